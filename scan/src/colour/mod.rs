//! Colouring a model from photographs.
//!
//! Stages: [`vertices`] of the finest surface into a scratch file → for each photograph its depth maps ([`view`], drawn from the pack by [`model`]), its pixels
//! ([`picture`]), and what it shows of every vertex ([`observe`]), into a second scratch file → the tones of all photographs
//! (`kilwa_scan_core::colour::tone`) → chunk by chunk one colour for each vertex ([`paint`], `kilwa_scan_core::colour::blend`); vertices that no photograph sees
//! keep the colour of the model, matched in tone to the photographs ([`unseen`]).
//!
//! A vertex on the border of chunks is in several of them. It gets the same colour in all, because that depends only on its position and normal. Results do not
//! depend on threads. Memory: a photograph with its depth maps per thread, decoded chunks up to a share of `Options::memory`, and an index of some bytes for each
//! photograph and chunk that it sees.

pub mod align;
mod model;
mod observe;
mod paint;
mod picture;
mod subdivide;
#[cfg(test)]
mod tests;
mod unseen;
mod vertices;
mod view;

pub use model::{Model, Part};
use paint::Painter;
pub use paint::{Colouring, PHOTOS};
pub use picture::{Photograph, Shown};
pub use view::{Sighting, View};

use crate::ScanError;
use crate::import::Progress;
use kilwa_pack::plural::counted;
use kilwa_pack::{Reader, Source};
use kilwa_scan_core::colour::tone::{MAX_PHOTOS, ToneSample, Tones};
use kilwa_scan_core::photo_pose::{self, Grey, Quality};
use kilwa_scan_core::{Camera, PosedCamera};
use observe::{Observations, Observer, PhotoObservations, Subsample};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use vertices::{Vertices, mixed};

/// Approximate number of vertices from which tones are estimated.
const TONE_VERTICES: u64 = 150_000;
/// Focal lengths that differ by less than this share belong to the same lens.
const SAME_LENS: f64 = 0.03;
/// Bytes in memory for each pixel of a photograph, and for its depth maps.
const PIXEL_BYTES: u64 = 12;
const VIEW_BYTES: u64 = 40 << 20;
/// The share of places that may become white, and the linear light of the brightest of the others.
const WHITE: f64 = 0.005;
const BRIGHTEST: f32 = 0.95;

/// What else helps if the disk is full.
fn remedy(are_triangles_split: bool) -> &'static str {
    if are_triangles_split { ", or give a larger number of pixels for --texture-detail" } else { "" }
}

/// How to colour.
#[derive(Debug, Clone)]
pub struct Options {
    /// Bytes of memory, about.
    pub memory: u64,
    /// Worker threads.
    pub threads: usize,
    /// The folder of scratch files.
    pub scratch: PathBuf,
    /// Refine the pose of every photograph against the model, and leave out photographs that do not fit it.
    pub refine: bool,
    /// A folder for pictures of photographs that do not fit, with the edges of the model drawn over them.
    pub overlays: Option<PathBuf>,
    /// Split triangles until no edge spans more than this many pixels of any photograph that sees a corner of its triangle.
    pub texture_detail: Option<f64>,
}

/// A photograph to colour from.
#[derive(Debug, Clone)]
pub struct Input {
    /// Its name, for messages.
    pub name: String,
    /// The picture.
    pub path: PathBuf,
    /// A PNG picture that is black, or transparent, where the photograph is not to be used.
    pub mask: Option<PathBuf>,
    /// The camera, in the coordinates of the model.
    pub camera: PosedCamera,
    /// Exposure in stops, relative to the other photographs: log2(t · ISO / N²), if known.
    pub exposure: Option<f64>,
}

/// Why a photograph was not used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// The reason.
    pub why: String,
    /// The picture that shows it, with the edges of the model, if one was written.
    pub overlay: Option<PathBuf>,
}

impl From<String> for LeftOut {
    fn from(why: String) -> Self {
        Self { why, overlay: None }
    }
}

/// How a photograph was used.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoReport {
    /// Its name.
    pub name: String,
    /// Why it was not used.
    pub left_out: Option<LeftOut>,
    /// Its camera and pose, refined if that was asked for.
    pub camera: PosedCamera,
    /// How its pose was refined.
    pub refined: Option<Refinement>,
    /// Vertices that it sees.
    pub seen: u64,
    /// The sum of its shares in the colours of vertices: 1 for each vertex that it alone colours.
    pub share: f64,
    /// Vertices for which it was dropped, because it shows something else than the others.
    pub dropped: u64,
    /// Its gain in red, green and blue, relative to the mean of all photographs.
    pub gain: [f64; 3],
    /// Its offset, in linear light.
    pub offset: [f64; 3],
    /// The brightness of its lens in the corners, relative to the centre.
    pub corner: f64,
}

/// How a pose was refined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refinement {
    /// By how much what the photograph shows was shifted, pixels (root mean square).
    pub moved_px: f64,
    /// Distances between the photograph and the model that remain, pixels (root mean square over the patches that agree).
    pub residual_px: f64,
    /// The share of the patches that agree with the pose.
    pub agreement: f64,
}

/// How triangles were split.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Split {
    /// Triangles before.
    pub before: u64,
    /// Triangles after.
    pub after: u64,
    /// How often the edge that was split most was halved.
    pub halvings: u8,
}

/// What was done.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Report {
    /// The photographs, in the order of the inputs.
    pub photos: Vec<PhotoReport>,
    /// Vertices; those on the borders of chunks count several times, here and below.
    pub vertices: u64,
    /// Vertices that at least one photograph sees.
    pub coloured: u64,
    /// How the triangles of the surface were split, if that was asked for.
    pub split: Option<Split>,
    /// Places at which photographs were compared to find their tones.
    pub places: usize,
    /// The factor by which light was multiplied so that highlights fit into the range of colours.
    pub brightness: f64,
    /// Bytes of scratch files.
    pub scratch: u64,
}

/// Colour a model.
///
/// # Errors
/// [`ScanError::Request`] if no photograph can be used or none sees the model; [`ScanError::Model`]; [`ScanError::Scratch`]; [`ScanError::Stopped`].
pub fn colour<S: Source + Sync>(
    reader: &Reader<S>,
    inputs: &[Input],
    options: &Options,
    progress: &(dyn Progress + Sync),
) -> Result<(Colouring, Report), ScanError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build();
    let pool = pool.map_err(|e| ScanError::Request(format!("cannot start {} threads: {e}", options.threads)))?;
    pool.install(|| coloured(reader, inputs, options, progress))
}

fn coloured<S: Source + Sync>(
    reader: &Reader<S>,
    inputs: &[Input],
    options: &Options,
    progress: &(dyn Progress + Sync),
) -> Result<(Colouring, Report), ScanError> {
    let model = Model::new(reader, options.memory / 2);
    let placing = Placing { model: &model, options };
    let noted =
        options.texture_detail.map(|pixels| subdivide::note_all(&placing, inputs, pixels, progress)).transpose()?;
    let (subdivision, placed) = noted.unzip();
    let mut vertices = Vertices::read(reader, subdivision, &options.scratch, progress)?;
    let observations = Observations::create(&options.scratch, remedy(options.texture_detail.is_some()))?;
    let share = Subsample((vertices.originals() / TONE_VERTICES).max(1));
    let work = Observing { placing, placed, vertices: &vertices, observations: &observations, share };
    let found = work.all(inputs, progress)?;
    drop(model);
    let split = vertices.subdivision.as_ref().map(|subdivision| {
        let [before, after] = vertices.triangles;
        Split { before, after, halvings: subdivision.deepest() }
    });
    let mut report = Report { vertices: vertices.count(), split, scratch: observations.bytes(), ..Report::default() };
    let (mut runs, mut samples) = (Vec::new(), BTreeMap::<[u32; 2], Vec<ToneSample>>::new());
    for (input, result) in inputs.iter().zip(found) {
        let (found, left_out) = match result {
            Ok(found) => (found, None),
            Err(why) => (PhotoObservations::default(), Some(why)),
        };
        report.photos.push(PhotoReport::new(input, &found, left_out));
        runs.extend(found.runs);
        for (vertex, sample) in found.samples {
            keep(samples.entry(vertex).or_default(), vertex, sample);
        }
    }
    refuse_if_none(&report.photos)?;
    runs.sort_unstable();
    let places: Vec<Vec<ToneSample>> = samples.into_values().collect();
    progress.update("matching the photographs", 0, 1);
    let lenses = lenses(inputs);
    let tones = Tones::solve(&lenses, &expected_gains(inputs), &places);
    report.places = tones.places;
    let brightness = brightness(&tones, &places);
    report.brightness = brightness.into();
    for ((number, photo), lens) in (0u32..).zip(&mut report.photos).zip(&lenses) {
        (photo.gain, photo.offset) = (tones.gain(number), tones.offset(number));
        photo.corner = tones.vignette(*lens, 1.0);
    }
    let work = Painter { reader, vertices: &vertices, observations: &observations, tones: &tones, brightness };
    let mut colouring = work.paint(&runs, &options.scratch, &mut report, progress)?;
    colouring.subdivision = vertices.subdivision.take();
    Ok((colouring, report))
}

/// Keep a sample, unless the place has enough; which ones are kept is random, but the same in every run.
fn keep(samples: &mut Vec<ToneSample>, vertex: [u32; 2], sample: ToneSample) {
    let [group, number] = vertex.map(u64::from);
    let rank = |sample: &ToneSample| mixed(u64::from(sample.photo) ^ group.rotate_left(40) ^ number.rotate_left(20));
    samples.push(sample);
    if samples.len() > MAX_PHOTOS
        && let Some(last) = (0..samples.len()).max_by_key(|k| rank(&samples[*k]))
    {
        samples.remove(last);
    }
}

impl PhotoReport {
    fn new(input: &Input, found: &PhotoObservations, left_out: Option<LeftOut>) -> Self {
        Self {
            name: input.name.clone(),
            left_out,
            camera: found.refined.map_or(input.camera, |(camera, _)| camera),
            refined: found.refined.map(|(_, refined)| refined),
            seen: found.seen,
            share: 0.0,
            dropped: 0,
            gain: [1.0; 3],
            offset: [0.0; 3],
            corner: 1.0,
        }
    }
}

/// What is needed to find out where photographs were taken.
#[derive(Clone, Copy)]
struct Placing<'a, S> {
    model: &'a Model<'a, S>,
    options: &'a Options,
}

/// A photograph's camera and pose, and how it was refined if that was asked for.
#[derive(Clone, Copy)]
struct Placed {
    camera: PosedCamera,
    refined: Option<Refinement>,
}

impl<S: Source + Sync> Placing<'_, S> {
    /// Process photographs, as many at once as memory allows. Photographs that need more memory than there is are left out.
    fn each<T: Send>(
        &self,
        inputs: &[(u32, &Input)],
        progress: &(dyn Progress + Sync),
        done: impl Fn() + Sync,
        process: impl Fn(u32, &Input) -> Result<Result<T, LeftOut>, ScanError> + Sync,
    ) -> Result<Vec<Result<T, LeftOut>>, ScanError> {
        let bytes = |input: &Input| {
            let [width, height] = input.camera.camera.size().map(u64::from);
            width.saturating_mul(height).saturating_mul(PIXEL_BYTES).saturating_add(VIEW_BYTES)
        };
        let all = self.options.memory / 2;
        let at_once = all / self.options.threads.max(1) as u64;
        let one = |(number, input): &(u32, &Input)| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let result = if bytes(input) > all {
                let mebibytes = bytes(input) >> 20;
                Err(LeftOut::from(format!("it needs {mebibytes} MiB of memory; allow twice that with --memory")))
            } else {
                process(*number, input)?
            };
            done();
            Ok((*number, result))
        };
        // Those that are so large that not every thread could have one are processed one after the other.
        let (ordinary, large): (Vec<_>, Vec<_>) = inputs.iter().partition(|(_, input)| bytes(input) <= at_once);
        let mut results = ordinary.par_iter().with_max_len(1).map(one).collect::<Result<Vec<_>, ScanError>>()?;
        for photo in &large {
            results.push(one(photo)?);
        }
        results.sort_by_key(|(number, _)| *number);
        Ok(results.into_iter().map(|(_, result)| result).collect())
    }

    /// Where a photograph was taken; or why it cannot be used, in which case a picture may be written.
    fn placed(&self, photo: u32, input: &Input, picture: &Photograph) -> Result<Result<Placed, LeftOut>, ScanError> {
        if !self.options.refine {
            return Ok(Ok(Placed { camera: input.camera, refined: None }));
        }
        let how = photo_pose::Options::default();
        let side = picture.size().into_iter().max().unwrap_or(1).div_ceil(how.finest);
        let (values, size) = picture.luma(side);
        let Some(grey) = Grey::new(size, values) else { return Ok(Err("the picture is too small".to_owned().into())) };
        let factor = f64::from(side);
        match align::refine_photograph(self.model, &input.camera, &grey, factor, &how)? {
            Ok(found) => {
                let Quality { residual_px, share, .. } = found.quality;
                let refined = Refinement { moved_px: found.moved_px, residual_px, agreement: share };
                Ok(Ok(Placed { camera: found.camera, refined: Some(refined) }))
            }
            Err(why) => {
                let mut left_out = LeftOut::from(why.to_string());
                if let Some(folder) = &self.options.overlays {
                    let rasters = align::draw(self.model, &input.camera, 1.0 / factor)?;
                    let path = folder.join(format!("{:04}.png", photo + 1));
                    let overlay = align::Overlay::new(&grey, factor, &input.camera, &rasters);
                    let mut bytes = Vec::new();
                    let written = overlay.write_png(&mut bytes);
                    let written = written.and_then(|()| {
                        kilwa_files::atomic::write(&path, &bytes, kilwa_files::atomic::Access::Default, true)
                    });
                    written.map_err(ScanError::write(&path))?;
                    left_out.overlay = Some(path);
                }
                Ok(Err(left_out))
            }
        }
    }
}

/// What is needed to find out what photographs show.
struct Observing<'a, S> {
    placing: Placing<'a, S>,
    /// Where the photographs were taken, if that is known already.
    placed: Option<Vec<Result<Placed, LeftOut>>>,
    vertices: &'a Vertices,
    observations: &'a Observations,
    share: Subsample,
}

impl<S: Source + Sync> Observing<'_, S> {
    /// What the photographs show. One that cannot be read is left out, with the reason.
    fn all(
        &self,
        inputs: &[Input],
        progress: &(dyn Progress + Sync),
    ) -> Result<Vec<Result<PhotoObservations, LeftOut>>, ScanError> {
        let count = AtomicU64::new(0);
        let done = || {
            let count = count.fetch_add(1, Ordering::Relaxed) + 1;
            progress.update("processing the photographs", count, inputs.len() as u64);
        };
        let numbered: Vec<(u32, &Input)> = (0u32..).zip(inputs).collect();
        self.placing.each(&numbered, progress, done, |number, input| self.photograph(number, input))
    }

    /// What a photograph shows; or why it cannot be used.
    fn photograph(&self, photo: u32, input: &Input) -> Result<Result<PhotoObservations, LeftOut>, ScanError> {
        let known = self.placed.as_ref().and_then(|placed| placed.get(photo as usize));
        if let Some(Err(why)) = known {
            return Ok(Err(why.clone()));
        }
        let picture = match Photograph::read(&input.path, input.camera.camera.size(), input.mask.as_deref()) {
            Ok(picture) => picture,
            Err(why) => return Ok(Err(why.into())),
        };
        let placed = match known {
            Some(placed) => placed.clone(),
            None => self.placing.placed(photo, input, &picture)?,
        };
        let Placed { camera, refined } = match placed {
            Ok(placed) => placed,
            Err(why) => return Ok(Err(why)),
        };
        let view = View::new(self.placing.model, camera)?;
        let observer = Observer { photo, view, picture, vertices: self.vertices, share: self.share };
        let found = self.observations.of(&observer)?;
        Ok(Ok(PhotoObservations { refined: refined.map(|refined| (camera, refined)), ..found }))
    }
}

fn refuse_if_none(photos: &[PhotoReport]) -> Result<(), ScanError> {
    if photos.iter().any(|photo| photo.seen > 0) {
        return Ok(());
    }
    let readable = photos.iter().filter(|photo| photo.left_out.is_none()).count() as u64;
    if readable > 0 {
        return Err(ScanError::Request(format!(
            "no photograph sees the model ({} read); check that the surface of the model faces outwards, and that the poses are in its coordinates; if they are in the frame of a reconstruction, give control points (--control-points) or the positions of cameras (--camera-positions)",
            counted(readable, "photograph was", "photographs were")
        )));
    }
    let why = photos.iter().find_map(|photo| Some(format!("{}: {}", photo.name, photo.left_out.as_ref()?.why)));
    Err(ScanError::Request(format!(
        "no photograph could be read; {}",
        why.unwrap_or_else(|| "there is none".to_owned())
    )))
}

/// Photographs of the same size, projection and, to within a few percent, focal length have the same lens: programs may calibrate every photograph on its own.
fn lenses(inputs: &[Input]) -> Vec<u32> {
    let mut known: Vec<(Camera, f64)> = Vec::new();
    let number = |input: &Input| {
        let camera = input.camera.camera;
        let focal = camera.pixels_per_radian();
        let is_same = |(other, length): &(Camera, f64)| {
            other.size() == camera.size()
                && std::mem::discriminant(other.model()) == std::mem::discriminant(camera.model())
                && (focal / length - 1.0).abs() < SAME_LENS
        };
        let at = known.iter().position(is_same).unwrap_or_else(|| {
            known.push((camera, focal));
            known.len() - 1
        });
        at as u32
    };
    inputs.iter().map(number).collect()
}

/// Logarithms of the gains expected from the exposure settings, relative to the mean; 0 for all if any is unknown.
fn expected_gains(inputs: &[Input]) -> Vec<f64> {
    let known: Option<Vec<f64>> = inputs.iter().map(|input| input.exposure).collect();
    let Some(stops) = known else { return vec![0.0; inputs.len()] };
    let mean = stops.iter().sum::<f64>() / stops.len().max(1) as f64;
    stops.iter().map(|stop| (stop - mean) * std::f64::consts::LN_2).collect()
}

/// The factor for light with which only a few places become white.
fn brightness(tones: &Tones, places: &[Vec<ToneSample>]) -> f32 {
    let largest = |samples: &Vec<ToneSample>| {
        let lights = samples.iter().map(|s| tones.corrected(s.photo, s.r2, s.light));
        let mut values: Vec<f32> = lights.map(|light| light.into_iter().fold(0.0, f32::max)).collect();
        values.sort_by(f32::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let mut lights: Vec<f32> = places.iter().filter_map(largest).collect();
    lights.sort_by(f32::total_cmp);
    let at = ((1.0 - WHITE) * lights.len() as f64) as usize;
    lights.get(at).map_or(1.0, |light| (BRIGHTEST / light.max(1e-6)).min(1.0))
}
