//! Extracts: the mesh of a pack for other programs, made when somebody asks, and kept for the next.
//!
//! | URL | what |
//! |---|---|
//! | `/<slug>/extract` | what there is to download, and a form for the rest ([`page`], [`routes`]) |
//! | POST there | asks for a file and leads to it |
//! | `/<slug>/extract/<name>` | the file; 202 with how far it is while it is being made; 404 where nobody asked for it |
//!
//! [`job_spec`] defines what can be requested and its name, this module makes it: as many at once as there are cores, others wait in a
//! queue in which networks take turns ([`queue`]), and learn how many are ahead of them and the estimated wait ([`pace`]). Files being made may take as much room as the cache has; identical requests share one file. [`mesh`] extracts the mesh from the pack.
//!
//! Invariants: the cache holds complete files only, under names made from the hash of the pack and the job, never from an address; its size stays below
//! the limit, the oldest go first; a file is given to whoever may have the pack, and nobody else. Of a pack in a store only what a mesh needs is fetched, into room that
//! counts beside that of the mesh ([`pack`]). Failures: a full disk and a pack that cannot be read are reported to those who wait, and retried at the next
//! request; an unavailable store is waited for and reported.

#[cfg(test)]
mod fake;
pub(crate) mod job_spec;
mod mesh;
pub(crate) mod pace;
mod pack;
pub(crate) mod page;
mod queue;
pub(crate) mod routes;

pub use job_spec::{Detail, Format};
pub use pack::{Opened, Pack, is_not_given};

use crate::store::{Content, Identity};
use job_spec::JobSpec;
use kilwa_files::plain_file;
use pace::{Pace, Wait};
use queue::{Full, Queue, SHARE};
use std::collections::{BTreeMap, VecDeque};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Jobs of one network that begin something new, in [`WHILE`].
pub(crate) const STARTS: usize = 20;
/// Seconds after which whoever was refused may come again: where nothing is known, at least, and at most.
const COME_AGAIN: u64 = 30;
const SOONEST: u64 = 5;
const LATEST: u64 = 600;
const WHILE: Duration = Duration::from_secs(600);
/// Networks that are remembered; an older one is forgotten for a new one.
const NETWORKS: usize = 10_000;
/// How long a failure is reported.
const FAILURE_SHOWN: Duration = Duration::from_secs(600);
/// Where something could not be made, the same is not tried again before this.
const AGAIN: Duration = Duration::from_secs(10);
/// Prefix of the names of folders in which meshes are being made.
const UNFINISHED: &str = ".kilwa-";
/// What a crash left half written is removed after this.
const STALE: Duration = Duration::from_secs(24 * 3600);

/// Why a file was not made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Failure {
    /// No room on the disk.
    Full,
    /// The store does not answer, or does not give the pack.
    Away,
    /// Anything else, in a sentence for the log.
    Other(String),
}

/// Writes the mesh of a pack to a file, which exists only when it is complete, and reports the share that is done, 0 to 1. If it fails, it leaves no
/// files.
pub type Extractor = dyn Fn(&Pack, &Path, Format, Detail, &(dyn Fn(f64) + Sync)) -> Result<(), Failure> + Send + Sync;

/// The status of a job.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum JobStatus {
    /// The file is there.
    Ready(PathBuf),
    /// So many are before it; and when it will probably be there.
    Waiting(usize, Option<Wait>),
    /// So much of it is done, percent; so many bytes of a pack in a store were fetched; and when it will probably be there.
    Running(u32, Option<u64>, Option<Wait>),
    /// It could not be made.
    Failed(Failure),
    /// Nobody asked for it, or it was so long ago that it went for others.
    Unknown,
}

/// Why a job is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The queue is full: seconds to wait.
    Busy(u64),
    /// This network has its share of the queue: seconds to wait.
    Share(u64),
    /// This network has begun too many: seconds to wait.
    TooMany(u64),
}

struct Job {
    pack: Pack,
    /// Bytes on the disk while it is made, at most: of the mesh, and of what is read of a pack in a store.
    disk_bytes: [u64; 2],
    spec: JobSpec,
    share: Arc<AtomicU32>,
    /// Who asked first; where it runs, whose turn it was.
    network: String,
    phase: Phase,
}

impl Job {
    /// What it takes while it is made: what estimates of time go by.
    fn bytes(&self) -> u64 {
        total(self.disk_bytes)
    }

    /// For how long it runs, and the share of it that is done.
    fn state(&self) -> Option<(Duration, f64)> {
        let Phase::Running(since) = &self.phase else { return None };
        Some((since.elapsed(), f64::from(self.share.load(Ordering::Relaxed)) / 100.0))
    }
}

enum Phase {
    Waiting,
    Running(Instant),
    Failed(Failure, Instant),
}

#[derive(Default)]
struct State {
    jobs: BTreeMap<String, Job>,
    queue: Queue,
    pace: Pace,
    running: usize,
    /// Of those that run.
    disk_bytes: u64,
    starts: BTreeMap<String, VecDeque<Instant>>,
    /// The identities of the cached files when they were made, or, if an earlier run made them, when they were first requested.
    made: BTreeMap<String, Identity>,
}

impl State {
    /// Bytes and state of what runs.
    fn running(&self) -> Vec<(u64, (Duration, f64))> {
        self.jobs.values().filter_map(|job| Some((job.bytes(), job.state()?))).collect()
    }

    /// How many are before a job that waits, and when it will probably be there.
    fn waiting(&self, key: &str, job: &Job, workers: usize) -> JobStatus {
        let before = self.queue.before(key);
        let bytes: Vec<u64> = before.iter().filter_map(|key| self.jobs.get(key)).map(Job::bytes).collect();
        JobStatus::Waiting(before.len(), self.pace.of_waiting(job.bytes(), &self.running(), &bytes, workers))
    }

    /// Seconds until a place will probably be free: when the first of those that run has ended.
    fn come_again(&self) -> u64 {
        let ends = self.running().into_iter().filter_map(|(bytes, state)| self.pace.of_running(bytes, state));
        ends.map(|wait| wait.to.as_secs()).min().unwrap_or(COME_AGAIN).clamp(SOONEST, LATEST)
    }
}

/// The cache, and what is being made for it.
pub struct Extracts {
    cache: PathBuf,
    max_bytes: u64,
    workers: usize,
    extractor: Arc<Extractor>,
    /// Asked how much room the disk of a folder has.
    space: Space,
    state: Mutex<State>,
}

/// Tells the free bytes of the disk that holds a folder, where that can be known.
type Space = Box<dyn Fn(&Path) -> Option<u64> + Send + Sync>;

impl Extracts {
    /// With a cache in the folder `cache`, which is made where it is missing, of at most `max_bytes`.
    ///
    /// # Errors
    /// If the folder cannot be created or listed.
    pub fn open(cache: PathBuf, max_bytes: u64) -> std::io::Result<Arc<Self>> {
        Self::with_extractor(cache, max_bytes, Arc::new(mesh::extract))
    }

    /// As [`Extracts::open`], with meshes that `extractor` makes.
    ///
    /// # Errors
    /// As [`Extracts::open`].
    pub fn with_extractor(cache: PathBuf, max_bytes: u64, extractor: Arc<Extractor>) -> std::io::Result<Arc<Self>> {
        create(&cache)?;
        for entry in std::fs::read_dir(&cache)? {
            let entry = entry?;
            let name = entry.file_name();
            let is_ours = name.to_str().is_some_and(|n| n.starts_with(UNFINISHED));
            let age = entry.metadata().and_then(|m| m.modified()).ok().and_then(|t| t.elapsed().ok());
            if is_ours && age.is_some_and(|age| age > STALE) {
                // Another server that uses the cache may have been faster.
                drop(std::fs::remove_dir_all(entry.path()).or_else(|_| std::fs::remove_file(entry.path())));
            }
        }
        let workers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let space = Box::new(|at: &Path| fs4::available_space(at).ok());
        let extracts = Self { cache, max_bytes, workers, extractor, space, state: Mutex::default() };
        extracts.tidy(None);
        Ok(Arc::new(extracts))
    }

    /// The same, where the disk has as much room as this says: for tests in which it has little.
    #[must_use]
    pub fn with_space(mut self: Arc<Self>, space: impl Fn(&Path) -> Option<u64> + Send + Sync + 'static) -> Arc<Self> {
        if let Some(extracts) = Arc::get_mut(&mut self) {
            extracts.space = Box::new(space);
        }
        self
    }

    /// Bytes that the cache may hold.
    pub(crate) fn max_bytes(&self) -> u64 {
        self.max_bytes
    }

    /// Bytes that a job for a pack of so many triangles takes while it is made: of the mesh, and of what is read of a pack in a store.
    pub(crate) fn disk_bytes(&self, pack: &Pack, triangles: u64, spec: JobSpec) -> [u64; 2] {
        let mesh = spec.disk_bytes(triangles);
        [mesh, pack.disk_bytes(mesh, self.max_bytes)]
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, key: &str) -> PathBuf {
        self.cache.join(key)
    }

    /// A file of the cache, if it is unchanged. A changed file, or something else in its place, is removed, and the mesh is made again when it is requested.
    /// Blocks.
    fn ready(&self, key: &str) -> Option<PathBuf> {
        let path = self.path(key);
        let why = match plain_file::metadata_inside(&self.cache, &path) {
            Ok(metadata) => {
                let now = Identity::of(&metadata);
                if *self.lock().made.entry(key.to_owned()).or_insert_with(|| now.clone()) == now {
                    return Some(path);
                }
                "it was changed".to_owned()
            }
            Err(e) if plain_file::is_other(&e) => e.to_string(),
            Err(_) => return None,
        };
        tracing::warn!("{}: removed from the cache of meshes: {why}", path.display());
        self.lock().made.remove(key);
        if let Err(e) = std::fs::remove_file(&path) {
            tracing::warn!("cannot remove {}: {e}", path.display());
        }
        None
    }

    /// Open a file of the cache that is [`JobStatus::Ready`]. Blocks.
    ///
    /// # Errors
    /// If it was removed at this moment to make space, or was replaced.
    pub(crate) fn open_ready(&self, path: &Path) -> std::io::Result<Content> {
        let file = plain_file::open_inside(&self.cache, path)?;
        let identity = Identity::of(&file.metadata()?);
        let key = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if self.lock().made.get(key) == Some(&identity) {
            Ok(Content::File(file, identity))
        } else {
            Err(plain_file::replaced())
        }
    }

    /// Have a file of a pack of so many triangles made, unless it is there or being made. Blocks on the file system.
    pub(crate) fn ask(
        self: &Arc<Self>,
        (pack, hash): (&Pack, &str),
        triangles: u64,
        spec: JobSpec,
        network: &str,
    ) -> Result<(), Refusal> {
        let key = spec.key(hash);
        if self.ready(&key).is_some() {
            return Ok(());
        }
        let now = Instant::now();
        {
            let mut state = self.lock();
            state.jobs.retain(
                |_, job| !matches!(&job.phase, Phase::Failed(_, at) if now.duration_since(*at) > FAILURE_SHOWN),
            );
            match state.jobs.get(&key).map(|job| &job.phase) {
                Some(Phase::Waiting) => {
                    state.queue.join(network, &key);
                    return Ok(());
                }
                Some(Phase::Running(_)) => return Ok(()),
                Some(Phase::Failed(_, at)) if now.duration_since(*at) < AGAIN => return Ok(()),
                _ => {}
            }
            let again = state.come_again();
            state.queue.push(network, &key).map_err(|full| match full {
                Full::All => Refusal::Busy(again),
                Full::Share => Refusal::Share(again),
            })?;
            if let Err(seconds) = begin(&mut state.starts, network, now) {
                state.queue.remove(&key);
                return Err(Refusal::TooMany(seconds));
            }
            let disk_bytes = self.disk_bytes(pack, triangles, spec);
            let (share, pack) = (Arc::default(), pack.clone().with_disk_space(&self.cache, disk_bytes[1]));
            let network = network.to_owned();
            state.jobs.insert(key, Job { pack, disk_bytes, spec, share, network, phase: Phase::Waiting });
        }
        self.go_on();
        Ok(())
    }

    /// The status of a job. Blocks on the file system.
    pub(crate) fn job_status(&self, hash: &str, spec: JobSpec) -> JobStatus {
        let key = spec.key(hash);
        {
            let state = self.lock();
            match state.jobs.get(&key) {
                Some(job @ Job { phase: Phase::Running(_), share, pack, .. }) => {
                    let left = job.state().and_then(|now| state.pace.of_running(job.bytes(), now));
                    return JobStatus::Running(share.load(Ordering::Relaxed), pack.fetched(), left);
                }
                Some(job @ Job { phase: Phase::Waiting, .. }) => return state.waiting(&key, job, self.workers),
                Some(Job { phase: Phase::Failed(failure, _), .. }) => return JobStatus::Failed(failure.clone()),
                None => {}
            }
        }
        self.ready(&key).map_or(JobStatus::Unknown, JobStatus::Ready)
    }

    /// Begin what can be begun.
    fn go_on(self: &Arc<Self>) {
        loop {
            let (key, pack, spec, share) = {
                let mut state = self.lock();
                if state.running >= self.workers {
                    return;
                }
                let Some((network, key)) = state.queue.next(self.workers) else { return };
                let beside = state.disk_bytes;
                let Some(job) = state.jobs.get_mut(&key) else {
                    state.queue.remove(&key);
                    continue;
                };
                // Whatever is in the cache already goes for it; what is being made beside it does not. Alone it always fits.
                let disk_bytes = beside.saturating_add(total(job.disk_bytes));
                if beside > 0 && disk_bytes > self.max_bytes {
                    return;
                }
                job.phase = Phase::Running(Instant::now());
                job.network.clone_from(&network);
                let begun = (key, (job.pack.clone(), job.disk_bytes), job.spec, Arc::clone(&job.share));
                state.queue.begin(&network, &begun.0);
                state.running += 1;
                state.disk_bytes = disk_bytes;
                begun
            };
            let (extracts, name) = (Arc::clone(self), key.clone());
            let make = move || extracts.make(&name, &pack, spec, &share);
            // A thread of its own: hours of work must not stand in the way of reading files.
            if let Err(e) = std::thread::Builder::new().name("extract".to_owned()).spawn(make) {
                self.ended(&key, Err(Failure::Other(format!("no thread: {e}"))));
            }
        }
    }

    fn make(self: &Arc<Self>, key: &str, (pack, disk_bytes): &(Pack, [u64; 2]), spec: JobSpec, share: &AtomicU32) {
        let progress = |done: f64| share.store((done.clamp(0.0, 1.0) * 100.0) as u32, Ordering::Relaxed);
        // What would have to be fetched again is not fetched in vain.
        let lacks_space =
            || pack.is_stored() && (self.space)(&self.cache).is_some_and(|free| free < total(*disk_bytes));
        let work = || if lacks_space() { Err(Failure::Full) } else { self.take(pack, key, spec, &progress) };
        // A defect in it must not leave a place taken for ever.
        let made = std::panic::catch_unwind(AssertUnwindSafe(work));
        let made = made.unwrap_or_else(|_| Err(Failure::Other("the program failed".to_owned())));
        match &made {
            Ok(()) => self.tidy(Some(key)),
            Err(failure) => tracing::warn!("{}: {} could not be made: {failure:?}", pack, spec.name(1)),
        }
        self.ended(key, made);
        self.go_on();
    }

    fn take(&self, pack: &Pack, key: &str, spec: JobSpec, progress: &(dyn Fn(f64) + Sync)) -> Result<(), Failure> {
        let failed = |e: std::io::Error| {
            let why = format!("cannot write to {}: {e}", self.cache.display());
            if e.kind() == std::io::ErrorKind::StorageFull { Failure::Full } else { Failure::Other(why) }
        };
        // Somebody may have deleted the folder.
        create(&self.cache).map_err(failed)?;
        // Other users may be able to read the cache folder. So a mesh is made in a private folder, and only the server can read it.
        let mut builder = tempfile::Builder::new();
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o700));
        let work = builder.prefix(UNFINISHED).tempdir_in(&self.cache).map_err(failed)?;
        let made = work.path().join(key);
        (self.extractor)(pack, &made, spec.format, spec.detail, progress)?;
        #[cfg(unix)]
        std::fs::set_permissions(&made, std::os::unix::fs::PermissionsExt::from_mode(0o600)).map_err(failed)?;
        std::fs::rename(&made, self.path(key)).map_err(failed)
    }

    fn ended(&self, key: &str, made: Result<(), Failure>) {
        let mut state = self.lock();
        let ran = state.jobs.get(key).map(|job| (job.network.clone(), job.bytes(), job.state()));
        state.running = state.running.saturating_sub(1);
        if let Some((network, bytes, now)) = ran {
            state.disk_bytes = state.disk_bytes.saturating_sub(bytes);
            state.queue.end(&network);
            if let (Ok(()), Some((took, _))) = (&made, now) {
                state.pace.add(bytes, took);
            }
        }
        match made {
            Ok(()) => {
                state.jobs.remove(key);
                // Its new identity is recorded when it is next requested.
                state.made.remove(key);
            }
            Err(failure) => {
                if let Some(job) = state.jobs.get_mut(key) {
                    job.phase = Phase::Failed(failure, Instant::now());
                }
            }
        }
    }

    /// Take the oldest files away until the rest is below the limit; `new` stays.
    fn tidy(&self, new: Option<&str>) {
        let Ok(entries) = std::fs::read_dir(&self.cache) else { return };
        let mut files: Vec<(SystemTime, u64, PathBuf)> = entries
            .flatten()
            .filter(|e| e.file_name().to_str().is_some_and(|n| !n.starts_with('.') && is_ours(n)))
            .filter_map(|e| {
                let metadata = e.metadata().ok()?;
                Some((metadata.modified().ok()?, metadata.len(), e.path()))
            })
            .collect();
        files.sort();
        let mut total: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
        for (_, bytes, path) in files {
            if total <= self.max_bytes {
                break;
            }
            if new.is_some_and(|new| path == self.path(new)) {
                continue;
            }
            match std::fs::remove_file(&path) {
                Ok(()) => {
                    total = total.saturating_sub(bytes);
                    self.lock().made.remove(path.file_name().and_then(|name| name.to_str()).unwrap_or_default());
                }
                Err(e) => tracing::warn!("cannot remove {}: {e}", path.display()),
            }
        }
    }
}

/// Create the cache folder if it does not exist.
fn create(cache: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    builder.recursive(true);
    // Models that are not public on the web must not be readable by other users of the computer.
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(cache)
}

/// All of the room of a job.
fn total([mesh, pack]: [u64; 2]) -> u64 {
    mesh.saturating_add(pack)
}

/// Whether a file of the cache's folder is one of the cache.
fn is_ours(name: &str) -> bool {
    let mut parts = name.split('.');
    let is_hash = parts.next().is_some_and(|hash| hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()));
    is_hash && name.rsplit('.').next().is_some_and(|end| Format::of(end).is_some())
}

/// Count a start; seconds to wait where there were too many.
fn begin(starts: &mut BTreeMap<String, VecDeque<Instant>>, network: &str, now: Instant) -> Result<(), u64> {
    if starts.len() >= NETWORKS && !starts.contains_key(network) {
        starts.retain(|_, times| times.back().is_some_and(|at| now.duration_since(*at) < WHILE));
        if starts.len() >= NETWORKS {
            starts.pop_first();
        }
    }
    let times = starts.entry(network.to_owned()).or_default();
    while times.front().is_some_and(|at| now.duration_since(*at) >= WHILE) {
        times.pop_front();
    }
    if times.len() >= STARTS {
        let first = times.front().map_or(Duration::ZERO, |at| now.duration_since(*at));
        return Err((WHILE.saturating_sub(first)).as_secs().max(1));
    }
    times.push_back(now);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::fake::Fake;
    use super::*;
    use crate::eventually::eventually;

    fn spec(triangles: u64) -> JobSpec {
        JobSpec { format: Format::Ply, detail: Detail::Triangles(triangles) }
    }

    fn hash() -> String {
        "a".repeat(64)
    }

    fn wait_for(extracts: &Extracts, spec: JobSpec, is_so: impl Fn(&JobStatus) -> bool) {
        let what = format!("the wanted state of {spec:?}");
        eventually(&what, || is_so(&extracts.job_status(&hash(), spec)).then_some(()));
    }

    /// With a fake that waits to be released.
    fn shop(max: u64, workers: usize) -> (tempfile::TempDir, Arc<Fake>, Arc<Extracts>) {
        let dir = tempfile::tempdir().unwrap();
        let fake = Arc::new(Fake::waiting());
        let mut extracts = Extracts::with_extractor(dir.path().join("cache"), max, fake.extractor()).unwrap();
        Arc::get_mut(&mut extracts).unwrap().workers = workers;
        (dir, fake, extracts)
    }

    #[test]
    fn the_same_extract_is_made_once_and_other_jobs_wait_their_turn() {
        let (_dir, fake, extracts) = shop(1 << 20, 1);
        let ask = |n| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, spec(n), "net");
        for _ in 0..5 {
            ask(1).unwrap();
        }
        ask(2).unwrap();
        ask(3).unwrap();
        wait_for(&extracts, spec(1), |s| matches!(s, JobStatus::Running(25, None, _)));
        assert_eq!(extracts.job_status(&hash(), spec(3)), JobStatus::Waiting(1, None));
        assert_eq!(extracts.job_status(&hash(), spec(9)), JobStatus::Unknown);
        fake.waits(false);
        for n in 1..=3 {
            wait_for(&extracts, spec(n), |s| matches!(s, JobStatus::Ready(_)));
        }
        ask(1).unwrap();
        assert_eq!(fake.made.load(Ordering::SeqCst), 3, "an existing file is not made again");
    }

    #[test]
    fn a_job_that_does_not_fit_beside_running_jobs_waits() {
        let disk_bytes = spec(1000).disk_bytes(1000);
        let (_dir, fake, extracts) = shop(disk_bytes * 2 + disk_bytes / 2, 4);
        let within = |n: u32| JobSpec { format: Format::Ply, detail: Detail::Error(f64::from(n) / 1e6) };
        for n in 1..=4 {
            extracts.ask((&Pack::here(Path::new("p")), &hash()), 1000, within(n), "net").unwrap();
        }
        wait_for(&extracts, within(2), |s| matches!(s, JobStatus::Running(25, None, _)));
        assert_eq!(extracts.job_status(&hash(), within(3)), JobStatus::Waiting(0, None));
        assert_eq!(extracts.job_status(&hash(), within(4)), JobStatus::Waiting(1, None));
        fake.waits(false);
        for n in 1..=4 {
            wait_for(&extracts, within(n), |s| matches!(s, JobStatus::Ready(_)));
        }
        assert_eq!(extracts.lock().disk_bytes, 0);
    }

    #[test]
    fn a_network_with_many_requests_gets_its_share_and_other_networks_are_next() {
        let (_dir, fake, extracts) = shop(1 << 20, 1);
        let ask = |n, net: &str| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, spec(n), net);
        let taken = (0..100).filter(|n| ask(*n, "greedy").is_ok()).count();
        // One runs, the others wait.
        assert_eq!(taken, 1 + SHARE);
        assert!(matches!(ask(200, "greedy"), Err(Refusal::Share(SOONEST..=LATEST))));
        assert_eq!(ask(300, "other"), Ok(()));
        wait_for(&extracts, spec(0), |s| matches!(s, JobStatus::Running(..)));
        assert_eq!(extracts.job_status(&hash(), spec(300)), JobStatus::Waiting(0, None), "nobody is before it");
        assert_eq!(extracts.job_status(&hash(), spec(1)), JobStatus::Waiting(1, None));
        // Whoever asks for what another waits for has the better place of both.
        assert_eq!(ask(4, "third"), Ok(()));
        assert_eq!(extracts.job_status(&hash(), spec(4)), JobStatus::Waiting(1, None));
        fake.waits(false);
        for n in [0, 1, 2, 3, 4, 300] {
            wait_for(&extracts, spec(n), |s| matches!(s, JobStatus::Ready(_)));
        }
        assert_eq!(fake.made.load(Ordering::SeqCst), 6);
        // Measurements predict how long the next will take.
        fake.waits(true);
        assert_eq!((ask(500, "greedy"), ask(501, "other")), (Ok(()), Ok(())));
        let waits = extracts.job_status(&hash(), spec(501));
        assert!(matches!(waits, JobStatus::Waiting(0, Some(wait)) if wait.from <= wait.to), "{waits:?}");
        fake.waits(false);
    }

    #[test]
    fn the_queue_and_the_jobs_of_a_network_are_limited() {
        let (_dir, fake, extracts) = shop(1 << 20, 1);
        let ask = |n, net: &str| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, spec(n), net);
        ask(0, "first").unwrap();
        wait_for(&extracts, spec(0), |s| matches!(s, JobStatus::Running(..)));
        let places = queue::PLACES as u64;
        for n in 1..=places {
            ask(n, &format!("net {n}")).unwrap();
        }
        assert!(matches!(ask(99, "another"), Err(Refusal::Busy(SOONEST..=LATEST))));
        assert_eq!(ask(3, "another"), Ok(()), "what waits already can be joined");
        fake.waits(false);
        wait_for(&extracts, spec(places), |s| matches!(s, JobStatus::Ready(_)));
        let refused = (0..40).find(|n| {
            let refused = matches!(ask(200 + n, "greedy"), Err(Refusal::TooMany(1..=600)));
            wait_for(&extracts, spec(200 + n), |s| refused || matches!(s, JobStatus::Ready(_)));
            refused
        });
        assert_eq!(refused, Some(STARTS as u64));
        assert_eq!(extracts.job_status(&hash(), spec(220)), JobStatus::Unknown);
        assert_eq!(ask(999, "another"), Ok(()));
    }

    #[test]
    fn a_full_cache_evicts_its_oldest_files_and_keeps_foreign_files() {
        let (dir, fake, extracts) = shop(2500, 1);
        std::fs::write(dir.path().join("cache/notes.ply"), vec![0; 5000]).unwrap();
        fake.waits(false);
        for n in 1..=4 {
            extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, spec(n), "net").unwrap();
            wait_for(&extracts, spec(n), |s| matches!(s, JobStatus::Ready(_)));
            // Each a second later than the one before, and none in the future.
            let JobStatus::Ready(made) = extracts.job_status(&hash(), spec(n)) else { panic!("it is there") };
            let time = SystemTime::now() - Duration::from_secs(100 - n);
            std::fs::File::options().write(true).open(made).unwrap().set_modified(time).unwrap();
            // As after a restart, when no other times are known.
            extracts.lock().made.clear();
        }
        let left: Vec<bool> =
            (1..=4).map(|n| matches!(extracts.job_status(&hash(), spec(n)), JobStatus::Ready(_))).collect();
        assert_eq!(left, [false, false, true, true]);
        assert!(dir.path().join("cache/notes.ply").exists());
    }

    #[test]
    fn a_failure_is_reported_and_not_retried_at_once() {
        let (_dir, fake, extracts) = shop(1000, 1);
        fake.fails(Failure::Full);
        fake.waits(false);
        let ask = |n| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, spec(n), "net").unwrap();
        let failed = |n| wait_for(&extracts, spec(n), |s| *s == JobStatus::Failed(Failure::Full));
        ask(1);
        failed(1);
        ask(1);
        // The only worker takes the jobs in their order: were there a second attempt, it would come before this one.
        ask(2);
        failed(2);
        assert_eq!(fake.made.load(Ordering::SeqCst), 2);
    }
}
