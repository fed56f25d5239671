//! The triangles of stations, cut into pieces. Stations are shared among threads; pieces of a station stay together.

use super::accuracy::{PoseSigma, StationSigma};
use super::brightness::Brightness;
use super::piles::{Gathered, Piles};
use super::{BEST_SIGMA, Options, PARTS, Scale};
use crate::ScanError;
use crate::import::Progress;
use crate::mask;
use crate::mesh::{self, MeshVertex, Surface, mesh};
use crate::register::Registration;
use crate::spool::Reader;
use crate::survey::{self, Survey};
use glam::DVec3;
use kilwa_scan_core::tsdf::{Corner, INTENSITY_MAX, pieces};
use kilwa_scan_core::{Pose, Rays};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Number of pieces between two checks whether to stop.
const ASK_EVERY: u64 = 1 << 18;
/// Vertices of a station that are kept at a time.
const WINDOW: usize = 1 << 17;

/// A station that is merged.
pub(super) struct Station<'a> {
    folder: &'a Path,
    entry: &'a survey::Station,
    unmasked: bool,
    pub(super) pose: Pose,
    /// The uncertainty of the pose, if known.
    pub(super) pose_sigma: PoseSigma,
    pub(super) rays: Rays,
    pub(super) options: mesh::Options,
}

impl Station<'_> {
    pub(super) fn open(&self) -> Result<Reader, ScanError> {
        mask::open(self.folder, self.entry, self.unmasked)
    }

    /// All samples, including masked ones, because these blocked its rays, too.
    pub(super) fn open_unmasked(&self) -> Result<Reader, ScanError> {
        mask::open(self.folder, self.entry, true)
    }

    pub(super) fn name(&self) -> &str {
        &self.entry.name
    }

    /// Maker, model and serial number of its scanner, as far as known.
    pub(super) fn instrument(&self) -> Option<&str> {
        self.entry.instrument.as_deref()
    }

    /// Whether the uncertainty of its pose is known.
    pub(super) fn has_sigma(&self) -> bool {
        matches!(self.pose_sigma, PoseSigma::Known(_))
    }

    /// Standard deviations of its pose: metres, radians.
    pub(super) fn sigma(&self) -> [f64; 2] {
        self.entry.sigma.unwrap_or_default()
    }
}

/// The stations of a survey, if they can be merged.
pub(super) fn stations<'a>(
    folder: &'a Path,
    survey: &'a Survey,
    options: &Options,
    options_of: &dyn Fn(&survey::Station) -> mesh::Options,
) -> Result<Vec<Station<'a>>, ScanError> {
    let all = &survey.stations;
    if all.is_empty() {
        let message = format!("the survey {} has no stations; use `kilwa scans import`", folder.display());
        return Err(ScanError::Request(message));
    }
    if all.len() >= usize::from(u16::MAX) {
        let message = format!("the survey has {} stations; at most {} can be merged", all.len(), u16::MAX - 1);
        return Err(ScanError::Request(message));
    }
    let registration = Registration::open(folder)?;
    let mut out = Vec::with_capacity(all.len());
    for entry in all {
        let name = &entry.name;
        // A single station needs no pose.
        let Some(pose) = entry.pose.or((all.len() == 1).then_some(Pose::IDENTITY)) else {
            return Err(ScanError::Request(format!(
                "station {name} has no pose, so its position relative to the others is unknown; add rotation and translation to it in survey.toml"
            )));
        };
        let unmasked = options.unmasked;
        let reader = mask::open(folder, entry, unmasked)?;
        if !reader.header().is_grid {
            return Err(ScanError::Request(format!(
                "station {name} is an unstructured point cloud and has no surface to merge; build its points with `kilwa build --points`, or remove the station from survey.toml"
            )));
        }
        let (pose_sigma, rays) = (PoseSigma::of(entry, registration.as_ref()), reader.header().rays);
        out.push(Station { folder, entry, unmasked, pose, pose_sigma, rays, options: options_of(entry) });
    }
    Ok(out)
}

/// The statistics of all stations combined.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// A box that holds all points, metres.
    pub(super) bounds: [DVec3; 2],
    pub(super) has_color: bool,
    pub(super) has_intensity: bool,
}

impl Known {
    pub(super) fn of(stations: &[Station<'_>]) -> Result<Self, ScanError> {
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        let (mut has_color, mut has_intensity) = (false, false);
        for station in stations {
            let statistics = station.open()?.header().statistics;
            if statistics.measured == 0 {
                continue;
            }
            let [min, max] = statistics.bounds.map(glam::Vec3::as_dvec3);
            for k in 0..8 {
                let pick = |axis: usize| if k >> axis & 1 == 0 { min[axis] } else { max[axis] };
                let p = station.pose.apply(DVec3::new(pick(0), pick(1), pick(2)));
                bounds = [bounds[0].min(p), bounds[1].max(p)];
            }
            has_color |= statistics.colored > 0;
            has_intensity |= statistics.with_intensity > 0;
        }
        if bounds[0].cmpgt(bounds[1]).any() {
            return Err(ScanError::Request(
                "no station has measured points; check them with `kilwa scans list`, and import the scans again"
                    .to_owned(),
            ));
        }
        Ok(Self { bounds, has_color, has_intensity })
    }
}

/// What a station contributes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Part {
    pub(super) triangles: u64,
    /// Pieces that they were cut into.
    pub(super) pieces: u64,
    /// The smallest and the largest variance of a piece due to the pose, square metres, if known.
    pub(super) variances: Option<[f64; 2]>,
}

/// Cut all stations; returns what each contributes.
pub(super) fn cut_all(
    stations: &[Station<'_>],
    options: &Options,
    (known, brightness): (&Known, &Brightness),
    scale: Scale,
    piles: &Piles,
    tile_log2: u32,
    progress: &(dyn Progress + Sync),
) -> Result<Vec<Part>, ScanError> {
    let (next, done) = (AtomicUsize::new(0), AtomicU64::new(0));
    let (parts, failure) = (Mutex::new(vec![Part::default(); stations.len()]), Mutex::new(None));
    let threads = options.threads.clamp(1, stations.len());
    let most = usize::try_from(options.memory / 2).unwrap_or(usize::MAX) / threads;
    let total = PARTS * stations.len() as u64;
    let work = || -> Result<(), ScanError> {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            let Some(station) = stations.get(number) else { return Ok(()) };
            let gathered =
                Gathered::new(piles, number as u16 + 1, [tile_log2, options.fill.margin().cast_unsigned()], most);
            let mut before = 0;
            let mut tell = |part: u64, of: u64| {
                if progress.is_stopped() || failure.lock().is_ok_and(|f| f.is_some()) {
                    return Err(ScanError::Stopped);
                }
                let now = (part as f64 / of.max(1) as f64 * PARTS as f64) as u64;
                let sum = done.fetch_add(now - before, Ordering::Relaxed) + now - before;
                before = now;
                progress.update("reading stations", sum, total);
                Ok(())
            };
            let to_voxels = |bounds: [DVec3; 2]| bounds.map(|corner| scale.to_voxels(corner));
            // Poses are rounded differently in bounds and in points.
            let [low, high] = to_voxels(known.bounds);
            let boxes = [[low - 1.0, high + 1.0], options.bounds.map_or([low - 1.0, high + 1.0], to_voxels)];
            let part = cut((station, number), brightness, scale, boxes, gathered, &mut tell)?;
            parts.lock().unwrap_or_else(PoisonError::into_inner)[number] = part;
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                if let Err(e) = work() {
                    // The first is the reason; others stop because of it.
                    failure.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
                }
            });
        }
    });
    match failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(e) => Err(e),
        None => Ok(parts.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

type Tell<'t> = &'t mut dyn FnMut(u64, u64) -> Result<(), ScanError>;

fn cut(
    (station, number): (&Station<'_>, usize),
    brightness: &Brightness,
    scale: Scale,
    [known, bounds]: [[DVec3; 2]; 2],
    gathered: Gathered<'_>,
    tell: Tell<'_>,
) -> Result<Part, ScanError> {
    let path = station.folder.join(&station.entry.scan);
    let is_central = station.rays == Rays::Central;
    let origin = station.pose.translation;
    let light = move |vertex: &MeshVertex| {
        if is_central { brightness.factor(number, vertex.position - origin, vertex.normal) } else { 1.0 }
    };
    let light = &light;
    let mut cutter = Cutter {
        path,
        scale,
        known,
        bounds,
        light,
        part: 0,
        window: Vec::new(),
        gathered,
        sigma: StationSigma::new(station, scale),
        variances: None,
        tell,
        pieces: 0,
        done: (0, 1),
    };
    let report = mesh(&mut station.open()?, station.pose, &station.options, &mut cutter)?;
    cutter.gathered.flush()?;
    (cutter.tell)(1, 1)?;
    Ok(Part { triangles: report.triangles, pieces: cutter.gathered.count, variances: cutter.variances })
}

/// Cuts the triangles of a station.
struct Cutter<'a> {
    path: PathBuf,
    scale: Scale,
    /// The box that the headers of all stations state, voxels.
    known: [DVec3; 2],
    /// Only pieces in this box are kept, voxels.
    bounds: [DVec3; 2],
    /// What to multiply the intensity of a vertex with.
    light: &'a dyn Fn(&MeshVertex) -> f64,
    /// Each part has a window of vertices of its own.
    part: u32,
    window: Vec<Corner>,
    gathered: Gathered<'a>,
    sigma: Option<StationSigma<'a>>,
    /// See [`Part::variances`].
    variances: Option<[f64; 2]>,
    tell: Tell<'a>,
    /// Pieces so far, and how many of how many lines of the grid are done.
    pieces: u64,
    done: (u64, u64),
}

impl Surface for Cutter<'_> {
    fn part(&mut self) -> Result<u32, ScanError> {
        if self.window.len() >= WINDOW {
            self.window.clear();
            self.part += 1;
        }
        Ok(self.part)
    }

    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        let position = self.scale.to_voxels(vertex.position);
        let [low, high] = self.known;
        if position.cmplt(low).any() || position.cmpgt(high).any() {
            return Err(ScanError::Spool {
                file: self.path.clone(),
                what: format!("a point at {:?} m is outside the bounds in its header", vertex.position.to_array()),
            });
        }
        // A value that is not finite, or is larger than any scanner produces, is not a measurement.
        let intensity = Some(vertex.intensity).filter(|v| v.abs() <= INTENSITY_MAX);
        let normalised = |v| (f64::from(v) * (self.light)(vertex)) as f32;
        let intensity = intensity.map(|v| normalised(v).clamp(-INTENSITY_MAX, INTENSITY_MAX));
        self.window.push(Corner {
            position,
            color: vertex.color,
            intensity,
            quality: f64::from(vertex.confidence) * self.scale.voxel * self.scale.voxel,
        });
        Ok(self.window.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        let corners = corners.map(|k| self.window[k as usize]);
        let best = (self.scale.voxel / BEST_SIGMA).powi(2);
        let [a, b, c] = corners.map(|corner| corner.position);
        let [low, high] = self.bounds;
        if a.max(b).max(c).cmplt(low).any() || a.min(b).min(c).cmpgt(high).any() {
            return Ok(());
        }
        let mut failure = None;
        pieces(&corners, best, self.bounds, &mut |piece| {
            // A large triangle can have very many.
            self.pieces += 1;
            if self.pieces.is_multiple_of(ASK_EVERY) && failure.is_none() {
                failure = (self.tell)(self.done.0, self.done.1).err();
            }
            let at = piece.position();
            if failure.is_none() && at.cmpge(low).all() && at.cmple(high).all() {
                failure = self.gathered.add(&piece).err();
                if let Some(sigma) = &self.sigma {
                    let variance = sigma.at(&piece).pose();
                    let [least, greatest] = self.variances.unwrap_or([variance; 2]);
                    self.variances = Some([least.min(variance), greatest.max(variance)]);
                }
            }
        });
        failure.map_or(Ok(()), Err)
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), ScanError> {
        self.done = (done, total);
        (self.tell)(done, total)
    }
}
