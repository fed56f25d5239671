//! What rays of other stations pass through.
//!
//! A range image is made of every station with a pose. They are kept in memory as far as [`MEMORY`] goes, the others in a scratch file, from which they are
//! loaded a few at a time. For the station that is masked, a byte a cell counts its witnesses.

use super::MaskWriter;
use super::make::{Making, joining};
use crate::ScanError;
use crate::import::Progress;
use crate::spool::Reader;
use crate::survey::{Station, Survey};
use glam::{DMat3, DVec3};
use kilwa_scan_core::mask::components::Finder;
use kilwa_scan_core::mask::through::{RangeImage, Tally};
use kilwa_scan_core::{Pose, Rays, Sample};
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Bytes of range images in memory.
pub(super) const MEMORY: usize = 192 << 20;
/// Cells read at a time.
const BATCH: u64 = 65_536;
/// A thing that is passed through has at least so many samples whose witnesses saw through all around it.
const MIN_SURE: u32 = 3;

/// One station that may be a witness.
struct Witness {
    name: String,
    pose: Pose,
    /// Standard deviations of its pose: metres, radians.
    sigma: [f64; 2],
    image: Kept,
}

enum Kept {
    Memory(RangeImage),
    /// An empty image of the same size, and where its pixels are.
    Scratch {
        empty: RangeImage,
        offset: u64,
    },
}

/// All stations that may be witnesses.
pub(super) struct Witnesses {
    all: Vec<Witness>,
    /// Bytes of range images in memory.
    memory: usize,
    scratch: Option<File>,
    /// Stations that have no pose.
    pub(super) without_pose: Vec<String>,
}

impl Witnesses {
    pub(super) fn new(
        folder: &Path,
        survey: &Survey,
        stations: &[&Station],
        needed: u8,
        memory: usize,
        progress: &dyn Progress,
    ) -> Result<Self, ScanError> {
        let mut made = Self { all: Vec::new(), memory, scratch: None, without_pose: Vec::new() };
        let (mut held, mut offset) = (0, 0);
        let with_pose = survey.stations.iter().filter(|s| s.pose.is_some()).count();
        for station in stations {
            if with_pose.saturating_sub(1) < usize::from(needed) {
                return Err(ScanError::Request(format!(
                    "station {} can be masked only if {needed} other stations have poses, but {} have; add rotation and translation to more stations in survey.toml",
                    station.name,
                    with_pose.saturating_sub(1)
                )));
            }
        }
        for (number, station) in survey.stations.iter().enumerate() {
            let Some(pose) = station.pose else {
                made.without_pose.push(station.name.clone());
                continue;
            };
            let mut reader = Reader::open(&folder.join(&station.scan))?;
            if reader.header().rays != Rays::Central {
                continue;
            }
            let image = range_image(&mut reader, &mut |done, cells| {
                if progress.is_stopped() {
                    return Err(ScanError::Stopped);
                }
                let share = (number as f64 + done as f64 / cells.max(1) as f64) / survey.stations.len() as f64;
                progress.update("looking", (share * 1e6) as u64, 1_000_000);
                Ok(())
            })?;
            let image = if held + image.bytes() <= memory / 2 {
                held += image.bytes();
                Kept::Memory(image)
            } else {
                let cannot = |source| ScanError::Write { path: folder.to_owned(), source };
                let file = match &mut made.scratch {
                    Some(file) => file,
                    None => made.scratch.insert(tempfile::tempfile_in(folder).map_err(cannot)?),
                };
                let bytes: Vec<u8> = image.pixels().iter().flat_map(|range| range.to_le_bytes()).collect();
                file.seek(SeekFrom::Start(offset)).and_then(|_| file.write_all(&bytes)).map_err(cannot)?;
                let kept = Kept::Scratch { offset, empty: image.emptied() };
                offset += bytes.len() as u64;
                kept
            };
            let sigma = station.sigma.unwrap_or_default();
            made.all.push(Witness { name: station.name.clone(), pose, sigma, image });
        }
        Ok(made)
    }
}

/// What a station saw in every direction.
pub(crate) fn range_image(
    reader: &mut Reader,
    progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
) -> Result<RangeImage, ScanError> {
    let mut image = RangeImage::new(ray_spacing(reader)?);
    let (cells, mut at, mut batch) = (reader.header().grid.cells(), 0, Vec::new());
    while at < cells {
        let count = BATCH.min(cells - at);
        reader.read(at, count as usize, &mut batch)?;
        batch.iter().filter(|sample| sample.is_measured()).for_each(|sample| image.add(sample.position));
        at += count;
        progress(at, cells)?;
    }
    Ok(image)
}

/// How far neighbouring rays are from each other, radians: the larger of the medians along and across lines; of a cloud, as if its points were spread
/// evenly over the sphere.
pub(crate) fn ray_spacing(reader: &mut Reader) -> Result<f64, ScanError> {
    const LINES: u32 = 48;
    let header = *reader.header();
    if !header.is_grid {
        return Ok((4.0 * std::f64::consts::PI / header.statistics.measured.max(1) as f64).sqrt());
    }
    let (mut along, mut across) = (Vec::new(), Vec::new());
    let (mut line, mut next) = (Vec::new(), Vec::new());
    let lines = header.grid.lines();
    for number in (0..lines).step_by((lines / LINES).max(1) as usize) {
        reader.line(number, &mut line)?;
        next.clear();
        if number + 1 < lines {
            reader.line(number + 1, &mut next)?;
        }
        along.extend(line.windows(2).filter_map(|pair| angle(&pair[0], &pair[1], false)));
        across.extend(line.iter().zip(&next).filter_map(|(a, b)| angle(a, b, true)));
    }
    let median = |angles: &mut Vec<f64>| {
        angles.sort_unstable_by(f64::total_cmp);
        angles.get(angles.len() / 2).copied().unwrap_or(0.0)
    };
    // Which of both are azimuths does not matter to the larger.
    Ok(median(&mut along).max(median(&mut across)).max(1e-5))
}

/// The angle between two samples; `across`: as it would be at the horizon, if they are at the same height.
fn angle(a: &Sample, b: &Sample, across: bool) -> Option<f64> {
    if !a.is_measured() || !b.is_measured() {
        return None;
    }
    let (a, b) = (a.position.as_dvec3().try_normalize()?, b.position.as_dvec3().try_normalize()?);
    let angle = a.angle_between(b);
    let cos = (1.0 - a.z * a.z).max(0.0).sqrt();
    if across && (a.z - b.z).abs() < 0.3 * angle { (cos > 0.2).then_some(angle / cos) } else { Some(angle) }
}

/// A witness that is in memory, and the way to its coordinates.
struct Loaded<'a> {
    image: std::borrow::Cow<'a, RangeImage>,
    rotation: DMat3,
    translation: DVec3,
    sigma: [f64; 2],
}

impl Loaded<'_> {
    fn look(&self, position: DVec3, margin: f64) -> kilwa_scan_core::mask::through::Witness {
        let place = self.rotation * position + self.translation;
        let [metres, radians] = self.sigma;
        let margin = margin + 3.0 * (metres + radians * place.length());
        self.image.witness(place, margin)
    }
}

/// Mask what rays of others pass through.
pub(super) fn mask(
    making: &mut Making<'_>,
    witnesses: &Witnesses,
    needed: u8,
    margin: f64,
    writer: &mut MaskWriter,
) -> Result<(), ScanError> {
    let header = *making.reader.header();
    let cells = header.grid.cells();
    let pose = making.station.pose.unwrap_or_default();
    let own_sigma = making.station.sigma.unwrap_or_default();
    let name = &making.station.name;
    let others: Vec<&Witness> = witnesses.all.iter().filter(|witness| witness.name != *name).collect();
    let groups = groups(&others, witnesses.memory);
    making.parts = groups.len() as u64 + 2;
    let mut tallies = vec![Tally::default(); cells as usize];
    let mut batch = Vec::new();
    for (number, group) in groups.iter().enumerate() {
        let loaded: Vec<Loaded<'_>> =
            group.iter().map(|witness| load(witness, witnesses, pose, own_sigma, making)).collect::<Result<_, _>>()?;
        let mut at = 0;
        while at < cells {
            let count = BATCH.min(cells - at);
            making.reader.read(at, count as usize, &mut batch)?;
            tally(&batch, &mut tallies[at as usize..(at + count) as usize], &loaded, needed, margin);
            at += count;
            making.progress(number as u64, at, cells)?;
        }
    }
    connected(making, &tallies, needed, groups.len() as u64, writer)
}

/// As many at a time as the memory allows.
fn groups<'a>(others: &[&'a Witness], memory: usize) -> Vec<Vec<&'a Witness>> {
    let mut groups: Vec<Vec<&Witness>> = Vec::new();
    let mut bytes = usize::MAX;
    for &witness in others {
        let own = match &witness.image {
            Kept::Memory(_) => 0,
            Kept::Scratch { empty, .. } => empty.full_bytes(),
        };
        if bytes.saturating_add(own) > memory / 2 {
            groups.push(Vec::new());
            bytes = 0;
        }
        bytes += own;
        if let Some(group) = groups.last_mut() {
            group.push(witness);
        }
    }
    groups
}

fn load<'a>(
    witness: &'a Witness,
    witnesses: &Witnesses,
    pose: Pose,
    own_sigma: [f64; 2],
    making: &Making<'_>,
) -> Result<Loaded<'a>, ScanError> {
    let image = match &witness.image {
        Kept::Memory(image) => std::borrow::Cow::Borrowed(image),
        Kept::Scratch { empty, offset } => {
            let read = || -> io::Result<RangeImage> {
                let mut bytes = vec![0; empty.full_bytes()];
                if let Some(mut file) = witnesses.scratch.as_ref() {
                    file.seek(SeekFrom::Start(*offset))?;
                    file.read_exact(&mut bytes)?;
                }
                let number = |four: &[u8]| f32::from_le_bytes([four[0], four[1], four[2], four[3]]);
                Ok(empty.filled(bytes.chunks_exact(4).map(number).collect()))
            };
            std::borrow::Cow::Owned(read().map_err(making.cannot())?)
        }
    };
    let to = pose.then(witness.pose.inverse());
    let sigma = [witness.sigma[0].hypot(own_sigma[0]), witness.sigma[1].hypot(own_sigma[1])];
    Ok(Loaded { image, rotation: DMat3::from_quat(to.rotation), translation: to.translation, sigma })
}

/// Enter what the witnesses say of a batch of samples; all processors share it.
fn tally(batch: &[Sample], tallies: &mut [Tally], witnesses: &[Loaded<'_>], needed: u8, margin: f64) {
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(16);
    let share = batch.len().div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        for (samples, tallies) in batch.chunks(share).zip(tallies.chunks_mut(share)) {
            scope.spawn(move || {
                for (sample, tally) in samples.iter().zip(tallies).filter(|(sample, _)| sample.is_measured()) {
                    let position = sample.position.as_dvec3();
                    for witness in witnesses {
                        if tally.whole() >= needed {
                            break;
                        }
                        tally.add(witness.look(position, margin));
                    }
                }
            });
        }
    });
}

/// Mask the connected things that enough witnesses saw through, and of which some samples were seen through all around.
fn connected(
    making: &mut Making<'_>,
    tallies: &[Tally],
    needed: u8,
    part: u64,
    writer: &mut MaskWriter,
) -> Result<(), ScanError> {
    let header = *making.reader.header();
    let (lines, length) = (header.grid.lines(), header.grid.line_length() as usize);
    let cannot = making.cannot();
    let mut finder = Finder::new(joining(making.station, header.rays), header.rays);
    let mut line = Vec::new();
    let of = |number: u32| &tallies[number as usize * length..(number as usize + 1) * length];
    for number in 0..lines {
        making.reader.line(number, &mut line)?;
        let own = of(number);
        finder.line(&line, &|at| own[at].any() >= needed, &|at| own[at].whole() >= needed);
        making.progress(part, u64::from(number), u64::from(lines))?;
    }
    if making.closes()? {
        finder.close();
    }
    let mut components = finder.finish();
    for number in 0..lines {
        making.reader.line(number, &mut line)?;
        let own = of(number);
        let mut places = Vec::new();
        components.line(&line, &|at| own[at].any() >= needed, &mut |at, _, sure| {
            if sure >= MIN_SURE {
                places.push(at);
            }
        });
        for at in places {
            writer.mask(u64::from(number) * length as u64 + at as u64).map_err(&cannot)?;
        }
        making.progress(part + 1, u64::from(number), u64::from(lines))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::make::make_within;
    use super::super::{Recipe, Request};
    use super::*;
    use crate::import::{Options, Silent, import};
    use std::fmt::Write as _;

    /// Rays to a sphere of 10 m around the site; some of the first station's end after 2 m.
    fn scan(at: f64, has_thing: bool) -> String {
        let mut text = format!("100\n60\n{at} 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{at} 0 0 1\n");
        for (column, row) in (0..100).flat_map(|column| (0..60).map(move |row| (column, row))) {
            let (a, e) = (f64::from(column) * 0.06283, (f64::from(row) - 30.0) * 0.045);
            let d = DVec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin());
            let far = -at * d.x + (at * at * d.x * d.x - at * at + 100.0).sqrt();
            let p = d * if has_thing && (20..30).contains(&column) && (25..40).contains(&row) { 2.0 } else { far };
            writeln!(text, "{:.6} {:.6} {:.6} 0.5", p.x, p.y, p.z).unwrap();
        }
        text
    }

    #[test]
    fn range_images_that_do_not_fit_into_memory_give_the_same_mask() {
        let folder = tempfile::tempdir().unwrap();
        let survey = folder.path().join("survey");
        let files: Vec<_> = [(0.0, true), (1.0, false), (-1.5, false), (3.0, false)]
            .iter()
            .enumerate()
            .map(|(k, (at, has_thing))| {
                let path = folder.path().join(format!("s{k}.ptx"));
                std::fs::write(&path, scan(*at, *has_thing)).unwrap();
                path
            })
            .collect();
        import(&survey, &files, &Options::default(), &Silent).unwrap();
        let recipe = Recipe::SeenThrough { witnesses: 2, margin: 0.1 };
        let made = [("a", MEMORY), ("b", 0)].map(|(name, memory)| {
            let request = Request { name: name.to_owned(), recipe: recipe.clone(), stations: Vec::new() };
            make_within(&survey, &request, &Silent, memory).unwrap()
        });
        assert_eq!(made[0], made[1]);
        let masked: Vec<u64> = made[0].stations.iter().map(|made| made.masked).collect();
        assert_eq!(masked, [150, 0, 0, 0]);
        let bytes = |name: &str| {
            let toml = Survey::open(&survey).unwrap();
            let mask = toml.stations[0].masks.iter().find(|mask| mask.name == name).unwrap().file.clone();
            std::fs::read(survey.join(mask)).unwrap()
        };
        assert!(bytes("a") == bytes("b"));
    }
}
