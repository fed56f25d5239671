//! The nearest place of a surface that is given by points with normals.

use glam::DVec3;

/// A place of the surface: its position and its unit normal.
pub type Foot = (DVec3, DVec3);

/// Points of a surface with their normals, in a k-d tree (Bentley, "Multidimensional binary search trees used for associative searching", 1975): each half of a range lies on one side of its middle point, along
/// the axis in which the range is longest.
#[derive(Debug, Clone, Default)]
pub struct Surface {
    points: Vec<Foot>,
    /// The axis of the middle point of each range.
    axes: Vec<u8>,
}

impl Surface {
    /// From positions and unit normals; those that are not finite are left out.
    pub fn new(points: impl IntoIterator<Item = Foot>) -> Self {
        let mut points: Vec<Foot> = points.into_iter().filter(|(p, n)| p.is_finite() && n.is_finite()).collect();
        let mut axes = vec![0; points.len()];
        sort(&mut points, &mut axes);
        Self { points, axes }
    }

    /// The number of points.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The point nearest to a place, if it is within `reach`.
    pub fn nearest(&self, place: DVec3, reach: f64) -> Option<Foot> {
        let mut best = (reach * reach, None);
        self.look(place, 0, self.points.len(), &mut best);
        best.1.map(|k: usize| self.points[k])
    }

    fn look(&self, place: DVec3, from: usize, to: usize, best: &mut (f64, Option<usize>)) {
        if from >= to {
            return;
        }
        let middle = from + (to - from) / 2;
        let (position, _) = self.points[middle];
        let square = position.distance_squared(place);
        if square <= best.0 {
            *best = (square, Some(middle));
        }
        let axis = usize::from(self.axes[middle]);
        let offset = place[axis] - position[axis];
        let (near, far) = ((from, middle), (middle + 1, to));
        let (near, far) = if offset < 0.0 { (near, far) } else { (far, near) };
        self.look(place, near.0, near.1, best);
        if offset * offset <= best.0 {
            self.look(place, far.0, far.1, best);
        }
    }
}

fn sort(points: &mut [Foot], axes: &mut [u8]) {
    if points.len() < 2 {
        return;
    }
    let low = points.iter().fold(DVec3::INFINITY, |low, (p, _)| low.min(*p));
    let high = points.iter().fold(DVec3::NEG_INFINITY, |high, (p, _)| high.max(*p));
    let size = high - low;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let middle = points.len() / 2;
    points.select_nth_unstable_by(middle, |(a, _), (b, _)| a[axis].total_cmp(&b[axis]));
    axes[middle] = axis as u8;
    let (left, right) = points.split_at_mut(middle);
    let (left_axes, right_axes) = axes.split_at_mut(middle);
    sort(left, left_axes);
    sort(&mut right[1..], &mut right_axes[1..]);
}
