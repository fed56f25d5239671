//! The accept loop over a real socket: limits hold, stopping is orderly.

use crate::common::{noise, page};
use crate::eventually::eventually_async;
use kilwa_server::{Catalogue, Limits, Site, app, listen};
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

struct Running {
    address: SocketAddr,
    stop: oneshot::Sender<()>,
    done: JoinHandle<std::io::Result<()>>,
    bytes: Vec<u8>,
    _dir: tempfile::TempDir,
}

async fn start(limits: Limits, size: usize) -> Running {
    let dir = tempfile::tempdir().unwrap();
    let bytes = noise(size, 5);
    std::fs::write(dir.path().join("fort.kilwa"), &bytes).unwrap();
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let site = Site::new(Catalogue::open(dir.path()).unwrap(), page());
    let metrics = Arc::clone(&site.metrics);
    let done = tokio::spawn(listen(listener, app(site), metrics, limits, async {
        drop(stopped.await);
    }));
    Running { address, stop, done, bytes, _dir: dir }
}

const GET: &[u8] = b"GET /packs/fort.kilwa HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n";

async fn whole(mut s: TcpStream) -> std::io::Result<Vec<u8>> {
    let mut all = Vec::new();
    s.read_to_end(&mut all).await?;
    let head = all.windows(4).position(|w| w == b"\r\n\r\n").map_or(0, |p| p + 4);
    Ok(all.split_off(head))
}

#[tokio::test]
async fn a_socket_that_never_finishes_its_headers_is_closed() {
    let r = start(Limits { headers: Duration::from_millis(200), ..Limits::default() }, 10).await;
    let mut slow = TcpStream::connect(r.address).await.unwrap();
    slow.write_all(b"GET / HTTP/1.1\r\nHost:").await.unwrap();
    // Ends (with or without a 408) only because the server hangs up.
    let mut rest = Vec::new();
    drop(slow.read_to_end(&mut rest).await);
    r.stop.send(()).unwrap();
    r.done.await.unwrap().unwrap();
}

#[tokio::test]
async fn more_connections_than_allowed_wait_and_are_then_served() {
    let r = start(Limits { connections: 1, ..Limits::default() }, 10_000).await;
    let first = TcpStream::connect(r.address).await.unwrap();
    let mut second = TcpStream::connect(r.address).await.unwrap();
    second.write_all(GET).await.unwrap();
    drop(first);
    assert_eq!(whole(second).await.unwrap(), r.bytes);
    r.stop.send(()).unwrap();
    r.done.await.unwrap().unwrap();
}

#[tokio::test]
async fn a_stalled_reader_is_disconnected_and_a_slow_one_is_not() {
    let r = start(Limits { stall: Duration::from_millis(300), ..Limits::default() }, 32 << 20).await;
    let mut stuck = TcpStream::connect(r.address).await.unwrap();
    stuck.write_all(GET).await.unwrap();
    let mut good = TcpStream::connect(r.address).await.unwrap();
    good.write_all(GET).await.unwrap();
    assert!(whole(good).await.unwrap() == r.bytes);
    let disconnected = async || {
        let mut asked = TcpStream::connect(r.address).await.unwrap();
        asked.write_all(b"GET /metrics HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").await.unwrap();
        let figures = String::from_utf8(whole(asked).await.unwrap()).unwrap();
        figures.lines().any(|line| line == "kilwa_slow_readers_total 1").then_some(())
    };
    eventually_async("the stalled reader is disconnected", disconnected).await;
    assert!(whole(stuck).await.map_or(0, |b| b.len()) < r.bytes.len());
    r.stop.send(()).unwrap();
    r.done.await.unwrap().unwrap();
}

#[tokio::test]
async fn stopping_finishes_running_requests_accepts_no_new_ones_and_keeps_its_deadline() {
    let r = start(Limits { shutdown: Duration::from_secs(3), ..Limits::default() }, 32 << 20).await;
    let mut running = TcpStream::connect(r.address).await.unwrap();
    running.write_all(GET).await.unwrap();
    let mut first = [0; 1];
    running.read_exact(&mut first).await.unwrap();
    let mut stuck = TcpStream::connect(r.address).await.unwrap();
    stuck.write_all(GET).await.unwrap();
    stuck.read_exact(&mut first).await.unwrap();
    r.stop.send(()).unwrap();
    assert!(whole(running).await.unwrap().ends_with(&r.bytes[r.bytes.len() - 100..]), "finished in order");
    r.done.await.unwrap().unwrap();
    assert!(TcpStream::connect(r.address).await.is_err());
}
