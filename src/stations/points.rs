//! The points of stations as inputs of a build.

use super::{StationInput, failed, open};
use crate::inputs::Inputs;
use glam::{DVec3, Vec3};
use kilwa_builder::BuildError;
use kilwa_builder::build::work::Work;
use kilwa_builder::points::{Point, PointInputs, PointSink};
use kilwa_formats::UNCOLOURED;
use kilwa_formats::read::Placement;
use kilwa_pack::metadata::SourceFile;
use kilwa_scan::ScanError;
use kilwa_scan::points::points;
use kilwa_scan::spool::Reader;
use std::path::Path;

/// The points of all stations of some inputs, which are surveys.
pub(crate) struct StationPoints<'a>(pub(crate) &'a Inputs);

impl StationPoints<'_> {
    fn stations(&self) -> impl Iterator<Item = (&Path, &StationInput, &Placement)> {
        self.0.files.iter().filter_map(|file| Some((file.path.as_path(), file.station.as_ref()?, &file.placement)))
    }
}

impl PointInputs for StationPoints<'_> {
    fn bounds(&self) -> Result<[DVec3; 2], BuildError> {
        let mut all = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for (path, station, placement) in self.stations() {
            let statistics = Reader::open(path).map_err(failed)?.header().statistics;
            if statistics.measured == 0 {
                continue;
            }
            let corners = statistics.bounds.map(|p: Vec3| p.as_dvec3());
            for k in 0..8 {
                let corner = DVec3::new(corners[k & 1].x, corners[k >> 1 & 1].y, corners[k >> 2].z);
                let p = placement.place(station.pose.apply(corner));
                all = [all[0].min(p), all[1].max(p)];
            }
        }
        if all[0].cmple(all[1]).all() {
            return Ok(all);
        }
        Err(BuildError::Inputs { why: "no station has measured points".to_owned() })
    }

    fn attributes(&self) -> (bool, bool) {
        let mut any = (false, false);
        for (path, ..) in self.stations() {
            // One that cannot be opened is reported when it is read.
            if let Ok(reader) = Reader::open(path) {
                let statistics = reader.header().statistics;
                any = (any.0 || statistics.colored > 0, any.1 || statistics.with_intensity > 0);
            }
        }
        any
    }

    fn deliver(&mut self, sink: &mut PointSink<'_>, work: &Work<'_>) -> Result<Vec<SourceFile>, BuildError> {
        let cells = |path: &Path| Reader::open(path).map_or(0, |reader| reader.header().grid.cells());
        let total: u64 = self.stations().map(|(path, ..)| cells(path)).sum();
        let mut before = 0;
        let mut block = Vec::new();
        for (path, station, placement) in self.stations() {
            let mut reader = open(path, station)?;
            let all = reader.header().grid.cells();
            let scale = placement.scale() as f32;
            let mut failure = None;
            let done = points(&mut reader, station.pose, &station.options.tessellate, &mut |some, done, of| {
                block.clear();
                block.extend(some.iter().map(|p| Point {
                    position: placement.place(p.position),
                    normal: placement.turn(p.normal).as_vec3(),
                    spacing: p.spacing as f32 * scale,
                    color: p.color.unwrap_or(UNCOLOURED),
                    intensity: p.intensity,
                }));
                let share = (done as f64 / of.max(1) as f64 * all as f64) as u64;
                work.progress.update("reading", before + share, total.max(before + share));
                sink(&block).map_err(|e| {
                    failure = Some(e);
                    ScanError::Stopped
                })
            });
            if let Some(failure) = failure {
                return Err(failure);
            }
            done.map_err(failed)?;
            before += all;
        }
        self.0.sources(work.progress, work.stop)
    }
}
