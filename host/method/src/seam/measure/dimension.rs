//! What is measured of a joint beside the line of its seam, and how sure the measurement is (ours).

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Quantity {
    /// Angle between the faces through the air: of a groove, the groove angle. Degrees.
    IncludedAngle,
    /// From the surface of the plates down to where the groove faces end, mm.
    GrooveDepth,
    /// Width of a groove at the surface of the plates, mm.
    CapWidth,
    /// Height of the upper sheet's edge, mm.
    SheetThickness,
    /// Distance of the members at the root, mm.
    RootOpening,
}

impl Quantity {
    /// The name in files, with the unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::IncludedAngle => "included_angle_deg",
            Self::GrooveDepth => "groove_depth_mm",
            Self::CapWidth => "cap_width_mm",
            Self::SheetThickness => "sheet_thickness_mm",
            Self::RootOpening => "root_opening_mm",
        }
    }
}

impl Quantity {
    /// The name for people.
    pub const fn words(self) -> &'static str {
        match self {
            Self::IncludedAngle => "included angle",
            Self::GrooveDepth => "groove depth",
            Self::CapWidth => "cap width",
            Self::SheetThickness => "sheet thickness",
            Self::RootOpening => "root opening",
        }
    }

    /// Its unit.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::IncludedAngle => "deg",
            _ => "mm",
        }
    }
}

impl std::fmt::Display for Dimension {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (words, unit) = (self.quantity.words(), self.quantity.unit());
        match &self.value {
            Ok(Value { value, uncertainty }) => write!(f, "{words} {value:.1} ± {uncertainty:.1} {unit}"),
            Err(reason) => write!(f, "{words} not measurable ({reason})"),
        }
    }
}

/// A value and its uncertainty, in the unit of its quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Value {
    /// The best guess.
    pub value: f64,
    /// The truth lies no farther from it in about 19 cases of 20.
    pub uncertainty: f64,
}

/// One dimension of a joint: a value, or why it cannot be measured from this scan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Dimension {
    /// What it is.
    pub quantity: Quantity,
    /// How large it is, or in words why nobody can tell.
    pub value: Result<Value, Cow<'static, str>>,
}

impl Dimension {
    /// What was measured, or why it could not be.
    pub fn new(quantity: Quantity, value: Result<Value, &'static str>) -> Self {
        Self { quantity, value: value.map_err(Cow::Borrowed) }
    }
}
