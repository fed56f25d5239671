//! Ranges and conditions: a table of requests and expected responses, and random ranges compared with the file.

use super::client::Client;
use super::process::Server;
use super::{check_none, full, noise};

const LENGTH: usize = 1000;
const URL: &str = "/packs/fort.kilwa";

/// The expected response.
#[derive(Clone, Copy)]
enum Wanted {
    /// 200 and all of it.
    Whole,
    /// 206 and the bytes from first to last.
    Part(usize, usize),
    /// 416.
    Beyond,
    /// Another status, without the file.
    Status(u16),
}
use Wanted::{Beyond, Part, Status, Whole};
use fastrand::Rng;

/// `Range` and what it means in a file of [`LENGTH`] bytes.
const RANGES: [(&str, Wanted); 49] = [
    ("bytes=0-0", Part(0, 0)),
    ("bytes=0-1", Part(0, 1)),
    ("bytes=1-1", Part(1, 1)),
    ("bytes=0-499", Part(0, 499)),
    ("bytes=500-999", Part(500, 999)),
    ("bytes=0-998", Part(0, 998)),
    ("bytes=0-999", Part(0, 999)),
    ("bytes=0-1000", Part(0, 999)),
    ("bytes=0-4294967296", Part(0, 999)),
    ("bytes=0-18446744073709551615", Part(0, 999)),
    ("bytes=0-18446744073709551616", Part(0, 999)),
    ("bytes=998-99999999999999999999999999999999", Part(998, 999)),
    ("bytes=999-999", Part(999, 999)),
    ("bytes=999-1000", Part(999, 999)),
    ("bytes=0-", Part(0, 999)),
    ("bytes=1-", Part(1, 999)),
    ("bytes=999-", Part(999, 999)),
    ("bytes=-1", Part(999, 999)),
    ("bytes=-999", Part(1, 999)),
    ("bytes=-1000", Part(0, 999)),
    ("bytes=-1001", Part(0, 999)),
    ("bytes=-99999999999999999999999", Part(0, 999)),
    ("bytes=00000-00009", Part(0, 9)),
    ("bytes= 3-4", Part(3, 4)),
    ("Bytes=3-4", Part(3, 4)),
    ("BYTES=3-4", Part(3, 4)),
    ("bytes=1000-", Beyond),
    ("bytes=1000-1000", Beyond),
    ("bytes=1001-2000", Beyond),
    ("bytes=4294967296-", Beyond),
    ("bytes=99999999999999999999-", Beyond),
    ("bytes=-0", Beyond),
    ("bytes=", Whole),
    ("bytes=-", Whole),
    ("bytes=--1", Whole),
    ("bytes=5-3", Whole),
    ("bytes=a-b", Whole),
    ("bytes=1-b", Whole),
    ("bytes=0x0-0x9", Whole),
    ("bytes=+1-2", Whole),
    ("bytes=1.5-2", Whole),
    ("bytes=0-1,5-6", Whole),
    ("bytes=0-,0-", Whole),
    ("bytes=0-0,-1", Whole),
    ("bytes 0-1", Whole),
    ("0-1", Whole),
    ("items=0-1", Whole),
    ("seconds=0-1", Whole),
    ("bytes=\u{661}-\u{662}", Whole),
];

/// Method, header lines (`TAG` is replaced by the file's ETag) and the expected response.
const CONDITIONS: [(&str, &str, Wanted); 31] = [
    ("GET", "", Whole),
    ("HEAD", "", Status(200)),
    ("HEAD", "Range: bytes=0-9\r\n", Status(200)),
    ("HEAD", "If-None-Match: TAG\r\n", Status(304)),
    ("GET", "If-None-Match: TAG\r\n", Status(304)),
    ("GET", "If-None-Match: W/TAG\r\n", Status(304)),
    ("GET", "If-None-Match: \"a\", TAG\r\n", Status(304)),
    ("GET", "If-None-Match: \"a\"\r\nIf-None-Match: TAG\r\n", Status(304)),
    ("GET", "If-None-Match: *\r\n", Status(304)),
    ("GET", "If-None-Match: \"a\"\r\n", Whole),
    ("GET", "If-None-Match: TAG\r\nRange: bytes=0-9\r\n", Status(304)),
    ("GET", "If-None-Match: \"a\"\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-Match: TAG\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-Match: *\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-Match: W/TAG\r\n", Status(412)),
    ("GET", "If-Match: \"a\"\r\nRange: bytes=0-9\r\n", Status(412)),
    // Tags with bytes that are no ASCII are tags all the same.
    ("GET", "If-Match: \"é\"\r\nRange: bytes=0-9\r\n", Status(412)),
    ("GET", "If-Match: \"é\", TAG\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-None-Match: \"é\"\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-Range: \"é\"\r\nRange: bytes=0-9\r\n", Whole),
    ("GET", "If-Range: TAG\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("GET", "If-Range: TAG\r\nRange: bytes=1000-\r\n", Beyond),
    ("GET", "If-Range: TAG\r\n", Whole),
    ("GET", "If-Range: W/TAG\r\nRange: bytes=0-9\r\n", Whole),
    ("GET", "If-Range: \"a\"\r\nRange: bytes=0-9\r\n", Whole),
    ("GET", "If-Range: \"a\"\r\nRange: bytes=1000-\r\n", Whole),
    ("GET", "If-Range: Sat, 21 Nov 2026 00:00:00 GMT\r\nRange: bytes=0-9\r\n", Whole),
    ("GET", "Range: bytes=0-9\r\nRange: bytes=10-19\r\n", Whole),
    ("GET", "Accept-Encoding: gzip, br\r\nRange: bytes=0-9\r\n", Part(0, 9)),
    ("POST", "Content-Length: 0\r\n", Status(405)),
    ("DELETE", "", Status(405)),
];

#[tokio::test]
async fn every_request_in_the_table_is_answered_exactly() {
    let bytes = noise(LENGTH, 3);
    let server = Server::start(&[("fort", &bytes)], &[]);
    let mut client = Client::connect(server.address).await.unwrap();
    let tag = client.ask("HEAD", URL, "").await.unwrap().header("etag").to_owned();
    assert!(tag.starts_with('"') && tag.len() == 66, "strong, and a hash: {tag}");
    let ranges = RANGES.iter().map(|(range, wanted)| ("GET", format!("Range: {range}\r\n"), *wanted));
    let conditions = CONDITIONS.iter().map(|(method, lines, wanted)| (*method, lines.replace("TAG", &tag), *wanted));
    let rows: Vec<_> = ranges.chain(conditions).collect();
    let mut wrong = Vec::new();
    for (method, lines, wanted) in &rows {
        let a = client.ask(method, URL, lines).await.unwrap();
        let (status, body, range) = match *wanted {
            Whole => (200, &bytes[..], String::new()),
            Part(from, to) => (206, &bytes[from..=to], format!("bytes {from}-{to}/{LENGTH}")),
            Beyond => (416, &b"416 Range Not Satisfiable\n"[..], format!("bytes */{LENGTH}")),
            Status(status) => (status, &a.body[..], String::new()),
        };
        let sound = a.status == status
            && a.body == body
            && a.header("content-range") == range
            && a.header("content-encoding").is_empty()
            && (status == 405 || a.header("etag") == tag && a.header("accept-ranges") == "bytes")
            && (*method != "HEAD" || status != 200 || a.header("content-length") == LENGTH.to_string());
        if !sound {
            wrong.push(format!("{method} {lines:?}: {}", a.head));
        }
    }
    assert!(rows.len() >= 60, "{}", rows.len());
    check_none("range table: answers that are not exact", rows.len(), &wrong);
}

/// One random request of each form that the RFC has, and the bytes that it means.
fn random(dice: &mut Rng, length: u64) -> (String, std::ops::Range<usize>) {
    let from = dice.u64(..length);
    let some = dice.u64(..length - from).min(dice.u64(..200_000));
    let range = |a: u64, b: u64| a as usize..b as usize;
    match dice.u64(..10) {
        0 => {
            let last = dice.u64(..100_000) + 1;
            (format!("bytes=-{last}"), range(length - last.min(length), length))
        }
        1 => {
            let from = length - dice.u64(..100_000.min(length)) - 1;
            (format!("bytes={from}-"), range(from, length))
        }
        2 => (format!("bytes={from}-{from}"), range(from, from + 1)),
        _ => (format!("bytes={from}-{}", from + some), range(from, from + some + 1)),
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn random_ranges_are_the_bytes_of_the_file() {
    const CLIENTS: u64 = 8;
    let each = if full() { 12_500 } else { 250 };
    let bytes: &'static [u8] = Vec::leak(noise(20_000_003, 11));
    let server = Server::start(&[("fort", bytes)], &[]);
    let clients = (0..CLIENTS).map(|seed| {
        let address = server.address;
        tokio::spawn(async move {
            let mut client = Client::connect(address).await.unwrap();
            let mut dice = Rng::with_seed(seed + 1);
            let mut wrong = Vec::new();
            for _ in 0..each {
                let (value, wanted) = random(&mut dice, bytes.len() as u64);
                let a = client.get(URL, &format!("Range: {value}\r\n")).await.unwrap();
                let place = format!("bytes {}-{}/{}", wanted.start, wanted.end - 1, bytes.len());
                if a.status != 206 || a.header("content-range") != place || a.body != bytes[wanted] {
                    wrong.push(format!("{value}: {}", a.head));
                }
            }
            wrong
        })
    });
    let mut wrong = Vec::new();
    for client in clients.collect::<Vec<_>>() {
        wrong.extend(client.await.unwrap());
    }
    check_none("random ranges that are not the bytes of the file", (CLIENTS * each) as usize, &wrong);
}

/// The suffix of the pack's address, and the ranges that it means; none if there is no such address.
const SEVERAL: [(&str, &[(usize, usize)]); 24] = [
    ("0-999", &[(0, 999)]),
    ("5-5", &[(5, 5)]),
    ("0-9,20-29", &[(0, 9), (20, 29)]),
    ("20-29,0-9", &[(20, 29), (0, 9)]),
    ("990-999,0-0,500-599", &[(990, 999), (0, 0), (500, 599)]),
    ("0-9,10-19", &[(0, 9), (10, 19)]),
    ("00-09", &[(0, 9)]),
    ("0-9%2C20-29", &[(0, 9), (20, 29)]),
    ("0-1000", &[]),
    ("0-9,999-1000", &[]),
    ("0-9,9-19", &[]),
    ("0-9,0-9", &[]),
    ("5-9,0-999", &[]),
    ("9-0", &[]),
    ("0-", &[]),
    ("-9", &[]),
    ("0-9,", &[]),
    (",", &[]),
    ("0-9;20-29", &[]),
    ("0-9, 20-29", &[]),
    ("a-b", &[]),
    ("0-9/20-29", &[]),
    ("18446744073709551615-18446744073709551616", &[]),
    ("../fort.kilwa", &[]),
];

#[tokio::test]
async fn several_ranges_in_an_address_are_answered_in_order() {
    let bytes = noise(LENGTH, 3);
    let server = Server::start(&[("fort", &bytes)], &[]);
    let mut client = Client::connect(server.address).await.unwrap();
    let head = client.ask("HEAD", URL, "").await.unwrap();
    let tag = head.header("etag").to_owned();
    assert_eq!(head.header("kilwa-ranges"), "64");
    assert!(head.header("access-control-expose-headers").contains("Kilwa-Ranges"));
    let hash = tag.trim_matches('"');
    let mut wrong = Vec::new();
    for address in [URL.to_owned(), format!("/packs/fort.{hash}.kilwa")] {
        for (ranges, wanted) in SEVERAL {
            let path = format!("{address}/{}", ranges.replace(' ', "%20"));
            let a = client.ask("GET", &path, "").await.unwrap();
            let body: Vec<u8> = wanted.iter().flat_map(|&(from, to)| bytes[from..=to].iter().copied()).collect();
            let sound = match wanted {
                [] => a.status == 404,
                _ => {
                    a.status == 200 && a.body == body && a.header("etag") == tag && a.header("content-range").is_empty()
                }
            };
            if !sound {
                wrong.push(format!("{path}: {}", a.head));
            }
        }
    }
    let several = format!("{URL}/0-9,20-29");
    let fresh = client.ask("GET", &several, &format!("If-None-Match: {tag}\r\n")).await.unwrap();
    let other = client.ask("GET", &several, "If-Match: \"other\"\r\n").await.unwrap();
    let short = client.ask("HEAD", &several, "").await.unwrap();
    let ranged = client.ask("GET", &several, "Range: bytes=0-3\r\n").await.unwrap();
    assert_eq!((fresh.status, other.status, short.status), (304, 412, 200));
    assert_eq!((short.header("content-length"), ranged.status, ranged.body.len()), ("20", 200, 20));
    check_none("several ranges: answers that are not exact", 2 * SEVERAL.len(), &wrong);
}

#[tokio::test]
async fn random_lists_of_ranges_are_the_bytes_of_the_file() {
    let bytes = noise(3_000_000, 9);
    let server = Server::start(&[("fort", &bytes)], &[]);
    let mut client = Client::connect(server.address).await.unwrap();
    let mut dice = Rng::with_seed(77);
    let (count, mut wrong) = (if full() { 20_000 } else { 1_000 }, Vec::new());
    for _ in 0..count {
        // Apart from each other, of every length, in any order.
        let mut ranges = Vec::new();
        let mut at = dice.u64(..40_000);
        while ranges.len() < 64 && at < bytes.len() as u64 {
            let max = 1 << (1 + dice.u64(..17));
            let end = (at + dice.u64(..max)).min(bytes.len() as u64 - 1);
            ranges.push(at as usize..end as usize + 1);
            at = end + 1 + dice.u64(..90_000);
        }
        for i in (1..ranges.len()).rev() {
            ranges.swap(i, dice.u64(..=(i as u64)) as usize);
        }
        if ranges.is_empty() {
            continue;
        }
        let list: Vec<String> = ranges.iter().map(|r| format!("{}-{}", r.start, r.end - 1)).collect();
        let a = client.ask("GET", &format!("{URL}/{}", list.join(",")), "").await.unwrap();
        let wanted: Vec<u8> = ranges.into_iter().flat_map(|r| bytes[r].iter().copied()).collect();
        if a.status != 200 || a.body != wanted {
            wrong.push(format!("{}: {}", list.join(","), a.head));
        }
    }
    check_none("random lists of ranges that are not the bytes of the file", count, &wrong);
}
