//! The plan of a survey: which part of the ground it shows, what is where in the drawing, and the samples seen from above as its background.
//!
//! Its units and label placement are those of [`kilwa_scan::plan`].

use super::pictures::Drawn;
use super::{Facts, Surveyed};
use glam::{DVec2, DVec3};
use kilwa_scan::plan::{DOT, LONGER, Label, ScaleBar, around, bar, labels, text};
use kilwa_scan::survey::{Station, Survey};
use kilwa_scan::top_view::{self, TopView};
use kilwa_scan_core::Pose;
use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, PoisonError};

/// Pixels of the background along its longer side, at least and at most: so few that there are samples for them.
const PIXELS: [f64; 2] = [300.0, 1200.0];
/// Samples that are read for the background; of larger surveys every so many lines.
const SAMPLES_MAX: u64 = 256_000_000;
/// Which part of the ground is shown: metres in the survey.
#[derive(Debug)]
pub(crate) struct Plan {
    /// Differs where anything that the plan shows differs.
    pub(crate) key: String,
    min: DVec2,
    max: DVec2,
}

/// A station and what is known of it.
pub(crate) type Known<'a> = (&'a Station, &'a Arc<Facts>);

/// A control point with a place in the survey.
pub(crate) struct Control<'a> {
    pub(crate) name: &'a str,
    pub(crate) at: DVec3,
}

/// The control points whose places in the survey are known, each once.
pub(crate) fn controls(survey: &Survey) -> Vec<Control<'_>> {
    let mut names = BTreeSet::new();
    let poses: HashMap<&str, Option<Pose>> =
        survey.stations.iter().map(|station| (station.name.as_str(), station.pose)).collect();
    let place = |control: &kilwa_scan::survey::Control| match &control.station {
        None => Some(control.at),
        Some(name) => Some((*poses.get(name.as_str())?)?.apply(control.at)),
    };
    // Coordinates of the survey before those that depend on a pose.
    let mut all: Vec<_> = survey.controls.iter().collect();
    all.sort_by_key(|control| control.station.is_some());
    let placed = all.into_iter().filter_map(|control| Some(Control { name: &control.name, at: place(control)? }));
    placed.filter(|control| names.insert(control.name)).collect()
}

/// Places of the photographs that have one.
fn photographs(survey: &Survey) -> impl Iterator<Item = DVec3> {
    survey.photographs.iter().filter_map(|photograph| Some(photograph.pose?.translation))
}

impl Surveyed {
    /// The plan; `None` where nothing has a place.
    pub(crate) fn plan(&self, survey: &Survey, stations: &[Known<'_>]) -> Option<Arc<Plan>> {
        let mut hash = blake3::Hasher::new();
        let mut points: Vec<DVec2> = Vec::new();
        for (station, facts) in stations {
            let Some(pose) = station.pose else { continue };
            hash.update(facts.identity.as_bytes());
            for number in pose.rotation.to_array().into_iter().chain(pose.translation.to_array()) {
                hash.update(&number.to_le_bytes());
            }
            points.push(pose.translation.truncate());
        }
        let others = controls(survey).into_iter().map(|control| control.at).chain(photographs(survey));
        for at in others {
            hash.update(b"point");
            for number in at.to_array() {
                hash.update(&number.to_le_bytes());
            }
            points.push(at.truncate());
        }
        let key = hash.finalize().to_hex()[..32].to_owned();
        // Held while samples are read: who asks meanwhile needs the same.
        let mut kept = self.plan.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(plan) = kept.as_ref().filter(|plan| plan.key == key) {
            return Some(Arc::clone(plan));
        }
        for (station, facts) in stations {
            let Some(pose) = station.pose.filter(|_| facts.trouble().is_none()) else { continue };
            match self.reader(station, false).and_then(|mut reader| top_view::extent(&mut reader, pose)) {
                Ok(extent) => points.extend(extent.into_iter().flatten()),
                Err(e) => drop(self.fault(facts, &e)),
            }
        }
        let [min, max] = around(&points)?;
        let plan = Arc::new(Plan { key, min, max });
        *kept = Some(Arc::clone(&plan));
        Some(plan)
    }

    /// The samples of all stations with a pose, seen from above.
    pub(crate) fn draw_plan(&self, plan: &Plan, stations: &[Known<'_>]) -> Result<Drawn, String> {
        let placed = stations.iter().filter_map(|(station, facts)| {
            let header = facts.header.as_ref().ok()?;
            Some((station, facts, station.pose?, header.grid.cells()))
        });
        let total: u64 = placed.clone().map(|(.., cells)| cells).sum();
        let every = total.div_ceil(SAMPLES_MAX);
        let pixels = (total as f64).sqrt().clamp(PIXELS[0], PIXELS[1]) as u32;
        let mut view = TopView::new(plan.min, plan.max, pixels);
        for (station, facts, pose, _) in placed {
            let added = self.reader(station, false).and_then(|mut reader| view.add(&mut reader, pose, every));
            if let Err(e) = added {
                self.fault(facts, &e);
            }
        }
        let mut png = Vec::new();
        view.write_png(&mut png).map_err(|e| e.to_string())?;
        Ok(Drawn { png: png.into(), size: view.size(), frame: None })
    }
}

/// A thing of the drawing with its name.
pub(crate) struct Mark<'a> {
    pub(crate) name: &'a str,
    pub(crate) x: String,
    pub(crate) y: String,
    /// Of a station: the end of the line that shows its heading.
    pub(crate) end: Option<[String; 2]>,
    /// Where its name has room.
    pub(crate) label: Option<Label>,
}

/// What is where.
pub(crate) struct Drawing<'a> {
    pub(crate) size: [f64; 2],
    pub(crate) stations: Vec<Mark<'a>>,
    pub(crate) controls: Vec<Mark<'a>>,
    pub(crate) photographs: Vec<[String; 2]>,
    pub(crate) bar: ScaleBar,
}

impl Plan {
    fn scale(&self) -> f64 {
        LONGER / (self.max - self.min).max_element()
    }

    fn size(&self) -> [f64; 2] {
        ((self.max - self.min) * self.scale()).to_array()
    }

    /// Where a place of the survey is in the drawing.
    pub(crate) fn at(&self, point: DVec3) -> [f64; 2] {
        let at = (point.truncate() - self.min) * self.scale();
        [at.x, self.size()[1] - at.y]
    }

    /// Whether a place of the drawing is on it.
    pub(crate) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let [width, height] = self.size();
        (0.0..=width).contains(&x) && (0.0..=height).contains(&y)
    }

    /// The end of the line that shows the heading of a station, in the drawing.
    pub(crate) fn ahead(&self, pose: Pose) -> [f64; 2] {
        let [x, y] = self.at(pose.translation);
        let ahead = (pose.rotation * DVec3::X).truncate().normalize_or_zero() * 2.6 * DOT;
        [x + ahead.x, y - ahead.y]
    }

    /// What is where of a survey.
    pub(crate) fn drawing<'a>(&self, survey: &'a Survey) -> Drawing<'a> {
        let placed = survey.stations.iter().filter_map(|station| Some((station.name.as_str(), station.pose?)));
        let placed: Vec<(&str, Pose)> = placed.collect();
        let controls = controls(survey);
        let stations = placed.iter().map(|(name, pose)| (*name, self.at(pose.translation)));
        let named: Vec<_> =
            stations.chain(controls.iter().map(|control| (control.name, self.at(control.at)))).collect();
        let size = self.size();
        let bar = bar((self.max - self.min).x, self.scale());
        let mut labels = labels(&named, size, bar.length).into_iter();
        let mut marks = named.iter().zip(0..).map(|((name, [x, y]), k)| {
            let end = placed.get::<usize>(k).map(|(_, pose)| self.ahead(*pose).map(text));
            Mark { name, x: text(*x), y: text(*y), end, label: labels.next().flatten() }
        });
        Drawing {
            size,
            stations: marks.by_ref().take(placed.len()).collect(),
            controls: marks.collect(),
            photographs: photographs(survey).map(|at| self.at(at).map(text)).collect(),
            bar,
        }
    }
}

/// Azimuth of the scanner's x axis, clockwise from the survey's y axis, degrees from 0 to 360.
pub(crate) fn heading(pose: Pose) -> f64 {
    let ahead = pose.rotation * DVec3::X;
    ahead.x.atan2(ahead.y).to_degrees().rem_euclid(360.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_heading_is_clockwise_from_the_y_axis() {
        let turned =
            |degrees: f64| Pose { rotation: DQuat::from_rotation_z(degrees.to_radians()), translation: DVec3::ZERO };
        for (turn, azimuth) in [(0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0)] {
            let found = heading(turned(turn));
            assert!((found - azimuth).abs() < 1e-9 || (found - azimuth - 360.0).abs() < 1e-9, "{turn}: {found}");
        }
    }
}
