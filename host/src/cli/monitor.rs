//! `weldpath monitor`: the pendant's telemetry, by listening only.

use std::io::Read;
use std::time::{Duration, Instant};

use weldpath::pendant::link::{Error, Noise, cause_words, fault_words, is_passing, state_words};
use weldpath::pendant::serial;
use weldpath_core::wire::frame::{self, Received};
use weldpath_core::wire::{FromPendant, PendantDeframer, PendantMessage, Telemetry};

use super::port::Port;
use super::{Exit, Failure, print};

/// Show the pendant's state as it reports it
///
/// Only listens, so the pendant is not disturbed: no session is opened, and a loaded path stays. Prints a line when
/// something changes, and every second.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    port: Port,
    /// End after this many reports [default: never]
    #[arg(long, value_name = "N")]
    count: Option<u64>,
    /// Print every report as a line of JSON
    #[arg(long)]
    json: bool,
}

/// After this long without a report there is no pendant.
const SILENCE: Duration = Duration::from_secs(3);
const PERIOD: Duration = Duration::from_secs(1);

pub(super) fn run(args: &Args) -> Result<(), Failure> {
    let line = serial::open(&args.port.port, args.port.baud)
        .map_err(|error| Failure::new(Exit::Pendant, &error).hint(error.hint()))?;
    let mut reports =
        Reports { reader: line.reader, bytes: Box::default(), noise: Noise::default(), read: Vec::new() };
    let (mut seen, mut shown) = (0, None);
    while args.count.is_none_or(|count| seen < count) {
        let report = reports.next()?;
        seen += 1;
        if args.json {
            let line = serde_json::to_string(&report).map_err(|error| Failure::new(Exit::Output, error))?;
            print(&format!("{line}\n"))?;
        } else if worth_a_line(&mut shown, &report) {
            print(&words(&report))?;
        }
    }
    Ok(())
}

fn worth_a_line(shown: &mut Option<(Telemetry, Instant)>, report: &Telemetry) -> bool {
    let key = |r: &Telemetry| (r.state, r.changes, r.cause, r.fault, r.arc, r.pins, r.finished);
    let news = !matches!(shown, Some((last, at)) if key(last) == key(report) && at.elapsed() < PERIOD);
    if news {
        *shown = Some((*report, Instant::now()));
    }
    news
}

/// Bytes into reports.
struct Reports {
    reader: Box<dyn Read + Send>,
    bytes: Box<PendantDeframer>,
    noise: Noise,
    read: Vec<u8>,
}

impl Reports {
    fn next(&mut self) -> Result<Telemetry, Failure> {
        let heard = Instant::now();
        while heard.elapsed() < SILENCE {
            let mut rest = std::mem::take(&mut self.read).into_iter();
            while let Some(byte) = rest.next() {
                let Some(Received::Payload(payload)) = self.bytes.push(byte) else { continue };
                match frame::decode(payload) {
                    Ok(FromPendant { message: PendantMessage::Telemetry(report), .. }) => {
                        self.read = rest.collect();
                        return Ok(report);
                    }
                    Ok(_) => {}
                    Err(_) => self.noise.frames += 1,
                }
            }
            self.read()?;
        }
        let why = format!("no report for {} s{}", SILENCE.as_secs(), self.noise);
        Err(Failure::new(Exit::Pendant, why).hint(Error::NoAnswer(self.noise).hint()))
    }

    fn read(&mut self) -> Result<(), Failure> {
        let mut buffer = [0; 1024];
        match self.reader.read(&mut buffer) {
            Ok(0) => Err(Failure::new(Exit::Pendant, "the line was closed at the other end")),
            Ok(count) => {
                self.noise.hear(&buffer[..count]);
                self.read.extend_from_slice(&buffer[..count]);
                Ok(())
            }
            Err(error) if is_passing(&error) => Ok(()),
            Err(error) => Err(Failure::new(Exit::Pendant, format!("the line failed: {error}"))),
        }
    }
}

fn words(report: &Telemetry) -> String {
    let [x, y, z] = report.pose.position_um.map(|um| f64::from(um) / 1000.0);
    let pins = [
        (Telemetry::E_STOP, "E-STOP"),
        (Telemetry::ENABLE, "enable"),
        (Telemetry::ENABLED, "enabled"),
        (Telemetry::ARMED, "armed"),
        (Telemetry::MANUAL, "manual"),
        (Telemetry::GAS, "gas"),
        (Telemetry::ARC, "ARC"),
    ];
    let pins: String =
        pins.iter().filter(|(bit, _)| report.pins & bit != 0).map(|(_, name)| format!(" {name}")).collect();
    let load =
        report.load.map(|load| format!(" path {} loaded {}", load.path, load.next)).unwrap_or_default();
    let why = report.fault.map(fault_words).or(report.cause.map(cause_words));
    format!(
        "{:>9.3} s {:8} segment {} at {:.1} mm/s x {x:.2} y {y:.2} z {z:.2} mm{load}{pins}{}\n",
        f64::from(report.tick) * 0.002,
        state_words(report.state),
        report.segment,
        f64::from(report.speed_um_s) / 1000.0,
        why.map(|why| format!(": {why}")).unwrap_or_default(),
    )
}
