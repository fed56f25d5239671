//! Waiting for a state: whatever a test has to wait for, it looks at again and again until it is so. If it never is, the failure names it.

#![allow(dead_code, reason = "each test program uses a part of it")]

use std::time::{Duration, Instant};

/// Even a machine that is busy with other things gets there within this time.
const DEADLINE: Duration = Duration::from_secs(60);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(5);

/// Look until there is a result, a minute at most.
pub(crate) fn eventually<T>(what: &str, look: impl FnMut() -> Option<T>) -> T {
    eventually_every(PAUSE, what, look)
}

/// The same for what lasts only a moment: with another pause between two looks.
pub(crate) fn eventually_every<T>(pause: Duration, what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < DEADLINE, "{what}: not within {} s", DEADLINE.as_secs());
        std::thread::sleep(pause);
    }
}

/// As [`eventually`], where looking means waiting for an answer.
pub(crate) async fn eventually_async<T>(what: &str, mut look: impl AsyncFnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look().await {
            return found;
        }
        assert!(began.elapsed() < DEADLINE, "{what}: not within {} s", DEADLINE.as_secs());
        tokio::time::sleep(PAUSE).await;
    }
}
