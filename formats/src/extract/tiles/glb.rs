//! A tile as GLB (Khronos, "glTF 2.0 Specification"): positions on a grid, relative to the node's translation, y up.
//!
//! Clients multiply positions by a matrix of floats for each tile. If two tiles have different translations, these matrices are rounded
//! differently, and a vertex that both have moves apart by a ten-thousandth of a pixel: now and then, a single pixel at a border shows the
//! background. So all tiles have the same translation, except in models that are wider than [`CELL`] steps.

use super::Profile;
use crate::extract::ExtractError;
use crate::extract::gltf::{ARRAY_BUFFER, BYTE, ELEMENT_ARRAY_BUFFER, FLOAT, LIGHT, UNSIGNED_SHORT, begin, padded};
use crate::extract::meshopt::{MESHOPT, QUANTIZED, ViewError, Views, colored, exponential, octahedral};
use glam::{DVec3, I64Vec3, IVec3};
use kilwa_geometry::Sphere;
use serde_json::{Value, json};

/// Largest distance from the offset: 24 bits with a sign.
const REACH: i32 = (1 << 23) - 1;
/// Offsets are multiples of so many steps: 2 km in a grid of a millimetre. Floats move a vertex that is half as far away by an eighth of a step at most.
const CELL: i64 = 1 << 21;
/// The extension of glTF for surfaces whose colours contain the light.
const UNLIT: &str = "KHR_materials_unlit";

/// The mesh of a tile.
pub(super) struct Tile {
    /// Steps of the grid, relative to `offset`.
    points: Vec<IVec3>,
    offset: IVec3,
    /// Unit vectors, or none.
    normals: Vec<DVec3>,
    /// sRGB, or none.
    colors: Vec<[u8; 3]>,
    indices: Vec<u32>,
    grid_log2: i32,
}

/// An attribute of the vertices.
struct Attribute {
    name: &'static str,
    bytes: Vec<u8>,
    stride: usize,
    /// What the accessor says of type, range and bounds.
    accessor: Value,
    /// Of meshopt, in the profile `web`.
    filter: &'static str,
}

impl Tile {
    /// From points on the grid.
    ///
    /// # Errors
    /// If they are too far apart for floats.
    pub(super) fn new(
        mut points: Vec<IVec3>,
        normals: Vec<DVec3>,
        colors: Vec<[u8; 3]>,
        indices: Vec<u32>,
        grid_log2: i32,
    ) -> Result<Self, ExtractError> {
        let min = points.iter().copied().fold(IVec3::MAX, IVec3::min);
        let max = points.iter().copied().fold(IVec3::MIN, IVec3::max);
        let Some(offset) = offset(min, max) else {
            return Err(ExtractError::Numbers("a tile is too wide for 32-bit floats".to_owned()));
        };
        for p in &mut points {
            *p -= offset;
        }
        Ok(Self { points, offset, normals, colors, indices, grid_log2 })
    }

    pub(super) fn triangles(&self) -> usize {
        self.indices.len() / 3
    }

    pub(super) fn vertices(&self) -> usize {
        self.points.len()
    }

    /// Round its vertices, metres in the frame.
    pub(super) fn sphere(&self) -> Sphere {
        let spacing = libm::scalbn(1.0, self.grid_log2);
        let ball = Sphere::of(&self.points);
        Sphere { center: (ball.center + self.offset.as_dvec3()) * spacing, radius: ball.radius * spacing }
    }

    /// The file; `error` is certified, in metres.
    ///
    /// # Errors
    /// If meshopt fails.
    pub(super) fn bytes(&self, profile: Profile, error: f64) -> Result<Vec<u8>, ExtractError> {
        match profile {
            Profile::Web => self.compressed(error),
            Profile::Plain => self.plain(error),
        }
    }

    /// Steps of the grid, y up.
    fn y_up(p: IVec3) -> [i32; 3] {
        [p.x, p.z, -p.y]
    }

    fn bounds(&self) -> [[f64; 3]; 2] {
        let spacing = libm::scalbn(1.0, self.grid_log2);
        let turned = || self.points.iter().map(|p| IVec3::from(Self::y_up(*p)));
        let (min, max) = (turned().fold(IVec3::MAX, IVec3::min), turned().fold(IVec3::MIN, IVec3::max));
        [min, max].map(|p| (p.as_dvec3() * spacing).to_array())
    }

    fn positions(&self, filtered: bool) -> Attribute {
        let [min, max] = self.bounds();
        let mut bytes = Vec::with_capacity(self.points.len() * 12);
        for x in self.points.iter().flat_map(|p| Self::y_up(*p)) {
            if filtered {
                bytes.extend(exponential(x, self.grid_log2 as i8));
            } else {
                bytes.extend((libm::scalbn(f64::from(x), self.grid_log2) as f32).to_le_bytes());
            }
        }
        let accessor = json!({"componentType": FLOAT, "type": "VEC3", "min": min, "max": max});
        Attribute { name: "POSITION", bytes, stride: 12, accessor, filter: "EXPONENTIAL" }
    }

    fn colors(&self, profile: Profile) -> Result<Option<Attribute>, ExtractError> {
        if self.colors.is_empty() {
            return Ok(None);
        }
        let (bytes, stride, accessor) = match profile {
            Profile::Plain => {
                let light = |[r, g, b]: [u8; 3]| [r, g, b].map(|level| LIGHT[usize::from(level)]);
                let four = self.colors.iter().flat_map(|color| light(*color).into_iter().chain([0]));
                let bytes = four.flat_map(u16::to_le_bytes).collect();
                (bytes, 8, json!({"componentType": UNSIGNED_SHORT, "normalized": true, "type": "VEC3"}))
            }
            Profile::Web => {
                let bytes = colored(&self.colors).map_err(ViewError::Encode).map_err(failed)?;
                (bytes, 12, json!({"componentType": FLOAT, "type": "VEC3"}))
            }
        };
        Ok(Some(Attribute { name: "COLOR_0", bytes, stride, accessor, filter: "EXPONENTIAL" }))
    }

    fn normals(&self, profile: Profile) -> Result<Option<Attribute>, ExtractError> {
        if self.normals.is_empty() {
            return Ok(None);
        }
        let turned = self.normals.iter().map(|n| [n.x as f32, n.z as f32, -n.y as f32]);
        let (bytes, stride, accessor) = match profile {
            Profile::Plain => {
                let bytes = turned.flatten().flat_map(f32::to_le_bytes).collect();
                (bytes, 12, json!({"componentType": FLOAT, "type": "VEC3"}))
            }
            Profile::Web => {
                let bytes = octahedral(&turned.collect::<Vec<_>>()).map_err(ViewError::Encode).map_err(failed)?;
                (bytes, 4, json!({"componentType": BYTE, "normalized": true, "type": "VEC3"}))
            }
        };
        Ok(Some(Attribute { name: "NORMAL", bytes, stride, accessor, filter: "OCTAHEDRAL" }))
    }

    fn compressed(&self, error: f64) -> Result<Vec<u8>, ExtractError> {
        let (colors, normals) = (self.colors(Profile::Web)?, self.normals(Profile::Web)?);
        let is_quantized = normals.is_some();
        let (mut file, mut views) = (self.file(error), Views::new(Vec::new()));
        for attribute in [Some(self.positions(true)), colors, normals].into_iter().flatten() {
            let Attribute { name, bytes, stride, mut accessor, filter } = attribute;
            let count = self.points.len();
            accessor["bufferView"] = json!(views.vertices(&bytes, count, stride, filter).map_err(failed)?);
            accessor["count"] = json!(count);
            add(&mut file, name, accessor);
        }
        let view = views.triangles(&self.indices).map_err(failed)?;
        self.add_indices(&mut file, view);
        views.describe(&mut file);
        let mut required = vec![MESHOPT];
        if is_quantized {
            required.push(QUANTIZED);
        }
        file["extensionsRequired"] = json!(required);
        if !self.colors.is_empty() {
            required.push(UNLIT);
        }
        file["extensionsUsed"] = json!(required);
        if !self.colors.is_empty() {
            file["materials"][0]["extensions"] = json!({UNLIT: {}});
        }
        glb(&file, &views.out)
    }

    fn plain(&self, error: f64) -> Result<Vec<u8>, ExtractError> {
        let mut file = self.file(error);
        let (colors, normals) = (self.colors(Profile::Plain)?, self.normals(Profile::Plain)?);
        let attributes: Vec<Attribute> = [Some(self.positions(false)), normals, colors].into_iter().flatten().collect();
        let stride: usize = attributes.iter().map(|a| a.stride).sum();
        let count = self.points.len();
        let mut binary = Vec::with_capacity(count * stride + self.indices.len() * 2 + 2);
        for v in 0..count {
            for a in &attributes {
                binary.extend(&a.bytes[v * a.stride..(v + 1) * a.stride]);
            }
        }
        push(
            &mut file,
            "bufferViews",
            json!({"buffer": 0, "byteLength": count * stride, "byteStride": stride, "target": ARRAY_BUFFER}),
        );
        let mut at = 0;
        for Attribute { name, stride, mut accessor, .. } in attributes {
            accessor["count"] = json!(count);
            accessor["byteOffset"] = json!(at);
            accessor["bufferView"] = json!(0);
            at += stride;
            add(&mut file, name, accessor);
        }
        let view = json!({"buffer": 0, "byteOffset": binary.len(), "byteLength": self.indices.len() * 2,
            "target": ELEMENT_ARRAY_BUFFER});
        push(&mut file, "bufferViews", view);
        binary.extend(self.indices.iter().flat_map(|i| (*i as u16).to_le_bytes()));
        binary.resize(binary.len().next_multiple_of(4), 0);
        self.add_indices(&mut file, 1);
        file["buffers"] = json!([{"byteLength": binary.len()}]);
        glb(&file, &binary)
    }

    fn add_indices(&self, file: &mut Value, view: usize) {
        let accessor =
            json!({"bufferView": view, "componentType": UNSIGNED_SHORT, "count": self.indices.len(), "type": "SCALAR"});
        let number = push(file, "accessors", accessor);
        file["meshes"][0]["primitives"][0]["indices"] = json!(number);
    }

    /// The parts that do not depend on the profile.
    fn file(&self, error: f64) -> Value {
        let spacing = libm::scalbn(1.0, self.grid_log2);
        let [x, y, z] = Self::y_up(self.offset).map(|x| f64::from(x) * spacing);
        json!({
            "asset": {"version": "2.0", "generator": format!("kilwa {}", env!("CARGO_PKG_VERSION"))},
            "extras": {"certified_error_m": error},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "translation": [x, y, z]}],
            "meshes": [{"primitives": [{"attributes": {}, "material": 0}]}],
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
            "accessors": [],
            "bufferViews": [],
        })
    }
}

/// The offset of a tile between two corners: the nearest multiple of [`CELL`], or the middle where positions relative to that have too many bits; `None` if
/// all have.
fn offset(min: IVec3, max: IVec3) -> Option<IVec3> {
    let (min, max) = (min.as_i64vec3(), max.as_i64vec3());
    let middle = (min + max) / 2;
    let nearest = (middle + CELL / 2).map(|x| x.div_euclid(CELL) * CELL);
    let fits = |offset: &I64Vec3| (max - offset).max(offset - min).max_element() <= i64::from(REACH);
    [nearest, middle].into_iter().filter(fits).find_map(|offset| IVec3::try_from(offset).ok())
}

fn failed(error: ViewError) -> ExtractError {
    match error {
        ViewError::Encode(error) => ExtractError::Encode(error.to_string()),
        ViewError::Write(error) => ExtractError::Encode(error.to_string()),
    }
}

/// Append to a list of the file; returns the number of what was appended.
fn push(file: &mut Value, list: &str, what: Value) -> usize {
    let Some(list) = file[list].as_array_mut() else { return 0 };
    list.push(what);
    list.len() - 1
}

/// Add an attribute by its accessor.
fn add(file: &mut Value, name: &str, accessor: Value) {
    let number = push(file, "accessors", accessor);
    file["meshes"][0]["primitives"][0]["attributes"][name] = json!(number);
}

/// The file with its two parts.
///
/// # Errors
/// If it were longer than its format allows; tiles are far from that.
fn glb(file: &Value, binary: &[u8]) -> Result<Vec<u8>, ExtractError> {
    let (json, mut out) = (padded(file), Vec::with_capacity(binary.len()));
    begin(&mut out, &json, binary.len() as u64).map_err(|e| ExtractError::Encode(e.to_string()))?;
    out.extend(binary);
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_share_an_offset_and_wide_ones_fit() {
        let cell = CELL as i32;
        let around = |x: i32, half: i32| offset(IVec3::new(x - half, 0, -7), IVec3::new(x + half, 9, 7)).map(|o| o.x);
        for x in [-cell / 2, -12_345, 0, 9, cell / 2 - 1] {
            assert_eq!(around(x, 100), Some(0));
        }
        assert_eq!((around(cell / 2, 5), around(-cell / 2 - 1, 5)), (Some(cell), Some(-cell)));
        // 24 bits: about the middle if need be, and no more.
        assert_eq!((around(700, REACH - 700), around(700, REACH), around(0, REACH + 1)), (Some(0), Some(700), None));
        let edge = i32::MAX - 10;
        assert_eq!(around(edge, 5), Some(edge));
    }
}
