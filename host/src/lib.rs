//! weldpath: from scans of a workpiece to the motion of a welding torch.
//!
//! ```no_run
//! use weldpath::{Job, input};
//!
//! let scan = input::read("fixtures/cell".as_ref(), &input::Options::default())?;
//! let run = weldpath::plan(&scan, &Job::default(), &mut ())?;
//! println!("{}", run.verdict().lines().join("\n"));
//! for path in run.paths()? {
//!     for point in &path.points {
//!         println!("{:?} {:?}", point.position_mm, point.base_from_torch);
//!     }
//! }
//! run.write("out".as_ref(), false)?; // all that the command writes: programs, report, figures
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! **What is promised** is at the root of this crate: [`Scan`] and what makes one ([`input::read`], [`RawCloud`], [`PosedViews`] with its
//! [`RawView`]s), [`Job`], [`Observer`], [`plan`] and the [`Run`] that it returns, with what these name. A run that is refused hands out
//! neither path nor program. The modules are the crates that all this is made of. They are for those who study or change the method,
//! and change without notice.
//!
//! After Zhou et al., *Path Planning with Automatic Seam Extraction over Point Cloud Models for Robotic Arc Welding*.
//! [`pipeline`] is the whole method on one page. The way of the data, each arrow a function from values to values:
//!
//! ```text
//!  scan.json, PLY, STL ...     arrays in memory                          job.toml, command line
//!          |                          |                                            |
//!          | input::read              | RawCloud::read, PosedViews::read              | Job::read
//!          v                          v                                            |
//!  Scan: a View per camera pose <-----'                                            |
//!          |                                                                       |
//!          | pipeline::plan                                                        |
//!          |   model::normals, model::reconstruction   II-C, eqs. (1)-(8)          |
//!          |   model::downsampling, model::denoising   II-D, eqs. (9)-(10)         |
//!          v                                                                       |
//!  PointCloud                                                                      |
//!          |   seam::extraction::find                  II-E, eqs. (11)-(17)        |
//!          v                                                                       |
//!  Seam, one per joint                                                             |
//!          |   weld::SeamPath::along                   II-F                        |
//!          v                                                                       v
//!  SeamPath, one per seam -----------------> run::postprocessing::postprocess <----'
//!                                                  run::selection, weld::recipe, weld::program, robot::feasibility
//!                                                          |
//!                                                          v
//!                                                Waypoint, the whole program, with a verdict
//!                                                          |
//!            +--------------------+------------------------+-----+-----------------------+
//!            | output             | robot::dialect               | report                | pendant::link
//!            v                    v                              v                       v
//!   path.csv, path.json   path.script, .mod, .ls           report.html, .svg    a pendant, eqs. (18)-(19)
//! ```
//!
//! Beside it: [`geometry`] is what every stage measures with, [`files`] writes all files of a run or none, [`lab`] makes
//! scans with exact truth and says how far a plan is from it. Edge scores, interpolation, the link and the pendant's
//! state machine are [`weldpath_core`], which runs on the pendant as well.
//!
//! Millimetres, radians, seconds; robot base frame unless a name says otherwise; transforms are `to_from`.
//!
//! The command `weldpath` is the feature `cli`, its page that edits a job the feature `open`. A library user who wants few crates takes
//! `default-features = false` and of `ply`, `pcd`, `yaml`, `serial`, `gestures`, `e57`, `las` what is needed. `examples/`
//! plans a cloud in 20 lines, runs stages of one's own choice, and fills in poses between those of a path.
#![forbid(unsafe_code)]

extern crate self as weldpath;

pub use weldpath_files as files;
pub use weldpath_job::{output, robot, run};
pub use weldpath_lab as lab;
pub use weldpath_method::{geometry, input, model, pipeline, seam, weld};
pub use weldpath_pendant as pendant;
pub use weldpath_sim::{evaluation, simulation};

pub use facade::{Error, Run, Withheld, plan};
pub use weldpath_job::run::job::Job;
pub use weldpath_method::input::{
    CameraPose, Coordinates, PosedViews, RawCloud, RawView, Scan, Transform, Units,
};
pub use weldpath_method::pipeline::Observer;

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
mod facade;
pub mod report;
#[cfg(feature = "open")]
pub mod server;
