//! Decides from the header what is kept of every row, and as what; the rest of the reader only follows the plan.
//!
//! Names are compared without regard to case. Refused here: no triangles declared, no x, y or z, a face without a list
//! of vertex indices, the same thing declared twice.

use super::header::{Element, Header, Kind, Property};
use super::points::GRID;
use super::scalar::Scalar;
use super::{Place, ReadError};
use crate::Diagnostics;
use kilwa_pack::chunk::MAX_SCALARS;
use kilwa_pack::plural::counted;
use std::path::Path;

/// What a kept scalar of a vertex is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Role {
    Position(usize),
    Color(usize),
    Alpha,
    Normal(usize),
    /// A further scalar channel, by its number in [`Plan::channels`].
    Channel(usize),
}

/// What happens to one property of a row.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Keep {
    Nothing,
    /// Goes to this column of the rows that are handed on.
    Column(usize),
    /// Is the list of vertex indices.
    Indices,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Field {
    pub(super) name: String,
    pub(super) kind: Kind,
    pub(super) keep: Keep,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum ElementPlan {
    Vertices(Vec<Field>),
    Faces(Vec<Field>),
    Strips(Vec<Field>),
    Skip(Vec<Field>),
}

/// A kept scalar of the vertices, in the order of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Column {
    pub(super) role: Role,
    pub(super) kind: Scalar,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Plan {
    /// One for each element of the header.
    pub(super) elements: Vec<ElementPlan>,
    /// Kept scalars of the vertices.
    pub(super) columns: Vec<Column>,
    /// Names of the further channels.
    pub(super) channels: Vec<String>,
    /// The type of the colours of the faces where these become the colours of the mesh.
    pub(super) face_colors: Option<Scalar>,
    /// Rows of the vertex element.
    pub(super) vertices: u64,
    /// Rows of the face element.
    pub(super) faces: u64,
}

/// Names of colours: red, green, blue, alpha.
const COLORS: [[&str; 4]; 3] = [
    ["red", "green", "blue", "alpha"],
    ["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"],
    ["r", "g", "b", "a"],
];
/// Names of the list of corners.
const INDICES: [&str; 2] = ["vertex_indices", "vertex_index"];
/// Channels kept under their names, besides `scalar_*` (CloudCompare). From the fifth on they are those that Kilwa itself writes.
const CHANNELS: [&str; 9] =
    ["confidence", "quality", "intensity", "value", "stations", "registration", "filled", "source", "photos"];

const MESH_FIRST: &str = "Make a mesh of it first (for example Poisson reconstruction in CloudCompare or MeshLab) and give that; where the mesh exists, export its faces too";

impl Plan {
    pub(super) fn new(header: &Header, path: &Path) -> Result<Self, ReadError> {
        let vertex = only(header, "vertex", path)?;
        let face = only(header, "face", path)?;
        let strips = only(header, "tristrips", path)?;
        let rows = |e: Option<&Element>| e.map_or(0, |e| e.count);
        if let (Some(vertex), None, None) = (vertex, face, strips)
            && vertex.properties.iter().any(|p| INDICES.iter().any(|n| n.eq_ignore_ascii_case(&p.name)))
        {
            let found = "an element vertex with vertex_indices and no element face".to_owned();
            return Err(malformed(path, vertex, found, "\"element face COUNT\" before that property"));
        }
        let Some(vertex) = vertex.filter(|v| v.count > 0 && rows(face) + rows(strips) > 0) else {
            return Err(ReadError::NoTriangles {
                file: path.to_owned(),
                found: inventory(header, rows(vertex)),
                way_out: if rows(vertex) > 0 { MESH_FIRST } else { "Export the mesh again and give that" },
            });
        };
        Self::with(header, vertex, rows(face), path, |plan, element| {
            Ok(match element.name.as_str() {
                "face" if element.count > 0 => {
                    let mut fields = index_fields(element, path)?;
                    if rows(strips) == 0 {
                        plan.keep_face_colors(element, &mut fields, path)?;
                    }
                    Some(ElementPlan::Faces(fields))
                }
                "tristrips" if element.count > 0 => Some(ElementPlan::Strips(index_fields(element, path)?)),
                _ => None,
            })
        })
    }

    /// What is kept of a file of points: its vertices, and the vertex of each cell of a range grid.
    pub(super) fn of_points(header: &Header, path: &Path) -> Result<Self, ReadError> {
        let vertex = only(header, "vertex", path)?;
        let faces = only(header, "face", path)?.map_or(0, |e| e.count);
        only(header, GRID, path)?;
        if faces > 0 {
            let needs = format!("is a mesh of {}, not a scan", counted(faces, "face", "faces"));
            return Err(ReadError::Needs { file: path.to_owned(), needs, way_out: "Build it with `kilwa build`" });
        }
        let Some(vertex) = vertex.filter(|v| v.count > 0) else {
            let needs = format!("has no points: {}", inventory(header, 0));
            return Err(ReadError::Needs { file: path.to_owned(), needs, way_out: "Export the scan again" });
        };
        Self::with(header, vertex, 0, path, |plan, element| match element.name.as_str() {
            GRID if !plan.elements.iter().any(|what| matches!(what, ElementPlan::Vertices(_))) => {
                let found = "a range grid before the vertices".to_owned();
                Err(malformed(path, element, found, "the element vertex first"))
            }
            GRID => Ok(Some(ElementPlan::Faces(index_fields(element, path)?))),
            _ => Ok(None),
        })
    }

    /// A plan of a file with these vertices. `of_element` says what happens to its other elements; `None`: nothing is kept of them.
    fn with(
        header: &Header,
        vertex: &Element,
        faces: u64,
        path: &Path,
        of_element: impl Fn(&mut Self, &Element) -> Result<Option<ElementPlan>, ReadError>,
    ) -> Result<Self, ReadError> {
        let mut plan = Self {
            elements: Vec::with_capacity(header.elements.len()),
            columns: Vec::new(),
            channels: Vec::new(),
            face_colors: None,
            vertices: vertex.count,
            faces,
        };
        let vertex_fields = plan.vertex_fields(vertex, path)?;
        for element in &header.elements {
            let what = match element.name.as_str() {
                "vertex" => ElementPlan::Vertices(vertex_fields.clone()),
                _ => of_element(&mut plan, element)?.unwrap_or_else(|| ElementPlan::Skip(fields(element))),
            };
            plan.elements.push(what);
        }
        Ok(plan)
    }

    /// The type of the colours of the vertices, where these have colours.
    pub(super) fn vertex_colors(&self) -> Option<Scalar> {
        self.columns.iter().find(|c| matches!(c.role, Role::Color(_))).map(|c| c.kind)
    }

    /// List what is not kept.
    pub(super) fn report(&self, header: &Header, diagnostics: &mut Diagnostics) {
        let mut dropped = |kind, names: Vec<&str>| {
            if !names.is_empty() {
                diagnostics.add(kind, || listed(&names));
                diagnostics.add_many(kind, names.len() as u64 - 1);
            }
        };
        for plan in &self.elements {
            let names = |fields: &'_ [Field]| -> Vec<String> {
                fields.iter().filter(|f| f.keep == Keep::Nothing).map(|f| f.name.clone()).collect()
            };
            let (kind, names) = match plan {
                ElementPlan::Vertices(fields) => ("properties of the vertices not kept", names(fields)),
                ElementPlan::Faces(fields) => ("properties of the faces not kept", names(fields)),
                ElementPlan::Strips(fields) => ("properties of the triangle strips not kept", names(fields)),
                ElementPlan::Skip(_) => continue,
            };
            dropped(kind, names.iter().map(String::as_str).collect());
        }
        dropped("pictures named in the header not read", header.textures.iter().map(String::as_str).collect());
        for (element, _) in
            header.elements.iter().zip(&self.elements).filter(|(e, p)| matches!(p, ElementPlan::Skip(_)) && e.count > 0)
        {
            diagnostics.add("elements of the file not kept", || {
                format!("{} ({})", element.name, counted(element.count, "row", "rows"))
            });
        }
    }

    fn vertex_fields(&mut self, vertex: &Element, path: &Path) -> Result<Vec<Field>, ReadError> {
        let mut roles = vec![None; vertex.properties.len()];
        let mut give = |name: &str, role: Role| {
            let found = scalar_named(vertex, name);
            if let Some(i) = found {
                roles[i] = roles[i].or(Some(role));
            }
            found.is_some()
        };
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            if !give(name, Role::Position(axis)) {
                let found = format!("an element vertex without a scalar property {name}");
                return Err(malformed(path, vertex, found, "x, y and z"));
            }
            let times = vertex.properties.iter().filter(|p| p.name.eq_ignore_ascii_case(name)).count();
            if times > 1 {
                return Err(malformed(path, vertex, format!("{times} properties {name}"), "one"));
            }
        }
        let mut alpha = false;
        if let Some([red, green, blue, transparency]) = color_family(vertex, path)? {
            for (i, name) in [red, green, blue].into_iter().enumerate() {
                give(name, Role::Color(i));
            }
            alpha = give(transparency, Role::Alpha);
        }
        let normals = ["nx", "ny", "nz"];
        if normals.iter().all(|n| scalar_named(vertex, n).is_some()) {
            for (i, name) in normals.into_iter().enumerate() {
                give(name, Role::Normal(i));
            }
        }
        for property in &vertex.properties {
            let name = property.name.as_str();
            let known = CHANNELS.iter().any(|c| c.eq_ignore_ascii_case(name))
                || name.get(..7).is_some_and(|start| start.eq_ignore_ascii_case("scalar_"));
            // A pack has room for so many channels; the rest is reported with all else that is not kept.
            let room = self.channels.len() + usize::from(alpha) < usize::from(MAX_SCALARS);
            if known
                && room
                && !self.channels.iter().any(|c| c.eq_ignore_ascii_case(name))
                && give(name, Role::Channel(self.channels.len()))
            {
                self.channels.push(name.to_owned());
            }
        }
        let mut fields = fields(vertex);
        for (field, role) in fields.iter_mut().zip(roles) {
            if let (Some(role), Kind::Scalar(kind)) = (role, field.kind) {
                field.keep = Keep::Column(self.columns.len());
                self.columns.push(Column { role, kind });
            }
        }
        Ok(fields)
    }

    /// Colours of faces are kept where the vertices have none.
    fn keep_face_colors(&mut self, face: &Element, fields: &mut [Field], path: &Path) -> Result<(), ReadError> {
        if self.vertex_colors().is_some() {
            return Ok(());
        }
        if let Some(family) = color_family(face, path)? {
            for (i, name) in family.iter().take(3).enumerate() {
                if let Some(at) = scalar_named(face, name) {
                    fields[at].keep = Keep::Column(i);
                    if let Kind::Scalar(kind) = fields[at].kind {
                        self.face_colors = Some(kind);
                    }
                }
            }
        }
        Ok(())
    }
}

/// The element of this name; two of them are refused.
fn only<'h>(header: &'h Header, name: &str, path: &Path) -> Result<Option<&'h Element>, ReadError> {
    let mut found = header.elements.iter().filter(|e| e.name == name);
    let first = found.next();
    match found.next() {
        Some(second) => Err(malformed(path, second, format!("a second element {name}"), "one")),
        None => Ok(first),
    }
}

/// What a file without triangles has instead.
fn inventory(header: &Header, vertices: u64) -> String {
    let names: Vec<String> =
        header.elements.iter().map(|e| format!("{} {} (line {})", e.count, e.name, e.line)).collect();
    match (names.is_empty(), vertices) {
        (true, _) => "it declares no elements at all".to_owned(),
        (false, 0) => format!("it has no vertices; its header declares {}", names.join(", ")),
        (false, n) => {
            format!("it has {} and no faces; its header declares {}", counted(n, "point", "points"), names.join(", "))
        }
    }
}

fn fields(element: &Element) -> Vec<Field> {
    let field = |p: &Property| Field { name: p.name.clone(), kind: p.kind, keep: Keep::Nothing };
    element.properties.iter().map(field).collect()
}

/// The fields of a face or strip, with the list of vertex indices found.
fn index_fields(element: &Element, path: &Path) -> Result<Vec<Field>, ReadError> {
    let mut fields = fields(element);
    let named = |f: &Field| INDICES.iter().any(|n| n.eq_ignore_ascii_case(&f.name));
    let Some(list) = fields.iter_mut().find(|f| named(f)) else {
        let found = format!("an element {} without vertex_indices", element.name);
        return Err(malformed(path, element, found, "\"property list uchar int vertex_indices\""));
    };
    match list.kind {
        Kind::List { item, .. } if item.is_integer() => list.keep = Keep::Indices,
        Kind::List { item, .. } => {
            let found = format!("{} that are {}", list.name, item.name());
            return Err(malformed(path, element, found, "indices of an integer type"));
        }
        Kind::Scalar(_) => {
            return Err(malformed(path, element, format!("{} that is not a list", list.name), "a list"));
        }
    }
    Ok(fields)
}

/// The first scalar property of this name.
fn scalar_named(element: &Element, name: &str) -> Option<usize> {
    let is = |p: &Property| matches!(p.kind, Kind::Scalar(_)) && p.name.eq_ignore_ascii_case(name);
    element.properties.iter().position(is)
}

/// The names under which an element has red, green and blue; these must have one type.
fn color_family(element: &Element, path: &Path) -> Result<Option<&'static [&'static str; 4]>, ReadError> {
    let complete = |family: &&[&str; 4]| family[..3].iter().all(|n| scalar_named(element, n).is_some());
    let Some(family) = COLORS.iter().find(complete) else { return Ok(None) };
    let kinds: Vec<Kind> =
        family[..3].iter().filter_map(|n| scalar_named(element, n)).map(|i| element.properties[i].kind).collect();
    if kinds.windows(2).any(|pair| pair[0] != pair[1]) {
        let found = format!("{}, {} and {} of different types", family[0], family[1], family[2]);
        return Err(malformed(path, element, found, "one type"));
    }
    Ok(Some(family))
}

/// A few names in one line.
fn listed(names: &[&str]) -> String {
    const SHOWN: usize = 20;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names[..names.len().min(SHOWN)].join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}

fn malformed(path: &Path, element: &Element, found: String, expected: &str) -> ReadError {
    ReadError::Malformed {
        file: path.to_owned(),
        place: Place::Line(element.line),
        found,
        expected: expected.to_owned(),
    }
}
