//! The parts of glTF 2.0 JSON that carry a surface and its colours, as the specification names them (Khronos, "glTF 2.0
//! Specification", section 5). All else in the file is not looked at, so that damage there refuses nothing.
//!
//! The types are our own because those of the crate `gltf-json` have f32 transforms, cut indices to 32 bits and take several times
//! the memory; three tests beside this file fail with them.
//!
//! What few elements have is boxed: a file may have millions of elements of which each is two bytes of text. What they take
//! in memory is known before they are read (`tally`).

use super::tally::LARGEST_ELEMENT;
use serde::de::{IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::marker::PhantomData;

const _: () = {
    assert!(size_of::<Accessor>() <= LARGEST_ELEMENT && size_of::<Buffer>() <= LARGEST_ELEMENT);
    assert!(size_of::<View>() <= LARGEST_ELEMENT && size_of::<Image>() <= LARGEST_ELEMENT);
    assert!(size_of::<Material>() <= LARGEST_ELEMENT && size_of::<Mesh>() <= LARGEST_ELEMENT);
    assert!(size_of::<Primitive>() <= LARGEST_ELEMENT && size_of::<Node>() <= LARGEST_ELEMENT);
    assert!(size_of::<Sampler>() <= LARGEST_ELEMENT && size_of::<Scene>() <= LARGEST_ELEMENT);
    assert!(size_of::<Texture>() <= LARGEST_ELEMENT && size_of::<String>() <= LARGEST_ELEMENT);
    // What is boxed is an object of its own in the text.
    assert!(size_of::<Sparse>() <= 3 * LARGEST_ELEMENT && size_of::<Meshopt>() <= 3 * LARGEST_ELEMENT);
    assert!(size_of::<Pbr>() <= 3 * LARGEST_ELEMENT && size_of::<SpecularGlossiness>() <= 3 * LARGEST_ELEMENT);
};

/// The version, which identifies glTF 2.0, read before the rest.
#[derive(Deserialize)]
pub(super) struct Head {
    pub(super) asset: Option<Asset>,
    /// A 3D Tiles tileset has this.
    #[serde(rename = "geometricError")]
    pub(super) geometric_error: Option<IgnoredAny>,
    #[serde(rename = "extensionsRequired", default)]
    pub(super) extensions_required: Vec<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub(super) version: String,
    pub(super) min_version: Option<String>,
}

#[derive(Deserialize)]
pub(super) struct Root {
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) animations: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) buffers: Vec<Buffer>,
    #[serde(default, rename = "bufferViews")]
    pub(super) views: Vec<View>,
    #[serde(default)]
    pub(super) images: Vec<Image>,
    #[serde(default)]
    pub(super) materials: Vec<Material>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) samplers: Vec<Sampler>,
    pub(super) scene: Option<usize>,
    #[serde(default)]
    pub(super) extensions: RootExtensions,
    #[serde(default)]
    pub(super) scenes: Vec<Scene>,
    #[serde(default)]
    pub(super) textures: Vec<Texture>,
}

#[derive(Deserialize, Default)]
pub(super) struct RootExtensions {
    #[serde(rename = "CESIUM_RTC")]
    pub(super) rtc: Option<Rtc>,
}

/// Positions are relative to a centre: an extension of glTF 1.0, but still written in 3D Tiles.
#[derive(Deserialize)]
pub(super) struct Rtc {
    pub(super) center: [f64; 3],
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
    pub(super) count: u64,
    #[serde(default)]
    pub(super) normalized: bool,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Box<Sparse>>,
}

#[derive(Deserialize)]
pub(super) struct Sparse {
    pub(super) count: u64,
    pub(super) indices: SparseIndices,
    pub(super) values: SparseValues,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseIndices {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) component_type: u32,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SparseValues {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
}

#[derive(Deserialize)]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct View {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: Option<u64>,
    #[serde(default)]
    pub(super) extensions: ViewExtensions,
}

#[derive(Deserialize, Default)]
pub(super) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    pub(super) ext_meshopt: Option<Box<Meshopt>>,
    #[serde(rename = "KHR_meshopt_compression")]
    pub(super) khr_meshopt: Option<Box<Meshopt>>,
}

/// `EXT_meshopt_compression` and `KHR_meshopt_compression` have the same properties.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Meshopt {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: u64,
    pub(super) byte_length: u64,
    pub(super) byte_stride: u64,
    pub(super) count: u64,
    pub(super) mode: String,
    pub(super) filter: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Image {
    pub(super) uri: Option<String>,
    pub(super) buffer_view: Option<usize>,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase")]
pub(super) struct Material {
    pub(super) pbr_metallic_roughness: Option<Box<Pbr>>,
    #[serde(default)]
    pub(super) extensions: MaterialExtensions,
}

#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase")]
pub(super) struct Pbr {
    pub(super) base_color_factor: Option<[f64; 4]>,
    pub(super) base_color_texture: Option<TextureInfo>,
}

#[derive(Deserialize, Default)]
pub(super) struct MaterialExtensions {
    #[serde(rename = "KHR_materials_pbrSpecularGlossiness")]
    pub(super) specular_glossiness: Option<Box<SpecularGlossiness>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct SpecularGlossiness {
    pub(super) diffuse_factor: Option<[f64; 4]>,
    pub(super) diffuse_texture: Option<TextureInfo>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureInfo {
    pub(super) index: usize,
    #[serde(default)]
    pub(super) tex_coord: u32,
    #[serde(default)]
    pub(super) extensions: TextureInfoExtensions,
}

#[derive(Deserialize, Default)]
pub(super) struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub(super) transform: Option<TextureTransform>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextureTransform {
    #[serde(default)]
    pub(super) offset: [f64; 2],
    #[serde(default)]
    pub(super) rotation: f64,
    #[serde(default = "ones")]
    pub(super) scale: [f64; 2],
    pub(super) tex_coord: Option<u32>,
}

fn ones() -> [f64; 2] {
    [1.0; 2]
}

#[derive(Deserialize)]
pub(super) struct Mesh {
    pub(super) primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
pub(super) struct Primitive {
    pub(super) attributes: Attributes<usize>,
    pub(super) indices: Option<usize>,
    pub(super) material: Option<usize>,
    #[serde(default = "triangles")]
    pub(super) mode: u32,
    #[serde(default)]
    pub(super) targets: Vec<IgnoredAny>,
    #[serde(default)]
    pub(super) extensions: PrimitiveExtensions,
}

/// Numbers by the names of attributes, those that are read: positions, normals, colours and texture coordinates.
pub(super) struct Attributes<T>(Vec<(Box<str>, T)>);

impl<T> Attributes<T> {
    /// The number of an attribute.
    pub(super) fn get(&self, name: &str) -> Option<&T> {
        self.0.iter().find(|(own, _)| **own == *name).map(|(_, number)| number)
    }

    /// Whether there is such an attribute.
    pub(super) fn contains_key(&self, name: &str) -> bool {
        self.get(name).is_some()
    }
}

/// Sets of texture coordinates that are kept.
const SETS: usize = 16;

impl<'de, T: Deserialize<'de>> Deserialize<'de> for Attributes<T> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Names<T>(PhantomData<T>);
        impl<'de, T: Deserialize<'de>> Visitor<'de> for Names<T> {
            type Value = Attributes<T>;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an object of attributes")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Self::Value, A::Error> {
                let mut kept: Vec<(Box<str>, T)> = Vec::new();
                while let Some(name) = map.next_key::<String>()? {
                    let number = map.next_value()?;
                    let set = name.strip_prefix("TEXCOORD_").is_some_and(|set| set.parse::<u32>().is_ok());
                    if !set && !matches!(name.as_str(), "POSITION" | "NORMAL" | "COLOR_0") {
                        continue;
                    }
                    // As with a map, the last of one name counts.
                    if let Some((_, old)) = kept.iter_mut().find(|(own, _)| **own == *name) {
                        *old = number;
                    } else if kept.len() < SETS + 3 {
                        kept.push((name.into(), number));
                    }
                }
                Ok(Attributes(kept))
            }
        }
        from.deserialize_map(Names(PhantomData))
    }
}

fn triangles() -> u32 {
    4
}

#[derive(Deserialize, Default)]
pub(super) struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub(super) draco: Option<Box<Draco>>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Draco {
    pub(super) buffer_view: usize,
    pub(super) attributes: Attributes<u32>,
}

#[derive(Deserialize)]
pub(super) struct Node {
    #[serde(default)]
    pub(super) children: Vec<usize>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) mesh: Option<usize>,
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) skin: Option<usize>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    #[serde(default)]
    pub(super) extensions: NodeExtensions,
}

#[derive(Deserialize, Default)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instancing: Option<IgnoredAny>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Sampler {
    pub(super) wrap_s: Option<u32>,
    pub(super) wrap_t: Option<u32>,
}

#[derive(Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

#[derive(Deserialize)]
pub(super) struct Texture {
    pub(super) sampler: Option<usize>,
    pub(super) source: Option<usize>,
    #[serde(default)]
    pub(super) extensions: TextureExtensions,
}

#[derive(Deserialize, Default)]
pub(super) struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp")]
    pub(super) webp: Option<TextureSource>,
}

#[derive(Deserialize)]
pub(super) struct TextureSource {
    pub(super) source: usize,
}
