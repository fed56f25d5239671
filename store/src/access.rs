//! Credentials and connection settings of a store.

use crate::http::{Connector, LastFailure};
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::{Error, RetryConfig};
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;

/// Settings for signing requests; without any of them, requests are not signed.
const KEYS: [&str; 5] = [
    "AWS_ACCESS_KEY_ID",
    "AWS_WEB_IDENTITY_TOKEN_FILE",
    "AWS_CONTAINER_CREDENTIALS_RELATIVE_URI",
    "AWS_CONTAINER_CREDENTIALS_FULL_URI",
    "AWS_SKIP_SIGNATURE",
];

/// Keys, region and address of a store, with timeout and retries.
#[derive(Clone)]
pub struct Access {
    /// Address of a store other than Amazon's; overrides the settings.
    pub endpoint: Option<String>,
    /// Keys, region and other settings, named like the environment variables `AWS_…`.
    pub settings: Vec<(String, String)>,
    /// Timeout of each step of a request.
    pub timeout: Duration,
    /// Retry policy of the library, for responses that say that the store is too busy.
    pub retry: RetryConfig,
}

/// The environment variables `AWS_…` that are not empty.
pub fn environment() -> Vec<(String, String)> {
    let all =
        std::env::vars_os().filter_map(|(name, value)| Some((name.into_string().ok()?, value.into_string().ok()?)));
    all.filter(|(name, value)| name.starts_with("AWS_") && !value.is_empty()).collect()
}

impl Access {
    /// The library's client for a bucket, whose connections run on `threads` and whose last failure is kept in `last_failure`. Without keys in
    /// the settings, it can read only public objects.
    ///
    /// # Errors
    /// If the settings contradict each other.
    pub fn client(&self, bucket: &str, threads: &Handle, last_failure: &Arc<LastFailure>) -> Result<AmazonS3, Error> {
        let builder = self.builder();
        let connector = self.connector(&builder, threads, last_failure);
        let is_plain = connector.is_plain;
        let builder = builder.with_bucket_name(bucket).with_allow_http(is_plain).with_retry(self.retry.clone());
        builder.with_http_connector(connector).build()
    }

    /// The connector of such a client.
    pub(crate) fn connections(&self, threads: &Handle, last_failure: &Arc<LastFailure>) -> Connector {
        self.connector(&self.builder(), threads, last_failure)
    }

    fn builder(&self) -> AmazonS3Builder {
        let mut builder = AmazonS3Builder::new();
        for (name, value) in &self.settings {
            if let Ok(key) = name.to_ascii_lowercase().parse::<AmazonS3ConfigKey>() {
                builder = builder.with_config(key, value);
            }
        }
        if !KEYS.iter().any(|name| self.has(name)) {
            builder = builder.with_skip_signature(true);
        }
        if let Some(endpoint) = &self.endpoint {
            // Overrides both settings that can hold an address.
            builder = builder.with_config(AmazonS3ConfigKey::S3Endpoint, endpoint).with_endpoint(endpoint);
        }
        builder
    }

    fn connector(&self, builder: &AmazonS3Builder, threads: &Handle, last_failure: &Arc<LastFailure>) -> Connector {
        let endpoint = [AmazonS3ConfigKey::S3Endpoint, AmazonS3ConfigKey::Endpoint];
        let endpoint = endpoint.iter().find_map(|key| builder.get_config_value(key));
        let is_plain = endpoint.is_some_and(|endpoint| endpoint.starts_with("http://"));
        Connector { threads: threads.clone(), timeout: self.timeout, is_plain, last_failure: Arc::clone(last_failure) }
    }

    /// Whether requests are signed.
    pub(crate) fn is_signed(&self) -> bool {
        KEYS[..4].iter().any(|name| self.has(name))
    }

    fn has(&self, name: &str) -> bool {
        self.settings.iter().any(|(n, _)| n == name)
    }
}
