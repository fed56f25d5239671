//! Publishing to a server with interruptions of every kind: a `kilwa serve` that is killed and restarted, a connection that breaks at
//! any byte, a client that is killed.
//!
//! The object is made once by `kilwa publish` to a folder and sent; the server must have the same bytes at the end.

#[path = "../../src/publish/send.rs"]
#[allow(dead_code, reason = "the program uses all of it")]
mod send;

mod cuts;
mod proxy;
mod stored;
mod whole;

use crate::support::{Input, built_once, made_once, serving, succeeds, text};
use kilwa_archive::checksums::sha256;
use kilwa_archive::{Manifest, Metadata};
use kilwa_server::access::{Accounts, Grant, Purpose};
use kilwa_server::upload::wire::{AnnouncedFile, AnnouncedPreview, Drawing, FORM, Intent};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{SystemTime, UNIX_EPOCH};

/// What is published, in two versions.
pub(crate) const METADATA: &str = "title = \"Fort & <b>\"\nslug = \"fort\"\npublisher = \"Museum\"\nurl = \"https://museum.example/fort/\"\n\
    description = \"First.\\n\\nSecond.\"\n[rights]\nuri = \"CC BY 4.0\"\n[model]\nunits = \"m\"\n[[creators]]\nname = \"Rüther, Heinz\"\n";

/// Notes on it, as the page saves them.
pub(crate) const NOTES: &str = "{\"type\":\"AnnotationPage\",\"items\":[{\"id\":\"urn:uuid:1\",\"type\":\"Annotation\",\"label\":\"Gate\",\
    \"body\":[{\"type\":\"TextualBody\",\"value\":\"Coral <b>rag</b>\"},\"https://example.org/gate\"],\
    \"target\":{\"selector\":{\"type\":\"PointSelector\",\"x\":1.5,\"y\":2.25,\"z\":3.125}}}]}";

/// The pack.
pub(crate) fn pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("remote");
    built_once(&folder, "torus", |path| Input::torus(150, 60, [1.0, 2.0, 3.0]).write(path), &[])
}

/// The same two versions published to a folder, by the first test that asks.
pub(crate) fn local() -> PathBuf {
    let pack = pack();
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("remote");
    made_once(&folder.join("site"), |site| publish_both(&pack, &folder, site))
}

fn publish_both(pack: &Path, folder: &Path, site: &Path) {
    let (www, file, notes) = (folder.join("www"), folder.join("fort.toml"), folder.join("notes.json"));
    serving::page(&www);
    std::fs::write(&notes, NOTES).unwrap();
    for (day, more, metadata) in [
        ("2026-11-19", &["--notes", text(&notes)][..], METADATA.to_owned()),
        ("2026-11-20", &["--version-note", "Better text", "--no-notes"][..], METADATA.replace("First.", "Better.")),
    ] {
        std::fs::write(&file, metadata).unwrap();
        let args = ["publish", text(pack), "--to", text(site), "--metadata", text(&file), "--www", text(&www)];
        succeeds(&[&args[..], &["--software", "--date", day], more].concat());
    }
}

/// The announcement of version `number` of the object published in `site`.
pub(crate) fn intent(site: &Path, number: u32) -> Intent {
    let object = site.join("fort");
    let manifest = Manifest::parse(&std::fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let version = &manifest.versions[number as usize - 1];
    let folder = object.join(&version.folder);
    let json = |path: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(folder.join(path)).unwrap()).unwrap()
    };
    let metadata: Metadata = serde_json::from_value(json("metadata/metadata.json")).unwrap();
    let preview = &json("metadata/paradata.json")["preview"];
    // The crate names the files in the order in which they were made.
    let graph = json("ro-crate-metadata.json")["@graph"].clone();
    let root = graph.as_array().unwrap().iter().find(|e| e["@id"] == "./").unwrap();
    let parts: Vec<String> =
        root["hasPart"].as_array().unwrap().iter().map(|p| p["@id"].as_str().unwrap().to_owned()).collect();
    let is_sent = |p: &&String| {
        p.starts_with("pack.")
            || p.starts_with("poster")
            || p.starts_with("drawings/")
            || *p == "preview.glb"
            || *p == "annotations.json"
    };
    let listed = |path: &String| {
        let bytes = std::fs::read(folder.join(path)).unwrap();
        AnnouncedFile { path: path.clone(), bytes: bytes.len() as u64, sha256: sha256(&bytes) }
    };
    let html = std::fs::read_to_string(object.join("index.html")).unwrap();
    let words = |path: &str| {
        let rest = html.split(&format!("/{path}\" alt=\"")).nth(1).unwrap();
        rest.split('"').next().unwrap().to_owned()
    };
    let drawing = |p: &String| Drawing { path: p.clone(), words: words(p) };
    Intent {
        kilwa_upload: FORM,
        slug: "fort".to_owned(),
        version: number,
        published: version.published.clone(),
        note: version.note.clone(),
        location_redacted: false,
        location_cell: None,
        kept_channels: Vec::new(),
        same_object: false,
        metadata,
        preview: Some(AnnouncedPreview {
            triangles: preview["triangles"].as_u64().unwrap(),
            error: preview["error_m"].as_f64().unwrap(),
        }),
        drawings: parts
            .iter()
            .filter(|p| p.starts_with("drawings/") && Path::new(p).extension().is_some_and(|e| e == "png"))
            .map(drawing)
            .collect(),
        files: parts.iter().filter(is_sent).map(listed).collect(),
    }
}

/// Where the objects are in the store.
pub(crate) const ARCHIVE: &str = "s3://museum/archive";

/// `kilwa serve --accept-uploads` over an empty folder or store, which can be killed and started again at the same address.
pub(crate) struct Server {
    /// Where the store is.
    endpoint: Option<String>,
    child: Option<Child>,
    pub(crate) address: SocketAddr,
    pub(crate) token: String,
    dir: tempfile::TempDir,
}

impl Server {
    pub(crate) fn start() -> Self {
        Self::over(None)
    }

    /// Over the store at this address.
    pub(crate) fn over(endpoint: Option<String>) -> Self {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("models")).unwrap();
        serving::page(&dir.path().join("www"));
        let mut accounts = Accounts::new().unwrap();
        accounts.set_user("robot", &Grant::All, None).unwrap();
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs();
        let token = accounts.add_token("robot", Purpose::Publish, 30, now).unwrap();
        accounts.create(&dir.path().join("access.json")).unwrap();
        let mut server = Self { endpoint, child: None, address: "127.0.0.1:0".parse().unwrap(), token, dir };
        server.restart();
        server
    }

    pub(crate) fn folder(&self) -> PathBuf {
        self.path("models")
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Kill it without warning and start it again.
    pub(crate) fn restart(&mut self) {
        self.kill();
        let path = |name: &str| self.path(name);
        let log = std::fs::OpenOptions::new().create(true).append(true).open(path("log")).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        command.arg("serve");
        match &self.endpoint {
            None => command.arg(self.folder()),
            Some(endpoint) => command
                .env("AWS_ACCESS_KEY_ID", "test")
                .env("AWS_SECRET_ACCESS_KEY", "secret-of-the-test")
                .args([ARCHIVE, "--s3-endpoint", endpoint, "--s3-refresh", "1", "--upload-folder"])
                .arg(path("uploads")),
        };
        let mut child = command
            .args(["--listen", &self.address.to_string(), "--accept-uploads", "--access"])
            .arg(path("access.json"))
            .arg("--audit")
            .arg(path("audit.jsonl"))
            .arg("--www")
            .arg(path("www"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        self.address = serving::address(&mut child);
        self.child = Some(child);
    }

    pub(crate) fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            drop(child.kill());
            drop(child.wait());
        }
    }

    pub(crate) fn audit(&self) -> String {
        std::fs::read_to_string(self.dir.path().join("audit.jsonl")).unwrap_or_default()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Every file below a folder; those that are hidden if requested.
pub(crate) fn tree(folder: &Path, hidden: bool) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let Ok(entries) = std::fs::read_dir(folder) else { return all };
    for entry in entries {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.starts_with('.') && !hidden {
            continue;
        }
        if path.is_dir() {
            all.extend(tree(&path, hidden).into_iter().map(|(p, b)| (format!("{name}/{p}"), b)));
        } else {
            all.insert(name, std::fs::read(&path).unwrap());
        }
    }
    all
}
