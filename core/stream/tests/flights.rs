//! A recorded flight over simulated links: the commands are the same on every machine, byte by byte (`tests/snapshots`; written
//! again with `KILWA_BLESS=1`), every step is sound, and at every stop the target is reached, after any failure.

use crate::support::{Pack, assert_sound, perspective};
use glam::DVec3;
use kilwa_stream::sim::{Decoders, Flight, Link, Simulator};
use kilwa_stream::{Budgets, Command, Step, Streamer, View};
use std::fmt::Write as _;
use std::path::Path;

const FRAME_MS: f64 = 1000.0 / 60.0;

/// The server is away for this minute.
const AWAY_MS: (f64, f64) = (34_500.0, 94_500.0);

/// A camera inside or outside the cube of 4096 steps, looking at a place.
fn look(eye: DVec3, at: DVec3) -> View {
    let unit = |v: DVec3| v / v.length();
    let forward = unit(at - eye);
    let right = unit(forward.cross(DVec3::Z));
    perspective(eye, [right, right.cross(forward), forward])
}

/// Looks, glides, looks, glides, jumps: 150 s with four stops.
fn flight() -> Flight {
    let middle = DVec3::splat(2048.0);
    let a = look(DVec3::new(-4500.0, -5200.0, 4000.0), middle);
    let b = look(DVec3::new(900.0, 400.0, 2400.0), DVec3::new(1800.0, 2500.0, 1500.0));
    let c = look(DVec3::new(3300.0, 900.0, 2600.0), DVec3::new(1500.0, 2500.0, 1500.0));
    let d = look(DVec3::new(3000.0, 5200.0, 3000.0), middle);
    let keys = [(0.0, a), (30.0, a), (34.0, b), (60.0, b), (63.0, c), (90.0, c), (90.001, d), (150.0, d)];
    Flight::new(a, keys.into_iter().map(|(s, v)| (s * 1e3, v)).collect())
}

/// Fly, check every step, and return a summary of a few lines.
fn flight_summary(link: Link, budgets: Budgets) -> String {
    let pack = Pack::random(9, 400);
    let flight = flight();
    let streamer = Streamer::new(&pack.head, pack.head_bytes, budgets);
    let mut sim = Simulator::new(streamer, pack.head_bytes, &pack, link, Decoders::default());
    let mut summary = String::new();
    writeln!(
        summary,
        "{:.3} Mbit/s, {} ms, {} % fail, away {:?}",
        link.bits_per_second / 1e6,
        link.latency_ms,
        link.failures_percent,
        link.outage_ms
    )
    .unwrap();
    let mut from = 0.0;
    for (begins, ends) in flight.stops(1000.0) {
        let mut reached = f64::NAN;
        let mut last = None;
        // The simulator is told of every frame, also of those in which nothing happens, until the end of the stop.
        let mut steps = Vec::new();
        sim.fly(&flight, from, ends, FRAME_MS, |now, step| {
            if now >= begins && reached.is_nan() && step.stats.target_reached {
                reached = now - begins;
            }
            steps.push(step.clone());
        });
        for step in steps {
            // `is_resident` is asked of the streamer as it is now, so only what the step itself says is checked here.
            let drawn = step.draw.iter().map(|d| (d.chunk, d.patch)).collect();
            assert!(step.draw.is_empty() || pack.fault(&drawn).is_none(), "{:?}", pack.fault(&drawn));
            assert!(step.stats.gpu_bytes <= budgets.gpu_bytes);
            last = Some(step);
        }
        let step = last.expect("a stop has steps");
        assert_sound(&pack, &step, sim.streamer());
        assert!(!step.draw.is_empty(), "the model stays on screen");
        if link.outage_ms.is_none_or(|(away, back)| ends < away || ends > back) {
            assert!(step.stats.target_reached || step.stats.budget_limited, "at {ends} ms: {:?}", step.stats);
            assert!(step.stats.settled, "at {ends} ms: {:?}", step.stats);
        }
        let s = step.stats;
        writeln!(
            summary,
            "stop at {} s: target after {reached:.0} ms; {} of {} chunks resident are shown, {} triangles, {:.2} px",
            begins / 1e3,
            s.chunks_shown,
            s.chunks_resident,
            s.triangles_drawn,
            s.worst_pixel_error
        )
        .unwrap();
        from = ends;
    }
    writeln!(summary, "{:?}", sim.totals()).unwrap();
    let hash = u128::from_be_bytes(kilwa_pack::checksum(sim.log().as_bytes()));
    writeln!(summary, "log: {} lines, BLAKE3 {hash:032x}; it begins", sim.log().lines().count()).unwrap();
    for line in sim.log().lines().take(12) {
        writeln!(summary, "  {line}").unwrap();
    }
    summary
}

fn compare(name: &str, link: Link, budgets: Budgets) {
    let summary = flight_summary(link, budgets);
    assert_eq!(summary, flight_summary(link, budgets), "two flights are one");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("tests/snapshots/{name}.txt"));
    if std::env::var_os("KILWA_BLESS").is_some() {
        std::fs::write(&path, &summary).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert!(summary == kept, "{} is not what happens now (KILWA_BLESS=1 writes it anew):\n{summary}", path.display());
}

#[test]
fn a_fast_link() {
    compare("fast", Link::FAST, Budgets::default());
}

#[test]
fn ten_megabits() {
    compare("ten_megabits", Link::COMMON, Budgets::default());
}

/// With the requests that `kilwa serve` accepts.
fn several_ranges() -> Budgets {
    Budgets { ranges: 64, request_bytes: 128 << 10, ..Budgets::default() }
}

#[test]
fn ten_megabits_and_several_ranges_in_a_request() {
    compare("ten_megabits_several_ranges", Link::COMMON, several_ranges());
}

#[test]
fn two_megabits_with_failures_and_several_ranges_in_a_request() {
    compare("two_megabits_with_failures_several_ranges", Link::SLOW.failing(5), several_ranges());
}

#[test]
fn two_megabits_with_failures() {
    compare("two_megabits_with_failures", Link::SLOW.failing(5), Budgets::default());
}

#[test]
fn a_server_that_fails_for_a_minute() {
    // Two stops lie in that minute, and the third begins in it.
    let link = Link::COMMON.with_outage(AWAY_MS.0, AWAY_MS.1);
    compare("a_server_that_fails", link, Budgets::default());
}

#[test]
fn little_memory() {
    compare("little_memory", Link::COMMON, Budgets { gpu_bytes: 700_000, cpu_bytes: 700_000, ..Budgets::default() });
}

#[test]
fn a_gliding_camera_loads_what_it_will_see() {
    // The same flight with and without the intermediate frames, from which the movement is known.
    let pack = Pack::random(9, 400);
    let flight = flight();
    let asked_until = |frame_ms: f64| {
        let streamer = Streamer::new(&pack.head, pack.head_bytes, Budgets::default());
        let mut sim = Simulator::new(streamer, pack.head_bytes, &pack, Link::FAST, Decoders::default());
        sim.fly(&flight, 0.0, 30_000.0, FRAME_MS, |_, _| {});
        let before = sim.totals().bytes;
        sim.fly(&flight, 30_000.0, 30_600.0, frame_ms, |_, _| {});
        sim.totals().bytes - before
    };
    let (gliding, leaping) = (asked_until(FRAME_MS), asked_until(300.0));
    assert!(gliding > leaping, "{gliding} bytes with a prediction, {leaping} without");
}

#[test]
fn a_step_between_frames_does_not_change_the_prediction_of_a_glide() {
    let pack = Pack::random(9, 400);
    let flight = flight();
    let streamer = Streamer::new(&pack.head, pack.head_bytes, Budgets::default());
    let mut sim = Simulator::new(streamer, pack.head_bytes, &pack, Link::FAST, Decoders::default());
    sim.fly(&flight, 0.0, 30_000.0, FRAME_MS, |_, _| {});
    let is_asked = |step: &Step| step.commands.iter().filter(|c| matches!(c, Command::Fetch { .. })).count();
    let mut asked = 0;
    let mut now = 30_000.0;
    while now < 34_000.0 {
        let next = now + FRAME_MS;
        sim.step(now, &flight.at(now));
        let (mut attended, mut plain) = (sim.streamer().clone(), sim.streamer().clone());
        let between = attended.attend(&flight.at(now), now + FRAME_MS / 2.0, []);
        let with = attended.step(&flight.at(next), next, []);
        let without = plain.step(&flight.at(next), next, []);
        // Without the step in between, the same requests would be cancelled.
        for cancelled in between.commands.iter().chain(&with.commands).filter(|c| matches!(c, Command::Cancel { .. })) {
            assert!(without.commands.contains(cancelled), "at {now}: {cancelled:?} of {between:?} {with:?}");
        }
        assert_eq!(with.stats.chunks_wanted, without.stats.chunks_wanted, "at {now}");
        assert!(is_asked(&between) + is_asked(&with) >= is_asked(&without), "at {now}");
        asked += is_asked(&without);
        now = next;
    }
    assert!(asked > 10, "else this shows nothing");
}
