//! How the cut is shown.

/// What colours the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// The scan's own colours.
    #[default]
    Color,
    /// Neutral clay under a lamp at the eye and a soft sky.
    Clay,
    /// Normals as colours: x red, y green, z blue.
    Normals,
    /// One colour per level of detail.
    Level,
    /// Certified error, from the finest surface (pale) to coarse (dark red), on a logarithmic scale.
    Error,
}

impl Mode {
    /// All modes, with the names of the command line and the page.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::Color, "colour"),
        (Self::Clay, "clay"),
        (Self::Normals, "normals"),
        (Self::Level, "level"),
        (Self::Error, "error"),
    ];

    /// The mode of a name; `color` is understood too.
    pub fn from_name(name: &str) -> Option<Self> {
        let name = if name == "color" { "colour" } else { name };
        Self::ALL.iter().find(|(_, n)| *n == name).map(|(mode, _)| *mode)
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(mode, _)| *mode == self).map_or("colour", |(_, name)| name)
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

/// How the cut is shown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderOptions {
    /// What colours the surface.
    pub mode: Mode,
    /// How strongly a lamp at the eye shades the scan's colours: 0 shows them as they are.
    pub shading: f32,
    /// Tint the inside of the surface.
    pub mark_back_faces: bool,
    /// What is behind the model.
    pub background: Background,
    /// Only this part of the picture.
    pub tile: Option<Tile>,
}

impl Default for RenderOptions {
    fn default() -> Self {
        Self { mode: Mode::Color, shading: 0.35, mark_back_faces: true, background: Background::LIMESTONE, tile: None }
    }
}
