//! E57 that is written: what comes back when it is imported again.

use crate::support::{Site, ptx_header, seen_from};
use e57::{
    E57Writer, ImageFormat, PinholeImageProperties, Quaternion, Record, RecordDataType, RecordName, RecordValue,
};
use e57::{Transform, Translation, VisualReferenceImageProperties};
use kilwa_scan::ScanError;
use kilwa_scan::export::{Output, Report, Request, e57};
use kilwa_scan::import::Silent;
use kilwa_scan::mask::{self, Recipe, make};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::{Camera, Survey};
use kilwa_scan_core::{Grid, Kind, Sample};
use std::fmt::Write as _;
use std::fs::File;
use std::path::{Path, PathBuf};

const COLUMNS: u32 = 7;
const ROWS: u32 = 90;

/// A JPEG file as far as its size: 640 × 480.
const JPEG: &[u8] =
    b"\xff\xd8\xff\xe0\x00\x04ab\xff\xc0\x00\x11\x08\x01\xe0\x02\x80\x03\x01\x11\x00\x02\x11\x01\x03\x11\x01\xff\xd9";

/// A scan row by row with everything that a record can say, cells left out, directions without a return, and two photographs.
fn rich_e57(site: &Site) -> PathBuf {
    let path = site.path("rich.e57");
    let mut writer = E57Writer::from_file(&path, "file").unwrap();
    writer.set_coordinate_metadata(Some("EPSG:32737".to_owned()));
    let whole = |name, max| Record { name, data_type: RecordDataType::Integer { min: 0, max } };
    let float = |name| Record { name, data_type: RecordDataType::Single { min: None, max: None } };
    let prototype = vec![
        float(RecordName::CartesianX),
        float(RecordName::CartesianY),
        float(RecordName::CartesianZ),
        whole(RecordName::CartesianInvalidState, 2),
        float(RecordName::Intensity),
        whole(RecordName::IsIntensityInvalid, 1),
        Record::COLOR_RED_U8,
        Record::COLOR_GREEN_U8,
        Record::COLOR_BLUE_U8,
        whole(RecordName::IsColorInvalid, 1),
        whole(RecordName::RowIndex, i64::from(ROWS) - 1),
        whole(RecordName::ColumnIndex, i64::from(COLUMNS) - 1),
        whole(RecordName::ReturnIndex, 3),
        whole(RecordName::ReturnCount, 3),
    ];
    let mut cloud = writer.add_pointcloud("{A}", prototype).unwrap();
    cloud.set_name(Some("nave".to_owned()));
    cloud.set_sensor_model(Some("Model 5".to_owned()));
    let rotation = Quaternion { w: 0.8, x: 0.0, y: 0.0, z: 0.6 };
    let translation = Translation { x: 566_000.25, y: 9_010_000.125, z: 4.1 };
    let pose = Transform { rotation, translation };
    cloud.set_transform(Some(pose.clone()));
    let mut rng = fastrand::Rng::with_seed(5);
    for cell in 0..COLUMNS * ROWS {
        let (row, column) = (cell / COLUMNS, cell % COLUMNS);
        let is_last = cell + 1 == COLUMNS * ROWS;
        if rng.u8(..4) == 0 && !is_last {
            continue;
        }
        let state = i64::from(rng.u8(..6) == 0);
        let position = if state == 1 { [0.0, 0.6, -0.8] } else { [0; 3].map(|_: i32| rng.f32() * 60.0 - 30.0) };
        let (no_intensity, no_color) = (i64::from(rng.u8(..5) == 0), i64::from(rng.u8(..3) == 0));
        let mut values = position.map(RecordValue::Single).to_vec();
        let integer = |v: i64| RecordValue::Integer(v);
        values.extend([integer(state), RecordValue::Single(rng.f32() * 4096.0 - 100.0), integer(no_intensity)]);
        values.extend([0; 3].map(|_: i32| integer(i64::from(rng.u8(..)))));
        values.extend([integer(no_color), integer(i64::from(row)), integer(i64::from(column))]);
        values.extend([integer(i64::from(rng.u8(..3))), integer(3)]);
        cloud.add_point(values).unwrap();
    }
    cloud.finalize().unwrap();
    let mut image = writer.add_image("{B}").unwrap();
    image.set_pointcloud_guid("{A}");
    image.set_transform(pose);
    let properties = PinholeImageProperties {
        width: 640,
        height: 480,
        focal_length: 0.035,
        pixel_width: 1e-5,
        pixel_height: 1e-5,
        principal_x: 319.5,
        principal_y: 239.25,
    };
    image.add_pinhole(ImageFormat::Jpeg, &mut &*JPEG, properties, None).unwrap();
    image.finalize().unwrap();
    let mut image = writer.add_image("{C}").unwrap();
    image.set_pointcloud_guid("{A}");
    let properties = VisualReferenceImageProperties { width: 640, height: 480 };
    image.add_visual_reference(ImageFormat::Jpeg, &mut &*JPEG, properties, None).unwrap();
    image.finalize().unwrap();
    writer.finalize().unwrap();
    path
}

/// A grid from E57, a grid from PTX whose last column a mask hides, and an unstructured cloud; each with masks.
pub(crate) fn survey() -> Site {
    let site = Site::new();
    let mut ptx = ptx_header(COLUMNS, 3, [1.5, -2.0, 0.25]);
    for cell in 0..COLUMNS * 3 {
        let x = 0.1 + f64::from(cell) / 7.0;
        match cell {
            4 => ptx += "0 0 0 0.5\n",
            _ => writeln!(ptx, "{x} 2 -1 {}", f64::from(cell) / 100.0).unwrap(),
        }
    }
    let ptx = site.write("porch.ptx", ptx);
    let cloud =
        (0..50).map(|k| format!("{} {} 3.5 {} 1 2 {k}", 100 + k, 200.1 + f64::from(k), 300 + k)).collect::<Vec<_>>();
    let cloud = site.write("yard.xyz", cloud.join("\n") + "\n");
    site.import(&[rich_e57(&site), ptx, cloud], seen_from(100.0, 200.0, 1.5)).unwrap();
    let list =
        site.write("list.txt", (0..COLUMNS * ROWS).step_by(11).map(|k| k.to_string()).collect::<Vec<_>>().join("\n"));
    let mask = |name: &str, station: &str, recipe: Recipe| {
        let stations = vec![station.to_owned()];
        make(&site.survey(), &mask::Request { name: name.to_owned(), recipe, stations }, &Silent).unwrap();
    };
    let points =
        |list: &Path| Recipe::Points { list: list.to_owned(), column: None, numbering: Some(mask::Numbering::Cells) };
    mask("list", "nave", points(&list));
    mask("end", "porch", points(&site.write("end.txt", "18\n19\n20\n")));
    mask("first", "yard", points(&site.write("first.txt", "0\n7\n49\n")));
    site
}

pub(crate) fn export(site: &Site, stations: &[&str], unmasked: bool, to: &str) -> (Report, PathBuf) {
    let survey = Survey::open(&site.survey()).unwrap();
    let stations = stations.iter().map(|name| survey.station(name).unwrap()).collect();
    let folder = site.survey();
    let request = Request { folder: &folder, survey: &survey, stations, unmasked };
    let path = site.path(to);
    let file = File::options().read(true).write(true).create(true).truncate(true).open(&path).unwrap();
    let cannot = |source| ScanError::Write { path: PathBuf::new(), source };
    let mut last = 0;
    let mut progress = |done, total| {
        assert!(done >= last && done <= total);
        last = done;
        Ok(())
    };
    let report = e57(&request, &file, &mut Output { cannot: &cannot, progress: &mut progress }).unwrap();
    (report, path)
}

fn samples(site: &Site, station: &str, unmasked: bool) -> (Grid, Vec<Sample>) {
    let survey = Survey::open(&site.survey()).unwrap();
    let mut reader = mask::open(&site.survey(), survey.station(station).unwrap(), unmasked).unwrap();
    let (grid, mut out) = (reader.header().grid, Vec::new());
    reader.read(0, grid.cells() as usize, &mut out).unwrap();
    (grid, out)
}

fn bits(sample: &Sample) -> ([u32; 4], [u8; 3], u8) {
    let [x, y, z] = sample.position.to_array();
    let color = if sample.state.has_color() { sample.color } else { [0; 3] };
    let intensity = if sample.intensity.is_nan() { f32::NAN } else { sample.intensity };
    ([x, y, z, intensity].map(f32::to_bits), color, sample.state.to_byte())
}

#[test]
fn an_exported_e57_comes_back_with_every_sample_pose_and_photograph() {
    let site = survey();
    for unmasked in [false, true] {
        let names = ["nave", "porch", "yard"];
        let (report, file) = export(&site, &names, unmasked, "all.e57");
        let again = Site::new();
        let imported = again.import(&[file], ReadOptions::default()).unwrap();
        let (before, after) = (Survey::open(&site.survey()).unwrap(), Survey::open(&again.survey()).unwrap());
        assert_eq!(imported.stations.iter().map(|s| s.station.name.as_str()).collect::<Vec<_>>(), names);
        assert_eq!((&after.crs, before.crs.is_some()), (&before.crs, true));
        for (name, done) in names.into_iter().zip(&report.stations) {
            let (a, b) = (before.station(name).unwrap(), after.station(name).unwrap());
            let (pose, back) = (a.pose.unwrap(), b.pose.unwrap());
            assert!(back.translation == pose.translation && (back.rotation - pose.rotation).length() < 1e-15, "{name}");
            assert_eq!(a.instrument, b.instrument);
            let ((grid, mut wanted), (new, found)) = (samples(&site, name, unmasked), samples(&again, name, false));
            if name == "yard" {
                wanted.retain(|sample| sample.state.kind() != Kind::Empty);
            } else {
                assert_eq!(grid, new);
            }
            assert_eq!(done.points, wanted.iter().filter(|s| s.is_measured()).count() as u64);
            if name == "porch" && !unmasked {
                // The record that keeps the size of the grid.
                let corner = wanted.last_mut().unwrap();
                assert_eq!(corner.state.kind(), Kind::Empty);
                *corner = corner.without_return();
            }
            assert_eq!(wanted.len(), found.len());
            for (cell, (a, b)) in wanted.iter().zip(&found).enumerate() {
                assert_eq!(bits(a), bits(b), "{name}, cell {cell}, unmasked: {unmasked}");
            }
        }
        assert_eq!(report.photographs, 2);
        for (a, b) in before.photographs.iter().zip(&after.photographs) {
            let read = |site: &Site, file: &str| std::fs::read(site.survey().join(file)).unwrap();
            assert_eq!(read(&site, &a.file), read(&again, &b.file));
            assert_eq!((&a.station, &a.camera), (&b.station, &b.camera));
            assert_eq!(a.pose.map(|p| p.translation), b.pose.map(|p| p.translation));
        }
        assert!(matches!(after.photographs[0].camera, Some(Camera::Pinhole { size: [640, 480], .. })));
    }
}

#[test]
fn guids_and_bytes_of_an_exported_e57_follow_from_samples_masks_and_pose() {
    let site = survey();
    let guids = |names: &[&str], unmasked: bool| {
        let (_, file) = export(&site, names, unmasked, "one.e57");
        let bytes = std::fs::read(&file).unwrap();
        let reader = e57::E57Reader::from_file(&file).unwrap();
        let clouds: Vec<_> = reader.pointclouds().iter().map(|cloud| cloud.guid.clone().unwrap()).collect();
        (bytes, reader.guid().to_owned(), clouds)
    };
    let (bytes, file, clouds) = guids(&["nave", "yard"], false);
    assert!(guids(&["nave", "yard"], false).0 == bytes, "the same bytes again");
    assert_eq!((clouds[0].len(), clouds[0].as_bytes()[15], clouds[0].as_bytes()[20]), (38, b'8', b'8'), "{clouds:?}");
    let other = guids(&["yard", "nave"], false);
    assert_eq!([&other.2[1], &other.2[0]], [&clouds[0], &clouds[1]]);
    assert_ne!(other.1, file);
    assert_ne!(guids(&["nave", "yard"], true).2[0], clouds[0]);
    let toml = site.survey().join("survey.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text.replace("566000.25", "566000.5")).unwrap();
    let moved = guids(&["nave", "yard"], false).2;
    assert!(moved[0] != clouds[0] && moved[1] == clouds[1]);
}

#[test]
fn an_exported_e57_has_no_field_that_no_sample_needs_and_no_record_of_an_empty_cell() {
    let site = Site::new();
    let points = "1 2 3 0.5\n2 2 3 0.25\n3 2 3 0.75\n4 2 3 1\n";
    let plain = site.write("plain.ptx", format!("{}{points}", ptx_header(2, 2, [0.0; 3])));
    site.import(&[plain], ReadOptions::default()).unwrap();
    let fields = |unmasked| {
        let (_, file) = export(&site, &["plain"], unmasked, "plain.e57");
        let reader = e57::E57Reader::from_file(&file).unwrap();
        let cloud = reader.pointclouds().remove(0);
        let limits = cloud.intensity_limits.unwrap();
        let limits = [limits.intensity_min, limits.intensity_max].map(|v| match v {
            Some(RecordValue::Single(v)) => v,
            other => panic!("{other:?}"),
        });
        (cloud.records, limits, cloud.prototype.into_iter().map(|r| r.name).collect::<Vec<_>>())
    };
    let names = [
        RecordName::CartesianX,
        RecordName::CartesianY,
        RecordName::CartesianZ,
        RecordName::ColumnIndex,
        RecordName::RowIndex,
        RecordName::Intensity,
    ];
    assert_eq!(fields(false), (4, [0.25, 1.0], names.to_vec()));
    let recipe = Recipe::Intensity([0.3, 2.0]);
    let request = mask::Request { name: "low".to_owned(), recipe, stations: Vec::new() };
    make(&site.survey(), &request, &Silent).unwrap();
    assert_eq!(fields(false), (3, [0.5, 1.0], names.to_vec()));
}

#[test]
fn what_cannot_be_exported_is_refused_before_anything_is_written() {
    let site = survey();
    let survey = Survey::open(&site.survey()).unwrap();
    let folder = site.survey();
    let request =
        |survey| Request { folder: &folder, survey, stations: survey.stations.iter().collect(), unmasked: false };
    let cannot = |source| ScanError::Write { path: PathBuf::new(), source };
    let mut progress = |_, _| panic!("nothing is written");
    let mut text = Vec::new();
    let mut output = Output { cannot: &cannot, progress: &mut progress };
    let refused = kilwa_scan::export::ptx_file(&request(&survey), &mut text, &mut output).unwrap_err().to_string();
    assert!(refused.contains("station yard") && refused.contains("--e57"), "{refused}");
    let photograph = folder.join(&survey.photographs[1].file);
    std::fs::write(&photograph, "not a picture").unwrap();
    let file = tempfile::tempfile().unwrap();
    let refused = e57(&request(&survey), &file, &mut output).unwrap_err().to_string();
    assert!(refused.contains("-002.jpg") && refused.contains("JPEG"), "{refused}");
    std::fs::remove_file(&photograph).unwrap();
    let refused = e57(&request(&survey), &file, &mut output).unwrap_err().to_string();
    assert!(refused.contains("-002.jpg") && refused.contains("cannot be opened"), "{refused}");
}

/// PTX has intensities from 0 to 1: other ones are scaled, those of all stations of a file by one range.
#[test]
fn intensities_of_ptx_are_scaled_together_and_only_if_necessary() {
    let site = Site::new();
    for (name, intensities) in [("a", ["-2048", "2047"]), ("b", ["0.5", "1000"]), ("c", ["0.25", "1"])] {
        let points = intensities.map(|i| format!("1 2 3 {i}")).join("\n");
        let file = site.write(&format!("{name}.ptx"), format!("{}{points}\n", ptx_header(1, 2, [0.0; 3])));
        site.import(&[file], ReadOptions::default()).unwrap();
    }
    let survey = Survey::open(&site.survey()).unwrap();
    let folder = site.survey();
    let intensities = |names: &[&str]| {
        let stations = names.iter().map(|name| survey.station(name).unwrap()).collect();
        let request = Request { folder: &folder, survey: &survey, stations, unmasked: false };
        let cannot = |source| ScanError::Write { path: PathBuf::new(), source };
        let (mut text, mut progress) = (Vec::new(), |_, _| Ok(()));
        let mut output = Output { cannot: &cannot, progress: &mut progress };
        let report = kilwa_scan::export::ptx_file(&request, &mut text, &mut output).unwrap();
        let text = String::from_utf8(text).unwrap();
        let values = text.lines().filter_map(|l| l.strip_prefix("1 2 3 ")).map(|v| v.parse().unwrap()).collect();
        (report.scaled, values)
    };
    let (scaled, values): (_, Vec<f32>) = intensities(&["a", "b"]);
    let to_one = |v: f64| ((v + 2048.0) / 4095.0) as f32;
    assert_eq!((scaled, values), (Some([-2048.0, 2047.0]), vec![0.0, 1.0, to_one(0.5), to_one(1000.0)]));
    assert_eq!(intensities(&["c"]), (None, vec![0.25, 1.0]));
}

/// pye57 refuses fields for what is missing and for returns: rays without a return, and first returns, do not need them.
#[test]
fn rays_without_a_return_and_first_returns_need_no_fields_of_their_own() {
    let site = Site::new();
    let points = "1 2 3 0.5 1 2 3\n0 0 0 0.5 0 0 0\n3 2 3 0.75 4 5 6\n4 2 3 1 7 8 9\n";
    let grid = site.write("grid.ptx", format!("{}{points}", ptx_header(2, 2, [0.0; 3])));
    let cloud = crate::las::written(&site, "first.las", 7, 50);
    let mut bytes = std::fs::read(&cloud).unwrap();
    let at = u32::from_le_bytes(bytes[96..100].try_into().unwrap()) as usize;
    // The numbers of returns: all are the first.
    for point in bytes[at..].chunks_exact_mut(36 + 3) {
        point[14] = 0x11;
    }
    std::fs::write(&cloud, bytes).unwrap();
    site.import(&[grid, cloud], seen_from(566_040.0, 566_040.0, 566_001.5)).unwrap();
    let (_, file) = export(&site, &["grid", "first"], false, "both.e57");
    let reader = e57::E57Reader::from_file(&file).unwrap();
    for cloud in reader.pointclouds() {
        let names: Vec<_> = cloud.prototype.into_iter().map(|r| r.name).collect();
        let unwanted = [RecordName::IsIntensityInvalid, RecordName::IsColorInvalid, RecordName::ReturnIndex];
        assert!(unwanted.iter().all(|name| !names.contains(name)), "{names:?}");
        assert_eq!(names.contains(&RecordName::CartesianInvalidState), cloud.name.as_deref() == Some("grid"));
    }
}
