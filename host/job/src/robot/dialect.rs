//! Programs for robot controllers, one module per dialect. What each needs edited before it runs, and what has not
//! been tried: `docs/programs.md`. A dialect is a file with a function `write`, its `pub mod` and its line in the table
//! of [`Dialect`].

pub mod fanuc;
pub mod krl;
pub mod moves;
pub mod rapid;
pub mod ros;
pub mod urscript;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::moves::{Move, TooLong};
use super::arc::WeldingArc;
use super::frame::{ProgramFrame, ToolSource};
use super::posture::{Maker, PlannedPosture, ProgramEnd, Stance};
use super::tool::Tool;
use weldpath_files::File;
use weldpath_method::weld::program::Waypoint;

/// The table of dialects: a name, as which the command line and a job file know it in kebab case, and its module.
macro_rules! dialects {
    ($($(#[$about:meta])* $name:ident => $module:ident,)*) => {
        /// Whose program is written.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema)]
        #[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
        #[serde(rename_all = "kebab-case")]
        #[schemars(rename = "Robot")]
        pub enum Dialect {
            $($(#[$about])* $name,)*
        }

        impl Dialect {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$name),*];

            /// The files of the program.
            ///
            /// # Errors
            /// A seam is longer than a program of this dialect may be.
            ///
            /// ```
            /// use weldpath_job::robot::dialect::Dialect;
            /// use weldpath_job::run::job::Job;
            /// use nalgebra::{Point3, UnitQuaternion};
            /// use weldpath_method::weld::program::{Kind, Waypoint};
            ///
            /// let at = |x_mm| Waypoint {
            ///     position_mm: Point3::new(x_mm, 0.0, 0.0),
            ///     base_from_torch: UnitQuaternion::identity(),
            ///     feed_mm_s: 8.0,
            ///     weld: true,
            ///     seam: Some(1),
            ///     kind: Kind::Weld,
            ///     dwell_s: None,
            /// };
            /// let program = [at(0.0), at(10.0)];
            /// let files = Dialect::Ur.write(&program, &Job::default().program_setup())?;
            /// assert_eq!(files[0].name, "path.script");
            /// assert!(String::from_utf8_lossy(&files[0].bytes).contains("movep("));
            /// # Ok::<(), weldpath_job::robot::dialect::moves::TooLong>(())
            /// ```
            pub fn write(self, waypoints: &[Waypoint], setup: &ProgramSetup) -> Result<Vec<File>, TooLong> {
                match self {
                    $(Self::$name => $module::write(waypoints, setup),)*
                }
            }
        }
    };
}

dialects! {
    /// Universal Robots: URScript, path.script.
    #[default]
    Ur => urscript,
    /// ABB: RAPID, NAME.mod.
    Abb => rapid,
    /// KUKA: KRL, NAME.src and NAME.dat.
    Kuka => krl,
    /// FANUC: TP listing, NAME.ls.
    Fanuc => fanuc,
    /// ROS: geometry_msgs/PoseArray, poses.yaml and poses.json.
    Ros => ros,
}

impl Dialect {
    /// Whose controllers read it.
    pub fn maker(self) -> Option<Maker> {
        match self {
            Self::Ur => Some(Maker::UniversalRobots),
            Self::Abb => Some(Maker::Abb),
            Self::Kuka => Some(Maker::Kuka),
            Self::Fanuc => Some(Maker::Fanuc),
            Self::Ros => None,
        }
    }

    /// How its controllers know frames and tools; none where a program names neither.
    pub(crate) fn naming(self) -> Option<Naming> {
        match self {
            Self::Ur | Self::Abb => Some(Naming::Name),
            Self::Kuka | Self::Fanuc => Some(Naming::Number),
            Self::Ros => None,
        }
    }

    /// Whether a program sets frames and tools by way of a position register, and in no other.
    pub(crate) fn sets_by_register(self) -> bool {
        match self {
            Self::Fanuc => true,
            Self::Ur | Self::Abb | Self::Kuka | Self::Ros => false,
        }
    }
}

/// How a controller knows its frames and tools.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Naming {
    Name,
    Number,
}

/// The unit in which an ABB controller reads the speed of its welddata: by its Arc units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub enum WelddataUnit {
    /// SI_UNITS and WELD_UNITS.
    #[default]
    #[serde(rename = "mm/s")]
    MmS,
    /// US_UNITS.
    #[serde(rename = "in/min")]
    InMin,
}

/// Everything the programs need beside the waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramSetup {
    /// Of programs, and of the files of dialects in which the two are one.
    pub name: String,
    /// In which frame the poses are.
    pub frame: ProgramFrame,
    /// Which of the controller's tools.
    pub tool_source: ToolSource,
    /// Number of the tool on controllers that number them; used where `tool` is none, and by FANUC always.
    pub tool_number: u32,
    /// Number of the weld data on controllers that keep it themselves.
    pub weld_schedule: u32,
    /// FANUC: `Weld Start` of this procedure in place of `Arc Start`.
    pub weld_procedure: Option<u32>,
    /// ABB: the unit of speed in its welddata.
    pub welddata_unit: WelddataUnit,
    /// None leaves what is set on the controller.
    pub tool: Option<Tool>,
    /// How the arc is switched.
    pub arc: WeldingArc,
    /// How the arm stands; none leaves it to the controller.
    pub posture: Option<PlannedPosture>,
    /// What stands in the head of every program, one line each, beside what the dialect itself says.
    pub remarks: Vec<String>,
}

impl ProgramSetup {
    /// What the head of every program says: the remarks of the plan, then `own`, those of the dialect. In plain ASCII
    /// and in pieces of at most `most` characters, so that none can end its comment: names of files stand in them.
    fn head(&self, own: &[String], most: usize) -> Vec<String> {
        let plain = |c: char| if c == ' ' || c.is_ascii_graphic() { c } else { '?' };
        let mut lines: Vec<String> = Vec::new();
        for remark in self.remarks.iter().chain(own) {
            let text: String = remark.chars().map(plain).collect();
            let mut line = String::new();
            for word in text.split(' ').filter(|word| !word.is_empty()) {
                let word = &word[..word.len().min(most)];
                if !line.is_empty() && line.len() + 1 + word.len() > most {
                    lines.push(std::mem::take(&mut line));
                }
                let space = if line.is_empty() { "" } else { " " };
                line.push_str(space);
                line.push_str(word);
            }
            lines.push(line);
        }
        lines
    }

    /// The moves, in the program's frame.
    fn moves(&self, waypoints: &[Waypoint]) -> Vec<Move> {
        moves::moves(&self.frame.of(waypoints))
    }

    /// The tool whose value stands in the program.
    fn written_tool(&self) -> Option<&Tool> {
        self.tool.as_ref().filter(|_| !self.tool_source.is_held())
    }

    /// The joints along the program, if they are counted as `dialect` counts them and there is one stance for each
    /// of `waypoints`.
    fn joints(&self, dialect: Dialect, waypoints: usize) -> Option<Joints<'_>> {
        let posture = self.posture.as_ref()?;
        let own = posture.counted_by.is_none_or(|maker| dialect.maker() == Some(maker));
        let first = posture.stances.first().filter(|_| own && posture.stances.len() == waypoints)?;
        let home_deg = posture.home_deg;
        Some(Joints {
            stances: &posture.stances,
            first_deg: first.joints_deg,
            home_deg,
            end_deg: home_deg.filter(|_| posture.end == ProgramEnd::Home),
        })
    }

    /// What the head says of the arc where the program itself switches it.
    fn arc_remark(&self) -> &'static str {
        match self.arc.established_input {
            Some(_) => {
                "Loss of the arc is detected by the input of the established arc, and ends the program."
            }
            None => "Loss of the arc is not detected: the job has no established_input.",
        }
    }
}

/// In every head: what a program can never be.
const NO_SAFETY_FUNCTION: &str =
    "Not a safety function: the emergency stop must cut the power source by its own circuit.";

/// What a person reads before the arm moves on a way that nobody checked.
const UNCHECKED_MOVE: &str = "The next move, by joints, is not checked.";

/// Joints at which a program begins and ends, degrees, as the controller counts them.
struct Joints<'a> {
    /// At each waypoint.
    stances: &'a [Stance],
    /// At the first waypoint.
    first_deg: [f64; 6],
    /// Before it, if there is a home.
    home_deg: Option<[f64; 6]>,
    /// After the last waypoint, if the arm goes home.
    end_deg: Option<[f64; 6]>,
}

impl Joints<'_> {
    /// What the head says of the posture, the first move and the end.
    fn remarks(joints: Option<&Self>) -> Vec<String> {
        let Some(joints) = joints else {
            return vec![
                "The posture is the controller's choice: not checked.".into(),
                "At the end the arm stays at the last point.".into(),
            ];
        };
        let begins = match joints.home_deg {
            Some(_) => "Begins with a joint move home. The way there is not checked: start near home.",
            None => "The first move, by joints, is not checked: the program asks before it moves.",
        };
        let ends = match joints.end_deg {
            Some(_) => "At the end the arm goes home, by joints.",
            None => "At the end the arm stays at the last point.",
        };
        vec![begins.into(), ends.into()]
    }
}

/// Name of part `index`, counted from 0, of a divided program.
pub(super) fn part_name(name: &str, index: usize) -> String {
    format!("{name}_{}", index + 1)
}
