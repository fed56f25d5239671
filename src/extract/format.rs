//! The formats that are written, by the ending of the output, and what an encoder of one does.

use super::choose::Chosen;
use super::glb::Glb;
use super::obj::Obj;
use super::output::Scratch;
use super::ply::Ply;
use super::region::Steps;
use super::stl::Stl;
use super::stream::Counts;
use kilwa_geometry::{Aabb, Lattice, LatticePoint, Mesh};
use kilwa_pack::{Metadata, Reader, Source};
use std::io::Write;
use std::path::Path;

/// A format that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Format {
    Ply { ascii: bool },
    Obj,
    Stl,
    Glb,
}

/// Turns vertices and triangles into bytes.
pub(super) trait Encoder {
    /// Whether triangles name vertices; else they have their corners with them and no vertex is asked for.
    fn shares_vertices(&self) -> bool {
        true
    }

    /// Vertices that can be named.
    fn most_vertices(&self) -> u32 {
        u32::MAX
    }

    /// Append vertex `v` of `mesh`.
    fn vertex(&mut self, out: &mut Vec<u8>, mesh: &Mesh, v: usize);

    /// Append a triangle by the numbers and the positions of its corners.
    fn triangle(&mut self, out: &mut Vec<u8>, corners: [u32; 3], points: [LatticePoint; 3]);

    /// Write the whole file.
    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()>;
}

impl Format {
    /// By the ending of the output.
    pub(super) fn of(path: &Path, ascii: bool) -> anyhow::Result<Self> {
        let shown = path.display();
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let format = match ending.as_str() {
            "ply" => Self::Ply { ascii },
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "glb" => Self::Glb,
            // A device or a pipe has no ending.
            "" if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) => Self::Ply { ascii },
            _ if path.is_dir() => anyhow::bail!("{shown} is a folder; give a file name in it"),
            "gltf" => anyhow::bail!("{shown}: glTF is written as one file; give the output a name that ends in .glb"),
            "" => anyhow::bail!("{shown}: give the output a name that ends in .ply, .obj, .stl or .glb"),
            other => anyhow::bail!("{shown}: .{other} is not written; .ply, .obj, .stl and .glb are"),
        };
        if ascii && !matches!(format, Self::Ply { .. }) {
            anyhow::bail!("{shown}: --ascii is for PLY; {} has one form only", format.title());
        }
        Ok(format)
    }

    /// Its name for machines.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Ply { .. } => "ply",
            Self::Obj => "obj",
            Self::Stl => "stl",
            Self::Glb => "glb",
        }
    }

    /// Its name for people.
    pub(super) fn title(self) -> &'static str {
        match self {
            Self::Ply { .. } => "PLY",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Glb => "GLB",
        }
    }

    pub(super) fn encoder(self, target: &Target) -> Box<dyn Encoder> {
        match self {
            Self::Ply { ascii } => Box::new(Ply::new(target.clone(), ascii)),
            Self::Obj => Box::new(Obj::new(target.clone())),
            Self::Stl => Box::new(Stl::new(target.clone())),
            Self::Glb => Box::new(Glb::new(target.clone())),
        }
    }

    /// The type of coordinates.
    pub(super) fn coordinate_type(self, target: &Target) -> &'static str {
        match self {
            Self::Ply { .. } if target.needs_double => "double",
            Self::Obj => "text",
            _ => "float",
        }
    }

    /// What has to be added to coordinates, where they are not in the world's own.
    pub(super) fn offset(self, target: &Target) -> Option<[f64; 3]> {
        (self == Self::Stl && target.needs_double).then(|| target.lattice.world_from_lattice(target.center))
    }

    /// What of the pack the format does not hold.
    pub(super) fn left_out<S: Source>(self, reader: &Reader<S>) -> Vec<String> {
        let mut left_out = Vec::new();
        if self == Self::Stl && reader.header().attributes.colors {
            left_out.push("colours".to_owned());
        }
        if matches!(self, Self::Stl | Self::Obj) {
            left_out.push("normals of vertices".to_owned());
        }
        if !matches!(self, Self::Ply { .. }) {
            left_out.extend(reader.metadata().scalars.iter().map(|s| s.name.clone()));
        }
        left_out
    }
}

/// What encoders need to know of the pack.
#[derive(Debug, Clone)]
pub(super) struct Target {
    pub(super) lattice: Lattice,
    /// A lattice point in the middle of what is written.
    pub(super) center: LatticePoint,
    /// A `float` does not keep the lattice points of the world apart.
    pub(super) needs_double: bool,
    pub(super) colors: bool,
    pub(super) metadata: Metadata,
    /// Certified error in metres.
    pub(super) error: f32,
    /// GLB: the model stands at zero, and its place is told beside it.
    pub(super) at_zero: bool,
}

impl Target {
    pub(super) fn new<S: Source>(reader: &Reader<S>, chosen: &Chosen, region: Option<&Steps>) -> Self {
        let header = reader.header();
        let lattice = header.lattice;
        let near = |bounds: &&Aabb| region.is_none_or(|region| region.meets(bounds));
        let all = reader.entries().iter().map(|e| &e.bounds).filter(near).fold(Aabb::EMPTY, |sum, b| sum.union(b));
        let center =
            if all.is_empty() { [0; 3] } else { [0, 1, 2].map(|k| all.min[k] + (all.max[k] - all.min[k]) / 2) };
        let side = f64::from(1u32 << header.cube_log2);
        let far = lattice.world_from_steps([side; 3]);
        let largest = far.iter().chain(&lattice.origin).fold(0.0f64, |m, x| m.max(x.abs()));
        // Half a unit in the last place of a float is 2^-24 of the power of two below the number.
        let needs_double = largest * 2f64.powi(-24) > lattice.step() * 0.25;
        let (colors, metadata) = (header.attributes.colors, reader.metadata().clone());
        Self { lattice, center, needs_double, colors, metadata, error: chosen.error, at_zero: false }
    }

    /// A position relative to [`Self::center`], in metres: exact within 2^24 steps of it.
    pub(super) fn relative(&self, p: LatticePoint) -> [f32; 3] {
        let step = self.lattice.step();
        std::array::from_fn(|k| (f64::from(p[k] - self.center[k]) * step) as f32)
    }

    /// Name and version of the program, and the promise.
    pub(super) fn comment(&self) -> String {
        let version = env!("CARGO_PKG_VERSION");
        format!("kilwa {version}: certified error {} m against the finest surface", self.error)
    }

    /// Units, axes and the coordinate reference system.
    pub(super) fn frame(&self) -> String {
        format!("metres, z up, crs {}", one_line(self.metadata.crs.as_deref().unwrap_or("unknown")))
    }
}

/// Text for one line of a header.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}
