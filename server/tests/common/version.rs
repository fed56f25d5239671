//! Versions as `kilwa publish` sends them, and the responses of the server.

use super::{Answer, pack_in};
use kilwa_archive::Metadata;
use kilwa_archive::checksums::sha256;
use kilwa_server::upload::wire::{AnnouncedFile, AnnouncedPreview, Drawing, FORM, Intent, Status};

/// The status in a response; a refusal without a state counts as refused.
pub(crate) fn status(answer: &Answer) -> Status {
    serde_json::from_slice(&answer.body).unwrap_or_else(|_| {
        let value: serde_json::Value = serde_json::from_slice(&answer.body).unwrap_or_default();
        let error = value["error"].as_str().map(str::to_owned);
        let refused = serde_json::json!({ "state": "refused", "version": 0, "error": error });
        serde_json::from_value(refused).unwrap()
    })
}

/// A version to be published, with its files.
pub(crate) struct Version {
    pub(crate) intent: Intent,
    pub(crate) files: Vec<Vec<u8>>,
}

pub(crate) const METADATA: &str =
    "title = \"Fort\"\nslug = \"fort\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n";

/// In local coordinates.
pub(crate) fn fort_pack() -> Vec<u8> {
    pack_in("fort", None)
}

impl Version {
    pub(crate) fn new(slug: &str, number: u32, pack: Vec<u8>) -> Self {
        let mut metadata = Metadata::parse(METADATA).unwrap();
        metadata.slug = Some(slug.to_owned());
        let glb = {
            // One triangle at full detail.
            let json = "{\"accessors\":[{\"count\":3}],\"asset\":{\"version\":\"2.0\"},\"extras\":{\"certified_error_m\":0.0},\
                        \"meshes\":[{\"primitives\":[{\"indices\":0}]}]}";
            let json = format!("{json:<width$}", width = json.len().next_multiple_of(4));
            let mut bytes = b"glTF".to_vec();
            for word in [2, 20 + json.len() as u32, json.len() as u32, 0x4e4f_534a] {
                bytes.extend_from_slice(&word.to_le_bytes());
            }
            bytes.extend_from_slice(json.as_bytes());
            bytes
        };
        let mut version = Self {
            intent: Intent {
                kilwa_upload: FORM,
                slug: slug.to_owned(),
                version: number,
                published: "2026-11-21".to_owned(),
                note: "As it is".to_owned(),
                location_redacted: false,
                location_cell: None,
                kept_channels: Vec::new(),
                same_object: false,
                metadata,
                preview: Some(AnnouncedPreview { triangles: 1, error: 0.0 }),
                drawings: vec![Drawing { path: "drawings/plan.png".to_owned(), words: "Plan, 1:100".to_owned() }],
                files: Vec::new(),
            },
            files: Vec::new(),
        };
        let name = format!("pack.{}.kilwa", sha256(&pack));
        version.add(&name, pack);
        for (i, poster) in ["poster.jpg", "poster-600.jpg", "poster-300.jpg"].iter().enumerate() {
            version.add(poster, [b"\xff\xd8\xff\xe0JPEG", &[i as u8][..]].concat());
        }
        version.add("drawings/plan.png", b"\x89PNG\r\n\x1a\n....".to_vec());
        version.add("preview.glb", glb);
        version
    }

    pub(crate) fn add(&mut self, path: &str, bytes: Vec<u8>) {
        let file = AnnouncedFile { path: path.to_owned(), bytes: bytes.len() as u64, sha256: sha256(&bytes) };
        self.intent.files.push(file);
        self.files.push(bytes);
    }

    pub(crate) fn bytes(&self, wanted: &str) -> Vec<u8> {
        let at = self.intent.files.iter().position(|f| f.sha256 == wanted).unwrap();
        self.files[at].clone()
    }
}
