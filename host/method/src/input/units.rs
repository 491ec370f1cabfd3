//! Metres or millimetres: what the user says, then what the file says, then what size a workpiece has.

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::extent::Extent;

/// Unit of a cloud whose file does not say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Units {
    /// Metres.
    #[serde(rename = "m")]
    #[cfg_attr(feature = "clap", value(name = "m"))]
    Metres,
    /// Millimetres.
    #[serde(rename = "mm")]
    #[cfg_attr(feature = "clap", value(name = "mm"))]
    Millimetres,
    /// Guessed from the size of the scan.
    #[default]
    #[serde(rename = "auto")]
    Auto,
}

/// The text is none of `auto`, `m`, `mm`.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown unit {0:?}: write auto, m or mm")]
pub struct UnknownUnits(pub String);

impl FromStr for Units {
    type Err = UnknownUnits;

    fn from_str(text: &str) -> Result<Self, UnknownUnits> {
        match text {
            "auto" => Ok(Self::Auto),
            "m" => Ok(Self::Metres),
            "mm" => Ok(Self::Millimetres),
            other => Err(UnknownUnits(other.into())),
        }
    }
}

impl fmt::Display for Units {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Metres => "m",
            Self::Millimetres => "mm",
        })
    }
}

/// A unit that is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Unit {
    Metre,
    Millimetre,
}

impl Unit {
    pub(super) fn mm(self) -> f64 {
        match self {
            Self::Metre => 1000.0,
            Self::Millimetre => 1.0,
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Metre => "metres",
            Self::Millimetre => "millimetres",
        }
    }

    /// The unit that a word names, in any spelling that exporters use.
    pub(super) fn named(word: &str) -> Option<Self> {
        match word.to_ascii_lowercase().as_str() {
            "m" | "meter" | "meters" | "metre" | "metres" => Some(Self::Metre),
            "mm" | "millimeter" | "millimeters" | "millimetre" | "millimetres" => Some(Self::Millimetre),
            _ => None,
        }
    }

    /// What `units` says, where it says anything.
    pub(super) fn chosen(units: Units) -> Option<Self> {
        match units {
            Units::Auto => None,
            Units::Metres => Some(Self::Metre),
            Units::Millimetres => Some(Self::Millimetre),
        }
    }
}

/// Diagonals that a workpiece or the scene around it has, mm: both bounds a little beyond 20 mm .. 3 m.
const WORKPIECE_MM: std::ops::RangeInclusive<f64> = 15.0..=4000.0;
/// Spacing below which no weld scanner samples, mm.
const FINEST_SPACING_MM: f64 = 0.02;
/// Diagonals beyond these are a wrong unit rather than a large part, mm.
const ABSURD_MM: std::ops::RangeInclusive<f64> = 2.0..=30_000.0;

/// Millimetres per unit of the file: `asked`, else `stated` in the file, else by size; says which and why.
pub(super) fn decide(
    asked: Units,
    stated: Option<Unit>,
    extent: &Extent,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> f64 {
    let (unit, why) = match (Unit::chosen(asked), stated) {
        (Some(unit), stated) => {
            if let Some(other) = stated.filter(|other| *other != unit) {
                warnings.push(format!("--units {asked} overrules the file, which states {}", other.name()));
            }
            (unit, "as given by --units".to_string())
        }
        (None, Some(unit)) => (unit, "as stated in the file".to_string()),
        (None, None) => by_size(extent, warnings),
    };
    notes.push(format!("units: {} ({why})", unit.name()));
    warn_if_absurd(extent.diagonal * unit.mm(), unit, warnings);
    unit.mm()
}

fn by_size(extent: &Extent, warnings: &mut Vec<String>) -> (Unit, String) {
    let diagonal = extent.diagonal;
    let as_metres = WORKPIECE_MM.contains(&(diagonal * 1000.0));
    let as_mm = WORKPIECE_MM.contains(&diagonal) && extent.spacing >= FINEST_SPACING_MM;
    let unit = match (as_metres, as_mm) {
        (true, false) => Unit::Metre,
        (false, true) => Unit::Millimetre,
        _ if diagonal < 20.0 => Unit::Metre,
        _ => Unit::Millimetre,
    };
    if as_metres == as_mm {
        warnings.push(format!(
            "the unit is a guess: an extent of {diagonal:.4} is unusual for a workpiece, in metres and in \
             millimetres; taken as {}; say --units m or --units mm to be sure",
            unit.name()
        ));
    }
    (unit, format!("extent {diagonal:.4}, spacing about {:.2e}", extent.spacing))
}

/// Warns when something `diagonal_mm` large can hardly be a workpiece.
fn warn_if_absurd(diagonal_mm: f64, unit: Unit, warnings: &mut Vec<String>) {
    if diagonal_mm > 0.0 && !ABSURD_MM.contains(&diagonal_mm) {
        let other = if unit == Unit::Metre { Units::Millimetres } else { Units::Metres };
        warnings.push(format!(
            "read as {}, the scan is {diagonal_mm:.3} mm across, which no workpiece is: try --units {other}",
            unit.name()
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn decided(asked: Units, stated: Option<Unit>, diagonal: f64, spacing: f64) -> (f64, Vec<String>) {
        let extent = Extent { middle: Vector3::zeros(), diagonal, spacing };
        let mut warnings = Vec::new();
        (decide(asked, stated, &extent, &mut Vec::new(), &mut warnings), warnings)
    }

    #[test]
    fn half_a_unit_across_is_metres_and_five_hundred_is_millimetres() {
        assert_eq!(decided(Units::Auto, None, 0.5, 0.001), (1000.0, vec![]));
        assert_eq!(decided(Units::Auto, None, 500.0, 1.0), (1.0, vec![]));
    }

    #[test]
    fn a_guess_names_the_option_that_ends_it() {
        for diagonal in [0.001, 0.0, 9.0, 20_000.0] {
            let (_, warnings) = decided(Units::Auto, None, diagonal, diagonal / 300.0);
            assert!(warnings.iter().any(|w| w.contains("--units")), "{diagonal}");
        }
    }

    #[test]
    fn a_part_of_three_hundred_metres_draws_a_warning_that_names_the_other_unit() {
        let (mm, warnings) = decided(Units::Metres, None, 300.0, 1.0);
        assert_eq!(mm, 1000.0);
        assert!(warnings[0].contains("--units mm"), "{warnings:?}");
    }

    #[test]
    fn the_user_overrules_the_file_and_the_file_overrules_the_size() {
        assert_eq!(decided(Units::Auto, Some(Unit::Millimetre), 3.0, 0.1).0, 1.0);
        let (mm, warnings) = decided(Units::Metres, Some(Unit::Millimetre), 3.0, 0.1);
        assert_eq!(mm, 1000.0);
        assert!(warnings[0].contains("overrules"));
    }

    #[test]
    fn every_unit_is_read_back_as_it_is_written() {
        for units in [Units::Auto, Units::Metres, Units::Millimetres] {
            assert_eq!(units.to_string().parse(), Ok(units));
        }
        assert!("inch".parse::<Units>().is_err());
    }
}
