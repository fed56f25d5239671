//! Streaming of real packs over simulated links.

use crate::support::{built_once, succeeds, text};
use kilwa_pack::SliceSource;
use kilwa_stream::sim::{Decoders, Link, PackStore, Simulator};
use kilwa_stream::{Budgets, Stats};
use kilwa_viewer::{Bounds, Camera, StandardView};
use std::path::Path;

/// What the first view cost by the time its target was reached.
struct FirstView {
    first_picture_ms: f64,
    /// Bytes beside the head that had come by then.
    bytes_at_first_picture: u64,
    stats: Stats,
    head_bytes: u64,
    link_bytes: u64,
    /// Encoded bytes of all chunks that were loaded.
    chunk_bytes: u64,
}

fn first_view(pack: &Path, link: Link) -> FirstView {
    let store = PackStore::open(SliceSource(std::fs::read(pack).unwrap())).unwrap();
    let metadata = store.reader().metadata();
    let bounds = Bounds { min: metadata.bounds_min, max: metadata.bounds_max };
    let size = [1280, 720];
    let view =
        Camera::standard(StandardView::Iso, &bounds, size).view(&store.head().header.lattice, &bounds, size, 1.0);
    let (streamer, head_bytes) = (store.streamer(Budgets::default()), store.head_bytes());
    let mut sim = Simulator::new(streamer, head_bytes, store, link, Decoders::default());
    let (mut first, mut now) = (None, sim.start_ms());
    loop {
        let step = sim.step(now, &view);
        if first.is_none() && step.stats.triangles_drawn > 0 {
            first = Some((now, sim.totals().bytes));
        }
        if step.stats.target_reached {
            let entries = sim.store().reader().entries();
            let loaded = (0..entries.len() as u32).filter(|&c| sim.streamer().patches(c).is_some());
            let (first_picture_ms, bytes_at_first_picture) = first.unwrap();
            return FirstView {
                first_picture_ms,
                bytes_at_first_picture,
                stats: step.stats,
                head_bytes,
                link_bytes: sim.totals().bytes + head_bytes,
                chunk_bytes: loaded.map(|c| u64::from(entries[c as usize].encoded_bytes)).sum(),
            };
        }
        now += 16.0;
        assert!(now < 300_000.0, "the target was not reached: {:?}", step.stats);
    }
}

fn fort(folder: &Path) -> std::path::PathBuf {
    let write = |input: &Path| {
        succeeds(&["synth", "fort", "--triangles", "200k", "-o", text(input), "--force"]);
    };
    built_once(folder, "fort", write, &[])
}

#[test]
fn the_first_view_transfers_at_most_a_third_more_than_the_chunks_it_shows() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("streaming");
    for link in [Link::FAST, Link::COMMON, Link::SLOW, Link::SLOW.failing(5)] {
        let view = first_view(&fort(&folder), link);
        let ratio = view.chunk_bytes as f64 / view.stats.bytes_shown as f64;
        let all = view.link_bytes as f64 / view.stats.bytes_shown as f64;
        println!(
            "{:.0} Mbit/s: chunks loaded / shown {ratio:.3}; all bytes / shown {all:.3}; {} requests; first {:.0} ms {}",
            link.bits_per_second / 1e6,
            view.stats.requests_made,
            view.first_picture_ms,
            view.bytes_at_first_picture
        );
        assert!(view.head_bytes <= 131_072);
        assert!(ratio <= 1.3 && all <= 1.3, "{ratio:.3} and {all:.3}");
        // The first picture needs nothing but the head; on a fast link more may have come before it is drawn.
        assert!(view.bytes_at_first_picture == 0 || link.bits_per_second > 1e8);
    }
}
