//! Small files of a store that are held in memory, the most recently asked for, up to a number of bytes.

use super::Identity;
use axum::body::Bytes;
use std::collections::HashMap;

/// Bytes held in all.
const ALL: usize = 64 << 20;

/// Small files by their keys.
#[derive(Default)]
pub(super) struct Held {
    files: HashMap<String, (Identity, Bytes, u64)>,
    bytes: usize,
    clock: u64,
}

impl Held {
    /// The file, where it is the one that was listed.
    pub(super) fn get(&mut self, key: &str, identity: &Identity) -> Option<Bytes> {
        self.clock += 1;
        let (held, bytes, used) = self.files.get_mut(key)?;
        if held != identity {
            return None;
        }
        *used = self.clock;
        Some(bytes.clone())
    }

    /// Hold it; what was not asked for longest goes.
    pub(super) fn put(&mut self, key: &str, identity: Identity, bytes: Bytes) {
        self.clock += 1;
        self.bytes += bytes.len();
        if let Some((_, old, _)) = self.files.insert(key.to_owned(), (identity, bytes, self.clock)) {
            self.bytes -= old.len();
        }
        if self.bytes <= ALL {
            return;
        }
        // A good part at once, so that this is seldom done.
        let mut ages: Vec<u64> = self.files.values().map(|(.., used)| *used).collect();
        let middle = ages.len() / 4;
        let (_, oldest, _) = ages.select_nth_unstable(middle);
        let oldest = *oldest;
        self.files.retain(|_, (.., used)| *used > oldest);
        self.bytes = self.files.values().map(|(_, bytes, _)| bytes.len()).sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::SystemTime;

    #[test]
    fn the_cache_of_files_is_bounded_and_keeps_requested_files() {
        let mut held = Held::default();
        let of = |tag: &str| Identity::of_store(1 << 20, Some(tag), SystemTime::UNIX_EPOCH);
        held.put("first", of("a"), vec![1; 1 << 20].into());
        for i in 0..300 {
            held.put(&format!("k{i}"), of("a"), vec![0; 1 << 20].into());
            assert!(held.get("first", &of("a")).is_some(), "after {i}");
            assert!(held.bytes <= ALL);
            assert_eq!(held.bytes, held.files.values().map(|(_, b, _)| b.len()).sum::<usize>());
        }
        assert!(held.get("first", &of("b")).is_none(), "another version is another file");
    }
}
