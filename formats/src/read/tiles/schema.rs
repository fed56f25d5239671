//! The parts of a tileset's JSON that describe the tiles and their positions (OGC, "3D Tiles Specification 1.1", 22-025r4, section 7; 1.0 and its
//! drafts name some parts differently). Everything else is ignored, so errors there do not matter.

use super::super::gltf::OBJECT_BYTES;
use serde::Deserialize;
use serde::de::IgnoredAny;

// The memory estimate for the JSON assumes these sizes.
const _: () = assert!(size_of::<Tile>() <= OBJECT_BYTES && size_of::<Content>() <= OBJECT_BYTES);

/// One file.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Tileset {
    pub(super) asset: Asset,
    #[serde(default)]
    pub(super) extensions_required: Vec<String>,
    pub(super) root: Tile,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Asset {
    pub(super) version: String,
    /// The axis that points up in the glTF of tiles: from drafts of 1.0, but still written.
    pub(super) gltf_up_axis: Option<String>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Tile {
    /// In column-major order.
    pub(super) transform: Option<Box<[f64; 16]>>,
    pub(super) refine: Option<String>,
    /// Boxed, because memory is estimated by the size of elements of lists.
    content: Option<Box<Content>>,
    #[serde(default)]
    contents: Vec<Content>,
    #[serde(default)]
    pub(super) children: Vec<Tile>,
    implicit_tiling: Option<IgnoredAny>,
    extensions: Option<Box<Extensions>>,
}

/// The content of a tile. Drafts of 1.0 have `url`.
#[derive(Deserialize)]
pub(super) struct Content {
    uri: Option<String>,
    url: Option<String>,
}

#[derive(Deserialize)]
struct Extensions {
    #[serde(rename = "3DTILES_implicit_tiling")]
    implicit: Option<IgnoredAny>,
    #[serde(rename = "3DTILES_multiple_contents")]
    multiple: Option<Multiple>,
}

/// The extension of 1.0 that became `contents`; its drafts have `content`.
#[derive(Deserialize)]
struct Multiple {
    #[serde(default, alias = "content")]
    contents: Vec<Content>,
}

impl Content {
    /// The name, if there is one.
    pub(super) fn uri(&self) -> Option<&str> {
        self.uri.as_deref().or(self.url.as_deref())
    }
}

impl Tile {
    /// All its contents, with the names of the JSON properties.
    pub(super) fn contents(&self) -> impl Iterator<Item = (String, &Content)> {
        let one = self.content.iter().map(|content| ("content".to_owned(), &**content));
        let multiple = self.extensions.iter().filter_map(|e| e.multiple.as_ref()).flat_map(|m| &m.contents);
        let several = self.contents.iter().chain(multiple).enumerate();
        one.chain(several.map(|(i, content)| (format!("contents[{i}]"), content)))
    }

    /// Whether its descendants are defined by implicit tiling.
    pub(super) fn is_implicit(&self) -> bool {
        self.implicit_tiling.is_some() || self.extensions.as_ref().is_some_and(|e| e.implicit.is_some())
    }
}
