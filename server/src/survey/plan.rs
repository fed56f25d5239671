//! The plan of a survey: which part of the ground it shows, what is where in the drawing, and the samples seen from above as its background.
//!
//! The drawing has units of its own, [`LONGER`] along its longer side, x to the right and y up as in the survey.

use super::pictures::Drawn;
use super::{Facts, Surveyed};
use glam::{DVec2, DVec3};
use kilwa_scan::survey::{Station, Survey};
use kilwa_scan::top_view::{self, TopView};
use kilwa_scan_core::Pose;
use std::collections::BTreeSet;
use std::sync::{Arc, PoisonError};

/// Units of the drawing along its longer side.
pub(crate) const LONGER: f64 = 720.0;
/// Pixels of the background along its longer side, at least and at most: so few that there are samples for them.
const PIXELS: [f64; 2] = [300.0, 1200.0];
/// Samples that are read for the background; of larger surveys every so many lines.
const SAMPLES_MAX: u64 = 256_000_000;
/// Margin around everything, and the smallest plan: parts of the longer side, and metres.
const MARGIN: f64 = 0.05;
const SMALLEST: f64 = 4.0;
/// The shorter side is at least this part of the longer one.
const SLIMMEST: f64 = 0.4;
/// Text of the drawing, in its units: on a phone, where the drawing is small, and on larger screens. As in server/assets/survey.css.
const TEXTS: [f64; 2] = [28.0, 15.0];
/// Radius of a station with its outline, in units.
const DOT: f64 = 9.0;

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
    let place = |control: &kilwa_scan::survey::Control| match &control.station {
        None => Some(control.at),
        Some(name) => {
            let station = survey.stations.iter().find(|station| station.name == *name)?;
            Some(station.pose?.apply(control.at))
        }
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

/// The rectangle around points, with a margin and of a form that can be shown.
fn around(points: &[DVec2]) -> Option<[DVec2; 2]> {
    let min = points.iter().copied().reduce(DVec2::min)?;
    let max = points.iter().copied().reduce(DVec2::max)?;
    let middle = (min + max) / 2.0;
    let span = max - min;
    let span = span + 2.0 * MARGIN * span.max_element();
    let longer = span.max_element();
    let least = if longer < SMALLEST { SMALLEST } else { longer * SLIMMEST };
    let half = span.max(DVec2::splat(least)) / 2.0;
    let is_sound = middle.is_finite() && half.is_finite();
    is_sound.then_some([middle - half, middle + half])
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

/// A name beside its mark.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Label {
    pub(crate) x: String,
    pub(crate) y: String,
    pub(crate) anchor: &'static str,
    /// Whether it has room on large screens only.
    pub(crate) is_for_large: bool,
}

/// A bar of a round length.
pub(crate) struct ScaleBar {
    /// Units.
    pub(crate) length: f64,
    pub(crate) metres: f64,
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

    fn at(&self, point: DVec3) -> [f64; 2] {
        let at = (point.truncate() - self.min) * self.scale();
        [at.x, self.size()[1] - at.y]
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
            let end = placed.get::<usize>(k).map(|(_, pose)| {
                let ahead = (pose.rotation * DVec3::X).truncate().normalize_or_zero() * 2.6 * DOT;
                [text(x + ahead.x), text(y - ahead.y)]
            });
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

fn text(number: f64) -> String {
    format!("{number:.1}")
}

/// The longest bar of 1, 2 or 5 times a power of ten metres that is at most a third of the drawing.
fn bar(metres: f64, scale: f64) -> ScaleBar {
    let longest = metres / 3.0;
    let power = 10_f64.powf(longest.log10().floor());
    let metres = [5.0, 2.0, 1.0].map(|k| k * power).into_iter().find(|length| *length <= longest).unwrap_or(power);
    ScaleBar { length: metres * scale, metres }
}

/// Azimuth of the scanner's x axis, clockwise from the survey's y axis, degrees from 0 to 360.
pub(crate) fn heading(pose: Pose) -> f64 {
    let ahead = pose.rotation * DVec3::X;
    ahead.x.atan2(ahead.y).to_degrees().rem_euclid(360.0)
}

/// Where names have room: beside their marks, without overlapping each other, other marks, or the scale bar. The first ones have precedence.
fn labels(marks: &[(&str, [f64; 2])], [width, height]: [f64; 2], bar: f64) -> Vec<Option<Label>> {
    type Box = [f64; 4];
    let meets = |a: &Box, b: &Box| a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];
    let mut taken: Vec<Box> = marks.iter().map(|(_, [x, y])| [x - DOT, y - DOT, x + DOT, y + DOT]).collect();
    taken.push([0.0, height - 52.0, bar + 40.0, height]);
    taken.push([width - 76.0, 0.0, width, 84.0]);
    let mut taken = [taken.clone(), taken];
    let place = |name: &str, [x, y]: [f64; 2], size: f64| {
        let (long, high) = (name.chars().count() as f64 * 0.68 * size, 1.1 * size);
        let gap = DOT + 4.0;
        let beside = |x0: f64, y: f64| [x0, y - high / 2.0, x0 + long, y + high / 2.0];
        let (above, below) = (y - gap - high / 2.0, y + gap + high / 2.0);
        [
            (beside(x + gap, y), [x + gap, y], "start"),
            (beside(x - gap - long, y), [x - gap, y], "end"),
            (beside(x - long / 2.0, above), [x, above], "middle"),
            (beside(x - long / 2.0, below), [x, below], "middle"),
        ]
    };
    let mut find = |name: &str, at: [f64; 2]| {
        for (k, size) in TEXTS.into_iter().enumerate() {
            for (own, [x, y], anchor) in place(name, at, size) {
                let is_inside = own[0] >= 0.0 && own[1] >= 0.0 && own[2] <= width && own[3] <= height;
                if is_inside && !taken[k].iter().any(|other| meets(other, &own)) {
                    taken[k].push(own);
                    if k == 0 {
                        // On a large screen the same name is smaller.
                        let small = place(name, at, TEXTS[1]);
                        taken[1].extend(small.into_iter().find(|(.., other)| *other == anchor).map(|(own, ..)| own));
                    }
                    return Some(Label { x: text(x), y: text(y), anchor, is_for_large: k == 1 });
                }
            }
        }
        None
    };
    marks.iter().map(|(name, at)| find(name, *at)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn the_plan_is_never_a_line_or_a_point() {
        let [min, max] = around(&[DVec2::new(500_000.0, 9_000_000.0)]).unwrap();
        assert!((max - min - SMALLEST).abs().max_element() < 1e-6);
        let [min, max] = around(&[DVec2::ZERO, DVec2::new(100.0, 0.0)]).unwrap();
        assert!(((max - min).x - 110.0).abs() < 1e-9 && (max - min).y >= 110.0 * SLIMMEST - 1e-9);
        assert_eq!(around(&[]), None);
        assert_eq!(around(&[DVec2::NAN]), None);
    }

    #[test]
    fn a_heading_is_clockwise_from_the_y_axis() {
        let turned =
            |degrees: f64| Pose { rotation: DQuat::from_rotation_z(degrees.to_radians()), translation: DVec3::ZERO };
        for (turn, azimuth) in [(0.0, 90.0), (90.0, 0.0), (180.0, 270.0), (-90.0, 180.0)] {
            let found = heading(turned(turn));
            assert!((found - azimuth).abs() < 1e-9 || (found - azimuth - 360.0).abs() < 1e-9, "{turn}: {found}");
        }
    }

    #[test]
    fn the_scale_bar_is_round_and_at_most_a_third() {
        for metres in [0.7, 4.0, 31.0, 100.0, 2600.0] {
            let bar = bar(metres, 10.0);
            assert!(bar.metres <= metres / 3.0 && bar.metres > metres / 3.0 / 2.6, "{metres}: {}", bar.metres);
        }
    }

    #[test]
    fn names_do_not_overlap_and_those_without_room_are_left_out() {
        let marks: Vec<(String, [f64; 2])> = (0..60)
            .map(|k| (format!("station_{k:03}"), [60.0 + f64::from(k % 8) * 80.0, 60.0 + f64::from(k / 8) * 60.0]))
            .collect();
        let named: Vec<(&str, [f64; 2])> = marks.iter().map(|(name, at)| (name.as_str(), *at)).collect();
        let found = labels(&named, [720.0, 540.0], 100.0);
        let large: Vec<_> = found.iter().flatten().filter(|label| !label.is_for_large).collect();
        let count = found.iter().flatten().count();
        assert!(large.len() > 3 && count > large.len() + 5 && count <= 60, "{} of {count}", large.len());
        assert!(labels(&[("a", [5.0, 5.0])], [10.0, 10.0], 1.0)[0].is_none());
    }
}
