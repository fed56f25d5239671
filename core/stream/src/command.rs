//! The input and output of the state machine.

use kilwa_pack::PatchRange;
use std::ops::Range;
use std::sync::Arc;

/// Bytes in ranges together.
pub fn length_of(ranges: &[Range<u64>]) -> u64 {
    ranges.iter().map(|r| r.end - r.start).sum()
}

/// Names one request for the shell; never used twice by one streamer.
pub type RequestId = u64;

/// The "request" whose bytes are those of the head that the shell already has: see [`Command::Decode`].
pub const HEAD_REQUEST: RequestId = 0;

/// What a request is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FetchKind {
    /// Directory pages: hand the bytes back as [`Event::PageBytes`].
    Pages,
    /// Chunks: keep the bytes, and report [`Event::Bytes`].
    Chunks,
}

/// What the shell has to do.
#[derive(Debug, Clone, PartialEq)]
pub enum Command {
    /// Ask for bytes of the pack.
    Fetch {
        /// Name of the request.
        request: RequestId,
        /// Which bytes, at least one range and at most [`Budgets::ranges`], none over another. The answer is what is in them, one behind the other
        /// in this order.
        ranges: Vec<Range<u64>>,
        /// What to do with the answer.
        kind: FetchKind,
    },
    /// The answer of this request is no longer wanted. An answer that still comes is ignored.
    Cancel {
        /// Name of the request.
        request: RequestId,
    },
    /// Check and decode one chunk; report [`Event::Decoded`] or [`Event::DecodeFailed`]. Issued in the very step that
    /// received the request's [`Event::Progress`] or [`Event::Bytes`], so that the shell can forget the bytes after that step;
    /// the bytes of [`HEAD_REQUEST`] (the head of the file) must be kept.
    Decode {
        /// Directory index.
        chunk: u32,
        /// The request whose answer holds the bytes, or [`HEAD_REQUEST`].
        request: RequestId,
        /// First byte, counted from the first byte of that answer.
        offset: u64,
        /// Encoded bytes.
        length: u32,
        /// Vertices that the directory declares.
        vertices: u32,
        /// Triangles that the directory declares.
        triangles: u32,
        /// First 16 bytes of the BLAKE3 hash that the bytes must have.
        checksum: [u8; 16],
    },
    /// Put a decoded chunk into GPU memory, before this step's cut is drawn.
    Upload {
        /// Directory index.
        chunk: u32,
    },
    /// Forget everything held of a chunk: GPU buffers, decoded form, a decoding job.
    Evict {
        /// Directory index.
        chunk: u32,
    },
}

/// What happened since the last step.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// So many bytes of the answer of a chunk request are there, counted from its beginning; more will come. The chunks
    /// that are complete can be decoded already.
    Progress {
        /// Name of the request.
        request: RequestId,
        /// Bytes so far.
        length: u64,
    },
    /// The answer of a chunk request is there.
    Bytes {
        /// Name of the request.
        request: RequestId,
        /// Its length; anything but the length asked for counts as a failure.
        length: u64,
    },
    /// The answer of a page request.
    PageBytes {
        /// Name of the request.
        request: RequestId,
        /// All of its bytes.
        bytes: Vec<u8>,
    },
    /// A request failed, for whatever reason; it is tried again later.
    Failed {
        /// Name of the request.
        request: RequestId,
    },
    /// A chunk was decoded.
    Decoded {
        /// Directory index.
        chunk: u32,
        /// Its patches.
        patches: Vec<PatchRange>,
    },
    /// A chunk's checksum or content is wrong; it is fetched again later.
    DecodeFailed {
        /// Directory index.
        chunk: u32,
    },
    /// GPU memory is gone (device lost): every resident chunk has to be decoded and uploaded again.
    GpuLost,
}

/// Limits. Chunk sizes are those that the directory declares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Budgets {
    /// Requests in flight.
    pub requests: usize,
    /// Ranges of one request: 1 where the server takes one at a time.
    pub ranges: usize,
    /// Bytes asked for or being decoded; one request is always allowed.
    pub bytes_in_flight: u64,
    /// Longest request that chunks are joined into, bytes.
    pub request_bytes: u64,
    /// Decoded chunks kept in main memory (for picking), bytes, those on their way included.
    pub cpu_bytes: u64,
    /// Chunks in GPU memory, bytes, those on their way included.
    pub gpu_bytes: u64,
    /// Chunks uploaded per step.
    pub uploads: usize,
}

impl Default for Budgets {
    /// For a laptop: 6 requests of one range, 8 MiB in flight, 1 MiB per request, 1 GiB of main and 512 MiB of GPU memory.
    fn default() -> Self {
        Self {
            requests: 6,
            ranges: 1,
            bytes_in_flight: 8 << 20,
            request_bytes: 1 << 20,
            cpu_bytes: 1 << 30,
            gpu_bytes: 512 << 20,
            uploads: 4,
        }
    }
}

/// One patch of the cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawPatch {
    /// Directory index of the chunk that holds it.
    pub chunk: u32,
    /// Number of the patch in the chunk.
    pub patch: u32,
    /// First triangle in the chunk.
    pub first: u32,
    /// Number of triangles.
    pub count: u32,
    /// The diamond whose refinement would replace it, or [`kilwa_pack::NO_DIAMOND`].
    pub diamond: u32,
    /// Level of the chunk it comes from.
    pub level: u8,
    /// Certified error in metres: 0 for a leaf. Where the directory page of its diamond does not exist yet, the bound
    /// that its chunk's entry gives.
    pub error: f32,
    /// Whether it may lie in the view; a renderer of that view can skip the others.
    pub visible: bool,
}

/// Figures of one step.
#[expect(clippy::struct_excessive_bools, reason = "figures that do not exclude each other")]
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Stats {
    /// Directory entries known so far.
    pub entries_known: u32,
    /// Chunks that the view asks for, within the budgets.
    pub chunks_wanted: u32,
    /// Wanted chunks that are not resident yet.
    pub chunks_missing: u32,
    /// Encoded bytes of the missing chunks: what is left to load.
    pub bytes_missing: u64,
    /// Encoded bytes of the wanted chunks.
    pub bytes_wanted: u64,
    /// Chunks in GPU memory.
    pub chunks_resident: u32,
    /// Chunks asked for or being decoded.
    pub chunks_in_flight: u32,
    /// Their encoded bytes, with those of directory pages asked for and of gaps between chunks.
    pub bytes_in_flight: u64,
    /// Chunks that are in the picture, wholly or in part.
    pub chunks_shown: u32,
    /// Their encoded bytes.
    pub bytes_shown: u64,
    /// Directory pages that the view waits for.
    pub pages_missing: u32,
    /// Requests in flight.
    pub requests_in_flight: u32,
    /// Requests made since the beginning.
    pub requests_made: u64,
    /// Bytes received since the beginning, the head not counted.
    pub bytes_received: u64,
    /// Failed requests, pages and chunks since the beginning.
    pub failures: u64,
    /// When the next failed part is tried again, milliseconds from now; negative where nothing waits.
    pub retry_in_ms: f64,
    /// GPU memory held, bytes.
    pub gpu_bytes: u64,
    /// Main memory held for decoded chunks, bytes.
    pub cpu_bytes: u64,
    /// Patches in the cut.
    pub patches_drawn: u32,
    /// Triangles of the patches in the view.
    pub triangles_drawn: u64,
    /// Largest pixel error of what is visible.
    pub worst_pixel_error: f64,
    /// Largest certified error of what is visible, metres; infinite until the first levels are known.
    pub worst_error_metres: f64,
    /// The largest pixel error is within the target.
    pub target_reached: bool,
    /// Less is shown than asked for because a memory budget is full.
    pub budget_limited: bool,
    /// Less is shown than asked for because the file ends before its header states ([`crate::Streamer::set_cut_off`]).
    pub cut_off: bool,
    /// Everything wanted is resident, and nothing is in flight: with the same view the next step changes nothing.
    pub settled: bool,
}

/// The answer of one step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Step {
    /// To be carried out in this order.
    pub commands: Vec<Command>,
    /// The cut, in order of chunk and patch. Empty until the root chunk is resident. A step at rest hands out the list of the one before.
    pub draw: Arc<Vec<DrawPatch>>,
    /// Figures.
    pub stats: Stats,
}
