//! Properties of every cut.

use kilwa_geometry::{Aabb, Sphere};
use kilwa_pack::cut::{Cut, coarse_triangles};
use kilwa_pack::{Attributes, DirectoryEntry, NO_DIAMOND, PatchRange, Reader, SliceSource};

/// A random directory with up to four parents per entry and saturated errors.
fn directory(count: u32, seed: u64) -> (Vec<DirectoryEntry>, Vec<u64>) {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut entries: Vec<DirectoryEntry> = Vec::new();
    let mut coarse = Vec::new();
    for i in 0..count {
        let mut parents = [NO_DIAMOND; 4];
        let mut error = f32::INFINITY;
        if i > 0 {
            let wanted = 1 + random.u64(..4);
            let low = i / 4;
            let mut chosen: Vec<u32> = (0..wanted).map(|_| low + random.u64(..u64::from(i - low)) as u32).collect();
            chosen.sort_unstable();
            chosen.dedup();
            for (slot, p) in parents.iter_mut().zip(&chosen) {
                *slot = *p;
            }
            let above = chosen.iter().map(|&p| entries[p as usize].error).fold(f32::INFINITY, f32::min).min(10.0);
            error = above * (0.5 + random.u64(..1000) as f32 / 2000.0);
        }
        let triangles = 100 + random.u64(..200) as u32;
        coarse.push(u64::from(triangles) / 2);
        entries.push(DirectoryEntry {
            offset: 0,
            encoded_bytes: 1,
            vertices: 3,
            triangles,
            level: 0,
            error,
            color_error: 0.0,
            sphere: Sphere::EMPTY,
            bounds: Aabb::EMPTY,
            parents,
            checksum: [0; 16],
            children: None,
        });
    }
    (entries, coarse)
}

fn triangles(cut: &Cut, entries: &[DirectoryEntry], coarse: &[u64]) -> u64 {
    cut.refined().map(|i| u64::from(entries[i as usize].triangles) - if i == 0 { 0 } else { coarse[i as usize] }).sum()
}

#[test]
fn every_constructor_gives_a_valid_cut() {
    for seed in 0..50 {
        let (entries, coarse) = directory(200, seed);
        for cut in [
            Cut::coarsest(&entries),
            Cut::finest(&entries),
            Cut::for_error(&entries, 0.3),
            Cut::for_error(&entries, f64::NAN),
            Cut::for_triangles(&entries, &coarse, 5000),
            Cut::random(&entries, seed, 50),
        ] {
            assert!(cut.is_valid(&entries), "seed {seed}: {cut:?}");
        }
        assert_eq!(Cut::random(&entries, seed, 50), Cut::random(&entries, seed, 50));
        assert_eq!(Cut::random(&entries, seed, 50).refined().count(), 50);
        assert_ne!(Cut::random(&entries, seed, 50), Cut::random(&entries, seed + 1, 50));
    }
}

#[test]
fn the_error_limit_of_a_cut_holds() {
    let (entries, _) = directory(300, 9);
    let mut last = usize::MAX;
    for limit in [0.0, 0.01, 0.1, 0.5, 2.0] {
        let cut = Cut::for_error(&entries, limit);
        assert!(f64::from(cut.error(&entries)) <= limit);
        assert!(cut.refined().count() <= last, "a larger limit refines no more");
        last = cut.refined().count();
    }
    assert_eq!(Cut::finest(&entries).error(&entries), 0.0);
}

#[test]
fn the_triangle_limit_of_a_cut_holds_and_is_nearly_reached() {
    for seed in 0..50 {
        let (entries, coarse) = directory(400, seed);
        let all = triangles(&Cut::finest(&entries), &entries, &coarse);
        for limit in [1000, 5000, all / 2, all, all * 2] {
            let cut = Cut::for_triangles(&entries, &coarse, limit);
            let drawn = triangles(&cut, &entries, &coarse);
            assert!(drawn <= limit);
            assert!(drawn * 100 >= limit.min(all) * 67, "{drawn} of {limit}");
        }
    }
}

#[test]
fn a_limit_below_the_coarsest_cut_gives_the_coarsest_cut() {
    let (entries, coarse) = directory(100, 3);
    let cut = Cut::for_triangles(&entries, &coarse, 1);
    assert_eq!(cut, Cut::coarsest(&entries));
}

/// Patches in the chunks of the parents that represent each entry.
fn tables(entries: &[DirectoryEntry], coarse: &[u64]) -> Vec<Vec<PatchRange>> {
    let mut tables = vec![Vec::new(); entries.len()];
    for (i, entry) in (0u32..).zip(entries).skip(1) {
        let parents: Vec<u32> = entry.parents().collect();
        let all = coarse[i as usize] as u32;
        for (k, parent) in (0u32..).zip(&parents) {
            let n = parents.len() as u32;
            let count = all / n + u32::from(k < all % n);
            tables[*parent as usize].push(PatchRange { first: 0, count, diamond: i });
        }
    }
    tables
}

#[test]
fn a_cut_is_found_by_reading_only_the_chunks_that_it_refines() {
    for seed in 0..50 {
        let (entries, coarse) = directory(400, seed);
        let tables = tables(&entries, &coarse);
        for limit in [1, 1000, 5000, 20_000, u64::MAX] {
            let mut read = Vec::new();
            let cut = Cut::for_triangles_read(&entries, limit, |i| {
                read.push(i);
                Ok::<_, ()>(tables[i as usize].clone())
            });
            let cut = cut.unwrap();
            assert_eq!(cut, Cut::for_triangles(&entries, &coarse, limit), "seed {seed}, limit {limit}");
            read.sort_unstable();
            assert_eq!(read, cut.refined().collect::<Vec<_>>(), "each once");
        }
    }
    let (entries, _) = directory(100, 1);
    assert_eq!(Cut::for_triangles_read(&entries, 9999, |_| Err("away")), Err("away"));
}

#[test]
fn a_set_of_nodes_without_a_parent_is_no_cut() {
    let (entries, _) = directory(100, 4);
    let child = 99;
    assert!(Cut::from_refined(&entries, [0, child]).is_none_or(|_| entries[99].parents == [0, !0, !0, !0]));
    assert!(Cut::from_refined(&entries, []).is_none(), "the root entry is always refined");
    assert!(Cut::from_refined(&entries, [0, 100]).is_none(), "no such entry");
}

/// In a tree whose chunks hold the refinements of their diamonds' coarse forms, every cut covers each place once.
#[test]
fn coarse_triangles_are_summed_from_the_patch_tables() {
    let reader =
        Reader::open(SliceSource(crate::common::pack(20, 4, Attributes { colors: false, scalars: 0 }))).expect("opens");
    let patches: Vec<_> = (0..20).flat_map(|i| reader.chunk(i).expect("decodes").patches).collect();
    let coarse = coarse_triangles(20, &patches);
    assert_eq!(coarse[0], 0, "nothing names the root");
    assert_eq!(coarse[1], 32, "both patches of the root chunk belong to entry 1");
    assert!(coarse[2..].iter().all(|&c| c == 16));
}
