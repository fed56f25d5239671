//! `/map`: where the models are that answer a query, as a picture without scripts: a drawing whose dots are links, and the same as a list.
//!
//! The query is the catalogue's; `box=west,south,east,north` (degrees) looks closer. The projection is equirectangular, true to scale in the
//! middle of what is shown. Dots that would overlap are one, with their number; following it looks closer. Only what the index holds as
//! public is here ([`crate::index::Located`]): what is withheld leaves no gap that could be counted.

use super::catalogue::{Chosen, Search, address, chosen, search};
use super::frame::{Reader, Top};
use super::land;
use crate::index::{Located, Query};
use askama::Template;
use kilwa_archive::html::render;
use std::collections::BTreeMap;
use std::fmt::Write as _;

/// The drawing, in its own units.
const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 480.0;
/// Dots nearer to each other than this are one: a finger is as wide.
const APART: f64 = 44.0;
/// Places of the list; more are for looking closer.
const LISTED: usize = 200;
/// The outline has nothing below this many degrees of latitude.
const CLOSEST: f64 = 2.0;
/// Points of the outline nearer to the last one than this are left out.
const FINE: f64 = 0.6;

/// West, south, east, north in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Window([f64; 4]);

impl Window {
    /// As in an address; `None` where it is not a box.
    pub(crate) fn parse(text: &str) -> Option<Self> {
        let numbers: Vec<f64> = text.split(',').map(|n| n.parse().ok()).collect::<Option<_>>()?;
        let &[west, south, east, north] = &numbers[..] else { return None };
        let is_box = west < east && south < north && numbers.iter().all(|n| n.is_finite());
        let is_here = west >= -180.0 && east <= 180.0 && south >= -90.0 && north <= 90.0;
        (is_box && is_here).then_some(Self([west, south, east, north]))
    }

    /// The box around all of these, with a margin.
    fn around<'a>(places: &(impl Iterator<Item = &'a Located> + Clone)) -> Option<Self> {
        let fold = |k: usize, pick: fn(f64, f64) -> f64| places.clone().map(|p| p.at[k]).reduce(pick);
        let (south, north) = (fold(0, f64::min)?, fold(0, f64::max)?);
        let (west, east) = (fold(1, f64::min)?, fold(1, f64::max)?);
        let air = |low: f64, high: f64| ((high - low) * 0.15).max(CLOSEST / 2.0 - (high - low) / 2.0).max(0.1);
        let (x, y) = (air(west, east), air(south, north));
        Some(Self([(west - x).max(-180.0), (south - y).max(-90.0), (east + x).min(180.0), (north + y).min(90.0)]))
    }

    fn has(&self, place: &Located) -> bool {
        let Self([west, south, east, north]) = self;
        (south..=north).contains(&&place.at[0]) && (west..=east).contains(&&place.at[1])
    }

    fn text(&self) -> String {
        self.0.map(|v| format!("{v:.3}")).join(",")
    }
}

/// Degrees to the drawing, true to scale in its middle.
struct Projection {
    middle: [f64; 2],
    /// Units of the drawing for a degree of latitude.
    scale: f64,
    /// A degree of longitude against one of latitude.
    squeeze: f64,
}

impl Projection {
    fn of(Window([west, south, east, north]): Window) -> Self {
        let middle = [f64::midpoint(west, east), f64::midpoint(south, north)];
        let squeeze = middle[1].to_radians().cos().max(0.2);
        let scale = (WIDTH / ((east - west) * squeeze)).min(HEIGHT / (north - south));
        Self { middle, scale, squeeze }
    }

    fn at(&self, [lon, lat]: [f64; 2]) -> [f64; 2] {
        let x = (lon - self.middle[0]) * self.squeeze * self.scale;
        [WIDTH / 2.0 + x, HEIGHT / 2.0 - (lat - self.middle[1]) * self.scale]
    }

    /// The smallest and the largest longitude and latitude of the drawing.
    fn corners(&self) -> [[f64; 2]; 2] {
        let half = [WIDTH / 2.0 / self.scale / self.squeeze, HEIGHT / 2.0 / self.scale];
        let end = |sign: f64| {
            let max = [180.0, 90.0];
            [0, 1].map(|k: usize| (self.middle[k] + sign * half[k]).clamp(-max[k], max[k]))
        };
        [end(-1.0), end(1.0)]
    }
}

/// Places that are one dot.
struct Dot<'a> {
    at: [f64; 2],
    places: Vec<&'a Located>,
}

/// Each place joins the first dot that is too near for another one. In the order given, so the same every time.
fn dots<'a>(places: &[&'a Located], projection: &Projection) -> Vec<Dot<'a>> {
    let mut dots: Vec<Dot<'a>> = Vec::new();
    let mut cells: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
    let cell = |at: [f64; 2]| at.map(|v| (v / APART).floor() as i64);
    for &place in places {
        let at = projection.at([place.at[1], place.at[0]]);
        let [x, y] = cell(at);
        let around = (-1..=1).flat_map(|i| (-1..=1).map(move |j| [x + i, y + j]));
        let near = around.filter_map(|c| cells.get(&c)).flatten().copied().find(|&i| {
            let other = dots[i].at;
            (other[0] - at[0]).hypot(other[1] - at[1]) < APART
        });
        if let Some(i) = near {
            dots[i].places.push(place);
        } else {
            cells.entry([x, y]).or_default().push(dots.len());
            dots.push(Dot { at, places: vec![place] });
        }
    }
    dots
}

/// A step between lines of the graticule that leaves a few of them.
fn step(span: f64) -> f64 {
    [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 15.0].into_iter().find(|s| span / s <= 8.0).unwrap_or(30.0)
}

/// A degree as maps write it.
fn degree(reader: &Reader<'_>, value: f64, letters: [&str; 2]) -> String {
    let number = format!("{:.1}", value.abs());
    let number = reader.language.decimals(number.trim_end_matches(".0"));
    let letter = if value.abs() < 1e-9 { "" } else { letters[usize::from(value < 0.0)] };
    format!("{number}° {letter}").trim_end().to_owned()
}

/// Lines of longitude and latitude, with their names: position and text.
struct Graticule {
    path: String,
    meridians: Vec<(String, String, String)>,
    parallels: Vec<(String, String, String)>,
}

fn graticule(projection: &Projection, reader: &Reader<'_>) -> Graticule {
    let [low, high] = projection.corners();
    let step = step((high[0] - low[0]).max(high[1] - low[1]));
    let lines = |k: usize| {
        let first = (low[k] / step).ceil() as i64;
        let last = (high[k] / step).floor() as i64;
        (first..=last).map(move |i| i as f64 * step)
    };
    let ([left, bottom], [right, top]) = (projection.at(low), projection.at(high));
    let mut path = String::new();
    let (mut meridians, mut parallels) = (Vec::new(), Vec::new());
    for lon in lines(0) {
        let x = projection.at([lon, 0.0])[0];
        let _ = write!(path, "M{x:.1} {top:.1}V{bottom:.1}");
        if (40.0..WIDTH - 30.0).contains(&x) {
            meridians.push((format!("{x:.0}"), format!("{:.0}", HEIGHT - 8.0), degree(reader, lon, ["E", "W"])));
        }
    }
    for lat in lines(1) {
        let y = projection.at([0.0, lat])[1];
        let _ = write!(path, "M{left:.1} {y:.1}H{right:.1}");
        if (24.0..HEIGHT - 30.0).contains(&y) {
            parallels.push(("8".to_owned(), format!("{:.0}", y - 4.0), degree(reader, lat, ["N", "S"])));
        }
    }
    Graticule { path, meridians, parallels }
}

/// The land as the path of a drawing.
fn outline(projection: &Projection) -> String {
    let [low, high] = projection.corners();
    let mut path = String::new();
    for ring in land::within(low, high) {
        let mut last: Option<[f64; 2]> = None;
        let mut drawn = String::new();
        let mut count = 0;
        for point in ring {
            let at = projection.at(point);
            if last.is_some_and(|l| (l[0] - at[0]).abs().max((l[1] - at[1]).abs()) < FINE) {
                continue;
            }
            let _ = write!(drawn, "{}{:.1} {:.1}", if last.is_none() { "M" } else { "L" }, at[0], at[1]);
            last = Some(at);
            count += 1;
        }
        if count > 2 {
            let _ = write!(path, "{drawn}Z");
        }
    }
    path
}

/// What the page is made of.
pub(crate) struct Shown<'a> {
    pub(crate) query: &'a Query,
    pub(crate) places: &'a [Located],
    pub(crate) window: Option<Window>,
}

impl Shown<'_> {
    /// The address of this map, looking at a part of it.
    fn address(&self, window: Option<Window>, lang: Option<&str>) -> String {
        let whole = address("/map", self.query, 0, lang);
        match window {
            Some(window) => format!("{whole}{}box={}", if whole.contains('?') { '&' } else { '?' }, window.text()),
            None => whole,
        }
    }
}

#[derive(Template)]
#[template(path = "map.html")]
struct Page<'a> {
    top: Top,
    search: Search<'a>,
    chosen: Option<Chosen>,
    /// `None` where there is no place.
    view: Option<View<'a>>,
}

/// The drawing and the list beside it.
struct View<'a> {
    count: String,
    /// Addresses of the same models as a list, and of the whole map.
    list: String,
    whole: Option<String>,
    land: String,
    graticule: Graticule,
    dots: Vec<DrawnDot>,
    /// Where not all are listed.
    more: Option<String>,
    /// Addresses and places.
    places: Vec<(String, &'a Located)>,
}

/// A dot of the drawing.
struct DrawnDot {
    address: String,
    title: String,
    x: String,
    y: String,
    /// Of several places.
    many: Option<Many>,
}

struct Many {
    radius: String,
    /// Vertical position of the number.
    y: String,
    count: String,
}

/// The page.
pub(crate) fn page(shown: &Shown<'_>, reader: &Reader<'_>) -> String {
    let window = shown.window.or_else(|| Window::around(&shown.places.iter()));
    render(&Page {
        top: reader.top(&|code| shown.address(shown.window, Some(code))),
        search: search("/map", shown.query, reader),
        chosen: chosen("/map", shown.query, reader),
        view: window.map(|window| view(shown, window, reader)),
    })
}

fn view<'a>(shown: &Shown<'a>, window: Window, reader: &Reader<'_>) -> View<'a> {
    let l = reader.language;
    let projection = Projection::of(window);
    // All that the drawing reaches, which has a form of its own.
    let [low, high] = projection.corners();
    let drawn = Window([low[0], low[1], high[0], high[1]]);
    let here: Vec<&Located> = shown.places.iter().filter(|p| drawn.has(p)).collect();
    View {
        count: l.with("mapCount", &[("count", here.len())]),
        list: address("/", shown.query, 0, reader.lang),
        whole: shown.window.is_some().then(|| shown.address(None, reader.lang)),
        land: outline(&projection),
        graticule: graticule(&projection, reader),
        dots: dots(&here, &projection).iter().map(|dot| drawn_dot(dot, shown, window, reader)).collect(),
        more: (here.len() > LISTED).then(|| l.with("mapMore", &[("count", LISTED)])),
        places: here.iter().take(LISTED).map(|place| (reader.to(&format!("/{}/", place.slug)), *place)).collect(),
    }
}

fn drawn_dot(dot: &Dot<'_>, shown: &Shown<'_>, window: Window, reader: &Reader<'_>) -> DrawnDot {
    let l = reader.language;
    let [x, y] = dot.at;
    let (address, title, many) = if let [place] = dot.places[..] {
        let words: Vec<&str> = std::iter::once(place.title.as_str()).chain(place.place.as_deref()).collect();
        (reader.to(&format!("/{}/", place.slug)), words.join(", "), None)
    } else {
        let closer = Window::around(&dot.places.iter().copied()).filter(|w| *w != window && is_closer(*w, window));
        let to = closer.map_or_else(|| "#places".to_owned(), |w| shown.address(Some(w), reader.lang));
        let count = l.count(dot.places.len() as u64);
        let radius = format!("{:.1}", 11.0 + (dot.places.len() as f64).ln().min(9.0));
        let title = l.with("mapCloser", &[("count", dot.places.len())]);
        (to, title, Some(Many { radius, y: format!("{:.1}", y + 4.5), count }))
    };
    DrawnDot { address, title, x: format!("{x:.1}"), y: format!("{y:.1}"), many }
}

/// Whether looking at a window shows more than another one did.
fn is_closer(new: Window, old: Window) -> bool {
    let span = |Window([west, south, east, north]): Window| (east - west).max(north - south);
    span(new) < span(old) * 0.8
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::portal::language::Language;

    fn place(slug: &str, lat: f64, lon: f64) -> Located {
        Located {
            slug: slug.to_owned(),
            title: format!("The {slug}"),
            language: "en".to_owned(),
            place: None,
            at: [lat, lon],
        }
    }

    fn shown(places: &[Located], window: Option<Window>) -> String {
        let reader = Reader { has_map: true, ..Reader::of(Language::choose(None, ""), None) };
        page(&Shown { query: &Query::default(), places, window }, &reader)
    }

    #[test]
    fn every_location_is_in_a_dot_of_the_map_and_in_the_list() {
        let places: Vec<Located> = (0..300)
            .map(|i| place(&format!("m{i}"), f64::from(i % 17) * 0.9 - 12.0, f64::from(i % 31) * 1.1 + 20.0))
            .collect();
        let window = Window::around(&places.iter()).unwrap();
        let here: Vec<&Located> = places.iter().collect();
        let dots = dots(&here, &Projection::of(window));
        assert_eq!(dots.iter().map(|d| d.places.len()).sum::<usize>(), 300);
        for (i, a) in dots.iter().enumerate() {
            assert!((0.0..=WIDTH).contains(&a.at[0]) && (0.0..=HEIGHT).contains(&a.at[1]), "{:?}", a.at);
            for b in &dots[i + 1..] {
                assert!((a.at[0] - b.at[0]).hypot(a.at[1] - b.at[1]) >= APART);
            }
        }
        let html = shown(&places[..50], None);
        assert_eq!(html.matches("<li><a href=").count(), 50);
        assert!(shown(&places, None).contains("The first 200 are listed"));
    }

    #[test]
    fn zooming_in_ends_where_locations_are_equal() {
        let near = [place("a", -8.96, 39.51), place("b", -8.9601, 39.5101)];
        let html = shown(&near, None);
        assert!(html.contains("href=\"#places\"") && !html.contains("box="), "{html}");
        let far = [place("a", -8.96, 39.51), place("b", -8.7, 39.7), place("c", 50.0, 2.0)];
        let html = shown(&far, None);
        let closer = html.split("box=").nth(1).unwrap().split('"').next().unwrap();
        let window = Window::parse(closer).unwrap();
        assert!(window.has(&far[0]) && window.has(&far[1]) && !window.has(&far[2]));
        assert!(!shown(&far, Some(window)).contains("The c"));
    }

    #[test]
    fn a_bounding_box_is_parsed_or_refused() {
        assert!(Window::parse("-10,-5.5,10,20").is_some());
        for bad in ["", "1,2,3", "10,0,5,1", "0,0,nan,1", "-190,0,1,1", "0,0,1,1,1", "a,b,c,d", "0,0,1,91"] {
            assert_eq!(Window::parse(bad), None, "{bad}");
        }
        assert!(shown(&[], None).contains("None of these models has a public location."));
    }

    proptest::proptest! {
        #[test]
        fn any_bounding_box_gives_a_page(text in "[-0-9.,eE]{0,40}", lat in -90.0..=90.0f64, lon in -180.0..=180.0f64) {
            let html = shown(&[place("a", lat, lon), place("b", -lat, lon / 2.0)], Window::parse(&text));
            proptest::prop_assert!(html.ends_with("</html>\n") && !html.contains("NaN") && !html.contains("inf"));
        }
    }

    #[test]
    fn distances_are_exact_at_the_centre_of_the_map() {
        let p = Projection::of(Window([0.0, 50.0, 20.0, 60.0]));
        let [x0, y0] = p.at([10.0, 55.0]);
        let (east, north) = (p.at([10.1, 55.0])[0] - x0, y0 - p.at([10.0, 55.1])[1]);
        assert!((east / north - 55.0f64.to_radians().cos()).abs() < 1e-9);
    }
}
