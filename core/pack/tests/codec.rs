//! The chunk codec gives back exactly what it was given, and refuses everything else without a panic.

use crate::common::height_field;
use glam::DVec3;
use kilwa_geometry::Mesh;
use kilwa_pack::chunk::{Declared, decode, encode, encode_first, patch_table};
use kilwa_pack::{Attributes, Chunk, NO_DIAMOND, PatchRange};
use proptest::prelude::*;

const COLORED: Attributes = Attributes { colors: true, scalars: 0 };

fn declared(chunk: &Chunk) -> Declared {
    Declared { vertices: chunk.mesh.vertex_count() as u32, triangles: chunk.mesh.triangle_count() as u32 }
}

/// A triangle soup with everything that a mesh may have: duplicates, degenerate triangles, unused vertices, any
/// normal, any float, empty patches.
fn soup(seed: u64, triangles: usize, wide: bool, attributes: Attributes) -> Chunk {
    let mut random = fastrand::Rng::with_seed(seed);
    let vertices = 1 + random.u64(..3 * triangles.max(1) as u64) as usize;
    let vertices = if triangles == 0 { 0 } else { vertices };
    let extent = if wide { 1 << 30 } else { 50 };
    let mut mesh = Mesh { scalars: vec![Vec::new(); usize::from(attributes.scalars)], ..Mesh::default() };
    for _ in 0..vertices {
        mesh.positions.push([(); 3].map(|()| random.u64(..extent) as i32).into());
        mesh.normals.push([(); 2].map(|()| random.i16(..)));
        if attributes.colors {
            mesh.colors.push([(); 3].map(|()| random.u8(..)));
        }
        for channel in &mut mesh.scalars {
            channel.push(f32::from_bits(random.u32(..)));
        }
    }
    let mut patches = Vec::new();
    let mut first = 0;
    for _ in 0..triangles {
        let again = !mesh.triangles.is_empty() && random.u64(..8) == 0;
        let triangle = if again {
            mesh.triangles[random.u64(..mesh.triangles.len() as u64) as usize]
        } else {
            [(); 3].map(|()| random.u64(..vertices as u64) as u32)
        };
        mesh.triangles.push(triangle);
        mesh.borders.push(if random.u64(..3) == 0 { random.u64(..8) as u8 } else { 0 });
        if random.u64(..6) == 0 {
            let end = mesh.triangles.len() as u32 - random.u64(..2) as u32;
            let end = end.max(first);
            let diamond = if random.u64(..2) == 0 { NO_DIAMOND } else { random.u64(..1 << 20) as u32 };
            patches.push(PatchRange { first, count: end - first, diamond });
            first = end;
        }
    }
    patches.push(PatchRange { first, count: triangles as u32 - first, diamond: NO_DIAMOND });
    Chunk { mesh, patches }
}

#[test]
fn a_height_field_round_trips_with_every_attribute_and_border() {
    for attributes in [COLORED, Attributes { colors: false, scalars: 2 }, Attributes { colors: false, scalars: 0 }] {
        let chunk = height_field(40, 5, 1, attributes);
        let bytes = encode(&chunk, attributes).expect("encodes");
        let back = decode(&bytes, declared(&chunk), attributes).expect("decodes");
        assert_eq!(back.canonical(), chunk.canonical());
        assert_eq!(patch_table(&bytes).expect("has a table"), chunk.patches);
    }
}

#[test]
fn a_chunk_without_triangles_is_possible() {
    let chunk = Chunk::default();
    let bytes = encode(&chunk, COLORED).expect("encodes");
    assert_eq!(decode(&bytes, declared(&chunk), COLORED).expect("decodes"), chunk);
}

#[test]
fn a_scanned_wall_takes_less_than_three_bytes_per_triangle() {
    let chunk = height_field(64, 8, 1, COLORED);
    let bytes = encode(&chunk, COLORED).expect("encodes");
    let density = bytes.len() as f64 / chunk.mesh.triangle_count() as f64;
    println!("{density:.3} bytes per triangle, colours and normals included");
    assert!(density < 3.0, "{density}");
}

#[test]
fn the_cache_order_never_crosses_patches() {
    let chunk = height_field(20, 4, 3, COLORED);
    let back = decode(&encode(&chunk, COLORED).expect("encodes"), declared(&chunk), COLORED).expect("decodes");
    assert_eq!(back.patches, chunk.patches);
    assert_eq!(back.canonical(), chunk.canonical(), "canonical forms are compared patch by patch");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_triangle_soup_round_trips(
        seed in any::<u64>(), triangles in 0usize..120, wide in any::<bool>(), colors in any::<bool>(), scalars in 0u8..4,
    ) {
        let attributes = Attributes { colors, scalars };
        let chunk = soup(seed, triangles, wide, attributes);
        let bytes = encode(&chunk, attributes).expect("encodes");
        prop_assert_eq!(&bytes, &encode(&chunk, attributes).expect("encodes"), "encoding is deterministic");
        let back = decode(&bytes, declared(&chunk), attributes).expect("decodes");
        prop_assert_eq!(back.canonical(), chunk.canonical());
        prop_assert_eq!(declared(&back), declared(&chunk));
    }

    #[test]
    fn any_triangle_soup_of_codec_1_is_still_read(
        seed in any::<u64>(), triangles in 0usize..120, wide in any::<bool>(), colors in any::<bool>(), scalars in 0u8..4,
    ) {
        let attributes = Attributes { colors, scalars };
        let chunk = soup(seed, triangles, wide, attributes);
        let bytes = encode_first(&chunk, attributes).expect("encodes");
        prop_assert_eq!(bytes[0], 1);
        prop_assert_eq!(encode(&chunk, attributes).expect("encodes")[0], 2);
        let back = decode(&bytes, declared(&chunk), attributes).expect("decodes");
        prop_assert_eq!(back.canonical(), chunk.canonical());
    }

    #[test]
    fn random_bytes_behind_a_codec_number_are_refused(
        mut bytes in proptest::collection::vec(any::<u8>(), 1..400), codec in 1u8..3, triangles in 1u32..100,
    ) {
        bytes[0] = codec;
        let declared = Declared { vertices: triangles, triangles };
        prop_assert!(decode(&bytes, declared, COLORED).is_err());
    }

    #[test]
    fn random_bytes_are_refused_as_a_chunk(bytes in proptest::collection::vec(any::<u8>(), 0..400), triangles in 1u32..100) {
        let declared = Declared { vertices: triangles, triangles };
        prop_assert!(decode(&bytes, declared, COLORED).is_err());
    }
}

/// Without the checksum, which would catch all of these: the decoder alone must withstand them.
#[test]
fn damaged_chunks_never_panic_and_never_break_a_promise() {
    let attributes = Attributes { colors: true, scalars: 1 };
    let mut refused = 0;
    for seed in 0..6 {
        let chunk = soup(seed, 40, false, attributes);
        let coded = if seed % 3 == 2 { encode_first(&chunk, attributes) } else { encode(&chunk, attributes) };
        let bytes = coded.expect("encodes");
        for bit in 0..bytes.len() * 8 {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            match decode(&damaged, declared(&chunk), attributes) {
                Err(_) => refused += 1,
                Ok(other) => {
                    assert_eq!(declared(&other), declared(&chunk));
                    let vertices = other.mesh.vertex_count() as u32;
                    assert!(other.mesh.triangles.as_flattened().iter().all(|&v| v < vertices));
                    assert_eq!(other.patches.iter().map(|p| p.count).sum::<u32>(), declared(&chunk).triangles);
                }
            }
        }
        for length in 0..bytes.len() {
            assert!(decode(&bytes[..length], declared(&chunk), attributes).is_err(), "cut at {length}");
        }
        let mut longer = bytes.clone();
        longer.push(0);
        assert!(decode(&longer, declared(&chunk), attributes).is_err());
    }
    assert!(refused > 1000, "{refused}");
}

#[test]
fn damage_in_several_places_never_panics() {
    let chunk = height_field(12, 3, 5, COLORED);
    let bytes = encode(&chunk, COLORED).expect("encodes");
    let mut random = fastrand::Rng::with_seed(11);
    for _ in 0..3000 {
        let mut damaged = bytes.clone();
        for _ in 0..=random.u64(..8) {
            let at = random.u64(..damaged.len() as u64) as usize;
            damaged[at] = random.u8(..);
        }
        let _ = decode(&damaged, declared(&chunk), COLORED);
    }
}

#[test]
fn other_counts_than_the_encoded_ones_are_refused() {
    let chunk = height_field(8, 2, 5, COLORED);
    let bytes = encode(&chunk, COLORED).expect("encodes");
    let right = declared(&chunk);
    for (vertices, triangles) in [
        (right.vertices - 1, right.triangles),
        (right.vertices + 1, right.triangles),
        (right.vertices, right.triangles - 1),
        (right.vertices, right.triangles + 1),
        (u32::MAX, right.triangles),
        (right.vertices, u32::MAX),
        (3 << 20, 1 << 20),
        (0, 0),
    ] {
        assert!(decode(&bytes, Declared { vertices, triangles }, COLORED).is_err(), "{vertices} {triangles}");
    }
    assert!(decode(&bytes, right, Attributes { colors: false, scalars: 0 }).is_err());
    assert!(decode(&bytes, right, Attributes { colors: true, scalars: 1 }).is_err());
    assert!(decode(&bytes, right, Attributes { colors: true, scalars: 200 }).is_err());
}

#[test]
fn contradictory_chunks_are_not_encoded() {
    let good = height_field(4, 1, 5, COLORED);
    let spoil = |f: &dyn Fn(&mut Chunk)| {
        let mut chunk = good.clone();
        f(&mut chunk);
        encode(&chunk, COLORED).expect_err("refused").to_string()
    };
    assert!(spoil(&|c| c.mesh.triangles[3] = [0, 1, 99]).contains("names a vertex"));
    assert!(spoil(&|c| c.mesh.positions[3][1] = -1).contains("lattice"));
    assert!(spoil(&|c| c.mesh.borders[0] = 8).contains("border"));
    assert!(spoil(&|c| c.mesh.colors.clear()).contains("attribute"));
    assert!(spoil(&|c| c.mesh.borders.truncate(3)).contains("attribute"));
    assert!(spoil(&|c| c.patches[0].count -= 1).contains("patches hold"));
    assert!(spoil(&|c| c.patches[0].first = 1).contains("begins at"));
}

/// A sphere of `n` by `2 n` quads, closed at its poles, in two patches: no border anywhere.
fn sphere(n: u32) -> Chunk {
    let mut mesh = Mesh::default();
    let columns = 2 * n;
    let mut add = |u: f64, v: f64| {
        let direction = DVec3::new(u.cos() * v.sin(), u.sin() * v.sin(), v.cos());
        mesh.positions.push((20_000.0 + 9_000.0 * direction).round().as_ivec3());
        mesh.normals.push(kilwa_geometry::normal::encode(direction));
    };
    add(0.0, 0.0);
    for i in 1..n {
        for j in 0..columns {
            add(f64::from(j) / f64::from(n) * std::f64::consts::PI, f64::from(i) / f64::from(n) * std::f64::consts::PI);
        }
    }
    add(0.0, std::f64::consts::PI);
    let last = mesh.positions.len() as u32 - 1;
    let at = |i: u32, j: u32| {
        if i == 0 {
            0
        } else if i == n {
            last
        } else {
            1 + (i - 1) * columns + j % columns
        }
    };
    for i in 0..n {
        for j in 0..columns {
            for triangle in [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]] {
                if triangle[0] != triangle[2] && triangle[1] != triangle[2] {
                    mesh.triangles.push(triangle);
                }
            }
        }
    }
    mesh.borders = vec![0; mesh.triangles.len()];
    let half = mesh.triangles.len() as u32 / 2;
    let rest = mesh.triangles.len() as u32 - half;
    let patches = vec![
        PatchRange { first: 0, count: half, diamond: NO_DIAMOND },
        PatchRange { first: half, count: rest, diamond: 9 },
    ];
    Chunk { mesh, patches }
}

#[test]
fn a_closed_surface_costs_few_bits_for_its_connectivity() {
    let plain = Attributes { colors: false, scalars: 0 };
    let chunk = sphere(40);
    let (bytes, parts) = kilwa_pack::chunk::encode_parts(&chunk, plain).expect("encodes");
    assert_eq!(bytes, encode(&chunk, plain).expect("encodes"));
    let whole = parts.connectivity + parts.borders + parts.positions + parts.normals + parts.other;
    assert!(bytes.len().abs_diff(whole) <= 2 && parts.colors == 0 && parts.scalars == 0, "{parts:?}");
    let bits = parts.connectivity as f64 * 8.0 / chunk.mesh.triangle_count() as f64;
    assert!(bits < 0.5, "{bits} bits per triangle of a regular mesh in two patches");
    assert!(parts.borders <= 2, "{parts:?}");
    let back = decode(&bytes, declared(&chunk), plain).expect("decodes");
    assert_eq!(back.canonical(), chunk.canonical());
}

/// Coarse forms may be rounded to multiples of a power of two: then the zeros must not be paid for, and vertices that
/// are not rounded must round-trip as well.
#[test]
fn rounded_values_take_fewer_bytes_and_round_trip() {
    let fine = height_field(40, 3, 7, COLORED);
    let mut mixed = fine.clone();
    let mesh = &mut mixed.mesh;
    for v in (0..mesh.positions.len()).filter(|v| v % 41 > 4) {
        mesh.positions[v] &= !15;
        mesh.colors[v] = mesh.colors[v].map(|x| x & !3);
    }
    let [whole, rounded] = [&fine, &mixed].map(|c| kilwa_pack::chunk::encode_parts(c, COLORED).expect("encodes"));
    let back = decode(&rounded.0, declared(&mixed), COLORED).expect("decodes");
    assert_eq!(back.canonical(), mixed.canonical());
    let vertices = fine.mesh.vertex_count() as f64;
    let saved = |a: usize, b: usize| (a as f64 - b as f64) * 8.0 / vertices;
    // Nine in ten vertices lose 3 x 4 bits of position and 3 x 2 of colour.
    let (position, color) = (saved(whole.1.positions, rounded.1.positions), saved(whole.1.colors, rounded.1.colors));
    assert!(position > 9.0 && color > 4.0, "{position} and {color} bits per vertex");
}

/// Chunks of codec 1, as format 1.0 has them, hold the same geometry in codec 2.
#[test]
fn a_pack_of_version_1_0_is_read_and_its_chunks_come_back_from_codec_2() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/compat/1.0-wall.kilwa");
    let reader =
        kilwa_pack::Reader::open(kilwa_pack::SliceSource(std::fs::read(path).expect("is there"))).expect("opens");
    let attributes = reader.header().attributes;
    let (mut before, mut after) = (0, 0);
    for (i, entry) in (0..).zip(reader.entries()) {
        let chunk = reader.chunk(i).expect("decodes");
        let bytes = encode(&chunk, attributes).expect("encodes");
        let back = decode(&bytes, declared(&chunk), attributes).expect("decodes");
        assert_eq!(back.canonical(), chunk.canonical());
        before += entry.encoded_bytes as usize;
        after += bytes.len();
    }
    assert!(after < before, "{after} bytes, {before} in codec 1");
}

#[test]
fn a_hundred_thousand_flipped_bits_and_ten_thousand_cuts_never_panic() {
    let attributes = Attributes { colors: true, scalars: 1 };
    let chunk = height_field(48, 5, 3, attributes);
    let bytes = encode(&chunk, attributes).expect("encodes");
    let mut random = fastrand::Rng::with_seed(5);
    // Each trial takes the time of decoding: a smaller chunk for most of them.
    let small = height_field(4, 2, 3, attributes);
    let small_bytes = encode(&small, attributes).expect("encodes");
    for _ in 0..2_000 {
        let bit = random.u64(..bytes.len() as u64 * 8) as usize;
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        if let Ok(other) = decode(&damaged, declared(&chunk), attributes) {
            assert_eq!(declared(&other), declared(&chunk));
        }
        let length = random.u64(..bytes.len() as u64) as usize;
        assert!(decode(&bytes[..length], declared(&chunk), attributes).is_err(), "cut at {length}");
    }
    let mut harmless = 0;
    for _ in 0..98_000 {
        let bit = random.u64(..small_bytes.len() as u64 * 8) as usize;
        let mut damaged = small_bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        harmless += u32::from(decode(&damaged, declared(&small), attributes).is_ok());
    }
    for _ in 0..8_000 {
        let length = random.u64(..small_bytes.len() as u64) as usize;
        assert!(decode(&small_bytes[..length], declared(&small), attributes).is_err(), "cut at {length}");
    }
    // Raw bits can have any value; only the checksum of the chunk protects them.
    println!("{harmless} of 98,000 decode to something");
}
