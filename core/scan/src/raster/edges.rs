//! The distance of each pixel from the nearest depth discontinuity.

use super::{Raster, Value};

/// For each pixel of a raster, the distance in pixels to the nearest occlusion boundary or border of the surface, up to a limit.
#[derive(Debug, Clone)]
pub struct Edges {
    width: usize,
    /// Distances in thirds of a pixel (chamfer 3-4: Borgefors 1986, Distance transformations in digital images).
    thirds: Vec<u8>,
}

/// A step of one pixel along an axis, and along a diagonal, in thirds of a pixel.
const STRAIGHT: u8 = 3;
const DIAGONAL: u8 = 4;

impl Edges {
    /// The largest distance that can be stored, in pixels.
    pub const FARTHEST: f32 = 85.0;

    /// Find the edges: where neighbouring pixels differ in depth by more than the fraction `jump` of the depth, and by more than the slope of the surface on both sides explains.
    pub fn of<V: Value>(raster: &Raster<V>, jump: f32) -> Self {
        let [width, height] = raster.window().size;
        let mut thirds = vec![u8::MAX; width as usize * height as usize];
        let mut mark = |x: u32, y: u32| thirds[(y * width + x) as usize] = 0;
        for y in 0..height {
            for x in 0..width {
                if x + 1 < width && is_jump(raster, [x, y], [1, 0], jump) {
                    mark(x, y);
                    mark(x + 1, y);
                }
                if y + 1 < height && is_jump(raster, [x, y], [0, 1], jump) {
                    mark(x, y);
                    mark(x, y + 1);
                }
            }
        }
        let mut edges = Self { width: width as usize, thirds };
        edges.spread();
        edges
    }

    /// The chamfer transform: one pass down, one pass up.
    fn spread(&mut self) {
        let width = self.width;
        let height = self.thirds.len() / width.max(1);
        for y in 0..height {
            for x in 0..width {
                let at = y * width + x;
                let mut min = self.thirds[at];
                if x > 0 {
                    min = min.min(self.thirds[at - 1].saturating_add(STRAIGHT));
                }
                if y > 0 {
                    min = min.min(self.thirds[at - width].saturating_add(STRAIGHT));
                    if x > 0 {
                        min = min.min(self.thirds[at - width - 1].saturating_add(DIAGONAL));
                    }
                    if x + 1 < width {
                        min = min.min(self.thirds[at - width + 1].saturating_add(DIAGONAL));
                    }
                }
                self.thirds[at] = min;
            }
        }
        for y in (0..height).rev() {
            for x in (0..width).rev() {
                let at = y * width + x;
                let mut min = self.thirds[at];
                if x + 1 < width {
                    min = min.min(self.thirds[at + 1].saturating_add(STRAIGHT));
                }
                if y + 1 < height {
                    min = min.min(self.thirds[at + width].saturating_add(STRAIGHT));
                    if x > 0 {
                        min = min.min(self.thirds[at + width - 1].saturating_add(DIAGONAL));
                    }
                    if x + 1 < width {
                        min = min.min(self.thirds[at + width + 1].saturating_add(DIAGONAL));
                    }
                }
                self.thirds[at] = min;
            }
        }
    }

    /// Pixels to the nearest edge; at most [`Self::FARTHEST`]. 0 outside the picture.
    pub fn distance(&self, x: u32, y: u32) -> f32 {
        let at = y as usize * self.width + x as usize;
        let inside = (x as usize) < self.width;
        self.thirds.get(at).filter(|_| inside).map_or(0.0, |thirds| f32::from(*thirds) / f32::from(STRAIGHT))
    }
}

/// Whether the depth jumps between a pixel and the next one in a direction. Reciprocals of depths are compared, because they are linear across a plane: the
/// jump must exceed what the differences on either side lead one to expect.
fn is_jump<V: Value>(raster: &Raster<V>, [x, y]: [u32; 2], [dx, dy]: [u32; 2], jump: f32) -> bool {
    let at = |x: Option<u32>, y: Option<u32>| {
        let (x, y) = (x?, y?);
        let [width, height] = raster.window().size;
        (x < width && y < height).then(|| 1.0 / raster.depth(x, y))
    };
    let here = 1.0 / raster.depth(x, y);
    let next = 1.0 / raster.depth(x + dx, y + dy);
    if (here > 0.0) != (next > 0.0) {
        return true;
    }
    let difference = (here - next).abs();
    if difference <= jump * here.max(next) {
        return false;
    }
    let before = at(x.checked_sub(dx), y.checked_sub(dy)).map_or(0.0, |before| (here - before).abs());
    let after = at(x.checked_add(2 * dx), y.checked_add(2 * dy)).map_or(0.0, |after| (next - after).abs());
    difference > 3.0 * before.min(after) + jump * here.max(next)
}
