//! Verify what was sent, and publish it: on a thread of its own, one version at a time, with how far it is for who asks.

use super::staging::Staging;
use super::wire::{AnnouncedFile, Intent, Meant, State, Status};
use super::{Refusal, Uploads, files, lock, withheld};
use axum::http::StatusCode;
use kilwa_archive::assemble::{
    Facts, Following, Landing, agree, complete, further, is_published, next_version, write_viewer,
};
use kilwa_archive::checksums::sha256_of;
use kilwa_archive::date::day_of;
use kilwa_archive::draft::{Draft, DraftError};
use kilwa_archive::layout::{ANNOTATIONS, COLOUR_REPORT, HOLES, PREVIEW};
use kilwa_archive::lock::{Lock, PATIENCE};
use kilwa_archive::manifest::{Manifest, ManifestError};
use kilwa_archive::sound;
use kilwa_archive::source::FileSource;
use kilwa_pack::Reader;
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

/// A version that is being verified, or was.
pub(super) struct Job {
    pub(super) who: String,
    version: u32,
    /// Bytes that were verified, and went to a store where the version does.
    pub(super) done: AtomicU64,
    of: u64,
    /// Bytes of each file.
    files: BTreeMap<String, u64>,
    /// Uploads on their way to a store.
    pub(super) sending: Mutex<Option<String>>,
    /// Why it does not continue at the moment.
    pub(super) waits: Mutex<Option<String>>,
    pub(super) ended: Mutex<Option<Result<Done, Refusal>>>,
}

/// However the work on a job ends, by a panic or for want of a thread too, the job has ended with it.
pub(super) struct Ending(pub(super) Arc<Job>);

impl Drop for Ending {
    fn drop(&mut self) {
        let message =
            "the server failed while it verified the version; nothing was published. Run the same command again";
        lock(&self.0.ended).get_or_insert_with(|| Err(Refusal::new(StatusCode::SERVICE_UNAVAILABLE, message)));
    }
}

/// What was published.
#[derive(Debug, Clone, Copy)]
pub(super) struct Done {
    pub(super) version: u32,
    pub(super) already: bool,
}

impl Job {
    /// `is_stored`: what was verified goes to a store.
    pub(super) fn new(who: &str, intent: &Intent, is_stored: bool) -> Self {
        let all: u64 = intent.files.iter().map(|f| f.bytes).sum();
        Self {
            who: who.to_owned(),
            version: intent.version,
            done: AtomicU64::new(0),
            of: if is_stored { all.saturating_mul(2) } else { all },
            files: intent.files.iter().map(|f| (f.path.clone(), f.bytes)).collect(),
            sending: Mutex::default(),
            waits: Mutex::default(),
            ended: Mutex::default(),
        }
    }

    /// Bytes of a file by its key, `slug/v1/path`; 0 of one that was made here.
    pub(super) fn bytes_of(&self, key: &str) -> u64 {
        key.splitn(3, '/').nth(2).and_then(|path| self.files.get(path)).copied().unwrap_or(0)
    }

    pub(super) fn is_running(&self) -> bool {
        lock(&self.ended).is_none()
    }

    /// How far it is; a refusal has a status of its own.
    pub(super) fn status(&self) -> (StatusCode, Status) {
        let (done, of) = (self.done.load(Ordering::Relaxed), self.of);
        match &*lock(&self.ended) {
            None => {
                let waits = lock(&self.waits).clone();
                (StatusCode::OK, Status { done, of, waits, ..Status::new(State::Verifying, self.version) })
            }
            Some(Ok(d)) => (StatusCode::OK, Status { already: d.already, ..Status::new(State::Published, d.version) }),
            Some(Err(e)) => {
                (e.status, Status { error: Some(e.why.clone()), ..Status::new(State::Refused, self.version) })
            }
        }
    }
}

/// Verify and publish; then the files of the upload go. What is damaged goes too, everything else stays for another try.
pub(super) fn publish(uploads: &Uploads, staging: Staging, job: &Arc<Job>, now: u64) -> Result<Done, Refusal> {
    let intent = staging.record.intent.clone();
    let meant = intent.check(&uploads.limits, now)?;
    if !staging.lacking().is_empty() {
        return Err(Refusal::new(StatusCode::TOO_EARLY, "files are missing; run the same command again"));
    }
    // Whatever takes long needs only the upload, whose lock is held, and keeps nobody else from the folder.
    let checked = checked(&staging, &intent, &meant, job);
    match checked.and_then(|pack| placed(uploads, &staging, &intent, &meant, pack, (job.as_ref(), now))) {
        Ok(done) => {
            staging.remove();
            Ok(done)
        }
        Err(refusal) => {
            // An upload that cannot be published, however often it is tried, is not kept.
            if refusal.status == StatusCode::UNPROCESSABLE_ENTITY {
                staging.remove();
            }
            Err(refusal)
        }
    }
}

/// What a pack says of itself, and its identity.
type OfPack = (kilwa_pack::Metadata, String);

/// Whether every file that was sent is what it must be, byte for byte.
fn checked(staging: &Staging, intent: &Intent, meant: &Meant, job: &Job) -> Result<OfPack, Refusal> {
    let of_pack = check_pack(staging, intent, &meant.pack, &job.done)?;
    for file in intent.files.iter().filter(|f| f.path != meant.pack.path) {
        let at = staging.at(file);
        let (_, sum) = fs::File::open(&at).and_then(sha256_of).map_err(|e| Refusal::disk("read what was sent", &e))?;
        if sum != file.sha256 {
            return Err(altered(staging, file));
        }
        files::check(&file.path, &at).map_err(|e| refused_file(&e))?;
        if let Some(announced) = intent.preview.filter(|_| file.path == PREVIEW) {
            files::check_announced(&at, announced).map_err(|e| refused_file(&e))?;
        }
        if intent.location_redacted {
            withheld::check_file(&file.path, &at, &of_pack.0).map_err(|e| refused_file(&e))?;
        }
        if file.path == ANNOTATIONS {
            let noted = files::Noted {
                bounds: [of_pack.0.bounds_min, of_pack.0.bounds_max],
                pack: (&meant.pack.path, &of_pack.1),
                location_redacted: intent.location_redacted,
            };
            files::check_notes(&at, &noted).map_err(|e| refused_file(&e))?;
        }
        if file.path == HOLES {
            let bounds = [of_pack.0.bounds_min, of_pack.0.bounds_max];
            files::check_holes(&at, bounds, intent.location_redacted).map_err(|e| refused_file(&e))?;
        }
        if file.path == COLOUR_REPORT {
            files::check_colours(&at, &of_pack.0.sources, &intent.files).map_err(|e| refused_file(&e))?;
        }
        job.done.fetch_add(file.bytes, Ordering::Relaxed);
    }
    Ok(of_pack)
}

/// A file is not what was announced; it is removed, to be sent again.
fn altered(staging: &Staging, file: &AnnouncedFile) -> Refusal {
    staging.discard(file);
    let path = &file.path;
    Refusal::altered(format!(
        "{path} did not arrive with the announced content; run the same command again to send it again"
    ))
}

/// Versions are added, one after the other.
pub(super) fn check_version(intent: &Intent, before: Option<&Manifest>) -> Result<(), Refusal> {
    let next = next_version(before);
    if intent.version == next {
        return Ok(());
    }
    let there = if next == 1 { "has no version yet".to_owned() } else { format!("is at version {}", next - 1) };
    Err(Refusal::conflict(format!(
        "{} {there} here, so the next is {next}, not {}; check what is published, then run the command again",
        intent.slug, intent.version
    )))
}

fn locked(folder: &Path, job: &Job) -> Result<Lock, Refusal> {
    let message = "another publication or withdrawal is in progress; this one continues after it";
    let taken = Lock::wait(folder, PATIENCE, &|| *lock(&job.waits) = Some(message.to_owned()));
    *lock(&job.waits) = None;
    taken.map_err(|e| Refusal { retry_after: Some(60), ..refused(&e) })
}

/// Publish what was checked, while nobody else publishes to the folder.
fn placed(
    uploads: &Uploads,
    staging: &Staging,
    intent: &Intent,
    meant: &Meant,
    (of_pack, identity): OfPack,
    (job, now): (&Job, u64),
) -> Result<Done, Refusal> {
    let locked = locked(&uploads.shelf, job)?;
    let mut there = uploads.there_at_last(&locked, &meant.slug, job)?;
    let (object, before) = (there.shelf.join(&intent.slug), there.before.take());
    if let Some(m) =
        before.as_ref().filter(|m| is_published(&object, m, &meant.pack.sha256, &intent.metadata, intent.optional()))
    {
        return Ok(Done { version: m.current, already: true });
    }
    check_version(intent, before.as_ref())?;
    let crs = agree(&intent.metadata, &of_pack).map_err(Refusal::content)?;
    let note = match &before {
        Some(m) => further(m, &following(intent, &of_pack, &identity, &day_of(now))).map_err(Refusal::conflict)?,
        None => intent.note.clone(),
    };
    let accuracy = intent.metadata.capture.as_ref().and_then(|c| c.accuracy);
    let facts = Facts {
        metadata: intent.metadata.clone(),
        rights: meant.rights.clone(),
        slug: meant.slug.clone(),
        before,
        published: intent.published.clone(),
        note,
        location_redacted: intent.location_redacted,
        crs,
        accuracy: of_pack.capture_accuracy.or(accuracy),
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
    };
    let steps = |what: &str| (uploads.steps)(what);
    // Of a store the object is made in a folder of its own, which has a lock of its own.
    let locked = there.stored.as_ref().map_or(&locked, |(_, work)| work.lock());
    let mut draft = Draft::begin(locked, &facts.slug, &steps).map_err(|e| refused(&e))?;
    // In the order in which publishing to a folder writes them.
    for file in &intent.files {
        let is_same_file = put(staging, file, &draft.folder())?;
        if is_same_file {
            // Checked a moment ago, and nobody else writes while the upload's lock is held: it is not hashed a second time.
            draft.adopt_known(&file.path, file.bytes, &file.sha256).map_err(|e| refused(&e))?;
        } else if draft.adopt(&file.path).map_err(|e| refused(&e))? != (file.bytes, file.sha256.clone()) {
            return Err(altered(staging, file));
        }
    }
    let entry = facts.pack_entry(meant.pack.bytes, meant.pack.sha256.clone(), identity);
    let publication = facts.publication(entry, of_pack, meant.preview);
    let publication = publication.with_notes(&draft.folder()).map_err(|e| Refusal::disk("read the notes", &e))?;
    let publication = publication.with_holes(&draft.folder()).map_err(|e| Refusal::disk("read the holes", &e))?;
    let publication =
        publication.with_colours(&draft.folder()).map_err(|e| Refusal::disk("read the colour report", &e))?;
    let drawings = intent.drawings.iter().map(|d| (d.path.clone(), d.words.clone())).collect();
    write_viewer(&mut draft, &uploads.page).map_err(|e| refused(&e))?;
    let landing = Landing { viewer: &uploads.page, drawings, list: None };
    complete(draft, locked, &facts, &publication, landing).map_err(|e| refused(&e))?;
    uploads.send(&facts.slug, publication.version, &there, job)?;
    Ok(Done { version: publication.version, already: false })
}

/// What is wrong with a file that was sent, or with the disk.
fn refused_file(e: &io::Error) -> Refusal {
    match e.kind() {
        io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof => Refusal::content(e.to_string()),
        _ => Refusal::disk("read what was sent", e),
    }
}

fn following<'a>(
    intent: &'a Intent,
    pack: &'a kilwa_pack::Metadata,
    identity: &'a str,
    today: &'a str,
) -> Following<'a> {
    Following {
        at: &intent.slug,
        metadata: &intent.metadata,
        pack,
        identity,
        redacted: intent.location_redacted,
        same_object: intent.same_object,
        open_access: false,
        today,
        note: Some(&intent.note),
        published: &intent.published,
    }
}

/// Every byte and chunk of the pack.
fn check_pack(staging: &Staging, intent: &Intent, file: &AnnouncedFile, done: &AtomicU64) -> Result<OfPack, Refusal> {
    let path = staging.at(file);
    let failed = |e: io::Error| Refusal::disk("read the pack", &e);
    let source = FileSource::open(&path).map_err(failed)?;
    // Half of the processors: readers come first.
    let threads = std::thread::available_parallelism().map_or(1, |n| n.get().div_ceil(2));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    let pool = pool.map_err(|e| Refusal::disk("start threads", &io::Error::other(e)))?;
    let on_read = |n: u64| {
        done.fetch_add(n, Ordering::Relaxed);
    };
    let checked = pool.install(|| sound::check(&source, &on_read));
    let checked = checked.map_err(failed)?;
    if checked.sha256.as_ref() != Some(&file.sha256) {
        return Err(altered(staging, file));
    }
    if let Some(damage) = checked.damage() {
        return Err(Refusal::content(format!("the pack is damaged: {damage}")));
    }
    let reader = Reader::open(source).map_err(|e| Refusal::content(format!("the pack: {e}")))?;
    if intent.location_redacted {
        pool.install(|| withheld::check_pack(intent, &reader)).map_err(Refusal::content)?;
    }
    Ok((reader.metadata().clone(), reader.identity()))
}

/// Give a file of the upload its name in the draft: as a link, so that a failure later costs nothing; as a copy where there are no links.
/// Whether it is the same file.
fn put(staging: &Staging, file: &AnnouncedFile, folder: &Path) -> Result<bool, Refusal> {
    let (from, to) = (staging.at(file), folder.join(&file.path));
    let linked = (|| {
        if let Some(parent) = to.parent() {
            fs::create_dir_all(parent)?;
        }
        fs::hard_link(&from, &to).map(|()| true).or_else(|_| fs::copy(&from, &to).map(|_| false))
    })();
    linked.map_err(|e| Refusal::disk("write the version", &e))
}

fn is_full(e: &DraftError) -> bool {
    let kinds = [io::ErrorKind::StorageFull, io::ErrorKind::QuotaExceeded];
    matches!(e, DraftError::Disk { reason, .. } if kinds.contains(&reason.kind()))
}

/// What went wrong with a version, for the client. Paths of the server are only in the log.
pub(super) fn refused(e: &DraftError) -> Refusal {
    tracing::error!("an upload: {e}");
    let passing = |why: String| Refusal { retry_after: Some(60), ..Refusal::new(StatusCode::SERVICE_UNAVAILABLE, why) };
    match e {
        DraftError::Disk { reason, what, .. } => Refusal::disk(&format!("{what} the version"), reason),
        DraftError::Busy(_) => passing(
            "another publication or withdrawal is in progress on the server; nothing was published. Run the same command again when it is done".to_owned(),
        ),
        DraftError::Unlockable { .. } => passing(format!(
            "the server cannot lock its folder, and without a lock one of two simultaneous changes could be lost; nothing was published. {ASK}, then run the same command again"
        )),
        DraftError::Unfinished { done, why } if is_full(why) => Refusal::new(
            StatusCode::INSUFFICIENT_STORAGE,
            format!(
                "{done}: the disk of the server is full. Ask its administrator to free space, then run the same command again to finish"
            ),
        ),
        DraftError::Unfinished { done, .. } => passing(format!(
            "{done}: the disk of the server failed. Run the same command again to finish; if that fails too, {ask}",
            ask = ASK.to_lowercase()
        )),
        // Only a withdrawal fails like this, never an upload.
        DraftError::Left { why, .. } => refused(why),
        DraftError::There(_) => Refusal::conflict(
            "this version already exists; check what is published, then run the same command again".to_owned(),
        ),
        DraftError::Unnamed(_) => Refusal::conflict(format!(
            "the server has a folder for this version that manifest.json does not name: somebody may be copying the version there, or an earlier kilwa was interrupted. {ASK}, then run the same command again"
        )),
        DraftError::Foreign(_) => Refusal::conflict(format!(
            "on the server, a file that kilwa did not make is in the way. {ASK}, then run the same command again"
        )),
        DraftError::Other(_) => Refusal::conflict(format!(
            "the server has something under this name that is not an object of kilwa, or is damaged. {ASK}, or choose another name with slug = \"…\" in the metadata, then run the same command again"
        )),
        DraftError::Page(_) => Refusal::new(
            StatusCode::INTERNAL_SERVER_ERROR,
            format!(
                "the server has a viewer page that no landing page can be made of; nothing was published. {ASK}, then run the same command again"
            ),
        ),
        DraftError::Manifest(e) => Refusal::content(format!(
            "the manifest of this version cannot be written{}. Correct the metadata, then run the same command again; if that does not help, {ask}",
            field_of(e).map(|field| format!(", because of {field}")).unwrap_or_default(),
            ask = ASK.to_lowercase()
        )),
    }
}

/// The field that keeps a manifest from being written, if it looks like a field name, such as `versions[1].pack.url`.
fn field_of(e: &ManifestError) -> Option<&str> {
    let ManifestError::Wrong { field, .. } = e else { return None };
    let is_name = |c: char| c.is_ascii_alphanumeric() || "._[]".contains(c);
    field.chars().all(is_name).then_some(field.as_str())
}

/// What to do if only the server's log may name the place.
const ASK: &str = "Ask the administrator of the server (its log says where)";

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_archive::viewer::PageError;
    use std::path::PathBuf;

    #[test]
    fn no_refusal_contains_a_path_of_the_server() {
        let path = || PathBuf::from("/srv/secret/fort");
        let other = |text: &str| io::Error::other(text.to_owned());
        let disk = || DraftError::Disk { what: "write", path: path(), reason: other("at /srv/secret") };
        let manifest = DraftError::Manifest;
        let left = |why, left| DraftError::Left { why: Box::new(why), left: Box::new(left) };
        let all = [
            disk(),
            DraftError::Disk { what: "write", path: path(), reason: io::ErrorKind::StorageFull.into() },
            DraftError::Disk {
                what: "write",
                path: path(),
                reason: io::Error::new(io::ErrorKind::QuotaExceeded, "at /srv/secret"),
            },
            DraftError::Busy(path()),
            DraftError::Unlockable { path: path(), reason: other("at /srv/secret") },
            DraftError::There(path()),
            DraftError::Unnamed(path()),
            DraftError::Foreign(path()),
            DraftError::Other("/srv/secret/fort is there and is no object".to_owned()),
            disk().after("the version is published, but not all of its files are in place"),
            manifest(ManifestError::Form("/srv/secret/fort: no JSON".to_owned())),
            manifest(ManifestError::Newer(7)),
            DraftError::Page(PageError::Places("/srv/secret".to_owned())),
            manifest(ManifestError::Wrong { field: "versions[1].pack.url".to_owned(), why: "/srv/secret".to_owned() }),
            manifest(ManifestError::Wrong { field: "/srv/secret/fort".to_owned(), why: "it is empty".to_owned() }),
            manifest(ManifestError::Form("/srv/secret".to_owned())).after("the version is published"),
            left(disk(), DraftError::Foreign(path())),
            left(manifest(ManifestError::Form("/srv/secret".to_owned())), disk()),
            left(disk().after("the version is published"), disk()),
        ];
        // Add every new variant to the list above.
        for e in &all {
            match e {
                DraftError::Disk { .. }
                | DraftError::Busy(_)
                | DraftError::Unlockable { .. }
                | DraftError::There(_)
                | DraftError::Unnamed(_)
                | DraftError::Unfinished { .. }
                | DraftError::Left { .. }
                | DraftError::Other(_)
                | DraftError::Foreign(_)
                | DraftError::Page(_)
                | DraftError::Manifest(_) => {}
            }
        }
        for e in all {
            let Refusal { status, why, retry_after, .. } = refused(&e);
            assert!(!why.contains("/srv") && !why.contains("secret"), "{why}");
            assert!(why.contains("run the same command again") || why.contains("Run the same command again"), "{why}");
            let is_passing = status == StatusCode::SERVICE_UNAVAILABLE;
            assert_eq!(is_passing, retry_after.is_some(), "{status}: {why}");
        }
        let named = refused(&manifest(ManifestError::Wrong { field: "page.bytes".to_owned(), why: String::new() }));
        assert!(named.status == StatusCode::UNPROCESSABLE_ENTITY && named.why.contains("page.bytes"), "{}", named.why);
        let foreign = io::Error::other("cannot open /srv/secret/fort: gone");
        assert!(!Refusal::disk("read the pack", &foreign).why.contains("/srv"));
        let missing = Refusal::disk("read the pack", &io::ErrorKind::PermissionDenied.into()).why;
        assert!(missing.contains("permission denied"), "{missing}");
    }
}
