//! The arms that are known by name: lengths, joint limits and joint speeds, as their makers publish them.
//!
//! Universal Robots: the maker's article on DH parameters, and its data sheets. ABB, KUKA, FANUC: the URDFs and OPW parameters
//! of ROS-Industrial (joint angles count as there). Another spherical-wrist arm is given by its OPW parameters in the job file.

use super::arm::{Arm, Counting, Kinematics, Limits};
use super::body::{Body, OFFSET_WRIST};
use super::offset_wrist::OffsetWrist;
use super::spherical_wrist::{Opw, SphericalWrist};
use crate::robot::posture::Maker;

/// Names that [`super::arm::by_name`] knows.
pub const NAMES: &[&str] = &[
    "ur3",
    "ur5",
    "ur10",
    "ur3e",
    "ur5e",
    "ur10e",
    "ur16e",
    "ur20",
    "ur30",
    "abb-irb1600-10-145",
    "abb-irb2600-12-165",
    "kuka-kr10-r1420",
    "fanuc-m10ia",
];

/// The arm of this name.
pub(super) fn named(name: &'static str) -> Option<Arm> {
    universal_robots(name).or_else(|| spherical(name))
}

/// `d1, a2, a3, d4, d5, d6` in mm, joint speeds in degrees per second, how far upper arm and forearm stand aside in mm, and
/// radii of base, shoulder, upper arm, forearm and the three wrists in mm.
type OffsetRow = ([f64; 6], [f64; 6], [f64; 2], [f64; 7]);

const SMALL: [f64; 6] = [180.0, 180.0, 180.0, 360.0, 360.0, 360.0];
const SLOW: [f64; 6] = [120.0, 120.0, 180.0, 180.0, 180.0, 180.0];
const LARGE: [f64; 6] = [120.0, 120.0, 150.0, 210.0, 210.0, 210.0];
/// Half-widths of the housings in the meshes of the maker's ROS description for UR3, UR5 and UR10; their successors have the
/// same joints. For UR20 and UR30, of which no mesh was at hand, a third more than UR10.
const RADII_3_MM: [f64; 7] = [64.0, 54.0, 46.0, 38.0, 33.0, 33.0, 33.0];
const RADII_5_MM: [f64; 7] = [75.0, 70.0, 59.0, 54.0, 40.0, 40.0, 40.0];
const RADII_10_MM: [f64; 7] = [95.0, 86.0, 75.0, 60.0, 46.0, 46.0, 46.0];
const RADII_20_MM: [f64; 7] = [125.0, 115.0, 100.0, 80.0, 61.0, 61.0, 61.0];

fn universal_robots(name: &'static str) -> Option<Arm> {
    let (lengths_mm, speeds_deg_s, beside_mm, radii_mm): OffsetRow = match name {
        "ur3" => ([151.9, -243.65, -213.25, 112.35, 85.35, 81.9], SMALL, [119.8, 27.3], RADII_3_MM),
        "ur5" => ([89.159, -425.0, -392.25, 109.15, 94.65, 82.3], [180.0; 6], [135.85, 16.15], RADII_5_MM),
        "ur10" => ([127.3, -612.0, -572.3, 163.941, 115.7, 92.2], SLOW, [220.941, 49.041], RADII_10_MM),
        "ur3e" => ([151.85, -243.55, -213.2, 131.05, 85.35, 92.1], SMALL, [120.0, 27.0], RADII_3_MM),
        "ur5e" => ([162.5, -425.0, -392.2, 133.3, 99.7, 99.6], [180.0; 6], [138.0, 7.0], RADII_5_MM),
        "ur10e" => ([180.7, -612.7, -571.55, 174.15, 119.85, 116.55], SLOW, [176.2, 39.3], RADII_10_MM),
        "ur16e" => ([180.7, -478.4, -360.0, 174.15, 119.85, 116.55], SLOW, [176.2, 39.3], RADII_10_MM),
        "ur20" => ([236.3, -862.0, -728.7, 201.0, 159.3, 154.3], LARGE, [260.0, 43.0], RADII_20_MM),
        "ur30" => ([236.3, -637.0, -503.7, 201.0, 159.3, 154.3], LARGE, [260.0, 43.0], RADII_20_MM),
        _ => return None,
    };
    let [d1_mm, a2_mm, a3_mm, d4_mm, d5_mm, d6_mm] = lengths_mm;
    let kinematics = Kinematics::OffsetWrist(OffsetWrist { d1_mm, a2_mm, a3_mm, d4_mm, d5_mm, d6_mm });
    // The maker's range of the elbow is +-360, too; at +-180 the shoulder is in its way, and the ROS description ends there.
    let mut range_deg = [[-360.0, 360.0]; 6];
    range_deg[2] = [-180.0, 180.0];
    let body = Body { radii_mm, beside_mm, ..OFFSET_WRIST };
    let limits = Limits::degrees(range_deg, speeds_deg_s);
    let counting = Some(Counting { maker: Some(Maker::UniversalRobots), third_from_level: false });
    Some(Arm { name: name.into(), kinematics, limits, body, counting })
}

/// Lengths (a1, a2, b, c1 to c4, mm), offsets (degrees), signs, limits (degrees) and speeds (degrees/s) of the joints.
type SphericalRow = ([f64; 7], [f64; 6], [i8; 6], [[f64; 2]; 6], [f64; 6]);

const ELBOW: [f64; 6] = [0.0, 0.0, -90.0, 0.0, 0.0, 0.0];
const ABB_IRB1600_10_145: SphericalRow = (
    [150.0, 0.0, 0.0, 486.5, 700.0, 600.0, 65.0],
    ELBOW,
    [1; 6],
    [[-180.0, 180.0], [-90.0, 150.0], [-245.0, 65.0], [-200.0, 200.0], [-115.0, 115.0], [-400.0, 400.0]],
    [180.0, 180.0, 185.0, 385.0, 400.0, 460.0],
);

const ABB_IRB2600_12_165: SphericalRow = (
    [150.0, -115.0, 0.0, 445.0, 700.0, 795.0, 85.0],
    ELBOW,
    [1; 6],
    [[-180.0, 180.0], [-95.0, 155.0], [-155.0, 75.0], [-400.0, 400.0], [-120.0, 120.0], [-400.0, 400.0]],
    [175.0, 175.0, 175.0, 360.0, 360.0, 500.0],
);

const KUKA_KR10_R1420: SphericalRow = (
    [150.0, -20.0, 0.0, 450.0, 610.0, 660.0, 80.0],
    [0.0, -90.0, 0.0, 0.0, 0.0, 0.0],
    [-1, 1, 1, -1, 1, -1],
    [[-170.0, 170.0], [-185.0, 65.0], [-137.0, 163.0], [-185.0, 185.0], [-120.0, 120.0], [-350.0, 350.0]],
    [220.0, 210.0, 270.0, 381.0, 311.0, 492.0],
);

// Its controller's world frame stands at the height of joint 2, so c1 is 0 here; joint 3 counts as J2 + J3.
const FANUC_M10IA: SphericalRow = (
    [150.0, -200.0, 0.0, 0.0, 600.0, 640.0, 100.0],
    [0.0, 0.0, -90.0, 0.0, 0.0, 180.0],
    [1, 1, -1, -1, -1, -1],
    [[-180.0, 180.0], [-90.0, 160.0], [-180.0, 264.0], [-190.0, 190.0], [-190.0, 190.0], [-360.0, 360.0]],
    [210.0, 190.0, 210.0, 400.0, 400.0, 600.0],
);

/// Whose row it is, and how high it stands on: FANUC's origin is at joint 2.
fn spherical(name: &'static str) -> Option<Arm> {
    let (row, maker, mounting_mm) = match name {
        "abb-irb1600-10-145" => (ABB_IRB1600_10_145, Maker::Abb, 0.0),
        "abb-irb2600-12-165" => (ABB_IRB2600_12_165, Maker::Abb, 0.0),
        "kuka-kr10-r1420" => (KUKA_KR10_R1420, Maker::Kuka, 0.0),
        "fanuc-m10ia" => (FANUC_M10IA, Maker::Fanuc, -450.0),
        _ => return None,
    };
    let (lengths, offsets_deg, signs, limits_deg, speeds_deg_s) = row;
    let [a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm] = lengths;
    let opw = Opw { a1_mm, a2_mm, b_mm, c1_mm, c2_mm, c3_mm, c4_mm, offsets_deg, signs };
    let kinematics = Kinematics::SphericalWrist(SphericalWrist::new(opw));
    let body = Body::of_reach(c2_mm + c3_mm, mounting_mm);
    let limits = Limits::degrees(limits_deg, speeds_deg_s);
    let counting = Some(Counting { maker: Some(maker), third_from_level: maker == Maker::Fanuc });
    Some(Arm { name: name.into(), kinematics, limits, body, counting })
}
