//! Thin and moving things in front of the fort: capsules and planks, met by rays exactly, in a hierarchy of boxes.

use super::Class;
use crate::fort::scene::Beam;
use glam::DVec3;

/// A solid that rays meet in closed form.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shape {
    /// All places within `radius` of the line from `a` to `b`.
    Capsule { a: DVec3, b: DVec3, radius: f64 },
    /// A box with horizontal top and bottom, turned about the vertical: half its length, width and height, and the direction of its length.
    Plank { middle: DVec3, half: DVec3, along: [f64; 2] },
}

/// A solid with what it is and its colour (sRGB, 0 to 255).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Prop {
    pub(crate) shape: Shape,
    pub(crate) class: Class,
    pub(crate) color: [f64; 3],
}

/// Things in a hierarchy of boxes.
pub(crate) struct Props {
    props: Vec<Prop>,
    nodes: Vec<Node>,
}

/// A box round the things `first..first + count`, or, without any, round the next node and the node `first`.
struct Node {
    low: DVec3,
    high: DVec3,
    first: u32,
    count: u32,
}

/// Things in a leaf.
const LEAF: usize = 4;

impl Shape {
    fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Capsule { a, b, radius } => (a.min(b) - radius, a.max(b) + radius),
            Self::Plank { middle, half, along: [c, s] } => {
                let reach =
                    DVec3::new(c.abs() * half.x + s.abs() * half.y, s.abs() * half.x + c.abs() * half.y, half.z);
                (middle - reach, middle + reach)
            }
        }
    }

    /// Where a ray (origin, unit direction) first meets it from outside.
    pub(crate) fn meet(&self, o: DVec3, d: DVec3) -> Option<f64> {
        match *self {
            Self::Capsule { a, b, radius } => capsule(o, d, a, b, radius),
            Self::Plank { middle, half, along: [c, s] } => {
                let turn = |v: DVec3| DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z);
                let (o, inverse) = (turn(o - middle), turn(d).recip());
                let (one, two) = ((-half - o) * inverse, (half - o) * inverse);
                let (enter, exit) = (one.min(two).max_element(), one.max(two).min_element());
                (enter > 0.0 && enter < exit).then_some(enter)
            }
        }
    }

    /// Outward unit normal at a place of its surface.
    pub(crate) fn normal(&self, p: DVec3) -> DVec3 {
        match *self {
            Self::Capsule { a, b, .. } => {
                let axis = b - a;
                let share = ((p - a).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0);
                (p - a - axis * share).normalize_or(DVec3::Z)
            }
            Self::Plank { middle, half, along: [c, s] } => {
                let v = p - middle;
                let q = DVec3::new(c * v.x + s * v.y, c * v.y - s * v.x, v.z) / half;
                let n = if q.x.abs() >= q.y.abs().max(q.z.abs()) {
                    DVec3::X * q.x
                } else if q.y.abs() >= q.z.abs() {
                    DVec3::Y * q.y
                } else {
                    DVec3::Z * q.z
                };
                DVec3::new(c * n.x - s * n.y, s * n.x + c * n.y, n.z).normalize_or(DVec3::Z)
            }
        }
    }
}

/// Source: Quilez, "Capsule – intersection" (iquilezles.org).
fn capsule(o: DVec3, d: DVec3, a: DVec3, b: DVec3, radius: f64) -> Option<f64> {
    let (axis, from_a) = (b - a, o - a);
    let (aa, ad, ao) = (axis.length_squared(), axis.dot(d), axis.dot(from_a));
    let (od, oo) = (d.dot(from_a), from_a.length_squared());
    let p = aa - ad * ad;
    let q = aa * od - ao * ad;
    let r = aa * oo - ao * ao - radius * radius * aa;
    let h = q * q - p * r;
    if h < 0.0 {
        return None;
    }
    let side = (-q - h.sqrt()) / p;
    let along = ao + side * ad;
    if p > 0.0 && along > 0.0 && along < aa {
        return (side > 0.0).then_some(side);
    }
    let to_cap = if p > 0.0 && along >= aa || p <= 0.0 && ad < 0.0 { o - b } else { from_a };
    let (q, r) = (d.dot(to_cap), to_cap.length_squared() - radius * radius);
    let h = q * q - r;
    if h <= 0.0 {
        return None;
    }
    let cap = -q - h.sqrt();
    (cap > 0.0).then_some(cap)
}

impl Props {
    pub(crate) fn new(mut props: Vec<Prop>) -> Self {
        let mut nodes = Vec::new();
        if !props.is_empty() {
            build(&mut props, 0, &mut nodes);
        }
        Self { props, nodes }
    }

    pub(crate) fn get(&self, index: u32) -> &Prop {
        &self.props[index as usize]
    }

    /// The things that a beam may touch before `to`, added to `found`.
    pub(crate) fn near(&self, o: DVec3, d: DVec3, to: f64, beam: Beam, found: &mut Vec<u32>) {
        let inverse = d.recip();
        let radius = DVec3::splat(beam.radius(to));
        let mut node = 0;
        let mut open = [0_u32; 64];
        let mut waiting = 0;
        while let Some(n) = self.nodes.get(node as usize) {
            let (one, two) = ((n.low - radius - o) * inverse, (n.high + radius - o) * inverse);
            let (enter, exit) = (one.min(two).max_element(), one.max(two).min_element());
            let met = exit >= enter.max(0.0) && enter <= to;
            if met && n.count == 0 {
                open[waiting] = n.first;
                waiting += 1;
                node += 1;
                continue;
            }
            if met {
                found.extend(n.first..n.first + n.count);
            }
            if waiting == 0 {
                return;
            }
            waiting -= 1;
            node = open[waiting];
        }
    }
}

/// Sort things into a hierarchy; the order of equal things is that in which they were given.
fn build(props: &mut [Prop], first: usize, nodes: &mut Vec<Node>) {
    let (mut low, mut high) = (DVec3::MAX, DVec3::MIN);
    for prop in &*props {
        let (a, b) = prop.shape.bounds();
        (low, high) = (low.min(a), high.max(b));
    }
    let at = nodes.len();
    let leaf = props.len() <= LEAF;
    nodes.push(Node { low, high, first: first as u32, count: if leaf { props.len() as u32 } else { 0 } });
    if leaf {
        return;
    }
    let size = high - low;
    let axis = (0..3).fold(0, |best, k| if size[k] > size[best] { k } else { best });
    let middle = |prop: &Prop| {
        let (a, b) = prop.shape.bounds();
        a[axis] + b[axis]
    };
    props.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
    let half = props.len() / 2;
    let (left, right) = props.split_at_mut(half);
    build(left, first, nodes);
    nodes[at].first = nodes.len() as u32;
    build(right, first + half, nodes);
}
