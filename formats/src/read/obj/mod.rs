//! The reader of Wavefront OBJ (Wavefront Technologies, "Advanced Visualizer" manual, appendix B1) with its material
//! libraries (MTL): vertices with and without colours, faces of any number of corners, texture coordinates, normals.
//!
//! The file is read twice: `survey` (what there is), then line by line to the sink. Where faces name neither normals
//! nor a picture, vertices and faces go out as they stand (`plain`) and nothing is held. Else each distinct corner
//! becomes a vertex (`corners`): positions, texture coordinates and normals are kept in tables (`table`) that move to a
//! scratch file beyond a fixed size, and corners that a bounded cache has forgotten come out twice.
//!
//! What is kept: positions; colours of vertices as sRGB (0 to 1, or 0 to 255 where one is above 1), else the picture
//! (`map_Kd`) at the vertex, else the diffuse colour (`Kd`, taken as sRGB) of the material; where there is a picture it
//! comes before colours of vertices. Normals. Names of objects, groups and smoothing groups are passed over.
//!
//! Repaired and counted: polygons are triangulated with all their surface; faces of fewer than three corners and
//! triangles that name a vertex twice are dropped; libraries, materials and pictures that are missing are left out; lines,
//! points and free-form curves and surfaces are left out.
//! Refused with the line: a vertex index that names nothing, words that are no numbers, a polygon before its vertices.

mod corners;
mod lines;
mod material;
mod plain;
mod statements;
mod survey;
mod table;

#[cfg(test)]
mod fuzz_tests;
#[cfg(test)]
mod tests;

use super::companions::{Companions, Reference};
use super::source::Source;
use super::texture::detail::Detail;
use super::{Input, MeshSink, Place, ReadError};
use crate::Diagnostics;
use corners::{Corners, To};
use glam::{DVec2, DVec3};
use kilwa_pack::plural::counted;
use kilwa_pack::visible::visible;
use lines::{Lines, word};
use material::Material;
use plain::Plain;
use statements::{Corner, Counts, Fault};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use survey::Survey;

/// The part of the work that the first pass is, about.
const SURVEY: f64 = 0.25;

/// Keywords that the first line of an OBJ that says something begins with.
const KEYWORDS: [&[u8]; 17] = [
    b"v", b"vn", b"vt", b"vp", b"f", b"o", b"g", b"s", b"l", b"p", b"usemtl", b"mtllib", b"cstype", b"deg", b"mg",
    b"lod", b"newmtl",
];

/// Whether a file that starts with these bytes is an OBJ, decided by the first line that is no comment.
pub fn is_obj(start: &[u8]) -> bool {
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    let mut lines = text.split(|&b| b == b'\n' || b == b'\r').map(<[u8]>::trim_ascii);
    let says_something = |line: &&[u8]| !line.is_empty() && !line.starts_with(b"#");
    let Some(line) = lines.find(says_something) else { return false };
    let (keyword, rest) = word(line);
    match keyword {
        // Some writers put the library in the mesh file.
        b"newmtl" => lines.any(|line| word(line).0 == b"v"),
        // These begin lines of other files too; numbers follow here.
        b"v" | b"vn" | b"vt" => lines::number(word(rest).0).is_some(),
        b"f" | b"l" | b"p" => word(rest).0.iter().any(u8::is_ascii_digit),
        _ => KEYWORDS.contains(&keyword),
    }
}

/// Where the second pass delivers to.
trait Body {
    /// The next vertex; its colour where it has one.
    fn vertex(&mut self, position: DVec3, color: Option<[u8; 3]>) -> Result<(), ReadError>;
    /// The next texture coordinates.
    fn uv(&mut self, uv: DVec2) -> Result<(), ReadError>;
    /// The next normal.
    fn normal(&mut self, normal: DVec3) -> Result<(), ReadError>;
    /// Faces that follow have this material.
    fn material(&mut self, material: &Material) -> Result<(), ReadError>;
    /// A face. Vertices that come later it may name only where [`Body::may_look_ahead`] says so.
    fn face(&mut self, corners: &[Corner], line: u64) -> Result<(), ReadError>;
    /// Whether a face of so many corners may name vertices that come later.
    fn may_look_ahead(&self, corners: usize) -> bool;
    /// Whether texture coordinates and normals are looked at.
    fn needs_corners(&self) -> bool;
    /// Counts what is dropped and repaired.
    fn diagnostics(&mut self) -> &mut Diagnostics;
    /// Hand on the rest; how many triangles there were, and what was found.
    fn finish(self) -> Result<(u64, Diagnostics), ReadError>;
}

/// Deliver the OBJ.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, cut or without triangles.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let Input { path, total, source, progress, options, archive } = input;
    let mut source = Source::new(source, total, path, progress);
    let companions = Companions::of(path, options, archive);
    let (survey, materials, diagnostics) = first_pass(&mut source, path, &companions)?;
    source.begin_pass(SURVEY, 1.0 - SURVEY)?;
    let has_normals = survey.uses_normals && survey.normals > 0;
    // Where others are split at their edges, a mesh without pictures must be, too.
    let (delivered, diagnostics) = if has_pictures(&materials) || has_normals || options.detail.is_some() {
        let body = Corners::new(path, options, &companions, &survey, To::Sink(sink), diagnostics);
        second_pass(&mut source, path, &survey, &materials, body)?
    } else {
        let body = Plain::new(survey.has_colors, sink, diagnostics);
        second_pass(&mut source, path, &survey, &materials, body)?
    };
    source.done();
    if delivered == 0 {
        return Err(ReadError::no_face_left(path, survey.faces, &diagnostics));
    }
    sink.diagnostics().merge(diagnostics);
    Ok(())
}

/// Note how many texels the edges of the OBJ span, without delivering it.
///
/// # Errors
/// As [`read`].
pub fn note_detail(input: Input<'_>, detail: &Detail) -> Result<(), ReadError> {
    let Input { path, total, source, progress, options, archive } = input;
    let mut source = Source::new(source, total, path, progress);
    let companions = Companions::of(path, options, archive);
    let (survey, materials, diagnostics) = first_pass(&mut source, path, &companions)?;
    if has_pictures(&materials) {
        source.begin_pass(SURVEY, 1.0 - SURVEY)?;
        let body = Corners::new(path, options, &companions, &survey, To::Notes(detail), diagnostics);
        second_pass(&mut source, path, &survey, &materials, body)?;
    }
    source.done();
    Ok(())
}

fn has_pictures(materials: &HashMap<String, Material>) -> bool {
    materials.values().any(|m| m.map.is_some())
}

/// What the file has, the materials that it uses, and what was found on the way.
fn first_pass(
    source: &mut Source<'_>,
    path: &Path,
    companions: &Companions<'_>,
) -> Result<(Survey, HashMap<String, Material>, Diagnostics), ReadError> {
    let mut diagnostics = Diagnostics::default();
    source.begin_pass(0.0, SURVEY)?;
    let survey = Survey::read(&mut Lines::new(source)?, &mut diagnostics)?;
    if survey.vertices == 0 || survey.faces == 0 {
        return Err(no_faces(path, &survey));
    }
    let mut materials = libraries(path, companions, &survey, &mut diagnostics)?;
    for name in survey.materials.lines.keys() {
        if !materials.contains_key(name) {
            diagnostics.add("materials that no library defines, left out", || visible(name).into_owned());
        }
    }
    if !(survey.uses_uvs && survey.uvs > 0) {
        for material in materials.values_mut() {
            material.map = None;
        }
    }
    Ok((survey, materials, diagnostics))
}

fn second_pass(
    source: &mut Source<'_>,
    path: &Path,
    survey: &Survey,
    materials: &HashMap<String, Material>,
    mut body: impl Body,
) -> Result<(u64, Diagnostics), ReadError> {
    let mut lines = Lines::new(source)?;
    let all = Counts { vertices: survey.vertices, uvs: survey.uvs, normals: survey.normals };
    let mut so_far = Counts::default();
    let mut corners = Vec::new();
    let (full, none) = (if survey.largest_color > 1.0 { 255.0 } else { 1.0 }, Material::default());
    loop {
        let number = lines.next_number();
        let Some(line) = lines.next()? else { return body.finish() };
        let fault = |(found, expected): Fault| malformed(path, number, found, expected);
        let (keyword, rest) = word(line);
        match keyword {
            b"v" => {
                let vertex = statements::vertex(rest).map_err(fault)?;
                if vertex.weighted {
                    body.diagnostics().add("weights (w) of vertices not kept", || format!("line {number}"));
                }
                let color = vertex.color.map(|c| color(c, full, body.diagnostics()));
                body.vertex(vertex.position, color)?;
                so_far.vertices += 1;
            }
            b"vt" => {
                if body.needs_corners() {
                    body.uv(statements::uv(rest).map_err(fault)?)?;
                }
                so_far.uvs += 1;
            }
            b"vn" => {
                if body.needs_corners() {
                    body.normal(statements::normal(rest).map_err(fault)?)?;
                }
                so_far.normals += 1;
            }
            b"f" | b"fo" => {
                let mut missing = 0;
                statements::corners(rest, &so_far, &all, &mut corners, &mut missing).map_err(fault)?;
                body.diagnostics()
                    .add_many("texture coordinates and normals named by faces that do not exist", missing);
                check_face(&corners, so_far.vertices, &body).map_err(fault)?;
                body.face(&corners, number)?;
            }
            b"usemtl" => body.material(materials.get(&material::text(rest)).unwrap_or(&none))?,
            _ => {}
        }
    }
}

fn check_face(corners: &[Corner], so_far: u64, body: &impl Body) -> Result<(), Fault> {
    if corners.len() > super::faces::MAX_CORNERS {
        let found = format!("a face of {} corners", corners.len());
        return Err((found, format!("at most {}; split it in the program that made it", super::faces::MAX_CORNERS)));
    }
    match corners.iter().find(|c| c.vertex >= so_far) {
        Some(corner) if !body.may_look_ahead(corners.len()) => Err((
            format!("a face that names vertex {}, which comes after it", corner.vertex + 1),
            "vertices before the faces that name them; export the file again".to_owned(),
        )),
        _ => Ok(()),
    }
}

/// A colour of a vertex to 8 bits.
fn color(color: DVec3, full: f64, diagnostics: &mut Diagnostics) -> [u8; 3] {
    let levels = (color / full * 255.0).to_array();
    if !levels.iter().all(|v| (-0.001..=255.001).contains(v)) {
        diagnostics.add_many("colours outside their range clamped", 1);
    } else if levels.iter().any(|v| (v - v.round()).abs() > 0.01) {
        diagnostics.add_many("colours rounded to 8 bits", 1);
    }
    levels.map(|v| v.round().clamp(0.0, 255.0) as u8)
}

/// The materials that the mesh uses, of the libraries that are there.
fn libraries(
    path: &Path,
    companions: &Companions<'_>,
    survey: &Survey,
    diagnostics: &mut Diagnostics,
) -> Result<HashMap<String, Material>, ReadError> {
    const MISSING: &str = "material libraries that are missing; colours and pictures are left out";
    let mut materials = HashMap::new();
    if survey.materials.lines.is_empty() {
        return Ok(materials);
    }
    // The same library may have many names.
    let mut done = HashSet::new();
    for (name, line) in &survey.libraries.lines {
        let Some(files) = libraries_named(path, companions, name, *line)? else {
            diagnostics.add(MISSING, || visible(name).into_owned());
            continue;
        };
        for file in files {
            let cannot = |source| ReadError::Open { file: file.clone(), source };
            if !done.insert(companions.real(&file).map_err(cannot)?) {
                continue;
            }
            let (mut bytes, total) = companions.open(&file).map_err(cannot)?;
            let progress = &mut |_: u64, _: u64| {};
            let mut source = Source::new(&mut bytes, total, &file, progress);
            let mut lines = Lines::new(&mut source)?;
            material::read(&mut lines, &file, &survey.materials.lines, &mut materials, diagnostics)?;
        }
    }
    Ok(materials)
}

/// The files that `mtllib` names: one name with spaces, or several names. `None` where one is missing.
fn libraries_named(
    path: &Path,
    companions: &Companions<'_>,
    name: &str,
    line: u64,
) -> Result<Option<Vec<PathBuf>>, ReadError> {
    let place = format!("line {line} (mtllib)");
    let locate = |name: &str| companions.locate(companions.folder(), &Reference { file: path, place: &place, name });
    // The whole may look as if it led outside though it is several names: then these decide.
    let whole = locate(name);
    if let Ok(Some(file)) = whole {
        return Ok(Some(vec![file]));
    }
    let parts: Vec<&str> = name.split_whitespace().collect();
    if parts.len() < 2 {
        return whole.map(|_| None);
    }
    parts.into_iter().map(locate).collect()
}

fn no_faces(path: &Path, survey: &Survey) -> ReadError {
    let others = match survey.others {
        0 => String::new(),
        n => format!(
            " and {} not read",
            counted(n, "line, point or free-form element, which is", "lines, points or free-form elements, which are")
        ),
    };
    let (found, way_out) = match (survey.vertices, survey.faces) {
        (0, 0) => (format!("it has no vertices and no faces{others}"), "Export the mesh again and give that"),
        (0, n) => (
            format!("it has {} and no vertices", counted(n, "face", "faces")),
            "It is truncated or damaged: export it again",
        ),
        (n, _) if survey.others > 0 => (
            format!("it has {}, no faces{others}", counted(n, "vertex", "vertices")),
            "Convert curves and surfaces to a mesh in the program that made it and give that",
        ),
        (n, _) => (
            format!("it has {} and no faces", counted(n, "point", "points")),
            "Make a mesh of it first (for example Poisson reconstruction in CloudCompare or MeshLab) and give that",
        ),
    };
    ReadError::NoTriangles { file: path.to_owned(), found, way_out }
}

fn malformed(path: &Path, line: u64, found: String, expected: String) -> ReadError {
    ReadError::Malformed { file: path.to_owned(), place: Place::Line(line), found, expected }
}
