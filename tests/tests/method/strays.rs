//! Pixels that a camera invents, far behind the work or at the end of its range, change no seam.

use std::fs;
use std::path::Path;

use weldpath::input;
use weldpath::pipeline::{self, Plan};
use weldpath::run::job::Job;

/// Counts of the copies are so many of the fixture's: 0.5 mm each, which reach to 32 m.
const COARSER: u16 = 10;
/// Every so manieth pixel without a reading gets one.
const ONE_IN: usize = 97;

fn decoded(file: &Path) -> (png::OutputInfo, Vec<u16>) {
    let bytes = fs::read(file).expect("an image");
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a header");
    let mut data = vec![0; reader.output_buffer_size().expect("a size")];
    let info = reader.next_frame(&mut data).expect("pixels");
    (info, data.chunks_exact(2).map(|two| u16::from_be_bytes([two[0], two[1]])).collect())
}

fn encoded(info: &png::OutputInfo, counts: &[u16]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, info.width, info.height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let data: Vec<u8> = counts.iter().flat_map(|count| count.to_be_bytes()).collect();
    encoder.write_header().expect("a header").write_image_data(&data).expect("pixels");
    bytes
}

/// Plans the fillet with the counts of its empty pixels replaced, the first of them by the first of `invented`.
fn plan_with(invented: &[u16]) -> (Plan, Vec<String>) {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fixtures/fillet");
    let scratch = tempfile::tempdir().expect("a folder");
    let manifest = fs::read_to_string(fixture.join("scan.json")).expect("scan.json");
    assert!(manifest.contains("0.00005"), "the fixture's counts are of 0.05 mm");
    fs::write(scratch.path().join("scan.json"), manifest.replace("0.00005", "0.0005")).expect("a file");
    for k in 0..4 {
        let name = format!("view_{k:03}.png");
        let (info, mut counts) = decoded(&fixture.join(&name));
        counts.iter_mut().for_each(|count| *count /= COARSER);
        let empty = counts.iter_mut().filter(|count| **count == 0).step_by(ONE_IN);
        let put = empty.zip(invented.iter().cycle()).map(|(count, far)| *count = *far).count();
        assert!(invented.is_empty() || put > 5, "{put} pixels of {name}");
        fs::write(scratch.path().join(name), encoded(&info, &counts)).expect("a file");
    }
    let scan = input::read(scratch.path(), &input::Options::default()).unwrap_or_else(|e| panic!("{e}"));
    let plan = pipeline::plan(&scan.views, &Job::default().pipeline(), &mut ());
    (plan.unwrap_or_else(|e| panic!("{e}")), scan.notes)
}

#[test]
fn stray_and_saturated_pixels_change_no_seam() {
    let (clean, _) = plan_with(&[]);
    // 5, 10, 30 and 32 m, and the end of the range.
    for invented in [&[10_000, 20_000, 60_000, 65_000][..], &[65_535]] {
        let (strewn, notes) = plan_with(invented);
        let told = notes.iter().filter(|note| note.contains("from where most are")).count();
        assert_eq!(told, if invented.len() > 1 { 4 } else { 0 }, "{notes:?}");
        assert_eq!(strewn.seams.len(), clean.seams.len());
        for (a, b) in strewn.seams.iter().zip(&clean.seams) {
            assert_eq!(a.stations.len(), b.stations.len());
            let apart =
                a.stations.iter().zip(&b.stations).map(|(a, b)| (a.position_mm - b.position_mm).norm());
            let worst_mm = apart.fold(0.0, f64::max);
            assert!(worst_mm < 0.02, "{worst_mm} mm");
        }
    }
}
