//! Properties of the streamer under random packs, cameras, latencies and failures.

use crate::support::{Faults, Pack, World, random_view};
use fastrand::Rng;
use glam::DVec3;
use kilwa_stream::{Budgets, Clip, Command, Event, Step, Streamer, View, length_of};
use proptest::prelude::*;
use std::collections::BTreeSet;
use std::ops::Range;

fn budgets() -> impl Strategy<Value = Budgets> {
    (1usize..8, 1_000u64..200_000, 1_000u64..100_000, 10_000u64..400_000, 1usize..5, 1usize..6).prop_map(
        |(requests, bytes_in_flight, request_bytes, memory, uploads, ranges)| Budgets {
            requests,
            ranges,
            bytes_in_flight,
            request_bytes,
            cpu_bytes: memory * 2,
            gpu_bytes: memory,
            uploads,
        },
    )
}

/// How many random packs a comparison needs: the long form (`cargo xtask test --long`) has four times as many.
fn seeds(short: u64) -> Range<u64> {
    0..if std::env::var_os("KILWA_SOAK").is_some() { 4 * short } else { short }
}

/// How a flight ended.
struct Landed {
    streamer: Streamer,
    step: Step,
    view: View,
    log: Vec<String>,
}

/// Fly about with a bad network, by jumps and glides, then rest with a good one until nothing moves.
fn fly(pack: &Pack, seed: u64, budgets: Budgets, faults: Faults) -> Landed {
    let mut streamer = Streamer::new(&pack.head, pack.head_bytes, budgets);
    let mut world = World::new(pack, seed, budgets, faults);
    let mut random = Rng::with_seed(seed ^ 7);
    let mut view = random_view(&mut random);
    let mut now = 0;
    for _ in 0..60 {
        match random.usize(..12) {
            0 | 1 => view = random_view(&mut random),
            2..8 => view.eye = view.eye + 6.0 * view.forward + 3.0 * view.right,
            _ => {}
        }
        let mut events = world.due(now);
        if random.usize(..40) == 0 {
            events.extend(events.clone()); // Everything twice.
        }
        // Some steps are between two frames.
        let is_between = random.usize(..4) == 0;
        let now_ms = now as f64;
        let step =
            if is_between { streamer.attend(&view, now_ms, events) } else { streamer.step(&view, now_ms, events) };
        world.take(now, &step, &streamer);
        now += 1 + random.usize(..60) as u64;
    }
    world.faults = Faults { fail: 0, garble: 0 };
    for _ in 0..20_000 {
        let events = world.due(now);
        let step = streamer.step(&view, now as f64, events);
        world.take(now, &step, &streamer);
        if step.stats.settled && step.commands.is_empty() && world.is_quiet() {
            return Landed { streamer, step, view, log: world.log };
        }
        now += if step.stats.retry_in_ms > 0.0 && world.is_quiet() { step.stats.retry_in_ms as u64 + 1 } else { 10 };
    }
    panic!("the streamer never came to rest: {:?}", world.log.last());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// `World` checks every step: no hole, no overlap, only resident chunks, all budgets.
    #[test]
    fn every_cut_is_valid_and_a_camera_at_rest_reaches_the_target(
        seed in any::<u64>(), splits in 1usize..300, budgets in budgets(), fail in 0usize..60, garble in 0usize..30,
    ) {
        let pack = Pack::random(seed, splits);
        let Landed { step, .. } = fly(&pack, seed, budgets, Faults { fail, garble });
        prop_assert!(step.stats.target_reached || step.stats.budget_limited, "{:?}", step.stats);
        prop_assert!(step.stats.worst_pixel_error.is_finite());
    }

    #[test]
    fn with_enough_memory_the_target_is_reached(
        seed in any::<u64>(), splits in 1usize..300, fail in 0usize..60, garble in 0usize..30,
    ) {
        let pack = Pack::random(seed, splits);
        let Landed { step, .. } = fly(&pack, seed, Budgets::default(), Faults { fail, garble });
        prop_assert!(step.stats.target_reached && !step.stats.budget_limited, "{:?}", step.stats);
    }

    #[test]
    fn the_same_flight_gives_the_same_commands(seed in any::<u64>(), budgets in budgets()) {
        let pack = Pack::random(seed, 120);
        let faults = Faults { fail: 20, garble: 10 };
        prop_assert_eq!(fly(&pack, seed, budgets, faults).log, fly(&pack, seed, budgets, faults).log);
    }

    #[test]
    fn a_camera_at_rest_gives_an_unchanging_picture(seed in any::<u64>(), budgets in budgets()) {
        let pack = Pack::random(seed, 200);
        let Landed { mut streamer, step: last, view, .. } = fly(&pack, seed, budgets, Faults { fail: 10, garble: 5 });
        for k in 0..5 {
            let step = streamer.step(&view, 1e9 + f64::from(k), []);
            prop_assert_eq!(&step.commands, &Vec::new());
            prop_assert_eq!(&step.draw, &last.draw);
            // Any event, even an irrelevant one, triggers a full decision.
            let unknown = Event::Failed { request: u64::MAX };
            let fresh = streamer.clone().step(&view, 1e9 + f64::from(k), [unknown]);
            prop_assert_eq!(fresh, step);
        }
        streamer.set_budgets(Budgets { gpu_bytes: 0, cpu_bytes: 0, ..budgets });
        let step = streamer.step(&view, 1e9 + 6.0, []);
        prop_assert!(step.stats.chunks_resident <= 1, "the budget applies at rest, too: {:?}", step.stats);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// `World` checks that every cut is valid, with sections that come and go; here: what a section removes costs nothing.
    #[test]
    fn clipped_geometry_is_neither_loaded_nor_shown(seed in any::<u64>(), splits in 50usize..300) {
        let pack = Pack::random(seed, splits);
        let mut random = Rng::with_seed(seed);
        let mut cut = random_view(&mut random);
        while !cut.clip.is_on() {
            cut = random_view(&mut random);
        }
        let whole = View { clip: Clip::default(), ..cut };
        let (of_cut, of_whole) = (rest(&pack, &cut), rest(&pack, &whole));
        prop_assert!(of_cut.0.stats.target_reached);
        prop_assert!(of_cut.1 <= of_whole.1, "{} bytes with the section, {} without", of_cut.1, of_whole.1);
        for &chunk in &of_cut.2 {
            let entry = &pack.entries[chunk as usize];
            prop_assert!(entry.level <= 1 || !cut.clip.removes(&entry.sphere), "chunk {} was loaded", chunk);
        }
        // Of what is left, both show the same patches.
        let drawn: BTreeSet<(u32, u32)> = of_cut.0.draw.iter().map(|d| (d.chunk, d.patch)).collect();
        for patch in of_whole.0.draw.iter().filter(|d| d.visible) {
            let spheres = [patch.chunk, patch.diamond].map(|i| pack.entries.get(i as usize).map(|e| e.sphere));
            let is_left = !spheres.iter().flatten().any(|s| cut.clip.removes(s));
            prop_assert!(!is_left || drawn.contains(&(patch.chunk, patch.patch)), "{:?} is missing", patch);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..ProptestConfig::default() })]

    /// `World` checks that every cut is valid. Directory pages of these packs lie behind the chunks: large ones lose pages too.
    #[test]
    fn a_file_that_is_cut_off_shows_what_it_has_and_nothing_beyond_its_end_is_requested(
        seed in any::<u64>(), splits in 1usize..300, share in 0.0f64..1.0,
    ) {
        let pack = Pack::random(seed, splits);
        let view = View { clip: Clip::default(), ..random_view(&mut Rng::with_seed(seed)) };
        let end_of = |e: &kilwa_pack::DirectoryEntry| e.offset + u64::from(e.encoded_bytes);
        let root = end_of(&pack.entries[0]);
        let last = pack.entries.last().map_or(root, end_of);
        let end = root + ((last - root) as f64 * share) as u64;
        let (step, asked, _) = settle(&pack, &view, Budgets::default(), Some(end));
        prop_assert!(asked.iter().all(|r| r.end <= end), "{:?} of {} bytes", asked, end);
        prop_assert!(step.stats.target_reached || step.stats.cut_off, "{:?}", step.stats);
        let (whole, ..) = settle(&pack, &view, Budgets::default(), None);
        let drawn = |step: &Step| -> BTreeSet<(u32, u32)> { step.draw.iter().map(|d| (d.chunk, d.patch)).collect() };
        let is_complete = whole.draw.iter().all(|d| end_of(&pack.entries[d.chunk as usize]) <= end) && splits <= 100;
        prop_assert!(!is_complete || !step.stats.cut_off && drawn(&step) == drawn(&whole), "all of the view is there");
    }
}

/// Everything that a view loads over a quiet network: the last step, bytes, chunks.
fn rest(pack: &Pack, view: &View) -> (Step, u64, Vec<u32>) {
    let mut streamer = Streamer::new(&pack.head, pack.head_bytes, Budgets::default());
    let mut world = World::new(pack, 1, Budgets::default(), Faults { fail: 0, garble: 0 });
    let mut decoded = Vec::new();
    for now in (0..).step_by(10) {
        let events = world.due(now);
        let step = streamer.step(view, now as f64, events);
        world.take(now, &step, &streamer);
        decoded.extend(step.commands.iter().filter_map(|c| match c {
            Command::Decode { chunk, .. } => Some(*chunk),
            _ => None,
        }));
        if step.stats.settled && step.commands.is_empty() && world.is_quiet() {
            let bytes = decoded.iter().map(|&c| u64::from(pack.entries[c as usize].encoded_bytes)).sum();
            return (step, bytes, decoded);
        }
    }
    unreachable!("the loop ends when nothing moves");
}

/// Bytes of the chunks decoded until the target is reached, and the cut then. A request may have several ranges: nothing comes along in the gaps between them.
fn until_the_target(pack: &Pack, view: &View) -> (u64, BTreeSet<(u32, u32)>) {
    let budgets = Budgets { ranges: 64, ..Budgets::default() };
    let mut streamer = Streamer::new(&pack.head, pack.head_bytes, budgets);
    let mut world = World::new(pack, 1, budgets, Faults { fail: 0, garble: 0 });
    let mut bytes = 0;
    for now in (0..).step_by(10) {
        let events = world.due(now);
        let step = streamer.step(view, now as f64, events);
        world.take(now, &step, &streamer);
        for command in &step.commands {
            if let Command::Decode { length, .. } = command {
                bytes += u64::from(*length);
            }
        }
        if step.stats.target_reached {
            return (bytes, step.draw.iter().filter(|d| d.visible).map(|d| (d.chunk, d.patch)).collect());
        }
    }
    unreachable!("the loop ends when the target is reached");
}

#[test]
fn ancestors_that_are_not_shown_are_not_loaded_before_visible_chunks() {
    let (mut with, mut without) = (0, 0);
    for seed in seeds(20) {
        let view = View { clip: Clip::default(), ..random_view(&mut Rng::with_seed(seed)) };
        let listed = until_the_target(&Pack::random(seed, 400).listing_children(true), &view);
        let unlisted = until_the_target(&Pack::random(seed, 400).listing_children(false), &view);
        assert_eq!(listed.1, unlisted.1, "both show the same in the end, seed {seed}");
        assert!(
            listed.0 <= unlisted.0,
            "{} bytes where the directory lists children, {} where not, seed {seed}",
            listed.0,
            unlisted.0
        );
        (with, without) = (with + listed.0, without + unlisted.0);
    }
    println!("{with} bytes of chunks where the directory lists children, {without} where it does not");
    assert!(with * 10 < without * 9, "{with} bytes where the directory lists children, {without} where it does not");
}

#[test]
fn unsolicited_events_change_nothing() {
    let pack = Pack::random(3, 50);
    let mut streamer = Streamer::new(&pack.head, pack.head_bytes, Budgets::default());
    let view = random_view(&mut Rng::with_seed(1));
    let strays = [
        Event::Bytes { request: 999, length: 5 },
        Event::Failed { request: 998 },
        Event::PageBytes { request: 997, bytes: vec![1; 70_000] },
        Event::Decoded { chunk: 3, patches: Vec::new() },
        Event::DecodeFailed { chunk: 4_000_000_000 },
        Event::Decoded { chunk: u32::MAX, patches: Vec::new() },
    ];
    let mut quiet = streamer.clone();
    assert_eq!(streamer.step(&view, 0.0, strays), quiet.step(&view, 0.0, []));
}

#[test]
fn neighbouring_chunks_come_in_one_request() {
    let pack = Pack::random(11, 200);
    let budgets = Budgets { bytes_in_flight: 64 << 20, request_bytes: 1 << 20, ..Budgets::default() };
    let Landed { streamer, step, log, .. } = fly(&pack, 11, budgets, Faults { fail: 0, garble: 0 });
    let requests = log.iter().filter(|l| l.contains("Fetch")).count();
    let decoded = log.iter().filter(|l| l.contains("Decode {")).count();
    assert!(streamer.is_resident(0) && step.stats.settled);
    assert!(requests * 2 < decoded, "{requests} requests for {decoded} chunks");
}

#[test]
fn multirange_requests_need_fewer_requests_and_fewer_bytes() {
    let (mut several, mut one) = ((0, 0), (0, 0));
    for seed in seeds(10) {
        let view = View { clip: Clip::default(), ..random_view(&mut Rng::with_seed(seed)) };
        let pack = Pack::random(seed, 400).listing_children(true);
        let cost = |ranges| {
            let budgets = Budgets { ranges, ..Budgets::default() };
            let landed = settle(&pack, &view, budgets, None);
            let fetches = length_of(&landed.1);
            let drawn: BTreeSet<(u32, u32)> = landed.0.draw.iter().map(|d| (d.chunk, d.patch)).collect();
            (landed.2, fetches, drawn)
        };
        let (many, single) = (cost(64), cost(1));
        assert_eq!(many.2, single.2, "both show the same in the end, seed {seed}");
        several = (several.0 + many.0, several.1 + many.1);
        one = (one.0 + single.0, one.1 + single.1);
    }
    println!("{several:?} requests and bytes with several ranges in one, {one:?} with one");
    assert!(several.0 * 2 < one.0 && several.1 <= one.1, "{several:?} with several ranges in one, {one:?} with one");
}

#[test]
fn a_view_takes_few_requests_where_each_has_one_range_and_bytes_read_for_nothing_are_bounded() {
    let (mut all, seeds) = (0, seeds(10));
    for seed in seeds.clone() {
        let view = View { clip: Clip::default(), ..random_view(&mut Rng::with_seed(seed)) };
        let pack = Pack::random(seed, 400).listing_children(true);
        let (_, asked, requests) = settle(&pack, &view, Budgets::default(), None);
        let (_, useful, _) = rest(&pack, &view);
        // Pages lie behind the chunks of these packs.
        let (_, chunks): (Vec<_>, Vec<_>) = asked.into_iter().partition(|r| r.start >= pack.head.header.other_pages);
        let bytes = length_of(&chunks);
        assert!(bytes * 2 <= useful * 3, "{bytes} bytes for {useful} in {requests} requests, seed {seed}");
        all += requests;
    }
    println!("{all} requests for {} views", seeds.end);
    assert!(all <= seeds.end * 22, "{all} requests for {} views", seeds.end);
}

/// Load a view until nothing moves, of a file that ends at `cut_off`: the last step, what was asked for, in how many requests.
fn settle(pack: &Pack, view: &View, budgets: Budgets, cut_off: Option<u64>) -> (Step, Vec<Range<u64>>, u64) {
    let head_bytes = pack.head_bytes.min(cut_off.unwrap_or(u64::MAX));
    let mut streamer = Streamer::new(&pack.head, head_bytes, budgets);
    if let Some(end) = cut_off {
        streamer.set_cut_off(end);
    }
    let mut world = World::new(pack, 1, budgets, Faults { fail: 0, garble: 0 });
    let mut asked = Vec::new();
    for now in (0..).step_by(10) {
        let events = world.due(now);
        let step = streamer.step(view, now as f64, events);
        world.take(now, &step, &streamer);
        for command in &step.commands {
            if let Command::Fetch { ranges, .. } = command {
                asked.extend(ranges.iter().cloned());
            }
        }
        if step.stats.settled && step.commands.is_empty() && world.is_quiet() {
            let requests = step.stats.requests_made;
            return (step, asked, requests);
        }
    }
    unreachable!("the loop ends when nothing moves");
}

#[test]
fn steps_between_frames_request_and_decode_and_show_nothing() {
    let pack = Pack::random(3, 200);
    let budgets = Budgets::default();
    let mut random = Rng::with_seed(3);
    let view = random_view(&mut random);
    let mut streamer = Streamer::new(&pack.head, pack.head_bytes, budgets);
    let mut world = World::new(&pack, 3, budgets, Faults { fail: 0, garble: 0 });
    let mut now = 0;
    loop {
        assert!(now < 60_000, "it comes to rest");
        let step = streamer.attend(&view, now as f64, world.due(now));
        world.take(now, &step, &streamer);
        assert!(step.draw.is_empty(), "nothing is in GPU memory");
        if step.commands.is_empty() && world.is_quiet() {
            break;
        }
        now += 10;
    }
    // Every chunk of the picture is there: the next frames bring it without another byte.
    let before = streamer.attend(&view, now as f64, []).stats;
    assert!(before.requests_in_flight == 0 && before.bytes_in_flight == 0 && before.chunks_missing > 0);
    streamer.set_uploads(usize::MAX);
    let step = streamer.step(&view, now as f64, []);
    world.take(now, &step, &streamer);
    assert!(step.stats.target_reached, "{:?}", step.stats);
}

#[test]
fn a_lost_gpu_context_is_restored() {
    // The head, which stays in memory, holds the first chunk.
    let mut pack = Pack::random(5, 80);
    pack.head_bytes = 100_000;
    let Landed { mut streamer, step: last, .. } = fly(&pack, 5, Budgets::default(), Faults { fail: 0, garble: 0 });
    assert!(!last.draw.is_empty());
    let step = streamer.step(&random_view(&mut Rng::with_seed(1)), 1e9, [Event::GpuLost]);
    assert!(step.draw.is_empty(), "nothing is resident after the loss");
    let is_first = |c: &kilwa_stream::Command| matches!(c, kilwa_stream::Command::Decode { chunk: 0, .. });
    assert!(step.commands.iter().any(is_first), "what is held is decoded again: {:?}", step.commands);
}

#[test]
fn the_pixel_error_covers_every_displacement_that_can_be_seen() {
    let mut random = Rng::with_seed(42);
    let mut seen = 0;
    for _ in 0..20_000 {
        let view = View { clip: Clip::default(), ..random_view(&mut random) };
        let kilwa_stream::Projection::Perspective { tan_half_height } = view.projection else { continue };
        let center = DVec3::from_array(std::array::from_fn(|_| random.f64() * 4096.0));
        let sphere = kilwa_geometry::Sphere { center, radius: random.f64() * 500.0 };
        let error = 1e-4;
        let bound = view.pixel_error(&sphere, error);
        let ball = |random: &mut Rng, r: f64| -> DVec3 {
            loop {
                let d = DVec3::from_array(std::array::from_fn(|_| random.f64() * 2.0 - 1.0));
                if d.length_squared() <= 1.0 {
                    return d * r;
                }
            }
        };
        let project = |p: DVec3| {
            let DVec3 { x, y, z } = view.in_view(p);
            let focal = 400.0 / tan_half_height;
            (z > view.near).then(|| [x / z * focal, y / z * focal])
        };
        let (at, by) = (ball(&mut random, sphere.radius), ball(&mut random, error));
        let p = center + at;
        let q = p + by;
        let (Some(a), Some(b)) = (project(p), project(q)) else { continue };
        if a[0].abs() > 600.0 || a[1].abs() > 400.0 {
            continue;
        }
        seen += 1;
        assert!(view.may_see(&sphere), "a visible point lies in a ball that is reported as invisible");
        let moved = (a[0] - b[0]).hypot(a[1] - b[1]);
        assert!(moved <= bound * (1.0 + 1e-4) + 1e-9, "moved {moved} px, bound {bound}");
    }
    assert!(seen > 1000, "only {seen} points were in view");
}
