//! Truncations and single flipped bits of a small PTX, a small E57 (grid, intensities, colours) and a small layered LAZ, as from a bad disk or a broken
//! copy.
//!
//! `KILWA_SOAK=1` runs the full numbers: 10^4 truncations and 10^5 flips of each. Every input has to be read or refused in time, in memory that does not depend on
//! what its damaged header announces, and with an error that names the file, the place and what was expected. What is promised beyond that:
//! a truncated file is never taken for a whole one, and a damaged E57, whose pages have checksums, never gives other samples.

use crate::bodies::scans::{e57_file, read_scans};
use crate::{Current, Done};
use kilwa_scan::ScanError;
use std::fmt::Write as _;
use std::sync::Mutex;

/// Truncations and flips of a run.
fn counts() -> [usize; 2] {
    if crate::variable("KILWA_SOAK").is_some() { [10_000, 100_000] } else { [700, 4000] }
}

/// The most memory that the process may have held after reading nothing but these files, bytes.
const LARGEST: u64 = 200 << 20;

const COLUMNS: u32 = 16;
const ROWS: u32 = 24;
/// Cells of the second scan of the PTX.
const SECOND: u32 = 12;

/// The point in a cell, its intensity and colour; `None` where nothing came back.
fn point(cell: u32) -> Option<([f32; 3], f32, [u8; 3])> {
    let turn = f64::from(cell) * 0.37;
    let position = [turn.cos() as f32 * 7.5, turn.sin() as f32 * 7.5, cell as f32 * 0.011 - 2.0];
    (cell % 13 != 5).then_some((position, (cell % 101) as f32 / 100.0, [cell as u8, 255 - cell as u8, 90]))
}

/// Two scans, the second without colours.
fn ptx() -> Vec<u8> {
    let mut text = String::new();
    for (columns, rows, has_color) in [(COLUMNS, ROWS, true), (3, SECOND / 3, false)] {
        writeln!(text, "{columns}\n{rows}\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1").unwrap();
        for cell in 0..columns * rows {
            let ([x, y, z], intensity, [r, g, b]) = point(cell).unwrap_or(([0.0; 3], 0.5, [0; 3]));
            write!(text, "{x:.6} {y:.6} {z:.6} {intensity:.3}").unwrap();
            if has_color {
                write!(text, " {r} {g} {b}").unwrap();
            }
            text.push('\n');
        }
    }
    text.into_bytes()
}

fn e57() -> Vec<u8> {
    use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let index =
        |name, max: u32| Record { name, data_type: RecordDataType::Integer { min: 0, max: i64::from(max) - 1 } };
    let prototype = vec![
        Record::CARTESIAN_X_F32,
        Record::CARTESIAN_Y_F32,
        Record::CARTESIAN_Z_F32,
        Record::CARTESIAN_INVALID_STATE,
        Record::INTENSITY_UNIT_F32,
        Record::COLOR_RED_U8,
        Record::COLOR_GREEN_U8,
        Record::COLOR_BLUE_U8,
        index(RecordName::ColumnIndex, COLUMNS),
        index(RecordName::RowIndex, ROWS),
    ];
    let mut file = std::io::Cursor::new(Vec::new());
    let mut writer = E57Writer::new(&mut file, "file").unwrap();
    let mut cloud = writer.add_pointcloud("scan", prototype).unwrap();
    for cell in 0..COLUMNS * ROWS {
        let (position, intensity, color) = point(cell).unwrap_or_default();
        let mut values = position.map(RecordValue::Single).to_vec();
        values.push(RecordValue::Integer(if point(cell).is_some() { 0 } else { 2 }));
        values.push(RecordValue::Single(intensity));
        values.extend(color.map(|v| RecordValue::Integer(v.into())));
        values.extend([cell / ROWS, cell % ROWS].map(|v| RecordValue::Integer(v.into())));
        cloud.add_point(values).unwrap();
    }
    cloud.finalize().unwrap();
    writer.finalize().unwrap();
    drop(writer);
    file.into_inner()
}

/// An error as a user needs it: the place, and what was expected there. The file was named, or the body would have panicked.
fn refused(e: &ScanError) -> String {
    let text = e.to_string();
    let is_of_file =
        ["empty", "named as a scan", "unknown format", "holds no scan"].iter().any(|part| text.contains(part));
    let has_place = (text.contains("line ") || text.contains("byte ")) && text.contains("expected");
    assert!(has_place || is_of_file, "{text}");
    "refused".to_owned()
}

/// A PTX that is damaged; one that is cut may be whole only at the end of a scan.
fn ptx_that_is_cut(bytes: &[u8]) -> String {
    let whole = [COLUMNS * ROWS, COLUMNS * ROWS + SECOND].map(u64::from);
    let strict = match read_scans(bytes, "a.ptx", false) {
        Ok(scans) => {
            assert_eq!(scans.samples, whole[scans.stations as usize - 1]);
            "whole".to_owned()
        }
        Err(e) => refused(&e),
    };
    ptx_that_is_damaged(bytes);
    strict
}

fn ptx_that_is_damaged(bytes: &[u8]) -> String {
    read_scans(bytes, "a.ptx", true).map_or_else(|e| refused(&e), |_| "read".to_owned())
}

/// As it is, and with checksums that agree, so that what is behind them is reached.
fn e57_that_is_damaged(bytes: &[u8]) -> String {
    thread_local! {
        static SOUND: u64 = read_scans(&e57(), "a.e57", false).unwrap().digest;
    }
    e57_file(bytes);
    match read_scans(bytes, "a.e57", true) {
        Ok(scans) => {
            assert_eq!(scans.digest, SOUND.with(|sound| *sound), "other samples were read");
            "read".to_owned()
        }
        Err(e) => refused(&e),
    }
}

fn e57_that_is_cut(bytes: &[u8]) -> String {
    let kind = e57_that_is_damaged(bytes);
    assert_eq!(kind, "refused");
    kind
}

/// Points of format 7, in layered chunks.
fn laz() -> Vec<u8> {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(7).unwrap();
    builder.point_format.is_compressed = true;
    let mut writer = las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
    let mut rng = fastrand::Rng::with_seed(5);
    for k in 0..800 {
        let (x, y, z) = (rng.f64() * 90.0, rng.f64() * 90.0, rng.f64() * 9.0);
        let color = Some(las::Color { red: rng.u16(..), green: 7, blue: 65_535 });
        let (intensity, gps_time) = (rng.u16(..), Some(rng.f64() * f64::from(k)));
        writer.write_point(las::Point { x, y, z, intensity, color, gps_time, ..las::Point::default() }).unwrap();
    }
    writer.close().unwrap();
    writer.into_inner().unwrap().into_inner()
}

fn laz_that_is_damaged(bytes: &[u8]) -> String {
    read_scans(bytes, "a.laz", true).map_or_else(|e| refused(&e), |_| "read".to_owned())
}

/// All samples can be read only if nothing but the chunk table, which is not used, is cut off.
fn laz_that_is_cut(bytes: &[u8]) -> String {
    thread_local! {
        static SOUND: u64 = read_scans(&laz(), "a.laz", false).unwrap().digest;
    }
    match read_scans(bytes, "a.laz", true) {
        Ok(scans) => {
            assert_eq!(scans.digest, SOUND.with(|sound| *sound), "other samples were read");
            "read".to_owned()
        }
        Err(e) => refused(&e),
    }
}

type Body = fn(&[u8]) -> String;

/// Every so many bytes truncated, and bits flipped, each alone.
fn damage(name: &str, sound: &[u8], cut: Body, flipped: Body) {
    let [truncations, flips] = counts();
    assert!(sound.len() > 10_000, "{} bytes have fewer different truncations than are asked for", sound.len());
    assert!(read_scans(sound, &format!("a.{name}"), false).is_ok());
    let (current, is_done) = (Current::new(&format!("damaged-{name}")), Mutex::new(false));
    let begun = std::time::Instant::now();
    let mut kept = [0; 2];
    std::thread::scope(|scope| {
        scope.spawn(|| current.watch(&is_done));
        let _done = Done(&is_done);
        for k in 0..truncations {
            kept[0] += usize::from(current.run(cut, &sound[..k * sound.len() / truncations]) != "refused");
        }
        let mut rng = fastrand::Rng::with_seed(21);
        for _ in 0..flips {
            let (mut damaged, bit) = (sound.to_vec(), rng.usize(..8 * sound.len()));
            damaged[bit / 8] ^= 1 << (bit % 8);
            kept[1] += usize::from(current.run(flipped, &damaged) != "refused");
        }
    });
    let held = kilwa_builder::build::machine::peak_memory().unwrap_or(0);
    println!(
        "{name} of {} bytes: {truncations} truncations ({} read), {flips} flips ({} read) in {:.1} s, at most {} MiB held",
        sound.len(),
        kept[0],
        kept[1],
        begun.elapsed().as_secs_f64(),
        held >> 20
    );
    // Other runners run other targets in the same process.
    assert!(std::env::var_os("NEXTEST").is_none() || held < LARGEST, "{held} bytes of memory were held");
    std::fs::remove_file(&current.path).unwrap();
}

#[test]
fn a_truncated_or_damaged_ptx_is_read_or_refused_with_its_place() {
    damage("ptx", &ptx(), ptx_that_is_cut, ptx_that_is_damaged);
}

#[test]
fn a_truncated_or_damaged_e57_is_refused_with_its_place() {
    damage("e57", &e57(), e57_that_is_cut, e57_that_is_damaged);
}

#[test]
fn a_truncated_or_damaged_layered_laz_is_read_or_refused_with_its_place() {
    damage("laz", &laz(), laz_that_is_cut, laz_that_is_damaged);
}
