//! Where the renderer calls the [`super::timer::PassTimer`]: natively, if there is one. In a browser nothing is timed.

#[cfg(not(target_arch = "wasm32"))]
use super::timer::PassTimer;

/// The timer of a renderer, if passes are timed.
#[derive(Default)]
pub(crate) struct Timing {
    #[cfg(not(target_arch = "wasm32"))]
    pub(crate) timer: Option<PassTimer>,
}

#[cfg(not(target_arch = "wasm32"))]
impl Timing {
    /// Call when a pass begins; returns the timestamp writes for its descriptor.
    pub(crate) fn begin(&mut self, name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        self.timer.as_mut()?.begin(name)
    }

    /// Call when the current pass has been recorded.
    pub(crate) fn end(&mut self) {
        if let Some(timer) = &mut self.timer {
            timer.end();
        }
    }

    /// Finish a frame's commands and submit them.
    pub(crate) fn submit(&mut self, queue: &wgpu::Queue, mut encoder: wgpu::CommandEncoder) {
        if let Some(timer) = &mut self.timer {
            timer.resolve(&mut encoder);
        }
        queue.submit([encoder.finish()]);
        if let Some(timer) = &self.timer {
            timer.submitted();
        }
    }
}

#[cfg(target_arch = "wasm32")]
#[expect(clippy::unused_self, reason = "the interface of the native form")]
impl Timing {
    pub(crate) fn begin(&mut self, _name: &'static str) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        None
    }

    pub(crate) fn end(&mut self) {}

    pub(crate) fn submit(&mut self, queue: &wgpu::Queue, encoder: wgpu::CommandEncoder) {
        queue.submit([encoder.finish()]);
    }
}
