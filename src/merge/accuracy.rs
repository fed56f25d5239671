//! How accurate a merged surface is, in words, for machines and for the metadata of a pack.

use crate::info::metres;
use kilwa_builder::Capture;
use kilwa_scan::merge::{Accuracy, Parts};
use kilwa_scan::register;
use serde_json::{Value, json};

/// The accuracy of the capture for the metadata of a pack, if it is known. Three digits are more than a standard deviation has, and too few to hold a
/// coordinate.
pub(crate) fn capture(accuracy: &Accuracy) -> Option<Capture> {
    let Accuracy::Known(Parts { registration, instrument }) = *accuracy else { return None };
    let [accuracy, registration, instrument] =
        [registration.hypot(instrument), registration, instrument].map(three_digits);
    // An accuracy of 0 m would be that of a surface that is not measured.
    (accuracy > 0.0).then_some(Capture { accuracy, registration, instrument })
}

fn three_digits(x: f64) -> f64 {
    format!("{x:.2e}").parse().unwrap_or(x)
}

/// A sentence about it, without a full stop; `None` if there is nothing to report.
pub(crate) fn sentence(accuracy: &Accuracy) -> Option<String> {
    if let Some(Capture { accuracy, registration, instrument }) = capture(accuracy) {
        let [accuracy, registration, instrument] = [accuracy, registration, instrument].map(metres);
        return Some(format!("capture accuracy {accuracy} (registration {registration}, instrument {instrument})"));
    }
    let Accuracy::Incomplete(poses) = accuracy else { return None };
    let named = |was_changed: bool| {
        let names = poses.iter().filter(|pose| pose.was_changed == was_changed).map(|pose| pose.station.as_str());
        Some(names.collect::<Vec<_>>().join(", ")).filter(|names| !names.is_empty())
    };
    let changed = named(true).map(|names| {
        format!(
            "the pose was changed after registration: {names} (run `kilwa register` again, or remove {} to use translation_sigma and rotation_sigma of survey.toml)",
            register::FILE
        )
    });
    let unstated = named(false).map(|names| {
        format!(
            "the uncertainty of the pose is not known: {names} (run `kilwa register`, or give translation_sigma and rotation_sigma in survey.toml)"
        )
    });
    let reasons: Vec<String> = changed.into_iter().chain(unstated).collect();
    Some(format!("capture accuracy unknown: {}", reasons.join("; ")))
}

/// For machines.
pub(crate) fn figures(accuracy: &Accuracy) -> Value {
    match accuracy {
        Accuracy::Unknown => Value::Null,
        Accuracy::Incomplete(poses) => {
            let pose = |pose: &kilwa_scan::merge::UnknownPose| json!({ "station": pose.station, "was_changed": pose.was_changed });
            json!({ "unknown_poses": poses.iter().map(pose).collect::<Vec<_>>() })
        }
        Accuracy::Known(_) => json!(capture(accuracy)),
    }
}
