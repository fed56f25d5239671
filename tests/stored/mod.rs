//! `kilwa publish --to s3://…` and `kilwa serve s3://…` as programs, over an independent store.
//!
//! The store is moto, from PyPI: `cargo xtask test` puts it where `KILWA_MOTO` says; without that the tests say that they were skipped.
//! They follow a person's path: the keys come from the environment, the object is published, opened, read and followed by a second version.

mod extracts;

use crate::bucket::Bucket;
use crate::eventually::eventually_async;
use crate::http::client::{Answer, Client, loopback};
use crate::support::serving::{address, page};
use crate::support::{Input, built_once, text};
use kilwa_archive::Manifest;
use kilwa_archive::checksums::sha256;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

const ARCHIVE: &str = "s3://museum/archive/of forts";
const METADATA: &str = "title = \"Fort & <b>\"\nslug = \"fort\"\ndescription = \"@\"\npublished = 2026-11-21\n\
    [rights]\nuri = \"CC BY 4.0\"\n[model]\nunits = \"m\"\n";

fn pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stored");
    built_once(&folder, "torus", |path| Input::torus(150, 60, [1.0, 2.0, 3.0]).write(path), &[])
}

/// Who works with the store: a folder with a page and metadata, and the keys in the environment.
struct Keeper {
    folder: tempfile::TempDir,
    endpoint: String,
}

impl Keeper {
    fn of(bucket: &Bucket) -> Self {
        let folder = tempfile::tempdir().unwrap();
        page(&folder.path().join("www"));
        let endpoint = bucket.options(ARCHIVE, Duration::from_secs(20)).endpoint.unwrap();
        Self { folder, endpoint }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn kilwa() -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        command
            .env("AWS_ACCESS_KEY_ID", "test")
            .env("AWS_SECRET_ACCESS_KEY", "secret-of-the-test")
            .env_remove("AWS_ENDPOINT_URL")
            .env_remove("SOURCE_DATE_EPOCH")
            .stdin(Stdio::null());
        command
    }

    /// Publish the pack with this description.
    fn publish(&self, description: &str, more: &[&str]) -> Output {
        let metadata = self.path("metadata.toml");
        std::fs::write(&metadata, METADATA.replace('@', description)).unwrap();
        let (pack, www) = (pack(), self.path("www"));
        let args = ["publish", text(&pack), "--to", ARCHIVE, "--s3-endpoint", &self.endpoint, "--metadata"];
        let rest = [text(&metadata), "--www", text(&www), "--software", "--json"];
        Self::kilwa().args(args).args(rest).args(more).output().unwrap()
    }

    /// Publish the pack to a folder.
    fn publish_here(&self) -> PathBuf {
        let (local, metadata) = (self.path("local"), self.path("fort.toml"));
        std::fs::write(&metadata, METADATA).unwrap();
        let (pack, www) = (pack(), self.path("www"));
        let args = ["publish", text(&pack), "--to", text(&local), "--metadata", text(&metadata), "--www", text(&www)];
        crate::support::succeeds(&[&args[..], &["--software"]].concat());
        local
    }

    /// Serve the archive.
    fn serve(&self) -> Server {
        self.serve_with(&[ARCHIVE, "--s3-endpoint", &self.endpoint, "--s3-refresh", "1"])
    }

    fn serve_with(&self, what: &[&str]) -> Server {
        let log = std::fs::File::create(self.path("log")).unwrap();
        let mut child = Self::kilwa()
            .arg("serve")
            .args(what)
            .args(["--listen", "127.0.0.1:0", "--www"])
            .arg(self.path("www"))
            .stdout(Stdio::piped())
            .stderr(log)
            .spawn()
            .unwrap();
        let address = address(&mut child);
        Server { child, address }
    }
}

struct Server {
    child: Child,
    address: SocketAddr,
}

impl Server {
    async fn get(&self, path: &str, headers: &str) -> Answer {
        Client::connect(self.address).await.unwrap().get(path, headers).await.unwrap()
    }

    async fn json(&self, path: &str) -> serde_json::Value {
        serde_json::from_slice(&self.get(path, "").await.body).unwrap_or_default()
    }

    async fn text(&self, path: &str) -> String {
        String::from_utf8_lossy(&self.get(path, "").await.body).into_owned()
    }
}

/// A pack of so many bytes, of no particular content.
fn filled(bytes: usize) -> Vec<u8> {
    (0..bytes).map(|i| ((i * i) >> 7) as u8).collect()
}

/// Put a pack in the place of the one that was published to a folder: as much of an object as a server reads of it.
fn grown(object: &Path, pack: &[u8]) -> String {
    let mut manifest = Manifest::parse(&std::fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let version = &mut manifest.versions[0];
    let folder = object.join(&version.folder);
    let (old, sum) = (version.pack.sha256.clone(), sha256(pack));
    std::fs::remove_file(object.join(&version.pack.url)).unwrap();
    std::fs::write(folder.join(format!("pack.{sum}.kilwa")), pack).unwrap();
    let list = std::fs::read_to_string(object.join(&version.checksums.url)).unwrap().replace(&old, &sum);
    std::fs::write(object.join(&version.checksums.url), &list).unwrap();
    version.checksums.bytes = list.len() as u64;
    version.checksums.sha256 = sha256(list.as_bytes());
    version.pack.url = version.pack.url.replace(&old, &sum);
    version.pack.bytes = pack.len() as u64;
    version.pack.sha256 = sum;
    let url = format!("/fort/{}", version.pack.url);
    std::fs::write(object.join("manifest.json"), manifest.to_bytes().unwrap()).unwrap();
    url
}

/// `KILWA_SOAK=1 KILWA_MOTO=… cargo nextest run --test stored slow_readers --no-capture`; archived in docs/bench.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn slow_readers_of_a_pack_in_a_store_use_little_memory() {
    // The store of the test holds the rest of each answer in its own memory: 100 times this.
    const PACK: usize = 24 << 20;
    if std::env::var_os("KILWA_SOAK").is_none() {
        println!("skipped: slow readers of a pack in a store: KILWA_SOAK is not set");
        return;
    }
    let Some(mut bucket) = Bucket::start("slow_readers_of_a_pack_in_a_store…") else { return };
    let keeper = Keeper::of(&bucket);
    let local = keeper.publish_here();
    let url = grown(&local.join("fort"), &filled(PACK));
    bucket.sync(&local, "archive/of forts");
    let server = keeper.serve();
    let memory = || {
        let status = std::fs::read_to_string(format!("/proc/{}/status", server.child.id())).unwrap_or_default();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
        line.and_then(|line| line.split_whitespace().next()?.parse::<f64>().ok()).map(|kib| kib / 1024.0)
    };
    assert!(server.get(&url, "").await.body.len() == PACK);
    let Some(before) = memory() else {
        println!("skipped: memory of slow readers, which this system does not report");
        return;
    };
    let mut held = Vec::new();
    for number in 0..100 {
        let mut client = Client::connect_from(loopback(number), server.address, Some(4096)).await.unwrap();
        client.stream.write_all(format!("GET {url} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await.unwrap();
        held.push(client);
    }
    let (mut peak, mut buffer, mut read) = (before, vec![0; 4096], 0);
    for _ in 0..60 {
        // The readers are this slow; the pause waits for no state.
        tokio::time::sleep(Duration::from_millis(250)).await;
        for client in &mut held {
            let taken = tokio::time::timeout(Duration::from_millis(20), client.stream.read(&mut buffer)).await;
            read += taken.map_or(0, |n| n.unwrap());
        }
        peak = peak.max(memory().unwrap_or_default());
    }
    println!(
        "soak | memory for 100 slow readers of {} MiB each in a store, MiB | 32 | {:.1}",
        PACK >> 20,
        peak - before
    );
    assert!(read > 1_000_000, "they are served: {read} bytes");
    assert!(peak - before <= 32.0, "{} MiB more than {before}", peak - before);
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

fn done(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_published_to_a_store_can_be_found_opened_and_read_and_gets_a_second_version() {
    let Some(bucket) = Bucket::start("what_is_published_to_a_store_is_found_opened…") else { return };
    let keeper = Keeper::of(&bucket);
    let bytes = std::fs::read(pack()).unwrap();
    done(&keeper.publish("With a tower.", &[]));
    let server = keeper.serve();
    let list = server.text("/?q=tower").await;
    assert!(list.contains("Fort &amp; &lt;b&gt;") && list.contains("href=\"/fort/\""), "{list}");
    let page = server.get("/fort/", "").await;
    assert!(page.status == 200 && String::from_utf8_lossy(&page.body).contains("With a tower."));
    let first = server.json("/fort/manifest.json").await;
    let url = format!("/fort/{}", first["versions"][0]["pack"]["url"].as_str().unwrap());
    assert!(server.get(&url, "").await.body == bytes, "the whole pack");
    let mut random = fastrand::Rng::with_seed(11);
    for _ in 0..60 {
        let from = random.usize(..bytes.len());
        let to = (from + random.usize(..70_000)).min(bytes.len() - 1);
        let answer = server.get(&url, &format!("Range: bytes={from}-{to}\r\n")).await;
        assert!(answer.status == 206 && answer.body == bytes[from..=to], "{from}-{to}: {}", answer.head);
    }
    // The same again is nothing new; other metadata are a second version, which appears without a restart.
    let again = keeper.publish("With a tower.", &["--version-note", "Again"]);
    let message = String::from_utf8_lossy(&again.stderr);
    assert!(!again.status.success() && message.contains("has the same pack"), "{message}");
    let without = keeper.publish("Now with a cistern.", &[]);
    let message = String::from_utf8_lossy(&without.stderr);
    assert!(
        !without.status.success() && message.contains("s3://museum/archive/of forts/fort is published already"),
        "{message}"
    );
    let second = done(&keeper.publish("Now with a cistern.", &["--version-note", "Better text"]));
    assert_eq!(second["version"], 2, "{second}");
    let manifest = async || (server.json("/fort/manifest.json").await["current"] == 2).then_some(());
    eventually_async("the second version", manifest).await;
    let page = async || server.text("/fort/").await.contains("Now with a cistern.").then_some(());
    eventually_async("its page", page).await;
    let listed = async || server.text("/?q=cistern").await.contains("href=\"/fort/\"").then_some(());
    eventually_async("its place in the catalogue", listed).await;
    let manifest = server.json("/fort/manifest.json").await;
    for version in manifest["versions"].as_array().unwrap() {
        let url = format!("/fort/{}", version["pack"]["url"].as_str().unwrap());
        assert!(server.get(&url, "").await.body == bytes, "{url}");
    }
    assert_eq!(server.get("/fort/v1/checksums.sha256", "").await.status, 200, "the first stays");
}

#[test]
fn an_unusable_store_is_refused_with_what_to_do_and_without_the_keys() {
    let Some(bucket) = Bucket::start("what_cannot_be_is_said_with_what_to_do…") else { return };
    let keeper = Keeper::of(&bucket);
    let refused = |command: &mut Command| {
        let output = command.output().unwrap();
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert!(!message.contains("secret-of-the-test"), "{message}");
        message
    };
    let serve = |address: &str, endpoint: &str| {
        let mut command = Keeper::kilwa();
        command.args([
            "serve",
            address,
            "--s3-endpoint",
            endpoint,
            "--s3-timeout",
            "2",
            "--listen",
            "127.0.0.1:0",
            "--www",
        ]);
        command.arg(keeper.path("www"));
        command
    };
    done(&keeper.publish("With a tower.", &[]));
    let message = refused(&mut serve("s3://no-such-bucket", &keeper.endpoint));
    assert!(message.contains("no such bucket"), "{message}");
    let message = refused(&mut serve(ARCHIVE, "http://127.0.0.1:9"));
    assert!(message.contains("--s3-endpoint"), "{message}");
    let message =
        refused(serve(ARCHIVE, &keeper.endpoint).env_remove("AWS_ACCESS_KEY_ID").env_remove("AWS_SECRET_ACCESS_KEY"));
    assert!(message.contains("403") && message.contains("AWS_ACCESS_KEY_ID"), "{message}");
    bucket.proxy.down();
    let second = ["--version-note", "Better text"];
    let output = keeper.publish("Now with a cistern.", &second);
    let message = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(1) && message.contains("s3://museum"), "{message}");
    bucket.proxy.up();
    assert_eq!(done(&keeper.publish("Now with a cistern.", &second))["version"], 2, "the same command goes on");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn photographs_are_published_to_a_store_with_the_bytes_of_a_local_publication() {
    let Some(bucket) = Bucket::start("photographs_are_published_to_a_store…") else { return };
    let (keeper, made) = (Keeper::of(&bucket), crate::publish::photographs::coloured());
    let (local, metadata) = (keeper.path("local"), keeper.path("photographed.toml"));
    std::fs::write(&metadata, format!("{METADATA}[photographs]\nrights = \"CC BY-NC 4.0\"\n")).unwrap();
    let publish = |to: &[&str]| {
        let mut command = Keeper::kilwa();
        command
            .args(["publish", text(&made.pack), "--metadata", text(&metadata), "--software", "--json", "--to"])
            .args(to);
        command.args(["--colour-report", text(&made.report), "--photos", text(&made.photos), "--www"]);
        let output = command.arg(keeper.path("www")).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let there = [ARCHIVE, "--s3-endpoint", &keeper.endpoint];
    publish(&[text(&local)]);
    assert_eq!(publish(&[&there[..], &["--dry-run"]].concat())["photograph_copies"], 3);
    let report = publish(&there);
    assert_eq!((&report["photographs"], &report["masks"]), (&3.into(), &1.into()), "{report}");
    let server = keeper.serve();
    let object = local.join("fort");
    let manifest = Manifest::parse(&std::fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let list = std::fs::read_to_string(object.join(&manifest.versions[0].checksums.url)).unwrap();
    let names: Vec<_> = list.lines().filter_map(|line| line.split_once("  ").map(|(_, path)| path)).collect();
    let of_photographs = names.iter().filter(|path| path.starts_with("photographs/") || **path == "colour-report.json");
    let mut compared = 0;
    for path in of_photographs {
        let (here, answer) =
            (std::fs::read(object.join("v1").join(path)).unwrap(), server.get(&format!("/fort/v1/{path}"), "").await);
        assert!(answer.body == here, "{path}: {}", answer.head);
        compared += 1;
    }
    // Three photographs with a thumbnail each, a mask, and the report.
    assert_eq!(compared, 8, "{list}");
    assert_eq!(publish(&there)["already"], true);
}
