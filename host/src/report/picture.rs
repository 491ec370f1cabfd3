//! `report.svg`: the work from four sides without a browser: points, seams with ids, torch directions, scale bars.
//!
//! Parallel projection, frame of the scan, mm. The points are one embedded PNG a view ([`raster`]); all else is drawn.

mod raster;

use super::colour::{css, of_seam};
use super::content::Scene;
use super::page::html_text;
use super::run::Run;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use nalgebra::{Point2, Point3, Vector2, Vector3};
use rayon::prelude::*;
use std::fmt::Write;
use weldpath_job::output::frame::PathFrame;
use weldpath_job::output::verdict::ReasonId;
use weldpath_method::seam::{Seam, Unwelded};

/// Size of a view, px.
const WIDTH: f64 = 660.0;
const HEIGHT: f64 = 480.0;
const GAP: f64 = 16.0;
const HEADER: f64 = 52.0;
const ROW: f64 = 20.0;
/// Arrows of the torch along a seam, and their length, px.
const ARROWS: usize = 9;
const ARROW: f64 = 34.0;
/// Share of a view that the work fills.
const FILLED: f64 = 0.8;

/// A parallel projection onto a view.
struct Projection {
    centre_mm: Point3<f64>,
    right: Vector3<f64>,
    up: Vector3<f64>,
    toward: Vector3<f64>,
    px_per_mm: f64,
}

impl Projection {
    /// From `toward`, the whole work in view.
    fn new(scene: &Scene, toward: Vector3<f64>) -> Self {
        let any = if toward.dot(&scene.up).abs() > 0.99 { Vector3::y() } else { scene.up };
        let any = if toward.dot(&any).abs() > 0.99 { Vector3::x() } else { any };
        let right = any.cross(&toward).normalize();
        let up = toward.cross(&right);
        let range = |axis: &Vector3<f64>| {
            let along = scene.outline_mm.iter().map(|p| axis.dot(&(p - scene.centre_mm)));
            along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(v), high.max(v)])
        };
        let [[left, rightmost], [low, high]] = [range(&right), range(&up)];
        let centre_mm = scene.centre_mm + right * 0.5 * (left + rightmost) + up * 0.5 * (low + high);
        let fits = |px: f64, mm: f64| FILLED * px / mm.max(1.0);
        let px_per_mm = fits(WIDTH, rightmost - left).min(fits(HEIGHT, high - low));
        Self { centre_mm, right, up, toward, px_per_mm }
    }

    /// Place within the view, px, and height toward the eye, mm.
    fn place(&self, p_mm: &Point3<f64>) -> (Point2<f64>, f64) {
        let v = p_mm - self.centre_mm;
        let (x, y) = (self.right.dot(&v) * self.px_per_mm, self.up.dot(&v) * self.px_per_mm);
        (Point2::new(0.5 * WIDTH + x, 0.5 * HEIGHT - y), self.toward.dot(&v))
    }

    /// A direction within the view, px.
    fn direction(&self, v: &Vector3<f64>) -> Vector2<f64> {
        Vector2::new(self.right.dot(v), -self.up.dot(v))
    }
}

/// The whole picture.
pub(super) fn svg(run: &Run, scene: &Scene) -> String {
    let side = scene.up.cross(&scene.eye).try_normalize(1e-6).unwrap_or_else(Vector3::x);
    let front = side.cross(&scene.up);
    let views = [
        ("oblique", scene.eye),
        ("from above", scene.up),
        ("from the front", front),
        ("from the side", side),
    ];
    let seams = &run.plan.seams;
    let (width, views_high) = (2.0 * WIDTH + 3.0 * GAP, 2.0 * (HEIGHT + GAP));
    let height = HEADER + views_high + ROW * (seams.len() as f64 + 2.0);
    let mut text = head(run, width, height);
    let colours = raster::colours(&run.plan.model, scene);
    let drawn: Vec<String> = views
        .into_par_iter()
        .map(|(name, toward)| view(run, &colours, name, &Projection::new(scene, toward)))
        .collect();
    for (k, drawn) in drawn.iter().enumerate() {
        let x = GAP + (k % 2) as f64 * (WIDTH + GAP);
        let y = HEADER + (k / 2) as f64 * (HEIGHT + GAP);
        add(&mut text, format_args!("<g transform=\"translate({x} {y})\" clip-path=\"url(#view)\">"));
        text.push_str(drawn);
        text.push_str("</g>\n");
    }
    legend(&mut text, run, HEADER + views_high + ROW);
    text + "</svg>\n"
}

/// Writing to a String cannot fail.
fn add(text: &mut String, what: std::fmt::Arguments) {
    let _ = text.write_fmt(what);
}

fn head(run: &Run, width: f64, height: f64) -> String {
    let (title, seams) = (html_text(run.title), run.plan.seams.len());
    let warnings =
        run.output.summary.warnings().len() + run.plan.seams.iter().map(|s| s.warnings.len()).sum::<usize>();
    let count = |n: usize, what: &str| format!("{n} {what}{}", if n == 1 { "" } else { "s" });
    let (seams, warnings) = (count(seams, "seam"), count(warnings, "warning"));
    let frame = match run.output.summary.frame() {
        PathFrame::Base => "base frame",
        PathFrame::Camera => "the camera's frame",
        PathFrame::Unknown => "the scan's own frame",
    };
    let xmlns = "http://www.w3.org/2000/svg";
    format!(
        "<svg xmlns=\"{xmlns}\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
         font-family=\"system-ui, Helvetica, Arial, sans-serif\" font-size=\"13\" fill=\"#1b2430\">\n\
         <title>{title}</title>\n\
         <defs><clipPath id=\"view\"><rect width=\"{WIDTH}\" height=\"{HEIGHT}\" rx=\"6\"/></clipPath></defs>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
         <text x=\"{GAP}\" y=\"33\" font-size=\"20\" font-weight=\"600\">{title}</text>\n\
         <text x=\"{}\" y=\"33\" text-anchor=\"end\" fill=\"#5b6675\">{seams}, {warnings}; {frame}, mm</text>\n",
        width - GAP
    )
}

fn view(run: &Run, colours: &[[f32; 3]], name: &str, projection: &Projection) -> String {
    let mut whole = String::new();
    let text = &mut whole;
    add(text, format_args!("<rect width=\"{WIDTH}\" height=\"{HEIGHT}\" fill=\"#f3f5f8\"/>"));
    let png = raster::png(&run.plan.model, colours, projection, voxel_mm(run));
    let png = STANDARD.encode(png);
    add(
        text,
        format_args!("<image width=\"{WIDTH}\" height=\"{HEIGHT}\" href=\"data:image/png;base64,{png}\"/>\n"),
    );
    run.plan.unwelded.iter().for_each(|corner| thin_line(text, corner, projection));
    run.plan.seams.iter().for_each(|seam| line(text, seam, projection));
    run.output.paths.iter().for_each(|path| {
        let every = path.points.len().div_ceil(ARROWS).max(1);
        let half = (path.points.len() % every.max(2)) / 2;
        for point in path.points.iter().skip(half).step_by(every) {
            arrow(text, &projection.place(&point.position_mm).0, &projection.direction(&point.out_of_work()));
        }
    });
    run.plan.seams.iter().for_each(|seam| label(text, seam, projection));
    backed(text, 8.0, name, "");
    assumed(text, run);
    axes(text, projection);
    scale_bar(text, projection.px_per_mm);
    whole
}

/// What the pose of what is shown is assumed to be, by the reason of the verdict that asks about it.
const ASSUMED: [(ReasonId, &str); 3] = [
    (ReasonId::SideAssumed, "side assumed: check that the torch is on the open side"),
    (ReasonId::FrameUnknown, "pose assumed: as if it were in the robot's base frame"),
    (ReasonId::CameraFrame, "pose unknown: all is in the camera's frame"),
];

/// Says it below the name of a view.
fn assumed(text: &mut String, run: &Run) {
    let reasons = &run.output.summary.verdict().reasons;
    let notes = ASSUMED.iter().filter(|(id, _)| reasons.iter().any(|reason| reason.id == *id));
    for (k, (_, words)) in notes.enumerate() {
        backed(text, 35.5 + 24.0 * k as f64, words, " fill=\"#a85a00\" font-weight=\"600\"");
    }
}

/// Words on a light ground, which begins at `top`, px.
fn backed(text: &mut String, top: f64, words: &str, style: &str) {
    add(
        text,
        format_args!(
            "<rect x=\"8\" y=\"{top}\" width=\"{}\" height=\"22\" rx=\"4\" fill=\"#ffffff\" fill-opacity=\"0.85\"/>\
             <text x=\"15\" y=\"{}\"{style}>{words}</text>\n",
            16 + 7 * words.len(),
            top + 15.5,
        ),
    );
}

fn voxel_mm(run: &Run) -> f64 {
    run.plan.derived.parameters.iter().find(|d| d.name == "voxel_mm").map_or(1.0, |d| d.value)
}

/// Colour of inside corners that are no seams.
const UNWELDED: &str = "#b36b00";

/// An inside corner that is no seam.
fn thin_line(text: &mut String, corner: &Unwelded, projection: &Projection) {
    let points = points(corner.line_mm.iter(), projection);
    add(
        text,
        format_args!(
            "<polyline fill=\"none\" stroke=\"{UNWELDED}\" stroke-width=\"1.4\" points=\"{points}\"/>\n"
        ),
    );
}

/// Places of a line within the view, px.
fn points<'a>(places_mm: impl Iterator<Item = &'a Point3<f64>>, projection: &Projection) -> String {
    let mut points = String::new();
    for place_mm in places_mm {
        let p = projection.place(place_mm).0;
        add(&mut points, format_args!("{:.1},{:.1} ", p.x, p.y));
    }
    points
}

fn line(text: &mut String, seam: &Seam, projection: &Projection) {
    let places = seam.stations.iter().chain(seam.stations.first().filter(|_| seam.closed));
    let points = points(places.map(|station| &station.position_mm), projection);
    let colour = css(of_seam(seam.id));
    let stroke = "fill=\"none\" stroke-linejoin=\"round\" stroke-linecap=\"round\"";
    for (colour, width) in [("#ffffff", 6.5), (colour.as_str(), 3.5)] {
        add(
            text,
            format_args!(
                "<polyline {stroke} stroke=\"{colour}\" stroke-width=\"{width}\" points=\"{points}\"/>\n"
            ),
        );
    }
}

/// The torch axis, tip on the seam; `n` is its projection, shorter where it points at the eye.
fn arrow(text: &mut String, tip: &Point2<f64>, n: &Vector2<f64>) {
    let end = tip + n * ARROW;
    add(
        text,
        format_args!(
            "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"#10151c\" stroke-width=\"1.6\"/>\
             <circle cx=\"{:.1}\" cy=\"{:.1}\" r=\"2.2\" fill=\"#10151c\"/>\n",
            end.x, end.y, tip.x, tip.y, tip.x, tip.y
        ),
    );
}

fn label(text: &mut String, seam: &Seam, projection: &Projection) {
    let Some(middle) = seam.stations.get(seam.stations.len() / 2) else { return };
    let n = (middle.faces[0] + middle.faces[1]).try_normalize(1e-6).unwrap_or_default();
    let p = projection.place(&middle.position_mm).0 + projection.direction(&n) * (1.6 * ARROW);
    let (x, y) = (p.x.clamp(14.0, WIDTH - 14.0), p.y.clamp(14.0, HEIGHT - 14.0));
    add(
        text,
        format_args!(
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"11\" fill=\"{}\" stroke=\"#ffffff\" stroke-width=\"2\"/>\
             <text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"#ffffff\" font-weight=\"700\">{}</text>\n",
            css(of_seam(seam.id)),
            y + 4.5,
            seam.id
        ),
    );
}

fn axes(text: &mut String, projection: &Projection) {
    let origin = Point2::new(44.0, HEIGHT - 44.0);
    let back = format!("<rect x=\"6\" y=\"{}\" width=\"76\" height=\"76\" rx=\"4\"", HEIGHT - 82.0);
    add(text, format_args!("{back} fill=\"#ffffff\" fill-opacity=\"0.8\"/>"));
    let named =
        [("x", Vector3::x(), "#d02f2f"), ("y", Vector3::y(), "#2a8f3c"), ("z", Vector3::z(), "#2b5fd0")];
    for (name, axis, colour) in named {
        let v = projection.direction(&axis);
        let (end, beyond) = (origin + v * 26.0, origin + v * 35.0);
        // An axis along the line of sight has no length in the picture.
        if v.norm() > 0.15 {
            add(
                text,
                format_args!(
                    "<path d=\"M{:.1} {:.1}L{:.1} {:.1}\" stroke=\"{colour}\" stroke-width=\"2\"/>\
                     <text x=\"{:.1}\" y=\"{:.1}\" text-anchor=\"middle\" fill=\"{colour}\">{name}</text>\n",
                    origin.x,
                    origin.y,
                    end.x,
                    end.y,
                    beyond.x,
                    beyond.y + 4.0
                ),
            );
        }
    }
}

/// A bar of 1, 2 or 5 times a power of ten, mm, at most a quarter of the view wide.
fn scale_bar(text: &mut String, px_per_mm: f64) {
    let most_mm = 0.25 * WIDTH / px_per_mm;
    let power = 10f64.powf(most_mm.log10().floor());
    let length_mm = [5.0, 2.0, 1.0].map(|f| f * power).into_iter().find(|mm| *mm <= most_mm).unwrap_or(power);
    let (right, y) = (WIDTH - 20.0, HEIGHT - 20.0);
    let left = right - length_mm * px_per_mm;
    let (from, width) = (left - 10.0, right - left + 20.0);
    let back =
        format!("<rect x=\"{from:.1}\" y=\"{}\" width=\"{width:.1}\" height=\"36\" rx=\"4\"", y - 28.0);
    add(text, format_args!("{back} fill=\"#ffffff\" fill-opacity=\"0.8\"/>"));
    add(
        text,
        format_args!(
            "<path d=\"M{left:.1} {}v8h{:.1}v-8\" fill=\"none\" stroke=\"#10151c\" stroke-width=\"1.6\"/>\
             <text x=\"{:.1}\" y=\"{}\" text-anchor=\"middle\">{length_mm} mm</text>",
            y - 8.0,
            right - left,
            0.5 * (left + right),
            y - 8.0
        ),
    );
}

fn legend(text: &mut String, run: &Run, top: f64) {
    if !run.plan.unwelded.is_empty() {
        let y = top + ROW * run.plan.seams.len() as f64;
        add(
            text,
            format_args!(
                "<rect x=\"{GAP}\" y=\"{}\" width=\"14\" height=\"2\" fill=\"{UNWELDED}\"/>\
                 <text x=\"{}\" y=\"{y}\">inside corners that are no seams: summary.json says why</text>\n",
                y - 6.0,
                GAP + 24.0,
            ),
        );
    }
    for (k, seam) in run.plan.seams.iter().enumerate() {
        let y = top + ROW * k as f64;
        let joint = run.output.summary.joint(seam.id).unwrap_or(seam.joint).name();
        let selected = run.output.paths.iter().any(|path| path.seam == seam.id);
        add(
            text,
            format_args!(
                "<rect x=\"{GAP}\" y=\"{}\" width=\"14\" height=\"10\" fill=\"{}\"/>\
                 <text x=\"{}\" y=\"{y}\">seam {}: {joint}, {:.1} mm, confidence {:.0} %, expected error {:.2} mm and {:.2} deg{}</text>\n",
                y - 10.0,
                css(of_seam(seam.id)),
                GAP + 24.0,
                seam.id,
                seam.length_mm(),
                100.0 * seam.confidence,
                seam.tip_error_mm(),
                seam.tip_error_deg(),
                if selected { "" } else { "; not selected" }
            ),
        );
    }
}
