//! Meshes in a store that cannot be read from there, and stores that cannot be used.

use super::busy::{Trouble, proxy};
use super::{Seaweed, Site};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A GLB without a mesh that has an image.
fn glb(image: &str, padding: usize) -> Vec<u8> {
    let json = format!(r#"{{"asset":{{"version":"2.0"}},"images":[{image}]{}}}"#, " ".repeat(padding));
    let length = json.len() as u32;
    let words = [2, 20 + length, length, 0x4e4f_534a];
    [b"glTF".to_vec(), words.iter().flat_map(|word| word.to_le_bytes()).collect(), json.into_bytes()].concat()
}

#[test]
fn what_cannot_be_fetched_and_stores_that_cannot_be_used_are_refused() {
    let Some(store) = Seaweed::start("what_cannot_be_fetched_and_stores_that_cannot_be_used_are_refused") else {
        return;
    };
    let mut site = Site::new(&store, &["wall"], "3000", "1k");
    let (mesh, work, local) = (site.mesh(), site.work(), store.path("file"));
    let put = |url: &str, bytes: &[u8]| {
        std::fs::write(&local, bytes).unwrap();
        store.put(&local, url);
    };

    // The JSON may be longer than what is read of every mesh.
    for padding in [0, 100_000] {
        put("s3://museum/in/a.glb", &glb(r#"{"uri":"wall%20of.png"}"#, padding));
        let refers = site.fails(&["plan", "s3://museum/in/a.glb", "--work", &work]);
        assert!(refers.contains("s3://museum/in/a.glb refers to the file wall%20of.png"), "{refers}");
    }
    put("s3://museum/in/a.glb", &glb(r#"{"uri":"data:image/png;base64,AA=="},{"bufferView":0}"#, 0));
    site.run(&["plan", "s3://museum/in/a.glb", "--work", &work]);

    // The matrix beside a mesh whose name has letters that addresses may escape.
    let named = "s3://museum/in/Fürst [1] ~#%.ply";
    put(named, &store.get(&mesh));
    let none = site.fails(&["plan", named, "--work", &work, "--transform", "auto"]);
    assert!(none.contains("Fürst [1] ~#%.xf does not exist"), "{none}");
    put("s3://museum/in/Fürst [1] ~#%.xf", b"1 0 0 5  0 1 0 0  0 0 1 0  0 0 0 1");
    site.run(&["plan", named, "--work", &work, "--transform", "auto"]);
    assert!(store.left(&work).0.iter().any(|name| name.ends_with("/plan.json")));

    // A store that replaces objects although it is told not to; nothing is left there.
    let work = "s3://museum/elsewhere";
    let (port, _) = proxy(store.port, Trouble { ignores_conditions: true, ..Trouble::default() });
    site.endpoint = format!("http://127.0.0.1:{port}");
    let unfit = site.fails(&["plan", &mesh, "--work", work]);
    assert!(unfit.contains("If-None-Match"), "{unfit}");
    assert_eq!(store.left(work), (Vec::new(), 0));

    // Ctrl-C while the store does not answer leaves nothing on this machine.
    let (port, seen) = proxy(store.port, Trouble { percent: 100, ..Trouble::default() });
    let temporary = tempfile::tempdir().unwrap();
    let mut plan = Seaweed::kilwa(&format!("http://127.0.0.1:{port}"), &["plan", &mesh, "--work", work]);
    let mut plan = plan.env("TMPDIR", temporary.path()).stderr(Stdio::null()).spawn().unwrap();
    let until = Instant::now() + Duration::from_secs(60);
    while seen.busy.load(std::sync::atomic::Ordering::Relaxed) == 0 {
        assert!(Instant::now() < until, "no request");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(std::fs::read_dir(temporary.path()).unwrap().count(), 1);
    assert!(Command::new("kill").args(["-INT", &plan.id().to_string()]).status().unwrap().success());
    assert_eq!(plan.wait().unwrap().code(), Some(130));
    assert_eq!(std::fs::read_dir(temporary.path()).unwrap().count(), 0);
}
