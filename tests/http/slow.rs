//! Slow clients: requests sent a byte at a time, responses read a little at a time.

use super::client::{Client, loopback};
use super::process::Server;
use super::{check_bound, check_none, check_time, full, noise, quantile, remark};
use crate::eventually::eventually_async;
use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};

const URL: &str = "/packs/fort.kilwa";

/// Milliseconds of each of many ranges of 64 KiB, asked for by four people for a while.
async fn well_behaved(server: SocketAddr, ranges: usize) -> Vec<f64> {
    let people = (0..4).map(|person| {
        tokio::spawn(async move {
            let mut times = Vec::new();
            let mut client = Client::connect_from(loopback(5000 + person), server, None).await.unwrap();
            for k in 0..ranges / 4 {
                let from = (k * 65_536) % 8_000_000;
                let began = Instant::now();
                let range = format!("Range: bytes={from}-{}\r\n", from + 65_535);
                let answer = client.get(URL, &range).await.unwrap();
                times.push(began.elapsed().as_secs_f64() * 1e3);
                assert_eq!((answer.status, answer.body.len()), (206, 65_536));
                // The time that a person takes between two requests.
                tokio::time::sleep(Duration::from_millis(5)).await;
            }
            times
        })
    });
    let mut all = Vec::new();
    for person in people.collect::<Vec<_>>() {
        all.extend(person.await.unwrap());
    }
    all
}

/// The same after a few warm-up requests that do not count.
async fn warm(server: SocketAddr, ranges: usize) -> Vec<f64> {
    well_behaved(server, 80).await;
    well_behaved(server, ranges).await
}

/// A client that sends a byte of a request every `pause` and reconnects when the connection is closed, until stopped. Returns how
/// long each of its connections was open, seconds.
async fn creeping(
    server: SocketAddr,
    number: usize,
    pause: Duration,
    stop: Arc<AtomicBool>,
    begun: Arc<AtomicUsize>,
) -> Vec<f64> {
    let mut held = Vec::new();
    while !stop.load(Ordering::Relaxed) {
        let Ok(mut client) = Client::connect_from(loopback(number / 100), server, None).await else { break };
        begun.fetch_add(1, Ordering::Relaxed);
        let began = Instant::now();
        let (mut read, mut write) = client.stream.split();
        let mut request = b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ".iter().chain(std::iter::repeat(&b'a'));
        let mut answer = [0; 256];
        loop {
            let byte = [*request.next().unwrap()];
            if write.write_all(&byte).await.is_err() {
                break;
            }
            // A few words before it is closed, or nothing yet, is no end.
            if let Ok(Ok(0) | Err(_)) = tokio::time::timeout(pause, read.read(&mut answer)).await {
                break;
            }
        }
        held.push(began.elapsed().as_secs_f64());
    }
    held
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn endless_requests_are_closed_without_affecting_others() {
    let (sockets, limit, pause) = if full() { (2000, "10", 5000) } else { (200, "1", 300) };
    let bytes = noise(9_000_000, 5);
    let server = Server::start(&[("fort", &bytes)], &["--header-timeout", limit]);
    let ranges = if full() { 6000 } else { 80 };
    let before = if full() { warm(server.address, ranges).await } else { Vec::new() };
    let (stop, begun) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicUsize::new(0)));
    let pause = Duration::from_millis(pause);
    let crowd: Vec<_> = (0..sockets)
        .map(|number| tokio::spawn(creeping(server.address, number, pause, Arc::clone(&stop), Arc::clone(&begun))))
        .collect();
    let all_begun = async || (begun.load(Ordering::Relaxed) >= sockets).then_some(());
    eventually_async("each has connected", all_begun).await;
    let during = well_behaved(server.address, ranges * 2).await;
    stop.store(true, Ordering::Relaxed);
    let mut held = Vec::new();
    for one in crowd {
        held.extend(one.await.unwrap());
    }
    assert!(held.len() >= sockets, "each was closed by the server: {}", held.len());
    if !full() {
        return;
    }
    let after = well_behaved(server.address, ranges).await;
    let baseline = [before, after].concat();
    let (quiet, busy) = (quantile(&baseline, 0.99), quantile(&during, 0.99));
    remark(&format!(
        "{sockets} creeping connections at once, {} in all; 99th percentile of 64 KiB: {quiet:.2} ms without, {busy:.2} ms with",
        held.len()
    ));
    check_time("a creeping request holds its connection at most", "s", 15.0, held.iter().copied().fold(0.0, f64::max));
    check_time(
        "99th percentile of the others beside 2,000 creeping requests, of that without",
        "times",
        2.0,
        busy / quiet,
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn slow_readers_use_little_memory() {
    let readers = if full() { 1000 } else { 100 };
    let bytes = noise(48 << 20, 7);
    let server = Server::start(&[("fort", &bytes)], &[]);
    let Some(_) = server.memory() else {
        println!("skipped: memory of slow readers, which this system does not report");
        return;
    };
    // What the first requests cost in any case: the hash, threads that read.
    let mut first = Client::connect(server.address).await.unwrap();
    assert!(first.get(URL, "").await.unwrap().body == bytes);
    well_behaved(server.address, 200).await;
    let before = server.memory().unwrap();
    let mut held = Vec::new();
    for number in 0..readers {
        let mut client = Client::connect_from(loopback(number / 100), server.address, Some(4096)).await.unwrap();
        client.stream.write_all(format!("GET {URL} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await.unwrap();
        held.push(client);
    }
    let (mut peak, mut bytes_read, mut buffer) = (0.0_f64, 0, vec![0; 1024]);
    for _ in 0..if full() { 40 } else { 6 } {
        // The readers are this slow; the pause waits for no state.
        tokio::time::sleep(Duration::from_millis(250)).await;
        for client in &mut held {
            bytes_read += client.stream.read(&mut buffer).await.unwrap();
        }
        peak = peak.max(server.memory().unwrap());
    }
    assert!(bytes_read > 0);
    check_bound(
        &format!("memory for {readers} slow readers of 48 MiB each"),
        "MiB",
        64.0,
        (peak - before) / 1_048_576.0,
    );
    // A fast reader still gets everything.
    let mut other = Client::connect_from(loopback(6000), server.address, None).await.unwrap();
    assert!(other.get(URL, "").await.unwrap().body == bytes);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_stalled_reader_is_disconnected() {
    let bytes = noise(24 << 20, 9);
    let server = Server::start(&[("fort", &bytes)], &["--write-timeout", "1"]);
    let readers = 20;
    let mut stuck = Vec::new();
    for number in 0..readers {
        let mut client = Client::connect_from(loopback(number), server.address, Some(4096)).await.unwrap();
        client.stream.write_all(format!("GET {URL} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await.unwrap();
        stuck.push(client);
    }
    let mut monitor = Client::connect(server.address).await.unwrap();
    let wanted = format!("kilwa_slow_readers_total {readers}");
    eventually_async("all readers that take nothing are disconnected", async || {
        let body = monitor.get("/metrics", "").await.unwrap().body;
        String::from_utf8(body).unwrap().lines().any(|line| line == wanted).then_some(())
    })
    .await;
    check_none("readers that take nothing and are still served", readers, &[]);
    let mut whole = Vec::new();
    for mut client in stuck {
        let mut all = Vec::new();
        drop(client.stream.read_to_end(&mut all).await);
        if all.len() >= bytes.len() {
            whole.push(format!("{} bytes", all.len()));
        }
    }
    check_bound("answers to them that were not cut", "of 20", 0.0, whole.len() as f64);
}
