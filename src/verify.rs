//! `kilwa verify`: read every byte of a pack and check every promise that it makes.

use crate::source::FileSource;
use indicatif::{ProgressBar, ProgressStyle};
use kilwa_pack::verify::Totals;
use kilwa_pack::{PackError, Reader};
use rayon::prelude::*;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};

/// Check every byte of a pack: checksums, every chunk decoded, every count, bound and error.
///
/// Exits with 1 and names the damaged part when something is wrong.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The pack to check.
    pack: PathBuf,
    /// Report as JSON.
    #[arg(long)]
    json: bool,
}

/// Chunks decoded at a time: bounds memory, and keeps all threads busy.
const BATCH: usize = 64;
/// Damaged parts named before the rest is only counted.
const NAMED: usize = 10;

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let (checked, damaged) = check(&args.pack)?;
    let mut out = std::io::stdout();
    let mut said = Ok(());
    if args.json {
        said = writeln!(out, "{}", serde_json::to_string_pretty(&report(&args.pack, checked.as_ref(), &damaged))?);
    }
    if damaged.is_empty() {
        if let Some(Checked { totals, bytes }) = checked.filter(|_| !args.json) {
            said = writeln!(
                out,
                "{}: sound. {bytes} bytes, {} chunks, {} triangles ({} stored) checked.",
                args.pack.display(),
                totals.chunks,
                totals.finest_triangles,
                totals.stored_triangles
            );
        }
        return Ok(said?);
    }
    // Damage is what counts, even where nobody listens to the report.
    Err(named(&args.pack, &damaged))
}

/// Check a pack that something is going to be made of.
///
/// # Errors
/// When it is damaged, naming the parts, or cannot be read.
pub(crate) fn sound(pack: &Path) -> anyhow::Result<()> {
    let (_, damaged) = check(pack)?;
    if damaged.is_empty() { Ok(()) } else { Err(named(pack, &damaged)) }
}

/// The damaged parts, the first ones by name.
fn named(pack: &Path, damaged: &[String]) -> anyhow::Error {
    let mut message = damaged.iter().take(NAMED).cloned().collect::<Vec<_>>().join("\n  ");
    if damaged.len() > NAMED {
        let _ = write!(message, "\n  and {} more damaged parts", damaged.len() - NAMED);
    }
    anyhow::anyhow!(message).context(pack.display().to_string())
}

/// What was found sound.
struct Checked {
    totals: Totals,
    bytes: u64,
}

/// Check a pack; the damaged parts in words. Fails only where the file cannot be read at all.
fn check(path: &Path) -> anyhow::Result<(Option<Checked>, Vec<String>)> {
    let reader = match Reader::open(FileSource::open(path)?) {
        Ok(reader) => reader,
        Err(e) => return Ok((None, vec![e.to_string()])),
    };
    let mut damaged = Vec::new();
    damaged.extend(kilwa_pack::verify::directory(reader.entries()).err().map(|e| e.to_string()));
    damaged.extend(check_gaps(&reader)?);
    let bar = progress_bar(reader.entries().len() as u64, "verifying");
    let mut totals = Totals::default();
    let indices: Vec<u32> = (0u32..).take(reader.entries().len()).collect();
    for batch in indices.chunks(BATCH) {
        let results: Vec<Result<Totals, PackError>> =
            batch.par_iter().map(|&i| kilwa_pack::verify::chunk(i, &reader.chunk(i)?, reader.entries())).collect();
        for result in results {
            match result {
                Ok(part) => totals = totals.plus(part),
                Err(e) => damaged.push(e.to_string()),
            }
        }
        bar.inc(batch.len() as u64);
    }
    bar.finish_and_clear();
    if damaged.is_empty() {
        damaged.extend(totals.agree(reader.header(), reader.metadata()).err().map(|e| e.to_string()));
    }
    let bytes = reader.header().file_bytes;
    Ok((Some(Checked { totals, bytes }), damaged))
}

/// Bytes between the parts of the file: only zeros before page 0, nothing anywhere else.
fn check_gaps(reader: &Reader<FileSource>) -> anyhow::Result<Option<String>> {
    use kilwa_pack::{PAGE_BYTES, Source, footer::FOOTER_BYTES};
    let header = reader.header();
    let page = PAGE_BYTES as u64;
    let (metadata, length) = header.metadata;
    let mut parts: Vec<(u64, u64)> = reader.entries().iter().map(|e| (e.offset, u64::from(e.encoded_bytes))).collect();
    parts.push((header.other_pages, page * u64::from(header.page_count() - 1)));
    parts.push((header.file_bytes - FOOTER_BYTES as u64, FOOTER_BYTES as u64));
    parts.sort_unstable();
    let mut end = header.first_page + page;
    for (offset, bytes) in parts {
        if offset != end {
            return Ok(Some(format!("the bytes from {end} to {offset} belong to no part of the pack, or to two")));
        }
        end = offset + bytes;
    }
    let from = metadata + u64::from(length);
    let gap = header.first_page.checked_sub(from).filter(|gap| *gap < 16);
    let Some(gap) = gap else {
        return Ok(Some("directory page 0 does not follow the metadata".to_owned()));
    };
    let padding = reader.source().read_at(from, gap as usize)?;
    Ok(padding.iter().any(|&b| b != 0).then(|| "the padding before directory page 0 is not zero".to_owned()))
}

fn report(path: &Path, checked: Option<&Checked>, damaged: &[String]) -> serde_json::Value {
    let mut value = serde_json::json!({
        "file": path.display().to_string(),
        "sound": damaged.is_empty(),
        "damaged": damaged,
    });
    if let (Some(c), Some(map)) = (checked, value.as_object_mut()) {
        map.insert("bytes".to_owned(), c.bytes.into());
        map.insert("chunks".to_owned(), c.totals.chunks.into());
        map.insert("triangles".to_owned(), c.totals.finest_triangles.into());
        map.insert("stored_triangles".to_owned(), c.totals.stored_triangles.into());
        map.insert("border_edges".to_owned(), c.totals.finest_borders.into());
    }
    value
}

/// A progress bar on standard error, shown only where that is a terminal.
pub(crate) fn progress_bar(length: u64, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta} left") {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar
}
