//! Cuts: removed geometry is invisible, the rest is what the ray-caster sees, and a line follows the cut.

use super::*;
use glam::DVec3;
use kilwa_viewer::pick::{Scope, nearest};
use kilwa_viewer::section::{Clip, ClipBox, HalfSpace, box_faces};
use kilwa_viewer::shell::native::Session;

const SIZE: [u32; 2] = [96, 72];

fn cuts(bounds_center: DVec3, radius: f64) -> Vec<(&'static str, Clip)> {
    let half = |normal: DVec3, shift: f64| {
        let normal = normal / normal.length();
        HalfSpace { normal, offset: normal.dot(bounds_center) + shift * radius }
    };
    let faces = box_faces(bounds_center, DVec3::new(radius * 0.9, radius * 0.5, radius * 0.3), 0.6);
    let plane = |n, s| Clip { plane: Some(half(n, s)), bounds: None };
    vec![
        ("from above", plane(DVec3::Z, 0.02)),
        ("upright", plane(DVec3::new(1.0, 0.4, 0.0), 0.0)),
        ("slanted, from below", plane(DVec3::new(0.3, -0.5, -0.8), 0.1)),
        ("inside of a box", Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: false }) }),
        ("outside of a box", Clip { plane: None, bounds: Some(ClipBox { faces, remove_inside: true }) }),
        (
            "plane and box",
            Clip {
                plane: Some(half(DVec3::new(0.0, 1.0, 0.2), 0.0)),
                bounds: Some(ClipBox { faces, remove_inside: false }),
            },
        ),
    ]
}

/// The nearest hit that a cut leaves.
fn cast_cut(scene: &Scene, view: &View, clip: &Clip, pixel: [f64; 2]) -> Option<Hit> {
    let (origin, way) = Scene::ray(view, pixel);
    let stays = |h: &Hit| clip.keeps(origin + way * h.depth);
    scene.cast_all(view, pixel).into_iter().filter(stays).min_by(|a, b| a.depth.total_cmp(&b.depth))
}

#[test]
fn clipped_geometry_is_invisible_and_the_rest_is_what_the_ray_caster_sees() {
    let raw = mesh(SiteKind::Fort, &SynthOptions::new(12_000)).expect("a fort");
    let mut world = World::build(raw, 400);
    let (center, radius) = world.ball();
    let (_, cut) = world.cuts().remove(2);
    let draw = draw_list(&world.chunks, &cut);
    let scene = scene(&world.chunks, &draw);
    for (name, clip) in cuts(center, radius) {
        for (camera_name, camera) in cameras(&world.bounds, SIZE).into_iter().skip(1).step_by(2) {
            let view = world.view(&camera, SIZE);
            let frame = pollster::block_on(world.renderer.ids_of_cut(&view, &draw, None, &clip)).expect("reads back");
            let whole = world.ids(&view, &draw);
            let (mut shown, mut edges, mut wrong) = (0, 0, Vec::new());
            for (k, (id, depth)) in (0..).zip(&frame.pixels) {
                let (x, y) = (k % SIZE[0], k / SIZE[0]);
                let pixel = [f64::from(x) + 0.5, f64::from(y) + 0.5];
                if id.is_some() {
                    shown += 1;
                    let (origin, way) = Scene::ray(&view, pixel);
                    let z = distance_from_depth(&view, *depth);
                    let point = origin + way * z;
                    let slack = z.abs() * 1e-5 + 1e-6 * radius;
                    assert!(clip.depth(point) > -slack, "{name}, {camera_name}: {} steps removed", clip.depth(point));
                }
                if cast_cut(&scene, &view, &clip, pixel).map(|h| h.id) == *id {
                    continue;
                }
                edges += 1;
                // Depths of a steep triangle, and with them the place of the cut, are uncertain by more than the pixel's are.
                let loose = |p: [f64; 2]| {
                    let (origin, way) = Scene::ray(&view, p);
                    scene.cast_all(&view, p).iter().any(|h| {
                        let (low, high) = depths(&scene, &view, *h, x, y);
                        let ends = [low, high].map(|z| clip.depth(origin + way * z));
                        Some(h.id) == *id
                            && ends[0].max(ends[1]) >= 0.0
                            && (low..=high).contains(&distance_from_depth(&view, *depth))
                    })
                };
                if !near_probes(x, y).any(|p| cast_cut(&scene, &view, &clip, p).map(|h| h.id) == *id || loose(p))
                    && !explains_edge_on(&scene, &view, x, y, *id, distance_from_depth(&view, *depth))
                {
                    wrong.push((x, y, *id));
                }
            }
            assert!(wrong.is_empty(), "{name}, {camera_name}: {} unexplained, first {:?}", wrong.len(), wrong[0]);
            assert!(edges * 8 < shown + 800, "{name}, {camera_name}: {edges} edges of {shown}");
            let before = whole.pixels.iter().filter(|(id, _)| id.is_some()).count();
            assert!(shown <= before, "a cut shows no more than the whole");
        }
    }
}

#[test]
fn picks_pass_through_clipped_geometry() {
    let raw = mesh(SiteKind::Fort, &SynthOptions::new(12_000)).expect("a fort");
    let world = World::build(raw, 400);
    let (center, radius) = world.ball();
    let (_, cut) = world.cuts().remove(1);
    let draw = draw_list(&world.chunks, &cut);
    let scene = scene(&world.chunks, &draw);
    let held: BTreeMap<u32, GpuChunk> = world.chunks.iter().map(|(k, c)| (*k, interleave(c))).collect();
    let camera = Camera::standard(StandardView::Iso, &world.bounds, SIZE);
    let view = world.view(&camera, SIZE);
    let (mut hits, mut through) = (0, 0);
    for (name, clip) in cuts(center, radius) {
        for k in 0..180 {
            let pixel = [f64::from(k * 37 % 89) + 3.5, f64::from(k * 23 % 67) + 2.5];
            let (origin, way) = Scene::ray(&view, pixel);
            let chunk = |c: u32| Some((held.get(&c)?, world.reader.entries()[c as usize].bounds));
            let picked = nearest(origin, way, &draw, Scope::Seen, &clip, chunk);
            let expected = cast_cut(&scene, &view, &clip, pixel);
            assert_eq!(picked.is_some(), expected.is_some(), "{name} at {pixel:?}");
            let (Some(picked), Some(expected)) = (picked, expected) else { continue };
            assert!((picked.along - expected.depth).abs() < 1e-6 * expected.depth, "{name} at {pixel:?}");
            assert!(clip.keeps(picked.point));
            hits += 1;
            through += usize::from(scene.cast(&view, pixel).is_some_and(|h| h.depth < expected.depth * 0.999));
        }
    }
    assert!(hits > 100 && through > 10, "{hits} hits, {through} of them behind what was cut away");
}

#[test]
fn wholly_clipped_chunks_are_not_loaded_and_the_picture_is_the_same() {
    let raw = mesh(SiteKind::Wall, &SynthOptions::new(60_000)).expect("a wall");
    let world = World::build(raw, 200);
    let (center, radius) = world.ball();
    let view = world.view(&Camera::standard(StandardView::Iso, &world.bounds, SIZE), SIZE);
    let view = View { target_pixels: 0.05, ..view };
    let open = || Session::open(SliceSource(world.bytes.clone()), &world.gpu, Budgets::default()).expect("opens");
    let mut saved = 0;
    for (name, clip) in cuts(center, radius) {
        let options = RenderOptions { clip, ..RenderOptions::default() };
        let (image, cut) = open().render(&view, &options).expect("renders");
        let mut session = open();
        let step = session.settle(&view).expect("settles");
        let whole = pollster::block_on(session.renderer().image(&view, &step.draw, &options)).expect("reads back");
        assert!(image.pixels == whole.pixels, "{name}: another picture");
        assert!(cut.target_reached && cut.bytes_wanted <= step.stats.bytes_wanted, "{name}");
        assert!(cut.triangles_drawn <= step.stats.triangles_drawn, "{name}");
        println!("{name}: {} of {} bytes", cut.bytes_wanted, step.stats.bytes_wanted);
        saved += u32::from(cut.bytes_wanted * 10 < step.stats.bytes_wanted * 9);
    }
    assert!(saved >= 3, "{saved} of six cuts save a tenth of the bytes");
}

#[test]
fn a_line_marks_the_section_and_the_inside_has_its_own_colour() {
    let (mut renderer, center, chunk, draw) = renderer_with_ball(60);
    let view = ball_view(center, 50_000.0, 3.0, 0.0, SIZE);
    let up = DVec3::Z;
    let plane = Some(HalfSpace { normal: up, offset: f64::from(center.z) + 5_000.0 });
    let clip = Clip { plane, bounds: None };
    let oracle = scene(&BTreeMap::from([(0, chunk)]), &draw);
    let mut image = |outline: f32, background: Background| {
        let options = RenderOptions { clip, outline, background, ..RenderOptions::default() };
        pollster::block_on(renderer.image(&view, &draw, &options)).expect("reads back")
    };
    let red = |p: &[u8]| p[0] > 150 && p[1] < 110 && p[2] < 60;
    let with = image(2.0, Background::Flat([255; 3]));
    let without = image(0.0, Background::Flat([255; 3]));
    assert!(!without.pixels.chunks_exact(4).any(red), "no line where none is asked for");
    let line: Vec<usize> = (0..with.pixels.len() / 4).filter(|k| red(&with.pixels[k * 4..k * 4 + 4])).collect();
    assert!(line.len() > 60, "the line has {} pixels", line.len());
    for k in line {
        let (x, y) = (k as u32 % SIZE[0], k as u32 / SIZE[0]);
        // Within three pixels of the line the cut is met.
        let near = (-3..=3).flat_map(|a| {
            (-3..=3).map(move |b| [f64::from(x) + 0.5 + f64::from(a), f64::from(y) + 0.5 + f64::from(b)])
        });
        let sides: Vec<bool> = near
            .flat_map(|p| {
                let (o, d) = Scene::ray(&view, p);
                oracle.cast_all(&view, p).into_iter().map(move |h| (o, d, h))
            })
            .map(|(o, d, h)| clip.keeps(o + d * h.depth))
            .collect();
        assert!(sides.contains(&true) && sides.contains(&false), "a line at {x}, {y}, far from the cut");
    }
    // From above one looks into the ball: the inside is blue, the outside is not.
    let blue = |p: &[u8]| p[2] > p[0].saturating_add(10);
    let inside = with.pixels.chunks_exact(4).filter(|p| blue(p)).count();
    let outside = with.pixels.chunks_exact(4).filter(|p| p[0] > p[2] && p[0] < 250).count();
    assert!(inside > 200 && outside > 200, "{inside} pixels of the inside, {outside} of the outside");
    // Over nothing the cut edge is opaque or not there: no half colours.
    let bare = image(0.0, Background::Transparent);
    assert!(bare.pixels.chunks_exact(4).any(|p| p[3] == 255) && bare.pixels.chunks_exact(4).any(|p| p[3] == 0));
}
