//! Many people who look at a model at the same time.

use super::client::Client;
use super::crowd::{Crowd, Reader};
use super::process::Server;
use super::{full, noise, quantile, remark};
use std::time::Instant;

const URL: &str = "/packs/fort.kilwa";
const CHUNK: u64 = 64 * 1024;

/// A part of the pack, anywhere in it.
async fn part(mut r: Reader, bytes: &[u8]) -> Reader {
    let from = r.dice.u64(..bytes.len() as u64 - CHUNK);
    let began = Instant::now();
    let answer = r.client.get(URL, &format!("Range: bytes={from}-{}\r\n", from + CHUNK - 1)).await;
    r.times.push(began.elapsed().as_secs_f64() * 1e3);
    match answer {
        Ok(a) if a.status == 206 && a.body == bytes[from as usize..(from + CHUNK) as usize] => {}
        Ok(a) => r.wrong.push(a.head),
        Err(e) => r.wrong.push(e.to_string()),
    }
    r
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_viewers_are_served_without_errors_or_leaks() {
    let (viewers, rounds) = if full() { (500, 120) } else { (60, 8) };
    let bytes: &'static [u8] = Vec::leak(noise(64 << 20, 13));
    let server = Server::start(&[("fort", bytes)], &[]);
    // The hash of the pack is known after the first request.
    let first = Client::connect(server.address).await.unwrap().ask("HEAD", URL, "").await.unwrap();
    assert_eq!(first.status, 200);
    server.quiet().await;
    let crowd = Crowd::gather(&server, (viewers, "viewers"), rounds, |reader| part(reader, bytes)).await;
    let served = (viewers * (rounds - rounds / 3)) as f64;
    let [median, slow] = [0.5, 0.99].map(|share| quantile(&crowd.times, share));
    remark(&format!(
        "{viewers} viewers, {} ranges of 64 KiB: {:.0} a second, median {median:.1} ms, 99th percentile {slow:.1} ms",
        crowd.times.len(),
        served / crowd.took.as_secs_f64()
    ));
    crowd.check_bounds(&server, 16.0, 0).await;
}
