//! Merging the stations of a survey into one surface, out of core.
//!
//! Stages: the voxel, if it is not given (`spacing`) → the triangles of each station, cut into pieces, which are stored for each tile that needs them (`piles`)
//! → tile by tile the distance field and its surface ([`kilwa_scan_core::tsdf`]) → one mesh (`join`).
//!
//! The result does not depend on tiles, threads or the order of stations: sums are integers, and vertices and triangles are delivered in the order of the
//! bricks along a Morton curve; a tile is a section of that curve.

mod accuracy;
mod brightness;
mod causes;
mod cut;
mod fill;
mod holes;
mod join;
mod need;
mod patch_mesh;
mod piles;
mod rims;
mod spacing;
mod tiles;

#[cfg(test)]
mod tests;

use crate::ScanError;
use crate::import::Progress;
use crate::mesh::{self, MeshVertex};
use crate::survey::{self, Survey};
use accuracy::Sigmas;
pub use accuracy::{Accuracy, Parts, Reason, UnknownPose};
use brightness::Brightness;
pub use brightness::Light;
use cut::{Known, Station, cut_all, stations};
pub use fill::{Fill, Filled};
use glam::DVec3;
pub use holes::{Borders, Cause, Hole};
use join::Joined;
use kilwa_scan_core::tsdf::BRICK;
use patch_mesh::PatchMesh;
use piles::Piles;
use spacing::Spacings;
use std::path::{Path, PathBuf};

/// The station number of the pieces of the mesh that fills holes; greater than that of any station.
const MESH_STATION: u16 = u16::MAX;
/// The standard deviation across the surface at which a sample has the greatest weight, metres.
const BEST_SIGMA: f64 = 0.002;
/// Smallest and largest voxel, metres. Mesh files have coordinates in micrometres, and vertices can be as close together as a 64th of a voxel.
pub const VOXEL_RANGE: [f64; 2] = [1e-4, 100.0];
/// Maximum number of voxels along an axis.
const VOXELS_MAX: f64 = (1 << 22) as f64;

/// How stations are merged.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Edge of a voxel, metres; `None`: from the data.
    pub voxel: Option<f64>,
    /// Bytes of memory to use.
    pub memory: u64,
    /// Threads.
    pub threads: usize,
    /// Folder for the scratch file, which is unlinked.
    pub scratch: PathBuf,
    /// Also use masked samples.
    pub unmasked: bool,
    /// Only what lies in this box of the survey, metres.
    pub bounds: Option<[DVec3; 2]>,
    /// Which holes are filled.
    pub fill: Fill,
    /// What intensities the surface gets.
    pub intensity: Intensity,
}

/// What a vertex of the merged surface rests on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Source {
    /// Scans.
    #[default]
    Scans = 0,
    /// Scans at coarser voxels.
    Coarser = 1,
    /// Another mesh.
    Mesh = 2,
    /// Diffusion from the rim of a hole.
    Diffused = 3,
    /// Nothing: it closes what is open, to make the surface watertight.
    Closed = 4,
}

impl Source {
    /// A word for it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Scans => "scans",
            Self::Coarser => "coarser",
            Self::Mesh => "mesh",
            Self::Diffused => "diffused",
            Self::Closed => "closed",
        }
    }
}

/// What intensities the surface gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Intensity {
    /// Normalised for range, incidence and the gains of stations, if these can be estimated from the data.
    #[default]
    Normalised,
    /// Those of the files.
    Raw,
}

/// A vertex of the merged surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MergedVertex {
    /// Where it is, and its attributes: the intensity is as [`Report::light`] says, the confidence is the sum over stations.
    pub vertex: MeshVertex,
    /// How many stations saw the surface there.
    pub stations: u16,
    /// The standard deviation of a coordinate due to the poses of these stations, metres; `None` if it is unknown, or for a vertex that is not based on
    /// scans.
    pub registration: Option<f32>,
    /// What it rests on. Every triangle that was added to fill a hole has a vertex that does not rest on scans, and no other triangle has one.
    pub source: Source,
}

/// What is known before the first vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Begin {
    /// Edge of a voxel, metres.
    pub voxel: f64,
    /// A box that holds every vertex, metres.
    pub bounds: [DVec3; 2],
    /// Whether any station has colours; whether any has intensities.
    pub attributes: [bool; 2],
    /// Whether holes are filled, so that the source of vertices matters.
    pub is_filled: bool,
    /// The largest possible [`MergedVertex::registration`]; `None` if it is unknown or the same everywhere.
    pub registration: Option<f32>,
}

/// Receives the merged surface.
pub trait MergedSurface {
    /// Called once, before anything else.
    ///
    /// # Errors
    /// If the output cannot be started.
    fn begin(&mut self, begin: &Begin) -> Result<(), ScanError>;

    /// A vertex; they are counted from 0.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError>;

    /// A triangle of vertices that came before, counterclockwise seen from where the surface was scanned.
    ///
    /// # Errors
    /// Where it cannot be kept.
    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError>;
}

/// What was merged.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Report {
    /// Edge of a voxel, metres.
    pub voxel: f64,
    /// Stations.
    pub stations: usize,
    /// Triangles of the stations.
    pub station_triangles: u64,
    /// Pieces that they were cut into.
    pub pieces: u64,
    /// Bytes of the scratch file, as estimated beforehand.
    pub scratch_estimated: u64,
    /// Bytes of the scratch file.
    pub scratch_bytes: u64,
    /// Vertices of the merged surface.
    pub vertices: u64,
    /// Triangles of the merged surface.
    pub triangles: u64,
    /// What became of intensities.
    pub light: Light,
    /// Holes, and what else borders the surface.
    pub borders: Borders,
    /// What was filled, if filling was requested.
    pub filled: Option<Filled>,
    /// The accuracy of the measured surface, as far as the survey determines it.
    pub accuracy: Accuracy,
}

/// From coordinates of the survey to voxels and back.
#[derive(Debug, Clone, Copy)]
struct Scale {
    /// A multiple of the brick size, so that the grid depends on the voxel size only, not on the bounds.
    origin: DVec3,
    voxel: f64,
}

impl Scale {
    fn new(voxel: f64, [min, max]: [DVec3; 2]) -> Result<Self, ScanError> {
        // Two bricks of margin below the bounds; extraction needs one.
        let first = (min / (voxel * f64::from(BRICK))).floor() - 2.0;
        let origin = first * (voxel * f64::from(BRICK));
        let count = ((max - origin) / voxel).max_element();
        if count.is_nan() || count > VOXELS_MAX {
            return Err(ScanError::Request(format!(
                "the survey extends over {count:.0} voxels of {voxel} m along an axis, but at most {VOXELS_MAX} are allowed; use a larger --voxel, or limit the area with --box"
            )));
        }
        Ok(Self { origin, voxel })
    }

    fn to_voxels(self, survey: DVec3) -> DVec3 {
        (survey - self.origin) / self.voxel
    }

    fn to_survey(self, voxels: DVec3) -> DVec3 {
        voxels * self.voxel + self.origin
    }
}

/// Merge the stations of the survey in `folder`.
///
/// # Errors
/// [`ScanError::Request`] for stations without pose or grid, or where nothing is left; [`ScanError::Spool`] and [`ScanError::Mask`] for damaged ones; what the sink
/// returns.
pub fn merge(
    folder: &Path,
    survey: &Survey,
    options: &Options,
    options_of: &dyn Fn(&survey::Station) -> mesh::Options,
    sink: &mut dyn MergedSurface,
    progress: &(dyn Progress + Sync),
) -> Result<Report, ScanError> {
    let stations = stations(folder, survey, options, options_of)?;
    let has_sigmas = stations.iter().all(Station::has_sigma);
    let tile_log2 = tiles::size_log2(options.memory, options.threads, has_sigmas);
    // A tile needs the pieces in a wide margin, so small ones would be mostly margin.
    let tile_log2 = if options.fill.is_backed() { tile_log2.max(3) } else { tile_log2 };
    merge_in_tiles(tile_log2, &stations, options, sink, progress)
}

/// Merge in tiles of `1 << tile_log2` bricks along each axis.
fn merge_in_tiles(
    tile_log2: u32,
    stations: &[Station<'_>],
    options: &Options,
    sink: &mut dyn MergedSurface,
    progress: &(dyn Progress + Sync),
) -> Result<Report, ScanError> {
    let mut known = Known::of(stations)?;
    let read = |path| PatchMesh::read(path, known.bounds, progress);
    let patch_mesh = options.fill.mesh.as_deref().map(read).transpose()?;
    let survey = known.bounds;
    if let Some(mesh) = &patch_mesh {
        known.bounds = [known.bounds[0].min(mesh.bounds[0]), known.bounds[1].max(mesh.bounds[1])];
    }
    let (bounds, voxel) = extent(stations, options, known.bounds, survey, progress)?;
    let scale = Scale::new(voxel, bounds)?;
    let mut report = Report { voxel, stations: stations.len(), ..Report::default() };
    let of_mesh = patch_mesh.as_ref().map_or(0.0, |mesh| mesh.expected_pieces(scale, bounds));
    report.scratch_estimated = need::scratch_bytes(stations, of_mesh, options, scale, tile_log2)?;
    need::check(report.scratch_estimated, options)?;
    let piles = Piles::create(&options.scratch)?;
    let brightness = Brightness::of(stations, known.has_intensity, options.intensity, progress)?;
    report.light = brightness.light;
    let parts = cut_all(stations, options, (&known, &brightness), scale, &piles, tile_log2, progress)?;
    report.station_triangles = parts.iter().map(|part| part.triangles).sum();
    report.pieces = parts.iter().map(|part| part.pieces).sum();
    let sigmas = Sigmas::of(stations, &parts, scale).map_err(|accuracy| report.accuracy = accuracy).ok();
    if let Some(mesh) = &patch_mesh {
        mesh.cut(options, bounds, scale, &piles, tile_log2, progress)?;
    }
    drop(patch_mesh);
    report.scratch_bytes = piles.bytes();
    let room = DVec3::splat(4.0 * voxel);
    let bounds = [bounds[0] - room, bounds[1] + room];
    let is_filled = options.fill.is_any();
    let registration = sigmas.as_ref().and_then(Sigmas::largest);
    sink.begin(&Begin { voxel, bounds, attributes: [known.has_color, known.has_intensity], is_filled, registration })?;
    let mut joined = Joined::new(sink, scale);
    let of = tiles::TileInputs { piles: &piles, sigmas: sigmas.as_ref(), tile_log2 };
    tiles::surfaces(&of, options, progress, &mut |brick, patch| joined.patch(brick, &patch))?;
    [report.vertices, report.triangles] = joined.counts();
    if let Some(parts) = joined.accuracy().parts() {
        report.accuracy = Accuracy::Known(parts);
    }
    if report.triangles == 0 {
        return Err(ScanError::Request(match report.pieces {
            0 => "nothing is left to merge: the box holds no surface, or masks cover all samples (--unmasked uses them), or limits on edges drop all triangles".to_owned(),
            _ => format!(
                "no surface is left at a voxel of {voxel} m: the surface of the stations ({} triangles) is only a few voxels wide or less; use a smaller --voxel",
                report.station_triangles
            ),
        }));
    }
    let tell = |stage: &'static str| {
        move |done, total| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            progress.update(stage, done, total);
            Ok(())
        }
    };
    let rims = joined.rims().loops();
    report.borders = holes::borders(&rims, stations, 2.0 * voxel, &mut tell("analysing holes"))?;
    if is_filled {
        let mut filler = fill::Filler { fill: &options.fill, voxel, bounds, stations, joined: &mut joined };
        report.filled = Some(filler.run(&rims, &mut report.borders, &mut tell("filling holes"))?);
        [report.vertices, report.triangles] = joined.counts();
    }
    Ok(report)
}

/// The box that is merged and the voxel size, metres. `bounds`: of all inputs; `survey`: of the stations.
fn extent(
    stations: &[Station<'_>],
    options: &Options,
    bounds: [DVec3; 2],
    survey: [DVec3; 2],
    progress: &dyn Progress,
) -> Result<([DVec3; 2], f64), ScanError> {
    let bounds = match options.bounds {
        Some([min, max]) => [bounds[0].max(min), bounds[1].min(max)],
        None => bounds,
    };
    if bounds[0].cmpgt(bounds[1]).any() {
        let [low, high] = survey.map(|p| p.to_array());
        return Err(ScanError::Request(format!(
            "no station has points in the box; the survey extends from {low:?} to {high:?} m"
        )));
    }
    let voxel = match options.voxel {
        Some(voxel) => voxel,
        None => voxel_of(stations, options.bounds, progress)?.max(VOXEL_RANGE[0]),
    };
    if !(VOXEL_RANGE[0]..=VOXEL_RANGE[1]).contains(&voxel) {
        return Err(ScanError::Request(format!(
            "a voxel size of {voxel:e} m is not allowed; give a size from {} to {} m",
            VOXEL_RANGE[0], VOXEL_RANGE[1]
        )));
    }
    Ok((bounds, voxel))
}

/// The voxel that the data support.
fn voxel_of(stations: &[Station<'_>], bounds: Option<[DVec3; 2]>, progress: &dyn Progress) -> Result<f64, ScanError> {
    let mut spacings = Spacings::default();
    for (number, station) in stations.iter().enumerate() {
        spacings.add(station, bounds, &mut |done, total| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            progress.update("measuring point spacing", share(number, done, total), PARTS * stations.len() as u64);
            Ok(())
        })?;
    }
    spacings.voxel().ok_or_else(|| {
        ScanError::Request(
            "the voxel size cannot be derived, because no station has unmasked neighbouring points (in the box); turn masks off, use --unmasked, or give --voxel"
                .to_owned(),
        )
    })
}

/// Progress units per station.
const PARTS: u64 = 1000;

fn share(number: usize, done: u64, total: u64) -> u64 {
    number as u64 * PARTS + (done as f64 / total.max(1) as f64 * PARTS as f64) as u64
}
