//! What there is to serve: the packs and archive objects of one folder (or one of either), by slug.
//!
//! The folder is the truth. It is listed again when somebody looks at the list or asks for a slug that is not known, at
//! most once a second, and seldom enough that listing takes a small part of the time; what changed in size, time or identity is read again.
//! What cannot be read stays in the list with the reason, so that nothing vanishes silently.

use crate::FRESHNESS;
use crate::access::{Clock, Verdict, verdict};
use crate::object_files::{ObjectFiles, Tables};
use crate::store::{self, Identity, Place, S3, Survey, is_away, is_refused, is_silent};
use axum::http::StatusCode;
use glam::DVec3;
use kilwa_archive::Manifest;
use kilwa_archive::layout::SMALL_FILE_MAX;
use kilwa_archive::layout::{MANIFEST, RESERVED};
use kilwa_archive::manifest::{Access, AccessState};
use kilwa_files::plain_file;
use kilwa_pack::header::MAGIC;
use kilwa_pack::plural::counted;
use kilwa_pack::{HEADER_BYTES, Header, Metadata};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Bound;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};
use thiserror::Error;
use tokio::sync::OnceCell;

/// The folder is not listed for more than one part in so many of the time.
const LISTING_SHARE: u32 = 20;

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
    /// A store that cannot be listed.
    #[error("cannot list {name}: {source}")]
    Silent {
        /// Its address.
        name: String,
        /// Its message.
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
    /// Its title, empty where it has none.
    pub title: String,
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Points, if the pack is made of points.
    pub points: Option<u64>,
    /// Smallest and largest corner, metres.
    pub bounds: [DVec3; 2],
    /// Median edge of the finest level, metres.
    pub spacing: f64,
    /// Reference system; without it, local.
    pub crs: Option<String>,
}

/// One pack or object of the folder.
#[derive(Debug)]
pub struct Model {
    /// Its name in URLs: lower-case letters, digits and hyphens.
    pub slug: String,
    /// Name of its file or folder, without the folder that it is in.
    pub file_name: String,
    /// Bytes of the pack.
    pub bytes: u64,
    /// What the pack says of itself, or why it cannot be read.
    pub summary: Result<Summary, String>,
    pub(crate) place: Place,
    pub(crate) identity: Identity,
    pub(crate) kind: Kind,
    /// Its store refused access to it: it is requested again.
    is_unsure: bool,
    hash: OnceCell<Arc<str>>,
}

/// What a model lies in.
#[derive(Debug)]
pub(crate) enum Kind {
    /// A pack, with published notes and a list of holes beside it where there are any.
    Pack {
        /// The notes.
        notes: Option<PathBuf>,
        /// The list of holes.
        holes: Option<PathBuf>,
        /// Whether the file begins as a pack does: a file with that ending may be anything.
        begins_as_pack: bool,
    },
    /// An archive object.
    Object(Object),
}

/// What the list shows of an object.
#[derive(Debug)]
pub(crate) struct Object {
    pub(crate) files: Arc<ObjectFiles>,
    pub(crate) title: String,
    pub(crate) rights: Option<String>,
    pub(crate) access: Option<Access>,
    /// Address of the current pack inside the object.
    pub(crate) pack: Option<String>,
}

impl Object {
    /// Why it was withdrawn, if it was.
    pub(crate) fn withdrawn(&self) -> Option<&str> {
        let access = self.access.as_ref().filter(|access| access.state == AccessState::Withdrawn)?;
        Some(access.reason.as_deref().unwrap_or_default())
    }
}

impl Model {
    /// The title, or the file name if there is none.
    pub fn title(&self) -> &str {
        match (&self.kind, &self.summary) {
            (Kind::Object(object), _) if !object.title.is_empty() => &object.title,
            (_, Ok(s)) if !s.title.trim().is_empty() => &s.title,
            _ => &self.file_name,
        }
    }

    /// Who may have it now.
    pub(crate) fn verdict(&self, clock: &Clock) -> Verdict {
        let access = self.object().and_then(|object| object.access.as_ref());
        access.map_or(Verdict::Open, |access| verdict(access, clock))
    }

    pub(crate) fn object(&self) -> Option<&Object> {
        match &self.kind {
            Kind::Object(object) => Some(object),
            Kind::Pack { .. } => None,
        }
    }

    /// Address of its page, from the root of the site.
    pub fn page(&self) -> String {
        if self.object().is_some() { format!("/{}/", self.slug) } else { format!("/m/{}", self.slug) }
    }

    /// Address of its pack, where there is one.
    pub(crate) fn pack(&self) -> Option<String> {
        match &self.kind {
            Kind::Object(object) => Some(format!("/{}/{}", self.slug, object.pack.as_deref()?)),
            Kind::Pack { .. } => Some(format!("/packs/{}.kilwa", self.slug)),
        }
    }

    /// BLAKE3 of the whole file, 64 hexadecimal digits, computed once per version of the file. What is begun continues when nobody waits any more.
    ///
    /// # Errors
    /// When the file cannot be read, or changed since it was listed.
    pub async fn hash(self: &Arc<Self>) -> std::io::Result<Arc<str>> {
        if let Some(hash) = self.hash.get() {
            return Ok(Arc::clone(hash));
        }
        let model = Arc::clone(self);
        let begun = tokio::spawn(async move {
            let hash = model.hash.get_or_try_init(|| async {
                let Some(path) = model.place.path().map(Path::to_owned) else {
                    return Err(std::io::Error::other("it is not on this computer"));
                };
                let identity = model.identity.clone();
                tokio::task::spawn_blocking(move || hash_file(&path, &identity)).await.map_err(std::io::Error::other)?
            });
            hash.await.cloned()
        });
        begun.await.map_err(std::io::Error::other)?
    }
}

fn hash_file(path: &Path, identity: &Identity) -> std::io::Result<Arc<str>> {
    let mut file = plain_file::open_direct(path)?;
    let mut hasher = blake3::Hasher::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = file.read(&mut buffer)?;
        if n == 0 {
            break;
        }
        hasher.update(buffer.get(..n).unwrap_or_default());
    }
    if Identity::of(&file.metadata()?) != *identity {
        return Err(std::io::Error::other("the file changed while it was read"));
    }
    Ok(hasher.finalize().to_hex().as_str().into())
}

/// The models by slug.
pub struct Catalogue {
    root: Place,
    single: bool,
    listing: RwLock<Arc<Listing>>,
    listed: Mutex<Listed>,
    tables: Arc<Tables>,
    /// How long a listing of the folder is trusted.
    freshness: Duration,
}

/// What the folder held when it was last listed.
#[derive(Default)]
struct Listing {
    models: BTreeMap<String, Arc<Model>>,
    /// Those of them that no index knows: packs, and objects that cannot be read.
    others: Vec<Arc<Model>>,
}

/// An object that was found: where it lies, and the identity of its manifest.
type Found = (Place, Identity);

/// When the folder was last listed, and how long that took.
struct Listed {
    at: Instant,
    took: Duration,
}

impl Catalogue {
    /// List a folder of packs and objects, or take one of either.
    ///
    /// # Errors
    /// [`CatalogueError`] when there is nothing readable of that name, or it is a file of another kind.
    pub fn open(path: &Path) -> Result<Self, CatalogueError> {
        Self::open_fresh(path, FRESHNESS)
    }

    /// The same with a freshness other than [`FRESHNESS`]; with zero, every request reads the folder again.
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn open_fresh(path: &Path, freshness: Duration) -> Result<Self, CatalogueError> {
        let unreadable = |source| CatalogueError::Unreadable { path: path.to_owned(), source };
        let is_file = !std::fs::metadata(path).map_err(unreadable)?.is_dir();
        if is_file && !is_pack(path) {
            return Err(CatalogueError::NotAPack { path: path.to_owned() });
        }
        // A name, for what is given as `.`; and a working directory that changes later changes nothing.
        let root = path.canonicalize().map_err(unreadable)?;
        let single = is_file || root.join(MANIFEST).is_file();
        Self::begin(Place::Path(root), single, freshness).map_err(unreadable)
    }

    /// List the objects of a part of a store, or take one object.
    ///
    /// # Errors
    /// [`CatalogueError::Silent`] when the store cannot be listed.
    pub fn of_store(store: &Arc<S3>) -> Result<Self, CatalogueError> {
        let root = Place::Key(Arc::clone(store), String::new());
        let silent = |source| CatalogueError::Silent { name: store.name().to_owned(), source };
        let single = store.is_object().map_err(silent)?;
        let catalogue = Self::begin(root, single, FRESHNESS).map_err(silent)?;
        // One that is refused is named in the list; where all are, it is the keys.
        let listing = catalogue.listing();
        let refused = listing.models.values().next().filter(|_| listing.models.values().all(|m| m.is_unsure));
        if let Some(why) = refused.and_then(|model| model.summary.as_ref().err()) {
            let message =
                format!("{why}; the store refuses every object: see AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY");
            return Err(silent(std::io::Error::other(message)));
        }
        Ok(catalogue)
    }

    fn begin(root: Place, single: bool, freshness: Duration) -> std::io::Result<Self> {
        let listed = Mutex::new(Listed { at: Instant::now(), took: Duration::ZERO });
        let tables = Tables::new(freshness);
        let catalogue = Self { root, single, listing: RwLock::default(), listed, tables, freshness };
        catalogue.list()?;
        Ok(catalogue)
    }

    /// All models, by slug, after looking at the folder again where that is due. Blocks on the file system.
    pub fn models(&self) -> Vec<Arc<Model>> {
        self.relist();
        self.listing().models.values().cloned().collect()
    }

    /// As last listed, at most `limit` models by slug, behind `after` or from the first on.
    pub(crate) fn after(&self, after: Option<&str>, limit: usize) -> Vec<Arc<Model>> {
        let from = after.map_or(Bound::Unbounded, Bound::Excluded);
        self.listing()
            .models
            .range::<str, _>((from, Bound::Unbounded))
            .take(limit)
            .map(|(_, m)| Arc::clone(m))
            .collect()
    }

    /// Look at the folder again where that is due. Blocks on the file system.
    pub(crate) fn refresh(&self) {
        self.relist();
    }

    /// Packs, and objects that cannot be read, as last listed.
    pub(crate) fn others(&self) -> Vec<Arc<Model>> {
        self.listing().others.clone()
    }

    /// Whether there was any object that can be read.
    pub(crate) fn has_objects(&self) -> bool {
        let listing = self.listing();
        listing.models.len() > listing.others.len()
    }

    fn listing(&self) -> Arc<Listing> {
        Arc::clone(&self.listing.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// What is served, where it may hold many models.
    pub fn shelf(&self) -> Option<&Place> {
        (!self.single).then_some(&self.root)
    }

    /// The same, where it is a folder of this computer.
    pub fn folder(&self) -> Option<&Path> {
        self.shelf().and_then(Place::path)
    }

    /// What is served.
    pub(crate) fn place(&self) -> &Place {
        &self.root
    }

    /// How many models there were when the folder was last listed.
    pub(crate) fn count(&self) -> usize {
        self.listing().models.len()
    }

    /// The model of a slug. Blocks on the file system when the slug is not known.
    pub fn model(&self, slug: &str) -> Option<Arc<Model>> {
        let known = || self.listing().models.get(slug).cloned();
        known().or_else(|| {
            self.relist();
            known()
        })
    }

    /// What a slug that is not known is answered with: of a store that does not answer nobody can say what it has.
    pub(crate) fn missing(&self) -> StatusCode {
        let is_away = self.root.store().is_some_and(|store| store.away().is_some());
        if is_away { StatusCode::SERVICE_UNAVAILABLE } else { StatusCode::NOT_FOUND }
    }

    /// Whether the folder can be read now.
    ///
    /// # Errors
    /// The system's reason why not.
    pub(crate) fn check(&self) -> std::io::Result<()> {
        match &self.root {
            Place::Path(path) if path.is_dir() => std::fs::read_dir(path).map(drop),
            Place::Path(path) => plain_file::open(path).map(drop),
            Place::Key(store, _) => store.check(),
        }
    }

    /// Read the folder now: something was seen to differ from what was listed.
    pub(crate) fn list(&self) -> std::io::Result<()> {
        let began = Instant::now();
        let before = self.listing();
        let mut slugs = BTreeSet::new();
        // Objects first: their slugs are the names of their folders, which other places cite.
        let (survey, objects) = self.objects()?;
        let objects: Vec<_> =
            objects.into_iter().map(|(place, id)| (free_slug(&place, &mut slugs), place, id)).collect();
        let listed = store::each(&self.root, &objects, |(slug, place, identity)| {
            match listed_before(&before.models, slug, place, identity) {
                Some(model) => Ok(model),
                None => object_of(place, slug, identity, &survey, &self.tables).map(|model| {
                    // What a store refuses now stays as it is known.
                    let known = before.models.get(slug).filter(|known| model.is_unsure && known.place.is(place));
                    known.cloned().unwrap_or(model)
                }),
            }
        });
        // A store that went away is no reason to forget what is there.
        let mut models: BTreeMap<_, _> =
            listed.into_iter().map(|m| m.map(|m| (m.slug.clone(), m))).collect::<std::io::Result<_>>()?;
        for path in self.packs()? {
            let metadata = match plain_file::metadata_direct(&path) {
                Ok(metadata) => metadata,
                Err(e) => {
                    // A folder may be an object, whatever its name.
                    if plain_file::is_other(&e) && e.kind() != std::io::ErrorKind::IsADirectory {
                        store::warn_of(&path, &e);
                    }
                    continue;
                }
            };
            let (identity, place) = (Identity::of(&metadata), Place::Path(path));
            let slug = free_slug(&place, &mut slugs);
            let model = listed_before(&before.models, &slug, &place, &identity)
                .unwrap_or_else(|| pack_of(place, &slug, identity));
            models.insert(slug, model);
        }
        let is_other = |m: &&Arc<Model>| m.object().is_none_or(|object| object.access.is_none());
        let others = models.values().filter(is_other).cloned().collect();
        *self.listing.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(Listing { models, others });
        *self.listed.lock().unwrap_or_else(PoisonError::into_inner) =
            Listed { at: Instant::now(), took: began.elapsed() };
        Ok(())
    }

    /// The objects there are, by the names of their folders, and the identities of their manifests; with what was seen of their files on the way.
    fn objects(&self) -> std::io::Result<(Arc<Survey>, Vec<Found>)> {
        if !self.single {
            let survey = self.root.objects()?;
            let objects = survey.objects.iter().map(|(name, identity)| (self.root.join(name), identity.clone()));
            let objects = objects.collect();
            return Ok((survey, objects));
        }
        let objects = match self.root.join(MANIFEST).identity() {
            Ok(identity) => vec![(self.root.clone(), identity)],
            Err(e) if is_silent(&e) => return Err(e),
            Err(_) => Vec::new(),
        };
        Ok((Arc::default(), objects))
    }

    /// The packs that lie beside them, sorted; a store has none.
    fn packs(&self) -> std::io::Result<Vec<PathBuf>> {
        let Some(root) = self.root.path() else { return Ok(Vec::new()) };
        if self.single {
            return Ok(if is_pack(root) { vec![root.to_owned()] } else { Vec::new() });
        }
        let is_shown = |path: &PathBuf| {
            let hidden = path.file_name().is_none_or(|n| n.to_string_lossy().starts_with('.'));
            !hidden && is_pack(path)
        };
        let mut packs: Vec<_> =
            std::fs::read_dir(root)?.filter_map(|e| e.ok().map(|e| e.path())).filter(is_shown).collect();
        packs.sort();
        Ok(packs)
    }

    /// How long a listing that took this long is trusted. If every request must see the folder as it is, the cost of the listing does not count.
    fn trusted_for(&self, took: Duration) -> Duration {
        let limit = self.root.listed_for(self.freshness);
        if limit.is_zero() { limit } else { limit.max(took * LISTING_SHARE) }
    }

    fn relist(&self) {
        let due = {
            let mut listed = self.listed.lock().unwrap_or_else(PoisonError::into_inner);
            let due = listed.at.elapsed() >= self.trusted_for(listed.took);
            if due {
                // Others who ask meanwhile take what there is.
                listed.at = Instant::now();
            }
            due
        };
        if due && let Err(e) = self.list() {
            store::warn(&self.root, &e);
        }
    }
}

/// The model as it was listed before, if nothing of it changed.
fn listed_before(
    before: &BTreeMap<String, Arc<Model>>,
    slug: &str,
    place: &Place,
    identity: &Identity,
) -> Option<Arc<Model>> {
    let model = before.get(slug)?;
    let same_lists = match &model.kind {
        Kind::Pack { notes, holes, .. } => {
            place.path().is_some_and(|path| *notes == beside(path, NOTES) && *holes == beside(path, HOLES))
        }
        Kind::Object(_) => true,
    };
    let same = same_lists && !model.is_unsure && model.place.is(place) && model.identity == *identity;
    same.then(|| Arc::clone(model))
}

fn pack_of(place: Place, slug: &str, identity: Identity) -> Arc<Model> {
    Arc::new(Model {
        file_name: place.name(),
        bytes: identity.bytes(),
        summary: place.path().map_or_else(|| Err("it is not on this computer".to_owned()), summarise),
        hash: OnceCell::new(),
        slug: slug.to_owned(),
        kind: Kind::Pack {
            notes: place.path().and_then(|path| beside(path, NOTES)),
            holes: place.path().and_then(|path| beside(path, HOLES)),
            begins_as_pack: place.path().is_some_and(|path| begins_as_pack(path).unwrap_or(false)),
        },
        is_unsure: false,
        place,
        identity,
    })
}

/// Extensions of published notes and of a list of holes beside a pack; they replace the extension of the pack.
pub(crate) const NOTES: &str = "annotations.json";
pub(crate) const HOLES: &str = "holes.geojson";

/// `NAME.annotations.json` or `NAME.holes.geojson` beside `NAME.kilwa`.
fn beside(pack: &Path, ending: &str) -> Option<PathBuf> {
    let file = pack.with_extension(ending);
    match plain_file::metadata_direct(&file) {
        Ok(_) => Some(file),
        Err(e) => {
            if plain_file::is_other(&e) {
                store::warn_of(&file, &e);
            }
            None
        }
    }
}

/// From its manifest alone: a folder of ten thousand objects is listed without looking into each.
fn object_of(
    place: &Place,
    slug: &str,
    identity: &Identity,
    survey: &Survey,
    tables: &Arc<Tables>,
) -> std::io::Result<Arc<Model>> {
    let files = ObjectFiles::new(place.clone(), Arc::clone(tables));
    let mut object = Object { files, title: String::new(), rights: None, access: None, pack: None };
    let (mut bytes, mut summary, mut is_unsure) = (0, Err("it was withdrawn".to_owned()), false);
    let read = place.join(MANIFEST).read_listed(identity, SMALL_FILE_MAX);
    match read.and_then(|bytes| Manifest::parse(&bytes).map_err(std::io::Error::other)) {
        Err(e) if is_away(&e) => return Err(e),
        Err(e) if is_refused(&e) => {
            is_unsure = true;
            summary = Err(format!("the store does not deliver its manifest: {e}; {}", store::hint(&e)));
        }
        Err(e) => summary = Err(format!("cannot be read as an archive object: {e}; run kilwa verify on it")),
        Ok(manifest) => {
            object.rights = Some(manifest.rights.short.clone());
            object.access = Some(manifest.access.clone());
            if let Some(version) = manifest.current().filter(|_| object.withdrawn().is_none()) {
                let name = &version.pack.url;
                // The name comes from a manifest, whose reader lets through no path that leaves the object.
                let length = match survey.identity(place, name) {
                    Ok(identity) => Some(identity.bytes()),
                    Err(e) if is_away(&e) => return Err(e),
                    // Requests for it get this reason; whether it exists is unknown.
                    Err(e) if is_refused(&e) => Some(version.pack.bytes),
                    Err(_) => None,
                };
                if length == Some(version.pack.bytes) {
                    object.pack = Some(name.clone());
                    summary = Ok(Summary {
                        title: manifest.title.clone(),
                        triangles: version.figures.triangles,
                        points: version.figures.points,
                        bounds: version.figures.bounds,
                        spacing: version.figures.spacing,
                        crs: version.figures.crs.clone(),
                    });
                } else {
                    let what = if length.is_some() { "has another length" } else { "is not there" };
                    summary = Err(format!("{name}, which its manifest names, {what}; run kilwa verify on it"));
                }
                bytes = version.pack.bytes;
            }
            object.title = manifest.title;
        }
    }
    Ok(Arc::new(Model {
        file_name: place.name(),
        bytes,
        summary,
        hash: OnceCell::new(),
        slug: slug.to_owned(),
        place: place.clone(),
        identity: identity.clone(),
        kind: Kind::Object(object),
        is_unsure,
    }))
}

fn is_pack(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("kilwa"))
}

/// Whether the first bytes of a file are those of a pack.
fn begins_as_pack(path: &Path) -> std::io::Result<bool> {
    let mut first = Vec::new();
    plain_file::open_direct(path)?.take(MAGIC.len() as u64).read_to_end(&mut first)?;
    Ok(!first.is_empty() && MAGIC.starts_with(&first))
}

fn summarise(path: &Path) -> Result<Summary, String> {
    let read = |file: &mut File, offset: u64, length: usize| -> std::io::Result<Vec<u8>> {
        let mut bytes = vec![0; length];
        file.seek(SeekFrom::Start(offset))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    };
    let mut file = plain_file::open_direct(path).map_err(|e| format!("cannot open: {e}"))?;
    let actual = file.metadata().map_err(|e| e.to_string())?.len();
    if actual < HEADER_BYTES as u64 {
        return Err(format!("not a Kilwa pack: only {} long", counted(actual, "byte", "bytes")));
    }
    let header = read(&mut file, 0, HEADER_BYTES).map_err(|e| format!("cannot read the header: {e}"))?;
    let header = Header::parse(&header).map_err(|e| e.to_string())?;
    if header.file_bytes != actual {
        return Err(format!(
            "truncated or too long: it has {}, its header states {}; copy it again",
            counted(actual, "byte", "bytes"),
            header.file_bytes
        ));
    }
    let (offset, length) = header.metadata;
    let bytes = read(&mut file, offset, length as usize).map_err(|e| format!("cannot read the metadata: {e}"))?;
    let metadata = Metadata::parse(&bytes, &header).map_err(|e| e.to_string())?;
    Ok(Summary {
        title: metadata.title,
        triangles: header.triangles,
        points: header.is_of_points().then_some(metadata.vertices),
        bounds: [metadata.bounds_min, metadata.bounds_max],
        spacing: metadata.median_edge,
        crs: metadata.crs,
    })
}

/// The name, a pack's without its ending, in lower-case letters, digits and single hyphens, with a number where that is taken.
fn free_slug(place: &Place, taken: &mut BTreeSet<String>) -> String {
    let name = place.name().to_lowercase();
    let stem = name.strip_suffix(".kilwa").unwrap_or(&name);
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
    let is_free = |slug: &str| !taken.contains(slug) && !RESERVED.contains(&slug);
    // One of the first taken.len() + 1 numbers is free.
    let numbered = || (2..taken.len() + 3).map(|n| format!("{slug}-{n}")).find(|s| !taken.contains(s));
    let slug = if is_free(slug) { slug.to_owned() } else { numbered().unwrap_or_default() };
    taken.insert(slug.clone());
    slug
}
