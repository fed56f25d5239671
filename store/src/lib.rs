//! Objects of S3-compatible stores, `s3://bucket/key`, over the crate `object_store`.
//!
//! [`Access`] has the connection settings of a store: keys, region and address, named like the environment variables `AWS_…`. It makes the
//! client that the server and the divided builds use. [`Objects`] does complete transfers with it: read, put, upload, download, list, remove.
//! Each is retried while the store is busy or does not respond, and cancelled when the user asks for a stop. An object becomes visible only
//! when it is complete. The messages of [`ObjectError`] contain no keys and no signed addresses.

mod access;
mod address;
mod http;
mod objects;
mod transfer;
mod unfinished;

pub use access::{Access, environment};
pub use address::{Address, is_address};
pub use http::{Failure, LastFailure};
pub use object_store::{BackoffConfig, RetryConfig};
pub use objects::{Client, ObjectError, ObjectInfo, Objects, RetryPolicy};
pub use transfer::Condition;
pub use unfinished::{Unfinished, Upload};
