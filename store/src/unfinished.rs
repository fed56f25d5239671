//! Multipart uploads that were neither completed nor aborted, for example because a machine lost power. The library cannot list them, so they are
//! requested here, with an address that the library signs.

use crate::access::Access;
use crate::http::LastFailure;
use async_trait::async_trait;
use hyper::Method;
use object_store::aws::AmazonS3;
use object_store::client::{HttpClient, HttpConnector as _, HttpRequest, HttpRequestBody};
use object_store::multipart::MultipartStore as _;
use object_store::path::Path;
use object_store::signer::{SignedUrlOptions, Signer as _};
use object_store::{ClientOptions, Error};
use serde::Deserialize;
use std::sync::Arc;
use std::time::Duration;
use tokio::runtime::Handle;

/// How long a signed address is valid.
const SIGNED_FOR: Duration = Duration::from_secs(120);

/// An incomplete upload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Upload {
    /// The object that it would create.
    pub path: Path,
    /// Its identifier in the store.
    pub id: String,
}

/// Finds incomplete uploads.
#[async_trait]
pub trait Unfinished: Send + Sync {
    /// The uploads to the object `path` and to all objects below it.
    async fn uploads(&self, path: &Path) -> Result<Vec<Upload>, Error>;

    /// Abort an upload.
    async fn abort(&self, upload: &Upload) -> Result<(), Error>;
}

/// The incomplete uploads of a bucket.
pub(crate) struct OfBucket {
    client: Arc<AmazonS3>,
    http: HttpClient,
}

impl OfBucket {
    /// `None` without keys: then nothing can be uploaded anyway.
    pub(crate) fn new(
        client: &Arc<AmazonS3>,
        access: &Access,
        threads: &Handle,
        last_failure: &Arc<LastFailure>,
    ) -> Result<Option<Self>, Error> {
        if !access.is_signed() {
            return Ok(None);
        }
        let http = access.connections(threads, last_failure).connect(&ClientOptions::default())?;
        Ok(Some(Self { client: Arc::clone(client), http }))
    }

    async fn page(&self, prefix: &Path, after: Option<(&str, &str)>) -> Result<Page, Error> {
        let mut query = vec![("uploads", ""), ("prefix", prefix.as_ref())];
        query.extend(after.iter().flat_map(|(key, id)| [("key-marker", *key), ("upload-id-marker", *id)]));
        let options = SignedUrlOptions::default().with_query(query);
        let url = self.client.signed_url_opts(Method::GET, &Path::default(), SIGNED_FOR, &options).await?;
        let mut request = HttpRequest::new(HttpRequestBody::empty());
        *request.uri_mut() = url.as_str().parse().map_err(|_| generic("its address is too long"))?;
        let answer = self.http.execute(request).await.map_err(generic)?;
        let status = answer.status();
        let body = answer.into_body().bytes().await.map_err(generic)?;
        let text = String::from_utf8_lossy(&body);
        if !status.is_success() {
            let (path, source) = (prefix.to_string(), format!("{status}: {text}").into());
            return Err(match status.as_u16() {
                401 => Error::Unauthenticated { path, source },
                403 => Error::PermissionDenied { path, source },
                404 => Error::NotFound { path, source },
                // The store cannot list them at all.
                405 | 501 => Error::NotSupported { source },
                _ => generic(source),
            });
        }
        quick_xml::de::from_str(&text).map_err(|_| generic("its list of incomplete uploads cannot be read"))
    }
}

#[async_trait]
impl Unfinished for OfBucket {
    async fn uploads(&self, path: &Path) -> Result<Vec<Upload>, Error> {
        let mut all = Vec::new();
        let mut page = self.page(path, None).await?;
        loop {
            let found = page.uploads.iter().filter_map(|upload| {
                let path = Path::parse(&upload.key).ok()?;
                Some(Upload { path, id: upload.id.clone() })
            });
            all.extend(found.filter(|upload| upload.path.prefix_matches(path)));
            let next = (page.next_key.clone().unwrap_or_default(), page.next_id.clone().unwrap_or_default());
            if !page.is_truncated || next.0.is_empty() {
                return Ok(all);
            }
            page = self.page(path, Some((&next.0, &next.1))).await?;
        }
    }

    async fn abort(&self, upload: &Upload) -> Result<(), Error> {
        self.client.abort_multipart(&upload.path, &upload.id).await
    }
}

fn generic(source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Error {
    Error::Generic { store: "S3", source: source.into() }
}

/// `ListMultipartUploadsResult`.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "PascalCase")]
struct Page {
    #[serde(default)]
    is_truncated: bool,
    #[serde(default, rename = "NextKeyMarker")]
    next_key: Option<String>,
    #[serde(default, rename = "NextUploadIdMarker")]
    next_id: Option<String>,
    #[serde(default, rename = "Upload")]
    uploads: Vec<Listed>,
}

#[derive(Debug, Deserialize)]
struct Listed {
    #[serde(rename = "Key")]
    key: String,
    #[serde(rename = "UploadId")]
    id: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_with_and_without_uploads_are_read() {
        let head =
            "<?xml version=\"1.0\"?><ListMultipartUploadsResult xmlns=\"http://s3.amazonaws.com/doc/2006-03-01/\">";
        let some = "<Bucket>b</Bucket><IsTruncated>true</IsTruncated><NextKeyMarker>a &amp; b</NextKeyMarker>\
            <NextUploadIdMarker>7</NextUploadIdMarker><Upload><Key>a &amp; b</Key><UploadId>7</UploadId>\
            <Owner><ID>x</ID></Owner></Upload><Upload><Key>c</Key><UploadId>8</UploadId></Upload>";
        let page: Page = quick_xml::de::from_str(&format!("{head}{some}</ListMultipartUploadsResult>")).unwrap();
        let found: Vec<(&str, &str)> = page.uploads.iter().map(|u| (u.key.as_str(), u.id.as_str())).collect();
        assert_eq!(found, [("a & b", "7"), ("c", "8")]);
        assert!(page.is_truncated);
        assert_eq!((page.next_key.as_deref(), page.next_id.as_deref()), (Some("a & b"), Some("7")));
        let page: Page = quick_xml::de::from_str(&format!("{head}</ListMultipartUploadsResult>")).unwrap();
        assert!(page.uploads.is_empty() && !page.is_truncated);
    }
}
