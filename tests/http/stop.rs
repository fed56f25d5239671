//! A signal to stop during transfers: each response is complete or visibly truncated, and the process ends in time.

use super::client::{Client, loopback};
use super::process::Server;
use super::{check_bound, check_none, check_time, full, noise, remark};
use std::sync::Arc;
use std::time::Duration;
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::sync::Barrier;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sigterm_completes_or_aborts_every_transfer() {
    let transfers = if full() { 100 } else { 20 };
    let bytes: &'static [u8] = Vec::leak(noise(16 << 20, 17));
    let mut server = Server::start(&[("fort", bytes)], &["--shutdown", "5"]);
    let address = server.address;
    let started = Arc::new(Barrier::new(transfers + 1));
    let clients: Vec<_> = (0..transfers)
        .map(|number| {
            let started = Arc::clone(&started);
            tokio::spawn(async move {
                let mut client = Client::connect_from(loopback(number), address, None).await.unwrap();
                client.stream.write_all(b"GET /packs/fort.kilwa HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
                let (mut all, mut buffer) = (Vec::new(), vec![0; 64 * 1024]);
                let n = client.stream.read(&mut buffer).await.unwrap();
                all.extend_from_slice(&buffer[..n]);
                started.wait().await;
                // Every second one reads too slowly to finish within what is left.
                let pause = Duration::from_millis(if number % 2 == 0 { 0 } else { 100 });
                loop {
                    tokio::time::sleep(pause).await;
                    match client.stream.read(&mut buffer).await {
                        Ok(0) | Err(_) => break,
                        Ok(n) => all.extend_from_slice(&buffer[..n]),
                    }
                }
                let end = all.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
                let head = String::from_utf8_lossy(&all[..end]).into_owned();
                let body = &all[end..];
                let announced = head.to_lowercase().contains(&format!("content-length: {}\r\n", bytes.len()));
                (announced && *body == bytes[..body.len()], body.len() == bytes.len())
            })
        })
        .collect();
    started.wait().await;
    server.terminate();
    let ended = tokio::task::spawn_blocking(move || server.ended());
    let (mut wrong, mut complete) = (Vec::new(), 0);
    for (number, client) in clients.into_iter().enumerate() {
        let (is_sound, is_complete) = client.await.unwrap();
        complete += usize::from(is_complete);
        if !is_sound {
            wrong.push(format!("transfer {number}"));
        }
    }
    let (status, took) = ended.await.unwrap();
    remark(&format!("{complete} of {transfers} transfers were completed, the others cut"));
    check_none("transfers with bytes that are not the file's, at SIGTERM", transfers, &wrong);
    check_bound("exit code after SIGTERM", "code", 0.0, f64::from(status.code().unwrap_or(99)));
    check_time("from SIGTERM to the end, with 5 s for transfers", "s", 6.0, took.as_secs_f64());
    assert!(Client::connect(address).await.is_err(), "nobody listens any more");
}
