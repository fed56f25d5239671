//! Aligns a group rigidly with its known poses and control points.

use super::control::rigid;
use super::settle::{Given, rotation_vector};
use glam::DVec3;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::fit::moved;
use nalgebra::{Cholesky, Matrix6, Vector6};

/// Steps of the alignment to known poses and points.
const STEPS: usize = 20;

/// Aligns the members of a group (their numbers and poses) rigidly with the stations that keep their poses, or otherwise with known poses and control
/// points. Returns whether these determine the position of the group.
pub(super) fn align(members: &mut [(usize, Pose)], given: &Given) -> bool {
    if let Some((first, pose)) = given.kept_poses.iter().enumerate().find_map(|(k, pose)| Some((k, (*pose)?))) {
        move_to(members, first, pose);
        // Bit-identical, without rounding.
        for ((_, own), pose) in members.iter_mut().zip(&given.kept_poses) {
            *own = pose.unwrap_or(*own);
        }
        return true;
    }
    let points = given.controls.with_survey_coordinates();
    let pairs = survey_points(members, given);
    let most_certain = given.priors.iter().min_by(|a, b| a.2[1].total_cmp(&b.2[1]));
    match (rigid(&pairs), most_certain) {
        (Some(step), _) => move_by(members, step),
        (None, Some((member, pose, _))) => move_to(members, *member, *pose),
        (None, None) => return false,
    }
    for _ in 0..STEPS {
        let Some(step) = rigid_step(members, given, &points) else { break };
        move_by(members, step);
    }
    true
}

/// Points with survey coordinates: their coordinates in the survey and in the group.
pub(super) fn survey_points(members: &[(usize, Pose)], given: &Given) -> Vec<(DVec3, DVec3)> {
    let points = given.controls.with_survey_coordinates();
    points.iter().map(|(member, at, known, _)| (*known, members[*member].1.apply(*at))).collect()
}

/// The rotation and translation of a whole group that best fit the known poses and points, linearised at its current pose.
fn rigid_step(members: &[(usize, Pose)], given: &Given, points: &[(usize, DVec3, DVec3, f64)]) -> Option<Pose> {
    // Rotations are about the centroid, because coordinates may be those of a national grid.
    let middle = members.iter().map(|(_, pose)| pose.translation).sum::<DVec3>() / members.len() as f64;
    let (mut information, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
    let mut add = |at: Option<DVec3>, error: DVec3, sigma: f64| {
        for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
            let (turn, shift) = at.map_or((unit, DVec3::ZERO), |at| ((at - middle).cross(unit), unit));
            let j = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            information += j * j.transpose() / (sigma * sigma);
            gradient += j * (error[axis] / (sigma * sigma));
        }
    };
    for (member, pose, [metres, radians]) in &given.priors {
        let own = members[*member].1;
        add(None, rotation_vector(own.rotation * pose.rotation.inverse()), *radians);
        add(Some(own.translation), own.translation - pose.translation, *metres);
    }
    for (member, at, known, sigma) in points {
        let own = members[*member].1.apply(*at);
        add(Some(own), own - *known, *sigma);
    }
    let step = -Cholesky::new(information)?.solve(&gradient);
    let turned = moved(Pose::at(DVec3::ZERO), &step);
    let is_small = step.fixed_rows::<3>(0).norm() < 1e-12 && step.fixed_rows::<3>(3).norm() < 1e-9;
    (!is_small).then(|| Pose::at(-middle).then(turned).then(Pose::at(middle)))
}

fn move_by(members: &mut [(usize, Pose)], step: Pose) {
    for (_, own) in members {
        *own = own.then(step);
    }
}

/// Move all members so that this one has this pose.
fn move_to(members: &mut [(usize, Pose)], member: usize, pose: Pose) {
    let step = members[member].1.inverse().then(pose);
    move_by(members, step);
}
