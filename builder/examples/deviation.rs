//! How far a coarse form of a mesh is from the fine one, measured without anything of the certifier:
//! `deviation FINE.ply COARSE.ply` prints one line with triangles of the coarse form, root mean square and largest distance
//! from the vertices of the fine mesh to the coarse surface, largest distance from the vertices of the coarse mesh to the
//! fine surface (all in metres), and the root mean square colour difference (of 255, over three channels) between the fine
//! vertices and the coarse surface at its nearest point, its colours interpolated linearly.

use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_formats::read;
use kilwa_geometry::bvh::Bvh;
use kilwa_geometry::distance::closest_on_triangle;
use rayon::prelude::*;

struct Surface {
    mesh: RawMesh,
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
}

impl Surface {
    fn read(path: &str) -> Result<Self, read::ReadError> {
        let mesh = read::read_mesh(path.as_ref(), &mut |_, _| {})?;
        let triangles: Vec<[DVec3; 3]> = mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect();
        Ok(Self { tree: Bvh::new(&triangles), triangles, mesh })
    }

    /// The nearest triangle, the nearest point on it and its squared distance.
    fn nearest(&self, p: DVec3) -> (usize, DVec3, f64) {
        let mut best = (0, DVec3::ZERO, f64::INFINITY);
        self.tree.search(
            f64::INFINITY,
            |b| Some(b.distance_squared(p)),
            |t, limit| {
                let q = closest_on_triangle(p, self.triangles[t as usize]);
                let d = p.distance_squared(q);
                if d < limit {
                    best = (t as usize, q, d);
                }
                best.2
            },
        );
        best
    }

    /// The colour at a point of a triangle.
    fn color(&self, t: usize, q: DVec3) -> Option<[f64; 3]> {
        let [a, b, c] = self.triangles[t];
        let area = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).length();
        let w = [area(q, b, c), area(a, q, c), area(a, b, q)];
        let sum = (w[0] + w[1] + w[2]).max(f64::MIN_POSITIVE);
        let mut out = [0.0; 3];
        for (k, v) in self.mesh.triangles[t].iter().enumerate() {
            let color = self.mesh.colors.get(*v as usize)?;
            for i in 0..3 {
                out[i] += f64::from(color[i]) * w[k] / sum;
            }
        }
        Some(out)
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    let [fine, coarse] = files.as_slice() else { return Err("give FINE.ply COARSE.ply".into()) };
    let (fine, coarse) = (Surface::read(fine)?, Surface::read(coarse)?);
    let n = fine.mesh.positions.len();
    let (squares, largest, colors) = (0..n)
        .into_par_iter()
        .map(|v| {
            let (t, q, d) = coarse.nearest(fine.mesh.positions[v]);
            let color = fine
                .mesh
                .colors
                .get(v)
                .zip(coarse.color(t, q))
                .map_or(0.0, |(a, b)| (0..3).map(|i| (f64::from(a[i]) - b[i]).powi(2)).sum::<f64>() / 3.0);
            (d, d, color)
        })
        .reduce(|| (0.0, 0.0, 0.0), |a, b| (a.0 + b.0, f64::max(a.1, b.1), a.2 + b.2));
    let back = coarse.mesh.positions.par_iter().map(|p| fine.nearest(*p).2).reduce(|| 0.0, f64::max);
    println!(
        "{} {} {} {} {}",
        coarse.triangles.len(),
        (squares / n as f64).sqrt(),
        largest.sqrt(),
        back.sqrt(),
        (colors / n as f64).sqrt()
    );
    Ok(())
}
