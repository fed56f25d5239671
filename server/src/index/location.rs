//! Where on earth an object is, for the map: what its metadata say, else the middle of its box through its reference system.
//!
//! No location is given for an object any version of which was published without it, nor, if only its geometry would reveal it, for one whose
//! geometry is not for everybody. A system that is not known gives no place, never a wrong one.

use kilwa_archive::location::projection::degrees_of_box;
use kilwa_archive::manifest::Version;
use kilwa_archive::metadata::Place;
use kilwa_archive::{AccessState, Manifest};

/// Latitude and longitude, degrees of WGS 84.
pub(super) fn of(manifest: &Manifest, place: Option<&Place>) -> Option<[f64; 2]> {
    if manifest.access.state == AccessState::Withdrawn || manifest.versions.iter().any(|v| v.location_redacted) {
        return None;
    }
    let given = place.and_then(|p| Some([p.latitude?, p.longitude?]));
    let derived = || {
        let version = manifest.current().filter(|_| manifest.access.state == AccessState::Public)?;
        of_box(version)
    };
    given.or_else(derived).filter(|[lat, lon]| lat.abs() <= 90.0 && lon.abs() <= 180.0)
}

/// The middle of a version's box, in degrees.
fn of_box(version: &Version) -> Option<[f64; 2]> {
    degrees_of_box(version.figures.crs.as_deref()?, version.figures.bounds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_archive::manifest::Figures;

    fn figures(crs: &str, at: [f64; 2]) -> Version {
        let figures = serde_json::json!({
            "bounds": [[at[0] - 10.0, at[1] - 10.0, 0.0], [at[0] + 10.0, at[1] + 10.0, 5.0]], "crs": crs, "units": "m",
            "source_units": "m", "triangles": 1, "vertices": 3, "spacing": 0.1,
        });
        let figures: Figures = serde_json::from_value(figures).unwrap();
        let hash = "a".repeat(64);
        let version = serde_json::json!({
            "version": 1, "folder": "v1", "published": "2026-01-01", "note": "first",
            "pack": {"url": format!("v1/pack.{hash}.kilwa"), "bytes": 7, "sha256": hash, "identity": "b".repeat(32)},
            "checksums": {"url": "v1/checksums.sha256", "bytes": 3, "sha256": hash}, "figures": figures,
        });
        serde_json::from_value(version).unwrap()
    }

    /// Second opinion: pyproj 3.7.2 (PROJ 9.5.1) for the same coordinates.
    #[test]
    fn projected_coordinates_become_degrees() {
        for (crs, at, wanted) in [
            // Kilwa Kisiwani, UTM 37 S.
            ("EPSG:32737", [556_800.0, 9_009_000.0], [-8.964_796, 39.516_711]),
            // The Eiffel tower, Lambert 93.
            ("EPSG:2154", [648_237.3, 6_862_271.7], [48.858_400, 2.294_500]),
            // The Statue of Liberty, in US feet; the pack has metres.
            ("EPSG:2263", [971_570.0 * 1200.0 / 3937.0, 190_550.0 * 1200.0 / 3937.0], [40.689_683, -74.045_723]),
        ] {
            let found = of_box(&figures(crs, at)).unwrap();
            let off = (found[0] - wanted[0]).abs().max((found[1] - wanted[1]).abs());
            assert!(off < 1e-5, "{crs}: {found:?} instead of {wanted:?}");
        }
        for unknown in ["EPSG:4326", "EPSG:1025", "local", "PROJCS[\"x\"]", "EPSG:99999"] {
            assert_eq!(of_box(&figures(unknown, [5e5, 5e6])), None, "{unknown}");
        }
    }
}
