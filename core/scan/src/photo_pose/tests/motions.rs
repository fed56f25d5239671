use crate::camera::{Camera, Distortion, PosedCamera};
use crate::photo_pose::motion::{Directions, PARAMETERS, changed, derivatives, dot};
use crate::pose::Pose;
use glam::{DQuat, DVec2, DVec3};
use proptest::prelude::*;

fn vector(size: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-size..size).prop_map(DVec3::from_array)
}

proptest! {
    #[test]
    fn derivatives_are_those_of_differences(axis in vector(1.0), x in -1.0..1.0_f64, y in -0.8..0.8_f64, z in 2.0..9.0_f64, which in 0..PARAMETERS, panorama: bool) {
        let brown = Distortion::Brown { k: [-0.1, 0.05, 0.0, 0.0], p: [0.001, -0.002] };
        let camera = if panorama {
            Camera::equirectangular([1000, 500]).unwrap()
        } else {
            Camera::pinhole([800, 600], DVec2::new(600.0, 610.0), DVec2::new(405.0, 296.0), brown).unwrap()
        };
        let pose = Pose { rotation: DQuat::from_scaled_axis(axis), translation: axis * 3.0 };
        let posed = PosedCamera { camera, camera_from_world: pose };
        let point = DVec3::new(x * z * 0.5, y * z * 0.5, z);
        let world = pose.inverse().apply(point);
        let length = 4.0;
        let rows = derivatives(&camera, point, length, true).unwrap();
        let at = |amount: f64| {
            let mut change = [0.0; PARAMETERS];
            change[which] = amount;
            changed(&posed, &change, length).unwrap().project(world).unwrap()
        };
        let step = 1e-6;
        let slope = (at(step) - at(-step)) / (2.0 * step);
        prop_assert!(slope.distance(DVec2::new(rows[0][which], rows[1][which])) < 1e-3 * (1.0 + slope.length()), "{slope} {rows:?}");
    }
}

#[test]
fn directions_shift_points_by_one_pixel_and_are_independent() {
    let camera = Camera::pinhole([800, 600], DVec2::splat(600.0), DVec2::new(400.0, 300.0), Distortion::None).unwrap();
    let mut random = fastrand::Rng::with_seed(2);
    let mut number = || random.f64() * 2.0 - 1.0;
    let points: Vec<DVec3> =
        (0..50).map(|_| DVec3::new(number() * 3.0, number() * 2.0, 6.0 + 2.0 * number())).collect();
    let rows: Vec<_> = points.iter().map(|p| derivatives(&camera, *p, 6.0, false).unwrap()).collect();
    let directions = Directions::new(&rows);
    assert_eq!(directions.changes.len(), 6);
    for (i, a) in directions.changes.iter().enumerate() {
        for (j, b) in directions.changes.iter().enumerate() {
            let product: f64 = rows.iter().flatten().map(|row| dot(row, a) * dot(row, b)).sum::<f64>() / 50.0;
            assert!((product - f64::from(u8::from(i == j))).abs() < 1e-6, "{i} {j} {product}");
        }
    }
    let amounts = [1.0, -2.0, 0.5, 0.1, 0.7, -0.3];
    let back = directions.amounts(&directions.change(&amounts), &rows);
    assert!(amounts.iter().zip(back).all(|(a, b)| (a - b).abs() < 1e-6));
}
