//! Signed distances of the few solids that the fort is built of: negative inside, metres.
//!
//! A solid stands on its origin, turned about the vertical. Battered (leaning) sides and repeated solids make the
//! values bounds rather than exact distances; they never change faster than about 1.1 per metre, which is what the
//! extraction relies on. Source of the forms: Quilez, "Distance functions" (iquilezles.org).

use super::Vec3;

/// What a solid is, before it is placed.
#[derive(Debug, Clone, Copy)]
pub(super) enum Form {
    /// A block: half width (x), half depth (y), height; its sides lean in by `batter` per metre of height.
    Block { half: [f64; 2], height: f64, batter: f64 },
    /// An upright cylinder whose side leans in by `batter` per metre of height.
    Drum { radius: f64, height: f64, batter: f64 },
    /// A slab along x whose outline in x and z is a doorway: upright to `spring`, then an arch of `rise` (pointed
    /// where it rises more than `half_width`). `half_depth` is along y.
    Arch { half_width: f64, half_depth: f64, spring: f64, rise: f64 },
    /// Steps that go up along +x, each `run` long and `rise` high, `half_width` to both sides along y.
    Stair { steps: u32, run: f64, rise: f64, half_width: f64 },
    /// A ball round the origin.
    Ball { radius: f64 },
}

/// How a solid is repeated.
#[derive(Debug, Clone, Copy)]
pub(super) enum Repeat {
    /// Once.
    Once,
    /// `count` times along x, `pitch` apart, centred.
    Row { count: u32, pitch: f64 },
    /// `count` times round the origin, with its own origin at `radius` and its y axis outward.
    Ring { count: u32, radius: f64 },
}

/// A placed solid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solid {
    form: Form,
    repeat: Repeat,
    at: Vec3,
    turn: [f64; 2],
    tip: [f64; 2],
}

impl Solid {
    /// A solid with its foot at a place.
    pub(super) fn new(form: Form, at: Vec3) -> Self {
        Self { form, repeat: Repeat::Once, at, turn: [1.0, 0.0], tip: [1.0, 0.0] }
    }

    /// Turned counter-clockwise seen from above, in degrees.
    pub(super) fn turned(mut self, degrees: f64) -> Self {
        let angle = degrees.to_radians();
        self.turn = [libm::cos(angle), libm::sin(angle)];
        self
    }

    /// Tipped about its own y axis after turning, in degrees.
    pub(super) fn tipped(mut self, degrees: f64) -> Self {
        let (s, c) = libm::sincos(degrees.to_radians());
        self.tip = [c, s];
        self
    }

    /// Repeated.
    pub(super) fn repeated(mut self, repeat: Repeat) -> Self {
        self.repeat = repeat;
        self
    }

    /// Signed distance, or a bound of it.
    pub(super) fn distance(&self, p: Vec3) -> f64 {
        let d = [p[0] - self.at[0], p[1] - self.at[1], p[2] - self.at[2]];
        let [c, s] = self.turn;
        let q = [c * d[0] + s * d[1], c * d[1] - s * d[0], d[2]];
        let [c, s] = self.tip;
        let q = [c * q[0] + s * q[2], q[1], c * q[2] - s * q[0]];
        match self.repeat {
            Repeat::Once => self.form.distance(q),
            Repeat::Row { count, pitch } => {
                let half = f64::from(count - 1) / 2.0;
                let k = ((q[0] / pitch + half).round()).clamp(0.0, 2.0 * half) - half;
                self.form.distance([q[0] - k * pitch, q[1], q[2]])
            }
            Repeat::Ring { count, radius } => {
                let sector = std::f64::consts::TAU / f64::from(count);
                let angle = libm::atan2(q[0], q[1]);
                let k = (angle / sector).round() * sector;
                let (s, c) = libm::sincos(k);
                self.form.distance([c * q[0] - s * q[1], s * q[0] + c * q[1] - radius, q[2]])
            }
        }
    }
}

impl Form {
    fn distance(&self, q: Vec3) -> f64 {
        match *self {
            Self::Block { half, height, batter } => {
                let lean = batter * q[2].clamp(0.0, height);
                boxed([
                    q[0].abs() - half[0] + lean,
                    q[1].abs() - half[1] + lean,
                    (q[2] - height / 2.0).abs() - height / 2.0,
                ])
            }
            Self::Drum { radius, height, batter } => {
                let r = (q[0] * q[0] + q[1] * q[1]).sqrt();
                let side = r - radius + batter * q[2].clamp(0.0, height);
                boxed([side, f64::NEG_INFINITY, (q[2] - height / 2.0).abs() - height / 2.0])
            }
            Self::Arch { half_width, half_depth, spring, rise } => {
                let x = q[0].abs();
                let outline = if q[2] < spring {
                    x - half_width
                } else {
                    let bow = (half_width * half_width + rise * rise) / (2.0 * half_width);
                    let (u, v) = (x + bow - half_width, q[2] - spring);
                    (u * u + v * v).sqrt() - bow
                };
                outline.max(-q[2]).max(q[1].abs() - half_depth)
            }
            Self::Stair { steps, run, rise, half_width } => {
                let length = f64::from(steps) * run;
                let step = (q[0] / run).floor().clamp(0.0, f64::from(steps) - 1.0);
                let tread = q[2] - (step + 1.0) * rise;
                // The next riser is nearer than this tread where one stands in front of it.
                let riser = ((step + 1.0) * run - q[0]).max(q[2] - (step + 2.0) * rise);
                let profile = if step + 1.5 < f64::from(steps) { tread.min(riser) } else { tread };
                let ends = (-q[0]).max(q[0] - length).max(q[1].abs() - half_width);
                profile.max(ends).max(-q[2] - 0.5)
            }
            Self::Ball { radius } => (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt() - radius,
        }
    }
}

/// Distance to a box from the distances to its three pairs of sides.
fn boxed(d: Vec3) -> f64 {
    let out = d.map(|x| x.max(0.0));
    (out[0] * out[0] + out[1] * out[1] + out[2] * out[2]).sqrt() + d[0].max(d[1]).max(d[2]).min(0.0)
}
