//! What can be written and is hardly meant: coordinates on the wrong side of the equator, metres for millimetres. Said, never refused.
//!
//! Countries are compared by hemisphere, which is what a wrong sign changes; a pack's UTM zone says more where it has one.

use super::{Metadata, crs};
use crate::AccessState;

/// ISO 3166-1, two letters, by where a country lies: wholly south of the equator.
const SOUTH: &str = "AO AQ AR AS AU BI BO BV BW CK CL CX FJ FK GS HM IO KM LS MG MU MW MZ NA NC NF NR NU NZ PE PF PG PN PY RE RW SB SC \
    SH SZ TF TK TL TO TV TZ UY VU WF WS YT ZA ZM ZW";
/// On both sides of the equator.
const BOTH: &str = "BR CD CG CO EC GA GQ ID KE KI MV SO ST UG UM";
/// Wholly north of it.
const NORTH: &str = "AD AE AF AG AI AL AM AT AW AX AZ BA BB BD BE BF BG BH BJ BL BM BN BQ BS BT BY BZ CA CC CF CH CI CM CN CR CU CV CW CY \
    CZ DE DJ DK DM DO DZ EE EG EH ER ES ET FI FM FO FR GB GD GE GF GG GH GI GL GM GN GP GR GT GU GW GY HK HN HR HT HU IE IL IM IN IQ IR IS \
    IT JE JM JO JP KG KH KN KP KR KW KY KZ LA LB LC LI LK LR LT LU LV LY MA MC MD ME MF MH MK ML MM MN MO MP MQ MR MS MT MX MY NE NG NI NL \
    NO NP OM PA PH PK PL PM PR PS PT PW QA RO RS RU SA SD SE SG SI SJ SK SL SM SN SR SS SV SX SY TC TD TG TH TJ TM TN TR TT TW UA US UZ VA \
    VC VE VG VI VN XK YE";
/// Wholly west of Greenwich.
const WEST: &str = "AG AI AR AS AW BB BL BM BO BQ BR BS BZ CA CI CK CL CO CR CU CV CW DM DO EC EH FK FO GD GF GG GL GM GN GP GS GT GW GY HN \
    HT IE IM IS JE JM KN KY LC LR MA MF MQ MR MS MX NI NU PA PE PF PM PN PR PT PY SH SL SN SR SV SX TC TK TO TT UY VC VE VG VI WF WS";
/// On both sides of it, or of the line opposite.
const AROUND: &str = "AQ BF DZ ES FJ FR GB GH KI ML NZ RU TG UM US";

fn is_in(list: &str, code: &str) -> bool {
    list.split_whitespace().any(|c| c == code)
}

/// What is hardly meant, for people; `today` is a day.
pub fn warnings(m: &Metadata, pack: &kilwa_pack::Metadata, today: &str) -> Vec<String> {
    let mut all = Vec::new();
    if let Some(place) = &m.place {
        if let Some(code) = place.country.as_deref() {
            country(code, place.latitude, place.longitude, &mut all);
        }
        if let (Some(latitude), Some(longitude)) = (place.latitude, place.longitude) {
            zone(latitude, longitude, pack, &mut all);
        }
    }
    let accuracy = pack.capture_accuracy.or_else(|| m.capture.as_ref().and_then(|c| c.accuracy));
    if let Some(accuracy) = accuracy.filter(|_| pack.median_edge > 0.0) {
        let edge = pack.median_edge;
        if accuracy > edge * 100.0 {
            all.push(format!(
                "capture.accuracy is {accuracy} m, but the points of the mesh are {edge:.2e} m apart; the accuracy is in metres: 3 mm is 0.003"
            ));
        } else if accuracy < edge / 1000.0 {
            all.push(format!(
                "capture.accuracy is {accuracy} m, but the points of the mesh are {edge:.2e} m apart; is it the accuracy of a single point?"
            ));
        }
    }
    if let Some(date) = m.capture.as_ref().and_then(|c| c.date.as_deref()) {
        let last = date.rsplit('/').next().unwrap_or(date);
        if last > today.get(..last.len()).unwrap_or(today) {
            all.push(format!("capture.date is {date}, and today is {today}"));
        }
    }
    let access = m.access.as_ref().filter(|a| a.state == AccessState::Embargo);
    if let Some(until) = access.and_then(|a| a.until.as_deref()).filter(|until| *until <= today) {
        all.push(format!("access.until is {until}, so the model would be public at once (today is {today})"));
    }
    all
}

fn country(code: &str, latitude: Option<f64>, longitude: Option<f64>, all: &mut Vec<String>) {
    let known = [SOUTH, BOTH, NORTH].iter().any(|list| is_in(list, code));
    if !known {
        all.push(format!("place.country is {code}, which is not a country code of ISO 3166-1"));
        return;
    }
    let wrong = |is_wrong: bool, field: &str, value: f64, side: &str| {
        is_wrong.then(|| format!("place.{field} is {value}, and {code} lies {side}; is its sign wrong, or are latitude and longitude swapped?"))
    };
    if let Some(v) = latitude {
        all.extend(wrong(is_in(SOUTH, code) && v > 0.0, "latitude", v, "south of the equator, where it is negative"));
        all.extend(wrong(is_in(NORTH, code) && v < 0.0, "latitude", v, "north of the equator, where it is positive"));
    }
    if let Some(v) = longitude.filter(|_| !is_in(AROUND, code)) {
        let is_west = is_in(WEST, code);
        all.extend(wrong(is_west && v > 0.0, "longitude", v, "west of Greenwich, where it is negative"));
        all.extend(wrong(!is_west && v < 0.0, "longitude", v, "east of Greenwich, where it is positive"));
    }
}

/// Whether the place is where the pack's UTM zone is.
fn zone(latitude: f64, longitude: f64, pack: &kilwa_pack::Metadata, all: &mut Vec<String>) {
    let code = pack.crs.as_deref().and_then(|text| crs::normalise(text).ok().flatten());
    let code = code.as_deref().and_then(|c| c.strip_prefix("EPSG:")).and_then(|c| c.parse::<u32>().ok());
    let Some((number, is_south)) = code.and_then(|code| match code {
        32_601..=32_660 => Some((code - 32_600, false)),
        32_701..=32_760 => Some((code - 32_700, true)),
        _ => None,
    }) else {
        return;
    };
    let middle = f64::from(number) * 6.0 - 183.0;
    // Zones are used some way beyond their borders, also across the equator.
    let apart = (longitude - middle + 540.0).rem_euclid(360.0) - 180.0;
    let is_beyond = if is_south { latitude > 5.0 } else { latitude < -5.0 };
    if apart.abs() > 6.0 || is_beyond {
        let half = if is_south { "S" } else { "N" };
        all.push(format!(
            "place.latitude and longitude are {latitude}, {longitude}, and the pack lies in UTM zone {number} {half} (about {middle}° east); is a sign wrong, or are they swapped?"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pack(crs: Option<&str>, edge: f64) -> kilwa_pack::Metadata {
        kilwa_pack::Metadata {
            title: String::new(),
            source_units: "m".to_owned(),
            source_up: "z".to_owned(),
            crs: crs.map(str::to_owned),
            lattice_step: 0.001,
            bounds_min: glam::DVec3::ZERO,
            bounds_max: glam::DVec3::ONE,
            median_edge: edge,
            triangles: 1,
            vertices: 3,
            border_edges: 3,
            scalars: Vec::new(),
            sources: Vec::new(),
            tool: String::new(),
            options: std::collections::BTreeMap::new(),
            capture_accuracy: None,
            capture_registration: None,
            capture_instrument: None,
            repairs: std::collections::BTreeMap::new(),
        }
    }

    fn joined_warnings(more: &str, crs: Option<&str>) -> String {
        let text = format!("title = \"t\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n{more}");
        warnings(&Metadata::parse(&text).unwrap(), &pack(crs, 0.001), "2026-11-21").join("\n")
    }

    #[test]
    fn correct_metadata_gives_no_warnings() {
        for place in [
            "country = \"TZ\"\nlatitude = -8.9577\nlongitude = 39.5228",
            "country = \"PE\"\nlatitude = -13.2\nlongitude = -72.5",
            "country = \"GB\"\nlatitude = 51.5\nlongitude = 0.1",
            "country = \"NZ\"\nlatitude = -43.9\nlongitude = -176.5",
        ] {
            assert_eq!(
                joined_warnings(&format!("[place]\n{place}\n[capture]\naccuracy = 0.003\ndate = \"2026\""), None),
                ""
            );
        }
        let fort = "[place]\nlatitude = -8.9577\nlongitude = 39.5228\n";
        assert_eq!(joined_warnings(fort, Some("EPSG:32737")), "");
    }

    #[test]
    fn implausible_signs_codes_units_and_dates_give_warnings() {
        let place = |text: &str| joined_warnings(&format!("[place]\n{text}\n"), None);
        assert!(place("country = \"XX\"").contains("not a country code"));
        assert!(place("country = \"TZ\"\nlatitude = 8.9577\nlongitude = 39.5").contains("south of the equator"));
        assert!(place("country = \"TZ\"\nlatitude = -8.9\nlongitude = -39.5").contains("east of Greenwich"));
        assert!(place("country = \"DE\"\nlatitude = -50\nlongitude = 8").contains("north of the equator"));
        assert!(place("country = \"MX\"\nlatitude = 20\nlongitude = 90").contains("west of Greenwich"));
        let swapped = joined_warnings("[place]\nlatitude = 39.5228\nlongitude = -8.9577\n", Some("EPSG:32737"));
        assert!(swapped.contains("UTM zone 37 S"), "{swapped}");
        assert!(joined_warnings("[capture]\naccuracy = 3.0\n", None).contains("3 mm is 0.003"));
        assert!(joined_warnings("[capture]\ndate = \"2027-01\"\n", None).contains("today is 2026-11-21"));
        assert!(
            joined_warnings("[access]\nstate = \"embargo\"\nuntil = 2026-11-21\n", None)
                .contains("would be public at once")
        );
    }

    #[test]
    fn every_code_is_in_exactly_one_list() {
        let all: Vec<&str> = [SOUTH, BOTH, NORTH].iter().flat_map(|l| l.split_whitespace()).collect();
        let set: std::collections::BTreeSet<&str> = all.iter().copied().collect();
        assert_eq!((all.len(), set.len()), (250, 250), "249 of ISO 3166-1, and XK");
        assert!(WEST.split_whitespace().chain(AROUND.split_whitespace()).all(|c| set.contains(c)));
    }
}
