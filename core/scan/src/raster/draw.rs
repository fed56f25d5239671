//! A depth buffer, and values of the nearest surface.

use super::Window;
use glam::{DVec2, DVec3, Vec3};

/// Distance of the near clipping plane, in metres.
const NEAR: f32 = 1e-3;

/// Barycentric weights down to this are inside, so that rounding opens no gap between neighbouring triangles.
const MIN_BARYCENTRIC: f64 = -1e-9;

/// What is interpolated across a triangle.
pub trait Value: Copy + Default {
    /// The mean of the values of three corners with weights whose sum is 1.
    fn mix(values: [Self; 3], weights: [f32; 3]) -> Self;
}

impl Value for () {
    fn mix(_: [Self; 3], _: [f32; 3]) -> Self {}
}

impl<const N: usize> Value for [f32; N]
where
    Self: Default,
{
    fn mix([a, b, c]: [Self; 3], [u, v, w]: [f32; 3]) -> Self {
        std::array::from_fn(|k| u * a[k] + v * b[k] + w * c[k])
    }
}

/// What a window sees: for each pixel the depth of the nearest surface and its value, rows from the top.
#[derive(Debug, Clone)]
pub struct Raster<V = ()> {
    window: Window,
    /// Reciprocals of depths along the axis; 0 where nothing is seen.
    inverse_depth: Vec<f32>,
    values: Vec<V>,
}

impl<V: Value> Raster<V> {
    /// An empty picture.
    pub fn new(window: Window) -> Self {
        let count = window.size.map(|side| side as usize).iter().product();
        // Values without a size need no memory.
        Self { window, inverse_depth: vec![0.0; count], values: vec![V::default(); count] }
    }

    /// The view.
    pub fn window(&self) -> &Window {
        &self.window
    }

    /// Draw a triangle, seen from either side. Corners are in the axes of the window.
    pub fn draw(&mut self, corners: [Vec3; 3], values: [V; 3]) {
        let depths = corners.map(|corner| corner.z);
        if depths.iter().all(|z| *z > NEAR) {
            self.fill(corners.map(Vec3::as_dvec3), values);
            return;
        }
        if !depths.iter().any(|z| *z > NEAR) || depths.iter().any(|z| !z.is_finite()) {
            return;
        }
        // Clip against the near plane; three or four corners remain.
        let corners = corners.map(Vec3::as_dvec3);
        let near = f64::from(NEAR);
        let (mut rest, mut count) = ([(DVec3::ZERO, V::default()); 4], 0);
        for k in 0..3 {
            let (a, b) = (k, (k + 1) % 3);
            if depths[a] > NEAR {
                rest[count] = (corners[a], values[a]);
                count += 1;
            }
            if (depths[a] > NEAR) != (depths[b] > NEAR) {
                let t = (near - corners[a].z) / (corners[b].z - corners[a].z);
                let value = V::mix([values[a], values[b], values[b]], [1.0 - t as f32, t as f32, 0.0]);
                rest[count] = (corners[a].lerp(corners[b], t).with_z(near), value);
                count += 1;
            }
        }
        for k in 2..count {
            self.fill([rest[0].0, rest[k - 1].0, rest[k].0], [rest[0].1, rest[k - 1].1, rest[k].1]);
        }
    }

    /// Draw a triangle that lies in front of the near plane.
    fn fill(&mut self, corners: [DVec3; 3], values: [V; 3]) {
        let inverse = corners.map(|corner| 1.0 / corner.z);
        let Window { focal, center, .. } = self.window;
        let [mut a, mut b, mut c] = [0, 1, 2].map(|k| center + corners[k].truncate() * (focal * inverse[k]));
        let size = DVec2::new(self.window.size[0].into(), self.window.size[1].into());
        let low = a.min(b).min(c).max(DVec2::ZERO);
        let high = a.max(b).max(c).min(size);
        if !(low.cmplt(high).all()) {
            return;
        }
        // A pixel is filled if its centre lies in the triangle.
        let first = (low - 0.5).ceil().max(DVec2::ZERO);
        let last = (high - 0.5).floor().min(size - 1.0);
        if first.x > last.x || first.y > last.y {
            return;
        }
        let (columns, rows) = (first.x as usize..=last.x as usize, first.y as usize..=last.y as usize);
        let origin = first + 0.5;
        (a, b, c) = (a - origin, b - origin, c - origin);
        let area = (b - a).perp_dot(c - a);
        if area == 0.0 || !area.is_finite() {
            return;
        }
        let per_area = 1.0 / area;
        // Barycentric weights along a row: their start and their step.
        let steps = [b.y - c.y, c.y - a.y, a.y - b.y].map(|dy| dy * per_area);
        let width = self.window.size[0] as usize;
        for (j, row) in rows.enumerate() {
            let here = DVec2::new(0.0, j as f64);
            let weight = |p: DVec2, q: DVec2| (p - here).perp_dot(q - here) * per_area;
            let start = [weight(b, c), weight(c, a), weight(a, b)];
            for (i, column) in columns.clone().enumerate() {
                let x = i as f64;
                let w: [f64; 3] = std::array::from_fn(|k| start[k] + steps[k] * x);
                if w[0] < MIN_BARYCENTRIC || w[1] < MIN_BARYCENTRIC || w[2] < MIN_BARYCENTRIC {
                    continue;
                }
                let scaled: [f64; 3] = std::array::from_fn(|k| w[k] * inverse[k]);
                let sum = scaled[0] + scaled[1] + scaled[2];
                let at = row * width + column;
                if sum as f32 > self.inverse_depth[at] {
                    self.inverse_depth[at] = sum as f32;
                    self.values[at] = V::mix(values, scaled.map(|share| (share / sum) as f32));
                }
            }
        }
    }

    /// The depth along the axis at a pixel; infinite where nothing is seen, and outside the picture.
    pub fn depth(&self, x: u32, y: u32) -> f32 {
        1.0 / self.inverse_depth(x, y)
    }

    fn inverse_depth(&self, x: u32, y: u32) -> f32 {
        let [width, height] = self.window.size;
        if x < width && y < height { self.inverse_depth[y as usize * width as usize + x as usize] } else { 0.0 }
    }

    /// The value at a pixel, if a surface is seen there.
    pub fn value(&self, x: u32, y: u32) -> Option<V> {
        let at = y as usize * self.window.size[0] as usize + x as usize;
        (self.inverse_depth(x, y) > 0.0).then(|| self.values[at])
    }

    /// The largest depth of the four pixels around a place: a surface that is farther by more than a tolerance is hidden in all of them.
    pub fn farthest_around(&self, pixel: DVec2) -> f32 {
        let [width, height] = self.window.size;
        let corner = (pixel - 0.5).floor();
        let x = [corner.x, corner.x + 1.0].map(|x| x.clamp(0.0, f64::from(width - 1)) as u32);
        let y = [corner.y, corner.y + 1.0].map(|y| y.clamp(0.0, f64::from(height - 1)) as u32);
        let smallest = [(0, 0), (1, 0), (0, 1), (1, 1)]
            .iter()
            .map(|(i, j)| self.inverse_depth(x[*i], y[*j]))
            .fold(f32::INFINITY, f32::min);
        1.0 / smallest
    }
}
