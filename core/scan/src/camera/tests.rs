use super::*;
use proptest::prelude::*;

const SIZE: [u32; 2] = [4000, 3000];

/// Realistic lenses: the corners of the picture are at a tangent of about 1.
fn distortion() -> impl Strategy<Value = Distortion> {
    let tangential = || prop::array::uniform2(-0.002..0.002);
    let k = || (-0.1..0.1, prop::array::uniform5(-0.005..0.005));
    let brown = (k(), tangential()).prop_map(|((k1, k), p)| Distortion::Brown { k: [k1, k[0], k[1], k[2]], p });
    let open_cv =
        (k(), tangential()).prop_map(|((k1, k), p)| Distortion::OpenCv { k: [k1, k[0], k[1], k[2], k[3], k[4]], p });
    let fisheye = (prop::array::uniform4(-0.03..0.03), tangential()).prop_map(|(k, p)| Distortion::Fisheye { k, p });
    prop_oneof![Just(Distortion::None), brown, open_cv, fisheye]
}

fn pinhole() -> impl Strategy<Value = Camera> {
    let near = |at: f64, by: f64| at - by..at + by;
    (distortion(), near(3000.0, 300.0), near(3000.0, 300.0), near(2000.0, 80.0), near(1500.0, 80.0), near(0.0, 3.0))
        .prop_map(|(distortion, fx, fy, cx, cy, skew)| {
            let (focal, center) = (DVec2::new(fx, fy), DVec2::new(cx, cy));
            Camera::new(SIZE, CameraModel::Pinhole { focal, center, skew, distortion }).unwrap()
        })
}

fn camera() -> impl Strategy<Value = Camera> {
    let cylinder = CameraModel::Cylindrical { scale: DVec2::new(640.0, 700.0), center: DVec2::new(2000.0, 1400.0) };
    let part = CameraModel::Equirectangular { scale: DVec2::new(900.0, 960.0), center: DVec2::new(2000.0, 1500.0) };
    prop_oneof![
        4 => pinhole(),
        1 => Just(Camera::equirectangular([8192, 4096]).unwrap()),
        1 => Just(Camera::new(SIZE, cylinder).unwrap()),
        1 => Just(Camera::new(SIZE, part).unwrap()),
    ]
}

fn place(camera: &Camera, at: [f64; 2]) -> DVec2 {
    DVec2::from_array(at) * DVec2::from_array(camera.size().map(f64::from))
}

proptest! {
    #[test]
    fn projecting_the_ray_of_a_pixel_gives_the_pixel(camera in camera(), at in prop::array::uniform2(0.0..1.0), range in 0.1..100.0) {
        let pixel = place(&camera, at);
        let ray = camera.ray(pixel).unwrap();
        prop_assert!((ray.length() - 1.0).abs() < 1e-14);
        let again = camera.project(ray * range).unwrap();
        prop_assert!(again.distance(pixel) < 1e-9, "{}", again.distance(pixel));
    }

    #[test]
    fn a_point_is_on_the_ray_of_its_pixel(camera in camera(), x in -3.0..3.0, y in -3.0..3.0, z in -1.0..3.0) {
        let point = DVec3::new(x, y, z);
        if let Some(pixel) = camera.project(point) {
            let ray = camera.ray(pixel).unwrap();
            prop_assert!(ray.angle_between(point) < 1e-7, "{}", ray.angle_between(point));
        }
    }

    #[test]
    fn the_derivative_is_that_of_the_projection(camera in camera(), at in prop::array::uniform2(0.01..0.99), range in 0.5..5.0) {
        let point = camera.ray(place(&camera, at)).unwrap() * range;
        let found = camera.project_with_derivative(point).unwrap();
        prop_assert_eq!(Some(found.pixel), camera.project(point));
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            let step = 1e-6;
            let [before, after] = [-step, step].map(|s| camera.project(point + axis * s).unwrap());
            let difference = (after - before) / (2.0 * step);
            let derivative = DVec2::new(found.rows[0].dot(axis), found.rows[1].dot(axis));
            prop_assert!(derivative.distance(difference) < 1e-4 * (1.0 + difference.length()), "{derivative} {difference}");
        }
    }

    /// However wild the coefficients: what is seen at a pixel is on the ray of that pixel, so that nothing folds back.
    #[test]
    fn no_lens_shows_two_directions_at_a_pixel(
        kind in 0..3, k in prop::array::uniform6(-2.0..2.0), p in prop::array::uniform2(-0.1..0.1),
        x in -4.0..4.0, y in -4.0..4.0, z in -1.0..1.0,
    ) {
        let four = [k[0], k[1], k[2], k[3]];
        let distortion = match kind {
            0 => Distortion::Brown { k: four, p },
            1 => Distortion::OpenCv { k, p },
            _ => Distortion::Fisheye { k: four, p },
        };
        let camera = Camera::pinhole(SIZE, DVec2::splat(2000.0), DVec2::new(2000.0, 1500.0), distortion).unwrap();
        let point = DVec3::new(x, y, z);
        if let Some(pixel) = camera.project(point) {
            let ray = camera.ray(pixel).unwrap();
            prop_assert!(ray.angle_between(point) < 1e-6, "{} {}", ray.angle_between(point), camera.max_angle());
            prop_assert!(camera.project(ray).unwrap().distance(pixel) < 1e-9 + 1e-11 * pixel.length());
        }
    }

    #[test]
    fn a_pixel_covers_its_angle(camera in camera(), at in prop::array::uniform2(0.05..0.95), turn in 0.0..TAU) {
        let pixel = place(&camera, at);
        let ray = camera.ray(pixel).unwrap();
        let angle = camera.pixel_angle(ray * 7.0).unwrap();
        let next = camera.ray(pixel + DVec2::from_angle(turn)).unwrap();
        prop_assert!(ray.angle_between(next) < angle * 1.01, "{} {angle}", ray.angle_between(next));
    }
}

#[test]
fn a_barrel_lens_ends_where_it_would_fold_back() {
    let k = [-0.3, 0.0, 0.0, 0.0];
    let camera =
        Camera::pinhole(SIZE, DVec2::splat(1500.0), DVec2::new(2000.0, 1500.0), Distortion::Brown { k, p: [0.0; 2] })
            .unwrap();
    // r - 0.3 r³ turns back at r = 1/sqrt(0.9); the limit is shortly before.
    let fold = 1.0 / 0.9_f64.sqrt();
    let limit = libm::tan(camera.max_angle());
    assert!(limit < fold && limit > 0.98 * fold, "{limit} {fold}");
    assert!(camera.project(DVec3::new(limit * 0.999, 0.0, 1.0)).is_some());
    for r in [fold, 1.5, 1.7, 1.9, 20.0] {
        assert_eq!(camera.project(DVec3::new(r, 0.0, 1.0)), None, "{r}");
    }
    // The left rim of the picture, at 1.333, is farther than any ray gets: 0.703.
    assert_eq!(camera.ray(DVec2::new(0.0, 1500.0)), None);
    assert!(camera.ray(DVec2::new(1000.0, 1500.0)).is_some());
}

#[test]
fn points_behind_a_pinhole_are_invisible_and_a_fisheye_sees_beyond_90_degrees() {
    let center = DVec2::new(2000.0, 1500.0);
    let camera = Camera::pinhole(SIZE, DVec2::splat(3000.0), center, Distortion::None).unwrap();
    assert_eq!(camera.project(DVec3::new(0.1, 0.2, -1.0)), None);
    assert_eq!(camera.project(DVec3::new(0.1, 0.2, 0.0)), None);
    assert_eq!(camera.project(DVec3::ZERO), None);
    assert_eq!(camera.project(DVec3::new(0.0, 0.0, f64::NAN)), None);
    assert_eq!(camera.project(DVec3::Z), Some(center));
    let fisheye = Distortion::Fisheye { k: [0.0; 4], p: [0.0; 2] };
    let camera = Camera::pinhole(SIZE, DVec2::splat(1000.0), center, fisheye).unwrap();
    let seen = camera.project(DVec3::new(1.0, 0.0, -1.0)).unwrap();
    assert!(seen.distance(center + DVec2::X * 1000.0 * 0.75 * PI) < 1e-9);
    assert_eq!(camera.project(-DVec3::Z), None);
}

/// The directions of the docs: x right, y down, the centre of the picture forward.
#[test]
fn panorama_and_cube_directions_are_as_documented() {
    let camera = Camera::equirectangular([3600, 1800]).unwrap();
    for (point, pixel) in [
        (DVec3::Z, [1800.0, 900.0]),
        (DVec3::X, [2700.0, 900.0]),
        (-DVec3::X, [900.0, 900.0]),
        (DVec3::new(0.0, 1.0, 1.0), [1800.0, 1350.0]),
        (-DVec3::Y, [1800.0, 0.0]),
    ] {
        assert!(camera.project(point).unwrap().distance(DVec2::from_array(pixel)) < 1e-9, "{point}");
    }
    let face = Camera::cube_face(1000).unwrap();
    for (cube, face_direction) in
        CubeFace::ALL.into_iter().zip([DVec3::Z, DVec3::X, -DVec3::Z, -DVec3::X, -DVec3::Y, DVec3::Y])
    {
        let seen = face.project(cube.face_from_cube() * face_direction).unwrap();
        assert!(seen.distance(DVec2::splat(500.0)) < 1e-9, "{cube:?}");
    }
    // The front's right edge adjoins the left edge of the right face; its upper edge adjoins the lower edge of the
    // upper face.
    let corner = |cube: CubeFace, direction: DVec3| face.project(cube.face_from_cube() * direction).unwrap();
    let right = DVec3::new(1.0, 0.4, 1.0);
    assert!(corner(CubeFace::Front, right).distance(DVec2::new(1000.0, 700.0)) < 1e-9);
    assert!(corner(CubeFace::Right, right).distance(DVec2::new(0.0, 700.0)) < 1e-9);
    let up = DVec3::new(0.4, -1.0, 1.0);
    assert!(corner(CubeFace::Front, up).distance(DVec2::new(700.0, 0.0)) < 1e-9);
    assert!(corner(CubeFace::Up, up).distance(DVec2::new(700.0, 1000.0)) < 1e-9);
    let down = DVec3::new(0.4, 1.0, 1.0);
    assert!(corner(CubeFace::Down, down).distance(DVec2::new(700.0, 0.0)) < 1e-9);
}

/// A point by hand, for each model: the numbers follow from the formulas of OpenCV's documentation.
#[test]
fn the_coefficients_are_in_the_order_of_open_cv() {
    let (center, point) = (DVec2::new(10.0, 20.0), DVec3::new(0.6, -0.4, 2.0));
    let (x, y, r2): (f64, f64, f64) = (0.3, -0.2, 0.13);
    let p = [0.01, -0.02];
    let (tx, ty) = (2.0 * p[0] * x * y + p[1] * (r2 + 2.0 * x * x), p[0] * (r2 + 2.0 * y * y) + 2.0 * p[1] * x * y);
    let brown = 1.0 + 0.1 * r2 + 0.2 * r2 * r2 + 0.3 * r2.powi(3) + 0.4 * r2.powi(4);
    let rational =
        (1.0 + 0.1 * r2 + 0.2 * r2 * r2 + 0.3 * r2.powi(3)) / (1.0 + 0.4 * r2 + 0.5 * r2 * r2 + 0.6 * r2.powi(3));
    for (distortion, radial) in [
        (Distortion::Brown { k: [0.1, 0.2, 0.3, 0.4], p }, brown),
        (Distortion::OpenCv { k: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], p }, rational),
    ] {
        let camera = Camera::pinhole([100, 100], DVec2::new(50.0, 60.0), center, distortion).unwrap();
        let expected = center + DVec2::new(50.0 * (x * radial + tx), 60.0 * (y * radial + ty));
        assert!(camera.project(point).unwrap().distance(expected) < 1e-12);
    }
}

#[test]
fn invalid_camera_parameters_are_refused() {
    let pinhole = |size, focal| Camera::pinhole(size, DVec2::splat(focal), DVec2::ZERO, Distortion::None);
    assert_eq!(pinhole([0, 5], 1.0), Err(CameraError::Empty));
    assert_eq!(pinhole([5, 5], 0.0), Err(CameraError::NotPositive));
    assert_eq!(pinhole([5, 5], -1.0), Err(CameraError::NotPositive));
    assert_eq!(pinhole([5, 5], f64::NAN), Err(CameraError::NotFinite));
    let distortion = Distortion::Brown { k: [0.0, f64::INFINITY, 0.0, 0.0], p: [0.0; 2] };
    assert_eq!(Camera::pinhole([5, 5], DVec2::ONE, DVec2::ZERO, distortion), Err(CameraError::NotFinite));
}

#[test]
fn a_posed_camera_looks_from_its_place() {
    let camera = Camera::pinhole([100, 100], DVec2::splat(50.0), DVec2::splat(50.0), Distortion::None).unwrap();
    // It stands at (5, 0, 0) and looks along +x of the world, whose z is up.
    let world_from_camera = Pose {
        rotation: DQuat::from_mat3(&glam::DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X)),
        translation: DVec3::new(5.0, 0.0, 0.0),
    };
    let posed = PosedCamera { camera, camera_from_world: world_from_camera.inverse() };
    assert!(posed.position().distance(DVec3::new(5.0, 0.0, 0.0)) < 1e-12);
    assert!(posed.forward().distance(DVec3::X) < 1e-12);
    // To the left and up.
    let seen = posed.project(DVec3::new(15.0, 2.0, 1.0)).unwrap();
    assert!(seen.distance(DVec2::new(40.0, 45.0)) < 1e-9, "{seen}");
    assert!(posed.ray(seen).unwrap().distance(DVec3::new(10.0, 2.0, 1.0).normalize()) < 1e-12);
    assert!((posed.pixel_length(DVec3::new(15.0, 0.0, 0.0)).unwrap() - 0.2).abs() < 1e-12);
    assert_eq!(posed.project(DVec3::new(4.0, 0.0, 0.0)), None);
}
