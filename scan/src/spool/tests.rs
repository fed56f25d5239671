use super::*;
use glam::DVec3;
use kilwa_scan_core::{Grid, Rays};
use std::path::Path;

fn sample(rng: &mut fastrand::Rng) -> Sample {
    let kind = [Kind::Measured, Kind::Measured, Kind::NoReturn, Kind::Empty][rng.usize(..4)];
    if kind == Kind::Empty {
        return Sample::EMPTY;
    }
    let number = |rng: &mut fastrand::Rng| (rng.f32() - 0.5) * 200.0;
    Sample {
        position: Vec3::new(number(rng), number(rng), number(rng)),
        intensity: rng.f32(),
        color: [rng.u8(..), rng.u8(..), rng.u8(..)],
        state: State::new(kind, rng.bool(), rng.u8(0..16)),
    }
}

fn layout(columns: u32, rows: u32) -> Layout {
    let origin = DVec3::new(566_000.25, 9_010_000.5, 12.0);
    Layout { grid: Grid::by_columns(columns, rows), is_grid: true, rays: Rays::Central, origin }
}

fn written(path: &Path, samples: &[Sample], order: &[usize], layout: Layout) -> Header {
    let mut writer = Writer::create(path).unwrap();
    for &at in order {
        assert!(writer.put(at as u64, &samples[at]).unwrap());
    }
    let (pending, header) = writer.finish(layout).unwrap();
    assert!(!path.exists(), "no name before it is whole");
    pending.commit(false).unwrap();
    header
}

#[test]
fn samples_come_back_exactly_in_whatever_order_they_were_put() {
    let folder = tempfile::tempdir().unwrap();
    let mut rng = fastrand::Rng::with_seed(1);
    for (columns, rows) in [(1, 1), (32, 32), (33, 100), (7, 1024)] {
        let samples: Vec<Sample> = (0..columns * rows).map(|_| sample(&mut rng)).collect();
        let mut order: Vec<usize> = (0..samples.len()).collect();
        let path = folder.path().join(format!("{columns}.scan"));
        let header = written(&path, &samples, &order, layout(columns, rows));
        rng.shuffle(&mut order);
        let other = folder.path().join(format!("{columns}_shuffled.scan"));
        written(&other, &samples, &order, layout(columns, rows));
        assert_eq!(std::fs::read(&path).unwrap(), std::fs::read(&other).unwrap());
        let mut reader = Reader::open(&path).unwrap();
        assert_eq!(*reader.header(), header);
        assert_eq!(header.origin, layout(1, 1).origin);
        assert_eq!(header.statistics.measured, samples.iter().filter(|s| s.is_measured()).count() as u64);
        let (mut back, mut line) = (Vec::new(), Vec::new());
        reader.read(0, samples.len(), &mut back).unwrap();
        let same = |a: &Sample, b: &Sample| {
            (a.position, a.color, a.state, a.intensity.to_bits())
                == (b.position, b.color, b.state, b.intensity.to_bits())
        };
        assert!(back.iter().zip(&samples).all(|(a, b)| same(a, b)));
        let last = (columns - 1) as usize * rows as usize;
        reader.line(columns - 1, &mut line).unwrap();
        assert!(line.iter().zip(&samples[last..]).all(|(a, b)| same(a, b)) && line.len() == rows as usize);
        assert!(reader.read(samples.len() as u64, 1, &mut back).is_err());
        let bytes = std::fs::metadata(&path).unwrap().len();
        assert!(bytes <= 20 * samples.len() as u64 + 256 + 8 * (samples.len() as u64).div_ceil(1024));
    }
}

#[test]
fn a_cell_keeps_its_first_sample_and_cells_that_never_came_are_empty() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scan");
    let mut writer = Writer::create(&path).unwrap();
    let at = |x| Sample::measured(Vec3::new(x, 0.0, 0.0));
    // Far apart, so that blocks are written and read again.
    for round in 0..2 {
        for block in 0..3000 {
            assert_eq!(writer.put(block * BLOCK_SAMPLES + 5, &at(block as f32)).unwrap(), round == 0);
        }
    }
    writer.finish(layout(3000, BLOCK_SAMPLES as u32)).unwrap().0.commit(false).unwrap();
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!(reader.header().statistics.measured, 3000);
    let mut line = Vec::new();
    for column in [0, 17, 2999] {
        reader.line(column, &mut line).unwrap();
        assert_eq!(line[5].position.x, column as f32);
        assert_eq!(line.iter().filter(|s| s.state.kind() != Kind::Empty).count(), 1);
    }
}

#[test]
fn every_flipped_byte_is_found_and_a_cut_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scan");
    let mut rng = fastrand::Rng::with_seed(2);
    let samples: Vec<Sample> = (0..1500).map(|_| sample(&mut rng)).collect();
    let order: Vec<usize> = (0..samples.len()).collect();
    written(&path, &samples, &order, layout(15, 100));
    let bytes = std::fs::read(&path).unwrap();
    let damaged = folder.path().join("b.scan");
    let read = |bytes: &[u8]| {
        std::fs::write(&damaged, bytes).unwrap();
        Reader::open(&damaged).and_then(|mut r| r.read(0, 1500, &mut Vec::new()))
    };
    read(&bytes).unwrap();
    for at in (0..bytes.len()).step_by(211).chain(0..256).chain(bytes.len() - 16..bytes.len()) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 1 << rng.u8(0..8);
        assert!(read(&flipped).is_err(), "byte {at}");
    }
    for length in [0, 10, 255, 256, 257, bytes.len() - 1] {
        let message = read(&bytes[..length]).unwrap_err().to_string();
        assert!(message.contains("b.scan") && message.contains("import this station again"), "{message}");
    }
}

#[test]
fn numbers_of_seven_digits_come_back_as_they_were_written_and_others_within_the_bound() {
    let mut rng = fastrand::Rng::with_seed(3);
    for _ in 0..20_000 {
        let decimals = rng.usize(0..7);
        let digits = rng.u32(0..10_000_000);
        let text = format!("{:.*}", decimals, f64::from(digits) / 10f64.powi(decimals as i32));
        let exact: f64 = text.parse().unwrap();
        let kept = exact as f32;
        assert_eq!(format!("{kept:.decimals$}"), text);
        let any = (rng.f64() - 0.5) * 300.0;
        assert!((f64::from(any as f32) - any).abs() <= any.abs() * 2f64.powi(-24));
    }
}

#[test]
fn a_header_that_states_the_impossible_is_refused_before_anything_is_allocated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scan");
    let samples: Vec<Sample> = (0..4).map(|k| Sample::measured(Vec3::new(k as f32, 1.0, 0.0))).collect();
    let sound = written(&path, &samples, &[0, 1, 2, 3], layout(2, 2));
    let grid = |columns, rows| Header { grid: Grid { columns, rows, by_rows: false }, ..sound };
    let counts = |change: fn(&mut Statistics)| {
        let mut header = sound;
        change(&mut header.statistics);
        header
    };
    for (header, bytes) in [
        // 64 bits overflow, and the length would be right.
        (grid(4_294_964_078, 3_434_634_757), 2_083_912),
        (grid(u32::MAX, u32::MAX), 256),
        (grid(0, 5), 256),
        (grid(5, 0), 256),
        (grid(0, 0), 256),
        (Header { origin: DVec3::NAN, ..sound }, 344),
        (Header { rays: Rays::Parallel(DVec3::new(0.0, f64::INFINITY, 0.0)), ..sound }, 344),
        (counts(|s| s.measured = 5), 344),
        (counts(|s| s.no_return = u64::MAX), 344),
        (counts(|s| s.bounds[1].x = f32::NAN), 344),
    ] {
        let file = std::fs::File::create(&path).unwrap();
        file.set_len(bytes).unwrap();
        std::io::Write::write_all(&mut &file, &header.to_bytes()).unwrap();
        let message = Reader::open(&path).unwrap_err().to_string();
        assert!(message.contains("a.scan: its header is damaged"), "{header:?}: {message}");
    }
}
