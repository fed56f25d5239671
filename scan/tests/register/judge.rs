//! Compares a registration with the ground truth, aligned at the anchor or the first fixed station by composing poses.

use glam::{DMat3, DQuat, DVec3};
use kilwa_scan::register::{Placed, Placement, Registration};
use kilwa_scan_core::Pose;
use std::fmt::Write as _;

/// A pose is wrong if its error exceeds these: metres, degrees.
const WRONG: [f64; 2] = [0.05, 0.5];
/// A stated standard deviation is too small if the error of a coordinate is more than this many times as large.
const DEVIATIONS: f64 = 2.5;

/// True poses by name, in any frame.
#[derive(Debug, Clone, Default)]
pub(super) struct Truth(pub(super) Vec<(String, Pose)>);

/// The pose error of a station.
#[derive(Debug, Clone)]
pub(super) struct Off {
    pub(super) name: String,
    /// Rotation about the axes of the survey through the station, degrees, and translation, metres.
    pub(super) rotation: DVec3,
    pub(super) translation: DVec3,
}

impl Off {
    fn is_more_than(&self, [metres, degrees]: [f64; 2]) -> bool {
        // NaN counts as more.
        !(self.translation.length() <= metres && self.rotation.length() <= degrees)
    }
}

/// The rotation vector of a quaternion, degrees.
pub(super) fn rotation_vector(turn: DQuat) -> DVec3 {
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let sine = turn.xyz().length();
    let angle = 2.0 * sine.atan2(turn.w);
    if sine > 1e-12 { turn.xyz() * (angle / sine).to_degrees() } else { turn.xyz() * 2_f64.to_degrees() }
}

impl Truth {
    pub(super) fn pose(&self, name: &str) -> Pose {
        let found = self.0.iter().find(|(own, _)| own == name);
        found.unwrap_or_else(|| panic!("there is no station {name}")).1
    }

    /// In the format of `kilwa synth scans`.
    pub(super) fn to_toml(&self) -> String {
        let mut text = String::new();
        for (name, Pose { rotation, translation }) in &self.0 {
            let m = DMat3::from_quat(*rotation);
            let rows = [0, 1, 2].map(|k| m.row(k).to_array());
            let position = translation.to_array();
            writeln!(text, "[[station]]\nname = \"{name}\"\nposition = {position:?}\nrotation = {rows:?}").unwrap();
        }
        text
    }

    /// The transformation from the true frame to that of the registration: at the anchor, or the first fixed station.
    pub(super) fn frame(&self, found: &Registration) -> Option<Pose> {
        let is = |placement: Placement| found.stations.iter().find(move |placed| placed.placement == placement);
        let base = is(Placement::Anchor).or_else(|| is(Placement::Fixed)).or_else(|| found.stations.first())?;
        Some(self.pose(&base.name).inverse().then(base.pose()))
    }

    /// The errors of all placed stations, largest first.
    pub(super) fn off(&self, found: &Registration) -> Vec<Off> {
        let Some(frame) = self.frame(found) else { return Vec::new() };
        let off = |placed: &Placed| {
            let expected = self.pose(&placed.name).then(frame);
            let turn = placed.pose().rotation * expected.rotation.inverse();
            Off {
                name: placed.name.clone(),
                rotation: rotation_vector(turn),
                translation: placed.pose().translation - expected.translation,
            }
        };
        let mut all: Vec<Off> = found.stations.iter().map(off).collect();
        all.sort_by(|a, b| b.translation.length().total_cmp(&a.translation.length()));
        all
    }

    /// The whole result, for a message.
    pub(super) fn table(&self, found: &Registration) -> String {
        let mut text = String::new();
        for Off { name, rotation, translation } in self.off(found) {
            let along = self.frame(found).unwrap().rotation.inverse() * translation * 1e3;
            let placed = found.stations.iter().find(|placed| placed.name == name).unwrap();
            let [metres, radians] = placed.sigma();
            writeln!(
                text,
                "{name:12} {:?}: {:.2} mm {:.4}° off; stated {:.2} mm {:.4}°; in the scene {along:.1} mm off",
                placed.placement,
                translation.length() * 1e3,
                rotation.length(),
                metres * 1e3,
                radians.to_degrees()
            )
            .unwrap();
        }
        for unplaced in &found.unplaced {
            writeln!(text, "{:12} not placed: {} {}", unplaced.name, unplaced.reason, unplaced.remedy).unwrap();
            for c in &unplaced.candidates {
                writeln!(
                    text,
                    "{:12}   matched with {}: overlap {:.3}, agreement {:.3}, contradicted {:.4}, residual {:.1} mm",
                    "",
                    c.matched_with,
                    c.overlap,
                    c.agreement,
                    c.contradicted,
                    c.residual * 1e3
                )
                .unwrap();
            }
        }
        for link in &found.links {
            writeln!(
                text,
                "{} – {}: overlap {:.3}, {} samples, residual {:.1} mm, contradicted {:.4}",
                link.stations[0],
                link.stations[1],
                link.overlap,
                link.samples,
                link.residual * 1e3,
                link.contradicted
            )
            .unwrap();
        }
        text
    }

    /// Fails if the result is incomplete, or if the error of a station exceeds these limits: metres, degrees.
    pub(super) fn within(&self, found: &Registration, limits: [f64; 2]) {
        let wrong: Vec<String> =
            self.off(found).into_iter().filter(|o| o.is_more_than(limits)).map(|o| o.name).collect();
        let [metres, degrees] = limits;
        assert!(
            wrong.is_empty(),
            "PLACED WRONGLY, more than {metres} m or {degrees}°: {}\n{}",
            wrong.join(", "),
            self.table(found)
        );
        is_whole(found, &self.0.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>());
    }

    /// Fails if a station was placed wrongly.
    pub(super) fn never_wrong(&self, found: &Registration) {
        self.within(found, WRONG);
    }

    /// Fails unless all stations are placed, each within 1 cm and 0.1°.
    pub(super) fn all_placed(&self, found: &Registration) {
        self.never_wrong(found);
        let missing: Vec<&str> = found.unplaced.iter().map(|u| u.name.as_str()).collect();
        assert!(missing.is_empty(), "not placed: {}\n{}", missing.join(", "), self.table(found));
        self.within(found, [0.01, 0.1]);
    }

    /// Fails if a coordinate along an axis of the true frame is off by more than its stated standard deviation allows.
    pub(super) fn is_honest_along(&self, found: &Registration, axis: DVec3) {
        let Some(frame) = self.frame(found) else { return };
        let axis = frame.rotation * axis.normalize();
        for Off { name, translation, .. } in self.off(found) {
            let placed = found.stations.iter().find(|placed| placed.name == name).unwrap();
            let c = &placed.covariance;
            let block = DMat3::from_cols_array_2d(&[3, 4, 5].map(|k| [c[k][3], c[k][4], c[k][5]]));
            let (sigma, error) = ((axis.dot(block * axis)).sqrt(), translation.dot(axis).abs());
            assert!(
                error <= 1e-9 || error <= DEVIATIONS * sigma,
                "{name} is {:.1} mm off along {axis}, but its stated standard deviation there is {:.2} mm\n{}",
                error * 1e3,
                sigma * 1e3,
                self.table(found)
            );
        }
    }
}

/// Fails unless every station of the survey is listed as placed or unplaced, covariances are valid, and reasons and remedies are readable.
pub(super) fn is_whole(found: &Registration, names: &[&str]) {
    let placed = found.stations.iter().map(|placed| placed.name.as_str());
    let mut listed: Vec<&str> = placed.chain(found.unplaced.iter().map(|unplaced| unplaced.name.as_str())).collect();
    let mut expected = names.to_vec();
    listed.sort_unstable();
    expected.sort_unstable();
    assert_eq!(listed, expected, "every station is listed exactly once, as placed or unplaced");
    for placed in &found.stations {
        let Placed { name, rotation, translation, covariance: c, placement, .. } = placed;
        assert!((placed.pose().rotation.length() - 1.0).abs() < 1e-9, "{name}: {rotation:?}");
        assert!(translation.iter().all(|v| v.is_finite()), "{name}: {translation:?}");
        for (i, row) in c.iter().enumerate() {
            for (j, value) in row.iter().enumerate() {
                let largest = (c[i][i] * c[j][j]).sqrt();
                assert!(value.abs() <= largest * (1.0 + 1e-9), "{name}: entry {i}, {j} of its covariance: {c:?}");
                assert!((value - c[j][i]).abs() <= 1e-9 * largest, "{name}: a covariance is symmetric: {c:?}");
            }
        }
        let is_known = matches!(placement, Placement::Anchor | Placement::Fixed);
        let is_zero = c.iter().flatten().all(|v| *v == 0.0);
        assert_eq!(
            is_known, is_zero,
            "{name}, {placement:?}: only the anchor and fixed stations have no uncertainty: {c:?}"
        );
    }
    for unplaced in &found.unplaced {
        for text in [&unplaced.reason, &unplaced.remedy] {
            let words = text.split_whitespace().count();
            assert!(words >= 4 && !text.contains("NaN") && !text.contains("inf "), "{}: {text:?}", unplaced.name);
        }
    }
    for link in &found.links {
        let is_placed = |name: &String| found.stations.iter().any(|placed| placed.name == *name);
        assert!(link.stations.iter().all(is_placed), "links are between placed stations: {:?}", link.stations);
        let shares = [link.overlap, link.contradicted];
        assert!(shares.iter().all(|s| (0.0..=1.0).contains(s)) && link.residual.is_finite(), "{link:?}");
    }
}

/// A correct result: the true poses in the frame of the first station.
fn right(truth: &Truth) -> Registration {
    let frame = truth.0[0].1.inverse();
    let placed = |(k, (name, pose)): (usize, &(String, Pose))| {
        let pose = pose.then(frame);
        let q = pose.rotation;
        let mut covariance = [[0.0; 6]; 6];
        for (i, row) in covariance.iter_mut().enumerate().filter(|_| k > 0) {
            row[i] = 1e-6;
        }
        let placement = if k == 0 { Placement::Anchor } else { Placement::Surface };
        let rotation = [q.w, q.x, q.y, q.z];
        Placed {
            name: name.clone(),
            placement,
            rotation,
            translation: pose.translation.to_array(),
            covariance,
            stated: None,
            scan: String::new(),
        }
    };
    Registration { stations: truth.0.iter().enumerate().map(placed).collect(), ..Registration::empty() }
}

fn three() -> Truth {
    let pose = |degrees: f64, x: f64| Pose {
        rotation: DQuat::from_rotation_z(degrees.to_radians()) * DQuat::from_rotation_x(3e-4),
        translation: DVec3::new(x, 2.0, 1.5),
    };
    Truth(vec![
        ("a".to_owned(), pose(30.0, 1.0)),
        ("b".to_owned(), pose(200.0, 9.0)),
        ("c".to_owned(), pose(-70.0, 4.0)),
    ])
}

#[test]
fn the_truth_is_right_in_any_frame() {
    let truth = three();
    truth.all_placed(&right(&truth));
    assert!(
        truth.off(&right(&truth)).iter().all(|off| off.translation.length() < 1e-12 && off.rotation.length() < 1e-12)
    );
}

#[test]
#[should_panic(expected = "PLACED WRONGLY, more than 0.05 m or 0.5°: b\n")]
fn a_place_six_centimetres_off_fails_with_its_name() {
    let (truth, mut found) = (three(), right(&three()));
    found.stations[1].translation[2] += 0.06;
    truth.never_wrong(&found);
}

#[test]
#[should_panic(expected = "PLACED WRONGLY, more than 0.05 m or 0.5°: c\n")]
fn a_heading_six_tenths_of_a_degree_off_fails_with_its_name() {
    let (truth, mut found) = (three(), right(&three()));
    let turned = DQuat::from_rotation_z(0.6_f64.to_radians()) * found.stations[2].pose().rotation;
    found.stations[2].rotation = [turned.w, turned.x, turned.y, turned.z];
    truth.never_wrong(&found);
}

#[test]
#[should_panic(expected = "every station is listed exactly once")]
fn a_station_missing_from_the_result_fails() {
    let (truth, mut found) = (three(), right(&three()));
    found.stations.pop();
    truth.never_wrong(&found);
}

#[test]
#[should_panic(expected = "b is 4.0 mm off along")]
fn an_error_beyond_its_standard_deviation_fails() {
    let (truth, mut found) = (three(), right(&three()));
    // Standard deviations are 1 mm.
    found.stations[1].translation[0] += 0.004;
    truth.is_honest_along(&found, truth.frame(&found).unwrap().rotation.inverse() * DVec3::X);
}
