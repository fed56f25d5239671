//! Many readers of the portal at the same time: catalogue, search, map, collection, landing page, downloads, and the pack by ranges.

use super::client::Client;
use super::crowd::{Crowd, Reader};
use super::process::Server;
use super::{full, noise, quantile, remark};
use crate::eventually::eventually_async;
use kilwa_archive::checksums::sha256;
use serde_json::json;
use std::path::Path;
use std::time::Instant;

const OBJECTS: usize = 40;
const CHUNK: u64 = 64 * 1024;

/// An object as publishing writes it, as far as serving looks; the address of its pack.
pub(crate) fn object(folder: &Path, number: usize, pack: &[u8]) -> String {
    let slug = format!("fort-{number}");
    let home = folder.join(&slug);
    std::fs::create_dir_all(home.join("v1/metadata")).unwrap();
    let sum = sha256(pack);
    let name = format!("pack.{sum}.kilwa");
    let page = format!(
        "<!doctype html><html><head><title>{slug}</title></head><body data-list=\"\"><ul class=\"files\"></ul></body></html>"
    );
    let list = format!("{sum}  {name}\n");
    std::fs::write(home.join("v1").join(&name), pack).unwrap();
    std::fs::write(home.join("v1/checksums.sha256"), &list).unwrap();
    std::fs::write(home.join("index.html"), &page).unwrap();
    let rights = json!({"uri": "https://creativecommons.org/licenses/by/4.0/", "label": "Attribution 4.0", "short": "CC BY 4.0"});
    let title = format!("Fort {number} of coral stone");
    let metadata = json!({
        "title": title, "language": "en", "rights": {"uri": rights["uri"]}, "model": {"units": "m"},
        "place": {"country": "TZ", "latitude": number as f64 - 20.0, "longitude": 39.0},
    });
    std::fs::write(home.join("v1/metadata/metadata.json"), metadata.to_string()).unwrap();
    let manifest = json!({
        "kilwa": 1, "slug": slug, "title": title, "language": "en", "rights": rights, "citation": "Example.", "tool": "test",
        "access": {"state": "public"}, "current": 1, "page": {"url": "index.html", "bytes": page.len(), "sha256": sha256(page.as_bytes())},
        "versions": [{
            "version": 1, "folder": "v1", "published": "2026-11-21", "note": "first",
            "pack": {"url": format!("v1/{name}"), "bytes": pack.len(), "sha256": sum, "identity": "b".repeat(32)},
            "checksums": {"url": "v1/checksums.sha256", "bytes": list.len(), "sha256": sha256(list.as_bytes())},
            "figures": {"bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], "units": "m", "source_units": "m", "triangles": 1000, "vertices": 500, "spacing": 0.1},
        }],
    });
    std::fs::write(home.join("manifest.json"), manifest.to_string()).unwrap();
    format!("/{slug}/v1/{name}")
}

/// One reader's round: pages, each with a word that it must have, and ranges of a pack.
async fn round(mut r: Reader, packs: &[String], bytes: &[u8]) -> Reader {
    let number = r.dice.u64(..packs.len() as u64) as usize;
    let pages = [
        ("/?sort=newest".to_owned(), "class=\"card\""),
        (format!("/?q=fort+{number}&lang=sw"), "of coral stone"),
        ("/map?country=TZ".to_owned(), "class=\"land\""),
        ("/collections/some/".to_owned(), "class=\"card\""),
        (format!("/fort-{number}/"), "PLY, GLB, OBJ, STL"),
        (format!("/fort-{number}/extract"), "value=\"stl\""),
    ];
    for (address, word) in pages {
        let began = Instant::now();
        match r.client.get(&address, "").await {
            Ok(a) if a.status == 200 && String::from_utf8_lossy(&a.body).contains(word) => {}
            Ok(a) => r.wrong.push(format!("{address}: {}", a.head)),
            Err(e) => r.wrong.push(format!("{address}: {e}")),
        }
        r.times.push(began.elapsed().as_secs_f64() * 1e3);
    }
    for _ in 0..10 {
        let from = r.dice.u64(..bytes.len() as u64 - CHUNK);
        match r.client.get(&packs[number], &format!("Range: bytes={from}-{}\r\n", from + CHUNK - 1)).await {
            Ok(a) if a.status == 206 && a.body == bytes[from as usize..(from + CHUNK) as usize] => {}
            Ok(a) => r.wrong.push(a.head),
            Err(e) => r.wrong.push(e.to_string()),
        }
    }
    r
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn many_readers_get_every_page_and_byte_without_leaking_resources() {
    let (readers, rounds) = if full() { (500, 12) } else { (30, 3) };
    let bytes: &'static [u8] = Vec::leak(noise(1 << 20, 17));
    let cache = tempfile::tempdir().unwrap();
    let index = cache.path().join("index.sqlite");
    let options = ["--cache", cache.path().to_str().unwrap(), "--index", index.to_str().unwrap()];
    let server = Server::start(&[("plain", bytes)], &options);
    let packs: Vec<String> = (0..OBJECTS).map(|number| object(&server.folder(), number, bytes)).collect();
    let members: Vec<String> = (0..30).map(|n| format!("\"fort-{n}\"")).collect();
    let collection = format!("[[collection]]\nslug = \"some\"\ntitle = \"Some\"\nmembers = [{}]\n", members.join(", "));
    std::fs::write(server.folder().join("collections.toml"), collection).unwrap();
    let address = server.address;
    // Until the new files are noticed: the server checks the folder once a second.
    eventually_async("all objects in the catalogue and in the collection", async || {
        let mut client = Client::connect(address).await.unwrap();
        let found = client.get("/?q=coral", "").await.unwrap();
        let set = client.get("/collections/some/", "").await.unwrap();
        let are_there = String::from_utf8_lossy(&found.body).contains("Models found: 40")
            && String::from_utf8_lossy(&set.body).contains("Models: 30");
        are_there.then_some(())
    })
    .await;
    server.quiet().await;
    let packs: &'static [String] = Vec::leak(packs);
    let crowd =
        Crowd::gather(&server, (readers, "readers of the portal"), rounds, |reader| round(reader, packs, bytes)).await;
    let [median, slow] = [0.5, 0.95].map(|share| quantile(&crowd.times, share));
    remark(&format!(
        "{readers} readers of the portal, {} pages: median {median:.1} ms, 95th percentile {slow:.1} ms",
        crowd.times.len()
    ));
    // The index keeps a few connections of its own.
    crowd.check_bounds(&server, 64.0, 8).await;
}
