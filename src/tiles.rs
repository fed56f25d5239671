//! 3D Tiles of a pack, for `kilwa extract --to tiles` and `kilwa publish --tiles`: how they are stored, and where they are on the globe.

use crate::source::FileSource;
use glam::DVec3;
use kilwa_archive::location::projection::Geocentric;
use kilwa_formats::extract::ExtractError;
use kilwa_formats::extract::tiles::{Earth, Folder, Limits, Profile, Request, Tileset, write_tiles};
use kilwa_pack::Reader;

/// How tiles are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum ProfileArg {
    /// Compressed (EXT_meshopt_compression), for browsers.
    Web,
    /// Uncompressed, without glTF extensions, for QGIS, Unreal and Blender.
    Plain,
}

impl From<ProfileArg> for Profile {
    fn from(profile: ProfileArg) -> Self {
        match profile {
            ProfileArg::Web => Self::Web,
            ProfileArg::Plain => Self::Plain,
        }
    }
}

/// The height of a geoid above its ellipsoid, from the command line.
pub(crate) fn parse_geoid_offset(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        // No geoid is farther than 110 m from its ellipsoid; local height systems can be.
        Ok(x) if x.is_finite() && x.abs() <= 10_000.0 => Ok(x),
        _ => Err("expected a length in metres, for example -28.5".to_owned()),
    }
}

/// A reference system, and heights above its ellipsoid.
pub(crate) struct Place {
    pub(crate) crs: String,
    geocentric: Geocentric,
    /// Metres, if it was given.
    given_offset: Option<f64>,
}

impl Place {
    /// Of a reference system (`EPSG:32737`) and the height of the geoid above its ellipsoid, metres.
    ///
    /// # Errors
    /// Why coordinates of this system cannot be placed on the globe.
    pub(crate) fn new(crs: String, geoid_offset: Option<f64>) -> Result<Self, String> {
        let geocentric = Geocentric::new(&crs).map_err(|why| {
            let shown: String = crs.chars().take(60).collect();
            format!("the model cannot be placed on the globe from its reference system \"{shown}\": {why}")
        })?;
        Ok(Self { crs, geocentric, given_offset: geoid_offset })
    }

    /// Height of the geoid above the ellipsoid, metres.
    pub(crate) fn geoid_offset(&self) -> f64 {
        self.given_offset.unwrap_or(0.0)
    }

    /// What the user should know about the model's position.
    pub(crate) fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.given_offset.is_none() {
            notes.push(
                "Heights were assumed to be ellipsoidal. If they are above sea level, add the height of the geoid at the site: --geoid-offset METRES.".to_owned(),
            );
        }
        if self.geocentric.is_approximate() {
            notes.push(format!(
                "{} has a datum that is converted to WGS 84 by an approximate transformation with a few parameters: the position on the globe may be off by metres, but the shape is not affected.",
                self.crs
            ));
        }
        notes
    }
}

impl Earth for Place {
    fn geocentric(&self, world: DVec3) -> Option<DVec3> {
        self.geocentric.of(world + DVec3::Z * self.geoid_offset())
    }
}

/// Write the tiles of a pack to a folder; without a place they keep the coordinates of the pack.
///
/// # Errors
/// As [`write_tiles`].
pub(crate) fn write(
    reader: &Reader<FileSource>,
    profile: ProfileArg,
    place: Option<&Place>,
    folder: &Folder,
    progress: &dyn Fn(u64, u64),
) -> Result<Tileset, ExtractError> {
    let request = Request {
        profile: profile.into(),
        limits: Limits::default(),
        earth: place.map(|place| place as &dyn Earth),
        crs: place.map(|place| place.crs.as_str()),
    };
    write_tiles(reader, &request, folder, progress)
}
