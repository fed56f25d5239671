//! What there is to serve: the packs of one folder (or one pack), by slug.
//!
//! The folder is the truth. It is listed again when somebody looks at the list or asks for a slug that is not known, at
//! most once a second; a pack whose size, time or identity changed is read anew. A file that cannot be read as a pack
//! stays in the list with the reason, so that nothing vanishes silently.

use kilwa_pack::{HEADER_BYTES, Header, Metadata};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant, SystemTime};
use thiserror::Error;
use tokio::sync::OnceCell;

/// The folder is not listed more often than this.
const RELIST: Duration = Duration::from_secs(1);

/// Why a folder cannot be served.
#[derive(Debug, Error)]
pub enum CatalogueError {
    /// Nothing of that name, or not readable.
    #[error("cannot read {path}: {source}")]
    Unreadable {
        /// What was asked for.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A file of another kind.
    #[error("{path} is not a pack: its name does not end in .kilwa; build one with `kilwa build {path} -o NAME.kilwa`")]
    NotAPack {
        /// What was asked for.
        path: PathBuf,
    },
}

/// What the list and the landing page show of a pack.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The header.
    pub header: Header,
    /// The metadata block.
    pub metadata: Metadata,
}

/// Which version of a file was looked at; a change means reading it again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Identity {
    bytes: u64,
    modified: Option<SystemTime>,
    file: (u64, u64),
}

impl Identity {
    pub(crate) fn of(metadata: &std::fs::Metadata) -> Self {
        #[cfg(unix)]
        let file = {
            use std::os::unix::fs::MetadataExt;
            (metadata.dev(), metadata.ino())
        };
        #[cfg(not(unix))]
        let file = (0, 0);
        Self { bytes: metadata.len(), modified: metadata.modified().ok(), file }
    }
}

/// One pack of the folder.
#[derive(Debug)]
pub struct Model {
    /// Its name in URLs: lower-case letters, digits and hyphens.
    pub slug: String,
    /// File name without the folder.
    pub file_name: String,
    /// Bytes of the file.
    pub bytes: u64,
    /// What it says of itself, or why it cannot be read.
    pub summary: Result<Summary, String>,
    pub(crate) path: PathBuf,
    pub(crate) identity: Identity,
    hash: OnceCell<Arc<str>>,
}

impl Model {
    /// The title, or the file name where there is none.
    pub fn title(&self) -> &str {
        match &self.summary {
            Ok(s) if !s.metadata.title.trim().is_empty() => &s.metadata.title,
            _ => &self.file_name,
        }
    }

    /// BLAKE3 of the whole file, 64 hexadecimal digits, computed once per version of the file.
    ///
    /// # Errors
    /// When the file cannot be read, or changed since it was listed.
    pub async fn hash(&self) -> std::io::Result<Arc<str>> {
        let hash = self.hash.get_or_try_init(|| async {
            let (path, identity) = (self.path.clone(), self.identity);
            tokio::task::spawn_blocking(move || hash_file(&path, identity)).await.map_err(std::io::Error::other)?
        });
        hash.await.cloned()
    }
}

fn hash_file(path: &Path, identity: Identity) -> std::io::Result<Arc<str>> {
    let mut file = File::open(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = file.read(&mut buffer)?;
        if n == 0 {
            break;
        }
        hasher.update(buffer.get(..n).unwrap_or_default());
    }
    if Identity::of(&file.metadata()?) != identity {
        return Err(std::io::Error::other("the file changed while it was read"));
    }
    Ok(hasher.finalize().to_hex().as_str().into())
}

/// The packs by slug.
pub struct Catalogue {
    root: PathBuf,
    single: bool,
    models: RwLock<BTreeMap<String, Arc<Model>>>,
    listed: Mutex<Instant>,
}

impl Catalogue {
    /// List a folder, or take one pack.
    ///
    /// # Errors
    /// [`CatalogueError`] when there is nothing readable of that name, or it is a file of another kind.
    pub fn open(path: &Path) -> Result<Self, CatalogueError> {
        let unreadable = |source| CatalogueError::Unreadable { path: path.to_owned(), source };
        let single = !std::fs::metadata(path).map_err(unreadable)?.is_dir();
        if single && !is_pack(path) {
            return Err(CatalogueError::NotAPack { path: path.to_owned() });
        }
        let catalogue =
            Self { root: path.to_owned(), single, models: RwLock::default(), listed: Mutex::new(Instant::now()) };
        catalogue.list().map_err(unreadable)?;
        Ok(catalogue)
    }

    /// All models, by slug, after looking at the folder again where that is due. Blocks on the file system.
    pub fn models(&self) -> Vec<Arc<Model>> {
        self.relist();
        self.models.read().unwrap_or_else(PoisonError::into_inner).values().cloned().collect()
    }

    /// The model of a slug. Blocks on the file system when the slug is not known.
    pub fn model(&self, slug: &str) -> Option<Arc<Model>> {
        let known = || self.models.read().unwrap_or_else(PoisonError::into_inner).get(slug).cloned();
        known().or_else(|| {
            self.relist();
            known()
        })
    }

    /// Read the folder now: a pack was seen to differ from what was listed.
    pub(crate) fn list(&self) -> std::io::Result<()> {
        let mut files: Vec<PathBuf> = if self.single {
            vec![self.root.clone()]
        } else {
            std::fs::read_dir(&self.root)?
                .filter_map(|e| e.ok().map(|e| e.path()))
                .filter(|p| is_pack(p) && p.is_file())
                .collect()
        };
        files.sort();
        let before = self.models.read().unwrap_or_else(PoisonError::into_inner).clone();
        let mut models = BTreeMap::new();
        for path in files {
            let Ok(metadata) = std::fs::metadata(&path) else { continue };
            let identity = Identity::of(&metadata);
            let slug = free_slug(&path, &models);
            let model = match before.get(&slug) {
                Some(m) if m.path == path && m.identity == identity => Arc::clone(m),
                _ => Arc::new(Model {
                    file_name: path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default(),
                    bytes: metadata.len(),
                    summary: summarise(&path),
                    hash: OnceCell::new(),
                    slug: slug.clone(),
                    path,
                    identity,
                }),
            };
            models.insert(slug, model);
        }
        *self.models.write().unwrap_or_else(PoisonError::into_inner) = models;
        Ok(())
    }

    fn relist(&self) {
        let mut listed = self.listed.lock().unwrap_or_else(PoisonError::into_inner);
        if listed.elapsed() >= RELIST {
            if let Err(e) = self.list() {
                tracing::warn!("cannot list {}: {e}", self.root.display());
            }
            *listed = Instant::now();
        }
    }
}

fn is_pack(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa"))
}

fn summarise(path: &Path) -> Result<Summary, String> {
    let read = |file: &mut File, offset: u64, length: usize| -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    };
    let mut file = File::open(path).map_err(|e| format!("cannot open: {e}"))?;
    let actual = file.metadata().map_err(|e| e.to_string())?.len();
    if actual < HEADER_BYTES as u64 {
        return Err(format!("not a Kilwa pack: only {actual} bytes long"));
    }
    let header = read(&mut file, 0, HEADER_BYTES).map_err(|e| format!("cannot read the header: {e}"))?;
    let header = Header::parse(&header).map_err(|e| e.to_string())?;
    if header.file_bytes != actual {
        return Err(format!(
            "truncated or overlong: {} bytes there, {} written; copy it again",
            actual, header.file_bytes
        ));
    }
    let (offset, length) = header.metadata;
    let bytes = read(&mut file, offset, length as usize).map_err(|e| format!("cannot read the metadata: {e}"))?;
    let metadata = Metadata::parse(&bytes, &header).map_err(|e| e.to_string())?;
    Ok(Summary { header, metadata })
}

/// The file's stem in lower-case letters, digits and single hyphens, with a number where that is taken.
fn free_slug(path: &Path, taken: &BTreeMap<String, Arc<Model>>) -> String {
    let stem = path.file_stem().map(|s| s.to_string_lossy().to_lowercase()).unwrap_or_default();
    let mut slug = String::new();
    for c in stem.chars() {
        if c.is_ascii_alphanumeric() {
            slug.push(c);
        } else if !slug.is_empty() && !slug.ends_with('-') {
            slug.push('-');
        }
    }
    let slug = match slug.trim_end_matches('-') {
        "" => "model",
        s => s,
    };
    if !taken.contains_key(slug) {
        return slug.to_owned();
    }
    // One of the first taken.len() + 1 numbers is free.
    (2..taken.len() + 3).map(|n| format!("{slug}-{n}")).find(|s| !taken.contains_key(s)).unwrap_or_default()
}
