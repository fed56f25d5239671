//! Loads a pack, moves the camera around it, and measures the time.

use crate::course;
use kilwa_stream::{Budgets, Stats};
use kilwa_viewer::gpu::timer::{PassTime, PassTimer};
use kilwa_viewer::shell::live::LiveSession;
use kilwa_viewer::{Bounds, Camera, Gpu, Mode, RenderOptions, Renderer};
use std::collections::VecDeque;
use std::error::Error;
use std::f64::consts::TAU;
use std::num::NonZeroUsize;
use std::time::Instant;

/// Format of canvases: without sRGB, so that pictures are encoded by the present pass.
pub(crate) const CANVAS_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Frames that the GPU may be behind.
const IN_FLIGHT: usize = 2;
/// Frames at rest, fewer where they take longer than an orbit.
const REST_FRAMES: usize = 50;
/// Time limit for loading, seconds; after it, the pack is drawn as far as it is loaded.
const LOAD_S: f64 = 120.0;

/// What is measured.
#[derive(Debug, Clone)]
pub(crate) struct Setting {
    pub(crate) pack: String,
    pub(crate) size: [u32; 2],
    /// Samples per pixel.
    pub(crate) samples: u32,
    /// Pixel error to refine to.
    pub(crate) pixels: f64,
    /// Of an orbit or a flight.
    pub(crate) seconds: f64,
    /// Decoding threads.
    pub(crate) threads: NonZeroUsize,
    pub(crate) mode: Mode,
    /// Draw calls are recorded one by one, as in a browser.
    pub(crate) direct: bool,
}

/// The path of the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Course {
    /// None: the whole model, which is loaded.
    Rest,
    /// Once around the whole model, which is loaded.
    Orbit,
    /// From all of the model to its surface, along it, and away again, while it loads.
    Flight,
}

/// One frame.
#[derive(Debug, Clone, Default)]
pub(crate) struct Frame {
    /// Since the frame before, milliseconds.
    pub(crate) ms: f64,
    /// Deciding what to show, and uploading, milliseconds.
    pub(crate) step_ms: f64,
    /// Uploading alone, milliseconds.
    pub(crate) upload_ms: f64,
    /// Recording and submitting, milliseconds.
    pub(crate) draw_ms: f64,
    pub(crate) triangles: u64,
    pub(crate) patches: u32,
    /// Draw calls of a pass.
    pub(crate) calls: usize,
    pub(crate) passes: Vec<PassTime>,
}

/// How loading went.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Load {
    /// From bytes in memory to the first picture that the GPU has finished, milliseconds.
    pub(crate) first_ms: f64,
    /// To the picture of the wanted detail, milliseconds.
    pub(crate) target_ms: f64,
    pub(crate) stats: Stats,
}

/// The results of one setting.
#[derive(Debug, Clone)]
pub(crate) struct Run {
    pub(crate) setting: Setting,
    pub(crate) load: Load,
    pub(crate) courses: Vec<(Course, Vec<Frame>)>,
}

/// As many decoding threads as the page has workers (www/decode-pool.js).
pub(crate) fn page_workers() -> NonZeroUsize {
    let cores = std::thread::available_parallelism().map_or(2, NonZeroUsize::get);
    NonZeroUsize::new((cores - 1).clamp(1, 4)).unwrap_or(NonZeroUsize::MIN)
}

/// Load a pack and fly the courses.
pub(crate) fn run(gpu: &Gpu, bytes: &[u8], setting: Setting, courses: &[Course]) -> Result<Run, Box<dyn Error>> {
    let mut flown = Vec::new();
    let mut load = Load::default();
    for &course in courses {
        let mut stage = Stage::new(gpu, bytes.to_vec(), &setting)?;
        if course == Course::Orbit {
            load = stage.load()?;
            let still = camera_at(Course::Rest, 0.0, &stage.session.bounds(), setting.size);
            let (begun, mut frames) = (Instant::now(), Vec::new());
            while frames.len() < 3 || frames.len() < REST_FRAMES && begun.elapsed().as_secs_f64() < setting.seconds {
                frames.push(stage.frame(&still)?.0);
            }
            stage.finish(&mut frames)?;
            flown.push((Course::Rest, frames));
        }
        let begun = Instant::now();
        let mut frames = Vec::new();
        loop {
            let share = begun.elapsed().as_secs_f64() / setting.seconds;
            if share >= 1.0 && frames.len() > 2 {
                break;
            }
            let camera = camera_at(course, share.min(1.0), &stage.session.bounds(), setting.size);
            frames.push(stage.frame(&camera)?.0);
        }
        stage.finish(&mut frames)?;
        flown.push((course, frames));
    }
    Ok(Run { setting, load, courses: flown })
}

/// The camera at a share of a course.
fn camera_at(course: Course, share: f64, bounds: &Bounds, size: [u32; 2]) -> Camera {
    let mut all = course::whole(bounds, size);
    match course {
        Course::Flight => return course::flight(&all, bounds, share),
        Course::Orbit => all.azimuth += TAU * share,
        Course::Rest => {}
    }
    all
}

/// A session, its target, and the frames that the GPU is behind.
struct Stage<'g> {
    gpu: &'g Gpu,
    session: LiveSession,
    target: wgpu::TextureView,
    options: RenderOptions,
    size: [u32; 2],
    pixels: f64,
    opened: Instant,
    last_frame: Instant,
    in_flight: VecDeque<wgpu::SubmissionIndex>,
    /// Times of frames in the order in which they were drawn.
    passes: Vec<Vec<PassTime>>,
    /// Frames before the course, whose times do not count.
    skipped: usize,
}

impl<'g> Stage<'g> {
    fn new(gpu: &'g Gpu, bytes: Vec<u8>, setting: &Setting) -> Result<Self, Box<dyn Error>> {
        let size = setting.size;
        let opened = Instant::now();
        let mut renderer = Renderer::new(gpu.device.clone(), gpu.queue.clone(), CANVAS_FORMAT, setting.samples);
        if setting.direct {
            renderer.set_indirect(false);
        }
        renderer.set_timer(Some(PassTimer::new(&gpu.device, &gpu.queue)));
        // No limit of memory: what the view wants is drawn.
        let budgets = Budgets { gpu_bytes: 16 << 30, cpu_bytes: 32 << 30, ..Budgets::default() };
        let session = LiveSession::open(bytes, renderer, budgets, setting.threads)?;
        Ok(Self {
            gpu,
            session,
            target: course::target(gpu, size, CANVAS_FORMAT),
            options: RenderOptions { mode: setting.mode, ..RenderOptions::default() },
            size,
            pixels: setting.pixels,
            opened,
            last_frame: opened,
            in_flight: VecDeque::new(),
            passes: Vec::new(),
            skipped: 0,
        })
    }

    /// Draw frames of the whole model until it is as fine as asked for.
    fn load(&mut self) -> Result<Load, Box<dyn Error>> {
        let camera = camera_at(Course::Orbit, 0.0, &self.session.bounds(), self.size);
        let mut load = Load::default();
        let now_ms = |s: &Self| s.opened.elapsed().as_secs_f64() * 1e3;
        loop {
            let (frame, stats) = self.frame(&camera)?;
            if load.first_ms == 0.0 && frame.triangles > 0 {
                self.gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
                load.first_ms = now_ms(self);
            }
            if stats.settled || now_ms(self) > LOAD_S * 1e3 {
                self.gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
                load.target_ms = now_ms(self);
                load.stats = stats;
                self.take_passes();
                self.in_flight.clear();
                self.skipped = self.passes.len();
                self.last_frame = Instant::now();
                return Ok(load);
            }
        }
    }

    fn frame(&mut self, camera: &Camera) -> Result<(Frame, Stats), Box<dyn Error>> {
        if self.in_flight.len() == IN_FLIGHT {
            self.gpu
                .device
                .poll(wgpu::PollType::Wait { submission_index: self.in_flight.pop_front(), timeout: None })?;
        }
        self.take_passes();
        let begun = Instant::now();
        let view = self.session.view(camera, self.size, self.pixels);
        let step = self.session.step(&view, self.opened.elapsed().as_secs_f64() * 1e3)?;
        let decided = Instant::now();
        self.session.renderer().draw(&view, &step.draw, &self.options, &self.target);
        self.in_flight.push_back(self.gpu.queue.submit([]));
        let drawn = Instant::now();
        let ms = |from: Instant, to: Instant| (to - from).as_secs_f64() * 1e3;
        let frame = Frame {
            ms: ms(self.last_frame, begun),
            step_ms: ms(begun, decided),
            upload_ms: self.session.spent().upload_ms,
            draw_ms: ms(decided, drawn),
            triangles: step.stats.triangles_drawn,
            patches: step.stats.patches_drawn,
            calls: self.session.renderer().call_count(),
            passes: Vec::new(),
        };
        self.last_frame = begun;
        Ok((frame, step.stats))
    }

    fn take_passes(&mut self) {
        let Some(timer) = self.session.renderer().timer() else { return };
        let times: Vec<_> = std::iter::from_fn(|| timer.take()).collect();
        self.passes.extend(times);
    }

    /// Wait for the last frames, and give every frame the times of its passes. The first frame has no time since the one before it.
    fn finish(&mut self, frames: &mut Vec<Frame>) -> Result<(), Box<dyn Error>> {
        self.gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
        self.take_passes();
        for (frame, passes) in frames.iter_mut().zip(self.passes.drain(..).skip(self.skipped)) {
            frame.passes = passes;
        }
        frames.remove(0);
        self.skipped = 0;
        self.in_flight.clear();
        self.last_frame = Instant::now();
        Ok(())
    }
}
