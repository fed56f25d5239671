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
    /// The datum is converted to WGS 84 with a few parameters, which is off by decimetres or metres.
    shifted: bool,
}

/// Why coordinates cannot be converted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum NoGeocentric {
    /// Well-known text, or another text that is not an EPSG code.
    #[error("it is not an EPSG code")]
    NoCode,
    /// The code is not in the list, or needs a datum shift grid.
    #[error("Kilwa does not have its definition, or not the grid of datum shifts that it needs")]
    Unknown,
    /// It is not projected, or its axes are not east and north.
    #[error("its coordinates are not eastings and northings")]
    NotProjected,
    /// Its datum is not tied to WGS 84.
    #[error("its definition does not relate its datum to WGS 84")]
    Datum,
}

impl Geocentric {
    /// The conversion for a projected system such as `EPSG:32737`.
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
        let to = Proj::from_proj_string("+proj=geocent +datum=WGS84 +units=m +no_defs")
            .map_err(|_| NoGeocentric::Unknown)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// pyproj 3.7 with PROJ 9, from the system in three dimensions to EPSG:4978.
    #[test]
    fn geocentric_coordinates_are_those_of_proj_to_a_tenth_of_a_millimetre() {
        for (crs, world, expected) in [
            ("EPSG:32737", [531_000.0, 9_010_000.0, 12.5], [4_877_142.538_7, 3_989_337.427_0, -986_357.815_5]),
            ("EPSG:32737", [531_400.25, 9_010_400.75, -3.125], [4_876_925.601_2, 3_989_676.875_6, -985_959.058_7]),
            ("EPSG:32633", [499_999.0, 1.0, 0.0], [6_160_807.510_8, 1_650_782.361_6, 1.000_4]),
            ("EPSG:25832", [691_000.5, 5_334_000.25, 520.0], [4_178_639.838_8, 855_248.272_9, 4_726_966.071_5]),
            ("EPSG:3006", [674_000.0, 6_580_000.0, 30.0], [3_101_539.157_8, 1_011_221.351_2, 5_462_399.623_0]),
            ("EPSG:2154", [652_000.0, 6_862_000.0, 80.0], [4_201_016.042_6, 172_094.765_9, 4_780_115.841_9]),
        ] {
            let geocentric = Geocentric::new(crs).expect("a known system");
            let found = geocentric.of(world.into()).expect("on the earth");
            assert!(found.distance(expected.into()) < 1.5e-4, "{crs}: {found} instead of {expected:?}");
            assert!(!geocentric.is_approximate(), "{crs}");
        }
        // The Swiss datum by its published shift of three parameters.
        let swiss = Geocentric::new("EPSG:2056").expect("a known system");
        let found = swiss.of(DVec3::new(2_600_000.0, 1_200_000.0, 550.0)).expect("on the earth");
        let expected = DVec3::new(4_325_361.849_8, 564_732.313_5, 4_638_492.480_0);
        assert!(swiss.is_approximate() && found.distance(expected) < 1.5e-4, "{found}");
    }

    #[test]
    fn systems_that_cannot_be_converted_are_refused_with_the_reason() {
        for (crs, why) in [
            ("PROJCRS[\"x\"]", NoGeocentric::NoCode),
            ("EPSG:99999", NoGeocentric::NoCode),
            ("EPSG:1999", NoGeocentric::Unknown),
            ("EPSG:4314", NoGeocentric::NotProjected),
            ("EPSG:4978", NoGeocentric::NotProjected),
        ] {
            assert_eq!(Geocentric::new(crs).err(), Some(why), "{crs}");
        }
    }
}
