//! Malicious inputs: that name other files, that take excessive time or memory, that control the terminal of the reader.

mod bounded;
mod outside;
mod printed;
