//! How long the passes of a frame take, on the processor and on the GPU. For figures; never needed to draw.
//!
//! A device with [`wgpu::Features::TIMESTAMP_QUERY`] writes the time at the beginning and the end of every pass into a query set, which is
//! copied to a buffer at the end of the frame. A buffer is read once the GPU has finished the frame, so that reading it does not stall the GPU.

use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Maximum number of timed passes per frame; further passes have no GPU time.
const PASSES: u32 = 8;
/// Maximum number of frames whose times have not been read; older ones are dropped.
const FRAMES: usize = 16;
/// Bytes of the timestamps of one frame.
const BYTES: u64 = PASSES as u64 * 2 * 8;

/// What one pass of a frame took.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PassTime {
    /// Name of the pass, as its shader file is called.
    pub name: &'static str,
    /// Recording it on the processor, milliseconds.
    pub cpu_ms: f64,
    /// Drawing it on the GPU, milliseconds; `None` where the device has no timestamps.
    pub gpu_ms: Option<f64>,
}

/// A frame whose passes have been recorded.
struct Recorded {
    passes: Vec<PassTime>,
    buffer: Option<wgpu::Buffer>,
    is_mapped: Arc<AtomicBool>,
}

/// Times the passes of a renderer ([`crate::Renderer::set_timer`]).
pub struct PassTimer {
    device: wgpu::Device,
    /// `None` where the device has no timestamps.
    queries: Option<wgpu::QuerySet>,
    resolved: Option<wgpu::Buffer>,
    /// Nanoseconds of a tick.
    period_ns: f64,
    passes: Vec<PassTime>,
    begun: Option<Instant>,
    frames: VecDeque<Recorded>,
}

impl PassTimer {
    /// A timer for renderers of this device.
    pub fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Self {
        let has_timestamps = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let queries = has_timestamps.then(|| {
            device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: PASSES * 2,
            })
        });
        let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let resolved = has_timestamps.then(|| buffer(device, usage));
        Self {
            device: device.clone(),
            queries,
            resolved,
            period_ns: f64::from(queue.get_timestamp_period()),
            passes: Vec::new(),
            begun: None,
            frames: VecDeque::new(),
        }
    }

    /// Call when a pass begins; returns the timestamp writes for its descriptor.
    pub(crate) fn begin(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let number = self.passes.len() as u32;
        self.passes.push(PassTime { name, cpu_ms: 0.0, gpu_ms: None });
        self.begun = Some(Instant::now());
        let query_set = self.queries.as_ref().filter(|_| number < PASSES)?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(number * 2),
            end_of_pass_write_index: Some(number * 2 + 1),
        })
    }

    /// Call when the current pass has been recorded.
    pub(crate) fn end(&mut self) {
        if let (Some(begun), Some(pass)) = (self.begun.take(), self.passes.last_mut()) {
            pass.cpu_ms = begun.elapsed().as_secs_f64() * 1e3;
        }
    }

    /// Call when all passes of a frame have been recorded; copies its timestamps to a buffer.
    pub(crate) fn resolve(&mut self, encoder: &mut wgpu::CommandEncoder) {
        let passes = std::mem::take(&mut self.passes);
        let count = (passes.len() as u32).min(PASSES) * 2;
        let buffer =
            self.queries.as_ref().zip(self.resolved.as_ref()).filter(|_| count > 0).map(|(queries, resolved)| {
                let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
                let out = buffer(&self.device, usage);
                encoder.resolve_query_set(queries, 0..count, resolved, 0);
                encoder.copy_buffer_to_buffer(resolved, 0, &out, 0, BYTES);
                out
            });
        if self.frames.len() == FRAMES {
            self.frames.pop_front();
        }
        self.frames.push_back(Recorded { passes, buffer, is_mapped: Arc::default() });
    }

    /// Call when the frame has been submitted; its buffer is mapped as soon as the GPU has finished.
    pub(crate) fn submitted(&self) {
        let Some(Recorded { buffer: Some(buffer), is_mapped, .. }) = self.frames.back() else { return };
        let is_mapped = is_mapped.clone();
        buffer.slice(..).map_async(wgpu::MapMode::Read, move |answer| {
            is_mapped.store(answer.is_ok(), Ordering::Release);
        });
    }

    /// Times of the oldest frame whose times were not taken yet, in the order of its passes, once the GPU has finished it (after
    /// [`wgpu::Device::poll`]).
    pub fn take(&mut self) -> Option<Vec<PassTime>> {
        let is_ready = self.frames.front().is_some_and(|f| f.buffer.is_none() || f.is_mapped.load(Ordering::Acquire));
        let mut frame = if is_ready { self.frames.pop_front()? } else { return None };
        let Some(data) = frame.buffer.as_ref().and_then(|b| b.get_mapped_range(..).ok()) else {
            return Some(frame.passes);
        };
        let ticks = |at: usize| data.get(at * 8..).and_then(|b| b.first_chunk()).map(|b| u64::from_le_bytes(*b));
        for (number, pass) in frame.passes.iter_mut().enumerate().take(PASSES as usize) {
            let span = ticks(number * 2).zip(ticks(number * 2 + 1)).and_then(|(from, to)| to.checked_sub(from));
            pass.gpu_ms = span.map(|ticks| ticks as f64 * self.period_ns / 1e6);
        }
        Some(frame.passes)
    }
}

fn buffer(device: &wgpu::Device, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("pass times"),
        size: BYTES,
        usage,
        mapped_at_creation: false,
    })
}
