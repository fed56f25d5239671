//! Runs `kilwa`, and reads PLY files independently of the program.
#![allow(dead_code, reason = "each test file uses its part")]

pub(crate) mod kill_seed;
pub(crate) mod serving;
pub(crate) mod zip;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// Run the program.
pub(crate) fn kilwa(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kilwa")).args(args).stdin(Stdio::null()).output().unwrap()
}

/// Run the program, which must succeed; its standard output.
pub(crate) fn succeeds(args: &[&str]) -> String {
    let output = kilwa(args);
    assert!(output.status.success(), "kilwa {args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Run the program, which must exit with 1; its standard error.
pub(crate) fn fails(args: &[&str]) -> String {
    let output = kilwa(args);
    assert_eq!(output.status.code(), Some(1), "kilwa {args:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A pack that several tests use ([`made_once`]), of a mesh that `write` makes.
pub(crate) fn built_once(folder: &Path, name: &str, write: impl FnOnce(&Path), options: &[&str]) -> PathBuf {
    made_once(&folder.join(format!("{name}.kilwa")), |pack| {
        let input = folder.join(format!("{name}.ply"));
        write(&input);
        succeeds(&[&["build", text(&input), "-o", text(pack), "--force"], options].concat());
    })
}

/// A file or folder that stays: made by the first test that needs it, and again when the program or the tests have changed. Others wait meanwhile, also
/// where each test is a process of its own (as under nextest).
pub(crate) fn made_once(path: &Path, make: impl FnOnce(&Path)) -> PathBuf {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let lock = std::fs::File::create(path.with_extension("lock")).unwrap();
    lock.lock().unwrap();
    // Written last, so that what was made in part is made again.
    let stamp = path.with_extension("made");
    let changed = |of: &Path| std::fs::metadata(of).and_then(|m| m.modified());
    let programs = [PathBuf::from(env!("CARGO_BIN_EXE_kilwa")), std::env::current_exe().unwrap()];
    let is_current = changed(&stamp).is_ok_and(|at| programs.iter().all(|program| changed(program).unwrap() < at));
    if !path.exists() || !is_current {
        if path.is_dir() {
            std::fs::remove_dir_all(path).unwrap();
        }
        make(path);
        std::fs::write(stamp, "").unwrap();
    }
    path.to_owned()
}

/// A pack of 327,680 triangles.
pub(crate) fn large_pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pack_verbs");
    built_once(&folder, "large", |to| Input::torus(1280, 128, [0.0; 3]).write(to), &[])
}

/// Run the program with `--json`; what it prints.
pub(crate) fn json(args: &[&str]) -> serde_json::Value {
    serde_json::from_str(&succeeds(&[args, &["--json"]].concat())).unwrap()
}

/// Make a named pipe.
pub(crate) fn make_pipe(path: &Path) {
    assert!(Command::new("mkfifo").arg(path).status().expect("starts").success());
}

/// A path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A place on the lattice and its colour.
pub(crate) type Corner = ([i32; 3], Option<[u8; 3]>);

/// Triangles as a sorted multiset of lattice corners with colours, each rotated to its smallest form, without those whose
/// corners fall together on the lattice.
pub(crate) fn multiset(triangles: impl Iterator<Item = [Corner; 3]>) -> Vec<[Corner; 3]> {
    let mut all: Vec<_> = triangles
        .filter(|[a, b, c]| a.0 != b.0 && b.0 != c.0 && c.0 != a.0)
        .map(|[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap())
        .collect();
    all.sort_unstable();
    all
}

/// All PLY files below a folder, in order.
pub(crate) fn plys(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            plys(&path, found);
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("ply")) {
            found.push(path);
        }
    }
}

/// A file of the shared data, or `None`, with a printed note that names it.
pub(crate) fn shared(name: &str) -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    if path.is_file() {
        return Some(path);
    }
    println!("skipped: {} is not here", path.display());
    None
}

/// A PLY as read back: vertices as named numbers, triangles.
#[derive(Debug, Default)]
pub(crate) struct Ply {
    pub(crate) properties: Vec<String>,
    pub(crate) types: Vec<String>,
    pub(crate) vertices: Vec<Vec<f64>>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Ply {
    /// The position of a vertex.
    pub(crate) fn position(&self, v: u32) -> [f64; 3] {
        let at = &self.vertices[v as usize];
        [at[0], at[1], at[2]]
    }

    /// A property of a vertex.
    pub(crate) fn get(&self, v: u32, name: &str) -> Option<f64> {
        let at = self.properties.iter().position(|p| p == name)?;
        Some(self.vertices[v as usize][at])
    }

    /// How many triangles use each edge, edges named by the positions of their ends.
    pub(crate) fn edge_uses(&self) -> BTreeMap<[[u64; 3]; 2], u32> {
        let mut uses = BTreeMap::new();
        for t in &self.triangles {
            for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                let mut ends = [a, b].map(|v| self.position(v).map(f64::to_bits));
                ends.sort_unstable();
                *uses.entry(ends).or_default() += 1;
            }
        }
        uses
    }

    /// Read what `kilwa extract` writes: `vertex` and `face`, binary little-endian or ascii.
    pub(crate) fn read(path: &Path) -> Self {
        let bytes = std::fs::read(path).unwrap();
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).expect("a header") + end.len();
        let header = std::str::from_utf8(&bytes[..at]).unwrap();
        let mut ply = Self::default();
        let mut counts = BTreeMap::new();
        let mut element = String::new();
        let mut ascii = false;
        for line in header.lines() {
            match line.split_whitespace().collect::<Vec<_>>()[..] {
                ["format", format, "1.0"] => ascii = format == "ascii",
                ["element", name, count] => {
                    name.clone_into(&mut element);
                    counts.insert(element.clone(), count.parse::<usize>().unwrap());
                }
                ["property", "list", "uchar", "int", "vertex_indices"] => assert_eq!(element, "face"),
                ["property", kind, name] => {
                    assert_eq!(element, "vertex");
                    ply.types.push(kind.to_owned());
                    ply.properties.push(name.to_owned());
                }
                _ => {}
            }
        }
        let mut body = Body { bytes: &bytes[at..], ascii };
        for _ in 0..counts["vertex"] {
            let vertex = ply.types.iter().map(|kind| body.number(kind)).collect();
            ply.vertices.push(vertex);
        }
        // Points have no faces.
        for _ in 0..counts.get("face").copied().unwrap_or(0) {
            assert_eq!(body.number("uchar"), 3.0);
            ply.triangles.push([(); 3].map(|()| body.number("int") as u32));
        }
        assert!(body.bytes.iter().all(u8::is_ascii_whitespace) || !ascii && body.bytes.is_empty(), "bytes left over");
        ply
    }
}

struct Body<'a> {
    bytes: &'a [u8],
    ascii: bool,
}

impl Body<'_> {
    fn number(&mut self, kind: &str) -> f64 {
        if self.ascii {
            let from = self.bytes.iter().position(|b| !b.is_ascii_whitespace()).unwrap();
            let rest = &self.bytes[from..];
            let to = rest.iter().position(u8::is_ascii_whitespace).unwrap();
            self.bytes = &rest[to..];
            return std::str::from_utf8(&rest[..to]).unwrap().parse().unwrap();
        }
        let size = match kind {
            "uchar" => 1,
            "float" | "int" => 4,
            "double" => 8,
            other => panic!("unexpected type {other}"),
        };
        let (now, rest) = self.bytes.split_at(size);
        self.bytes = rest;
        match kind {
            "uchar" => f64::from(now[0]),
            "float" => f64::from(f32::from_le_bytes(now.try_into().unwrap())),
            "int" => f64::from(i32::from_le_bytes(now.try_into().unwrap())),
            _ => f64::from_le_bytes(now.try_into().unwrap()),
        }
    }
}

/// A mesh to build from: positions, colours, triangles; written as ascii PLY with doubles.
#[derive(Default)]
pub(crate) struct Input {
    pub(crate) positions: Vec<[f64; 3]>,
    pub(crate) colors: Vec<[u8; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Input {
    /// A closed, dented, coloured torus of `2 n m` triangles about `origin`.
    pub(crate) fn torus(n: u32, m: u32, origin: [f64; 3]) -> Self {
        let mut mesh = Self::default();
        for i in 0..n {
            for j in 0..m {
                let (u, v) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(m));
                let (u, v) = (u * std::f64::consts::TAU, v * std::f64::consts::TAU);
                let r = 1.0 + 0.1 * (7.0 * u).sin() * (5.0 * v).cos() + 0.003 * (91.0 * u).sin() * (53.0 * v).sin();
                let ring = 3.0 + r * v.cos();
                let p = [ring * u.cos(), ring * u.sin(), r * v.sin()];
                mesh.positions.push([0, 1, 2].map(|k| origin[k] + p[k]));
                mesh.colors.push([(i % 256) as u8, (j * 3 % 256) as u8, ((i * 7 + j * 5) % 256) as u8]);
                let at = |i: u32, j: u32| (i % n) * m + j % m;
                mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
                mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            }
        }
        mesh
    }

    /// Write it with its colours.
    pub(crate) fn write(&self, path: &Path) {
        let colors = "property uchar red\nproperty uchar green\nproperty uchar blue\n";
        self.write_with(path, colors, |i| {
            let [r, g, b] = self.colors[i];
            format!("{r} {g} {b}")
        });
    }

    /// Write it with some properties for each vertex, by its number, after the position.
    pub(crate) fn write_with(&self, path: &Path, properties: &str, values: impl Fn(usize) -> String) {
        use std::fmt::Write;
        let mut out = String::from("ply\nformat ascii 1.0\n");
        let _ = writeln!(out, "element vertex {}", self.positions.len());
        out += "property double x\nproperty double y\nproperty double z\n";
        out += properties;
        let _ =
            writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", self.triangles.len());
        for (i, p) in self.positions.iter().enumerate() {
            let _ = writeln!(out, "{} {} {} {}", p[0], p[1], p[2], values(i));
        }
        for t in &self.triangles {
            let _ = writeln!(out, "3 {} {} {}", t[0], t[1], t[2]);
        }
        std::fs::write(path, out).unwrap();
    }
}
