//! Simulated stations of the fort, merged.

use super::*;
use crate::import::{self, Silent};
use crate::register::{Placed, Placement, Registration, Unplaced};
use kilwa_synth::scans::{ScanOptions, write};

#[derive(Default, PartialEq)]
struct Mesh {
    begin: Option<Begin>,
    vertices: Vec<MergedVertex>,
    triangles: Vec<[u64; 3]>,
}

impl MergedSurface for Mesh {
    fn begin(&mut self, begin: &Begin) -> Result<(), ScanError> {
        self.begin = Some(*begin);
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        let mut vertex = *vertex;
        // So that vertices without an intensity are equal.
        if vertex.vertex.intensity.is_nan() {
            vertex.vertex.intensity = f32::MIN;
        }
        self.vertices.push(vertex);
        Ok(())
    }

    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError> {
        assert!(corners.iter().all(|k| *k < self.vertices.len() as u64), "a triangle before its vertices");
        self.triangles.push(corners);
        Ok(())
    }
}

/// A survey of small scans.
fn survey(folder: &Path, stations: u32, columns: u32) -> (PathBuf, Survey) {
    std::fs::create_dir_all(folder).unwrap();
    let (scans, survey) = (folder.join("scans"), folder.join("survey"));
    write(&ScanOptions::new(stations, columns), &scans, &mut |_, _| ()).unwrap();
    let mut files: Vec<PathBuf> = std::fs::read_dir(&scans).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|e| e == "ptx"));
    files.sort();
    import::import(&survey, &files, &import::Options::default(), &Silent).unwrap();
    let read = Survey::open(&survey).unwrap();
    (survey, read)
}

fn options(folder: &Path, voxel: f64) -> Options {
    Options {
        voxel: Some(voxel),
        memory: 200 << 20,
        threads: 2,
        scratch: folder.to_owned(),
        unmasked: false,
        bounds: None,
        fill: Fill::default(),
        intensity: Intensity::default(),
    }
}

fn merged(folder: &Path, survey: &Survey, options: &Options, tile_log2: u32) -> (Mesh, Report) {
    let mut mesh = Mesh::default();
    let stations = stations(folder, survey, options, &|_| mesh::Options::default()).unwrap();
    let report = merge_in_tiles(tile_log2, &stations, options, &mut mesh, &Silent).unwrap();
    (mesh, report)
}

#[test]
fn tiles_threads_memory_and_the_order_of_stations_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 200);
    let common = options(folder.path(), 0.15);
    let (mesh, report) = merged(&path, &survey, &common, 4);
    assert_eq!([report.vertices, report.triangles], [mesh.vertices.len() as u64, mesh.triangles.len() as u64]);
    assert!(report.triangles > 10_000, "{report:?}");
    for (tile_log2, threads) in [(1, 1), (2, 2), (3, 8)] {
        let (other, _) = merged(&path, &survey, &Options { threads, ..common.clone() }, tile_log2);
        assert!(other == mesh, "tiles of {} bricks, {threads} threads", 1 << tile_log2);
    }
    // So little memory that piles are written early and tiles are divided.
    let (other, _) = merged(&path, &survey, &Options { memory: 4 << 20, ..common.clone() }, 4);
    assert!(other == mesh, "with little memory");
    let mut turned = survey.clone();
    turned.stations.reverse();
    let (other, _) = merged(&path, &turned, &common, 3);
    assert!(other == mesh, "in another order");
}

#[test]
fn no_edge_has_more_than_two_triangles_and_every_vertex_is_used_once() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 300);
    let (mesh, _) = merged(&path, &survey, &options(folder.path(), 0.1), 2);
    let mut sides = std::collections::HashMap::new();
    let mut is_used = vec![false; mesh.vertices.len()];
    for [a, b, c] in &mesh.triangles {
        assert!(a != b && b != c && c != a);
        for [p, q] in [[a, b], [b, c], [c, a]] {
            *sides.entry([*p, *q]).or_insert(0) += 1;
            is_used[*p as usize] = true;
        }
    }
    // Each side at most once in each direction: two triangles an edge, facing the same way.
    assert!(sides.values().all(|count| *count == 1));
    assert!(is_used.iter().all(|is_used| *is_used));
    let mut places: Vec<[u64; 3]> =
        mesh.vertices.iter().map(|v| v.vertex.position.to_array().map(f64::to_bits)).collect();
    places.sort_unstable();
    places.dedup();
    assert_eq!(places.len(), mesh.vertices.len(), "vertices coincide");
}

#[test]
fn the_voxel_follows_from_the_data_and_a_box_limits_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let voxels = [150, 300].map(|columns| {
        let (path, survey) = self::survey(&folder.path().join(columns.to_string()), 1, columns);
        merged(&path, &survey, &Options { voxel: None, ..options(folder.path(), 1.0) }, 3).1.voxel
    });
    // Twice as dense, half the voxel.
    assert!((voxels[0] / voxels[1] - 2.0).abs() < 0.5, "{voxels:?}");
    let (path, survey) = survey(folder.path(), 2, 200);
    let bounds = [DVec3::new(-100.0, -100.0, 0.5), DVec3::new(100.0, 100.0, 1.5)];
    let (mesh, _) = merged(&path, &survey, &Options { bounds: Some(bounds), ..options(folder.path(), 0.2) }, 3);
    let [low, high] = mesh.begin.unwrap().bounds;
    for vertex in &mesh.vertices {
        let p = vertex.vertex.position;
        assert!(p.cmpge(low).all() && p.cmple(high).all());
        assert!(p.z > -0.5 && p.z < 2.5, "{p}");
        assert!(vertex.stations >= 1 && vertex.vertex.confidence > 0.0 && vertex.vertex.color.is_some());
    }
}

/// Each edge in each direction, and whether the reverse is missing.
fn borders(triangles: &[[u64; 3]]) -> usize {
    let sides = triangles.iter().flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]]);
    let all: std::collections::HashSet<[u64; 2]> = sides.clone().collect();
    assert_eq!(all.len(), 3 * triangles.len(), "an edge is used twice in the same direction");
    sides.filter(|[a, b]| !all.contains(&[*b, *a])).count()
}

#[test]
fn filled_surface_is_added_to_the_measured_one_and_marked() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 200);
    let common = options(folder.path(), 0.15);
    let (bare, bare_report) = merged(&path, &survey, &common, 3);
    assert_eq!(bare_report.filled, None);
    let fill = Fill { diffuse: true, max_area: 20.0, ..Fill::default() };
    let with = Options { fill, ..common.clone() };
    let (mesh, report) = merged(&path, &survey, &with, 3);
    let filled = report.filled.unwrap();
    assert!(filled.holes >= 5 && filled.area > 0.5, "{filled:?}");
    assert_eq!(filled.holes, report.borders.holes.iter().filter(|hole| hole.filled.is_some()).count());
    let (vertices, triangles) = (bare.vertices.len(), bare.triangles.len());
    assert!(mesh.vertices[..vertices] == bare.vertices && mesh.triangles[..triangles] == bare.triangles);
    assert_eq!(filled.triangles, (mesh.triangles.len() - triangles) as u64);
    assert!(mesh.vertices[vertices..].iter().all(|v| v.source == Source::Diffused && v.stations == 0));
    assert!(mesh.triangles[triangles..].iter().all(|t| t.iter().any(|k| *k >= vertices as u64)));
    // The rims of filled holes are no longer borders.
    let rims: usize = report.borders.holes.iter().filter(|hole| hole.filled.is_some()).map(|hole| hole.rim.len()).sum();
    assert!(borders(&mesh.triangles) <= borders(&bare.triangles) - rims, "of {rims}");
    let (other, _) = merged(&path, &survey, &Options { threads: 1, ..with }, 2);
    assert!(other == mesh, "the tiling matters");
}

#[test]
fn a_watertight_surface_has_no_border() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 200);
    let fill = Fill { watertight: true, ..Fill::default() };
    let (mesh, report) = merged(&path, &survey, &Options { fill, ..options(folder.path(), 0.2) }, 3);
    assert_eq!(borders(&mesh.triangles), 0);
    let [low, high] = mesh.begin.unwrap().bounds;
    assert!(mesh.vertices.iter().all(|v| v.vertex.position.cmpge(low).all() && v.vertex.position.cmple(high).all()));
    assert!(report.filled.unwrap().closed > 0);
    // No two vertices so close together that a mesh file would have them in one place.
    let mut places = std::collections::HashMap::new();
    for (k, v) in mesh.vertices.iter().enumerate() {
        let place = (v.vertex.position * 1e6).round().to_array().map(|x| x as i64);
        let other = places.insert(place, k);
        assert_eq!(other.map(|k| mesh.vertices[k]), None, "{k} {other:?} {v:?}");
    }
}

#[test]
fn what_cannot_be_merged_is_refused_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut survey) = survey(folder.path(), 2, 60);
    let refused = |survey: &Survey, options: &Options| {
        let mut mesh = Mesh::default();
        let how = |_: &survey::Station| mesh::Options::default();
        merge(&path, survey, options, &how, &mut mesh, &Silent).unwrap_err().to_string()
    };
    let common = options(folder.path(), 0.3);
    let nowhere = [DVec3::splat(5e3), DVec3::splat(5.1e3)];
    let text = refused(&survey, &Options { bounds: Some(nowhere), ..common.clone() });
    assert!(text.contains("no station has points in the box"), "{text}");
    let text = refused(&survey, &Options { voxel: Some(1e-6), ..common.clone() });
    assert!(text.contains("give a size from"), "{text}");
    survey.stations[1].pose = None;
    let text = refused(&survey, &common);
    assert!(text.contains(&survey.stations[1].name) && text.contains("no pose"), "{text}");
    survey.stations.clear();
    let text = refused(&survey, &common);
    assert!(text.contains("scans import"), "{text}");
}

#[test]
fn filling_from_coarser_voxels_and_a_mesh_does_not_depend_on_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 200);
    // A floor of 20 × 20 m in two triangles. What scans have seen of it gets no second layer.
    let floor = folder.path().join("floor.obj");
    std::fs::write(&floor, "v -10 -10 0\nv 10 -10 0\nv 10 10 0\nv -10 10 0\nf 1 2 3\nf 1 3 4\n").unwrap();
    let common = options(folder.path(), 0.25);
    let (bare, _) = merged(&path, &survey, &common, 3);
    let (vertices, triangles) = (bare.vertices.len(), bare.triangles.len());
    for (mesh, source) in [(None, Source::Coarser), (Some(floor), Source::Mesh)] {
        let fill = Fill { coarser: mesh.is_none(), mesh, ..Fill::default() };
        let with = Options { fill, ..common.clone() };
        let (filled, report) = merged(&path, &survey, &with, 3);
        assert!(filled.vertices[..vertices] == bare.vertices && filled.triangles[..triangles] == bare.triangles);
        assert!(filled.vertices.len() > vertices && filled.vertices[vertices..].iter().all(|v| v.source == source));
        assert!(filled.triangles[triangles..].iter().all(|t| t.iter().any(|k| *k >= vertices as u64)));
        let report = report.filled.unwrap();
        let (before, after) = (borders(&bare.triangles), borders(&filled.triangles));
        if source == Source::Coarser {
            assert!(report.holes > 0 && after < before, "{report:?}, {before} to {after}");
        } else {
            assert!(report.mesh_area > 1.0 && report.mesh_area < 200.0, "{report:?}");
        }
        let (other, _) = merged(&path, &survey, &Options { threads: 1, ..with }, 2);
        assert!(other == filled, "the tiling matters to {source:?}");
    }
}

#[test]
fn scratch_space_is_estimated_before_it_is_needed() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 3, 300);
    let bounds = [DVec3::new(-8.0, -8.0, -20.0), DVec3::new(8.0, 8.0, 20.0)];
    for (voxel, tile_log2, bounds) in [(0.5, 3, None), (0.1, 1, None), (0.1, 3, Some(bounds)), (0.03, 3, None)] {
        let (_, report) = merged(&path, &survey, &Options { bounds, ..options(folder.path(), voxel) }, tile_log2);
        let ratio = report.scratch_estimated as f64 / report.scratch_bytes as f64;
        assert!((0.75..1.5).contains(&ratio), "{ratio} at {voxel} m in tiles of {}", 1 << tile_log2);
    }
    // More than any disk has: refused before a triangle is cut.
    let common = options(folder.path(), 1e-4);
    let mut mesh = Mesh::default();
    let how = |_: &survey::Station| mesh::Options::default();
    let text = merge(&path, &survey, &common, &how, &mut mesh, &Silent).unwrap_err().to_string();
    assert!(text.contains("scratch space") && text.contains("--voxel") && text.contains("TiB"), "{text}");
    assert!(mesh.begin.is_none());
}

#[test]
fn a_mesh_that_does_not_fit_the_survey_is_refused_and_one_with_y_up_is_turned() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 2, 60);
    let refused = |text: &str| {
        let file = folder.path().join("mesh.obj");
        std::fs::write(&file, text).unwrap();
        let fill = Fill { mesh: Some(file), ..Fill::default() };
        let mut mesh = Mesh::default();
        let how = |_: &survey::Station| mesh::Options::default();
        merge(&path, &survey, &Options { fill, ..options(folder.path(), 0.3) }, &how, &mut mesh, &Silent)
            .map(|report| report.filled)
            .map_err(|e| e.to_string())
    };
    let far = refused("v 5000 0 0\nv 5001 0 0\nv 5000 1 0\nf 1 2 3\n").unwrap_err();
    assert!(far.contains("mesh.obj does not fit the survey") && far.contains("survey coordinates"), "{far}");
    let millimetres = refused("v -9000 -9000 0\nv 9000 -9000 0\nv 0 9000 0\nf 1 2 3\n").unwrap_err();
    assert!(millimetres.contains("does not fit the survey"), "{millimetres}");
    // A vertex that no triangle uses does not count.
    let stray = refused("v 1 1 0.5\nv 2 1 0.5\nv 1 2 0.5\nv 1e30 0 0\nf 1 2 3\n");
    assert!(stray.is_ok(), "{stray:?}");
    let gltf = folder.path().join("mesh.gltf");
    let data = "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA";
    std::fs::write(
        &gltf,
        format!(
            r#"{{"asset":{{"version":"2.0"}},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}}],
        "bufferViews":[{{"buffer":0,"byteLength":36}}],
        "buffers":[{{"byteLength":36,"uri":"data:application/octet-stream;base64,{data}"}}]}}"#
        ),
    )
    .unwrap();
    let around = [DVec3::splat(-10.0), DVec3::splat(10.0)];
    let [low, high] = PatchMesh::read(&gltf, around, &Silent).unwrap().bounds;
    // The y of the file is up.
    assert!(low.abs_diff_eq(DVec3::ZERO, 1e-6) && high.abs_diff_eq(DVec3::new(1.0, 0.0, 1.0), 1e-6), "{low} {high}");
}

/// Writes a registration of the stations of a survey with these standard deviations: of the position (metres) and of the rotation (radians).
fn register(folder: &Path, survey: &Survey, sigmas: &[[f64; 2]]) {
    let placed = |(station, [metres, radians]): (&survey::Station, &[f64; 2])| {
        let pose = station.pose.unwrap();
        let mut covariance = [[0.0; 6]; 6];
        for k in 0..3 {
            covariance[k][k] = radians * radians;
            covariance[k + 3][k + 3] = metres * metres;
        }
        Placed::new(station, Placement::Surface, pose, covariance)
    };
    let stations = survey.stations.iter().zip(sigmas).map(placed).collect();
    Registration { stations, ..Registration::empty() }.save(folder).unwrap();
}

#[test]
fn the_uncertainty_of_vertices_follows_from_the_poses_of_their_stations() {
    let folder = tempfile::tempdir().unwrap();
    let (path, survey) = survey(folder.path(), 2, 200);
    let common = options(folder.path(), 0.15);
    let (bare, bare_report) = merged(&path, &survey, &common, 3);
    assert_eq!(bare_report.accuracy, Accuracy::Unknown);
    assert!(bare.begin.unwrap().registration.is_none() && bare.vertices.iter().all(|v| v.registration.is_none()));
    // Only positions are uncertain, so the uncertainty is the same in every direction.
    let sigmas = [[0.001, 0.0], [0.004, 0.0]];
    register(&path, &survey, &sigmas);
    let (mesh, report) = merged(&path, &survey, &common, 3);
    // The surface itself is the same.
    assert!(mesh.triangles == bare.triangles);
    let without = |v: &MergedVertex| MergedVertex { registration: None, ..*v };
    assert!(mesh.vertices.iter().map(without).eq(bare.vertices.iter().copied()));
    let [least, greatest] = sigmas.map(|[metres, _]| accuracy::kept(metres * metres));
    assert_eq!(mesh.begin.unwrap().registration, Some(greatest));
    let of = |v: &MergedVertex| v.registration.unwrap();
    assert!(mesh.vertices.iter().all(|v| (least..=greatest).contains(&of(v))));
    let (one, two): (Vec<&MergedVertex>, Vec<&MergedVertex>) = mesh.vertices.iter().partition(|v| v.stations == 1);
    assert!(one.iter().any(|v| of(v) == least) && one.iter().any(|v| of(v) == greatest));
    assert!(two.iter().filter(|v| of(v) > least && of(v) < greatest).count() > two.len() / 2);
    let Accuracy::Known(Parts { registration, instrument }) = report.accuracy else { panic!("{report:?}") };
    assert!(registration > 0.001 && registration < 0.004, "{registration}");
    // 2 mm and 10 ppm, less where both stations saw the surface.
    assert!(instrument > 0.001_4 && instrument < 0.002_3, "{instrument}");
    // The result does not depend on tiles, threads or the order of stations.
    let (other, other_report) = merged(&path, &survey, &Options { threads: 1, memory: 4 << 20, ..common.clone() }, 4);
    assert!(other == mesh && other_report.accuracy == report.accuracy);
    let mut turned = survey.clone();
    turned.stations.reverse();
    let (other, other_report) = merged(&path, &turned, &common, 2);
    assert!(other == mesh && other_report.accuracy == report.accuracy);
    // Filled surface is no more certain than the least certain point; its value is up to the caller.
    let fill = Fill { diffuse: true, max_area: 20.0, ..Fill::default() };
    let (filled, filled_report) = merged(&path, &survey, &Options { fill, ..common.clone() }, 3);
    assert!(filled.vertices.iter().all(|v| v.registration.is_some() == (v.source == Source::Scans)));
    assert!(filled.vertices.len() > mesh.vertices.len() && filled_report.accuracy == report.accuracy);
    // A rotation matters more the farther away a surface is.
    register(&path, &survey, &[[0.001, 0.0], [0.001, 0.001]]);
    let (rotated, _) = merged(&path, &survey, &common, 3);
    let center = survey.stations[1].pose.unwrap().translation;
    let second: Vec<_> = rotated.vertices.iter().filter(|v| v.stations == 1 && of(v) > least).collect();
    let fits = |v: &&&MergedVertex| {
        let distance = v.vertex.position.distance(center);
        // Around two of three axes.
        let wanted = f64::hypot(0.001, 0.001 * distance * (2.0_f64 / 3.0).sqrt());
        (f64::from(of(v)) / wanted - 1.0).abs() < 0.02
    };
    // Between two voxels that different stations saw, it is a mixture.
    let fitting = second.iter().filter(fits).count();
    assert!(second.len() > 500 && fitting as f64 > 0.95 * second.len() as f64, "{fitting} of {}", second.len());
}

#[test]
fn the_uncertainty_of_a_changed_pose_is_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut survey) = survey(folder.path(), 2, 120);
    let common = options(folder.path(), 0.2);
    let accuracy = |survey: &Survey, options: &Options| {
        let (mesh, report) = merged(&path, survey, options, 3);
        (mesh.begin.unwrap().registration, report.accuracy)
    };
    // The same everywhere: no value per vertex is needed.
    register(&path, &survey, &[[0.002, 0.0]; 2]);
    let (registration, known) = accuracy(&survey, &common);
    let Accuracy::Known(parts) = known else { panic!("{known:?}") };
    assert!(registration.is_none() && (parts.registration - 0.002).abs() < 1e-6, "{parts:?}");
    // The standard deviations in survey.toml are those of the pose that was registered, unless new ones are stated.
    survey.stations[1].sigma = Some([0.002, 0.0]);
    survey.stations[1].pose.as_mut().unwrap().translation.x += 1e-4;
    let name = survey.stations[1].name.clone();
    let unknown = |reason| Accuracy::Incomplete(vec![UnknownPose { station: name.clone(), reason }]);
    assert_eq!(accuracy(&survey, &common), (None, unknown(Reason::Changed)));
    let mut renamed = survey.clone();
    renamed.stations[1].name = "renamed".to_owned();
    let pose = UnknownPose { station: "renamed".to_owned(), reason: Reason::Changed };
    assert_eq!(accuracy(&renamed, &common), (None, Accuracy::Incomplete(vec![pose])));
    survey.stations[1].sigma = Some([0.002, 0.001]);
    let (registration, known) = accuracy(&survey, &common);
    assert!(registration > Some(0.002) && matches!(known, Accuracy::Known(_)), "{known:?}");
    // Without the registration, those in survey.toml count.
    std::fs::remove_file(path.join(crate::register::FILE)).unwrap();
    survey.stations[0].sigma = Some([0.001, 0.0005]);
    let (registration, known) = accuracy(&survey, &common);
    assert!(registration.is_some() && matches!(known, Accuracy::Known(_)), "{known:?}");
    survey.stations[1].sigma = None;
    assert_eq!(accuracy(&survey, &common), (None, unknown(Reason::Unstated)));
    survey.stations[0].sigma = None;
    assert_eq!(accuracy(&survey, &common), (None, Accuracy::Unknown));
    // A station that has no part in the surface does not matter.
    survey.stations[0].sigma = Some([0.001, 0.0005]);
    survey.stations[1].pose.as_mut().unwrap().translation.x += 500.0;
    let around = survey.stations[0].pose.unwrap().translation;
    let bounds = Some([around - 50.0, around + 50.0]);
    let (_, known) = accuracy(&survey, &Options { bounds, ..common.clone() });
    assert!(matches!(known, Accuracy::Known(_)), "{known:?}");
    std::fs::write(path.join(crate::register::FILE), "{}").unwrap();
    let Err(refused) = stations(&path, &survey, &common, &|_| mesh::Options::default()) else { panic!() };
    assert!(refused.to_string().contains("`kilwa register --again`, or remove the file"), "{refused}");
}

#[test]
fn a_given_pose_has_its_stated_uncertainty_and_that_of_an_unplaced_station_is_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let (path, mut survey) = survey(folder.path(), 2, 120);
    let common = options(folder.path(), 0.2);
    register(&path, &survey, &[[0.0, 0.0]; 2]);
    let mut registration = Registration::open(&path).unwrap().unwrap();
    // Two fixed stations have no uncertainty relative to each other, unless the survey states one.
    registration.stations.iter_mut().for_each(|placed| placed.placement = Placement::Fixed);
    registration.save(&path).unwrap();
    let (mesh, report) = merged(&path, &survey, &common, 3);
    let Accuracy::Known(exact) = report.accuracy else { panic!("{report:?}") };
    assert!(mesh.begin.unwrap().registration.is_none() && exact.registration == 0.0 && exact.instrument > 0.001);
    survey.stations[1].sigma = Some([0.003, 0.001]);
    let (mesh, report) = merged(&path, &survey, &common, 3);
    let Accuracy::Known(parts) = report.accuracy else { panic!("{report:?}") };
    assert!(mesh.begin.unwrap().registration > Some(0.003) && parts.registration > 0.001, "{parts:?}");
    // For a pose that was not given, the standard deviations of the registration apply.
    registration.stations[1].placement = Placement::Surface;
    registration.save(&path).unwrap();
    let (_, report) = merged(&path, &survey, &common, 3);
    assert_eq!(report.accuracy, Accuracy::Known(exact));
    let Placed { name, .. } = registration.stations.pop().unwrap();
    let (reason, remedy) = ("no overlap".to_owned(), "scan again".to_owned());
    registration.unplaced =
        vec![Unplaced { name: name.clone(), scan: String::new(), reason, candidates: Vec::new(), remedy }];
    registration.save(&path).unwrap();
    let (_, report) = merged(&path, &survey, &common, 3);
    let reason = Reason::Unplaced;
    assert_eq!(report.accuracy, Accuracy::Incomplete(vec![UnknownPose { station: name, reason }]));
}
