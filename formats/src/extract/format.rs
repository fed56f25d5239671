//! The formats that are written, by the ending of the output, and what an encoder of one does.

use super::ExtractError;
use super::choose::Chosen;
use super::compressed::Compressed;
use super::glb::Glb;
use super::obj::Obj;
use super::output::Scratch;
use super::plain::About;
use super::ply::Ply;
use super::region::Steps;
use super::stl::Stl;
use super::stream::Counts;
use glam::{DVec3, Vec3};
use kilwa_geometry::{Aabb, Lattice, LatticePoint, Mesh};
use kilwa_pack::metadata::ScalarChannel;
use kilwa_pack::{Metadata, Reader, Source};
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

/// A format that is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// PLY.
    Ply {
        /// Numbers as text instead of binary little-endian.
        ascii: bool,
    },
    /// OBJ with colours of vertices.
    Obj,
    /// Binary STL.
    Stl,
    /// GLB.
    Glb {
        /// Compressed with `EXT_meshopt_compression`.
        compressed: bool,
    },
}

/// The formats, in the order in which messages name them.
const ALL: [Format; 4] = [Format::Ply { ascii: false }, Format::Obj, Format::Stl, Format::Glb { compressed: false }];

/// Turns vertices and triangles into bytes.
pub(super) trait Encoder {
    /// Whether triangles name vertices; else they have their corners with them and no vertex is asked for.
    fn shares_vertices(&self) -> bool {
        true
    }

    /// Whether points without triangles can be written; else the squares that stand for them are.
    fn writes_points(&self) -> bool {
        false
    }

    /// Vertices that can be named.
    fn max_vertices(&self) -> u32 {
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
    ///
    /// # Errors
    /// [`ExtractError::Output`] if its ending is not that of a supported format, if it is a folder, or if the format has no ASCII form and `ascii` is set.
    pub fn of(path: &Path, ascii: bool) -> Result<Self, ExtractError> {
        let shown = path.display();
        let refused = |why: String| Err(ExtractError::Output(why));
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        let format = match ending.as_str() {
            "ply" => Self::Ply { ascii },
            "obj" => Self::Obj,
            "stl" => Self::Stl,
            "glb" => Self::Glb { compressed: false },
            // A device or a pipe has no ending.
            "" if std::fs::metadata(path).is_ok_and(|m| !m.is_file() && !m.is_dir()) => Self::Ply { ascii },
            _ if path.is_dir() => return refused(format!("{shown} is a folder; add a file name")),
            "gltf" => {
                return refused(format!("{shown}: glTF is written as one file; use an output name that ends in .glb"));
            }
            "" => {
                return refused(format!("{shown}: give the output a name that ends in .ply, .obj, .stl or .glb"));
            }
            other => {
                return refused(format!(
                    "{shown}: kilwa cannot write .{other}; give the output a name that ends in .ply, .obj, .stl or .glb"
                ));
            }
        };
        if ascii && !matches!(format, Self::Ply { .. }) {
            return refused(format!("{shown}: --ascii works only with PLY; omit it for {}", format.title()));
        }
        Ok(format)
    }

    /// The compressed form of it.
    ///
    /// # Errors
    /// [`ExtractError::Output`] if it has none.
    pub fn compressed(self) -> Result<Self, ExtractError> {
        match self {
            Self::Glb { .. } => Ok(Self::Glb { compressed: true }),
            _ => Err(ExtractError::Output(format!("--compress works only with GLB; omit it for {}", self.title()))),
        }
    }

    /// Its name for machines.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply { .. } => "ply",
            Self::Obj => "obj",
            Self::Stl => "stl",
            Self::Glb { .. } => "glb",
        }
    }

    /// Whether it stores scalars of vertices.
    pub fn has_scalars(self) -> bool {
        matches!(self, Self::Ply { .. })
    }

    /// Whether it stores colours of vertices.
    pub fn has_colors(self) -> bool {
        self != Self::Stl
    }

    /// Its name for people.
    pub fn title(self) -> &'static str {
        match self {
            Self::Ply { .. } => "PLY",
            Self::Obj => "OBJ",
            Self::Stl => "STL",
            Self::Glb { .. } => "GLB",
        }
    }

    pub(super) fn encoder(self, target: &Target) -> Box<dyn Encoder> {
        match self {
            Self::Ply { ascii } => Box::new(Ply::new(target.clone(), ascii)),
            Self::Obj => Box::new(Obj::new(target.clone())),
            Self::Stl => Box::new(Stl::new(target.clone())),
            Self::Glb { compressed: false } => Box::new(Glb::new(target.clone())),
            Self::Glb { compressed: true } => Box::new(Compressed::new(target.clone())),
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
    pub(super) fn offset(self, target: &Target) -> Option<DVec3> {
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
        if !self.has_scalars() {
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
    /// World coordinates do not fit `float`: its range is too small, or lattice points would coincide.
    pub(super) needs_double: bool,
    pub(super) colors: bool,
    pub(super) metadata: Metadata,
    /// GLB: the model is at the origin, and its position is recorded beside it.
    pub(super) at_zero: bool,
    /// What stands in the file in place of the certified error, for a mesh that has none.
    pub(super) note: Option<String>,
}

/// The coordinates to be written, and which number types can represent them. This is decided only here.
#[derive(Debug, Clone, Copy)]
struct Coordinates {
    lattice: Lattice,
    cube_log2: u32,
    /// Bounds of what is written, in lattice units; not empty.
    bounds: Aabb,
    /// Median edge of the finest surface, or the error of what is written if that is larger; metres.
    median_edge: f64,
}

impl Coordinates {
    /// Floats are exact up to this many steps: 24 bits.
    const EXACT: f64 = 16_777_216.0;

    /// A lattice point in the middle.
    fn center(&self) -> LatticePoint {
        let Aabb { min, max } = self.bounds;
        min + (max - min) / 2
    }

    /// Whether world coordinates need `double`. Steps must be normal numbers, because many programs read smaller ones as zero.
    fn need_double(&self) -> bool {
        let step = self.lattice.step();
        let side = f64::from(1u32 << self.cube_log2);
        let far = self.lattice.world_from_steps(DVec3::splat(side));
        let largest = far.abs().max(self.lattice.origin.abs()).max_element();
        // Half a unit in the last place of a float is 2^-24 of the power of two below the number.
        largest * 2f64.powi(-24) > step * 0.25 || largest > f64::from(f32::MAX) || step < f64::from(f32::MIN_POSITIVE)
    }

    /// Whether world coordinates are finite as `double`, and no two lattice points become one.
    fn fit_double(&self) -> bool {
        let step = self.lattice.step();
        let ends = [self.bounds.min, self.bounds.max].map(|p| self.lattice.world_from_lattice(p));
        (0..3).all(|k| {
            let largest = ends[0][k].abs().max(ends[1][k].abs());
            let spacing = largest - largest.next_down();
            // If both are equal, points stay distinct only if none has to be rounded.
            let apart = spacing < step || (spacing == step && self.lattice.origin[k] % step == 0.0);
            largest.is_finite() && apart
        })
    }

    /// Whether coordinates relative to the middle fit `float`: exactly, or, in a model more than 2^25 steps wide, rounded by at most a
    /// quarter of the median edge.
    fn fit_relative_float(&self) -> bool {
        let (step, center) = (self.lattice.step(), self.center());
        let reach = f64::from((self.bounds.max - center).max_element().max(0));
        // Neighbouring floats below `reach` are at most this far apart.
        let spacing = reach * 2f64.powi(-23) * step;
        step >= f64::from(f32::MIN_POSITIVE)
            && reach * step <= f64::from(f32::MAX)
            && (reach <= Self::EXACT || spacing <= self.median_edge * 0.5)
            && self.lattice.world_from_lattice(center).is_finite()
    }

    /// Whether they fit the form that is compressed: as floats, with a bit less, and no very large or small steps.
    fn fit_compressed(&self) -> bool {
        let reach = f64::from((self.bounds.max - self.center()).max_element().max(0));
        let is_precise =
            reach * 2.0 <= Self::EXACT || reach * 2f64.powi(-22) * self.lattice.step() <= self.median_edge * 0.5;
        // With room for the exponents of far positions.
        is_precise && (-100..=90).contains(&self.lattice.step_log2) && self.fit_relative_float()
    }

    /// Whether a format can represent them.
    fn fit(&self, format: Format) -> bool {
        match format {
            Format::Ply { .. } => !self.need_double() || self.fit_double(),
            Format::Obj => self.fit_double(),
            Format::Stl => !self.need_double() || self.fit_relative_float(),
            Format::Glb { compressed: false } => self.fit_relative_float(),
            Format::Glb { compressed: true } => self.fit_compressed(),
        }
    }

    /// Fail if a format cannot represent them, with a message that says what to do.
    fn refuse_unless_fit(&self, format: Format) -> Result<(), ExtractError> {
        if self.fit(format) {
            return Ok(());
        }
        let (DVec3 { x, y, z }, step) = (self.lattice.origin, self.lattice.step_log2);
        let others: Vec<&str> = ALL.iter().filter(|f| self.fit(**f)).map(|f| f.title()).collect();
        let center = self.center();
        let small = Self { bounds: Aabb { min: center, max: center }, ..*self };
        let hint = if !others.is_empty() {
            format!("write {} instead", others.join(" or "))
        } else if small.fit(format) {
            "no other format can either; extract smaller parts with --box".to_owned()
        } else {
            "no other format can either; build the pack again with coordinates nearer to zero, or with another --step"
                .to_owned()
        };
        Err(ExtractError::Numbers(format!(
            "{} cannot represent coordinates in steps of 2^{step} m from the origin {x:?} {y:?} {z:?}; {hint}",
            format.title()
        )))
    }
}

impl Target {
    /// What `format` needs to know.
    ///
    /// # Errors
    /// If the format cannot represent the coordinates; the message says which format can.
    pub(super) fn new<S: Source>(
        reader: &Reader<S>,
        chosen: &Chosen,
        region: Option<&Steps>,
        format: Format,
    ) -> Result<Self, ExtractError> {
        let header = reader.header();
        let lattice = header.lattice;
        let near = |bounds: &&Aabb| region.is_none_or(|region| region.meets(bounds));
        let all = reader.entries().iter().map(|e| &e.bounds).filter(near).fold(Aabb::EMPTY, |sum, b| sum.union(b));
        let bounds = if all.is_empty() { Aabb { min: LatticePoint::ZERO, max: LatticePoint::ZERO } } else { all };
        // A coarse surface is no finer than its error.
        let error = Some(f64::from(chosen.error)).filter(|error| error.is_finite()).unwrap_or(0.0);
        let median_edge = reader.metadata().median_edge.max(error);
        let coordinates = Coordinates { lattice, cube_log2: header.cube_log2, bounds, median_edge };
        // If there is nothing to write, the caller reports that.
        if !all.is_empty() {
            coordinates.refuse_unless_fit(format)?;
        }
        let (center, needs_double) = (coordinates.center(), coordinates.need_double());
        let (colors, metadata) = (header.attributes.colors, reader.metadata().clone());
        Ok(Self { lattice, center, needs_double, colors, metadata, at_zero: false, note: None })
    }

    /// Record that vertices have colours and additional scalars.
    pub(super) fn repainted(&mut self, scalars: &[String]) {
        self.colors = true;
        let channel = |name: &String| ScalarChannel { name: name.clone(), min: 0.0, max: 0.0 };
        self.metadata.scalars.extend(scalars.iter().map(channel));
    }

    /// For a mesh that comes from no pack.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(super) fn plain(about: &About, lattice: Lattice, bounds: Aabb, format: Format) -> Result<Self, ExtractError> {
        let channel = |name: &String| ScalarChannel { name: name.clone(), min: 0.0, max: 0.0 };
        let metadata = Metadata {
            title: about.title.clone(),
            source_units: "m".to_owned(),
            source_up: "z".to_owned(),
            crs: about.crs.clone(),
            lattice_step: lattice.step(),
            bounds_min: about.bounds[0],
            bounds_max: about.bounds[1],
            median_edge: 0.0,
            triangles: 0,
            vertices: 0,
            border_edges: 0,
            scalars: about.scalars.iter().map(channel).collect(),
            sources: Vec::new(),
            tool: String::new(),
            options: BTreeMap::new(),
            capture_accuracy: None,
            capture_registration: None,
            capture_instrument: None,
            repairs: BTreeMap::new(),
        };
        let side = (bounds.max - bounds.min.min(LatticePoint::ZERO)).max_element().max(1) as u32;
        let cube_log2 = side.ilog2() + 1;
        // A tenth of a millimetre is less than the noise of any scanner.
        let coordinates = Coordinates { lattice, cube_log2: cube_log2.min(31), bounds, median_edge: 1e-4 };
        coordinates.refuse_unless_fit(format)?;
        let (center, needs_double) = (coordinates.center(), coordinates.need_double());
        let note = Some(about.note.clone());
        Ok(Self { lattice, center, needs_double, colors: about.colors, metadata, at_zero: false, note })
    }

    /// Name and version of the program, and the promise: `error` is certified, in metres; for a mesh without one its note.
    pub(super) fn comment(&self, error: f32) -> String {
        match &self.note {
            Some(note) => format!("kilwa {}: {}", env!("CARGO_PKG_VERSION"), one_line(note)),
            None => comment(error),
        }
    }

    /// A position relative to [`Self::center`], in metres: exact within 2^24 steps of it.
    pub(super) fn relative(&self, p: LatticePoint) -> Vec3 {
        ((p - self.center).as_dvec3() * self.lattice.step()).as_vec3()
    }

    /// Units, axes and the coordinate reference system.
    pub(super) fn frame(&self) -> String {
        format!("metres, z up, crs {}", one_line(self.metadata.crs.as_deref().unwrap_or("unknown")))
    }
}

/// Name and version of the program, and the promise: `error` is certified, in metres.
fn comment(error: f32) -> String {
    let version = env!("CARGO_PKG_VERSION");
    format!("kilwa {version}: certified error {error} m against the finest surface")
}

/// Text for one line of a header.
pub(super) fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GLB: Format = Format::Glb { compressed: false };

    /// A cube of 2^10 steps.
    fn coordinates(step_log2: i32, origin: f64) -> Coordinates {
        let lattice = Lattice { origin: DVec3::new(origin, -origin, origin), step_log2 };
        let bounds = Aabb { min: LatticePoint::ZERO, max: LatticePoint::splat(1024) };
        Coordinates { lattice, cube_log2: 10, bounds, median_edge: lattice.step() * 16.0 }
    }

    #[test]
    fn each_format_is_refused_exactly_if_its_number_type_is_not_precise_enough() {
        // Step; origin; whether PLY uses double; whether PLY, OBJ, STL and GLB can represent it.
        for (step, origin, double, fit) in [
            (-13, 0.0, false, [true; 4]),
            (-13, 9e6, true, [true; 4]),
            (117, 0.0, false, [true; 4]),
            (118, 0.0, true, [true, true, true, true]),
            (119, 0.0, true, [true, true, false, false]),
            (1000, 0.0, true, [true, true, false, false]),
            (-126, 0.0, false, [true; 4]),
            (-127, 0.0, true, [true, true, false, false]),
            (-1000, 0.0, true, [true, true, false, false]),
            (-40, 5e5, true, [false, false, true, true]),
            (-10, 1e15, true, [false, false, true, true]),
            (0, 1e300, true, [false, false, true, true]),
            (-900, 5e5, true, [false; 4]),
            (100, f64::MAX, true, [false, false, true, true]),
        ] {
            let c = coordinates(step, origin);
            assert_eq!(c.need_double(), double, "2^{step} at {origin}");
            assert_eq!(ALL.map(|f| c.fit(f)), fit, "2^{step} at {origin}");
        }
    }

    #[test]
    fn accepted_coordinates_are_finite_and_distinct() {
        for step in (-1000..=1000).step_by(7) {
            for origin in [0.0, 1.0 / 3.0, 1e3, 5e5, 1e9, 1e15, 1e16, 1e100, 1e308] {
                let c = coordinates(step, origin);
                let apart = |of: &dyn Fn(i32) -> f64| {
                    let all: Vec<f64> = (0..=1024).map(of).collect();
                    all.iter().all(|x| x.is_finite()) && all.windows(2).all(|w| w[0] < w[1])
                };
                let world = |p: i32| c.lattice.world_from_lattice(LatticePoint::splat(p)).x;
                assert!(!c.fit(Format::Obj) || apart(&world), "2^{step} at {origin}");
                assert!(c.need_double() || apart(&|p| f64::from(world(p) as f32)), "2^{step} at {origin}");
                let local = |p: i32| f64::from((f64::from(p - c.center().x) * c.lattice.step()) as f32);
                assert!(!c.fit(GLB) || apart(&local), "2^{step} at {origin}");
            }
        }
    }

    #[test]
    fn a_spacing_of_one_ulp_is_accepted_if_the_origin_is_a_multiple_of_it() {
        let exact = coordinates(-29, 9e6);
        assert!(exact.fit(Format::Obj), "the finest step that kilwa build derives");
        let mut between = exact;
        between.lattice.origin = DVec3::new(8_388_608.0 - 2f64.powi(-30), 0.0, 0.0);
        assert!(!between.fit(Format::Obj), "points above 2^23 m would have to be rounded");
        assert!(!coordinates(-30, 9e6).fit(Format::Obj));
    }

    #[test]
    fn a_wide_model_is_refused_only_if_rounding_would_collapse_its_edges() {
        let mut wide = coordinates(-10, 0.0);
        (wide.cube_log2, wide.bounds.max) = (30, LatticePoint::splat((1 << 30) - 1));
        wide.median_edge = wide.lattice.step();
        assert!(!wide.fit(GLB));
        assert!(wide.fit(Format::Obj));
        wide.median_edge = wide.lattice.step() * 256.0;
        assert!(wide.fit(GLB));
    }

    #[test]
    fn a_refusal_names_spacing_origin_and_remedy() {
        let say = |c: Coordinates, f: Format| c.refuse_unless_fit(f).unwrap_err().to_string();
        let far = say(coordinates(-40, 5e5), Format::Obj);
        assert!(far.contains("OBJ") && far.contains("2^-40 m") && far.contains("500000.0 -500000.0"), "{far}");
        assert!(far.contains("write STL or GLB instead"), "{far}");
        assert!(say(coordinates(-900, 0.0), GLB).contains("write PLY or OBJ instead"));
        assert!(say(coordinates(-900, 5e5), Format::Stl).contains("build the pack again"));
        let mut wide = coordinates(1000, 0.0);
        wide.bounds.max = LatticePoint::splat(1 << 24);
        assert!(say(wide, Format::Ply { ascii: true }).contains("--box"));
    }
}
