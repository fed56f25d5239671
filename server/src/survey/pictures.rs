//! The pictures of stations: drawn on request, once for any number of simultaneous requests, and kept in memory up to a limit.
//!
//! A picture is at most [`WHOLE`] pixels wide and high. A station with more cells has tiles of [`PART`] pixels with every cell. The key of a picture names
//! what it was drawn from, so that a station whose files change gets another one; the old one is the first to go. A picture that failed is not kept.

use super::{Facts, Surveyed};
use axum::body::Bytes;
use kilwa_scan::ScanError;
use kilwa_scan::panorama::{self, Frame, Picture, Show, Window};
use kilwa_scan::survey::Station;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::OnceCell;

/// Largest width and height of the picture of a station.
pub(crate) const WHOLE: u32 = 2048;
/// Width and height of a tile of it.
pub(crate) const PART: u32 = 1024;
/// Bytes of all pictures that are kept.
const KEPT: usize = 128 << 20;

/// A picture as it is sent.
#[derive(Debug)]
pub(crate) struct Drawn {
    pub(crate) png: Bytes,
    pub(crate) size: [u32; 2],
    /// Of a station's.
    pub(crate) frame: Option<Frame>,
}

/// See the module.
#[derive(Debug, Default)]
pub(crate) struct Pictures {
    kept: Mutex<Kept>,
    drawn: AtomicU64,
}

#[derive(Debug, Default)]
struct Kept {
    pictures: HashMap<String, Entry>,
    bytes: usize,
    /// Grows with every use.
    uses: u64,
}

#[derive(Debug, Default)]
struct Entry {
    picture: Arc<OnceCell<Arc<Drawn>>>,
    bytes: usize,
    used: u64,
}

impl Pictures {
    pub(crate) fn drawn(&self) -> u64 {
        self.drawn.load(Ordering::Relaxed)
    }

    /// The picture of this key, drawn by `draw` where it is not kept.
    ///
    /// # Errors
    /// Those of `draw`, as sentences.
    pub(crate) async fn get(
        &self,
        key: &str,
        draw: impl FnOnce() -> Result<Drawn, String> + Send + 'static,
    ) -> Result<Arc<Drawn>, String> {
        let picture = {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.uses += 1;
            let now = kept.uses;
            let entry = kept.pictures.entry(key.to_owned()).or_default();
            entry.used = now;
            Arc::clone(&entry.picture)
        };
        let drawn = picture.get_or_try_init(|| async {
            self.drawn.fetch_add(1, Ordering::Relaxed);
            let drawn = tokio::task::spawn_blocking(draw).await.map_err(|e| e.to_string())??;
            Ok::<_, String>(Arc::new(drawn))
        });
        let drawn = drawn.await.cloned();
        self.kept.lock().unwrap_or_else(PoisonError::into_inner).settle(key, drawn.as_ref().ok());
        drawn
    }
}

impl Kept {
    /// Count a picture that was drawn, or forget one that failed; let those go that were not used for the longest time.
    fn settle(&mut self, key: &str, drawn: Option<&Arc<Drawn>>) {
        match (self.pictures.get_mut(key), drawn) {
            (Some(entry), Some(drawn)) if entry.bytes == 0 => {
                entry.bytes = drawn.png.len();
                self.bytes += entry.bytes;
            }
            (Some(entry), None) if !entry.picture.initialized() => {
                self.pictures.remove(key);
            }
            _ => {}
        }
        while self.bytes > KEPT {
            let settled = self.pictures.iter().filter(|(other, entry)| entry.bytes > 0 && *other != key);
            let Some(oldest) = settled.min_by_key(|(_, entry)| entry.used).map(|(key, _)| key.clone()) else { break };
            self.bytes -= self.pictures.remove(&oldest).map_or(0, |entry| entry.bytes);
        }
    }
}

/// What pictures show, by their names in addresses.
pub(crate) const SHOWN: [(&str, Show); 4] =
    [("range", Show::Range), ("intensity", Show::Intensity), ("colour", Show::Colour), ("mask", Show::Mask)];

/// The name of what a picture shows in addresses.
pub(crate) fn name_of(show: Show) -> &'static str {
    SHOWN.iter().find(|(_, other)| *other == show).map_or("range", |(name, _)| name)
}

/// What there are pictures of, of this station.
pub(crate) fn shown(station: &Station, facts: &Facts) -> Vec<Show> {
    let Ok(header) = &facts.header else { return Vec::new() };
    let has = |show: &Show| match show {
        Show::Range => true,
        Show::Intensity => header.statistics.with_intensity > 0,
        Show::Colour => header.statistics.colored > 0,
        Show::Mask => !station.masks.is_empty(),
    };
    SHOWN.iter().map(|(_, show)| *show).filter(has).collect()
}

/// The key of a picture: another one for whatever is drawn otherwise.
pub(crate) fn key(facts: &Facts, show: Show, part: Option<[u32; 2]>) -> String {
    let part = part.map(|[column, row]| format!(" {column}-{row}")).unwrap_or_default();
    format!("{} {}{part}", facts.identity, name_of(show))
}

/// The picture of a station.
///
/// # Errors
/// Why it cannot be drawn.
pub(crate) async fn whole(
    surveyed: &Arc<Surveyed>,
    station: &Station,
    facts: &Arc<Facts>,
    show: Show,
) -> Result<Arc<Drawn>, String> {
    let draw = drawing(surveyed, station, facts, show, None);
    surveyed.pictures.get(&key(facts, show, None), draw).await
}

/// A part of the picture of a station with every cell, [`PART`] cells wide and high but at its ends; `None` where it has no such part.
///
/// # Errors
/// Why it cannot be drawn.
pub(crate) async fn part(
    surveyed: &Arc<Surveyed>,
    station: &Station,
    facts: &Arc<Facts>,
    show: Show,
    [column, row]: [u32; 2],
) -> Result<Option<Arc<Drawn>>, String> {
    // Its place and its colours are those of the whole.
    let Some(frame) = whole(surveyed, station, facts, show).await?.frame else { return Ok(None) };
    let length = |number: u32, size: u32| {
        let start = number.checked_mul(PART).filter(|start| *start < size)?;
        Some((start, PART.min(size - start)))
    };
    let (Some((left, width)), Some((top, height))) = (length(column, frame.size[0]), length(row, frame.size[1])) else {
        return Ok(None);
    };
    let window = Window { left, top, width, height };
    let draw = drawing(surveyed, station, facts, show, Some((frame, window)));
    surveyed.pictures.get(&key(facts, show, Some([column, row])), draw).await.map(Some)
}

fn drawing(
    surveyed: &Arc<Surveyed>,
    station: &Station,
    facts: &Arc<Facts>,
    show: Show,
    part: Option<(Frame, Window)>,
) -> impl FnOnce() -> Result<Drawn, String> + Send + 'static {
    let (surveyed, station, facts) = (Arc::clone(surveyed), station.clone(), Arc::clone(facts));
    move || {
        let picture = draw(&surveyed, &station, show, part).map_err(|e| surveyed.fault(&facts, &e))?;
        let mut png = Vec::new();
        picture.write_png(&mut png).map_err(|e| e.to_string())?;
        Ok(Drawn { png: png.into(), size: [picture.width, picture.height], frame: Some(picture.frame) })
    }
}

fn draw(
    surveyed: &Surveyed,
    station: &Station,
    show: Show,
    part: Option<(Frame, Window)>,
) -> Result<Picture, ScanError> {
    let is_mask = show == Show::Mask;
    // The picture of masks shows what is below them.
    let mut reader = surveyed.reader(station, is_mask)?;
    let masks = station.masks.iter().filter(|_| is_mask).map(|mask| surveyed.mask(mask));
    let mut masks = masks.collect::<Result<Vec<_>, _>>()?;
    match part {
        None => panorama::render(&mut reader, show, &mut masks, WHOLE),
        Some((frame, window)) => panorama::render_part(&mut reader, show, &mut masks, &frame, window),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(bytes: usize) -> Drawn {
        Drawn { png: vec![0; bytes].into(), size: [1, 1], frame: None }
    }

    #[tokio::test]
    async fn pictures_are_drawn_once_and_the_least_used_make_room() {
        let pictures = Pictures::default();
        let large = KEPT / 2 - 10;
        for (key, drawn) in [("a", 1), ("b", 2), ("a", 2), ("c", 3), ("a", 3), ("b", 4)] {
            pictures.get(key, move || Ok(picture(large))).await.unwrap();
            assert_eq!(pictures.drawn(), drawn, "{key}");
            assert!(pictures.kept.lock().unwrap().bytes <= KEPT);
        }
    }

    #[tokio::test]
    async fn a_picture_that_failed_is_tried_again() {
        let pictures = Pictures::default();
        assert_eq!(pictures.get("a", || Err("no".to_owned())).await.unwrap_err(), "no");
        assert!(pictures.kept.lock().unwrap().pictures.is_empty());
        assert!(pictures.get("a", || Ok(picture(1))).await.is_ok());
    }
}
