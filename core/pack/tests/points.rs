//! Packs of points: what is coded comes back, and what is damaged is refused.

use glam::{DVec3, IVec3};
use kilwa_geometry::normal;
use kilwa_pack::chunk::splat::{self, MAX_RADIUS, MIN_RADIUS, Splats};
use kilwa_pack::chunk::{self, Declared};
use kilwa_pack::{Attributes, NO_DIAMOND, PatchRange};
use proptest::prelude::*;

const ALL: Attributes = Attributes { colors: true, scalars: 2 };

/// Sorted along Morton's curve, places that occur twice only once.
fn sorted(mut points: Vec<IVec3>) -> Vec<IVec3> {
    points.sort_unstable_by(|&a, &b| {
        if a == b {
            std::cmp::Ordering::Equal
        } else if splat::is_before(a, b) {
            std::cmp::Ordering::Less
        } else {
            std::cmp::Ordering::Greater
        }
    });
    points.dedup();
    points
}

/// Splats of `counts` points for each patch, at places that `place` gives.
fn splats(counts: &[usize], seed: u64, place: impl Fn(&mut fastrand::Rng) -> IVec3) -> (Splats, Vec<PatchRange>) {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut out = Splats { scalars: vec![Vec::new(); 2], ..Splats::default() };
    let mut patches = Vec::new();
    for &count in counts {
        let points = sorted((0..count).map(|_| place(&mut random)).collect());
        let count = 2 * points.len() as u32;
        patches.push(PatchRange { first: 2 * out.len() as u32, count, diamond: NO_DIAMOND });
        for p in points {
            out.positions.push(p);
            let n = DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() + 1.0);
            out.normals.push(normal::encode(n).map(|x| x & !0x1ff));
            out.radii.push(random.u8(MIN_RADIUS..30));
            out.colors.push([0; 3].map(|_| random.u8(90..130)));
            out.scalars[0].push(f32::from(random.u8(..)));
            out.scalars[1].push(-random.f32());
        }
    }
    (out, patches)
}

fn encoded(splats: &Splats, patches: &[PatchRange]) -> Vec<u8> {
    let body = splat::encode_body(splats, patches, ALL).expect("is sound");
    chunk::of_points_with_patches(patches, &body)
}

fn declared(splats: &Splats) -> Declared {
    Declared { vertices: 4 * splats.len() as u32, triangles: 2 * splats.len() as u32 }
}

fn anywhere(random: &mut fastrand::Rng) -> IVec3 {
    IVec3::from([0; 3].map(|_| random.i32(4096..(1 << 30) - 4096)))
}

/// A wall seen by a scanner: 20 steps between points, noise of 4.
fn on_a_wall(random: &mut fastrand::Rng) -> IVec3 {
    IVec3::new(random.i32(10_000..10_900), random.i32(5000..5008), random.i32(20_000..20_900))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn splats_come_back_as_they_were_coded(seed in any::<u64>(), counts in proptest::collection::vec(0usize..60, 1..6)) {
        let (splats, patches) = splats(&counts, seed, anywhere);
        let bytes = encoded(&splats, &patches);
        let chunk = chunk::decode(&bytes, declared(&splats), ALL).expect("decodes");
        prop_assert_eq!(&chunk.patches, &patches);
        prop_assert_eq!(&chunk.mesh, &splats.mesh());
        let back = Splats::of(&chunk.mesh).expect("are splats");
        prop_assert_eq!((back.mesh(), back.positions), (splats.mesh(), splats.positions));
    }

    #[test]
    fn the_order_is_that_of_interleaved_bits(a in prop::array::uniform3(0i32..1 << 30), b in prop::array::uniform3(0i32..1 << 30)) {
        let code = |p: [i32; 3]| (0..30).rev().fold(0u128, |code, bit| {
            p.iter().fold(code, |code, x| code << 1 | (x >> bit & 1) as u128)
        });
        prop_assert_eq!(splat::is_before(a.into(), b.into()), code(a) < code(b));
    }
}

#[test]
fn a_splat_is_a_square_that_faces_along_its_normal() {
    let mut random = fastrand::Rng::with_seed(7);
    for _ in 0..500 {
        let n = normal::encode(DVec3::new(random.f64() - 0.5, random.f64() - 0.5, random.f64() - 0.5));
        let code = random.u8(MIN_RADIUS..=60);
        let center = IVec3::splat(1 << 29);
        let square = splat::corners(center, n, code);
        let [a, b, c, d] = square.map(|p| (p - center).as_dvec3());
        let r = splat::radius(code);
        for p in [a, b, c, d] {
            assert!((p.length() - r).abs() < 1.0, "{p:?}, {r}");
        }
        let facing = (b - a).cross(c - a);
        assert!(
            facing.normalize().dot(normal::decode(n)) > 1.0 - 2.0 / r && (a + c, b + d) == (DVec3::ZERO, DVec3::ZERO)
        );
        assert_eq!(splat::center_of(square).0, center);
    }
}

#[test]
fn radii_grow_by_quarters_of_an_octave() {
    assert_eq!(splat::radius(MIN_RADIUS), 2.0);
    for code in MIN_RADIUS..MAX_RADIUS {
        let ratio = splat::radius(code + 1) / splat::radius(code);
        assert!((ratio - 2f64.powf(0.25)).abs() < 2e-4);
        assert_eq!(splat::code_of(splat::radius(code)), code);
        assert_eq!(splat::code_of(splat::radius(code) + 1e-6), code + 1);
    }
    assert_eq!((splat::code_of(0.0), splat::code_of(f64::INFINITY)), (MIN_RADIUS, MAX_RADIUS));
}

#[test]
fn a_point_of_a_scanned_wall_takes_less_than_eight_bytes() {
    let (mut splats, patches) = splats(&[2000], 3, on_a_wall);
    splats.radii.fill(12);
    splats.normals.fill([512, -512]);
    splats.scalars[1].fill(0.0);
    let bytes = encoded(&splats, &patches).len() as f64 / splats.len() as f64;
    assert!(bytes < 8.0, "{bytes}");
}

#[test]
fn damaged_chunks_are_refused_or_decode_to_something_sound() {
    let (splats, patches) = splats(&[40, 30], 11, on_a_wall);
    let bytes = encoded(&splats, &patches);
    for at in 0..bytes.len() * 8 {
        let mut bad = bytes.clone();
        bad[at / 8] ^= 1 << (at % 8);
        // `decode` checks what it returns.
        if let Ok(chunk) = chunk::decode(&bad, declared(&splats), ALL) {
            assert_eq!(chunk.mesh.triangle_count(), 2 * splats.len());
        }
    }
    for length in 0..bytes.len() {
        assert!(chunk::decode(&bytes[..length], declared(&splats), ALL).is_err(), "cut to {length} bytes");
    }
    let fewer = Declared { vertices: declared(&splats).vertices - 4, ..declared(&splats) };
    assert!(chunk::decode(&bytes, fewer, ALL).is_err());
}

#[test]
fn what_cannot_be_coded_is_refused() {
    let (splats, patches) = splats(&[40], 5, on_a_wall);
    let refused = |change: &dyn Fn(&mut Splats)| {
        let mut other = splats.clone();
        change(&mut other);
        splat::encode_body(&other, &patches, ALL).unwrap_err().to_string()
    };
    assert!(refused(&|s| s.positions.swap(3, 4)).contains("out of order"));
    assert!(refused(&|s| s.positions[3] = s.positions[2]).contains("same place"));
    assert!(refused(&|s| s.radii[0] = MIN_RADIUS - 1).contains("radius"));
    assert!(refused(&|s| s.colors.truncate(7)).contains("missing"));
    assert!(refused(&|s| s.scalars.truncate(1)).contains("missing"));
    let odd = [PatchRange { count: patches[0].count - 1, ..patches[0] }];
    assert!(splat::encode_body(&splats, &odd, ALL).is_err());
    let mut mesh = splats.mesh();
    mesh.positions[5].x += 1;
    assert!(Splats::of(&mesh).unwrap_err().to_string().contains("not splats"));
}

/// A surface whose header says that it is made of points, and the other way round: neither is shown.
#[test]
fn chunks_of_another_kind_than_the_header_states_are_refused() {
    let surface = crate::common::pack(2, 2, Attributes { colors: true, scalars: 0 });
    let reader = |bytes: Vec<u8>| kilwa_pack::Reader::open(kilwa_pack::SliceSource(bytes));
    assert!(!reader(surface.clone()).expect("opens").header().is_of_points());
    let mut forged = surface;
    forged[16] |= 2;
    let hash = *blake3::hash(&forged[..224]).as_bytes();
    forged[224..256].copy_from_slice(&hash);
    let footer = forged.len() - 64;
    forged[footer..footer + 32].copy_from_slice(&hash);
    let reader = reader(forged).expect("opens");
    assert!(reader.header().is_of_points());
    assert!(reader.chunk(0).unwrap_err().to_string().contains("does not announce its codec"));
}
