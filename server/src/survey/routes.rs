//! The routes of a survey.

use super::pictures::{self, Drawn, SHOWN, shown};
use super::plan::Known;
use super::{Facts, Surveyed, control, plan_page, station};
use crate::budget::lean;
use crate::content::text;
use crate::gate::{Gate, Passing, pass};
use crate::packs::blocking;
use crate::portal::frame::Reader;
use crate::portal::limit::short_query;
use crate::portal::routes::{Given, for_reader};
use crate::range::lists;
use crate::site::{Site, lost};
use axum::Router;
use axum::extract::{Path, RawQuery, State};
use axum::http::header::{CONTENT_TYPE, ETAG, IF_NONE_MATCH, LOCATION};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::middleware::from_fn_with_state;
use axum::response::{IntoResponse as _, Response};
use axum::routing::{get, post};
use kilwa_scan::panorama::Show;
use kilwa_scan::survey::{Station, Survey};
use std::sync::Arc;

/// Pictures that are drawn at once, in all and for one network: each takes up to about a hundred megabytes while it is drawn.
const AT_ONCE: usize = 4;
const SHARE: usize = 2;

const STYLE: &str = include_str!("../../assets/survey.css");
const SCRIPT: &str = include_str!("../../assets/survey.js");
const CONTROL_SCRIPT: &str = include_str!("../../assets/control.js");

pub(crate) fn routes(site: &Site) -> Router<Site> {
    let behind_proxy = site.behind_proxy;
    let short = || from_fn_with_state(site.clone(), short_query);
    let gated = |router: Router<Site>, gate: Gate| {
        router.route_layer(from_fn_with_state(Passing { gate: Arc::new(gate), behind_proxy }, pass))
    };
    let plan = Router::new().route("/", get(plan_page)).route("/plan.png", get(background));
    let stations = Router::new()
        .route("/stations/{name}/", get(station_page))
        .route("/stations/{name}/{file}", get(picture))
        .route("/stations/{name}/at/{place}", get(control::sample))
        .route("/stations/{name}/{show}/{part}", get(part))
        .route("/control/", get(control::page));
    let fits = Router::new().route("/control/fit", post(control::fit));
    gated(plan.route_layer(short()), Gate::of(AT_ONCE, SHARE))
        .merge(gated(fits.route_layer(short()), Gate::default()))
        .merge(gated(stations.route_layer(short()), Gate::of(AT_ONCE, SHARE)))
        .route("/stations/{name}", get(towards))
        .route("/survey.css", get(|headers: HeaderMap| async move { file(STYLE, "text/css", &headers) }))
        .route("/control", get(|| async { (StatusCode::PERMANENT_REDIRECT, [(LOCATION, "/control/")]) }))
        .route("/survey.js", get(|headers: HeaderMap| async move { file(SCRIPT, "text/javascript", &headers) }))
        .route(
            "/control.js",
            get(|headers: HeaderMap| async move { file(CONTROL_SCRIPT, "text/javascript", &headers) }),
        )
}

/// What is known of all stations, in the order of the survey.
fn all(surveyed: &Surveyed, survey: &Survey) -> Vec<Arc<Facts>> {
    survey.stations.iter().map(|station| surveyed.facts(station)).collect()
}

fn known<'a>(survey: &'a Survey, facts: &'a [Arc<Facts>]) -> Vec<Known<'a>> {
    survey.stations.iter().zip(facts).collect()
}

/// `/`
async fn plan_page(State(site): State<Site>, RawQuery(query): RawQuery, headers: HeaderMap) -> Response {
    let Some(surveyed) = site.survey.clone() else { return lost() };
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let found = blocking(move || {
        let survey = surveyed.survey()?;
        let facts = all(&surveyed, &survey);
        let plan = surveyed.plan(&survey, &known(&survey, &facts));
        // A station may have been renamed since.
        let found = surveyed.registration().map(|found| found.map(|found| Arc::new(found.with_current_names(&survey))));
        Ok::<_, Arc<str>>((survey, facts, plan, found))
    });
    let reader = given.reader();
    match found.await {
        Ok(Ok((survey, facts, plan, registration))) => {
            let stations = known(&survey, &facts);
            for_reader(plan_page::page(&survey, &stations, plan.as_deref(), &registration, &reader), &reader, &headers)
        }
        Ok(Err(why)) => mistakes(&why, &reader, &headers),
        Err(status) => status.into_response(),
    }
}

/// `/plan.png`
async fn background(State(site): State<Site>, headers: HeaderMap) -> Response {
    let Some(surveyed) = site.survey.clone() else { return lost() };
    let reading = Arc::clone(&surveyed);
    let found = blocking(move || {
        let survey = reading.survey().ok()?;
        let facts = all(&reading, &survey);
        let plan = reading.plan(&survey, &known(&survey, &facts))?;
        Some((survey, facts, plan))
    });
    let (survey, facts, plan) = match found.await {
        Ok(Some(found)) => found,
        Ok(None) => return StatusCode::NOT_FOUND.into_response(),
        Err(status) => return status.into_response(),
    };
    let key = format!("plan {}", plan.key);
    let etag = tag(&key);
    if is_known(&etag, &headers) {
        return unchanged(&etag);
    }
    let drawing = Arc::clone(&surveyed);
    let draw = move || drawing.draw_plan(&plan, &known(&survey, &facts));
    png(surveyed.pictures.get(&key, draw).await, &etag)
}

/// A station that an address names.
pub(super) struct Found {
    pub(super) surveyed: Arc<Surveyed>,
    pub(super) survey: Arc<Survey>,
    pub(super) station: Station,
    pub(super) facts: Arc<Facts>,
}

/// Why there is none.
pub(super) enum Missing {
    Unknown,
    /// In `survey.toml`.
    Mistakes(Arc<str>),
    /// The station cannot be read.
    Broken(String),
    Status(StatusCode),
}

async fn find(site: &Site, name: &str) -> Result<Found, Missing> {
    let surveyed = site.survey.clone().ok_or(Missing::Unknown)?;
    let name = name.to_owned();
    let found = blocking(move || {
        let survey = surveyed.survey().map_err(Missing::Mistakes)?;
        let station = survey.stations.iter().find(|station| station.name == name).cloned();
        let station = station.ok_or(Missing::Unknown)?;
        let facts = surveyed.facts(&station);
        Ok(Found { surveyed, survey, station, facts })
    });
    found.await.map_err(Missing::Status)?
}

/// A station's address without its last slash.
async fn towards(State(site): State<Site>, Path(name): Path<String>) -> Response {
    match find(&site, &name).await {
        Ok(found) => {
            let address = format!("/stations/{}/", found.station.name);
            (StatusCode::PERMANENT_REDIRECT, [(LOCATION, address)]).into_response()
        }
        Err(Missing::Status(status)) => status.into_response(),
        Err(_) => lost(),
    }
}

/// `/stations/<name>/`
async fn station_page(
    State(site): State<Site>,
    Path(name): Path<String>,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
) -> Response {
    let given = Given::of(&site, query.as_deref().unwrap_or_default(), &headers).await;
    let reader = given.reader();
    let Found { surveyed, survey, station, facts } = match find(&site, &name).await {
        Ok(found) => found,
        Err(why) => return missing(why, &reader, &headers),
    };
    let shown = shown(&station, &facts);
    let asked = given.get("show").and_then(named).filter(|show| shown.contains(show));
    let show = asked.unwrap_or(Show::Range);
    let picture = match &facts.header {
        Ok(_) => pictures::whole(&surveyed, &station, &facts, show).await,
        Err(why) => Err(why.clone()),
    };
    let asked = station::Asked { survey: &survey, station: &station, facts: &facts, shown: &shown, show, picture };
    for_reader(station::page(asked, &reader), &reader, &headers)
}

pub(super) fn named(name: &str) -> Option<Show> {
    SHOWN.iter().find(|(other, _)| *other == name).map(|(_, show)| *show)
}

/// `/stations/<name>/<show>.png`
async fn picture(State(site): State<Site>, Path((name, file)): Path<(String, String)>, headers: HeaderMap) -> Response {
    let Some(show) = file.strip_suffix(".png").and_then(named) else { return lost() };
    match drawable(&site, &name, show).await {
        Ok(Found { surveyed, station, facts, .. }) => {
            let etag = tag(&pictures::key(&facts, show, None));
            if is_known(&etag, &headers) {
                return unchanged(&etag);
            }
            png(pictures::whole(&surveyed, &station, &facts, show).await, &etag)
        }
        Err(why) => no_picture(why),
    }
}

/// `/stations/<name>/<show>/<column>-<row>.png`
async fn part(
    State(site): State<Site>,
    Path((name, show, part)): Path<(String, String, String)>,
    headers: HeaderMap,
) -> Response {
    let place = part.strip_suffix(".png").and_then(column_and_row);
    let (Some(show), Some(place)) = (named(&show), place) else { return lost() };
    match drawable(&site, &name, show).await {
        Ok(Found { surveyed, station, facts, .. }) => {
            let etag = tag(&pictures::key(&facts, show, Some(place)));
            if is_known(&etag, &headers) {
                return unchanged(&etag);
            }
            match pictures::part(&surveyed, &station, &facts, show, place).await {
                Ok(Some(drawn)) => png(Ok(drawn), &etag),
                Ok(None) => lost(),
                Err(why) => png(Err(why), &etag),
            }
        }
        Err(why) => no_picture(why),
    }
}

/// A number in an address. Each has one address: no signs, no leading zeros.
pub(super) fn number(text: &str) -> Option<u32> {
    text.parse::<u32>().ok().filter(|number| number.to_string() == text)
}

/// `<column>-<row>`
pub(super) fn column_and_row(text: &str) -> Option<[u32; 2]> {
    let (column, row) = text.split_once('-')?;
    Some([number(column)?, number(row)?])
}

/// A station that has a picture of this kind.
pub(super) async fn drawable(site: &Site, name: &str, show: Show) -> Result<Found, Missing> {
    let found = find(site, name).await?;
    match &found.facts.header {
        Err(why) => Err(Missing::Broken(why.clone())),
        Ok(_) if !shown(&found.station, &found.facts).contains(&show) => Err(Missing::Unknown),
        Ok(_) => Ok(found),
    }
}

pub(super) fn no_picture(why: Missing) -> Response {
    match why {
        Missing::Unknown => lost(),
        Missing::Mistakes(why) => broken(&why),
        Missing::Broken(why) => broken(&why),
        Missing::Status(status) => status.into_response(),
    }
}

pub(super) fn missing(why: Missing, reader: &Reader<'_>, headers: &HeaderMap) -> Response {
    match why {
        Missing::Unknown => {
            let mut response = for_reader(plan_page::lost(reader), reader, headers);
            *response.status_mut() = StatusCode::NOT_FOUND;
            response
        }
        Missing::Mistakes(why) => mistakes(&why, reader, headers),
        Missing::Broken(why) => broken(&why),
        Missing::Status(status) => status.into_response(),
    }
}

fn mistakes(why: &str, reader: &Reader<'_>, headers: &HeaderMap) -> Response {
    let mut response = for_reader(plan_page::mistakes(why, reader), reader, headers);
    *response.status_mut() = StatusCode::SERVICE_UNAVAILABLE;
    response
}

/// A picture that cannot be drawn.
pub(super) fn broken(why: &str) -> Response {
    (StatusCode::SERVICE_UNAVAILABLE, format!("{why}\n")).into_response()
}

fn png(drawn: Result<Arc<Drawn>, String>, etag: &str) -> Response {
    match drawn {
        Ok(drawn) => {
            let mut response = ([(CONTENT_TYPE, "image/png")], drawn.png.clone()).into_response();
            add_tag(&mut response, etag);
            // All readers have the same bytes.
            lean(response)
        }
        Err(why) => broken(&why),
    }
}

/// A style sheet or a script of these pages.
fn file(content: &'static str, kind: &'static str, headers: &HeaderMap) -> Response {
    let etag = tag(content);
    if is_known(&etag, headers) {
        return unchanged(&etag);
    }
    let mut response = ([(CONTENT_TYPE, format!("{kind}; charset=utf-8"))], content).into_response();
    add_tag(&mut response, &etag);
    lean(response)
}

pub(super) fn tag(key: &str) -> String {
    format!("\"{}\"", &blake3::hash(key.as_bytes()).to_hex()[..32])
}

pub(super) fn is_known(etag: &str, headers: &HeaderMap) -> bool {
    lists(text(headers, &IF_NONE_MATCH).unwrap_or_default(), etag, true)
}

pub(super) fn unchanged(etag: &str) -> Response {
    let mut response = StatusCode::NOT_MODIFIED.into_response();
    add_tag(&mut response, etag);
    response
}

pub(super) fn add_tag(response: &mut Response, etag: &str) {
    if let Ok(value) = HeaderValue::from_str(etag) {
        response.headers_mut().insert(ETAG, value);
    }
}
