//! One colour for each vertex, chunk by chunk, and how to put them on the surface.

use super::observe::{Observations, Run};
use super::unseen::{Observed as Cells, Ratios, observe};
use super::vertices::{Group, Vertices, finest};
use super::{Report, WAY_OUT};
use crate::ScanError;
use crate::import::Progress;
use crate::scratch::{ScratchFile, Stretch};
use kilwa_formats::UNCOLOURED;
use kilwa_formats::extract::Repaint;
use kilwa_geometry::Lattice;
use kilwa_geometry::color::{light_from_srgb_f32, srgb_from_light_f32};
use kilwa_pack::{Chunk, Reader, Source};
use kilwa_scan_core::colour::blend::{Observation, blend};
use kilwa_scan_core::colour::tone::Tones;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;

/// The scalar with the number of photographs that a colour rests on.
pub const PHOTOS: &str = "photos";

/// Bytes of a vertex: its colour, and the number of photographs.
const BYTES: usize = 5;
/// Groups at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

/// The colours of a model.
pub struct Colouring {
    lattice: Lattice,
    stretches: HashMap<u32, Stretch>,
    file: ScratchFile,
    ratios: Ratios,
}

/// The colours of a group.
struct Painted {
    bytes: Vec<u8>,
    coloured: u64,
    /// For each photograph its share of the colours, and how often it was dropped.
    photos: Vec<(u32, [f64; 2])>,
    cells: Cells,
}

/// Everything that was found.
pub(super) struct Work<'a, S> {
    pub(super) reader: &'a Reader<S>,
    pub(super) vertices: &'a Vertices,
    pub(super) observations: &'a Observations,
    pub(super) tones: &'a Tones,
    /// What light is multiplied by.
    pub(super) brightness: f32,
}

impl<S: Source + Sync> Work<'_, S> {
    /// Blend the observations of all groups; `runs` are in their order.
    pub(super) fn paint(
        &self,
        runs: &[Run],
        scratch: &Path,
        report: &mut Report,
        progress: &(dyn Progress + Sync),
    ) -> Result<Colouring, ScanError> {
        let file = ScratchFile::create(scratch, WAY_OUT)?;
        let lattice = self.vertices.lattice;
        let mut colouring = Colouring { lattice, stretches: HashMap::new(), file, ratios: Ratios::default() };
        let numbered: Vec<(u32, &Group)> = (0u32..).zip(&self.vertices.groups).collect();
        for batch in numbered.chunks(BATCH) {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            progress.update("colouring", batch[0].0.into(), numbered.len() as u64);
            let painted: Vec<Result<Painted, ScanError>> = batch
                .par_iter()
                .map(|(number, group)| {
                    let first = runs.partition_point(|run| run.group < *number);
                    let last = runs.partition_point(|run| run.group <= *number);
                    self.group(group, &runs[first..last])
                })
                .collect();
            for ((_, group), painted) in batch.iter().zip(painted) {
                let painted = painted?;
                report.coloured += painted.coloured;
                for (photo, [share, dropped]) in painted.photos {
                    let about = &mut report.photos[photo as usize];
                    about.share += share;
                    about.dropped += dropped as u64;
                }
                colouring.ratios.add(painted.cells);
                colouring.stretches.insert(group.chunk, colouring.file.append(&painted.bytes)?);
            }
        }
        Ok(colouring)
    }

    fn group(&self, group: &Group, runs: &[Run]) -> Result<Painted, ScanError> {
        let mut all: Vec<(u32, u32, Observation)> = Vec::new();
        for (number, run) in (0u32..).zip(runs) {
            for observed in self.observations.read(run)? {
                let corrected = |light: [u8; 3]| {
                    let light = self.tones.corrected(run.photo, observed.r2, light.map(light_from_srgb_f32));
                    light.map(|light| light * self.brightness)
                };
                let observation = Observation {
                    weight: observed.weight,
                    full: corrected(observed.full),
                    low: corrected(observed.low),
                };
                all.push((observed.vertex, number, observation));
            }
        }
        all.sort_unstable_by_key(|(vertex, run, _)| (*vertex, *run));
        let mut bytes = vec![0; group.count as usize * BYTES];
        let mut photos: Vec<(u32, [f64; 2])> = runs.iter().map(|run| (run.photo, [0.0; 2])).collect();
        let (mut coloured, mut cells) = (0, Cells::default());
        let scans = self.scans(group)?;
        let places = self.vertices.of(group)?;
        let (mut seen, mut agreement) = (Vec::new(), Vec::new());
        for part in all.chunk_by(|a, b| a.0 == b.0) {
            seen.clear();
            seen.extend(part.iter().map(|(_, _, observation)| *observation));
            let Some(blended) = blend(&seen, &mut agreement) else { continue };
            coloured += 1;
            let vertex = part[0].0 as usize;
            let at = vertex * BYTES;
            bytes[at..at + 3].copy_from_slice(&blended.light.map(srgb_from_light_f32));
            bytes[at + 3..at + 5].copy_from_slice(&blended.photos.max(1).to_le_bytes());
            let whole: f32 = seen.iter().zip(&agreement).map(|(o, a)| o.weight * a).sum();
            for ((_, run, observation), agreement) in part.iter().zip(&agreement) {
                let [share, dropped] = &mut photos[*run as usize].1;
                *share += f64::from(observation.weight * agreement / whole);
                *dropped += f64::from(u8::from(*agreement == 0.0));
            }
            if let Some(scan) = scans.get(vertex) {
                let place = self.vertices.lattice.world_from_lattice(places[vertex].position);
                observe(&mut cells, place, blended.light, scan.map(light_from_srgb_f32));
            }
        }
        Ok(Painted { bytes, coloured, photos, cells })
    }

    /// The colours that the vertices of a group have in the pack; none if it has no colours.
    fn scans(&self, group: &Group) -> Result<Vec<[u8; 3]>, ScanError> {
        if !self.reader.header().attributes.colors {
            return Ok(Vec::new());
        }
        let chunk = self.reader.chunk(group.chunk).map_err(|source| ScanError::Model { source })?;
        let used = finest(&chunk.mesh, &chunk.patches);
        Ok(used.iter().map(|k| chunk.mesh.colors[*k as usize]).collect())
    }
}

impl Colouring {
    /// Give the vertices of a chunk that belong to the finest surface their colours, and all a further scalar: the number of photographs that each colour rests on,
    /// 0 where it is the scan's.
    ///
    /// # Errors
    /// [`ScanError::Scratch`] if the scratch file cannot be read.
    pub fn apply(&self, number: u32, chunk: &mut Chunk) -> Result<(), ScanError> {
        let mesh = &mut chunk.mesh;
        let count = mesh.positions.len();
        if mesh.colors.is_empty() {
            mesh.colors = vec![UNCOLOURED; count];
        }
        let mut photos = vec![0.0; count];
        if let Some(stretch) = self.stretches.get(&number) {
            let bytes = self.file.read(*stretch)?;
            for (k, painted) in finest(mesh, &chunk.patches).into_iter().zip(bytes.as_chunks::<BYTES>().0) {
                let k = k as usize;
                let [r, g, b, low, high] = *painted;
                let seen = u16::from_le_bytes([low, high]);
                photos[k] = f32::from(seen);
                mesh.colors[k] = if seen > 0 {
                    [r, g, b]
                } else {
                    let place = self.lattice.world_from_lattice(mesh.positions[k]);
                    let scan = mesh.colors[k].map(light_from_srgb_f32);
                    self.ratios.matched(place, scan).map(srgb_from_light_f32)
                };
            }
        }
        mesh.scalars.push(photos);
        Ok(())
    }
}

impl Repaint for Colouring {
    fn scalars(&self) -> Vec<String> {
        vec![PHOTOS.to_owned()]
    }

    fn repaint(&self, number: u32, chunk: &mut Chunk) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(self.apply(number, chunk)?)
    }
}
