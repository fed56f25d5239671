//! Who may have which file of an object, decided for every request, in UTC.
//!
//! | state | landing page, manifest, metadata, pictures | geometry |
//! |---|---|---|
//! | public | yes | yes |
//! | embargo | yes | from the first second of its day on |
//! | restricted | yes | no |
//! | withdrawn | 410, with the landing page as the tombstone | 410 |
//!
//! Invariant: whatever is not certainly allowed is refused; a clock that was set back only keeps an embargo longer.

use kilwa_archive::date::{day_of, in_words, moment_of};
use kilwa_archive::manifest::{Access, AccessState};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// What may be had, with the reason why not all of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Verdict {
    Open,
    WithoutGeometry(String),
    Gone(String),
}

/// Where the time comes from: seconds since 1970.
#[derive(Clone)]
pub struct Clock(Arc<dyn Fn() -> u64 + Send + Sync>);

impl Clock {
    /// A clock of one's own, for tests.
    pub fn new(seconds: impl Fn() -> u64 + Send + Sync + 'static) -> Self {
        Self(Arc::new(seconds))
    }

    /// Today, UTC, `YYYY-MM-DD`.
    /// Seconds since 1970.
    pub(crate) fn seconds(&self) -> u64 {
        (self.0)()
    }

    pub(crate) fn day(&self) -> String {
        day_of((self.0)())
    }

    /// Now, UTC, `YYYY-MM-DDThh:mm:ssZ`.
    pub(crate) fn instant(&self) -> String {
        moment_of((self.0)())
    }
}

impl Default for Clock {
    /// The system's.
    fn default() -> Self {
        Self::new(|| SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs())
    }
}

pub(crate) fn verdict(access: &Access, clock: &Clock) -> Verdict {
    let reason = access.reason.as_deref().unwrap_or_default();
    let contact = access.contact.as_ref().map(|contact| format!(" Contact: {contact}")).unwrap_or_default();
    let why = format!("{reason}{contact}").trim().to_owned();
    match (access.state, access.until.as_deref()) {
        (AccessState::Public, _) => Verdict::Open,
        (AccessState::Embargo, Some(until)) if *until <= *clock.day() => Verdict::Open,
        (AccessState::Embargo, until) => {
            let until = until.map(|day| format!("Public from {} on, 00:00 UTC. ", in_words(day))).unwrap_or_default();
            Verdict::WithoutGeometry(format!("{until}{why}").trim().to_owned())
        }
        (AccessState::Restricted, _) => Verdict::WithoutGeometry(why),
        (AccessState::Withdrawn, _) => Verdict::Gone(why),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_archive::layout::is_geometry;

    fn access(state: AccessState, until: Option<&str>) -> Access {
        Access {
            state,
            until: until.map(str::to_owned),
            reason: Some("Rock art.".to_owned()),
            contact: None,
            withdrawn: None,
        }
    }

    #[test]
    fn an_embargo_ends_at_the_first_second_of_its_day() {
        // 2026-11-22T00:00:00Z
        let midnight = 1_795_305_600;
        let embargo = access(AccessState::Embargo, Some("2026-11-22"));
        for (second, open) in [(midnight - 1, false), (midnight, true), (midnight + 1, true), (0, false)] {
            let verdict = verdict(&embargo, &Clock::new(move || second));
            assert_eq!(verdict == Verdict::Open, open, "{second}: {verdict:?}");
        }
        let Verdict::WithoutGeometry(why) = verdict(&embargo, &Clock::new(|| 0)) else { panic!() };
        assert!(why.contains("22 November 2026") && why.contains("Rock art."), "{why}");
        let endless = verdict(&access(AccessState::Embargo, None), &Clock::default());
        assert!(matches!(endless, Verdict::WithoutGeometry(_)), "without a day it never ends");
    }

    #[test]
    fn states_other_than_embargo_do_not_depend_on_the_clock() {
        let clock = Clock::default();
        assert_eq!(verdict(&access(AccessState::Public, None), &clock), Verdict::Open);
        assert_eq!(
            verdict(&access(AccessState::Restricted, None), &clock),
            Verdict::WithoutGeometry("Rock art.".to_owned())
        );
        assert_eq!(verdict(&access(AccessState::Withdrawn, None), &clock), Verdict::Gone("Rock art.".to_owned()));
    }

    #[test]
    fn geometry_is_recognised_by_its_file_name() {
        assert!(is_geometry("v1/pack.00.kilwa") && is_geometry("v1/preview.GLB"));
        assert!(is_geometry("v1/annotations.json") && is_geometry("v1/iiif/annotations.json"));
        assert!(is_geometry("annotations.json") && !is_geometry("v1/poster.jpg") && !is_geometry("manifest.json"));
    }
}
