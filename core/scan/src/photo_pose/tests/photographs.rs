//! Photographs of a wall with relief and colours, under a light that the model does not know.

use crate::camera::{Camera, CameraModel, Distortion, PosedCamera};
use crate::photo_pose::predict::look;
use crate::photo_pose::{Grey, NotRefined, Options, Refined, RefusalReason, Shown, refine};
use crate::pose::Pose;
use crate::raster::{Raster, windows};
use glam::{DQuat, DVec2, DVec3, Vec3};
use std::convert::Infallible;

/// A closed room with relief, 8 m × 6 m × 4 m around the origin.
struct Room {
    triangles: Vec<([Vec3; 3], [Shown; 3])>,
}

/// Smooth noise between -1 and 1.
fn noise(seed: u32, p: DVec3) -> f64 {
    let cell = p.floor();
    let corner = |k: u32| {
        let at = cell + DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2));
        let mut h = seed.wrapping_mul(0x9e37_79b9);
        for v in at.to_array() {
            h = (h ^ v as i32 as u32).wrapping_mul(0x85eb_ca6b);
            h ^= h >> 13;
        }
        let share = (p - at).abs();
        let fade = |t: f64| (1.0 - t) * (1.0 - t) * (1.0 + 2.0 * t);
        fade(share.x) * fade(share.y) * fade(share.z) * (f64::from(h & 0xffff) / 32_767.5 - 1.0)
    };
    (0..8).map(corner).sum()
}

impl Room {
    fn new(seed: u32, has_colors: bool) -> Self {
        const N: u32 = 80;
        let mut triangles = Vec::new();
        let half = DVec3::new(4.0, 3.0, 2.0);
        for side in 0..6_u32 {
            let axis = (side / 2) as usize;
            let sign = if side % 2 == 0 { 1.0 } else { -1.0 };
            let place = |i: u32, j: u32| {
                let (u, v) = (2.0 * f64::from(i) / f64::from(N) - 1.0, 2.0 * f64::from(j) / f64::from(N) - 1.0);
                let mut at = DVec3::splat(sign);
                at[(axis + 1) % 3] = u;
                at[(axis + 2) % 3] = v;
                let at = at * half;
                let mut out = at;
                out[axis] += (0.12 * noise(seed, at * 1.7) + 0.06 * noise(seed + 2, at * 4.3))
                    * (1.0 - u.powi(8))
                    * (1.0 - v.powi(8));
                out
            };
            let vertex = |i: u32, j: u32| {
                let (i0, i1, j0, j1) = (i.saturating_sub(1), (i + 1).min(N), j.saturating_sub(1), (j + 1).min(N));
                let normal = (place(i1, j) - place(i0, j)).cross(place(i, j1) - place(i, j0)).normalize();
                let p = place(i, j);
                let light = if has_colors { (0.4 + 0.25 * noise(seed + 1, p * 4.0)) as f32 } else { f32::NAN };
                let n = normal.as_vec3();
                (p.as_vec3(), [light, f32::NAN, n.x, n.y, n.z])
            };
            for i in 0..N {
                for j in 0..N {
                    let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
                    for [p, q, r] in [[a, b, c], [a, c, d]] {
                        triangles.push(([p.0, q.0, r.0], [p.1, q.1, r.1]));
                    }
                }
            }
        }
        Self { triangles }
    }

    /// The same room in one colour.
    fn whitewashed(&self) -> Self {
        let white = |[_, intensity, x, y, z]: Shown| [0.6, intensity, x, y, z];
        Self { triangles: self.triangles.iter().map(|(corners, shown)| (*corners, shown.map(white))).collect() }
    }

    fn draw(&self, camera: &PosedCamera, scale: f64) -> Vec<Raster<Shown>> {
        let draw = |window: crate::raster::Window| {
            let mut raster = Raster::new(window);
            for (corners, shown) in &self.triangles {
                let at = |p: Vec3| window.window_from_camera * camera.camera_from_world.apply(p.as_dvec3());
                raster.draw(corners.map(|p| at(p).as_vec3()), *shown);
            }
            raster
        };
        windows(&camera.camera, scale, 1_000_000).into_iter().map(draw).collect()
    }

    /// A photograph under a light, with a vignette and noise.
    fn photograph(&self, camera: &PosedCamera) -> Grey {
        let rasters = self.draw(camera, 1.0);
        let sun = DVec3::new(0.5, 0.3, 0.8).normalize();
        let mut random = fastrand::Rng::with_seed(9);
        let [width, height] = camera.camera.size().map(f64::from);
        Grey::from_fn(camera.camera.size(), |x, y| {
            let pixel = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            let Some(ray) = camera.camera.ray(pixel) else { return 0.0 };
            let Some((_, [light, _, nx, ny, nz])) = rasters.iter().find_map(|raster| look(raster, ray)) else {
                return 0.0;
            };
            let normal = DVec3::new(nx.into(), ny.into(), nz.into());
            let shading = 0.35 + 0.5 * normal.dot(sun).abs() + 0.1 * normal.z;
            let off = (pixel - DVec2::new(width, height) * 0.5) / width;
            let value = f64::from(light) * shading * (1.0 - 0.5 * off.length_squared());
            (value + 0.01 * (random.f64() - 0.5)).max(0.0) as f32
        })
    }
}

fn pinhole() -> Camera {
    let brown = Distortion::Brown { k: [-0.08, 0.02, 0.0, 0.0], p: [0.0; 2] };
    Camera::pinhole([320, 240], DVec2::splat(260.0), DVec2::new(158.0, 121.0), brown).unwrap()
}

fn posed(camera: Camera, look: DQuat, at: DVec3) -> PosedCamera {
    PosedCamera { camera, camera_from_world: Pose { rotation: look, translation: -(look * at) } }
}

/// Turned and moved: places 4 m away shift by about `pixels` of a pinhole.
fn disturbed(truth: &PosedCamera, pixels: f64) -> PosedCamera {
    let angle = pixels / 260.0;
    let turn = DQuat::from_scaled_axis(DVec3::new(0.6, -0.5, 0.8) * angle);
    let pose = truth.camera_from_world;
    let translation = turn * pose.translation + DVec3::new(0.5, 0.4, -0.7) * (2.0 * angle);
    PosedCamera { camera_from_world: Pose { rotation: (turn * pose.rotation).normalize(), translation }, ..*truth }
}

/// Where places that the truth sees are seen instead, pixels (root mean square).
fn error(truth: &PosedCamera, found: &PosedCamera, room: &Room) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for (corners, _) in room.triangles.iter().step_by(37) {
        let place = corners[0].as_dvec3();
        if let (Some(a), Some(b)) = (truth.project(place), found.project(place))
            && truth.camera.contains(a)
        {
            let width = f64::from(truth.camera.size()[0]);
            let mut offset = a - b;
            if truth.camera.max_angle() > 3.0 {
                offset.x -= (offset.x / width).round() * width;
            }
            sum += offset.length_squared();
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

fn run(room: &Room, start: &PosedCamera, picture: &Grey, options: &Options) -> Result<Refined, Box<NotRefined>> {
    let mut render = |camera: &PosedCamera, scale: f64| Ok::<_, Infallible>(room.draw(camera, scale));
    match refine(start, picture, 1.0, &mut render, options) {
        Ok(result) => result,
        Err(never) => match never {},
    }
}

fn looking() -> PosedCamera {
    posed(pinhole(), DQuat::from_rotation_y(-0.5) * DQuat::from_rotation_x(0.2), DVec3::new(-1.0, 0.5, -0.8))
}

#[test]
fn a_photograph_finds_its_pose_also_where_the_model_has_no_colours() {
    let full = Room::new(1, true);
    let truth = looking();
    let picture = full.photograph(&truth);
    let start = disturbed(&truth, 11.0);
    assert!(error(&truth, &start, &full) > 5.0);
    // Whitewash: only its relief is seen.
    let white = full.whitewashed();
    let bare = white.photograph(&truth);
    let plain = Room::new(1, false);
    for (room, picture, limit) in [(&full, &picture, 0.1), (&plain, &bare, 0.3)] {
        let refined = run(room, &start, picture, &Options::default()).unwrap();
        let error = error(&truth, &refined.camera, room);
        assert!(error < limit, "{error} {refined:?}");
        assert!(refined.quality.share > 0.5 && refined.quality.residual_px < 2.0, "{refined:?}");
        assert!(refined.moved_px > 2.0);
    }
}

#[test]
fn a_person_and_a_mask_do_not_matter() {
    let room = Room::new(1, true);
    let truth = looking();
    let picture = room.photograph(&truth);
    let hidden = Grey::from_fn(picture.size(), |x, y| match (x, y) {
        (60..110, 60..) => 0.1 + 0.3 * f32::from(u8::from((x / 5 + y / 7) % 2 == 0)),
        (200..260, 100..150) => f32::NAN,
        _ => picture.at(x as usize, y as usize),
    });
    let refined = run(&room, &disturbed(&truth, 11.0), &hidden, &Options::default()).unwrap();
    let error = error(&truth, &refined.camera, &room);
    assert!(error < 0.3, "{error} {refined:?}");
}

#[test]
fn what_cannot_be_refined_is_refused() {
    let room = Room::new(1, true);
    let truth = looking();
    let picture = room.photograph(&truth);
    // Far beyond the reach of 16 pixels; and another room.
    let far = disturbed(&truth, 90.0);
    let other = Room::new(77, true);
    for (start, picture) in [(&far, &picture), (&disturbed(&truth, 4.0), &other.photograph(&truth))] {
        let not = run(&room, start, picture, &Options::default()).unwrap_err();
        assert!(matches!(not.why, RefusalReason::Disagrees | RefusalReason::Little { .. }), "{not:?}");
        assert!(not.quality.share < 0.25, "{not:?}");
        assert!(not.to_string().contains("agree") || not.to_string().contains("too little"), "{not}");
    }
    // Nothing of the model in sight.
    let away = posed(pinhole(), DQuat::IDENTITY, DVec3::new(0.0, 0.0, 50.0));
    let not = run(&room, &away, &picture, &Options::default()).unwrap_err();
    assert!(matches!(not.why, RefusalReason::Little { patches: 0 }), "{not:?}");
    // A picture without contrast.
    let blank = Grey::from_fn([320, 240], |_, _| 0.5);
    let not = run(&room, &truth, &blank, &Options::default()).unwrap_err();
    assert!(matches!(not.why, RefusalReason::Little { .. }), "{not:?}");
    // Pictures of other sizes.
    let small = picture.halved().unwrap();
    let not = run(&room, &truth, &small, &Options::default()).unwrap_err();
    assert_eq!(not.why, RefusalReason::Size { picture: [160, 120], expected: [320, 240] });
    let tiny = Camera::pinhole([60, 50], DVec2::splat(50.0), DVec2::new(30.0, 25.0), Distortion::None).unwrap();
    let tiny = PosedCamera { camera: tiny, ..truth };
    let not = run(&room, &tiny, &Grey::from_fn([60, 50], |_, _| 0.0), &Options::default()).unwrap_err();
    assert_eq!(not.why, RefusalReason::Small);
    assert!(not.to_string().contains("too small"), "{not}");
}

/// A flat wall of equal tiles.
fn tiles() -> Room {
    const N: u32 = 200;
    let vertex = |i: u32, j: u32| {
        let p = DVec3::new(f64::from(i) * 0.05 - 5.0, f64::from(j) * 0.05 - 5.0, 4.0);
        let wave = |x: f64| libm::sin(x * std::f64::consts::TAU / 0.5);
        let light = (0.5 + 0.3 * wave(p.x) * wave(p.y)) as f32;
        (p.as_vec3(), [light, f32::NAN, 0.0, 0.0, -1.0])
    };
    let mut triangles = Vec::new();
    for (i, j) in (0..N).flat_map(|i| (0..N).map(move |j| (i, j))) {
        let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
        triangles.extend([[a, b, c], [a, c, d]].map(|[p, q, r]| ([p.0, q.0, r.0], [p.1, q.1, r.1])));
    }
    Room { triangles }
}

#[test]
fn a_wall_of_equal_tiles_is_ambiguous() {
    let wall = tiles();
    let truth = posed(pinhole(), DQuat::from_rotation_y(0.1), DVec3::new(0.1, 0.2, 0.3));
    let not = run(&wall, &disturbed(&truth, 8.0), &wall.photograph(&truth), &Options::default()).unwrap_err();
    assert!(not.quality.rival > 0.85 && not.why == RefusalReason::Ambiguous, "{not:?}");
    assert!(not.to_string().contains("repeats"));
}

#[test]
fn a_panorama_finds_its_pose() {
    let room = Room::new(1, true);
    let camera = Camera::equirectangular([512, 256]).unwrap();
    let truth = posed(camera, DQuat::from_rotation_x(-1.5), DVec3::new(0.5, -0.4, 0.2));
    let picture = room.photograph(&truth);
    let start = disturbed(&truth, 14.0);
    let refined = run(&room, &start, &picture, &Options::default()).unwrap();
    let error = error(&truth, &refined.camera, &room);
    assert!(error < 0.3, "{error} {refined:?}");
}

#[test]
fn focal_length_and_principal_point_are_refined_if_asked() {
    let room = Room::new(1, true);
    let truth = looking();
    let picture = room.photograph(&truth);
    let CameraModel::Pinhole { focal, center, skew, distortion } = *truth.camera.model() else { panic!() };
    let model = CameraModel::Pinhole { focal: focal * 1.03, center: center + 3.0, skew, distortion };
    let start = PosedCamera { camera: Camera::new([320, 240], model).unwrap(), ..disturbed(&truth, 4.0) };
    let pose_only = run(&room, &start, &picture, &Options::default());
    let refined = run(&room, &start, &picture, &Options { calibrate: true, ..Options::default() }).unwrap();
    let CameraModel::Pinhole { focal: found, .. } = *refined.camera.camera.model() else { panic!() };
    assert!((found.x / focal.x - 1.0).abs() < 0.01, "{found}");
    let after = error(&truth, &refined.camera, &room);
    let before = pose_only.map_or(f64::INFINITY, |refined| error(&truth, &refined.camera, &room));
    assert!(after < 0.5 && after < before, "{after} {before}");
}

#[test]
fn the_same_photograph_at_half_the_size_gives_almost_the_same_pose() {
    let room = Room::new(1, true);
    let truth = looking();
    let picture = room.photograph(&truth).halved().unwrap();
    let mut render = |camera: &PosedCamera, scale: f64| Ok::<_, Infallible>(room.draw(camera, scale));
    let options = Options { max_sigma: 3.0, ..Options::default() };
    let Ok(refined) = refine(&disturbed(&truth, 5.0), &picture, 2.0, &mut render, &options);
    let refined = refined.unwrap();
    let error = error(&truth, &refined.camera, &room);
    assert!(error < 0.8, "{error} {refined:?}");
}
