//! How much room a disk has.

use std::path::Path;

/// Free bytes of the file system that holds `folder`; `u64::MAX` if it does not report them. Some (FUSE) report a size of 0.
pub(crate) fn free_space(folder: &Path) -> u64 {
    let is_known = fs4::total_space(folder).is_ok_and(|total| total > 0);
    if is_known { fs4::available_space(folder).unwrap_or(u64::MAX) } else { u64::MAX }
}
