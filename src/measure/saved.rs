//! Saved measurements: adding to a document, measuring all of a document again, writing it in other formats.

use super::{Args, Subject};
use crate::new_file::{NewFile, check_output};
use crate::source::read_named;
use anyhow::Context;
use kilwa_archive::lock::{Lock, PATIENCE};
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_measure::job::pack_name;
use kilwa_measure::{Document, Leaves, Measurement, Outcome, Reading};
use kilwa_pack::plural::{counted, plural};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// What is named as the instrument.
const PROGRAM: &str = concat!("Kilwa ", env!("CARGO_PKG_VERSION"));

/// A document and what to do with it.
#[derive(clap::Args)]
pub(crate) struct AgainArgs {
    /// The document of measurements (.json).
    file: PathBuf,
    /// Write it in another format too: .csv, .geojson or .dxf.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

/// Longest document of measurements that is read, bytes.
const DOCUMENT_MAX: u64 = 256 << 20;

fn read(path: &Path) -> anyhow::Result<Document> {
    let bytes = read_named(path, DOCUMENT_MAX)?;
    Document::parse(&bytes).with_context(|| path.display().to_string())
}

/// Replace or make a file at once: a reader never sees half of it.
pub(super) fn write_whole(path: &Path, text: &str, replace: bool) -> anyhow::Result<()> {
    NewFile::write(path, text.as_bytes(), replace)
}

/// What came out, as it is saved and cited; `default` is its name where none is given.
pub(super) fn measurement(outcome: &Outcome, args: &Args, default: String) -> Measurement {
    Measurement {
        name: args.name.clone().unwrap_or(default),
        task: outcome.task.clone(),
        readings: outcome.readings.clone(),
        uncertainty: outcome.uncertainty,
        color: None,
        hidden: false,
        note: String::new(),
        date: args.date.clone(),
    }
}

/// One sentence that cites it.
pub(super) fn citation(s: &Subject, measurement: &Measurement) -> String {
    measurement.citation(&pack_name(s.leaves.index()), PROGRAM, s.unit)
}

/// Add a measurement to a document, which is created if it does not exist. The folder is locked meanwhile, so that two measurements saved at once are both
/// kept. In a folder of objects, a publication may hold that lock for minutes; then a message says that the command is waiting.
pub(super) fn save(s: &Subject, outcome: &Outcome, to: &Path, args: &Args) -> anyhow::Result<()> {
    let pack = pack_name(s.leaves.index());
    let waits = || {
        crate::terminal::say!(
            "kilwa: another kilwa command is publishing, withdrawing or saving in {}; waiting for up to {} minutes",
            folder_of(to).display(),
            PATIENCE.as_secs() / 60
        );
    };
    let folders = MadeFolders::for_file(to);
    let _folders = folders.with_context(|| format!("cannot write {}", to.display()))?;
    let _lock =
        Lock::wait(folder_of(to), PATIENCE, &waits).with_context(|| format!("cannot write {}", to.display()))?;
    let mut document = if to.exists() { read(to)? } else { Document::new(pack.clone()) };
    anyhow::ensure!(
        document.pack.identity == pack.identity,
        "{} contains measurements of another pack ({}, {}); choose another file",
        to.display(),
        document.pack.title,
        document.pack.identity
    );
    let default = format!("{} {}", outcome.task.tool.name(), document.measurements.len() + 1);
    document.measurements.push(measurement(outcome, args, default));
    write_whole(to, &document.to_json(), true)
}

/// Measure everything of a document again. True where all values are the same to the last bit.
pub(super) fn again(s: &Subject, again: &AgainArgs, all: &Args) -> anyhow::Result<bool> {
    let (args, as_json) = (again, all.json);
    let document = read(&args.file)?;
    let ending = args.output.as_deref().map(|path| (path, export(&document, path)));
    if let Some((path, text)) = ending {
        let text = text?;
        check_output(path, args.force, [all.pack.as_path(), args.file.as_path()])?;
        write_whole(path, &text, args.force)?;
    }
    let here = pack_name(s.leaves.index());
    let same_pack = document.pack.identity == here.identity;
    let mut out = crate::terminal::out();
    let (mut rows, mut differing) = (Vec::new(), 0);
    for m in &document.measurements {
        let task = m.task.on_lattice(&document.pack.lattice, &here.lattice);
        let now = s.measure(&task).map_err(|e| format!("{e:#}"));
        let is_same =
            |now: &[Reading]| now.len() == m.readings.len() && now.iter().zip(&m.readings).all(|(a, b)| a.is_same(b));
        let same = now.as_ref().is_ok_and(|r| is_same(&r.readings));
        differing += usize::from(!same);
        rows.push(json!({
            "name": m.name,
            "tool": m.task.tool,
            "same": same,
            "saved": m.readings,
            "now": now.as_ref().ok().map(|n| &n.readings),
            "refused": now.as_ref().err(),
        }));
        if as_json {
            continue;
        }
        writeln!(out, "{} ({}): {}", m.name, m.task.tool.name(), if same { "the same" } else { "DIFFERENT" })?;
        for (i, r) in m.readings.iter().enumerate() {
            let text = r.text(s.unit);
            let other = now.as_ref().ok().and_then(|n| n.readings.get(i)).filter(|other| other.quantity != r.quantity);
            match other {
                Some(other) if same => {
                    writeln!(out, "  {:24} {text}, with the uncertainty of today {}", r.name, other.text(s.unit))?;
                }
                Some(other) => writeln!(out, "  {:24} {text}, now {}", r.name, other.text(s.unit))?,
                None => writeln!(out, "  {:24} {text}", r.name)?,
            }
        }
        if let Err(why) = &now {
            writeln!(out, "  {why}")?;
        }
        if all.cite {
            writeln!(out, "  {}", m.citation(&document.pack, PROGRAM, s.unit))?;
        }
    }
    if as_json {
        let whole = json!({ "pack": here, "saved_pack": document.pack, "same_pack": same_pack, "measurements": rows });
        writeln!(out, "{}", crate::terminal::json_text(&whole)?)?;
    } else if !same_pack {
        writeln!(
            out,
            "The measurements were made on another pack: {} ({}).",
            document.pack.title, document.pack.identity
        )?;
    }
    if differing > 0 && !as_json {
        let all = counted(document.measurements.len(), "measurement", "measurements");
        writeln!(out, "{differing} of {all} {}.", plural(differing, "differs", "differ"))?;
    }
    Ok(differing == 0)
}

fn export(document: &Document, path: &Path) -> anyhow::Result<String> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match ending.as_deref() {
        Some("csv") => Ok(document.to_csv()),
        Some("geojson") => Ok(document.to_geojson()),
        Some("dxf") => Ok(document.to_dxf()),
        _ => anyhow::bail!("{}: the file extension must be .csv, .geojson or .dxf", path.display()),
    }
}
