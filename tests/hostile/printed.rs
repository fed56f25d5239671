//! No name in a file, pack or argument controls the terminal of the reader.

use crate::support::{Input, kilwa, text};
use std::io::{Read, Write};
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

/// Sequences that terminals and readers interpret: colours, titles, the cursor, links, the clipboard, other directions of text, the
/// eight-bit forms of these, delete, backspace, carriage return.
const HOSTILE: [&str; 12] = [
    "\u{1b}[31mred",
    "\u{1b}]0;owned\u{7}",
    "\u{1b}]52;c;cm0gLXJm\u{1b}\\",
    "\u{1b}]8;;http://evil.example\u{7}here\u{1b}]8;;\u{7}",
    "\u{1b}[2J\u{1b}[H",
    "\u{1b}P+q\u{1b}\\",
    "\u{9b}31mred",
    "\u{9d}0;owned\u{9c}",
    "safe\u{202e}ylp.exe",
    "\u{2066}a\u{2069}\u{202a}\u{202c}",
    "a\u{8}\u{8}\u{7f}b",
    "all is well\rnothing",
];

/// All of them in few names, so that there are fewer programs to run.
fn names() -> Vec<String> {
    HOSTILE.chunks(4).map(|some| some.join(" ")).collect()
}

/// Checks that the output has only lines, tabs and printable characters.
fn is_plain(output: &Output, what: &str) -> String {
    let mut both = String::new();
    for bytes in [&output.stdout, &output.stderr] {
        let text = std::str::from_utf8(bytes).unwrap_or_else(|e| panic!("{what}: {e}: {bytes:?}"));
        let acts = |c: char| {
            (c.is_control() && c != '\n' && c != '\t')
                || ('\u{202a}'..='\u{202e}').contains(&c)
                || ('\u{2066}'..='\u{2069}').contains(&c)
        };
        assert!(!text.contains(acts), "{what}: {text:?}");
        both += text;
    }
    assert!(matches!(output.status.code(), Some(0..=2)), "{what}: {}", output.status);
    both
}

/// Of a program whose output is JSON, too.
fn is_plain_json(output: &Output, what: &str) -> serde_json::Value {
    is_plain(output, what);
    assert!(output.status.success(), "{what}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{what}: {e}"))
}

struct Site {
    folder: tempfile::TempDir,
}

impl Site {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name.replace('/', "_"))
    }

    /// A pack whose title, reference system, channel and source have this name.
    fn pack(&self, name: &str) -> PathBuf {
        let (mesh, pack) = (self.path(&format!("{name}.ply")), self.path(&format!("{name}.kilwa")));
        let mut input = Input::torus(12, 8, [0.0; 3]);
        input.colors.truncate(input.positions.len());
        input.write(&mesh);
        let ply = std::fs::read_to_string(&mesh).unwrap();
        let channel: String = name.chars().filter(|c| !c.is_whitespace()).collect();
        let ply =
            ply.replace("property uchar blue\n", &format!("property uchar blue\nproperty float scalar_{channel}\n"));
        let (head, body) = ply.split_once("end_header\n").unwrap();
        let rows: Vec<String> = body
            .lines()
            .map(|l| if l.starts_with("3 ") && l.split(' ').count() == 4 { l.to_owned() } else { format!("{l} 0.5") })
            .collect();
        std::fs::write(&mesh, format!("{head}end_header\n{}\n", rows.join("\n"))).unwrap();
        let crs = format!("PROJCRS[\"{name}\"]");
        let built = kilwa(&["build", text(&mesh), "-o", text(&pack), "--force", "--title", name, "--crs", &crs]);
        let output = is_plain(&built, "build");
        assert!(built.status.success(), "{output}");
        pack
    }
}

#[test]
fn no_verb_lets_metadata_of_a_pack_control_the_terminal() {
    let site = Site::new();
    for name in &names() {
        let pack = site.pack(name);
        let pack = text(&pack);
        let shown = is_plain(&kilwa(&["info", pack]), "info");
        let title = shown.lines().find(|l| l.starts_with("title")).unwrap();
        assert!(title.contains("\\u{") || title.contains("\\r"), "{title}");
        let info = is_plain_json(&kilwa(&["info", pack, "--json"]), "info --json");
        assert_eq!(info["metadata"]["title"], name.as_str(), "JSON has the title as it is");
        is_plain(&kilwa(&["verify", pack]), "verify");
        is_plain_json(&kilwa(&["verify", pack, "--json"]), "verify --json");
        for format in ["ply", "obj", "glb", "stl"] {
            let to = site.path(&format!("{name}.{format}"));
            is_plain(&kilwa(&["extract", pack, "-o", text(&to), "--force"]), "extract");
            is_plain(&kilwa(&["info", text(&to)]), "info of a mesh");
            is_plain_json(&kilwa(&["extract", pack, "-o", text(&to), "--force", "--json"]), "extract --json");
        }
        is_plain_json(&kilwa(&["measure", pack, "--json", "area"]), "measure --json");
        for verb in ["area", name.as_str()] {
            is_plain(&kilwa(&["measure", pack, "--cite", verb]), "measure --cite");
        }
        is_plain(&kilwa(&["metadata", "template", "--pack", pack]), "metadata");
        is_plain(&kilwa(&["metadata", pack]), "metadata");
        is_plain(&kilwa(&["publish", pack, "--to", text(&site.path(name))]), "publish");
    }
}

#[test]
fn file_names_in_error_messages_never_control_the_terminal() {
    let site = Site::new();
    for name in &names() {
        let missing = site.path(&format!("{name}.kilwa"));
        let damaged = site.path(&format!("{name}.damaged"));
        std::fs::write(&damaged, "KILWA and then nothing").unwrap();
        for path in [missing, damaged] {
            let path = text(&path);
            for verb in [
                "info", "verify", "extract", "measure", "metadata", "render", "publish", "serve", "build", "scans",
                "merge", "access",
            ] {
                let shown = is_plain(&kilwa(&[verb, path]), verb);
                assert!(!shown.is_empty(), "{verb}");
                is_plain(&kilwa(&[verb, path, "--json"]), verb);
                is_plain(&kilwa(&[verb, "-o", path, "--to", path, path]), verb);
                is_plain(&kilwa(&[verb, &format!("--{name}")]), verb);
            }
            let to = site.path("out.kilwa");
            is_plain(&kilwa(&["build", path, "-o", text(&to), "--transform", path]), "build");
            is_plain(&kilwa(&["access", "user", name, "--file", path]), "access user");
            is_plain(&kilwa(&["access", "list", "--file", path]), "access list");
        }
        is_plain(&kilwa(&[name]), "no verb");
    }
}

/// The mesh, and other files by name.
type Mesh = (&'static str, String);

fn meshes(name: &str) -> Vec<Vec<Mesh>> {
    let surface = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\n";
    let line = name.replace('\r', " ");
    let json = serde_json::to_string(name).unwrap();
    let asset = r#""asset":{"version":"2.0"}"#;
    vec![
        vec![("a.obj", format!("{surface}mtllib {line}\nusemtl {line}\ng {line}\n{line} 1\nf 1/1 2/1 3/1\n"))],
        vec![("a.obj", format!("{surface}f {line} 2 3\n"))],
        vec![("a.obj", format!("{surface}v {line}\nf 1 2 3\n"))],
        vec![
            ("a.obj", format!("mtllib a.mtl\n{surface}usemtl {line}\nf 1/1 2/1 3/1\n")),
            ("a.mtl", format!("newmtl {line}\nKd {line}\nmap_Kd {line}.png\n")),
        ],
        vec![
            ("a.obj", format!("mtllib a.mtl\n{surface}usemtl {line}\nf 1/1 2/1 3/1\n")),
            ("a.mtl", format!("newmtl {line}\nmap_Kd ../{line}/../../../../../../../../../etc/passwd\n")),
        ],
        vec![(
            "a.ply",
            format!(
                "ply\nformat ascii 1.0\ncomment TextureFile {line}\nelement {line} 1\nproperty float x\nend_header\n"
            ),
        )],
        vec![("a.ply", format!("ply\nformat ascii 1.0\nelement vertex 3\nproperty {line} x\nend_header\n"))],
        vec![("a.ply", format!("ply\nformat {line} 1.0\nend_header\n"))],
        vec![(
            "a.ply",
            format!(
                "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n{line} 0 0\n3 0 0 0\n"
            ),
        )],
        vec![("a.stl", format!("solid {line}\nfacet normal 0 0 0\nouter loop\nvertex {line} 0 0\n"))],
        vec![("a.stl", format!("solid {line}\n{line}\n"))],
        vec![("a.gltf", format!(r#"{{"asset":{{"version":{json}}}}}"#))],
        vec![("a.gltf", format!(r#"{{{asset},"extensionsRequired":[{json}]}}"#))],
        vec![("a.gltf", format!(r#"{{{asset},"nodes":[{{"mesh":{json}}}]}}"#))],
        vec![("a.gltf", format!(r#"{{{asset},"meshes":[{{"primitives":[{{"attributes":{{{json}:{json}}}}}]}}]}}"#))],
        vec![("a.gltf", format!(r#"{{{asset},"nodes":{json}}}"#))],
        vec![("a.gltf", gltf(&json, "\"VEC3\"", "null"))],
        vec![("a.gltf", gltf("\"data:,\"", &json, "null"))],
        vec![("a.gltf", gltf(CORNERS, "\"VEC3\"", &json))],
    ]
}

const CORNERS: &str = "\"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA\"";

fn gltf(uri: &str, kind: &str, image: &str) -> String {
    format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"uri":{uri}}}],"bufferViews":[{{"buffer":0,"byteLength":36}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":3,"type":{kind}}}],"images":[{{"uri":{image}}}],
        "textures":[{{"source":0}}],"materials":[{{"pbrMetallicRoughness":{{"baseColorTexture":{{"index":0}}}}}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0,"TEXCOORD_0":0}},"material":0}}]}}]}}"#
    )
}

#[test]
fn names_in_meshes_never_control_the_terminal() {
    let site = Site::new();
    let mut trials = 0;
    for name in &names() {
        for files in meshes(name) {
            for (file, content) in &files {
                std::fs::write(site.path(file), content).unwrap();
            }
            let (mesh, pack) = (site.path(files[0].0), site.path("a.kilwa"));
            is_plain(&kilwa(&["info", text(&mesh)]), &files[0].1);
            is_plain(&kilwa(&["info", text(&mesh), "--json"]), &files[0].1);
            is_plain(&kilwa(&["build", text(&mesh), "-o", text(&pack), "--force"]), &files[0].1);
            trials += 3;
        }
    }
    println!("{trials} outputs");
}

#[test]
fn names_and_rights_in_archives_never_control_the_terminal() {
    use crate::support::zip::{archive, license, stored};
    let site = Site::new();
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let (zip, pack) = (site.path("a.zip"), site.path("a.kilwa"));
    for name in &names() {
        let stated = stored("license.txt", license(name, name).as_bytes());
        let archives = [
            vec![stored(&format!("{}.obj", name.replace('\\', "")), obj), stated.clone()],
            vec![stored(name, b"x"), stored(&format!("/{name}"), b"x")],
            vec![stored(&format!("{name}.obj"), b"no mesh"), stated],
            vec![stored(&format!("a{name}.zip"), b"x")],
        ];
        for items in archives {
            std::fs::write(&zip, archive(&items)).unwrap();
            is_plain(&kilwa(&["info", text(&zip)]), name);
            is_plain(&kilwa(&["build", text(&zip), "-o", text(&pack), "--force"]), name);
            is_plain(&kilwa(&["metadata", "init", "--download", text(&zip)]), name);
        }
    }
}

/// The log of a server under hostile requests and packs.
#[cfg(unix)]
#[test]
fn the_server_log_never_controls_the_terminal() {
    let site = Site::new();
    let www = site.path("www");
    std::fs::create_dir(&www).unwrap();
    crate::support::serving::page(&www);
    for (name, log) in names().iter().zip(["text", "json"].into_iter().cycle()) {
        let folder = site.path(&format!("served {name}"));
        std::fs::create_dir(&folder).unwrap();
        std::fs::rename(site.pack(name), folder.join("a.kilwa")).unwrap();
        std::fs::write(folder.join(format!("{name}.kilwa").replace('/', "_")), "KILWA, cut").unwrap();
        let mut server = Command::new(env!("CARGO_BIN_EXE_kilwa"))
            .args([
                "serve",
                text(&folder),
                "--www",
                text(&www),
                "--listen",
                "127.0.0.1:0",
                "--access-log",
                "--log",
                log,
            ])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let address = crate::support::serving::address(&mut server);
        for path in [name.as_str(), "%1b%5d0;owned%07", "a.kilwa"] {
            let agent = if path == name { name } else { "a browser" };
            let mut socket = std::net::TcpStream::connect(address).unwrap();
            let head = format!("GET /{path} HTTP/1.1\r\nHost: a\r\nUser-Agent: {agent}\r\n");
            socket.write_all(format!("{head}Connection: close\r\n\r\n").as_bytes()).unwrap();
            // Some are answered, others cut off.
            drop(socket.read_to_end(&mut Vec::new()));
        }
        // It ends when all answers are sent and in the log.
        assert!(Command::new("kill").arg(server.id().to_string()).status().unwrap().success());
        let output = server.wait_with_output().unwrap();
        let shown = is_plain(&Output { status: std::process::ExitStatus::default(), ..output.clone() }, "serve");
        assert!(shown.contains("%1b"), "the request is in the log: {shown}");
        for line in String::from_utf8_lossy(&output.stderr).lines().filter(|_| log == "json") {
            assert!(serde_json::from_str::<serde_json::Value>(line).is_ok(), "{line}");
        }
    }
}
