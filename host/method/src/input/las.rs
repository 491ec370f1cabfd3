//! LAS and LAZ by the crate `las`. Metres, as almost all such files are; `--units` overrules.

use std::io::Cursor;
use std::path::Path;

use las::Reader;
use nalgebra::Point3;

use super::Error;
use super::memory::Limit;
use super::raw::{Positions, Raw};
use super::records;
use super::units::Unit;

/// The shortest point record of the format, bytes.
const RECORD: u64 = 20;
/// LAZ packs a point into no less than this share of a byte: what claims more is broken.
const LAZ_POINTS_PER_BYTE: u64 = 64;
/// Points read at once.
const CHUNK: u64 = 65_536;

/// Reads a LAS or LAZ file.
pub(super) fn parse(bytes: Vec<u8>, path: &Path, limit: Limit) -> Result<Raw, Error> {
    let available = bytes.len();
    let bad = |e: las::Error| {
        Error::malformed(
            path,
            "LAS data",
            e.to_string(),
            "The file is cut off or damaged: copy or export it again",
        )
    };
    let mut reader = Reader::new(Cursor::new(bytes)).map_err(bad)?;
    let (count, packed) = (reader.header().number_of_points(), reader.header().point_format().is_compressed);
    let possible = if packed { available.saturating_mul(LAZ_POINTS_PER_BYTE as usize) } else { available };
    let record = if packed { 1 } else { RECORD };
    let count = records::check_count(count, record, possible, "points", "number of point records", path)?;
    limit.hold(path, available, "points", count as u64, 24 + 12)?;
    let mut points = Vec::with_capacity(count);
    while points.len() < count {
        let chunk = reader.read_points(CHUNK).map_err(bad)?;
        if chunk.is_empty() {
            let problem = format!("{count} points are claimed, {} are there", points.len());
            return Err(Error::malformed(
                path,
                "LAS data",
                problem,
                "The file is cut off: copy or export it again",
            ));
        }
        points.extend(chunk.x().zip(chunk.y()).zip(chunk.z()).map(|((x, y), z)| Point3::new(x, y, z)));
    }
    let mut raw = Raw::from(Positions::Double(points));
    raw.unit = Some(Unit::Metre);
    raw.notes.push("LAS: read as metres; say --units mm if it is not".into());
    Ok(raw)
}

#[cfg(test)]
mod tests {
    use super::super::{Options, Scan, Units, read_bytes};
    use super::*;
    use las::point::Format;
    use las::{Builder, Point, Transform, Vector, Writer};

    /// A file of 500 points far from the origin, written by the crate's own writer.
    fn written(packed: bool) -> (Vec<u8>, Vec<Point3<f64>>) {
        let truth: Vec<Point3<f64>> = (0..500)
            .map(|i| {
                Point3::new(
                    1000.0 + f64::from(i % 25) * 0.01,
                    -2000.0 + f64::from(i / 25) * 0.01,
                    3.0 + f64::from(i) * 1e-4,
                )
            })
            .collect();
        let mut builder = Builder::from((1, 2));
        builder.point_format = Format::new(0).unwrap();
        builder.point_format.is_compressed = packed;
        let axis = |offset| Transform { scale: 1e-5, offset };
        builder.transforms = Vector { x: axis(1000.0), y: axis(-2000.0), z: axis(0.0) };
        let mut writer = Writer::new(Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
        for p in &truth {
            writer.write_point(Point { x: p.x, y: p.y, z: p.z, ..Point::default() }).unwrap();
        }
        (writer.into_inner().unwrap().into_inner(), truth)
    }

    fn read(bytes: Vec<u8>) -> Result<Scan, Error> {
        read_bytes(bytes, Path::new("part.las"), &Options::default())
    }

    #[test]
    fn what_the_writer_of_the_crate_wrote_is_read_in_millimetres() {
        for packed in [false, true] {
            let (bytes, truth) = written(packed);
            let scan = read(bytes.clone()).unwrap();
            let view = &scan.views[0];
            assert_eq!(view.points_mm.len(), truth.len(), "packed {packed}");
            for (p, t) in view.points_mm.iter().zip(&truth) {
                let base = view.base_from_camera * p.cast::<f64>();
                assert!((base.coords - t.coords * 1000.0).norm() < 0.02, "{base} {t}");
            }
            let options = Options { units: Units::Millimetres, ..Options::default() };
            let as_mm = read_bytes(bytes, Path::new("part.las"), &options).unwrap();
            assert!((as_mm.views[0].base_from_camera.translation.vector.x - 1000.0).abs() < 1.0);
        }
    }

    #[test]
    fn a_file_that_is_cut_off_or_claims_too_much_is_refused() {
        let (bytes, _) = written(false);
        for cut in [3, 100, 230, bytes.len() / 2, bytes.len() - 1] {
            assert!(read(bytes[..cut].to_vec()).is_err(), "cut at {cut}");
        }
        let (packed, _) = written(true);
        assert!(read(packed[..packed.len() / 2].to_vec()).is_err());
        let mut greedy = bytes;
        greedy[107..111].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(matches!(read(greedy), Err(Error::Oversized { .. })));
    }
}
