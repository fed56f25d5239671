//! The streamer over the directory of a pack of 1.5 · 10^10 triangles: 5.5 million entries, 43,000 pages, 50 GB. The file is sparse:
//! pages are written on request, at their true offsets; of the chunks' bodies, only the last one exists.
//!
//! The model is a strip that is folded in half like a hairpin, as a level is along a space-filling curve: entries on opposite sides of the fold are
//! close in space, but can be a whole level apart in the file.

#[path = "../../pack/tests/common/sparse.rs"]
mod sparse;

use crate::support::perspective;
use glam::DVec3;
use kilwa_geometry::{Aabb, Lattice, Mesh, Sphere};
use kilwa_pack::directory::{link_children, write_page};
use kilwa_pack::footer::Footer;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::writer::directory_hash;
use kilwa_pack::{
    Attributes, Chunk, DirectoryEntry, ENTRIES_PER_PAGE, HEAD_BYTES, HEADER_BYTES, Head, Header, Metadata, NO_DIAMOND,
    PAGE_BYTES, PackWriter, PatchRange, Reader, Source, checksum, chunk, parse_head, verify,
};
use kilwa_stream::sim::{Decoders, Link, Simulator, Store};
use kilwa_stream::{Budgets, Streamer, View};
use sparse::Sparse;
use std::collections::BTreeSet;
use std::os::unix::fs::FileExt;

const ATTRIBUTES: Attributes = Attributes { colors: false, scalars: 0 };
/// Triangles of the finest level; about as many per chunk as in packs of walls (docs/bench, build).
const TRIANGLES: u64 = FINEST as u64 * FINEST_TRIANGLES as u64;
const FINEST_TRIANGLES: u32 = 5435;
/// Entries of the finest level, and the number of levels.
const FINEST: u32 = 2_760_000;
const LEVELS: u8 = 22;
/// Bytes of every chunk but the last.
const CHUNK_BYTES: u32 = 9_000;
/// The strip's length, and half the distance between its two halves, in lattice steps.
const SIDE: f64 = (1u32 << 30) as f64;
const HALF_GAP: f64 = 100.0;

/// Entries of a level.
const fn count(level: u8) -> u32 {
    FINEST >> (LEVELS - level)
}

/// Index of the first entry of every level, and of the end of the last one.
const STARTS: [u32; LEVELS as usize + 2] = {
    let (mut starts, mut level) = ([0; LEVELS as usize + 2], 1);
    while level < starts.len() {
        starts[level] = if level == 1 { 1 } else { starts[level - 1] + count(level as u8 - 1) };
        level += 1;
    }
    starts
};

/// Index of the first entry of a level.
fn start(level: u8) -> u32 {
    STARTS[usize::from(level)]
}

fn entry_count() -> u32 {
    start(LEVELS + 1)
}

/// The level of an entry other than the root, and its place in that level.
fn place(index: u32) -> (u8, u32) {
    let level = (1..=LEVELS).rev().find(|&level| start(level) <= index).expect("not the root");
    (level, index - start(level))
}

/// Places of the parents in the level above: the one before in the strip, and for some the one across the fold.
fn parents(level: u8, at: u32) -> BTreeSet<u32> {
    let above = count(level - 1);
    let near = (at / 2).min(above - 1);
    let is_across = at.is_multiple_of(64) || at + 1 == count(level);
    std::iter::once(near).chain(is_across.then(|| above - 1 - near)).collect()
}

/// Places of the children in the level below.
fn children(level: u8, at: u32) -> BTreeSet<u32> {
    let (here, below) = (count(level), count(level + 1));
    let around = |at: u32| (2 * at)..(2 * at + 3);
    around(at).chain(around(here - 1 - at)).filter(|&c| c < below && parents(level + 1, c).contains(&at)).collect()
}

fn sphere(level: u8, at: u32) -> Sphere {
    let u = (f64::from(at) + 0.5) / f64::from(count(level));
    let (x, y) = if u < 0.5 { (2.0 * u * SIDE, HALF_GAP) } else { (2.0 * (1.0 - u) * SIDE, -HALF_GAP) };
    // Twice the place of a parent, whose places are twice as long, and both halves.
    let radius = 8.0 * SIDE / f64::from(count(level)) + 4.0 * HALF_GAP;
    Sphere { center: DVec3::new(x, y + SIDE / 2.0, SIDE / 2.0), radius }
}

/// The last chunk: two triangles.
fn last_chunk() -> Chunk {
    let positions = [[0, 0, 0], [700, 0, 0], [0, 700, 0], [700, 700, 9]].map(glam::IVec3::from_array).to_vec();
    let normals = vec![kilwa_geometry::normal::quantize(kilwa_geometry::normal::encode(DVec3::Z), 10); 4];
    let mesh =
        Mesh { positions, normals, triangles: vec![[0, 1, 2], [1, 3, 2]], borders: vec![0; 2], ..Mesh::default() };
    Chunk { mesh, patches: vec![PatchRange { first: 0, count: 2, diamond: NO_DIAMOND }] }
}

/// The patches of a chunk: one for every child; on the finest level, a single one.
fn patches(index: u32) -> Vec<PatchRange> {
    if index + 1 == entry_count() {
        return last_chunk().patches;
    }
    let (level, at) = if index == 0 { (0, 0) } else { place(index) };
    let below = match level {
        0 => (0..count(1)).collect(),
        LEVELS => return vec![PatchRange { first: 0, count: FINEST_TRIANGLES, diamond: NO_DIAMOND }],
        _ => children(level, at),
    };
    let diamonds = below.into_iter().map(|at| start(level + 1) + at);
    (0..).zip(diamonds).map(|(k, diamond): (u32, _)| PatchRange { first: 800 * k, count: 800, diamond }).collect()
}

/// The model, its file, and what was requested.
struct Giant {
    header: Header,
    /// Chunks that are before page 1.
    before: u32,
    hole: [u8; 16],
    last: Vec<u8>,
    sparse: Sparse,
    pages: BTreeSet<u32>,
}

fn metadata() -> Metadata {
    Metadata {
        title: "A strip".into(),
        lattice_step: 2f64.powi(-13),
        triangles: TRIANGLES,
        vertices: TRIANGLES / 2,
        ..crate::support::metadata()
    }
}

impl Giant {
    /// Lay out the file, and write its head and its last chunk.
    fn new(name: &str) -> Self {
        let mut giant = Self {
            header: Header::new(Lattice { origin: DVec3::ZERO, step_log2: -13 }, 30, TRIANGLES, ATTRIBUTES),
            before: 0,
            hole: checksum(&[0; CHUNK_BYTES as usize]),
            last: chunk::encode(&last_chunk(), ATTRIBUTES).expect("encodes"),
            sparse: Sparse::new(name),
            pages: BTreeSet::new(),
        };
        // The writer's own header and metadata of a pack of one entry, with the larger numbers filled in.
        let mut small = Vec::new();
        PackWriter::begin(&mut small, giant.header.clone(), &metadata(), vec![giant.entry(0)]).expect("begins");
        let written = Header::parse(&small).expect("parses");
        giant.before = ((HEAD_BYTES - written.first_page - PAGE_BYTES as u64) / u64::from(CHUNK_BYTES)) as u32;
        giant.header = Header {
            entry_count: entry_count(),
            other_pages: written.first_page + PAGE_BYTES as u64 + u64::from(giant.before * CHUNK_BYTES),
            // About; a streamer does not need it.
            stored_triangles: TRIANGLES + 1600 * u64::from(FINEST),
            ..written
        };
        giant.header.file_bytes = giant.offset(entry_count() - 1) + giant.last.len() as u64 + 80;
        giant.sparse.file.set_len(giant.header.file_bytes).expect("a sparse file");
        giant.sparse.file.write_all_at(&small[..giant.header.first_page as usize], 0).expect("writes");
        giant.sparse.file.write_all_at(&giant.header.to_bytes(), 0).expect("writes");
        giant.write_page(0);
        giant.sparse.file.write_all_at(&giant.last, giant.offset(entry_count() - 1)).expect("writes");
        giant
    }

    fn head(&self) -> Head {
        parse_head(&self.read_at(0, HEAD_BYTES as usize).expect("reads")).expect("a sound head")
    }

    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        (&self.sparse).read_at(offset, length)
    }

    fn offset(&self, index: u32) -> u64 {
        let (from, first) = if index < self.before {
            (self.header.first_page + PAGE_BYTES as u64, 0)
        } else {
            (self.header.other_pages + u64::from(self.header.page_count() - 1) * PAGE_BYTES as u64, self.before)
        };
        from + u64::from(index - first) * u64::from(CHUNK_BYTES)
    }

    fn entry(&self, index: u32) -> DirectoryEntry {
        let (level, at) = if index == 0 { (0, 0) } else { place(index) };
        let error = if index == 0 { f32::INFINITY } else { 0.02 * libm::exp2f(f32::from(LEVELS - level)) };
        let mut slots = [NO_DIAMOND; 4];
        match level {
            0 => {}
            1 => slots[0] = 0,
            _ => slots.iter_mut().zip(parents(level, at)).for_each(|(slot, p)| *slot = start(level - 1) + p),
        }
        let triangles: u32 = patches(index).iter().map(|p| p.count).sum();
        let is_last = index + 1 == entry_count();
        let corner = (SIDE as i32) - 1;
        DirectoryEntry {
            offset: if self.before > 0 { self.offset(index) } else { 0 },
            encoded_bytes: if is_last { self.last.len() as u32 } else { CHUNK_BYTES },
            vertices: if is_last { 4 } else { triangles / 2 + 2 },
            triangles,
            level,
            error,
            color_error: 0.0,
            sphere: if index == 0 {
                Sphere { center: DVec3::splat(SIDE / 2.0), radius: 32.0 * SIDE }
            } else {
                sphere(level, at)
            },
            bounds: Aabb { min: glam::IVec3::ZERO, max: glam::IVec3::splat(corner) },
            parents: slots,
            checksum: if is_last { checksum(&self.last) } else { self.hole },
            children: None,
        }
    }

    fn write_page(&self, page: u32) {
        let from = page * ENTRIES_PER_PAGE as u32;
        let entries: Vec<DirectoryEntry> =
            (from..entry_count()).take(ENTRIES_PER_PAGE).map(|index| self.entry(index)).collect();
        let (offset, _) = self.header.page_range(page);
        self.sparse.file.write_all_at(&write_page(&entries, page), offset).expect("writes");
    }
}

impl Store for Giant {
    fn pages(&mut self, offset: u64, length: u64) -> Option<Vec<u8>> {
        let bytes = PAGE_BYTES as u64;
        let first = (offset.checked_sub(self.header.other_pages)? / bytes) as u32 + 1;
        for page in first..first + (length / bytes) as u32 {
            self.write_page(page);
            self.pages.insert(page);
        }
        self.read_at(offset, length as usize).ok()
    }

    fn patches(&mut self, chunk: u32) -> Option<Vec<PatchRange>> {
        Some(patches(chunk))
    }
}

/// A camera in front of the two ends of the strip, which are the first and the last entry of every level.
fn at_the_ends() -> View {
    let eye = DVec3::new(0.0, SIDE / 2.0, SIDE / 2.0 + 6_000.0);
    perspective(eye, [DVec3::X, DVec3::Y, -DVec3::Z])
}

#[test]
fn the_last_chunk_of_15_billion_triangles_is_found_with_few_pages() {
    let giant = Giant::new("giant");
    let (head, header) = (giant.head(), giant.header.clone());
    assert_eq!((header.entry_count, header.page_count()), (5_519_993, 43_465));
    assert_eq!(head.header.triangles, 15_000_600_000);
    assert!(header.file_bytes > 50_000_000_000, "{} bytes", header.file_bytes);
    let last = entry_count() - 1;
    // The first entry of the level above is the other parent of the last entry: its children are a whole level apart.
    assert_eq!(children(LEVELS - 1, 0), [0, 1, FINEST - 1].into());
    assert_eq!(parents(LEVELS, FINEST - 1), [0, count(LEVELS - 1) - 1].into());

    let streamer = Streamer::new(&head, HEAD_BYTES, Budgets::default());
    let mut simulator = Simulator::new(streamer, HEAD_BYTES, giant, Link::FAST, Decoders::default());
    let (view, mut now) = (at_the_ends(), 0.0);
    let step = loop {
        let step = simulator.step(now, &view);
        if step.stats.settled {
            break step;
        }
        assert!(now < 60_000.0, "not settled: {:?}", step.stats);
        now = simulator.next_event_ms().unwrap_or(now).max(now + 1.0);
    };
    assert!(step.stats.target_reached, "{:?}", step.stats);
    let shown: BTreeSet<u32> = step.draw.iter().map(|d| d.chunk).collect();
    assert!(shown.contains(&last) && shown.contains(&start(LEVELS)), "the ends are shown in full");
    // The drawn patches are a cut: no patch is drawn if its diamond is drawn too.
    assert!(step.draw.iter().all(|d| !shown.contains(&d.diamond)), "no overlap");
    let giant = simulator.store();
    assert!(giant.pages.contains(&(header.page_count() - 1)));
    assert!(giant.pages.len() < 200, "{} pages were fetched", giant.pages.len());

    let entry = simulator.streamer().entry(last).expect("known").clone();
    assert!(entry.offset > 1 << 35, "{}", entry.offset);
    let bytes = giant.read_at(entry.offset, entry.encoded_bytes as usize).expect("reads");
    assert_eq!(decode_checked(&bytes, last, &entry, &header).expect("decodes").canonical(), last_chunk().canonical());
    assert_eq!(entry.offset + bytes.len() as u64 + 80, header.file_bytes);
}

/// Everything at once: with `KILWA_SOAK=1`, as in `cargo xtask test --long`.
#[test]
fn the_whole_directory_of_15_billion_triangles_is_written_and_opened() {
    if std::env::var_os("KILWA_SOAK").is_none() {
        eprintln!("skipped: it takes 3 GB of memory and 0.7 GB of disk, and runs with KILWA_SOAK=1");
        return;
    }
    let mut giant = Giant::new("giant-whole");
    let mut entries: Vec<DirectoryEntry> = (0..entry_count()).map(|index| giant.entry(index)).collect();
    link_children(&mut entries, |_| false);
    verify::directory(&entries).expect("a sound directory");
    let stated: Vec<u8> = entries.iter().filter_map(|e| e.children).map(|c| c.pages).collect();
    let parents: BTreeSet<u32> = entries.iter().flat_map(DirectoryEntry::parents).collect();
    let largest = stated.iter().max().expect("some are stated");
    println!("{} of {} entries with children state them, at most {largest} pages apart", stated.len(), parents.len());
    assert!(*largest <= 127 && stated.len() < parents.len());
    assert_eq!(entries[start(LEVELS - 1) as usize].children, None, "a whole level apart");

    giant.sparse.file.set_len(0).expect("empties");
    let mut file = &giant.sparse.file;
    let mut writer = PackWriter::begin(&mut file, giant.header.clone(), &metadata(), entries).expect("begins");
    for _ in 0..=giant.before {
        writer.chunk(&[0; CHUNK_BYTES as usize]).expect("writes");
    }
    drop(writer);
    let head = giant.read_at(0, HEADER_BYTES).expect("reads");
    let header = Header::parse(&head).expect("parses");
    assert_eq!((header.file_bytes, header.other_pages), (giant.header.file_bytes, giant.header.other_pages));
    giant.header = header;
    let last = entry_count() - 1;
    giant.sparse.file.set_len(giant.header.file_bytes).expect("a sparse file");
    giant.sparse.file.write_all_at(&giant.last, giant.offset(last)).expect("writes");
    let sums = (0..giant.header.page_count())
        .map(|page| giant.read_at(giant.header.page_range(page).0 + 16, 16).expect("reads"));
    let footer = Footer {
        file_bytes: giant.header.file_bytes,
        header_hash: head[HEADER_BYTES - 32..].try_into().expect("32 bytes"),
        directory_hash: directory_hash(sums.map(|sum| sum.try_into().expect("16 bytes"))),
    };
    giant.sparse.file.write_all_at(&footer.to_bytes(), giant.header.file_bytes - 80).expect("writes");
    let reader = Reader::open(&giant.sparse).expect("opens");
    assert_eq!(reader.entries().len(), 5_519_993);
    assert_eq!(reader.chunk(last).expect("decodes").canonical(), last_chunk().canonical());
}
