//! Objects of S3-compatible stores, `s3://bucket/key`, which some verbs can read or write instead of files.
//!
//! Keys, region and address of the store come from the environment (`AWS_…`), as for `kilwa serve` and `kilwa publish`, so that they are in no
//! command line, plan or task.

use anyhow::anyhow;
use kilwa_builder::build::work::Stop;
use kilwa_server::store::StoreError;
use kilwa_store::{Access, Address, BackoffConfig, Objects, RetryConfig, RetryPolicy, environment, is_address};
use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;
use tokio::runtime::Runtime;

/// Timeout of each step of a request: long enough for a part of 8 MiB on a slow connection.
const TIMEOUT: Duration = Duration::from_secs(60);
/// How long a failed request is retried.
const PATIENCE: Duration = Duration::from_secs(120);

/// Threads that talk to stores.
static THREADS: LazyLock<std::io::Result<Runtime>> = LazyLock::new(|| {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("store").enable_all().build()
});

/// The address of an object, if the argument is one.
///
/// # Errors
/// If it begins like an address but is not valid.
pub(crate) fn address(given: &Path) -> anyhow::Result<Option<Address>> {
    let Some(text) = given.to_str().filter(|text| is_address(text)) else { return Ok(None) };
    let address = Address::parse(text).filter(|address| !address.path.as_ref().is_empty());
    // The argument is not repeated in the message, because it may contain keys.
    let refused = || StoreError::Address(text.rsplit('@').next().unwrap_or_default().to_owned());
    Ok(Some(address.ok_or_else(refused)?))
}

/// The objects of a bucket; requests end when `stop` is set.
///
/// # Errors
/// If the environment variables contradict each other.
pub(crate) fn objects(bucket: &str, stop: &Stop) -> anyhow::Result<Objects> {
    let threads = THREADS.as_ref().map_err(|e| anyhow!("cannot start threads: {e}"))?;
    let (first, longest) = (Duration::from_millis(100), Duration::from_secs(5));
    let backoff = BackoffConfig { init_backoff: first, max_backoff: longest, base: 2.0 };
    // Even if three responses in ten are 503, only one request in a million fails eleven times.
    let retry = RetryConfig { backoff, max_retries: 10, retry_timeout: PATIENCE };
    let access = Access { endpoint: None, settings: environment(), timeout: TIMEOUT, retry };
    // For failures that the library does not retry: truncated responses, and requests whose response is lost. If these are six in a hundred, only one
    // request in twenty million fails six times.
    let retry_policy = RetryPolicy { attempts: 6, first_pause: first, longest_pause: longest, whole: PATIENCE };
    let objects = Objects::of_bucket(bucket, &access, retry_policy, threads.handle());
    let stop = stop.clone();
    Ok(objects.map_err(|e| anyhow!("s3://{bucket}: {e}"))?.with_stop(move || stop.asked()))
}
