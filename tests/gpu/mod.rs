//! Frames of the GPU against a ray-caster on the CPU, over the same cut. No stored image.
//!
//! Runs on llvmpipe where there is no graphics card (Debian: mesa-vulkan-drivers). Without any adapter these tests
//! fail, because passing without a test would be misleading.

mod display;
mod raycast;
mod section;

use glam::{DVec3, IVec3};
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_geometry::{Mesh, normal};
use kilwa_pack::{Chunk, Cut, GpuChunk, NO_DIAMOND, PatchRange, Reader, SliceSource, interleave};
use kilwa_stream::{Budgets, DrawPatch, View};
use kilwa_synth::{Phantom, SiteKind, SynthOptions, mesh};
use kilwa_viewer::clip::distance_from_depth;
use kilwa_viewer::options::Scale;
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{
    Background, Bounds, Camera, Gpu, IdImage, Mode, Prefer, RenderOptions, Renderer, StandardView, Tile,
};
use raycast::{Hit, Scene, Triangle};
use std::collections::BTreeMap;

fn gpu() -> Gpu {
    let gpu = pollster::block_on(Gpu::headless(Prefer::Software)).expect("these tests need a graphics adapter");
    println!("adapter: {}", gpu.describe());
    gpu
}

/// How far apart the GPU's rasteriser and exact geometry may see an edge: vertices are snapped to 1/256 pixel.
const JITTER: f64 = 1.0 / 64.0;

/// Triangles of a draw list.
fn scene(chunks: &BTreeMap<u32, Chunk>, draw: &[DrawPatch]) -> Scene {
    let mut triangles = Vec::new();
    for (id, patch) in (0u32..).zip(draw) {
        let mesh = &chunks[&patch.chunk].mesh;
        for t in patch.first..patch.first + patch.count {
            triangles.push(Triangle { corners: mesh.corners(t as usize).map(glam::IVec3::as_dvec3), id });
        }
    }
    Scene::new(triangles)
}

/// The pixel's centre and eight points round it.
fn probes(x: u32, y: u32) -> impl Iterator<Item = [f64; 2]> {
    let center = [f64::from(x) + 0.5, f64::from(y) + 0.5];
    let round = (0..8).map(move |k| {
        let (s, c) = (f64::from(k) * std::f64::consts::FRAC_PI_4).sin_cos();
        [center[0] + c * JITTER, center[1] + s * JITTER]
    });
    std::iter::once(center).chain(round)
}

/// Many points round the centre: triangles seen edge-on are thin, and where a triangle reaches from beside the eye to
/// far away, `f32` clip coordinates move its edges by some hundredths of a pixel.
fn near_probes(x: u32, y: u32) -> impl Iterator<Item = [f64; 2]> {
    (1..=8).flat_map(move |ring| {
        (0..24).map(move |k| {
            let (s, c) = ((f64::from(k) + 0.5 * f64::from(ring % 2)) * std::f64::consts::TAU / 24.0).sin_cos();
            let r = f64::from(ring) / 128.0;
            [f64::from(x) + 0.5 + c * r, f64::from(y) + 0.5 + s * r]
        })
    })
}

/// Whether a GPU pixel can be explained by a hit near its centre: the same patch, at a depth that the hit triangle's
/// plane has within the pixel's uncertainty.
fn explains(scene: &Scene, view: &View, hit: Option<Hit>, x: u32, y: u32, id: Option<u32>, depth: f64) -> bool {
    let (Some(hit), Some(id)) = (hit, id) else { return hit.is_none() && id.is_none() };
    if hit.id != id {
        return false;
    }
    let (low, high) = depths(scene, view, hit, x, y);
    (low..=high).contains(&depth)
}

/// Depths that the plane of a hit triangle has within the pixel's uncertainty.
fn depths(scene: &Scene, view: &View, hit: Hit, x: u32, y: u32) -> (f64, f64) {
    let (mut low, mut high) = (hit.depth, hit.depth);
    for probe in probes(x, y) {
        let d = scene.plane_depth(view, hit.triangle, probe);
        if d.is_finite() && d > 0.0 {
            low = low.min(d);
            high = high.max(d);
        }
    }
    let slack = hit.depth.abs() * 2e-5 + if view.far.is_finite() { view.far * 1e-6 } else { 0.0 };
    (low - slack, high + slack)
}

/// The harder question for a pixel on an edge: is there a point nearby where the GPU's patch is hit, and hidden by
/// nothing, or by no more than the uncertainty of its depth? (At a fold two triangles meet at equal depth.)
fn explains_edge(scene: &Scene, view: &View, x: u32, y: u32, id: Option<u32>, depth: f64) -> bool {
    near_probes(x, y).any(|probe| {
        let hits = scene.cast_all(view, probe);
        let Some(id) = id else { return hits.is_empty() };
        let nearest = hits.iter().map(|h| h.depth).fold(f64::INFINITY, f64::min);
        hits.iter().filter(|h| h.id == id).any(|h| {
            let (low, high) = depths(scene, view, *h, x, y);
            (low..=high).contains(&depth) && h.depth - nearest <= high - low
        })
    })
}

/// Whether a triangle seen edge-on explains a pixel: its plane, steep as it is, has that depth within the pixel's uncertainty.
fn explains_edge_on(scene: &Scene, view: &View, x: u32, y: u32, id: Option<u32>, depth: f64) -> bool {
    let Some(id) = id else { return false };
    let pixel = [f64::from(x) + 0.5, f64::from(y) + 0.5];
    scene.edge_on(view, pixel, id, JITTER).into_iter().any(|triangle| {
        let d = scene.plane_depth(view, triangle, pixel);
        let (low, high) = depths(scene, view, Hit { id, triangle, depth: d }, x, y);
        (low..=high).contains(&depth)
    })
}

/// Compare a frame with the ray-caster. Returns how many pixels show the model and how many lie on an edge.
fn compare(name: &str, scene: &Scene, view: &View, frame: &IdImage) -> (usize, usize) {
    let (mut covered, mut edges, mut wrong) = (0, 0, Vec::new());
    for y in 0..view.size[1] {
        for x in 0..view.size[0] {
            let (id, depth) = frame.pixels[(y * view.size[0] + x) as usize];
            let depth = distance_from_depth(view, depth);
            covered += usize::from(id.is_some());
            let center = scene.cast(view, [f64::from(x) + 0.5, f64::from(y) + 0.5]);
            if explains(scene, view, center, x, y, id, depth) {
                continue;
            }
            edges += 1;
            if !explains_edge(scene, view, x, y, id, depth) && !explains_edge_on(scene, view, x, y, id, depth) {
                wrong.push((x, y, id, depth, center));
            }
        }
    }
    assert!(
        wrong.is_empty(),
        "{name}: {} pixels are unexplained, first {:?}",
        wrong.len(),
        &wrong[..wrong.len().min(5)]
    );
    (covered, edges)
}

fn draw_list(chunks: &BTreeMap<u32, Chunk>, cut: &Cut) -> Vec<DrawPatch> {
    let mut out = Vec::new();
    for chunk in cut.refined() {
        for (number, patch) in chunks[&chunk].patches.iter().enumerate() {
            if cut.draws(patch) {
                out.push(draw_patch(chunk, number as u32, patch));
            }
        }
    }
    out
}

fn draw_patch(chunk: u32, patch: u32, p: &PatchRange) -> DrawPatch {
    DrawPatch { chunk, patch, first: p.first, count: p.count, diamond: p.diamond, level: 0, error: 0.0, visible: true }
}

/// A built pack, all of its chunks, and a renderer that holds them.
struct World {
    reader: Reader<SliceSource<Vec<u8>>>,
    bytes: Vec<u8>,
    chunks: BTreeMap<u32, Chunk>,
    renderer: Renderer,
    gpu: Gpu,
    bounds: Bounds,
}

impl World {
    fn build(raw: RawMesh, leaf_triangles: usize) -> Self {
        let options = BuildOptions { leaf_triangles, ..BuildOptions::default() };
        let bytes = build_pack(raw, &options, &Silent).expect("builds").bytes;
        let reader = Reader::open(SliceSource(bytes.clone())).expect("opens");
        let gpu = gpu();
        let mut renderer = Renderer::headless(&gpu);
        let mut chunks = BTreeMap::new();
        for index in 0..reader.header().entry_count {
            let chunk = reader.chunk(index).expect("decodes");
            renderer.upload(index, &interleave(&chunk));
            chunks.insert(index, chunk);
        }
        let m = reader.metadata();
        let bounds = Bounds { min: m.bounds_min, max: m.bounds_max };
        Self { reader, bytes, chunks, renderer, gpu, bounds }
    }

    fn view(&self, camera: &Camera, size: [u32; 2]) -> View {
        camera.view(&self.reader.header().lattice, &self.bounds, size, 1.0)
    }

    /// Centre and radius of a ball round it, in lattice units.
    fn ball(&self) -> (DVec3, f64) {
        let lattice = self.reader.header().lattice;
        (lattice.steps_from_world(self.bounds.center()), self.bounds.radius() / lattice.step())
    }

    fn cuts(&self) -> Vec<(String, Cut)> {
        let entries = self.reader.entries();
        let mut cuts =
            vec![("coarsest".to_owned(), Cut::coarsest(entries)), ("finest".to_owned(), Cut::finest(entries))];
        for seed in 0..4 {
            let target = 1 + entries.len() * (seed + 1) / 6;
            cuts.push((format!("random {seed}"), Cut::random(entries, seed as u64, target)));
        }
        cuts
    }

    fn ids(&mut self, view: &View, draw: &[DrawPatch]) -> IdImage {
        pollster::block_on(self.renderer.ids(view, draw, None)).expect("reads back")
    }
}

/// Cameras all round, near the surface and inside.
fn cameras(bounds: &Bounds, size: [u32; 2]) -> Vec<(String, Camera)> {
    let mut out: Vec<(String, Camera)> =
        StandardView::ALL.iter().map(|(v, name)| ((*name).to_owned(), Camera::standard(*v, bounds, size))).collect();
    let iso = Camera::standard(StandardView::Iso, bounds, size);
    for (k, distance) in [0.3, 0.05, 0.004].into_iter().enumerate() {
        let mut close = iso;
        close.orbit(1.1 * k as f64, -0.2 * k as f64);
        let back = close.backward();
        close.target = bounds.center() + back * bounds.radius() * 0.55;
        close.distance = bounds.radius() * distance;
        out.push((format!("close {distance}"), close));
    }
    let mut inside = iso;
    inside.distance = bounds.radius() * 0.05;
    out.push(("inside".to_owned(), inside));
    out
}

#[test]
fn frames_of_a_fort_equal_the_ray_caster_in_mixed_cuts() {
    for seed in 1..=2 {
        frames_equal_the_ray_caster(seed);
    }
}

fn frames_equal_the_ray_caster(seed: u64) {
    let raw = mesh(SiteKind::Fort, &SynthOptions { seed, ..SynthOptions::new(20_000) }).expect("a fort");
    let mut world = World::build(raw, 400);
    let size = [96, 72];
    let (mut pixels, mut edges) = (0, 0);
    for (cut_name, cut) in world.cuts() {
        let draw = draw_list(&world.chunks, &cut);
        let scene = scene(&world.chunks, &draw);
        for (camera_name, camera) in cameras(&world.bounds, size) {
            let view = world.view(&camera, size);
            let frame = world.ids(&view, &draw);
            let (covered, edge) = compare(&format!("{cut_name}, {camera_name}"), &scene, &view, &frame);
            pixels += covered;
            edges += edge;
        }
    }
    println!("{pixels} pixels of the model, {edges} of them on an edge between patches or on a silhouette");
    assert!(pixels > 50_000 && edges * 20 < pixels);
}

#[test]
fn a_closed_model_shows_no_background_from_inside_in_any_cut() {
    for phantom in [Phantom::Sphere, Phantom::Cube] {
        let raw = mesh(SiteKind::Phantom(phantom), &SynthOptions::new(8_000)).expect("a phantom");
        let mut world = World::build(raw, 150);
        let size = [160, 160];
        for (cut_name, cut) in world.cuts() {
            let draw = draw_list(&world.chunks, &cut);
            for k in 0..6 {
                let mut camera = Camera::standard(StandardView::Iso, &world.bounds, size);
                camera.orbit(f64::from(k), f64::from(k) * 0.5 - 1.2);
                camera.distance = world.bounds.radius() * 0.1;
                let frame = world.ids(&world.view(&camera, size), &draw);
                let holes = frame.pixels.iter().filter(|(id, _)| id.is_none()).count();
                assert_eq!(holes, 0, "{} {cut_name} camera {k}: background inside a closed model", phantom.name());
            }
        }
    }
}

/// A closed bumpy ball round `center`, in one chunk of several patches, in lattice units.
fn ball(center: IVec3, radius: f64, rings: u32) -> Chunk {
    ball_with_bumps(center, radius, rings, 0.05)
}

fn ball_with_bumps(center: IVec3, radius: f64, rings: u32, bumps: f64) -> Chunk {
    let mut mesh = Mesh::default();
    let segments = rings * 2;
    for ring in 0..=rings {
        for segment in 0..segments {
            let (st, ct) = (std::f64::consts::PI * f64::from(ring) / f64::from(rings)).sin_cos();
            let (sp, cp) = (std::f64::consts::TAU * f64::from(segment) / f64::from(segments)).sin_cos();
            let n = DVec3::new(st * cp, st * sp, ct);
            let r = radius * (1.0 + bumps * (7.0 * n.x).sin() * (9.0 * n.y).cos());
            mesh.positions.push(center + (n * r).round().as_ivec3());
            mesh.normals.push(normal::encode(n));
            mesh.colors.push([200, 180, 150]);
        }
    }
    let at = |ring: u32, segment: u32| ring * segments + segment % segments;
    for ring in 0..rings {
        for s in 0..segments {
            let quad = [at(ring, s), at(ring + 1, s), at(ring + 1, s + 1), at(ring, s + 1)];
            if ring + 1 < rings {
                mesh.triangles.push([quad[0], quad[1], quad[2]]);
            }
            if ring > 0 {
                mesh.triangles.push([quad[0], quad[2], quad[3]]);
            }
        }
    }
    mesh.borders = vec![0; mesh.triangles.len()];
    // At the poles all vertices of a ring share one position.
    let total = mesh.triangles.len() as u32;
    let patches = (0..4)
        .map(|k| PatchRange { first: total * k / 4, count: total * (k + 1) / 4 - total * k / 4, diamond: NO_DIAMOND })
        .collect();
    Chunk { mesh, patches }
}

/// The view of a ball from a distance in radii.
fn ball_view(center: IVec3, radius: f64, distance: f64, turn: f64, size: [u32; 2]) -> View {
    let lattice = kilwa_geometry::Lattice { origin: DVec3::ZERO, step_log2: 0 };
    let at = center.as_dvec3();
    let bounds = Bounds { min: at - radius * 1.1, max: at + radius * 1.1 };
    let mut camera = Camera::standard(StandardView::Iso, &bounds, size);
    camera.orbit(turn, turn * 0.3);
    camera.distance = distance * radius;
    camera.view(&lattice, &bounds, size, 1.0)
}

#[test]
fn far_out_on_the_lattice_nothing_jitters() {
    // Twice the same ball, once near the lattice's origin and once near 2^29 on every axis, as UTM coordinates come.
    let gpu = gpu();
    let mut renderer = Renderer::headless(&gpu);
    let (near, far) = (IVec3::splat(1 << 20), IVec3::new((1 << 29) + 12_345, (1 << 29) + 777, (1 << 29) - 31));
    let size = [120, 120];
    let radius = 400_000.0;
    let mut chunks = BTreeMap::new();
    for (index, center) in [(0, near), (1, far)] {
        let chunk = ball(center, radius, 60);
        renderer.upload(index, &interleave(&chunk));
        chunks.insert(index, chunk);
    }
    for (distance, turn) in [(3.0, 0.0), (1.2, 1.0), (1.051, 2.0), (0.5, 3.0)] {
        let mut frames = Vec::new();
        for (index, center) in [(0u32, near), (1, far)] {
            let draw: Vec<DrawPatch> =
                (0..4).map(|k| draw_patch(index, k, &chunks[&index].patches[k as usize])).collect();
            let view = ball_view(center, radius, distance, turn, size);
            let frame = pollster::block_on(renderer.ids(&view, &draw, None)).expect("reads back");
            compare(&format!("ball {index} from {distance}"), &scene(&chunks, &draw), &view, &frame);
            frames.push(frame);
        }
        assert!(frames[0] == frames[1], "the place on the lattice changes the picture at distance {distance}");
    }
}

#[test]
fn the_streamer_draws_what_the_ray_caster_sees() {
    let raw = mesh(SiteKind::Fort, &SynthOptions::new(30_000)).expect("a fort");
    let world = World::build(raw, 400);
    let size = [128, 96];
    let source = SliceSource(world.bytes.clone());
    let mut session = Session::open(source, &world.gpu, Budgets { uploads: 3, ..Budgets::default() }).expect("opens");
    for (name, camera) in cameras(&world.bounds, size) {
        let view = session.view(&camera, size, 2.0);
        let step = session.settle(&view).expect("settles");
        assert!(step.stats.target_reached, "{name}: {:?}", step.stats);
        let frame = session.ids(&view, &step.draw).expect("draws");
        // The oracle sees the patches that the streamer thinks invisible, too.
        let (covered, _) = compare(&name, &scene(&world.chunks, &step.draw), &view, &frame);
        let whole = StandardView::from_name(&name).is_some();
        assert!(covered > 500 || !whole, "{name} shows {covered} pixels of the fort");
    }
}

/// A renderer that holds a ball as chunk 0, the ball's centre, and its patches.
fn renderer_with_ball(rings: u32) -> (Renderer, IVec3, Chunk, Vec<DrawPatch>) {
    let mut renderer = Renderer::headless(&gpu());
    let center = IVec3::splat(1 << 20);
    let chunk = ball(center, 50_000.0, rings);
    renderer.upload(0, &interleave(&chunk));
    let draw = (0..4).map(|k| draw_patch(0, k, &chunk.patches[k as usize])).collect();
    (renderer, center, chunk, draw)
}

#[test]
fn tiles_together_equal_the_whole_picture() {
    let (mut renderer, center, chunk, draw) = renderer_with_ball(40);
    let chunks = BTreeMap::from([(0, chunk)]);
    let size = [150, 100];
    let view = ball_view(center, 50_000.0, 2.5, 0.4, size);
    let scene = scene(&chunks, &draw);
    let mut whole = IdImage { size, pixels: vec![(None, 0.0); 150 * 100] };
    for top in (0..100).step_by(34) {
        for left in (0..150).step_by(64) {
            let part = [64.min(150 - left), 34.min(100 - top)];
            let tile = Tile { offset: [left, top], size: part };
            let ids = pollster::block_on(renderer.ids(&view, &draw, Some(tile))).expect("reads back");
            for (k, pixel) in (0u32..).zip(&ids.pixels) {
                whole.pixels[((top + k / part[0]) * 150 + left + k % part[0]) as usize] = *pixel;
            }
        }
    }
    let (covered, _) = compare("tiles", &scene, &view, &whole);
    assert!(covered > 3000);
    // A pick is a tile of one pixel.
    let picked = pollster::block_on(renderer.pick(&view, &draw, [75, 50])).expect("reads back").expect("hits the ball");
    let hit = scene.cast(&view, [75.5, 50.5]).expect("hits the ball");
    assert_eq!(picked.0, hit.id);
    assert!((picked.1 - hit.depth).abs() < hit.depth * 1e-5);
    assert_eq!(pollster::block_on(renderer.pick(&view, &draw, [1, 1])).expect("reads back"), None);
}

#[test]
fn every_mode_colours_the_model_and_not_the_background() {
    let (mut renderer, center, _, mut draw) = renderer_with_ball(40);
    for patch in &mut draw {
        (patch.error, patch.level) = (0.01, 3);
    }
    let view = ball_view(center, 50_000.0, 4.0, 0.4, [64, 64]);
    let mut seen = Vec::new();
    for (mode, name) in Mode::ALL {
        // Heights and distances span the ball; the distance grows to the east.
        let normal = if mode == Mode::Distance { DVec3::X } else { DVec3::Z };
        let middle = f64::from(center.x);
        let scale = Scale { normal, offset: middle, range: [-60_000.0, 60_000.0] };
        let background = Background::Flat([10, 200, 30]);
        let options = RenderOptions { mode, scale, background, ..RenderOptions::default() };
        let image = pollster::block_on(renderer.image(&view, &draw, &options)).expect("reads back");
        let at = |x: usize, y: usize| &image.pixels[(y * 64 + x) * 4..(y * 64 + x) * 4 + 4];
        let near = |a: &[u8], b: [u8; 4]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) <= 1);
        assert!(near(at(0, 0), [10, 200, 30, 255]), "{name}: background {:?}", at(0, 0));
        assert!(!near(at(32, 32), [10, 200, 30, 255]), "{name}: nothing in the middle");
        assert!(!seen.contains(&at(32, 32).to_vec()), "{name} looks like another mode");
        seen.push(at(32, 32).to_vec());
    }
    let flat = RenderOptions { shading: 0.0, ..RenderOptions::default() };
    let image = pollster::block_on(renderer.image(&view, &draw, &flat)).expect("reads back");
    let middle = &image.pixels[(32 * 64 + 32) * 4..(32 * 64 + 32) * 4 + 3];
    assert!(middle.iter().zip([200u8, 180, 150]).all(|(a, b)| a.abs_diff(b) <= 1), "colours come back: {middle:?}");
    let none = RenderOptions { background: Background::Transparent, ..flat };
    let image = pollster::block_on(renderer.image(&view, &draw, &none)).expect("reads back");
    assert_eq!(&image.pixels[..4], &[0, 0, 0, 0]);
}

#[test]
fn missing_chunks_are_skipped_and_evicted_ones_free_their_memory() {
    let gpu = gpu();
    let mut renderer = Renderer::headless(&gpu);
    let chunk = ball(IVec3::splat(1 << 20), 50_000.0, 20);
    let gpu_chunk: GpuChunk = interleave(&chunk);
    renderer.upload(7, &gpu_chunk);
    renderer.upload(7, &gpu_chunk);
    assert_eq!(renderer.chunk_count(), 1);
    assert_eq!(renderer.chunk_bytes() as usize, gpu_chunk.vertices.len() + gpu_chunk.indices.len() * 4);
    let beyond = PatchRange { first: 1, count: u32::MAX, diamond: NO_DIAMOND };
    let draw = [draw_patch(7, 0, &beyond), draw_patch(8, 0, &chunk.patches[0])];
    let view = ball_view(IVec3::splat(1 << 20), 50_000.0, 3.0, 0.0, [32, 32]);
    let ids = pollster::block_on(renderer.ids(&view, &draw, None)).expect("reads back");
    assert!(ids.pixels.iter().all(|(id, _)| id.is_none()));
    renderer.evict(7);
    assert_eq!((renderer.chunk_count(), renderer.chunk_bytes()), (0, 0));
}

/// Places that evicted chunks leave are filled by others, some in buffers of their own: pictures do not depend on it.
#[test]
fn a_picture_does_not_depend_on_what_was_uploaded_and_evicted_before() {
    let gpu = gpu();
    let center = IVec3::splat(1 << 20);
    // Balls in a row, of 40 to 60,000 triangles; the largest has more vertices than the first buffer has places.
    let balls: BTreeMap<u32, Chunk> = (0..9_i32)
        .map(|k| {
            let rings = [5, 190, 12, 60, 8, 30, 100, 6, 20][k as usize];
            (k as u32, ball(center + IVec3::new((k - 4) * 90_000, 0, 0), 40_000.0, rings))
        })
        .collect();
    let draw: Vec<DrawPatch> = balls
        .iter()
        .flat_map(|(&index, chunk)| (0..4).map(move |k| draw_patch(index, k, &chunk.patches[k as usize])))
        .collect();
    let view = ball_view(center, 200_000.0, 3.0, 0.7, [96, 64]);
    let options = RenderOptions::default();
    let mut fresh = Renderer::headless(&gpu);
    let mut used = Renderer::headless(&gpu);
    for (&index, chunk) in &balls {
        fresh.upload(index, &interleave(chunk));
        used.upload(8 - index, &interleave(chunk));
    }
    for index in [1, 3, 4, 8, 0] {
        used.evict(index);
    }
    for index in [3, 6, 0, 8, 2, 1, 7, 5, 4] {
        used.upload(index, &interleave(&balls[&index]));
    }
    assert_eq!(used.chunk_bytes(), fresh.chunk_bytes());
    let [a, b] =
        [&mut fresh, &mut used].map(|r| pollster::block_on(r.image(&view, &draw, &options)).expect("reads back"));
    let colors: std::collections::BTreeSet<&[u8]> = a.pixels.chunks_exact(4).collect();
    assert!(colors.len() > 20, "the balls are in the picture");
    assert_eq!(a, b);
}
