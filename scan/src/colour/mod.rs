//! Colouring a model from photographs.
//!
//! Stages: [`vertices`] of the finest surface into a scratch file → for each photograph its depth maps ([`view`], drawn from the pack by [`model`]), its pixels
//! ([`picture`]), and what it shows of every vertex ([`observe`]), into a second scratch file → the tones of all photographs
//! (`kilwa_scan_core::colour::tone`) → chunk by chunk one colour for each vertex ([`paint`], `kilwa_scan_core::colour::blend`); vertices that no photograph sees
//! keep the scan's colour in the tone of the photographs ([`unseen`]).
//!
//! A vertex on the border of chunks is in several of them. It gets the same colour in all, because that depends only on its position and normal. Results do not
//! depend on threads. Memory: a photograph with its depth maps per thread, decoded chunks up to a share of `Options::memory`, and an index of some bytes for each
//! photograph and chunk that it sees.

pub mod align;
mod model;
mod observe;
mod paint;
mod picture;
#[cfg(test)]
mod tests;
mod unseen;
mod vertices;
mod view;

pub use model::{Model, Part};
use paint::Work;
pub use paint::{Colouring, PHOTOS};
pub use picture::{Photograph, Shown};
pub use view::{Sighting, View};

use crate::ScanError;
use crate::import::Progress;
use kilwa_pack::plural::counted;
use kilwa_pack::{Reader, Source};
use kilwa_scan_core::colour::tone::{ToneSample, Tones};
use kilwa_scan_core::{Camera, PosedCamera};
use observe::{Found, Observations, Observer, Share};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use vertices::Vertices;

/// What helps where scratch space is short.
const WAY_OUT: &str = "";
/// Vertices that determine tones, about.
const TONE_VERTICES: u64 = 150_000;
/// Bytes of a photograph for each of its pixels while it is used, and of its depth maps.
const PIXEL_BYTES: u64 = 12;
const VIEW_BYTES: u64 = 40 << 20;
/// The share of places that may become white, and what the brightest of the others becomes, linear light.
const WHITE: f64 = 0.005;
const BRIGHTEST: f32 = 0.95;

/// How to colour.
#[derive(Debug, Clone)]
pub struct Options {
    /// Bytes of memory, about.
    pub memory: u64,
    /// Worker threads.
    pub threads: usize,
    /// The folder of scratch files.
    pub scratch: PathBuf,
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
    /// Light per exposure in stops, relative to the other photographs: log2(t · ISO / N²), if that is known.
    pub exposure: Option<f64>,
}

/// What became of a photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct PhotoReport {
    /// Its name.
    pub name: String,
    /// Why it was not used.
    pub left_out: Option<String>,
    /// Vertices that it sees.
    pub seen: u64,
    /// The sum of its shares in the colours of vertices: 1 for each vertex that it alone colours.
    pub share: f64,
    /// Vertices for which it was dropped, because it shows something else than the others.
    pub dropped: u64,
    /// What it multiplies light by, relative to the mean of all photographs, in red, green and blue.
    pub gain: [f64; 3],
    /// What it adds to light, linear.
    pub offset: [f64; 3],
    /// The brightness of its lens in the corners, relative to the centre.
    pub corner: f64,
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
    /// Places at which photographs were compared to find their tones.
    pub places: usize,
    /// What light was multiplied by, so that highlights fit into the range of colours.
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
    let vertices = Vertices::read(reader, &options.scratch, progress)?;
    let observations = Observations::create(&options.scratch)?;
    let share = Share((vertices.count() / TONE_VERTICES).max(1));
    let model = Model::new(reader, options.memory / 2);
    let found = observe_all(&model, inputs, &vertices, &observations, share, options, progress)?;
    drop(model);
    let mut report = Report { vertices: vertices.count(), scratch: observations.bytes(), ..Report::default() };
    let (mut runs, mut samples) = (Vec::new(), BTreeMap::<[u32; 2], Vec<ToneSample>>::new());
    for (input, result) in inputs.iter().zip(found) {
        let (found, left_out) = match result {
            Ok(found) => (found, None),
            Err(why) => (Found::default(), Some(why)),
        };
        report.photos.push(PhotoReport::new(input, &found, left_out));
        runs.extend(found.runs);
        for (vertex, sample) in found.samples {
            samples.entry(vertex).or_default().push(sample);
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
    let work = Work { reader, vertices: &vertices, observations: &observations, tones: &tones, brightness };
    let colouring = work.paint(&runs, &options.scratch, &mut report, progress)?;
    Ok((colouring, report))
}

impl PhotoReport {
    fn new(input: &Input, found: &Found, left_out: Option<String>) -> Self {
        Self {
            name: input.name.clone(),
            left_out,
            seen: found.seen,
            share: 0.0,
            dropped: 0,
            gain: [1.0; 3],
            offset: [0.0; 3],
            corner: 1.0,
        }
    }
}

/// Go through the photographs, as many at once as memory allows. A photograph that cannot be read is left out, with the reason.
fn observe_all<S: Source + Sync>(
    model: &Model<'_, S>,
    inputs: &[Input],
    vertices: &Vertices,
    observations: &Observations,
    share: Share,
    options: &Options,
    progress: &(dyn Progress + Sync),
) -> Result<Vec<Result<Found, String>>, ScanError> {
    let pixels = |input: &Input| input.camera.camera.size().map(u64::from).iter().product::<u64>();
    let largest = inputs.iter().map(pixels).max().unwrap_or(0) * PIXEL_BYTES + VIEW_BYTES;
    let at_once = (options.memory / 2 / largest).clamp(1, 1 << 10) as usize;
    let done = AtomicU64::new(0);
    let mut results = Vec::with_capacity(inputs.len());
    let numbered: Vec<(u32, &Input)> = (0u32..).zip(inputs).collect();
    for batch in numbered.chunks(at_once.max(1)) {
        let found: Vec<Result<Result<Found, String>, ScanError>> = batch
            .par_iter()
            .with_max_len(1)
            .map(|(number, input)| {
                if progress.is_stopped() {
                    return Err(ScanError::Stopped);
                }
                let result = match Photograph::read(&input.path, input.camera.camera.size(), input.mask.as_deref()) {
                    Ok(picture) => {
                        let view = View::new(model, input.camera)?;
                        let observer = Observer { photo: *number, view, picture, vertices, share };
                        Ok(observations.of(&observer)?)
                    }
                    Err(why) => Err(why),
                };
                progress.update("photographs", done.fetch_add(1, Ordering::Relaxed) + 1, inputs.len() as u64);
                Ok(result)
            })
            .collect();
        for result in found {
            results.push(result?);
        }
    }
    Ok(results)
}

fn refuse_if_none(photos: &[PhotoReport]) -> Result<(), ScanError> {
    if photos.iter().any(|photo| photo.seen > 0) {
        return Ok(());
    }
    let readable = photos.iter().filter(|photo| photo.left_out.is_none()).count() as u64;
    if readable > 0 {
        return Err(ScanError::Request(format!(
            "{} and none sees the model; check that their poses are in the coordinates of the model, and that the surface of the model faces outwards",
            counted(readable, "photograph could be read", "photographs could be read")
        )));
    }
    let why = photos.iter().find_map(|photo| Some(format!("{}: {}", photo.name, photo.left_out.as_ref()?)));
    Err(ScanError::Request(format!(
        "no photograph could be read; {}",
        why.unwrap_or_else(|| "there is none".to_owned())
    )))
}

/// Photographs of the same camera have the same lens.
fn lenses(inputs: &[Input]) -> Vec<u32> {
    let mut known: Vec<Camera> = Vec::new();
    let number = |input: &Input| {
        let camera = input.camera.camera;
        let at = known.iter().position(|other| *other == camera).unwrap_or_else(|| {
            known.push(camera);
            known.len() - 1
        });
        at as u32
    };
    inputs.iter().map(number).collect()
}

/// Logarithms of gains, relative to the mean; 0 for all if any is unknown.
fn expected_gains(inputs: &[Input]) -> Vec<f64> {
    let known: Option<Vec<f64>> = inputs.iter().map(|input| input.exposure).collect();
    let Some(stops) = known else { return vec![0.0; inputs.len()] };
    let mean = stops.iter().sum::<f64>() / stops.len().max(1) as f64;
    stops.iter().map(|stop| (stop - mean) * std::f64::consts::LN_2).collect()
}

/// What to multiply light by, so that all but a few places are not white.
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
