//! Many readers at the same time, each with a connection of its own: errors, response times, the growth of the server's memory
//! meanwhile, and the descriptors it holds afterwards.

use super::client::{Client, loopback};
use super::process::Server;
use super::{check_bound, check_none};
use crate::eventually::eventually_async;
use fastrand::Rng;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::sync::Barrier;

/// One reader.
pub(crate) struct Reader {
    pub(crate) client: Client,
    pub(crate) dice: Rng,
    /// Wrong responses.
    pub(crate) wrong: Vec<String>,
    /// Of the answers, milliseconds.
    pub(crate) times: Vec<f64>,
}

/// The results of a crowd.
pub(crate) struct Crowd {
    who: String,
    wrong: Vec<String>,
    pub(crate) times: Vec<f64>,
    /// From when a third of the rounds were over until the last reader had ended.
    pub(crate) took: Duration,
    /// Of the server in that time, MiB, and its descriptors before; `None` if the system does not report it.
    grown: Option<(f64, usize)>,
}

impl Crowd {
    /// Let `count` readers, who are called `who`, go `rounds` rounds each. All meet after a third and at the end, while memory is read.
    pub(crate) async fn gather<R, F>(server: &Server, (count, who): (usize, &str), rounds: usize, round: R) -> Self
    where
        R: Fn(Reader) -> F + Clone + Send + 'static,
        F: Future<Output = Reader> + Send,
    {
        let (address, files) = (server.address, server.files());
        let barrier = Arc::new(Barrier::new(count + 1));
        let readers: Vec<_> = (0..count)
            .map(|number| {
                let (barrier, round) = (Arc::clone(&barrier), round.clone());
                tokio::spawn(async move {
                    let client = Client::connect_from(loopback(number / 4), address, None).await.unwrap();
                    let dice = Rng::with_seed(number as u64 + 1);
                    let mut reader = Reader { client, dice, wrong: Vec::new(), times: Vec::new() };
                    for at in 0..rounds {
                        if at == rounds / 3 {
                            barrier.wait().await;
                            barrier.wait().await;
                        }
                        reader = round(reader).await;
                    }
                    barrier.wait().await;
                    barrier.wait().await;
                    (reader.wrong, reader.times)
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
        for reader in readers {
            let (w, t) = reader.await.unwrap();
            wrong.extend(w);
            times.extend(t);
        }
        let grown = early.zip(late).map(|(early, late)| (late - early) / 1_048_576.0).zip(files);
        Self { who: format!("{count} {who}"), wrong, times, took, grown }
    }

    /// State that nothing went wrong, that memory grew by at most `memory` MiB, and that at most `descriptors` more are held than before.
    pub(crate) async fn check_bounds(&self, server: &Server, memory: f64, descriptors: usize) {
        check_none(&format!("errors of {}", self.who), self.times.len(), &self.wrong);
        let Some((grown, before)) = self.grown else {
            println!("skipped: memory and descriptors under {}, which this system does not report", self.who);
            return;
        };
        check_bound(&format!("memory that grows while {} go on", self.who), "MiB", memory, grown);
        let what = format!("descriptors left when {} have gone", self.who);
        let gone = async || server.files().filter(|left| *left <= before + descriptors);
        let left = eventually_async(&format!("at most {descriptors} {what}"), gone).await;
        check_bound(&what, "above before", descriptors as f64, left.saturating_sub(before) as f64);
    }
}
