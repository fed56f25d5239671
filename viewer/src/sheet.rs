//! The camera of a part of a drawing to scale ([`kilwa_measure::sheet`]).

use crate::camera::{Bounds, Camera, StandardView};
use kilwa_measure::sheet::{Part, View};

/// The drawing that a view gives; `None` for an oblique one, which has no scale.
pub fn drawing(view: StandardView) -> Option<View> {
    StandardView::ALL.iter().find(|(v, _)| *v == view).and_then(|(_, name)| View::from_name(name))
}

/// The camera that sees a part of a drawing.
pub fn camera(view: StandardView, bounds: &Bounds, part: &Part) -> Camera {
    let mut camera = Camera::standard(view, bounds, [1, 1]);
    camera.target = part.target;
    camera.distance *= part.half_height / camera.half_height();
    camera
}
