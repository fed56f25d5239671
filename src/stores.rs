//! Objects of S3-compatible stores, `s3://bucket/key`, where a verb reads or writes them instead of files.
//!
//! Keys, region and address of the store come from the environment (`AWS_…`), as for `kilwa serve` and `kilwa publish`, so that they stand in no
//! command line, plan or task.

use anyhow::anyhow;
use kilwa_builder::build::work::Stop;
use kilwa_server::store::StoreError;
use kilwa_store::{Access, Address, BackoffConfig, Objects, Patience, RetryConfig, environment, is_address};
use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;
use tokio::runtime::Runtime;

/// How long a step of a request may take: a part of 8 MiB on a slow line.
const TIMEOUT: Duration = Duration::from_secs(60);
/// How long a request is tried again.
const PATIENCE: Duration = Duration::from_secs(120);

/// Threads that talk to stores.
static THREADS: LazyLock<std::io::Result<Runtime>> = LazyLock::new(|| {
    tokio::runtime::Builder::new_multi_thread().worker_threads(2).thread_name("store").enable_all().build()
});

/// The address of an object, if the argument is one.
///
/// # Errors
/// Where it begins as one but is none.
pub(crate) fn address(given: &Path) -> anyhow::Result<Option<Address>> {
    let Some(text) = given.to_str().filter(|text| is_address(text)) else { return Ok(None) };
    let address = Address::parse(text).filter(|address| !address.path.as_ref().is_empty());
    // Whoever writes keys into the address does not get them into a log.
    let refused = || StoreError::Address(text.rsplit('@').next().unwrap_or_default().to_owned());
    Ok(Some(address.ok_or_else(refused)?))
}

/// The objects of a bucket; requests end when `stop` is asked for.
///
/// # Errors
/// Where the environment variables contradict each other.
pub(crate) fn objects(bucket: &str, stop: &Stop) -> anyhow::Result<Objects> {
    let threads = THREADS.as_ref().map_err(|e| anyhow!("cannot start threads: {e}"))?;
    let (first, longest) = (Duration::from_millis(100), Duration::from_secs(5));
    let backoff = BackoffConfig { init_backoff: first, max_backoff: longest, base: 2.0 };
    // Three answers in ten may be 503: then one request in a million fails eleven times.
    let retry = RetryConfig { backoff, max_retries: 10, retry_timeout: PATIENCE };
    let access = Access { endpoint: None, settings: environment(), timeout: TIMEOUT, retry };
    // For what the library does not try again: answers that break off, and requests whose answer is lost.
    let patience = Patience { attempts: 4, first_pause: first, longest_pause: longest, whole: PATIENCE };
    let objects = Objects::of_bucket(bucket, &access, patience, threads.handle());
    let stop = stop.clone();
    Ok(objects.map_err(|e| anyhow!("s3://{bucket}: {e}"))?.with_stop(move || stop.asked()))
}
