//! Safe opening of files that somebody else may have put on disk, or may be changing at this moment.
//!
//! Code that opens a file named by a user, by another file or by a folder entry uses this crate.
//! So does code that writes a file under a temporary name.

pub mod atomic;
pub mod made_folders;
pub mod output;
pub mod plain_file;
pub mod size;
pub mod unfinished;
