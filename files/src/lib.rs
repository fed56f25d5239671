//! Files on disk that others may have put there, or may be changing at this moment.
//!
//! Everything that opens a file named by a person, by another file or by an entry of a folder goes through here. So does every file that
//! is written under a temporary name.

pub mod plain_file;
pub mod unfinished;
