//! Coordinate reference systems: how they may be written, and whether a model can lie in one.
//!
//! The crate `crs-definitions` lists some seven thousand EPSG codes, but not all of them: a code that is not in the list may exist, and is not refused.
//! Whether a model can lie in a system is judged for UTM on WGS 84 only (EPSG:32601-32660, 32701-32760).

use glam::DVec3;

/// UTM on WGS 84: zone 1 to 60, and which half of the earth.
fn utm(code: u32) -> Option<(u32, &'static str)> {
    match code {
        32_601..=32_660 => Some((code - 32_600, "N")),
        32_701..=32_760 => Some((code - 32_700, "S")),
        _ => None,
    }
}

/// Codes in degrees that the list lacks, or has without their definition.
const GEOGRAPHIC: [u32; 12] = [4326, 4979, 4258, 4269, 4267, 4230, 4171, 4283, 7844, 4210, 4148, 9057];

/// The definition of a code for the library PROJ.
fn definition(code: u32) -> Option<&'static str> {
    let code = u16::try_from(code).ok()?;
    crs_definitions::from_code(code).map(|found| found.proj4)
}

/// Whether the list of EPSG codes has a system in the form that packs have (`EPSG:32737`); true for well-known text. A code that is not in it may
/// exist all the same.
pub fn is_listed(crs: &str) -> bool {
    let Some(code) = crs.strip_prefix("EPSG:") else { return true };
    code.parse().is_ok_and(|code| GEOGRAPHIC.contains(&code) || definition(code).is_some())
}

/// A reference system in the form that packs have: `EPSG:32737`; `None` for `local`.
///
/// # Errors
/// A sentence that says what is wanted.
pub fn normalise(text: &str) -> Result<Option<String>, String> {
    let text = text.trim();
    let lower = text.to_lowercase();
    if matches!(lower.as_str(), "local" | "none") {
        return Ok(None);
    }
    let code = lower
        .strip_prefix("epsg:")
        .or_else(|| lower.strip_prefix("urn:ogc:def:crs:epsg::"))
        .or_else(|| lower.strip_prefix("https://www.opengis.net/def/crs/epsg/0/"))
        .or_else(|| lower.strip_prefix("http://www.opengis.net/def/crs/epsg/0/"))
        .map(str::trim);
    if let Some(code) = code {
        return match code.parse::<u32>() {
            Ok(n) if (1024..=32_767).contains(&n) => {
                of_metres(n)?;
                Ok(Some(format!("EPSG:{n}")))
            }
            _ => Err(format!(
                "\"{text}\" is not an EPSG code; EPSG codes are numbers from 1024 to 32767, for example EPSG:32737 (https://epsg.org)"
            )),
        };
    }
    let is_wkt = ["projcrs[", "projcs[", "boundcrs[", "compoundcrs[", "compd_cs[", "engcrs[", "local_cs["]
        .iter()
        .any(|k| lower.starts_with(k));
    if is_wkt {
        return Ok(Some(text.to_owned()));
    }
    if lower.parse::<u32>().is_ok() {
        return Err(format!("write \"EPSG:{lower}\""));
    }
    Err(format!(
        "\"{text}\" is not a reference system; write an EPSG code such as \"EPSG:32737\", well-known text, or \"local\""
    ))
}

fn of_metres(code: u32) -> Result<(), String> {
    let is_in_degrees = definition(code).is_some_and(|text| text.contains("+proj=longlat"));
    if is_in_degrees || GEOGRAPHIC.contains(&code) {
        return Err(format!(
            "EPSG:{code} has degrees, but a mesh has metres: write the projected system of the survey, for example EPSG:32737 (UTM 37 S)"
        ));
    }
    Ok(())
}

/// Whether a model with this box, metres, can lie in a system.
///
/// # Errors
/// A sentence that says where it would lie.
pub fn holds(crs: &str, min: DVec3, max: DVec3) -> Result<(), String> {
    let Some(code) = crs.strip_prefix("EPSG:").and_then(|c| c.parse::<u32>().ok()) else { return Ok(()) };
    of_metres(code)?;
    let Some((zone, half)) = utm(code) else { return Ok(()) };
    let (east, north) = ((100_000.0, 900_000.0), (0.0, 10_000_000.0));
    let inside = min.x >= east.0 && max.x <= east.1 && min.y >= north.0 && max.y <= north.1;
    if inside {
        return Ok(());
    }
    Err(format!(
        "the model lies from x {:.1}, y {:.1} to x {:.1}, y {:.1} m, which is not in {crs} (UTM {zone} {half}: x from 100000 to 900000, y from 0 to 10000000); \
         if its coordinates are local, build the pack without --crs and write \"local\"",
        min.x, min.y, max.x, max.y
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_systems_are_normalised_to_one_spelling() {
        for given in
            ["EPSG:32737", "epsg:32737", "urn:ogc:def:crs:EPSG::32737", "http://www.opengis.net/def/crs/EPSG/0/32737"]
        {
            assert_eq!(normalise(given), Ok(Some("EPSG:32737".to_owned())), "{given}");
        }
        assert_eq!(normalise("Local"), Ok(None));
        assert!(normalise("PROJCRS[\"x\"]").unwrap().is_some());
        for (bad, expected) in [
            ("32737", "write \"EPSG:32737\""),
            ("EPSG:4326", "degrees"),
            ("EPSG:4314", "degrees"),
            ("EPSG:99999", "not an EPSG code"),
            ("UTM 37S", "EPSG code such as"),
        ] {
            assert!(normalise(bad).unwrap_err().contains(expected), "{bad}");
        }
    }

    #[test]
    fn an_unlisted_code_is_known_to_be_unlisted_and_accepted() {
        for listed in ["EPSG:32737", "EPSG:27700", "EPSG:2056", "EPSG:4326", "PROJCRS[\"x\"]"] {
            assert!(is_listed(listed), "{listed}");
        }
        assert!(!is_listed("EPSG:1999") && !is_listed("EPSG:99999"));
        assert_eq!(normalise("EPSG:1999"), Ok(Some("EPSG:1999".to_owned())));
    }

    #[test]
    fn a_model_outside_its_zone_is_reported() {
        let at = |x: f64, y: f64| (DVec3::new(x, y, 0.0), DVec3::new(x + 50.0, y + 50.0, 5.0));
        let (min, max) = at(512_000.0, 9_007_000.0);
        assert!(holds("EPSG:32737", min, max).is_ok() && holds("EPSG:2169", DVec3::ZERO, DVec3::ONE).is_ok());
        let (min, max) = at(-20.0, -20.0);
        assert!(holds("EPSG:32737", min, max).unwrap_err().contains("UTM 37 S"));
    }
}
