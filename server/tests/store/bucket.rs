//! An independent store (moto, in Python), and a proxy to it that can break connections and hold or refuse requests.

use crate::eventually::eventually;
use kilwa_server::store::{S3, S3Options, StoreError};
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
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
    pub(crate) proxy: Proxy,
}

impl Bucket {
    /// `None` where the packages are not there.
    pub(crate) fn start(test: &str) -> Option<Self> {
        let Some(packages) = std::env::var_os("KILWA_MOTO") else {
            println!("skipped: {test}: KILWA_MOTO is not set (cargo xtask test sets it)");
            return None;
        };
        let mut child = Command::new("python3")
            .env("PYTHONPATH", packages)
            .args(["-c", include_str!("server.py")])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .expect("python3 is there");
        let say = child.stdin.take();
        let mut hear = BufReader::new(child.stdout.take().expect("its output"));
        let mut port = String::new();
        hear.read_line(&mut port).expect("it speaks");
        let proxy = Proxy::to(port.trim().parse().expect("a port"));
        Some(Self { child, say, hear, proxy })
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

    /// How it is reached, through the proxy.
    pub(crate) fn options(&self, url: &str, timeout: Duration) -> S3Options {
        let settings = [
            ("AWS_ACCESS_KEY_ID", "test"),
            ("AWS_SECRET_ACCESS_KEY", "secret-of-the-test"),
            ("AWS_REGION", "us-east-1"),
        ];
        S3Options {
            url: url.to_owned(),
            endpoint: Some(format!("http://127.0.0.1:{}", self.proxy.port)),
            settings: settings.map(|(n, v)| (n.to_owned(), v.to_owned())).to_vec(),
            timeout,
            refresh: Duration::from_millis(100),
            retries: 1,
            // A command takes over what another has begun; tests of claims choose otherwise.
            lease: Duration::ZERO,
        }
    }

    /// The store without the proxy.
    pub(crate) fn open_directly(&self, url: &str, timeout: Duration) -> Result<Arc<S3>, StoreError> {
        let endpoint = Some(format!("http://127.0.0.1:{}", self.proxy.upstream));
        S3::open(&S3Options { endpoint, ..self.options(url, timeout) })
    }

    /// The store, whose list is asked for again for every request.
    pub(crate) fn open_fresh(&self, url: &str, timeout: Duration) -> Result<Arc<S3>, StoreError> {
        S3::open(&S3Options { refresh: Duration::ZERO, ..self.options(url, timeout) })
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

/// How requests are treated whose first line contains certain words.
#[derive(Clone, Copy, PartialEq)]
enum Fate {
    /// The store says 403.
    Refused,
    /// They are held for now.
    Held,
}

/// State of the proxy.
struct Traffic {
    /// Bytes of answers that still go through.
    left: AtomicI64,
    /// Whether what comes after these is held back; else the connection ends.
    holds: AtomicBool,
    connections: AtomicU64,
    rule: Mutex<Option<(String, Fate)>>,
    /// Whether a request is held.
    is_holding: AtomicBool,
    /// First lines of the requests so far.
    asked: Mutex<Vec<String>>,
    /// Bytes of answers so far.
    carried: AtomicU64,
}

impl Traffic {
    /// Write down a request that begins with these bytes.
    fn note(&self, begins: &[u8]) {
        let line = String::from_utf8_lossy(begins.split(|b| *b == b'\r').next().unwrap_or_default()).into_owned();
        if let Some(line) = line.strip_suffix(" HTTP/1.1") {
            self.asked.lock().expect("no panic").push(line.to_owned());
        }
    }

    /// What becomes of a request that begins with these bytes.
    fn fate(&self, begins: &[u8]) -> Option<Fate> {
        let line = begins.split(|b| *b == b'\r').next().unwrap_or_default();
        let line = String::from_utf8_lossy(line);
        let rule = self.rule.lock().expect("no panic");
        rule.as_ref().filter(|(words, _)| line.ends_with(" HTTP/1.1") && line.contains(words)).map(|(_, fate)| *fate)
    }
}

/// A proxy to a port that can be cut, silent, or stop in the middle of a response.
pub(crate) struct Proxy {
    port: u16,
    upstream: u16,
    threads: Option<Runtime>,
    /// Counted up whenever the proxy is opened or closed: earlier connections end, however soon it is open again.
    turn: watch::Sender<u64>,
    traffic: Arc<Traffic>,
}

impl Proxy {
    fn to(upstream: u16) -> Self {
        let threads =
            tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().expect("threads");
        let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
        let port = listener.local_addr().expect("a port").port();
        drop(listener);
        let traffic = Traffic {
            left: AtomicI64::new(i64::MAX),
            holds: AtomicBool::new(false),
            connections: AtomicU64::new(0),
            rule: Mutex::new(None),
            is_holding: AtomicBool::new(false),
            asked: Mutex::default(),
            carried: AtomicU64::new(0),
        };
        let proxy =
            Self { port, upstream, threads: Some(threads), turn: watch::Sender::new(0), traffic: Arc::new(traffic) };
        proxy.up();
        proxy
    }

    /// Take connections, and let everything through.
    pub(crate) fn up(&self) {
        self.traffic.left.store(i64::MAX, Ordering::SeqCst);
        self.turn.send_modify(|turn| *turn += 1);
        let (port, upstream, mut turn, traffic) =
            (self.port, self.upstream, self.turn.subscribe(), Arc::clone(&self.traffic));
        let mine = *turn.borrow_and_update();
        let threads = self.threads.as_ref().expect("running");
        let listener = std::net::TcpListener::bind(("127.0.0.1", port)).expect("the port is free");
        listener.set_nonblocking(true).expect("a listener");
        threads.spawn(async move {
            let listener = TcpListener::from_std(listener).expect("a listener");
            loop {
                let stream = tokio::select! {
                    taken = listener.accept() => taken.expect("a connection").0,
                    _ = turn.wait_for(|turn| *turn != mine) => break,
                };
                let (mut turn, traffic) = (turn.clone(), Arc::clone(&traffic));
                tokio::spawn(async move {
                    tokio::select! {
                        () = carry(stream, upstream, &traffic) => {}
                        _ = turn.wait_for(|turn| *turn != mine) => {}
                    }
                });
            }
        });
    }

    /// End all connections and take none.
    pub(crate) fn down(&self) {
        self.turn.send_modify(|turn| *turn += 1);
        let closed = || std::net::TcpStream::connect(("127.0.0.1", self.port)).is_err().then_some(());
        eventually("the proxy takes no connections", closed);
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

    /// From now on the store refuses requests with these words in their first line.
    pub(crate) fn refuse(&self, words: &str) {
        *self.traffic.rule.lock().expect("no panic") = Some((words.to_owned(), Fate::Refused));
    }

    /// From now on requests with these words in their first line come no further.
    pub(crate) fn hold(&self, words: &str) {
        *self.traffic.rule.lock().expect("no panic") = Some((words.to_owned(), Fate::Held));
    }

    /// Until a request is held.
    pub(crate) fn wait_until_held(&self) {
        eventually("a request that is held", || self.traffic.is_holding.load(Ordering::SeqCst).then_some(()));
    }

    /// No request is refused or held any more.
    pub(crate) fn allow(&self) {
        *self.traffic.rule.lock().expect("no panic") = None;
    }

    /// First lines of the requests since this was last asked: method and address.
    pub(crate) fn asked(&self) -> Vec<String> {
        std::mem::take(&mut self.traffic.asked.lock().expect("no panic"))
    }

    /// Bytes of answers since this was last asked.
    pub(crate) fn carried(&self) -> u64 {
        self.traffic.carried.swap(0, Ordering::SeqCst)
    }

    /// Connections so far.
    pub(crate) fn connections(&self) -> u64 {
        self.traffic.connections.load(Ordering::SeqCst)
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        if let Some(threads) = self.threads.take() {
            threads.shutdown_background();
        }
    }
}

/// Carry a connection until either side ends it or the proxy is cut.
async fn carry(near: TcpStream, upstream: u16, traffic: &Traffic) {
    traffic.connections.fetch_add(1, Ordering::SeqCst);
    let Ok(far) = TcpStream::connect(("127.0.0.1", upstream)).await else { return };
    let (mut near_read, mut near_write) = near.into_split();
    let (mut far_read, mut far_write) = far.into_split();
    // True where the request is refused.
    let asked = async {
        let mut buffer = vec![0; 64 * 1024];
        loop {
            let n = near_read.read(&mut buffer).await.unwrap_or(0);
            if n == 0 {
                break;
            }
            traffic.note(&buffer[..n]);
            // Held until the test releases it or its connection ends.
            while traffic.fate(&buffer[..n]) == Some(Fate::Held) {
                traffic.is_holding.store(true, Ordering::SeqCst);
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            if traffic.fate(&buffer[..n]) == Some(Fate::Refused) {
                return true;
            }
            if far_write.write_all(&buffer[..n]).await.is_err() {
                break;
            }
        }
        far_write.shutdown().await.ok();
        false
    };
    let answered = async {
        let mut buffer = vec![0; 16 * 1024];
        loop {
            let n = far_read.read(&mut buffer).await.unwrap_or(0);
            if n == 0 {
                break;
            }
            traffic.carried.fetch_add(n as u64, Ordering::SeqCst);
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
        () = async { if !asked.await { std::future::pending::<()>().await } } => {
            let body = "<Error><Code>AccessDenied</Code><Message>Access Denied</Message></Error>";
            let head = format!("HTTP/1.1 403 Forbidden\r\ncontent-type: application/xml\r\ncontent-length: {}\r\nconnection: close\r\n\r\n", body.len());
            near_write.write_all(format!("{head}{body}").as_bytes()).await.ok();
            near_write.shutdown().await.ok();
        }
    }
}
