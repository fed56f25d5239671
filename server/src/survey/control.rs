//! Control points that somebody marks in the pictures of two stations: the page, the sample at a place of a picture, and how well the marked pairs fit.
//!
//! Nothing is written: the page shows entries to copy into `survey.toml`, and keeps what was marked in the browser. Invariants: a sample is one that the picture
//! shows, so what masks hide cannot be marked; pairs are aligned as registration aligns them ([`align_points`]); no more than [`PAIRS_MAX`] pairs
//! of finite coordinates are aligned. Failures: a place without a sample is 404, a request that cannot be read 400.

use super::control_page::{self, Chosen};
use super::pictures::{self, shown};
use super::registered::best_match;
use super::routes::{self, Found, Missing};
use super::{Facts, Surveyed};
use crate::packs::blocking;
use crate::portal::pairs;
use crate::portal::routes::{Given, for_reader};
use crate::site::{Site, lost};
use axum::body::Bytes;
use axum::extract::{Path, RawQuery, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse as _, Response};
use glam::DVec3;
use kilwa_scan::panorama::{Picked, Show, WIDTH_MAX, pick};
use kilwa_scan::register::{MIN_POINTS, PointPair, Registration, align_points, common_points};
use kilwa_scan::survey::{Station, Survey};
use serde::{Deserialize, Serialize};
use std::fmt::Write as _;
use std::sync::Arc;

/// Pairs of one request.
const PAIRS_MAX: usize = 64;
/// Largest coordinate in a station, metres: scans are refused from 10 km on.
const COORDINATE_MAX: f64 = 20_000.0;
/// Standard deviations of a marked place, metres: the smallest that is stated, the one where there are no samples around, and the largest that is accepted.
const SIGMA: [f64; 3] = [0.002, 0.005, 100.0];
/// Coordinates of the same point differ by less, because they are written to `survey.toml` with four digits; metres.
const SAME: f64 = 1e-4;

/// What a picture shows that somebody marks places in, the most useful first: intensity is measured with the range, colours often from another place.
const PREFERRED: [Show; 3] = [Show::Intensity, Show::Colour, Show::Range];

/// `/control/`
pub(super) async fn page(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let Some(surveyed) = site.survey.clone() else { return lost() };
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let reader = given.reader();
    let names = ["a", "b"].map(|name| given.get(name).map(str::to_owned));
    let reading = Arc::clone(&surveyed);
    let (survey, stations) = match blocking(move || choose(&reading, names)).await {
        Ok(Ok(found)) => found,
        Ok(Err(why)) => return routes::missing(why, &reader, &headers),
        Err(status) => return status.into_response(),
    };
    let kinds: Vec<Show> = offered(&stations);
    let asked = given.get("show").and_then(routes::named).filter(|show| kinds.contains(show));
    let show = asked.or_else(|| usual(&stations));
    let mut chosen = Vec::new();
    let is_pair = matches!(&stations, [Some((a, _)), Some((b, _))] if a.name != b.name);
    for (station, facts) in stations.iter().flatten().filter(|_| is_pair) {
        let own = show.filter(|show| shown(station, facts).contains(show)).or_else(|| usual_of(station, facts));
        let own = own.unwrap_or(Show::Range);
        let picture = match &facts.header {
            Ok(_) => pictures::whole(&surveyed, station, facts, own).await,
            Err(why) => Err(why.clone()),
        };
        chosen.push(Chosen { station, facts, show: own, picture });
    }
    let names = stations.each_ref().map(|station| station.as_ref().map(|(station, _)| station.name.as_str()));
    for_reader(control_page::page(&survey, names, &kinds, asked, &chosen, &reader), &reader, &headers)
}

/// Two stations that were chosen, and what is known of them.
type Pair = [Option<(Station, Arc<Facts>)>; 2];

/// The stations of these names. If only the first is named and it could not be placed, the second is the one that it fits best.
fn choose(surveyed: &Surveyed, names: [Option<String>; 2]) -> Result<(Arc<Survey>, Pair), Missing> {
    let survey = surveyed.survey().map_err(Missing::Mistakes)?;
    let [a, mut b] = names;
    if let (Some(name), None) = (&a, &b) {
        // Stations may have been renamed since.
        let registration = surveyed.registration().ok().flatten().map(|found| found.with_current_names(&survey));
        b = registration.and_then(|found| best_match(&found, &survey, name).map(str::to_owned));
    }
    let find = |name: Option<String>| match name.filter(|name| !name.is_empty()) {
        None => Ok(None),
        Some(name) => {
            let station = survey.station(&name).map_err(|_| Missing::Unknown)?;
            Ok(Some((station.clone(), surveyed.facts(station))))
        }
    };
    let found = [find(a)?, find(b)?];
    Ok((survey, found))
}

/// What there is to choose from: what at least one of the stations has a picture of.
fn offered(stations: &Pair) -> Vec<Show> {
    let all: Vec<Show> = stations.iter().flatten().flat_map(|(station, facts)| shown(station, facts)).collect();
    let kinds = [Show::Range, Show::Intensity, Show::Colour];
    kinds.into_iter().filter(|show| all.contains(show)).collect()
}

/// What is shown at first: the most useful picture that both stations have.
fn usual(stations: &Pair) -> Option<Show> {
    let has = |show: &Show| stations.iter().flatten().all(|(station, facts)| shown(station, facts).contains(show));
    PREFERRED.into_iter().find(has)
}

fn usual_of(station: &Station, facts: &Facts) -> Option<Show> {
    let shown = shown(station, facts);
    PREFERRED.into_iter().find(|show| shown.contains(show))
}

/// A sample that was marked, in the coordinates of its station.
#[derive(Serialize)]
struct Sample {
    /// Column and row of the picture with every cell.
    cell: [u32; 2],
    /// Metres, to a tenth of a millimetre.
    at: [f64; 3],
    /// Standard deviation of a coordinate, metres.
    sigma: f64,
    /// Distance from the scanner, metres.
    range: f64,
}

/// `/stations/<name>/at/<column>-<row>.json`; `?width=<cells>` says how many cells the reader sees as one pixel.
pub(super) async fn sample(
    State(site): State<Site>,
    Path((name, place)): Path<(String, String)>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let Some(cell) = place.strip_suffix(".json").and_then(routes::column_and_row) else { return lost() };
    let query = pairs(query.as_deref().unwrap_or_default());
    let width = query.iter().find(|(name, _)| name == "width").map_or(Some(1), |(_, value)| routes::number(value));
    let Some(width) = width.filter(|width| (1..=WIDTH_MAX).contains(width)) else {
        return refused(StatusCode::BAD_REQUEST, &format!("width must be a number from 1 to {WIDTH_MAX}"));
    };
    let Found { surveyed, station, facts, .. } = match routes::drawable(&site, &name, Show::Range).await {
        Ok(found) => found,
        Err(why) => return routes::no_picture(why),
    };
    let etag = routes::tag(&format!("{} at {}-{} {width}", facts.identity, cell[0], cell[1]));
    if routes::is_known(&etag, &headers) {
        return routes::unchanged(&etag);
    }
    // The orientation of the picture is determined when it is drawn, whatever it shows; the page shows this one first.
    let show = usual_of(&station, &facts).unwrap_or(Show::Range);
    let frame = match pictures::whole(&surveyed, &station, &facts, show).await {
        Ok(drawn) => drawn.frame,
        Err(why) => return routes::broken(&why),
    };
    let Some(frame) = frame.filter(|frame| cell.iter().zip(frame.size).all(|(at, size)| *at < size)) else {
        return refused(StatusCode::NOT_FOUND, "the picture has no such cell");
    };
    let found = blocking(move || {
        let picked = surveyed.reader(&station, false).and_then(|mut reader| pick(&mut reader, &frame, cell, width));
        picked.map_err(|e| surveyed.fault(&facts, &e))
    });
    match found.await {
        Ok(Ok(Some(picked))) => {
            let mut response = json(StatusCode::OK, &Sample::new(&picked, width));
            routes::add_tag(&mut response, &etag);
            response
        }
        Ok(Ok(None)) => refused(StatusCode::NOT_FOUND, "there is no sample in this cell, or a mask hides it"),
        Ok(Err(why)) => routes::broken(&why),
        Err(status) => status.into_response(),
    }
}

impl Sample {
    /// A place that was marked where `width` cells are seen as one pixel.
    fn new(picked: &Picked, width: u32) -> Self {
        let at = picked.position.as_dvec3();
        Self {
            cell: picked.cell,
            at: at.to_array().map(|v| rounded(v, 1e4)),
            sigma: sigma(picked.spacing, width),
            range: rounded(at.length(), 1e4),
        }
    }
}

fn rounded(value: f64, per_metre: f64) -> f64 {
    // -0 is 0.
    (value * per_metre).round() / per_metre + 0.0
}

/// The standard deviation of a place that somebody marked: a person chooses the nearest sample to what they mean, which is off by up to half the
/// distance to the next ones. Rounded up to millimetres.
fn sigma(spacing: Option<f32>, width: u32) -> f64 {
    let [min, unknown, max] = SIGMA;
    let half = spacing.map_or(unknown, |spacing| 0.5 * f64::from(spacing) * f64::from(width));
    // Do not round up what is only the rounding of the coordinates.
    ((half * 1000.0 - 1e-3).ceil() / 1000.0).clamp(min, max)
}

/// What the page sends: the pairs that are marked.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Asked {
    a: String,
    b: String,
    pairs: Vec<Marks>,
}

/// A place in both stations.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Marks {
    a: Mark,
    b: Mark,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mark {
    at: [f64; 3],
    sigma: f64,
}

impl Asked {
    fn read(body: &[u8]) -> Result<Self, String> {
        let asked: Self = serde_json::from_slice(body).map_err(|e| e.to_string())?;
        if asked.a == asked.b {
            return Err("a and b must be two different stations".to_owned());
        }
        if asked.pairs.len() > PAIRS_MAX {
            return Err(format!("{} pairs; at most {PAIRS_MAX} are aligned", asked.pairs.len()));
        }
        let is_sound = |mark: &Mark| {
            let [min, _, max] = SIGMA;
            mark.at.iter().all(|v| v.abs() <= COORDINATE_MAX) && (min..=max).contains(&mark.sigma)
        };
        if asked.pairs.iter().any(|pair| !is_sound(&pair.a) || !is_sound(&pair.b)) {
            return Err("a coordinate or a standard deviation is out of range".to_owned());
        }
        Ok(asked)
    }

    fn pairs(&self) -> Vec<PointPair> {
        let pair = |Marks { a, b }: &Marks| PointPair {
            at: [&a.at, &b.at].map(|at| DVec3::from_array(*at)),
            sigma: [a.sigma, b.sigma],
        };
        self.pairs.iter().map(pair).collect()
    }
}

/// How well the pairs fit, and the entries for `survey.toml`.
#[derive(Serialize)]
struct Answer {
    /// The marked pairs, in the order in which they were sent.
    pairs: Vec<Point>,
    /// The other control points of both stations in `survey.toml`, by name.
    known: Vec<Point>,
    /// `few`: more pairs are needed; `line`: they are collinear; `check`: they do not fit each other; `fits`.
    state: &'static str,
    /// How many pairs are missing to three.
    missing: usize,
    /// The name of the pair that is most likely wrong. Of three pairs, none can be singled out.
    suspect: Option<String>,
    /// Entries of the marked pairs that are not in `survey.toml` yet.
    entries: String,
    /// Whether both stations would keep their poses unless all are registered again.
    again: bool,
    /// Whether both are fixed in `survey.toml`: registering again does not change their poses either.
    fixed: bool,
}

#[derive(Serialize)]
struct Point {
    name: String,
    /// What its marks are labelled with.
    label: String,
    /// Its coordinates in both stations, metres.
    at: [[f64; 3]; 2],
    /// The distance after the best rigid alignment, metres.
    residual: Option<f64>,
    /// Whether it is in `survey.toml`.
    known: bool,
}

/// `/control/fit`
pub(super) async fn fit(State(site): State<Site>, body: Bytes) -> Response {
    let Some(surveyed) = site.survey.clone() else { return lost() };
    let asked = match Asked::read(&body) {
        Ok(asked) => asked,
        Err(why) => return refused(StatusCode::BAD_REQUEST, &why),
    };
    let found = blocking(move || {
        let survey = surveyed.survey().map_err(Missing::Mistakes)?;
        let station = |name: &str| survey.station(name).map_err(|_| Missing::Unknown);
        let stations = [station(&asked.a)?, station(&asked.b)?];
        let registration = surveyed.registration().ok().flatten();
        Ok(Answer::new(&survey, stations, &asked.pairs(), registration.as_deref()))
    });
    match found.await {
        Ok(Ok(answer)) => json(StatusCode::OK, &answer),
        Ok(Err(Missing::Unknown)) => refused(StatusCode::NOT_FOUND, "the survey has no station of this name"),
        Ok(Err(why)) => routes::no_picture(why),
        Err(status) => status.into_response(),
    }
}

impl Answer {
    fn new(survey: &Survey, [a, b]: [&Station; 2], pairs: &[PointPair], registration: Option<&Registration>) -> Self {
        let mut others = common_points(survey, a, b);
        let names = Names::new(survey, a, b);
        let mut marked: Vec<(String, bool)> = Vec::new();
        let mut new = Vec::new();
        for pair in pairs {
            // What was marked and then entered in survey.toml is there under a name, perhaps another one.
            let entered = others.iter().position(|(_, other)| is_same(pair, other));
            if let Some(entered) = entered {
                marked.push((others.remove(entered).0, true));
            } else {
                let name = names.of(new.len());
                marked.push((name.clone(), false));
                new.push((name, *pair));
            }
        }
        let all: Vec<PointPair> = pairs.iter().copied().chain(others.iter().map(|(_, pair)| *pair)).collect();
        let alignment = align_points(&all);
        let named = marked.into_iter().chain(others.into_iter().map(|(name, _)| (name, true)));
        let mut points: Vec<Point> = named
            .zip(&all)
            .enumerate()
            .map(|(k, ((name, known), pair))| Point {
                label: names.label(&name),
                name,
                at: pair.at.map(|at| at.to_array()),
                residual: alignment.as_ref().map(|found| found.residuals[k]),
                known,
            })
            .collect();
        let wrong = alignment.as_ref().and_then(|found| found.suspect);
        // Without one of three pairs, too few are left for an alignment.
        let suspect = wrong.filter(|_| all.len() > MIN_POINTS).map(|k| points[k].name.clone());
        let keeps_pose =
            |station: &Station| station.is_fixed || registration.is_some_and(|found| found.of(station).is_some());
        let is_fixed = a.is_fixed && b.is_fixed;
        Self {
            state: match &alignment {
                None if all.len() < MIN_POINTS => "few",
                None => "line",
                Some(_) if wrong.is_some() => "check",
                Some(_) => "fits",
            },
            missing: MIN_POINTS.saturating_sub(all.len()),
            suspect,
            known: points.split_off(pairs.len()),
            pairs: points,
            entries: entries([a, b], &new),
            again: keeps_pose(a) && keeps_pose(b) && !is_fixed,
            fixed: is_fixed,
        }
    }
}

fn is_same(a: &PointPair, b: &PointPair) -> bool {
    a.at.iter().zip(b.at).all(|(a, b)| (*a - b).abs().max_element() < SAME)
}

/// Names for new control points of two stations: no others have them, because no name of a station contains a +.
struct Names {
    start: String,
    /// The number of the first.
    first: u64,
}

impl Names {
    fn new(survey: &Survey, a: &Station, b: &Station) -> Self {
        // The same in both orders.
        let both = survey.stations.iter().filter(|station| station.name == a.name || station.name == b.name);
        let both: Vec<&str> = both.map(|station| station.name.as_str()).collect();
        let start = format!("{}-", both.join("+"));
        let numbers = survey.controls.iter().filter_map(|control| control.name.strip_prefix(&start)?.parse().ok());
        // A number that somebody made up may be any.
        let first = numbers.filter(|number| *number < u64::from(u32::MAX)).max().unwrap_or(0) + 1;
        Self { start, first }
    }

    fn of(&self, number: usize) -> String {
        format!("{}{}", self.start, self.first + number as u64)
    }

    fn label(&self, name: &str) -> String {
        name.strip_prefix(&self.start).unwrap_or(name).to_owned()
    }
}

/// The entries of control points, to append to `survey.toml`.
fn entries(stations: [&Station; 2], points: &[(String, PointPair)]) -> String {
    if points.is_empty() {
        return String::new();
    }
    let [a, b] = stations.map(|station| &station.name);
    let mut text = format!(
        "\n# Control points that were marked in the pictures of stations {a} and {b} (kilwa serve).\n\
         # sigma is half the distance between neighbouring samples, as marked, but at least 2 mm: a person can only choose one of the samples.\n"
    );
    for (name, pair) in points {
        for ((station, at), sigma) in stations.iter().zip(pair.at).zip(pair.sigma) {
            // Writing to a String cannot fail. The names of stations have no characters that TOML would escape.
            let _ = write!(
                text,
                "\n[[control]]\nname = \"{name}\"\nstation = \"{}\"\nat = [{:.4}, {:.4}, {:.4}]\nsigma = {sigma:.3}\n",
                station.name, at.x, at.y, at.z
            );
        }
    }
    text
}

fn json(status: StatusCode, value: &impl Serialize) -> Response {
    match serde_json::to_string(value) {
        Ok(text) => (status, [(CONTENT_TYPE, "application/json")], text).into_response(),
        Err(_) => StatusCode::INTERNAL_SERVER_ERROR.into_response(),
    }
}

/// Why a request is not answered.
fn refused(status: StatusCode, reason: &str) -> Response {
    json(status, &serde_json::json!({ "reason": reason }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_standard_deviation_is_half_the_spacing_but_at_least_two_millimetres() {
        for (spacing, width, expected) in [
            (Some(0.001), 1, 0.002),
            (Some(0.008), 1, 0.004),
            (Some(0.0081), 1, 0.005),
            (Some(0.008), 3, 0.012),
            (Some(f32::MAX), WIDTH_MAX, 100.0),
            (None, 1, 0.005),
        ] {
            let found = sigma(spacing, width);
            assert!((found - expected).abs() < 1e-9, "{spacing:?} {width}: {found}");
        }
    }
}
