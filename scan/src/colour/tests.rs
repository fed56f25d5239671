//! A wall behind a pillar, photographed by cameras with different exposures; the pictures are ray traced here, independently of the code under test.

use super::*;
use crate::import::Silent;
use glam::{DMat3, DQuat, DVec2, DVec3};
use kilwa_formats::RawMesh;
use kilwa_geometry::color::{light_from_srgb, srgb_from_light};
use kilwa_pack::SliceSource;
use kilwa_scan_core::{Distortion, Pose};
use std::path::Path;

/// The wall is z = 0; the pillar stands before it.
const WALL: DVec2 = DVec2::new(2.0, 1.2);
const PILLAR: [DVec3; 2] = [DVec3::new(-0.4, -1.2, 0.6), DVec3::new(0.4, 1.2, 0.9)];
const SPACING: f64 = 0.02;
const SIZE: [u32; 2] = [360, 240];

/// Light of a place of the surface.
fn light(p: DVec3) -> [f64; 3] {
    if p.z > 0.1 {
        return [0.05, 0.10, 0.30];
    }
    let wave = 0.06 * (5.0 * p.x + 1.0).sin() * (4.0 * p.y).cos();
    [0.25 + wave, 0.20 + wave, 0.15 - 0.5 * wave]
}

/// Where a ray meets the scene.
fn hit(o: DVec3, d: DVec3) -> Option<DVec3> {
    let wall = Some(o - d * (o.z / d.z)).filter(|p| d.z < 0.0 && p.truncate().abs().cmple(WALL).all());
    let (a, b) = ((PILLAR[0] - o) / d, (PILLAR[1] - o) / d);
    let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element());
    let pillar = (enter > 0.0 && enter < leave).then(|| o + d * enter);
    pillar.or(wall)
}

/// Whether a camera sees a vertex of the wall.
fn sees(camera: &PosedCamera, p: DVec3) -> bool {
    let d = (p - camera.position()).normalize();
    let inside = camera.project(p).is_some_and(|pixel| camera.camera.contains(pixel));
    inside && hit(camera.position(), d).is_some_and(|q| q.distance(p) < 1e-6)
}

fn camera_at(position: DVec3, distortion: Distortion) -> PosedCamera {
    let focal = DVec2::splat(260.0);
    let camera = Camera::pinhole(SIZE, focal, DVec2::new(180.0, 120.0), distortion).expect("a camera");
    // Looks along -z, with y of the world up.
    let rotation = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, -DVec3::Y, -DVec3::Z));
    PosedCamera { camera, camera_from_world: Pose { rotation, translation: -(rotation * position) } }
}

/// A photograph with a gain; `person` hides a part of it.
fn photograph(folder: &Path, number: usize, camera: PosedCamera, gain: f64, person: Option<[u32; 4]>) -> Input {
    let mut picture = image::RgbImage::new(SIZE[0], SIZE[1]);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let place = ray.and_then(|ray| hit(camera.position(), ray));
        let is_hidden =
            person.is_some_and(|[left, top, right, bottom]| (left..right).contains(&x) && (top..bottom).contains(&y));
        let shown = if is_hidden { [0.02; 3] } else { place.map_or([0.6, 0.7, 0.9], light) };
        pixel.0 = shown.map(|light| srgb_from_light(light * gain));
    }
    let path = folder.join(format!("{number}.png"));
    picture.save(&path).expect("a file");
    Input { name: format!("{number}.png"), path, mask: None, camera, exposure: None }
}

fn quad(mesh: &mut RawMesh, corner: DVec3, u: DVec3, v: DVec3, scan: [u8; 3]) {
    let count = |side: DVec3| (side.length() / SPACING).round().max(1.0) as u32;
    let (columns, rows) = (count(u), count(v));
    let first = mesh.positions.len() as u32;
    for j in 0..=rows {
        for i in 0..=columns {
            mesh.positions
                .push(corner + u * (f64::from(i) / f64::from(columns)) + v * (f64::from(j) / f64::from(rows)));
            mesh.normals.push(u.cross(v).normalize().as_vec3());
            mesh.colors.push(scan);
        }
    }
    for j in 0..rows {
        for i in 0..columns {
            let a = first + j * (columns + 1) + i;
            let (b, c, d) = (a + 1, a + columns + 2, a + columns + 1);
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
}

/// The wall and the pillar, with the uniform colour of a scan.
fn pack() -> Vec<u8> {
    let mut mesh = RawMesh::default();
    let scan = [120, 110, 100];
    quad(&mut mesh, DVec3::new(-WALL.x, -WALL.y, 0.0), DVec3::X * (2.0 * WALL.x), DVec3::Y * (2.0 * WALL.y), scan);
    let [low, high] = PILLAR;
    let size = high - low;
    quad(&mut mesh, low.with_z(high.z), DVec3::X * size.x, DVec3::Y * size.y, scan);
    quad(&mut mesh, low.with_x(high.x), DVec3::Y * size.y, DVec3::Z * size.z, scan);
    quad(&mut mesh, low, DVec3::Z * size.z, DVec3::Y * size.y, scan);
    let options = kilwa_builder::BuildOptions { leaf_triangles: 512, ..Default::default() };
    kilwa_builder::build_pack(mesh, &options, &kilwa_builder::build::progress::Silent).expect("a pack").bytes
}

/// A coloured vertex.
struct Vertex {
    place: DVec3,
    color: [u8; 3],
    photos: f32,
}

fn options(folder: &Path, threads: usize, memory: u64) -> Options {
    Options { memory, threads, scratch: folder.to_owned(), refine: false, overlays: None, texture_detail: None }
}

fn vertices(pack: &[u8], inputs: &[Input], options: &Options) -> (Vec<Vertex>, Report) {
    let reader = Reader::open(SliceSource(pack)).expect("a pack");
    let (colouring, report) = colour(&reader, inputs, options, &Silent).expect("colours");
    let mut all = Vec::new();
    for number in 0..reader.entries().len() as u32 {
        let mut chunk = reader.chunk(number).expect("a chunk");
        colouring.apply(number, &mut chunk).expect("colours");
        for k in vertices::finest(&chunk.mesh, &chunk.patches) {
            let k = k as usize;
            let place = reader.header().lattice.world_from_lattice(chunk.mesh.positions[k]);
            let photos = chunk.mesh.scalars.last().expect("a scalar")[k];
            all.push(Vertex { place, color: chunk.mesh.colors[k], photos });
        }
    }
    (all, report)
}

fn session(folder: &Path) -> Vec<Input> {
    let brown = Distortion::Brown { k: [-0.08, 0.01, 0.0, 0.0], p: [0.001, 0.0] };
    let places = [(-0.25, 0.1, 1.0), (-0.1, -0.1, 0.6), (0.0, 0.0, 1.5), (0.15, 0.1, 1.0), (0.25, -0.1, 0.7)];
    let place = |(k, (x, y, gain)): (usize, (f64, f64, f64))| {
        // Someone stands in the third one.
        let person = (k == 2).then_some([60, 40, 110, 240]);
        photograph(folder, k, camera_at(DVec3::new(x, y, 3.0), brown), gain, person)
    };
    places.into_iter().enumerate().map(place).collect()
}

#[test]
fn the_colours_of_the_wall_are_recovered_without_the_pillar_and_the_passer_by() {
    let folder = tempfile::tempdir().expect("a folder");
    let inputs = session(folder.path());
    let (all, report) = vertices(&pack(), &inputs, &options(folder.path(), 2, 1 << 30));
    let wall: Vec<&Vertex> = all.iter().filter(|v| v.place.z < 0.1 && v.place.y.abs() < 1.15).collect();
    // Vertices that at least one camera sees even if they are moved a little, and vertices that none sees.
    let moved =
        |v: &Vertex, by: f64| [DVec3::X * by, -DVec3::X * by, DVec3::Y * by, -DVec3::Y * by].map(|step| v.place + step);
    let clear = |v: &Vertex| inputs.iter().any(|i| moved(v, 0.03).iter().all(|p| sees(&i.camera, p.with_z(0.0))));
    let hidden = |v: &Vertex| inputs.iter().all(|i| moved(v, 0.03).iter().all(|p| !sees(&i.camera, p.with_z(0.0))));
    let (seen, unseen): (Vec<&Vertex>, Vec<&Vertex>) =
        (wall.iter().filter(|v| clear(v)).copied().collect(), wall.iter().filter(|v| hidden(v)).copied().collect());
    assert!(seen.len() > 10_000 && unseen.len() > 1_000, "{} {}", seen.len(), unseen.len());
    assert!(seen.iter().all(|v| v.photos > 0.0));
    assert!(unseen.iter().all(|v| v.photos == 0.0));
    let ratio = |v: &Vertex, k: usize| light_from_srgb(v.color[k]) / light(v.place)[k];
    let mut median_ratio = [0.0; 3];
    for (k, median_ratio) in median_ratio.iter_mut().enumerate() {
        let mut ratios: Vec<f64> = seen.iter().map(|v| ratio(v, k)).collect();
        ratios.sort_by(f64::total_cmp);
        *median_ratio = ratios[ratios.len() / 2];
        let wrong = ratios.iter().filter(|r| (*r / *median_ratio - 1.0).abs() > 0.15).count();
        assert!(wrong < seen.len() / 100, "{wrong} of {}", seen.len());
    }
    // What no photograph sees keeps the scan's colour, in the tone of the photographs: between the extremes of the wall.
    let grey = unseen.iter().map(|v| light_from_srgb(v.color[1]) / median_ratio[1]);
    assert!(grey.clone().all(|light| light > 0.13 && light < 0.28), "{:?}", grey.fold(0.0, f64::max));
    let gains: Vec<f64> = report.photos.iter().map(|photo| photo.gain[1]).collect();
    assert!(
        (gains[1] / gains[0] / 0.6 - 1.0).abs() < 0.02 && (gains[2] / gains[0] / 1.5 - 1.0).abs() < 0.02,
        "{gains:?}"
    );
    assert!(report.photos[2].dropped > 500, "{}", report.photos[2].dropped);
}

#[test]
fn colours_do_not_depend_on_threads_memory_or_chunks() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pack, inputs) = (pack(), session(folder.path()));
    let (one, report) = vertices(&pack, &inputs, &options(folder.path(), 1, 1 << 30));
    let (other, same) = vertices(&pack, &inputs, &options(folder.path(), 2, 90 << 20));
    assert_eq!(report, same);
    let mut known = std::collections::HashMap::new();
    for (a, b) in one.iter().zip(&other) {
        assert_eq!((a.color, a.photos), (b.color, b.photos));
        let place = a.place.to_array().map(f64::to_bits);
        // On the edges of the pillar vertices of two faces meet.
        if a.place.z < 0.1 {
            assert_eq!(*known.entry(place).or_insert((a.color, a.photos)), (a.color, a.photos), "{}", a.place);
        }
    }
    assert!(known.len() < one.iter().filter(|v| v.place.z < 0.1).count());
}

#[test]
fn masked_parts_and_damaged_photographs_are_left_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut inputs = session(folder.path());
    inputs.truncate(2);
    let mask = folder.path().join("mask.png");
    image::GrayImage::from_fn(SIZE[0], SIZE[1], |x, _| image::Luma([if x < 180 { 0 } else { 255 }]))
        .save(&mask)
        .expect("a mask");
    inputs[0].mask = Some(mask);
    std::fs::write(&inputs[1].path, b"\x89PNG\r\n\x1a\n and no more").expect("a file");
    let (all, report) = vertices(&pack(), &inputs, &options(folder.path(), 2, 1 << 30));
    assert!(report.photos[1].left_out.is_some() && report.photos[0].left_out.is_none());
    let left = |v: &&Vertex| inputs[0].camera.project(v.place).is_some_and(|pixel| pixel.x < 179.0);
    assert!(all.iter().filter(left).all(|v| v.photos == 0.0));
    assert!(all.iter().any(|v| v.photos == 1.0));
    // The mask has the wrong size, so no photograph is left.
    image::GrayImage::new(5, 5).save(inputs[0].mask.as_ref().expect("a mask")).expect("a mask");
    let pack = pack();
    let reader = Reader::open(SliceSource(pack.as_slice())).expect("a pack");
    let refused = colour(&reader, &inputs, &options(folder.path(), 1, 1 << 30), &Silent).err().expect("a refusal");
    assert!(refused.to_string().contains("its mask"), "{refused}");
}

#[test]
fn photographs_of_something_else_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let away = camera_at(DVec3::new(0.0, 0.0, -2.0), Distortion::None);
    let inputs = [photograph(folder.path(), 0, away, 1.0, None)];
    let pack = pack();
    let reader = Reader::open(SliceSource(pack.as_slice())).expect("a pack");
    let refused = colour(&reader, &inputs, &options(folder.path(), 1, 1 << 30), &Silent).err().expect("a refusal");
    assert!(refused.to_string().contains("sees the model"), "{refused}");
}

#[test]
fn sharpness_distinguishes_blurred_from_sharp_photographs() {
    let mut random = fastrand::Rng::with_seed(4);
    let mut sharp = vec![120_u8; 128 * 128];
    for _ in 0..400 {
        let (left, top, width, height) =
            (random.usize(..128), random.usize(..128), random.usize(3..20), random.usize(3..20));
        let level = random.u8(60..190);
        for y in top..(top + height).min(128) {
            sharp[y * 128 + left..y * 128 + (left + width).min(128)].fill(level);
        }
    }
    let blurred: Vec<u8> = (0..128 * 128_usize)
        .map(|k| {
            let (x, y) = (k % 128, k / 128);
            let around = (0..25).map(|d| u32::from(sharp[((y + d / 5) % 128) * 128 + (x + d % 5) % 128]));
            (around.sum::<u32>() / 25) as u8
        })
        .collect();
    let of = |levels: &[u8]| {
        let photograph = Photograph::new([128, 128], levels.iter().map(|level| [*level; 3]).collect(), Vec::new());
        photograph.shown(40.0, 40.0).expect("a pixel").sharpness
    };
    assert!(of(&sharp) > 0.95 && of(&blurred) < 0.7, "{} {}", of(&sharp), of(&blurred));
    assert!(of(&[100; 128 * 128]) >= 1.0);
}

#[test]
fn a_jpeg_file_that_ends_too_early_is_left_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let mut input = session(folder.path()).remove(0);
    let path = folder.path().join("whole.jpg");
    image::open(&input.path).expect("a picture").save(&path).expect("a file");
    let read = |path: &Path| Photograph::read(path, SIZE, None);
    assert!(read(&path).is_ok());
    let bytes = std::fs::read(&path).expect("bytes");
    input.path = folder.path().join("half.jpg");
    std::fs::write(&input.path, &bytes[..bytes.len() / 2]).expect("a file");
    assert!(read(&input.path).expect_err("a refusal").contains("cut off"));
}

#[test]
fn a_mask_with_an_opaque_alpha_channel_masks_by_its_levels() {
    let folder = tempfile::tempdir().expect("a folder");
    let (input, mask) = (session(folder.path()).remove(0), folder.path().join("mask.png"));
    let level = |x: u32| if x < 180 { [0, 0, 0, 255] } else { [255; 4] };
    image::RgbaImage::from_fn(SIZE[0], SIZE[1], |x, _| image::Rgba(level(x))).save(&mask).expect("a mask");
    let photograph = Photograph::read(&input.path, SIZE, Some(&mask)).expect("a photograph");
    assert!(photograph.shown(179.5, 100.0).is_none() && photograph.shown(181.0, 100.0).is_some());
}

#[test]
fn a_mask_does_not_darken_what_is_beside_it() {
    let plain = Photograph::new([64, 64], vec![[150; 3]; 64 * 64], Vec::new());
    let masked = Photograph::new([64, 64], vec![[150; 3]; 64 * 64], (0..64 * 64).map(|k| k % 64 >= 32).collect());
    for x in 32..64 {
        let [a, b] = [&plain, &masked].map(|p| p.shown(f64::from(x) + 0.5, 20.0).expect("a pixel").low[0]);
        assert!((a - b).abs() < 1e-4, "{x}: {a} {b}");
    }
    assert!(masked.luma(4).0.iter().filter(|value| value.is_nan()).count() == 8 * 16);
}

#[test]
fn a_panorama_colours_the_wall_across_its_seam() {
    let folder = tempfile::tempdir().expect("a folder");
    let camera = Camera::equirectangular([720, 360]).expect("a camera");
    // Its back looks at the wall, exactly along an axis.
    let rotation = DQuat::from_mat3(&DMat3::from_cols(-DVec3::X, -DVec3::Y, DVec3::Z));
    let position = DVec3::new(1.0, 0.0, 1.0);
    let camera = PosedCamera { camera, camera_from_world: Pose { rotation, translation: -(rotation * position) } };
    let mut picture = image::RgbImage::new(720, 360);
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let place = ray.and_then(|ray| hit(position, ray));
        pixel.0 = place.map_or([0.5; 3], light).map(srgb_from_light);
    }
    let path = folder.path().join("round.png");
    picture.save(&path).expect("a file");
    let input = Input { name: "round.png".to_owned(), path, mask: None, camera, exposure: None };
    let (all, _) = vertices(&pack(), &[input], &options(folder.path(), 2, 1 << 30));
    let near = |v: &&Vertex| v.place.z < 0.1 && v.place.distance(position.with_z(0.0)) < 0.5;
    assert!(all.iter().filter(near).count() > 1000);
    for v in all.iter().filter(near) {
        assert!(v.photos > 0.0, "{}", v.place);
        let ratio = light_from_srgb(v.color[1]) / light(v.place)[1];
        assert!((ratio - 1.0).abs() < 0.06, "{} {ratio}", v.place);
    }
}

#[test]
fn every_photograph_of_a_crowded_place_may_be_compared() {
    let mut kept = [0; 40];
    for place in 0..200 {
        let mut samples = Vec::new();
        for photo in 0..40 {
            keep(&mut samples, [place, 7], ToneSample { photo, r2: 0.0, light: [0.2; 3], weight: 1.0 });
        }
        assert_eq!(samples.len(), MAX_PHOTOS);
        for sample in &samples {
            kept[sample.photo as usize] += 1;
        }
    }
    assert!(kept.iter().all(|count| (40..130).contains(count)), "{kept:?}");
}

/// A wall of coarse triangles, painted with stripes narrower than these.
fn striped(folder: &Path) -> (Vec<u8>, Vec<Input>) {
    let mut mesh = RawMesh::default();
    let at = |k: i32| 0.2 * f64::from(k);
    for (j, i) in (0..=10).flat_map(|j| (0..=20).map(move |i| (j, i))) {
        mesh.positions.push(DVec3::new(at(i - 10), at(j - 5), 0.0));
        mesh.normals.push(glam::Vec3::Z);
        mesh.colors.push([120, 110, 100]);
    }
    for (j, i) in (0..10).flat_map(|j| (0..20).map(move |i| (j, i))) {
        let a: u32 = j * 21 + i;
        mesh.triangles.extend([[a, a + 1, a + 22], [a, a + 22, a + 21]]);
    }
    let options = kilwa_builder::BuildOptions { leaf_triangles: 64, step: Some(1.0 / 1024.0), ..Default::default() };
    let pack =
        kilwa_builder::build_pack(mesh, &options, &kilwa_builder::build::progress::Silent).expect("a pack").bytes;
    // They see what is left of x = 0.4 m, about.
    let input = |number: usize, y: f64| {
        let camera = camera_at(DVec3::new(-1.0, y, 2.0), Distortion::default());
        let mut picture = image::RgbImage::new(SIZE[0], SIZE[1]);
        for (x, y, pixel) in picture.enumerate_pixels_mut() {
            let ray = camera.ray(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).expect("a ray");
            pixel.0 = stripes(camera.position() - ray * (2.0 / ray.z)).map(srgb_from_light);
        }
        let path = folder.join(format!("{number}.png"));
        picture.save(&path).expect("a file");
        Input { name: format!("{number}.png"), path, mask: None, camera, exposure: None }
    };
    (pack, vec![input(0, 0.0), input(1, -0.3), input(2, 0.3)])
}

fn stripes(place: DVec3) -> [f64; 3] {
    let wave = 0.15 * (40.0 * place.x).sin();
    [0.3 + wave, 0.2, 0.2 - wave]
}

#[test]
fn triangles_are_split_where_a_photograph_shows_more_than_their_corners_can_hold() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pack, inputs) = striped(folder.path());
    let plain = options(folder.path(), 2, 1 << 30);
    let (before, report) = vertices(&pack, &inputs, &plain);
    assert_eq!(report.split, None);
    let with_detail = Options { texture_detail: Some(5.0), ..plain.clone() };
    let (all, report) = vertices(&pack, &inputs, &with_detail);
    let split = report.split.expect("triangles were split");
    assert!(split.before == 400 && split.after > 8 * split.before, "{split:?}");
    // A pixel is 2 m / 260 wide, so vertices are at most 39 mm apart: a quarter of a stripe.
    let of = |list: &[Vertex]| list.iter().filter(|v| v.photos > 0.0).count();
    assert!(of(&all) > 20 * of(&before));
    let wrong = |list: &[Vertex]| {
        let coloured = list.iter().filter(|v| v.photos > 0.0);
        let off = coloured.map(|v| (light_from_srgb(v.color[0]) - stripes(v.place)[0]).abs());
        off.fold(0.0, f64::max)
    };
    assert!(wrong(&all) < 0.04, "{}", wrong(&all));
    // No edge is longer than five pixels where photographs see it.
    let near = |v: &&Vertex| v.place.x < 0.0 && v.place.y.abs() < 0.8;
    let steps = all.iter().filter(near).map(|v| (v.place.x * 1024.0).round() as i64);
    let columns: std::collections::BTreeSet<i64> = steps.collect();
    let widest = columns.iter().zip(columns.iter().skip(1)).map(|(a, b)| b - a).max();
    assert!(widest.is_some_and(|steps| steps as f64 / 1024.0 < 5.0 * 2.0 / 260.0), "{widest:?}");
    // A photograph that cannot be read splits nothing, and what is not photographed is split only to meet the rest.
    let gone = Input { path: folder.path().join("gone.png"), ..inputs[1].clone() };
    let (_, report) = vertices(&pack, &[gone, inputs[0].clone()], &with_detail);
    let (_, alone) = vertices(&pack, &inputs[..1], &with_detail);
    assert!(report.split == alone.split && report.photos[0].left_out.is_some());
    let unseen = |list: &[Vertex]| list.iter().filter(|v| v.place.x > 0.7).count();
    assert_eq!(unseen(&all), unseen(&before));
    let (one, _) =
        vertices(&pack, &inputs, &Options { texture_detail: Some(5.0), ..options(folder.path(), 1, 256 << 20) });
    assert!(one.len() == all.len() && one.iter().zip(&all).all(|(a, b)| a.place == b.place && a.color == b.color));
}

#[test]
fn the_split_surface_is_closed_like_the_one_before_and_has_the_same_area() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pack, inputs) = striped(folder.path());
    let reader = Reader::open(SliceSource(&pack)).expect("a pack");
    let with = Options { texture_detail: Some(3.0), ..options(folder.path(), 2, 1 << 30) };
    let (colouring, report) = colour(&reader, &inputs, &with, &Silent).expect("colours");
    let path = folder.path().join("split.ply");
    let format = kilwa_formats::extract::Format::of(&path, false).expect("a format");
    let output = kilwa_formats::extract::Output::prepare(&path, false).expect("an output");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
    let written = kilwa_formats::extract::extract_repainted(&reader, format, &colouring, &output, &pool, &|_, _| ());
    assert_eq!(Some(written.expect("a file").triangles), report.split.map(|split| split.after));
    let mesh = kilwa_formats::read::read_mesh(&path, &mut |_, _| ()).expect("a mesh");
    let mut edges = BTreeMap::<[u32; 2], i32>::new();
    let mut area = 0.0;
    for [a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *edges.entry([*from.min(to), *from.max(to)]).or_default() += if from < to { 1 } else { -1 };
        }
        let [a, b, c] = [a, b, c].map(|k| mesh.positions[*k as usize]);
        area += 0.5 * (b - a).cross(c - a).z;
    }
    assert!((area - 8.0).abs() < 1e-3, "{area}");
    let is_on_rim = |k: &u32| {
        let p = mesh.positions[*k as usize];
        p.x.abs() > 1.999 || p.y.abs() > 0.999
    };
    let open: Vec<_> = edges.iter().filter(|(_, uses)| **uses != 0).collect();
    assert!(!open.is_empty() && open.iter().all(|(ends, _)| ends.iter().all(is_on_rim)), "no crack inside");
}

#[test]
fn a_panorama_does_not_split_what_is_above_and_below_it_more_than_the_rest() {
    let folder = tempfile::tempdir().expect("a folder");
    let (pack, _) = striped(folder.path());
    // Its lower pole looks at the wall from a metre away.
    let camera = Camera::equirectangular([1200, 600]).expect("a camera");
    let rotation = DQuat::from_mat3(&DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y));
    let position = DVec3::new(-0.05, 0.03, 1.0);
    let camera = PosedCamera { camera, camera_from_world: Pose { rotation, translation: -(rotation * position) } };
    let path = folder.path().join("panorama.png");
    image::RgbImage::from_pixel(1200, 600, image::Rgb([90; 3])).save(&path).expect("a file");
    let input = Input { name: "panorama.png".to_owned(), path, mask: None, camera, exposure: None };
    let with = Options { texture_detail: Some(10.0), ..options(folder.path(), 2, 1 << 30) };
    let (all, report) = vertices(&pack, &[input], &with);
    // A pixel is 2π / 1200 m wide there, so that an edge of 0.2 m spans 38 of them (its diagonal 54), and is split into four parts (eight).
    assert!(report.split.is_some_and(|split| (2..=3).contains(&split.halvings)), "{:?}", report.split);
    let around = |center: DVec2| all.iter().filter(|v| v.place.truncate().distance(center) < 0.25).count();
    let [below, beside] = [DVec2::ZERO, DVec2::new(0.4, 0.0)].map(|offset| around(position.truncate() + offset));
    assert!(below > 20 && below < 2 * beside, "{below} {beside}");
}
