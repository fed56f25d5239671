//! Properties of every verb of `kilwa`: help, exit codes (0 success, 1 failure, 2 wrong usage), and messages that name the
//! file they are about.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The verbs, in the order of `kilwa --help`.
const VERBS: [&str; 18] = [
    "synth", "scans", "register", "merge", "colour", "build", "plan", "task", "assemble", "info", "verify", "extract",
    "render", "measure", "publish", "metadata", "serve", "access",
];

fn kilwa(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kilwa")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A call with a file that does not exist: in the arguments `{in}` and `{out}` are paths in an empty folder.
fn calls_without_input() -> [(&'static str, Vec<&'static str>); 12] {
    [
        ("register", vec!["{in}"]),
        ("merge", vec!["{in}", "-o", "{out}.kilwa"]),
        ("build", vec!["{in}.ply", "-o", "{out}.kilwa"]),
        ("plan", vec!["{in}.ply", "--work", "{out}"]),
        ("task", vec!["{in}.json"]),
        ("assemble", vec!["{in}", "-o", "{out}.kilwa"]),
        ("info", vec!["{in}.kilwa"]),
        ("verify", vec!["{in}.kilwa"]),
        ("extract", vec!["{in}.kilwa", "-o", "{out}.ply"]),
        ("render", vec!["{in}.kilwa", "-o", "{out}.png"]),
        ("measure", vec!["{in}.kilwa", "area"]),
        ("serve", vec!["{in}", "--listen", "127.0.0.1:0"]),
    ]
}

/// The documentation page of a verb.
fn page_of(verb: &str) -> PathBuf {
    let page = match verb {
        "register" => "registering",
        "task" | "assemble" => "plan",
        verb => verb,
    };
    Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("docs/{page}.md"))
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}

#[test]
fn help_lists_exactly_the_verbs_that_are_documented() {
    let output = kilwa(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = stdout(&output);
    let commands = text.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    let listed: Vec<_> =
        commands.lines().filter_map(|line| line.split_whitespace().next()).filter(|v| *v != "help").collect();
    assert_eq!(listed, VERBS);
    for verb in VERBS {
        let page = page_of(verb);
        assert!(page.is_file(), "{} is missing", page.display());
    }
}

#[test]
fn every_verb_explains_itself() {
    for verb in VERBS {
        let output = kilwa(&[verb, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{verb} --help: {}", stderr(&output));
        let text = stdout(&output);
        assert!(text.contains(&format!("Usage: kilwa {verb}")), "{verb} --help says {text}");
        assert!(!text.starts_with("Usage:"), "{verb} --help does not say what the verb does: {text}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn help_that_cannot_be_printed_is_an_error() {
    let calls: [&[&str]; 6] =
        [&["help"], &["help", "build"], &["--help"], &["verify", "-h"], &["measure", "help"], &["--version"]];
    for call in calls {
        let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
        let output = Command::new(env!("CARGO_BIN_EXE_kilwa")).args(call).stdout(full).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{call:?}");
        assert!(stderr(&output).contains("cannot print: No space left"), "{call:?}: {}", stderr(&output));
    }
}

#[test]
fn every_option_in_the_help_has_a_description() {
    for verb in VERBS {
        let text = stdout(&kilwa(&[verb, "-h"]));
        let lines: Vec<_> = text.lines().collect();
        for (at, line) in lines.iter().enumerate().filter(|(_, line)| line.trim_start().starts_with('-')) {
            // Two spaces separate the description; a long option has it on the next, deeper line.
            let has_own = line.trim_start().contains("  ");
            let has_next = lines
                .get(at + 1)
                .is_some_and(|next| next.starts_with("          ") && !next.trim_start().starts_with('-'));
            assert!(has_own || has_next, "{verb}: no description for {line:?}");
        }
    }
}

#[test]
fn usage_errors_exit_with_2_and_show_the_usage() {
    let mut calls: Vec<Vec<&str>> = vec![vec![], vec!["paint"], vec!["--no-such-option"]];
    calls.extend(VERBS.iter().map(|verb| vec![*verb]));
    calls.extend(VERBS.iter().map(|verb| vec![*verb, "--no-such-option"]));
    calls.push(vec!["build", "a.ply", "-o", "a.kilwa", "--threads", "20000"]);
    for call in calls {
        let output = kilwa(&call);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "kilwa {call:?}: {text}");
        assert!(text.contains("Usage:") || text.contains("--help"), "kilwa {call:?} does not say how it goes: {text}");
        assert!(output.stdout.is_empty(), "kilwa {call:?} writes to stdout: {}", stdout(&output));
    }
}

#[test]
fn a_missing_file_exits_with_1_names_the_file_and_leaves_nothing_behind() {
    for (verb, args) in calls_without_input() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let args: Vec<String> =
            args.iter().map(|arg| arg.replace("{in}", &path("not-there")).replace("{out}", &path("result"))).collect();
        let call: Vec<&str> = std::iter::once(verb).chain(args.iter().map(String::as_str)).collect();
        let output = kilwa(&call);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "kilwa {call:?}: {text}");
        assert!(text.contains("not-there"), "kilwa {verb} does not name the file: {text}");
        assert!(text.starts_with("kilwa: "), "kilwa {verb}: {text}");
        assert!(is_empty(folder.path()), "kilwa {verb} left files behind");
    }
}

#[test]
fn a_file_that_is_no_pack_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("letter.kilwa");
    std::fs::write(&file, "Dear archivist, this is not a pack.\n".repeat(200)).unwrap();
    let file = file.display().to_string();
    for verb in ["info", "verify"] {
        let output = kilwa(&[verb, &file]);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "kilwa {verb}: {text}");
        assert!(text.contains("letter.kilwa"), "kilwa {verb} does not name the file: {text}");
    }
}

#[test]
fn a_closed_output_pipe_is_no_error() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .arg("--help")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}

#[test]
fn every_option_is_explained_in_the_documentation() {
    for verb in VERBS {
        let page = std::fs::read_to_string(page_of(verb)).unwrap();
        let help = stdout(&kilwa(&[verb, "--help"]));
        let options = help.split_whitespace().filter(|word| word.starts_with("--") && word.len() > 2);
        // `--redact-location[=<METRES>]` is explained as `--redact-location`.
        let name =
            |word: &'_ str| word.split(|c: char| !c.is_ascii_alphanumeric() && c != '-').next().map(str::to_owned);
        for option in options.filter_map(name) {
            let option = option.trim_end_matches('-');
            let is_explained = option == "--help" || page.contains(option);
            assert!(is_explained, "the page of {verb} in docs says nothing about {option}");
        }
    }
}

/// A fort in a folder of its own, and its pack.
fn fort() -> (tempfile::TempDir, String, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (mesh, pack) = (path("fort.ply"), path("fort.kilwa"));
    succeed(&["synth", "fort", "--triangles", "20000", "-o", &mesh]);
    succeed(&["build", &mesh, "-o", &pack]);
    (folder, mesh, pack)
}

fn succeed(args: &[&str]) -> String {
    let output = kilwa(args);
    assert_eq!(output.status.code(), Some(0), "kilwa {args:?}: {}", stderr(&output));
    stdout(&output)
}

/// The number of `element NAME` in a PLY's header.
fn ply_count(file: &str, element: &str) -> u64 {
    let bytes = std::fs::read(file).unwrap();
    let header = String::from_utf8_lossy(&bytes[..bytes.len().min(2000)]).into_owned();
    let prefix = format!("element {element} ");
    header.lines().find_map(|line| line.strip_prefix(&prefix)).unwrap().trim().parse().unwrap()
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("no JSON ({error}): {text}"))
}

#[test]
fn a_mesh_goes_through_every_verb_and_comes_back_whole() {
    let (folder, mesh, pack) = fort();
    let triangles = ply_count(&mesh, "face");
    let verified = json(&succeed(&["verify", &pack, "--json"]));
    assert_eq!(verified["sound"], true);
    assert_eq!(verified["triangles"], triangles);
    let info = json(&succeed(&["info", &pack, "--json"]));
    assert_eq!(info["bytes"], std::fs::metadata(&pack).unwrap().len());
    assert_eq!(info["metadata"]["sources"][0]["name"], "fort.ply");

    let whole = folder.path().join("whole.ply").display().to_string();
    succeed(&["extract", &pack, "-o", &whole]);
    assert_eq!(ply_count(&whole, "face"), triangles, "extract gives back every triangle");

    // The extract is a valid input.
    let again = folder.path().join("again.kilwa").display().to_string();
    succeed(&["build", &whole, "-o", &again]);
    assert_eq!(json(&succeed(&["verify", &again, "--json"]))["triangles"], triangles);

    let light = folder.path().join("light.ply").display().to_string();
    succeed(&["extract", &pack, "-o", &light, "--max-triangles", "10000"]);
    let count = ply_count(&light, "face");
    assert!(count <= 10_000 && count > 0, "{count} triangles");
}

#[test]
fn an_existing_file_is_not_replaced_without_force() {
    let (folder, mesh, pack) = fort();
    let before = std::fs::read(&pack).unwrap();
    let ply = folder.path().join("out.ply").display().to_string();
    std::fs::write(&ply, "mine").unwrap();
    let call = ["synth", "fort", "--triangles", "10000", "-o", &mesh];
    for call in [&["build", &mesh, "-o", &pack][..], &["extract", &pack, "-o", &ply], &call] {
        let output = kilwa(call);
        assert_eq!(output.status.code(), Some(1), "kilwa {call:?}");
        assert!(stderr(&output).contains("--force"), "kilwa {call:?} does not say how: {}", stderr(&output));
    }
    assert_eq!(std::fs::read(&pack).unwrap(), before);
    assert_eq!(std::fs::read(&ply).unwrap(), b"mine");
    succeed(&["build", &mesh, "-o", &pack, "--force", "--title", "another"]);
    assert_ne!(std::fs::read(&pack).unwrap(), before);
}

#[test]
fn a_damaged_pack_is_named_and_exits_with_1() {
    let (_folder, _, pack) = fort();
    let good = std::fs::read(&pack).unwrap();
    let mut flipped = good.clone();
    let at = good.len() * 2 / 3;
    flipped[at] ^= 0x10;
    for (what, bytes) in [("flipped", &flipped[..]), ("cut", &good[..good.len() / 2]), ("empty", &[])] {
        std::fs::write(&pack, bytes).unwrap();
        let output = kilwa(&["verify", &pack]);
        assert_eq!(output.status.code(), Some(1), "{what}: {}", stdout(&output));
        assert!(stderr(&output).contains("fort.kilwa"), "{what}: {}", stderr(&output));
    }
}

#[test]
fn bad_meshes_are_refused_by_name_and_leave_nothing_under_the_final_name() {
    let header = |vertices: &str, faces: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {faces}\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let meshes = [
        ("truncated", header("3", "2") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"),
        ("huge", header("9223372036854775808", "1") + "0 0 0\n"),
        ("not-a-number", header("3", "1") + "0 0 0\n1 0 0\nnan nan nan\n3 0 1 2\n"),
        ("index", header("3", "1") + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"),
        ("no-faces", header("3", "0") + "0 0 0\n1 0 0\n0 1 0\n"),
        ("nothing", String::new()),
        ("one-point", header("3", "1") + "1 1 1\n1 1 1\n1 1 1\n3 0 1 2\n"),
        ("letter", "Dear archivist,\n".to_owned()),
    ];
    for (name, text) in meshes {
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join(format!("{name}.ply"));
        std::fs::write(&mesh, text).unwrap();
        let pack = folder.path().join("result.kilwa").display().to_string();
        let output = kilwa(&["build", &mesh.display().to_string(), "-o", &pack]);
        let message = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "{name}: {message}");
        assert!(message.contains(&format!("{name}.ply")), "{name}: the message does not name the file: {message}");
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 1, "{name}: more than the input is left");
    }
}

#[test]
fn a_file_extension_in_capitals_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (small, capital) = (path("fort.ply"), path("FORT.PLY"));
    succeed(&["synth", "fort", "--triangles", "5000", "-o", &small]);
    std::fs::rename(&small, &capital).unwrap();
    succeed(&["build", &capital, "-o", &path("fort.kilwa")]);
}

#[test]
fn an_input_is_never_replaced_by_the_pack_made_of_it() {
    let (_folder, mesh, _) = fort();
    let before = std::fs::read(&mesh).unwrap();
    let output = kilwa(&["build", &mesh, "-o", &mesh, "--force"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(stderr(&output).contains("is an input"), "{}", stderr(&output));
    assert_eq!(std::fs::read(&mesh).unwrap(), before);
}

/// Every verb that writes a file, into a folder that does not exist yet.
#[test]
fn missing_folders_of_an_output_are_made() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let calls = [
        ("a/b/c.ply", vec!["synth", "phantom", "--triangles", "300", "-o", "{}"]),
        ("c/d/c.kilwa", vec!["build", "a/b/c.ply", "-o", "{}"]),
        ("e/f/c.glb", vec!["extract", "c/d/c.kilwa", "-o", "{}"]),
        ("g/h/c.png", vec!["render", "c/d/c.kilwa", "--size", "8x8", "--software", "-o", "{}"]),
        ("i/j/c.svg", vec!["measure", "c/d/c.kilwa", "section", "--z", "0.5", "-o", "{}"]),
        ("k/l/c.json", vec!["measure", "c/d/c.kilwa", "area", "--save", "{}"]),
        ("m/n/c.toml", vec!["metadata", "init", "c/d/c.kilwa", "--quiet", "-o", "{}"]),
        ("o/p/state", vec!["verify", "c/d/c.kilwa", "--state", "{}"]),
        ("q/r/access.json", vec!["access", "init", "{}"]),
    ];
    for (output, call) in &calls {
        let call: Vec<&str> = call.iter().map(|arg| if *arg == "{}" { *output } else { *arg }).collect();
        let done = Command::new(env!("CARGO_BIN_EXE_kilwa")).args(&call).current_dir(folder.path()).output().unwrap();
        assert!(done.status.success(), "{call:?}: {}", stderr(&done));
        assert!(Path::new(&at(output)).is_file(), "{output}");
    }
    // What fails leaves no folder.
    for (output, input) in [("s/t/c.kilwa", "none.ply"), ("s/t/c.kilwa", "bad.ply")] {
        std::fs::write(at("bad.ply"), "ply\n").unwrap();
        let refused = kilwa(&["build", &at(input), "-o", &at(output)]);
        assert_eq!(refused.status.code(), Some(1));
        assert!(!Path::new(&at("s")).exists(), "{}", stderr(&refused));
    }
}

#[test]
fn an_output_is_what_its_name_says_or_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).display().to_string();
    let said = |args: &[&str]| {
        let output = kilwa(args);
        assert_eq!(output.status.code(), Some(1), "{args:?}: {}", stderr(&output));
        stderr(&output)
    };
    let (mesh, pack) = (at("c.ply"), at("c.kilwa"));
    assert!(kilwa(&["synth", "phantom", "--triangles", "300", "-o", &mesh]).status.success());
    let message = said(&["build", &mesh, "-o", &at("a.ply")]);
    assert!(message.contains("names end in .kilwa") && message.contains("kilwa extract"), "{message}");
    assert!(said(&["build", &mesh, "-o", &at("a")]).contains("a.kilwa"));
    // Reference systems: what is none is refused, what may be one is stored with a warning.
    let crs = |code: &str| kilwa(&["build", &mesh, "-o", &pack, "--force", "--crs", code]);
    for (code, part) in [("EPSG:99999", "not an EPSG code"), ("EPSG:4326", "degrees"), ("UTM 37", "EPSG code such as")]
    {
        let refused = crs(code);
        assert_eq!(refused.status.code(), Some(1), "{code}");
        assert!(stderr(&refused).contains(part) && !Path::new(&pack).exists(), "{code}: {}", stderr(&refused));
    }
    let unlisted = crs("epsg:1999");
    assert!(unlisted.status.success() && stderr(&unlisted).contains("warning: EPSG:1999 is not in the list"));
    assert!(stdout(&kilwa(&["info", &pack])).contains("EPSG:1999"));
    // Pictures.
    let render = |name: &str, more: &[&str]| {
        kilwa(&[&["render", &pack, "--software", "--size", "16x12", "-o", &at(name)], more].concat())
    };
    for (name, format) in [("a.png", image::ImageFormat::Png), ("a.jpg", image::ImageFormat::Jpeg)] {
        let done = render(name, &[]);
        assert!(done.status.success(), "{}", stderr(&done));
        let bytes = std::fs::read(at(name)).unwrap();
        assert_eq!(image::guess_format(&bytes).unwrap(), format);
        assert_eq!(image::load_from_memory(&bytes).unwrap().into_rgb8().dimensions(), (16, 12));
    }
    for (name, more, part) in [
        ("b.gif", &[][..], "must be .png or .jpg"),
        ("b.pdf", &[], "give --scale"),
        ("b.jpg", &["--background", "transparent"], "cannot be transparent"),
    ] {
        let refused = render(name, more);
        assert_eq!(refused.status.code(), Some(1), "{name}");
        assert!(stderr(&refused).contains(part) && !Path::new(&at(name)).exists(), "{}", stderr(&refused));
    }
}

#[test]
fn an_output_that_cannot_be_written_is_named() {
    let (folder, mesh, pack) = fort();
    std::fs::write(folder.path().join("no"), "a file").unwrap();
    let nowhere = folder.path().join("no/such/folder/out");
    for (verb, input, suffix) in [("build", &mesh, "kilwa"), ("extract", &pack, "ply"), ("render", &pack, "png")] {
        let target = nowhere.with_extension(suffix).display().to_string();
        let output = kilwa(&[verb, input, "-o", &target]);
        assert_eq!(output.status.code(), Some(1), "kilwa {verb}");
        assert!(stderr(&output).contains("no/such/folder"), "kilwa {verb}: {}", stderr(&output));
    }
}
