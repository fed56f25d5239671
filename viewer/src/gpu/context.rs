//! Adapter and device.

use thiserror::Error;

/// Why there is no GPU to draw with, or why it stopped.
#[derive(Debug, Error)]
pub enum GpuError {
    /// No adapter answered.
    #[error(
        "no graphics adapter answered ({reason}). Without a graphics card, install a software Vulkan driver \
         (Debian and Ubuntu: apt-get install mesa-vulkan-drivers)"
    )]
    NoAdapter {
        /// The message of wgpu.
        reason: String,
    },
    /// The adapter gave no device.
    #[error("the graphics adapter {adapter} gave no device: {reason}")]
    NoDevice {
        /// Name of the adapter.
        adapter: String,
        /// The message of wgpu.
        reason: String,
    },
    /// The picture could not be read back.
    #[error("the picture could not be read back: the graphics device was lost")]
    Readback,
}

/// The graphics API of a browser build: WebGPU, or WebGL2 in the build for browsers without it (features of this crate).
#[cfg(target_arch = "wasm32")]
pub const BROWSER_BACKEND: wgpu::Backends =
    if cfg!(feature = "webgpu") { wgpu::Backends::BROWSER_WEBGPU } else { wgpu::Backends::GL };

/// Optional features, enabled if the adapter supports them: timestamps in native builds ([`super::timer`]).
const OPTIONAL_FEATURES: wgpu::Features =
    if cfg!(target_arch = "wasm32") { wgpu::Features::empty() } else { wgpu::Features::TIMESTAMP_QUERY };

/// Which adapter to take where there are several.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Prefer {
    /// A graphics card before a software renderer.
    #[default]
    Hardware,
    /// A software renderer, for tests that compare pixels.
    Software,
}

/// An open device.
#[derive(Debug, Clone)]
pub struct Gpu {
    /// The adapter.
    pub adapter: wgpu::Adapter,
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
}

impl Gpu {
    /// A device without a surface.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] and [`GpuError::NoDevice`].
    pub async fn headless(prefer: Prefer) -> Result<Self, GpuError> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::PRIMARY;
        // The renderer writes the arguments of its indirect draws itself, and correctly: checking each costs more than drawing it.
        descriptor.flags.remove(wgpu::InstanceFlags::VALIDATION_INDIRECT_CALL);
        let instance = wgpu::Instance::new(descriptor);
        let mut adapters = instance.enumerate_adapters(wgpu::Backends::all()).await;
        adapters.sort_by_key(|a| rank(a.get_info().device_type, prefer));
        let adapter = match adapters.into_iter().next() {
            Some(adapter) => adapter,
            None => instance
                .request_adapter(&wgpu::RequestAdapterOptions::default())
                .await
                .map_err(|e| GpuError::NoAdapter { reason: e.to_string() })?,
        };
        Self::open(adapter).await
    }

    /// A device that can draw to a surface of `instance`, for example a canvas.
    ///
    /// # Errors
    /// [`GpuError::NoAdapter`] and [`GpuError::NoDevice`].
    pub async fn for_surface(instance: &wgpu::Instance, surface: &wgpu::Surface<'_>) -> Result<Self, GpuError> {
        let adapter = instance
            .request_adapter(&wgpu::RequestAdapterOptions {
                power_preference: wgpu::PowerPreference::HighPerformance,
                compatible_surface: Some(surface),
                ..wgpu::RequestAdapterOptions::default()
            })
            .await
            .map_err(|e| GpuError::NoAdapter { reason: e.to_string() })?;
        Self::open(adapter).await
    }

    async fn open(adapter: wgpu::Adapter) -> Result<Self, GpuError> {
        let available = adapter.limits();
        let mut limits = wgpu::Limits::downlevel_webgl2_defaults().using_resolution(available.clone());
        limits.max_buffer_size = available.max_buffer_size;
        let (device, queue) = adapter
            .request_device(&wgpu::DeviceDescriptor {
                label: Some("kilwa"),
                required_limits: limits,
                required_features: adapter.features() & OPTIONAL_FEATURES,
                ..wgpu::DeviceDescriptor::default()
            })
            .await
            .map_err(|e| GpuError::NoDevice { adapter: adapter.get_info().name, reason: e.to_string() })?;
        Ok(Self { adapter, device, queue })
    }

    /// Name and kind of the adapter, for people.
    pub fn describe(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({:?}, {:?})", info.name, info.device_type, info.backend)
    }

    /// Samples per pixel that a format can have: 4, or 1 where it cannot.
    pub fn samples(&self, format: wgpu::TextureFormat) -> u32 {
        let can = |f| self.adapter.get_texture_format_features(f).flags.sample_count_supported(4);
        if can(format) && can(super::DEPTH_FORMAT) { 4 } else { 1 }
    }
}

fn rank(kind: wgpu::DeviceType, prefer: Prefer) -> u8 {
    let hardware = match kind {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    match prefer {
        Prefer::Hardware => hardware,
        Prefer::Software => u8::from(kind != wgpu::DeviceType::Cpu) * (1 + hardware),
    }
}
