//! The job: every setting of a run, from `job.toml` and the command line. Reference: `docs/formats.md`.
//!
//! A key that is not known, a value out of range or a wrong type is refused with its line, the reason and the nearest
//! right name. The effective job of a run is written next to its results and replays to the same path.

pub mod quantity;
pub mod robot;

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::export::urscript;
use crate::feasibility;
use crate::pipeline;
use crate::toolpath::program::Motion;
use crate::toolpath::resampling::Sampling;
use quantity::{
    AirFeedMmS, ApproachMm, ClearanceMm, FeedMmS, Input, Output, PayloadKg, Points, RatioThreshold,
    SpacingMm, StandoffMm, TimeS,
};
use robot::{RobotSettings, TorchBodySettings};

/// Where the tip is assumed for the feasibility check if there is no `[tool]`: straight ahead of the flange, mm.
pub const ASSUMED_TCP_MM: f64 = 350.0;
/// Spacing of the waypoints when nothing else is said, mm.
const DEFAULT_SPACING_MM: f64 = 2.0;

/// Unit of a cloud whose file does not say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Units {
    /// Metres.
    M,
    /// Millimetres.
    Mm,
    /// Told from the size of what was scanned.
    #[default]
    Auto,
}

/// How seams are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The whole pipeline.
    #[default]
    Weldpath,
    /// The paper's eqs. (13)-(17) alone, for comparison.
    Paper,
}

/// Everything that decides what a run computes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Job {
    /// Folder with `scan.json`, or one cloud; relative to the job file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<PathBuf>,
    /// Unit of the input.
    pub units: Units,
    /// How seams are found.
    pub method: Method,
    /// Threshold `t` of eq. (16), for [`Method::Paper`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ratio_threshold: Option<RatioThreshold>,
    /// Which of the seams are welded.
    pub selection: Selection,
    /// How the torch moves.
    pub path: PathSettings,
    /// The arc's switches and times.
    pub arc: ArcSettings,
    /// The tool; without it the robot controller's own setting holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool: Option<ToolSettings>,
    /// The arm that shall run the program; without it reach and joints are not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotSettings>,
    /// Sizes of the torch; without it and without a robot, collisions are not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torch_body: Option<TorchBodySettings>,
}

/// `[selection]`: a seam is welded if it passes all that is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Selection {
    /// Ids; empty takes all.
    pub seams: Vec<usize>,
    /// The one seam nearest to this place, mm, base frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub near_mm: Option<quantity::Place>,
    /// Seams with at least half of their points in this box, mm, base frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub roi_mm: Option<quantity::Region>,
}

/// `[path]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PathSettings {
    /// Distance of the tip from the seam along the torch axis.
    pub standoff_mm: StandoffMm,
    /// Spacing of the waypoints; not together with `points`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spacing_mm: Option<SpacingMm>,
    /// Waypoints of each seam; not together with `spacing_mm`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<Points>,
    /// Weld speed.
    pub feed_mm_s: FeedMmS,
    /// Distance of approach and retract.
    pub approach_mm: ApproachMm,
    /// Speed from the approach to the seam and off it.
    pub approach_feed_mm_s: quantity::ApproachFeedMmS,
    /// Speed of air moves.
    pub air_feed_mm_s: AirFeedMmS,
    /// Height of air moves over the model.
    pub clearance_mm: ClearanceMm,
}

/// `[arc]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArcSettings {
    /// Digital output that starts the power source.
    pub output: Output,
    /// Digital output of a gas valve of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gas_output: Option<Output>,
    /// Digital input that is high while the arc burns.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub established_input: Option<Input>,
    /// Gas before the arc.
    pub gas_preflow_s: TimeS<500>,
    /// Time for the arc to establish.
    pub strike_s: TimeS<800>,
    /// Standing still at the end of a seam.
    pub crater_s: TimeS<300>,
    /// Gas after the arc.
    pub gas_postflow_s: TimeS<500>,
}

/// `[tool]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToolSettings {
    /// Tip of the wire in the flange's frame.
    pub flange_from_tcp_mm: quantity::Place,
    /// Rotation vector of the same transform; z out of the torch, into the work.
    pub flange_from_tcp_rotation_rad: quantity::RotationVector,
    /// Mass at the flange.
    pub payload_kg: PayloadKg,
    /// Centre of that mass in the flange's frame.
    #[serde(default)]
    pub payload_centre_mm: quantity::Place,
}

/// Why a job file is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Error {
    /// The file cannot be read at all.
    #[error("cannot read job file {}: {why}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        why: String,
    },
    /// A line of it makes no sense.
    #[error("{}:{line}: {why}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// What is wrong, in words.
        why: String,
        /// What to write instead.
        hint: String,
    },
}

impl Error {
    /// What to do about it.
    pub fn hint(&self) -> &str {
        match self {
            Self::Unreadable { .. } => {
                "every run of `weldpath plan` writes a complete job.toml to start from"
            }
            Self::Line { hint, .. } => hint,
        }
    }
}

impl Job {
    /// Reads a job file; its `input` is made relative to where the file is.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| Error::Unreadable { path: path.into(), why: error.to_string() })?;
        let mut job = Self::parse(&text, path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        job.input = job.input.map(|input| folder.join(input));
        Ok(job)
    }

    /// Parses the text of the job file at `path`, which is only named in errors.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let job: Self = toml::from_str(text).map_err(|error| line_error(text, path, &error))?;
        let refuse = |key: &str, why: &str, hint: &str| {
            let line = 1 + text.lines().position(|line| line.trim_start().starts_with(key)).unwrap_or(0);
            Err(Error::Line { path: path.into(), line, why: why.into(), hint: hint.into() })
        };
        if job.path.spacing_mm.is_some() && job.path.points.is_some() {
            return refuse("points", "spacing_mm and points exclude each other", "keep one of the two lines");
        }
        if job.ratio_threshold.is_some() && job.method == Method::Weldpath {
            return refuse(
                "ratio_threshold",
                "only the paper's method has a ratio_threshold",
                "add method = \"paper\", or leave the threshold to be found from the data",
            );
        }
        let faults =
            [job.robot.as_ref().and_then(RobotSettings::fault), job.torch_body.and_then(|t| t.fault())];
        if let Some((key, why)) = faults.into_iter().flatten().next() {
            return refuse(key, &why, "docs/feasibility.md lists the keys of [robot] and [torch_body]");
        }
        Ok(job)
    }

    /// The job as a file that plans the same; what was left to a default is written out.
    pub fn to_toml(&self) -> String {
        let mut job = self.clone();
        if let Sampling::SpacingMm(spacing_mm) = self.sampling() {
            job.path.spacing_mm = spacing_mm.try_into().ok();
        }
        if self.method == Method::Paper {
            job.ratio_threshold = Some(self.ratio_threshold.unwrap_or_default());
        }
        // Every type in it has a TOML form.
        toml::to_string(&job).unwrap_or_default()
    }

    /// The settings of the pipeline.
    pub fn pipeline(&self) -> pipeline::Config {
        let method = match self.method {
            Method::Weldpath => pipeline::Method::Weldpath,
            Method::Paper => {
                let ratio_threshold = self.ratio_threshold.unwrap_or_default().get();
                pipeline::Method::Paper { ratio_threshold }
            }
        };
        pipeline::Config { method, ..pipeline::Config::default() }
    }

    /// How densely the paths are sampled.
    pub fn sampling(&self) -> Sampling {
        match (self.path.points, self.path.spacing_mm) {
            (Some(points), _) => Sampling::Points(points.get() as usize),
            (None, spacing) => Sampling::SpacingMm(spacing.map_or(DEFAULT_SPACING_MM, SpacingMm::get)),
        }
    }

    /// How the torch moves.
    pub fn motion(&self) -> Motion {
        Motion {
            feed_mm_s: self.path.feed_mm_s.get(),
            approach_feed_mm_s: self.path.approach_feed_mm_s.get(),
            air_feed_mm_s: self.path.air_feed_mm_s.get(),
            approach_mm: self.path.approach_mm.get(),
            clearance_mm: self.path.clearance_mm.get(),
        }
    }

    /// What the feasibility check needs; none if neither a robot nor a torch is given.
    pub fn feasibility(&self) -> Option<feasibility::Setup> {
        if self.robot.is_none() && self.torch_body.is_none() {
            return None;
        }
        let body = self.torch_body.unwrap_or_default();
        let robot = self.robot.as_ref().and_then(|robot| {
            let flange_from_tcp = match &self.tool {
                Some(tool) => robot::pose(tool.flange_from_tcp_mm, tool.flange_from_tcp_rotation_rad),
                None => Isometry3::translation(0.0, 0.0, ASSUMED_TCP_MM),
            };
            let base_from_robot = robot.base_from_robot();
            Some(feasibility::Robot { arm: robot.arm()?, base_from_robot, flange_from_tcp })
        });
        Some(feasibility::Setup { robot, torch: body.torch(), clearance_mm: body.keep_off_mm })
    }

    /// What a robot controller needs beside the path.
    pub fn controller(&self) -> urscript::Settings {
        let tool = self.tool.as_ref().map(|tool| urscript::Tool {
            flange_from_tcp_mm: tool.flange_from_tcp_mm.get(),
            flange_from_tcp_rotation_rad: tool.flange_from_tcp_rotation_rad.get(),
            payload_kg: tool.payload_kg.get(),
            payload_centre_mm: tool.payload_centre_mm.get(),
        });
        let arc = urscript::Arc {
            output: self.arc.output.get() as u8,
            gas_output: self.arc.gas_output.map(|output| output.get() as u8),
            established_input: self.arc.established_input.map(|input| input.get() as u8),
            gas_preflow_s: self.arc.gas_preflow_s.get(),
            strike_s: self.arc.strike_s.get(),
            crater_s: self.arc.crater_s.get(),
            gas_postflow_s: self.arc.gas_postflow_s.get(),
        };
        urscript::Settings { tool, arc }
    }
}

fn line_error(text: &str, path: &Path, error: &toml::de::Error) -> Error {
    let line = line_of(text, error.span().map_or(0, |span| span.start));
    let why = error.message().to_owned();
    let hint = nearest_name(&why).map_or_else(
        || "docs/formats.md lists every key with its unit and range".to_owned(),
        |name| format!("did you mean `{name}`?"),
    );
    Error::Line { path: path.into(), line, why, hint }
}

/// Of "unknown field `a`, expected one of `b`, `c`" the name most like `a`.
fn nearest_name(message: &str) -> Option<&str> {
    let unknown = message.starts_with("unknown");
    let mut names = message.split('`').skip(1).step_by(2);
    let wrong = names.next().filter(|_| unknown)?;
    names.max_by(|a, b| strsim::jaro_winkler(wrong, a).total_cmp(&strsim::jaro_winkler(wrong, b)))
}

fn line_of(text: &str, byte: usize) -> usize {
    1 + text.bytes().take(byte).filter(|&b| b == b'\n').count()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FULL: &str = r#"
input = "scan"
units = "mm"
method = "paper"
ratio_threshold = 53
[selection]
seams = [2, 1]
near_mm = [1, 2.5, -3]
roi_mm = [[0, 0, 0], [100, 100, 50]]
[path]
standoff_mm = 12
points = 120
feed_mm_s = 6.5
[arc]
output = 3
established_input = 1
gas_preflow_s = 0.4
[tool]
flange_from_tcp_mm = [0, -50, 300]
flange_from_tcp_rotation_rad = [0, 0.5, 0]
payload_kg = 2.1
[robot]
model = "ur10e"
base_mm = [0, 0, -40]
[torch_body]
neck_deg = 22
"#;

    fn refused(text: &str) -> (usize, String, String) {
        match Job::parse(text, Path::new("job.toml")) {
            Err(Error::Line { line, why, hint, .. }) => (line, why, hint),
            other => panic!("{text:?} gave {other:?}"),
        }
    }

    #[test]
    fn a_written_job_reads_back_to_the_same_job() {
        for text in ["", FULL, "method = \"paper\""] {
            let job = Job::parse(text, Path::new("job.toml")).unwrap();
            let again = Job::parse(&job.to_toml(), Path::new("job.toml")).unwrap();
            assert_eq!(job.sampling(), again.sampling());
            assert_eq!(job.pipeline().method, again.pipeline().method);
            assert_eq!((job.motion(), job.controller()), (again.motion(), again.controller()));
            assert_eq!(job.selection, again.selection);
            assert_eq!((&job.robot, job.torch_body), (&again.robot, again.torch_body));
            assert_eq!(job.to_toml(), again.to_toml());
        }
    }

    #[test]
    fn a_written_job_spells_out_every_default() {
        let text = Job::default().to_toml();
        for line in
            ["spacing_mm = 2.0", "feed_mm_s = 8.0", "output = 0", "strike_s = 0.8", "units = \"auto\""]
        {
            assert!(text.lines().any(|l| l == line), "{line} is missing in\n{text}");
        }
    }

    #[test]
    fn settings_arrive_where_they_are_used() {
        let job = Job::parse(FULL, Path::new("job.toml")).unwrap();
        assert_eq!(job.sampling(), Sampling::Points(120));
        assert_eq!(job.motion().feed_mm_s, 6.5);
        let controller = job.controller();
        assert_eq!((controller.arc.output, controller.arc.established_input), (3, Some(1)));
        assert_eq!(controller.tool.unwrap().flange_from_tcp_mm, [0.0, -50.0, 300.0]);
        assert_eq!(Job::default().sampling(), Sampling::SpacingMm(2.0));
        assert_eq!(Job::default().motion().feed_mm_s, 8.0);
        assert_eq!(Job::default().motion().approach_mm, 50.0);
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_right_one() {
        let (line, why, hint) = refused("units = \"mm\"\n[path]\nfeed_m_s = 0.008\n");
        assert_eq!((line, hint.as_str()), (3, "did you mean `feed_mm_s`?"));
        assert!(why.contains("feed_m_s"));
        assert_eq!(refused("unit = \"mm\"").2, "did you mean `units`?");
        assert_eq!(refused("units = \"inch\"").0, 1);
        assert_eq!(refused("\n[arcs]\noutput = 1").2, "did you mean `arc`?");
    }

    #[test]
    fn numbers_out_of_range_are_refused_with_their_line_and_range() {
        for (text, part) in [
            ("[path]\nfeed_mm_s = -1", "-1"),
            ("[path]\nfeed_mm_s = 0", "mm/s"),
            ("[path]\nfeed_mm_s = nan", "number"),
            ("[path]\nspacing_mm = inf", "number"),
            ("[path]\npoints = 1", "at least 2"),
            ("[path]\npoints = 2.5", "whole"),
            ("[arc]\noutput = 8", "at most 7"),
            ("[arc]\noutput = true", "boolean"),
            ("[selection]\nnear_mm = [1, 2]", "length"),
            ("[selection]\nroi_mm = [[0, 0, 0], [1, -1, 1]]", "first corner"),
            ("[robot]\nmodel = \"ur6\"", "did you mean"),
            ("[torch_body]\nneck_deg = 120", "not -90 to 90"),
        ] {
            let (line, why, _) = refused(text);
            assert_eq!(line, 2, "{text}");
            assert!(why.contains(part), "{text}: {why}");
        }
    }

    #[test]
    fn settings_that_exclude_each_other_are_refused() {
        assert_eq!(refused("[path]\nspacing_mm = 2\npoints = 9").0, 3);
        assert_eq!(refused("units = \"m\"\nratio_threshold = 60").0, 2);
    }

    #[test]
    fn input_is_relative_to_the_job_file() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("job.toml");
        std::fs::write(&path, "input = \"scan\"").unwrap();
        assert_eq!(Job::read(&path).unwrap().input, Some(home.path().join("scan")));
        let missing = Job::read(&home.path().join("none.toml")).unwrap_err();
        assert!(missing.to_string().contains("none.toml"));
    }
}
