//! The built viewer page: every file of `www/dist` in memory, by its name relative to that folder.
//!
//! Files `NAME.br` and `NAME.gz` beside `NAME` are its compressed forms, sent where the client accepts brotli or gzip. Nothing else
//! of the disk can be reached through it.

use crate::frame::Frame;
use crate::places::PLACES;
use bytes::Bytes;
#[cfg(embedded)]
use include_dir::{Dir, include_dir};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use thiserror::Error;

#[cfg(embedded)]
static EMBEDDED: Dir<'_> = include_dir!("$KILWA_PAGE");
/// The first of [`crate::places::PLACES`].
const HEAD: &str = PLACES[0].0;
/// A page folder with more than this in it was not built by Kilwa.
const PAGE_LIMIT: u64 = 256 << 20;

/// Why there is no page.
#[derive(Debug, Error)]
pub enum PageError {
    /// Neither embedded nor given.
    #[error("the viewer page is not built into this program: run `cargo xtask web` and build again, or use --www DIR")]
    NotBuilt,
    /// The folder given holds no page.
    #[error("{folder} is not a built viewer page ({missing} is missing): run `cargo xtask web`, which writes www/dist")]
    Incomplete {
        /// The folder.
        folder: PathBuf,
        /// The first file that is missing.
        missing: &'static str,
    },
    /// A page without the places that the facts of a model are put into.
    #[error(
        "index.html of the viewer page cannot hold a model: {0}; run `cargo xtask web` with this version of Kilwa, and build again or give its www/dist with --www"
    )]
    Places(String),
    /// The folder given cannot be read.
    #[error("cannot read {path}: {source}")]
    Unreadable {
        /// File or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The folder is something else.
    #[error("{folder} contains more than {PAGE_LIMIT} bytes, so it is not the built viewer page; use www/dist")]
    TooLarge {
        /// The folder.
        folder: PathBuf,
    },
}

/// One file, ready to be sent.
#[derive(Debug, Clone)]
pub struct Asset {
    /// Content.
    pub bytes: Bytes,
    /// The same, compressed by brotli.
    pub brotli: Option<Bytes>,
    /// The same, compressed by gzip.
    pub gzip: Option<Bytes>,
    /// Media type.
    pub content_type: &'static str,
    /// Entity tag, with its quotes.
    pub etag: String,
}

/// The page's files.
#[derive(Debug, Clone)]
pub struct Page {
    files: Arc<BTreeMap<String, Asset>>,
}

impl Page {
    /// The page of the program, or the one in `folder`. A release program has its page built in; a program of development or of the tests reads
    /// `www/dist` of the repository (see build.rs).
    ///
    /// # Errors
    /// [`PageError`] when there is none, saying how to build it.
    pub fn load(folder: Option<&Path>) -> Result<Self, PageError> {
        let mut raw = BTreeMap::new();
        match folder {
            Some(folder) => read_folder(folder, folder, &mut 0, &mut raw)?,
            #[cfg(embedded)]
            None => collect(&EMBEDDED, &mut raw),
            #[cfg(not(embedded))]
            None => {
                let built = Path::new(env!("KILWA_PAGE"));
                if built.is_dir() {
                    read_folder(built, built, &mut 0, &mut raw)?;
                }
            }
        }
        let page = Self::from_files(raw);
        match (page.missing(), folder) {
            (None, _) => {
                page.frame()?;
                Ok(page)
            }
            (Some(_), None) => Err(PageError::NotBuilt),
            (Some(missing), Some(folder)) => Err(PageError::Incomplete { folder: folder.to_owned(), missing }),
        }
    }

    /// A page of the files given, by relative name.
    pub fn from_files(raw: BTreeMap<String, Vec<u8>>) -> Self {
        let (mut packed, plain): (BTreeMap<_, _>, BTreeMap<_, _>) =
            raw.into_iter().partition(|(name, _)| Path::new(name).extension().is_some_and(|e| e == "gz" || e == "br"));
        let files = plain.into_iter().map(|(name, bytes)| {
            let mut form = |end: &str| packed.remove(&format!("{name}.{end}")).map(Bytes::from);
            let (brotli, gzip) = (form("br"), form("gz"));
            let asset = asset(&name, bytes, brotli, gzip);
            (name, asset)
        });
        Self { files: Arc::new(files.collect()) }
    }

    /// The same page with something put into the head of its `index.html`, first thing.
    #[must_use]
    pub fn with_head(self, head: &str) -> Self {
        if head.is_empty() {
            return self;
        }
        let mut files = (*self.files).clone();
        // A page that was loaded has a head.
        if let Some(index) = files.get_mut("index.html")
            && let Some((before, after)) = std::str::from_utf8(&index.bytes).ok().and_then(|html| html.split_once(HEAD))
        {
            let html = format!("{before}{HEAD}\n{head}{after}").into_bytes();
            // Its packed forms are of the other text.
            *index = asset("index.html", html, None, None);
        }
        Self { files: Arc::new(files) }
    }

    /// Files that a page cannot be without.
    pub const NEEDED: [&str; 8] = [
        "index.html",
        "boot.js",
        "viewer.js",
        "viewer_bg.wasm",
        "viewer-gl.js",
        "viewer-gl_bg.wasm",
        "decode-worker.js",
        "decode_bg.wasm",
    ];

    fn missing(&self) -> Option<&'static str> {
        Self::NEEDED.into_iter().find(|f| !self.files.contains_key(*f))
    }

    /// One file by its name.
    pub fn file(&self, name: &str) -> Option<&Asset> {
        self.files.get(name)
    }

    /// Every file by name, with its bytes; compressed forms under their own names (`NAME.gz`, `NAME.br`). Sorted.
    pub fn files(&self) -> impl Iterator<Item = (String, &[u8])> {
        self.files.iter().flat_map(|(name, asset)| {
            let forms = [("", Some(&asset.bytes)), (".br", asset.brotli.as_ref()), (".gz", asset.gzip.as_ref())];
            forms.into_iter().filter_map(move |(end, bytes)| bytes.map(|b| (format!("{name}{end}"), &b[..])))
        })
    }

    /// Bytes of all of them.
    pub fn bytes(&self) -> u64 {
        self.files().map(|(_, bytes)| bytes.len() as u64).sum()
    }

    /// The HTML of the viewer, cut where the facts of a model go.
    ///
    /// # Errors
    /// [`PageError::Places`] where one of the places is missing, which [`Page::load`] has checked.
    pub fn frame(&self) -> Result<Frame<'_>, PageError> {
        let html = self.file("index.html").and_then(|a| std::str::from_utf8(&a.bytes).ok()).unwrap_or_default();
        Frame::of(html).map_err(PageError::Places)
    }
}

fn asset(name: &str, bytes: Vec<u8>, brotli: Option<Bytes>, gzip: Option<Bytes>) -> Asset {
    let etag = format!("\"{}\"", &blake3::hash(&bytes).to_hex().as_str()[..32]);
    Asset { brotli, gzip, content_type: content_type(name), etag, bytes: bytes.into() }
}

#[cfg(embedded)]
fn collect(dir: &Dir<'_>, into: &mut BTreeMap<String, Vec<u8>>) {
    for file in dir.files() {
        if let Some(name) = file.path().to_str() {
            into.insert(name.replace('\\', "/"), file.contents().to_vec());
        }
    }
    for dir in dir.dirs() {
        collect(dir, into);
    }
}

fn read_folder(
    root: &Path,
    folder: &Path,
    total: &mut u64,
    into: &mut BTreeMap<String, Vec<u8>>,
) -> Result<(), PageError> {
    let unreadable = |path: &Path| {
        let path = path.to_owned();
        move |source| PageError::Unreadable { path, source }
    };
    for entry in std::fs::read_dir(folder).map_err(unreadable(folder))? {
        let path = entry.map_err(unreadable(folder))?.path();
        let metadata = std::fs::metadata(&path).map_err(unreadable(&path))?;
        if metadata.is_dir() {
            read_folder(root, &path, total, into)?;
            continue;
        }
        *total += metadata.len();
        if *total > PAGE_LIMIT {
            return Err(PageError::TooLarge { folder: root.to_owned() });
        }
        if let Some(name) = path.strip_prefix(root).ok().and_then(Path::to_str) {
            into.insert(name.replace('\\', "/"), std::fs::read(&path).map_err(unreadable(&path))?);
        }
    }
    Ok(())
}

/// By the end of a name; what is not known is bytes.
pub fn content_type(name: &str) -> &'static str {
    match name.rsplit('.').next().unwrap_or_default() {
        "html" => "text/html; charset=utf-8",
        "js" | "mjs" => "text/javascript; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "json" => "application/json",
        "geojson" => "application/geo+json",
        "wasm" => "application/wasm",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "webp" => "image/webp",
        "jpg" | "jpeg" => "image/jpeg",
        "tif" | "tiff" => "image/tiff",
        "pdf" => "application/pdf",
        "glb" => "model/gltf-binary",
        "xml" => "application/xml",
        "bib" => "application/x-bibtex; charset=utf-8",
        "ris" => "application/x-research-info-systems; charset=utf-8",
        "txt" | "md" | "sha256" | "pgw" => "text/plain; charset=utf-8",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::PLACES;

    #[test]
    fn a_page_folder_without_a_place_is_refused_with_what_to_do() {
        let folder = tempfile::tempdir().unwrap();
        let html = include_str!("../../www/index.html");
        for name in Page::NEEDED {
            std::fs::write(folder.path().join(name), html).unwrap();
        }
        let page = Page::load(Some(folder.path())).unwrap();
        let head = page.with_head("<meta name=\"x\">\n");
        let index = head.file("index.html").unwrap();
        assert!(String::from_utf8_lossy(&index.bytes).contains("<head>\n<meta name=\"x\">\n"));
        for (place, _) in PLACES {
            std::fs::write(folder.path().join("index.html"), html.replace(place, "")).unwrap();
            let why = Page::load(Some(folder.path())).unwrap_err().to_string();
            assert!(why.contains(place) && why.contains("cargo xtask web") && why.contains("--www"), "{why}");
        }
    }
}
