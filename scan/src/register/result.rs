//! The result of a registration: poses with their covariances, links, and the stations that could not be placed. It is stored in the survey as
//! `registration.json`, next to `survey.toml`, which has the poses.

use crate::ScanError;
use crate::survey::{Station, Survey};
use glam::{DQuat, DVec3};
use kilwa_files::atomic::{self, Access};
use kilwa_files::plain_file;
use kilwa_formats::read::ReadError;
use kilwa_scan_core::Pose;
use serde::{Deserialize, Serialize};
use std::io::Read as _;
use std::path::Path;

/// The name of the file.
pub const FILE: &str = "registration.json";
/// The version of the file that this program reads and writes.
const VERSION: u32 = 1;
/// Largest file, bytes.
const FILE_MAX: u64 = 256 << 20;

/// The result of a registration.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// [`VERSION`].
    pub version: u32,
    /// Stations with a pose, in the order of the survey.
    pub stations: Vec<Placed>,
    /// Stations without one, in the order of the survey.
    pub unplaced: Vec<Unplaced>,
    /// Pairs of placed stations that see the same surface.
    pub links: Vec<Link>,
    /// The stations on the path from the anchor to the least certain station, along the links with the smallest total variance.
    pub weakest_chain: Vec<String>,
    /// Further messages for the user.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// What is known about the uncertainty of a pose.
#[derive(Debug, Clone, Copy)]
pub enum KnownSigma<'a> {
    /// The pose is the one that was registered.
    Registered(&'a Placed),
    /// The survey states standard deviations: of each coordinate of the position, metres, and about each axis, radians.
    Stated([f64; 2]),
}

impl KnownSigma<'_> {
    /// Standard deviations: of a coordinate of the position, metres, and of the rotation, radians.
    pub fn deviations(&self) -> [f64; 2] {
        match self {
            Self::Registered(placed) => placed.sigma(),
            Self::Stated(sigma) => *sigma,
        }
    }
}

/// How the pose of a station was determined.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// Its pose defines the coordinate system: there are no fixed stations, known poses or control points with survey coordinates.
    Anchor,
    /// Its pose was given and kept.
    Fixed,
    /// From control points.
    Control,
    /// From the surface that it shares with others.
    Surface,
}

/// A station that has a pose.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Placed {
    /// Its name in the survey.
    pub name: String,
    /// Its scan, relative to the folder of the survey: a station may be renamed.
    #[serde(default)]
    pub scan: String,
    /// How its pose was determined.
    pub placement: Placement,
    /// `survey_from_station`: a unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// And a translation, metres.
    pub translation: [f64; 3],
    /// Covariance of the pose relative to the anchor or the fixed stations, 6 × 6: rotations about the axes of the survey through the station
    /// (radians), then translations of the station along them (metres). A point `p` of the station is displaced by `ω × (p − translation) + τ`.
    pub covariance: [[f64; 6]; 6],
    /// The pose that this one replaced in `survey.toml`, unless that pose came from a registration as well.
    #[serde(default)]
    pub stated: Option<Stated>,
}

/// A pose that does not come from a registration: it was imported with the scan or entered by hand.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stated {
    /// `survey_from_station`: a unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// And a translation, metres.
    pub translation: [f64; 3],
    /// Its standard deviations, if somebody entered them: metres, radians.
    pub sigma: Option<[f64; 2]>,
}

impl Stated {
    /// A pose, and its standard deviations in metres and radians.
    pub fn new(pose: Pose, sigma: Option<[f64; 2]>) -> Self {
        Self { rotation: quaternion(pose), translation: pose.translation.to_array(), sigma }
    }

    /// `survey_from_station`.
    pub fn pose(&self) -> Pose {
        pose(self.rotation, self.translation)
    }
}

/// The rotation of a pose as w, x, y, z.
pub(super) fn quaternion(pose: Pose) -> [f64; 4] {
    let q = pose.rotation;
    [q.w, q.x, q.y, q.z]
}

fn pose([w, x, y, z]: [f64; 4], translation: [f64; 3]) -> Pose {
    Pose { rotation: DQuat::from_xyzw(x, y, z, w), translation: DVec3::from_array(translation) }
}

impl Placement {
    /// Whether the pose is exact by definition.
    pub fn is_given(self) -> bool {
        matches!(self, Self::Anchor | Self::Fixed)
    }
}

impl Placed {
    /// A station with this pose and its covariance, 6 × 6.
    pub fn new(station: &Station, placement: Placement, pose: Pose, covariance: [[f64; 6]; 6]) -> Self {
        Self {
            name: station.name.clone(),
            scan: station.scan.clone(),
            placement,
            rotation: quaternion(pose),
            translation: pose.translation.to_array(),
            covariance,
            stated: None,
        }
    }

    /// Whether it can be stored and read again.
    fn is_valid(&self) -> bool {
        let is_pose =
            |pose: Pose| pose.translation.is_finite() && (pose.rotation.length() - 1.0).abs() <= Pose::TOLERANCE;
        is_pose(self.pose())
            && self.covariance.iter().flatten().all(|v| v.is_finite())
            && self.stated.is_none_or(|stated| is_pose(stated.pose()))
    }

    /// `survey_from_station`.
    pub fn pose(&self) -> Pose {
        pose(self.rotation, self.translation)
    }

    /// Standard deviations as `survey.toml` has them: of the position, the root mean square of its three coordinates, metres; and of the rotation about
    /// the axis for which it is largest, radians.
    pub fn sigma(&self) -> [f64; 2] {
        let c = &self.covariance;
        let metres = ((c[3][3] + c[4][4] + c[5][5]) / 3.0).max(0.0).sqrt();
        let radians = (c[0][0].max(c[1][1]).max(c[2][2])).max(0.0).sqrt();
        [metres, radians]
    }
}

/// A station that could not be placed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Unplaced {
    /// Its name in the survey.
    pub name: String,
    /// Its scan, as in [`Placed`].
    #[serde(default)]
    pub scan: String,
    /// The reason, as a phrase.
    pub reason: String,
    /// The best candidate poses, best first.
    pub candidates: Vec<Candidate>,
    /// The remedy, as a phrase.
    pub remedy: String,
}

/// A candidate pose of a station.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Candidate {
    /// The placed station with which it was matched.
    pub matched_with: String,
    /// `survey_from_station` for this candidate: a unit quaternion w, x, y, z.
    pub rotation: [f64; 4],
    /// And a translation, metres.
    pub translation: [f64; 3],
    /// Share of the surface of both stations that the other one should see too, 0 to 1.
    pub overlap: f64,
    /// Share of this common surface that agrees, 0 to 1.
    pub agreement: f64,
    /// Share of it that rays of the other station pass through, 0 to 1.
    pub contradicted: f64,
    /// Root mean square distance between the surfaces where they agree, metres.
    pub residual: f64,
}

/// Two stations that see the same surface.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Link {
    /// The names of both.
    pub stations: [String; 2],
    /// Share of the samples of the smaller view that the other sees too, 0 to 1.
    pub overlap: f64,
    /// Samples that were compared.
    pub samples: u64,
    /// Root mean square distance between the surfaces after registration, metres.
    pub residual: f64,
    /// Share of the samples that rays of the other pass through, 0 to 1.
    pub contradicted: f64,
    /// Standard deviations of the relative pose from this link alone: the largest of a translation (metres) and of a rotation
    /// (radians) in any direction; `None` if either is not finite.
    pub sigma: Option<[f64; 2]>,
}

impl Candidate {
    /// `survey_from_station` for this candidate.
    pub fn pose(&self) -> Pose {
        pose(self.rotation, self.translation)
    }
}

impl Registration {
    /// The result of the last registration of the survey in `folder`; `None` if it was never registered.
    ///
    /// # Errors
    /// [`ScanError::Request`] for an invalid file; [`ReadError::Open`] for one that cannot be read.
    pub fn open(folder: &Path) -> Result<Option<Self>, ScanError> {
        let path = folder.join(FILE);
        if !path.exists() {
            return Ok(None);
        }
        let cannot = |source| ReadError::Open { file: path.clone(), source };
        let mut text = Vec::new();
        let file = plain_file::open(&path).map_err(cannot)?;
        file.take(FILE_MAX + 1).read_to_end(&mut text).map_err(cannot)?;
        let wrong = |what: String| {
            ScanError::Request(format!(
                "{} is damaged: {what}; register all stations again with `kilwa register --again`, or remove the file",
                path.display()
            ))
        };
        if text.len() as u64 > FILE_MAX {
            return Err(wrong(format!("it is larger than {FILE_MAX} bytes")));
        }
        let found: Self = serde_json::from_slice(&text).map_err(|e| wrong(e.to_string()))?;
        if found.version != VERSION {
            return Err(ScanError::Request(format!(
                "{} has version {}, but this program reads version {VERSION}: use the version of Kilwa that wrote it, or register all stations again with `kilwa register --again`",
                path.display(),
                found.version
            )));
        }
        if let Some(station) = found.stations.iter().find(|station| !station.is_valid()) {
            return Err(wrong(format!("the pose of station {} is invalid", station.name)));
        }
        Ok(Some(found))
    }

    /// Write it into the survey.
    ///
    /// # Errors
    /// [`ScanError::Write`]; [`ScanError::Request`] if a covariance is not finite, because the file could not be read again.
    pub fn save(&self, folder: &Path) -> Result<(), ScanError> {
        let path = folder.join(FILE);
        self.check()?;
        let mut text = serde_json::to_string_pretty(self).map_err(|e| ScanError::Request(e.to_string()))?;
        text.push('\n');
        atomic::write(&path, text.as_bytes(), Access::Default, true).map_err(ScanError::write(&path))
    }

    /// An empty result.
    pub fn empty() -> Self {
        Self { version: VERSION, ..Self::default() }
    }

    /// The entry for the current pose of a station; `None` if it was not registered, or if its pose has been changed since.
    pub fn of(&self, station: &Station) -> Option<&Placed> {
        let placed = self.entry(station)?;
        let (angle, distance) = station.pose?.difference(placed.pose());
        (angle < 1e-6 && distance < 1e-6).then_some(placed)
    }

    /// The entry of a station, whatever its pose is now.
    pub(crate) fn entry(&self, station: &Station) -> Option<&Placed> {
        let is_same = |placed: &&Placed| match &placed.scan[..] {
            "" => placed.name == station.name,
            scan => scan == station.scan,
        };
        self.stations.iter().find(is_same)
    }

    /// Whether a station could not be placed.
    pub fn is_unplaced(&self, station: &Station) -> bool {
        self.unplaced.iter().any(|unplaced| match &unplaced.scan[..] {
            "" => unplaced.name == station.name,
            scan => scan == station.scan,
        })
    }

    /// The same with the names that stations have in `survey` now, without those that are no longer in it.
    #[must_use]
    pub fn with_current_names(&self, survey: &Survey) -> Self {
        let name_of = |station: &Station| {
            let unplaced = self.unplaced.iter().find(|u| !u.scan.is_empty() && u.scan == station.scan);
            let former = self.entry(station).map(|placed| &placed.name).or(unplaced.map(|unplaced| &unplaced.name));
            (former.unwrap_or(&station.name).clone(), station.name.clone())
        };
        self.renamed(&survey.stations.iter().map(name_of).collect())
    }

    /// Whether the standard deviations of a station in `survey.toml` are those that this registration entered there.
    pub(crate) fn has_entered_sigma(&self, station: &Station) -> bool {
        let Some((placed, sigma)) = self.entry(station).zip(station.sigma) else { return false };
        // Angles are stored in degrees.
        placed.placement != Placement::Fixed
            && sigma.iter().zip(placed.sigma()).all(|(a, b)| (a - b).abs() <= 1e-9 * b.abs())
    }

    /// What is known about the uncertainty of the current pose of a station, from the registration or from the survey; `None` if it is unknown.
    ///
    /// Standard deviations that a registration entered do not apply to a pose that was changed afterwards, and a registration that did not place a station does not confirm its pose.
    pub fn known_sigma<'a>(registration: Option<&'a Self>, station: &Station) -> Option<KnownSigma<'a>> {
        let stated = station.sigma.filter(|_| !registration.is_some_and(|all| all.has_entered_sigma(station)));
        let stated = station.pose.and(stated).map(KnownSigma::Stated);
        match registration.and_then(|all| all.of(station)) {
            Some(placed) if placed.placement == Placement::Fixed => stated.or(Some(KnownSigma::Registered(placed))),
            Some(placed) => Some(KnownSigma::Registered(placed)),
            None => stated.filter(|_| !registration.is_some_and(|all| all.is_unplaced(station))),
        }
    }

    /// Checks that the result can be stored and read again.
    ///
    /// # Errors
    /// [`ScanError::Request`] if a pose or a covariance is not finite.
    pub(super) fn check(&self) -> Result<(), ScanError> {
        match self.stations.iter().find(|station| !station.is_valid()) {
            Some(bad) => Err(ScanError::Request(format!(
                "the pose or the covariance of station {} is not finite, so the result cannot be stored; register with `--dry-run --report FILE.html` and look at its links",
                bad.name
            ))),
            None => Ok(()),
        }
    }

    /// The pose of a station that does not come from a registration (`before` is the last one); `None` if there is no such pose. Standard deviations written by the
    /// registration say nothing about a pose that has been entered since.
    pub(super) fn stated(before: Option<&Self>, station: &Station) -> Option<Stated> {
        let own = |sigma| station.pose.map(|pose| Stated::new(pose, sigma));
        let Some((before, placed)) = before.and_then(|before| Some((before, before.entry(station)?))) else {
            return own(station.sigma);
        };
        let sigma = station.sigma.filter(|_| !before.has_entered_sigma(station));
        let was_replaced = placed.placement != Placement::Fixed || placed.stated.is_some();
        if was_replaced && sigma.is_none() && before.of(station).is_some() { placed.stated } else { own(sigma) }
    }
}
