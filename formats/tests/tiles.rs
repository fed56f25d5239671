//! 3D Tiles: whatever a client shows at rest has no cracks, the finest tiles have the triangles of the pack, and files are as the specification and the
//! documentation promise.

use crate::reduce::{extracted, torus};
use glam::{DMat4, DVec3};
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_formats::extract::WINDOW;
use kilwa_formats::extract::tiles::{Earth, Folder, Limits, PIXELS, Profile, Request, Tileset, write_tiles};
use kilwa_formats::read::read_mesh;
use kilwa_pack::reader::SliceSource;
use kilwa_pack::{NO_DIAMOND, Reader};
use serde_json::Value;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

type Pack = Reader<SliceSource<Vec<u8>>>;

/// Small tiles and short files, so that a small model has many.
const SMALL: Limits = Limits { triangles: 400, vertices: 600, tiles_of_file: 20 };

/// A planet without flattening: x and y are lengths along its equator and its meridians.
struct Ball;

impl Earth for Ball {
    fn geocentric(&self, world: DVec3) -> Option<DVec3> {
        const RADIUS: f64 = 6_371_000.0;
        let (lon, lat) = (world.x / RADIUS, world.y / RADIUS);
        let up = DVec3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin());
        Some(up * (RADIUS + world.z))
    }
}

/// A closed surface, `scale` times 10 m wide, far from the origin.
fn pack(scale: f64) -> Pack {
    let mut mesh = torus(160, 64);
    for p in &mut mesh.positions {
        *p = *p * scale + DVec3::new(531_000.0, 4_010_000.0, 12.0);
    }
    mesh.colors = (0..mesh.positions.len()).map(|i| [(i % 251) as u8, (i / 64) as u8, 128]).collect();
    let options = BuildOptions { leaf_triangles: 64, ..BuildOptions::default() };
    let built = build_pack(mesh, &options, &Silent).expect("builds");
    Reader::open(SliceSource(built.bytes)).expect("a pack")
}

fn written(pack: &Pack, profile: Profile, limits: Limits, earth: Option<&dyn Earth>, to: &Path) -> Tileset {
    let folder = Folder::prepare(to).expect("can be written");
    let request = Request { profile, limits, earth, crs: None };
    write_tiles(pack, &request, &folder, &|_, _| ()).expect("writes")
}

/// A tile as a client knows it.
struct Tile {
    /// Metres in the frame of the tileset.
    center: DVec3,
    radius: f64,
    error: f64,
    /// Names a GLB.
    content: Option<String>,
    /// Names a tileset, whose first tile is its only child.
    is_external: bool,
    children: Vec<Tile>,
}

fn json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).expect("is there")).expect("JSON")
}

impl Tile {
    fn of(json: &Value, folder: &Path, inside: &str) -> Self {
        let sphere: Vec<f64> = serde_json::from_value(json["boundingVolume"]["sphere"].clone()).expect("a sphere");
        let uri = json["content"]["uri"].as_str().map(|uri| match uri.strip_prefix("../") {
            Some(above) => above.to_owned(),
            None => format!("{inside}{uri}"),
        });
        let is_external =
            uri.as_ref().is_some_and(|uri| std::path::Path::new(uri.as_str()).extension().is_some_and(|e| e == "json"));
        let children = match &uri {
            Some(uri) if is_external => vec![Self::whole(folder, uri)],
            _ => json["children"].as_array().into_iter().flatten().map(|c| Self::of(c, folder, inside)).collect(),
        };
        let center = DVec3::new(sphere[0], sphere[1], sphere[2]);
        let error = json["geometricError"].as_f64().expect("an error");
        Self { center, radius: sphere[3], error, content: uri.filter(|_| !is_external), is_external, children }
    }

    /// The first tile of a tileset.
    fn whole(folder: &Path, name: &str) -> Self {
        let json = json(&folder.join(name));
        assert_eq!((&json["asset"]["version"], &json["root"]["refine"]), (&"1.1".into(), &"REPLACE".into()));
        Self::of(&json["root"], folder, name.rsplit_once('/').map_or("", |_| "tilesets/"))
    }

    fn visit<'a>(&'a self, above: Option<&'a Self>, each: &mut dyn FnMut(&'a Self, Option<&'a Self>)) {
        each(self, above);
        for child in &self.children {
            child.visit(Some(self), each);
        }
    }

    /// The contents that are shown at rest where `refines` decides, as the three clients descend: tilesets are entered always.
    fn shown<'a>(&'a self, refines: &dyn Fn(&Self) -> bool, out: &mut Vec<&'a str>) {
        if self.is_external || !self.children.is_empty() && refines(self) {
            for child in &self.children {
                child.shown(refines, out);
            }
        } else if let Some(content) = &self.content {
            out.push(content);
        }
    }
}

fn transform(folder: &Path) -> DMat4 {
    let columns: [f64; 16] =
        serde_json::from_value(json(&folder.join("tileset.json"))["root"]["transform"].clone()).expect("a matrix");
    DMat4::from_cols_array(&columns)
}

/// The mesh of a tile in the frame of the tileset: z is up there, and y in glTF.
fn mesh_of(folder: &Path, name: &str) -> RawMesh {
    let mut mesh = read_mesh(&folder.join(name), &mut |_, _| {}).unwrap_or_else(|e| panic!("{name}: {e}"));
    for p in &mut mesh.positions {
        *p = DVec3::new(p.x, -p.z, p.y);
    }
    mesh
}

/// The boundary of a surface as a sum: of every edge its number, negative in the other direction. It is 0 if and (but for collisions of the numbers)
/// only if each edge is used as often one way as the other, bit for bit.
fn boundary(mesh: &RawMesh) -> i128 {
    let name = |v: u32| mesh.positions[v as usize].to_array().map(|x| (x + 0.0).to_bits());
    let mut sum = 0i128;
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (name(t[k]), name(t[(k + 1) % 3]));
            let number = [0u8, 1].map(|half| {
                let mut hasher = DefaultHasher::new();
                (half, a.min(b), a.max(b)).hash(&mut hasher);
                hasher.finish()
            });
            let number = (i128::from(number[0]) << 62) ^ i128::from(number[1]);
            sum = if a < b { sum.wrapping_add(number) } else { sum.wrapping_sub(number) };
        }
    }
    sum
}

/// How three clients decide, from the distance of a camera to a sphere and the error, in pixels of their limit. `height` is that of the picture,
/// `tangent` of half the angle of view. Read in CesiumJS 1.145 (`Cesium3DTile.getScreenSpaceError`), 3d-tiles-renderer 0.5
/// (`calculateTileViewError`) and loaders.gl 4.5 (`TileHeader.getScreenSpaceError`).
fn clients(height: f64, tangent: f64) -> [Box<dyn Fn(f64, f64) -> bool>; 3] {
    let denominator = 2.0 * tangent;
    [
        Box::new(move |error, distance: f64| error * height / (distance.max(1e-7) * denominator) > 16.0),
        Box::new(move |error, distance: f64| {
            let pixels = denominator / height;
            (if distance == 0.0 { f64::INFINITY } else { error / (distance * pixels) }) > 16.0
        }),
        Box::new(move |error, distance: f64| error * height / (distance.max(1e-7) * 1.15) > 8.0),
    ]
}

/// Show `root` to `cameras` random cameras in every client; returns how many different sets of tiles were shown.
fn assert_closed(folder: &Path, root: &Tile, cameras: usize) -> usize {
    let mut boundaries: BTreeMap<&str, i128> = BTreeMap::new();
    root.visit(None, &mut |tile, _| {
        if let Some(name) = &tile.content {
            boundaries.insert(name, boundary(&mesh_of(folder, name)));
        }
    });
    let transform = transform(folder);
    let scale = (0..3).map(|k| transform.col(k).length()).fold(0.0, f64::max);
    let mut random = fastrand::Rng::with_seed(26);
    let mut seen: BTreeMap<u64, usize> = BTreeMap::new();
    for _ in 0..cameras {
        let direction = DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5).normalize_or(DVec3::X);
        // From inside to a hundred times its size away.
        let away = root.radius * 10f64.powf(random.f64() * 4.0 - 2.0);
        let camera = transform.transform_point3(root.center + direction * away);
        for decides in &clients(300.0 + 2000.0 * random.f64(), 0.2 + random.f64()) {
            let refines = |tile: &Tile| {
                let distance = transform.transform_point3(tile.center).distance(camera) - tile.radius * scale;
                decides(tile.error, distance.max(0.0))
            };
            let mut shown = Vec::new();
            root.shown(&refines, &mut shown);
            let sum = shown.iter().fold(0i128, |sum, name| sum.wrapping_add(boundaries[name]));
            assert_eq!(sum, 0, "open edges in {} tiles from {camera}", shown.len());
            let mut hasher = DefaultHasher::new();
            shown.hash(&mut hasher);
            seen.insert(hasher.finish(), shown.len());
        }
    }
    seen.len()
}

#[test]
fn what_every_client_shows_at_rest_is_closed() {
    let work = tempfile::tempdir().unwrap();
    for (name, scale, earth) in
        [("local", 1.0, None), ("flat", 1.0, Some(&Ball as &dyn Earth)), ("curved", 100.0, Some(&Ball))]
    {
        let (pack, folder) = (pack(scale), work.path().join(name));
        let report = written(&pack, Profile::Web, SMALL, earth, &folder);
        assert_eq!((report.is_curved, report.residual.is_some()), (name == "curved", name == "flat"), "{name}");
        let different = assert_closed(&folder, &Tile::whole(&folder, "tileset.json"), 10_000);
        assert!(different > 200, "{name}: only {different} cuts");
    }
}

#[test]
fn vertices_that_tiles_share_have_the_same_floats() {
    let work = tempfile::tempdir().unwrap();
    for (name, scale, earth) in
        [("local", 1.0, None), ("flat", 1.0, Some(&Ball as &dyn Earth)), ("curved", 100.0, Some(&Ball))]
    {
        let folder = work.path().join(name);
        let report = written(&pack(scale), Profile::Plain, SMALL, earth, &folder);
        // With one offset, equal positions are equal floats, and clients compute the same of them in every tile.
        let mut offsets = Vec::new();
        Tile::whole(&folder, "tileset.json").visit(None, &mut |tile, _| {
            let Some(content) = &tile.content else { return };
            let bytes = std::fs::read(folder.join(content)).expect("is there");
            let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four bytes")) as usize;
            let file: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
            offsets.push(file["nodes"][0]["translation"].to_string());
        });
        assert_eq!(offsets.len() as u64, report.tiles);
        offsets.sort();
        offsets.dedup();
        assert_eq!(offsets.len(), 1, "{name}: {offsets:?}");
    }
}

#[test]
fn a_wrong_decision_would_be_noticed() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path().join("tiles");
    written(&pack(1.0), Profile::Web, SMALL, None, &folder);
    let root = Tile::whole(&folder, "tileset.json");
    let mut random = fastrand::Rng::with_seed(1);
    // Tiles that decide by themselves do not fit together.
    let open = (0..100).filter(|_| {
        let chosen = std::cell::RefCell::new(&mut random);
        let mut shown = Vec::new();
        root.shown(&|_| chosen.borrow_mut().f64() < 0.8, &mut shown);
        shown.iter().fold(0i128, |sum, name| sum.wrapping_add(boundary(&mesh_of(&folder, name)))) != 0
    });
    assert!(open.count() > 50);
}

#[test]
fn spheres_contain_what_is_below_and_errors_decrease() {
    let work = tempfile::tempdir().unwrap();
    for (name, scale, earth) in [("local", 1.0, None), ("curved", 100.0, Some(&Ball as &dyn Earth))] {
        let folder = work.path().join(name);
        let pack = pack(scale);
        let report = written(&pack, Profile::Web, SMALL, earth, &folder);
        let root = Tile::whole(&folder, "tileset.json");
        let (mut files, mut same): (Vec<String>, BTreeMap<u64, [f64; 4]>) = (Vec::new(), BTreeMap::new());
        let mut largest: f64 = 0.0;
        root.visit(None, &mut |tile, above| {
            if let Some(above) = above {
                assert!(tile.error < above.error, "{name}: {} is not below {}", tile.error, above.error);
                assert!(
                    above.center.distance(tile.center) + tile.radius <= above.radius,
                    "{name}: a sphere sticks out"
                );
            }
            assert_eq!(tile.error == 0.0, tile.children.is_empty(), "{name}: only leaves have no error");
            if !tile.is_external && !tile.children.is_empty() && above.is_some() {
                // Groups have different errors here, so that the same error is the same group.
                let sphere = [tile.center.x, tile.center.y, tile.center.z, tile.radius];
                assert_eq!(*same.entry(tile.error.to_bits()).or_insert(sphere), sphere);
            }
            if let Some(content) = &tile.content {
                files.push(content.clone());
                let mesh = mesh_of(&folder, content);
                assert!(mesh.triangles.len() <= SMALL.triangles && mesh.positions.len() <= SMALL.vertices);
                let farthest = mesh.positions.iter().map(|p| p.distance(tile.center)).fold(0.0, f64::max);
                assert!(farthest <= tile.radius * (1.0 + 1e-9), "{name}: {content} reaches out of its sphere");
                largest = largest.max(tile.error);
            }
        });
        files.sort();
        let count = files.len();
        files.dedup();
        assert_eq!((files.len(), files.len() as u64), (count, report.tiles), "each file is named once");
        assert!(report.tilesets > 3 && files.iter().all(|f| folder.join(f).is_file()), "{}", report.tilesets);
        // One pixel at the limit of clients.
        let coarsest = pack.entries().iter().map(|e| e.error).filter(|e| e.is_finite()).fold(0.0, f32::max);
        let ratio = largest / (PIXELS * f64::from(coarsest));
        assert!((1.0..1.01).contains(&ratio), "{name}: {ratio}");
    }
}

/// Triangles as a sorted list of lattice corners with their colours, each rotated to its smallest form.
type Corner = ([i32; 3], [u8; 3]);

fn sorted(triangles: impl Iterator<Item = [Corner; 3]>) -> Vec<[Corner; 3]> {
    let rotated = |[a, b, c]: [Corner; 3]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().expect("three");
    let mut all: Vec<_> = triangles.map(rotated).collect();
    all.sort_unstable();
    all
}

#[test]
fn leaf_tiles_have_the_triangles_of_the_pack_in_both_profiles() {
    let work = tempfile::tempdir().unwrap();
    let pack = pack(1.0);
    let mut expected = Vec::new();
    for i in 0..pack.entries().len() as u32 {
        let chunk = pack.chunk(i).unwrap();
        for patch in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
            for t in patch.first..patch.first + patch.count {
                let corner = |v: u32| (chunk.mesh.positions[v as usize].to_array(), chunk.mesh.colors[v as usize]);
                expected.push(chunk.mesh.triangles[t as usize].map(corner));
            }
        }
    }
    let expected = sorted(expected.into_iter());
    for (name, profile) in [("web", Profile::Web), ("plain", Profile::Plain)] {
        let folder = work.path().join(name);
        let report = written(&pack, profile, SMALL, None, &folder);
        let (transform, lattice) = (transform(&folder), pack.header().lattice);
        let mut found = Vec::new();
        Tile::whole(&folder, "tileset.json").visit(None, &mut |tile, _| {
            let Some(content) = tile.content.as_ref().filter(|_| tile.children.is_empty()) else { return };
            let mesh = mesh_of(&folder, content);
            let corner = |v: u32| {
                let world = transform.transform_point3(mesh.positions[v as usize]);
                (lattice.snap(world).expect("on the lattice").to_array(), mesh.colors[v as usize])
            };
            found.extend(mesh.triangles.iter().map(|t| t.map(corner)));
        });
        assert_eq!(report.triangles as usize, expected.len(), "{name}");
        assert!(sorted(found.into_iter()) == expected, "{name}: other triangles");
    }
}

#[test]
fn vertices_are_on_the_sphere_of_the_earth() {
    let work = tempfile::tempdir().unwrap();
    let (pack, folder) = (pack(100.0), work.path().join("tiles"));
    let report = written(&pack, Profile::Web, SMALL, Some(&Ball), &folder);
    let transform = transform(&folder);
    let exact: Vec<DVec3> = (0..pack.entries().len() as u32)
        .flat_map(|i| pack.chunk(i).unwrap().mesh.positions)
        .map(|p| Ball.geocentric(pack.header().lattice.world_from_lattice(p)).expect("on the ball"))
        .collect();
    // By cells of ten steps, so that neighbours are found without comparing all with all.
    let cell = |p: DVec3| (p / (report.spacing * 10.0)).floor().as_i64vec3().to_array();
    let mut cells: BTreeMap<[i64; 3], Vec<DVec3>> = BTreeMap::new();
    for p in &exact {
        cells.entry(cell(*p)).or_default().push(*p);
    }
    let mut worst: f64 = 0.0;
    Tile::whole(&folder, "tileset.json").visit(None, &mut |tile, _| {
        let Some(content) = &tile.content else { return };
        for p in mesh_of(&folder, content).positions {
            let p = transform.transform_point3(p);
            let c = cell(p);
            let near = (0..27).filter_map(|i| cells.get(&[c[0] + i % 3 - 1, c[1] + i / 3 % 3 - 1, c[2] + i / 9 - 1]));
            worst = worst.max(near.flatten().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min));
        }
    });
    assert!(worst <= report.spacing * 0.87 + 1e-8, "{worst} m, with a spacing of {} m", report.spacing);
}

fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inside) = folders.pop() {
        for entry in std::fs::read_dir(inside).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
                all.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    all
}

#[test]
fn threads_change_no_byte_and_the_report_counts_all() {
    let work = tempfile::tempdir().unwrap();
    let pack = pack(1.0);
    let with = |threads: usize| {
        let folder = work.path().join(format!("{threads} threads"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let report = pool.install(|| written(&pack, Profile::Web, SMALL, None, &folder));
        (report, contents(&folder))
    };
    let ((report, one), (_, four)) = (with(1), with(4));
    assert!(one == four);
    assert_eq!(report.bytes, one.values().map(|b| b.len() as u64).sum::<u64>());
    assert_eq!((report.tiles + report.tilesets) as usize, one.len());
    assert_eq!(report.triangles, pack.header().triangles);
}

#[test]
fn a_small_model_is_one_tile_or_a_few() {
    let work = tempfile::tempdir().unwrap();
    let built = build_pack(torus(16, 8), &BuildOptions::default(), &Silent).expect("builds");
    let pack = Reader::open(SliceSource(built.bytes)).expect("a pack");
    for (name, limits) in [("one", Limits::default()), ("several", Limits { triangles: 50, ..SMALL })] {
        let folder = work.path().join(name);
        let report = written(&pack, Profile::Plain, limits, None, &folder);
        assert_eq!((report.triangles, report.tiles == 1), (256, name == "one"));
        assert!(assert_closed(&folder, &Tile::whole(&folder, "tileset.json"), 50) >= 1);
    }
}

#[test]
fn nothing_is_overwritten_and_nothing_is_left_after_a_failure() {
    let work = tempfile::tempdir().unwrap();
    let pack = pack(1.0);
    let at = work.path().join("new/tiles");
    let folder = Folder::prepare(&at).expect("can be written");
    // The last chunk is damaged.
    let mut bytes = pack.source().0.clone();
    let last = pack.entries().last().expect("a chunk");
    bytes[(last.offset + u64::from(last.encoded_bytes)) as usize - 1] ^= 1;
    let damaged = Reader::open(SliceSource(bytes)).expect("opens");
    let request = Request { profile: Profile::Web, limits: SMALL, earth: None, crs: None };
    let error = write_tiles(&damaged, &request, &folder, &|_, _| ()).unwrap_err();
    assert!(!error.is_of_output() && error.to_string().contains("chunk"), "{error}");
    assert!(!work.path().join("new").exists(), "not even the folder above");
    written(&pack, Profile::Web, SMALL, None, &at);
    let before = contents(&at);
    let text = Folder::prepare(&at).unwrap_err().to_string();
    assert!(text.contains("already exists; remove it, or choose another name"), "{text}");
    // Somebody was faster.
    let error = write_tiles(&pack, &request, &folder, &|_, _| ()).unwrap_err();
    assert!(error.is_of_output() && error.to_string().contains("tiles"), "{error}");
    assert!(contents(&at) == before);
    assert_eq!(std::fs::read_dir(work.path().join("new")).unwrap().count(), 1);
    let text = Folder::prepare(&at.join("tileset.json/below")).unwrap_err().to_string();
    assert!(text.contains("tileset.json is not a folder"), "{text}");
}

#[test]
fn a_place_off_the_earth_is_refused() {
    struct Nowhere;
    impl Earth for Nowhere {
        fn geocentric(&self, _: DVec3) -> Option<DVec3> {
            None
        }
    }
    let work = tempfile::tempdir().unwrap();
    let folder = Folder::prepare(&work.path().join("tiles")).expect("can be written");
    let request = Request { profile: Profile::Web, limits: SMALL, earth: Some(&Nowhere), crs: None };
    let text = write_tiles(&pack(1.0), &request, &folder, &|_, _| ()).unwrap_err().to_string();
    assert!(text.contains("has no place on the earth") && text.contains("--crs local"), "{text}");
}

/// The corners of triangles in millimetres, each from its smallest corner on, sorted: equal for the same surface, however it is divided and numbered.
fn triangles_of(mesh: &RawMesh) -> Vec<[[i64; 3]; 3]> {
    let corner = |v: u32| mesh.positions[v as usize].to_array().map(|x| (x * 1000.0).round() as i64);
    let mut all: Vec<[[i64; 3]; 3]> = mesh
        .triangles
        .iter()
        .map(|t| {
            let mut corners = t.map(corner);
            let first = (0..3).min_by_key(|&i| corners[i]).unwrap_or(0);
            corners.rotate_left(first);
            corners
        })
        .collect();
    all.sort_unstable();
    all
}

#[test]
fn a_written_tileset_is_read_back_as_the_finest_surface() {
    let work = tempfile::tempdir().unwrap();
    let pack = pack(1.0);
    let mut finest: Vec<[[i64; 3]; 3]> = Vec::new();
    for (name, profile, earth) in [
        ("plain", Profile::Plain, None),
        ("web", Profile::Web, None),
        ("earth", Profile::Web, Some(&Ball as &dyn Earth)),
    ] {
        let folder = work.path().join(name);
        let report = written(&pack, profile, SMALL, earth, &folder);
        assert!(
            report.tilesets > 2 && report.stored_triangles > report.triangles,
            "{name} has nested files and coarser levels"
        );
        let mesh = read_mesh(&folder.join("tileset.json"), &mut |_, _| {}).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(mesh.triangles.len() as u64, report.triangles, "{name}");
        assert_eq!(mesh.colors.len(), mesh.positions.len(), "{name}");
        let count = |kind: &str| mesh.diagnostics.count(kind);
        let coarser = count("coarser tiles left out, because finer ones replace them");
        assert_eq!(count("tiles of the finest level read") + coarser, report.tiles, "{name}");
        assert_eq!(count("external tilesets read") + 1, report.tilesets, "{name}");
        let geocentric = count("tiles in geocentric coordinates (EPSG:4978), kept as they are");
        assert_eq!(geocentric > 0, earth.is_some(), "{name}");
        if earth.is_none() {
            let triangles = triangles_of(&mesh);
            if !finest.is_empty() {
                assert!(triangles == finest, "both profiles have the same triangles");
            }
            finest = triangles;
        }
    }
    // The surface of the pack, extracted by another writer.
    let (_, expected) = extracted(&pack, None, WINDOW, None);
    assert!(finest == triangles_of(&expected), "the triangles of the pack");
}
