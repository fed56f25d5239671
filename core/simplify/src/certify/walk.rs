//! Covering a triangle quickly: walking over the opposite triangles that it lies over, from neighbour to neighbour.
//!
//! Everything is seen along one direction. Opposite triangles are walked over that face it, starting with one that the
//! triangle overlaps; where an edge of one crosses the inside of the triangle, its neighbour there is next. If every such
//! edge has exactly one other triangle, facing the same way, the walk has covered everything: two triangles on an edge,
//! both facing the viewer, lie on its two sides, so the rim of what is covered has no point of an edge in it, and a rim
//! without edges is none. What is nearer to a line than [`ON_LINE`] is left out of account; it is far below
//! [`kilwa_geometry::distance::ABSOLUTE_SLACK`], which every bound is raised by.

use super::polygon::{Cut, Point2, Polygon};
use super::surface::{Candidates, NONE, Surface, Triangle};
use super::view::{Frame, ON_LINE, Seen};
use glam::DVec3;
use kilwa_geometry::distance::point_triangle_squared;

/// Opposite triangles after which the walk is given up.
const MAX_TRIANGLES: usize = 48;
/// Pieces below this share of the limit are taken as they are seen, however steep.
const EXACT: f64 = 0.5;
/// Squared cosine above which the height over a triangle is taken for the distance to it: at most a tenth more.
const FLAT: f64 = 0.83;
/// An opposite triangle whose area is less than this share of the square of its sides cannot be walked over.
const THINNEST: f64 = 1e-5;

/// A point of the other surface as seen along the current direction.
#[derive(Clone, Copy)]
struct Flat {
    at: Point2,
    /// Its side of each edge of the triangle that is covered, in twice an area; above 0 inside.
    sides: [f64; 3],
    /// Its height over the plane of the triangle that is covered.
    height: f64,
    /// The walk in which this was worked out.
    walk: u32,
    /// Bit k: not above 0 on side k.
    outside: u32,
}

/// Walks over one surface.
pub(super) struct Walker<'a> {
    to: &'a Surface,
    flat: Vec<Flat>,
    walk: u32,
    visited: Candidates,
    /// Opposite triangles and distances, of the walk that was done last.
    pub(super) pieces: Vec<(u32, f64)>,
    /// The rest of the triangle: what is farther than the limit from the opposite triangle that it lies over.
    pub(super) far: Vec<Triangle>,
    /// For each point of the covered surface an opposite triangle that lay over it, from where to start.
    hints: Vec<u32>,
}

impl<'a> Walker<'a> {
    pub(super) fn new(from: &Surface, to: &'a Surface) -> Self {
        let nowhere = Flat { at: Point2::ZERO, sides: [0.0; 3], height: 0.0, walk: 0, outside: 0 };
        Self {
            to,
            flat: vec![nowhere; to.points.len()],
            walk: 0,
            visited: Candidates::new(to.triangles.len()),
            pieces: Vec::new(),
            far: Vec::new(),
            hints: vec![NONE; from.points.len()],
        }
    }

    /// Cover the triangle `t` with corners `names`, and put the pieces on [`Self::pieces`], those further away than `limit`
    /// on [`Self::far`]. `starts` are opposite triangles that it may lie over. Returns whether all of it is covered.
    pub(super) fn cover(
        &mut self,
        t: &Triangle,
        names: [u32; 3],
        direction: DVec3,
        starts: impl Iterator<Item = u32>,
        limit: f64,
    ) -> bool {
        self.pieces.clear();
        self.far.clear();
        let Some(frame) = Frame::along(direction, t[0]) else { return false };
        let Some(own) = Seen::of(t.map(|p| frame.inside(p))) else { return false };
        let walk = Walk { frame, own, names, limit };
        self.walk += 1;
        self.visited.clear();
        let hints = names.map(|p| self.hints[p as usize]);
        for start in hints.into_iter().filter(|h| *h != NONE).chain(starts).take(MAX_TRIANGLES) {
            if !self.visited.add(start) {
                continue;
            }
            let first = self.visited.list.len();
            match self.visit(start, &walk) {
                Visit::Beside => {}
                Visit::Lost => return false,
                Visit::Over => return self.rest(first, &walk),
            }
        }
        false
    }

    /// Visit what is on the list from `next` on.
    fn rest(&mut self, mut next: usize, walk: &Walk) -> bool {
        while let Some(&c) = self.visited.list.get(next) {
            next += 1;
            // One of its edges crosses the triangle, so it lies over it; anything else is not to be trusted.
            if next > MAX_TRIANGLES || !matches!(self.visit(c, walk), Visit::Over) {
                return false;
            }
        }
        true
    }

    /// Add the piece that lies over one opposite triangle, and put the neighbours on the list that the triangle reaches
    /// over to.
    fn visit(&mut self, c: u32, walk: &Walk) -> Visit {
        let corners = self.to.triangles[c as usize];
        for p in corners {
            self.look(p, walk);
        }
        let [a, b, d] = corners.map(|p| &self.flat[p as usize]);
        let (u, v) = (b.at - a.at, d.at - a.at);
        let area = u.perp_dot(v);
        let squares = u.x * u.x + u.y * u.y + v.x * v.x + v.y * v.y;
        if area <= THINNEST * squares {
            return Visit::Lost;
        }
        if a.outside & b.outside & d.outside != 0 {
            return Visit::Beside;
        }
        // The corners of the piece: where the edges of the opposite triangle enter and leave the triangle ...
        let mut highest = -1.0f64;
        let mut onwards = [false; 3];
        for (k, (p, q)) in [(a, b), (b, d), (d, a)].into_iter().enumerate() {
            let Some((from, to)) = crossing(p, q) else { continue };
            let rise = q.height - p.height;
            highest = highest.max((p.height + rise * from).abs()).max((p.height + rise * to).abs());
            onwards[k] = true;
        }
        // ... and those of its own corners that the opposite one lies over.
        let corners_at = [a.at, b.at, d.at];
        for (k, p) in walk.own.flat.iter().enumerate() {
            let w = [0, 1, 2].map(|i: usize| side(corners_at[i], corners_at[(i + 1) % 3], *p));
            let hair = -ON_LINE * squares.sqrt();
            if w[0] >= hair && w[1] >= hair && w[2] >= hair {
                highest = highest.max(((w[1] * a.height + w[2] * b.height + w[0] * d.height) / area).abs());
                self.hints[walk.names[k] as usize] = c;
            }
        }
        // Where no edge of the opposite triangle passes through the triangle, that is beside it, or inside as a whole: its
        // corners may touch in both cases, its centroid decides.
        if !onwards.contains(&true) {
            let own = &walk.own.flat;
            let centroid = (own[0] + own[1] + own[2]) / 3.0;
            if (0..3).any(|k| side(corners_at[k], corners_at[(k + 1) % 3], centroid) <= 0.0) {
                return Visit::Beside;
            }
        }
        let next = self.to.neighbours[c as usize];
        for k in 0..3 {
            if onwards[k] {
                if next[k] == NONE {
                    return Visit::Lost;
                }
                self.visited.add(next[k]);
            }
        }
        if highest > walk.limit * EXACT && self.is_steep(c, area) {
            highest = highest.min(self.exactly(c, walk));
        }
        if highest <= walk.limit {
            self.pieces.push((c, highest));
            return Visit::Over;
        }
        let Some(piece) = self.piece(c, walk) else { return Visit::Lost };
        let lifted = |p: &Point2| walk.own.lift(p, &walk.frame);
        if let [first, rest @ ..] = piece.corners() {
            self.far.extend(rest.windows(2).map(|w| [lifted(first), lifted(&w[0]), lifted(&w[1])]));
        }
        Visit::Over
    }

    /// The opposite triangles that were looked at.
    pub(super) fn visited(&self) -> &[u32] {
        &self.visited.list
    }

    /// Work out a point of the other surface in the frame.
    fn look(&mut self, p: u32, walk: &Walk) {
        let f = &mut self.flat[p as usize];
        if f.walk != self.walk {
            let inside = walk.frame.inside(self.to.points[p as usize]);
            let at = inside.truncate();
            let sides = [0, 1, 2].map(|k: usize| walk.own.edges[k].side(&at) - walk.own.edges[k].tolerance);
            let outside = (0..3).map(|k| u32::from(sides[k] <= 0.0) << k).sum();
            *f = Flat { at, sides, height: inside.z - walk.own.height(&at), walk: self.walk, outside };
        }
    }

    /// Whether distances along the direction are much more than those to the plane of `c`; `area` is twice its area as seen.
    fn is_steep(&self, c: u32, area: f64) -> bool {
        let [p, q, r] = self.to.triangle(c);
        let n = (q - p).cross(r - p);
        area * area < FLAT * n.length_squared()
    }

    /// The largest distance of the piece over `c` to it, not along the direction but to the nearest point.
    fn exactly(&self, c: u32, walk: &Walk) -> f64 {
        let Some(piece) = self.piece(c, walk) else { return f64::INFINITY };
        let t = self.to.triangle(c);
        let squared = piece.corners().iter().map(|p| point_triangle_squared(walk.own.lift(p, &walk.frame), t));
        squared.fold(0.0, f64::max).sqrt()
    }

    /// The piece that lies over `c`.
    fn piece(&self, c: u32, walk: &Walk) -> Option<Polygon> {
        let seen = Seen::of(self.to.triangle(c).map(|p| walk.frame.inside(p)))?;
        let mut piece = Polygon::triangle(walk.own.flat);
        for line in &seen.edges {
            match piece.cut(line) {
                Cut::Inside => {}
                Cut::Both(inside, _) => piece = inside,
                Cut::Outside | Cut::Full => return None,
            }
        }
        Some(piece)
    }
}

/// One walk.
struct Walk {
    frame: Frame,
    /// The triangle that is covered.
    own: Seen,
    /// Its points.
    names: [u32; 3],
    limit: f64,
}

/// What was found of an opposite triangle.
enum Visit {
    /// The triangle is not over it.
    Beside,
    /// It is, and all went well.
    Over,
    /// The walk cannot continue.
    Lost,
}

/// Twice the area of a triangle, above 0 where `p` is on the left of the line from `a` to `b`.
fn side(a: Point2, b: Point2, p: Point2) -> f64 {
    (b - a).perp_dot(p - a)
}

/// Which part of the segment between two points is inside the triangle.
fn crossing(a: &Flat, b: &Flat) -> Option<(f64, f64)> {
    if a.outside & b.outside != 0 {
        return None;
    }
    let (mut from, mut to) = (0.0f64, 1.0f64);
    if a.outside | b.outside != 0 {
        for k in 0..3 {
            let (sa, sb) = (a.sides[k], b.sides[k]);
            if sa <= 0.0 {
                from = from.max(sa / (sa - sb));
            } else if sb <= 0.0 {
                to = to.min(sa / (sa - sb));
            }
        }
    }
    (from < to).then_some((from, to))
}
