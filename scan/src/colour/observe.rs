//! What every photograph shows of the vertices: observations in a scratch file, by group of vertices.

use super::Refinement;
use super::picture::Photograph;
use super::vertices::{Vertex, Vertices};
use super::view::{Sighting, View};
use crate::ScanError;
use crate::scratch::{ByteRange, ScratchFile};
use glam::DVec2;
use kilwa_geometry::color::{light_from_srgb_f32, srgb_from_light_f32};
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::colour::tone::ToneSample;

/// Bytes of an observation.
const BYTES: usize = 14;
/// A photograph does not colour a vertex if the cosine of the angle between the normal and the line of sight is smaller.
pub(super) const GRAZING: f64 = 0.15;
/// Distances from an occlusion boundary, in pixels: below the first a photograph hardly counts, from the second on it counts fully.
const BORDER: [f64; 2] = [2.0, 24.0];
/// The same for the border of the picture, as shares of its longer side.
const MARGIN: [f64; 2] = [0.002, 0.06];
/// The smallest factor for weights at borders; not 0, because there may be no other photograph that sees the vertex.
const MIN_WEIGHT: f64 = 1e-3;
/// The factor for the weight of a clipped value.
const CLIPPED: f64 = 0.02;
/// Weights are kept as logarithms: steps per factor of two, and the logarithm (base 2) of the smallest.
const STEPS: f64 = 512.0;
const SMALLEST: f64 = -64.0;

/// What a photograph shows of a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observed {
    /// The number of the vertex in its group.
    pub(super) vertex: u32,
    pub(super) weight: f32,
    /// The square of the distance from the centre of the picture; 1 in the corners.
    pub(super) r2: f32,
    /// sRGB, at the vertex and around it.
    pub(super) full: [u8; 3],
    pub(super) low: [u8; 3],
}

impl Observed {
    /// A sample for comparing tones, taken from the surroundings because poses are not exact.
    fn tone(&self, photo: u32) -> ToneSample {
        ToneSample { photo, r2: self.r2, light: self.low.map(light_from_srgb_f32), weight: 1.0 }
    }

    fn to_bytes(self, bytes: &mut Vec<u8>) {
        let weight = (libm::log2(f64::from(self.weight)) - SMALLEST) * STEPS;
        let weight = weight.round().clamp(0.0, 65_535.0) as u16;
        let radius = (self.r2 * 32_768.0).round().clamp(0.0, 65_535.0) as u16;
        bytes.extend(self.vertex.to_le_bytes());
        bytes.extend(weight.to_le_bytes());
        bytes.extend(radius.to_le_bytes());
        bytes.extend(self.full);
        bytes.extend(self.low);
    }

    fn from_bytes(b: &[u8; BYTES]) -> Self {
        let short = |k: usize| u16::from_le_bytes([b[k], b[k + 1]]);
        Self {
            vertex: u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
            weight: libm::exp2(f64::from(short(4)) / STEPS + SMALLEST) as f32,
            r2: f32::from(short(6)) / 32_768.0,
            full: [b[8], b[9], b[10]],
            low: [b[11], b[12], b[13]],
        }
    }
}

/// The observations of a photograph in a group.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Run {
    pub(super) group: u32,
    pub(super) photo: u32,
    range: ByteRange,
}

/// The scratch file.
pub(super) struct Observations {
    file: ScratchFile,
}

/// What was found in a photograph.
#[derive(Default)]
pub(super) struct PhotoObservations {
    pub(super) runs: Vec<Run>,
    /// Samples for the tone, each with its vertex: group and number in it.
    pub(super) samples: Vec<([u32; 2], ToneSample)>,
    /// Vertices that are seen.
    pub(super) seen: u64,
    /// The camera with its pose refined.
    pub(super) refined: Option<(PosedCamera, Refinement)>,
}

/// Which part of the vertices determines tones: those whose hash is divisible by this.
#[derive(Debug, Clone, Copy)]
pub(super) struct Subsample(pub(super) u64);

impl Observations {
    pub(super) fn create(scratch: &std::path::Path, remedy: &'static str) -> Result<Self, ScanError> {
        Ok(Self { file: ScratchFile::create(scratch, remedy)? })
    }

    /// The observations of a run.
    pub(super) fn read(&self, run: &Run) -> Result<Vec<Observed>, ScanError> {
        let bytes = self.file.read(run.range)?;
        Ok(bytes.as_chunks::<BYTES>().0.iter().map(Observed::from_bytes).collect())
    }

    /// Bytes in the scratch file.
    pub(super) fn bytes(&self) -> u64 {
        self.file.bytes()
    }

    /// What a photograph shows.
    pub(super) fn of(&self, observer: &Observer<'_>) -> Result<PhotoObservations, ScanError> {
        let mut found = PhotoObservations::default();
        let mut bytes = Vec::new();
        for (number, group) in (0u32..).zip(&observer.vertices.groups) {
            if !observer.view.may_show(group.center, group.radius) {
                continue;
            }
            bytes.clear();
            for (k, vertex) in (0u32..).zip(observer.vertices.of(group)?) {
                let Some((observed, is_clear)) = observer.observed(k, &vertex) else { continue };
                observed.to_bytes(&mut bytes);
                // Where triangles are split, a place would count many times.
                if is_clear && k < group.original && vertex.hash().is_multiple_of(observer.share.0) {
                    found.samples.push(([number, k], observed.tone(observer.photo)));
                }
            }
            if !bytes.is_empty() {
                found.seen += (bytes.len() / BYTES) as u64;
                found.runs.push(Run { group: number, photo: observer.photo, range: self.file.append(&bytes)? });
            }
        }
        Ok(found)
    }
}

/// A photograph, and the vertices that it may see.
pub(super) struct Observer<'a> {
    /// The number of the photograph.
    pub(super) photo: u32,
    pub(super) view: View,
    pub(super) picture: Photograph,
    pub(super) vertices: &'a Vertices,
    pub(super) share: Subsample,
}

impl Observer<'_> {
    /// What it shows of a vertex, and whether that is good enough to compare tones.
    fn observed(&self, number: u32, vertex: &Vertex) -> Option<(Observed, bool)> {
        let lattice = &self.vertices.lattice;
        let place = lattice.world_from_lattice(vertex.position);
        let sighting = self.view.sighting(place, vertex.normal(), lattice.step()).filter(|s| s.facing > GRAZING)?;
        let camera = self.view.camera();
        let point = camera.camera_from_world.apply(place);
        let mut pixel = camera.camera.project(point)?;
        let size = self.picture.size().map(f64::from);
        // Such pictures are composed of many, and have no vignetting.
        let is_full_turn = camera.camera.is_full_turn();
        if is_full_turn {
            // Straight behind, the column may be the one after the last.
            pixel.x = pixel.x.rem_euclid(size[0]);
        }
        let shown = self.picture.shown(pixel.x, pixel.y)?;
        let angle = camera.camera.pixel_angle(point)?;
        let margin = if is_full_turn { 1.0 } else { margin(pixel, size) };
        let mut weight = weight(&sighting, angle, margin) * f64::from(shown.sharpness * shown.sharpness);
        if shown.is_clipped {
            weight *= CLIPPED;
        }
        let encode = |light: [f32; 3]| light.map(srgb_from_light_f32);
        let observed = Observed {
            vertex: number,
            weight: weight as f32,
            r2: if is_full_turn { 0.0 } else { radius2(pixel, size) as f32 },
            full: encode(shown.full),
            low: encode(shown.low),
        };
        Some((observed, !shown.is_clipped && sighting.clearance > BORDER[1] * angle))
    }
}

/// How well a photograph shows a vertex: pixels per square metre of surface, reduced where they are unreliable.
fn weight(sighting: &Sighting, pixel_angle: f64, margin: f64) -> f64 {
    let length = pixel_angle * sighting.range;
    let density = sighting.facing / (length * length);
    let border = ramp(sighting.clearance / pixel_angle, BORDER);
    density * sighting.facing * (border * margin).max(MIN_WEIGHT)
}

/// What is left of a weight near the border of a picture.
fn margin(pixel: DVec2, [width, height]: [f64; 2]) -> f64 {
    let to_edge = pixel.x.min(pixel.y).min(width - pixel.x).min(height - pixel.y);
    ramp(to_edge / width.max(height), MARGIN)
}

/// The square of the distance from the centre of a picture; 1 in the corners.
fn radius2(pixel: DVec2, [width, height]: [f64; 2]) -> f64 {
    let half = DVec2::new(width, height) * 0.5;
    (pixel - half).length_squared() / half.length_squared()
}

/// Smoothstep: rises from 0 to 1 between two numbers.
fn ramp(value: f64, [from, to]: [f64; 2]) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_stored_to_within_a_quarter_of_a_per_cent() {
        let mut random = fastrand::Rng::with_seed(1);
        for _ in 0..1000 {
            let observed = Observed {
                vertex: random.u32(..),
                weight: (random.f64() * 40.0 - 20.0).exp2() as f32,
                r2: random.f32(),
                full: [random.u8(..); 3],
                low: [random.u8(..); 3],
            };
            let mut bytes = Vec::new();
            observed.to_bytes(&mut bytes);
            let back = Observed::from_bytes(bytes.as_chunks::<BYTES>().0.first().expect("one"));
            assert!((back.weight / observed.weight - 1.0).abs() < 0.0025 && (back.r2 - observed.r2).abs() < 2e-5);
            assert_eq!((back.vertex, back.full, back.low), (observed.vertex, observed.full, observed.low));
        }
    }

    #[test]
    fn closer_and_more_frontal_photographs_count_more_and_borders_less() {
        let size = [1000.0, 800.0];
        let middle = DVec2::new(500.0, 400.0);
        let seen = |facing: f64, range: f64, clearance: f64| Sighting { facing, range, clearance };
        let base = weight(&seen(0.8, 5.0, 0.1), 1e-3, 1.0);
        assert!(weight(&seen(0.8, 4.0, 0.1), 1e-3, 1.0) > base);
        assert!(weight(&seen(0.9, 5.0, 0.1), 1e-3, 1.0) > base);
        assert!(weight(&seen(0.8, 5.0, 0.004), 1e-3, 1.0) < 0.1 * base);
        assert!(margin(DVec2::new(4.0, 400.0), size) < 0.1 && margin(middle, size) >= 1.0);
        assert!(weight(&seen(0.8, 5.0, 0.0), 1e-3, 1.0) > 0.0);
    }
}
