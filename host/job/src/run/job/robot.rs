//! `[robot]` and `[torch_body]`: what the feasibility check needs to know. Reference: `docs/feasibility.md`.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::frame::{FrameSetting, ToolSetting};
use super::quantity::{Place, RotationVector};
use crate::robot::dialect::Dialect;
use crate::robot::feasibility::Floor;
use crate::robot::feasibility::arm;
use crate::robot::feasibility::arm::{Arm, Counting, Kinematics, Limits};
use crate::robot::feasibility::body::Body;
use crate::robot::feasibility::catalogue;
use crate::robot::feasibility::spherical_wrist::{Opw, SphericalWrist};
use crate::robot::feasibility::torch::Torch;
use crate::robot::frame::ProgramFrame;
use crate::robot::posture::ProgramEnd;

/// `[robot]`: the arm, and where it stands.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RobotSettings {
    /// A name of the catalogue; or any name together with `opw`. Without it no arm is checked.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub model: String,
    /// The robot's base in the scan's base frame.
    pub base_mm: Place,
    /// Rotation vector of the same transform.
    pub base_rotation_rad: RotationVector,
    /// Height of the floor in the scan's base frame, mm, or "none"; by default what the arm is mounted on, or the lowest
    /// scanned place if that is lower.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub floor_z_mm: Option<FloorHeight>,
    /// Where the program begins, as the controller shows the joints; its way to the first waypoint is checked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub home_deg: Option<[f64; 6]>,
    /// What follows the last waypoint: the arm stays, or goes home.
    pub end: ProgramEnd,
    /// `"controller"`: the joint angles of `opw` are those that the controller shows, so that programs may name them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<JointCounting>,
    /// In which frame programs write their poses; by default the robot's own base.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameSetting>,
    /// With which of its tools the controller runs a program; by default `[tool]`, or `[program] tool_number`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tool: Option<ToolSetting>,
    /// A spherical-wrist arm that the catalogue does not have.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opw: Option<OpwSettings>,
}

/// `floor_z_mm`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum FloorHeight {
    /// mm.
    At(f64),
    /// `"none"`.
    None(NoFloor),
}

/// `"none"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum NoFloor {
    /// No floor.
    None,
}

/// Whose counting of joints.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JointCounting {
    /// The controller's.
    Controller,
}

/// `[robot.opw]`: the parameters of Brandstötter, Angerer and Hofbaur (2014).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct OpwSettings {
    /// From axis 1 to axis 2, along x.
    pub a1_mm: f64,
    /// From axis 3 to the forearm's axis, against x.
    pub a2_mm: f64,
    /// Sideways offset of the arm, along y.
    #[serde(default)]
    pub b_mm: f64,
    /// Height of axis 2.
    pub c1_mm: f64,
    /// From axis 2 to axis 3.
    pub c2_mm: f64,
    /// From axis 3 to the wrist's centre.
    pub c3_mm: f64,
    /// From the wrist's centre to the flange.
    pub c4_mm: f64,
    /// Joint angle where the model's is zero.
    #[serde(default)]
    pub offsets_deg: [f64; 6],
    /// 1 or -1 for each joint.
    #[serde(default = "all_positive")]
    pub signs: [i8; 6],
    /// Least and greatest angle of each joint.
    pub limits_deg: [[f64; 2]; 6],
    /// Greatest speed of each joint.
    pub speeds_deg_s: [f64; 6],
}

/// Beyond this tilt of its base, degrees, the surface that an arm is mounted on is a wall or a ceiling.
const MOST_TILT_DEG: f64 = 45.0;

fn all_positive() -> [i8; 6] {
    [1; 6]
}

/// `[torch_body]`: sizes of the torch, and how near it may come to what was scanned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TorchBodySettings {
    /// Stick-out: length of the wire from the nozzle to its tip.
    pub stickout_mm: f64,
    /// Outer radius of the gas nozzle.
    pub nozzle_radius_mm: f64,
    /// Length of the gas nozzle.
    pub nozzle_length_mm: f64,
    /// Length of the cone from the nozzle to the body.
    pub neck_length_mm: f64,
    /// How far the body leans away from the direction of travel.
    pub neck_deg: f64,
    /// Radius of the body.
    pub body_radius_mm: f64,
    /// Length of the body.
    pub body_length_mm: f64,
    /// Radius of the cable and its hoses about the flange of the robot.
    pub cable_radius_mm: f64,
    /// Least distance that the torch keeps from what was scanned.
    pub keep_off_mm: f64,
}

impl Default for TorchBodySettings {
    fn default() -> Self {
        let torch = Torch::default();
        Self {
            stickout_mm: torch.stickout_mm,
            nozzle_radius_mm: torch.nozzle_radius_mm,
            nozzle_length_mm: torch.nozzle_length_mm,
            neck_length_mm: torch.neck_length_mm,
            neck_deg: torch.neck_deg,
            body_radius_mm: torch.body_radius_mm,
            body_length_mm: torch.body_length_mm,
            cable_radius_mm: torch.cable_radius_mm,
            keep_off_mm: 1.0,
        }
    }
}

/// A value that makes no sense: its key, and why.
pub(super) type Fault = (&'static str, String);

impl RobotSettings {
    /// The robot of this name, at the origin of the base frame.
    ///
    /// # Errors
    /// The known names, and which of them was probably meant.
    pub fn named(model: &str) -> Result<Self, String> {
        let settings = Self { model: model.into(), ..Self::default() };
        settings.fault().map_or(Ok(settings), |(_, why)| Err(why))
    }

    pub(super) fn fault(&self) -> Option<Fault> {
        let named = match &self.opw {
            Some(opw) => opw.fault(),
            None if arm::by_name(&self.model).is_some() || self.is_armless() => None,
            None => Some(("model", unknown(&self.model))),
        };
        named.or_else(|| self.floor_fault()).or_else(|| self.home_fault())
    }

    /// Whether it says nothing but what programs need of bases, frames and tools.
    fn is_armless(&self) -> bool {
        let Self { base_mm, base_rotation_rad, frame, tool, .. } = self.clone();
        let rest = Self { base_mm, base_rotation_rad, frame, tool, ..Self::default() };
        *self == rest && *self != Self::default()
    }

    /// What its frame and tool ask of a dialect that cannot do it.
    pub(super) fn unwritable(&self, dialects: &[Dialect], has_tool: bool) -> Option<Fault> {
        let frame = self.frame.as_ref().and_then(|frame| frame.fault(dialects));
        frame.or_else(|| self.tool.as_ref()?.fault(dialects, has_tool))
    }

    fn floor_fault(&self) -> Option<Fault> {
        let why = match self.floor_z_mm {
            Some(FloorHeight::At(z_mm)) if !(-100_000.0..=100_000.0).contains(&z_mm) => {
                format!("{z_mm} mm is not a valid floor height")
            }
            Some(_) => return None,
            None if self.opw.is_some() => {
                "an arm of your own needs it: the height of the floor in the scan's base frame, \
                                           mm, or \"none\""
                    .into()
            }
            None if self.tilt_deg() > MOST_TILT_DEG => format!(
                "the robot's base is tilted by {:.0} degrees, so its mounting surface is no floor: give the height of the \
                 floor in the scan's base frame, mm, or \"none\"",
                self.tilt_deg()
            ),
            None => return None,
        };
        Some(("floor_z_mm", why))
    }

    fn home_fault(&self) -> Option<Fault> {
        let Some(home_deg) = self.home_deg else {
            let asks = self.end == ProgramEnd::Home;
            return asks
                .then(|| ("end", "to end at home, the job has to state where that is: home_deg".into()));
        };
        let arm = self.arm()?;
        let Some(counting) = arm.counting else {
            return Some((
                "home_deg",
                "state joints = \"controller\", if the joint angles of opw are those that the controller shows".into(),
            ));
        };
        let home_rad = counting.from_shown_rad(&home_deg);
        // NaN is beyond any limit, too.
        let beyond = |j: &usize| {
            let margin_rad = arm.limits.margin_rad(*j, home_rad[*j]);
            margin_rad.is_nan() || margin_rad < 0.0
        };
        let joint = (0..6).find(beyond)?;
        Some((
            "home_deg",
            format!("joint {} of {} cannot stand at {} degrees", joint + 1, arm.name, home_deg[joint]),
        ))
    }

    fn tilt_deg(&self) -> f64 {
        (self.base_from_robot().rotation * Vector3::z()).angle(&Vector3::z()).to_degrees()
    }

    /// Below which no link may go.
    pub(super) fn floor(&self) -> Floor {
        match self.floor_z_mm {
            None => Floor::Mounting,
            Some(FloorHeight::At(z_mm)) => Floor::At(z_mm),
            Some(FloorHeight::None(NoFloor::None)) => Floor::None,
        }
    }

    /// The arm; none if the name is not known.
    pub fn arm(&self) -> Option<Arm> {
        match &self.opw {
            Some(opw) => Some(Arm {
                name: self.model.clone(),
                counting: self.joints.map(|_| Counting { maker: None, third_from_level: false }),
                ..opw.arm()
            }),
            None => arm::by_name(&self.model),
        }
    }

    /// In which frame programs write their poses.
    pub(super) fn frame(&self) -> ProgramFrame {
        let base_from_robot = self.base_from_robot();
        match &self.frame {
            Some(frame) => frame.frame(&base_from_robot),
            None => ProgramFrame { frame_from_base: base_from_robot.inverse(), ..ProgramFrame::default() },
        }
    }

    /// The robot's base in the scan's base frame.
    pub fn base_from_robot(&self) -> Isometry3<f64> {
        pose(self.base_mm, self.base_rotation_rad)
    }

    /// Places the base: x, y, z in mm and a rotation vector in rad.
    ///
    /// # Errors
    /// What is wrong with the numbers.
    pub fn place(&mut self, text: &str) -> Result<(), String> {
        (self.base_mm, self.base_rotation_rad) = six_numbers(text)?;
        Ok(())
    }
}

/// A transform as the command line says it: x, y, z in mm and a rotation vector in rad.
///
/// # Errors
/// What is wrong with the numbers.
pub fn transform(text: &str) -> Result<Isometry3<f64>, String> {
    six_numbers(text).map(|(at_mm, rotation_rad)| pose(at_mm, rotation_rad))
}

fn six_numbers(text: &str) -> Result<(Place, RotationVector), String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|word| word.trim().parse::<f64>()).collect();
    let numbers = numbers.map_err(|_| format!("{text:?} is not six numbers"))?;
    let [x, y, z, rx, ry, rz] = numbers[..] else {
        return Err(format!("{} numbers; give six: x,y,z in mm and a rotation vector in rad", numbers.len()));
    };
    Ok(([x, y, z].try_into()?, [rx, ry, rz].try_into()?))
}

/// A transform from a place and a rotation vector.
pub(super) fn pose(at_mm: Place, rotation_rad: RotationVector) -> Isometry3<f64> {
    let rotation = UnitQuaternion::from_scaled_axis(Vector3::from(rotation_rad.get()));
    Isometry3::from_parts(Translation3::from(Vector3::from(at_mm.get())), rotation)
}

fn unknown(model: &str) -> String {
    let alike = |name: &&&str| (1e3 * strsim::jaro_winkler(&model.to_ascii_lowercase(), name)) as u32;
    let nearest = catalogue::NAMES.iter().max_by_key(alike).copied().unwrap_or_default();
    let all = catalogue::NAMES.join(", ");
    format!(
        "unknown robot model {model:?}, did you mean {nearest:?}? Known are {all}; others need [robot.opw]"
    )
}

impl OpwSettings {
    fn arm(&self) -> Arm {
        let Self { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs, .. } = *self;
        let opw = Opw { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs };
        Arm {
            name: String::new(),
            kinematics: Kinematics::SphericalWrist(SphericalWrist::new(opw)),
            limits: Limits::degrees(self.limits_deg, self.speeds_deg_s),
            body: Body::of_reach(c2_mm + c3_mm, 0.0),
            counting: None,
        }
    }

    fn fault(&self) -> Option<Fault> {
        let lengths = [
            ("a1_mm", self.a1_mm),
            ("a2_mm", self.a2_mm),
            ("b_mm", self.b_mm),
            ("c1_mm", self.c1_mm),
            ("c2_mm", self.c2_mm),
            ("c3_mm", self.c3_mm),
            ("c4_mm", self.c4_mm),
        ];
        let long = |(_, mm): &&(&str, f64)| !(-10_000.0..=10_000.0).contains(mm);
        if let Some((key, mm)) = lengths.iter().find(long) {
            return Some((key, format!("{mm} mm is not a valid arm length; at most 10000 mm")));
        }
        let arms = self.c2_mm > 0.0 && self.c3_mm > 0.0;
        let rules = [
            ("c2_mm", !arms, "c2_mm and c3_mm, upper arm and forearm, are above 0"),
            ("signs", self.signs.iter().any(|sign| sign.abs() != 1), "every sign is 1 or -1"),
            (
                "offsets_deg",
                self.offsets_deg.iter().any(|deg| !(-360.0..=360.0).contains(deg)),
                "offsets are -360 to 360",
            ),
            (
                "limits_deg",
                !self.limits_deg.iter().all(|[low, high]| low < high && low.abs().max(high.abs()) <= 3600.0),
                "each pair of limits is the least and the greatest angle, degrees",
            ),
            (
                "speeds_deg_s",
                !self.speeds_deg_s.iter().all(|&speed| speed > 0.0 && speed <= 3600.0),
                "joint speeds are above 0 and at most 3600 degrees per second",
            ),
        ];
        rules.into_iter().find(|rule| rule.1).map(|(key, _, why)| (key, why.to_owned()))
    }
}

impl TorchBodySettings {
    /// Sizes as `key=value` pairs with commas between, the others by default.
    ///
    /// # Errors
    /// What is wrong with them.
    pub fn from_pairs(text: &str) -> Result<Self, String> {
        let settings: Self = toml::from_str(&text.replace(',', "\n")).map_err(|e| e.message().to_owned())?;
        settings.fault().map_or(Ok(settings), |(key, why)| Err(format!("{key}: {why}")))
    }

    pub(super) fn fault(&self) -> Option<Fault> {
        let ranges = [
            ("stickout_mm", self.stickout_mm, 1.0, 100.0),
            ("nozzle_radius_mm", self.nozzle_radius_mm, 1.0, 100.0),
            ("nozzle_length_mm", self.nozzle_length_mm, 1.0, 500.0),
            ("neck_length_mm", self.neck_length_mm, 0.0, 500.0),
            ("neck_deg", self.neck_deg, -90.0, 90.0),
            ("body_radius_mm", self.body_radius_mm, 1.0, 200.0),
            ("body_length_mm", self.body_length_mm, 0.0, 1000.0),
            ("cable_radius_mm", self.cable_radius_mm, 0.0, 300.0),
            ("keep_off_mm", self.keep_off_mm, 0.0, 30.0),
        ];
        let outside = |(_, value, least, most): &&(&str, f64, f64, f64)| !(*least..=*most).contains(value);
        ranges
            .iter()
            .find(outside)
            .map(|(key, value, least, most)| (*key, format!("{value} is not {least} to {most}")))
    }

    /// The torch of these sizes.
    pub fn torch(&self) -> Torch {
        Torch {
            stickout_mm: self.stickout_mm,
            nozzle_radius_mm: self.nozzle_radius_mm,
            nozzle_length_mm: self.nozzle_length_mm,
            neck_length_mm: self.neck_length_mm,
            neck_deg: self.neck_deg,
            body_radius_mm: self.body_radius_mm,
            body_length_mm: self.body_length_mm,
            cable_radius_mm: self.cable_radius_mm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const IRB: &str = "model = \"mine\"\nfloor_z_mm = 0\n[opw]\na1_mm = 150\na2_mm = 0\nc1_mm = 486.5\nc2_mm = 700\nc3_mm = 600\n\
        c4_mm = 65\noffsets_deg = [0, 0, -90, 0, 0, 0]\n\
        limits_deg = [[-180, 180], [-90, 150], [-245, 65], [-200, 200], [-115, 115], [-400, 400]]\n\
        speeds_deg_s = [180, 180, 185, 385, 400, 460]\n";

    #[test]
    fn own_opw_parameters_make_the_same_arm_as_the_catalogue() {
        let own: RobotSettings = toml::from_str(IRB).unwrap();
        assert_eq!(own.fault(), None);
        let (own, known) = (own.arm().unwrap(), arm::by_name("abb-irb1600-10-145").unwrap());
        let joints = [0.3, -0.2, 0.5, 1.0, 0.7, -2.0];
        assert!((own.forward(&joints).inverse() * known.forward(&joints)).translation.vector.norm() < 1e-9);
        assert_eq!((own.name.as_str(), own.limits), ("mine", known.limits));
    }

    #[test]
    fn a_value_that_makes_no_sense_is_named_by_its_key() {
        for (from, to, key) in [
            ("c2_mm = 700", "c2_mm = nan", "c2_mm"),
            ("c2_mm = 700", "c2_mm = -700", "c2_mm"),
            ("[-90, 150]", "[150, -90]", "limits_deg"),
            ("460]", "0]", "speeds_deg_s"),
            ("-90, 0, 0, 0]", "-900, 0, 0, 0]", "offsets_deg"),
        ] {
            let settings: RobotSettings = toml::from_str(&IRB.replacen(from, to, 1)).unwrap();
            assert_eq!(settings.fault().unwrap().0, key, "{to}");
        }
        assert!(RobotSettings::named("ur5").is_ok());
        let error = RobotSettings::named("UR5E-series").unwrap_err();
        assert!(error.contains("did you mean \"ur5e\"") && error.contains("kuka"), "{error}");
    }

    #[test]
    fn a_base_is_placed_by_six_numbers() {
        let mut settings = RobotSettings::named("ur5e").unwrap();
        settings.place("100,-20,3,0,0,1.5708").unwrap();
        let moved = settings.base_from_robot() * nalgebra::Point3::new(10.0, 0.0, 0.0);
        assert!((moved - nalgebra::Point3::new(100.0, -10.0, 3.0)).norm() < 1e-3);
        for text in ["1,2,3", "1,2,3,4,5,x", "nan,0,0,0,0,0", "0,0,0,90,0,0"] {
            assert!(settings.place(text).is_err(), "{text}");
        }
    }

    #[test]
    fn torch_sizes_are_given_by_name_and_kept_in_range() {
        let torch = TorchBodySettings::from_pairs("stickout_mm=20,nozzle_radius_mm=8").unwrap();
        assert_eq!((torch.stickout_mm, torch.nozzle_radius_mm), (20.0, 8.0));
        assert_eq!(torch.body_radius_mm, TorchBodySettings::default().body_radius_mm);
        for text in ["stickout_mm=0", "nozzle_mm=8", "neck_deg=nan", "stickout_mm", "body_length_mm=-1"] {
            assert!(TorchBodySettings::from_pairs(text).is_err(), "{text}");
        }
    }
}
