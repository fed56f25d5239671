//! Properties of simulated surveys.

use super::*;
use std::sync::LazyLock;

/// The fort of seed 1, which most tests share.
static SCENE: LazyLock<Scene> = LazyLock::new(|| Scene::new(1));

fn nothing(_: u64, _: u64) {}

/// A small survey: its options, its stations, and all samples of each.
fn scanned(options: &ScanOptions) -> Vec<(Station, Vec<Sample>)> {
    let survey = Survey::new(&SCENE, options).unwrap();
    survey.stations.iter().map(|station| (station.clone(), samples(&survey, station))).collect()
}

fn samples(survey: &Survey<'_>, station: &Station) -> Vec<Sample> {
    // The classes go nowhere: they are in the samples.
    let columns = survey.columns(station, tempfile::tempfile().unwrap());
    columns.flat_map(Result::unwrap).collect()
}

/// A sample in the fort's frame, by the true pose.
fn in_fort(station: &Station, point: DVec3) -> DVec3 {
    Scene::from_site(station.rotation * point + station.position)
}

static QUIET: LazyLock<Vec<(Station, Vec<Sample>)>> =
    LazyLock::new(|| scanned(&ScanOptions { noise: 0.0, ..ScanOptions::new(5, 150) }));

/// Numbers of a PTX file: its ten lines of header, and its samples.
fn read_ptx(path: &Path) -> (Vec<Vec<f64>>, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap();
    let number = |word: &str| word.parse::<f64>().unwrap_or_else(|_| panic!("{word} is no number"));
    let mut lines = text.lines().map(|line| line.split(' ').map(number).collect::<Vec<f64>>());
    (lines.by_ref().take(10).collect(), lines.collect())
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn surface_samples_without_noise_lie_on_the_true_surface_by_the_true_pose() {
    let (mut count, mut far) = (0, 0);
    for (station, samples) in &*QUIET {
        for sample in samples.iter().filter(|s| s.class == Class::Surface) {
            let Some(point) = sample.point else { panic!("a surface sample without a point") };
            let off = SCENE.value(in_fort(station, point)).abs();
            count += 1;
            // Bars of the grilles are no part of the field; the mean over a beam is a little off where the surface bends.
            far += usize::from(off > 0.004);
        }
    }
    assert!(count > 10_000, "{count}");
    assert!((far as f64) < 0.01 * f64::from(count), "{far} of {count} are off the surface");
}

#[test]
fn mixed_samples_are_off_the_surface_and_only_where_ranges_jump() {
    let (mut mixed, mut off, mut at_jump) = (0, 0, 0);
    for (station, samples) in &*QUIET {
        let (_, rows) = station.instrument.grid(150);
        let rows = rows as usize;
        for (k, sample) in samples.iter().enumerate().filter(|(_, s)| s.class == Class::Mixed) {
            let Some(point) = sample.point else { panic!("a mixed sample without a point") };
            mixed += 1;
            off += usize::from(SCENE.value(in_fort(station, point)).abs() > 0.004);
            let range = |k: usize| samples.get(k).and_then(|s| s.point).map_or(200.0, DVec3::length);
            let around = [k.wrapping_sub(1), k + 1, k.wrapping_sub(rows), k + rows];
            let jump = around.iter().any(|n| (range(*n) - point.length()).abs() > 0.02);
            at_jump += usize::from(jump);
        }
    }
    assert!(mixed > 100, "{mixed}");
    assert!(off * 10 > mixed * 5, "{off} of {mixed} are off the surface");
    assert!(at_jump * 100 > mixed * 95, "{at_jump} of {mixed} are where ranges jump");
}

#[test]
fn the_noise_of_ranges_is_as_large_as_the_instrument_says() {
    let options =
        ScanOptions { extras: Extras { walkers: false, grass: false, scaffolding: false }, ..ScanOptions::new(3, 100) };
    let noisy = scanned(&options);
    let quiet = scanned(&ScanOptions { noise: 0.0, ..options });
    for ((station, noisy), (_, quiet)) in noisy.iter().zip(&quiet) {
        let [a, ..] = station.instrument.noise;
        let pairs = noisy.iter().zip(quiet).filter(|(n, _)| n.class == Class::Surface);
        let off: Vec<f64> = pairs.filter_map(|(n, q)| Some(n.point?.length() - q.point?.length())).collect();
        let count = off.len() as f64;
        let mean = off.iter().sum::<f64>() / count;
        let sigma = (off.iter().map(|x| x * x).sum::<f64>() / count).sqrt();
        assert!(mean.abs() < 0.2 * a, "mean {mean}");
        // Range and incidence add to it.
        assert!((a..4.0 * a).contains(&sigma), "{}: {sigma}, not {a} and a little more", station.instrument.name);
    }
}

#[test]
fn stations_are_indoors_and_out_see_each_other_and_keep_their_distance() {
    for count in [1, 4, 12, 40] {
        let stations = stations::stations(&SCENE, 1, count);
        assert_eq!(stations.len(), count as usize);
        let indoors = stations.iter().filter(|s| s.indoors).count();
        let outside = |s: &&Station| {
            let p = Scene::from_site(s.position);
            p.x.abs() > 13.0 || p.y.abs() > 11.5
        };
        if count >= 4 {
            assert!(indoors > 0 && stations.iter().any(|s| outside(&s)), "{indoors} of {count} indoors");
        }
        for (k, station) in stations.iter().enumerate() {
            assert!(station.shared > 0.1, "station {} shares {}", k + 1, station.shared);
            let tilt = (station.rotation.z_axis.z).clamp(-1.0, 1.0);
            assert!(libm::acos(tilt).to_degrees() < 5.0 * TILT_DEGREES, "station {} leans", k + 1);
            let eye = Scene::from_site(station.position);
            assert!(SCENE.value(eye) > 0.2, "station {} stands in a wall", k + 1);
        }
    }
    assert_eq!(stations::stations(&SCENE, 1, 4), stations::stations(&SCENE, 1, 4));
    assert_ne!(stations::stations(&SCENE, 1, 4), stations::stations(&SCENE, 2, 4));
}

#[test]
fn walkers_are_elsewhere_for_each_station_and_every_class_occurs() {
    let survey = scanned(&ScanOptions::new(8, 200));
    let mut counts = [0_u64; CLASSES];
    let mut walkers = Vec::new();
    for (station, samples) in &survey {
        let mut here = 0;
        for sample in samples {
            counts[sample.class as usize] += 1;
            assert_eq!(sample.point.is_none(), matches!(sample.class, Class::Empty | Class::Dropout));
            if let (Class::Walker, Some(p)) = (sample.class, sample.point) {
                here += 1;
                walkers.push((station.number, in_fort(station, p)));
            }
        }
        assert!(here * 5 < samples.len(), "{here} of {} samples show people", samples.len());
    }
    for class in Class::ALL {
        assert!(counts[class as usize] > 0, "no sample is {}: {counts:?}", class.name());
    }
    let seen = |n: u32| walkers.iter().filter(move |(k, _)| *k == n).map(|(_, p)| *p);
    let middle = |n: u32| seen(n).sum::<DVec3>() / seen(n).count().max(1) as f64;
    let places: Vec<DVec3> = survey.iter().map(|(s, _)| middle(s.number)).collect();
    for (k, a) in places.iter().enumerate() {
        assert!(places[k + 1..].iter().all(|b| a.distance(*b) > 0.05), "people stand at the same place twice");
    }
}

#[test]
fn the_same_options_give_the_same_bytes_with_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    for format in [ScanFormat::Ptx, ScanFormat::E57] {
        let made = [1, 3].map(|threads| {
            let out = folder.path().join(format!("{}_{threads}", format.extension()));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let options = ScanOptions { format, truth_mesh: Some(20_000), ..ScanOptions::new(2, 40) };
            let report = pool.install(|| write(&options, &out, &mut nothing)).unwrap();
            let mut files = report.files.clone();
            files.extend(names(&report.truth).iter().map(|name| report.truth.join(name)));
            assert_eq!(files.len(), 2 + 4);
            files.iter().map(|file| fs::read(file).unwrap()).collect::<Vec<_>>()
        });
        assert!(made[0] == made[1], "{format:?}");
    }
}

#[test]
fn a_ptx_counts_its_samples_and_both_of_its_matrices_are_the_pose_of_the_truth() {
    let folder = tempfile::tempdir().unwrap();
    let rough = Poses::Rough { position: 0.3, heading: 3.0 };
    for (name, poses, surveyed, utm) in [
        ("true", Poses::True, 0, true),
        ("none", Poses::None, 0, false),
        ("rough", rough, 0, false),
        ("surveyed", rough, 1, true),
    ] {
        let out = folder.path().join(name);
        let options = ScanOptions { poses, surveyed, utm, ..ScanOptions::new(2, 30) };
        let report = write(&options, &out, &mut nothing).unwrap();
        let truth = fs::read_to_string(report.truth.join("poses.toml")).unwrap();
        let stations = stations::stations(&SCENE, 1, 2);
        for (file, station) in report.files.iter().zip(&stations) {
            let (head, samples) = read_ptx(file);
            let (columns, rows) = station.instrument.grid(30);
            assert_eq!((head[0][0], head[1][0]), (f64::from(columns), f64::from(rows)));
            assert_eq!(samples.len() as u32, columns * rows);
            assert!(samples.iter().all(|s| s.len() == 7 && (0.0..=1.0).contains(&s[3])));
            // Position and axes, and the same as a matrix.
            assert_eq!(head[2], head[9][..3]);
            for axis in 0..3 {
                assert_eq!((&head[3 + axis][..], head[6 + axis][3]), (&head[6 + axis][..3], 0.0));
            }
            let position = DVec3::from_slice(&head[2]);
            let x_axis = DVec3::from_slice(&head[3]);
            let origin = if utm { UTM_ORIGIN } else { DVec3::ZERO };
            let moved = position - station.position - origin;
            let poses = if station.number <= surveyed { Poses::True } else { poses };
            match poses {
                Poses::True => {
                    assert!(moved.length() < 1e-5 && x_axis.distance(station.rotation.x_axis) < 1e-9);
                }
                Poses::None => assert_eq!((position, x_axis), (DVec3::ZERO, DVec3::X)),
                Poses::Rough { .. } => {
                    assert!((0.01..2.0).contains(&moved.length()), "{moved}");
                    assert!(x_axis.distance(station.rotation.x_axis) < 0.3);
                }
            }
            let line = |p: DVec3| format!("[{:.6}, {:.6}, {:.6}]", p.x, p.y, p.z);
            assert!(truth.contains(&format!("\nposition = {}", line(station.position + origin))), "{truth}");
            assert!(truth.contains(&format!("\nwritten_position = {}", line(position))), "{truth}");
        }
    }
}

#[test]
fn classes_are_in_the_order_of_the_samples() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a");
    let report = write(&ScanOptions::new(1, 40), &out, &mut nothing).unwrap();
    let (head, samples) = read_ptx(&report.files[0]);
    let labels = fs::read(report.truth.join("scan_001.labels")).unwrap();
    assert_eq!(&labels[..8], b"KSYNLBL1");
    let number = |at: usize| u32::from_le_bytes(labels[at..at + 4].try_into().unwrap());
    assert_eq!((f64::from(number(8)), f64::from(number(12))), (head[0][0], head[1][0]));
    let labels = &labels[16..];
    assert_eq!(labels.len(), samples.len());
    for (label, sample) in labels.iter().zip(&samples) {
        let empty = sample[..3] == [0.0; 3];
        assert_eq!(empty, [Class::Empty as u8, Class::Dropout as u8].contains(label), "{label}: {sample:?}");
    }
    for class in Class::ALL {
        let count: u64 = labels.iter().map(|&label| u64::from(label == class as u8)).sum();
        assert_eq!(count, report.samples[class as usize], "{}", class.name());
    }
}

#[test]
fn an_e57_has_the_samples_and_the_pose_of_the_ptx() {
    let folder = tempfile::tempdir().unwrap();
    let file = |format: ScanFormat| {
        let out = folder.path().join(format.extension());
        write(&ScanOptions { format, ..ScanOptions::new(1, 40) }, &out, &mut nothing).unwrap().files[0].clone()
    };
    let (head, samples) = read_ptx(&file(ScanFormat::Ptx));
    let mut reader = ::e57::E57Reader::from_file(file(ScanFormat::E57)).unwrap();
    let clouds = reader.pointclouds();
    let [cloud] = &clouds[..] else { panic!("{} clouds", clouds.len()) };
    assert_eq!(cloud.records, samples.len() as u64);
    let pose = cloud.transform.clone().unwrap();
    let q = glam::DQuat::from_xyzw(pose.rotation.x, pose.rotation.y, pose.rotation.z, pose.rotation.w);
    for (k, axis) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
        assert!((q * axis).distance(DVec3::from_slice(&head[3 + k])) < 1e-9);
    }
    let rows = head[1][0] as i64;
    let mut simple = reader.pointcloud_simple(cloud).unwrap();
    simple.apply_pose(false);
    for (k, (point, sample)) in simple.zip(&samples).enumerate() {
        let point = point.unwrap();
        assert_eq!((point.column, point.row), (k as i64 / rows, k as i64 % rows));
        match point.cartesian {
            ::e57::CartesianCoordinate::Valid { x, y, z } => {
                assert!(DVec3::new(x, y, z).distance(DVec3::from_slice(sample)) < 1e-9);
            }
            _ => assert_eq!(sample[..3], [0.0; 3]),
        }
    }
}

#[test]
fn the_true_surface_lies_on_the_field_and_is_closed_but_for_the_border_of_the_ground() {
    let folder = tempfile::tempdir().unwrap();
    let options = ScanOptions { truth_mesh: Some(60_000), ..ScanOptions::new(1, 16) };
    let report = write(&options, &folder.path().join("a"), &mut nothing).unwrap();
    let triangles = report.truth_triangles.unwrap();
    assert!((40_000..90_000).contains(&triangles), "{triangles} triangles");
    let mesh = kilwa_formats::read::read_mesh(&report.truth.join("surface.ply"), &mut |_, _| {}).unwrap();
    assert_eq!(mesh.triangles.len() as u64, triangles);
    // The bars come last.
    let bars = figures::grilles(&SCENE).len() * 26;
    let own = &mesh.positions[..mesh.positions.len() - bars];
    let mut off: Vec<f64> = own.iter().map(|p| SCENE.value(Scene::from_site(*p)).abs()).collect();
    off.sort_by(f64::total_cmp);
    let at = |share: f64| off[(off.len() as f64 * share) as usize];
    assert!(at(0.5) < 0.002 && at(0.9) < 0.05, "{} {}", at(0.5), at(0.9));
    let mut edges = std::collections::HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            *edges.entry((t[k], t[(k + 1) % 3])).or_insert(0) += 1;
        }
    }
    let border = edges.keys().filter(|(a, b)| !edges.contains_key(&(*b, *a)));
    let inside = border.filter(|(a, _)| {
        let p = Scene::from_site(mesh.positions[*a as usize]);
        p.x.abs().max(p.y.abs()) < 27.0
    });
    let inside: Vec<DVec3> = inside.map(|(a, _)| Scene::from_site(mesh.positions[*a as usize])).collect();
    assert!(inside.is_empty(), "the true surface has holes at {inside:?}");
}

#[test]
fn interpolated_samples_lie_near_the_traced_ones() {
    let options = ScanOptions { noise: 0.0, trace_every: 4, ..ScanOptions::new(1, 205) };
    let [sparse, full] = [options.clone(), ScanOptions { trace_every: 1, ..options }].map(|options| scanned(&options));
    let (station, sparse, full) = (&full[0].0, &sparse[0].1, &full[0].1);
    assert_eq!(sparse.len(), full.len());
    let (columns, rows) = station.instrument.grid(205);
    assert!(columns % 4 != 0 && (rows - 1) % 4 != 0, "the last cells have the full size");
    let (mut off, mut same) = (Vec::new(), 0);
    for (k, (a, b)) in sparse.iter().zip(full).enumerate() {
        let (column, row) = (k as u32 / rows, k as u32 % rows);
        if column % 4 == 0 && (row % 4 == 0 || row + 1 == rows) {
            assert_eq!(a, b, "column {column}, row {row} is traced");
        }
        same += usize::from(a == b);
        if let (Some(p), Some(q)) = (a.point, b.point)
            && a.class == Class::Surface
            && b.class == Class::Surface
        {
            off.push(p.distance(q) / q.length());
        }
    }
    off.sort_unstable_by(f64::total_cmp);
    let far = off.iter().filter(|off| **off > 0.05).count();
    assert!(far * 100 < off.len(), "{far} of {} are far off the surface", off.len());
    assert!(same * 10 < full.len() * 7, "{same} of {} samples were traced or are empty", full.len());
    // A share of the range; traced rays are 0.12 apart.
    assert!(
        off[off.len() / 2] < 0.0025 && off[off.len() * 19 / 20] < 0.015,
        "{:?}",
        [1, 10, 19].map(|k| off[off.len() * k / 20])
    );
}

#[test]
fn impossible_options_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |options: &ScanOptions, name: &str| {
        write(options, &folder.path().join(name), &mut nothing).unwrap_err().to_string()
    };
    let good = ScanOptions::new(2, 40);
    assert!(refused(&ScanOptions { stations: 0, ..good.clone() }, "a").contains("ask for 1 to 1000"));
    assert!(refused(&ScanOptions { columns: 5, ..good.clone() }, "a").contains("ask for 16 to 40000"));
    assert!(refused(&ScanOptions { noise: f64::NAN, ..good.clone() }, "a").contains("the noise cannot be NaN"));
    assert!(refused(&ScanOptions { truth_mesh: Some(3), ..good.clone() }, "a").contains("triangles"));
    for asked in [0, 65] {
        let reason = refused(&ScanOptions { trace_every: asked, ..good.clone() }, "a");
        assert!(reason.contains("give a number from 1 to 64"), "{reason}");
    }
    let rough = Poses::Rough { position: -1.0, heading: 1.0 };
    assert!(refused(&ScanOptions { poses: rough, ..good.clone() }, "a").contains("positions cannot be -1"));
    assert!(names(folder.path()).is_empty());
    fs::write(folder.path().join("mine"), "x").unwrap();
    assert!(refused(&good, "mine").contains("already exists"));
    assert!(refused(&good, "mine/such").contains("mine"));
    fs::create_dir(folder.path().join("full")).unwrap();
    fs::write(folder.path().join("full/mine"), "x").unwrap();
    assert!(refused(&good, "full").contains("not empty"));
    assert_eq!(names(folder.path()), ["full", "mine"]);
}

#[test]
fn missing_folders_above_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("none/such");
    assert!(!write(&ScanOptions::new(2, 40), &out, &mut nothing).unwrap().files.is_empty());
    assert!(names(&folder.path().join("none")) == ["such"] && out.is_dir());
}

#[test]
fn progress_rises_to_the_number_of_samples() {
    let folder = tempfile::tempdir().unwrap();
    let (mut last, mut rising) = ((0, 0), true);
    let report = write(&ScanOptions::new(2, 40), &folder.path().join("a"), &mut |done, total| {
        rising &= done >= last.0;
        last = (done, total);
    });
    let samples: u64 = report.unwrap().samples.iter().sum();
    assert!(rising);
    assert_eq!(last, (samples, samples));
}
