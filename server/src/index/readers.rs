//! Connections to the index that only read: so many at a time, kept for the next search.
//!
//! A search that comes when all are in use waits for one (it takes milliseconds); so neither descriptors nor memory follow the number of
//! people who search. SQLite keeps the descriptor of a connection that is closed while another one is open: without a bound a crowd would leave
//! as many as searched at once.

use super::IndexError;
use super::schema;
use rusqlite::Connection;
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// More than this, and more than there are cores, only wait for each other.
const MIN: usize = 4;

/// See the module.
#[derive(Default)]
pub(super) struct Readers {
    state: Mutex<State>,
    returned: Condvar,
}

#[derive(Default)]
struct State {
    idle: Vec<Connection>,
    in_use: usize,
    /// How often the index was rebuilt: a connection of before is not kept.
    age: u64,
}

impl Readers {
    /// Do something with a connection to `file`.
    pub(super) fn with<T>(
        &self,
        file: &Path,
        what: impl Fn(&Connection) -> Result<T, IndexError>,
    ) -> Result<T, IndexError> {
        let max = std::thread::available_parallelism().map_or(MIN, |n| n.get().max(MIN));
        let mut state = self.lock();
        while state.in_use >= max {
            state = self.returned.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
        state.in_use += 1;
        let mut lent = Lent { readers: self, connection: state.idle.pop(), age: state.age };
        drop(state);
        let connection = match lent.connection.take() {
            Some(connection) => connection,
            None => schema::reader(file)?,
        };
        let result = what(&connection);
        lent.connection = result.is_ok().then_some(connection);
        result
    }

    /// Close all; those in use are closed when they come back.
    pub(super) fn clear(&self) {
        let mut state = self.lock();
        state.idle.clear();
        state.age += 1;
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Gives its place back, whatever happens, and its connection where it holds one.
struct Lent<'a> {
    readers: &'a Readers,
    connection: Option<Connection>,
    age: u64,
}

impl Drop for Lent<'_> {
    fn drop(&mut self) {
        let mut state = self.readers.lock();
        state.in_use -= 1;
        let is_current = state.age == self.age;
        state.idle.extend(self.connection.take().filter(|_| is_current));
        drop(state);
        self.readers.returned.notify_one();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn many_readers_share_a_few_connections_and_a_panic_returns_its_connection() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("index.sqlite");
        drop(schema::open(&file).unwrap());
        let (readers, now, max) = (Readers::default(), AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for number in 0..60 {
                let (readers, file, now, max) = (&readers, &file, &now, &max);
                scope.spawn(move || {
                    let once = std::panic::AssertUnwindSafe(|| {
                        readers.with(file, |_| {
                            max.fetch_max(now.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                            // The search takes some time, so that readers overlap.
                            std::thread::sleep(std::time::Duration::from_millis(2));
                            now.fetch_sub(1, Ordering::SeqCst);
                            assert!(number % 20 != 7, "one of the panics of this test");
                            Ok(())
                        })
                    });
                    let _ = std::panic::catch_unwind(once);
                });
            }
        });
        let bound = std::thread::available_parallelism().map_or(MIN, |n| n.get().max(MIN));
        assert!(max.load(Ordering::SeqCst) <= bound);
        let state = readers.lock();
        assert_eq!(state.in_use, 0);
        assert!((1..=bound).contains(&state.idle.len()));
    }
}
