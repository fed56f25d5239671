//! The sample that somebody points at in the picture of a station.
//!
//! Only the cells around the place are kept in memory. Of a grid only their blocks are read; of a point cloud all points, because they are in no order.

use super::{Cell, Frame, Window, cells_of, full_size};
use crate::ScanError;
use crate::spool::Reader;
use glam::Vec3;

/// Largest width of the area that is searched, cells.
pub const WIDTH_MAX: u32 = 64;
/// How far away a cell may be to count as a neighbour, cells.
const NEIGHBOURS: u32 = 4;

/// A sample, and how densely its surroundings were sampled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// Its column and row in the picture, in pixels of [`Frame::size`].
    pub cell: [u32; 2],
    /// Its position in the coordinates of the station, metres.
    pub position: Vec3,
    /// The distance between samples of adjacent cells here, along the rows or the columns, whichever is larger; metres. `None` if there are no samples around.
    pub spacing: Option<f32>,
}

/// The sample of a cell of the picture, or the nearest one at most half of `width` cells away: the reader sees these cells as one pixel. In the picture of a point
/// cloud, the nearest point in each pixel. `None` if nothing was measured there, or if masks that are applied hide it.
///
/// `cell` is in pixels of [`Frame::size`]; `frame` is that of the station's picture ([`super::render`]); `width` is 1 to [`WIDTH_MAX`], other values are limited to that.
///
/// # Errors
/// [`ScanError::Spool`], [`ScanError::Mask`] for damaged files; [`ScanError::Request`] for a cell that is not in the picture.
pub fn pick(reader: &mut Reader, frame: &Frame, cell: [u32; 2], width: u32) -> Result<Option<Picked>, ScanError> {
    let is_inside = cell.iter().zip(frame.size).all(|(at, size)| *at < size);
    if !is_inside || frame.size != full_size(reader) {
        return Err(ScanError::Request("the picture of the station has no such cell".to_owned()));
    }
    let reach = width.clamp(1, WIDTH_MAX) / 2;
    let around = |at: u32, size: u32| {
        let start = at.saturating_sub(reach + NEIGHBOURS);
        (start, at.saturating_add(reach + NEIGHBOURS + 1).min(size) - start)
    };
    let ((left, width), (top, height)) = (around(cell[0], frame.size[0]), around(cell[1], frame.size[1]));
    let part = Window { left, top, width, height };
    let cells = Cells { cells: cells_of(reader, &mut [], frame, part)?, part };
    let Some((cell, position)) = cells.nearest(cell, reach) else { return Ok(None) };
    Ok(Some(Picked { cell, position, spacing: cells.spacing(cell, position) }))
}

/// The cells of a part of the picture.
struct Cells {
    cells: Vec<Cell>,
    part: Window,
}

impl Cells {
    /// The measured position in a cell of the picture; `None` also outside the part.
    fn at(&self, column: i64, row: i64) -> Option<Vec3> {
        let Window { left, top, width, height } = self.part;
        let column = u32::try_from(column - i64::from(left)).ok().filter(|column| *column < width)?;
        let row = u32::try_from(row - i64::from(top)).ok().filter(|row| *row < height)?;
        let sample = &self.cells.get(row as usize * width as usize + column as usize)?.sample;
        sample.is_measured().then_some(sample.position)
    }

    /// The nearest measured cell, at most `reach` columns and rows away. Of several, the first by rows.
    fn nearest(&self, [column, row]: [u32; 2], reach: u32) -> Option<([u32; 2], Vec3)> {
        let range = |at: u32| at.saturating_sub(reach)..=at.saturating_add(reach);
        let cells = range(row).flat_map(|y| range(column).map(move |x| [x, y]));
        let measured = cells.filter_map(|[x, y]| Some(([x, y], self.at(x.into(), y.into())?)));
        measured.min_by_key(|([x, y], _)| {
            let [x, y] = [x.abs_diff(column), y.abs_diff(row)];
            x * x + y * y
        })
    }

    /// See [`Picked::spacing`].
    fn spacing(&self, cell: [u32; 2], position: Vec3) -> Option<f32> {
        let [column, row] = cell.map(i64::from);
        let gap = |[x, y]: [i64; 2]| {
            (1..=i64::from(NEIGHBOURS)).find_map(|k| {
                let other = self.at(column + k * x, row + k * y)?;
                Some(position.distance(other) / k as f32)
            })
        };
        // The neighbour on one side may lie on another surface, far behind this one.
        let along = |step: [i64; 2]| [gap(step), gap(step.map(|n| -n))].into_iter().flatten().min_by(f32::total_cmp);
        [along([1, 0]), along([0, 1])].into_iter().flatten().max_by(f32::total_cmp)
    }
}
