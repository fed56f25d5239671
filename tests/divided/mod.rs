//! One build on many machines through an object store: `kilwa plan`, `kilwa task` and `kilwa assemble` with `s3://…`, against a real store.

mod again;
mod busy;
mod inputs;
mod seaweed;

use crate::support::{succeeds, text};
use busy::Trouble;
use seaweed::Seaweed;
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// A mesh in the store, and the pack that `kilwa build` makes of it.
struct Site<'a> {
    store: &'a Seaweed,
    kind: &'static str,
    endpoint: String,
    task_triangles: &'static str,
    expected: Vec<u8>,
}

impl<'a> Site<'a> {
    fn new(store: &'a Seaweed, shape: &[&'static str], triangles: &str, task_triangles: &'static str) -> Self {
        let kind = shape[0];
        let (mesh, pack) = (store.path(&format!("{kind}.ply")), store.path(&format!("{kind}.kilwa")));
        succeeds(&[&["synth"], shape, &["--force", "--triangles", triangles, "-o", text(&mesh)]].concat());
        succeeds(&["build", text(&mesh), "-o", text(&pack), "--force", "--title", "the site"]);
        let site =
            Self { store, kind, endpoint: store.endpoint(), task_triangles, expected: std::fs::read(&pack).unwrap() };
        store.put(&mesh, &site.mesh());
        site
    }

    fn mesh(&self) -> String {
        format!("s3://museum/in/{}.ply", self.kind)
    }

    fn output(&self) -> String {
        format!("s3://museum/packs/{}.kilwa", self.kind)
    }

    fn work(&self) -> String {
        format!("s3://museum/work/{}", self.kind)
    }

    fn try_run(&self, args: &[&str]) -> Output {
        Seaweed::kilwa(&self.endpoint, args).output().unwrap()
    }

    fn run(&self, args: &[&str]) -> String {
        let ended = self.try_run(args);
        let message = String::from_utf8_lossy(&ended.stderr);
        assert!(ended.status.success(), "{args:?}: {message}");
        String::from_utf8(ended.stdout).unwrap()
    }

    fn fails(&self, args: &[&str]) -> String {
        let ended = self.try_run(args);
        assert!(!ended.status.success(), "{args:?}");
        String::from_utf8_lossy(&ended.stderr).into_owned()
    }

    fn plan(&self, more: &[&str]) -> Value {
        let (mesh, work) = (self.mesh(), self.work());
        let args = ["plan", &mesh, "--work", &work, "--task-triangles", self.task_triangles, "--title", "the site"];
        serde_json::from_str(&self.run(&[&args[..], &["--json"], more].concat())).unwrap()
    }

    /// Run all tasks with `workers` at a time. Returns the folder of the build.
    fn work_off(&self, workers: usize) -> String {
        loop {
            let plan = self.plan(&[]);
            let tasks = plan["tasks"].as_array().unwrap();
            let open = || tasks.iter().filter(|t| t["done"] == false);
            let wave = open().map(|t| t["wave"].as_u64().unwrap()).min();
            let now = open().filter(|t| t["wave"].as_u64() == wave);
            let files: Mutex<Vec<String>> = Mutex::new(now.map(|t| t["file"].as_str().unwrap().to_owned()).collect());
            if files.lock().unwrap().is_empty() {
                assert!(tasks.len() > 2, "{plan}");
                return plan["build"].as_str().unwrap().to_owned();
            }
            std::thread::scope(|scope| {
                for _ in 0..workers {
                    scope.spawn(|| {
                        loop {
                            let Some(file) = files.lock().unwrap().pop() else { break };
                            self.run(&["task", &file, "--threads", "1"]);
                        }
                    });
                }
            });
        }
    }

    fn check(&self) {
        assert!(self.store.get(&self.output()) == self.expected, "{}: other bytes", self.kind);
        assert_eq!(self.store.left(&self.work()), (Vec::new(), 0));
        let packs = self.store.left("s3://museum/packs").0;
        assert!(packs.iter().all(|name| Path::new(name).extension().is_some_and(|e| e == "kilwa")), "{packs:?}");
    }
}

#[test]
fn tasks_through_a_store_give_the_pack_of_a_build_and_leave_nothing() {
    let Some(store) = Seaweed::start("tasks_through_a_store_give_the_pack_of_a_build_and_leave_nothing") else {
        return;
    };
    let is_long = std::env::var_os("KILWA_SOAK").is_some();
    let shapes: [(&[&str], usize); 3] = [(&["fort"], 2), (&["wall"], 1), (&["phantom", "--shape", "sphere"], 5)];
    for (shape, workers) in shapes {
        let kind = shape[0];
        let site = Site::new(&store, shape, "20000", "5k");
        let all: &[usize] = if is_long { &[1, 2, 5] } else { &[workers] };
        for workers in all {
            let build = site.work_off(*workers);
            let output = site.output();
            let inside = site.fails(&["assemble", &build, "-o", &format!("{build}/a.kilwa")]);
            assert!(inside.contains("in the folder of the build"), "{inside}");
            let made: Value = serde_json::from_str(&site.run(&["assemble", &build, "-o", &output, "--json"])).unwrap();
            assert_eq!(made["sha256"], kilwa_archive::checksums::sha256(&site.expected));
            site.check();
            // The pack is there: the same build has nothing left to do, and others are refused.
            let plan = site.plan(&["-o", &output]);
            assert_eq!((&plan["complete"], &plan["pack"]["sha256"]), (&true.into(), &made["sha256"]), "{plan}");
            let mesh = site.mesh();
            let other = site.fails(&["plan", &mesh, "--work", &site.work(), "--title", "another", "-o", &output]);
            assert!(other.contains("already exists") && other.contains(&output), "{other}");
            assert_eq!(store.left(&site.work()), (Vec::new(), 0));
            store.objects(std::time::Duration::from_secs(10)).remove(&format!("packs/{kind}.kilwa").into()).unwrap();
        }
    }
    killed(&store);
    refusals(&store);
}

/// Workers and an assembly are killed while they download and upload; nothing of them remains.
fn killed(store: &Seaweed) {
    let site = Site::new(store, &["wall"], "60000", "10k");
    let mut random = fastrand::Rng::with_seed(crate::support::kill_seed::seed().into());
    for _ in 0..6 {
        let plan = site.plan(&[]);
        let open = plan["tasks"].as_array().unwrap().iter().find(|t| t["done"] == false);
        let Some(file) = open.map(|t| t["file"].as_str().unwrap()) else { break };
        let mut worker = Seaweed::kilwa(&site.endpoint, &["task", file, "--threads", "1"]).spawn().unwrap();
        std::thread::sleep(std::time::Duration::from_millis(random.u64(..400)));
        drop(worker.kill());
        worker.wait().unwrap();
    }
    // Left by a machine that lost power while it uploaded a long file.
    let build = site.work_off(2);
    store.begin_upload(&format!("{build}/files/left"));
    let mut assembly = Seaweed::kilwa(&site.endpoint, &["assemble", &build, "-o", &site.output()]).spawn().unwrap();
    std::thread::sleep(std::time::Duration::from_millis(random.u64(..300)));
    drop(assembly.kill());
    let ended = assembly.wait().unwrap();
    if !ended.success() {
        site.run(&["assemble", &build, "-o", &site.output()]);
    }
    site.check();
    store.objects(std::time::Duration::from_secs(10)).remove(&"packs/wall.kilwa".into()).unwrap();
}

/// Errors say why, where, and what to do.
fn refusals(store: &Seaweed) {
    let site = Site::new(store, &["wall"], "3000", "1k");
    let (mesh, work) = (site.mesh(), site.work());
    let ingest = site.plan(&[])["tasks"][0]["file"].as_str().unwrap().to_owned();
    // The mesh is replaced by another one of the same length.
    let local = store.path("wall.ply");
    let mut bytes = std::fs::read(&local).unwrap();
    let last = bytes.len() - 1;
    bytes[last] ^= 1;
    std::fs::write(&local, bytes).unwrap();
    store.put(&local, &mesh);
    let changed = site.fails(&["task", &ingest]);
    assert!(
        changed.contains(&mesh) && changed.contains("changed since") && changed.contains("kilwa plan"),
        "{changed}"
    );

    let none = site.fails(&["plan", "s3://museum/in/none.ply", "--work", &work]);
    assert!(none.contains("s3://museum/in/none.ply does not exist"), "{none}");
    let twice = site.fails(&["plan", &mesh, &mesh, "--work", &work]);
    assert!(twice.contains("given twice"), "{twice}");
    let obj = store.path("a.obj");
    std::fs::write(&obj, "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    store.put(&obj, "s3://museum/in/a.obj");
    let refers = site.fails(&["plan", "s3://museum/in/a.obj", "--work", &work]);
    assert!(refers.contains("s3://museum/in/a.obj") && refers.contains("refer to other files"), "{refers}");
    store.put(&obj, "s3://museum/in/a.ply");
    std::fs::write(&obj, "nothing").unwrap();
    store.put(&obj, "s3://museum/in/b.ply");
    let nothing = site.fails(&["plan", "s3://museum/in/b.ply", "--work", &work]);
    assert!(nothing.contains("s3://museum/in/b.ply") && !nothing.contains("kilwa-inputs"), "{nothing}");
    let build = site.fails(&["build", &mesh, "-o", text(&store.path("x.kilwa"))]);
    assert!(build.contains("only `kilwa plan` reads meshes from a store"), "{build}");
    let nowhere = site.fails(&["assemble", "s3://museum/none", "-o", "s3://museum/packs/x.kilwa"]);
    assert!(nowhere.contains("there is no build"), "{nowhere}");
    let address = site.fails(&["plan", &mesh, "--work", "s3://"]);
    assert!(address.contains("not the address of a store"), "{address}");

    let mut wrong = Seaweed::kilwa(&site.endpoint, &["plan", &mesh, "--work", &work]);
    let wrong = wrong.env("AWS_SECRET_ACCESS_KEY", "another-secret").output().unwrap();
    let wrong = String::from_utf8_lossy(&wrong.stderr).into_owned();
    assert!(wrong.contains("AWS_SECRET_ACCESS_KEY") && !wrong.contains("another-secret"), "{wrong}");
    store.objects(std::time::Duration::from_secs(10)).remove_several(vec!["in/a.obj".into()]).unwrap();
}

#[test]
fn a_store_of_which_three_answers_in_ten_fail_gives_the_same_pack() {
    let Some(store) = Seaweed::start("a_store_of_which_three_answers_in_ten_fail_gives_the_same_pack") else { return };
    let mut site = Site::new(&store, &["wall"], "20000", "5k");
    let (port, seen) = busy::proxy(store.port, Trouble { percent: 30, seed: 5, ..Trouble::default() });
    site.endpoint = format!("http://127.0.0.1:{port}");
    let build = site.work_off(2);
    site.run(&["assemble", &build, "-o", &site.output()]);
    site.check();
    let [all, busy, broken] = [&seen.all, &seen.busy, &seen.broken].map(|n| n.load(Ordering::Relaxed));
    println!("{all} requests, {busy} answered by 503, {broken} broken off or lost");
    assert!(busy * 5 > all && broken > 5, "{all} {busy} {broken}");
}

/// Tasks in a folder with the pack in a store, and tasks in a store with the pack in a file.
#[test]
fn folders_and_stores_mix() {
    let Some(store) = Seaweed::start("folders_and_stores_mix") else { return };
    let site = Site::new(&store, &["wall"], "20000", "5k");
    let build = site.work_off(2);
    let pack = store.path("made.kilwa");
    site.run(&["assemble", &build, "-o", text(&pack)]);
    assert!(std::fs::read(&pack).unwrap() == site.expected);
    assert_eq!(store.left(&site.work()), (Vec::new(), 0));

    let (mesh, work) = (store.path("wall.ply"), store.path("work"));
    let plan = || -> Value {
        let args =
            ["plan", text(&mesh), "--work", text(&work), "--task-triangles", "5k", "--title", "the site", "--json"];
        serde_json::from_str(&site.run(&args)).unwrap()
    };
    let build = loop {
        let plan = plan();
        let open: Vec<&Value> = plan["tasks"].as_array().unwrap().iter().filter(|t| t["done"] == false).collect();
        let Some(first) = open.first() else { break PathBuf::from(plan["build"].as_str().unwrap()) };
        site.run(&["task", first["file"].as_str().unwrap()]);
    };
    site.run(&["assemble", text(&build), "-o", &site.output()]);
    site.check();
    assert!(!Path::new(&build).exists());
}
