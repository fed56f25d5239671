use crate::camera::{Camera, PosedCamera};
use crate::photo_pose::icp::{SurfaceFitError, fit_to_surface};
use crate::photo_pose::similarity::{FrameError, Pair, Similarity};
use crate::photo_pose::surface::Surface;
use crate::pose::Pose;
use glam::{DQuat, DVec3};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-size..size).prop_map(DVec3::from_array)
}

fn similarity() -> impl Strategy<Value = Similarity> {
    (vector(3.0), vector(100.0), 0.05..20.0_f64).prop_map(|(axis, translation, scale)| Similarity {
        scale,
        rotation: DQuat::from_scaled_axis(axis),
        translation,
    })
}

/// Places that are not on a line.
const PLACES: [DVec3; 6] = [
    DVec3::new(1.0, 2.0, 0.5),
    DVec3::new(-3.0, 4.0, 1.5),
    DVec3::new(2.0, -5.0, 2.5),
    DVec3::new(7.0, 1.0, -0.5),
    DVec3::new(-6.0, -3.0, 3.0),
    DVec3::new(0.0, 6.0, 5.0),
];

fn pairs(similarity: &Similarity, count: usize) -> Vec<Pair> {
    let pair = |p: &DVec3| Pair { survey: *p, reconstruction: similarity.inverse().apply(*p), sigma: 0.01 };
    PLACES[..count].iter().map(pair).collect()
}

proptest! {
    #[test]
    fn pairs_give_their_similarity(similarity in similarity(), count in 3_usize..=6, p in vector(50.0)) {
        let fit = Similarity::from_pairs(&pairs(&similarity, count)).unwrap();
        prop_assert!(fit.rms < 1e-8, "{}", fit.rms);
        let there = similarity.inverse().apply(p);
        prop_assert!(fit.similarity.apply(there).distance(p) < 1e-7);
        prop_assert!(similarity.then(&similarity.inverse()).apply(p).distance(p) < 1e-9);
    }

    #[test]
    fn a_camera_sees_the_same_in_both_frames(similarity in similarity(), axis in vector(2.0), at in vector(5.0), p in vector(5.0)) {
        let camera = Camera::equirectangular([1000, 500]).unwrap();
        let camera = PosedCamera { camera, camera_from_world: Pose { rotation: DQuat::from_scaled_axis(axis), translation: at } };
        let moved = similarity.camera(&camera);
        prop_assert!(moved.position().distance(similarity.apply(camera.position())) < 1e-6 * similarity.scale + 1e-9);
        if let (Some(a), Some(b)) = (camera.ray(glam::DVec2::new(300.0, 200.0)), moved.ray(glam::DVec2::new(300.0, 200.0))) {
            prop_assert!((similarity.rotation * a).distance(b) < 1e-9);
        }
        let offset = camera.camera_from_world.apply(p) * similarity.scale;
        prop_assert!(moved.camera_from_world.apply(similarity.apply(p)).distance(offset) < 1e-7);
    }

    #[test]
    fn a_wrong_pair_is_named(similarity in similarity(), wrong in 0_usize..6, offset in 0.3..3.0_f64) {
        let mut pairs = pairs(&similarity, 6);
        pairs[wrong].survey += DVec3::new(0.6, -0.48, 0.64) * offset;
        match Similarity::from_pairs(&pairs) {
            Err(FrameError::Contradiction { pair, distance, .. }) => {
                prop_assert_eq!(pair, wrong);
                prop_assert!((distance - offset).abs() < 1e-6, "{} {}", distance, offset);
            }
            other => prop_assert!(false, "{:?}", other),
        }
    }

    #[test]
    fn the_nearest_point_is_that_of_a_full_search(points in prop::collection::vec(vector(2.0), 1..60), at in vector(3.0), reach in 0.1..4.0_f64) {
        let surface = Surface::new(points.iter().map(|p| (*p, DVec3::Z)));
        let best = points.iter().copied().min_by(|a, b| a.distance(at).total_cmp(&b.distance(at))).unwrap();
        let found = surface.nearest(at, reach).map(|(p, _)| p.distance(at));
        prop_assert_eq!(found, (best.distance(at) <= reach).then(|| best.distance(at)));
    }
}

#[test]
fn few_collinear_and_contradicting_pairs_are_refused() {
    let one = Similarity { scale: 3.0, ..Similarity::IDENTITY };
    assert_eq!(Similarity::from_pairs(&pairs(&one, 2)), Err(FrameError::Few { pairs: 2 }));
    let line: Vec<Pair> = (0..5)
        .map(|k| DVec3::new(1.0, 2.0, 3.0) * f64::from(k))
        .map(|p| Pair { survey: p, reconstruction: p * 2.0, sigma: 0.01 })
        .collect();
    assert_eq!(Similarity::from_pairs(&line), Err(FrameError::Line));
    let mut bad = pairs(&one, 4);
    bad[1].reconstruction.x = f64::NAN;
    assert_eq!(Similarity::from_pairs(&bad), Err(FrameError::Unusable { pair: 1 }));
    // With four pairs it is unknown which one is wrong: any three always fit to a good part.
    let mut bad = pairs(&one, 4);
    bad[2].survey += DVec3::new(0.0, 2.0, 2.0);
    assert!(matches!(Similarity::from_pairs(&bad), Err(FrameError::Contradictions { .. })));
    // Two wrong ones.
    let mut bad = pairs(&one, 6);
    bad[2].survey += DVec3::new(0.0, 2.0, 2.0);
    bad[5].survey += DVec3::new(1.0, -1.0, 0.5);
    let error = Similarity::from_pairs(&bad).unwrap_err();
    assert!(matches!(error, FrameError::Contradictions { .. }));
    assert!(error.to_string().contains("contradict"), "{error}");
}

/// A room with a step in it, 0.1 m apart, and points on it.
fn room() -> (Surface, Vec<DVec3>) {
    let mut feet = Vec::new();
    let mut points = Vec::new();
    let mut random = fastrand::Rng::with_seed(4);
    let sides = [
        (DVec3::ZERO, DVec3::X * 6.0, DVec3::Y * 4.0),
        (DVec3::ZERO, DVec3::Y * 4.0, DVec3::Z * 3.0),
        (DVec3::ZERO, DVec3::Z * 3.0, DVec3::X * 6.0),
        (DVec3::X * 6.0, DVec3::Y * 4.0, DVec3::new(0.5, 0.0, 3.0)),
        (DVec3::Y * 4.0, DVec3::X * 6.0, DVec3::new(0.0, 0.3, 3.0)),
        (DVec3::new(2.0, 1.0, 1.0), DVec3::X, DVec3::Y),
        (DVec3::new(2.0, 1.0, 0.0), DVec3::X, DVec3::Z),
    ];
    for (corner, a, b) in sides {
        let normal = a.cross(b).normalize();
        let (across, down) = ((a.length() * 10.0) as u32, (b.length() * 10.0) as u32);
        for i in 0..=across {
            for j in 0..=down {
                let at = a * (f64::from(i) / f64::from(across)) + b * (f64::from(j) / f64::from(down));
                feet.push((corner + at, normal));
            }
        }
        points.extend((0..60).map(|_| corner + a * random.f64() + b * random.f64()));
    }
    // Points that are on nothing.
    points.extend((0..60).map(|_| DVec3::new(random.f64() * 6.0, random.f64() * 4.0, 0.5 + random.f64() * 2.0)));
    (Surface::new(feet), points)
}

#[test]
fn sparse_points_land_on_their_surface_with_the_right_scale() {
    let (surface, points) = room();
    let truth = Similarity {
        scale: 4.0,
        rotation: DQuat::from_scaled_axis(DVec3::new(0.4, 1.0, -0.3)),
        translation: DVec3::new(3.0, -1.0, 2.0),
    };
    let sparse: Vec<DVec3> = points.iter().map(|p| truth.inverse().apply(*p)).collect();
    let off = Similarity {
        scale: 1.02,
        rotation: DQuat::from_scaled_axis(DVec3::new(0.02, -0.02, 0.03)),
        translation: DVec3::new(0.1, -0.1, 0.05),
    };
    let landed = fit_to_surface(&sparse, &truth.then(&off), 0.5, &surface, 0.1).unwrap();
    assert!((landed.similarity.scale / truth.scale - 1.0).abs() < 1e-4, "{landed:?}");
    let far = sparse.iter().map(|p| landed.similarity.apply(*p).distance(truth.apply(*p))).fold(0.0, f64::max);
    assert!(far < 2e-3, "{far}");
    assert!(landed.share > 0.8 && landed.median < 1e-3, "{landed:?}");
}

#[test]
fn points_on_a_plane_or_far_away_are_refused() {
    let (surface, points) = room();
    let floor: Vec<DVec3> = points.iter().copied().filter(|p| p.z == 0.0).collect();
    assert!(floor.len() > 50);
    assert_eq!(fit_to_surface(&floor, &Similarity::IDENTITY, 0.3, &surface, 0.1), Err(SurfaceFitError::Slides));
    let away = Similarity { translation: DVec3::splat(30.0), ..Similarity::IDENTITY };
    let error = fit_to_surface(&points, &away, 0.5, &surface, 0.1).unwrap_err();
    assert!(matches!(error, SurfaceFitError::Few { near: 0, .. }), "{error}");
}
