//! Numbers with a unit and a range, the same for the job file and the command line.

use std::borrow::Cow;
use std::str::FromStr;

use nalgebra::{Point3, Unit, UnitVector3, Vector3};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// Range of a number: which values make sense to a robot, and which are surely a slip of unit or key.
struct Range {
    least: f64,
    most: f64,
    unit: &'static str,
    whole: bool,
}

impl Range {
    fn check(&self, value: f64) -> Result<f64, String> {
        let Self { least, most, unit, .. } = self;
        if !value.is_finite() {
            return Err(format!("{value} is not a finite number; give {least} to {most}{unit}"));
        }
        if self.whole && value.fract() != 0.0 {
            return Err(format!("{value} is not a whole number; give {least} to {most}{unit}"));
        }
        if value < *least {
            return Err(format!("{value}{unit} is too little: at least {least}{unit}, at most {most}{unit}"));
        }
        if value > *most {
            return Err(format!("{value}{unit} is too much: at most {most}{unit}, at least {least}{unit}"));
        }
        Ok(value)
    }
}

fn number(text: &str) -> Result<f64, String> {
    text.trim().parse().map_err(|_| format!("{text:?} is not a number"))
}

macro_rules! quantity {
    ($(#[$doc:meta])* $name:ident, $least:literal to $most:literal $unit:literal $(, default $default:expr)?) => {
        quantity!(@ $(#[$doc])* $name, f64, $least, $most, $unit, false $(, $default)?);
    };
    ($(#[$doc:meta])* $name:ident, whole $least:literal to $most:literal $(, default $default:expr)?) => {
        quantity!(@ $(#[$doc])* $name, u32, $least, $most, "", true $(, $default)?);
    };
    (@ $(#[$doc:meta])* $name:ident, $number:ident, $least:literal, $most:literal, $unit:literal, $whole:literal
        $(, $default:expr)?) => {
        $(#[$doc])*
        #[doc = concat!("\n\n", stringify!($least), " to ", stringify!($most), $unit, ".")]
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(try_from = "f64")]
        pub struct $name($number);

        impl $name {
            /// The number itself, in the unit of the type's name.
            pub const fn get(self) -> $number {
                self.0
            }
        }

        impl TryFrom<f64> for $name {
            type Error = String;
            fn try_from(value: f64) -> Result<Self, String> {
                let range = Range { least: $least as f64, most: $most as f64, unit: $unit, whole: $whole };
                range.check(value).map(|value| Self(value as $number))
            }
        }

        impl FromStr for $name {
            type Err = String;
            fn from_str(text: &str) -> Result<Self, String> {
                number(text)?.try_into()
            }
        }

        impl JsonSchema for $name {
            fn inline_schema() -> bool {
                true
            }
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }
            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                let number = if $whole { "integer" } else { "number" };
                let limits = concat!(stringify!($least), " to ", stringify!($most), $unit);
                json_schema!({ "type": number, "minimum": $least, "maximum": $most, "title": limits })
            }
        }

        $(impl Default for $name {
            fn default() -> Self {
                Self($default as $number)
            }
        })?
    };
}

quantity!(/// Metres per count of depth images that come without; a scanner is no coarser than a tenth of a metre.
    DepthScaleM, 0.0000001 to 0.1 " m");
quantity!(/// Stand-off of the tip from the seam.
    StandoffMm, -20 to 200 " mm", default 0);
quantity!(/// Spacing of the waypoints; below a tenth of a millimetre a robot only stutters.
    SpacingMm, 0.1 to 100 " mm");
quantity!(/// Waypoints of each seam.
    Points, whole 2 to 100000);
quantity!(/// Weld speed; 250 mm/s is what a robot may move in manual mode.
    FeedMmS, 0.1 to 250 " mm/s", default 8);
quantity!(/// Welded beyond an end of the seam; negative shortens.
    ExtendMm, -1000 to 1000 " mm", default 0);
quantity!(/// Along the travel before the start or beyond the end, arc off.
    LeadMm, 0 to 500 " mm", default 0);
quantity!(/// How far from its seam a place may be that names it.
    WithinMm, 0.1 to 200 " mm");
quantity!(/// Radius of the arc in place of a corner.
    CornerRadiusMm, 0.5 to 200 " mm", default 3);
quantity!(/// How far the torch is lifted between stitches.
    LiftMm, 1 to 200 " mm", default 10);
quantity!(/// Lean of the torch about the travel; beyond 80 degrees it would lie in the work.
    WorkAngleDeg, -80 to 80 " deg", default 0);
quantity!(/// Push or drag.
    TravelAngleDeg, -60 to 60 " deg", default 0);
quantity!(/// Turn about the torch axis.
    TurnDeg, -360 to 360 " deg", default 0);
quantity!(/// From the seam to the farthest place of a weave on either side.
    AmplitudeMm, 0.1 to 30 " mm", default 2);
quantity!(/// Travel in one wave.
    WavelengthMm, 0.5 to 100 " mm");
quantity!(/// Waves per second.
    FrequencyHz, 0.05 to 20 " Hz");
quantity!(/// How far the sides of a triangle weave are out of the work.
    HeightMm, 0 to 30 " mm");
quantity!(/// Length of a stitch or tack.
    StitchMm, 1 to 2000 " mm", default 20);
quantity!(/// From the centre of a stitch to the next.
    PitchMm, 2 to 5000 " mm", default 50);
quantity!(/// Number of tacks.
    Tacks, whole 1 to 1000, default 3);
quantity!(/// Place of a pass to the right of the travel.
    AcrossMm, -100 to 100 " mm", default 0);
quantity!(/// Place of a pass out of the work.
    OutMm, -50 to 100 " mm", default 0);
quantity!(/// Speed of approach and retract.
    ApproachFeedMmS, 0.1 to 250 " mm/s", default 25);
quantity!(/// Speed of air moves.
    AirFeedMmS, 0.1 to 250 " mm/s", default 150);
quantity!(/// Distance of approach and retract from the seam.
    ApproachMm, 1 to 500 " mm", default 50);
quantity!(/// Height of air moves over the model.
    ClearanceMm, 1 to 1000 " mm", default 50);
quantity!(/// Threshold `t` of eq. (16); at 27, the least value of the ratio, everything would be an edge.
    RatioThreshold, 27.000001 to 1000000 "", default weldpath_method::pipeline::RATIO_THRESHOLD);
quantity!(/// Standard digital output of the controller.
    Output, whole 0 to 7, default 0);
quantity!(/// Standard digital input of the controller.
    Input, whole 0 to 7);
quantity!(/// Number of a tool on the controller.
    ToolNumber, whole 1 to 16, default 1);
quantity!(/// Number of the weld data on the controller.
    WeldSchedule, whole 1 to 32, default 1);
quantity!(/// Number of a weld procedure on the controller.
    WeldProcedure, whole 1 to 99);
quantity!(/// How far a seam was welded before it was broken off.
    WeldedMm, 0 to 100000 " mm");
quantity!(/// How much of a broken weld is welded again.
    OverlapMm, 0 to 200 " mm", default 5);
quantity!(/// Mass at the flange.
    PayloadKg, 0 to 100 " kg");
quantity!(/// Standard deviation of a position that the robot reports; an uncalibrated arm's is a millimetre or two.
    RobotMm, 0.001 to 20 " mm", default 0.3);
quantity!(/// Standard deviation of where the tip touched, each axis: by eye, with a sharp tip.
    TouchMm, 0.01 to 5 " mm", default 0.2);
quantity!(/// Standard deviation of an orientation that the robot reports.
    RobotDeg, 0.0001 to 5 " deg", default 0.05);
quantity!(/// Standard deviation of the camera's position on the flange.
    HandEyeMm, 0.001 to 100 " mm", default 3);
quantity!(/// Standard deviation of the camera's orientation on the flange.
    HandEyeDeg, 0.0001 to 20 " deg", default 1);
quantity!(Duration, 0 to 60 " s");

/// A time of 0 to 60 s; `DEFAULT_MS` when nothing is said.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct TimeS<const DEFAULT_MS: u16>(Duration);

impl<const DEFAULT_MS: u16> TimeS<DEFAULT_MS> {
    /// The time, s.
    pub const fn get(self) -> f64 {
        self.0.get()
    }
}

impl<const DEFAULT_MS: u16> Default for TimeS<DEFAULT_MS> {
    fn default() -> Self {
        Self(Duration(f64::from(DEFAULT_MS) / 1e3))
    }
}

impl<const DEFAULT_MS: u16> TryFrom<f64> for TimeS<DEFAULT_MS> {
    type Error = String;
    fn try_from(value: f64) -> Result<Self, String> {
        value.try_into().map(Self)
    }
}

impl<const DEFAULT_MS: u16> From<TimeS<DEFAULT_MS>> for f64 {
    fn from(time: TimeS<DEFAULT_MS>) -> Self {
        time.get()
    }
}

impl<const DEFAULT_MS: u16> JsonSchema for TimeS<DEFAULT_MS> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        Duration::schema_name()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Duration::json_schema(generator)
    }
}

/// A place or offset in mm, at most a kilometre away in any direction.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct Place([f64; 3]);

impl Place {
    /// x, y, z in mm.
    pub const fn get(self) -> [f64; 3] {
        self.0
    }

    /// The same as a point.
    pub fn point_mm(self) -> Point3<f64> {
        Point3::from(self.0)
    }
}

impl TryFrom<[f64; 3]> for Place {
    type Error = String;
    fn try_from(place: [f64; 3]) -> Result<Self, String> {
        let range = Range { least: -1e6, most: 1e6, unit: " mm", whole: false };
        place.iter().try_for_each(|&value| range.check(value).map(drop))?;
        Ok(Self(place))
    }
}

impl From<Place> for [f64; 3] {
    fn from(place: Place) -> Self {
        place.0
    }
}

impl FromStr for Place {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        let place: [f64; 3] = numbers
            .try_into()
            .map_err(|n: Vec<f64>| format!("{} numbers; give three in mm, as in 120,-35,8.5", n.len()))?;
        place.try_into()
    }
}

/// A box in the base frame, from its least to its greatest corner.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "[Place; 2]", into = "[Place; 2]")]
pub struct Region {
    least: Place,
    greatest: Place,
}

impl Region {
    /// Its least and its greatest corner.
    pub fn corners_mm(&self) -> [Point3<f64>; 2] {
        [self.least.point_mm(), self.greatest.point_mm()]
    }

    /// Whether `p_mm` lies in the box or on its surface.
    pub fn contains(&self, p_mm: &Point3<f64>) -> bool {
        (0..3).all(|axis| (self.least.0[axis]..=self.greatest.0[axis]).contains(&p_mm[axis]))
    }
}

impl TryFrom<[Place; 2]> for Region {
    type Error = String;
    fn try_from([least, greatest]: [Place; 2]) -> Result<Self, String> {
        match (0..3).find(|&axis| least.0[axis] > greatest.0[axis]) {
            Some(axis) => {
                let name = ['x', 'y', 'z'][axis];
                Err(format!("the first corner has the greater {name}; give the least corner first"))
            }
            None => Ok(Self { least, greatest }),
        }
    }
}

impl From<Region> for [Place; 2] {
    fn from(region: Region) -> Self {
        [region.least, region.greatest]
    }
}

impl FromStr for Region {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        let (least, greatest) =
            text.split_once("..").ok_or("give two corners in mm, as in 0,0,0..200,100,50".to_owned())?;
        [least.parse()?, greatest.parse()?].try_into()
    }
}

/// A rotation vector, rad; up to two turns, as controllers write them.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct RotationVector([f64; 3]);

impl RotationVector {
    /// rx, ry, rz in rad.
    pub const fn get(self) -> [f64; 3] {
        self.0
    }
}

impl TryFrom<[f64; 3]> for RotationVector {
    type Error = String;
    fn try_from(vector: [f64; 3]) -> Result<Self, String> {
        let two_turns = 2.0 * std::f64::consts::TAU;
        let range = Range { least: -two_turns, most: two_turns, unit: " rad", whole: false };
        vector.iter().try_for_each(|&value| range.check(value).map(drop))?;
        Ok(Self(vector))
    }
}

impl From<RotationVector> for [f64; 3] {
    fn from(vector: RotationVector) -> Self {
        vector.0
    }
}

/// Name of a robot program that every dialect takes: at most 16 letters, digits and underscores, a letter first.
///
/// KUKA has the shortest names, of 24 characters, and the longest addition to them, of 8.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "String", into = "String")]
pub struct ProgramName(String);

impl Default for ProgramName {
    fn default() -> Self {
        Self("weldpath".into())
    }
}

/// Words that a dialect keeps for itself, in lower case: RAPID's reserved words (3HAC050947, 1.1), those of KRL, of
/// URScript (and what it takes from Python), of FANUC's TP, and instructions and types that a program of that name would
/// hide; a name is used in any of them, and case is told in none but URScript.
const RESERVED: &str = "\
    abort alias and anin anout arcl arclend arclstart as assert attr axis b_and b_exor b_not b_or backward bas \
    bool brake break call case ccirc cell char circ circ_rel class confirm confj confl connect const continue \
    decl def default deffct del digin div do e6axis e6pos elif else elseif end enddat endfct endfold endfor \
    endfunc endif endloop endmodule endproc endrecord endspline endswitch endtest endtrap endwhile enum eof \
    error except exit exor ext extfct false fct finally fold for frame from func global goto halt home if import \
    in inout int interrupt ir_stopm is jmp join jointtarget kill lambda lbl lin lin_rel load local loop main \
    maximum minimum mn mod module monitor moveabsj movec movej movel movep none nostepin not noview num off on \
    or orient override p00 pass pause pers popup pos pose print prio proc prog ptp ptp_rel public pulse pulsedo \
    raise readonly real record repeat reset resume retry return robtarget run seamdata sec select set setdo \
    signal singarea skip sleep slin speeddata spline sps sptp step stop string struc switch sync sysmodule task \
    test textmsg then thread timer to tooldata tpwrite trap trigger true try trynext uframe_num undo until \
    utool_num var viewonly wait waitdi waittime waituntil welddata when while with wobjdata xor zonedata \
";
/// What programs of weldpath number themselves, and registers: letters that only digits follow.
const NUMBERED: [&str; 6] = ["p", "xp", "r", "pr", "di", "do"];

/// Whether a program of this name would be, or hide, something else.
fn is_taken(name: &str) -> bool {
    let name = name.to_ascii_lowercase();
    let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
    let numbered = letters.len() < name.len() && NUMBERED.contains(&letters);
    numbered || RESERVED.split_whitespace().any(|word| word == name)
}

impl TryFrom<String> for ProgramName {
    type Error = String;
    fn try_from(name: String) -> Result<Self, String> {
        let allowed = |c: char| c.is_ascii_alphanumeric() || c == '_';
        let first = name.chars().next().is_some_and(|c| c.is_ascii_alphabetic());
        if is_taken(&name) {
            return Err(format!(
                "{name:?} is a word of a robot language, or what its programs call points: choose another name, such as \
                 \"weld_{name}\""
            ));
        }
        if first && name.len() <= 16 && name.chars().all(allowed) {
            return Ok(Self(name));
        }
        Err(format!(
            "{name:?} is not a valid program name: at most 16 letters, digits and underscores, a letter first"
        ))
    }
}

impl From<ProgramName> for String {
    fn from(name: ProgramName) -> Self {
        name.0
    }
}

impl std::fmt::Display for ProgramName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

/// A direction of any length.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(inline)]
#[serde(try_from = "[f64; 3]", into = "[f64; 3]")]
pub struct Up([f64; 3]);

impl Up {
    /// The direction.
    pub fn get(self) -> UnitVector3<f64> {
        Unit::try_new(Vector3::from(self.0), 1e-9).unwrap_or(Vector3::z_axis())
    }
}

impl Default for Up {
    fn default() -> Self {
        Self([0.0, 0.0, 1.0])
    }
}

impl TryFrom<[f64; 3]> for Up {
    type Error = String;
    fn try_from(vector: [f64; 3]) -> Result<Self, String> {
        let range = Range { least: -1e6, most: 1e6, unit: "", whole: false };
        vector.iter().try_for_each(|&value| range.check(value).map(drop))?;
        match Unit::try_new(Vector3::from(vector), 1e-9) {
            Some(_) => Ok(Self(vector)),
            None => Err("a direction cannot be zero; give it as in [0, 0, 1]".into()),
        }
    }
}

impl From<Up> for [f64; 3] {
    fn from(up: Up) -> Self {
        up.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_mean_nothing_are_refused_with_the_range() {
        for text in ["nan", "inf", "-inf", "0", "-8", "251", "", "8 mm", "1e999"] {
            let error = text.parse::<FeedMmS>().unwrap_err();
            assert!(!error.is_empty(), "{text}");
        }
        assert_eq!("8".parse::<FeedMmS>().unwrap().get(), 8.0);
        assert!("0".parse::<FeedMmS>().unwrap_err().contains("at least 0.1 mm/s"));
        assert!("2.5".parse::<Points>().is_err());
        assert!("27".parse::<RatioThreshold>().is_err());
        assert_eq!("7".parse::<Output>().unwrap().get(), 7);
    }

    #[test]
    fn a_region_holds_its_corners_and_nothing_beyond() {
        let region: Region = "-1,-2,-3..1,2,3".parse().unwrap();
        assert!(region.contains(&Point3::new(-1.0, 2.0, 3.0)));
        assert!(!region.contains(&Point3::new(0.0, 2.1, 0.0)));
        for text in
            ["1,2,3", "1,2..3,4,5", "1,2,3..0,9,9", "1,2,x..3,4,5", "nan,0,0..1,1,1", "1,2,3,4..5,6,7"]
        {
            assert!(text.parse::<Region>().is_err(), "{text}");
        }
    }
    #[test]
    fn a_program_name_fits_every_controller() {
        for name in ["weldpath", "a", "Frame_12_left"] {
            assert!(ProgramName::try_from(name.to_owned()).is_ok(), "{name}");
        }
        for name in ["", "1st", "_a", "a-b", "a b", "ä", "a.b", "seventeen_letters"] {
            assert!(ProgramName::try_from(name.to_owned()).is_err(), "{name}");
        }
        for name in ["stop", "Stop", "P1", "p12", "XP3", "R2", "main", "movej", "WHILE"] {
            let error = ProgramName::try_from(name.to_owned()).unwrap_err();
            assert!(error.contains(&format!("weld_{name}")), "{error}");
            assert!(ProgramName::try_from(format!("weld_{name}")).is_ok(), "{name}");
        }
    }
}
