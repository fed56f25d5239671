//! Byte sources for packs: files.
