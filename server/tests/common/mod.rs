//! A site over a temporary folder, driven without a socket.

#![allow(dead_code, reason = "each test program uses a part of it")]

mod log;
pub(crate) mod version;

pub(crate) use log::LogCapture;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{HeaderMap, Request, StatusCode};
use glam::DVec3;
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_archive::manifest::{
    Access, AccessState, FORM, Figures, FileEntry, Manifest, PackEntry, RightsEntry, Version,
};
use kilwa_geometry::{Aabb, Lattice, Sphere};
use kilwa_pack::chunk::encode;
use kilwa_pack::{Attributes, Chunk, DirectoryEntry, Header, Metadata, NO_DIAMOND, PackWriter, PatchRange};
use kilwa_server::{Catalogue, Page, Site, app};
use std::path::Path;
use std::time::Duration;
use tower::ServiceExt as _;

/// A page of a few small files.
pub(crate) fn page() -> Page {
    let html = "<!doctype html><html lang=\"en\"><head><base href=\"./\"><title>Kilwa</title></head>\
        <body data-pack=\"\" data-list=\"\"><h1><!--title--></h1><!--poster--><!--about--><!--facts--></body></html>";
    let files = [
        ("index.html", html.as_bytes()),
        ("boot.js", b"export {};".as_slice()),
        ("boot.js.gz", b"(gzip)".as_slice()),
        ("i18n/sw.json", b"{}".as_slice()),
        ("i18n/sw.json.br", b"(brotli)".as_slice()),
        ("i18n/sw.json.gz", b"(gzip)".as_slice()),
        ("viewer_bg.wasm", b"\0asm".as_slice()),
    ];
    Page::from_files(files.into_iter().map(|(n, b)| (n.to_owned(), b.to_vec())).collect())
}

/// The site over a folder or a file.
pub(crate) fn site(path: &Path) -> Router {
    app(Site::new(Catalogue::open(path).expect("a readable folder"), page()))
}

/// The same, looking at the folder again for every request.
pub(crate) fn fresh_site(path: &Path) -> Router {
    app(Site::new(fresh(path), page()))
}

/// A catalogue that looks at its folder again for every request.
pub(crate) fn fresh(path: &Path) -> Catalogue {
    Catalogue::open_fresh(path, Duration::ZERO).expect("a readable folder")
}

/// A reproducible file of no particular content.
pub(crate) fn noise(length: usize, seed: u64) -> Vec<u8> {
    let mut random = fastrand::Rng::with_seed(seed);
    let rest = std::iter::repeat_with(|| random.u8(..));
    kilwa_pack::header::MAGIC.into_iter().chain(rest).take(length).collect()
}

/// One answer, read to its end.
pub(crate) struct Answer {
    pub(crate) status: StatusCode,
    pub(crate) headers: HeaderMap,
    pub(crate) body: Bytes,
}

impl Answer {
    pub(crate) async fn of(response: axum::response::Response) -> Self {
        let (parts, body) = response.into_parts();
        let body = axum::body::to_bytes(body, usize::MAX).await.unwrap();
        Self { status: parts.status, headers: parts.headers, body }
    }

    pub(crate) fn header(&self, name: &str) -> &str {
        self.headers.get(name).and_then(|v| v.to_str().ok()).unwrap_or("")
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

/// Ask.
pub(crate) async fn ask(app: &Router, method: &str, uri: &str, headers: &[(&str, &str)]) -> Answer {
    let mut request = Request::builder().method(method).uri(uri);
    for (name, value) in headers {
        request = request.header(*name, *value);
    }
    Answer::of(app.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap()).await
}

/// GET without further headers.
pub(crate) async fn get(app: &Router, uri: &str) -> Answer {
    ask(app, "GET", uri, &[]).await
}

/// A valid pack of one triangle.
pub(crate) fn pack(title: &str) -> Vec<u8> {
    pack_in(title, Some("EPSG:32737"))
}

/// The same, in a reference system or none.
pub(crate) fn pack_in(title: &str, crs: Option<&str>) -> Vec<u8> {
    pack_at(title, crs, DVec3::ZERO, &[])
}

/// The same with its lattice at `origin`, metres, and scalar channels: name and the values of the three vertices.
pub(crate) fn pack_at(title: &str, crs: Option<&str>, origin: DVec3, channels: &[(&str, [f32; 3])]) -> Vec<u8> {
    pack_from(title, crs, origin, channels, Vec::new())
}

/// The same that names the files that it was made from.
pub(crate) fn pack_from(
    title: &str,
    crs: Option<&str>,
    origin: DVec3,
    channels: &[(&str, [f32; 3])],
    sources: Vec<kilwa_pack::metadata::SourceFile>,
) -> Vec<u8> {
    let attributes = Attributes { colors: true, scalars: channels.len() as u8 };
    let mut chunk = Chunk::default();
    chunk.mesh.positions = [[0, 0, 0], [1000, 0, 0], [0, 800, 400]].map(Into::into).to_vec();
    chunk.mesh.normals = vec![[0, 0]; 3];
    chunk.mesh.colors = vec![[200, 190, 170]; 3];
    chunk.mesh.scalars = channels.iter().map(|(_, values)| values.to_vec()).collect();
    chunk.mesh.triangles = vec![[0, 1, 2]];
    chunk.mesh.borders = vec![7];
    chunk.patches = vec![PatchRange { first: 0, count: 1, diamond: NO_DIAMOND }];
    let encoded = encode(&chunk, attributes).unwrap();
    let lattice = Lattice { origin, step_log2: -10 };
    let step = lattice.step();
    let bounds = Aabb::of(&chunk.mesh.positions);
    let entry = DirectoryEntry {
        offset: 0,
        encoded_bytes: encoded.len() as u32,
        vertices: 3,
        triangles: 1,
        level: 0,
        error: f32::INFINITY,
        color_error: 0.0,
        sphere: Sphere { center: [500.0, 400.0, 200.0].into(), radius: 900.0 },
        bounds,
        parents: [NO_DIAMOND; 4],
        checksum: kilwa_pack::checksum(&encoded),
        children: None,
    };
    let header = Header::new(lattice, 10, 1, attributes);
    let metadata = Metadata {
        title: title.to_owned(),
        source_units: "m".to_owned(),
        source_up: "z".to_owned(),
        crs: crs.map(str::to_owned),
        lattice_step: step,
        bounds_min: origin,
        bounds_max: origin + DVec3::new(1000.0, 800.0, 400.0) * step,
        median_edge: 0.02,
        triangles: 1,
        vertices: 3,
        border_edges: 3,
        scalars: channels
            .iter()
            .map(|(name, v)| kilwa_pack::ScalarChannel {
                name: (*name).to_owned(),
                min: v.iter().copied().fold(f32::INFINITY, f32::min),
                max: v.iter().copied().fold(f32::NEG_INFINITY, f32::max),
            })
            .collect(),
        sources,
        tool: "test".to_owned(),
        options: std::collections::BTreeMap::new(),
        capture_accuracy: None,
        capture_registration: None,
        capture_instrument: None,
        repairs: std::collections::BTreeMap::new(),
    };
    let mut writer = PackWriter::begin(Vec::new(), header, &metadata, vec![entry]).unwrap();
    writer.chunk(&encoded).unwrap();
    writer.finish().unwrap()
}

/// Everybody may have it.
pub(crate) fn public() -> Access {
    Access { state: AccessState::Public, until: None, reason: None, contact: None, withdrawn: None }
}

/// An archive object with a version for each pack, as `kilwa publish` lays it out.
pub(crate) fn object(folder: &Path, slug: &str, packs: &[Vec<u8>], access: Access) -> Manifest {
    let root = folder.join(slug);
    let versions = (1..).zip(packs).map(|(number, pack)| version(&root, number, pack)).collect();
    let page = format!(
        "<!doctype html><html><head><title>{slug}</title></head><body data-list=\"\">landing of {slug}</body></html>"
    );
    let manifest = Manifest {
        kilwa: FORM,
        slug: slug.to_owned(),
        title: format!("Title of {slug}"),
        description: None,
        language: "en".to_owned(),
        place: None,
        captured: None,
        subjects: Vec::new(),
        creators: Vec::new(),
        url: None,
        identifier: None,
        rights: RightsEntry {
            uri: "https://creativecommons.org/licenses/by/4.0/".to_owned(),
            label: "Attribution 4.0 International".to_owned(),
            short: "CC BY 4.0".to_owned(),
            holder: None,
        },
        citation: "Somebody (2026)".to_owned(),
        access,
        current: packs.len() as u32,
        versions,
        page: FileEntry { url: "index.html".to_owned(), bytes: page.len() as u64, sha256: sha256(page.as_bytes()) },
        tool: "test".to_owned(),
    };
    std::fs::write(root.join("index.html"), page).unwrap();
    // Last, and at once, as publishing does it.
    std::fs::write(root.join(".new"), manifest.to_bytes().unwrap()).unwrap();
    std::fs::rename(root.join(".new"), root.join("manifest.json")).unwrap();
    manifest
}

fn version(root: &Path, number: u32, pack: &[u8]) -> Version {
    let folder = format!("v{number}");
    std::fs::create_dir_all(root.join(&folder).join("metadata")).unwrap();
    let name = format!("pack.{}.kilwa", sha256(pack));
    let mut list = Checksums::default();
    std::fs::create_dir_all(root.join(&folder).join("viewer")).unwrap();
    // As with real models, another pack has another picture.
    let poster = [b"JPEG", sha256(pack).as_bytes()].concat();
    let files: [(&str, &[u8]); 7] = [
        (name.as_str(), pack),
        ("preview.glb", b"glTF"),
        ("poster.jpg", &poster),
        ("metadata/dc.xml", b"<dc/>"),
        ("viewer/app.js", b"export {};"),
        ("viewer/app.js.br", b"(brotli)"),
        ("viewer/app.js.gz", b"(gzip)"),
    ];
    for (file, bytes) in files {
        std::fs::write(root.join(&folder).join(file), bytes).unwrap();
        list.add(file, sha256(bytes));
    }
    let text = list.to_text();
    std::fs::write(root.join(&folder).join("checksums.sha256"), &text).unwrap();
    Version {
        version: number,
        published: "2026-11-21".to_owned(),
        note: "as it is".to_owned(),
        pack: PackEntry {
            url: format!("{folder}/{name}"),
            bytes: pack.len() as u64,
            sha256: sha256(pack),
            identity: "0".repeat(32),
        },
        checksums: FileEntry {
            url: format!("{folder}/checksums.sha256"),
            bytes: text.len() as u64,
            sha256: sha256(text.as_bytes()),
        },
        annotations: None,
        holes: None,
        tiles: None,
        colour_report: None,
        photographs: None,
        figures: Figures {
            bounds: [DVec3::ZERO, DVec3::ONE],
            crs: None,
            units: "m".to_owned(),
            source_units: "m".to_owned(),
            triangles: 1,
            points: None,
            vertices: 3,
            spacing: 0.1,
            accuracy: None,
        },
        folder,
        location_redacted: false,
    }
}
