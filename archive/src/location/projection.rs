//! Conversion between the coordinates of a reference system and degrees of WGS 84.

use glam::DVec3;
use proj4rs::Proj;

/// Latitude and longitude of the middle of a box, metres, in a reference system such as `EPSG:32737`: in degrees of WGS 84; `None` if the system
/// is unknown.
pub fn degrees_of_box(crs: &str, [min, max]: [DVec3; 2]) -> Option<[f64; 2]> {
    let code = crs.strip_prefix("EPSG:")?.parse::<u16>().ok()?;
    let from = Proj::from_epsg_code(code).ok()?;
    // In packs, x points east; systems with another axis order are not supported.
    if from.is_latlong() || from.is_geocent() || !from.is_normalized_axis() {
        return None;
    }
    let to = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
    // Packs are in metres, whatever the unit of the system.
    let middle = |k: usize| f64::midpoint(min[k], max[k]) / from.to_meter();
    let mut point = (middle(0), middle(1), 0.0);
    proj4rs::transform::transform(&from, &to, &mut point).ok()?;
    let (lon, lat) = (point.0.to_degrees(), point.1.to_degrees());
    (lat.is_finite() && lon.is_finite()).then_some([lat, lon])
}

/// Easting and northing, in the units of the system, of a latitude and longitude in degrees of WGS 84; `None` if the system is unknown.
pub fn projected(epsg: u16, [lat, lon]: [f64; 2]) -> Option<[f64; 2]> {
    let to = Proj::from_epsg_code(epsg).ok()?;
    let from = Proj::from_proj_string("+proj=longlat +datum=WGS84 +no_defs").ok()?;
    let mut point = (lon.to_radians(), lat.to_radians(), 0.0);
    proj4rs::transform::transform(&from, &to, &mut point).ok()?;
    (point.0.is_finite() && point.1.is_finite()).then_some([point.0, point.1])
}

/// Converts coordinates of a reference system to geocentric ones.
pub struct Geocentric {
    from: Proj,
    to: Proj,
    /// The datum is brought to WGS 84 by a shift of a few parameters, which is off by decimetres or metres.
    shifted: bool,
}

/// Why coordinates cannot be converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoGeocentric {
    /// Well-known text, or another text that is not an EPSG code.
    #[error("it is not an EPSG code")]
    NoCode,
    /// The code is not in the list, or needs a grid of shifts.
    #[error("its definition is not known to Kilwa")]
    Unknown,
    /// It is not projected, or its axes are not east and north.
    #[error("its coordinates are not eastings and northings")]
    NotProjected,
    /// Its datum is not tied to WGS 84.
    #[error("its definition does not relate its datum to WGS 84")]
    Datum,
}

impl Geocentric {
    /// Of a projected system such as `EPSG:32737`.
    ///
    /// # Errors
    /// [`NoGeocentric`].
    pub fn new(crs: &str) -> Result<Self, NoGeocentric> {
        let code = crs.strip_prefix("EPSG:").and_then(|code| code.parse::<u16>().ok()).ok_or(NoGeocentric::NoCode)?;
        let text = crs_definitions::from_code(code).ok_or(NoGeocentric::Unknown)?.proj4;
        if text.contains("+nadgrids") {
            return Err(NoGeocentric::Unknown);
        }
        let from = Proj::from_proj_string(text).map_err(|_| NoGeocentric::Unknown)?;
        if from.is_latlong() || from.is_geocent() || !from.is_normalized_axis() {
            return Err(NoGeocentric::NotProjected);
        }
        let shift = text.split_whitespace().find_map(|part| part.strip_prefix("+towgs84="));
        let datum = text.split_whitespace().find_map(|part| part.strip_prefix("+datum="));
        // NAD 83 is taken for WGS 84, from which it is a metre or two away.
        let shifted = shift.is_some_and(|values| values.split(',').any(|v| v.parse() != Ok(0.0)))
            || datum.is_some_and(|datum| datum != "WGS84");
        if shift.is_none() && datum.is_none() && !text.contains("+ellps=WGS84") {
            return Err(NoGeocentric::Datum);
        }
        // No shift of the datum: it is WGS 84 then.
        let to = Proj::from_proj_string("+proj=geocent +datum=WGS84 +units=m +no_defs").map_err(|_| NoGeocentric::Unknown)?;
        Ok(Self { from, to, shifted })
    }

    /// Whether the datum is brought to WGS 84 by an approximation.
    pub fn is_approximate(&self) -> bool {
        self.shifted
    }

    /// Geocentric coordinates (WGS 84, EPSG:4978) of an easting, a northing and an ellipsoidal height, all in metres; `None` outside of the projection.
    pub fn of(&self, world: DVec3) -> Option<DVec3> {
        // Packs are in metres, whatever the unit of the system.
        let horizontal = world / self.from.to_meter();
        let mut point = (horizontal.x, horizontal.y, world.z / self.from.vto_meter());
        proj4rs::transform::transform(&self.from, &self.to, &mut point).ok()?;
        let found = DVec3::new(point.0, point.1, point.2);
        found.is_finite().then_some(found)
    }
}
