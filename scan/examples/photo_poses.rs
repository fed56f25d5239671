//! `photo_poses PHOTOS WIDTH HEIGHT TRIANGLES PIXELS SEED [plain] [panoramas=N] [finest=N]`: simulates photographs of the fort, disturbs their poses by PIXELS (root mean square), refines them against a mesh
//! of the fort and compares the result with the truth. `plain`: the mesh has no colours. Also refines each photograph from a pose that is 200 pixels off, and one of another place. Prints a table.

use glam::{DQuat, DVec2, DVec3, Vec3};
use kilwa_formats::RawMesh;
use kilwa_scan_core::photo_pose::{Grey, NotRefined, Options, Quality, Refined, Shown, refine};
use kilwa_scan_core::raster::{Raster, windows};
use kilwa_scan_core::{Pose, PosedCamera};
use kilwa_synth::photos::{PhotoOptions, Session};
use kilwa_synth::{SiteKind, SynthOptions};
use std::convert::Infallible;
use std::time::Instant;

/// Triangles that are drawn or left out together.
const BLOCK: usize = 256;

/// A mesh with normals and brightness at its vertices.
struct Model {
    mesh: RawMesh,
    shown: Vec<Shown>,
    balls: Vec<(DVec3, f64)>,
}

impl Model {
    fn new(triangles: u64, seed: u64, is_plain: bool) -> Self {
        let options = SynthOptions { seed, ..SynthOptions::new(triangles) };
        let mesh = kilwa_synth::mesh(SiteKind::Fort, &options).expect("a fort");
        let mut normals = vec![DVec3::ZERO; mesh.positions.len()];
        for corners in &mesh.triangles {
            let [a, b, c] = corners.map(|k| mesh.positions[k as usize]);
            let normal = (b - a).cross(c - a);
            for k in corners {
                normals[*k as usize] += normal;
            }
        }
        let light = |color: [u8; 3]| {
            let [r, g, b] = color.map(kilwa_geometry::color::light_from_srgb_f32);
            if is_plain { f32::NAN } else { 0.2126 * r + 0.7152 * g + 0.0722 * b }
        };
        let shown = normals.iter().zip(&mesh.colors).map(|(normal, color)| {
            let n = normal.normalize_or_zero().as_vec3();
            [light(*color), f32::NAN, n.x, n.y, n.z]
        });
        let shown = shown.collect();
        let ball = |triangles: &[[u32; 3]]| {
            let corners = || triangles.iter().flatten().map(|k| mesh.positions[*k as usize]);
            let low = corners().fold(DVec3::INFINITY, DVec3::min);
            let high = corners().fold(DVec3::NEG_INFINITY, DVec3::max);
            (0.5 * (low + high), 0.5 * low.distance(high))
        };
        let balls = mesh.triangles.chunks(BLOCK).map(ball).collect();
        Self { mesh, shown, balls }
    }

    fn draw(&self, camera: &PosedCamera, scale: f64) -> Vec<Raster<Shown>> {
        let draw = |window: kilwa_scan_core::raster::Window| {
            let mut raster = Raster::new(window);
            for (block, (center, radius)) in self.mesh.triangles.chunks(BLOCK).zip(&self.balls) {
                if !window.may_show(camera.camera_from_world.apply(*center), *radius) {
                    continue;
                }
                for corners in block {
                    let at = |k: u32| -> Vec3 {
                        let point = camera.camera_from_world.apply(self.mesh.positions[k as usize]);
                        (window.window_from_camera * point).as_vec3()
                    };
                    raster.draw(corners.map(at), corners.map(|k| self.shown[k as usize]));
                }
            }
            raster
        };
        windows(&camera.camera, scale, 4_000_000).into_iter().map(draw).collect()
    }
}

/// Where a pose sees what the truth sees on a grid, pixels (root mean square).
fn error(truth: &PosedCamera, pose: &PosedCamera, places: &[DVec3]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    let width = f64::from(truth.camera.size()[0]);
    for place in places {
        if let (Some(a), Some(b)) = (truth.project(*place), pose.project(*place)) {
            let mut offset = a - b;
            if truth.camera.max_angle() > 3.0 {
                offset.x -= (offset.x / width).round() * width;
            }
            sum += offset.length_squared();
            count += 1.0;
        }
    }
    f64::sqrt(sum / f64::max(count, 1.0))
}

/// The mean shift, and the median distance.
fn bias(truth: &PosedCamera, pose: &PosedCamera, places: &[DVec3]) -> String {
    let offsets: Vec<DVec2> =
        places.iter().filter_map(|place| Some(pose.project(*place)? - truth.project(*place)?)).collect();
    let mean = offsets.iter().sum::<DVec2>() / offsets.len().max(1) as f64;
    let mut lengths: Vec<f64> = offsets.iter().map(|offset| offset.length()).collect();
    lengths.sort_by(f64::total_cmp);
    format!("mean {:.2} {:.2} median {:.2}", mean.x, mean.y, lengths.get(lengths.len() / 2).copied().unwrap_or(0.0))
}

fn grey(bytes: &[u8], size: [u32; 2]) -> Grey {
    let luminance = |p: &[u8]| (0.2126 * f32::from(p[0]) + 0.7152 * f32::from(p[1]) + 0.0722 * f32::from(p[2])) / 255.0;
    Grey::new(size, bytes.chunks_exact(3).map(luminance).collect()).expect("a picture")
}

/// A simulated picture; kept in the folder `PHOTO_CACHE` of the environment, if there is one.
fn cached(session: &Session, number: usize, options: &PhotoOptions) -> Vec<u8> {
    let (width, height) = session.photos()[number].size();
    let name = format!("{}-{}-{}-{number}-{width}x{height}", options.seed, options.photos, options.panoramas);
    let path = std::env::var_os("PHOTO_CACHE").map(|folder| std::path::PathBuf::from(folder).join(name));
    let known = path.as_ref().and_then(|path| std::fs::read(path).ok());
    known.filter(|bytes| bytes.len() == width as usize * height as usize * 3).unwrap_or_else(|| {
        let bytes = session.picture(number, options);
        if let Some(path) = path {
            std::fs::write(path, &bytes).expect("a folder for pictures");
        }
        bytes
    })
}

/// Turned about a random axis and moved so that places shift by about `pixels`.
fn disturbed(truth: &PosedCamera, places: &[DVec3], pixels: f64, random: &mut fastrand::Rng) -> PosedCamera {
    let mut vector = || DVec3::from_array(std::array::from_fn(|_| random.f64() * 2.0 - 1.0));
    let (turn, shift) = (vector(), vector());
    let mut ranges: Vec<f64> = places.iter().map(|p| p.distance(truth.position())).collect();
    ranges.sort_by(f64::total_cmp);
    let range = ranges.get(ranges.len() / 2).copied().unwrap_or(10.0);
    let with = |factor: f64| {
        let rotation = DQuat::from_scaled_axis(turn * factor);
        let pose = truth.camera_from_world;
        let translation = rotation * pose.translation + shift * (0.5 * factor * range);
        PosedCamera {
            camera_from_world: Pose { rotation: (rotation * pose.rotation).normalize(), translation },
            ..*truth
        }
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..40 {
        let middle = 0.5 * (low + high);
        if error(truth, &with(middle), places) < pixels { low = middle } else { high = middle }
    }
    with(low)
}

fn describe(result: &Result<Refined, Box<NotRefined>>, truth: &PosedCamera, places: &[DVec3]) -> String {
    let line = |word: &str, camera: &PosedCamera, q: &Quality, note: String| {
        format!(
            "{word:8} {:8.2} px | share {:.2} of {:3} chance {:.3} score {:6.1} residual {:5.2} sigma {:6.3} rival {:.2} {note}",
            error(truth, camera, places),
            q.share,
            q.patches,
            q.chance,
            q.score,
            q.residual_px,
            q.sigma_px,
            q.rival
        )
    };
    match result {
        Ok(refined) => line(
            "refined",
            &refined.camera,
            &refined.quality,
            format!("moved {:.1} {}", refined.moved_px, bias(truth, &refined.camera, places)),
        ),
        Err(not) => line("REJECTED", &not.camera, &not.quality, not.to_string()),
    }
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize, fallback: f64| args.get(k).and_then(|a| a.parse::<f64>().ok()).unwrap_or(fallback);
    let named = |name: &str| args.iter().find_map(|a| a.strip_prefix(name)?.parse::<u32>().ok());
    let is_plain = args.iter().any(|a| a == "plain");
    let (width, height) = (number(1, 800.0) as u32, number(2, 600.0) as u32);
    let options = PhotoOptions {
        pose_error: number(4, 15.0),
        seed: number(5, 1.0) as u64,
        panoramas: named("panoramas=").unwrap_or(0),
        ..PhotoOptions::new(number(0, 24.0) as u32, (width, height))
    };
    let start = Instant::now();
    let model = Model::new(number(3, 2e6) as u64, options.seed, is_plain);
    println!("{} triangles in {:.1} s", model.mesh.triangles.len(), start.elapsed().as_secs_f64());
    let start = Instant::now();
    let session = Session::new(&options).expect("a session");
    let mut posed = session.disturbed(&options);
    println!("session in {:.1} s", start.elapsed().as_secs_f64());
    let settings = Options { finest: named("finest=").unwrap_or(Options::default().finest), ..Options::default() };
    let mut random = fastrand::Rng::with_seed(options.seed);
    let (mut good, mut wrong, mut accepted, mut false_accepted, mut tests) = (0, 0, 0, 0, 0);
    let photos = session.photos();
    let mut pictures: Vec<Grey> = Vec::new();
    for (k, photo) in photos.iter().enumerate() {
        let truth = photo.posed();
        let size = photo.camera.size();
        let [w, h] = size.map(f64::from);
        let places: Vec<DVec3> = (0..400)
            .filter_map(|n| {
                let at = DVec2::new((f64::from(n % 20) + 0.5) / 20.0 * w, (f64::from(n / 20) + 0.5) / 20.0 * h);
                Some(session.shown_at(k, at)?.position)
            })
            .collect();
        if k >= posed.len() {
            let start = disturbed(&truth, &places, options.pose_error, &mut random);
            posed.push((start, options.pose_error));
        }
        let begin = Instant::now();
        let picture = grey(&cached(&session, k, &options), size);
        let rendered = begin.elapsed().as_secs_f64();
        let attempt = |pose: &PosedCamera, picture: &Grey| {
            let mut render = |camera: &PosedCamera, scale: f64| Ok::<_, Infallible>(model.draw(camera, scale));
            match refine(pose, picture, 1.0, &mut render, &settings) {
                Ok(result) => result,
                Err(never) => match never {},
            }
        };
        let begin = Instant::now();
        let result = attempt(&posed[k].0, &picture);
        let seconds = begin.elapsed().as_secs_f64();
        let before = error(&truth, &posed[k].0, &places);
        println!(
            "{} {:6} {before:6.2} px -> {} ({seconds:.1} s, simulated in {rendered:.1} s)",
            photo.name,
            format!("{:?}", photo.carrier),
            describe(&result, &truth, &places)
        );
        if let Ok(refined) = &result {
            accepted += 1;
            let after = error(&truth, &refined.camera, &places);
            if after <= 1.5 { good += 1 } else { wrong += 1 }
        }
        // A pose far off, and the photograph before instead of this one.
        if args.iter().any(|a| a == "quick") {
            continue;
        }
        let far = disturbed(&truth, &places, 200.0, &mut random);
        let other = pictures.iter().rev().find(|other| other.size() == picture.size());
        for (name, pose, picture) in
            [Some(("200 px", far, &picture)), other.map(|other| ("other", posed[k].0, other))].into_iter().flatten()
        {
            let result = attempt(&pose, picture);
            let is_wrong = result.as_ref().is_ok_and(|r| error(&truth, &r.camera, &places) > 1.5 || name == "other");
            tests += 1;
            false_accepted += u32::from(is_wrong);
            println!("    {name:8} -> {}", describe(&result, &truth, &places));
        }
        pictures.push(picture);
    }
    println!(
        "{good} of {} within 1.5 px, {wrong} accepted but worse, {} rejected; of {tests} hopeless ones {false_accepted} accepted",
        photos.len(),
        photos.len() - accepted
    );
}
