//! The fort's plan: what stands where. Pure geometry, the same for every seed.
//!
//! Frame: metres, origin in the court, x east, y north, z up from the court's floor; the sea lies to the south and the
//! gate faces it, as at the Gereza of Kilwa Kisiwani. Walls in the Swahili manner: coral rag in lime, a round tower
//! and a square one at opposite corners, rooms with niches along the court, stone benches beside the gate.

use super::solid::{Form, Repeat, Solid};

/// Half width (x) of the curtain, outside.
pub(crate) const HALF_X: f64 = 13.0;
/// Half depth (y) of the curtain, outside.
pub(crate) const HALF_Y: f64 = 11.5;
/// Thickness of the curtain at its foot.
const THICK: f64 = 1.25;
/// Height of the wall-walk.
pub(super) const WALK: f64 = 4.9;
/// Height of the parapet without merlons.
pub(super) const PARAPET: f64 = 5.8;
/// Centre of the round tower.
pub(crate) const DRUM: [f64; 2] = [12.4, -10.8];
/// Centre of the square tower.
pub(crate) const KEEP: [f64; 2] = [-12.2, 10.6];
/// Where the gate stands on the south curtain.
pub(crate) const GATE_X: f64 = -2.0;
/// Centre of the well.
pub(super) const WELL: [f64; 2] = [3.4, 1.2];

/// The parts of the fort.
pub(super) struct Plan {
    /// Masonry that weathers and falls.
    pub(super) walls: Vec<Solid>,
    /// What is taken out of the walls.
    pub(super) openings: Vec<Solid>,
    /// Masonry that stands in openings or lies about; not cut by them.
    pub(super) fittings: Vec<Solid>,
    /// What is taken out of everything, the ground too.
    pub(super) shafts: Vec<Solid>,
}

fn block(x: f64, y: f64, z: f64, half: [f64; 2], height: f64) -> Solid {
    Solid::new(Form::Block { half, height, batter: 0.0 }, [x, y, z])
}

fn arch(x: f64, y: f64, z: f64, half_width: f64, half_depth: f64, spring: f64, rise: f64) -> Solid {
    Solid::new(Form::Arch { half_width, half_depth, spring, rise }, [x, y, z])
}

impl Plan {
    /// The plan on ground of a given height: `ground(x, y)`.
    pub(super) fn new(ground: &dyn Fn(f64, f64) -> f64) -> Self {
        let mut plan = Self { walls: Vec::new(), openings: Vec::new(), fittings: Vec::new(), shafts: Vec::new() };
        plan.curtain();
        plan.round_tower();
        plan.square_tower();
        plan.gate();
        plan.west_range();
        plan.north_range();
        plan.east_range();
        plan.court();
        plan.fallen(ground);
        plan
    }

    fn curtain(&mut self) {
        let foot = -2.5;
        let wall =
            |x, y, half: [f64; 2]| Solid::new(Form::Block { half, height: WALK - foot, batter: 0.018 }, [x, y, foot]);
        let t = THICK / 2.0;
        let merlon = Form::Arch { half_width: 0.42, half_depth: 0.24, spring: 0.45, rise: 0.5 };
        for side in [-1.0, 1.0] {
            let (x, y) = (side * (HALF_X - t), side * (HALF_Y - t));
            self.walls.push(wall(0.0, y, [HALF_X, t]));
            self.walls.push(wall(x, 0.0, [t, HALF_Y]));
            let (px, py) = (side * (HALF_X - 0.45), side * (HALF_Y - 0.45));
            self.walls.push(block(0.0, py, WALK - 0.3, [HALF_X - 0.2, 0.27], PARAPET - WALK + 0.3));
            self.walls.push(block(px, 0.0, WALK - 0.3, [0.27, HALF_Y - 0.2], PARAPET - WALK + 0.3));
            let row = |count| Repeat::Row { count, pitch: 1.45 };
            self.walls.push(Solid::new(merlon, [0.0, py, PARAPET]).repeated(row(17)));
            self.walls.push(Solid::new(merlon, [px, 0.0, PARAPET]).turned(90.0).repeated(row(15)));
            // Loopholes below the walk, and holes of the scaffold's beams.
            let slit = Form::Arch { half_width: 0.11, half_depth: 1.5, spring: 0.75, rise: 0.12 };
            let beam = Form::Block { half: [0.1, 0.45], height: 0.2, batter: 0.0 };
            let (sx, sy) = (side * HALF_X, side * HALF_Y);
            self.openings.push(Solid::new(slit, [0.05, sy, 1.9]).repeated(Repeat::Row { count: 6, pitch: 3.9 }));
            self.openings
                .push(Solid::new(slit, [sx, 0.4, 1.9]).turned(90.0).repeated(Repeat::Row { count: 5, pitch: 3.7 }));
            self.openings.push(Solid::new(beam, [0.3, sy, 3.75]).repeated(Repeat::Row { count: 11, pitch: 2.05 }));
            self.openings
                .push(Solid::new(beam, [sx, 0.3, 3.75]).turned(90.0).repeated(Repeat::Row { count: 9, pitch: 2.05 }));
        }
    }

    fn round_tower(&mut self) {
        let [x, y] = DRUM;
        let drum = |radius, height, batter, z| Solid::new(Form::Drum { radius, height, batter }, [x, y, z]);
        self.walls.push(drum(4.5, 11.0, 0.045, -2.8));
        // A string course under the parapet.
        self.walls.push(drum(4.18, 0.22, 0.0, 7.0));
        self.openings.push(drum(2.75, 3.0, 0.0, 0.1));
        self.openings.push(Solid::new(Form::Ball { radius: 2.75 }, [x, y, 3.1]));
        self.openings.push(drum(3.45, 4.0, 0.0, 6.9));
        let gap = Form::Block { half: [0.36, 1.2], height: 2.0, batter: 0.0 };
        self.openings.push(Solid::new(gap, [x, y, 7.65]).repeated(Repeat::Ring { count: 13, radius: 4.0 }));
        let port = Form::Arch { half_width: 0.32, half_depth: 1.6, spring: 0.55, rise: 0.32 };
        self.openings.push(Solid::new(port, [x, y, 1.2]).turned(14.0).repeated(Repeat::Ring { count: 7, radius: 3.9 }));
        // The way in from the court.
        self.openings.push(arch(x - 3.1, y + 3.1, 0.05, 0.55, 2.6, 1.55, 0.7).turned(45.0));
    }

    fn square_tower(&mut self) {
        let [x, y] = KEEP;
        let body = Form::Block { half: [3.6, 3.6], height: 10.4, batter: 0.03 };
        self.walls.push(Solid::new(body, [x, y, -2.8]));
        self.openings.push(block(x, y, 0.15, [2.3, 2.3], 3.2));
        self.openings.push(block(x, y, 3.75, [2.45, 2.45], 8.0));
        self.openings.push(arch(x + 2.9, y - 1.4, 0.1, 0.5, 1.2, 1.5, 0.6).turned(90.0));
        self.openings.push(arch(x + 3.0, y - 1.2, 4.9, 0.5, 1.4, 1.5, 0.55).turned(90.0));
        let window = Form::Arch { half_width: 0.34, half_depth: 1.3, spring: 0.8, rise: 0.4 };
        for turn in [0.0, 90.0, 180.0, 270.0] {
            let ring = Repeat::Ring { count: 1, radius: 3.1 };
            self.openings.push(Solid::new(window, [x, y, 4.9]).turned(turn).repeated(ring));
        }
        let merlon = Form::Arch { half_width: 0.42, half_depth: 0.26, spring: 0.5, rise: 0.5 };
        for side in [-1.0, 1.0] {
            let row = Repeat::Row { count: 5, pitch: 1.45 };
            self.walls.push(Solid::new(merlon, [x, y + side * 2.95, 7.5]).repeated(row));
            self.walls.push(Solid::new(merlon, [x + side * 2.95, y, 7.5]).turned(90.0).repeated(row));
        }
    }

    fn gate(&mut self) {
        let (x, y) = (GATE_X, -HALF_Y);
        let body = Form::Block { half: [3.1, 1.5], height: 9.3, batter: 0.012 };
        self.walls.push(Solid::new(body, [x, y + 0.55, -2.5]));
        let merlon = Form::Arch { half_width: 0.4, half_depth: 0.3, spring: 0.4, rise: 0.55 };
        let row = Repeat::Row { count: 5, pitch: 1.3 };
        self.walls.push(Solid::new(merlon, [x, y - 0.5, 6.8]).repeated(row));
        // A tall recess with a pointed head, in it the door's arch, above it the place of a lost inscription.
        self.openings.push(arch(x, y - 0.95, -0.2, 1.75, 0.42, 3.0, 2.1));
        self.openings.push(arch(x, y + 0.5, -0.1, 0.98, 3.4, 2.0, 1.15));
        self.openings.push(arch(x, y + 1.45, -0.1, 1.35, 1.1, 2.3, 1.45));
        self.openings.push(block(x, y - 0.55, 3.65, [0.5, 0.2], 0.42));
        self.openings.push(block(x, y + 0.4, 5.6, [2.3, 0.85], 3.0));
        self.openings.push(arch(x - 2.45, y - 0.9, 1.0, 0.26, 0.45, 0.75, 0.32));
        self.openings.push(arch(x + 2.45, y - 0.9, 1.0, 0.26, 0.45, 0.75, 0.32));
        for side in [-1.0, 1.0] {
            self.fittings.push(block(x + side * 2.45, y - 1.3, -1.5, [0.66, 0.55], 1.95));
            self.fittings.push(block(x + side * 2.9, y - 1.65, -1.5, [0.2, 0.2], 2.45));
        }
        self.fittings.push(
            Solid::new(Form::Stair { steps: 3, run: 0.42, rise: 0.16, half_width: 1.5 }, [x, y - 2.55, -0.52])
                .turned(90.0),
        );
    }

    /// Rooms along the west curtain; the northern two still carry their roof.
    fn west_range(&mut self) {
        let (x, foot) = (-8.0, -0.6);
        self.walls.push(block(x, 0.0, foot, [0.32, HALF_Y - 0.7], 4.6));
        for y in [-5.2, -0.2, 4.6] {
            self.walls.push(block(-10.0, y, foot, [2.2, 0.28], 4.4));
        }
        self.walls.push(block(-10.0, 2.2, 3.55, [2.4, 2.6], 0.34));
        for y in [-8.2, -2.6, 2.2, 6.6] {
            self.openings.push(arch(x, y, 0.0, 0.52, 0.6, 1.75, 0.62).turned(90.0));
        }
        for y in [-6.6, -4.2, -1.2, 0.7, 3.7] {
            self.openings.push(block(x, y, 1.35, [0.6, 0.22], 0.95));
        }
        self.openings.push(arch(-10.2, -5.2, 0.0, 0.42, 0.6, 1.6, 0.5));
        // Swahili niches, two rows, in the curtain's inner face and in the cross walls.
        let niche = Form::Arch { half_width: 0.2, half_depth: 0.24, spring: 0.36, rise: 0.22 };
        for (y, count) in [(-7.9, 5), (-2.7, 5), (2.2, 5)] {
            for z in [1.2, 2.15] {
                let at = [-HALF_X + THICK - 0.04, y, z];
                self.openings.push(Solid::new(niche, at).turned(90.0).repeated(Repeat::Row { count, pitch: 0.72 }));
            }
        }
        for z in [1.2, 2.15] {
            let at = [-10.0, -0.2 - 0.28, z];
            self.openings.push(Solid::new(niche, at).repeated(Repeat::Row { count: 4, pitch: 0.8 }));
        }
    }

    /// Rooms along the north curtain, roofless.
    fn north_range(&mut self) {
        let (y, foot) = (6.9, -0.6);
        self.walls.push(block(1.2, y, foot, [9.5, 0.3], 4.3));
        for x in [-4.4, 0.6, 6.0] {
            self.walls.push(block(x, 8.9, foot, [0.27, 2.0], 4.2));
        }
        for x in [-6.2, -1.9, 3.3, 8.6] {
            self.openings.push(arch(x, y, 0.0, 0.5, 0.6, 1.7, 0.72));
        }
        for x in [-3.4, -0.5, 1.7, 4.9, 7.0] {
            self.openings.push(arch(x, y, 1.3, 0.27, 0.6, 0.6, 0.34));
        }
        self.openings.push(arch(0.6, 9.2, 0.0, 0.42, 0.5, 1.55, 0.5).turned(90.0));
        let niche = Form::Arch { half_width: 0.2, half_depth: 0.24, spring: 0.36, rise: 0.22 };
        for (x, count) in [(-1.9, 6), (3.3, 6)] {
            let at = [x, HALF_Y - THICK + 0.04, 1.4];
            self.openings.push(Solid::new(niche, at).repeated(Repeat::Row { count, pitch: 0.7 }));
        }
    }

    /// Low walls of a fallen range along the east curtain.
    fn east_range(&mut self) {
        let (x, foot) = (8.3, -0.6);
        self.walls.push(block(x, 1.0, foot, [0.3, 6.0], 3.4));
        for y in [-2.6, 2.4] {
            self.walls.push(block(10.1, y, foot, [1.8, 0.27], 3.2));
        }
        for y in [-3.9, -0.2, 4.3] {
            self.openings.push(arch(x, y, 0.0, 0.48, 0.6, 1.7, 0.6).turned(90.0));
        }
    }

    fn court(&mut self) {
        // Stairs to the wall-walk along the south curtain.
        self.fittings.push(Solid::new(
            Form::Stair { steps: 19, run: 0.31, rise: 0.258, half_width: 0.62 },
            [1.9, -HALF_Y + THICK + 0.5, 0.0],
        ));
        // The well and its kerb, a trough, and a long stone bench.
        let [wx, wy] = WELL;
        self.fittings.push(Solid::new(Form::Drum { radius: 1.12, height: 1.25, batter: 0.04 }, [wx, wy, -0.5]));
        self.shafts.push(Solid::new(Form::Drum { radius: 0.74, height: 6.0, batter: 0.0 }, [wx, wy, -4.5]));
        self.fittings.push(block(wx + 1.75, wy - 0.4, -0.4, [0.42, 0.85], 0.85).turned(12.0));
        self.shafts.push(block(wx + 1.75, wy - 0.4, 0.18, [0.26, 0.68], 1.0).turned(12.0));
        self.fittings.push(block(-7.2, -5.4, -0.4, [0.42, 1.6], 0.82));
        self.fittings.push(block(-4.0, 6.35, -0.4, [1.5, 0.35], 0.8));
    }

    /// Pieces of the parapet that have come down and lie as they fell.
    fn fallen(&mut self, ground: &dyn Fn(f64, f64) -> f64) {
        let pieces = [
            (15.6, 2.4, 24.0, 0.55),
            (16.4, 0.6, 71.0, 0.42),
            (10.9, 3.3, 40.0, 0.5),
            (17.4, 4.2, 12.0, 0.36),
            (-15.9, 14.9, 33.0, 0.6),
            (-13.2, 16.4, 64.0, 0.45),
            (4.6, 13.4, 20.0, 0.5),
            (6.1, 14.2, 52.0, 0.38),
            (6.9, 2.2, 15.0, 0.34),
            (1.6, -15.2, 37.0, 0.4),
            (-8.8, -14.4, 58.0, 0.46),
            (9.7, -3.4, 80.0, 0.3),
        ];
        for (x, y, turn, size) in pieces {
            let piece = block(x, y, ground(x, y) - size * 0.5, [size, size * 0.66], size * 1.05);
            self.fittings.push(piece.turned(turn).tipped(turn - 45.0));
        }
    }

    /// The well's lining below its kerb, which simulated scans see instead of earth.
    pub(super) fn lining() -> Solid {
        Solid::new(Form::Drum { radius: 1.12, height: 4.6, batter: 0.0 }, [WELL[0], WELL[1], -4.9])
    }

    /// Thin walls that only simulated scans have: a plastered partition with a doorway in a western room, and a plank screen in a northern one.
    pub(super) fn boards() -> Vec<Solid> {
        let partition = |low: f64, high: f64, foot: f64, head: f64| {
            block(f64::midpoint(low, high), -3.7, foot, [(high - low) / 2.0, 0.05], head - foot)
        };
        vec![
            partition(-12.2, -9.75, -0.6, 2.6),
            partition(-9.75, -8.95, 1.95, 2.6),
            partition(-8.95, -8.0, -0.6, 2.6),
            block(-3.2, 8.55, -0.6, [1.15, 0.02], 2.5),
        ]
    }
}
