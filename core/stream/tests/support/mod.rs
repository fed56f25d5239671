//! Random packs (directories only) and a network that is slow, loses, garbles and reorders.
#![allow(dead_code, reason = "each test file uses its part")]

use fastrand::Rng;
use glam::DVec3;
use kilwa_geometry::{Aabb, DiamondKey, Lattice, Sphere, Tetra};
use kilwa_pack::{
    Attributes, DirectoryEntry, ENTRIES_PER_PAGE, Head, Header, Metadata, NO_DIAMOND, PatchRange, directory,
};
use kilwa_stream::clip::{Clip, ClipBox, HalfSpace};
use kilwa_stream::sim::Store;
use kilwa_stream::{Budgets, Command, Event, FetchKind, Projection, Step, Streamer, View, length_of};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

const CUBE_LOG2: u32 = 12;

/// A directory over a real tetrahedral subdivision, with the patches of every chunk.
pub(crate) struct Pack {
    pub(crate) head: Head,
    pub(crate) head_bytes: u64,
    pub(crate) entries: Vec<DirectoryEntry>,
    pub(crate) patches: Vec<Vec<PatchRange>>,
    /// Where each tetrahedron is a patch: chunk and number.
    place: BTreeMap<Tetra, (u32, u32)>,
    split: BTreeSet<DiamondKey>,
}

impl Pack {
    /// Split `splits` random diamonds, parents first.
    pub(crate) fn random(seed: u64, splits: usize) -> Self {
        let mut random = Rng::with_seed(seed);
        let mut split = BTreeSet::<DiamondKey>::new();
        let mut open: BTreeSet<DiamondKey> = Tetra::roots(CUBE_LOG2).iter().map(DiamondKey::of).collect();
        while split.len() < splits {
            let Some(key) = open.iter().nth(random.usize(..open.len())).copied() else { break };
            split_with_parents(key, &mut split);
            let tetras = all_tetras(&split);
            open = tetras.iter().filter(|t| t.level < 18).map(DiamondKey::of).filter(|k| !split.contains(k)).collect();
        }
        Self::of(split, &mut random)
    }

    fn of(split: BTreeSet<DiamondKey>, random: &mut Rng) -> Self {
        let index: BTreeMap<DiamondKey, u32> = split.iter().copied().zip(1..).collect();
        let diamond = |t: &Tetra| index.get(&DiamondKey::of(t)).copied().unwrap_or(NO_DIAMOND);
        let mut members: Vec<Vec<Tetra>> = vec![Tetra::roots(CUBE_LOG2).to_vec()];
        members.resize(split.len() + 1, Vec::new());
        let mut parents = vec![BTreeSet::new(); split.len() + 1];
        let mut place = BTreeMap::new();
        let mut patches = vec![Vec::new(); split.len() + 1];
        let mut triangles = vec![0u32; split.len() + 1];
        for chunk in 0..members.len() {
            for number in 0..members[chunk].len() {
                let tetra = members[chunk][number];
                let of = diamond(&tetra);
                let count = 1 + random.usize(..40) as u32;
                patches[chunk].push(PatchRange { first: triangles[chunk], count, diamond: of });
                triangles[chunk] += count;
                place.insert(tetra, (chunk as u32, number as u32));
                if of != NO_DIAMOND {
                    parents[of as usize].insert(chunk as u32);
                    members[of as usize].extend(tetra.children());
                }
            }
        }
        let mut entries: Vec<DirectoryEntry> = Vec::new();
        let mut offset = 40_000u64;
        for chunk in 0..members.len() {
            let level = if chunk == 0 { 0 } else { split.iter().nth(chunk - 1).expect("indexed").level };
            let points: Vec<_> = members[chunk].iter().flat_map(|t| t.v).collect();
            let mut slots = [NO_DIAMOND; 4];
            for (slot, parent) in slots.iter_mut().zip(&parents[chunk]) {
                *slot = *parent;
            }
            let encoded_bytes = 100 + random.usize(..30_000) as u32;
            entries.push(DirectoryEntry {
                offset,
                encoded_bytes,
                vertices: triangles[chunk] + 2,
                triangles: triangles[chunk],
                level,
                error: (libm::exp2(-f64::from(level) / 3.0) * (0.01 + 0.04 * random.f64())) as f32,
                color_error: 0.0,
                sphere: Sphere::of(&points),
                bounds: Aabb::of(&points),
                parents: slots,
                checksum: [0; 16],
                children: None,
            });
            offset += u64::from(encoded_bytes);
        }
        for chunk in (1..entries.len()).rev() {
            let (error, sphere) = (entries[chunk].error, entries[chunk].sphere);
            for parent in parents[chunk].iter().map(|&p| p as usize) {
                entries[parent].error = entries[parent].error.max(error);
                entries[parent].sphere = entries[parent].sphere.union(&sphere);
            }
        }
        entries[0].error = f32::INFINITY;
        // Most packs list children for most chunks without leaves.
        let mut chance = random.fork();
        let is_listed = chance.usize(..4) > 0;
        let is_told: Vec<bool> = patches
            .iter()
            .map(|p| is_listed && chance.usize(..10) > 0 && p.iter().all(|p| p.diamond != NO_DIAMOND))
            .collect();
        directory::link_children(&mut entries, |i| is_told[i]);
        let head = head(&entries, offset);
        Self { head, head_bytes: 40_000 + random.usize(..60_000) as u64, entries, patches, place, split }
    }

    /// The same pack with all children listed that may be, or none.
    pub(crate) fn listing_children(mut self, is_listed: bool) -> Self {
        let patches = &self.patches;
        let is_whole = |i: usize| is_listed && patches[i].iter().all(|p| p.diamond != NO_DIAMOND);
        directory::link_children(&mut self.entries, is_whole);
        let end = self.entries.last().map_or(0, |e| e.offset + u64::from(e.encoded_bytes));
        self.head = head(&self.entries, end);
        self
    }

    fn page(&self, page: u32) -> Vec<u8> {
        let chunks: Vec<_> = self.entries.chunks(ENTRIES_PER_PAGE).collect();
        directory::write_page(chunks[page as usize], page)
    }

    /// Why a drawn set is not a cut: every path from a root tetrahedron to a leaf must meet exactly one drawn patch.
    pub(crate) fn fault(&self, drawn: &BTreeSet<(u32, u32)>) -> Option<String> {
        let mut stack: Vec<(Tetra, usize)> = Tetra::roots(CUBE_LOG2).into_iter().map(|t| (t, 0)).collect();
        while let Some((tetra, above)) = stack.pop() {
            let here = above + usize::from(drawn.contains(&self.place[&tetra]));
            if here > 1 {
                return Some(format!("overlap at {:?}", self.place[&tetra]));
            }
            if self.split.contains(&DiamondKey::of(&tetra)) {
                stack.extend(tetra.children().map(|t| (t, here)));
            } else if here == 0 {
                return Some(format!("hole at {:?}", self.place[&tetra]));
            }
        }
        None
    }

    pub(crate) fn gpu_bytes(&self, chunk: u32) -> u64 {
        let e = &self.entries[chunk as usize];
        u64::from(e.vertices) * 20 + u64::from(e.triangles) * 12
    }
}

/// The pack as the far end of a simulated link.
impl Store for &Pack {
    fn pages(&mut self, offset: u64, length: u64) -> Option<Vec<u8>> {
        let first = (offset.checked_sub(self.head.header.other_pages)? / 16_384) as u32 + 1;
        Some((first..first + (length / 16_384) as u32).flat_map(|p| self.page(p)).collect())
    }

    fn patches(&mut self, chunk: u32) -> Option<Vec<PatchRange>> {
        self.patches.get(chunk as usize).cloned()
    }
}

/// What must hold at every step under any network conditions: what is drawn is resident and a cut, and memory is
/// within its budget.
pub(crate) fn assert_sound(pack: &Pack, step: &Step, streamer: &Streamer) {
    let gpu_bytes = streamer.budgets().gpu_bytes;
    assert!(step.stats.gpu_bytes <= gpu_bytes.max(pack.gpu_bytes(0)), "{} bytes of GPU memory", step.stats.gpu_bytes);
    let drawn: BTreeSet<(u32, u32)> = step.draw.iter().map(|d| (d.chunk, d.patch)).collect();
    assert_eq!(drawn.len(), step.draw.len(), "a patch is drawn twice");
    assert!(drawn.iter().all(|(c, _)| streamer.is_resident(*c)), "a chunk is drawn that is not resident");
    assert_eq!(step.draw.is_empty(), !streamer.is_resident(0), "something is drawn exactly when the root is there");
    if !drawn.is_empty() {
        assert_eq!(pack.fault(&drawn), None);
    }
}

fn split_with_parents(key: DiamondKey, split: &mut BTreeSet<DiamondKey>) {
    for parent in key.parents(CUBE_LOG2) {
        split_with_parents(parent, split);
    }
    split.insert(key);
}

fn all_tetras(split: &BTreeSet<DiamondKey>) -> Vec<Tetra> {
    let mut out = Tetra::roots(CUBE_LOG2).to_vec();
    let mut at = 0;
    while at < out.len() {
        if split.contains(&DiamondKey::of(&out[at])) {
            out.extend(out[at].children());
        }
        at += 1;
    }
    out
}

/// Metadata of a pack without a name.
pub(crate) fn metadata() -> Metadata {
    Metadata {
        title: String::new(),
        source_units: "m".into(),
        source_up: "z".into(),
        crs: None,
        lattice_step: 2f64.powi(-12),
        bounds_min: DVec3::ZERO,
        bounds_max: DVec3::ONE,
        median_edge: 0.01,
        triangles: 1,
        vertices: 1,
        border_edges: 0,
        scalars: Vec::new(),
        sources: Vec::new(),
        tool: String::new(),
        options: BTreeMap::new(),
        capture_accuracy: None,
        capture_registration: None,
        capture_instrument: None,
        repairs: BTreeMap::new(),
    }
}

/// A camera with a perspective picture of 1280 × 720 pixels.
pub(crate) fn perspective(eye: DVec3, [right, up, forward]: [DVec3; 3]) -> View {
    View {
        eye,
        right,
        up,
        forward,
        anchor: eye,
        projection: Projection::Perspective { tan_half_height: 0.4 },
        size: [1280, 720],
        near: 1.0,
        far: f64::INFINITY,
        target_pixels: 3.0,
        clip: Clip::default(),
    }
}

fn head(entries: &[DirectoryEntry], end: u64) -> Head {
    let lattice = Lattice { origin: DVec3::ZERO, step_log2: -12 };
    let header = Header {
        file_bytes: end + (1 << 40),
        metadata: (256, 100),
        entry_count: entries.len() as u32,
        first_page: 512,
        other_pages: 1 << 39,
        stored_triangles: 1,
        stored_vertices: 1,
        ..Header::new(lattice, CUBE_LOG2, 1, Attributes { colors: true, scalars: 0 })
    };
    let page = directory::write_page(&entries[..entries.len().min(ENTRIES_PER_PAGE)], 0);
    let entries = directory::parse_page(&page, 0, header.entry_count).expect("a sound page");
    Head { header, metadata: metadata(), entries }
}

/// A camera on a sphere round the cube, or inside it.
pub(crate) fn random_view(random: &mut Rng) -> View {
    let side = f64::from(1 << CUBE_LOG2);
    let eye = DVec3::from_array(std::array::from_fn(|_| random.f64() * 2.0 - 0.5)) * side;
    let (a, h) = (random.f64() * 6.3, random.f64() * 1.8 - 0.9);
    let r = libm::sqrt(1.0 - h * h);
    let (sin, cos) = libm::sincos(a);
    let forward = DVec3::new(r * cos, r * sin, h);
    let right = DVec3::new(sin, -cos, 0.0);
    let up = right.cross(forward);
    let projection = if random.usize(..5) == 0 {
        Projection::Orthographic { half_height: side * (0.02 + random.f64()) }
    } else {
        Projection::Perspective { tan_half_height: 0.2 + random.f64() }
    };
    View {
        eye,
        right,
        up,
        forward,
        anchor: eye,
        projection,
        size: [1200, 800],
        near: 1.0,
        far: side * 4.0,
        target_pixels: 0.5 + random.f64() * 30.0,
        clip: random_clip(random),
    }
}

/// No clip, a plane, or a box that is kept or removed.
fn random_clip(random: &mut Rng) -> Clip {
    let side = f64::from(1 << CUBE_LOG2);
    let (a, h) = (random.f64() * 6.3, random.f64() * 2.0 - 1.0);
    let r = libm::sqrt(1.0 - h * h);
    let (sin, cos) = libm::sincos(a);
    let normal = DVec3::new(r * cos, r * sin, h);
    let at = DVec3::from_array(std::array::from_fn(|_| random.f64() * side));
    let plane = HalfSpace { normal, offset: normal.dot(at) };
    let half = side * 0.5 * random.f64();
    let faces = std::array::from_fn(|k| {
        let sign = if k % 2 == 0 { -1.0 } else { 1.0 };
        let normal = DVec3::AXES[k / 2] * sign;
        HalfSpace { normal, offset: sign * at[k / 2] + half }
    });
    match random.usize(..4) {
        0 => Clip { plane: Some(plane), bounds: None },
        1 => Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: false }) },
        2 => Clip { plane: Some(plane), bounds: Some(ClipBox { faces, remove_inside: true }) },
        _ => Clip::default(),
    }
}

/// What goes wrong, in per cent.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    pub(crate) fail: usize,
    pub(crate) garble: usize,
}

/// The other side: carries commands out after random delays, and checks them.
pub(crate) struct World<'p> {
    pack: &'p Pack,
    random: Rng,
    pub(crate) faults: Faults,
    queue: BTreeMap<(u64, u64), Event>,
    sequence: u64,
    open: BTreeMap<u64, u64>,
    decoded: BTreeSet<u32>,
    uploaded: BTreeSet<u32>,
    budgets: Budgets,
    pub(crate) log: Vec<String>,
}

impl<'p> World<'p> {
    pub(crate) fn new(pack: &'p Pack, seed: u64, budgets: Budgets, faults: Faults) -> Self {
        Self {
            pack,
            random: Rng::with_seed(seed),
            faults,
            queue: BTreeMap::new(),
            sequence: 0,
            open: BTreeMap::new(),
            decoded: BTreeSet::new(),
            uploaded: BTreeSet::new(),
            budgets,
            log: Vec::new(),
        }
    }

    /// Events due at `now`.
    pub(crate) fn due(&mut self, now: u64) -> Vec<Event> {
        let later = self.queue.split_off(&(now + 1, 0));
        let due: Vec<Event> = std::mem::replace(&mut self.queue, later).into_values().collect();
        for event in &due {
            match event {
                Event::Decoded { chunk, .. } => {
                    self.decoded.insert(*chunk);
                }
                Event::Bytes { request, .. } | Event::PageBytes { request, .. } | Event::Failed { request } => {
                    self.open.remove(request);
                }
                _ => {}
            }
        }
        due
    }

    fn later(&mut self, now: u64, event: Event) {
        self.sequence += 1;
        let at = now + 1 + self.random.usize(..120) as u64;
        self.queue.insert((at, self.sequence), event);
    }

    /// Carry a step's commands out and check what it draws.
    pub(crate) fn take(&mut self, now: u64, step: &Step, streamer: &Streamer) {
        for command in &step.commands {
            self.log.push(format!("{now} {command:?}"));
            match *command {
                Command::Fetch { request, ref ranges, kind } => self.fetch(now, request, ranges, kind),
                Command::Cancel { request } => {
                    assert!(self.open.remove(&request).is_some(), "cancelled {request}, which is not in flight");
                }
                Command::Decode { chunk, .. } => {
                    let event = if self.random.usize(..100) < self.faults.garble {
                        Event::DecodeFailed { chunk }
                    } else {
                        Event::Decoded { chunk, patches: self.pack.patches[chunk as usize].clone() }
                    };
                    self.later(now, event);
                }
                Command::Upload { chunk } => {
                    assert!(self.decoded.contains(&chunk), "uploaded {chunk}, which is not decoded");
                    assert!(self.uploaded.insert(chunk), "uploaded {chunk} twice");
                }
                Command::Evict { chunk } => {
                    self.decoded.remove(&chunk);
                    self.uploaded.remove(&chunk);
                }
            }
        }
        self.check(step, streamer);
    }

    fn fetch(&mut self, now: u64, request: u64, ranges: &[Range<u64>], kind: FetchKind) {
        let length = length_of(ranges);
        assert!((1..=self.budgets.ranges).contains(&ranges.len()), "{} ranges", ranges.len());
        let mut sorted = ranges.to_vec();
        sorted.sort_by_key(|r| r.start);
        assert!(sorted.iter().all(|r| r.start < r.end), "an empty range: {ranges:?}");
        assert!(sorted.windows(2).all(|w| w[0].end <= w[1].start), "ranges over each other: {ranges:?}");
        assert!(length <= self.budgets.request_bytes.max(30_100), "a request of {length} bytes");
        assert!(self.open.insert(request, length).is_none(), "request {request} made twice");
        let event = if self.random.usize(..100) < self.faults.fail {
            Event::Failed { request }
        } else if kind == FetchKind::Pages {
            let number = |offset: u64| ((offset - self.pack.head.header.other_pages) / 16_384) as u32 + 1;
            let pages = ranges.iter().flat_map(|r| number(r.start)..number(r.end));
            let mut bytes: Vec<u8> = pages.flat_map(|p| self.pack.page(p)).collect();
            if self.random.usize(..100) < self.faults.garble {
                let at = self.random.usize(..bytes.len());
                bytes[at] ^= 1;
            }
            Event::PageBytes { request, bytes }
        } else {
            if self.random.usize(..3) == 0 {
                self.sequence += 1;
                let length = self.random.usize(..length as usize) as u64;
                self.queue.insert((now + 1, self.sequence), Event::Progress { request, length });
            }
            let short = u64::from(self.random.usize(..100) < self.faults.garble);
            Event::Bytes { request, length: length - short }
        };
        self.later(now, event);
    }

    fn check(&self, step: &Step, streamer: &Streamer) {
        assert!(self.open.len() <= self.budgets.requests, "{} requests in flight", self.open.len());
        let bytes: u64 = self.open.values().sum();
        assert!(bytes <= self.budgets.bytes_in_flight || self.open.len() == 1, "{bytes} bytes in flight");
        let gpu: u64 = self.uploaded.iter().map(|&c| self.pack.gpu_bytes(c)).sum();
        let only_root = self.uploaded.iter().all(|&c| c == 0);
        assert!(gpu <= self.budgets.gpu_bytes || only_root, "{gpu} bytes of GPU memory");
        assert!(step.draw.iter().all(|d| self.uploaded.contains(&d.chunk)), "a chunk is drawn that is not uploaded");
        assert_sound(self.pack, step, streamer);
    }

    /// Whether nothing is on its way.
    pub(crate) fn is_quiet(&self) -> bool {
        self.queue.is_empty()
    }
}
