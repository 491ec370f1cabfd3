//! The shapes everything is made of: millimetres, single precision, robot base frame unless a name says otherwise.
//!
//! nalgebra's types and arithmetic only: every root or angle comes from [`crate::math`], so that host and
//! microcontroller compute the same bits.

/// A place, mm.
pub type Point = nalgebra::Point3<f32>;
/// A displacement, mm, or a free vector.
pub type Vector = nalgebra::Vector3<f32>;
/// A unit vector.
pub type Direction = nalgebra::UnitVector3<f32>;
/// A rotation: `base_from_tool` unless a name says otherwise.
pub type Orientation = nalgebra::UnitQuaternion<f32>;
