//! A pack in memory, drawn frame by frame while background threads decode chunks, as the page does with its workers.
//! Used to measure flights. No frame waits for a chunk; it shows what is loaded.

use super::native::{SessionError, read_head};
use crate::camera::{Bounds, Camera};
use crate::renderer::Renderer;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{DirectoryEntry, GpuChunk, Header, Metadata, PatchRange, SliceSource, Source, interleave};
use kilwa_stream::{Budgets, Command, Event, FetchKind, Step, Streamer, View, length_of};
use std::collections::{BTreeMap, BTreeSet};
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;
use std::time::Instant;

/// Chunks uploaded in a step: at most so many, ...
const UPLOADS: usize = 16;
/// ... in at most this part of the time from frame to frame, but for at least so many milliseconds: where the GPU takes long for a frame, the
/// processor waits for it anyway. One chunk is always uploaded.
const UPLOAD_PART: f64 = 1.0 / 8.0;
const UPLOAD_MS: f64 = 0.5;

/// Processor time of a step.
#[derive(Debug, Clone, Copy, Default)]
pub struct Spent {
    /// What the streamer took to decide, milliseconds.
    pub decide_ms: f64,
    /// What uploading took, milliseconds.
    pub upload_ms: f64,
    /// Chunks uploaded.
    pub uploads: u32,
}

/// A chunk to decode.
struct Job {
    chunk: u32,
    entry: DirectoryEntry,
}

/// The chunk and its decoded form; `None` if its bytes are damaged.
type Answer = (u32, Option<(GpuChunk, Vec<PatchRange>)>);

/// What the decoding threads share.
struct Shared {
    bytes: SliceSource<Vec<u8>>,
    header: Header,
    jobs: Mutex<mpsc::Receiver<Job>>,
}

/// An open pack with its renderer and its decoding threads.
pub struct LiveSession {
    shared: Arc<Shared>,
    metadata: Metadata,
    streamer: Streamer,
    renderer: Renderer,
    /// `None` when the threads should stop.
    jobs: Option<mpsc::Sender<Job>>,
    answers: mpsc::Receiver<Answer>,
    threads: Vec<JoinHandle<()>>,
    /// Chunks that are being decoded, unless they were evicted meanwhile.
    awaited: BTreeSet<u32>,
    /// Decoded chunks that are not uploaded yet.
    decoded: BTreeMap<u32, GpuChunk>,
    events: Vec<Event>,
    /// Time of the last step, milliseconds.
    stepped_at: f64,
    /// What uploading a chunk takes, milliseconds, smoothed.
    per_upload_ms: f64,
    spent: Spent,
}

impl LiveSession {
    /// Read the head of a pack and start this many decoding threads. `renderer` draws the pack. How much a step uploads
    /// follows from the time between frames; `budgets.uploads` is not used.
    ///
    /// # Errors
    /// [`SessionError`] if it is not a valid pack.
    pub fn open(
        bytes: Vec<u8>,
        renderer: Renderer,
        budgets: Budgets,
        threads: NonZeroUsize,
    ) -> Result<Self, SessionError> {
        let source = SliceSource(bytes);
        let (head_bytes, head) = read_head(&source)?;
        let streamer = Streamer::new(&head, head_bytes.len() as u64, budgets);
        let (jobs, queue) = mpsc::channel();
        let (answer, answers) = mpsc::channel();
        let shared = Arc::new(Shared { bytes: source, header: head.header, jobs: Mutex::new(queue) });
        let threads = (0..threads.get())
            .map(|_| {
                let (shared, answer) = (shared.clone(), answer.clone());
                std::thread::spawn(move || decode_all(&shared, &answer))
            })
            .collect();
        Ok(Self {
            shared,
            metadata: head.metadata,
            streamer,
            renderer,
            jobs: Some(jobs),
            answers,
            threads,
            awaited: BTreeSet::new(),
            decoded: BTreeMap::new(),
            events: Vec::new(),
            stepped_at: 0.0,
            per_upload_ms: 0.0,
            spent: Spent::default(),
        })
    }

    /// What the last step took.
    pub fn spent(&self) -> Spent {
        self.spent
    }

    /// The model's box, world metres.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.metadata.bounds_min, max: self.metadata.bounds_max }
    }

    /// A camera's view of this pack.
    pub fn view(&self, camera: &Camera, size: [u32; 2], target_pixels: f64) -> View {
        camera.view(&self.shared.header.lattice, &self.bounds(), size, target_pixels)
    }

    /// The renderer.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// Decide what a frame shows. Requests of the step are started, and chunks decoded so far are uploaded.
    ///
    /// # Errors
    /// [`SessionError::Read`] if the pack is shorter than its header states.
    pub fn step(&mut self, view: &View, now_ms: f64) -> Result<Step, SessionError> {
        let mut events = std::mem::take(&mut self.events);
        for (chunk, decoded) in self.answers.try_iter() {
            if !self.awaited.remove(&chunk) {
                continue;
            }
            events.push(match decoded {
                Some((decoded, patches)) => {
                    self.decoded.insert(chunk, decoded);
                    Event::Decoded { chunk, patches }
                }
                None => Event::DecodeFailed { chunk },
            });
        }
        let may_take = (now_ms - self.stepped_at) * UPLOAD_PART;
        self.stepped_at = now_ms;
        let fitting = may_take.max(UPLOAD_MS) / self.per_upload_ms.max(1e-3);
        self.streamer.set_uploads(UPLOADS.min(fitting as usize).max(1));
        self.spent = Spent::default();
        let begun = Instant::now();
        let step = self.streamer.step(view, now_ms, events);
        self.spent.decide_ms = ms_since(begun);
        for command in &step.commands {
            self.carry_out(command)?;
        }
        if self.spent.uploads > 0 {
            let each = self.spent.upload_ms / f64::from(self.spent.uploads);
            self.per_upload_ms += (each - self.per_upload_ms) * 0.2;
        }
        Ok(step)
    }

    fn carry_out(&mut self, command: &Command) -> Result<(), SessionError> {
        match *command {
            Command::Fetch { request, ref ranges, kind: FetchKind::Pages } => {
                let mut bytes = Vec::new();
                for range in ranges {
                    bytes.extend(super::native::read(&self.shared.bytes, range.start, range.end - range.start)?);
                }
                self.events.push(Event::PageBytes { request, bytes });
            }
            Command::Fetch { request, ref ranges, kind: FetchKind::Chunks } => {
                self.events.push(Event::Bytes { request, length: length_of(ranges) });
            }
            Command::Decode { chunk, .. } => {
                let entry = self.streamer.entry(chunk).cloned();
                let is_begun =
                    entry.zip(self.jobs.as_ref()).is_some_and(|(entry, jobs)| jobs.send(Job { chunk, entry }).is_ok());
                if is_begun {
                    self.awaited.insert(chunk);
                } else {
                    self.events.push(Event::DecodeFailed { chunk });
                }
            }
            Command::Upload { chunk } => {
                let begun = Instant::now();
                if let Some(decoded) = self.decoded.remove(&chunk) {
                    self.renderer.upload(chunk, &decoded);
                }
                self.spent.upload_ms += ms_since(begun);
                self.spent.uploads += 1;
            }
            Command::Evict { chunk } => {
                self.awaited.remove(&chunk);
                self.decoded.remove(&chunk);
                self.renderer.evict(chunk);
            }
            Command::Cancel { .. } => {}
        }
        Ok(())
    }
}

impl Drop for LiveSession {
    fn drop(&mut self) {
        self.jobs = None;
        for thread in self.threads.drain(..) {
            // The panic has already been reported.
            let _ = thread.join();
        }
    }
}

fn ms_since(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// Decode queued chunks until the session is dropped.
fn decode_all(shared: &Shared, answers: &mpsc::Sender<Answer>) {
    loop {
        let job = shared.jobs.lock().map(|jobs| jobs.recv());
        let Ok(Ok(Job { chunk, entry })) = job else { return };
        let bytes = usize::try_from(entry.encoded_bytes).ok().and_then(|n| shared.bytes.read_at(entry.offset, n).ok());
        let decoded = bytes.and_then(|bytes| decode_checked(&bytes, chunk, &entry, &shared.header).ok());
        let answer = decoded.map(|decoded| (interleave(&decoded), decoded.patches));
        if answers.send((chunk, answer)).is_err() {
            return;
        }
    }
}
