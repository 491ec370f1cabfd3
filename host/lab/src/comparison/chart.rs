//! Line charts as SVG.

use plotters::prelude::*;

/// A line: its name, its colour, its points.
pub(super) struct Line {
    pub name: String,
    pub colour: RGBColor,
    pub points: Vec<(f64, f64)>,
}

/// Blue, orange, green, grey: told apart by the colour-blind, too.
pub(super) const COLOURS: [RGBColor; 4] =
    [RGBColor(0, 90, 181), RGBColor(220, 120, 0), RGBColor(0, 130, 90), RGBColor(110, 110, 110)];

/// What is below a chart, and how it is spaced.
#[derive(Clone, Copy)]
pub(super) enum Axis {
    Linear(&'static str),
    Logarithmic(&'static str),
}

impl Axis {
    fn name(self) -> &'static str {
        let (Self::Linear(name) | Self::Logarithmic(name)) = self;
        name
    }

    /// Where a value is drawn.
    fn place(self, value: f64) -> f64 {
        if let Self::Logarithmic(_) = self { value.log10() } else { value }
    }

    /// What is drawn at a place.
    fn value(self, place: f64) -> f64 {
        if let Self::Logarithmic(_) = self { 10_f64.powf(place) } else { place }
    }
}

/// A chart of `lines`, y from 0 to 1; empty text if it cannot be drawn.
pub(super) fn svg(title: &str, x: Axis, y: &str, lines: &[Line]) -> String {
    let mut text = String::new();
    match draw(&mut text, title, x, y, lines) {
        Ok(()) => text,
        Err(_) => String::new(),
    }
}

type Failed = Box<dyn std::error::Error>;

fn draw(text: &mut String, title: &str, x: Axis, y: &str, lines: &[Line]) -> Result<(), Failed> {
    let all = || lines.iter().flat_map(|line| line.points.iter().map(|p| x.place(p.0)));
    let (low, high) = all().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let range = if low < high { low..high } else { 0.0..1.0 };
    let root = SVGBackend::with_string(text, (680, 380)).into_drawing_area();
    let fail = |e: DrawingAreaErrorKind<std::io::Error>| -> Failed { e.to_string().into() };
    root.fill(&WHITE).map_err(fail)?;
    let mut chart = ChartBuilder::on(&root)
        .caption(title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(52)
        .build_cartesian_2d(range, 0.0..1.0)
        .map_err(fail)?;
    let label = |v: &f64| format!("{:.0}", x.value(*v));
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(x.name()).y_desc(y).x_label_formatter(&label);
    mesh.light_line_style(WHITE).draw().map_err(fail)?;
    for line in lines {
        let colour = line.colour;
        chart
            .draw_series(LineSeries::new(
                line.points.iter().map(|&(at, y)| (x.place(at), y)),
                colour.stroke_width(2),
            ))
            .map_err(fail)?
            .label(line.name.as_str())
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
    }
    let mut labels = chart.configure_series_labels();
    labels.position(SeriesLabelPosition::MiddleRight);
    labels.background_style(WHITE.mix(0.8)).border_style(RGBColor(200, 200, 200)).draw().map_err(fail)?;
    root.present().map_err(fail)
}
