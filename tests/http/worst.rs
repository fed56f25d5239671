//! The request with the largest response, over every route, and slow readers of it.
//!
//! The search asks every route with every kind of query that any handler reads, up to the longest request line that the server takes, and then random
//! mixtures of them. What it finds is held by readers from two addresses: memory must stay within its bound, and others must be served meanwhile.

use super::client::{Client, loopback};
use super::portal::object;
use super::process::Server;
use super::{check_bound, check_none, full, noise};
use crate::eventually::eventually_async;
use fastrand::Rng;
use std::net::SocketAddr;
use std::time::Duration;
use tokio::io::AsyncWriteExt as _;

/// Longest query that the search sends; with the other headers it stays below what the server takes of a request.
const LONGEST: usize = 15_000;
/// Largest answer that is made in memory, bytes, whatever was asked.
const ANSWER_MAX: f64 = 512.0 * 1024.0;
/// Slow readers, from two addresses.
const READERS: usize = 400;

/// Every route whose answer is made for the request; files of the archive are streamed (`slow.rs`).
const PATHS: [&str; 26] = [
    "/",
    "/map",
    "/site.css",
    "/collections/",
    "/collections/some/",
    "/collections/some/feed.xml",
    "/oai",
    "/oembed",
    "/feed.xml",
    "/sitemap.xml",
    "/robots.txt",
    "/models.json",
    "/healthz",
    "/metrics",
    "/sign-in",
    "/fort-0",
    "/fort-0/",
    "/fort-0/manifest.json",
    "/fort-0/extract",
    "/fort-0/extract/v1-whole.ply",
    "/m/plain",
    "/plain/extract",
    "/viewer/",
    "/packs/nothing.kilwa",
    "/uploads/fort-0",
    "/nothing/at/all",
];

/// Pieces of queries: a beginning, and what is repeated until the query is long enough; `#` is a number that is another one each time.
const PIECES: [(&str, &str); 24] = [
    ("", "kind=a#&"),
    ("", "subject=#&"),
    ("", "country=#&kind=#&period=#&licence=#&size=#&subject=#&"),
    ("", "kind=%22#&"),
    ("", "kind='#&"),
    ("", "subject=%ff%ff%ff#&"),
    ("q=", "x"),
    ("q=", "%ff"),
    ("q=", "a+"),
    ("lang=", "x"),
    ("lang=ar-", "x"),
    ("lang=sw&", "kind=a#&"),
    ("sort=newest&page=2&", "period=#&"),
    ("box=-180,-90,180,90&", "licence=#&"),
    ("box=", "0,"),
    ("next=/", "'"),
    ("next=/fort-0/%23", "%26"),
    ("verb=ListRecords&metadataPrefix=oai_dc&set=", "x"),
    ("verb=ListRecords&metadataPrefix=oai_dc", ""),
    ("verb=ListSets", ""),
    ("verb=ListIdentifiers&resumptionToken=,,,", "x"),
    ("verb=", "'"),
    ("verb=Identify&", "'#=1&"),
    ("url=http%3A%2F%2Fx%2Ffort-0%2F%23", "%27"),
];

/// A query of about `length` bytes.
fn query((begin, again): (&str, &str), length: usize) -> String {
    let mut query = begin.to_owned();
    for number in 0..length {
        if again.is_empty() || query.len() + again.len() > length {
            break;
        }
        query.push_str(&again.replace('#', &format!("{number:x}")));
    }
    query.truncate(length.max(begin.len()));
    query
}

/// What the search asks: every route with every piece, short and long, and mixtures.
fn addresses(mixtures: usize) -> Vec<String> {
    let mut all: Vec<String> = PATHS.iter().map(|path| (*path).to_owned()).collect();
    for path in PATHS {
        for piece in PIECES {
            all.extend([1_000, 2_000, LONGEST].map(|length| format!("{path}?{}", query(piece, length))));
        }
    }
    // All that is within the limits: ten values of each filter, in an address that is just short enough.
    for path in ["/", "/map"] {
        for (fill, length) in [("x", 1), ("'", 3), ("%22", 3), ("%26", 3), ("%E2%82%AC", 9), ("+", 1)] {
            let filters = ["country", "kind", "period", "licence", "size", "subject"];
            let room = 2_040 / 60 - "subject=00&".len();
            let value = fill.repeat(room / length);
            let pairs = (0..60).map(|n| format!("{}={}{value}", filters[n % 6], n / 6));
            all.push(format!("{path}?{}", pairs.collect::<Vec<_>>().join("&")));
        }
    }
    let ranges: Vec<String> = (0..64).map(|k| format!("{}-{}", k * 3, k * 3 + 1)).collect();
    all.push(format!("/packs/plain.kilwa/{}", ranges.join(",")));
    let mut dice = Rng::with_seed(11);
    for _ in 0..mixtures {
        let path = PATHS[dice.u64(..PATHS.len() as u64) as usize];
        let mut parts = Vec::new();
        let mut left = dice.u64(..LONGEST as u64) as usize;
        while left > 20 && parts.len() < 6 {
            let length = (dice.u64(..left as u64) + 1) as usize;
            parts.push(query(PIECES[dice.u64(..PIECES.len() as u64) as usize], length));
            left -= length;
        }
        all.push(format!("{path}?{}", parts.join("&")));
    }
    all
}

/// A museum of so many objects and collections.
fn museum(objects: usize) -> (Server, tempfile::TempDir) {
    let bytes = noise(4096, 3);
    let state = tempfile::tempdir().unwrap();
    let (cache, access) = (state.path().join("cache"), state.path().join("access.json"));
    crate::support::succeeds(&["access", "init", access.to_str().unwrap()]);
    let options = [
        "--cache",
        cache.to_str().unwrap(),
        "--access",
        access.to_str().unwrap(),
        "--url",
        "http://x",
        "--log",
        "json",
    ];
    let server = Server::start(&[("plain", &bytes)], &options);
    for number in 0..objects {
        object(&server.folder(), number, &bytes);
    }
    let members: Vec<String> = (0..objects).map(|n| format!("\"fort-{n}\"")).collect();
    let set = |slug: &str, members: &str| {
        format!("[[collection]]\nslug = \"{slug}\"\ntitle = \"A set\"\nmembers = [{members}]\n")
    };
    let mut collections = vec![set("some", &members.join(", "))];
    collections.extend((0..objects).map(|number| set(&format!("set-{number}"), "")));
    std::fs::write(server.folder().join("collections.toml"), collections.concat()).unwrap();
    (server, state)
}

/// Until the server has noticed what was put there.
async fn noticed(address: SocketAddr, objects: usize) {
    eventually_async("all objects and collections", async || {
        let mut client = Client::connect(address).await.unwrap();
        let list = client.get("/", "").await.unwrap();
        let sets = client.get("/oai?verb=ListSets", "").await.unwrap();
        let found = String::from_utf8_lossy(&list.body).replace(',', "").contains(&format!("found: {objects}"));
        (found && String::from_utf8_lossy(&sets.body).contains("set-0")).then_some(())
    })
    .await;
}

/// Ask each; the largest answers first, with their addresses, and what was answered with an error of the server.
async fn search(server: SocketAddr, addresses: Vec<String>) -> (Vec<(usize, String)>, Vec<String>) {
    let (mut answers, mut wrong) = (Vec::new(), Vec::new());
    let mut client = Client::connect(server).await.unwrap();
    for address in addresses {
        let mut answered = client.get(&address, "").await;
        if answered.is_err() {
            // The connection was closed behind a refusal.
            client = Client::connect(server).await.unwrap();
            answered = client.get(&address, "").await;
        }
        let answer = answered.unwrap();
        if answer.status >= 500 && answer.status != 501 {
            wrong.push(format!("{}: {}", answer.status, address.chars().take(100).collect::<String>()));
        }
        answers.push((answer.head.len() + answer.body.len(), address));
    }
    answers.sort_by_key(|(bytes, _)| std::cmp::Reverse(*bytes));
    (answers, wrong)
}

/// Request `address` and read hardly anything of the response.
async fn slow_reader(number: usize, server: SocketAddr, address: &str) -> Client {
    let mut client = Client::connect_from(loopback(number % 2), server, Some(4096)).await.unwrap();
    client.stream.write_all(format!("GET {address} HTTP/1.1\r\nHost: x\r\n\r\n").as_bytes()).await.unwrap();
    client
}

/// What `READERS` slow readers of an address cost above `before`, MiB; others are served meanwhile.
async fn held(server: &Server, before: f64, address: &str) -> Option<f64> {
    let mut readers = Vec::new();
    for number in 0..READERS {
        readers.push(slow_reader(number, server.address, address).await);
    }
    let (mut peak, mut buffer) = (0.0_f64, vec![0; 512]);
    for _ in 0..if full() { 12 } else { 4 } {
        // The readers are this slow; the pause waits for no state.
        tokio::time::sleep(Duration::from_millis(250)).await;
        for reader in &mut readers {
            // Where nothing has come, or no more comes, there is nothing to take.
            drop(reader.stream.try_read(&mut buffer));
        }
        peak = peak.max(server.memory()?);
    }
    let mut other = Client::connect_from(loopback(7000), server.address, None).await.unwrap();
    for page in ["/?q=coral", "/map", "/fort-1/"] {
        assert_eq!(other.get(page, "").await.unwrap().status, 200, "{page} beside slow readers of another");
    }
    Some((peak - before) / 1_048_576.0)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_request_gets_a_disproportionate_response_and_slow_readers_use_little_memory() {
    let (objects, mixtures) = if full() { (2_000, 5_000) } else { (150, 300) };
    let (server, _state) = museum(objects);
    noticed(server.address, objects).await;
    let addresses = addresses(mixtures);
    let asked = addresses.len();
    let (answers, wrong) = search(server.address, addresses).await;
    let before = server.memory().unwrap_or_default();
    for (bytes, address) in answers.iter().take(5) {
        println!(
            "{bytes} bytes to {} of the address: {}",
            address.len(),
            address.chars().take(100).collect::<String>()
        );
    }
    check_none("addresses with an error of the server", asked, &wrong);
    let mut worst: Vec<&str> = vec![&answers[0].1];
    // The one that was found from outside, and the largest of each other route.
    let found = format!("/?{}", query(PIECES[0], LONGEST));
    worst.push(&found);
    if full() {
        for path in PATHS {
            worst.extend(answers.iter().map(|a| a.1.as_str()).find(|a| a.split('?').next() == Some(path)));
        }
        worst.dedup();
    }
    let mut peak = 0.0_f64;
    for address in worst {
        let Some(grown) = held(&server, before, address).await else {
            println!("skipped: memory of slow readers, which this system does not report");
            break;
        };
        println!("{grown:.1} MiB for {READERS} slow readers of {}", address.chars().take(100).collect::<String>());
        peak = peak.max(grown);
    }
    check_bound(&format!("memory for {READERS} slow readers of the worst address, from two"), "MiB", 64.0, peak);
    // What is streamed may be of any length.
    let made = answers.iter().find(|(_, a)| !["/models.json", "/sitemap.xml"].iter().any(|s| a.starts_with(s)));
    let largest = made.map_or(0, |(bytes, _)| *bytes) as f64;
    check_bound("largest answer that is made in memory, over every route", "bytes", ANSWER_MAX, largest);
}
