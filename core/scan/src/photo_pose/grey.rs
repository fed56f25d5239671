//! Grey pictures: halving, blurring, and what remains of a picture when its smooth part is taken away.

/// A picture with one number per pixel, rows from the top.
#[derive(Debug, Clone, PartialEq)]
pub struct Grey {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

/// Blurs whose difference is kept by [`Grey::details`]: standard deviations, pixels.
const FINE: f32 = 0.8;
const COARSE: f32 = 4.0;
/// Details larger than this many times their root mean square are cut off, so that a few strong edges (of shadows) do not outweigh the texture.
const CUT: f32 = 2.5;

impl Grey {
    /// A picture of `size` (width and height, pixels). None if there are not as many values as pixels, or none.
    pub fn new(size: [u32; 2], values: Vec<f32>) -> Option<Self> {
        let [width, height] = size.map(|side| side as usize);
        let fits = !values.is_empty() && width.checked_mul(height) == Some(values.len());
        fits.then_some(Self { width, height, values })
    }

    /// A picture whose pixels are a function of column and row.
    pub fn from_fn(size: [u32; 2], mut value: impl FnMut(u32, u32) -> f32) -> Self {
        let [width, height] = size;
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| value(x, y)).collect();
        Self { width: width as usize, height: height as usize, values }
    }

    /// Width and height, pixels.
    pub fn size(&self) -> [u32; 2] {
        [self.width as u32, self.height as u32]
    }

    /// The pixels, rows from the top.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The value of a pixel.
    ///
    /// # Panics
    /// If it is outside the picture.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        assert!(x < self.width);
        self.values[y * self.width + x]
    }

    /// `count` pixels of a row.
    pub(super) fn row(&self, x: usize, y: usize, count: usize) -> &[f32] {
        let from = y * self.width + x;
        &self.values[from..from + count]
    }

    /// The picture at half the resolution: means of 2 × 2 pixels. A last odd column or row is dropped. None if it has only one.
    pub fn halved(&self) -> Option<Self> {
        let (width, height) = (self.width / 2, self.height / 2);
        if width == 0 || height == 0 {
            return None;
        }
        let mean = |x: usize, y: usize| {
            let at = 2 * y * self.width + 2 * x;
            let below = at + self.width;
            0.25 * (self.values[at] + self.values[at + 1] + self.values[below] + self.values[below + 1])
        };
        let values = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| mean(x, y)).collect();
        Some(Self { width, height, values })
    }

    /// Each pixel replaced by a function of it.
    #[must_use]
    pub fn map(&self, f: impl Fn(f32) -> f32) -> Self {
        Self { values: self.values.iter().map(|v| f(*v)).collect(), ..*self }
    }

    /// Blurred with a Gaussian of this standard deviation, pixels, cut off at three of them. Beyond the border, the border is repeated.
    #[must_use]
    pub fn blurred(&self, sigma: f32) -> Self {
        let reach = (3.0 * sigma).ceil() as usize;
        let weight = |k: usize| libm::expf(-0.5 * (k as f32 / sigma) * (k as f32 / sigma));
        let sum: f32 = weight(0) + 2.0 * (1..=reach).map(weight).sum::<f32>();
        let kernel: Vec<f32> = (0..=reach).map(|k| weight(k) / sum).collect();
        let across = self.convolved_across(&kernel);
        // Down: whole rows at a time.
        let mut values = vec![0.0_f32; self.values.len()];
        for (y, out) in values.chunks_exact_mut(self.width).enumerate() {
            let mut add = |row: usize, factor: f32| {
                let source = &across[row * self.width..(row + 1) * self.width];
                out.iter_mut().zip(source).for_each(|(out, v)| *out += factor * v);
            };
            add(y, kernel[0]);
            for (k, factor) in kernel.iter().enumerate().skip(1) {
                add(y.saturating_sub(k), *factor);
                add((y + k).min(self.height - 1), *factor);
            }
        }
        Self { values, ..*self }
    }

    fn convolved_across(&self, kernel: &[f32]) -> Vec<f32> {
        let reach = kernel.len() - 1;
        let mut padded = vec![0.0_f32; self.width + 2 * reach];
        let mut out = Vec::with_capacity(self.values.len());
        for row in self.values.chunks_exact(self.width) {
            padded[..reach].fill(row[0]);
            padded[reach..reach + self.width].copy_from_slice(row);
            padded[reach + self.width..].fill(row[self.width - 1]);
            let from = out.len();
            out.resize(from + self.width, 0.0);
            let target = &mut out[from..];
            for (k, factor) in kernel.iter().enumerate() {
                let (left, right) = (&padded[reach - k..], &padded[reach + k..]);
                let both = if k == 0 { 0.5 * factor } else { *factor };
                target.iter_mut().zip(left.iter().zip(right)).for_each(|(out, (a, b))| *out += both * (a + b));
            }
        }
        out
    }

    /// The difference of two blurs, with extremes cut off. `known`: 1 where the picture has values, 0 elsewhere (values there do not count, and details are 0); None: everywhere.
    #[must_use]
    pub fn details(&self, known: Option<&Self>) -> Self {
        let blur = |sigma: f32| match known {
            None => self.blurred(sigma),
            Some(known) => {
                let product = self.values.iter().zip(&known.values).map(|(v, k)| if *k > 0.0 { v * k } else { 0.0 });
                let sum = Self { values: product.collect(), ..*self }.blurred(sigma);
                let weight = known.blurred(sigma);
                let ratio = sum.values.iter().zip(&weight.values).map(|(s, w)| if *w > 1e-4 { s / w } else { 0.0 });
                Self { values: ratio.collect(), ..*self }
            }
        };
        let (fine, coarse) = (blur(FINE), blur(COARSE));
        let is_known = |k: usize| known.is_none_or(|known| known.values[k] > 0.0);
        let difference = |k: usize| if is_known(k) { fine.values[k] - coarse.values[k] } else { 0.0 };
        let mut values: Vec<f32> = (0..self.values.len()).map(difference).collect();
        let count = (0..values.len()).filter(|k| is_known(*k)).count().max(1);
        let square: f64 = values.iter().map(|v| f64::from(*v) * f64::from(*v)).sum();
        let cut = CUT * (square / count as f64).sqrt() as f32;
        for value in &mut values {
            *value = value.clamp(-cut, cut);
        }
        Self { values, ..*self }
    }
}
