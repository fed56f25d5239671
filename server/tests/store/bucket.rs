//! A store that was made by others (moto, over Python), and a line to it that can be cut.

use kilwa_server::store::{S3, S3Options, StoreError};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Runtime;
use tokio::sync::watch;

/// The bucket, which ends with it.
pub(crate) struct Bucket {
    child: Child,
    say: Option<ChildStdin>,
    hear: BufReader<ChildStdout>,
    pub(crate) line: Line,
}

impl Bucket {
    /// `None` where the packages are not there.
    pub(crate) fn start(test: &str) -> Option<Self> {
        let Some(packages) = std::env::var_os("KILWA_MOTO") else {
            println!("skipped: {test}: KILWA_MOTO is not set (cargo xtask test sets it)");
            return None;
        };
        let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/store/server.py");
        let mut child = Command::new("python3")
            .env("PYTHONPATH", packages)
            .arg(program)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python3 is there");
        let say = child.stdin.take();
        let mut hear = BufReader::new(child.stdout.take().expect("its output"));
        let mut port = String::new();
        hear.read_line(&mut port).expect("it speaks");
        let line = Line::to(port.trim().parse().expect("a port"));
        Some(Self { child, say, hear, line })
    }

    fn order(&mut self, words: &[&str]) {
        writeln!(self.say.as_mut().expect("open"), "{}", words.join("\t")).expect("it listens");
        let mut answer = String::new();
        self.hear.read_line(&mut answer).expect("it speaks");
        assert_eq!(answer.trim(), "ok", "{words:?}");
    }

    /// Copy a folder.
    pub(crate) fn sync(&mut self, folder: &Path, prefix: &str) {
        self.order(&["sync", folder.to_str().expect("a plain path"), prefix]);
    }

    /// Copy a file.
    pub(crate) fn put(&mut self, file: &Path, key: &str) {
        self.order(&["put", file.to_str().expect("a plain path"), key]);
    }

    /// Take one away.
    pub(crate) fn delete(&mut self, key: &str) {
        self.order(&["delete", key]);
    }

    /// How it is reached, over the line.
    pub(crate) fn options(&self, url: &str, timeout: Duration) -> S3Options {
        let settings = [
            ("AWS_ACCESS_KEY_ID", "test"),
            ("AWS_SECRET_ACCESS_KEY", "secret-of-the-test"),
            ("AWS_REGION", "us-east-1"),
        ];
        S3Options {
            url: url.to_owned(),
            endpoint: Some(format!("http://127.0.0.1:{}", self.line.port)),
            settings: settings.map(|(n, v)| (n.to_owned(), v.to_owned())).to_vec(),
            timeout,
            refresh: Duration::from_millis(100),
            retries: 1,
        }
    }

    /// The store.
    pub(crate) fn open(&self, url: &str, timeout: Duration) -> Result<Arc<S3>, StoreError> {
        S3::open(&self.options(url, timeout))
    }
}

impl Drop for Bucket {
    fn drop(&mut self) {
        drop(self.say.take());
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// What goes through the line.
struct Traffic {
    /// Bytes of answers that still go through.
    left: AtomicI64,
    /// Whether what comes after these is held back; else the connection ends.
    holds: AtomicBool,
    connections: AtomicU64,
}

/// A line to a port, which can be cut, silent, or go dead in the middle.
pub(crate) struct Line {
    port: u16,
    upstream: u16,
    threads: Option<Runtime>,
    open: watch::Sender<bool>,
    traffic: Arc<Traffic>,
}

impl Line {
    fn to(upstream: u16) -> Self {
        let threads =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("threads");
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("a port").port();
        drop(listener);
        let traffic =
            Traffic { left: AtomicI64::new(i64::MAX), holds: AtomicBool::new(false), connections: AtomicU64::new(0) };
        let line = Self {
            port,
            upstream,
            threads: Some(threads),
            open: watch::Sender::new(false),
            traffic: Arc::new(traffic),
        };
        line.up();
        line
    }

    /// Take connections, and let everything through.
    pub(crate) fn up(&self) {
        self.traffic.left.store(i64::MAX, Ordering::SeqCst);
        self.open.send_replace(true);
        let (port, upstream, mut open, traffic) =
            (self.port, self.upstream, self.open.subscribe(), Arc::clone(&self.traffic));
        let threads = self.threads.as_ref().expect("running");
        let listener = std::net::TcpListener::bind(("127.0.0.1", port)).expect("the port is free");
        listener.set_nonblocking(true).expect("a listener");
        threads.spawn(async move {
            let listener = TcpListener::from_std(listener).expect("a listener");
            loop {
                let stream = tokio::select! {
                    taken = listener.accept() => taken.expect("a connection").0,
                    _ = open.wait_for(|open| !open) => break,
                };
                let (mut open, traffic) = (open.clone(), Arc::clone(&traffic));
                tokio::spawn(async move {
                    tokio::select! {
                        () = carry(stream, upstream, &traffic) => {}
                        _ = open.wait_for(|open| !open) => {}
                    }
                });
            }
        });
    }

    /// End all connections and take none.
    pub(crate) fn down(&self) {
        self.open.send_replace(false);
        while std::net::TcpStream::connect(("127.0.0.1", self.port)).is_ok() {
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Take connections and questions, and answer nothing.
    pub(crate) fn silent(&self) {
        self.silent_after(0);
    }

    /// The same after so many further bytes of answers.
    pub(crate) fn silent_after(&self, bytes: i64) {
        self.traffic.holds.store(true, Ordering::SeqCst);
        self.traffic.left.store(bytes, Ordering::SeqCst);
    }

    /// After so many further bytes of answers, every connection ends, and those that follow.
    pub(crate) fn cut_after(&self, bytes: i64) {
        self.traffic.holds.store(false, Ordering::SeqCst);
        self.traffic.left.store(bytes, Ordering::SeqCst);
    }

    /// Connections so far.
    pub(crate) fn connections(&self) -> u64 {
        self.traffic.connections.load(Ordering::SeqCst)
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        if let Some(threads) = self.threads.take() {
            threads.shutdown_background();
        }
    }
}

/// Carry a connection until either side ends it or the line is cut.
async fn carry(near: TcpStream, upstream: u16, traffic: &Traffic) {
    traffic.connections.fetch_add(1, Ordering::SeqCst);
    let Ok(far) = TcpStream::connect(("127.0.0.1", upstream)).await else { return };
    let (mut near_read, mut near_write) = near.into_split();
    let (mut far_read, mut far_write) = far.into_split();
    let asked = async {
        tokio::io::copy(&mut near_read, &mut far_write).await.ok();
        far_write.shutdown().await.ok();
    };
    let answered = async {
        let mut buffer = vec![0; 16 * 1024];
        loop {
            let n = far_read.read(&mut buffer).await.unwrap_or(0);
            if n == 0 {
                break;
            }
            let left = traffic.left.fetch_sub(n as i64, Ordering::SeqCst).clamp(0, n as i64);
            if near_write.write_all(&buffer[..left as usize]).await.is_err() {
                break;
            }
            if left < n as i64 {
                if traffic.holds.load(Ordering::SeqCst) {
                    std::future::pending::<()>().await;
                }
                break;
            }
        }
    };
    tokio::select! {
        () = answered => {}
        () = async { asked.await; std::future::pending::<()>().await } => {}
    }
}
