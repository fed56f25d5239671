//! Masks: which samples of a station are not of the site, by name, reversible.
//!
//! A mask is a file beside the scan with a bit for each cell ([`MaskReader`]); the scan itself never changes. `survey.toml` names the masks of each station
//! and says which are on; [`open`] opens a station with those applied: what they mask is read as an empty cell. [`make`] makes masks.

mod file;
mod list;
mod make;
mod manage;
mod recipe;
mod through;

pub use file::{HEADER_BYTES, MaskHeader, MaskReader, MaskWriter};
pub use list::read_list;
pub use make::{Made, Report, Request, make};
pub use manage::{remove, switch};
pub use recipe::{Numbering, Recipe};
pub(crate) use through::{range_image, ray_spacing};

use crate::ScanError;
use crate::spool::Reader;
use crate::survey::{Mask, Station, Survey};
use std::path::Path;

/// Open the scan of a station with the masks that are on, or without any.
///
/// # Errors
/// Those of [`Reader::open`]; [`ScanError::Mask`] where a mask is damaged, missing, or of another scan.
pub fn open(folder: &Path, station: &Station, unmasked: bool) -> Result<Reader, ScanError> {
    let mut reader = Reader::open(&folder.join(&station.scan))?;
    if !unmasked {
        let is_on = |mask: &&Mask| mask.is_on;
        let masks =
            station.masks.iter().filter(is_on).map(|mask| MaskReader::open(&folder.join(&mask.file), &mask.name));
        reader.set_masks(masks.collect::<Result<_, _>>()?)?;
    }
    Ok(reader)
}

/// How many samples the masks that are applied mask together.
///
/// # Errors
/// [`ScanError::Mask`] where one is damaged.
pub fn count(reader: &mut Reader) -> Result<u64, ScanError> {
    const BATCH: u64 = 1 << 20;
    let cells = reader.header().grid.cells();
    let masks = reader.masks();
    if masks.len() < 2 {
        return Ok(masks.first().map_or(0, |mask| mask.header().masked));
    }
    let (mut at, mut total, mut is_masked) = (0, 0, Vec::new());
    while at < cells {
        let batch = BATCH.min(cells - at) as usize;
        is_masked.clear();
        is_masked.resize(batch, false);
        for mask in &mut *masks {
            mask.cells(at, batch, &mut |cell| is_masked[cell] = true)?;
        }
        total += is_masked.iter().filter(|is| **is).count() as u64;
        at += batch as u64;
    }
    Ok(total)
}

/// What tells the poses of stations from other ones.
fn digest_of_poses<'a>(stations: impl IntoIterator<Item = &'a Station>) -> String {
    let mut hash = blake3::Hasher::new();
    for station in stations {
        hash.update(station.name.as_bytes());
        hash.update(&[0, u8::from(station.pose.is_some())]);
        if let Some(pose) = station.pose {
            let q = pose.rotation;
            // To a nanometre: what a person writes with fewer digits is the same pose.
            for number in [q.x, q.y, q.z, q.w].into_iter().chain(pose.translation.to_array()) {
                hash.update(&((number * 1e9).round() as i64).to_le_bytes());
            }
        }
    }
    hash.finalize().to_hex()[..16].to_owned()
}

/// Whether a mask of a station was made with other poses than those that the survey has now: its own for boxes, those of all stations for
/// what rays of others pass through.
pub fn is_outdated(mask: &Mask, station: &Station, survey: &Survey) -> bool {
    mask.poses
        .as_ref()
        .is_some_and(|made| *made != digest_of_poses([station]) && *made != digest_of_poses(&survey.stations))
}
