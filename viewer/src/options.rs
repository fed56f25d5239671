//! How the cut is shown: options of the passes. [`crate::display`] has the same in metres, degrees and names.

use crate::section::Clip;
use glam::DVec3;
use kilwa_stream::View;

/// What colours the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum Mode {
    /// The scan's own colours.
    #[default]
    Color,
    /// Neutral clay under a lamp at the eye and a soft sky.
    Clay,
    /// A lamp at the eye, nothing else.
    Headlight,
    /// One low light from a chosen side.
    Raking,
    /// Ridges bright and hollows dark, at a scale in metres.
    Curvature,
    /// Darker behind depth steps and in hollows: eye-dome lighting, at a scale in pixels.
    EyeDome,
    /// Normals as colours: x red, y green, z blue.
    Normals,
    /// Height as colours.
    Height,
    /// Distance from the reference plane as colours.
    Distance,
    /// A scalar of the scan (confidence, quality …) as colours.
    Scalar,
    /// One colour per level of detail.
    Level,
    /// Certified error, from the finest surface (pale) to coarse (dark red), on a logarithmic scale.
    Error,
}

impl Mode {
    /// All modes, with the names of the command line and the page. The position is the number that the shader knows.
    pub const ALL: [(Self, &'static str); 12] = [
        (Self::Color, "colour"),
        (Self::Clay, "clay"),
        (Self::Headlight, "headlight"),
        (Self::Raking, "raking"),
        (Self::Curvature, "curvature"),
        (Self::EyeDome, "eye-dome"),
        (Self::Normals, "normals"),
        (Self::Height, "height"),
        (Self::Distance, "distance"),
        (Self::Scalar, "scalar"),
        (Self::Level, "level"),
        (Self::Error, "error"),
    ];

    /// Its number in the shader.
    pub(crate) fn number(self) -> usize {
        Self::ALL.iter().position(|(mode, _)| *mode == self).unwrap_or(0)
    }

    /// The mode of a name; `color` is understood too.
    pub fn from_name(name: &str) -> Option<Self> {
        let name = if name == "color" { "colour" } else { name };
        Self::ALL.iter().find(|(_, n)| *n == name).map(|(mode, _)| *mode)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(mode, _)| *mode == self).map_or("colour", |(_, name)| name)
    }

    /// Whether it looks at the neighbourhood of a pixel, and so needs the depth and normal pass.
    pub fn needs_depth_normal(self) -> bool {
        matches!(self, Self::Curvature | Self::EyeDome)
    }

    /// Whether it colours by value, so that a legend belongs to it.
    pub fn has_scale(self) -> bool {
        matches!(self, Self::Height | Self::Distance | Self::Scalar)
    }
}

/// What is behind the model. Colours are sRGB.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Background {
    /// One colour.
    Flat([u8; 3]),
    /// From the top of the picture to its bottom.
    Gradient([u8; 3], [u8; 3]),
    /// Nothing: alpha 0.
    Transparent,
}

impl Background {
    /// Warm light grey, for the light theme.
    pub const LIMESTONE: Self = Self::Gradient([246, 243, 237], [214, 208, 197]);
    /// Warm dark grey, for the dark theme.
    pub const BASALT: Self = Self::Gradient([52, 49, 46], [26, 24, 23]);
}

/// A part of a picture that is larger than a texture can be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tile {
    /// Left and top pixel in the whole picture (whose size is the view's).
    pub offset: [u32; 2],
    /// Width and height in pixels.
    pub size: [u32; 2],
}

/// The edges of a perspective picture as tangents of angles from the axis; left and down are negative where the axis meets the picture. Those
/// of an eye of a headset are not symmetric, and its pixels need not be square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frustum {
    /// Of the left edge.
    pub left: f64,
    /// Of the right edge.
    pub right: f64,
    /// Of the lower edge.
    pub down: f64,
    /// Of the upper edge.
    pub up: f64,
}

/// The direction of the raking light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Where it comes from, radians: from north, clockwise. With `with_view`: from the top of the picture, clockwise.
    pub azimuth: f64,
    /// Its elevation, radians: above the horizon, or above the plane of the picture.
    pub elevation: f64,
    /// It is fixed to the picture instead of to the world.
    pub with_view: bool,
}

impl Default for Light {
    fn default() -> Self {
        Self { azimuth: 315f64.to_radians(), elevation: 20f64.to_radians(), with_view: false }
    }
}

impl Light {
    /// Towards the light, a unit vector in world axes.
    pub fn direction(&self, view: &View) -> DVec3 {
        let (sa, ca) = libm::sincos(self.azimuth);
        let (se, ce) = libm::sincos(self.elevation);
        if self.with_view {
            return view.right * sa * ce + view.up * ca * ce - view.forward * se;
        }
        DVec3::new(ce * sa, ce * ca, se)
    }
}

/// A plane that distances are counted from, and the distances where the colours begin and end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Unit normal; distances grow along it.
    pub normal: DVec3,
    /// `normal · p` on the plane, in lattice units.
    pub offset: f64,
    /// First and last distance of the scale, in lattice units.
    pub range: [f64; 2],
}

impl Default for Scale {
    fn default() -> Self {
        Self { normal: DVec3::Z, offset: 0.0, range: [0.0, 1.0] }
    }
}

/// How the cut is shown. Lengths are in lattice units; [`crate::display::Display`] makes it from metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// What colours the surface.
    pub mode: Mode,
    /// How strongly a lamp at the eye shades the scan's colours and false colours: 0 shows them as they are.
    pub shading: f32,
    /// Headlight, raking light, curvature and eye-dome lighting on the scan's colours instead of a neutral surface.
    pub on_color: bool,
    /// The raking light.
    pub light: Light,
    /// How strong curvature and eye-dome lighting are, 0 to 1.
    pub strength: f32,
    /// Radius of the eye-dome lighting, pixels.
    pub radius: f32,
    /// Size of what curvature shows, lattice units.
    pub feature: f64,
    /// The plane and the scale of height and distance.
    pub scale: Scale,
    /// First and last value of the scalar's colours, as shares of the channel's range.
    pub scalar_range: [f32; 2],
    /// What is cut away.
    pub clip: Clip,
    /// Width of the line where the surface is cut, pixels; 0 draws none.
    pub outline: f32,
    /// Tint the inside of the surface.
    pub mark_back_faces: bool,
    /// What is behind the model.
    pub background: Background,
    /// Only this part of the picture.
    pub tile: Option<Tile>,
    /// The edges of the picture instead of the view's own: for perspective views. The browser's program for WebGPU, which nearly every visitor waits
    /// for, is smaller without: headsets are drawn through WebGL 2.
    #[cfg(any(feature = "webgl", not(target_arch = "wasm32")))]
    pub frustum: Option<Frustum>,
}

impl RenderOptions {
    /// The edges of the picture where they are not the view's own.
    #[cfg(any(feature = "webgl", not(target_arch = "wasm32")))]
    pub(crate) fn own_frustum(&self) -> Option<Frustum> {
        self.frustum
    }

    /// There are none.
    #[cfg(not(any(feature = "webgl", not(target_arch = "wasm32"))))]
    #[expect(clippy::unused_self, reason = "the interface of the other form")]
    pub(crate) fn own_frustum(&self) -> Option<Frustum> {
        None
    }
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self {
            mode: Mode::Color,
            shading: 0.35,
            on_color: false,
            light: Light::default(),
            strength: 0.5,
            radius: 3.0,
            feature: 64.0,
            scale: Scale::default(),
            scalar_range: [0.0, 1.0],
            clip: Clip::default(),
            outline: 1.5,
            mark_back_faces: true,
            background: Background::LIMESTONE,
            tile: None,
            #[cfg(any(feature = "webgl", not(target_arch = "wasm32")))]
            frustum: None,
        }
    }
}
