//! Extracts: the mesh of a pack for other programs, made when somebody asks, and kept for the next.
//!
//! | URL | what |
//! |---|---|
//! | `/<slug>/extract` | what there is to download, and a form for the rest ([`page`], [`routes`]) |
//! | POST there | asks for a file and leads to it |
//! | `/<slug>/extract/<name>` | the file; 202 with how far it is while it is being made; 404 where nobody asked for it |
//!
//! [`order`] says what can be asked for and how it is called, this module makes it: as many at once as there are cores, others wait in a
//! line that ends somewhere, and while what is being made may take as much room as the cache is large, and who asks for what is being made gets the same. How a mesh is taken out of a pack is not known here: the program
//! gives an [`Extract`].
//!
//! Invariants: the cache holds complete files only, under names made from the pack's hash and the order, never from an address; its size stays below
//! the limit, the oldest go first; a file is given to whoever may have the pack, and nobody else. Of a pack in a store only what a mesh needs is fetched, into room that
//! counts beside that of the mesh ([`pack`]). Failures: a full disk and a pack that cannot be read are told to whoever waits, and tried again when somebody asks
//! again; a store that goes away is waited for, and told of.

#[cfg(test)]
mod clerk;
pub(crate) mod order;
mod pack;
pub(crate) mod page;
pub(crate) mod routes;

pub use order::{Detail, Format};
pub use pack::{Opened, Pack, is_not_given};

use order::Order;
use std::collections::{BTreeMap, VecDeque};
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime};

/// Orders that wait; for more, who asks is told to come back.
const LINE: usize = 16;
/// Orders of one network that begin something new, in [`WHILE`].
const STARTS: usize = 20;
const WHILE: Duration = Duration::from_secs(600);
/// Networks that are remembered; an older one is forgotten for a new one.
const NETWORKS: usize = 10_000;
/// A failure is told for so long.
const TOLD: Duration = Duration::from_secs(600);
/// Where something could not be made, the same is not tried again before this.
const AGAIN: Duration = Duration::from_secs(10);
/// What a crash left half written is taken away after this.
const STALE: Duration = Duration::from_secs(24 * 3600);
/// Endings of files of this cache.
const ENDINGS: [&str; 4] = ["ply", "glb", "obj", "stl"];

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

/// Takes a mesh out of a pack.
pub trait Extract: Send + Sync {
    /// Write the mesh of `pack` to `to`, which is there only when it is complete. `progress` is told the share that is done, 0 to 1.
    ///
    /// # Errors
    /// [`Failure`]; nothing is left then.
    fn extract(
        &self,
        pack: &Pack,
        to: &Path,
        format: Format,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), Failure>;
}

/// How an order stands.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Standing {
    /// The file is there.
    Ready(PathBuf),
    /// So many are before it.
    Waiting(usize),
    /// So much of it is done, percent; and so many bytes of a pack in a store were fetched.
    Running(u32, Option<u64>),
    /// It could not be made.
    Failed(Failure),
    /// Nobody asked for it, or it was so long ago that it went for others.
    Unknown,
}

/// Why an order is not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    /// The line is full: seconds to wait.
    Busy(u64),
    /// This network has begun too many: seconds to wait.
    TooMany(u64),
}

struct Job {
    pack: Pack,
    /// Bytes on the disk while it is made, at most: of the mesh, and of what is read of a pack in a store.
    room: [u64; 2],
    order: Order,
    share: Arc<AtomicU32>,
    phase: Phase,
}

enum Phase {
    Waiting,
    Running,
    Failed(Failure, Instant),
}

#[derive(Default)]
struct State {
    jobs: BTreeMap<String, Job>,
    line: VecDeque<String>,
    running: usize,
    /// Of those that run.
    room: u64,
    starts: BTreeMap<String, VecDeque<Instant>>,
}

/// The cache, and what is being made for it.
pub struct Extracts {
    cache: PathBuf,
    most_bytes: u64,
    workers: usize,
    extractor: Arc<dyn Extract>,
    /// Asked how much room the disk of a folder has.
    space: Space,
    state: Mutex<State>,
}

/// Tells the free bytes of the disk that holds a folder, where that can be known.
type Space = Box<dyn Fn(&Path) -> Option<u64> + Send + Sync>;

impl Extracts {
    /// With a cache in the folder `cache`, which is made where it is missing, of at most `most_bytes`.
    ///
    /// # Errors
    /// When the folder cannot be made or listed.
    pub fn open(cache: PathBuf, most_bytes: u64, extractor: Arc<dyn Extract>) -> std::io::Result<Arc<Self>> {
        let mut builder = std::fs::DirBuilder::new();
        builder.recursive(true);
        // What is not public for the web is not public for other users of the machine.
        #[cfg(unix)]
        std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
        builder.create(&cache)?;
        for entry in std::fs::read_dir(&cache)? {
            let entry = entry?;
            let name = entry.file_name();
            let is_ours = name.to_str().is_some_and(|n| n.starts_with(".kilwa-"));
            let age = entry.metadata().and_then(|m| m.modified()).ok().and_then(|t| t.elapsed().ok());
            if is_ours && age.is_some_and(|age| age > STALE) {
                // Another server that uses the cache may have been faster.
                drop(std::fs::remove_file(entry.path()));
            }
        }
        let workers = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let space = Box::new(|at: &Path| fs4::available_space(at).ok());
        let extracts = Self { cache, most_bytes, workers, extractor, space, state: Mutex::default() };
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
    pub(crate) fn most_bytes(&self) -> u64 {
        self.most_bytes
    }

    /// Bytes that an order of a pack of so many triangles takes while it is made: of the mesh, and of what is read of a pack in a store.
    pub(crate) fn room(&self, pack: &Pack, triangles: u64, order: Order) -> [u64; 2] {
        let mesh = order.room(triangles);
        [mesh, pack.room(mesh, self.most_bytes)]
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, key: &str) -> PathBuf {
        self.cache.join(key)
    }

    /// Have a file of a pack of so many triangles made, unless it is there or being made. Blocks on the file system.
    pub(crate) fn ask(
        self: &Arc<Self>,
        (pack, hash): (&Pack, &str),
        triangles: u64,
        order: Order,
        network: &str,
    ) -> Result<(), Refusal> {
        let key = order.key(hash);
        if self.path(&key).is_file() {
            return Ok(());
        }
        let now = Instant::now();
        {
            let mut state = self.lock();
            state.jobs.retain(|_, job| !matches!(&job.phase, Phase::Failed(_, at) if now.duration_since(*at) > TOLD));
            match state.jobs.get(&key).map(|job| &job.phase) {
                Some(Phase::Waiting | Phase::Running) => return Ok(()),
                Some(Phase::Failed(_, at)) if now.duration_since(*at) < AGAIN => return Ok(()),
                _ => {}
            }
            if state.line.len() >= LINE {
                return Err(Refusal::Busy(30));
            }
            begin(&mut state.starts, network, now).map_err(Refusal::TooMany)?;
            let room = self.room(pack, triangles, order);
            let (share, pack) = (Arc::default(), pack.clone().with_room(&self.cache, room[1]));
            state.jobs.insert(key.clone(), Job { pack, room, order, share, phase: Phase::Waiting });
            state.line.push_back(key);
        }
        self.go_on();
        Ok(())
    }

    /// How an order stands. Blocks on the file system.
    pub(crate) fn standing(&self, hash: &str, order: Order) -> Standing {
        let key = order.key(hash);
        {
            let state = self.lock();
            match state.jobs.get(&key) {
                Some(Job { phase: Phase::Running, share, pack, .. }) => {
                    return Standing::Running(share.load(Ordering::Relaxed), pack.fetched());
                }
                Some(Job { phase: Phase::Waiting, .. }) => {
                    return Standing::Waiting(state.line.iter().position(|k| *k == key).unwrap_or(0) + 1);
                }
                Some(Job { phase: Phase::Failed(failure, _), .. }) => return Standing::Failed(failure.clone()),
                None => {}
            }
        }
        let path = self.path(&key);
        if path.is_file() { Standing::Ready(path) } else { Standing::Unknown }
    }

    /// Begin what can be begun.
    fn go_on(self: &Arc<Self>) {
        loop {
            let (key, pack, order, share) = {
                let mut state = self.lock();
                if state.running >= self.workers {
                    return;
                }
                let Some(key) = state.line.front().cloned() else { return };
                let beside = state.room;
                let Some(job) = state.jobs.get_mut(&key) else {
                    state.line.pop_front();
                    continue;
                };
                // Whatever is in the cache already goes for it; what is being made beside it does not. Alone it always fits.
                let room = beside.saturating_add(total(job.room));
                if beside > 0 && room > self.most_bytes {
                    return;
                }
                job.phase = Phase::Running;
                let begun = (key, (job.pack.clone(), job.room), job.order, Arc::clone(&job.share));
                state.line.pop_front();
                state.running += 1;
                state.room = room;
                begun
            };
            let (extracts, name) = (Arc::clone(self), key.clone());
            let make = move || extracts.make(&name, &pack, order, &share);
            // A thread of its own: hours of work must not stand in the way of reading files.
            if let Err(e) = std::thread::Builder::new().name("extract".to_owned()).spawn(make) {
                self.ended(&key, Err(Failure::Other(format!("no thread: {e}"))));
            }
        }
    }

    fn make(self: &Arc<Self>, key: &str, (pack, room): &(Pack, [u64; 2]), order: Order, share: &AtomicU32) {
        let progress = |done: f64| share.store((done.clamp(0.0, 1.0) * 100.0) as u32, Ordering::Relaxed);
        // What would have to be fetched again is not fetched in vain.
        let lacks_room = || pack.is_stored() && (self.space)(&self.cache).is_some_and(|free| free < total(*room));
        let work = || if lacks_room() { Err(Failure::Full) } else { self.take(pack, key, order, &progress) };
        // A defect in it must not leave a place taken for ever.
        let made = std::panic::catch_unwind(AssertUnwindSafe(work));
        let made = made.unwrap_or_else(|_| Err(Failure::Other("the program failed".to_owned())));
        match &made {
            Ok(()) => self.tidy(Some(key)),
            Err(failure) => tracing::warn!("{}: {} could not be made: {failure:?}", pack, order.name(1)),
        }
        self.ended(key, made);
        self.go_on();
    }

    fn take(&self, pack: &Pack, key: &str, order: Order, progress: &(dyn Fn(f64) + Sync)) -> Result<(), Failure> {
        self.extractor.extract(pack, &self.path(key), order.format, order.detail, progress)
    }

    fn ended(&self, key: &str, made: Result<(), Failure>) {
        let mut state = self.lock();
        state.running = state.running.saturating_sub(1);
        state.room = state.room.saturating_sub(state.jobs.get(key).map_or(0, |job| total(job.room)));
        match made {
            Ok(()) => drop(state.jobs.remove(key)),
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
            if total <= self.most_bytes {
                break;
            }
            if new.is_some_and(|new| path == self.path(new)) {
                continue;
            }
            match std::fs::remove_file(&path) {
                Ok(()) => total = total.saturating_sub(bytes),
                Err(e) => tracing::warn!("cannot remove {}: {e}", path.display()),
            }
        }
    }
}

/// All of the room of a job.
fn total([mesh, pack]: [u64; 2]) -> u64 {
    mesh.saturating_add(pack)
}

/// Whether a file of the cache's folder is one of the cache.
fn is_ours(name: &str) -> bool {
    let mut parts = name.split('.');
    let is_hash = parts.next().is_some_and(|hash| hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit()));
    is_hash && name.rsplit('.').next().is_some_and(|end| ENDINGS.contains(&end))
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
    use super::clerk::Clerk;
    use super::*;

    fn order(triangles: u64) -> Order {
        Order { format: Format::Ply, detail: Detail::Triangles(triangles) }
    }

    fn hash() -> String {
        "a".repeat(64)
    }

    fn wait_for(extracts: &Extracts, order: Order, is_so: impl Fn(&Standing) -> bool) {
        for _ in 0..2000 {
            if is_so(&extracts.standing(&hash(), order)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        panic!("{:?}", extracts.standing(&hash(), order));
    }

    /// With a clerk that waits to be let.
    fn shop(most: u64, workers: usize) -> (tempfile::TempDir, Arc<Clerk>, Arc<Extracts>) {
        let dir = tempfile::tempdir().unwrap();
        let clerk = Arc::new(Clerk::waiting());
        let mut extracts = Extracts::open(dir.path().join("cache"), most, Arc::<Clerk>::clone(&clerk)).unwrap();
        Arc::get_mut(&mut extracts).unwrap().workers = workers;
        (dir, clerk, extracts)
    }

    #[test]
    fn the_same_order_is_made_once_and_others_wait_their_turn() {
        let (_dir, clerk, extracts) = shop(1 << 20, 1);
        let ask = |n| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, order(n), "net");
        for _ in 0..5 {
            ask(1).unwrap();
        }
        ask(2).unwrap();
        ask(3).unwrap();
        wait_for(&extracts, order(1), |s| *s == Standing::Running(25, None));
        assert_eq!(extracts.standing(&hash(), order(3)), Standing::Waiting(2));
        assert_eq!(extracts.standing(&hash(), order(9)), Standing::Unknown);
        clerk.waits(false);
        for n in 1..=3 {
            wait_for(&extracts, order(n), |s| matches!(s, Standing::Ready(_)));
        }
        ask(1).unwrap();
        assert_eq!(clerk.made.load(Ordering::SeqCst), 3, "what is there is not made again");
    }

    #[test]
    fn what_does_not_fit_beside_what_is_being_made_waits() {
        let room = order(1000).room(1000);
        let (_dir, clerk, extracts) = shop(room * 2 + room / 2, 4);
        let within = |n: u32| Order { format: Format::Ply, detail: Detail::Error(f64::from(n) / 1e6) };
        for n in 1..=4 {
            extracts.ask((&Pack::here(Path::new("p")), &hash()), 1000, within(n), "net").unwrap();
        }
        wait_for(&extracts, within(2), |s| *s == Standing::Running(25, None));
        assert_eq!(extracts.standing(&hash(), within(3)), Standing::Waiting(1));
        assert_eq!(extracts.standing(&hash(), within(4)), Standing::Waiting(2));
        clerk.waits(false);
        for n in 1..=4 {
            wait_for(&extracts, within(n), |s| matches!(s, Standing::Ready(_)));
        }
        assert_eq!(extracts.lock().room, 0);
    }

    #[test]
    fn the_line_ends_somewhere_and_nobody_fills_it_alone() {
        let (_dir, clerk, extracts) = shop(1 << 20, 1);
        let ask = |n, net: &str| extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, order(n), net);
        ask(0, "first").unwrap();
        wait_for(&extracts, order(0), |s| matches!(s, Standing::Running(..)));
        for n in 1..=LINE as u64 {
            ask(n, &format!("net {n}")).unwrap();
        }
        assert!(matches!(ask(99, "another"), Err(Refusal::Busy(_))));
        assert_eq!(ask(3, "another"), Ok(()), "what waits already can be joined");
        clerk.waits(false);
        wait_for(&extracts, order(LINE as u64), |s| matches!(s, Standing::Ready(_)));
        let refused = (0..40).find(|n| {
            let refused = matches!(ask(200 + n, "greedy"), Err(Refusal::TooMany(1..=600)));
            wait_for(&extracts, order(200 + n), |s| refused || matches!(s, Standing::Ready(_)));
            refused
        });
        assert_eq!(refused, Some(STARTS as u64));
        assert_eq!(ask(999, "another"), Ok(()));
    }

    #[test]
    fn the_oldest_go_when_the_cache_is_full_and_what_is_not_ours_stays() {
        let (dir, clerk, extracts) = shop(2500, 1);
        std::fs::write(dir.path().join("cache/notes.ply"), vec![0; 5000]).unwrap();
        clerk.waits(false);
        for n in 1..=4 {
            extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, order(n), "net").unwrap();
            wait_for(&extracts, order(n), |s| matches!(s, Standing::Ready(_)));
            // Times of files are told apart by more than the clock's steps.
            std::thread::sleep(Duration::from_millis(20));
        }
        let left: Vec<bool> =
            (1..=4).map(|n| matches!(extracts.standing(&hash(), order(n)), Standing::Ready(_))).collect();
        assert_eq!(left, [false, false, true, true]);
        assert!(dir.path().join("cache/notes.ply").exists());
    }

    #[test]
    fn a_failure_is_told_and_not_tried_again_at_once() {
        let (_dir, clerk, extracts) = shop(1000, 1);
        clerk.fails(Failure::Full);
        clerk.waits(false);
        let ask = || extracts.ask((&Pack::here(Path::new("p")), &hash()), 10, order(1), "net").unwrap();
        ask();
        wait_for(&extracts, order(1), |s| *s == Standing::Failed(Failure::Full));
        ask();
        std::thread::sleep(Duration::from_millis(50));
        assert_eq!(clerk.made.load(Ordering::SeqCst), 1);
    }
}
