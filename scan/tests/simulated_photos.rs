//! Simulated photographs and a simulated scan of the same fort, read together.

use crate::support::Site;
use glam::DVec2;
use kilwa_scan::photos::{self, Format, Frame, Options};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::Survey;
use kilwa_synth::photos::{Carrier, PhotoOptions, Session};
use kilwa_synth::scans::ScanOptions;

#[test]
fn simulated_photographs_are_read_with_their_true_cameras_and_panoramas_with_the_pose_of_their_station() {
    let site = Site::new();
    let scans = kilwa_synth::scans::write(&ScanOptions::new(1, 16), &site.path("scans"), &mut |_, _| {}).unwrap();
    site.import(&scans.files, ReadOptions::default()).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let options = PhotoOptions { panoramas: 1, ..PhotoOptions::new(4, (64, 48)) };
    let out = site.path("simulated");
    let written = kilwa_synth::photos::write(&options, &out, &mut |_, _| {}).unwrap();

    let read = Options { poses: None, stations: &survey.stations };
    let set = photos::read(&out.join("photos"), &read).unwrap();
    assert_eq!(set.poses.as_ref().map(|(format, _)| *format), Some(Format::ColmapText));
    assert_eq!((set.photos.len(), set.sparse_points.len() as u64), (5, written.points));
    let session = Session::new(&options).unwrap();
    for photo in session.photos() {
        let found = set.photos.iter().find(|p| p.name.contains(&photo.name)).unwrap();
        assert!(found.missing.is_empty(), "{}: {:?}", photo.name, found.missing);
        let posed = found.posed().unwrap();
        assert!(posed.position().distance(photo.position) < 1e-5);
        for k in 0..30 {
            let at = DVec2::new(f64::from(k * 7 % 64), f64::from(k * 5 % 48)) + 0.5;
            let Some(place) = (0..session.photos().len()).find_map(|n| session.shown_at(n, at)) else { continue };
            let pixels = (posed.project(place.position), photo.project(place.position));
            if let (Some(a), Some(b)) = pixels {
                assert!(a.distance(b) < 1e-3, "{}: {a} instead of {b}", photo.name);
            }
        }
        let is_panorama = photo.carrier == Carrier::Tripod;
        assert_eq!(found.station.as_deref(), is_panorama.then_some("scan_001"));
        assert_eq!(found.frame, if is_panorama { Frame::Survey } else { Frame::Reconstruction });
    }
}
