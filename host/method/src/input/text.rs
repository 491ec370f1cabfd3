//! Columns of numbers: XYZ, TXT, CSV, ASC, PTS; comma, semicolon, tab or spaces; a header in any order is optional.
//!
//! A header cell may carry the unit (`x_mm`, `Y [m]`). An empty cell or `nan` is a missing reading. With semicolons a
//! comma is a decimal comma. Columns beyond x, y and z are left.

use std::path::Path;

use csv::{ByteRecord, ReaderBuilder, Trim};
use nalgebra::Point3;

use super::Error;
use super::raw::{Positions, Raw};
use super::units::Unit;

const HELP: &str =
    "Write one point per line: x, y, z, with one delimiter and, if you like, a header that names them";

/// Bytes of a row at most: some thousand columns.
const LONGEST_ROW: usize = 1 << 16;

/// Reads a file of columns.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Raw, Error> {
    let preamble = Preamble::of(bytes, path)?;
    preamble.refuse_endless_rows(path)?;
    let mut reader = ReaderBuilder::new()
        .delimiter(preamble.delimiter)
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(Trim::All)
        .from_reader(preamble.rows);
    let mut record = ByteRecord::new();
    let mut points = Vec::new();
    loop {
        let line = preamble.lines + reader.position().line() as usize;
        let bad = |problem: String| Error::malformed(path, format!("line {line}"), problem, HELP);
        if !reader.read_byte_record(&mut record).map_err(|e| bad(e.to_string()))? {
            break;
        }
        if let Some(point) = preamble.point(&record).map_err(bad)? {
            points.push(point);
        }
    }
    let mut raw = Raw::from(Positions::Double(points));
    raw.unit = preamble.unit;
    raw.notes.push(preamble.note());
    Ok(raw)
}

/// What stands before the first row of numbers, and what follows from it.
#[derive(Debug)]
struct Preamble<'a> {
    rows: &'a [u8],
    /// Lines before `rows`.
    lines: usize,
    delimiter: u8,
    columns: [usize; 3],
    unit: Option<Unit>,
}

impl<'a> Preamble<'a> {
    fn of(bytes: &'a [u8], path: &Path) -> Result<Self, Error> {
        let mut rest = bytes;
        let mut header = None;
        let mut lines = 0;
        while !rest.is_empty() {
            let end = rest.iter().position(|b| *b == b'\n').map_or(rest.len(), |at| at + 1);
            let line = rest[..end].trim_ascii();
            if is_row(line) {
                let (columns, unit) = header.unwrap_or(([0, 1, 2], None));
                return Ok(Self { rows: rest, lines, delimiter: delimiter(line), columns, unit });
            }
            lines += 1;
            match named_columns(line).map_err(|p| Error::malformed(path, format!("line {lines}"), p, HELP))? {
                Some(found) => header = Some(found),
                None if is_remark(line) => {}
                None => {
                    let problem = "neither a row of numbers nor a header with x, y and z";
                    return Err(Error::malformed(path, format!("line {lines}"), problem, HELP));
                }
            }
            rest = &rest[end..];
        }
        Err(Error::empty(path, "there is no row of numbers"))
    }

    /// The library keeps the place of every cell of a row: one of nothing but commas would take eight times its bytes.
    fn refuse_endless_rows(&self, path: &Path) -> Result<(), Error> {
        let long = self.rows.split(|b| *b == b'\n').position(|row| row.len() > LONGEST_ROW);
        long.map_or(Ok(()), |row| {
            let problem = format!("it is longer than {LONGEST_ROW} bytes, the most for one point");
            Err(Error::malformed(path, format!("line {}", self.lines + row + 1), problem, HELP))
        })
    }

    /// The point of a row; `None` for an empty row.
    fn point(&self, record: &ByteRecord) -> Result<Option<Point3<f64>>, String> {
        let spaced = self.delimiter == b' ';
        let mut cells = record.iter().filter(|cell| !(spaced && cell.is_empty()));
        if record.iter().all(<[u8]>::is_empty) {
            return Ok(None);
        }
        let mut xyz = [None; 3];
        let last = self.columns.into_iter().max().unwrap_or(2);
        for column in 0..=last {
            let cell =
                cells.next().ok_or_else(|| format!("{column} columns, at least {} are needed", last + 1))?;
            if let Some(axis) = self.columns.iter().position(|c| *c == column) {
                xyz[axis] = Some(number(cell, self.delimiter == b';').ok_or_else(|| {
                    format!("column {} is {:?}, not a number", column + 1, String::from_utf8_lossy(cell))
                })?);
            }
        }
        let [x, y, z] = xyz.map(|c| c.unwrap_or(f64::NAN));
        Ok(Some(Point3::new(x, y, z)))
    }

    fn note(&self) -> String {
        let [x, y, z] = self.columns.map(|c| c + 1);
        let delimiter = match self.delimiter {
            b',' => "commas",
            b';' => "semicolons",
            b'\t' => "tabs",
            _ => "spaces",
        };
        format!("x, y, z are columns {x}, {y}, {z}, separated by {delimiter}")
    }
}

/// A line that says nothing: empty, a comment, or the number of points that PTS files begin with.
fn is_remark(line: &[u8]) -> bool {
    line.is_empty()
        || line.starts_with(b"#")
        || line.starts_with(b"//")
        || line.iter().all(u8::is_ascii_digit)
}

/// A line whose first cell is a number and that has more than one.
fn is_row(line: &[u8]) -> bool {
    let delimiter = delimiter(line);
    let mut cells = line.split(|b| *b == delimiter).map(<[u8]>::trim_ascii);
    let first = cells.next().is_some_and(|cell| number(cell.trim_ascii(), delimiter == b';').is_some());
    first && cells.next().is_some()
}

fn delimiter(line: &[u8]) -> u8 {
    [b';', b',', b'\t'].into_iter().find(|d| line.contains(d)).unwrap_or(b' ')
}

type Named = ([usize; 3], Option<Unit>);

/// Columns and unit of a header; `None` if the line does not name x, y and z.
fn named_columns(line: &[u8]) -> Result<Option<Named>, String> {
    let line = String::from_utf8_lossy(line).to_ascii_lowercase();
    let line = line.trim_start_matches(['#', '/', ' ']);
    let delimiter = char::from(delimiter(line.as_bytes()));
    let cells = line.split(delimiter).filter(|cell| delimiter != ' ' || !cell.is_empty());
    let mut columns = [None; 3];
    let mut units = Vec::new();
    for (i, cell) in cells.enumerate() {
        let mut words = cell.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
        let axis = words.next().and_then(|name| ["x", "y", "z"].iter().position(|axis| *axis == name));
        if let Some(axis) = axis.filter(|axis| columns[*axis].is_none()) {
            columns[axis] = Some(i);
            units.push(words.find_map(Unit::named));
        }
    }
    match columns {
        [Some(x), Some(y), Some(z)] if units.iter().all(|unit| *unit == units[0]) => {
            Ok(Some(([x, y, z], units[0])))
        }
        [Some(_), Some(_), Some(_)] => Err("x, y and z have different units".into()),
        _ => Ok(None),
    }
}

/// A number, or NaN for a reading that is missing; `None` for anything else.
fn number(cell: &[u8], decimal_comma: bool) -> Option<f64> {
    let text = std::str::from_utf8(cell).ok()?.trim_matches('"');
    if text.is_empty() || text.trim_start_matches('-').to_ascii_lowercase().starts_with("nan") {
        return Some(f64::NAN);
    }
    match decimal_comma && text.contains(',') {
        true => text.replace(',', ".").parse().ok(),
        false => text.parse().ok(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Raw, Error> {
        parse(text.as_bytes(), Path::new("cloud.csv"))
    }

    fn points(text: &str) -> Vec<[f64; 3]> {
        match read(text).unwrap().positions {
            Positions::Double(points) => points.iter().map(|p| [p.x, p.y, p.z]).collect(),
            Positions::Single(_) => unreachable!("text is read in double precision"),
        }
    }

    #[test]
    fn all_delimiters_and_headers_give_the_same_point() {
        for text in [
            "1.5 2 -3\n",
            "  1.5   2  -3 255 0 0\n",
            "1.5\t2\t-3",
            "1.5,2,-3\r\n",
            "1.5, 2, -3\n",
            "1,5;2;-3\n",
            "x,y,z\n1.5,2,-3\n",
            "z;x;y\n-3;1,5;2\n",
            "//X Y Z R G B\n1.5 2 -3 1 2 3\n",
            "# made by hand\n# intensity z y x\n0.5 -3 2 1.5\n",
            "1\n1.5 2 -3 77\n",
            "nx,ny,nz,x_mm,y_mm,z_mm\n0,0,1,1.5,2,-3\n",
            "\"x\",\"y\",\"z\"\n\"1.5\",\"2\",\"-3\"\n\n",
        ] {
            assert_eq!(points(text), [[1.5, 2.0, -3.0]], "{text:?}");
        }
    }

    #[test]
    fn the_unit_stands_in_the_header() {
        assert_eq!(read("x_mm,y_mm,z_mm\n1,2,3\n").unwrap().unit, Some(Unit::Millimetre));
        assert_eq!(read("X [m];Y [m];Z [m]\n1;2;3\n").unwrap().unit, Some(Unit::Metre));
        assert_eq!(read("x,y,z\n1,2,3\n").unwrap().unit, None);
        assert!(read("x_mm,y_m,z_mm\n1,2,3\n").unwrap_err().to_string().contains("line 1"));
    }

    #[test]
    fn an_error_names_the_line_and_the_cell() {
        let error = read("# c\nx,y,z\n1,2,3\n4,five,6\n").unwrap_err().to_string();
        assert!(error.contains("line 4") && error.contains("column 2") && error.contains("five"), "{error}");
        let error = read("1 2 3\n4 5\n").unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
        assert!(read("hello world\n").unwrap_err().to_string().contains("line 1"));
        assert!(matches!(read("# nothing\n").unwrap_err(), Error::Empty { .. }));
    }

    #[test]
    fn missing_readings_are_not_numbers() {
        let nan = |text: &str| points(text)[1].iter().any(|c| c.is_nan());
        assert!(nan("1,2,3\n1,,3\n") && nan("1 2 3\nnan nan nan\n") && nan("1,2,3\n1,-nan(ind),3\n"));
    }
}
