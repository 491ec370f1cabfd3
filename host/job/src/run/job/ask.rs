//! `[[ask]]`: a seam that the search passed over. `[[draw]]`: a line that is none until a person says so.

use std::str::FromStr;

use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::Place;

/// Most places of one seam: a loop clicked every few degrees has fewer.
const MOST_PLACES: usize = 200;

/// `[[ask]]`: a seam that the search missed. It is searched along these places, and not found if no two faces meet there.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AskSettings {
    /// Places within 10 mm of the seam, in their order, mm, base frame: both ends of a straight one, more of a curve; a loop
    /// comes back to the first.
    pub between_mm: Places,
}

/// `[[draw]]`: a line on the surface that is welded though no seam is found there: the last resort. A person looks at it each time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DrawSettings {
    /// Places on the surface, in their order, mm, base frame: straight from each to the next, as the surface goes; a loop comes back to
    /// the first.
    pub through_mm: Places,
}

impl DrawSettings {
    /// As the pipeline takes it.
    pub fn places_mm(&self) -> Vec<Point3<f64>> {
        self.through_mm.points_mm()
    }
}

/// Two places or more.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "Vec<Place>", into = "Vec<Place>")]
#[schemars(with = "Vec<Place>", extend("minItems" = 2, "maxItems" = MOST_PLACES))]
pub struct Places(Vec<Place>);

impl AskSettings {
    /// As the pipeline takes it.
    pub fn places_mm(&self) -> Vec<Point3<f64>> {
        self.between_mm.points_mm()
    }
}

impl Places {
    fn points_mm(&self) -> Vec<Point3<f64>> {
        self.0.iter().map(|place| place.point_mm()).collect()
    }
}

impl TryFrom<Vec<Place>> for Places {
    type Error = String;

    fn try_from(places: Vec<Place>) -> Result<Self, String> {
        let least_two_differ = places.iter().any(|place| *place != places[0]);
        match places.len() {
            0 | 1 => Err("a seam has two places or more".into()),
            2..=MOST_PLACES if least_two_differ => Ok(Self(places)),
            2..=MOST_PLACES => Err("all places are the same: name both ends of the seam".into()),
            many => Err(format!("{many} places are too many: at most {MOST_PLACES}")),
        }
    }
}

impl From<Places> for Vec<Place> {
    fn from(places: Places) -> Self {
        places.0
    }
}

impl FromStr for Places {
    type Err = String;

    /// `x,y,z;x,y,z` or more.
    fn from_str(text: &str) -> Result<Self, String> {
        let places: Result<Vec<Place>, String> = text.split(';').map(|place| place.trim().parse()).collect();
        let hint = |why| format!("{why}; give two places or more in mm, as in 10,20,5;110,20,5");
        places.and_then(Self::try_from).map_err(hint)
    }
}

impl FromStr for AskSettings {
    type Err = String;

    /// `x,y,z;x,y,z` or more.
    fn from_str(text: &str) -> Result<Self, String> {
        text.parse().map(|between_mm| Self { between_mm })
    }
}

impl FromStr for DrawSettings {
    type Err = String;

    /// `x,y,z;x,y,z` or more.
    fn from_str(text: &str) -> Result<Self, String> {
        text.parse().map(|through_mm| Self { through_mm })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_places_or_more_are_a_wish_and_anything_else_is_told() {
        let ask: AskSettings = "1,2,3; -4,5,6;7,8,9.5".parse().unwrap();
        assert_eq!(ask.places_mm(), [[1.0, 2.0, 3.0], [-4.0, 5.0, 6.0], [7.0, 8.0, 9.5]].map(Point3::from));
        for (text, why) in [
            ("1,2,3", "two places or more"),
            ("1,2,3;1,2,3", "all places are the same"),
            ("1,2;3,4,5", "2 numbers"),
            ("1,2,x;3,4,5", "x"),
        ] {
            let error = text.parse::<AskSettings>().unwrap_err();
            assert!(error.contains(why) && error.contains("10,20,5;110,20,5"), "{text}: {error}");
        }
        assert!("0,0,0;1,1,1;".repeat(MOST_PLACES).trim_end_matches(';').parse::<AskSettings>().is_err());
    }
}
