//! What a pack URL answers: exact ranges, strong tags, no surprises.

use crate::common::{ask, get, noise, site};
use std::fs::write;
use tempfile::TempDir;

fn folder(bytes: &[u8]) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path().join("fort.kilwa"), bytes).unwrap();
    dir
}

const URL: &str = "/packs/fort.kilwa";

#[tokio::test]
async fn a_whole_pack_is_served_byte_for_byte_and_never_compressed() {
    let bytes = noise(200_000, 7);
    let dir = folder(&bytes);
    let app = site(dir.path());
    let a = ask(&app, "GET", URL, &[("accept-encoding", "gzip, br")]).await;
    assert_eq!(a.status, 200);
    assert_eq!(a.body, bytes);
    assert_eq!(a.header("content-length"), "200000");
    assert_eq!(a.header("accept-ranges"), "bytes");
    assert_eq!(a.header("cache-control"), "no-cache");
    assert_eq!(a.header("etag"), format!("\"{}\"", blake3::hash(&bytes).to_hex()));
    assert!(!a.headers.contains_key("content-encoding"));
    assert_eq!(a.header("access-control-allow-origin"), "*");
    for name in ["ETag", "Content-Range", "Content-Length", "Accept-Ranges"] {
        assert!(a.header("access-control-expose-headers").contains(name), "{name}");
    }
    assert_eq!(a.header("cross-origin-resource-policy"), "cross-origin");
    assert_eq!(a.header("x-content-type-options"), "nosniff");
}

#[tokio::test]
async fn single_ranges_are_exact() {
    let bytes = noise(1000, 3);
    let dir = folder(&bytes);
    let app = site(dir.path());
    for (range, from, to) in [
        ("bytes=0-0", 0, 0),
        ("bytes=0-999", 0, 999),
        ("bytes=0-1000", 0, 999),
        ("bytes=0-18446744073709551616", 0, 999),
        ("bytes=999-999", 999, 999),
        ("bytes=500-", 500, 999),
        ("bytes=-1", 999, 999),
        ("bytes=-1000", 0, 999),
        ("bytes=-5000", 0, 999),
        ("BYTES=3-4", 3, 4),
    ] {
        let a = ask(&app, "GET", URL, &[("range", range)]).await;
        assert_eq!(a.status, 206, "{range}");
        assert_eq!(a.body, bytes[from..=to], "{range}");
        assert_eq!(a.header("content-range"), format!("bytes {from}-{to}/1000"), "{range}");
        assert_eq!(a.header("content-length"), (to - from + 1).to_string(), "{range}");
    }
    for range in ["bytes=1000-", "bytes=1000-1001", "bytes=-0", "bytes=99999999999999999999-"] {
        let a = ask(&app, "GET", URL, &[("range", range)]).await;
        assert_eq!(a.status, 416, "{range}");
        assert_eq!(a.header("content-range"), "bytes */1000", "{range}");
    }
    for range in ["bytes=0-1,5-6", "bytes=5-3", "bytes=x-y", "bytes=", "items=0-1", "bytes=-", "0-1"] {
        let a = ask(&app, "GET", URL, &[("range", range)]).await;
        assert_eq!((a.status.as_u16(), a.body.len()), (200, 1000), "{range}");
    }
}

#[tokio::test]
async fn many_random_ranges_equal_the_file() {
    let bytes = noise(300_000, 11);
    let dir = folder(&bytes);
    let app = site(dir.path());
    let mut random = fastrand::Rng::with_seed(1);
    for _ in 0..2000 {
        let from = random.u64(..300_000);
        let to = random.u64(from..300_000);
        let a = ask(&app, "GET", URL, &[("range", &format!("bytes={from}-{to}"))]).await;
        assert_eq!(a.status, 206);
        assert!(a.body == bytes[from as usize..=to as usize], "{from}-{to}");
    }
}

#[tokio::test]
async fn conditional_requests_follow_the_etag() {
    let dir = folder(&noise(1000, 3));
    let app = site(dir.path());
    let tag = get(&app, URL).await.header("etag").to_owned();
    let weak = format!("W/{tag}");
    let range = ("range", "bytes=0-9");
    for (headers, status) in [
        (vec![("if-none-match", tag.as_str())], 304),
        (vec![("if-none-match", weak.as_str())], 304),
        (vec![("if-none-match", "*")], 304),
        (vec![("if-none-match", "\"other\"")], 200),
        (vec![("if-none-match", tag.as_str()), range], 304),
        (vec![("if-match", tag.as_str()), range], 206),
        (vec![("if-match", weak.as_str()), range], 412),
        (vec![("if-match", "\"other\"")], 412),
        (vec![("if-range", tag.as_str()), range], 206),
        (vec![("if-range", weak.as_str()), range], 200),
        (vec![("if-range", "\"other\""), range], 200),
        (vec![("if-range", "Sat, 21 Nov 2026 00:00:00 GMT"), range], 200),
        (vec![("if-range", "\"other\""), ("range", "bytes=5000-")], 200),
    ] {
        let a = ask(&app, "GET", URL, &headers).await;
        assert_eq!(a.status, status, "{headers:?}");
        assert_eq!(a.header("etag"), tag, "{headers:?}");
        if status == 304 {
            assert!(a.body.is_empty());
        }
    }
}

#[tokio::test]
async fn head_answers_like_get_without_a_body() {
    let dir = folder(&noise(1000, 3));
    let app = site(dir.path());
    let a = ask(&app, "HEAD", URL, &[("range", "bytes=0-9")]).await;
    assert_eq!((a.status.as_u16(), a.header("content-length"), a.body.len()), (200, "1000", 0));
    assert_eq!(a.header("accept-ranges"), "bytes");
    let a = ask(&app, "OPTIONS", URL, &[("access-control-request-method", "GET")]).await;
    assert_eq!(a.status, 204);
    assert!(a.header("access-control-allow-headers").contains("Range"));
    assert_eq!(ask(&app, "POST", URL, &[]).await.status, 405);
}

#[tokio::test]
async fn only_the_address_with_the_hash_is_immutable() {
    let bytes = noise(1000, 3);
    let dir = folder(&bytes);
    let app = site(dir.path());
    let pinned = format!("/packs/fort.{}.kilwa", blake3::hash(&bytes).to_hex());
    let a = get(&app, &pinned).await;
    assert_eq!(a.status, 200);
    assert!(a.header("cache-control").contains("immutable"));
    assert_eq!(get(&app, &pinned.replace("fort.", "fort.0")).await.status, 404);
}

#[tokio::test]
async fn a_changed_file_gets_a_new_etag_at_once() {
    let dir = folder(&noise(1000, 3));
    let app = site(dir.path());
    let before = get(&app, URL).await;
    let changed = noise(1000, 4);
    // Replaced as a careful person does it, under another name first.
    write(dir.path().join("new"), &changed).unwrap();
    std::fs::rename(dir.path().join("new"), dir.path().join("fort.kilwa")).unwrap();
    let after = get(&app, URL).await;
    assert_ne!(before.header("etag"), after.header("etag"));
    assert_eq!(after.body, changed);
    let a = ask(&app, "GET", URL, &[("range", "bytes=0-9"), ("if-range", before.header("etag"))]).await;
    assert_eq!((a.status.as_u16(), a.body.len()), (200, 1000));
    std::fs::remove_file(dir.path().join("fort.kilwa")).unwrap();
    assert_eq!(get(&app, URL).await.status, 404);
}

#[tokio::test]
async fn no_address_reaches_outside_the_index() {
    let dir = folder(&noise(100, 3));
    write(dir.path().join("secret.txt"), "secret").unwrap();
    std::fs::create_dir(dir.path().join("sub")).unwrap();
    write(dir.path().join("sub/inner.kilwa"), "secret").unwrap();
    let app = site(dir.path());
    let up = ["..", "%2e%2e", "%252e%252e", "..%5c", "%c0%ae%c0%ae", "....", "%2e.", ".%2e", "%00", "..;"];
    let slash = ["/", "%2f", "%5c", "%252f", "//", "%c0%af"];
    let end = ["etc/passwd", "secret.txt", "fort.kilwa%00", "sub%2finner.kilwa", "sub/inner.kilwa"];
    let mut asked = 0;
    for root in ["/packs/", "/m/", "/viewer/", "/"] {
        for u in up {
            for s in slash {
                for e in end {
                    let a = get(&app, &format!("{root}{u}{s}{e}")).await;
                    assert!(matches!(a.status.as_u16(), 400 | 404), "{root}{u}{s}{e}: {}", a.status);
                    assert!(!a.text().contains("secret"));
                    asked += 1;
                }
            }
        }
    }
    assert_eq!(asked, 1200);
    for uri in ["/packs/secret.txt", "/packs/inner.kilwa", "/packs/.kilwa", "/packs/", "/m/", "/packs/FORT.kilwa"] {
        assert_eq!(get(&app, uri).await.status, 404, "{uri}");
    }
}
