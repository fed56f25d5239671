//! The channels of a merged surface.

use kilwa_pack::metadata::REGISTRATION;
use kilwa_scan::merge::{Begin, MergedVertex, Source};

/// Which channels there are.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Channels {
    has_intensity: bool,
    is_filled: bool,
    /// The largest standard deviation of a vertex due to the poses, metres, if there is a channel for it.
    registration: Option<f32>,
}

impl Channels {
    /// Maximum number of channels.
    const MAX: usize = 6;

    pub(crate) fn of(begin: &Begin) -> Self {
        Self { has_intensity: begin.attributes[1], is_filled: begin.is_filled, registration: begin.registration }
    }

    /// Their names.
    pub(crate) fn names(self) -> Vec<String> {
        let intensity = self.has_intensity.then_some("intensity");
        let registration = self.registration.map(|_| REGISTRATION);
        let filled = self.is_filled.then_some(["filled", "source"]);
        ["confidence", "stations"]
            .into_iter()
            .chain(intensity)
            .chain(registration)
            .chain(filled.into_iter().flatten())
            .map(str::to_owned)
            .collect()
    }

    /// The values of a vertex in the same order, in an array of which the first [`Self::count`] matter.
    pub(crate) fn values(self, vertex: &MergedVertex) -> [f32; Self::MAX] {
        let MergedVertex { vertex, stations, registration, source } = vertex;
        let mut values = [0.0; Self::MAX];
        values[..2].copy_from_slice(&[vertex.confidence, f32::from(*stations)]);
        let mut next = 2;
        if self.has_intensity {
            values[next] = if vertex.intensity.is_nan() { 0.0 } else { vertex.intensity };
            next += 1;
        }
        if let Some(largest) = self.registration {
            // A vertex that fills a hole gets the largest uncertainty.
            values[next] = registration.unwrap_or(largest);
            next += 1;
        }
        if self.is_filled {
            values[next] = f32::from(u8::from(*source != Source::Scans));
            values[next + 1] = f32::from(*source as u8);
        }
        values
    }

    /// How many there are.
    pub(crate) fn count(self) -> usize {
        self.names().len()
    }
}
