//! What a viewer needs of a pack to show it at a given error, for curves of error against bytes:
//! `cuts PACK.kilwa METRES... [--mesh NAME.ply]` prints a line for each error, of the coarsest cut that is certified to it:
//! the error asked for, the certified error of the cut (both in metres), bytes, requests, chunks, triangles.
//!
//! Bytes are everything before the first chunk (header, metadata), the whole directory, and the chunks of all refined
//! diamonds: those of the triangles shown and of all their ancestors, which a viewer loads on the way. Requests are one for the
//! first bytes of the file ([`HEAD_BYTES`]), one for the other pages of the directory where there are any, and one for each stretch
//! of neighbouring chunks beyond. With `--mesh` the cut for the last error is written: what a viewer draws, nothing simplified.

use kilwa_formats::extract::{Format, Output, Request, WINDOW, extract};
use kilwa_pack::cut::Cut;
use kilwa_pack::header::HEAD_BYTES;
use kilwa_pack::{HEADER_BYTES, PAGE_BYTES, Reader, SliceSource};
use std::error::Error;
use std::io::Write;

type Pack = Reader<SliceSource<Vec<u8>>>;

/// Bytes, requests, chunks and triangles of a cut.
fn cost(pack: &Pack, cut: &Cut) -> Result<(u64, usize, usize, u64), Box<dyn Error>> {
    let (header, entries) = (pack.header(), pack.entries());
    let pages = u64::from(header.page_count());
    let mut bytes = HEADER_BYTES as u64 + u64::from(header.metadata.1) + pages * PAGE_BYTES as u64;
    let mut requests = if pages > 1 { 2 } else { 1 };
    let (mut chunks, mut triangles) = (0, 0);
    let mut end = 0;
    let mut stretches: Vec<(u64, u64)> = Vec::new();
    for i in cut.refined() {
        let entry = entries.get(i as usize).ok_or("no such entry")?;
        bytes += u64::from(entry.encoded_bytes);
        chunks += 1;
        stretches.push((entry.offset, entry.offset + u64::from(entry.encoded_bytes)));
        let chunk = pack.chunk(i)?;
        triangles += cut.drawn(&chunk.patches).map(|patch| u64::from(patch.count)).sum::<u64>();
    }
    stretches.sort_unstable();
    for (from, to) in stretches {
        // A chunk that begins inside the first request and ends behind it needs another one.
        if to > HEAD_BYTES && (from > end || end <= HEAD_BYTES) {
            requests += 1;
        }
        end = end.max(to);
    }
    Ok((bytes, requests, chunks, triangles))
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mesh = match arguments.iter().position(|a| a == "--mesh") {
        Some(at) => {
            arguments.remove(at);
            Some(arguments.get(at).cloned().ok_or("--mesh needs a name")?).inspect(|_| drop(arguments.remove(at)))
        }
        None => None,
    };
    let (pack, errors) = arguments.split_first().ok_or("give PACK.kilwa METRES... [--mesh NAME.ply]")?;
    let pack = Reader::open(SliceSource(std::fs::read(pack)?))?;
    let errors: Vec<f64> = errors.iter().map(|e| e.parse()).collect::<Result<_, _>>()?;
    let mut out = std::io::stdout().lock();
    for error in &errors {
        let cut = Cut::for_error(pack.entries(), *error);
        let (bytes, requests, chunks, triangles) = cost(&pack, &cut)?;
        writeln!(out, "{error} {} {bytes} {requests} {chunks} {triangles}", cut.error(pack.entries()))?;
    }
    if let (Some(name), Some(error)) = (mesh, errors.last()) {
        let request = Request {
            format: Format::Ply { ascii: false },
            max_error: Some(*error),
            max_triangles: None,
            region: None,
            window: WINDOW,
        };
        extract(&pack, &request, &Output::prepare(name.as_ref(), true)?, &|_, _| ())?;
    }
    Ok(())
}
