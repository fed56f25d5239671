//! LAS of point formats 6 to 10, and LAZ with layered chunks.

use crate::support::{Site, seen_from};
use kilwa_scan::read::ReadOptions;
use kilwa_scan_core::Sample;
use std::path::PathBuf;

/// A file of points of this format, compressed by its name; some values change from point to point and some never, so that layers are there or empty.
pub(crate) fn written(site: &Site, name: &str, format: u8, count: u32) -> PathBuf {
    let mut builder = las::Builder::from((1, 4));
    builder.point_format = las::point::Format::new(format).unwrap();
    builder.point_format.is_compressed = name.ends_with("laz");
    builder.point_format.extra_bytes = 3;
    let transform = las::Transform { scale: 0.001, offset: 566_000.0 };
    builder.transforms = las::Vector { x: transform, y: transform, z: transform };
    let path = site.path(name);
    let format = builder.point_format;
    let mut writer = las::Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
    let mut rng = fastrand::Rng::with_seed(3);
    let returns = if format.is_extended { 15 } else { 5 };
    for k in 0..count {
        let mut near = || 566_000.0 + f64::from(rng.u32(..90_000)) * 0.001;
        let (x, y, z) = (near(), near(), near());
        let point = las::Point {
            x,
            y,
            z,
            intensity: rng.u16(..),
            return_number: rng.u8(1..=returns),
            number_of_returns: returns,
            gps_time: format.has_gps_time.then_some(f64::from(k)),
            color: format.has_color.then(|| las::Color { red: rng.u16(..), green: 700, blue: 65_535 }),
            nir: format.has_nir.then(|| rng.u16(..)),
            waveform: format.has_waveform.then(Default::default),
            extra_bytes: vec![rng.u8(..), 7, (k % 3) as u8],
            // Each channel of the scanner has contexts of its own in layers.
            scanner_channel: if format.is_extended { (k / 7 % 4) as u8 } else { 0 },
            ..las::Point::default()
        };
        writer.write_point(point).unwrap();
    }
    writer.close().unwrap();
    path
}

fn here() -> ReadOptions {
    seen_from(566_040.0, 566_040.0, 566_001.5)
}

fn samples(site: &Site, path: PathBuf) -> Vec<Sample> {
    let report = site.import(&[path], here()).unwrap();
    site.samples(&report.stations[0].station.name)
}

/// Chunks have 50,000 points, so there is more than one.
#[test]
fn las_and_laz_of_the_extended_point_formats_hold_the_same_samples() {
    const COUNT: u32 = 60_000;
    let site = Site::new();
    for format in [6, 7, 8, 9, 10] {
        let plain = samples(&site, written(&site, &format!("plain{format}.las"), format, COUNT));
        let layered = samples(&site, written(&site, &format!("layered{format}.laz"), format, COUNT));
        assert!(plain == layered, "format {format}");
        assert_eq!(plain.len(), COUNT as usize);
        let has_color = [7, 8, 10].contains(&format);
        assert!(plain.iter().all(|s| s.state.has_color() == has_color));
        assert!(!has_color || plain.iter().all(|s| s.color[1..] == [2, 255]));
        let mut numbers = [0; 16];
        for sample in &plain {
            numbers[usize::from(sample.state.return_number())] += 1;
        }
        assert!(numbers[0] == 0 && numbers[1..].iter().all(|n| *n > 3000), "{numbers:?}");
    }
}

fn refusal(site: &Site, bytes: &[u8]) -> String {
    let file = site.write("a.laz", bytes);
    site.import(&[file], here()).unwrap_err().to_string()
}

/// The lengths in the head of a chunk are compared with the file before anything is allocated for it.
#[test]
fn chunks_with_wrong_heads_are_refused_with_their_byte() {
    let site = Site::new();
    let bytes = std::fs::read(written(&site, "seed.laz", 6, 50)).unwrap();
    let at = chunks_at(&bytes);
    // After the first point (30 bytes, and three extra bytes): the number of points, and the lengths of nine layers.
    let count = at + 33;
    let with = |place: usize, value: u32| {
        let mut lying = bytes.clone();
        lying[place..place + 4].copy_from_slice(&value.to_le_bytes());
        refusal(&site, &lying)
    };
    for (place, value, expected) in [
        (count, 0, "a chunk without points"),
        (count, 51, "chunks of 51 points in all"),
        (count, 40, "a chunk of"),
        (count + 4, u32::MAX, "are left in the file"),
        (count + 36, u32::MAX, "are left in the file"),
    ] {
        let message = with(place, value);
        assert!(message.contains(expected) && message.contains("byte "), "{message}");
        assert!(value == 40 || message.contains(&format!("byte {at}")), "{message}");
    }
}

/// The record says how many items a point has: it is not read beyond its end, and not once more for each record like it.
#[test]
fn very_many_laszip_records_of_very_many_items_are_refused_at_once() {
    const RECORDS: u32 = 20_000;
    let site = Site::new();
    let sound = std::fs::read(written(&site, "seed.laz", 6, 50)).unwrap();
    let head = usize::from(u16::from_le_bytes([sound[94], sound[95]]));
    let mut record = [0; 54];
    record[2..16].copy_from_slice(b"laszip encoded");
    record[18..20].copy_from_slice(&22_204_u16.to_le_bytes());
    // Behind a record without data, this is the number of items of the one before it.
    record[32..34].fill(255);
    let mut bytes = sound[..head].to_vec();
    bytes.extend(record.repeat(RECORDS as usize));
    let points = bytes.len() as u32;
    bytes.resize(bytes.len() + 6 * 65_535, 0);
    bytes[96..100].copy_from_slice(&points.to_le_bytes());
    bytes[100..104].copy_from_slice(&RECORDS.to_le_bytes());
    let message = refusal(&site, &bytes);
    assert!(message.contains(&format!("byte {}:", head + 54 + 32)), "{message}");
    assert!(message.contains("65535 items of points in a LASzip record of 0 bytes"), "{message}");
}

#[test]
fn a_second_laszip_record_and_too_many_items_are_refused_by_their_bytes() {
    let site = Site::new();
    let sound = std::fs::read(written(&site, "seed.laz", 6, 50)).unwrap();
    let (head, points) = (usize::from(u16::from_le_bytes([sound[94], sound[95]])), chunks_at(&sound) - 8);
    let found = (head..points).find(|at| sound[at + 18..at + 20] == 22_204_u16.to_le_bytes()).unwrap();
    let length = 54 + usize::from(u16::from_le_bytes([sound[found + 20], sound[found + 21]]));
    let record = sound[found..found + length].to_vec();
    // The record is replaced by these bytes, which are this many records.
    let with = |records: &[u8], more: u32| {
        let mut bytes = [&sound[..found], records, &sound[found + length..]].concat();
        let count = u32::from_le_bytes(sound[100..104].try_into().unwrap()) + more;
        bytes[96..100].copy_from_slice(&((points + records.len() - length) as u32).to_le_bytes());
        bytes[100..104].copy_from_slice(&count.to_le_bytes());
        refusal(&site, &bytes)
    };
    let message = with(&record.repeat(2), 1);
    assert!(message.contains(&format!("byte {}: found a second LASzip record", found + length)), "{message}");
    // The compatibility mode of LASzip has a record of the same number and another user ID.
    let mut compatible = record.clone();
    compatible[2..18].copy_from_slice(b"lascompatible\0\0\0");
    let mut bytes = [&sound[..found], &compatible[..], &sound[found..]].concat();
    bytes[96..100].copy_from_slice(&((points + length) as u32).to_le_bytes());
    let count = u32::from_le_bytes(sound[100..104].try_into().unwrap()) + 1;
    bytes[100..104].copy_from_slice(&count.to_le_bytes());
    // The place of the table of chunks, which precedes them, has moved too.
    let table = u64::from_le_bytes(sound[points..points + 8].try_into().unwrap()) + length as u64;
    let at = points + length;
    bytes[at..at + 8].copy_from_slice(&table.to_le_bytes());
    let other = Site::new();
    let file = other.write("compatible.laz", &bytes);
    other.import(&[file], here()).unwrap();
    let mut pointwise = record.clone();
    pointwise[54] = 1;
    let message = with(&pointwise, 0);
    assert!(
        message.contains(&format!("byte {}: found points that are not divided into chunks", found + 54)),
        "{message}"
    );
    let mut many = record.clone();
    many[20..22].copy_from_slice(&(34 + 6 * 16_u16).to_le_bytes());
    many[54 + 32..54 + 34].copy_from_slice(&16_u16.to_le_bytes());
    many.resize(54 + 34 + 6 * 16, 0);
    let message = with(&many, 0);
    assert!(message.contains(&format!("byte {}: found 16 items", found + 54 + 32)), "{message}");
}

/// Layers of values that never change take almost no bytes, so that a small file can hold more points than the disk has room for.
#[test]
fn points_that_the_disk_has_no_room_for_are_refused_before_they_are_read() {
    let site = Site::new();
    for format in [3, 6] {
        let mut bytes = std::fs::read(written(&site, "seed.laz", format, 50)).unwrap();
        // The number of points has 32 bits in older versions and 64 in version 1.4; which one is read depends on both.
        bytes[107..111].fill(255);
        bytes[247..251].fill(255);
        let message = refusal(&site, &bytes);
        let free = fs4::available_space(site.survey()).unwrap();
        if free > 80 << 30 {
            eprintln!("skipped: the disk has room for {free} bytes");
            continue;
        }
        assert!(message.contains("4294967295 samples take 80 GiB") && message.contains(" free"), "{message}");
        assert!(!site.survey().join("stations").exists());
    }
}

/// On damaged bytes, `laz` recurses without limit when it decodes GPS times. They are not kept, so they are not decoded.
#[test]
fn the_layer_of_gps_times_is_skipped_even_if_it_is_damaged() {
    let site = Site::new();
    let sound = written(&site, "seed.laz", 6, 2000);
    let bytes = std::fs::read(&sound).unwrap();
    let before = samples(&site, sound);
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let lengths = chunks_at(&bytes) + 33 + 4;
    // Nine layers of a point, the last of which has the GPS times, and three layers of extra bytes.
    let layers = lengths + 4 * 12;
    let begin = layers + (0..8).map(|k| word(lengths + 4 * k)).sum::<usize>();
    let times = begin..begin + word(lengths + 4 * 8);
    assert!(times.len() > 100);
    for seed in 0..50 {
        let mut damaged = bytes.clone();
        let mut rng = fastrand::Rng::with_seed(seed);
        damaged[times.clone()].fill_with(|| rng.u8(..));
        let file = site.write(&format!("damaged{seed}.laz"), &damaged);
        assert!(samples(&site, file) == before);
    }
}

/// The byte where the chunks begin.
fn chunks_at(bytes: &[u8]) -> usize {
    u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize + 8
}

/// A point too far away is named by its byte, which counts from the beginning of the file.
#[test]
fn the_byte_of_a_point_too_far_away_is_that_of_the_file() {
    let site = Site::new();
    let file = written(&site, "far.las", 6, 40);
    let mut bytes = std::fs::read(&file).unwrap();
    let (at, point) = (chunks_at(&bytes) - 8, 30 + 3);
    let place = at + 17 * point;
    bytes[place..place + 4].copy_from_slice(&i32::MAX.to_le_bytes());
    std::fs::write(&file, bytes).unwrap();
    let message = site.import(&[file], here()).unwrap_err().to_string();
    assert!(message.contains(&format!("byte {place}:")) && message.contains("km from the scanner"), "{message}");
}

/// Neither truncation nor damage crashes the reader, makes it hang or allocate what is not there.
#[test]
fn truncated_and_damaged_chunks_in_layers_are_refused_or_read() {
    let mut rng = fastrand::Rng::with_seed(11);
    let site = Site::new();
    let bytes = std::fs::read(written(&site, "seed.laz", 8, 200)).unwrap();
    for round in 0..300 {
        let mut damaged = bytes.clone();
        if round % 3 == 0 {
            damaged.truncate(rng.usize(..bytes.len()));
        } else {
            for _ in 0..=rng.usize(..3) {
                let at = rng.usize(..damaged.len());
                damaged[at] ^= 1 << rng.u8(..8);
            }
        }
        let file = site.write("a.laz", &damaged);
        drop(std::fs::remove_dir_all(site.survey()));
        match site.import(&[file], here()) {
            Ok(report) => assert_eq!(site.samples(&report.stations[0].station.name).len(), 200),
            Err(e) => assert!(e.to_string().contains("a.laz"), "{e}"),
        }
    }
}
