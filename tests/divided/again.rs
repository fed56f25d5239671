//! The same command once more, after a death, or after a file has changed that the build does not compare.

use super::Site;
use super::seaweed::Seaweed;
use crate::support::text;
use kilwa_store::Address;
use serde_json::Value;
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(10);

impl Site<'_> {
    fn json(&self, args: &[&str]) -> Value {
        serde_json::from_str(&self.run(&[args, &["--json"]].concat())).unwrap()
    }

    /// Remove the objects of the build below some of its folders, as a removal that is killed.
    fn remove(&self, build: &str, folders: &[&str]) {
        let objects = self.store.objects(PATIENCE);
        for folder in folders {
            let below = Address::parse(build).unwrap().join(folder).path;
            let listed = objects.list(&below).unwrap();
            assert!(!listed.is_empty(), "{folder}");
            objects.remove_several(listed.into_iter().map(|(path, _)| path).collect()).unwrap();
        }
    }

    fn nothing_is_left(&self) {
        assert_eq!(self.store.left(&self.work()), (Vec::new(), 0));
    }
}

#[test]
fn a_repeated_assembly_finds_its_pack() {
    let Some(store) = Seaweed::start("a_repeated_assembly_finds_its_pack") else { return };
    let site = Site::new(&store, &["wall"], "3000", "1k");
    let (build, output, mine) = (site.work_off(2), site.output(), store.path("mine.kilwa"));
    let of_build = kilwa_archive::checksums::sha256(&site.expected);
    store.begin_upload(&output);
    let other = format!("{output}/other");
    store.begin_upload(&other);
    let made = site.json(&["assemble", &build, "-o", &output, "--keep"]);
    assert_eq!((&made["sha256"], &made["already_done"]), (&of_build.clone().into(), &Value::Null));
    // What an earlier assembly began was given up, and nobody else's.
    let earlier = store.objects(PATIENCE).unfinished_of(&Address::parse(&output).unwrap().path).unwrap();
    assert!(earlier.is_empty(), "{earlier:?}");
    assert_eq!(store.left(&other), (Vec::new(), 1));

    // A kept build stays, also when it is planned again.
    assert_eq!(site.plan(&["-o", &output])["pack"]["sha256"], made["sha256"]);
    let found = site.json(&["assemble", &build, "-o", &output, "--keep"]);
    assert_eq!((&found["already_done"], &found["sha256"]), (&true.into(), &made["sha256"]), "{found}");
    assert_eq!((&found["triangles"], &found["pack"]["bytes"]), (&made["triangles"], &made["pack"]["bytes"]));
    let to_file = site.json(&["assemble", &build, "-o", text(&mine), "--keep"]);
    assert_eq!(to_file["sha256"], made["sha256"]);
    let another = store.path("another.kilwa");
    std::fs::write(&another, "another").unwrap();
    let refused = site.fails(&["assemble", &build, "-o", text(&another)]);
    assert!(refused.contains("already exists; use --force"), "{refused}");

    // As if it had been killed while it removed the build, at first without and then with the note of the pack; and when all was removed.
    site.remove(&build, &["done", "files"]);
    for output in [text(&mine), output.as_str()] {
        let found = site.json(&["assemble", &build, "-o", output, "--keep"]);
        assert_eq!((&found["already_done"], &found["sha256"]), (&true.into(), &made["sha256"]), "{found}");
    }
    site.remove(&build, &["scratch"]);
    for _ in 0..2 {
        let found = site.json(&["assemble", &build, "-o", &output]);
        assert_eq!((&found["already_done"], &found["sha256"]), (&true.into(), &made["sha256"]), "{found}");
        site.nothing_is_left();
    }

    // By force, the pack is made once more, because a picture of the mesh may have changed.
    for _ in 0..2 {
        let plan = site.plan(&["-o", &output, "--force"]);
        assert_eq!((&plan["complete"], &plan["pack"]), (&false.into(), &Value::Null), "{plan}");
    }
    let build = site.work_off(2);
    let refused = site.fails(&["assemble", &build, "-o", &output]);
    assert!(refused.contains("already exists; use --force"), "{refused}");
    let made = site.json(&["assemble", &build, "-o", &output, "--force"]);
    assert_eq!((&made["sha256"], &made["already_done"]), (&of_build.into(), &Value::Null));
    site.check();
}
