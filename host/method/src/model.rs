//! From the views of a camera to one model of the work (paper II-C, II-D): normals, registration, the place of all views in
//! the base frame, voxel grid, bilateral filter, and the orientation of normals where no camera is known.

pub mod agreement;
pub mod base_frame;
pub mod camera;
pub mod denoising;
pub mod downsampling;
pub mod normals;
pub mod orientation;
pub mod reconstruction;
