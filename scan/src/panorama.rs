//! A station as a picture: range, intensity or colour of every cell of its grid, as the scanner saw it; clouds without a grid as an equirectangular
//! view from the station; or which samples its masks mask.

mod pick;

pub use pick::{Picked, WIDTH_MAX, pick};

use crate::ScanError;
use crate::mask::MaskReader;
use crate::spool::Reader;
use crate::write_png::write_png;
use kilwa_scan_core::{Kind, Rays, Sample};
use std::io::Write;

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Show {
    /// The distance from the scanner, near dark, far bright.
    Range,
    /// The intensity, from its 1st to its 99th percentile.
    Intensity,
    /// The colour.
    Colour,
    /// What masks mask, each in its colour ([`mask_color`]); the rest in grey, near dark, far bright.
    Mask,
}

/// Largest number of columns of the picture of a cloud.
const CLOUD_MAX: u32 = 16_384;
/// Cells where nothing is recorded.
const EMPTY: [u8; 3] = [12, 12, 16];
/// Cells without a valid return.
const NO_RETURN: [u8; 3] = [28, 36, 64];
/// Points without a colour or an intensity, where that is shown.
const WITHOUT: [u8; 3] = [90, 70, 70];
/// Colours of masks, far from each other also for colour-blind people (Okabe and Ito 2008).
const MASKS: [(&str, [u8; 3]); 7] = [
    ("orange", [230, 159, 0]),
    ("sky blue", [86, 180, 233]),
    ("green", [0, 158, 115]),
    ("yellow", [240, 228, 66]),
    ("blue", [0, 114, 178]),
    ("red", [213, 94, 0]),
    ("pink", [204, 121, 167]),
];

/// The name and the colour of the mask with this number; after seven they begin again.
pub fn mask_color(number: usize) -> (&'static str, [u8; 3]) {
    MASKS[number % MASKS.len()]
}

/// From dark to bright, even in lightness.
const RAMP: [[u8; 3]; 6] =
    [[48, 18, 77], [62, 73, 137], [49, 104, 142], [38, 166, 125], [122, 209, 81], [253, 231, 37]];

/// A picture of three bytes a pixel.
#[derive(Debug, Clone)]
pub struct Picture {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Rows from the top, red green blue.
    pub pixels: Vec<u8>,
    /// What this picture has in common with those of its parts.
    pub frame: Frame,
}

/// How a station lies in its picture and what the colours mean: for the whole picture and, with the same colours, for every part of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// Pixels across and down with a pixel for every cell of the grid; of a cloud, with about one for every point.
    pub size: [u32; 2],
    /// The values at both ends of the ramp: metres, or the file's intensity.
    pub scale: Option<[f32; 2]>,
    /// Whether the rows of the grid run upwards, and its columns to the left.
    is_upside_down: bool,
    is_mirrored: bool,
}

/// A part of a picture, in pixels of [`Frame::size`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The first column.
    pub left: u32,
    /// The first row.
    pub top: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl Picture {
    /// Write it as PNG.
    ///
    /// # Errors
    /// The system's.
    pub fn write_png(&self, out: &mut dyn Write) -> std::io::Result<()> {
        write_png(out, [self.width, self.height], png::ColorType::Rgb, &self.pixels)
    }
}

/// A cell of a picture: its sample, and the number of the first mask that masks something in it, from 1.
#[derive(Debug, Clone, Copy, Default)]
struct Cell {
    sample: Sample,
    mask: u8,
}

/// A picture of a station, at most `max` pixels wide and high. `masks` are shown by [`Show::Mask`] only.
///
/// # Errors
/// [`ScanError::Spool`] where the spool is damaged; [`ScanError::Mask`] where a mask is; [`ScanError::Request`] where the station has no colours or no intensity.
pub fn render(reader: &mut Reader, show: Show, masks: &mut [MaskReader], max: u32) -> Result<Picture, ScanError> {
    check(reader, show, masks)?;
    let size = full_size(reader);
    let max = max.max(16);
    let mut frame = Frame { size, scale: None, is_upside_down: false, is_mirrored: false };
    let (mut cells, [width, height]) = if reader.header().is_grid {
        let step = size[0].max(size[1]).div_ceil(max);
        (from_grid(reader, masks, [0, 0], size, step)?, size.map(|n| n.div_ceil(step)))
    } else {
        let width = max.min(size[0]) / 2 * 2;
        let size = [width, width / 2];
        let window = Window { left: 0, top: 0, width: size[0], height: size[1] };
        (from_cloud(reader, masks, size, window)?, size)
    };
    if reader.header().is_grid {
        let rays = reader.header().rays;
        frame.is_upside_down = !rises_to_the_top(&cells, width, rays);
        turn(&mut cells, width, frame.is_upside_down, false);
        frame.is_mirrored = is_mirrored(&cells, width, rays);
        turn(&mut cells, width, false, frame.is_mirrored);
    }
    frame.scale = (show != Show::Colour).then(|| percentiles(&cells, show));
    let pixels = cells.iter().flat_map(|cell| pixel(cell, show, frame.scale)).collect();
    Ok(Picture { width, height, pixels, frame })
}

/// A part of a picture of a station with every cell, in the place and the colours that `frame` says, which [`render`] gives for the same station.
///
/// # Errors
/// As of [`render`]; [`ScanError::Request`] for a part that is not in the picture.
pub fn render_part(
    reader: &mut Reader,
    show: Show,
    masks: &mut [MaskReader],
    frame: &Frame,
    part: Window,
) -> Result<Picture, ScanError> {
    check(reader, show, masks)?;
    let Window { left, top, width, height } = part;
    let ends = [left.checked_add(width), top.checked_add(height)];
    let is_inside = ends.iter().zip(frame.size).all(|(end, size)| end.is_some_and(|end| end <= size));
    if !is_inside || width == 0 || height == 0 || frame.size != full_size(reader) {
        return Err(ScanError::Request("the picture of the station has no such part".to_owned()));
    }
    let cells = cells_of(reader, masks, frame, part)?;
    let pixels = cells.iter().flat_map(|cell| pixel(cell, show, frame.scale)).collect();
    Ok(Picture { width, height, pixels, frame: *frame })
}

/// The cells of a part of the picture, in its rows from the top. The part must lie inside the picture.
fn cells_of(
    reader: &mut Reader,
    masks: &mut [MaskReader],
    frame: &Frame,
    part: Window,
) -> Result<Vec<Cell>, ScanError> {
    if !reader.header().is_grid {
        return from_cloud(reader, masks, frame.size, part);
    }
    let from_end = |start: u32, length: u32, size: u32, is_turned: bool| {
        if is_turned { size - start - length } else { start }
    };
    let column = from_end(part.left, part.width, frame.size[0], frame.is_mirrored);
    let row = from_end(part.top, part.height, frame.size[1], frame.is_upside_down);
    let mut cells = from_grid(reader, masks, [column, row], [part.width, part.height], 1)?;
    turn(&mut cells, part.width, frame.is_upside_down, frame.is_mirrored);
    Ok(cells)
}

fn check(reader: &Reader, show: Show, masks: &[MaskReader]) -> Result<(), ScanError> {
    let statistics = reader.header().statistics;
    let missing = match show {
        Show::Intensity if statistics.with_intensity == 0 => Some("intensity"),
        Show::Colour if statistics.colored == 0 => Some("colours"),
        _ => None,
    };
    if let Some(what) = missing {
        return Err(ScanError::Request(format!("this station has no {what}; use --show range")));
    }
    masks.iter().try_for_each(|mask| mask.check_scan(reader.header()))
}

/// See [`Frame::size`].
fn full_size(reader: &Reader) -> [u32; 2] {
    let grid = reader.header().grid;
    if reader.header().is_grid {
        return [grid.columns, grid.rows];
    }
    // About one point per pixel, as long as there is room.
    let width = CLOUD_MAX.min(2 * ((grid.cells() as f64 / 2.0).sqrt() as u32).max(64)) / 2 * 2;
    [width, width / 2]
}

/// Turn rows and columns of cells.
fn turn(cells: &mut Vec<Cell>, width: u32, is_upside_down: bool, is_mirrored: bool) {
    if is_upside_down {
        *cells = cells.chunks(width as usize).rev().flatten().copied().collect();
    }
    if is_mirrored {
        cells.chunks_mut(width as usize).for_each(<[Cell]>::reverse);
    }
}

/// Of `size` columns and rows of the grid, from `first` on, every `step`-th. Masked cells are shown even where the cells between are left out.
fn from_grid(
    reader: &mut Reader,
    masks: &mut [MaskReader],
    first: [u32; 2],
    size: [u32; 2],
    step: u32,
) -> Result<Vec<Cell>, ScanError> {
    let grid = reader.header().grid;
    let [width, height] = size.map(|n| n.div_ceil(step) as usize);
    let mut cells = vec![Cell::default(); width * height];
    let place = |along: usize, k: usize| {
        let (column, row) = if grid.by_rows { (k, along) } else { (along, k) };
        row * width + column
    };
    // Lines of the grid, and the cells of each.
    let [line, cell] = if grid.by_rows { [1, 0] } else { [0, 1] };
    let cells_from =
        |number: u32| u64::from(first[line] + number) * u64::from(grid.line_length()) + u64::from(first[cell]);
    let length = size[cell] as usize;
    let mut samples = Vec::new();
    for number in (0..size[line]).step_by(step as usize) {
        reader.read(cells_from(number), length, &mut samples)?;
        for (k, sample) in samples.iter().step_by(step as usize).enumerate() {
            cells[place((number / step) as usize, k)].sample = *sample;
        }
    }
    for (mask, number) in masks.iter_mut().zip(1..=u8::MAX).rev() {
        for line in 0..size[line] {
            mask.cells(cells_from(line), length, &mut |at| {
                cells[place((line / step) as usize, at / step as usize)].mask = number;
            })?;
        }
    }
    Ok(cells)
}

/// How high a sample is in the view, and how far to the right, of an arbitrary origin.
fn view(sample: &Sample, rays: Rays) -> (f32, f32) {
    let p = sample.position;
    match rays {
        // The azimuth grows to the left.
        Rays::Central => (p.z / p.length().max(f32::MIN_POSITIVE), -p.y.atan2(p.x)),
        Rays::Parallel(_) => (p.y, p.x),
    }
}

/// Whether samples in the upper half of the picture are the higher ones, of most columns.
fn rises_to_the_top(cells: &[Cell], width: u32, rays: Rays) -> bool {
    let width = width as usize;
    let mut votes = 0_i64;
    for column in 0..width {
        let mut measured = cells[column..].iter().map(|cell| &cell.sample).step_by(width).filter(|s| s.is_measured());
        if let Some((first, last)) = measured.next().zip(measured.next_back()) {
            votes += if view(first, rays).0 >= view(last, rays).0 { 1 } else { -1 };
        }
    }
    votes >= 0
}

/// Whether samples run from right to left, of most neighbours.
fn is_mirrored(cells: &[Cell], width: u32, rays: Rays) -> bool {
    let mut votes = 0_i64;
    for row in cells.chunks(width as usize) {
        for pair in row.windows(2) {
            if pair.iter().all(|cell| cell.sample.is_measured()) {
                let step = view(&pair[1].sample, rays).1 - view(&pair[0].sample, rays).1;
                // Not where the azimuth jumps by a whole turn.
                if step.abs() < std::f32::consts::PI {
                    votes += if step >= 0.0 { 1 } else { -1 };
                }
            }
        }
    }
    votes < 0
}

/// The nearest sample in every direction, of a part of the equirectangular view that has `size` pixels.
fn from_cloud(
    reader: &mut Reader,
    masks: &mut [MaskReader],
    size: [u32; 2],
    part: Window,
) -> Result<Vec<Cell>, ScanError> {
    const BATCH: u64 = 65_536;
    let total = reader.header().grid.cells();
    let mut cells = vec![Cell::default(); part.width as usize * part.height as usize];
    let (mut batch, mut numbers) = (Vec::new(), Vec::new());
    let mut at = 0;
    while at < total {
        let count = BATCH.min(total - at);
        reader.read(at, count as usize, &mut batch)?;
        numbers.clear();
        numbers.resize(batch.len(), 0);
        for (mask, number) in masks.iter_mut().zip(1..=u8::MAX).rev() {
            mask.cells(at, batch.len(), &mut |k| numbers[k] = number)?;
        }
        at += count;
        for (sample, mask) in batch.iter().zip(&numbers).filter(|(sample, _)| sample.is_measured()) {
            let p = sample.position;
            let range = p.length();
            if range == 0.0 {
                continue;
            }
            let across = 0.5 - p.y.atan2(p.x) / std::f32::consts::TAU;
            let down = 0.5 - (p.z / range).clamp(-1.0, 1.0).asin() / std::f32::consts::PI;
            let column = ((across * size[0] as f32) as u32).min(size[0] - 1).checked_sub(part.left);
            let row = ((down * size[1] as f32) as u32).min(size[1] - 1).checked_sub(part.top);
            let inside = column.zip(row).filter(|(column, row)| *column < part.width && *row < part.height);
            let Some((column, row)) = inside else { continue };
            let cell = &mut cells[row as usize * part.width as usize + column as usize];
            if !cell.sample.is_measured() || range < cell.sample.position.length() {
                cell.sample = *sample;
            }
            if *mask != 0 {
                cell.mask = *mask;
            }
        }
    }
    Ok(cells)
}

fn shown_value(sample: &Sample, show: Show) -> Option<f32> {
    let value = if show == Show::Intensity { sample.intensity } else { sample.position.length() };
    (sample.is_measured() && value.is_finite()).then_some(value)
}

/// The values at 1 % and 99 %, of every n-th cell if there are many: a few million give them as well as all do.
fn percentiles(cells: &[Cell], show: Show) -> [f32; 2] {
    const MANY: usize = 4 << 20;
    let step = cells.len().div_ceil(MANY).max(1);
    let mut values: Vec<f32> = cells.iter().step_by(step).filter_map(|cell| shown_value(&cell.sample, show)).collect();
    values.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| values.get((share * values.len().saturating_sub(1) as f64) as usize).copied().unwrap_or(0.0);
    [at(0.01), at(0.99)]
}

fn pixel(cell: &Cell, show: Show, scale: Option<[f32; 2]>) -> [u8; 3] {
    let Cell { sample, mask } = cell;
    if let Some(number) = mask.checked_sub(1).filter(|_| show == Show::Mask) {
        return mask_color(usize::from(number)).1;
    }
    match (sample.state.kind(), show) {
        (Kind::Empty, _) => EMPTY,
        (Kind::NoReturn, _) => NO_RETURN,
        (Kind::Measured, Show::Colour) => {
            if sample.state.has_color() {
                sample.color
            } else {
                WITHOUT
            }
        }
        (Kind::Measured, _) => match (shown_value(sample, show), scale) {
            (Some(value), Some([low, high])) => {
                let share = if high > low { ((value - low) / (high - low)).clamp(0.0, 1.0) } else { 0.5 };
                match show {
                    Show::Intensity => [(40.0 + share * 215.0) as u8; 3],
                    Show::Mask => [(50.0 + share * 90.0) as u8; 3],
                    _ => range_color(share),
                }
            }
            _ => WITHOUT,
        },
    }
}

/// The colour of a range: 0 is near, 1 is far.
pub fn range_color(share: f32) -> [u8; 3] {
    let at = share * (RAMP.len() - 1) as f32;
    let k = (at as usize).min(RAMP.len() - 2);
    let part = at - k as f32;
    std::array::from_fn(|c| (f32::from(RAMP[k][c]) * (1.0 - part) + f32::from(RAMP[k + 1][c]) * part + 0.5) as u8)
}
