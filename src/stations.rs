//! Stations of a survey as inputs of a build: each is meshed while it is read, or its points are handed on.

pub(crate) mod merged;
pub(crate) mod points;

use anyhow::bail;
use glam::{DVec3, Vec3};
use kilwa_builder::BuildError;
use kilwa_formats::UNCOLOURED;
use kilwa_formats::read::{MeshSink, ReadError, VertexBlock};
use kilwa_scan::ScanError;
use kilwa_scan::mask::{self, MaskReader};
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::{MeshDefaults, Station, Survey};
use kilwa_scan_core::{Pose, tessellate};
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Vertices or triangles handed on at a time.
const BLOCK: usize = 4096;

/// How a station is meshed and placed.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct StationInput {
    pose: Pose,
    options: Options,
    /// Masks that are on: their names and files. A mask that is made again gets another file.
    masks: Vec<(String, PathBuf)>,
}

/// What a survey says of meshing, for one of its stations.
pub(crate) fn options(defaults: MeshDefaults, station: &Station) -> Options {
    let common = tessellate::Options::default();
    Options {
        tessellate: tessellate::Options {
            edge_factor: defaults.edge_factor.unwrap_or(common.edge_factor),
            max_edge: defaults.max_edge.unwrap_or(common.max_edge),
            grazing: defaults.grazing.map_or(common.grazing, f64::to_radians),
            instrument: station.measures_with(),
        },
        subsample: defaults.subsample.unwrap_or(1),
        bounds: None,
    }
}

/// The stations of the survey in `folder`, by their spools, with the masks that are on, or `unmasked`; as `points`, also those without a grid.
pub(crate) fn of(folder: &Path, unmasked: bool, points: bool) -> anyhow::Result<Vec<(PathBuf, StationInput)>> {
    let survey = Survey::open(folder)?;
    if survey.stations.is_empty() {
        bail!("the survey {} has no stations; use `kilwa scans import`", folder.display());
    }
    let mut stations = Vec::with_capacity(survey.stations.len());
    for station in &survey.stations {
        let path = folder.join(&station.scan);
        // Also finds damaged masks before anything is built.
        if !mask::open(folder, station, unmasked)?.header().is_grid && !points {
            bail!(
                "station {} of {} is an unstructured point cloud and cannot be meshed; build the points with --points, or export the other stations with `kilwa scans export --mesh` and build those files",
                station.name,
                folder.display()
            );
        }
        // One station alone may stand anywhere; several without poses would be piled up.
        if station.pose.is_none() && survey.stations.len() > 1 {
            bail!(
                "station {} of {} has no pose; give it rotation and translation in survey.toml",
                station.name,
                folder.display()
            );
        }
        let pose = station.pose.unwrap_or_default();
        let masks = station.masks.iter().filter(|mask| mask.is_on && !unmasked);
        let masks = masks.map(|mask| (mask.name.clone(), folder.join(&mask.file))).collect::<Vec<_>>();
        if !masks.is_empty() {
            crate::scans::mask::warn_of_outdated(&survey, station);
        }
        stations.push((path, StationInput { pose, options: options(survey.mesh, station), masks }));
    }
    warn_of_same_poses(folder, &survey);
    Ok(stations)
}

/// Warn if stations have exactly the same pose.
pub(crate) fn warn_of_same_poses(folder: &Path, survey: &Survey) {
    if let Some(warning) = same_poses(&survey.stations) {
        crate::terminal::say!("kilwa: {}: {warning}", folder.display());
    }
}

/// A warning about stations with exactly the same pose, as unregistered scans have it: PTX files, and many E57 files, state the identity for them.
fn same_poses(stations: &[Station]) -> Option<String> {
    let mut poses: HashMap<[u64; 7], Vec<&Station>> = HashMap::new();
    for station in stations {
        let Some(Pose { rotation, translation }) = station.pose else { continue };
        let mut key = [0; 7];
        for (key, number) in key.iter_mut().zip(rotation.to_array().into_iter().chain(translation.to_array())) {
            // -0 is 0.
            *key = (number + 0.0).to_bits();
        }
        poses.entry(key).or_default().push(station);
    }
    let same = poses.into_values().max_by_key(Vec::len).filter(|same| same.len() > 1)?;
    let is_identity = same[0].pose == Some(Pose::IDENTITY);
    Some(format!(
        "{} stations ({}, {}{}) have the same pose{}; if these scans are not registered, their meshes lie on top of each other: put the poses into survey.toml",
        same.len(),
        same[0].name,
        same[1].name,
        if same.len() > 2 { ", …" } else { "" },
        if is_identity { ", the identity" } else { "" },
    ))
}

fn failed(e: ScanError) -> BuildError {
    match e {
        ScanError::Read(e) => BuildError::Read(e),
        other => BuildError::Inputs { why: other.to_string() },
    }
}

/// The samples of a station, with the masks that are on.
fn open(path: &Path, station: &StationInput) -> Result<Reader, BuildError> {
    let mut reader = Reader::open(path).map_err(failed)?;
    let masks = station.masks.iter().map(|(name, file)| MaskReader::open(file, name)).collect::<Result<_, _>>();
    masks.and_then(|masks| reader.set_masks(masks)).map_err(failed)?;
    Ok(reader)
}

/// Hand the mesh of a station on.
pub(crate) fn deliver(
    path: &Path,
    station: &StationInput,
    sink: &mut dyn MeshSink,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<(), BuildError> {
    let mut reader = open(path, station)?;
    let statistics = reader.header().statistics;
    let has_intensity = statistics.with_intensity > 0;
    let mut names = vec!["confidence".to_owned()];
    names.extend(has_intensity.then(|| "intensity".to_owned()));
    sink.channels(&names)?;
    let mut blocks = Blocks::new(sink, progress);
    blocks.scalars = vec![Vec::new(); names.len()];
    blocks.has_color = statistics.colored > 0;
    let done = mesh(&mut reader, station.pose, &station.options, &mut blocks).map(drop);
    if let Some(failure) = blocks.failure.take() {
        return Err(failure.into());
    }
    done.map_err(failed)?;
    Ok(blocks.flush()?)
}

/// Collects vertices and triangles in blocks.
struct Blocks<'a> {
    sink: &'a mut dyn MeshSink,
    progress: &'a mut dyn FnMut(u64, u64),
    count: u32,
    positions: Vec<DVec3>,
    normals: Vec<Vec3>,
    colors: Vec<[u8; 3]>,
    scalars: Vec<Vec<f32>>,
    triangles: Vec<[u64; 3]>,
    has_color: bool,
    /// An error of the sink, which a [`Surface`] cannot carry.
    failure: Option<ReadError>,
}

impl<'a> Blocks<'a> {
    fn new(sink: &'a mut dyn MeshSink, progress: &'a mut dyn FnMut(u64, u64)) -> Self {
        Self {
            sink,
            progress,
            count: 0,
            positions: Vec::new(),
            normals: Vec::new(),
            colors: Vec::new(),
            scalars: Vec::new(),
            triangles: Vec::new(),
            has_color: false,
            failure: None,
        }
    }

    /// Add a vertex with as many of the scalars as there are channels.
    fn push(&mut self, vertex: &MeshVertex, color: [u8; 3], scalars: &[f32]) -> Result<(), ScanError> {
        self.positions.push(vertex.position);
        self.normals.push(vertex.normal.as_vec3());
        if self.has_color {
            self.colors.push(color);
        }
        for (channel, value) in self.scalars.iter_mut().zip(scalars) {
            channel.push(*value);
        }
        self.flush_if_full()
    }

    fn flush(&mut self) -> Result<(), ReadError> {
        let Self { positions, colors, normals, scalars, .. } = self;
        self.sink.vertices(&VertexBlock { positions, colors, normals, scalars })?;
        self.sink.triangles(&self.triangles, &[])?;
        self.positions.clear();
        self.normals.clear();
        self.colors.clear();
        self.scalars.iter_mut().for_each(Vec::clear);
        self.triangles.clear();
        Ok(())
    }

    fn flush_if_full(&mut self) -> Result<(), ScanError> {
        if self.positions.len() < BLOCK && self.triangles.len() < BLOCK {
            return Ok(());
        }
        self.flush().map_err(|e| {
            self.failure = Some(e);
            ScanError::Stopped
        })
    }
}

impl Surface for Blocks<'_> {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        let intensity = if vertex.intensity.is_nan() { 0.0 } else { vertex.intensity };
        self.push(vertex, vertex.color.unwrap_or(UNCOLOURED), &[vertex.confidence, intensity])?;
        self.count += 1;
        Ok(self.count - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        self.triangles.push(corners.map(u64::from));
        self.flush_if_full()
    }

    fn progress(&mut self, done: u64, total: u64) -> Result<(), ScanError> {
        (self.progress)(done, total);
        Ok(())
    }
}
