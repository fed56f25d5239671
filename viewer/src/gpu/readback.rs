//! Bytes back from the GPU: a copy into a mappable buffer, and a future that is ready when it is mapped.

use super::context::GpuError;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};

/// A copy of a texture on its way.
pub(crate) struct Readback {
    buffer: wgpu::Buffer,
    size: [u32; 2],
    row_bytes: u32,
    padded: u32,
}

impl Readback {
    /// Record the copy of a whole texture with `texel` bytes per texel.
    pub(crate) fn record(
        device: &wgpu::Device,
        encoder: &mut wgpu::CommandEncoder,
        texture: &wgpu::Texture,
        texel: u32,
    ) -> Self {
        let size = [texture.width(), texture.height()];
        let row_bytes = size[0] * texel;
        let padded = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("readback"),
            size: u64::from(padded) * u64::from(size[1]),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None },
            },
            texture.size(),
        );
        Self { buffer, size, row_bytes, padded }
    }

    /// The rows, without padding. Call after the submission.
    ///
    /// # Errors
    /// [`GpuError::Readback`] when the device was lost.
    pub(crate) async fn bytes(self, device: &wgpu::Device) -> Result<Vec<u8>, GpuError> {
        let mapped = Mapped::default();
        let state = mapped.state.clone();
        self.buffer.map_async(wgpu::MapMode::Read, .., move |result| finish(&state, result.is_ok()));
        // Natively this waits for the GPU; with WebGPU it does nothing and the event loop continues.
        let _ = device.poll(wgpu::PollType::wait_indefinitely());
        #[cfg(all(target_arch = "wasm32", not(feature = "webgpu")))]
        poll_until_done(device, &mapped.state).await;
        if !mapped.await {
            return Err(GpuError::Readback);
        }
        let range = self.buffer.get_mapped_range(..).map_err(|_| GpuError::Readback)?;
        let mut out = Vec::with_capacity(self.row_bytes as usize * self.size[1] as usize);
        for row in range.chunks_exact(self.padded as usize) {
            out.extend_from_slice(&row[..self.row_bytes as usize]);
        }
        Ok(out)
    }
}

/// WebGL2 does not signal completion and must not be waited for: it is polled every few milliseconds.
#[cfg(all(target_arch = "wasm32", not(feature = "webgpu")))]
async fn poll_until_done(device: &wgpu::Device, state: &Mutex<MapState>) {
    const PAUSE_MS: i32 = 4;
    while state.lock().unwrap_or_else(PoisonError::into_inner).result.is_none() {
        let Some(window) = web_sys::window() else { return };
        let pause = js_sys::Promise::new(&mut |resolve, _| {
            // A refusal leaves the promise open only where a page has no timers, which no browser does.
            let _ = window.set_timeout_with_callback_and_timeout_and_arguments_0(&resolve, PAUSE_MS);
        });
        let _ = wasm_bindgen_futures::JsFuture::from(pause).await;
        let _ = device.poll(wgpu::PollType::Poll);
    }
}

#[derive(Default)]
struct MapState {
    result: Option<bool>,
    waker: Option<Waker>,
}

#[derive(Default)]
struct Mapped {
    state: Arc<Mutex<MapState>>,
}

fn finish(state: &Mutex<MapState>, ok: bool) {
    let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
    state.result = Some(ok);
    if let Some(waker) = state.waker.take() {
        waker.wake();
    }
}

impl Future for Mapped {
    type Output = bool;

    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<bool> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(ok) = state.result {
            return Poll::Ready(ok);
        }
        state.waker = Some(context.waker().clone());
        Poll::Pending
    }
}
