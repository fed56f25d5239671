//! Two instruments of very different density, side by side: no step where one surface passes into the other.

use kilwa_scan::ScanError;
use kilwa_scan::import::{self, Silent};
use kilwa_scan::merge::{Begin, Intensity, MergedSurface, MergedVertex, Options, merge};
use kilwa_scan::survey::Survey;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Standard deviation of the noise across the plane, metres.
const SIGMA: f64 = 0.002;

/// Keeps x and y of vertices; the plane is y = 0.
#[derive(Default)]
struct Kept(Vec<[f64; 2]>);

impl MergedSurface for Kept {
    fn begin(&mut self, _: &Begin) -> Result<(), ScanError> {
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        let p = vertex.vertex.position;
        self.0.push([p.x, p.y]);
        Ok(())
    }

    fn triangle(&mut self, _: [u64; 3]) -> Result<(), ScanError> {
        Ok(())
    }
}

/// A scan of the plane from 4 m in front of it, from `from` to `from` + 3.5 m, with samples `step` apart.
fn scan(folder: &Path, name: &str, from: f64, step: f64) -> PathBuf {
    let mut random = fastrand::Rng::with_seed(3);
    let mut normal = || (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
    let (columns, rows) = ((3.5 / step) as u32 + 1, (2.0 / step) as u32 + 1);
    let mut ptx = format!("{columns}\n{rows}\n0 -4 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 -4 0 1\n");
    for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
        let [x, z] = [from + f64::from(column) * step, f64::from(row) * step - 1.0];
        // Noise is along the ray.
        let far = 1.0 + SIGMA * normal() / 4.0;
        writeln!(ptx, "{:.6} {:.6} {:.6} 0.5", x * far, 4.0 * far, z * far).unwrap();
    }
    let file = folder.join(name);
    std::fs::write(&file, ptx).unwrap();
    file
}

#[test]
fn scans_of_very_different_density_meet_without_a_step() {
    let folder = tempfile::tempdir().unwrap();
    let survey = folder.path().join("survey");
    let files = [scan(folder.path(), "dense.ptx", -3.0, 0.02), scan(folder.path(), "coarse.ptx", -0.5, 0.1)];
    import::import(&survey, &files, &import::Options::default(), &Silent).unwrap();
    let options = Options {
        voxel: Some(0.04),
        memory: 200 << 20,
        threads: 2,
        scratch: folder.path().to_owned(),
        unmasked: false,
        bounds: None,
        fill: kilwa_scan::merge::Fill::default(),
        intensity: Intensity::Raw,
    };
    let mut kept = Kept::default();
    let how = |_: &_| kilwa_scan::mesh::Options::default();
    merge(&survey, &Survey::open(&survey).unwrap(), &options, &how, &mut kept, &Silent).unwrap();
    assert!(kept.0.iter().all(|[_, y]| y.abs() < 4.0 * SIGMA));
    // Means over strips of a quarter of a metre across the overlap, which is from -0.5 to 0.5.
    let mean = |strip: i32| {
        let from = f64::from(strip) * 0.25;
        let ys: Vec<f64> = kept.0.iter().filter(|[x, _]| (from..from + 0.25).contains(x)).map(|[_, y]| *y).collect();
        assert!(ys.len() > 200, "strip {strip}: {}", ys.len());
        ys.iter().sum::<f64>() / ys.len() as f64
    };
    let means: Vec<f64> = (-6..6).map(mean).collect();
    let largest = means.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
    assert!(largest < SIGMA / 2.0, "{means:?}");
}
