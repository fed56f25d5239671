//! Calculates one colour for each vertex, chunk by chunk, and applies the colours to the surface.

use super::observe::{Observations, Run};
use super::subdivide::Subdivision;
use super::unseen::{CellSums, Ratios, observe};
use super::vertices::{Group, Vertices, finest};
use super::{Report, remedy};
use crate::ScanError;
use crate::import::Progress;
use crate::scratch::{ByteRange, ScratchFile};
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

/// The scalar with the number of photographs that a colour is based on.
pub const PHOTOS: &str = "photos";

/// Bytes of a vertex: its colour, and the number of photographs.
const BYTES: usize = 5;
/// Groups at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;

/// The colours of a model.
pub struct Colouring {
    lattice: Lattice,
    ranges: HashMap<u32, ByteRange>,
    file: ScratchFile,
    ratios: Ratios,
    /// How triangles are split first, if they are.
    pub(super) subdivision: Option<Subdivision>,
    /// The number of the scalar that the model has already, if it was coloured before.
    channel: Option<usize>,
}

/// The colours of a group.
struct Painted {
    bytes: Vec<u8>,
    coloured: u64,
    /// For each photograph its share of the colours, and how often it was dropped.
    photos: Vec<(u32, [f64; 2])>,
    cells: CellSums,
}

/// The input of the last stage.
pub(super) struct Painter<'a, S> {
    pub(super) reader: &'a Reader<S>,
    pub(super) vertices: &'a Vertices,
    pub(super) observations: &'a Observations,
    pub(super) tones: &'a Tones,
    /// What light is multiplied by.
    pub(super) brightness: f32,
}

impl<S: Source + Sync> Painter<'_, S> {
    /// Blend the observations of all groups; `runs` are sorted by group.
    pub(super) fn paint(
        &self,
        runs: &[Run],
        scratch: &Path,
        report: &mut Report,
        progress: &(dyn Progress + Sync),
    ) -> Result<Colouring, ScanError> {
        let file = ScratchFile::create(scratch, remedy(self.vertices.subdivision.is_some()))?;
        let lattice = self.vertices.lattice;
        let channel = self.reader.metadata().scalars.iter().position(|scalar| scalar.name == PHOTOS);
        let mut colouring =
            Colouring { lattice, ranges: HashMap::new(), file, ratios: Ratios::default(), subdivision: None, channel };
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
                colouring.ranges.insert(group.chunk, colouring.file.append(&painted.bytes)?);
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
        let (mut coloured, mut cells) = (0, CellSums::default());
        let original_colors = self.original_colors(group)?;
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
            let total: f32 = seen.iter().zip(&agreement).map(|(o, a)| o.weight * a).sum();
            for ((_, run, observation), agreement) in part.iter().zip(&agreement) {
                let [share, dropped] = &mut photos[*run as usize].1;
                *share += f64::from(observation.weight * agreement / total);
                *dropped += f64::from(u8::from(*agreement == 0.0));
            }
            if let Some(original) = original_colors.get(vertex) {
                let place = self.vertices.lattice.world_from_lattice(places[vertex].position);
                observe(&mut cells, place, blended.light, original.map(light_from_srgb_f32));
            }
        }
        Ok(Painted { bytes, coloured, photos, cells })
    }

    /// The colours that the vertices of a group have in the pack; none if it has no colours.
    fn original_colors(&self, group: &Group) -> Result<Vec<[u8; 3]>, ScanError> {
        if !self.reader.header().attributes.colors {
            return Ok(Vec::new());
        }
        let mut chunk = self.reader.chunk(group.chunk).map_err(|source| ScanError::Model { source })?;
        if let Some(subdivision) = &self.vertices.subdivision {
            subdivision.apply(&mut chunk)?;
        }
        let used = finest(&chunk.mesh, &chunk.patches);
        Ok(used.iter().map(|k| chunk.mesh.colors[*k as usize]).collect())
    }
}

impl Colouring {
    /// Split the triangles of the finest surface in a chunk if that was asked for, colour its vertices, and give all vertices of the chunk an additional scalar: the number of photographs that each colour is based on,
    /// 0 where the vertex keeps its own colour.
    ///
    /// # Errors
    /// [`ScanError::Scratch`] if the scratch file cannot be read; [`ScanError::Request`] if splitting makes too many triangles.
    pub fn apply(&self, number: u32, chunk: &mut Chunk) -> Result<(), ScanError> {
        if let Some(subdivision) = &self.subdivision {
            subdivision.apply(chunk)?;
        }
        let mesh = &mut chunk.mesh;
        let count = mesh.positions.len();
        if mesh.colors.is_empty() {
            mesh.colors = vec![UNCOLOURED; count];
        }
        let mut photos = vec![0.0; count];
        if let Some(range) = self.ranges.get(&number) {
            let bytes = self.file.read(*range)?;
            for (k, painted) in finest(mesh, &chunk.patches).into_iter().zip(bytes.as_chunks::<BYTES>().0) {
                let k = k as usize;
                let [r, g, b, low, high] = *painted;
                let seen = u16::from_le_bytes([low, high]);
                photos[k] = f32::from(seen);
                mesh.colors[k] = if seen > 0 {
                    [r, g, b]
                } else {
                    let place = self.lattice.world_from_lattice(mesh.positions[k]);
                    let original = mesh.colors[k].map(light_from_srgb_f32);
                    self.ratios.matched(place, original).map(srgb_from_light_f32)
                };
            }
        }
        match self.channel.and_then(|channel| mesh.scalars.get_mut(channel)) {
            Some(channel) => *channel = photos,
            None => mesh.scalars.push(photos),
        }
        Ok(())
    }
}

impl Repaint for Colouring {
    fn scalars(&self) -> Vec<String> {
        if self.channel.is_some() { Vec::new() } else { vec![PHOTOS.to_owned()] }
    }

    fn repaint(&self, number: u32, chunk: &mut Chunk) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(self.apply(number, chunk)?)
    }
}
