//! Registration results (`registration.json`) on the page of a survey: links on the plan, how certain stations are, and which stations were not placed.

use super::control_page;
use super::plan::{Known, Plan, heading};
use super::plan_page::{coordinates, degrees};
use super::{Surveyed, stamp};
use crate::portal::frame::Reader;
use crate::portal::language::Language;
use kilwa_scan::plan::text;
use kilwa_scan::register::{Candidate, FILE, Grades, Link, Placement, Registration, Unplaced};
use kilwa_scan::survey::{Station, Survey};
use std::sync::{Arc, PoisonError};

/// The current `registration.json`: `None` if the survey was never registered; an error message if the file cannot be read.
pub(crate) type Found = Result<Option<Arc<Registration>>, Arc<str>>;

/// The file when it was last read.
#[derive(Debug, Default)]
pub(super) struct Cached {
    /// Which state of the file that was.
    stamp: Option<String>,
    found: Option<Found>,
}

impl Surveyed {
    /// The result of the last registration of the survey.
    pub(crate) fn registration(&self) -> Found {
        let mut kept = self.registration.lock().unwrap_or_else(PoisonError::into_inner);
        let now = stamp(&self.folder.join(FILE));
        if let Some(found) = kept.found.as_ref().filter(|_| kept.stamp.as_ref() == Some(&now)) {
            return found.clone();
        }
        let found = self.check_file(FILE).and_then(|()| Registration::open(&self.folder));
        let found = found.map(|found| found.map(Arc::new)).map_err(|e| self.sentence(&e).into());
        *kept = Cached { stamp: Some(now), found: Some(Found::clone(&found)) };
        found
    }
}

/// A link in the drawing.
pub(crate) struct Line {
    pub(crate) ends: [String; 4],
    /// As in [`Grades`].
    pub(crate) grade: usize,
    pub(crate) samples: usize,
    pub(crate) what: String,
}

/// The links of the weakest chain, as ends of lines.
pub(crate) fn chain(found: &Registration, plan: &Plan, survey: &Survey) -> Vec<[String; 4]> {
    let line = |pair: &[String]| {
        let [[x1, y1], [x2, y2]] = [end(found, plan, survey, &pair[0])?, end(found, plan, survey, &pair[1])?];
        Some([x1, y1, x2, y2].map(text))
    };
    found.weakest_chain.windows(2).filter_map(line).collect()
}

/// The position of a station on the plan; `None` if its pose is not the registered one.
fn end(found: &Registration, plan: &Plan, survey: &Survey, name: &str) -> Option<[f64; 2]> {
    let station = survey.stations.iter().find(|station| station.name == name)?;
    found.of(station).and(station.pose).map(|pose| plan.at(pose.translation))
}

/// Links on the plan, and the grades of their residuals with their bounds. Links of stations whose poses were changed since are left out.
pub(crate) fn links(
    found: &Registration,
    plan: &Plan,
    survey: &Survey,
    l: &'static Language,
) -> (Vec<Line>, Vec<(usize, String)>) {
    let Some(grades) = Grades::of(&found.links) else { return (Vec::new(), Vec::new()) };
    let end = |name: &str| end(found, plan, survey, name);
    let mut sorted: Vec<&Link> = found.links.iter().collect();
    // The worst ones lie on top.
    sorted.sort_by(|a, b| a.residual.total_cmp(&b.residual));
    let lines = sorted.into_iter().filter_map(|link| {
        let [a, b] = link.stations.each_ref().map(String::as_str);
        let [[x1, y1], [x2, y2]] = [end(a)?, end(b)?];
        let samples = l.with("surveySamples", &[("count", link.samples)]);
        let what = format!("{a} – {b}: {} · {samples}", millimetres(link.residual, l));
        let ends = [x1, y1, x2, y2].map(text);
        Some(Line { ends, grade: grades.residual(link), samples: grades.samples(link), what })
    });
    let lines: Vec<Line> = lines.collect();
    if lines.is_empty() {
        return (Vec::new(), Vec::new());
    }
    let [first, second, third] = grades.bounds().map(|bound| millimetres(bound, l));
    let legend = [format!("≤ {first}"), format!("≤ {second}"), format!("≤ {third}"), format!("> {third}")];
    (lines, (0..).zip(legend).collect())
}

/// A link in the list.
pub(crate) struct LinkRow<'a> {
    pub(crate) names: [&'a str; 2],
    /// As in [`Grades`].
    pub(crate) grade: usize,
    pub(crate) residual: String,
    pub(crate) samples: String,
    pub(crate) overlap: String,
    pub(crate) contradicted: String,
    /// Standard deviations of the position and the rotation of one station relative to the other.
    pub(crate) sigma: Option<String>,
}

/// All links, the largest residual first, without those of stations whose poses were changed since.
pub(crate) fn link_rows<'a>(found: &'a Registration, survey: &Survey, l: &'static Language) -> Vec<LinkRow<'a>> {
    let Some(grades) = Grades::of(&found.links) else { return Vec::new() };
    let are_current = |link: &&Link| link.stations.iter().all(|name| is_current(found, survey, name));
    let mut sorted: Vec<&Link> = found.links.iter().filter(are_current).collect();
    sorted.sort_by(|a, b| b.residual.total_cmp(&a.residual).then_with(|| a.stations.cmp(&b.stations)));
    let row = |link: &'a Link| LinkRow {
        names: link.stations.each_ref().map(String::as_str),
        grade: grades.residual(link),
        residual: millimetres(link.residual, l),
        samples: l.count(link.samples),
        overlap: percent(link.overlap, l),
        contradicted: percent(link.contradicted, l),
        sigma: link.sigma.map(|sigma| deviations(sigma, l)),
    };
    sorted.into_iter().map(row).collect()
}

/// How a station was placed, and its standard deviations.
pub(crate) struct Certainty {
    pub(crate) placement: &'static str,
    /// Of its position and its rotation; none of a pose that was given.
    pub(crate) sigma: Option<String>,
}

/// How certain a station is; `None` where that is not known.
pub(crate) fn certainty(found: &Registration, station: &Station, l: &'static Language) -> Option<Certainty> {
    let known = found.stations.iter().any(|placed| placed.name == station.name);
    let Some(placed) = found.of(station) else {
        return known.then(|| Certainty { placement: l.t("surveyPoseChanged"), sigma: None });
    };
    let (key, is_given) = match placed.placement {
        Placement::Anchor => ("surveyAnchor", true),
        Placement::Fixed => ("surveyFixed", true),
        Placement::Control => ("surveyByControl", false),
        Placement::Surface => ("surveyBySurface", false),
    };
    let sigma = (!is_given).then(|| deviations(placed.sigma(), l));
    Some(Certainty { placement: l.t(key), sigma })
}

/// Standard deviations of a position, metres, and of a rotation, radians.
fn deviations([metres, radians]: [f64; 2], l: &'static Language) -> String {
    let degrees = radians.to_degrees();
    let digits = if degrees >= 0.01 { 3 } else { 4 };
    format!("{}; {}°", millimetres(metres, l), l.decimals(&format!("{degrees:.digits$}")))
}

/// A share; small ones with a digit more.
fn percent(share: f64, l: &'static Language) -> String {
    let value = share * 100.0;
    let digits = usize::from(value > 0.0 && value < 9.95);
    format!("{} %", l.decimals(&format!("{value:.digits$}")))
}

/// A station that could not be placed, with the reason and the remedy in English.
pub(crate) struct Refused<'a> {
    pub(crate) name: &'a str,
    pub(crate) reason: &'a str,
    pub(crate) remedy: &'a str,
    /// Address of the page where its control points are marked.
    pub(crate) control: String,
    /// None if the station cannot be read.
    pub(crate) picture: Option<Picture>,
    pub(crate) candidates: Vec<CandidateRow<'a>>,
    pub(crate) candidate_count: String,
}

/// The range image of a station.
pub(crate) struct Picture {
    pub(crate) address: String,
    /// Columns and rows of its grid, which have the proportions of the image; none of a cloud.
    pub(crate) size: Option<[u32; 2]>,
    pub(crate) alternative: String,
}

/// A candidate pose in the list.
pub(crate) struct CandidateRow<'a> {
    pub(crate) matched_with: &'a str,
    /// Position and heading; none if the pose of the other station has been changed since.
    pub(crate) pose: Option<[String; 2]>,
    pub(crate) overlap: String,
    pub(crate) agreement: String,
    pub(crate) contradicted: String,
    pub(crate) residual: String,
}

fn candidate_row<'a>(
    candidate: &'a Candidate,
    found: &Registration,
    survey: &Survey,
    l: &'static Language,
) -> CandidateRow<'a> {
    let pose = candidate.pose();
    CandidateRow {
        matched_with: &candidate.matched_with,
        pose: is_current(found, survey, &candidate.matched_with)
            .then(|| [coordinates(pose, l), degrees(heading(pose), l)]),
        overlap: percent(candidate.overlap, l),
        agreement: percent(candidate.agreement, l),
        contradicted: percent(candidate.contradicted, l),
        residual: millimetres(candidate.residual, l),
    }
}

/// A candidate pose in the drawing.
pub(crate) struct CandidateMark {
    pub(crate) at: [String; 2],
    /// The end of the line that shows its heading.
    pub(crate) end: [String; 2],
    pub(crate) what: String,
}

/// The candidate poses of stations that could not be placed, as far as they are on the plan and relative to stations that still have their registered poses.
pub(crate) fn candidates(
    found: &Registration,
    plan: &Plan,
    survey: &Survey,
    l: &'static Language,
) -> Vec<CandidateMark> {
    let all = open(found, survey).flat_map(|one| one.candidates.iter().map(move |candidate| (one, candidate)));
    all.filter(|(_, candidate)| is_current(found, survey, &candidate.matched_with))
        .filter_map(|(one, candidate)| {
            let pose = candidate.pose();
            let what =
                l.with("surveyCandidateOf", &[("name", one.name.as_str()), ("other", candidate.matched_with.as_str())]);
            let at = plan.at(pose.translation);
            plan.contains(at).then(|| CandidateMark { at: at.map(text), end: plan.ahead(pose).map(text), what })
        })
        .collect()
}

/// Whether a station still has its registered pose.
fn is_current(found: &Registration, survey: &Survey, name: &str) -> bool {
    survey.stations.iter().any(|station| station.name == name && found.of(station).is_some())
}

/// The stations of the survey that could not be placed and were not fixed since.
fn open<'a>(found: &'a Registration, survey: &Survey) -> impl Iterator<Item = &'a Unplaced> {
    let is_open = |name: &str| survey.stations.iter().any(|station| station.name == name && !station.is_fixed);
    found.unplaced.iter().filter(move |one| is_open(&one.name))
}

/// The stations of the survey that could not be placed and were not fixed since.
pub(crate) fn refused<'a>(
    found: &'a Registration,
    survey: &Survey,
    stations: &[Known<'_>],
    reader: &Reader<'_>,
) -> Vec<Refused<'a>> {
    let l = reader.language;
    let link = |name: &str| control_page::link(&[Some(name), best_match(found, survey, name)], reader);
    let picture = |name: &str| {
        let (_, facts) = stations.iter().find(|(station, facts)| station.name == name && facts.trouble().is_none())?;
        let grid = facts.header.as_ref().ok().filter(|header| header.is_grid).map(|header| header.grid);
        Some(Picture {
            address: format!("/stations/{name}/range.png"),
            size: grid.map(|grid| [grid.columns, grid.rows]),
            alternative: l.with("surveyRefusedPicture", &[("name", name)]),
        })
    };
    open(found, survey)
        .map(|one| Refused {
            name: &one.name,
            reason: &one.reason,
            remedy: &one.remedy,
            control: link(&one.name),
            picture: picture(&one.name),
            candidate_count: l.count(one.candidates.len() as u64),
            candidates: one.candidates.iter().map(|candidate| candidate_row(candidate, found, survey, l)).collect(),
        })
        .collect()
}

/// The station with which a station that could not be placed was matched best.
pub(crate) fn best_match<'a>(found: &'a Registration, survey: &Survey, name: &str) -> Option<&'a str> {
    let unplaced = found.unplaced.iter().find(|one| one.name == name)?;
    let best = unplaced.candidates.first()?.matched_with.as_str();
    survey.stations.iter().any(|station| station.name == best && best != name).then_some(best)
}

/// A length in millimetres with two or three significant digits.
fn millimetres(metres: f64, l: &'static Language) -> String {
    let value = metres * 1000.0;
    let digits = match value {
        v if v >= 100.0 => 0,
        v if v >= 10.0 => 1,
        v if v >= 0.1 => 2,
        _ => 3,
    };
    format!("{} mm", l.decimals(&format!("{value:.digits$}")))
}
