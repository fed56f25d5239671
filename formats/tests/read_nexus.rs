//! A real Nexus file, where `../shared/data` is present: compared with what Corto's own JavaScript decoder gives for it.

use crate::shared_data::{check_invariants, data};
use kilwa_formats::read::read_mesh;

#[test]
fn a_real_compressed_model_is_read_as_the_decoder_of_its_makers_reads_it() {
    let Some(folder) = data() else { return };
    let path = folder.join("cnr-isti-vclab+nexus/html/models/gargo.nxz");
    if !path.is_file() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let mesh = read_mesh(&path, &mut |_, _| {}).unwrap();
    check_invariants(&mesh, "gargo.nxz");
    if let Ok(oracle) = std::env::var("KILWA_NXS_ORACLE") {
        let b = std::fs::read(oracle).unwrap();
        let u = |at: usize| u32::from_le_bytes(b[at..at + 4].try_into().unwrap());
        let f = |at: usize| f32::from_bits(u(at));
        // position -> (color, normal) list
        let mut all = std::collections::HashMap::<[u32; 3], Vec<([u8; 3], [f32; 3])>>::new();
        let mut tris = Vec::new();
        let mut at = 0;
        while at < b.len() {
            let (nv, nf) = (u(at) as usize, u(at + 4) as usize);
            at += 8;
            let (p, c, n, t) = (at, at + 12 * nv, at + 15 * nv, at + 27 * nv);
            let pos = |v: usize| [0, 1, 2].map(|k| u(p + 12 * v + 4 * k));
            for v in 0..nv {
                let col = [0, 1, 2].map(|k| b[c + 3 * v + k]);
                let nor = [0, 1, 2].map(|k| f(n + 12 * v + 4 * k));
                all.entry(pos(v)).or_default().push((col, nor));
            }
            for i in 0..nf {
                tris.push([0, 1, 2].map(|k| pos(u(t + 12 * i + 4 * k) as usize)));
            }
            at = t + 12 * nf;
        }
        let key = |v: u32| mesh.positions[v as usize].to_array().map(|x| (x as f32).to_bits());
        let mut mine: Vec<_> = mesh.triangles.iter().map(|t| t.map(key)).collect();
        mine.sort_unstable();
        tris.sort_unstable();
        println!("oracle {} mine {} equal {}", tris.len(), mine.len(), mine == tris);
        let (mut worst_c, mut worst_n, mut other) = (0i32, 0f32, 0);
        for v in 0..mesh.positions.len() as u32 {
            let Some(list) = all.get(&key(v)) else {
                other += 1;
                continue;
            };
            let c = mesh.colors[v as usize];
            let n = mesh.normals[v as usize];
            let dc = list
                .iter()
                .map(|(o, _)| (0..3).map(|k| (i32::from(o[k]) - i32::from(c[k])).abs()).max().unwrap())
                .min()
                .unwrap();
            let dn = list
                .iter()
                .map(|(_, o)| (glam::Vec3::from_array(*o).dot(n)).clamp(-1.0, 1.0).acos().to_degrees())
                .fold(f32::MAX, f32::min);
            worst_c = worst_c.max(dc);
            if dn > worst_n {
                worst_n = dn;
                println!("normal {v}: {dn} {n} {:?}", list);
            }
        }
        println!(
            "vertices {} positions not in oracle {other}, colour {worst_c}, normal {worst_n} degrees",
            mesh.positions.len()
        );
    }
}
