//! The page's face of measuring, without a browser: the same questions through the sans-I/O surface that its worker uses, over a network that
//! answers late, against what the command line prints. The browser's own test is tests/browser/measure.test.mjs.

use super::check_none;
use super::oracle::between;
use super::phantoms::phantom;
use super::rays::Open;
use crate::support::{built_once, json, succeeds, text};
use fastrand::Rng;
use glam::DVec3;
use kilwa_measure::clip::{ClipBox, HalfSpace, box_faces};
use kilwa_measure::interval::Provisional;
use kilwa_measure::{Clip, Document, Picker, Ray};
use kilwa_measure_web::question::{Pick, Question, read, write};
use kilwa_measure_web::remote::{Fetch, Remote, Store};
use kilwa_pack::{Cut, GpuChunk, Index, NO_DIAMOND, interleave};
use kilwa_stream::DrawPatch;
use serde_json::{Value, json as value};
use std::cell::{Cell, RefCell};
use std::future::Future;
use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::rc::Rc;
use std::task::{Context, Poll};

/// A file behind a slow line that may damage what it carries.
#[derive(Clone)]
struct Line {
    bytes: Rc<Vec<u8>>,
    /// Ranges asked for, in order.
    asked: Rc<RefCell<Vec<(u64, u64, bool)>>>,
    /// Of each answer that was not asked for afresh, flip a bit.
    damages: Rc<Cell<bool>>,
    /// Also of the others.
    damages_all: Rc<Cell<bool>>,
}

/// An answer that comes after some turns.
struct Late {
    turns: u64,
    bytes: Vec<u8>,
}

impl Future for Late {
    type Output = Result<Vec<u8>, String>;

    fn poll(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Self::Output> {
        if self.turns > 0 {
            self.turns -= 1;
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        Poll::Ready(Ok(std::mem::take(&mut self.bytes)))
    }
}

impl Fetch for Line {
    type Sent = Late;

    fn send(&self, offset: u64, length: u64, fresh: bool) -> Late {
        self.asked.borrow_mut().push((offset, length, fresh));
        let from = offset as usize;
        let mut bytes = self.bytes[from..from + length as usize].to_vec();
        if self.damages_all.get() || self.damages.get() && !fresh {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 4;
        }
        // Answers overtake each other.
        Late { turns: offset.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61, bytes }
    }

    fn report_progress(&self, _done: u64, _all: u64) {}
}

/// What the page has of a pack.
pub(super) struct Page {
    index: Index,
    store: RefCell<Store>,
    line: Line,
}

impl Page {
    pub(super) fn open(pack: &Path) -> Self {
        let bytes = std::fs::read(pack).unwrap();
        let head = kilwa_pack::parse_head(&bytes[..bytes.len().min(1 << 17)]).unwrap().header;
        let part = |(offset, length): (u64, u64)| &bytes[offset as usize..(offset + length) as usize];
        let (pages, footer) = (part(Index::other_pages(&head)), part(Index::footer_range(&head)));
        let index = Index::parse(&bytes[..bytes.len().min(1 << 17)], pages, footer).unwrap();
        let line =
            Line { bytes: Rc::new(bytes), asked: Rc::default(), damages: Rc::default(), damages_all: Rc::default() };
        Self { index, store: RefCell::default(), line }
    }

    fn surface(&self) -> Remote<'_, Line> {
        Remote::new(&self.index, &self.store, self.line.clone())
    }

    pub(super) fn measure(&self, task: &Value) -> Value {
        let question: Question = serde_json::from_value(value!({ "task": task, "unit": "m" })).unwrap();
        pollster::block_on(question.answer(&self.surface())).unwrap()
    }
}

#[test]
fn the_page_gives_the_same_digits_as_the_command_line_for_every_tool() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tools, mut differing) = (0, 0);
    for place in ["origin", "utm"] {
        let p = phantom("cube", place);
        let file = folder.path().join(format!("{place}.json"));
        super::saved::save_all(&p, &file);
        let words = std::fs::read_to_string(&file).unwrap();
        let page = Page::open(&p.pack);
        let document = read(&page.index, &words).unwrap();
        assert_eq!(document["same"], true);
        let again = write(&page.index, &page.surface_point(), &document.to_string(), "json", 50.0).unwrap();
        assert_eq!(again, words, "read and written in the page it is the same file");
        let unit = kilwa_geometry::LengthUnit::Metre;
        for m in Document::parse(words.as_bytes()).unwrap().measurements {
            // Cold, and with what the first answer left in the store.
            for _ in 0..2 {
                let answer = page.measure(&value!(m.task));
                let printed: Vec<Value> =
                    m.readings.iter().map(|r| value!({ "name": r.name, "text": r.text(unit) })).collect();
                tools += 1;
                differing +=
                    usize::from(answer["readings"] != value!(m.readings) || answer["printed"] != value!(printed));
            }
        }
    }
    check_none("answers of the page's engine that differ from the command line in a digit", tools, differing);
}

impl Page {
    fn surface_point(&self) -> kilwa_measure::Uncertainty {
        kilwa_measure::job::Subject::new(&self.surface()).point
    }
}

#[test]
fn refusals_in_the_page_match_the_command_line() {
    let page = Page::open(&phantom("cube", "origin").pack);
    let say = |task: Value| page.measure(&task)["refusal"].as_str().unwrap_or_default().to_owned();
    assert!(say(value!({ "tool": "angle", "local": [[0, 0, 0], [0, 0, 0], [1, 0, 0]] })).contains("same place"));
    assert!(say(value!({ "tool": "section" })).contains("needs a plane"));
    let far = value!({ "point": [0, 0, 99], "normal": [0, 0, 1] });
    assert!(say(value!({ "tool": "section", "plane": far })).contains("meets no surface"));
    assert!(say(value!({ "tool": "contours", "interval": 0 })).contains("not possible"));
    assert!(say(value!({ "tool": "area", "local": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "reach": -1 })).contains("reach"));
    assert!(serde_json::from_str::<Question>(r#"{"task":{"tool":"area","local":[[null,0,0]]}}"#).is_err());
    let open = Page::open(&fort());
    assert!(open.measure(&value!({ "tool": "volume" }))["refusal"].as_str().unwrap().contains("not closed"));
}

/// A fort of many chunks.
fn fort() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("trust");
    let write = |to: &Path| drop(succeeds(&["synth", "fort", "--triangles", "150000", "-o", text(to), "--force"]));
    built_once(&folder, "fort", write, &[])
}

#[test]
fn a_section_in_the_page_fetches_only_the_leaves_along_the_cut() {
    let pack = fort();
    let page = Page::open(&pack);
    let open = Open::of(&pack);
    let leafless: Vec<u32> = (0u32..)
        .zip(&open.chunks)
        .filter(|(_, c)| c.patches.iter().all(|p| p.diamond != NO_DIAMOND))
        .map(|(i, _)| i)
        .collect();
    // The viewer reports what it has decoded.
    page.store.borrow_mut().are_leafless(leafless.iter().copied());
    let x = f64::midpoint(page.index.metadata().bounds_min[0], page.index.metadata().bounds_max[0]);
    let lattice = page.index.header().lattice;
    let at = (x - lattice.origin[0]) / lattice.step();
    let plane = value!({ "point": [x - lattice.origin[0], 0, 0], "normal": [1, 0, 0] });
    let answer = page.measure(&value!({ "tool": "section", "plane": plane }));
    let meets = |b: &kilwa_geometry::Aabb| f64::from(b.min[0]) <= at + 2.0 && f64::from(b.max[0]) >= at - 2.0;
    let along: u64 = (0u32..)
        .zip(page.index.entries())
        .filter(|(i, e)| !leafless.contains(i) && !e.bounds.is_empty() && meets(&e.bounds))
        .map(|(_, e)| u64::from(e.encoded_bytes))
        .sum();
    let asked: u64 = page.line.asked.borrow().iter().map(|(_, length, _)| length).sum();
    println!(
        "trust | bytes that a section in the page fetches beyond the leaves along the cut | 0 | {}",
        asked - along
    );
    assert_eq!(asked, along);
    assert_eq!(answer["read"]["bytes"], along);
    assert!(along * 2 < page.index.header().file_bytes, "{along} bytes are no small part");
    let plane = format!("--x={x:?}");
    let native = json(&["measure", text(&pack), "section", &plane]);
    assert_eq!(native["printed"], answer["printed"]);
    // Once more it costs nothing.
    page.measure(&value!({ "tool": "section", "plane": answer["task"]["plane"] }));
    assert_eq!(page.line.asked.borrow().iter().map(|(_, length, _)| length).sum::<u64>(), along);
}

#[test]
fn damaged_bytes_are_refetched_and_never_measured() {
    let pack = phantom("sphere", "origin").pack;
    let sound = Page::open(&pack).measure(&value!({ "tool": "volume" }));
    let page = Page::open(&pack);
    page.line.damages.set(true);
    assert_eq!(page.measure(&value!({ "tool": "volume" }))["readings"], sound["readings"]);
    assert!(page.line.asked.borrow().iter().any(|(_, _, fresh)| *fresh));
    let page = Page::open(&pack);
    page.line.damages_all.set(true);
    let question: Question = serde_json::from_value(value!({ "task": { "tool": "volume" } })).unwrap();
    let why = pollster::block_on(question.answer(&page.surface())).unwrap_err().to_string();
    assert!(why.contains("damaged"), "{why}");
}

/// What the viewer draws of a cut.
fn drawn(open: &Open, cut: &Cut) -> (Vec<DrawPatch>, Vec<GpuChunk>) {
    let entries = open.reader.entries();
    let meshes: Vec<GpuChunk> = open.chunks.iter().map(interleave).collect();
    let mut patches = Vec::new();
    for i in cut.refined() {
        for (n, p) in (0u32..).zip(&meshes[i as usize].patches) {
            if cut.draws(p) {
                let error = if p.diamond == NO_DIAMOND { 0.0 } else { entries[p.diamond as usize].error };
                let (first, count, diamond) = (p.first, p.count, p.diamond);
                patches.push(DrawPatch {
                    chunk: i,
                    patch: n as u16 as _,
                    first,
                    count,
                    diamond,
                    level: 0,
                    error,
                    visible: true,
                });
            }
        }
    }
    (patches, meshes)
}

#[test]
fn the_provisional_interval_of_the_viewer_contains_the_final_pick_also_at_cuts() {
    let mut random = Rng::with_seed(77);
    let (mut picks, mut outside, mut one) = (0, 0, 0);
    for (shape, place) in [("stepped-wall", "origin"), ("sphere", "utm"), ("bent-wall", "far")] {
        let open = Open::of(&phantom(shape, place).pack);
        let entries = open.reader.entries();
        let step = open.reader.header().lattice.step();
        let root = entries[0].bounds;
        let centre = root.min.as_dvec3().midpoint(root.max.as_dvec3());
        let size = f64::from((root.max - root.min).max_element());
        for round in 0..10u64 {
            let cut = Cut::random(entries, round, 1 + round as usize * 8);
            let (patches, meshes) = drawn(&open, &cut);
            for n in 0..40 {
                let ray = open.random_ray(&mut random);
                let way = DVec3::from([0, 1, 2].map(|_| between(&mut random, -1.0, 1.0)));
                let normal = way / way.length();
                let plane = HalfSpace { normal, offset: normal.dot(centre) };
                let faces = box_faces(centre, DVec3::splat(size * 0.5), n as f64);
                let clip = Clip {
                    plane: (n % 2 == 1).then_some(plane),
                    bounds: (n % 4 >= 2).then_some(ClipBox { faces, remove_inside: n % 8 >= 4 }),
                };
                let found = kilwa_viewer::pick::interval(&ray, &patches, &clip, step, |c| {
                    Some((&meshes[c as usize], entries[c as usize].bounds))
                });
                picks += 1;
                let Some(last) = finest(&open, ray, clip) else { continue };
                outside += usize::from(match found {
                    Provisional::Nothing => true,
                    Provisional::Between { from, to } => {
                        one += 1;
                        last < from - 1e-9 || last > to + 1e-9
                    }
                    Provisional::Several(all) => {
                        !all.iter().any(|(from, to)| (from - 1e-9..=to + 1e-9).contains(&last))
                    }
                });
            }
        }
    }
    check_none("intervals of the viewer, clipped or not, that do not contain the final pick", picks, outside);
    assert!(one > 100, "{one}");
}

/// The first triangle of the finest surface that is not cut away.
fn finest(open: &Open, ray: Ray, clip: Clip) -> Option<f64> {
    let mut picker = Picker::clipped(ray, clip);
    for chunk in &open.chunks {
        kilwa_measure::leaves::finest(chunk).for_each(|t| picker.add(t));
    }
    picker.picked().map(|p| p.t)
}

#[test]
fn a_pick_in_the_page_equals_that_of_the_command_line() {
    let p = phantom("sphere", "utm");
    let page = Page::open(&p.pack);
    let open = Open::of(&p.pack);
    let mut random = Rng::with_seed(5);
    let lattice = page.index.header().lattice;
    let (mut hits, mut differing) = (0, 0);
    for _ in 0..30 {
        let ray = open.random_ray(&mut random);
        let origin = lattice.world_from_steps(ray.origin);
        let asked: Pick = serde_json::from_value(value!({ "origin": origin, "direction": ray.direction })).unwrap();
        let answer = pollster::block_on(asked.answer(&page.surface())).unwrap();
        let numbers: Vec<String> =
            [origin, ray.direction].map(|v| v.to_array()).as_flattened().iter().map(|x| format!("{x:?}")).collect();
        let numbers = [
            &["measure", text(&p.pack), "coordinate", "--rays", "--json", "--"],
            &numbers.iter().map(String::as_str).collect::<Vec<_>>()[..],
        ]
        .concat();
        let native = crate::support::kilwa(&numbers);
        if answer.is_null() {
            assert_eq!(native.status.code(), Some(1));
            continue;
        }
        hits += 1;
        let native: Value = serde_json::from_slice(&native.stdout).unwrap();
        differing += usize::from(native["points"][0]["world"] != answer["world"]);
        let here = page.measure(&value!({ "tool": "coordinate", "local": [answer["local"]] }));
        differing += usize::from(native["printed"] != here["printed"]);
    }
    assert!(hits > 5, "{hits}");
    check_none("picks of the page's engine that differ from the command line in a digit", hits, differing);
}
