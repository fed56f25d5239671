//! Each format: what was written is what is in the survey.

use crate::support::{Site, ptx_header, seen_from};
use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
use glam::{DVec3, Vec3};
use kilwa_geometry::LengthUnit;
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::Survey;
use kilwa_scan_core::{Kind, Rays};

#[test]
fn ptx_keeps_grids_poses_empty_cells_intensity_and_colours_of_every_scan() {
    let site = Site::new();
    let points = "1.5 -2.25 0.125 0.5 10 20 30\n0 0 0 0.5 0 0 0\n1 2 3 0.25 255 0 1\n4 5 6 1 7 8 9\n-1 0 0 0 1 1 1\n0 0 1 0 2 2 2\n";
    // A quarter turn about z, as row vectors: x goes to y.
    let turned = "1\n2\n7 8 9\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n7 8 9 1\n1 0 0 0.5\r\n2 0 0 0.75";
    let file = site.write("a.ptx", format!("{}{points}{turned}", ptx_header(2, 3, [100.0, 200.0, 5.0])));
    let report = site.import(&[file], ReadOptions::default()).unwrap();
    assert_eq!(report.stations.len(), 2);
    let survey = Survey::open(&site.survey()).unwrap();
    let names: Vec<&str> = survey.stations.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["a", "a-2"]);
    let first = site.samples("a");
    assert_eq!(first[0].position, Vec3::new(1.5, -2.25, 0.125));
    assert_eq!((first[0].color, first[0].intensity), ([10, 20, 30], 0.5));
    assert_eq!(first[1].state.kind(), Kind::NoReturn);
    assert_eq!(first[3].position, Vec3::new(4.0, 5.0, 6.0));
    let header = report.stations[0].header;
    assert_eq!((header.grid.columns, header.grid.rows, header.is_grid), (2, 3, true));
    assert_eq!((header.statistics.measured, header.statistics.no_return, header.statistics.colored), (5, 1, 5));
    let second = site.samples("a-2");
    assert!(!second[0].state.has_color() && second[1].intensity == 0.75);
    let turned = survey.stations[1].pose.unwrap().apply(second[1].position.as_dvec3());
    assert!(turned.distance(DVec3::new(7.0, 10.0, 9.0)) < 1e-12, "{turned}");
    assert_eq!(survey.stations[1].source.number, 2);
}

#[test]
fn columns_of_text_are_read_in_every_form_and_units() {
    let site = Site::new();
    let forms = [
        ("a.xyz", "100 200 5\n101 202 8\n", None, None),
        ("b.txt", "X,Y,Z,I\n100,200,5,7\n101,202,8,0.5\n", Some(0.5), None),
        ("c.xyz", "# by hand\n100;200;5;1;2;3\n101;202;8;4;5;6\n", None, Some([4, 5, 6])),
        ("d.pts", "2\n100 200 5 -12 1 2 3\n101 202 8 -2048 4 5 6\n", Some(-2048.0), Some([4, 5, 6])),
        ("e.xyz", "100 200 5 0 0 1\n101 202 8 0.6 0.8 0\n", None, None),
    ];
    for (name, text, intensity, color) in forms {
        let file = site.write(name, text);
        let refused = site.import(std::slice::from_ref(&file), ReadOptions::default()).unwrap_err().to_string();
        assert!(refused.contains(name) && refused.contains("--station X,Y,Z"), "{refused}");
        let report = site.import(&[file], seen_from(100.0, 200.0, 5.0)).unwrap();
        let station = &report.stations[0].station;
        let samples = site.samples(&station.name);
        assert_eq!(samples[1].position, Vec3::new(1.0, 2.0, 3.0), "{name}");
        assert_eq!(samples[1].state.has_color().then_some(samples[1].color), color, "{name}");
        assert_eq!(Some(samples[1].intensity).filter(|v| !v.is_nan()), intensity, "{name}");
        assert_eq!(station.pose.unwrap().translation, DVec3::new(100.0, 200.0, 5.0));
    }
    let normals = site.write("f.xyz", "1 2 3 0 0 1.5\n");
    let report =
        site.import(&[normals], ReadOptions { units: LengthUnit::parse("mm").unwrap(), ..seen_from(0.0, 0.0, 0.0) });
    let report = report.unwrap();
    assert_eq!(report.diagnostics[0].1.count("normals of points dropped"), 1);
    assert_eq!(site.samples(&report.stations[0].station.name)[0].position, Vec3::new(0.001, 0.002, 0.003));
}

#[test]
fn columns_are_decided_once_for_a_cloud_by_a_heading_or_by_its_lines_and_doubts_are_reported() {
    let site = Site::new();
    let rich = |k: usize| (Some(k as f32), Some([7, 8, 9]));
    for (name, text, (intensity, color), doubts) in [
        ("a.xyz", "//X Y Z R G B Intensity\n1 2 3 7 8 9 200\n", rich(200), 0),
        ("b.xyz", "# x,y,z,i,r,g,b\n1,2,3,200,7,8,9\n", rich(200), 0),
        ("c.xyz", "1 2 3 200 7 8 9\n", rich(200), 1),
        ("d.xyz", "1 2 3 7 8 9 1200\n", rich(1200), 0),
        ("e.pts", "1\n1 2 3 200 7 8 9\n", rich(200), 0),
        ("f.pts", "//X Y Z R G B Intensity\n1\n1 2 3 7 8 9 200\n# the end\n", rich(200), 0),
        ("g.xyz", "1 2 3 0 0 1\n1 2 3 1 0 0\n", (None, None), 1),
        ("h.xyz", "X Y Z R G B\n1 2 3 0 0 1\n", (None, Some([0, 0, 1])), 0),
        ("i.xyz", "1 2 3 0.6 0.8 0\n1 2 3 0 0 1\n", (None, None), 0),
    ] {
        let file = site.write(name, text);
        let report = site.import(&[file], seen_from(0.0, 0.0, 0.0)).unwrap();
        let samples = site.samples(&report.stations[0].station.name);
        let last = samples[samples.len() - 1];
        assert_eq!(last.position, Vec3::new(1.0, 2.0, 3.0), "{name}");
        assert_eq!(Some(last.intensity).filter(|v| !v.is_nan()), intensity, "{name}");
        assert_eq!(last.state.has_color().then_some(last.color), color, "{name}");
        let found = report.diagnostics[0].1.iter().filter(|(kind, ..)| kind.starts_with("clouds ")).count();
        assert_eq!(found, doubts, "{name}");
    }
}

#[test]
fn a_given_position_moves_only_scans_that_state_none() {
    let site = Site::new();
    let far = DVec3::new(566_000.0, 9_010_000.0, 5.0);
    let ptx = site.write("a.ptx", format!("{}1 2 3 0.5\n", ptx_header(1, 1, [10.0, 0.0, 0.0])));
    let xyz = site.write("b.xyz", "566001 9010002 8\n");
    let grid = e57_grid(&site, "c.e57", false, false);
    let report = site.import(&[ptx, xyz, grid], seen_from(far.x, far.y, far.z)).unwrap();
    let at = |k: usize| report.stations[k].station.pose.map(|pose| pose.translation);
    assert_eq!([at(0), at(1), at(2)], [Some(DVec3::new(10.0, 0.0, 0.0)), Some(far), None]);
    for name in ["a", "b"] {
        assert_eq!(site.samples(name)[0].position, Vec3::new(1.0, 2.0, 3.0), "{name}");
    }
    assert_eq!(report.stations[2].header.origin, DVec3::ZERO);
    assert_eq!(report.stations[0].header.origin, DVec3::ZERO);
}

#[test]
fn the_position_of_scans_that_were_exported_in_coordinates_of_the_map_can_be_given() {
    let site = Site::new();
    let far = DVec3::new(566_000.0, 9_010_000.0, 5.0);
    let file = [site.write("a.ptx", format!("{}566001 9010002 8 0.5\n", ptx_header(1, 1, [0.0; 3])))];
    let message = site.import(&file, seen_from(far.x, far.y, far.z)).unwrap_err().to_string();
    assert!(message.contains("--override-position"), "{message}");
    let read = ReadOptions { override_position: true, ..seen_from(far.x, far.y, far.z) };
    let report = site.import(&file, read).unwrap();
    assert_eq!(site.samples("a")[0].position, Vec3::new(1.0, 2.0, 3.0));
    assert_eq!(report.stations[0].station.pose.unwrap().translation, far);
}

#[test]
fn photographs_of_an_e57_belong_to_their_scan_also_behind_an_empty_one() {
    let site = Site::new();
    let path = site.path("a.e57");
    let mut writer = E57Writer::from_file(&path, "file").unwrap();
    let prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
    for (name, points) in [("empty", 0_u8), ("north", 2), ("south", 3)] {
        let mut cloud = writer.add_pointcloud(name, prototype.clone()).unwrap();
        cloud.set_name(Some(name.to_owned()));
        for k in 0..points {
            cloud.add_point(vec![RecordValue::Single(f32::from(k)); 3]).unwrap();
        }
        cloud.finalize().unwrap();
    }
    for of in ["north", "south", "empty"] {
        let mut image = writer.add_image(of).unwrap();
        image.set_pointcloud_guid(of);
        let properties = e57::VisualReferenceImageProperties { width: 1, height: 1 };
        image.add_visual_reference(e57::ImageFormat::Jpeg, &mut &b"\xff\xd8"[..], properties, None).unwrap();
        image.finalize().unwrap();
    }
    writer.finalize().unwrap();
    drop(writer);
    site.import(&[path], seen_from(0.0, 0.0, 0.0)).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let numbers: Vec<_> = survey.stations.iter().map(|s| (s.name.as_str(), s.source.number)).collect();
    assert_eq!(numbers, [("north", 2), ("south", 3)], "the numbers of the scans in the file");
    let of: Vec<_> = survey.photographs.iter().map(|p| p.station.as_deref()).collect();
    assert_eq!(of, [Some("north"), Some("south"), None]);
}

fn record(name: RecordName, data_type: RecordDataType) -> Record {
    Record { name, data_type }
}

/// A grid of 3 columns and 2 rows, the lower left cell left out, as E57 in both orders.
fn e57_grid(site: &Site, name: &str, by_rows: bool, is_spherical: bool) -> std::path::PathBuf {
    let path = site.path(name);
    let mut writer = E57Writer::from_file(&path, "file").unwrap();
    let index = RecordDataType::Integer { min: 0, max: 2 };
    let state = if is_spherical { RecordName::SphericalInvalidState } else { RecordName::CartesianInvalidState };
    let mut prototype = if is_spherical {
        vec![Record::SPHERICAL_RANGE_F64, Record::SPHERICAL_AZIMUTH_F64, Record::SPHERICAL_ELEVATION_F64]
    } else {
        vec![Record::CARTESIAN_X_F64, Record::CARTESIAN_Y_F64, Record::CARTESIAN_Z_F64]
    };
    prototype.push(record(state, RecordDataType::Integer { min: 0, max: 2 }));
    prototype.push(Record::INTENSITY_U16);
    prototype.extend([Record::COLOR_RED_U8, Record::COLOR_GREEN_U8, Record::COLOR_BLUE_U8]);
    prototype.extend([record(RecordName::RowIndex, index.clone()), record(RecordName::ColumnIndex, index)]);
    let mut cloud = writer.add_pointcloud("cloud", prototype).unwrap();
    cloud.set_name(Some("Nave east".to_owned()));
    let cells: Vec<(i64, i64)> = if by_rows {
        (0..2).flat_map(|r| (0..3).map(move |c| (c, r))).collect()
    } else {
        (0..3).flat_map(|c| (0..2).map(move |r| (c, r))).collect()
    };
    for (c, r) in cells.into_iter().filter(|cell| *cell != (0, 0)) {
        let is_sky = (c, r) == (2, 1);
        let numbers =
            if is_spherical { [10.0 + c as f64, 0.1 * c as f64, 0.2 * r as f64] } else { [c as f64, r as f64, 5.0] };
        let mut values: Vec<RecordValue> = numbers.map(RecordValue::Double).to_vec();
        values.push(RecordValue::Integer(i64::from(is_sky)));
        values.push(RecordValue::Integer(100 * c));
        values.extend([10 * c, 20 * r, 255].map(RecordValue::Integer));
        values.extend([r, c].map(RecordValue::Integer));
        cloud.add_point(values).unwrap();
    }
    cloud.finalize().unwrap();
    writer.finalize().unwrap();
    path
}

#[test]
fn e57_keeps_its_grid_in_either_order_and_its_invalid_states() {
    let site = Site::new();
    for (name, by_rows, is_spherical) in [("a.e57", false, false), ("b.e57", true, false), ("c.e57", false, true)] {
        let file = e57_grid(&site, name, by_rows, is_spherical);
        let report = site.import(&[file], ReadOptions::default()).unwrap();
        let station = &report.stations[0].station;
        assert!(station.name.starts_with("Nave_east"), "{}", station.name);
        let path = site.survey().join(&station.scan);
        let header = *Reader::open(&path).unwrap().header();
        let grid = header.grid;
        assert_eq!((grid.columns, grid.rows, grid.by_rows, header.is_grid), (3, 2, by_rows, true), "{name}");
        let samples = site.samples(&station.name);
        let at = |c, r| samples[grid.cell(c, r) as usize];
        assert_eq!(at(0, 0).state.kind(), Kind::Empty);
        assert_eq!(at(2, 1).state.kind(), Kind::NoReturn);
        assert!((at(2, 1).position.length() - 1.0).abs() < 1e-6, "a direction");
        assert_eq!((at(2, 0).intensity, at(1, 1).color), (200.0, [10, 20, 255]));
        if is_spherical {
            let wanted =
                DVec3::new(11.0 * 0.2f64.cos() * 0.1f64.cos(), 11.0 * 0.2f64.cos() * 0.1f64.sin(), 11.0 * 0.2f64.sin());
            assert!(at(1, 1).position.as_dvec3().distance(wanted) < 1e-6);
        } else {
            assert_eq!(at(1, 1).position, Vec3::new(1.0, 1.0, 5.0));
        }
    }
}

#[test]
fn las_and_laz_give_the_same_points_with_returns_and_colours_of_either_depth() {
    let site = Site::new();
    for (name, full) in [("a.las", 1), ("b.laz", 1), ("c.las", 257)] {
        let mut builder = las::Builder::from((1, 2));
        builder.point_format = las::point::Format::new(2).unwrap();
        builder.point_format.is_compressed = name.ends_with("laz");
        let transform = las::Transform { scale: 0.001, offset: 1000.0 };
        builder.transforms =
            las::Vector { x: transform, y: transform, z: las::Transform { scale: 0.001, offset: 0.0 } };
        let path = site.path(name);
        let mut writer = las::Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
        for k in 0..100_u16 {
            let point = las::Point {
                x: 1000.0 + f64::from(k) * 0.25,
                y: 1001.0,
                z: 2.5,
                intensity: 10 * k,
                return_number: 1 + (k % 2) as u8,
                number_of_returns: 2,
                color: Some(las::Color { red: k * full, green: 200 * full, blue: 0 }),
                ..las::Point::default()
            };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        let report = site.import(&[path], seen_from(1000.0, 1000.0, 1.5)).unwrap();
        let samples = site.samples(&report.stations[0].station.name);
        assert_eq!(samples.len(), 100);
        assert_eq!(samples[40].position, Vec3::new(10.0, 1.0, 1.0), "{name}");
        assert_eq!((samples[40].color, samples[40].intensity), ([40, 200, 0], 400.0), "{name}");
        assert_eq!((samples[40].state.return_number(), samples[41].state.return_number()), (1, 2));
    }
}

#[test]
fn ply_range_grids_keep_their_cells_and_clouds_need_a_station() {
    let site = Site::new();
    let header = |count: usize, cells: &str| {
        format!(
            "ply\nformat ascii 1.0\nobj_info num_cols 3\nobj_info num_rows 2\nelement vertex {count}\nproperty float x\nproperty float y\nproperty float z\nproperty float intensity\n{cells}end_header\n"
        )
    };
    let vertices = "0 0 1 0.5\n0.1 0 1 0.5\n0 0.1 1 0.5\n0.1 0.1 1 0.75\n";
    let grid = "element range_grid 6\nproperty list uchar int vertex_indices\n";
    let file = site.write("grid.ply", format!("{}{vertices}1 0\n1 1\n0\n1 2\n1 3\n0\n", header(4, grid)));
    let report = site.import(&[file], ReadOptions::default()).unwrap();
    let found = report.stations[0].header;
    assert_eq!((found.grid.columns, found.grid.rows, found.is_grid), (3, 2, true));
    assert_eq!(found.rays, Rays::Parallel(DVec3::NEG_Z));
    let samples = site.samples("grid");
    let at = |c, r| samples[found.grid.cell(c, r) as usize];
    assert_eq!(at(1, 1).position, Vec3::new(0.1, 0.1, 1.0));
    assert_eq!((at(1, 1).intensity, at(2, 0).state.kind()), (0.75, Kind::Empty));

    let cloud = site.write("cloud.ply", format!("{}{vertices}", header(4, "")));
    assert!(
        site.import(std::slice::from_ref(&cloud), ReadOptions::default())
            .unwrap_err()
            .to_string()
            .contains("--station")
    );
    site.import(&[cloud], seen_from(0.0, 0.0, 1.0)).unwrap();
    assert_eq!(site.samples("cloud")[3].position, Vec3::new(0.1, 0.1, 0.0));
    let mesh = site.write(
        "mesh.ply",
        format!("{}{vertices}3 0 1 2\n", header(4, "element face 1\nproperty list uchar int vertex_indices\n")),
    );
    let refused = site.import(&[mesh], seen_from(0.0, 0.0, 0.0)).unwrap_err().to_string();
    assert!(refused.contains("is a mesh of 1 face") && refused.contains("kilwa build"), "{refused}");
}

#[test]
fn an_exported_ptx_comes_back_with_every_sample_and_its_pose() {
    let site = Site::new();
    let turned = "3\n2\n7 8 9\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n7 8 9 1\n";
    let points = "1.1 0.3 -0.7 0.5 1 2 3\n2.123456 0 0 0.75 4 5 6\n0 0 0 0.5 0 0 0\n1e-7 3 4 0 7 8 9\n5 6 7 1 0 0 0\n-1 -2 -3 0.1 255 254 253\n";
    let by_rows = e57_grid(&site, "b.e57", true, false);
    let ptx = site.write("a.ptx", format!("{turned}{points}"));
    site.import(&[by_rows, ptx], ReadOptions::default()).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    for station in &survey.stations {
        let mut reader = Reader::open(&site.survey().join(&station.scan)).unwrap();
        let grid = reader.header().grid;
        let mut text = Vec::new();
        let failed = |e| panic!("{e}");
        let pose = station.pose.unwrap_or_default();
        kilwa_scan::export::ptx(&mut reader, pose, None, &mut text, &failed, &mut |_, _| Ok(())).unwrap();
        let again = Site::new();
        let file = again.write("again.ptx", text);
        let report = again.import(&[file], ReadOptions::default()).unwrap();
        let back = report.stations[0].station.pose.unwrap();
        assert!(back.difference(pose).0 < 1e-7 && back.translation == pose.translation);
        let (before, after) = (site.samples(&station.name), again.samples("again"));
        let new = report.stations[0].header.grid;
        assert_eq!((new.columns, new.rows), (grid.columns, grid.rows));
        for column in 0..grid.columns {
            for row in 0..grid.rows {
                let (a, b) = (before[grid.cell(column, row) as usize], after[new.cell(column, row) as usize]);
                assert_eq!(a.is_measured(), b.is_measured());
                if a.is_measured() {
                    assert_eq!((a.position, a.intensity, a.color), (b.position, b.intensity, b.color));
                }
            }
        }
    }
}

#[test]
fn scans_that_are_probably_not_registered_or_share_a_given_position_are_reported() {
    let site = Site::new();
    let unregistered = format!("{}1 2 3 0.5\n", ptx_header(1, 1, [0.0; 3]));
    let two = site.write("two.ptx", unregistered.repeat(2));
    let placed = site.write("placed.ptx", format!("{}1 2 3 0.5\n", ptx_header(1, 1, [5.0, 0.0, 0.0])));
    let report = site.import(&[placed, two], ReadOptions::default()).unwrap();
    let doubts: Vec<Vec<u64>> =
        report.diagnostics.iter().map(|(_, all)| all.iter().map(|(_, count, _)| count).collect()).collect();
    assert_eq!(doubts, [vec![], vec![1]], "{:?}", report.diagnostics);
    let clouds = ["a.xyz", "bb.xyz", "ccc.xyz"].map(|name| site.write(name, format!("1 2 3 {}\n", name.len())));
    let report = site.import(&clouds, seen_from(1.0, 1.0, 1.0)).unwrap();
    let shared = |k: usize| {
        let (_, all) = &report.diagnostics[k];
        all.iter().find(|(kind, ..)| kind.contains("share the position of --station")).map(|(_, count, _)| count)
    };
    assert_eq!([shared(0), shared(1), shared(2)], [None, Some(1), Some(1)]);
}
