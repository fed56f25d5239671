//! Thousands of damaged files: for any bytes the reader ends, does not panic, and returns a valid mesh or an error.
//! Seeded, so that a failure can be repeated; `tests/fuzz` goes further.

use crate::read::read_mesh_from;
use fastrand::Rng;
use std::io::Cursor;
use std::path::Path;

const SEEDS: [&str; 3] = [
    "# a\no w\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1 1 0 0 0 1\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nusemtl a\nf 1/1/1 2/2/1 3/1/1\nf -4//1 -2//1 -1//1\nf 1 2 3 4\nl 1 2\n",
    "v 0 0 0\r\nv 2 1 0 1.0\r\nv 4 0 0\r\nv 2 4 0\r\nf 1 2 \\\r\n3 4\r\nf 1/1 2/1 3/1\r\ncurv 0 1 2\r\ns off\r\n",
    "g a\nv 1e3 -2.5e-3 .5\nv 5 5 5\nv 5 6 5\nv nan 0 0\nv 7 7 7\nf 1 2 3 4 5\nf 1 2 3\nf 3 5 2\nmtllib none.mtl\n",
];

const WORDS: [&str; 20] = [
    "v",
    "vt",
    "vn",
    "f",
    "1",
    "-1",
    "0",
    "99999999999",
    "1/2/3",
    "//",
    "1e308",
    "nan",
    "usemtl",
    "\\\n",
    "#",
    "\r",
    "l",
    "\n",
    "-9223372036854775808",
    "\0",
];

fn mutate(bytes: &mut Vec<u8>, random: &mut Rng) {
    for _ in 0..=random.usize(..3) {
        let at = random.usize(..bytes.len().max(1));
        match random.usize(..5) {
            0 => bytes.truncate(at),
            1 => bytes[at] ^= 1 << random.usize(..8),
            2 => {
                let end = (at + random.usize(..40)).min(bytes.len());
                let copy = bytes[at..end].to_vec();
                let to = random.usize(..bytes.len().max(1));
                bytes.splice(to..to, copy);
            }
            _ => {
                let end = bytes[at..].iter().position(u8::is_ascii_whitespace).map_or(bytes.len(), |n| at + n);
                let start = bytes[..at].iter().rposition(u8::is_ascii_whitespace).map_or(0, |n| n + 1);
                bytes.splice(start..end.max(start), WORDS[random.usize(..WORDS.len())].bytes());
            }
        }
        if bytes.is_empty() {
            return;
        }
    }
}

#[test]
fn ten_thousand_damaged_files_cause_no_panic() {
    let mut random = Rng::with_seed(5);
    let (mut read, mut refused) = (0, 0);
    for i in 0..10_000 {
        let mut bytes = SEEDS[i % SEEDS.len()].as_bytes().to_vec();
        if i >= SEEDS.len() {
            mutate(&mut bytes, &mut random);
        }
        let total = bytes.len() as u64;
        let Ok(mesh) = read_mesh_from(Cursor::new(&bytes), total, Path::new("fuzz.obj"), &mut |_, _| {}) else {
            assert!(i >= SEEDS.len(), "seed {i} is sound");
            refused += 1;
            continue;
        };
        read += 1;
        let n = mesh.positions.len();
        assert!(mesh.positions.iter().all(|p| p.is_finite()));
        assert!(mesh.triangles.iter().flatten().all(|&v| (v as usize) < n));
        assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
        assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
        assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
        assert!(n + mesh.triangles.len() <= bytes.len(), "no more than the file justifies");
    }
    assert!(read > 1000 && refused > 1000, "{read} read, {refused} refused");
}
