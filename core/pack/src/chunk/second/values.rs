//! Positions and colours, vertex by vertex: predicted from vertices that are known, the residuals coded. FORMAT sections
//! 5.16 and 5.17.

use super::super::attributes::{Tint, round_to, tinted, wrap};
use super::super::border::Link;
use super::super::predict::{Coefficients, Weights};
use super::fit::Seen;
use super::lanes::Lanes;
use super::model::Adaptive;
use super::rans::{Coder, Part};
use super::tables::{Line, NEARBY, Scale, TABLES};

/// Largest residual that is remembered.
const LARGEST: u32 = 1 << 20;

/// What is known of a vertex. Four lanes each, so that a processor's vectors fit.
#[derive(Clone, Copy)]
struct Known {
    position: Lanes,
    /// Sizes of its residuals; the last is the grain of the position.
    sizes: Lanes,
    color: Lanes,
}

/// How coarse values are: the number of zero bits at the end that all coordinates of a vertex have, at least.
pub(super) struct Grains {
    models: Option<Vec<Adaptive<16>>>,
}

impl Grains {
    /// Whether there are any grains above 0.
    pub(super) fn new(any: bool) -> Self {
        Self { models: any.then(|| vec![Adaptive::unknown(16); 16]) }
    }

    /// The grain of a vertex; `near` is one that it may resemble.
    #[inline]
    pub(super) fn code<C: Coder>(&mut self, coder: &mut C, near: u8, grain: u8) -> u8 {
        let Some(models) = &mut self.models else { return 0 };
        let Some(model) = models.get_mut(usize::from(near)) else { return 0 };
        #[expect(clippy::cast_possible_truncation, reason = "below 16")]
        let grain = (model.code(coder, 0, grain.into()) & 15) as u8;
        grain
    }
}

/// Grains that an encoder wants: of positions, of colours.
pub(super) type Wanted<'a> = [Option<&'a [u8]>; 2];

/// All that is fitted to a chunk.
#[derive(Clone, Copy, Default)]
pub(super) struct Fitted {
    pub(super) positions: Weights,
    pub(super) colors: Weights,
    pub(super) tint: Tint,
    /// For one parallelogram and for two.
    lines: [Line; 2],
    /// Tables of green, red and blue: for grain 0 and above, for one parallelogram and for two.
    color_tables: [[[u8; 3]; 2]; 2],
}

impl Fitted {
    /// As it is stored.
    pub(super) fn code<C: Coder>(self, coder: &mut C, has_colors: bool, any_color_grain: bool) -> Self {
        let mut raw = |bits, value| coder.raw32(bits, value);
        let mut fitted = self;
        fitted.positions = self.positions.code(&mut raw);
        if has_colors {
            fitted.colors = self.colors.code(&mut raw);
            fitted.tint = self.tint.code(&mut raw);
        }
        fitted.lines = self.lines.map(|line| line.code(coder));
        if has_colors {
            let tables = fitted.color_tables.as_flattened_mut().as_flattened_mut();
            // Without grains there is none above 0.
            let count = if any_color_grain { tables.len() } else { tables.len() / 2 };
            for table in tables.iter_mut().take(count) {
                *table = (coder.raw32(5, (*table).into()) & 31) as u8;
            }
        }
        fitted
    }
}

/// Residuals that a dry run has met.
#[derive(Default)]
pub(super) struct SeenValues {
    positions: [Seen; 2],
    colors: [[[Seen; 3]; 2]; 2],
}

impl SeenValues {
    pub(super) fn fit(&mut self, fitted: &mut Fitted) {
        for (line, seen) in fitted.lines.iter_mut().zip(&mut self.positions) {
            *line = seen.best();
        }
        let tables = fitted.color_tables.as_flattened_mut().as_flattened_mut();
        for (table, seen) in tables.iter_mut().zip(self.colors.as_flattened_mut().as_flattened_mut()) {
            *table = seen.best_color();
        }
    }
}

/// Positions and colours; the encoder's are in the arrays, the decoder's are put there. Returns the grains of the positions.
pub(super) struct Values<'a> {
    pub(super) links: &'a [Link],
    pub(super) positions: &'a mut [[i32; 3]],
    /// Empty where there are none.
    pub(super) colors: &'a mut [[u8; 3]],
    pub(super) wanted: Wanted<'a>,
    /// Whether there are grains.
    pub(super) any: [bool; 2],
    pub(super) fitted: Fitted,
}

#[expect(clippy::inline_always, reason = "in the inner loop")]
#[inline(always)]
fn zip<A: Copy, B: Copy, T>([a, b, c]: [A; 3], [d, e, f]: [B; 3], with: impl Fn(A, B) -> T) -> [T; 3] {
    [with(a, d), with(b, e), with(c, f)]
}

/// What the vertices of a link give.
struct Around {
    position: [i32; 3],
    color: [i32; 3],
    /// Sizes nearby.
    nearby: Lanes,
    grain: u8,
}

/// An affine combination of seven values: the first, and sums of differences from it.
#[expect(clippy::inline_always, reason = "in the inner loop")]
#[inline(always)]
fn affine(k: [i32; 3], [a, b, d, e, c, f, s]: [Lanes; 7]) -> Lanes {
    let edges = b.plus(d).plus(e).minus(a.plus(a).plus(a));
    let across = c.plus(f).minus(a.plus(a));
    let sum = edges.times(k[0]).plus(across.times(k[1])).plus(s.minus(a).times(k[2]));
    a.plus(sum.plus(Lanes::new([128; 4])).down(8))
}

#[inline(always)]
fn around(known: &[Known], link: &Link, of: &Coefficients, of_colors: Option<&Coefficients>) -> Around {
    static NOTHING: Known =
        Known { position: Lanes::new([0; 4]), sizes: Lanes::new([0; 4]), color: Lanes::new([0; 4]) };
    let at = |v: u32| known.get(v as usize).unwrap_or(&NOTHING);
    let [a, b, d, e] = [link.edge[0], link.edge[1], link.edge2[0], link.edge2[1]].map(at);
    let [c, f, s] = [link.across, link.across2, link.shared].map(at);
    let all = [a, b, d, e, c, f, s];
    let [x, y, z, _] = affine(of.of(link.kind), all.map(|v| v.position)).array();
    let ends = a.sizes.plus(b.sizes);
    let sizes = ends.plus(ends).plus(ends).plus(c.sizes).plus(f.sizes).down(2);
    // Along the straight rim of a scan an axis has no residuals at all; the surface beside it has.
    let [p, q, r, _] = sizes.array();
    let nearby = sizes.at_least((p + q + r) >> 4);
    let mut color = [0; 3];
    if let Some(of) = of_colors {
        let [r, g, b, _] = affine(of.of(link.kind), all.map(|v| v.color)).clamped(0, 255).array();
        color = [r, g, b];
    }
    let [.., grain] = a.sizes.array();
    Around { position: [x, y, z], color, nearby, grain: (grain & 0xff) as u8 }
}

impl Values<'_> {
    /// Code them all. In a dry run nothing is coded, and what would be is seen.
    pub(super) fn code<C: Coder>(&mut self, coder: C, seen: &mut SeenValues) -> (C, Vec<u8>) {
        if self.colors.is_empty() { self.with::<C, false>(coder, seen) } else { self.with::<C, true>(coder, seen) }
    }

    /// The coder is a variable of this function, so that its states stay in registers; and a function of its own, because
    /// compilers in browsers do worse with large ones.
    #[inline(never)]
    fn with<C: Coder, const COLORS: bool>(&mut self, coder: C, seen: &mut SeenValues) -> (C, Vec<u8>) {
        let mut to = coder;
        let coder = &mut to;
        let [mut grains, mut color_grains] = self.any.map(Grains::new);
        let scales: [[Scale; NEARBY]; 2] = self.fitted.lines.map(Line::scales);
        let color_scales = self.fitted.color_tables.map(|of| of.map(|of| of.map(Scale::of_color)));
        let (of, of_colors) = (self.fitted.positions.coefficients(), self.fitted.colors.coefficients());
        let tables = &*TABLES;
        let mut known: Vec<Known> = Vec::with_capacity(self.links.len());
        let positions = &mut *self.positions;
        let mut colors = self.colors.iter_mut();
        for (v, (link, position)) in self.links.iter().zip(positions).enumerate() {
            let two = usize::from(link.is_two());
            let Around { position: predicted, color, nearby, grain: near } =
                around(&known, link, &of, COLORS.then_some(&of_colors));
            let want = |wanted: Option<&[u8]>| wanted.and_then(|w| w.get(v)).copied().unwrap_or(0);
            let grain = grains.code(coder, near, want(self.wanted[0]));
            let nearby = nearby.down(grain.into()).quarter_octaves();
            let [ones, twos] = &scales;
            let scales = if two == 1 { twos } else { ones };
            let scales = nearby.map(|t| scales.get(t).copied().unwrap_or_default());
            let p = predicted.map(|x| round_to(x, grain));
            let wanted = zip(*position, p, |x, p| (x >> grain).wrapping_sub(p));
            if C::DRY
                && let Some(seen) = seen.positions.get_mut(two)
            {
                wanted.into_iter().zip(nearby).for_each(|(r, t)| seen.add(t, r));
            }
            let r = tables.three(coder, scales, wanted);
            let value = zip(p, r, |p, r| p.wrapping_add(r) << grain);
            let [p, q, r] = r.map(|r| (r.unsigned_abs().min(LARGEST >> grain) << grain).cast_signed());
            let sizes = Lanes::new([p, q, r, grain.into()]);
            *position = value;
            let [x, y, z] = value;
            let mut new = Known { position: Lanes::new([x, y, z, 0]), sizes, color: Lanes::new([0; 4]) };
            if COLORS && let Some(slot) = colors.next() {
                coder.part(Part::Colors);
                let grain = color_grains.code(coder, grain, want(self.wanted[1])).min(7);
                let [fine, coarse] = &color_scales;
                let [ones, twos] = if grain > 0 { coarse } else { fine };
                let scales = if two == 1 { *twos } else { *ones };
                let wanted = slot.map(i32::from);
                let (value, r) = self.fitted.color(coder, scales, (color, wanted), grain);
                if C::DRY {
                    let [fine, coarse] = &mut seen.colors;
                    if let Some(seen) = (if grain > 0 { coarse } else { fine }).get_mut(two) {
                        seen.iter_mut().zip(r).for_each(|(seen, r)| seen.add(0, r));
                    }
                }
                *slot = value.map(|x| (x & 0xff) as u8);
                let [r, g, b] = value;
                new.color = Lanes::new([r, g, b, 0]);
                coder.part(Part::Positions);
            }
            known.push(new);
        }
        let grains = known.iter().map(|known| (known.sizes.array()[3] & 0xff) as u8).collect();
        (to, grains)
    }
}

impl Fitted {
    /// A colour, predicted as the first of the pair, wanted by an encoder as the second: red, green, blue. Returns it, and the
    /// residuals of green, red and blue.
    #[expect(clippy::inline_always, reason = "in the inner loop")]
    #[inline(always)]
    fn color<C: Coder>(
        &self,
        coder: &mut C,
        scales: [Scale; 3],
        ([pr, pg, pb], [red, green, blue]): ([i32; 3], [i32; 3]),
        grain: u8,
    ) -> ([i32; 3], [i32; 3]) {
        let Tint { red_of_green, blue_of_green, blue_of_red } = self.tint;
        let of_red = |green: i32| round_to(tinted(pr, red_of_green * (green - pg)), grain);
        let of_blue =
            |green: i32, red: i32| round_to(tinted(pb, blue_of_green * (green - pg) + blue_of_red * (red - pr)), grain);
        let of_green = round_to(pg, grain);
        let residual = |x: i32, p: i32| wrap((x >> grain).wrapping_sub(p), grain);
        let wanted = [residual(green, of_green), residual(red, of_red(green)), residual(blue, of_blue(green, red))];
        let r = TABLES.three(coder, scales, if C::ENCODES { wanted } else { [0; 3] });
        let value = |p: i32, r: i32| p.wrapping_add(r) << grain & 0xff;
        let green = value(of_green, r[0]);
        let red = value(of_red(green), r[1]);
        let blue = value(of_blue(green, red), r[2]);
        ([red, green, blue], r)
    }
}
