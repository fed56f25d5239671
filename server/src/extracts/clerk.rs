//! Who makes meshes in tests, here and in `tests/extracts.rs`: writes what was asked for, when it is let.

use super::{Detail, Extract, Failure, Format, Pack};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Condvar, Mutex};

/// Length of what is written, at least.
pub(crate) const BYTES: usize = 1000;

/// See the module.
#[derive(Default)]
pub(crate) struct Clerk {
    /// Whether it waits, and fails.
    orders: Mutex<(bool, Option<Failure>)>,
    told: Condvar,
    /// How many meshes it was let make.
    pub(crate) made: AtomicU32,
}

impl Clerk {
    /// One that waits to be let.
    pub(crate) fn waiting() -> Self {
        let clerk = Self::default();
        clerk.waits(true);
        clerk
    }

    /// Whether it waits from now on.
    pub(crate) fn waits(&self, waits: bool) {
        self.orders.lock().expect("no panic").0 = waits;
        self.told.notify_all();
    }

    /// It fails from now on.
    pub(crate) fn fails(&self, failure: Failure) {
        self.orders.lock().expect("no panic").1 = Some(failure);
    }
}

impl Extract for Clerk {
    fn extract(
        &self,
        pack: &Pack,
        to: &Path,
        format: Format,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), Failure> {
        progress(0.25);
        let orders =
            self.told.wait_while(self.orders.lock().expect("no panic"), |(waits, _)| *waits).expect("no panic");
        self.made.fetch_add(1, Ordering::SeqCst);
        if let Some(failure) = &orders.1 {
            return Err(failure.clone());
        }
        let name = pack.name();
        let text = format!("{} {detail} of {name}", format.ending());
        std::fs::write(to, format!("{text:<BYTES$}")).map_err(|e| Failure::Other(e.to_string()))
    }
}
