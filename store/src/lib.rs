//! Objects of S3-compatible stores, `s3://bucket/key`, over the crate `object_store`.
//!
//! [`Access`] says how a store is reached: keys, region and address by the names of the environment variables, `AWS_…`; it makes the
//! client that the server and the divided builds use. [`Objects`] does whole transfers with it: read, put, upload, download, list, remove,
//! each tried again while the store is busy or silent, and given up when the user asks for a stop. An object appears when it is whole.
//! Failures: [`ObjectError`], in words that hold no key and no signed address.

mod access;
mod address;
mod http;
mod objects;
mod transfer;
mod unfinished;

pub use access::{Access, environment};
pub use address::{Address, is_address};
pub use http::{Failure, Seen};
pub use object_store::{BackoffConfig, RetryConfig};
pub use objects::{About, Client, ObjectError, Objects, Patience};
pub use transfer::Condition;
pub use unfinished::{Unfinished, Upload};
