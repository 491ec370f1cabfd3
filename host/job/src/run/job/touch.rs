//! `[[touch]]`: a place that the robot's own tip touched.

use std::path::Path;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::quantity::{Place, TouchMm};
use weldpath_method::pipeline::touch::Touch;

/// `[[touch]]`: a place on a seam where the robot's own tip was.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TouchSettings {
    /// Where the tip was, mm, base frame.
    pub at_mm: Place,
    /// Id of the seam that it touched; by default the nearest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seam: Option<usize>,
    /// One standard deviation, each axis.
    #[serde(default)]
    pub sigma_mm: TouchMm,
}

impl TouchSettings {
    /// As the pipeline takes it.
    pub fn touch(&self) -> Touch {
        Touch { at_mm: self.at_mm.point_mm(), seam: self.seam, sigma_mm: self.sigma_mm.get() }
    }

    /// Touches of a CSV file: a row each, x, y, z in mm and perhaps the seam's id; a first row of words is passed over.
    ///
    /// # Errors
    /// What is wrong, with its line; `path` is only named.
    pub fn of_csv(text: &str, path: &Path) -> Result<Vec<Self>, String> {
        let rows = text.lines().enumerate().filter(|(_, row)| !row.trim().is_empty());
        let is_head = |(at, row): &(usize, &str)| *at == 0 && row.chars().any(char::is_alphabetic);
        let touch = |(at, row): (usize, &str)| {
            row.parse().map_err(|why| format!("{}, line {}: {why}", path.display(), at + 1))
        };
        let touches: Vec<Self> = rows.filter(|row| !is_head(row)).map(touch).collect::<Result<_, _>>()?;
        if touches.is_empty() {
            return Err(format!(
                "{}: it holds no touch; write x,y,z[,seam] in mm, one per line",
                path.display()
            ));
        }
        Ok(touches)
    }
}

impl FromStr for TouchSettings {
    type Err = String;

    /// `x,y,z` or `x,y,z,seam`.
    fn from_str(text: &str) -> Result<Self, String> {
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        let (place, seam) = match parts.as_slice() {
            [x, y, z] => ([x, y, z], None),
            [x, y, z, seam] => ([x, y, z], Some(*seam)),
            _ => {
                return Err(format!(
                    "{} values; give x,y,z in mm, or x,y,z,SEAM, as in 412.3,-80.1,22.4,2",
                    parts.len()
                ));
            }
        };
        let at_mm = place.map(|value| *value).join(",").parse()?;
        let number = |seam: &str| seam.parse().map_err(|_| format!("{seam:?} is not a seam number"));
        Ok(Self { at_mm, seam: seam.map(number).transpose()?, sigma_mm: TouchMm::default() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_touches_and_their_faults_are_told_with_the_line() {
        let path = Path::new("touches.csv");
        let touches = TouchSettings::of_csv("x_mm,y_mm,z_mm,seam\n1,2.5,-3\n\n4,5,6,2\n", path).unwrap();
        assert_eq!(touches.len(), 2);
        assert_eq!((touches[0].at_mm.get(), touches[0].seam), ([1.0, 2.5, -3.0], None));
        assert_eq!(touches[1].seam, Some(2));
        for (text, why) in [
            ("", "no touch"),
            ("1,2\n", "line 1"),
            ("a,b,c\n1,x,3\n", "line 2"),
            ("x,y,z\n1,2,nan\n", "line 2"),
        ] {
            let error = TouchSettings::of_csv(text, path).unwrap_err();
            assert!(error.contains("touches.csv") && error.contains(why), "{error}");
        }
    }
}
