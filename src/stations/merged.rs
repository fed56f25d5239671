//! The merged surface of a survey as the input of a build.

use super::{Blocks, failed};
use crate::merge::channels::Channels;
use crate::merge::{accuracy, holes};
use kilwa_builder::build::work::Work;
use kilwa_builder::{BuildError, Capture};
use kilwa_formats::UNCOLOURED;
use kilwa_formats::read::{MeshSink, ReadError};
use kilwa_pack::plural::counted;
use kilwa_scan::ScanError;
use kilwa_scan::merge::{Begin, MergedSurface, MergedVertex, Options, Report, merge};
use kilwa_scan::survey::Survey;
use kilwa_scan::{import, register};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// Which survey is merged, and how.
#[derive(Debug, Clone)]
pub(crate) struct Merging {
    /// The folder of the survey.
    pub(crate) folder: PathBuf,
    /// The survey as it was read.
    pub(crate) survey: Survey,
    /// Memory, threads and scratch folder are those of the build.
    pub(crate) options: Options,
    /// What was merged, once it is.
    pub(crate) report: Arc<Mutex<Option<Report>>>,
}

impl Merging {
    /// The options that affect the surface, in one line, to check that a resumed build is the same.
    pub(crate) fn plan(&self) -> String {
        let Options { voxel, unmasked, bounds, fill, intensity, memory: _, threads: _, scratch: _ } = &self.options;
        // Another mesh under the same name is another merge.
        let mesh = fill.mesh.as_ref().and_then(|path| path.metadata().ok()).map(|m| (m.len(), m.modified().ok()));
        format!("merged {voxel:?} {unmasked} {bounds:?} {fill:?} {mesh:?} {intensity:?}{}", self.sigmas())
    }

    /// A fingerprint of the pose uncertainties; empty if there are none.
    fn sigmas(&self) -> String {
        let registration = std::fs::read(self.folder.join(register::FILE)).ok();
        let stated: Vec<Option<[f64; 2]>> = self.survey.stations.iter().map(|station| station.sigma).collect();
        if registration.is_none() && stated.iter().all(Option::is_none) {
            return String::new();
        }
        let all = [registration.unwrap_or_default(), format!("{stated:?}").into_bytes()].concat();
        format!(" poses {:?}", kilwa_pack::checksum(&all))
    }

    /// The figures of the merge for machines, once it is done.
    pub(crate) fn figures(&self) -> Option<serde_json::Value> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner).as_ref().map(crate::merge::figures)
    }

    /// Pass the merged surface to the build. Returns the accuracy of the capture, if it can be computed from the survey.
    pub(crate) fn deliver(&self, sink: &mut dyn MeshSink, work: &Work<'_>) -> Result<Option<Capture>, BuildError> {
        let survey = &self.survey;
        let options = Options {
            memory: work.memory,
            threads: work.threads,
            scratch: work.scratch.folder().to_owned(),
            ..self.options.clone()
        };
        let options_of = |station: &_| super::options(survey.mesh, station);
        let mut ignored = |_, _| ();
        let mut merged =
            Merged { blocks: Blocks::new(sink, &mut ignored), failure: None, channels: Channels::default() };
        let done = merge(&self.folder, survey, &options, &options_of, &mut merged, &Shown(work));
        if let Some(failure) = merged.failure.take().or(merged.blocks.failure.take()) {
            return Err(failure.into());
        }
        match done {
            Err(ScanError::Stopped) => Err(BuildError::Stopped),
            other => {
                let report = other.map_err(failed)?;
                work.progress.note(&format!(
                    "{} merged, voxel size {} m; {}",
                    counted(report.stations, "station", "stations"),
                    report.voxel,
                    holes::sentence(&report.borders)
                ));
                if let Some(filled) = &report.filled {
                    work.progress.note(&holes::filled_sentence(filled));
                }
                if let Some(sentence) = crate::merge::intensities(report.light) {
                    work.progress.note(&sentence);
                }
                if let Some(sentence) = accuracy::sentence(&report.accuracy) {
                    work.progress.note(&sentence);
                }
                let capture = accuracy::capture(&report.accuracy);
                *self.report.lock().unwrap_or_else(PoisonError::into_inner) = Some(report);
                merged.blocks.flush()?;
                Ok(capture)
            }
        }
    }
}

/// The share of a build that merging takes, about.
const MERGED: f64 = 0.35;

struct Shown<'w>(&'w Work<'w>);

impl import::Progress for Shown<'_> {
    fn update(&self, stage: &'static str, done: u64, total: u64) {
        self.0.progress.update(stage, done, total);
        if let Some(share) = crate::merge::share(stage, done, total) {
            self.0.progress.whole(MERGED * share);
        }
    }

    fn is_stopped(&self) -> bool {
        self.0.stop.asked()
    }
}

struct Merged<'a> {
    blocks: Blocks<'a>,
    failure: Option<ReadError>,
    channels: Channels,
}

impl MergedSurface for Merged<'_> {
    fn begin(&mut self, begin: &Begin) -> Result<(), ScanError> {
        self.channels = Channels::of(begin);
        let names = self.channels.names();
        self.blocks.has_color = begin.attributes[0];
        self.blocks.scalars = vec![Vec::new(); names.len()];
        self.blocks.sink.channels(&names).map_err(|e| {
            self.failure = Some(e);
            ScanError::Stopped
        })
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        let color = vertex.vertex.color.unwrap_or(UNCOLOURED);
        self.blocks.push(&vertex.vertex, color, &self.channels.values(vertex))
    }

    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError> {
        self.blocks.triangles.push(corners);
        self.blocks.flush_if_full()
    }
}
