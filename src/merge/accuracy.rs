//! The accuracy of a merged surface as text, as JSON, and for the metadata of a pack.

use crate::info::metres;
use kilwa_builder::Capture;
use kilwa_scan::merge::{Accuracy, Parts, Reason, UnknownPose};
use serde_json::{Value, json};

/// Maximum number of stations named in a message.
const NAMED: usize = 5;

/// The accuracy of the capture for the metadata of a pack, if it is known. Three digits exceed the precision of a standard deviation, and are too few to encode a
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

/// A message about the accuracy, without a full stop; `None` if there is nothing to report.
pub(crate) fn sentence(accuracy: &Accuracy) -> Option<String> {
    if let Some(Capture { accuracy, registration, instrument }) = capture(accuracy) {
        let [accuracy, registration, instrument] = [accuracy, registration, instrument].map(metres);
        return Some(format!("capture accuracy {accuracy} (registration {registration}, instrument {instrument})"));
    }
    let Accuracy::Incomplete(poses) = accuracy else { return None };
    let named = |reason: Reason, why: &str| {
        let all = poses.iter().filter(|pose| pose.reason == reason).map(|pose| pose.station.as_str());
        let all: Vec<&str> = all.collect();
        let more = all.len().saturating_sub(NAMED);
        let names = all[..all.len() - more].join(", ");
        let names = if more > 0 { format!("{names} and {more} more") } else { names };
        (!all.is_empty()).then(|| format!("{why}: {names}"))
    };
    let changed = named(Reason::Changed, "pose changed after registration");
    let unplaced = named(Reason::Unplaced, "not placed by registration");
    let unstated = named(Reason::Unstated, "pose uncertainty unknown");
    let reasons: Vec<String> = [changed, unplaced, unstated].into_iter().flatten().collect();
    Some(format!("capture accuracy unknown: {} (run `kilwa register`, or use --capture-accuracy)", reasons.join("; ")))
}

/// The accuracy as JSON.
pub(crate) fn figures(accuracy: &Accuracy) -> Value {
    match accuracy {
        Accuracy::Unknown => Value::Null,
        Accuracy::Incomplete(poses) => {
            let pose = |pose: &UnknownPose| {
                let reason = match pose.reason {
                    Reason::Changed => "changed",
                    Reason::Unplaced => "unplaced",
                    Reason::Unstated => "unstated",
                };
                json!({ "station": pose.station, "reason": reason })
            };
            json!({ "unknown_poses": poses.iter().map(pose).collect::<Vec<_>>() })
        }
        Accuracy::Known(_) => json!(capture(accuracy)),
    }
}
