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
