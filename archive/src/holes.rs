//! Published holes: the list of holes that `kilwa merge --holes` writes beside a merged surface, kept in a version as `holes.geojson`.
//!
//! [`Holes::parse`] reads the file of `kilwa merge` or of a version. Whatever is not part of the list is left out, and a hole that the viewer
//! could not draw is refused with its number. [`Holes::to_bytes`] writes a canonical form: equal lists have equal bytes, so a server that receives
//! such a file can check that it contains nothing else.
//!
//! Coordinates are metres in the reference system of the survey, which is that of the pack, z up. Allocation is bounded by the length of the file.

use crate::metadata::crs;
use glam::DVec3;
use kilwa_pack::plural::counted;
use serde::Deserialize;
use serde_json::{Value, json};
use thiserror::Error;

/// Maximum size of a published list, bytes; the page reads no larger file.
pub const HOLES_MAX: u64 = 16_000_000;
/// Maximum size of a file that is read, bytes; larger, because `kilwa merge` writes more digits than are published.
pub const HOLES_READ_MAX: u64 = 4 * HOLES_MAX;
/// What a hole can be due to, as in the file: seen by no station, seen through, measured but dropped, no return.
pub const CAUSES: [&str; 4] = ["unseen", "free", "dropped", "no_return"];
/// How far from the model's box a rim may be, as a part of the box's diagonal. Rims are borders of the surface; only rounding takes them outside.
const MARGIN: f64 = 0.02;
/// Coordinates, lengths and areas are rounded to this part of a metre or square metre.
const PARTS: f64 = 1e6;
/// Larger numbers are refused: no survey is that large, and rounding could make them infinite.
const FAR: f64 = 1e12;

/// Why a list of holes is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum HolesError {
    /// It is not JSON, or not a list of this form.
    #[error("not a list of holes as written by kilwa merge --holes: {0}")]
    Form(String),
    /// An invalid hole.
    #[error("hole {number}: {what}")]
    Hole {
        /// Its number in the file, from 1.
        number: usize,
        /// What is wrong with it.
        what: String,
    },
    /// Its coordinates are in another system.
    #[error(
        "the list is in {holes} and the pack in {pack}; give the list that kilwa merge wrote together with this model"
    )]
    System {
        /// That of the list.
        holes: String,
        /// That of the pack.
        pack: String,
    },
    /// It is too long for the page.
    #[error(
        "{} would take {bytes} bytes, more than the maximum of {HOLES_MAX} for the viewer; the list is sorted by area, so remove holes from its end, or merge with larger voxels",
        counted(*.holes, "hole", "holes")
    )]
    Long {
        /// How many holes.
        holes: usize,
        /// Length of the published form.
        bytes: usize,
    },
}

/// A hole.
#[derive(Debug, Clone, PartialEq)]
pub struct Hole {
    /// The cause of its largest part: an index in [`CAUSES`].
    pub cause: usize,
    /// Area that its rim encloses, square metres.
    pub area: f64,
    /// Length of its rim, metres.
    pub rim_length: f64,
    /// Middle of its rim.
    pub center: DVec3,
    /// Area due to each cause, square metres.
    pub areas: [f64; 4],
    /// Its rim, a closed line: the first point is not repeated.
    pub rim: Vec<DVec3>,
}

/// The holes of a version.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Holes {
    /// As in the file, largest first.
    pub holes: Vec<Hole>,
    /// Reference system of the survey, if stated.
    pub crs: Option<String>,
}

#[derive(Deserialize)]
struct File {
    #[serde(rename = "type")]
    kind: String,
    name: String,
    #[serde(default)]
    crs_of_survey: Option<String>,
    features: Vec<Feature>,
}

#[derive(Deserialize)]
struct Feature {
    geometry: Geometry,
    properties: Properties,
}

#[derive(Deserialize)]
struct Geometry {
    #[serde(rename = "type")]
    kind: String,
    coordinates: Vec<Vec<DVec3>>,
}

#[derive(Deserialize)]
struct Properties {
    cause: String,
    area_m2: f64,
    rim_m: f64,
    center: DVec3,
    areas_m2: Areas,
}

#[derive(Deserialize)]
struct Areas {
    unseen: f64,
    free: f64,
    dropped: f64,
    no_return: f64,
}

impl Feature {
    fn hole(self) -> Result<Hole, String> {
        let Self { geometry, properties: p } = self;
        let cause = CAUSES.iter().position(|c| *c == p.cause);
        let cause = cause.ok_or_else(|| format!("its cause is not one of {}", CAUSES.join(", ")))?;
        let areas = [p.areas_m2.unseen, p.areas_m2.free, p.areas_m2.dropped, p.areas_m2.no_return];
        if !areas.into_iter().chain([p.area_m2, p.rim_m]).all(|v| (0.0..FAR).contains(&v)) {
            return Err("its areas and the length of its rim must be finite and not negative".to_owned());
        }
        let mut rings = geometry.coordinates.into_iter();
        let (Some(mut rim), None, "Polygon") = (rings.next(), rings.next(), &*geometry.kind) else {
            return Err("its rim must be a Polygon with exactly one ring".to_owned());
        };
        if rim.len() < 4 || rim.first() != rim.last() {
            return Err("its rim must be a closed ring of at least three points".to_owned());
        }
        rim.pop();
        if !rim.iter().chain([&p.center]).all(|place| place.abs().max_element() < FAR) {
            return Err("its coordinates must be less than 1e12 m from zero".to_owned());
        }
        Ok(Hole { cause, area: p.area_m2, rim_length: p.rim_m, center: p.center, areas, rim })
    }
}

impl Holes {
    /// Read a list.
    ///
    /// # Errors
    /// [`HolesError`].
    pub fn parse(bytes: &[u8]) -> Result<Self, HolesError> {
        let file: File = kilwa_pack::json::from_slice(bytes).map_err(|e| HolesError::Form(e.to_string()))?;
        if file.kind != "FeatureCollection" || file.name != "holes" {
            return Err(HolesError::Form("expected a FeatureCollection named holes".to_owned()));
        }
        let numbered = file.features.into_iter().zip(1..);
        let holes = numbered.map(|(f, number)| f.hole().map_err(|what| HolesError::Hole { number, what }));
        Ok(Self { holes: holes.collect::<Result<_, _>>()?, crs: file.crs_of_survey })
    }

    /// Check that every rim lies in this bounding box of the model, metres, with a margin.
    ///
    /// # Errors
    /// [`HolesError::Hole`] for the first that is not.
    pub fn within(&self, min: DVec3, max: DVec3) -> Result<(), HolesError> {
        let margin = max.distance(min) * MARGIN;
        let is_near = |place: &DVec3| place.cmpge(min - margin).all() && place.cmple(max + margin).all();
        for (hole, number) in self.holes.iter().zip(1..) {
            if let Some(place) = hole.rim.iter().chain([&hole.center]).find(|place| !is_near(place)) {
                let [x, y, z] = place.to_array();
                let what = format!(
                    "{x} {y} {z} is outside of the model, which extends from {} {} {} to {} {} {}; give the list that kilwa merge wrote together with this model",
                    min.x, min.y, min.z, max.x, max.y, max.z
                );
                return Err(HolesError::Hole { number, what });
            }
        }
        Ok(())
    }

    /// Check that the list is in the reference system of a pack, where both state one.
    ///
    /// # Errors
    /// [`HolesError::System`].
    pub fn same_system(&self, of_pack: Option<&str>) -> Result<(), HolesError> {
        let normal = |text: &str| crs::normalise(text).ok().flatten().unwrap_or_else(|| text.to_owned());
        match (&self.crs, of_pack) {
            (Some(holes), Some(pack)) if normal(holes) != normal(pack) => {
                Err(HolesError::System { holes: holes.clone(), pack: pack.to_owned() })
            }
            _ => Ok(()),
        }
    }

    /// The list without what reveals a location on earth: moved by `offset` (what has to be added to the new coordinates to get the old ones), and
    /// without its reference system.
    #[must_use]
    pub fn without_place(mut self, offset: DVec3) -> Self {
        for hole in &mut self.holes {
            hole.center -= offset;
            for place in &mut hole.rim {
                *place -= offset;
            }
        }
        self.crs = None;
        self
    }

    /// The published form: GeoJSON in one line, as `kilwa merge` writes it, rounded to a micrometre.
    ///
    /// # Errors
    /// [`HolesError::Long`].
    pub fn to_bytes(&self) -> Result<Vec<u8>, HolesError> {
        let features: Vec<Value> = self.holes.iter().zip(1..).map(|(hole, number)| hole.feature(number)).collect();
        let list = json!({
            "type": "FeatureCollection",
            "name": "holes",
            "axes": "x, y, z in the survey, metres",
            "crs_of_survey": self.crs,
            "features": features,
        });
        let mut bytes = list.to_string().into_bytes();
        bytes.push(b'\n');
        if bytes.len() as u64 > HOLES_MAX {
            return Err(HolesError::Long { holes: self.holes.len(), bytes: bytes.len() });
        }
        Ok(bytes)
    }
}

impl Hole {
    fn feature(&self, number: usize) -> Value {
        let place = |p: &DVec3| p.to_array().map(rounded);
        let ring: Vec<[f64; 3]> = self.rim.iter().chain(self.rim.first()).map(place).collect();
        let [unseen, free, dropped, no_return] = self.areas.map(rounded);
        json!({
            "type": "Feature",
            "id": number,
            "geometry": { "type": "Polygon", "coordinates": [ring] },
            "properties": {
                "cause": CAUSES.get(self.cause),
                "area_m2": rounded(self.area),
                "rim_m": rounded(self.rim_length),
                "center": place(&self.center),
                "areas_m2": { "unseen": unseen, "free": free, "dropped": dropped, "no_return": no_return },
            },
        })
    }
}

/// Rounded to 1/`PARTS`; negative zero becomes zero.
fn rounded(v: f64) -> f64 {
    (v * PARTS).round() / PARTS + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A list of one hole, changed by `change`.
    fn one(change: &dyn Fn(&mut Value)) -> Vec<u8> {
        let mut list = json!({
            "type": "FeatureCollection", "name": "holes", "axes": "…", "crs_of_survey": "EPSG:32737",
            "features": [{
                "type": "Feature", "id": 7, "more": "unknown",
                "geometry": { "type": "Polygon", "coordinates": [[[1.0, 1.0, 2.0], [2.0, 1.0, 2.0], [1.5, 2.000_000_4, 2.0], [1.0, 1.0, 2.0]]] },
                "properties": { "cause": "free", "area_m2": 0.5, "rim_m": 3.2, "center": [1.5, 1.3, 2.0],
                    "areas_m2": { "unseen": 0.1, "free": 0.4, "dropped": 0.0, "no_return": -0.0 } },
            }],
        });
        change(&mut list);
        list.to_string().into_bytes()
    }

    fn refused(change: &dyn Fn(&mut Value)) -> String {
        Holes::parse(&one(change)).unwrap_err().to_string()
    }

    #[test]
    fn a_list_has_one_written_form_that_reads_back_unchanged() {
        let holes = Holes::parse(&one(&|_| {})).unwrap();
        assert_eq!((holes.holes.len(), holes.holes[0].rim.len(), holes.holes[0].cause), (1, 3, 1));
        let bytes = holes.to_bytes().unwrap();
        let again = Holes::parse(&bytes).unwrap();
        assert_eq!(again.to_bytes().unwrap(), bytes);
        assert_eq!(again.holes[0].rim[2], DVec3::new(1.5, 2.0, 2.0), "rounded to a micrometre");
        assert!(!String::from_utf8(bytes).unwrap().contains("unknown"));
        assert_eq!(Holes::parse(&Holes::default().to_bytes().unwrap()).unwrap(), Holes::default());
    }

    #[test]
    fn anything_but_a_list_of_holes_is_refused_with_the_reason() {
        for text in ["", "[]", "{}", "{\"type\":\"FeatureCollection\",\"features\":[]}"] {
            let why = Holes::parse(text.as_bytes()).unwrap_err().to_string();
            assert!(why.contains("kilwa merge --holes"), "{why}");
        }
        assert!(refused(&|v| v["name"] = "roads".into()).contains("named holes"));
        assert!(refused(&|v| v["features"][0]["properties"]["cause"] = "x".into()).contains("hole 1: its cause"));
        assert!(refused(&|v| v["features"][0]["properties"]["area_m2"] = (-1.0).into()).contains("not negative"));
        assert!(refused(&|v| v["features"][0]["geometry"]["type"] = "LineString".into()).contains("one ring"));
        assert!(refused(&|v| v["features"][0]["geometry"]["coordinates"] = json!([])).contains("one ring"));
        let open = |v: &mut Value| v["features"][0]["geometry"]["coordinates"][0][3] = json!([9, 9, 9]);
        assert!(refused(&open).contains("closed ring"));
        assert!(
            refused(&|v| v["features"][0]["geometry"]["coordinates"][0][1] = json!([1, 2])).contains("kilwa merge")
        );
        // JSON has no infinity; a number beyond the largest is refused by the parser.
        let text = String::from_utf8(one(&|_| {})).unwrap().replace("3.2", "1e999");
        assert!(Holes::parse(text.as_bytes()).is_err());
    }

    #[test]
    fn holes_of_another_model_or_system_are_refused() {
        let holes = Holes::parse(&one(&|_| {})).unwrap();
        let (min, max) = (DVec3::ZERO, DVec3::splat(3.0));
        assert_eq!(holes.within(min, max), Ok(()));
        let why = holes.within(min + 100.0, max + 100.0).unwrap_err().to_string();
        assert!(why.starts_with("hole 1: 1 1 2 is outside of the model"), "{why}");
        assert_eq!(holes.same_system(Some("epsg:32737")), Ok(()));
        assert_eq!(holes.same_system(None), Ok(()));
        let why = holes.same_system(Some("EPSG:32736")).unwrap_err().to_string();
        assert!(why.contains("EPSG:32737") && why.contains("EPSG:32736"), "{why}");
    }

    #[test]
    fn a_list_without_its_location_is_moved_and_names_no_reference_system() {
        let offset = DVec3::new(565_000.0, 9_009_000.0, 0.0);
        let mut holes = Holes::parse(&one(&|_| {})).unwrap();
        let here = holes.clone();
        for hole in &mut holes.holes {
            hole.center += offset;
            hole.rim.iter_mut().for_each(|p| *p += offset);
        }
        let moved = holes.without_place(offset);
        assert_eq!(moved.to_bytes().unwrap(), Holes { crs: None, ..here }.to_bytes().unwrap());
    }

    #[test]
    fn a_list_too_large_for_the_page_is_refused() {
        let mut holes = Holes::parse(&one(&|_| {})).unwrap();
        let rim = vec![DVec3::new(123_456.789_123, 9_123_456.789_123, 12.345_678); 450_000];
        holes.holes[0].rim = rim;
        let why = holes.to_bytes().unwrap_err().to_string();
        assert!(why.starts_with("1 hole would take") && why.contains("larger voxels"), "{why}");
    }
}
