//! Second opinions by programs that others wrote: trimesh on areas, volumes and sections, ezdxf on the DXF. From PyPI; `cargo xtask
//! test` puts them in the tools' folder and names it in `KILWA_PYTHON`; where that is not set the tests say so.

use super::check_bound;
use super::phantoms::{measure, phantom, reading};
use crate::support::{json, shared, succeeds, text};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

/// The JSON that a Python program prints, or `None` where the packages are not there.
pub(crate) fn python(program: &str, args: &[&str]) -> Option<Value> {
    let Some(packages) = std::env::var_os("KILWA_PYTHON") else {
        println!("skipped: second opinion by trimesh and ezdxf: KILWA_PYTHON is not set (cargo xtask test sets it)");
        return None;
    };
    let output = Command::new("python3").env("PYTHONPATH", packages).args(["-c", program]).args(args).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

const TRIMESH: &str = "
import sys, json, numpy, trimesh
m = trimesh.load(sys.argv[1], process=False)
s = trimesh.intersections.mesh_plane(m, [0, 0, 1], [0, 0, float(sys.argv[2])])
print(json.dumps({'area': float(m.area), 'volume': float(m.volume), 'section': float(numpy.linalg.norm(s[:, 1] - s[:, 0], axis=1).sum())}))
";

/// Area, volume where it is closed, and a level section, against trimesh on the mesh that `kilwa extract` gives back.
fn compare(name: &str, pack: &Path, closed: bool) {
    let folder = tempfile::tempdir().unwrap();
    let (ply, out) = (folder.path().join("mesh.ply"), folder.path().join("s.json"));
    succeeds(&["extract", text(pack), "-o", text(&ply)]);
    let info = json(&["info", text(pack)]);
    let z = |k: &str| info["metadata"][k][2].as_f64().unwrap();
    let middle = z("bounds_min") + 0.437 * (z("bounds_max") - z("bounds_min"));
    let height = format!("{middle:?}");
    let Some(other) = python(TRIMESH, &[text(&ply), &height]) else { return };
    let of = |k: &str| other[k].as_f64().unwrap();
    let found = json(&["measure", text(pack), "area"]);
    check_bound(
        &format!("surface of {name} against trimesh, relative"),
        1e-6,
        (reading(&found, "surface") / of("area") - 1.0).abs(),
    );
    let section = json(&["measure", text(pack), "section", &format!("--z={height}"), "-o", text(&out)]);
    let length = reading(&section, "length");
    check_bound(
        &format!("level section of {name} against trimesh, relative length"),
        1e-5,
        (length / of("section") - 1.0).abs(),
    );
    if closed {
        let volume = reading(&json(&["measure", text(pack), "volume"]), "volume");
        check_bound(&format!("volume of {name} against trimesh, relative"), 1e-5, (volume / of("volume") - 1.0).abs());
    }
}

#[test]
fn trimesh_agrees_on_phantoms() {
    for shape in ["sphere", "bent-wall"] {
        compare(shape, &phantom(shape, "origin").pack, true);
    }
}

#[test]
fn trimesh_agrees_on_real_scans() {
    for (file, closed) in
        [("pyvista+vtk-data/Data/turbineblade.ply", true), ("cnr-isti-vclab+3DHOP/examples/models/gargo.ply", true)]
    {
        let Some(path) = shared(file) else { continue };
        let folder = tempfile::tempdir().unwrap();
        let pack = folder.path().join("scan.kilwa");
        succeeds(&["build", text(&path), "-o", text(&pack)]);
        let borders = json(&["info", text(&pack)])["metadata"]["border_edges"].as_u64();
        compare(file.rsplit('/').next().unwrap(), &pack, closed && borders == Some(0));
    }
}

pub(crate) const EZDXF: &str = "
import sys, json, ezdxf
d = ezdxf.readfile(sys.argv[1])
a = d.audit()
lines = [[[p[0], p[1]] for p in e.get_points()] for e in d.modelspace().query('LWPOLYLINE')]
space = [[[v.dxf.location.x, v.dxf.location.y, v.dxf.location.z] for v in e.vertices] for e in d.modelspace().query('POLYLINE')]
print(json.dumps({'lines3': space, 'version': d.dxfversion, 'errors': len(a.errors), 'fixes': len(a.fixes), 'units': d.units, 'lines': lines,
  'layers': sorted(l.dxf.name for l in d.layers)}))
";

#[test]
fn a_second_parser_reads_the_drawing_bit_for_bit() {
    let p = phantom("bent-wall", "utm");
    let folder = tempfile::tempdir().unwrap();
    let (dxf, data) = (folder.path().join("s.dxf"), folder.path().join("s.json"));
    let height = format!("--z={:?}", p.at[2] + 1.13);
    for out in [&dxf, &data] {
        succeeds(&["measure", text(&p.pack), "section", &height, "-o", text(out)]);
    }
    let Some(read) = python(EZDXF, &[text(&dxf)]) else { return };
    assert_eq!(
        (&read["version"], &read["errors"], &read["fixes"], &read["units"]),
        (&"AC1024".into(), &0.into(), &0.into(), &6.into())
    );
    let ours: Value = serde_json::from_slice(&std::fs::read(&data).unwrap()).unwrap();
    let bits = |v: &Value| -> Vec<u64> {
        let points = v.as_array().unwrap().iter();
        points.flat_map(|q| [0, 1].map(|k| q[k].as_f64().unwrap().to_bits())).collect()
    };
    let theirs: Vec<Vec<u64>> = read["lines"].as_array().unwrap().iter().map(bits).collect();
    let ours: Vec<Vec<u64>> = ours["lines"].as_array().unwrap().iter().map(|l| bits(&l["flat"])).collect();
    println!("trust | DXF opened by ezdxf: errors, lines that differ by a bit | 0 | {}", usize::from(ours != theirs));
    assert!(!ours.is_empty() && ours == theirs);
    // And the section's length from it is that of the reading.
    let found = measure(&p, &["section", &height], &[]);
    assert!(reading(&found, "length") > 1.0);
}
