//! Properties of each mode; the oracle is the ray-caster or the picture of another setting.

use super::*;
use kilwa_viewer::Image;
use kilwa_viewer::colormap::{NO_VALUE, viridis};
use kilwa_viewer::gpu::pool::ShownScalar;
use kilwa_viewer::options::{Light, Scale};

const CENTER: IVec3 = IVec3::splat(1 << 20);
const RADIUS: f64 = 50_000.0;
const SIZE: [u32; 2] = [96, 96];

/// One chunk on the GPU, drawn whole.
struct Scenery {
    renderer: Renderer,
    draw: Vec<DrawPatch>,
    chunks: BTreeMap<u32, Chunk>,
}

impl Scenery {
    fn new(chunk: Chunk) -> Self {
        let mut renderer = Renderer::headless(&gpu());
        renderer.upload(0, &interleave(&chunk));
        let draw = (0..chunk.patches.len() as u32).map(|k| draw_patch(0, k, &chunk.patches[k as usize])).collect();
        Self { renderer, draw, chunks: BTreeMap::from([(0, chunk)]) }
    }

    fn image(&mut self, view: &View, options: &RenderOptions) -> Image {
        pollster::block_on(self.renderer.image(view, &self.draw, options)).expect("reads back")
    }

    fn scene(&self) -> Scene {
        scene(&self.chunks, &self.draw)
    }
}

fn view_from(standard: StandardView, distance: f64, size: [u32; 2]) -> View {
    let lattice = kilwa_geometry::Lattice { origin: DVec3::ZERO, step_log2: 0 };
    let at = CENTER.as_dvec3();
    let bounds = Bounds { min: at - RADIUS * 1.1, max: at + RADIUS * 1.1 };
    let mut camera = Camera::standard(standard, &bounds, size);
    camera.orthographic = false;
    camera.distance = distance * RADIUS;
    camera.view(&lattice, &bounds, size, 1.0)
}

fn options(mode: Mode) -> RenderOptions {
    let background = Background::Flat([0, 0, 0]);
    RenderOptions { mode, background, shading: 0.0, mark_back_faces: false, ..RenderOptions::default() }
}

fn at(image: &Image, x: u32, y: u32) -> [f64; 3] {
    let k = (y * image.size[0] + x) as usize * 4;
    std::array::from_fn(|i| f64::from(image.pixels[k + i]))
}

fn linear(c: [f64; 3]) -> [f64; 3] {
    c.map(|x| kilwa_geometry::color::decode(x / 255.0))
}

fn light_of(image: &Image, pixels: impl Iterator<Item = (u32, u32)>) -> f64 {
    let values: Vec<f64> = pixels.map(|(x, y)| linear(at(image, x, y))[1]).collect();
    values.iter().sum::<f64>() / values.len() as f64
}

/// Pixels of a part of the picture, in shares of its size.
fn part(size: [u32; 2], x: [f64; 2], y: [f64; 2]) -> impl Iterator<Item = (u32, u32)> {
    let range = move |r: [f64; 2], n: u32| (r[0] * f64::from(n)) as u32..(r[1] * f64::from(n)) as u32;
    range(y, size[1]).flat_map(move |v| range(x, size[0]).map(move |u| (u, v)))
}

/// Flat squares of `half` steps round places before the south view (y is the depth), each one patch.
fn squares(places: &[(IVec3, i32)], tilt: i32) -> Chunk {
    let mut chunk = Chunk::default();
    for (first, (center, half)) in (0..).step_by(2).zip(places) {
        let base = chunk.mesh.positions.len() as u32;
        for (x, z) in [(-1, -1), (1, -1), (1, 1), (-1, 1)] {
            chunk.mesh.positions.push(*center + IVec3::new(x * half, (x + z) * tilt, z * half));
            chunk.mesh.normals.push(normal::encode(DVec3::NEG_Y));
            chunk.mesh.colors.push([180, 180, 180]);
        }
        chunk.mesh.triangles.extend([[base, base + 1, base + 2], [base, base + 2, base + 3]]);
        chunk.patches.push(PatchRange { first, count: 2, diamond: NO_DIAMOND });
    }
    chunk.mesh.borders = vec![0; chunk.mesh.triangles.len()];
    chunk
}

#[test]
fn raking_light_brightens_faces_towards_it_and_darkens_others() {
    let mut ball = Scenery::new(ball_with_bumps(CENTER, RADIUS, 40, 0.0));
    let plan = view_from(StandardView::Plan, 4.0, SIZE);
    let (west, east) = ([0.34, 0.42], [0.58, 0.66]);
    let (north, south) = ([0.34, 0.42], [0.58, 0.66]);
    let middle = [0.45, 0.55];
    for (azimuth, bright, dark) in [
        (90.0, (east, middle), (west, middle)),
        (270.0, (west, middle), (east, middle)),
        (0.0, (middle, north), (middle, south)),
    ] {
        let light = Light { azimuth: f64::to_radians(azimuth), elevation: 0.2, with_view: false };
        let image = ball.image(&plan, &RenderOptions { light, ..options(Mode::Raking) });
        let towards = light_of(&image, part(SIZE, bright.0, bright.1));
        let away = light_of(&image, part(SIZE, dark.0, dark.1));
        assert!(towards > 3.0 * away, "from {azimuth}: {towards} towards the light, {away} away from it");
        // On the scan's colours only the brightness changes: the hue is the scan's.
        let colored = ball.image(&plan, &RenderOptions { light, on_color: true, ..options(Mode::Raking) });
        let [r, g, b] = linear(at(&colored, 48, 48));
        let [br, bg, bb] = linear([200.0, 180.0, 150.0]);
        assert!((r / g - br / bg).abs() < 0.05 && (b / g - bb / bg).abs() < 0.05, "{r} {g} {b}");
    }
    // Relative to the view: from the left of the picture, for any camera.
    let light = Light { azimuth: f64::to_radians(270.0), elevation: 0.2, with_view: true };
    for standard in [StandardView::Plan, StandardView::North, StandardView::East] {
        let image = ball.image(&view_from(standard, 4.0, SIZE), &RenderOptions { light, ..options(Mode::Raking) });
        let left = light_of(&image, part(SIZE, [0.34, 0.42], middle));
        assert!(left > 3.0 * light_of(&image, part(SIZE, [0.58, 0.66], middle)), "{standard:?}");
    }
}

#[test]
fn a_headlight_is_brightest_where_the_surface_faces_the_eye() {
    let mut ball = Scenery::new(ball_with_bumps(CENTER, RADIUS, 40, 0.0));
    for standard in [StandardView::Plan, StandardView::South, StandardView::Iso] {
        let image = ball.image(&view_from(standard, 4.0, SIZE), &options(Mode::Headlight));
        let middle = light_of(&image, part(SIZE, [0.47, 0.53], [0.47, 0.53]));
        for side in [[0.19, 0.22], [0.78, 0.81]] {
            let edge = light_of(&image, part(SIZE, side, [0.47, 0.53]));
            assert!(middle > 1.2 * edge, "{standard:?}: {middle} in the middle, {edge} at the side");
        }
    }
}

#[test]
fn height_and_distance_colours_depend_only_on_the_value() {
    let mut ball = Scenery::new(ball(CENTER, RADIUS, 40));
    let oracle = ball.scene();
    let tilted = {
        let l = 14f64.sqrt();
        DVec3::new(1.0, -2.0, 3.0) / l
    };
    for (mode, normal) in [(Mode::Height, DVec3::Z), (Mode::Distance, tilted)] {
        let offset = normal.dot(CENTER.as_dvec3());
        let scale = Scale { normal, offset, range: [-40_000.0, 45_000.0] };
        for standard in [StandardView::Plan, StandardView::South, StandardView::Iso] {
            let view = view_from(standard, 3.0, SIZE);
            let image = ball.image(&view, &RenderOptions { scale, ..options(mode) });
            let mut compared = 0;
            for (x, y) in part(SIZE, [0.2, 0.8], [0.2, 0.8]) {
                let pixel = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                let ring: Vec<_> = probes_at(pixel, 0.8).filter_map(|p| oracle.cast(&view, p)).collect();
                let Some(hit) = oracle.cast(&view, pixel).filter(|_| ring.len() == 8) else { continue };
                let (origin, way) = Scene::ray(&view, pixel);
                let distance = (0..3).map(|i| normal[i] * (origin[i] + way[i] * hit.depth)).sum::<f64>() - offset;
                let expected = viridis((distance + 40_000.0) / 85_000.0);
                // Pixels of one surface: at folds four samples may show two.
                if ring.iter().any(|h| (h.depth - hit.depth).abs() > 4_000.0) {
                    continue;
                }
                compared += 1;
                let seen = at(&image, x, y);
                let off = (0..3).map(|i| (seen[i] - expected[i]).abs()).fold(0.0, f64::max);
                assert!(off <= 6.0, "{mode:?} {standard:?} at {x}, {y}: {seen:?}, not {expected:?}");
            }
            assert!(compared > 500, "{compared} pixels compared");
        }
    }
}

fn probes_at(pixel: [f64; 2], r: f64) -> impl Iterator<Item = [f64; 2]> {
    (0..8).map(move |k| {
        let (s, c) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
        [pixel[0] + c * r, pixel[1] + s * r]
    })
}

#[test]
fn scalars_have_the_colours_of_their_scale_and_missing_values_are_grey() {
    // A square whose scalar grows to the right, and one that has no values.
    let IVec3 { x, y, z } = CENTER;
    let mut chunk = squares(&[(IVec3::new(x - 16_000, y, z), 15_000), (IVec3::new(x + 16_000, y, z), 15_000)], 0);
    chunk.mesh.scalars = vec![vec![0.0; 8], vec![2.0, 6.0, 6.0, 2.0, f32::NAN, f32::NAN, f32::NAN, f32::NAN]];
    let view = view_from(StandardView::South, 3.0, SIZE);
    let mut wall = Scenery::new(chunk.clone());
    let before = wall.image(&view, &options(Mode::Scalar));
    let none = NO_VALUE.map(f64::from);
    let near = |a: [f64; 3], b: [f64; 3]| (0..3).all(|i| (a[i] - b[i]).abs() <= 3.0);
    assert!(near(at(&before, 36, 48), none), "a model without scalars is grey: {:?}", at(&before, 36, 48));
    assert!(wall.renderer.set_scalar(Some(ShownScalar { channel: 1, min: 2.0, max: 6.0 })));
    wall.renderer.upload_scalars(0, &interleave(&chunk));
    let oracle = wall.scene();
    for scalar_range in [[0.0, 1.0], [0.25, 0.5]] {
        let image = wall.image(&view, &RenderOptions { scalar_range, ..options(Mode::Scalar) });
        let mut seen = [0, 0];
        for (u, v) in part(SIZE, [0.2, 0.8], [0.45, 0.55]) {
            let pixel = [f64::from(u) + 0.5, f64::from(v) + 0.5];
            let Some(hit) = oracle.cast(&view, pixel) else { continue };
            if probes_at(pixel, 0.8).any(|p| oracle.cast(&view, p).is_none_or(|h| h.id != hit.id)) {
                continue;
            }
            let (origin, way) = Scene::ray(&view, pixel);
            let along = (origin[0] + way[0] * hit.depth - f64::from(x - 31_000)) / 30_000.0;
            let share = (along - f64::from(scalar_range[0])) / f64::from(scalar_range[1] - scalar_range[0]);
            let expected = if hit.id == 0 { viridis(share) } else { none };
            assert!(near(at(&image, u, v), expected), "{u}: {:?}, not {expected:?}", at(&image, u, v));
            seen[hit.id as usize] += 1;
        }
        assert!(seen.iter().all(|n| *n > 50), "{seen:?}");
    }
    // Given back, it costs nothing.
    let held = wall.renderer.chunk_bytes();
    assert!(wall.renderer.set_scalar(None));
    wall.renderer.upload_scalars(0, &interleave(&chunk));
    assert_eq!(wall.renderer.chunk_bytes(), held - 8 * 4);
}

#[test]
fn eye_dome_lighting_darkens_behind_depth_steps_and_leaves_planes_as_they_are() {
    let IVec3 { x, y, z } = CENTER;
    for orthographic in [false, true] {
        let mut view = view_from(StandardView::South, 3.0, SIZE);
        if orthographic {
            let half_height = 50_000.0;
            view.projection = kilwa_stream::Projection::Orthographic { half_height };
            (view.near, view.far) = (1.0, 400_000.0);
        }
        for tilt in [0, 9_000, 25_000] {
            let mut plane = Scenery::new(squares(&[(CENTER, 40_000)], tilt));
            let plain = plane.image(&view, &RenderOptions { strength: 0.0, ..options(Mode::EyeDome) });
            let strong = plane.image(&view, &RenderOptions { strength: 1.0, ..options(Mode::EyeDome) });
            assert!(at(&plain, 48, 48)[0] > 30.0, "the plane is there");
            assert!(plain == strong, "a plane tilted by {tilt} is not neutral (orthographic: {orthographic})");
        }
        // A small square before a large one.
        let mut step = Scenery::new(squares(&[(CENTER, 45_000), (IVec3::new(x, y - 20_000, z), 15_000)], 0));
        let ids = pollster::block_on(step.renderer.ids(&view, &step.draw, None)).expect("reads back");
        let plain = step.image(&view, &RenderOptions { strength: 0.0, ..options(Mode::EyeDome) });
        let strong = step.image(&view, &RenderOptions { strength: 1.0, radius: 4.0, ..options(Mode::EyeDome) });
        let id = |u: i64, v: i64| ids.pixels[(v * 96 + u) as usize].0;
        let (mut beside, mut far, mut front) = (0, 0, 0);
        for (u, v) in part(SIZE, [0.25, 0.75], [0.25, 0.75]) {
            let (u, v) = (i64::from(u), i64::from(v));
            let round = |r: i64| (-r..=r).flat_map(move |a| (-r..=r).map(move |b| (a, b)));
            let others = |r: i64| round(r).any(|(a, b)| id(u + a, v + b) != id(u, v));
            let change = linear(at(&strong, u as u32, v as u32))[1] / linear(at(&plain, u as u32, v as u32))[1];
            match id(u, v) {
                // Whole pixels of the back square, right beside the front one.
                Some(0) if others(2) && !others(1) => {
                    beside += 1;
                    assert!(change < 0.75, "{change} beside the step at {u}, {v}");
                }
                Some(0) if !others(6) => {
                    far += 1;
                    assert!((change - 1.0).abs() < 0.02, "{change} far from the step at {u}, {v}");
                }
                Some(1) if !others(1) => {
                    front += 1;
                    assert!((change - 1.0).abs() < 0.02, "{change} in front of the step at {u}, {v}");
                }
                _ => {}
            }
        }
        assert!(beside > 40 && far > 100 && front > 100, "{beside} {far} {front}");
    }
}

#[test]
fn curvature_does_not_depend_on_tilt_or_distance() {
    let mut ball = Scenery::new(ball_with_bumps(CENTER, RADIUS, 80, 0.0));
    // On a ball of radius R the curvature times the feature is f / R everywhere.
    let feature = RADIUS / 5.0;
    let expected = (4.0 * 0.5 * 0.2 / (0.4 + 0.2f64)).exp2();
    for distance in [2.5, 4.0, 8.0] {
        for (inside, sign) in [(false, 1.0), (true, -1.0)] {
            let distance = if inside { 0.2 } else { distance };
            let view = view_from(StandardView::Iso, distance, [128, 128]);
            let plain = ball.image(&view, &RenderOptions { strength: 0.0, feature, ..options(Mode::Curvature) });
            let bent = ball.image(&view, &RenderOptions { strength: 0.5, feature, ..options(Mode::Curvature) });
            let mut compared = 0;
            for (x, y) in part([128, 128], [0.42, 0.58], [0.42, 0.58]) {
                let ratio = linear(at(&bent, x, y))[1] / linear(at(&plain, x, y))[1];
                let off = (ratio.log2() - sign * expected.log2()).abs() / expected.log2();
                assert!(off < 0.25, "from {distance} radii at {x}, {y}: {ratio} of {expected} to the {sign}");
                compared += 1;
            }
            assert!(compared > 300);
        }
    }
}

#[test]
fn every_mode_looks_the_same_at_a_coarser_level() {
    let raw = mesh(SiteKind::Fort, &SynthOptions::new(60_000)).expect("a fort");
    let world = World::build(raw, 400);
    let size = [240, 180];
    let budgets = Budgets { uploads: 64, ..Budgets::default() };
    let mut session = Session::open(SliceSource(world.bytes.clone()), &world.gpu, budgets).expect("opens");
    let camera = Camera::standard(StandardView::Iso, &world.bounds, size);
    for (mode, name) in Mode::ALL {
        if matches!(mode, Mode::Level | Mode::Error | Mode::Scalar) {
            continue; // They show the level, or what this scan has not.
        }
        let display = kilwa_viewer::Display {
            mode: name.to_owned(),
            background: "transparent".to_owned(),
            ..kilwa_viewer::Display::default()
        };
        let options = session.options(&display);
        let mut picture = |pixels: f64| {
            let view = session.view(&camera, size, pixels);
            session.render(&view, &options).expect("renders")
        };
        let ((fine, a), (coarse, b)) = (picture(1.0), picture(4.0));
        assert!(a.triangles_drawn as f64 > 1.5 * b.triangles_drawn as f64, "two levels");
        // Pixels that both show whole.
        let both =
            fine.pixels.chunks_exact(4).zip(coarse.pixels.chunks_exact(4)).filter(|(f, c)| f[3] == 255 && c[3] == 255);
        let (mut sums, mut count) = ([[0.0; 3]; 2], 0.0);
        for (f, c) in both {
            count += 1.0;
            for i in 0..3 {
                sums[0][i] += f64::from(f[i]);
                sums[1][i] += f64::from(c[i]);
            }
        }
        let off = (0..3).map(|i| (sums[0][i] - sums[1][i]).abs() / count).fold(0.0, f64::max);
        println!("{name}: mean colour differs by {off:.2} of 255 over {count} pixels");
        assert!(count > 5_000.0 && off < 4.0, "{name}: the mean colour differs by {off}");
    }
}

#[test]
fn tiles_of_modes_that_sample_neighbours_have_no_seams() {
    let mut ball = Scenery::new(ball(CENTER, RADIUS, 40));
    let view = view_from(StandardView::Iso, 2.2, [150, 100]);
    for mode in [Mode::Curvature, Mode::EyeDome] {
        let options = RenderOptions { feature: RADIUS / 8.0, strength: 1.0, ..options(mode) };
        let whole = ball.image(&view, &options);
        for top in (0..100).step_by(34) {
            for left in (0..150).step_by(64) {
                let size = [64.min(150 - left), 34.min(100 - top)];
                let tile = Some(Tile { offset: [left, top], size });
                let part = ball.image(&view, &RenderOptions { tile, ..options });
                let off = |k: u32| {
                    let (x, y) = (k % size[0], k / size[0]);
                    let (a, b) = (at(&part, x, y), at(&whole, left + x, top + y));
                    (0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
                };
                let differ = (0..size[0] * size[1]).filter(|k| off(*k) > 2.0).count();
                assert!(differ <= 3, "{mode:?}: {differ} pixels of the tile at {left}, {top} differ");
            }
        }
    }
}

#[test]
fn during_a_fade_every_pixel_shows_one_of_the_levels() {
    let mut two = Scenery::new(squares(&[(CENTER, 40_000), (CENTER, 40_000)], 0));
    for color in &mut two.chunks.get_mut(&0).expect("there").mesh.colors[4..] {
        *color = [10, 60, 200];
    }
    let chunk = two.chunks[&0].clone();
    two.renderer.upload(0, &interleave(&chunk));
    let view = view_from(StandardView::South, 3.0, SIZE);
    let options = options(Mode::Color);
    for share in [0.0, 0.25, 0.5, 0.9, 1.0] {
        // The second square comes while the first one leaves.
        let fades = [[share, 1.0], [0.0, share]];
        let image =
            pollster::block_on(two.renderer.image_fading(&view, &two.draw, &fades, &options)).expect("reads back");
        let (mut old, mut new) = (0, 0);
        for (x, y) in part(SIZE, [0.3, 0.7], [0.3, 0.7]) {
            match at(&image, x, y).map(f64::round) {
                [r, ..] if (r - 180.0).abs() <= 1.0 => old += 1,
                [r, _, b] if (r - 10.0).abs() <= 1.0 && (b - 200.0).abs() <= 1.0 => new += 1,
                other => panic!("{other:?} at {x}, {y} is neither of them"),
            }
        }
        let seen = f64::from(new) / f64::from(old + new);
        assert!((seen - f64::from(share)).abs() < 0.03, "{seen} of the pixels have changed, not {share}");
    }
}

#[test]
fn the_picture_is_the_same_far_from_the_origin_of_the_reference_system() {
    // 10,000 km out, as far as no projected system goes: places on a grid of 1/1024 m, exact in f64 at both places.
    let mut raw = mesh(SiteKind::Fort, &SynthOptions::new(20_000)).expect("a fort");
    for p in &mut raw.positions {
        *p = p.map(|x| (x * 1024.0).round() / 1024.0);
    }
    let mut pictures: Vec<Vec<Image>> = Vec::new();
    for offset in [0.0, 1e7] {
        let mut moved = RawMesh { positions: raw.positions.clone(), ..raw.clone() };
        for p in &mut moved.positions {
            *p += offset;
        }
        let world = World::build(moved, 400);
        let size = [200, 150];
        let mut session =
            Session::open(SliceSource(world.bytes.clone()), &world.gpu, Budgets { uploads: 64, ..Budgets::default() })
                .expect("opens");
        let at = |p: DVec3| p + offset;
        let mut seen = Vec::new();
        for (mode, name) in [(Mode::Color, "colour"), (Mode::Curvature, "curvature"), (Mode::Distance, "distance")] {
            let display = kilwa_viewer::Display {
                mode: name.to_owned(),
                plane: Some(kilwa_viewer::display::Plane { normal: DVec3::new(0.0, 0.6, 0.8), point: at(DVec3::Z) }),
                clip_plane: Some(kilwa_viewer::display::Plane {
                    normal: DVec3::new(1.0, 0.5, 0.0),
                    point: at(DVec3::new(6.0, 0.0, 0.0)),
                }),
                range: Some([-20.0, 20.0]),
                ..kilwa_viewer::Display::default()
            };
            let options = session.options(&display);
            assert_eq!(options.mode, mode);
            for (azimuth, distance) in [(0.7, 60.0), (2.9, 9.0), (4.0, 1.5)] {
                let mut camera = Camera::standard(StandardView::Iso, &world.bounds, size);
                (camera.target, camera.azimuth, camera.distance) = (at(DVec3::new(0.5, 0.25, 2.0)), azimuth, distance);
                let view = session.view(&camera, size, 1.0);
                seen.push(session.render(&view, &options).expect("renders").0);
            }
        }
        pictures.push(seen);
    }
    for (k, (near, far)) in pictures[0].iter().zip(&pictures[1]).enumerate() {
        let worst = near.pixels.iter().zip(&far.pixels).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(worst <= Some(1), "picture {k} differs by {worst:?} levels");
        assert!(near.pixels.chunks_exact(4).any(|p| p[..3] != near.pixels[..3]), "picture {k} shows something");
    }
}
