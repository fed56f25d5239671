//! Signed distances of the few solids that the fort is built of: negative inside, metres.
//!
//! A solid stands on its origin, turned about the vertical. Battered (leaning) sides and repeated solids make the
//! values bounds rather than exact distances; they never change faster than about 1.1 per metre, which is what the
//! extraction relies on. Source of the forms: Quilez, "Distance functions" (iquilezles.org).

use glam::DVec3;

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
    at: DVec3,
    turn: [f64; 2],
    tip: [f64; 2],
}

impl Solid {
    /// A solid with its foot at a place.
    pub(super) fn new(form: Form, at: impl Into<DVec3>) -> Self {
        Self { form, repeat: Repeat::Once, at: at.into(), turn: [1.0, 0.0], tip: [1.0, 0.0] }
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

    /// The most that [`Solid::distance`] changes per metre, outside the solid.
    pub(super) fn slope(&self) -> f64 {
        match self.form {
            Form::Block { batter, .. } | Form::Drum { batter, .. } => 1.0 + 1.5 * batter,
            Form::Arch { .. } | Form::Ball { .. } => 1.0,
            Form::Stair { run, rise, .. } => (1.0 + (rise / run) * (rise / run)).sqrt(),
        }
    }

    /// Signed distance, or a bound of it.
    pub(super) fn distance(&self, p: DVec3) -> f64 {
        self.looking(1, p)
    }

    /// The same with stairs that look a step further ahead: a bound nearly twice as far from them.
    pub(super) fn far_distance(&self, p: DVec3) -> f64 {
        self.looking(2, p)
    }

    fn looking(&self, ahead: u32, p: DVec3) -> f64 {
        let d = p - self.at;
        let [c, s] = self.turn;
        let q = DVec3::new(c * d.x + s * d.y, c * d.y - s * d.x, d.z);
        let [c, s] = self.tip;
        let q = DVec3::new(c * q.x + s * q.z, q.y, c * q.z - s * q.x);
        match self.repeat {
            Repeat::Once => self.form.distance(ahead, q),
            Repeat::Row { count, pitch } => {
                let half = f64::from(count - 1) / 2.0;
                let k = ((q.x / pitch + half).round()).clamp(0.0, 2.0 * half) - half;
                self.form.distance(ahead, DVec3::new(q.x - k * pitch, q.y, q.z))
            }
            Repeat::Ring { count, radius } => {
                let sector = std::f64::consts::TAU / f64::from(count);
                let angle = libm::atan2(q.x, q.y);
                let k = (angle / sector).round() * sector;
                let (s, c) = libm::sincos(k);
                self.form.distance(ahead, DVec3::new(c * q.x - s * q.y, s * q.x + c * q.y - radius, q.z))
            }
        }
    }
}

impl Form {
    fn distance(&self, ahead: u32, q: DVec3) -> f64 {
        match *self {
            Self::Block { half, height, batter } => {
                let lean = batter * q.z.clamp(0.0, height);
                boxed(DVec3::new(
                    q.x.abs() - half[0] + lean,
                    q.y.abs() - half[1] + lean,
                    (q.z - height / 2.0).abs() - height / 2.0,
                ))
            }
            Self::Drum { radius, height, batter } => {
                let r = (q.x * q.x + q.y * q.y).sqrt();
                let side = r - radius + batter * q.z.clamp(0.0, height);
                boxed(DVec3::new(side, f64::NEG_INFINITY, (q.z - height / 2.0).abs() - height / 2.0))
            }
            Self::Arch { half_width, half_depth, spring, rise } => {
                let x = q.x.abs();
                let outline = if q.z < spring {
                    x - half_width
                } else {
                    let bow = (half_width * half_width + rise * rise) / (2.0 * half_width);
                    let (u, v) = (x + bow - half_width, q.z - spring);
                    (u * u + v * v).sqrt() - bow
                };
                outline.max(-q.z).max(q.y.abs() - half_depth)
            }
            Self::Stair { steps, run, rise, half_width } => {
                let length = f64::from(steps) * run;
                let step = (q.x / run).floor().clamp(0.0, f64::from(steps) - 1.0);
                let mut profile = q.z - (step + 1.0) * rise;
                // The next riser is nearer than this tread where one stands in front of it.
                for k in (1..=ahead).map(f64::from) {
                    if step + k + 0.5 < f64::from(steps) {
                        profile = profile.min(((step + k) * run - q.x).max(q.z - (step + k + 1.0) * rise));
                    }
                }
                let ends = (-q.x).max(q.x - length).max(q.y.abs() - half_width);
                profile.max(ends).max(-q.z - 0.5)
            }
            Self::Ball { radius } => q.length() - radius,
        }
    }
}

/// Distance to a box from the distances to its three pairs of sides.
fn boxed(d: DVec3) -> f64 {
    d.max(DVec3::ZERO).length() + d.max_element().min(0.0)
}
