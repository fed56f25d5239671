//! Where a plan is in the world: what a GeoTIFF (OGC 19-008r4) and a world file say.

use super::{Sheet, View};

/// Where a plan is in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct GeoReference {
    /// A pixel's side, metres.
    pub metres_per_pixel: f64,
    /// World coordinates of the upper left corner.
    pub corner: [f64; 2],
    /// EPSG code of a projected system, where known.
    pub epsg: Option<u16>,
}

impl GeoReference {
    /// Of a plan, whose model has this reference system (`EPSG:32737`); `None` for elevations, which have local axes.
    pub fn of(sheet: &Sheet, crs: Option<&str>) -> Option<Self> {
        (sheet.view == View::Plan).then(|| Self {
            metres_per_pixel: sheet.metres_per_pixel(),
            corner: sheet.corner(),
            epsg: crs.and_then(|c| c.strip_prefix("EPSG:")).and_then(|c| c.parse().ok()),
        })
    }

    /// World coordinates of the middle of the first pixel.
    pub fn first_pixel(&self) -> [f64; 2] {
        [self.corner[0] + self.metres_per_pixel * 0.5, self.corner[1] - self.metres_per_pixel * 0.5]
    }

    /// The world file beside a picture: size of a pixel, and the middle of the first one.
    pub fn world_file(&self) -> String {
        let [x, y] = self.first_pixel();
        format!("{:?}\n0.0\n0.0\n{:?}\n{x:?}\n{y:?}\n", self.metres_per_pixel, -self.metres_per_pixel)
    }

    /// The GeoKeyDirectory: version 1.1.1, raster pixels are areas; the model type is projected where the system is known.
    pub(super) fn keys(&self) -> Vec<u16> {
        let mut keys = vec![[1024, 0, 1, if self.epsg.is_some() { 1 } else { 32767 }], [1025, 0, 1, 1]];
        keys.extend(self.epsg.map(|code| [3072, 0, 1, code]));
        let mut all = vec![1, 1, 1, keys.len() as u16];
        all.extend(keys.iter().flatten());
        all
    }
}
