//! The seed of tests that kill the program.

use std::hash::{BuildHasher as _, RandomState};

/// The seed that chooses where the program is killed: random, or from `KILWA_KILL_SEED` to repeat a failure.
pub(crate) fn seed() -> u32 {
    let given = std::env::var("KILWA_KILL_SEED").ok();
    let random = || u32::try_from(RandomState::new().hash_one(()) % 1_000_000).unwrap();
    given.map_or_else(random, |text| text.parse().expect("KILWA_KILL_SEED is a number"))
}
