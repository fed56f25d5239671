//! What a view and a visit download: the streamer on a recorded flight, over a simulated network, with the bytes of a real pack.
//!
//! Usage: `flight PACK...`. The flight is the same for all packs of a model: to each of eight places on its surface, seen along its normal from
//! the length of the model's diagonal away and then, by factors of two, from ever nearer, to 1/128 of it. Every leg has sixty
//! frames in two seconds, and at its end a rest until the picture is within a pixel (1920 × 1080, 60 degrees across the height). The
//! network gives 10 Mbit/s with 50 ms before each answer; decoding takes 200 ns a triangle; budgets are the page's.
//!
//! One line of a Markdown table comes out per pack, means over the places: kilobytes until the picture is there for who begins at
//! that distance with nothing, and their sum; for the whole flight, which keeps what it has, kilobytes and requests, seconds until
//! the first picture was there, and seconds waited at the ends of the legs.

use glam::DVec3;
use kilwa_geometry::normal;
use kilwa_pack::{Chunk, NO_DIAMOND, Reader, SliceSource, parse_head};
use kilwa_stream::{Budgets, Command, Event, FetchKind, Projection, Streamer, View, length_of};

type Failure = Box<dyn std::error::Error>;

const BYTES_PER_MS: f64 = 10e6 / 8.0 / 1000.0;
const LATENCY_MS: f64 = 50.0;
const DECODING_MS: f64 = 200e-6;
const FRAME_MS: f64 = 1000.0 / 30.0;
const FRAMES_PER_LEG: u32 = 60;
/// What the page asks for first.
const HEAD_BYTES: usize = 131_072;
/// Distances of a descent.
const HALVES: i32 = 8;
const PLACES: usize = 8;

/// Where the camera is and what it looks at.
#[derive(Clone, Copy)]
struct Pose {
    eye: DVec3,
    target: DVec3,
}

impl Pose {
    fn between(self, to: Self, share: f64) -> Self {
        let mix = |a: DVec3, b: DVec3| a + (b - a) * share;
        Self { eye: mix(self.eye, to.eye), target: mix(self.target, to.target) }
    }

    fn view(self, near: f64) -> View {
        let unit = |v: DVec3| v / v.length();
        let forward = unit(self.target - self.eye);
        let upright = if forward[2].abs() > 0.99 { DVec3::Y } else { DVec3::Z };
        let right = unit(forward.cross(upright));
        View {
            eye: self.eye,
            right,
            up: right.cross(forward),
            forward,
            anchor: self.eye,
            projection: Projection::Perspective { tan_half_height: 0.577_350_269 },
            size: [1920, 1080],
            near,
            far: f64::INFINITY,
            target_pixels: 1.0,
            clip: kilwa_stream::Clip::default(),
        }
    }
}

/// A pack behind a simulated network.
struct Visit<'a> {
    bytes: &'a [u8],
    chunks: &'a [Chunk],
    streamer: Streamer,
    now: f64,
    link_free: f64,
    decoder_free: f64,
    /// What happens when, in no order.
    pending: Vec<(f64, Event)>,
    fetched: u64,
    requests: u64,
    near: f64,
}

impl Visit<'_> {
    /// One frame; whether the picture is there and nothing more is wanted.
    fn frame(&mut self, pose: Pose) -> bool {
        self.now += FRAME_MS;
        let (mut due, later): (Vec<_>, Vec<_>) = self.pending.drain(..).partition(|(at, _)| *at <= self.now);
        self.pending = later;
        due.sort_by(|a, b| a.0.total_cmp(&b.0));
        let step = self.streamer.step(&pose.view(self.near), self.now, due.into_iter().map(|(_, event)| event));
        for command in step.commands {
            match command {
                Command::Fetch { request, ranges, kind } => {
                    let length = length_of(&ranges);
                    self.link_free = self.link_free.max(self.now + LATENCY_MS) + length as f64 / BYTES_PER_MS;
                    self.fetched += length;
                    self.requests += 1;
                    let event = match kind {
                        FetchKind::Chunks => Event::Bytes { request, length },
                        FetchKind::Pages => {
                            let parts = ranges.iter().map(|r| &self.bytes[r.start as usize..r.end as usize]);
                            Event::PageBytes { request, bytes: parts.collect::<Vec<_>>().concat() }
                        }
                    };
                    self.pending.push((self.link_free, event));
                }
                Command::Decode { chunk, triangles, .. } => {
                    self.decoder_free = self.decoder_free.max(self.now) + f64::from(triangles) * DECODING_MS;
                    let patches = self.chunks[chunk as usize].patches.clone();
                    self.pending.push((self.decoder_free, Event::Decoded { chunk, patches }));
                }
                Command::Cancel { .. } | Command::Upload { .. } | Command::Evict { .. } => {}
            }
        }
        step.stats.settled && self.pending.is_empty()
    }

    /// Fly there, then rest until the picture is there. Milliseconds of rest.
    fn go(&mut self, from: Pose, to: Pose) -> Result<f64, Failure> {
        for frame in 1..FRAMES_PER_LEG {
            self.frame(from.between(to, f64::from(frame) / f64::from(FRAMES_PER_LEG)));
        }
        self.rest(to)
    }

    /// Stay until the picture is there. Milliseconds.
    fn rest(&mut self, pose: Pose) -> Result<f64, Failure> {
        let begin = self.now;
        for _ in 0..100_000 {
            if self.frame(pose) {
                return Ok(self.now - begin);
            }
        }
        Err("the streamer does not come to rest".into())
    }
}

/// Places on the finest surface, the same for every pack of a model: the vertices nearest to points spread over its box, with
/// their normals.
fn places(chunks: &[Chunk], low: DVec3, high: DVec3) -> Vec<(DVec3, DVec3)> {
    let mut best = vec![(f64::INFINITY, DVec3::ZERO, DVec3::ZERO); PLACES];
    for chunk in chunks {
        for patch in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
            for &v in chunk.mesh.triangles[patch.first as usize..][..patch.count as usize].as_flattened() {
                let at = chunk.mesh.positions[v as usize].as_dvec3();
                for (k, best) in best.iter_mut().enumerate() {
                    // The R3 sequence (Roberts 2018): evenly spread for any number of points.
                    let share =
                        DVec3::new(0.819_172_5, 0.671_043_6, 0.549_700_5).map(|a| (0.5 + a * (k + 1) as f64).fract());
                    let wanted = low + (high - low) * share;
                    let d = at - wanted;
                    // Vertices that stand twice have the same place; the first normal in order of their numbers.
                    let key = (d.length_squared(), at.to_array());
                    if key < (best.0, best.1.to_array()) {
                        *best = (key.0, at, normal::decode(chunk.mesh.normals[v as usize]));
                    }
                }
            }
        }
    }
    best.into_iter().map(|(_, at, n)| (at, n)).collect()
}

fn fly(path: &str) -> Result<(), Failure> {
    let bytes = std::fs::read(path)?;
    let reader = Reader::open(SliceSource(bytes.as_slice()))?;
    let chunks: Vec<Chunk> = (0..reader.header().entry_count).map(|i| reader.chunk(i)).collect::<Result<_, _>>()?;
    let (m, lattice) = (reader.metadata(), reader.header().lattice);
    let [low, high] = [m.bounds_min, m.bounds_max].map(|p| (p - lattice.origin) / lattice.step());
    let size = (high - low).length();

    let head_bytes = bytes.len().min(HEAD_BYTES);
    let head = parse_head(&bytes[..head_bytes])?;
    let visit = || Visit {
        bytes: &bytes,
        chunks: &chunks,
        streamer: Streamer::new(&head, head_bytes as u64, Budgets::default()),
        now: 0.0,
        link_free: 0.0,
        decoder_free: 0.0,
        pending: Vec::new(),
        fetched: head_bytes as u64,
        requests: 1,
        near: size * 1e-4,
    };
    let pose = |(target, n): (DVec3, DVec3), half: i32| {
        // From somewhat above, never from straight above.
        let n = DVec3::new(n.x + 0.01, n.y + 0.02, (n.z + 0.2).min(0.7));
        let distance = size * 0.5f64.powi(half) / n.length();
        Pose { eye: target + n * distance, target }
    };
    let (mut cold, mut fetched, mut requests, mut waited, mut first) = ([0; HALVES as usize], 0, 0, 0.0, 0.0);
    for place in places(&chunks, low, high) {
        for (half, sum) in (0..HALVES).zip(&mut cold) {
            let mut visit = visit();
            visit.rest(pose(place, half))?;
            *sum += visit.fetched;
        }
        let mut visit = visit();
        first += visit.rest(pose(place, 0))?;
        for half in 1..HALVES {
            waited += visit.go(pose(place, half - 1), pose(place, half))?;
        }
        fetched += visit.fetched;
        requests += visit.requests;
    }
    let kb = |bytes: u64| format!("{:.0}", bytes as f64 / 1000.0 / PLACES as f64);
    let name = std::path::Path::new(path).file_stem().unwrap_or_default().to_string_lossy();
    println!(
        "| {name} | {:.2} | {} | {} | {} | {:.0} | {:.2} | {:.2} |",
        bytes.len() as f64 / m.triangles as f64,
        cold.map(kb).join(" | "),
        kb(cold.iter().sum()),
        kb(fetched),
        requests as f64 / PLACES as f64,
        first / 1000.0 / PLACES as f64,
        waited / 1000.0 / PLACES as f64,
    );
    Ok(())
}

fn main() -> Result<(), Failure> {
    let packs: Vec<String> = std::env::args().skip(1).collect();
    if packs.is_empty() {
        return Err("usage: flight PACK...".into());
    }
    let distances: Vec<String> = (0..HALVES).map(|h| format!("/{}", 1 << h)).collect();
    println!(
        "| pack | B/triangle | {} | sum | flight kB | requests | first s | waited s |\n|---|{}",
        distances.join(" | "),
        "---:|".repeat(6 + HALVES as usize)
    );
    packs.iter().try_for_each(|path| fly(path))
}
