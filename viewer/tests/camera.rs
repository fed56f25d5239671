//! Properties of the camera.

use glam::DVec3;
use kilwa_geometry::Lattice;
use kilwa_viewer::{Bounds, Camera, Edges, StandardView};

const BOUNDS: Bounds =
    Bounds { min: DVec3::new(500_000.0, 4_649_776.0, 100.0), max: DVec3::new(500_040.0, 4_649_806.0, 112.0) };
const SIZE: [u32; 2] = [1200, 800];
const LATTICE: Lattice = Lattice { origin: DVec3::new(499_990.0, 4_649_700.0, 90.0), step_log2: -13 };

fn close(a: DVec3, b: DVec3, within: f64) -> bool {
    a.abs_diff_eq(b, within)
}

/// The pixel of a world point.
fn pixel(camera: &Camera, point: DVec3) -> [f64; 2] {
    let d = point - camera.eye();
    let (x, y, z) = (d.dot(camera.right()), d.dot(camera.up()), -d.dot(camera.backward()));
    let scale =
        f64::from(SIZE[1]) * 0.5 / camera.half_height() * if camera.orthographic { 1.0 } else { camera.distance / z };
    [f64::from(SIZE[0]) * 0.5 + x * scale, f64::from(SIZE[1]) * 0.5 - y * scale]
}

#[test]
fn elevations_look_at_the_face_they_are_named_after() {
    let from = |view| Camera::standard(view, &BOUNDS, SIZE).backward();
    assert!(close(from(StandardView::North), DVec3::Y, 1e-12));
    assert!(close(from(StandardView::East), DVec3::X, 1e-12));
    assert!(close(from(StandardView::South), DVec3::new(0.0, -1.0, 0.0), 1e-12));
    assert!(close(from(StandardView::West), DVec3::new(-1.0, 0.0, 0.0), 1e-12));
    assert!(close(from(StandardView::Plan), DVec3::Z, 1e-12));
}

#[test]
fn a_plan_has_north_up_and_east_right() {
    let plan = Camera::standard(StandardView::Plan, &BOUNDS, SIZE);
    assert!(close(plan.up(), DVec3::Y, 1e-12) && close(plan.right(), DVec3::X, 1e-12));
}

#[test]
fn axes_are_orthogonal_and_right_handed_from_every_side() {
    let mut camera = Camera::standard(StandardView::Iso, &BOUNDS, SIZE);
    for k in 0..500 {
        camera.orbit(0.37, if k % 2 == 0 { 0.9 } else { -1.0 });
        let (r, u, b) = (camera.right(), camera.up(), camera.backward());
        assert!(close(r.cross(u), b, 1e-12), "{camera:?}");
        assert!(camera.elevation.abs() <= std::f64::consts::FRAC_PI_2);
        assert!(r[2] == 0.0 && u[2] >= -1e-12, "up stays up");
    }
}

#[test]
fn every_standard_view_shows_the_whole_model() {
    for (view, name) in StandardView::ALL {
        for size in [[1200u32, 800], [390, 844]] {
            let camera = Camera::standard(view, &BOUNDS, size);
            let v = camera.view(&LATTICE, &BOUNDS, size, 1.0);
            for k in 0..8 {
                let corner = BOUNDS.corners()[k];
                let DVec3 { x, y, z } = v.in_view(LATTICE.steps_from_world(corner));
                let (half, depth) = match v.projection {
                    kilwa_stream::Projection::Perspective { tan_half_height } => (tan_half_height * z, z > v.near),
                    kilwa_stream::Projection::Orthographic { half_height } => (half_height, z >= 0.0 && z <= v.far),
                };
                let inside = x.abs() <= half * v.aspect() * 1.000_001 && y.abs() <= half * 1.000_001 && depth;
                assert!(inside, "{name} {size:?} corner {k}: {x} {y} {z}");
            }
        }
    }
}

#[test]
fn beside_what_covers_the_edges_of_the_picture_all_of_the_model_is_shown_as_large_as_it_goes() {
    for covered in [
        Edges { left: 64.0, ..Edges::default() },
        Edges { bottom: 72.0, ..Edges::default() },
        Edges { left: 30.0, top: 50.0, right: 90.0, bottom: 20.0 },
    ] {
        for size in [[300, 600], [1100, 700]] {
            for (view, name) in StandardView::ALL {
                for orthographic in [false, true] {
                    let mut camera = Camera { orthographic, ..Camera::standard(view, &BOUNDS, size) };
                    camera.fit_beside(&BOUNDS, size, covered);
                    let pixels = BOUNDS.corners().map(|c| camera.pixel(c, size).unwrap().0);
                    let free = [
                        (covered.left, f64::from(size[0]) - covered.right),
                        (covered.top, f64::from(size[1]) - covered.bottom),
                    ];
                    let mut fullest = 0.0_f64;
                    for (i, (from, to)) in free.into_iter().enumerate() {
                        let low = pixels.iter().map(|p| p[i]).fold(f64::MAX, f64::min);
                        let high = pixels.iter().map(|p| p[i]).fold(f64::MIN, f64::max);
                        assert!(low >= from && high <= to, "{name}: {low} to {high} of {from} to {to}");
                        fullest = fullest.max((high - low) / (to - from));
                    }
                    assert!(fullest > 0.93, "{name}: only {fullest} of the free area is used");
                }
            }
        }
    }
}

#[test]
fn edges_that_would_leave_nothing_free_leave_half_of_the_picture() {
    let mut camera = Camera::standard(StandardView::Plan, &BOUNDS, [400, 400]);
    camera.fit_beside(&BOUNDS, [400, 400], Edges { left: 500.0, top: f64::NAN, right: -3.0, bottom: 0.0 });
    let pixels = BOUNDS.corners().map(|c| camera.pixel(c, [400, 400]).unwrap().0);
    assert!(pixels.iter().all(|[x, y]| (200.0..=400.0).contains(x) && (0.0..=400.0).contains(y)), "{pixels:?}");
}

#[test]
fn zooming_keeps_the_point_under_the_pointer() {
    for view in [StandardView::Iso, StandardView::North] {
        let mut camera = Camera::standard(view, &BOUNDS, SIZE);
        let point = DVec3::new(500_010.0, 4_649_790.0, 104.0);
        let before = pixel(&camera, point);
        for factor in [0.5, 0.8, 1.3, 0.2] {
            camera.zoom(factor, point, &BOUNDS);
            let after = pixel(&camera, point);
            assert!((before[0] - after[0]).abs() < 1e-4 && (before[1] - after[1]).abs() < 1e-4, "{before:?} {after:?}");
        }
    }
}

#[test]
fn zooming_never_runs_away_or_passes_through_the_target() {
    let mut camera = Camera::standard(StandardView::Iso, &BOUNDS, SIZE);
    for factor in [1e-9, 1e-9, 1e12, f64::NAN, 0.0, -1.0, f64::INFINITY] {
        camera.zoom(factor, BOUNDS.center(), &BOUNDS);
        assert!(camera.distance > 0.0 && camera.distance < 1e4 && camera.target.is_finite());
    }
}

#[test]
fn panning_moves_the_target_with_the_pointer() {
    for view in [StandardView::Iso, StandardView::Plan] {
        let mut camera = Camera::standard(view, &BOUNDS, SIZE);
        let point = camera.target;
        camera.pan(100.0, -40.0, SIZE);
        let [x, y] = pixel(&camera, point);
        assert!((x - 700.0).abs() < 1e-6 && (y - 360.0).abs() < 1e-6, "{x} {y}");
    }
}

#[test]
fn a_ray_through_a_pixel_meets_what_is_drawn_there() {
    for view in [StandardView::Iso, StandardView::West] {
        let camera = Camera::standard(view, &BOUNDS, SIZE);
        let (origin, direction) = camera.ray([300.0, 650.0], SIZE);
        let far = origin + direction * 17.0;
        let [x, y] = pixel(&camera, far);
        assert!((x - 300.0).abs() < 1e-6 && (y - 650.0).abs() < 1e-6);
    }
}

#[test]
fn a_new_pivot_does_not_move_the_picture() {
    for view in [StandardView::Iso, StandardView::South] {
        let mut camera = Camera::standard(view, &BOUNDS, SIZE);
        let point = DVec3::new(500_020.0, 4_649_780.0, 101.0);
        let before = pixel(&camera, point);
        camera.set_pivot(point);
        let after = pixel(&camera, point);
        assert!((before[0] - after[0]).abs() < 1e-6 && (before[1] - after[1]).abs() < 1e-6, "{before:?} {after:?}");
    }
}

#[test]
fn free_rotation_passes_the_poles_and_keeps_distance_and_axes() {
    let mut camera = Camera::standard(StandardView::Iso, &BOUNDS, SIZE);
    let mut lowest: f64 = 1.0;
    for k in 0..400 {
        let (before, target) = (camera.backward(), camera.target);
        camera.turn_free(0.011 * f64::from(k % 7), 0.05, 0.003);
        let (r, u, b) = (camera.right(), camera.up(), camera.backward());
        assert!(close(r.cross(u), b, 1e-9) && (b.length_squared() - 1.0).abs() < 1e-9, "{camera:?}");
        assert!(before.dot(b) > 0.99, "no jump at the pole: {before:?} to {b:?}");
        assert_eq!(target, camera.target);
        lowest = lowest.min(u[2]);
    }
    assert!(lowest < -0.4, "the picture stood on its head in between: {lowest}");
}

#[test]
fn free_rotation_equals_the_turntable_at_the_horizon() {
    let mut free = Camera::standard(StandardView::South, &BOUNDS, SIZE);
    let mut table = free;
    free.turn_free(0.2, 0.0, 0.0);
    table.orbit(0.2, 0.0);
    assert!(close(free.eye(), table.eye(), 1e-6) && close(free.up(), table.up(), 1e-9));
    free.turn_free(0.0, 0.3, 0.0);
    table.orbit(0.0, 0.3);
    assert!(close(free.eye(), table.eye(), 1e-6) && close(free.up(), table.up(), 1e-9));
}

#[test]
fn looking_around_does_not_move_the_eye() {
    let mut camera = Camera::standard(StandardView::Iso, &BOUNDS, SIZE);
    let eye = camera.eye();
    camera.look(1.1, -0.4);
    assert!(close(camera.eye(), eye, 1e-6));
    camera.place_eye(DVec3::new(500_001.0, 4_649_780.0, 101.6));
    assert!(close(camera.eye(), DVec3::new(500_001.0, 4_649_780.0, 101.6), 1e-6));
}

#[test]
fn the_pixel_of_a_point_is_the_one_whose_ray_meets_it() {
    for (view, _) in StandardView::ALL {
        let mut camera = Camera::standard(view, &BOUNDS, SIZE);
        camera.turn_free(0.2, 0.1, 0.3);
        for at in [[0.0, 0.0], [600.0, 400.0], [1100.0, 30.0]] {
            let (origin, direction) = camera.ray(at, SIZE);
            let point = origin + direction * camera.distance * 1.3;
            let (found, depth) = camera.pixel(point, SIZE).unwrap();
            assert!((found[0] - at[0]).abs() < 1e-3 && (found[1] - at[1]).abs() < 1e-3, "{found:?} for {at:?}");
            assert!(depth > 0.0);
        }
    }
    let camera = Camera::standard(StandardView::Iso, &BOUNDS, SIZE);
    let behind = camera.eye() + camera.backward();
    assert!(camera.pixel(behind, SIZE).is_none());
}

#[test]
fn resizing_a_picture_keeps_the_view_along_its_shorter_side() {
    let bounds = Bounds { min: DVec3::ZERO, max: DVec3::new(50.0, 50.0, 10.0) };
    for view in [StandardView::Iso, StandardView::Plan] {
        let phone = Camera::standard(view, &bounds, [390, 700]);
        let per_pixel = |c: &Camera, size: [u32; 2]| 2.0 * c.half_height() / f64::from(size[1]);
        let mut sheet = phone;
        sheet.resized([390, 700], [390, 256]);
        let (a, b) = (per_pixel(&phone, [390, 700]) * 390.0, per_pixel(&sheet, [390, 256]) * 256.0);
        assert!((a / b - 1.0).abs() < 1e-12, "{a} {b}");
        let mut back = sheet;
        back.resized([390, 256], [390, 700]);
        assert!((back.distance / phone.distance - 1.0).abs() < 1e-12);
        let mut wide = Camera::standard(view, &bounds, [1440, 900]);
        let before = wide.distance;
        wide.resized([1440, 900], [1100, 900]);
        assert_eq!(wide.distance, before, "a window that stays wider than high keeps its opening angle");
    }
}
