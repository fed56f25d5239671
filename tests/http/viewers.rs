//! Many people who look at a model at the same time.

use crate::client::{Client, loopback};
use crate::process::Server;
use crate::{Dice, claim, claim_none, claim_when_quiet, full, noise, quantile};
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Barrier;

const URL: &str = "/packs/fort.kilwa";
const CHUNK: u64 = 64 * 1024;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_crowd_of_viewers_is_served_without_an_error_and_leaves_nothing_behind() {
    let (viewers, rounds) = if full() { (500, 120) } else { (60, 8) };
    let bytes: &'static [u8] = Vec::leak(noise(64 << 20, 13));
    let server = Server::start(&[("fort", bytes)], &[]);
    let address = server.address;
    // The hash of the pack is known after the first request.
    assert_eq!(Client::connect(address).await.unwrap().ask("HEAD", URL, "").await.unwrap().status, 200);
    tokio::time::sleep(Duration::from_millis(300)).await;
    let files_before = server.files();
    // All meet after a third and at the end, while memory is read.
    let barrier = Arc::new(Barrier::new(viewers + 1));
    let crowd: Vec<_> = (0..viewers)
        .map(|number| {
            let barrier = Arc::clone(&barrier);
            tokio::spawn(async move {
                let mut client = Client::connect_from(loopback(number / 4), address, None).await.unwrap();
                let mut dice = Dice(number as u64 + 1);
                let (mut wrong, mut times) = (Vec::new(), Vec::new());
                for round in 0..rounds {
                    if round == rounds / 3 {
                        barrier.wait().await;
                        barrier.wait().await;
                    }
                    let from = dice.below(bytes.len() as u64 - CHUNK);
                    let began = Instant::now();
                    let answer = client.get(URL, &format!("Range: bytes={from}-{}\r\n", from + CHUNK - 1)).await;
                    times.push(began.elapsed().as_secs_f64() * 1e3);
                    match answer {
                        Ok(a) if a.status == 206 && a.body == bytes[from as usize..(from + CHUNK) as usize] => {}
                        Ok(a) => wrong.push(a.head),
                        Err(e) => wrong.push(e.to_string()),
                    }
                }
                barrier.wait().await;
                barrier.wait().await;
                (wrong, times)
            })
        })
        .collect();
    barrier.wait().await;
    let early = server.memory();
    barrier.wait().await;
    let began = Instant::now();
    barrier.wait().await;
    let (late, took) = (server.memory(), began.elapsed());
    barrier.wait().await;
    let (mut wrong, mut times) = (Vec::new(), Vec::new());
    for viewer in crowd {
        let (w, t) = viewer.await.unwrap();
        wrong.extend(w);
        times.extend(t);
    }
    let served = (viewers * (rounds - rounds / 3)) as f64;
    println!(
        "{viewers} viewers, {} ranges of 64 KiB: {:.0} a second, median {:.1} ms, 99th percentile {:.1} ms",
        times.len(),
        served / took.as_secs_f64(),
        quantile(&times, 0.5),
        quantile(&times, 0.99)
    );
    claim_none(&format!("errors of {viewers} viewers"), times.len(), &wrong);
    let (Some(early), Some(late), Some(files_before)) = (early, late, files_before) else {
        println!("skipped: memory and descriptors of a crowd, which this system does not tell");
        return;
    };
    claim_when_quiet(
        &format!("memory that grows while {viewers} viewers go on"),
        "MiB",
        16.0,
        (late - early) / 1_048_576.0,
    );
    let mut left = usize::MAX;
    for _ in 0..100 {
        left = server.files().unwrap();
        if left <= files_before {
            break;
        }
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    claim("descriptors left when they have gone", "above before", 0.0, left.saturating_sub(files_before) as f64);
}
