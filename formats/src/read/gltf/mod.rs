//! The reader of glTF 2.0 and GLB (Khronos, "glTF 2.0 Specification", 2021; ISO/IEC 12113).
//!
//! Stages: `container` (GLB or text) → `schema` (the JSON) → `scene` (which meshes stand where) → `primitive` (vertices
//! and triangles, through `accessor`, `buffers` and `draco`) → the sink. A mesh that several nodes show is delivered
//! once for each. Coordinates are metres and y points up by default.
//!
//! What is kept: positions in all types, with node transforms in f64 (a transform that mirrors turns its triangles
//! round); normals; colours: `COLOR_0` times the factor times the picture of the base colour, which are linear light,
//! as 8-bit sRGB. Vertices get the colour of the picture where they lie. Opacity is not kept.
//! Extensions: `KHR_mesh_quantization`, `EXT_meshopt_compression` and `KHR_meshopt_compression` with all filters,
//! `KHR_draco_mesh_compression`, `KHR_texture_transform`, `EXT_texture_webp`, base colours of
//! `KHR_materials_pbrSpecularGlossiness`. Others that the file requires are refused by name.
//!
//! Counted: points and lines left out; skins, morph targets and animations, of which the rest pose is taken; scenes
//! beside the default; pictures that cannot be read. Refused with the part of the file: indices and offsets that name
//! what does not exist, nodes in circles, streams that do not decode, files beside it that are missing; glTF 1.0.
//!
//! Triangles under pictures are split if requested (`detailed`).
//!
//! Memory: the JSON, blocks of constant size, exceptions of sparse accessors, compressed views and pictures decoded whole.

mod accessor;
mod buffers;
mod container;
mod detailed;
mod draco;
mod json;
mod material;
mod primitive;
mod scene;
mod schema;
mod sizes;
mod strip;
mod tally;
#[cfg(test)]
mod tests;
mod transform;

pub(super) use detailed::{Detailing, Nowhere};
pub use sizes::{Sizes, sizes};
pub(super) use tally::{LARGEST_ELEMENT as OBJECT_BYTES, Tally};

use super::companions::{Companions, Found, Reference};
use super::texture::detail::Detail;
use super::{Input, MeshSink, ReadError};
use buffers::Buffers;
use container::Container;
use glam::{DAffine3, DVec3};
use json::deserialize;
use kilwa_pack::visible::visible;
use material::Material;
use primitive::{Delivery, Known};
use schema::{Head, Root};
use serde::de::DeserializeOwned;
use std::path::Path;
use transform::Transform;

/// Extensions that a file may require: those that are read, and those that change neither surface nor base colour.
const KNOWN_EXTENSIONS: &[&str] = &[
    "CESIUM_RTC",
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_draco_mesh_compression",
    "KHR_texture_transform",
    "EXT_texture_webp",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_lights_punctual",
    "KHR_animation_pointer",
    "KHR_xmp",
    "KHR_xmp_json_ld",
];
const EXPORT: &str =
    "Export it again as plain glTF 2.0 (for example with `gltf-transform copy`), or as PLY with its colours";

/// What messages need.
struct Context<'a> {
    path: &'a Path,
    companions: &'a Companions<'a>,
    /// The format that the JSON should have, for messages.
    format: &'static str,
}

/// The format of a glTF's JSON, for messages.
const GLTF: &str = "glTF 2.0";

/// The placement of a scene that is part of a larger model.
pub(super) struct TilePlacement {
    /// From the coordinates of the tile, with z up, to those of the whole.
    pub(super) root_from_tile: DAffine3,
    /// Turns the scene so that z is up. `CESIUM_RTC`, which is given with z up, comes behind it.
    pub(super) tile_from_scene: DAffine3,
    /// Finds the files that the glTF refers to.
    pub(super) companions: Companions<'static>,
}

impl TilePlacement {
    /// From the coordinates of the scene to those of the whole, for positions that are relative to a centre.
    fn transform(&self, center: Option<DVec3>) -> Transform {
        let tile_from_centered = center.map_or(DAffine3::IDENTITY, DAffine3::from_translation);
        Transform::new(self.root_from_tile * tile_from_centered * self.tile_from_scene)
    }
}

/// What was delivered of a scene that is part of a larger whole.
pub(super) struct Stood {
    /// May be 0.
    pub(super) triangles: u64,
    /// Where the origins of its meshes are in the whole.
    pub(super) origins: Vec<DVec3>,
}

impl Context<'_> {
    /// The error for a part of the file.
    fn part(&self, part: String, found: String, expected: &str) -> ReadError {
        ReadError::Part { file: self.path.to_owned(), part, found, expected: expected.to_owned() }
    }

    /// The error for a version that is not read.
    fn version(&self, version: &str) -> ReadError {
        let needs = format!("is glTF {}; only glTF 2.0 is supported", visible(version));
        ReadError::Needs { file: self.path.to_owned(), needs, way_out: EXPORT }
    }
}

/// Whether a file that starts with these bytes is a glTF or a GLB.
pub fn is_gltf(start: &[u8], _total: u64) -> bool {
    if start.starts_with(container::MAGIC) {
        return true;
    }
    let text = without_mark(start).trim_ascii_start();
    let keys =
        ["\"asset\"", "\"accessors\"", "\"bufferViews\"", "\"buffers\"", "\"meshes\"", "\"scenes\"", "\"nodes\""];
    let has = |key: &str| text.windows(key.len()).any(|w| w == key.as_bytes());
    text.starts_with(b"{") && keys.iter().any(|key| has(key))
}

fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// Deliver the scene.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, of another version, needs what is not read, or shows no triangle; what the
/// sink says.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let detailing = input.options.detail.as_deref().map(|detail| Detailing { detail, notes: false });
    deliver(input, sink, detailing)
}

/// First pass of [`super::ReadOptions::detail`]: note how many texels the edges of the scene span.
///
/// # Errors
/// As [`read`].
pub fn note_detail(input: Input<'_>, detail: &Detail) -> Result<(), ReadError> {
    deliver(input, &mut Nowhere::default(), Some(Detailing { detail, notes: true }))
}

fn deliver(input: Input<'_>, sink: &mut dyn MeshSink, detailing: Option<Detailing<'_>>) -> Result<(), ReadError> {
    let path = input.path;
    let companions = Companions::of(path, input.options, input.archive);
    let delivered =
        deliver_at(input, sink, detailing, &companions, |center| center.map(Transform::relative_to_center))?;
    if delivered.triangles > 0 || detailing.is_some_and(|d| d.notes) {
        return Ok(());
    }
    let found = match (delivered.meshes, delivered.origins.as_slice()) {
        (0, _) => "it has no meshes".to_owned(),
        (1, []) => "its mesh is not in the scene".to_owned(),
        (n, []) => format!("none of its {n} meshes is in the scene"),
        _ => "its meshes are points, lines or empty".to_owned(),
    };
    Err(ReadError::NoTriangles {
        file: path.to_owned(),
        found,
        way_out: "Export the model again, with its surface as triangles",
    })
}

/// Deliver a scene that is part of a larger whole.
///
/// # Errors
/// As [`read`].
pub(super) fn deliver_placed(
    input: Input<'_>,
    sink: &mut dyn MeshSink,
    detailing: Option<Detailing<'_>>,
    standing: &TilePlacement,
) -> Result<Stood, ReadError> {
    let outer = |center| Some(standing.transform(center));
    let Delivered { triangles, origins, .. } = deliver_at(input, sink, detailing, &standing.companions, outer)?;
    Ok(Stood { triangles, origins })
}

/// Parse the JSON of another format that contains glTF files. The caller has checked that there is enough memory.
///
/// # Errors
/// [`ReadError::Part`] with the path to what is wrong.
pub(super) fn json_of<T: DeserializeOwned>(
    json: &[u8],
    path: &Path,
    companions: &Companions<'_>,
    format: &'static str,
) -> Result<T, ReadError> {
    deserialize(json, &Context { path, companions, format })
}

/// What was delivered from a file.
struct Delivered {
    triangles: u64,
    meshes: usize,
    /// Where the meshes in the scene stand.
    origins: Vec<DVec3>,
}

/// Deliver a scene; `outer` is what its nodes are moved by, given the centre of `CESIUM_RTC`.
fn deliver_at(
    input: Input<'_>,
    sink: &mut dyn MeshSink,
    detailing: Option<Detailing<'_>>,
    companions: &Companions<'_>,
    outer: impl FnOnce(Option<DVec3>) -> Option<Transform>,
) -> Result<Delivered, ReadError> {
    let Input { path, total, source, progress, options, .. } = input;
    let context = Context { path, companions, format: GLTF };
    let Container { json, binary, trailing } = container::open(source, total, options.document, &context)?;
    let root = parse(json, options.document, &context)?;
    refuse_pictures_outside(&root, &context)?;
    let diagnostics = sink.diagnostics();
    diagnostics.add_many("bytes behind the end that the header of the GLB gives left out", trailing);
    diagnostics.add_many("animations left out; the rest pose is taken", root.animations.len() as u64);
    let mut placed = scene::placed(&root, diagnostics, &context)?;
    if let Some(outer) = outer(root.extensions.rtc.as_ref().map(|rtc| rtc.center.into())) {
        for place in &mut placed {
            place.transform = outer.after(&place.transform);
        }
    }
    let mut in_scene = vec![false; root.meshes.len()];
    for place in &placed {
        in_scene[place.mesh] = true;
    }
    let unused = in_scene.iter().filter(|used| !**used).count();
    diagnostics.add_many("meshes that do not stand in the scene left out", unused as u64);

    let buffers = Buffers::new(source, total, binary, &root, options.document, progress);
    let colored = is_colored(&root, &in_scene, &context)?;
    let mut delivery =
        Delivery::new(&root, buffers, sink, Context { path, companions, format: GLTF }, colored, options, detailing);
    for place in &placed {
        let mut known = Known::new();
        for (number, primitive) in root.meshes[place.mesh].primitives.iter().enumerate() {
            let part = format!("meshes[{}].primitives[{number}]", place.mesh);
            delivery.primitive(primitive, &part, &place.transform, &mut known)?;
        }
    }
    delivery.count_pictures();
    delivery.buffers.finish();
    let origins = placed.iter().map(|place| place.transform.point(DVec3::ZERO)).collect();
    Ok(Delivered { triangles: delivery.triangles(), meshes: root.meshes.len(), origins })
}

/// Refuse pictures that lie outside of the folder. Those that are missing are left out when they are needed.
fn refuse_pictures_outside(root: &Root, context: &Context<'_>) -> Result<(), ReadError> {
    for (number, image) in root.images.iter().enumerate() {
        if let (Some(uri), None) = (&image.uri, image.buffer_view)
            && !buffers::is_data(uri)
        {
            let place = format!("images[{number}]");
            if let Found::Outside(target) = buffers::find(uri, context) {
                let by = Reference { file: context.path, place: &place, name: uri };
                return Err(context.companions.refusal(&by, target));
            }
        }
    }
    Ok(())
}

/// Read the JSON: the version first, because other versions have another form.
fn parse(mut json: Vec<u8>, max: u64, context: &Context<'_>) -> Result<Root, ReadError> {
    // Some writers pad the JSON chunk with zeros instead of spaces.
    json.truncate(json.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1));
    if without_mark(&json).len() < json.len() {
        json.drain(..json.len() - without_mark(&json).len());
    }
    tally::check(&json, max, context)?;
    let head: Head = deserialize(&json, context)?;
    let needs = |needs: String, way_out| ReadError::Needs { file: context.path.to_owned(), needs, way_out };
    if head.geometric_error.is_some() {
        let way_out = "Give the mesh that the tiles were made of";
        return Err(needs("is a tileset of 3D Tiles and has no mesh of its own".to_owned(), way_out));
    }
    let Some(asset) = head.asset else {
        return Err(context.part(
            "asset".to_owned(),
            "nothing".to_owned(),
            "the version of glTF, which every file has",
        ));
    };
    for version in [Some(&asset.version), asset.min_version.as_ref()].into_iter().flatten() {
        let major = version.split('.').next().unwrap_or_default();
        let too_new = asset.min_version.as_ref() == Some(version) && version != "2.0";
        if major != "2" || too_new {
            return Err(context.version(version));
        }
    }
    let unknown: Vec<&str> =
        head.extensions_required.iter().map(String::as_str).filter(|name| !KNOWN_EXTENSIONS.contains(name)).collect();
    if !unknown.is_empty() {
        let shown = |n: &&str| visible(&n.chars().take(60).collect::<String>()).into_owned();
        let names: Vec<String> = unknown.iter().take(5).map(shown).collect();
        return Err(needs(format!("requires glTF extensions that are not read: {}", names.join(", ")), EXPORT));
    }
    let refusal = match deserialize(&json, context) {
        Ok(root) => return Ok(root),
        Err(refusal) => refusal,
    };
    let whole = json::with_whole_numbers(&json);
    // Both forms are not held while one of them is parsed.
    drop(json);
    let Some(json) = whole else { return Err(refusal) };
    deserialize(&json, context).map_err(|_| refusal)
}

/// Whether anything in the scene has a colour that is not white.
fn is_colored(root: &Root, in_scene: &[bool], context: &Context<'_>) -> Result<bool, ReadError> {
    for (number, mesh) in root.meshes.iter().enumerate().filter(|(i, _)| in_scene[*i]) {
        for (i, primitive) in mesh.primitives.iter().enumerate() {
            let part = format!("meshes[{number}].primitives[{i}]");
            let white = Material::of(root, primitive, &part, context)?.is_white();
            if !white || primitive.attributes.contains_key("COLOR_0") {
                return Ok(true);
            }
        }
    }
    Ok(false)
}
