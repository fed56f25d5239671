//! A build that is stopped, killed or loses its scratch files ends with the bytes of an undisturbed one, or says why
//! not; in between there is no file under the final name.

use crate::eventually::eventually_every;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const TRIANGLES: &str = "30000";
const KILLS: usize = 50;

/// A folder with a mesh and its pack as an undisturbed build makes it.
struct Site {
    folder: tempfile::TempDir,
    undisturbed: Vec<u8>,
    took: Duration,
}

fn kilwa(folder: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.current_dir(folder).args(args).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

impl Site {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let made =
            kilwa(folder.path(), &["synth", "fort", "--triangles", TRIANGLES, "-o", "fort.ply"]).output().unwrap();
        assert!(made.status.success(), "{}", stderr(&made));
        let begun = Instant::now();
        let built =
            kilwa(folder.path(), &["build", "fort.ply", "-o", "first.kilwa", "--title", "fort"]).output().unwrap();
        assert!(built.status.success(), "{}", stderr(&built));
        let undisturbed = std::fs::read(folder.path().join("first.kilwa")).unwrap();
        Self { folder, undisturbed, took: begun.elapsed() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// `kilwa build` of the mesh to `a.kilwa`, with further arguments.
    fn build(&self, args: &[&str]) -> Command {
        let mut all = vec!["build", "fort.ply", "-o", "a.kilwa", "--title", "fort"];
        all.extend(args);
        kilwa(self.folder.path(), &all)
    }

    fn scratch(&self) -> PathBuf {
        self.path(".a.kilwa.scratch")
    }

    fn assert_undisturbed(&self, what: &str) {
        let bytes = std::fs::read(self.path("a.kilwa")).unwrap_or_else(|e| panic!("{what}: {e}"));
        assert!(bytes == self.undisturbed, "{what}: other bytes");
        assert!(!self.scratch().exists(), "{what}: scratch files are left");
        assert!(!self.path(".a.kilwa.part").exists(), "{what}: a part is left");
        std::fs::remove_file(self.path("a.kilwa")).unwrap();
    }

    /// A build that was stopped by Ctrl-C as soon as the scratch file `name` was there; tried again where it was faster.
    fn stopped_at(&self, name: &str, args: &[&str]) -> Output {
        let file = self.scratch().join(name);
        for _ in 0..10 {
            // Files of an earlier build would be taken for this one's, and the signal would be sent before the program handles it.
            std::fs::remove_file(&file).ok();
            let child = self.build(args).spawn().unwrap();
            wait(|| file.exists() || self.path("a.kilwa").exists(), name);
            interrupt(&child);
            let output = child.wait_with_output().unwrap();
            if output.status.code() != Some(0) {
                return output;
            }
            self.assert_undisturbed("faster than the signal");
        }
        panic!("no build could be stopped at {name}");
    }
}

/// A stage of a build of this size lasts a few milliseconds.
fn wait(until: impl Fn() -> bool, what: &str) {
    eventually_every(Duration::from_micros(200), what, || until().then_some(()));
}

fn interrupt(child: &Child) {
    let sent = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

#[test]
fn fifty_random_kills_do_not_change_the_bytes_and_leave_no_partial_file_under_the_final_name() {
    let site = Site::new();
    let mut random = fastrand::Rng::with_seed(7);
    let (mut kills, mut finished) = (0, 0);
    while kills < KILLS {
        let mut child = site.build(&["--resume"]).stdout(Stdio::null()).spawn().unwrap();
        // The moment of the kill is the subject of this test; it waits for no state.
        std::thread::sleep(site.took.mul_f64(random.f64() * 0.6));
        if child.try_wait().unwrap().is_some() {
            let output = child.wait_with_output().unwrap();
            assert!(output.status.success(), "after {kills} kills: {}", stderr(&output));
            site.assert_undisturbed("between kills");
            finished += 1;
            continue;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
        if site.path("a.kilwa").exists() {
            // It was killed after the rename: then the file is complete.
            let bytes = std::fs::read(site.path("a.kilwa")).unwrap();
            assert!(bytes == site.undisturbed, "kill {kills}: an incomplete pack stands under the final name");
            std::fs::remove_file(site.path("a.kilwa")).unwrap();
        }
    }
    let last = site.build(&["--resume"]).output().unwrap();
    assert!(last.status.success(), "{}", stderr(&last));
    site.assert_undisturbed("after all kills");
    println!("{kills} kills, {} builds finished", finished + 1);
}

#[test]
fn threads_memory_and_resuming_do_not_change_the_bytes() {
    let site = Site::new();
    for threads in ["1", "2", "8"] {
        for memory in ["100M", "2G"] {
            let args = ["--threads", threads, "--memory", memory];
            let built = site.build(&args).output().unwrap();
            assert!(built.status.success(), "{}", stderr(&built));
            site.assert_undisturbed(&format!("{args:?}"));
        }
        let other = ["--threads", threads, "--memory", "100M"];
        let stopped = site.stopped_at("level-01.patches", &other);
        assert_eq!(stopped.status.code(), Some(130), "{}", stderr(&stopped));
        let resumed = site.build(&["--resume", "--memory", "1G"]).output().unwrap();
        assert!(resumed.status.success(), "{}", stderr(&resumed));
        assert!(stderr(&resumed).contains("going on after stage"), "{}", stderr(&resumed));
        site.assert_undisturbed(&format!("{other:?}, resumed"));
    }
}

#[test]
fn ctrl_c_stops_cleanly_and_says_how_to_resume() {
    let site = Site::new();
    for at in ["journal", "corners", "level-02.shared"] {
        let stopped = site.stopped_at(at, &[]);
        assert_eq!(stopped.status.code(), Some(130), "{at}: {}", stderr(&stopped));
        let message = stderr(&stopped);
        assert!(message.contains("--resume") && message.contains(".a.kilwa.scratch"), "{at}: {message}");
        assert!(!site.path("a.kilwa").exists() && !site.path(".a.kilwa.part").exists(), "{at}: no partial output");
        assert!(site.scratch().join("journal").exists(), "{at}: scratch files are kept");
    }
    let resumed = site.build(&["--resume"]).output().unwrap();
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    site.assert_undisturbed("resumed");
}

#[test]
fn another_build_is_not_resumed_and_its_scratch_files_are_kept() {
    let site = Site::new();
    site.stopped_at("level-01.patches", &[]);
    let refused = |args: &[&str], says: &str| {
        let output = site.build(args).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{args:?}");
        assert!(stderr(&output).contains(says), "{args:?}: {}", stderr(&output));
        assert!(site.scratch().join("journal").exists(), "{args:?}");
    };
    refused(&["--resume", "--step", "0.0009765625"], "step");
    refused(&["--resume", "--crs", "EPSG:32737"], "crs");
    refused(&["--resume", "--up", "y"], "up");
    refused(&["--resume", "--color-bits", "6"], "color_bits");
    refused(&["--resume", "--normal-bits", "8"], "normal_bits");
    refused(&["--resume", "--origin", "1,2,3"], "placed otherwise");
    let mut mesh = std::fs::read(site.path("fort.ply")).unwrap();
    let at = mesh.len() - 1;
    mesh[at] = mesh[at].wrapping_add(1);
    let before = std::fs::read(site.path("fort.ply")).unwrap();
    std::fs::write(site.path("fort.ply"), &mesh).unwrap();
    refused(&["--resume"], "was changed");
    std::fs::write(site.path("fort.ply"), before).unwrap();
    // Without --resume it starts over and says what is discarded.
    let anew = site.build(&[]).output().unwrap();
    assert!(anew.status.success(), "{}", stderr(&anew));
    assert!(stderr(&anew).contains("discarded"), "{}", stderr(&anew));
    site.assert_undisturbed("anew");
}

/// Restore the time of a file, like `cp -p` or `rsync -t`.
#[test]
fn an_input_changed_with_the_same_length_and_time_is_detected_and_an_identical_copy_accepted() {
    let site = Site::new();
    let (mesh, other) = (site.path("fort.ply"), site.path("other.ply"));
    let before = std::fs::read(&mesh).unwrap();
    let time = std::fs::metadata(&mesh).unwrap().modified().unwrap();
    let mut changed = before.clone();
    let at = changed.len() - 1;
    changed[at] = changed[at].wrapping_add(1);
    let put = |bytes: &[u8], path: &Path| {
        std::fs::write(path, bytes).unwrap();
        std::fs::File::options().write(true).open(path).unwrap().set_modified(time).unwrap();
    };
    site.stopped_at("level-01.patches", &[]);
    for is_replaced in [false, true] {
        if is_replaced {
            put(&changed, &other);
            std::fs::rename(&other, &mesh).unwrap();
        } else {
            put(&changed, &mesh);
        }
        let refused = site.build(&["--resume"]).output().unwrap();
        assert_eq!(refused.status.code(), Some(1), "replaced {is_replaced}: {}", stderr(&refused));
        assert!(stderr(&refused).contains("fort.ply was changed since"), "{}", stderr(&refused));
        assert!(site.scratch().join("journal").exists());
    }
    // Another inode and another ctime, but the original content.
    put(&before, &other);
    std::fs::rename(&other, &mesh).unwrap();
    let resumed = site.build(&["--resume"]).output().unwrap();
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    assert!(stderr(&resumed).contains("going on after stage"), "{}", stderr(&resumed));
    site.assert_undisturbed("the same content again");
}

#[test]
fn damaged_scratch_files_are_detected_and_their_stage_is_repeated() {
    let site = Site::new();
    // Each with a way to damage it: truncated, or one bit flipped in the middle.
    for (file, cut) in [
        ("level-02.patches", true),
        ("level-02.patches", false),
        ("level-02.shared", false),
        ("level-02.results", false),
        ("chunks", true),
        ("chunks", false),
        ("leaves.patches", false),
        ("tree", false),
        ("journal", true),
    ] {
        let path = site.scratch().join(file);
        // A build that got further before the signal has already consumed the files of the previous stage.
        let is_stopped = (0..10).any(|_| {
            site.stopped_at("level-01.patches", &[]);
            path.exists()
        });
        assert!(is_stopped, "{file}: no build was stopped while it was there");
        let mut bytes = std::fs::read(&path).unwrap();
        if cut {
            bytes.truncate(bytes.len() / 2);
        } else {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 0x40;
        }
        std::fs::write(&path, bytes).unwrap();
        let resumed = site.build(&["--resume"]).output().unwrap();
        assert!(resumed.status.success(), "{file}, cut {cut}: {}", stderr(&resumed));
        site.assert_undisturbed(&format!("{file}, cut {cut}"));
    }
}

/// A pack is written under a temporary name first; a link under that name must not redirect it into another file.
#[cfg(unix)]
#[test]
fn a_link_under_the_temporary_name_is_refused_and_its_target_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let (precious, part) = (folder.path().join("precious"), folder.path().join(".a.kilwa.part"));
    let made = kilwa(folder.path(), &["synth", "wall", "--triangles", "2000", "-o", "wall.ply"]).output().unwrap();
    assert!(made.status.success(), "{}", stderr(&made));
    let link = [std::os::unix::fs::symlink::<&Path, &Path>, std::fs::hard_link::<&Path, &Path>];
    for link in link {
        std::fs::write(&precious, "precious").unwrap();
        link(&precious, &part).unwrap();
        let refused = kilwa(folder.path(), &["build", "wall.ply", "-o", "a.kilwa"]).output().unwrap();
        assert_eq!(refused.status.code(), Some(1));
        assert!(stderr(&refused).contains(".a.kilwa.part"), "{}", stderr(&refused));
        assert_eq!(std::fs::read(&precious).unwrap(), b"precious");
        std::fs::remove_file(&part).unwrap();
    }
}

/// All files in a scratch folder are removed at the end, and another user may have put a link in its place.
#[cfg(unix)]
#[test]
fn a_link_in_place_of_the_scratch_folder_is_refused_and_its_target_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let made = kilwa(folder.path(), &["synth", "wall", "--triangles", "2000", "-o", "wall.ply"]).output().unwrap();
    assert!(made.status.success(), "{}", stderr(&made));
    let archive = folder.path().join("archive");
    std::fs::create_dir_all(archive.join("journal")).unwrap();
    std::fs::create_dir(folder.path().join("disk")).unwrap();
    for name in ["lock", "a.tif", "journal/b.tif"] {
        std::fs::write(archive.join(name), "").unwrap();
    }
    let hows: [(&str, &[&str]); 4] = [
        (".a.kilwa.scratch", &[]),
        (".a.kilwa.scratch", &["--resume"]),
        (".a.kilwa.scratch", &["--force"]),
        ("disk/.a.kilwa.scratch", &["--scratch", "disk"]),
    ];
    for (link, args) in hows {
        std::os::unix::fs::symlink(&archive, folder.path().join(link)).unwrap();
        let all = [&["build", "wall.ply", "-o", "a.kilwa"], args].concat();
        let refused = kilwa(folder.path(), &all).output().unwrap();
        assert_eq!(refused.status.code(), Some(1), "{args:?}: {}", stderr(&refused));
        assert!(stderr(&refused).contains("is a link"), "{args:?}: {}", stderr(&refused));
        for name in ["lock", "a.tif", "journal/b.tif"] {
            assert!(archive.join(name).is_file(), "{args:?}: {name}");
        }
        std::fs::remove_file(folder.path().join(link)).unwrap();
    }
}

/// A bad output is refused before the build starts, and a pack that was written is not reported as missing.
#[cfg(unix)]
#[test]
fn a_broken_link_is_refused_as_output_and_an_unlistable_folder_is_accepted() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let folder = tempfile::tempdir().unwrap();
    let run = |args: &[&str]| kilwa(folder.path(), args).output().unwrap();
    assert!(run(&["synth", "wall", "--triangles", "2000", "-o", "wall.ply"]).status.success());
    symlink("nowhere", folder.path().join("l.kilwa")).unwrap();
    let refused = run(&["build", "wall.ply", "-o", "l.kilwa"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("whose target does not exist"), "{}", stderr(&refused));
    assert!(!folder.path().join(".l.kilwa.scratch").exists());
    // Root can list it anyway; then this only shows that nothing else is wrong.
    let blind = folder.path().join("blind");
    std::fs::create_dir(&blind).unwrap();
    std::fs::set_permissions(&blind, std::fs::Permissions::from_mode(0o333)).unwrap();
    let built = run(&["build", "wall.ply", "-o", "blind/a.kilwa"]);
    std::fs::set_permissions(&blind, std::fs::Permissions::from_mode(0o755)).unwrap();
    assert!(built.status.success(), "{}", stderr(&built));
    assert!(!blind.join(".a.kilwa.scratch").exists());
}

#[test]
fn two_builds_of_one_pack_at_once_and_foreign_folders_are_refused() {
    let site = Site::new();
    let child = site.build(&[]).spawn().unwrap();
    wait(|| site.scratch().join("journal").exists(), "journal");
    let second = site.build(&[]).output().unwrap();
    assert_eq!(second.status.code(), Some(1));
    assert!(stderr(&second).contains("another build"), "{}", stderr(&second));
    assert!(child.wait_with_output().unwrap().status.success());
    site.assert_undisturbed("the first");
    std::fs::create_dir(site.scratch()).unwrap();
    std::fs::write(site.scratch().join("notes.txt"), "of the survey").unwrap();
    let refused = site.build(&[]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("notes.txt"), "{}", stderr(&refused));
    assert_eq!(std::fs::read(site.scratch().join("notes.txt")).unwrap(), b"of the survey");
    // A scratch folder elsewhere is used and left unchanged.
    std::fs::create_dir(site.path("disk")).unwrap();
    std::fs::remove_dir_all(site.scratch()).unwrap();
    let elsewhere = site.build(&["--scratch", "disk"]).output().unwrap();
    assert!(elsewhere.status.success(), "{}", stderr(&elsewhere));
    assert_eq!(std::fs::read_dir(site.path("disk")).unwrap().count(), 0);
    site.assert_undisturbed("scratch elsewhere");
}

/// A small disk in memory, removed with the test; `None` if this user may not mount one.
struct Disk(PathBuf);

impl Disk {
    fn mount(at: PathBuf, size: &str) -> Option<Self> {
        std::fs::create_dir(&at).ok()?;
        let size = format!("size={size}");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(&at).output();
        match mounted {
            Ok(output) if output.status.success() => Some(Self(at)),
            _ => {
                eprintln!("skipped: full disks, which need the right to mount one");
                None
            }
        }
    }

    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        entries.map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect()
    }
}

impl Drop for Disk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg(&self.0).status();
    }
}

/// A build to `a.kilwa` while another program fills the disk of its scratch files as soon as the file `at` exists,
/// and takes all space that is freed; retried if the build still had enough space.
fn robbed_of_its_disk(site: &Site, disk: &Disk, at: &str) -> Output {
    let file = disk.0.join(".a.kilwa.scratch").join(at);
    let filler = disk.0.join("filler");
    for _ in 0..20 {
        let mut child = site.build(&["--scratch", "disk"]).spawn().unwrap();
        wait(|| file.exists() || site.path("a.kilwa").exists(), at);
        let mut writer = std::fs::File::create(&filler).unwrap();
        while child.try_wait().unwrap().is_none() {
            let _ = std::io::Write::write_all(&mut writer, &[1; 4096]);
        }
        let output = child.wait_with_output().unwrap();
        if output.status.code() != Some(0) {
            return output;
        }
        std::fs::remove_file(&filler).unwrap();
        site.assert_undisturbed("enough room in spite of the filler");
    }
    panic!("no build was robbed of its disk at {at}");
}

#[test]
fn a_disk_too_small_is_refused_beforehand_and_one_that_fills_up_is_a_clear_error() {
    let site = Site::new();
    let Some(small) = Disk::mount(site.path("small"), "1m") else { return };
    let refused = site.build(&["--scratch", "small"]).output().unwrap();
    assert_eq!(refused.status.code(), Some(1));
    assert!(stderr(&refused).contains("free") && stderr(&refused).contains("needed"), "{}", stderr(&refused));
    assert!(small.files().is_empty(), "{:?}", small.files());

    let Some(disk) = Disk::mount(site.path("disk"), "12m") else { return };
    for at in ["positions", "buckets", "level-02.patches"] {
        let output = robbed_of_its_disk(&site, &disk, at);
        assert_eq!(output.status.code(), Some(1), "{at}: {}", stderr(&output));
        let message = stderr(&output);
        assert!(message.contains("disk is full") || message.contains("No space left"), "{at}: {message}");
        assert_eq!(disk.files(), ["filler"], "{at}: scratch files are cleaned away");
        assert!(!site.path("a.kilwa").exists() && !site.path(".a.kilwa.part").exists(), "{at}");
        std::fs::remove_file(disk.0.join("filler")).unwrap();
    }
}

/// A square of `n` by `n` quads with relief, in lines that are short enough for their number to be underestimated.
fn terse(n: u32) -> String {
    use std::fmt::Write;
    let at = |i: u32, j: u32| i * (n + 1) + j + 1;
    let all = || (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j)));
    let mut obj = String::new();
    for (i, j) in all() {
        let _ = writeln!(obj, "v {i} {j} {}", (i * i / 7 + j * 3) % 5);
    }
    for (i, j) in all().filter(|(i, j)| *i < n && *j < n) {
        let _ = writeln!(obj, "f {} {} {} {}", at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
    }
    obj
}

/// The need of a text without a header is estimated from its length. So the check beforehand accepts disks that the build
/// then fills, each at another point; with one thread and no other program, always at the same one.
#[test]
fn a_disk_that_the_build_itself_fills_is_a_clear_error_wherever_that_happens() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("terse.obj"), terse(150)).unwrap();
    let build = |args: &[&str]| {
        let all = [&["build", "terse.obj", "-o", "a.kilwa", "--threads", "1", "--json"], args].concat();
        kilwa(folder.path(), &all).output().unwrap()
    };
    let roomy = build(&[]);
    assert!(roomy.status.success(), "{}", stderr(&roomy));
    let report: serde_json::Value = serde_json::from_slice(&roomy.stdout).unwrap();
    let number = |v: &serde_json::Value| v.as_u64().unwrap();
    let (estimated, peak) =
        (number(&report["run"]["estimated"]["scratch_bytes"]), number(&report["scratch_peak_bytes"]));
    assert!(estimated * 5 < peak * 4, "{estimated} estimated, {peak} needed: the test has nothing to fill");
    let undisturbed = std::fs::read(folder.path().join("a.kilwa")).unwrap();
    std::fs::remove_file(folder.path().join("a.kilwa")).unwrap();

    let mut full_at = std::collections::BTreeSet::new();
    for step in 0..6 {
        let size = estimated + 65_536 + (peak - estimated) * step / 5;
        let Some(disk) = Disk::mount(folder.path().join(format!("disk{step}")), &size.to_string()) else { return };
        let output = build(&["--scratch", &format!("disk{step}")]);
        let message = stderr(&output);
        assert!(disk.files().is_empty(), "{size}: scratch files are cleaned away: {:?}", disk.files());
        if output.status.success() {
            // Less than the peak by the little that was rounded up.
            assert!(size * 10 > peak * 9, "{size} of {peak} bytes were enough");
            let bytes = std::fs::read(folder.path().join("a.kilwa")).unwrap();
            assert!(bytes == undisturbed, "{size}: other bytes");
            std::fs::remove_file(folder.path().join("a.kilwa")).unwrap();
            continue;
        }
        assert_eq!(output.status.code(), Some(1), "{size}: {message}");
        assert!(message.contains("the disk is full") && message.contains("--scratch"), "{size}: {message}");
        assert!(!folder.path().join("a.kilwa").exists() && !folder.path().join(".a.kilwa.part").exists(), "{size}");
        let file = message.split(".a.kilwa.scratch/").nth(1).and_then(|rest| rest.split(',').next());
        full_at.insert(file.unwrap_or_else(|| panic!("no file is named: {message}")).to_owned());
    }
    println!("{estimated} bytes estimated, {peak} needed; full at {full_at:?}");
    assert!(full_at.len() >= 2, "{full_at:?}");
}
