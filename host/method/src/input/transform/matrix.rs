//! A matrix in a file of OpenCV's FileStorage (YAML or JSON) or of Zivid (FloatMatrix).
//!
//! Zivid's lengths are mm. FileStorage does not say its unit, but the distance of a camera does: none is within a millimetre of the
//! flange, and none is five metres off.

use nalgebra::Isometry3;
use serde_json::{Map, Value};

use super::super::units::Unit;
use super::{Fault, from_rows};

const HELP: &str = "Give one 4x4 matrix, or a rotation R (3x3) and a translation t (3x1)";

/// YAML as the standard has it: FileStorage writes a head and a tag of its own.
#[cfg(feature = "yaml")]
pub(super) fn plain_yaml(bytes: &[u8]) -> Vec<u8> {
    const TAG: &[u8] = b"!!opencv-matrix";
    let lines = bytes.split_inclusive(|b| *b == b'\n').filter(|line| !line.starts_with(b"%YAML"));
    let plain = lines.map(|line| match line.windows(TAG.len()).position(|window| window == TAG) {
        Some(at) => [&line[..at], &line[at + TAG.len()..]].concat(),
        None => line.to_vec(),
    });
    plain.collect::<Vec<_>>().concat()
}

/// The transform that the file's matrices make; none if it has no matrix.
pub(super) fn of(value: &Value) -> Option<Result<Isometry3<f64>, Fault>> {
    let root = value.as_object()?;
    let zivid = root.get("FloatMatrix").map(|matrix| matrix.get("Data").unwrap_or(matrix));
    if let Some(data) = zivid {
        let rows = numbers(data).filter(|all| all.len() == 16);
        let rows = rows.ok_or_else(|| ("its FloatMatrix has not 4x4 numbers".to_owned(), HELP));
        return Some(rows.and_then(|all| from_rows(&four(&all), Unit::Millimetre)));
    }
    let found: Vec<(&str, Matrix)> = root
        .iter()
        .filter_map(|(key, value)| Some((key.as_str(), Matrix::of(value.as_object()?)?)))
        .collect();
    if found.is_empty() {
        return None;
    }
    Some(rigid(&found))
}

fn rigid(found: &[(&str, Matrix)]) -> Result<Isometry3<f64>, Fault> {
    let sized = |rows: usize, columns: usize| -> Vec<&(&str, Matrix)> {
        found.iter().filter(|(_, matrix)| (matrix.rows, matrix.columns) == (rows, columns)).collect()
    };
    let rows = match (&sized(4, 4)[..], &sized(3, 3)[..], &sized(3, 1)[..]) {
        ([(_, one)], ..) => four(&one.data),
        ([], [(_, r)], [(_, t)]) => {
            let row = |k: usize| [r.data[3 * k], r.data[3 * k + 1], r.data[3 * k + 2], t.data[k]];
            [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]]
        }
        _ => {
            let names: Vec<String> =
                found.iter().map(|(name, m)| format!("{name} ({}x{})", m.rows, m.columns)).collect();
            return Err((
                format!("which of its matrices is the transform? It has {}", names.join(", ")),
                HELP,
            ));
        }
    };
    let away = [rows[0][3], rows[1][3], rows[2][3]].map(|c| c * c).iter().sum::<f64>().sqrt();
    let unit = match away {
        away if away < 1.0 => Unit::Metre,
        away if away > 5.0 => Unit::Millimetre,
        _ => {
            let help = "Give the transform itself in scan.json, in its `units`";
            return Err((
                format!("its camera is {away:.3} away, and the file does not say whether mm or m"),
                help,
            ));
        }
    };
    from_rows(&rows, unit)
}

/// A matrix of FileStorage.
struct Matrix {
    rows: usize,
    columns: usize,
    /// Row by row, as many as rows times columns.
    data: Vec<f64>,
}

impl Matrix {
    fn of(map: &Map<String, Value>) -> Option<Self> {
        let size = |key: &str| usize::try_from(map.get(key)?.as_u64()?).ok();
        let (rows, columns) = (size("rows")?, size("cols")?);
        let data = numbers(map.get("data")?)?;
        (Some(data.len()) == rows.checked_mul(columns)).then_some(Self { rows, columns, data })
    }
}

/// All numbers of a list, or of a list of lists.
fn numbers(value: &Value) -> Option<Vec<f64>> {
    let rows = value.as_array()?.iter().map(|item| match item {
        Value::Array(row) => row.iter().map(Value::as_f64).collect::<Option<Vec<_>>>(),
        other => Some(vec![other.as_f64()?]),
    });
    Some(rows.collect::<Option<Vec<_>>>()?.concat())
}

/// Sixteen numbers row by row.
fn four(all: &[f64]) -> [[f64; 4]; 4] {
    std::array::from_fn(|r| std::array::from_fn(|c| all[4 * r + c]))
}

#[cfg(all(test, feature = "yaml"))]
mod tests {
    use super::super::{Mount, of_file};

    const ROWS: &str = "0, 0, 1, 10, 1, 0, 0, -20, 0, 1, 0, 30, 0, 0, 0, 1";

    fn read(text: &str) -> Result<nalgebra::Isometry3<f64>, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("eye.yml");
        std::fs::write(&file, text).unwrap();
        of_file(&file, Mount::Flange).map_err(|error| error.to_string())
    }

    #[test]
    fn matrices_of_opencv_and_zivid_say_the_same() {
        let opencv = |name: &str, rows: usize, columns: usize, data: &str| {
            format!(
                "{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]\n"
            )
        };
        let head = "%YAML:1.0\n---\n";
        let metres = ROWS.replace("10,", "0.01,").replace("20", "0.02").replace("30", "0.03");
        let zivid = "__version__:\n  serializer: 1\n  data: 1\nFloatMatrix:\n  Data:\n    [[0, 0, 1, 10],\n     [1, 0, 0, -20],\n     \
                     [0, 1, 0, 30],\n     [0, 0, 0, 1]]\n";
        let json = format!(
            "{{\"T\": {{\"type_id\": \"opencv-matrix\", \"rows\": 4, \"cols\": 4, \"dt\": \"d\", \"data\": [{ROWS}]}}}}"
        );
        for text in [
            format!("{head}{}", opencv("PoseState", 4, 4, ROWS)),
            format!("{head}{}", opencv("T", 4, 4, &metres)).replace('\n', "\r\n"),
            format!(
                "{head}{}{}",
                opencv("R", 3, 3, "0, 0, 1, 1, 0, 0, 0, 1, 0"),
                opencv("t", 3, 1, "10, -20, 30")
            ),
            zivid.to_owned(),
            json,
        ] {
            let read = read(&text).unwrap();
            let turned = (read.rotation * nalgebra::Vector3::x() - nalgebra::Vector3::y()).norm();
            let at = read.translation.vector - nalgebra::Vector3::new(10.0, -20.0, 30.0);
            assert!(turned < 1e-6 && at.norm() < 1e-6, "{text}\n{read}");
        }
        for (text, part) in [
            (format!("{head}{}", opencv("K", 3, 3, "600, 0, 320, 0, 600, 240, 0, 0, 1")), "K (3x3)"),
            (
                format!(
                    "{head}{}",
                    opencv("T", 4, 4, &ROWS.replace("30", "3").replace("10,", "1,").replace("-20", "2"))
                ),
                "whether mm or m",
            ),
            (zivid.replace("[0, 0, 0, 1]", "[0, 0, 0]"), "FloatMatrix"),
        ] {
            let error = read(&text).unwrap_err();
            assert!(error.contains("eye.yml") && error.contains(part), "{error}");
        }
    }
}
