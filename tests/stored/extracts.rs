//! Meshes on request, as `kilwa serve` makes them: the same bytes from a store and from a folder, and a small one reads a small part of the pack.

use super::{ARCHIVE, Keeper, grown};
use crate::bucket::Bucket;
use crate::eventually::eventually;
use crate::support::{built_once, succeeds, text};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Several megabytes: a hundred chunks.
fn large() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("stored");
    let write = |to: &Path| drop(succeeds(&["synth", "wall", "--triangles", "700000", "-o", text(to), "--force"]));
    built_once(&folder, "large", write, &[])
}

/// A site that is asked over its socket.
struct Reader(ureq::Agent, String);

impl Reader {
    fn of(address: std::net::SocketAddr) -> Self {
        let config = ureq::Agent::config_builder().http_status_as_error(false).max_redirects(0);
        let config = config.max_redirects_will_error(false).timeout_global(Some(Duration::from_secs(60)));
        Self(config.build().into(), format!("http://{address}"))
    }

    /// The file that a form leads to.
    fn extract(&self, form: &str) -> Vec<u8> {
        let kind = "application/x-www-form-urlencoded";
        let asked = self.0.post(format!("{}/fort/extract", self.1)).header("content-type", kind).send(form).unwrap();
        assert_eq!(asked.status(), 303, "{form}");
        let to = asked.headers()["location"].to_str().unwrap().split('?').next().unwrap().to_owned();
        eventually(form, || {
            let mut file = self.0.get(format!("{}{to}", self.1)).call().unwrap();
            match file.status().as_u16() {
                200 => Some(file.body_mut().with_config().limit(1 << 30).read_to_vec().unwrap()),
                202 => None,
                other => panic!("{form}: {other}"),
            }
        })
    }
}

#[test]
fn an_extract_from_a_store_equals_one_from_a_folder_and_a_small_one_reads_little_of_the_pack() {
    let Some(mut bucket) = Bucket::start("an_extract_of_a_pack_in_a_store_is_that_of_the_folder…") else { return };
    let keeper = Keeper::of(&bucket);
    let (local, pack) = (keeper.publish_here(), std::fs::read(large()).unwrap());
    grown(&local.join("fort"), &pack);
    bucket.sync(&local, "archive/of forts");
    let (here, there) = (keeper.path("cache-folder"), keeper.path("cache-store"));
    let of_folder = keeper.serve_with(&[text(&local), "--cache", text(&here)]);
    let of_store = keeper.serve_with(&[ARCHIVE, "--s3-endpoint", &keeper.endpoint, "--cache", text(&there)]);
    let (folder, store) = (Reader::of(of_folder.address), Reader::of(of_store.address));
    bucket.proxy.carried();
    let small = store.extract("format=ply&detail=triangles&triangles=2000");
    let carried = bucket.proxy.carried();
    println!("2,000 triangles of a pack of {} bytes: {carried} bytes were fetched", pack.len());
    // Four blocks of 256 KiB, of eleven: head, directory, and some chunks.
    assert!(carried < 1 << 20 && pack.len() > 5 << 19, "{carried} of {}", pack.len());
    assert!(small == folder.extract("format=ply&detail=triangles&triangles=2000"));
    // Each format, and each kind of detail, once.
    let details = ["detail=triangles&triangles=60000", "detail=error&error=0.05", "detail=whole", "detail=whole"];
    for (format, detail) in ["ply", "glb", "obj", "stl"].into_iter().zip(details) {
        let form = format!("format={format}&{detail}");
        assert!(store.extract(&form) == folder.extract(&form), "{form}");
    }
}
