//! The job: every setting of a run, from `job.toml` and the command line. Reference: `docs/formats.md`.
//!
//! A key that is not known, a value out of range or a wrong type is refused with its line, the reason and the nearest
//! right name ([`refusal`]). The effective job of a run is written next to its results and replays to the same path.
//! How a weld is made is a [`layer`]: the whole job's, a seam's own on top of it, and a pass's on top of that.

pub mod ask;
pub mod calibration;
pub mod exclude;
pub mod frame;
pub mod layer;
pub mod quantity;
pub mod refusal;
pub mod resume;
pub mod robot;
pub mod scan;
pub mod touch;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::output::verdict::ReasonId;
use crate::robot::arc::WeldingArc;
use crate::robot::dialect::{Dialect, ProgramSetup, WelddataUnit};
use crate::robot::feasibility::arm::Counting;
use crate::robot::feasibility::{self, FeasibilitySetup, PlacedArm};
use crate::robot::tool::Tool;
use ask::{AskSettings, DrawSettings};
use calibration::CalibrationSettings;
use exclude::ExcludeSettings;
use frame::ToolSetting;
pub use layer::{
    PassSettings, PathSettings, SeamSettings, StitchSettings, TorchSettings, WeaveSettings, Weld,
};
use quantity::{DepthScaleM, Input, Output, PayloadKg, ProgramName, RatioThreshold, TimeS};
pub use refusal::Error;
use resume::ResumeSettings;
use robot::{RobotSettings, TorchBodySettings};
use scan::ScanSettings;
use touch::TouchSettings;
use weldpath_files::reading;
use weldpath_method::input::{CameraPosition, Intrinsics, MeshAs, StatedFrame, Units};
use weldpath_method::pipeline::{self, Method};
use weldpath_method::seam::Joint;
use weldpath_method::weld::recipe::Recipe;

/// Where the tip is assumed for the feasibility check if there is no `[tool]`: straight ahead of the flange, mm.
pub(crate) const ASSUMED_TCP_MM: f64 = 350.0;

/// Everything that decides what a run computes.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Job {
    /// Folder with `scan.json`, or one cloud; relative to the job file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub input: Option<PathBuf>,
    /// Unit of the input.
    pub units: Units,
    /// Intrinsics of depth images that come without: fx, fy, cx, cy in pixels, then k1, k2, p1, p2, k3.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<Intrinsics>,
    /// Metres per count of the same images; 0.001 if not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub depth_scale_m: Option<DepthScaleM>,
    /// Camera position of a cloud that stores none: x, y, z in mm, in the cloud's own frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub camera_mm: Option<CameraPosition>,
    /// Frame of a cloud's coordinates, if its file does not state it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<StatedFrame>,
    /// Whether a file with faces is exact CAD or a scan, if its data do not show which.
    #[serde(rename = "as", skip_serializing_if = "Option::is_none")]
    pub mesh_as: Option<MeshAs>,
    /// How seams are found.
    pub method: Method,
    /// Threshold `t` of eq. (16), for the method of the paper.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ratio_threshold: Option<RatioThreshold>,
    /// Robots whose programs are written; by default that of the arm's maker, and URScript where no arm is named.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub formats: Option<Vec<Dialect>>,
    /// Reasons of the verdict against running the program that are accepted, by their ids.
    pub accept: Vec<ReasonId>,
    /// How exact the robot's poses and the hand-eye transform are.
    pub scan: ScanSettings,
    /// What is scanned but does not belong to the work.
    #[serde(skip_serializing_if = "ExcludeSettings::is_empty")]
    pub exclude: ExcludeSettings,
    /// Places that the robot's own tip touched.
    #[serde(rename = "touch", skip_serializing_if = "Vec::is_empty")]
    pub touches: Vec<TouchSettings>,
    /// Seams that the search missed.
    #[serde(rename = "ask", skip_serializing_if = "Vec::is_empty")]
    pub asks: Vec<AskSettings>,
    /// Lines that are drawn on the surface, where no seam can be found.
    #[serde(rename = "draw", skip_serializing_if = "Vec::is_empty")]
    pub draws: Vec<DrawSettings>,
    /// Which of the seams are welded.
    pub selection: Selection,
    /// Order in which the seams are welded.
    pub order: OrderSettings,
    /// How the torch moves along a seam.
    pub path: PathSettings,
    /// How the torch leans.
    pub torch: TorchSettings,
    /// How the tip swings.
    pub weave: WeaveSettings,
    /// Whether only stretches are welded.
    pub stitch: StitchSettings,
    /// The arc's switches and times.
    pub arc: ArcSettings,
    /// The tool; without it the robot controller's own setting applies.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool: Option<ToolSettings>,
    /// The arm that will run the program; without it reach and joints are not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<RobotSettings>,
    /// Sizes of the torch; without it and without a robot, collisions are not checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub torch_body: Option<TorchBodySettings>,
    /// Names and numbers in the robot programs.
    pub program: ProgramSettings,
    /// The rest of a weld that was broken off, in place of the whole program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub resume: Option<ResumeSettings>,
    /// Passes of every seam, in their order; without any, one pass on the seam's line.
    #[serde(rename = "pass", skip_serializing_if = "Vec::is_empty")]
    pub passes: Vec<PassSettings>,
    /// How all seams of a joint type are welded, over what holds for the whole job.
    #[serde(rename = "joint", skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("propertyNames" = { "$ref": "#/$defs/Joint" }))]
    pub joints: BTreeMap<Joint, Weld>,
    /// What single seams have of their own.
    #[serde(rename = "seam", skip_serializing_if = "Vec::is_empty")]
    pub seams: Vec<SeamSettings>,
}

/// `[program]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ProgramSettings {
    /// Of programs, and of the files of dialects in which the two are one.
    pub name: ProgramName,
    /// Number of the tool on controllers that number them.
    pub tool_number: quantity::ToolNumber,
    /// Number of the weld data on controllers that keep it themselves.
    pub weld_schedule: quantity::WeldSchedule,
    /// FANUC: number of the weld procedure; with it programs say `Weld Start[procedure, schedule]` in place of `Arc Start`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub weld_procedure: Option<quantity::WeldProcedure>,
    /// ABB: the unit of speed in welddata, by the controller's Arc units.
    pub welddata_unit: WelddataUnit,
}

/// `[selection]`: a seam is welded if it passes all that is given.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
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

/// `[order]`: which seam comes next, how the torch goes there, and which way is up.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OrderSettings {
    /// Which seam comes next.
    pub sequence: Sequence,
    /// How the torch goes from seam to seam.
    pub air: AirMoves,
    /// Against gravity, base frame; any length. For vertical-up, vertical-down and the names of welding positions.
    pub up: quantity::Up,
}

/// Which seam comes next.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum Sequence {
    /// Least air way; seams whose direction is free may be turned round.
    #[default]
    Shortest,
    /// By id; none is turned round unless its `direction` says so.
    Found,
    /// As their `[[seam]]` are listed, the others behind them by id; none is turned round unless its `direction` says so.
    Listed,
}

/// How the torch goes from seam to seam.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum AirMoves {
    /// The shortest way found that keeps the torch clear of everything scanned.
    #[default]
    Shortest,
    /// Up above everything scanned, across, and down again.
    SafeLevel,
}

/// `[arc]`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArcSettings {
    /// Digital output that starts the power source.
    pub output: Output,
    /// Digital output of a gas valve of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gas_output: Option<Output>,
    /// Digital input that is high while the arc burns: the power source says that the arc is established.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub established_input: Option<Input>,
    /// Gas before the arc.
    pub gas_preflow_s: TimeS<500>,
    /// Strike: how long the arc may take to establish itself, once power and wire are on.
    pub strike_s: TimeS<800>,
    /// Standing still at the end of a seam.
    pub crater_s: TimeS<300>,
    /// Gas after the arc.
    pub gas_postflow_s: TimeS<500>,
}

/// `[tool]`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
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

impl Job {
    /// Reads a job file; its `input` is made relative to where the file is.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let text = reading::text(path, reading::MOST_JOB)
            .map_err(|error| Error::Unreadable { path: path.into(), why: error.to_string() })?;
        let mut job = Self::parse(&text, path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        job.input = job.input.map(|input| folder.join(input));
        job.exclude = job.exclude.within(folder);
        Ok(job)
    }

    /// Parses the text of the job file at `path`, which is only named in errors.
    ///
    /// ```
    /// use std::path::Path;
    /// use weldpath_job::run::job::Job;
    ///
    /// let job = Job::parse("[path]\nfeed_mm_s = 6.5\n", Path::new("job.toml"))?;
    /// assert!(job.to_toml().contains("feed_mm_s = 6.5"));
    /// let error = Job::parse("[path]\nfeed_mm_min = 400\n", Path::new("job.toml")).unwrap_err();
    /// assert_eq!(error.hint(), "did you mean `feed_mm_s`? It is in millimetres per second; convert the number");
    /// # Ok::<(), weldpath_job::run::job::Error>(())
    /// ```
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let job: Self = toml::from_str(text).map_err(|error| refusal::of_toml(text, path, &error))?;
        refusal::check(&job, text, path)?;
        Ok(job)
    }

    /// Refuses what no single key shows; a job that was read is checked already.
    ///
    /// # Errors
    /// As of a file with this job.
    pub fn check(&self) -> Result<(), Error> {
        refusal::check(self, &self.to_toml(), Path::new("job.toml"))
    }

    /// The job as a file that plans the same; what was left to a default is written out.
    pub fn to_toml(&self) -> String {
        let Weld { path, torch, weave, stitch, .. } = self.weld().filled();
        let ratio_threshold = match self.method {
            Method::Paper => Some(self.ratio_threshold.unwrap_or_default()),
            Method::Weldpath => self.ratio_threshold,
        };
        let formats = Some(self.dialects());
        let job = Self { ratio_threshold, formats, path, torch, weave, stitch, ..self.clone() };
        // Every type in it has a TOML form but a path that is no text; without it the job still says how to weld.
        toml::to_string(&job).or_else(|_| toml::to_string(&Self { input: None, ..job })).unwrap_or_default()
    }

    /// The JSON schema of a job file, for editors.
    pub fn schema() -> String {
        let schema = schemars::schema_for!(Self);
        serde_json::to_string_pretty(&schema).map(|text| text + "\n").unwrap_or_default()
    }

    /// Whose programs are written.
    pub fn dialects(&self) -> Vec<Dialect> {
        let of_the_arm = || {
            let maker = self.robot.as_ref()?.arm()?.counting?.maker?;
            Dialect::ALL.iter().copied().find(|dialect| dialect.maker() == Some(maker))
        };
        self.formats.clone().unwrap_or_else(|| vec![of_the_arm().unwrap_or_default()])
    }

    /// How every seam is welded that has nothing of its own.
    pub fn weld(&self) -> Weld {
        let (path, torch, weave, stitch) = (self.path, self.torch, self.weave, self.stitch);
        Weld { path, torch, weave, stitch, passes: self.passes.clone() }
    }

    /// How passes are welded: with the settings of each seam and each joint type on top of the job's, and with the job's alone.
    pub fn recipes(&self) -> Vec<Recipe> {
        let of_all = self.weld();
        let of_joints = self.joints.values().map(|joint| joint.on(&of_all));
        let below: Vec<Weld> = of_joints.chain([of_all.clone()]).collect();
        // Which joint a seam has, only the scan tells.
        let on = |below: &Weld| self.seams.iter().map(|seam| seam.weld().on(below)).collect::<Vec<_>>();
        let welds: Vec<Weld> = below.iter().flat_map(on).chain(below.clone()).collect();
        welds.iter().flat_map(|weld| weld.passes()).map(|(recipe, _)| recipe).collect()
    }

    /// The settings of the pipeline.
    pub fn pipeline(&self) -> pipeline::Config {
        let anchor = Some(self.scan.anchor());
        let calibration = self.scan.calibration.as_ref().map(CalibrationSettings::calibration);
        let exclusion = self.exclude.exclusion();
        let asked = self.asks.iter().map(AskSettings::places_mm).collect();
        let ratio_threshold = self.ratio_threshold.unwrap_or_default().get();
        let drawn = self.draws.iter().map(DrawSettings::places_mm).collect();
        pipeline::Config {
            method: self.method,
            merge: pipeline::MergeConfig { anchor, calibration, ..Default::default() },
            search: pipeline::SearchConfig { exclusion, ratio_threshold, ..Default::default() },
            wishes: pipeline::Wishes { asked, drawn, kept_back: Vec::new() },
        }
    }

    /// What the feasibility check needs; none if neither a robot nor a torch is given.
    pub fn feasibility(&self) -> Option<FeasibilitySetup> {
        let robot = self.robot.as_ref().and_then(|robot| {
            let assumed = Isometry3::translation(0.0, 0.0, ASSUMED_TCP_MM);
            let flange_from_tcp = self.tool().map_or(assumed, |tool| tool.flange_from_tcp());
            let arm = robot.arm()?;
            let home = |counting: Counting| Some(counting.from_shown_rad(&robot.home_deg?));
            let home_rad = arm.counting.and_then(home);
            let (base_from_robot, floor, end) = (robot.base_from_robot(), robot.floor(), robot.end);
            Some(PlacedArm { arm, base_from_robot, flange_from_tcp, floor, home_rad, end })
        });
        if robot.is_none() && self.torch_body.is_none() {
            return None;
        }
        let clearance_mm = self.torch_body.unwrap_or_default().keep_off_mm;
        Some(FeasibilitySetup { robot, torch: self.torch_body(), clearance_mm })
    }

    /// Sizes of the torch; a straight one of usual size if nothing is said.
    pub fn torch_body(&self) -> feasibility::torch::Torch {
        self.torch_body.unwrap_or_default().torch()
    }

    /// What a robot controller has to know about the tool; none leaves what is set there.
    pub fn tool(&self) -> Option<Tool> {
        self.tool.as_ref().map(|tool| Tool {
            flange_from_tcp_mm: tool.flange_from_tcp_mm.get(),
            flange_from_tcp_rotation_rad: tool.flange_from_tcp_rotation_rad.get(),
            payload_kg: tool.payload_kg.get(),
            payload_centre_mm: tool.payload_centre_mm.get(),
        })
    }

    /// How the arc is switched.
    pub fn arc(&self) -> WeldingArc {
        WeldingArc {
            output: self.arc.output.get() as u8,
            gas_output: self.arc.gas_output.map(|output| output.get() as u8),
            established_input: self.arc.established_input.map(|input| input.get() as u8),
            gas_preflow_s: self.arc.gas_preflow_s.get(),
            strike_s: self.arc.strike_s.get(),
            crater_s: self.arc.crater_s.get(),
            gas_postflow_s: self.arc.gas_postflow_s.get(),
        }
    }

    /// A frame or a tool that one of its dialects cannot name so: the key, and why.
    pub fn unwritable(&self) -> Option<(&'static str, String)> {
        self.robot.as_ref()?.unwritable(&self.dialects(), self.tool.is_some())
    }

    /// What the robot programs need beside the path.
    pub fn program_setup(&self) -> ProgramSetup {
        let stated = self.robot.as_ref().and_then(|robot| robot.tool.as_ref());
        let tool_source = stated.map(ToolSetting::source).unwrap_or_default();
        ProgramSetup {
            name: self.program.name.to_string(),
            frame: self.robot.as_ref().map(RobotSettings::frame).unwrap_or_default(),
            tool_number: tool_source.number().unwrap_or(self.program.tool_number.get()),
            tool_source,
            weld_schedule: self.program.weld_schedule.get(),
            weld_procedure: self.program.weld_procedure.map(quantity::WeldProcedure::get),
            welddata_unit: self.program.welddata_unit,
            tool: self.tool(),
            arc: self.arc(),
            posture: None,
            remarks: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use weldpath_method::weld::resampling::Sampling;
    use weldpath_method::weld::stitching::Pattern;

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
            assert_eq!(job.weld().filled(), again.weld().filled());
            assert_eq!(job.pipeline().search.ratio_threshold, again.pipeline().search.ratio_threshold);
            assert_eq!(job.program_setup(), again.program_setup());
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
        assert_eq!(job.weld().sampling(), Sampling::Points(120));
        assert_eq!(job.weld().motion().feed_mm_s, 6.5);
        let controller = job.program_setup();
        assert_eq!((controller.arc.output, controller.arc.established_input), (3, Some(1)));
        assert_eq!(controller.tool.unwrap().flange_from_tcp_mm, [0.0, -50.0, 300.0]);
        let default = Job::default().weld();
        assert_eq!(default.sampling(), Sampling::SpacingMm(2.0));
        assert_eq!((default.motion().feed_mm_s, default.motion().retract_mm), (8.0, 50.0));
    }

    #[test]
    fn an_unknown_key_is_named_with_its_line_and_the_nearest_right_one() {
        let (line, why, hint) = refused("units = \"mm\"\n[path]\nfeed_m_s = 0.008\n");
        assert_eq!(line, 3);
        assert_eq!(hint, "did you mean `feed_mm_s`? It is in millimetres per second; convert the number");
        assert!(why.contains("feed_m_s"));
        assert_eq!(refused("unit = \"mm\"").2, "did you mean `units`?");
        assert_eq!(refused("units = \"inch\"").0, 1);
        assert_eq!(refused("\n[arcs]\noutput = 1").2, "did you mean `arc`?");
    }

    #[test]
    fn a_key_in_another_unit_is_told_the_right_one() {
        for (text, line, hint) in [
            ("[torch]\n\nwork_angle_rad = 0.2", 3, "`work_angle_deg`? It is in degrees"),
            ("[path]\nfeed_mm_min = 480", 2, "`feed_mm_s`? It is in millimetres per second"),
            ("[path]\nlead_in_cm = 1", 2, "`lead_in_mm`? It is in millimetres"),
            ("[path]\nend_dwell_ms = 300", 2, "`end_dwell_s`? It is in seconds"),
            ("[weave]\ndwell_left_ms = 300", 2, "`dwell_left_s`? It is in seconds"),
            ("[path]\nfeed_mm_s = \"8 mm/s\"", 2, "without quotes"),
        ] {
            let refused = refused(text);
            assert_eq!(refused.0, line, "{text}");
            assert!(refused.2.contains(hint), "{text}: {}", refused.2);
        }
    }

    #[test]
    fn a_key_in_the_wrong_table_is_sent_to_the_right_one() {
        for (text, hint) in [
            ("feed_mm_s = 8", "`feed_mm_s` belongs in [path]"),
            ("[path]\ntravel_angle_deg = 8", "`travel_angle_deg` belongs in [torch]"),
            ("[[seam]]\nid = 1\namplitude_mm = 2", "`amplitude_mm` belongs in [weave]"),
            ("[weave]\nshpae = \"sine\"", "did you mean `shape`?"),
            ("[weave]\nshape = \"zig-zag\"", "did you mean `zigzag`?"),
        ] {
            assert_eq!(refused(text).2, hint, "{text}");
        }
    }

    #[test]
    fn what_a_pass_says_lies_on_the_seam_and_that_on_the_job() {
        let text = "[path]\nfeed_mm_s = 7\nspacing_mm = 3\n[torch]\nwork_angle_deg = 10\ntravel_angle_deg = 5\n\
                    [[seam]]\nid = 2\npath.points = 40\ntorch.travel_angle_deg = -5\n\
                    [[seam.pass]]\n[[seam.pass]]\nout_mm = 3\ntorch.work_angle_deg = 0\npath.feed_mm_s = 6\n\
                    stitch = { pattern = \"tacks\", count = 4, length_mm = 9 }";
        let job = Job::parse(text, Path::new("job.toml")).unwrap();
        assert_eq!(job.weld().sampling(), Sampling::SpacingMm(3.0));
        let weld = job.seams[0].weld().on(&job.weld());
        assert_eq!(weld.sampling(), Sampling::Points(40), "the upper layer's way to say it holds");
        let [(root, slow), (cap, slower)] = weld.passes().try_into().unwrap();
        assert_eq!((slow.feed_mm_s, slower.feed_mm_s), (7.0, 6.0));
        assert_eq!((root.out_mm, cap.out_mm), (0.0, 3.0));
        assert_eq!([root.work_angle_rad, cap.work_angle_rad], [10f64.to_radians(), 0.0]);
        assert_eq!([root.travel_angle_rad, cap.travel_angle_rad], [-(5f64.to_radians()); 2]);
        assert_eq!((root.stitch.pattern, cap.stitch.pattern), (Pattern::Continuous, Pattern::Tacks));
        assert_eq!((cap.stitch.length_mm, cap.stitch.count), (9.0, 4));
        let again = Job::parse(&job.to_toml(), Path::new("job.toml")).unwrap();
        assert_eq!(again.seams, job.seams);
    }

    #[test]
    fn a_weave_frequency_is_a_wavelength_at_the_feed() {
        let weave = |text| Job::parse(text, Path::new("job.toml")).unwrap().weld().passes()[0].0.weave;
        let by_frequency = weave("[path]\nfeed_mm_s = 6\n[weave]\nshape = \"sine\"\nfrequency_hz = 2");
        assert_eq!((by_frequency.wavelength_mm, by_frequency.amplitude_mm), (3.0, 2.0));
        let triangle = weave("[weave]\nshape = \"triangle\"\namplitude_mm = 3");
        assert_eq!((triangle.height_mm, triangle.wavelength_mm), (3.0, 4.0));
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
            ("[torch]\nwork_angle_deg = 95", "at most 80 deg"),
            ("[order]\nup = [0, 0, 0]", "zero"),
            ("[[pass]]\nout_mm = 1000", "100 mm"),
            ("[stitch]\ncount = 0", "at least 1"),
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
        let (line, why, _) = refused("[weave]\nwavelength_mm = 2\nfrequency_hz = 9");
        assert_eq!((line, why.as_str()), (3, "wavelength_mm and frequency_hz exclude each other"));
        assert_eq!(refused("\n[[seam]]\npath.spacing_mm = 2").0, 2, "a seam without a name");
        assert_eq!(refused("[[seam]]\nid = 1\nnear_mm = [1, 2, 3]").0, 1);
        assert_eq!(refused("[[seam]]\nid = 1\npath.spacing_mm = 2\npath.points = 9").0, 4);
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
