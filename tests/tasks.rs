//! One build on many machines, by the command line: `kilwa plan`, `kilwa task`, `kilwa assemble`.

use crate::support::{fails, json, kilwa, succeeds, text};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// A mesh, and its pack as `kilwa build` makes it.
struct Site {
    folder: tempfile::TempDir,
    expected: Vec<u8>,
}

impl Site {
    fn new(kind: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let site = Self { folder, expected: Vec::new() };
        let (mesh, pack) = (site.path("mesh.ply"), site.path("whole.kilwa"));
        succeeds(&["synth", kind, "--triangles", "30000", "-o", text(&mesh)]);
        succeeds(&["build", text(&mesh), "-o", text(&pack), "--color-bits", "7", "--title", "the site"]);
        Self { expected: std::fs::read(pack).unwrap(), ..site }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn plan_arguments(&self) -> Vec<String> {
        let (mesh, work) = (self.path("mesh.ply"), self.path("work"));
        let options = ["--task-triangles", "4k", "--color-bits", "7", "--title", "the site"];
        let all = ["plan", text(&mesh), "--work", text(&work)].into_iter().chain(options);
        all.map(str::to_owned).collect()
    }

    fn plan(&self) -> Value {
        let arguments = self.plan_arguments();
        json(&arguments.iter().map(String::as_str).collect::<Vec<_>>())
    }

    /// The files of the tasks that can be done now.
    fn ready(&self) -> Vec<String> {
        let plan = self.plan();
        let tasks = plan["tasks"].as_array().unwrap();
        let open = || tasks.iter().filter(|t| t["done"] == false);
        let wave = open().map(|t| t["wave"].as_u64().unwrap()).min();
        let now = open().filter(|t| t["wave"].as_u64() == wave);
        now.map(|t| t["file"].as_str().unwrap().to_owned()).collect()
    }

    fn run_all(&self) -> PathBuf {
        loop {
            let files = self.ready();
            if files.is_empty() {
                return PathBuf::from(self.plan()["build"].as_str().unwrap());
            }
            for file in files {
                succeeds(&["task", &file]);
            }
        }
    }
}

fn start(file: &str, scratch: &Path) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args(["task", file, "--scratch", text(scratch), "--threads", "1"]);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

#[test]
fn tasks_give_the_pack_of_a_build_and_leave_nothing() {
    let site = Site::new("fort");
    let folder = site.run_all();
    let plan = site.plan();
    assert_eq!(plan["complete"], true);
    assert!(plan["tasks"].as_array().unwrap().len() > 8, "{plan}");
    let done = json(&["task", plan["tasks"][1]["file"].as_str().unwrap()]);
    assert_eq!(done["already_done"], true);

    for inside in ["pack.kilwa", "files/pack.kilwa", "new/pack.kilwa"] {
        let refused = fails(&["assemble", text(&folder), "-o", text(&folder.join(inside))]);
        assert!(refused.contains("in the folder of the build"), "{refused}");
    }
    let pack = site.path("made/pack.kilwa");
    let report = json(&["assemble", text(&folder), "-o", text(&pack), "--keep"]);
    assert!(std::fs::read(&pack).unwrap() == site.expected);
    assert!(report["stages"].as_array().unwrap().iter().any(|s| s["stage"] == "tail"), "{report}");
    let again = fails(&["assemble", text(&folder), "-o", text(&pack)]);
    assert!(again.contains("already exists"), "{again}");
    succeeds(&["assemble", text(&folder), "-o", text(&pack), "--force"]);
    assert!(std::fs::read(&pack).unwrap() == site.expected);
    assert_eq!(std::fs::read_dir(site.path("work")).unwrap().count(), 0);
    assert_eq!(std::fs::read_dir(site.path("made")).unwrap().count(), 1);
}

#[cfg(unix)]
#[test]
fn tasks_killed_at_any_moment_and_done_by_two_at_once_give_the_same_pack() {
    let site = Site::new("wall");
    let mut random = fastrand::Rng::with_seed(crate::support::kill_seed::seed().into());
    let (mut killed, mut patience) = (0, 20);
    while let Some(file) = site.ready().first() {
        // Two workers with the same task; one or both are killed after a moment.
        let mut workers = [start(file, &site.path("a")), start(file, &site.path("b"))];
        if killed < 12 {
            std::thread::sleep(std::time::Duration::from_millis(random.u64(..patience)));
            patience += 10;
            for worker in &mut workers[random.usize(..2)..] {
                killed += usize::from(worker.try_wait().unwrap().is_none());
                drop(worker.kill());
            }
        }
        for worker in &mut workers {
            worker.wait().unwrap();
        }
    }
    assert!(killed > 3, "{killed}");
    let pack = site.path("pack.kilwa");
    succeeds(&["assemble", site.plan()["build"].as_str().unwrap(), "-o", text(&pack)]);
    assert!(std::fs::read(&pack).unwrap() == site.expected);
}

#[test]
fn refusals_of_other_versions_other_files_and_changed_inputs_say_what_to_do() {
    let site = Site::new("wall");
    let ingest = site.ready().remove(0);
    let given = std::fs::read_to_string(&ingest).unwrap();

    let other = site.path("other.json");
    std::fs::write(&other, given.replace("kilwa 0", "kilwa 99")).unwrap();
    let refused = fails(&["task", text(&other)]);
    assert!(refused.contains("kilwa 99") && refused.contains("install the same version"), "{refused}");

    let plan = PathBuf::from(site.plan()["build"].as_str().unwrap()).join("plan.json");
    let bytes = std::fs::read(&plan).unwrap();
    for (other, says) in [(&b"{}"[..], "not a plan of Kilwa"), (&bytes[..bytes.len() - 3], "it is damaged")] {
        std::fs::write(&plan, other).unwrap();
        let refused = fails(&["task", &ingest]);
        assert!(refused.contains("plan.json") && refused.contains(says), "{refused}");
    }
    std::fs::write(&plan, bytes).unwrap();

    std::fs::write(&other, "{}").unwrap();
    let refused = fails(&["task", text(&other)]);
    assert!(refused.contains("other.json") && refused.contains("kilwa plan"), "{refused}");

    let key = site.plan()["key"].as_str().unwrap().to_owned();
    std::fs::write(&other, given.replace(&format!("\"key\": \"{key}\""), "\"key\": \"0\"")).unwrap();
    let refused = fails(&["task", text(&other)]);
    assert!(refused.contains("another build"), "{refused}");

    let early = fails(&["assemble", site.plan()["build"].as_str().unwrap(), "-o", text(&site.path("a.kilwa"))]);
    assert!(early.contains("ingest is not done"), "{early}");
    assert!(!site.path("a.kilwa").exists());

    // Other permissions do not make another build; a moved folder works in its new place.
    assert_eq!(site.ready(), [ingest.as_str()]);

    // The input grows between the plan and the task.
    let mut mesh = std::fs::read(site.path("mesh.ply")).unwrap();
    mesh.push(b'\n');
    std::fs::write(site.path("mesh.ply"), mesh).unwrap();
    let refused = fails(&["task", &ingest]);
    assert!(refused.contains("mesh.ply was changed since") && refused.contains("run `kilwa plan` again"), "{refused}");

    let none = kilwa(&["assemble", text(&site.path("nowhere")), "-o", text(&site.path("a.kilwa"))]);
    assert!(String::from_utf8_lossy(&none.stderr).contains("there is no build"));
}
