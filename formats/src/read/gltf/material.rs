//! What colours a primitive: the linear factor of its material, its texture, and where on the texture its vertices lie.

use super::super::ReadError;
use super::super::texture::Wrap;
use super::Context;
use super::schema::{Primitive, Root, TextureInfo};
use glam::{DAffine2, DVec2, DVec3};

/// The colour of a material.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Material {
    /// Linear red, green and blue.
    pub(super) factor: DVec3,
    pub(super) texture: Option<Texture>,
}

/// A texture as a material uses it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Texture {
    /// Number of the image in the file.
    pub(super) image: usize,
    /// The attribute with the coordinates.
    pub(super) attribute: String,
    /// From coordinates of the file to places on the picture.
    pub(super) picture_from_uv: DAffine2,
    /// What lies outside 0 to 1.
    pub(super) wrap: [Wrap; 2],
}

/// By the code of OpenGL that the file has.
fn wrap(code: Option<u32>) -> Wrap {
    match code {
        Some(33071) => Wrap::Clamp,
        Some(33648) => Wrap::Mirror,
        _ => Wrap::Repeat,
    }
}

impl Material {
    const WHITE: Self = Self { factor: DVec3::ONE, texture: None };

    /// Of a primitive. A material that has no metallic-roughness values may have those of the older extension.
    pub(super) fn of(root: &Root, primitive: &Primitive, part: &str, context: &Context<'_>) -> Result<Self, ReadError> {
        let Some(index) = primitive.material else { return Ok(Self::WHITE) };
        let Some(material) = root.materials.get(index) else {
            let found = format!("materials[{index}], but there are {}", root.materials.len());
            return Err(context.part(part.to_owned(), found, "a material of this file"));
        };
        let (factor, info) = match (&material.pbr_metallic_roughness, &material.extensions.specular_glossiness) {
            (_, Some(older)) => (older.diffuse_factor, older.diffuse_texture.as_ref()),
            (Some(pbr), None) => (pbr.base_color_factor, pbr.base_color_texture.as_ref()),
            (None, None) => (None, None),
        };
        let [r, g, b, _] = factor.unwrap_or([1.0; 4]);
        let texture = match info {
            Some(info) => Texture::of(root, info, index, context)?,
            None => None,
        };
        Ok(Self { factor: DVec3::new(r, g, b), texture })
    }

    /// Whether it is white throughout.
    pub(super) fn is_white(&self) -> bool {
        self.factor == DVec3::ONE && self.texture.is_none()
    }
}

impl Texture {
    /// Where on the picture coordinates of the file lie.
    pub(super) fn place(&self, uv: DVec2) -> DVec2 {
        self.picture_from_uv.transform_point2(uv)
    }

    /// `None` where the texture has no image that is read.
    fn of(root: &Root, info: &TextureInfo, material: usize, context: &Context<'_>) -> Result<Option<Self>, ReadError> {
        let part = || format!("materials[{material}]");
        let Some(texture) = root.textures.get(info.index) else {
            let found = format!("textures[{}], but there are {}", info.index, root.textures.len());
            return Err(context.part(part(), found, "a texture of this file"));
        };
        let webp = texture.extensions.webp.as_ref().map(|w| w.source);
        let Some(image) = webp.or(texture.source) else { return Ok(None) };
        if image >= root.images.len() {
            let found = format!("images[{image}], but there are {}", root.images.len());
            return Err(context.part(format!("textures[{}]", info.index), found, "an image of this file"));
        }
        let sampler = match texture.sampler {
            None => None,
            Some(index) => Some(root.samplers.get(index).ok_or_else(|| {
                let found = format!("samplers[{index}], but there are {}", root.samplers.len());
                context.part(format!("textures[{}]", info.index), found, "a sampler of this file")
            })?),
        };
        let wrap = [sampler.and_then(|s| s.wrap_s), sampler.and_then(|s| s.wrap_t)].map(wrap);
        let mut set = info.tex_coord;
        let mut picture_from_uv = DAffine2::IDENTITY;
        if let Some(t) = &info.extensions.transform {
            set = t.tex_coord.unwrap_or(set);
            // KHR_texture_transform: translation after rotation after scale, v pointing down.
            let (sin, cos) = libm::sincos(t.rotation);
            let [u, v] = t.scale;
            picture_from_uv =
                DAffine2::from_cols(DVec2::new(cos * u, -sin * u), DVec2::new(sin * v, cos * v), t.offset.into());
        }
        Ok(Some(Self { image, attribute: format!("TEXCOORD_{set}"), picture_from_uv, wrap }))
    }
}
