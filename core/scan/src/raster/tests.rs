use super::*;
use crate::camera::{Camera, Distortion};
use glam::{DMat3, DVec2, DVec3, Vec3};

fn window(size: [u32; 2], focal: f64) -> Window {
    let center = DVec2::new(size[0].into(), size[1].into()) * 0.5;
    Window { window_from_camera: DMat3::IDENTITY, focal, center, size }
}

/// The depth at which a ray from the origin along `d` meets a triangle.
fn depth_along_ray([a, b, c]: [DVec3; 3], d: DVec3) -> Option<f64> {
    let normal = (b - a).cross(c - a);
    let t = normal.dot(a) / normal.dot(d);
    let p = d * t;
    let inside = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal) > 1e-6 * normal.length_squared();
    (t > 0.0 && inside(a, b, p) && inside(b, c, p) && inside(c, a, p)).then_some(t * d.z)
}

#[test]
fn depths_match_ray_casting_even_for_triangles_that_reach_behind_the_camera() {
    let mut random = fastrand::Rng::with_seed(7);
    let window = window([40, 30], 25.0);
    let mut point = || Vec3::from_array(std::array::from_fn(|_| random.f32() * 8.0 - 4.0));
    for _ in 0..300 {
        let triangles: Vec<[Vec3; 3]> = (0..3).map(|_| [point(), point(), point()]).collect();
        let mut raster = Raster::<[f32; 1]>::new(window);
        for (number, corners) in triangles.iter().enumerate() {
            raster.draw(*corners, [[number as f32]; 3]);
        }
        let mut misses = 0;
        for (x, y) in (0..30).flat_map(|y| (0..40).map(move |x| (x, y))) {
            let ray = window.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
            let hits = triangles
                .iter()
                .enumerate()
                .filter_map(|(k, t)| Some((depth_along_ray(t.map(Vec3::as_dvec3), ray)?, k)));
            let Some((depth, number)) = hits.min_by(|a, b| a.0.total_cmp(&b.0)) else {
                continue;
            };
            if depth < 0.002 {
                continue;
            }
            let drawn = f64::from(raster.depth(x, y));
            // Single precision is not enough for triangles seen almost edge-on.
            let same = (drawn - depth).abs() < 2e-3 * depth
                && raster.value(x, y).is_some_and(|[value]| value.round() == number as f32);
            misses += u32::from(!same);
        }
        assert!(misses <= 6, "{misses} of 1200 pixels");
    }
}

#[test]
fn value_interpolation_is_perspective_correct() {
    let mut raster = Raster::<[f32; 1]>::new(window([100, 100], 50.0));
    // A floor that recedes; the value is the depth.
    let corners = [Vec3::new(-50.0, 1.0, 1.0), Vec3::new(50.0, 1.0, 1.0), Vec3::new(0.0, 1.0, 200.0)];
    raster.draw(corners, corners.map(|corner| [corner.z]));
    let mut seen = 0;
    for y in 50..100 {
        if let Some([value]) = raster.value(50, y) {
            seen += 1;
            assert!((value - raster.depth(50, y)).abs() < 1e-3 * value, "{value} {}", raster.depth(50, y));
        }
    }
    assert!(seen > 40);
    assert!(raster.value(50, 10).is_none() && raster.depth(50, 10).is_infinite());
}

#[test]
fn a_mesh_without_holes_has_none_in_its_picture() {
    let mut random = fastrand::Rng::with_seed(3);
    let n = 60;
    let mut at = |i: usize, j: usize| {
        let z = 5.0 + random.f32();
        Vec3::new((i as f32 / 20.0 - 1.5) * z, (j as f32 / 20.0 - 1.5) * z, z)
    };
    let grid: Vec<Vec<Vec3>> = (0..n).map(|j| (0..n).map(|i| at(i, j)).collect()).collect();
    let mut raster = Raster::<()>::new(window([301, 299], 120.0));
    for j in 1..n {
        for i in 1..n {
            let [a, b, c, d] = [grid[j - 1][i - 1], grid[j - 1][i], grid[j][i], grid[j][i - 1]];
            raster.draw([a, b, c], [(); 3]);
            raster.draw([a, c, d], [(); 3]);
        }
    }
    assert!((0..299).all(|y| (0..301).all(|x| raster.depth(x, y).is_finite())));
}

#[test]
fn windows_cover_everything_that_a_camera_sees() {
    let size = [640, 480];
    let half = DVec2::new(320.0, 240.0);
    let brown = Distortion::Brown { k: [-0.2, 0.05, 0.0, 0.0], p: [0.001, -0.002] };
    let fisheye = Distortion::Fisheye { k: [0.02, 0.0, 0.0, 0.0], p: [0.0; 2] };
    let cameras = [
        (Camera::pinhole(size, DVec2::splat(500.0), half, brown), 1),
        (Camera::pinhole(size, DVec2::splat(500.0), half * 0.3, Distortion::None), 1),
        (Camera::pinhole(size, DVec2::splat(300.0), half, fisheye), 5),
        (Camera::equirectangular([1024, 512]), 6),
    ];
    let mut random = fastrand::Rng::with_seed(5);
    for (camera, count) in cameras {
        let camera = camera.expect("a camera");
        let windows = windows(&camera, 0.5, u32::MAX);
        assert_eq!(windows.len(), count, "{camera:?}");
        for _ in 0..3000 {
            let [width, height] = camera.size().map(f64::from);
            let pixel = DVec2::new(random.f64() * width, random.f64() * height);
            let Some(ray) = camera.ray(pixel) else { continue };
            let shown = windows.iter().filter(|window| window.project(window.window_from_camera * ray).is_some());
            assert!(shown.count() >= 1, "{pixel} of {camera:?}");
            assert!(windows.iter().any(|window| window.may_show(ray * 3.0, 0.01)));
        }
    }
    let camera = Camera::equirectangular([8192, 4096]).expect("a camera");
    let pixels: u32 = windows(&camera, 1.0, 1_000_000).iter().map(|w| w.size[0] * w.size[1]).sum();
    assert!(pixels < 1_010_000, "{pixels}");
}

#[test]
fn spheres_outside_the_view_are_culled() {
    let window = window([100, 100], 100.0);
    assert!(window.may_show(DVec3::new(0.0, 0.0, 5.0), 0.1));
    assert!(!window.may_show(DVec3::new(0.0, 0.0, -5.0), 0.1));
    assert!(!window.may_show(DVec3::new(10.0, 0.0, 5.0), 0.1));
    assert!(window.may_show(DVec3::new(3.0, 0.0, 5.0), 1.0));
    assert!(window.may_show(DVec3::new(0.0, 0.0, -5.0), 6.0));
}

#[test]
fn edges_lie_at_depth_discontinuities_and_not_on_slopes() {
    let mut raster = Raster::<()>::new(window([80, 60], 60.0));
    let quad = |raster: &mut Raster<()>, corners: [Vec3; 4]| {
        raster.draw([corners[0], corners[1], corners[2]], [(); 3]);
        raster.draw([corners[0], corners[2], corners[3]], [(); 3]);
    };
    // A slanting wall over the whole picture, and a board in front of its right half.
    let wall =
        [(-40.0, 40.0), (40.0, 40.0), (40.0, -40.0), (-40.0, -40.0)].map(|(x, y)| Vec3::new(x, y, 50.0 + 0.2 * x));
    quad(&mut raster, wall);
    let edges = Edges::of(&raster, 0.01);
    assert!((0..60).all(|y| (0..80).all(|x| edges.distance(x, y) > 20.0)));
    let board = [(0.5, 9.0), (9.0, 9.0), (9.0, -9.0), (0.5, -9.0)].map(|(x, y)| Vec3::new(x, y, 6.0));
    quad(&mut raster, board);
    let edges = Edges::of(&raster, 0.01);
    // Its border is at 40 + 60 · 0.5 / 6 = 45.
    for x in 10..80 {
        let expected = (f64::from(x) + 0.5 - 45.0).abs() - 0.5;
        assert!((f64::from(edges.distance(x, 30)) - expected).abs() < 0.01, "{x}: {}", edges.distance(x, 30));
    }
    assert_eq!(edges.distance(80, 30), 0.0);
}
