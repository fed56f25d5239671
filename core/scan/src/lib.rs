//! Scans without I/O: what a scanner recorded in a cell of its grid ([`Sample`]), where a station stands ([`Pose`]), the triangles between
//! neighbouring cells ([`tessellate`]), which samples are not of the site ([`mask`]), what a photograph sees ([`camera`]), and drawing a mesh as a camera sees it ([`raster`]).
//!
//! Lengths are metres, angles radians. Coordinates of samples are those of their station (`station`); a pose takes them to those of
//! the survey (`survey_from_station`).

pub mod camera;
pub mod colour;
pub mod intensity;
pub mod kabsch;
pub mod mask;
pub mod photo_pose;
pub mod pose;
pub mod raster;
pub mod register;
pub mod sample;
pub mod tessellate;
pub mod tsdf;

pub use camera::{Camera, CameraError, CameraModel, Distortion, PosedCamera};
pub use pose::{Pose, PoseError};
pub use sample::{Grid, Kind, Rays, Sample, State};
