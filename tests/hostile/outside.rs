//! Files named by a mesh are read only from its own folder, unless the user allows others.

#[cfg(unix)]
use crate::support::make_pipe;
use crate::support::{fails, kilwa, succeeds, text};
use std::path::PathBuf;

/// Part of every file that must not be read.
const SECRET: &str = "BEGIN PRIVATE KEY 8f2c";

/// `site/` with the mesh, and beside it, one folder above, what must not be read: a library, a picture, a buffer.
struct Site {
    all: tempfile::TempDir,
}

impl Site {
    fn new() -> Self {
        let all = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(all.path().join("site/parts")).unwrap();
        let site = Self { all };
        site.write("secret.mtl", &format!("# {SECRET}\nnewmtl red\nKd 1 0 0\n{SECRET}\nKd {SECRET}\n"));
        std::fs::write(site.path("secret.png"), red_picture()).unwrap();
        let corners: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        std::fs::write(site.path("secret.bin"), corners.map(f32::to_le_bytes).concat()).unwrap();
        site
    }

    fn path(&self, name: &str) -> PathBuf {
        self.all.path().join(name)
    }

    fn write(&self, name: &str, content: &str) {
        std::fs::write(self.path(name), content).unwrap();
    }

    /// An OBJ with these lines before its surface.
    fn obj(&self, lines: &str) {
        let surface = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\n";
        self.write("site/scan.obj", &format!("{lines}\n{surface}"));
    }

    /// A glTF whose buffer and picture are these.
    fn gltf(&self, buffer: &str, image: Option<&str>) {
        let mut gltf = serde_json::json!({
            "asset": { "version": "2.0" },
            "buffers": [{ "uri": buffer, "byteLength": 36 }],
            "bufferViews": [{ "buffer": 0, "byteLength": 36 }],
            "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3" }],
            "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "material": 0 }] }],
            "materials": [{}],
        });
        if let Some(image) = image {
            gltf["images"] = serde_json::json!([{ "uri": image }]);
            gltf["textures"] = serde_json::json!([{ "source": 0 }]);
            gltf["materials"][0] =
                serde_json::json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } });
        }
        self.write("site/scan.gltf", &gltf.to_string());
    }

    /// `build` and `info` refuse the mesh, name all of `parts` and show nothing of any secret; with `--allow-outside` they do not.
    fn is_refused(&self, mesh: &str, parts: &[&str]) {
        let (mesh, pack) = (self.path(mesh), self.path("out.kilwa"));
        let build = ["build", text(&mesh), "-o", text(&pack), "--force"];
        for command in [&build[..], &["info", text(&mesh)]] {
            let message = fails(command);
            for part in parts.iter().chain(&["--allow-outside", "outside the folder"]) {
                assert!(message.contains(part), "{command:?}: {part} in: {message}");
            }
            assert!(!message.contains(SECRET), "{message}");
            assert!(!pack.exists());
        }
        for command in [&build[..], &["info", text(&mesh)]] {
            assert!(!succeeds(&[command, &["--allow-outside"]].concat()).contains(SECRET));
        }
        std::fs::remove_file(pack).unwrap();
    }
}

fn red_picture() -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::RgbImage::from_pixel(4, 4, image::Rgb([200, 10, 10])).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Data URI of three corners.
fn corners() -> String {
    "data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA".to_owned()
}

#[test]
fn a_material_library_outside_the_folder_is_refused_with_its_name_and_line() {
    let site = Site::new();
    let absolute = site.path("secret.mtl").display().to_string();
    for name in
        ["../secret.mtl", "..\\secret.mtl", "parts/../../secret.mtl", "\"../secret.mtl\"", "../SECRET.MTL", &absolute]
    {
        site.obj(&format!("# scan\nmtllib {name}"));
        site.is_refused("site/scan.obj", &["scan.obj", "line 2", "secret.mtl"]);
    }
    site.write("site/a.mtl", "newmtl red\nKd 1 0 0\n");
    site.obj("mtllib a.mtl ../secret.mtl");
    site.is_refused("site/scan.obj", &["line 1", "../secret.mtl"]);
}

#[test]
fn a_texture_outside_the_folder_is_refused_with_its_library_and_line() {
    let site = Site::new();
    site.obj("mtllib parts/a.mtl");
    let absolute = site.path("secret.png").display().to_string();
    for name in ["../../secret.png", "-s 1 1 1 -clamp on ../../secret.png", "..\\..\\secret.png", &absolute] {
        site.write("site/parts/a.mtl", &format!("newmtl red\nKd 1 1 1\nmap_Kd {name}\n"));
        site.is_refused("site/scan.obj", &["a.mtl", "line 3", "secret.png"]);
    }
    // Other maps are not read, wherever they are.
    site.write(
        "site/parts/a.mtl",
        "newmtl red\nKd 1 1 1\nmap_Ka ../../secret.png\nmap_Bump /etc/passwd\nrefl /etc/passwd\n",
    );
    succeeds(&["info", text(&site.path("site/scan.obj"))]);
    // Above the library's folder and inside of the mesh's is inside.
    std::fs::write(site.path("site/inside.png"), red_picture()).unwrap();
    site.write("site/parts/a.mtl", "newmtl red\nKd 1 1 1\nmap_Kd ../inside.png\n");
    assert!(succeeds(&["info", text(&site.path("site/scan.obj"))]).contains("colours     from 1 picture"));
}

#[test]
fn gltf_buffers_and_images_outside_the_folder_are_refused_with_their_number() {
    let site = Site::new();
    let absolute = |name: &str| site.path(name).display().to_string();
    let names = |name: &str| {
        let encoded = format!("%2e%2E%2f{name}");
        [format!("../{name}"), format!("./../{name}"), format!("..\\{name}"), encoded, absolute(name)]
    };
    for name in names("secret.bin") {
        site.gltf(&name, None);
        site.is_refused("site/scan.gltf", &["buffers[0]", "secret.bin"]);
    }
    for name in names("secret.png") {
        site.gltf(&corners(), Some(&name));
        site.is_refused("site/scan.gltf", &["images[0]", "secret.png"]);
    }
}

#[test]
fn names_of_missing_files_are_not_resolved_to_others() {
    let site = Site::new();
    let secret = site.path("secret.bin").display().to_string();
    let names = [
        "%252e%252e/secret.bin".to_owned(),
        "..%c0%af../secret.bin".to_owned(),
        "%c0%ae%c0%ae/secret.bin".to_owned(),
        format!("file://{secret}"),
        format!("file:{secret}"),
        format!("FILE://localhost{secret}"),
        "..%00/secret.bin".to_owned(),
        "../secret.bin%00.png".to_owned(),
        "site/../../../secret.bin\u{0}".to_owned(),
        "\\\\?\\C:\\secret.bin".to_owned(),
        "\\\\server\\share\\secret.bin".to_owned(),
        "C:../secret.bin".to_owned(),
        ".../secret.bin".to_owned(),
        "../secret.bin ./".to_owned(),
        "~/secret.bin".to_owned(),
        "$HOME/secret.bin".to_owned(),
        "https://127.0.0.1:1/secret.bin".to_owned(),
    ];
    for name in names {
        site.gltf(&name, None);
        let message = fails(&["info", text(&site.path("site/scan.gltf"))]);
        assert!(message.contains("buffers[0]"), "{name:?}: {message}");
    }
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_are_refused_and_pipes_and_devices_do_not_block() {
    use std::os::unix::fs::symlink;
    let site = Site::new();
    symlink("../secret.mtl", site.path("site/link.mtl")).unwrap();
    site.obj("mtllib link.mtl");
    site.is_refused("site/scan.obj", &["link.mtl", "secret.mtl"]);
    symlink("..", site.path("site/up")).unwrap();
    site.gltf("up/secret.bin", None);
    site.is_refused("site/scan.gltf", &["up/secret.bin"]);

    make_pipe(&site.path("site/pipe.mtl"));
    symlink("/dev/zero", site.path("site/zero.png")).unwrap();
    site.write("site/a.mtl", "newmtl red\nmap_Kd zero.png\n");
    site.obj("mtllib pipe.mtl");
    assert!(succeeds(&["info", text(&site.path("site/scan.obj"))]).contains("1 material library that is missing"));
    site.obj("mtllib a.mtl");
    let message = fails(&["info", text(&site.path("site/scan.obj"))]);
    assert!(message.contains("zero.png") && message.contains("/dev/zero"), "{message}");
    succeeds(&["info", text(&site.path("site/scan.obj")), "--allow-outside"]);

    // A pipe as the mesh itself, and a folder with a link to a mesh elsewhere.
    make_pipe(&site.path("pipe.ply"));
    assert!(fails(&["info", text(&site.path("pipe.ply"))]).contains("not a regular file"));
    assert!(fails(&["build", text(&site.path("pipe.ply")), "-o", text(&site.path("p.kilwa"))]).contains("regular"));
    std::fs::create_dir(site.path("blocks")).unwrap();
    site.obj("");
    symlink("../site/scan.obj", site.path("blocks/scan.obj")).unwrap();
    let pack = site.path("blocks.kilwa");
    let build = ["build", text(&site.path("blocks")), "-o", text(&pack)].map(str::to_owned);
    let build: Vec<&str> = build.iter().map(String::as_str).collect();
    let message = fails(&build);
    assert!(message.contains("scan.obj") && message.contains("--allow-outside"), "{message}");
    succeeds(&[&build[..], &["--allow-outside"]].concat());
}

#[cfg(unix)]
#[test]
fn a_matrix_file_that_is_a_link_out_of_the_folder_is_neither_read_nor_quoted() {
    let site = Site::new();
    site.obj("");
    std::os::unix::fs::symlink("../secret.mtl", site.path("site/scan.xf")).unwrap();
    let (mesh, pack) = (site.path("site/scan.obj"), site.path("out.kilwa"));
    let build = ["build", text(&mesh), "-o", text(&pack), "--transform", "auto"];
    assert!(fails(&build).contains("is a link to"));
    for command in
        [&build[..], &["build", text(&mesh), "-o", text(&pack), "--transform", text(&site.path("secret.mtl"))]]
    {
        let message = fails(&[command, &["--allow-outside"]].concat());
        assert!(message.contains("is not a number") && !message.contains("PRIVATE"), "{message}");
    }
}

/// As the folder that holds it would be: what a pattern finds by a link out of the folder before its first wildcard.
#[cfg(unix)]
#[test]
fn a_pattern_follows_no_link_out_of_its_folder() {
    use std::os::unix::fs::symlink;
    let site = Site::new();
    site.obj("");
    std::fs::create_dir_all(site.path("blocks/a")).unwrap();
    symlink("../site/scan.obj", site.path("blocks/x.obj")).unwrap();
    symlink("../../site/scan.obj", site.path("blocks/a/y.obj")).unwrap();
    symlink("../site", site.path("blocks/linked")).unwrap();
    let pack = site.path("out.kilwa");
    for pattern in
        ["blocks/*.obj", "blocks/?.obj", "blocks/[x].obj", "blocks/a/*.obj", "blocks/*/*.obj", "blocks/l*/scan.obj"]
    {
        let given = site.path(pattern);
        let build = ["build", text(&given), "-o", text(&pack), "--force"];
        let message = fails(&build);
        assert!(message.contains("is a link to") && message.contains("--allow-outside"), "{pattern}: {message}");
        assert!(!pack.exists(), "{pattern}");
    }
    succeeds(&["build", text(&site.path("blocks/?.obj")), "-o", text(&pack), "--allow-outside"]);
    // A path named by the user is followed even if it is a link to a file or a folder.
    for given in ["blocks/x.obj", "blocks/linked", "blocks/linked/*.obj", "si*/*.obj"] {
        succeeds(&["build", text(&site.path(given)), "-o", text(&pack), "--force"]);
    }
}

/// The folder of a mesh that is named through a link is that of the real file.
#[cfg(unix)]
#[test]
fn a_mesh_opened_through_a_link_uses_files_beside_its_target() {
    use std::os::unix::fs::symlink;
    let site = Site::new();
    // The mesh names files beside the link.
    std::fs::create_dir(site.path("private")).unwrap();
    std::fs::rename(site.path("secret.mtl"), site.path("private/secret.mtl")).unwrap();
    site.obj("mtllib private/secret.mtl");
    symlink("site/scan.obj", site.path("linked.obj")).unwrap();
    site.is_refused("linked.obj", &["linked.obj", "line 1", "secret.mtl"]);
    site.gltf("secret.bin", None);
    symlink("site/scan.gltf", site.path("linked.gltf")).unwrap();
    site.is_refused("linked.gltf", &["buffers[0]", "secret.bin"]);
    // A link in a folder for work to a mesh among its companions.
    site.write("site/a.mtl", "newmtl red\nKd 1 0 0\n");
    site.obj("mtllib a.mtl");
    assert!(succeeds(&["info", text(&site.path("linked.obj"))]).contains("colours     of the triangles"));
}

/// A mesh in an archive names files on the disk: none is read, allowed or not.
#[test]
fn a_mesh_in_an_archive_reads_no_file_of_the_disk() {
    use crate::support::zip::{archive, stored};
    let site = Site::new();
    let absolute = site.path("secret.bin").display().to_string();
    for name in ["../secret.bin", "secret.bin", "..\\secret.bin", "%2e%2e/secret.bin", &absolute] {
        site.gltf(name, None);
        let scene = std::fs::read(site.path("site/scan.gltf")).unwrap();
        std::fs::write(site.path("site/scan.zip"), archive(&[stored("scene.gltf", &scene)])).unwrap();
        for more in [&[][..], &["--allow-outside"]] {
            let message = fails(&[&["info", text(&site.path("site/scan.zip"))], more].concat());
            assert!(message.contains("buffers[0]") && message.contains("is not there"), "{name}: {message}");
        }
    }
    let surface = "mtllib ../secret.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n";
    std::fs::write(site.path("site/scan.zip"), archive(&[stored("scan.obj", surface.as_bytes())])).unwrap();
    let report = succeeds(&["info", text(&site.path("site/scan.zip")), "--allow-outside"]);
    assert!(report.contains("1 material library that is missing") && !report.contains(SECRET), "{report}");
}

/// Parts that names are made of.
const PARTS: [&str; 18] = [
    "..",
    ".",
    "/",
    "\\",
    "%2e%2e",
    "%2f",
    "%5c",
    "%00",
    "site",
    "parts",
    "up",
    "secret.bin",
    "SECRET.BIN",
    "link.bin",
    "\"",
    " ",
    "file:",
    "%252e",
];

/// Names made by chance: none that leads out is read.
#[cfg(unix)]
#[test]
fn no_combination_of_name_parts_leads_out_of_the_folder() {
    let site = Site::new();
    std::os::unix::fs::symlink("../..", site.path("site/up")).unwrap();
    std::os::unix::fs::symlink("../secret.bin", site.path("site/link.bin")).unwrap();
    let trials = if std::env::var_os("KILWA_SOAK").is_some() { 5000 } else { 200 };
    let mut random = fastrand::Rng::with_seed(17);
    let mut next = |n: usize| random.usize(..n);
    let (mut refused, mut missing) = (0, 0);
    for _ in 0..trials {
        let mut name: String = (0..=next(7)).map(|_| PARTS[next(PARTS.len())]).collect();
        if next(2) == 0 {
            name = format!("{name}{}secret.bin", ["/", "/../", "\\..\\", ""][next(4)]);
        }
        if next(8) == 0 {
            name = format!("{}/{name}", site.all.path().display());
        }
        site.gltf(&name, None);
        let output = kilwa(&["info", text(&site.path("site/scan.gltf"))]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{name:?} was read: {message}");
        if message.contains("--allow-outside") { refused += 1 } else { missing += 1 }
    }
    println!("{trials} names: {refused} refused, {missing} lead nowhere, 0 read");
    assert!(refused >= trials / 20, "{refused} of {trials}");
}
