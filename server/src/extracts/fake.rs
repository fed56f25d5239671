//! A fake extractor for tests, here and in `tests/extracts.rs`: when it is released, it writes the name of the request.

use super::{Detail, Extractor, Failure, Format, Pack};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Condvar, Mutex};

/// Length of what is written, at least.
pub(crate) const BYTES: usize = 1000;

/// See the module.
#[derive(Default)]
pub(crate) struct Fake {
    /// Whether it waits, and fails.
    behaviour: Mutex<(bool, Option<Failure>)>,
    changed: Condvar,
    /// How many meshes it was let make.
    pub(crate) made: AtomicU32,
}

impl Fake {
    /// One that waits to be let.
    pub(crate) fn waiting() -> Self {
        let fake = Self::default();
        fake.waits(true);
        fake
    }

    /// Whether it waits from now on.
    pub(crate) fn waits(&self, waits: bool) {
        self.behaviour.lock().expect("no panic").0 = waits;
        self.changed.notify_all();
    }

    /// It fails from now on.
    pub(crate) fn fails(&self, failure: Failure) {
        self.behaviour.lock().expect("no panic").1 = Some(failure);
    }
}

impl Fake {
    /// The extractor that makes the meshes.
    pub(crate) fn extractor(self: &Arc<Self>) -> Arc<Extractor> {
        let fake = Arc::clone(self);
        Arc::new(move |pack, to, format, detail, progress| fake.extract(pack, to, format, detail, progress))
    }

    fn extract(
        &self,
        pack: &Pack,
        to: &Path,
        format: Format,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), Failure> {
        progress(0.25);
        let behaviour =
            self.changed.wait_while(self.behaviour.lock().expect("no panic"), |(waits, _)| *waits).expect("no panic");
        self.made.fetch_add(1, Ordering::SeqCst);
        if let Some(failure) = &behaviour.1 {
            return Err(failure.clone());
        }
        let name = pack.name();
        let text = format!("{} {detail} of {name}", format.ending());
        std::fs::write(to, format!("{text:<BYTES$}")).map_err(|e| Failure::Other(e.to_string()))
    }
}
