//! Analytic solids: lengths, areas, angles, volumes and sections, at any position.

use super::oracle::{P, area, cut, dot, length, perimeter, six_volume, sub, to_segment};
use super::{check_bound, check_none};
use crate::support::{Input, Ply, built_once, json, succeeds, text};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Positions of the phantoms: at the origin, at UTM coordinates, 10^7 m away.
pub(crate) const PLACES: [(&str, P); 3] =
    [("origin", [0.0; 3]), ("utm", [500_000.0, 4_649_776.0, 123.456]), ("far", [1e7, -1e7, 1e7])];

/// A phantom's triangles where it was made, and the pack of it moved.
pub(crate) struct Phantom {
    pub(crate) triangles: Vec<[P; 3]>,
    pub(crate) pack: PathBuf,
    pub(crate) at: P,
    pub(crate) step: f64,
}

pub(crate) fn phantom(shape: &str, place: &str) -> Phantom {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("trust");
    std::fs::create_dir_all(&folder).unwrap();
    let at = PLACES.iter().find(|p| p.0 == place).unwrap().1;
    // A name for each process: tests run side by side.
    let made = folder.join(format!("{shape}-{place}-{}.ply", std::process::id()));
    succeeds(&["synth", "phantom", "--shape", shape, "--triangles", "3000", "-o", text(&made), "--force"]);
    let ply = Ply::read(&made);
    std::fs::remove_file(&made).unwrap();
    let positions: Vec<P> = (0..ply.vertices.len()).map(|v| ply.position(v as u32)).collect();
    let triangles = ply.triangles.iter().map(|t| t.map(|v| positions[v as usize])).collect();
    let moved = Input {
        positions: positions.iter().map(|p| [0, 1, 2].map(|k| p[k] + at[k])).collect(),
        colors: vec![[128; 3]; positions.len()],
        triangles: ply.triangles,
    };
    let options = ["--step", "0.00048828125"];
    let pack = built_once(&folder, &format!("{shape}-{place}"), |to| moved.write(to), &options);
    Phantom { triangles, pack, at, step: 0.000_488_281_25 }
}

/// `kilwa measure` on a phantom, positions given where the phantom was made.
pub(crate) fn measure(of: &Phantom, tool: &[&str], points: &[P]) -> Value {
    let numbers: Vec<String> =
        points.iter().flat_map(|p| [0, 1, 2].map(|k| format!("{:?}", p[k] + of.at[k]))).collect();
    let mut args = vec!["measure", text(&of.pack), tool[0]];
    args.extend(numbers.iter().map(String::as_str));
    args.extend(&tool[1..]);
    json(&args)
}

pub(crate) fn reading(of: &Value, name: &str) -> f64 {
    let all = of["readings"].as_array().unwrap();
    let found = all.iter().find(|r| r["name"] == name).unwrap_or_else(|| panic!("no {name} in {all:?}"));
    found["value"].as_f64().unwrap()
}

#[test]
fn distances_are_exact_to_the_lattice_everywhere() {
    let tan = 1.0 / 3f64.sqrt();
    let cases: [(&str, P, P); 7] = [
        ("cube", [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        ("cube", [0.0, 0.5, 0.0], [1.0, 0.5, 0.0]),
        ("ramp", [0.0, 0.0, 0.0], [2.0, 1.0, 2.0 * tan]),
        ("cylinder", [2.0, 0.0, 0.0], [-2.0, 0.0, 4.0]),
        ("sphere", [0.0, 0.0, 0.0], [0.0, 0.0, 2.0]),
        ("stepped-wall", [0.0, 0.0, 0.0], [2.0, 2.0, 1.25]),
        ("bent-wall", [2.75, 0.0, 0.0], [3.25, 0.0, 2.0]),
    ];
    for (place, _) in PLACES {
        let mut worst = 0.0f64;
        for (shape, a, b) in cases {
            let p = phantom(shape, place);
            let is = |q: P| p.triangles.iter().flatten().any(|v| length(sub(*v, q)) < 1e-6);
            if !is(a) || !is(b) {
                // Not a corner of this tessellation: the nearest two corners are compared instead.
                let near = |q: P| {
                    *p.triangles
                        .iter()
                        .flatten()
                        .min_by(|u, v| length(sub(**u, q)).total_cmp(&length(sub(**v, q))))
                        .unwrap()
                };
                let (a, b) = (near(a), near(b));
                let found = reading(&measure(&p, &["distance"], &[a, b]), "straight");
                worst = worst.max((found - length(sub(b, a))).abs() / p.step);
                continue;
            }
            let found = measure(&p, &["distance"], &[a, b]);
            let d = sub(b, a);
            worst = worst.max((reading(&found, "straight") - length(d)).abs() / p.step);
            worst = worst.max((reading(&found, "vertical") - d[2]).abs() / p.step);
            worst = worst.max((reading(&found, "horizontal") - d[0].hypot(d[1])).abs() / p.step);
        }
        check_bound(
            &format!("distance between corners of phantoms, {place}, in lattice units"),
            3f64.sqrt() + 1e-5,
            worst,
        );
    }
}

/// The largest error of all phantoms at a place, as `error_of` counts it.
fn worst_of_phantoms(place: &str, error_of: impl Fn(&Phantom) -> f64) -> f64 {
    let shapes = ["cube", "ramp", "cylinder", "sphere", "stepped-wall", "bent-wall"];
    shapes.into_iter().map(|shape| error_of(&phantom(shape, place))).fold(0.0, f64::max)
}

#[test]
fn areas_are_correct_for_upright_oblique_and_curved_surfaces() {
    for (place, _) in PLACES {
        let worst = worst_of_phantoms(place, |p| {
            let found = measure(p, &["area"], &[]);
            let true_area: f64 = p.triangles.iter().map(|t| area(*t)).sum();
            // Every corner moves by at most half a diagonal of a lattice cell; each side sees half of that across it.
            let bound: f64 = p.triangles.iter().map(|t| perimeter(*t)).sum::<f64>() * 0.5 * 3f64.sqrt() * 0.5 * p.step;
            (reading(&found, "surface") - true_area).abs() / bound
        });
        check_bound(&format!("surface area of phantoms, {place}, share of what the lattice explains"), 1.0, worst);
        let cube = phantom("cube", place);
        let side = [[0.2, 0.0, 0.2], [0.8, 0.0, 0.2], [0.8, 0.0, 0.8], [0.2, 0.0, 0.8]];
        let wall = measure(&cube, &["area"], &side);
        let error = |name: &str, right: f64| (reading(&wall, name) - right).abs();
        check_bound(
            &format!("upright wall of 0.36 m², in its plane, {place}, m²"),
            2.4 * cube.step,
            error("fitted plane", 0.36),
        );
        check_bound(
            &format!("upright wall of 0.36 m², surface inside, {place}, m²"),
            2.4 * cube.step,
            error("surface", 0.36),
        );
        check_bound(&format!("upright wall of 0.36 m², in plan, {place}, m²"), 2.4 * cube.step, error("plan", 0.0));
        let ramp = phantom("ramp", place);
        let on = |x: f64, y: f64| [x, y, x / 3f64.sqrt()];
        let slope = measure(&ramp, &["area"], &[on(0.5, 0.2), on(1.5, 0.2), on(1.5, 0.8), on(0.5, 0.8)]);
        let right = 0.6 / (std::f64::consts::PI / 6.0).cos();
        let error = |name: &str, right: f64| (reading(&slope, name) - right).abs();
        check_bound(&format!("ramp of 30°, surface inside, {place}, m²"), 4.0 * ramp.step, error("surface", right));
        check_bound(&format!("ramp of 30°, in plan, {place}, m²"), 4.0 * ramp.step, error("plan", 0.6));
    }
}

/// Noise makes the area of the triangles too large. The interval has to hold that of the solid all the same, and the report has to say why.
#[test]
fn the_interval_of_an_area_holds_that_of_the_surface_below_the_noise() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("trust");
    std::fs::create_dir_all(&folder).unwrap();
    let side = ["0.2", "0", "0.2", "0.8", "0", "0.2", "0.8", "0", "0.8", "0.2", "0", "0.8"];
    for noise in ["0", "0.001", "0.003"] {
        for (shape, triangles, solid) in [("cube", "20000", 6.0), ("sphere", "40000", 4.0 * std::f64::consts::PI)] {
            let make = |to: &Path| {
                succeeds(&[
                    "synth",
                    "phantom",
                    "--shape",
                    shape,
                    "--triangles",
                    triangles,
                    "--noise",
                    noise,
                    "-o",
                    text(to),
                    "--force",
                ]);
            };
            let pack = built_once(&folder, &format!("{shape}-noise-{noise}"), make, &["--step", "0.00006103515625"]);
            let share = |found: &Value, truth: f64| {
                let surface = found["readings"].as_array().unwrap().iter().find(|r| r["name"] == "surface").unwrap();
                let [value, uncertainty] = ["value", "uncertainty"].map(|key| surface[key].as_f64().unwrap());
                // Flat facets cut off a little of the sphere: a quarter of the spacing squared over the radius, twice.
                let facets = if shape == "sphere" { 1e-3 * truth } else { 0.0 };
                ((value - truth).abs() - facets).max(0.0) / (2.0 * uncertainty)
            };
            let measured = |points: &[&str], truth: f64| {
                let args = [&["measure", text(&pack), "area"][..], points].concat();
                let said = succeeds(&args);
                assert!(said.contains("on average; finer relief"), "{said}");
                assert_eq!(said.contains("if this is noise"), noise != "0", "{said}");
                share(&json(&args), truth)
            };
            let mut worst = measured(&[], solid);
            if shape == "cube" {
                worst = worst.max(measured(&side, 0.36));
            }
            let what = format!("area of a {shape} with noise of {noise} m, error, share of twice its uncertainty");
            check_bound(&what, 1.0, worst);
        }
    }
}

#[test]
fn volumes_are_correct_to_a_millionth_beyond_the_lattice() {
    for (place, _) in PLACES {
        let worst = worst_of_phantoms(place, |p| {
            let true_volume = p.triangles.iter().map(|t| six_volume(*t)).sum::<f64>() / 6.0;
            let surface: f64 = p.triangles.iter().map(|t| area(*t)).sum();
            // The surface moves by at most half a diagonal of a lattice cell.
            let bound = surface * 3f64.sqrt() * 0.5 * p.step + 1e-6 * true_volume;
            let found = reading(&measure(p, &["volume"], &[]), "volume");
            (found - true_volume).abs() / bound
        });
        check_bound(&format!("volume of phantoms, {place}, share of what the lattice explains and 1e-6"), 1.0, worst);
    }
}

#[test]
fn measurements_do_not_depend_on_the_position_of_the_phantom() {
    // The places are whole steps apart in x and y; in z of "utm" the lattice falls otherwise.
    for shape in ["cube", "sphere"] {
        let (a, b) = (phantom(shape, "origin"), phantom(shape, "far"));
        let of = |p: &Phantom| {
            (reading(&measure(p, &["area"], &[]), "surface"), reading(&measure(p, &["volume"], &[]), "volume"))
        };
        let (a, b) = (of(&a), of(&b));
        let apart = ((a.0 - b.0) / a.0).abs().max(((a.1 - b.1) / a.1).abs());
        check_bound(
            &format!("area and volume of the {shape} at the origin and 10^7 m away, relative difference"),
            1e-6,
            apart,
        );
    }
}

#[test]
fn angles_are_correct_to_a_microradian_beyond_the_lattice() {
    for (place, _) in PLACES {
        let ramp = phantom("ramp", place);
        let on = |x: f64, y: f64| [x, y, x / 3f64.sqrt()];
        let slope = [on(0.0, 0.0), on(2.0, 0.0), on(2.0, 1.0)];
        let floor = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 1.0, 0.0]];
        let found = measure(&ramp, &["angle", "--planes"], &[slope, floor].concat());
        let error = (reading(&found, "angle") - std::f64::consts::FRAC_PI_6).abs();
        // Two planes over a metre at least, each tilted by a step at most.
        check_bound(&format!("angle of the ramp of 30° with its floor, {place}, rad"), 2.0 * ramp.step + 1e-6, error);
        let cube = phantom("cube", place);
        let corner = measure(&cube, &["angle"], &[[1.0, 0.0, 0.0], [0.0; 3], [0.0, 1.0, 0.0]]);
        let error = (reading(&corner, "angle") - std::f64::consts::FRAC_PI_2).abs();
        check_bound(&format!("right angle of the cube, {place}, rad"), 2.0 * cube.step + 1e-6, error);
    }
}

#[test]
fn fitted_circles_have_the_true_radius() {
    for (place, _) in PLACES {
        let p = phantom("cylinder", place);
        // Corners of the tessellation at the height of the rim.
        let rim: Vec<P> =
            p.triangles.iter().flatten().filter(|v| v[2] > 3.999_99 && v[0].hypot(v[1]) > 1.999_99).copied().collect();
        let points: Vec<P> = rim.iter().step_by(rim.len() / 12).copied().collect();
        let found = reading(&measure(&p, &["circle"], &points), "radius");
        check_bound(
            &format!("radius of the cylinder's rim, {place}, in lattice units"),
            3f64.sqrt(),
            (found - 2.0).abs() / p.step,
        );
    }
}

#[test]
fn sections_match_the_analytic_section_of_the_tessellated_phantom() {
    // Planes at 30° or more to every face that they cut: there a step of the lattice moves the line by two at most.
    let level = [0.0, 0.0, 1.0];
    let cases: [(&str, P, P); 5] = [
        ("cube", [0.5, 0.5, 0.5], [0.6, 0.48, 0.64]),
        ("cylinder", [0.0, 0.0, 1.7], level),
        ("ramp", [1.0, 0.5, 0.5], [0.0, 1.0, 0.0]),
        ("stepped-wall", [0.0, 1.1, 0.0], [0.0, 1.0, 0.0]),
        ("bent-wall", [0.0, 0.0, 1.13], level),
    ];
    for (place, _) in PLACES {
        let (mut worst, mut open) = (0.0f64, 0);
        for (shape, at, normal) in cases {
            let p = phantom(shape, place);
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("section.json");
            let world = [0, 1, 2].map(|k| at[k] + p.at[k]);
            let plane: Vec<String> = world.iter().chain(&normal).map(|x| format!("{x:?}")).collect();
            let plane = format!("--plane={}", plane.join(","));
            succeeds(&["measure", text(&p.pack), "section", &plane, "-o", text(&out)]);
            let found: Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
            let mut lines: Vec<Vec<P>> = Vec::new();
            for line in found["lines"].as_array().unwrap() {
                open += usize::from(line["closed"] != true);
                let points = line["world"].as_array().unwrap().iter();
                lines.push(points.map(|q| [0, 1, 2].map(|k| q[k].as_f64().unwrap() - p.at[k])).collect());
            }
            let right: Vec<[P; 2]> = p.triangles.iter().filter_map(|t| cut(*t, at, normal)).collect();
            let mine: Vec<[P; 2]> = lines.iter().flat_map(|l| l.windows(2).map(|w| [w[0], w[1]])).collect();
            let nearest = |q: P, all: &[[P; 2]]| all.iter().map(|s| to_segment(q, *s)).fold(f64::MAX, f64::min);
            for q in lines.iter().flatten() {
                worst = worst.max(nearest(*q, &right) / p.step);
                assert!(dot(normal, sub(*q, at)).abs() < 1e-6, "a point beside the plane");
            }
            for s in &right {
                let middle = [0, 1, 2].map(|k| (s[0][k] + s[1][k]) * 0.5);
                worst = worst.max(nearest(middle, &mine) / p.step);
            }
        }
        check_bound(
            &format!("sections against those of the tessellated phantoms, {place}, in lattice units"),
            3f64.sqrt(),
            worst,
        );
        check_none(&format!("sections of closed phantoms that are open, {place}"), 5, open);
    }
}
