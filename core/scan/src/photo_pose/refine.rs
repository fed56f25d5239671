//! A photograph's pose refined against a model.

use super::Grey;
use super::motion::{changed, derivatives, dot};
use super::patch::{self, Map, SIDE};
use super::predict::{Prediction, Shown, logarithm};
use super::search::{Found, Search, Sight};
use crate::camera::PosedCamera;
use crate::raster::Raster;
use glam::{DVec2, DVec3};
use nalgebra::DVector;
use std::fmt;

/// How a pose is refined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Options {
    /// How far what is seen may be from where the initial pose expects it, pixels of the photograph. None: a twentieth of the longer side.
    pub reach: Option<f64>,
    /// Longer side of the finest resolution that is compared, pixels. The photograph is not compared at a finer resolution than it is given.
    pub finest: u32,
    /// Refine focal length and principal point, too; only of pinholes.
    pub calibrate: bool,
    /// Smallest share of patches that must agree.
    pub min_share: f64,
    /// Largest standard deviation of where the refined pose sees the surface, pixels of the photograph.
    pub max_sigma: f64,
}

impl Default for Options {
    fn default() -> Self {
        Self { reach: None, finest: 2048, calibrate: false, min_share: 0.4, max_sigma: 1.35 }
    }
}

/// Longer side of the coarsest resolution, at most, pixels.
const COARSEST: u32 = 256;
/// The fewest pixels along the shorter side of a picture that is compared.
const SHORTEST: u32 = 2 * SIDE as u32;
/// Largest shift that is sought at the coarsest resolution, pixels; and the largest at others.
const MAX_RADIUS: usize = 24;
const RADIUS: usize = 8;
/// Renderings of each resolution, at most.
const ROUNDS: usize = 3;
/// Pixels between patches.
const SPACING: usize = 16;
/// The pose is less certain than patches with independent errors would make it, by this factor: shadows shift neighbouring patches alike. Measured on simulated photographs.
const SIGMA_FACTOR: f64 = 3.0;
/// A picture has at most about this many patches.
const MAX_PATCHES: usize = 400;
/// Patches whose pixels are stretched by more than this are left out: those near the poles of panoramas do not move as a whole.
const STRETCHED: f64 = 2.0;
/// A resolution is finished when the pose moves what is seen by less than this, pixels of it.
const SETTLED: f64 = 0.15;
/// Patches agree with a shift whose likelihood is at most this far below that of their best shift.
const NATS: f32 = 3.0;
/// A patch counts as informative if at most this share of all shifts would agree with it,
const MAX_CHANCE_AGREEMENT: f64 = 0.12;
/// and its best shift has at least this gain.
const GAIN: f32 = 4.0;
/// The fewest informative patches.
const MIN_PATCHES: usize = 12;
/// The largest gain of a second pose, as a share of the best one's.
const MAX_RIVAL: f64 = 0.9;
/// By how many standard deviations more patches must agree than would by chance.
const MIN_SCORE: f64 = 8.0;

/// A refined pose, and how good it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The camera with the refined pose (and calibration, if asked).
    pub camera: PosedCamera,
    /// How it was judged.
    pub quality: Quality,
    /// By how much what is seen was shifted, pixels of the photograph (root mean square over the patches).
    pub moved_px: f64,
}

/// How well a photograph fits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Quality {
    /// Informative patches.
    pub patches: usize,
    /// The share of them that agree with the pose.
    pub share: f64,
    /// The share that would agree with any pose.
    pub chance: f64,
    /// By how many standard deviations more agree than would by chance.
    pub score: f64,
    /// Distances between where the patches that agree are and where they are expected, pixels of the photograph (root mean square).
    pub residual_px: f64,
    /// Standard deviation of where the pose sees the surface, pixels of the photograph (root mean square over the patches).
    pub sigma_px: f64,
    /// How well the second best pose within reach fits at the coarsest resolution, as a share of how well the best one fits: near 1 where something repeats.
    pub rival: f64,
}

/// Why a photograph could not be refined.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RefusalReason {
    /// The picture's size does not match the camera's.
    Size {
        /// Width and height of the picture, pixels.
        picture: [u32; 2],
        /// Those of the camera, divided by the given factor.
        expected: [u32; 2],
    },
    /// It is too small to compare.
    Small,
    /// It shows too little of the model: this many patches can be compared.
    Little {
        /// Informative patches.
        patches: usize,
    },
    /// Too few patches agree on a pose: it does not show the model, or is too far from where it was taken.
    Disagrees,
    /// Another pose fits almost as well: something in the picture repeats.
    Ambiguous,
    /// The patches that agree do not determine the pose.
    Vague,
    /// The pose would have to be changed by more than the reach.
    Far {
        /// By how much what is seen was shifted, pixels of the photograph.
        moved_px: f64,
    },
}

/// A photograph that could not be refined.
#[derive(Debug, Clone, PartialEq)]
pub struct NotRefined {
    /// Why.
    pub why: RefusalReason,
    /// How well it fits, as far as that could be judged.
    pub quality: Quality,
    /// The best pose that was found, which must not be used.
    pub camera: PosedCamera,
}

impl fmt::Display for NotRefined {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Quality { patches, share, sigma_px, .. } = self.quality;
        match self.why {
            RefusalReason::Size { picture: [w, h], expected: [a, b] } => {
                write!(f, "the picture has {w} × {h} pixels, but its camera has {a} × {b}")
            }
            RefusalReason::Small => write!(f, "the picture is too small: its shorter side must have at least {SHORTEST} pixels"),
            RefusalReason::Little { patches } => write!(
                f,
                "it shows too little of the model: only {patches} usable patches; at least {MIN_PATCHES} are needed"
            ),
            RefusalReason::Disagrees => write!(
                f,
                "only {:.0} % of {patches} patches agree on a pose: it does not show the model, or its pose is too far off",
                100.0 * share
            ),
            RefusalReason::Ambiguous => f.write_str("a second pose fits almost as well, because the scene repeats: give a better initial pose and a smaller reach"),
            RefusalReason::Vague => {
                write!(
                    f,
                    "the visible part of the model does not determine its pose: the uncertainty is {sigma_px:.1} pixels"
                )
            }
            RefusalReason::Far { moved_px } => {
                write!(
                    f,
                    "it fits only if its pose is changed by {moved_px:.0} pixels, which is more than the limit"
                )
            }
        }
    }
}

/// What one resolution found.
struct Round {
    camera: PosedCamera,
    /// Shift of what is seen, pixels of the resolution (root mean square).
    moved: f64,
    quality: Quality,
}

/// Draws a model for a camera, with pixels of a share of the photograph's pixels in each direction.
pub type Render<'a, E> = dyn FnMut(&PosedCamera, f64) -> Result<Vec<Raster<Shown>>, E> + 'a;

/// Refine the pose of a photograph.
///
/// `picture`: its luminance in a scale close to sRGB's or in linear light, at full size or divided by `factor` in both directions (a last incomplete pixel is dropped); NaN where it must not be used. `render` draws the model for a
/// camera, with pixels of a share of the photograph's pixels in each direction ([`crate::raster::windows`]). The result is a pure function of both.
///
/// Coarse to fine, the expected picture is compared with the photograph patch by patch ([`super::patch`]); the change of pose that most patches support is sought among all within reach,
/// and fitted to the patches' best shifts. Finally each patch is asked whether it agrees. Chance agreement is known from the same maps: of a photograph of something else, no more patches agree than by chance.
///
/// # Errors
/// Those of `render`. A photograph that cannot be refined is the inner error.
pub fn refine<E>(
    camera: &PosedCamera,
    picture: &Grey,
    factor: f64,
    render: &mut Render<'_, E>,
    options: &Options,
) -> Result<Result<Refined, Box<NotRefined>>, E> {
    let mut refiner = Refiner { options, initial: *camera, camera: *camera };
    let expected = camera.camera.size().map(|side| (f64::from(side) / factor) as u32);
    if expected.iter().zip(picture.size()).any(|(a, b)| a.abs_diff(b) > 1) {
        return Ok(Err(refiner.failed(RefusalReason::Size { picture: picture.size(), expected }, Quality::default())));
    }
    let mut levels = vec![(picture.clone(), factor)];
    while let Some((last, factor)) = levels.last()
        && (last.size()[0].max(last.size()[1]) > COARSEST && last.size()[0].min(last.size()[1]) >= 2 * SHORTEST)
        && let Some(half) = last.halved()
    {
        let factor = 2.0 * factor;
        levels.push((half, factor));
    }
    levels.retain(|(level, _)| level.size()[0].max(level.size()[1]) <= options.finest.max(COARSEST));
    let Some((coarsest, factor)) = levels.last() else {
        return Ok(Err(refiner.failed(RefusalReason::Small, Quality::default())));
    };
    if coarsest.size()[0].min(coarsest.size()[1]) < SHORTEST {
        return Ok(Err(refiner.failed(RefusalReason::Small, Quality::default())));
    }
    let reach = options.reach.unwrap_or(f64::from(camera.camera.size()[0].max(camera.camera.size()[1])) / 20.0);
    let mut radius = ((reach / factor).ceil() as usize).clamp(3, MAX_RADIUS);
    let (mut quality, mut rival) = (Quality::default(), None);
    for (level, factor) in levels.iter().rev() {
        for _ in 0..ROUNDS {
            let round = match refiner.round(level, *factor, radius, render)? {
                Ok(round) => round,
                Err(patches) => return Ok(Err(refiner.failed(RefusalReason::Little { patches }, quality))),
            };
            refiner.camera = round.camera;
            let first = *rival.get_or_insert(round.quality.rival);
            quality = Quality { rival: first, ..round.quality };
            radius = RADIUS;
            if round.moved < SETTLED {
                break;
            }
        }
    }
    Ok(refiner.judged(quality, reach))
}

struct Refiner<'a> {
    options: &'a Options,
    initial: PosedCamera,
    camera: PosedCamera,
}

impl Refiner<'_> {
    fn failed(&self, why: RefusalReason, quality: Quality) -> Box<NotRefined> {
        Box::new(NotRefined { why, quality, camera: self.camera })
    }

    /// Render, compare, and improve the pose once. The inner error: the number of patches, which is too small.
    fn round<E>(
        &self,
        picture: &Grey,
        factor: f64,
        radius: usize,
        render: &mut Render<'_, E>,
    ) -> Result<Result<Round, usize>, E> {
        let rasters = render(&self.camera, 1.0 / factor)?;
        let prediction = Prediction::new(&self.camera.camera, factor, picture.size(), &rasters);
        drop(rasters);
        let known =
            Grey::from_fn(picture.size(), |x, y| f32::from(u8::from(picture.at(x as usize, y as usize).is_finite())));
        let all_known = known.values().iter().all(|known| *known > 0.0);
        let known = (!all_known).then_some(&known);
        let details = logarithm(picture, known).details(known);
        let [width, height] = picture.size().map(|side| side as usize);
        let area = (width * height) as f64;
        let spacing = SPACING.max((area / MAX_PATCHES as f64).sqrt() as usize);
        let maps = patch::maps(&details, &prediction, radius, spacing);
        let length = median_range(&prediction.range);
        let sights: Vec<Sight> = maps
            .into_iter()
            .filter_map(|map| {
                let point = self.point(&map, &prediction, picture.size(), factor)?;
                let rows = derivatives(&self.camera.camera, point, length, self.options.calibrate)?;
                let [a, b] = rows.map(|row| DVec3::new(row[3], row[4], row[5]).length());
                if a.max(b) > STRETCHED * a.min(b) {
                    return None;
                }
                Some(Sight { map, rows: rows.map(|row| row.map(|value| value / factor)) })
            })
            .collect();
        if sights.len() < MIN_PATCHES {
            return Ok(Err(sights.len()));
        }
        // About what remains of errors at this resolution.
        let expected = if radius > RADIUS { 0.5 * radius as f64 } else { 2.0 };
        let Some(found) = Search::new(&sights, expected).best(radius.min(MAX_RADIUS) as i32) else {
            return Ok(Err(0));
        };
        let Ok(camera) = changed(&self.camera, &found.change, length) else { return Ok(Err(0)) };
        let square: f64 =
            sights.iter().flat_map(|s| &s.rows).map(|row| dot(row, &found.change)).map(|shift| shift * shift).sum();
        let moved = (square / sights.len() as f64).sqrt();
        Ok(Ok(Round { camera, moved, quality: quality(&sights, &found, factor) }))
    }

    /// Where a patch is, in the axes of the camera: its centre at the median range of its surface.
    fn point(&self, map: &Map, prediction: &Prediction, size: [u32; 2], factor: f64) -> Option<DVec3> {
        let half = SIDE / 2;
        let [x, y] = map.center.map(|c| c as usize);
        let mut ranges: Vec<f32> = (y - half..y + half)
            .flat_map(|row| prediction.range[row * size[0] as usize + x - half..][..SIDE].iter().copied())
            .filter(|range| range.is_finite())
            .collect();
        ranges.sort_unstable_by(f32::total_cmp);
        let range = f64::from(*ranges.get(ranges.len() / 2)?);
        let pixel = DVec2::new(f64::from(map.center[0]), f64::from(map.center[1])) * factor;
        Some(self.camera.camera.ray(pixel)? * range)
    }

    fn judged(&self, quality: Quality, reach: f64) -> Result<Refined, Box<NotRefined>> {
        let moved_px = self.moved();
        let why = if quality.patches < MIN_PATCHES {
            Some(RefusalReason::Little { patches: quality.patches })
        } else if quality.share < self.options.min_share || quality.score < MIN_SCORE {
            Some(RefusalReason::Disagrees)
        } else if quality.rival > MAX_RIVAL {
            Some(RefusalReason::Ambiguous)
        } else if quality.sigma_px > self.options.max_sigma {
            Some(RefusalReason::Vague)
        } else if moved_px > 2.0 * reach {
            Some(RefusalReason::Far { moved_px })
        } else {
            None
        };
        match why {
            Some(why) => Err(self.failed(why, quality)),
            None => Ok(Refined { camera: self.camera, quality, moved_px }),
        }
    }

    /// By how much directions are shifted between the initial and the refined pose at the median range, pixels (root mean square over a grid).
    fn moved(&self) -> f64 {
        let [width, height] = self.initial.camera.size().map(f64::from);
        let (mut sum, mut count) = (0.0, 0);
        for k in 0..64 {
            let pixel = DVec2::new((f64::from(k % 8) + 0.5) / 8.0 * width, (f64::from(k / 8) + 0.5) / 8.0 * height);
            let Some(ray) = self.initial.ray(pixel) else { continue };
            let Some(after) = self.camera.camera.project(self.camera.camera_from_world.rotation * ray) else {
                continue;
            };
            let mut offset = after - pixel;
            if self.initial.camera.max_angle() > 3.0 {
                offset.x -= (offset.x / width).round() * width;
            }
            sum += offset.length_squared();
            count += 1;
        }
        (sum / f64::from(count.max(1))).sqrt()
    }
}

fn median_range(range: &[f32]) -> f64 {
    let mut known: Vec<f32> = range.iter().copied().filter(|r| r.is_finite()).step_by(7).collect();
    known.sort_unstable_by(f32::total_cmp);
    known.get(known.len() / 2).map_or(1.0, |range| f64::from(*range).max(1e-9))
}

/// How many patches agree with a change, and how many would by chance.
fn quality(sights: &[Sight], found: &Found, factor: f64) -> Quality {
    let (mut patches, mut agree, mut chance, mut variance) = (0_u32, 0_u32, 0.0, 0.0);
    let (mut square, mut measured) = (0.0, 0_u32);
    let mut sigma = 0.0;
    for sight in sights {
        let shift = [dot(&sight.rows[0], &found.change), dot(&sight.rows[1], &found.change)];
        for row in &sight.rows {
            let row = DVector::from_column_slice(row);
            sigma += (row.transpose() * &found.covariance * &row)[0];
        }
        let best = sight.map.max();
        let p = sight.map.share_within(NATS);
        if best < GAIN || p > MAX_CHANCE_AGREEMENT {
            continue;
        }
        patches += 1;
        chance += p;
        variance += p * (1.0 - p);
        if sight.map.near(shift).is_some_and(|gain| gain >= best - NATS) {
            agree += 1;
            if let Some(peak) = sight.map.peak_near(shift, 3.0) {
                square += DVec2::from_array(peak.shift).distance_squared(DVec2::from_array(shift));
                measured += 1;
            }
        }
    }
    let count = f64::from(patches.max(1));
    Quality {
        patches: patches as usize,
        share: f64::from(agree) / count,
        chance: chance / count,
        score: (f64::from(agree) - chance) / variance.max(0.25).sqrt(),
        residual_px: (square / f64::from(measured.max(1))).sqrt() * factor,
        sigma_px: SIGMA_FACTOR * (sigma / sights.len().max(1) as f64).sqrt() * factor,
        rival: found.rival,
    }
}
