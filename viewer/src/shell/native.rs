//! A pack from a file (or any [`Source`]), drawn headless by the same streamer and renderer as the page.

use crate::camera::{Bounds, Camera};
use crate::display::Display;
use crate::filled::hide;
use crate::gpu::context::{Gpu, GpuError};
use crate::gpu::depth_normal::REACH;
use crate::gpu::pool::ShownScalar;
use crate::options::{Mode, RenderOptions, Tile};
use crate::renderer::{IdImage, Image, Renderer};
use kilwa_pack::directory::parse_page;
use kilwa_pack::plural::counted;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{GpuChunk, HEAD_BYTES, Head, Metadata, PAGE_BYTES, PackError, Source, interleave, parse_head};
use kilwa_stream::{Budgets, Command, DrawPatch, Event, FetchKind, Stats, Step, Streamer, View, length_of};
use std::collections::BTreeMap;
use thiserror::Error;

/// Why no picture came out.
#[derive(Debug, Error)]
pub enum SessionError {
    /// The pack is damaged, or is none.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The pack could not be read.
    #[error("cannot read the pack at byte {offset} ({}): {source}", counted(*length, "byte", "bytes"))]
    Read {
        /// First byte asked for.
        offset: u64,
        /// Bytes asked for.
        length: u64,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No GPU, or it stopped.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The memory budget is smaller than the coarsest level.
    #[error("the coarsest level of the pack does not fit the memory budget")]
    NothingDrawn,
}

/// An open pack with its renderer.
pub struct Session<S> {
    source: S,
    head: Vec<u8>,
    metadata: Metadata,
    streamer: Streamer,
    renderer: Renderer,
    decoded: BTreeMap<u32, GpuChunk>,
    /// Number of the channel by which triangles are hidden.
    hidden_by: Option<usize>,
    max_texture: u32,
    clock_ms: f64,
}

impl<S: Source> Session<S> {
    /// Read the head of a pack and get ready to draw it.
    ///
    /// # Errors
    /// [`SessionError`] when it cannot be read or is no sound pack.
    pub fn open(source: S, gpu: &Gpu, budgets: Budgets) -> Result<Self, SessionError> {
        let (bytes, head) = read_head(&source)?;
        let streamer = Streamer::new(&head, bytes.len() as u64, budgets);
        Ok(Self {
            source,
            head: bytes,
            metadata: head.metadata,
            streamer,
            renderer: Renderer::headless(gpu),
            decoded: BTreeMap::new(),
            hidden_by: None,
            max_texture: gpu.device.limits().max_texture_dimension_2d,
            clock_ms: 0.0,
        })
    }

    /// What the pack says of itself.
    pub fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    /// The model's box, world metres.
    pub fn bounds(&self) -> Bounds {
        Bounds { min: self.metadata.bounds_min, max: self.metadata.bounds_max }
    }

    /// The streamer, for its figures.
    pub fn streamer(&self) -> &Streamer {
        &self.streamer
    }

    /// The renderer.
    pub fn renderer(&mut self) -> &mut Renderer {
        &mut self.renderer
    }

    /// What a display says, for the renderer; the scalar that it shows is uploaded. Backgrounds by theme are the light one.
    pub fn options(&mut self, display: &Display) -> RenderOptions {
        let names: Vec<&str> = self.metadata.scalars.iter().map(|c| c.name.as_str()).collect();
        let index = display.channel_index(&names).filter(|_| display.mode() == Mode::Scalar);
        let shown = index.and_then(|channel| {
            let c = self.metadata.scalars.get(channel)?;
            Some(ShownScalar { channel, min: c.min, max: c.max })
        });
        let hidden_by = display.hidden_by(&self.metadata.scalars);
        if self.hidden_by != hidden_by {
            self.hidden_by = hidden_by;
            for (index, chunk) in &mut self.decoded {
                hide(chunk, hidden_by);
                self.renderer.renew(*index, chunk);
            }
        }
        if self.renderer.set_scalar(shown) {
            for (index, chunk) in &self.decoded {
                self.renderer.upload_scalars(*index, chunk);
            }
        }
        let range = shown.map(|s| [f64::from(s.min), f64::from(s.max)]);
        display.options(&self.streamer.header().lattice, &self.bounds(), false, 1.0, range)
    }

    /// A camera's view of this pack.
    pub fn view(&self, camera: &Camera, size: [u32; 2], target_pixels: f64) -> View {
        camera.view(&self.streamer.header().lattice, &self.bounds(), size, target_pixels)
    }

    /// Load until the view is as good as its target, or as the budgets allow.
    ///
    /// # Errors
    /// [`SessionError`]: a file that is damaged or unreadable is not asked twice.
    pub fn settle(&mut self, view: &View) -> Result<Step, SessionError> {
        let mut events = Vec::new();
        loop {
            self.clock_ms += 1.0;
            let step = self.streamer.step(view, self.clock_ms, std::mem::take(&mut events));
            events = self.carry_out(&step.commands)?;
            if step.stats.settled && events.is_empty() && !uploads(&step) {
                return if step.draw.is_empty() { Err(SessionError::NothingDrawn) } else { Ok(step) };
            }
            if events.is_empty() && step.commands.is_empty() {
                return Err(SessionError::NothingDrawn);
            }
        }
    }

    fn carry_out(&mut self, commands: &[Command]) -> Result<Vec<Event>, SessionError> {
        let mut events = Vec::new();
        for command in commands {
            match *command {
                Command::Fetch { request, ref ranges, kind } => match kind {
                    FetchKind::Pages => {
                        let mut bytes = Vec::new();
                        for range in ranges {
                            let part = read(&self.source, range.start, range.end - range.start)?;
                            self.check_pages(range.start, &part)?;
                            bytes.extend(part);
                        }
                        events.push(Event::PageBytes { request, bytes });
                    }
                    // The file is at hand: chunks are read when they are decoded.
                    FetchKind::Chunks => events.push(Event::Bytes { request, length: length_of(ranges) }),
                },
                Command::Decode { chunk, .. } => events.push(self.decode(chunk)?),
                Command::Upload { chunk } => {
                    if let Some(decoded) = self.decoded.get_mut(&chunk) {
                        hide(decoded, self.hidden_by);
                        self.renderer.upload(chunk, decoded);
                    }
                }
                Command::Evict { chunk } => {
                    self.decoded.remove(&chunk);
                    self.renderer.evict(chunk);
                }
                Command::Cancel { .. } => {}
            }
        }
        Ok(events)
    }

    /// A damaged page of a file does not get better by waiting.
    fn check_pages(&self, offset: u64, bytes: &[u8]) -> Result<(), SessionError> {
        let header = self.streamer.header();
        let first = offset.saturating_sub(header.other_pages) / PAGE_BYTES as u64 + 1;
        for (page, bytes) in (first..).zip(bytes.chunks(PAGE_BYTES)) {
            parse_page(bytes, page as u32, header.entry_count)?;
        }
        Ok(())
    }

    fn decode(&mut self, index: u32) -> Result<Event, SessionError> {
        let Some(entry) = self.streamer.entry(index) else {
            return Ok(Event::DecodeFailed { chunk: index });
        };
        let (offset, length) = (entry.offset, u64::from(entry.encoded_bytes));
        let in_head = usize::try_from(offset).ok().zip(usize::try_from(offset.saturating_add(length)).ok());
        let chunk = match in_head.and_then(|(from, to)| self.head.get(from..to)) {
            Some(bytes) => decode_checked(bytes, index, entry, self.streamer.header())?,
            None => decode_checked(&read(&self.source, offset, length)?, index, entry, self.streamer.header())?,
        };
        self.decoded.insert(index, interleave(&chunk));
        Ok(Event::Decoded { chunk: index, patches: chunk.patches })
    }

    /// A decoded chunk that is held.
    pub fn decoded(&self, index: u32) -> Option<&GpuChunk> {
        self.decoded.get(&index)
    }

    /// Load what the view needs, less what the options cut away, and draw it; pictures larger than the GPU's textures are drawn in tiles.
    ///
    /// # Errors
    /// [`SessionError`].
    pub fn render(&mut self, view: &View, options: &RenderOptions) -> Result<(Image, Stats), SessionError> {
        let view = &View { clip: options.clip, ..*view };
        let step = self.settle(view)?;
        let [width, height] = view.size;
        // The map of a mode that looks at the neighbourhood is larger than the tile, on every side.
        let tile = self.max_texture.saturating_sub(2 * REACH).clamp(1, 4096);
        if width <= tile && height <= tile {
            let image = pollster::block_on(self.renderer.image(view, &step.draw, options))?;
            return Ok((image, step.stats));
        }
        let mut pixels = vec![0; width as usize * height as usize * 4];
        for top in (0..height).step_by(tile as usize) {
            for left in (0..width).step_by(tile as usize) {
                let size = [tile.min(width - left), tile.min(height - top)];
                let options = RenderOptions { tile: Some(Tile { offset: [left, top], size }), ..*options };
                let part = pollster::block_on(self.renderer.image(view, &step.draw, &options))?;
                for (row, bytes) in part.pixels.chunks_exact(size[0] as usize * 4).enumerate() {
                    let at = ((top as usize + row) * width as usize + left as usize) * 4;
                    pixels[at..at + bytes.len()].copy_from_slice(bytes);
                }
            }
        }
        Ok((Image { size: view.size, pixels }, step.stats))
    }

    /// Which patch of `draw` covers every pixel.
    ///
    /// # Errors
    /// [`SessionError::Gpu`].
    pub fn ids(&mut self, view: &View, draw: &[DrawPatch]) -> Result<IdImage, SessionError> {
        Ok(pollster::block_on(self.renderer.ids(view, draw, None))?)
    }
}

/// The bytes of a pack's head, as many as it needs, and the parsed head.
pub(super) fn read_head<S: Source>(source: &S) -> Result<(Vec<u8>, Head), SessionError> {
    let length = source.len().map_err(|source| SessionError::Read { offset: 0, length: 0, source })?;
    let bytes = read(source, 0, HEAD_BYTES.min(length))?;
    match parse_head(&bytes) {
        Err(PackError::Truncated { needed, .. }) if needed <= length && needed > bytes.len() as u64 => {
            let bytes = read(source, 0, needed)?;
            let head = parse_head(&bytes)?;
            Ok((bytes, head))
        }
        head => Ok((bytes, head?)),
    }
}

fn uploads(step: &Step) -> bool {
    step.commands.iter().any(|c| matches!(c, Command::Upload { .. }))
}

pub(super) fn read<S: Source>(source: &S, offset: u64, length: u64) -> Result<Vec<u8>, SessionError> {
    let failed = |source| SessionError::Read { offset, length, source };
    let count = usize::try_from(length).map_err(|_| failed(std::io::ErrorKind::OutOfMemory.into()))?;
    source.read_at(offset, count).map_err(failed)
}
