//! How many triangles patches and chunks have, and how many could not be simplified: the report of the build and `kilwa info`
//! agree with each other and with the pack.

use crate::support::{json, succeeds, text};
use kilwa_pack::{NO_DIAMOND, Reader};

/// Smallest, 5 %, median, 95 %, largest, by counting.
fn spread(mut all: Vec<u64>) -> serde_json::Value {
    all.sort_unstable();
    let at = |percent: usize| all[(all.len() - 1) * percent / 100];
    serde_json::json!({
        "count": all.len(), "smallest": at(0), "percent_5": at(5), "median": at(50), "percent_95": at(95), "largest": at(100)
    })
}

#[test]
fn build_and_info_report_patch_and_chunk_sizes_and_what_could_not_be_simplified() {
    let folder = tempfile::tempdir().unwrap();
    let (ply, pack) = (folder.path().join("fort.ply"), folder.path().join("fort.kilwa"));
    succeeds(&["synth", "fort", "--triangles", "60000", "-o", text(&ply)]);
    let built = json(&["build", text(&ply), "-o", text(&pack)]);
    let info = json(&["info", text(&pack)]);

    let reader = Reader::open(kilwa_pack::reader::SliceSource(std::fs::read(&pack).unwrap())).unwrap();
    let chunks: Vec<_> = (0..reader.header().entry_count).map(|i| reader.chunk(i).unwrap()).collect();
    let patches: Vec<_> = chunks.iter().flat_map(|c| c.patches.clone()).collect();
    let per_patch = spread(patches.iter().map(|p| u64::from(p.count)).collect());
    let per_chunk = spread(chunks.iter().map(|c| c.mesh.triangle_count() as u64).collect());
    let (mut places, mut triangles) = (0, 0);
    for (i, chunk) in chunks.iter().enumerate().skip(1) {
        let of = patches.iter().filter(|p| p.diamond != NO_DIAMOND && p.diamond as usize == i);
        let coarse: u64 = of.map(|p| u64::from(p.count)).sum();
        if coarse * 10 > chunk.mesh.triangle_count() as u64 * 9 {
            places += 1;
            triangles += coarse;
        }
    }
    for (says, of) in [(&built["pack"], "build"), (&info, "info")] {
        assert_eq!(says["patch_triangles"], per_patch, "{of}");
        assert_eq!(says["chunk_triangles"], per_chunk, "{of}");
    }
    for (says, of) in [(&built, "build"), (&info, "info")] {
        assert_eq!(says["stuck_diamonds"], places, "{of}");
        assert_eq!(says["stuck_triangles"], triangles, "{of}");
    }
    // Leaves hold 2,048 at most; what is coarser may be a little more, never many times as much.
    assert!(per_patch["largest"].as_u64().unwrap() <= 4096, "{per_patch}");

    let number = |v: &serde_json::Value| v.as_u64().unwrap().to_string();
    let words = succeeds(&["info", text(&pack)]);
    for (line, of) in [("patches", &per_patch), ("chunks", &per_chunk)] {
        let line =
            words.lines().find(|l| l.starts_with(line) && l.contains("median")).unwrap_or_else(|| panic!("{words}"));
        for value in ["count", "smallest", "percent_5", "median", "percent_95", "largest"] {
            assert!(line.contains(&number(&of[value])), "{value} in {line}");
        }
    }
}

#[test]
fn a_pack_whose_tables_contradict_its_directory_is_not_described() {
    let folder = tempfile::tempdir().unwrap();
    let (ply, pack) = (folder.path().join("a.ply"), folder.path().join("a.kilwa"));
    crate::support::Input::torus(64, 32, [0.0; 3]).write(&ply);
    succeeds(&["build", text(&ply), "-o", text(&pack)]);
    let mut bytes = std::fs::read(&pack).unwrap();
    let reader = Reader::open(kilwa_pack::reader::SliceSource(bytes.clone())).unwrap();
    // Codec and number of patches, then the first count.
    let at = reader.entries()[0].offset as usize + 2;
    bytes[at] ^= 1;
    std::fs::write(&pack, bytes).unwrap();
    let message = crate::support::fails(&["info", text(&pack)]);
    assert!(message.contains("chunk 0") && message.contains("kilwa verify"), "{message}");
}
