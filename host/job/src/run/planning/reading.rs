//! Reads the scan of a job, and tells of the files alone whether it has to be read again.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::run::job::Job;
use crate::run::kept::{self, Digest, Key, content};
use weldpath_method::input::memory::Limit;
use weldpath_method::input::{self, CloudFrame, Scan};

/// What a reading may do, which no job says: a job may come from somebody else.
#[derive(Debug, Clone, Copy, Default)]
pub struct Allowed {
    /// Whether a `scan.json` may name files outside its folder.
    pub outside: bool,
    /// The most memory that reading and planning may take.
    pub memory: Limit,
}

impl Allowed {
    /// As it was asked for; without a number the usual limit holds.
    pub fn new(outside: bool, memory_mb: Option<u64>) -> Self {
        Self { outside, memory: memory_mb.map_or_else(Limit::default, Limit::of_mb) }
    }
}

/// Reads the input that the job names, and what was there before.
///
/// # Errors
/// If there is no input, one of them cannot be read, or both are not in one frame.
pub fn read(job: &Job, allowed: Allowed) -> Result<Scan, input::Error> {
    over_background(input::read(work(job), &options(job, allowed))?, job, allowed)
}

/// A scan over what the job says was there before.
///
/// # Errors
/// If that cannot be read, or both are not in one frame.
pub fn over_background(scan: Scan, job: &Job, allowed: Allowed) -> Result<Scan, input::Error> {
    let Some(background) = &job.exclude.background else { return Ok(scan) };
    // What is said of the work's cloud is not said of another.
    let options = input::Options { camera_mm: None, frame: None, mesh_as: None, ..options(job, allowed) };
    scan.over(input::read(background, &options)?)
}

fn work(job: &Job) -> &Path {
    job.input.as_deref().unwrap_or(Path::new("."))
}

/// How the job says that its input is read.
pub fn options(job: &Job, allowed: Allowed) -> input::Options {
    input::Options {
        units: job.units,
        intrinsics: job.intrinsics,
        depth_scale_m: job.depth_scale_m.map(|scale| scale.get()),
        camera_mm: job.camera_mm,
        frame: job.frame,
        mesh_as: job.mesh_as,
        allow_outside: allowed.outside,
        memory: allowed.memory,
    }
}

/// The key of what the job names and how it says that it is read.
pub(super) fn key(job: &Job, allowed: Allowed) -> Key {
    let mut digest = Digest::default();
    digest.shown(&kept::program());
    // What fits into memory is the same however much there is.
    let allowed = Allowed { memory: Limit::of_mb(0), ..allowed };
    digest.shown(&(work(job), &job.exclude.background, options(job, allowed)));
    digest.end()
}

/// What a reading told.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Reading {
    /// Files that were read, wherever they lie.
    inputs: Vec<PathBuf>,
    /// What was read, if the files were the same before and after it.
    settled: Option<Settled>,
}

/// What was read from files that had this key.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Settled {
    files: Key,
    frame: CloudFrame,
    content: Key,
}

/// The files on which a reading of the job's input hangs, as they are now: all that it may look at, and those that it read
/// the last time, which may lie elsewhere. None if one of them could not be read twice.
pub(super) fn files_now(job: &Job, earlier: Option<&Reading>) -> Option<Key> {
    files(job, earlier.map_or(&[], |reading| &reading.inputs))
}

fn files(job: &Job, inputs: &[PathBuf]) -> Option<Key> {
    let named = [Some(work(job)), job.exclude.background.as_deref()];
    let mut all: Vec<PathBuf> = named.into_iter().flatten().flat_map(input::looked_at).collect();
    all.extend_from_slice(inputs);
    all.sort();
    all.dedup();
    content::of_files(&all)
}

impl Reading {
    /// Of a scan with the key `content`; `before` are its files as they were before it was read.
    ///
    /// What is written while it is read may be read old or new. And where a file lies elsewhere, which shows only when the scan is
    /// read, nothing is known of it before: then the next reading tells.
    pub(super) fn new(job: &Job, scan: &Scan, content: Key, before: Option<Key>) -> Self {
        let files = before.filter(|_| files(job, &scan.inputs) == before);
        let settled = files.map(|files| Settled { files, frame: scan.frame, content });
        Self { inputs: scan.inputs.clone(), settled }
    }

    /// Frame and key of the scan, if it would be read the same from these files.
    pub(super) fn from(&self, files: Option<Key>) -> Option<(CloudFrame, Key)> {
        let Settled { frame, content, .. } = self.settled.filter(|settled| Some(settled.files) == files)?;
        Some((frame, content))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const OUTSIDE: Allowed = Allowed { outside: true, memory: Limit::of_mb(1 << 20) };

    /// A scan of one point, its hand-eye transform in a file of its own, and whatever lies beside them.
    fn scan(home: &Path, outside: &str) -> Job {
        let folder = home.join("scan");
        fs::create_dir_all(&folder).unwrap();
        let json = format!(
            r#"{{"units": "m", "flange_from_camera": "eye.yaml",
                 "views": [{{"cloud": "{outside}", "base_from_flange": [0, 0, 1, 0, 0, 0]}}]}}"#
        );
        fs::write(folder.join("scan.json"), json).unwrap();
        let eye = "transformation: {qw: 1, qx: 0, qy: 0, qz: 0, x: 0.01, y: 0, z: 0}\n";
        fs::write(folder.join("eye.yaml"), eye).unwrap();
        fs::write(folder.join(outside), "0.1 0.2 0.5\n").unwrap();
        fs::write(folder.join("notes.txt"), "mine\n").unwrap();
        Job { input: Some(folder), ..Job::default() }
    }

    fn taken(job: &Job, earlier: Option<&Reading>) -> Reading {
        let before = files_now(job, earlier);
        let scan = read(job, OUTSIDE).unwrap();
        Reading::new(job, &scan, content::of_scan(&scan), before)
    }

    #[test]
    fn whatever_a_reading_hangs_on_is_asked_before_it_is_taken_again() {
        let home = tempfile::tempdir().unwrap();
        let job = scan(home.path(), "a.xyz");
        let reading = taken(&job, None);
        assert!(reading.from(files_now(&job, Some(&reading))).is_some());
        let folder = home.path().join("scan");
        for name in ["scan.json", "eye.yaml", "a.xyz", "camera_intrinsic.json"] {
            let path = folder.join(name);
            let old = fs::read(&path).ok();
            fs::write(&path, [old.clone().unwrap_or_default(), b"\n".to_vec()].concat()).unwrap();
            assert_eq!(reading.from(files_now(&job, Some(&reading))), None, "{name}");
            match old {
                Some(old) => fs::write(&path, old).unwrap(),
                None => fs::remove_file(&path).unwrap(),
            }
            assert!(reading.from(files_now(&job, Some(&reading))).is_some(), "{name} is as it was");
        }
    }

    #[test]
    fn a_file_that_lies_elsewhere_counts_from_the_second_reading_on() {
        let home = tempfile::tempdir().unwrap();
        let job = scan(home.path(), "../far.xyz");
        let first = taken(&job, None);
        assert_eq!(
            first.from(files_now(&job, Some(&first))),
            None,
            "nothing was known of it before it was read"
        );
        let second = taken(&job, Some(&first));
        assert!(second.from(files_now(&job, Some(&second))).is_some());
        fs::write(home.path().join("far.xyz"), "0.1 0.2 0.6\n").unwrap();
        assert_eq!(second.from(files_now(&job, Some(&second))), None);
    }

    #[test]
    fn what_is_written_while_a_scan_is_read_is_not_taken_for_what_was_read() {
        let home = tempfile::tempdir().unwrap();
        let job = scan(home.path(), "a.xyz");
        let before = files_now(&job, None);
        let scan = read(&job, OUTSIDE).unwrap();
        fs::write(home.path().join("scan/a.xyz"), "0.1 0.2 0.6\n").unwrap();
        let reading = Reading::new(&job, &scan, content::of_scan(&scan), before);
        assert_eq!(reading.from(files_now(&job, Some(&reading))), None);
        assert_eq!(reading.from(before), None);
    }

    #[test]
    fn how_a_scan_is_read_is_in_the_key() {
        let plain = key(&Job::default(), Allowed::default());
        assert_ne!(plain, key(&Job::default(), OUTSIDE));
        let text = |text: &str| key(&Job::parse(text, Path::new("job.toml")).unwrap(), Allowed::default());
        assert_eq!(plain, text("[path]\nfeed_mm_s = 3"));
        for other in ["units = \"mm\"", "frame = \"base\"", "input = \"a\"", "camera_mm = [1, 2, 3]"] {
            assert_ne!(plain, text(other), "{other}");
        }
    }
}
