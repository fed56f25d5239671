//! `--notes FILE`: what people wrote about places on the model, read and checked before anything is written, then put into the version.
//!
//! Places are those of the pack that was given. Where its place on earth is taken out they are moved with it; notes that were made on a
//! published version whose place was taken out stand there already, as long as the model is as large as it was then. Notes belong to a version:
//! a further one says what becomes of them, with `--notes` or `--no-notes`.

use super::Args;
use super::plan::{Given, Plan};
use crate::redact::{Place, TakenOut};
use anyhow::{Context, bail, ensure};
use kilwa_archive::layout::{ANNOTATIONS, pack_name};
use kilwa_archive::notes::{NOTES_MAX, same_pack};
use kilwa_archive::{Manifest, Notes, Version};
use kilwa_files::plain_file;
use kilwa_pack::plural::{counted, plural};
use std::io::Read as _;
use std::path::Path;

/// By how much the size of a model may differ that stands where it stood, metres: rounding to its lattice.
const SAME_SIZE: f64 = 0.01;

pub(super) fn read(file: &Path) -> anyhow::Result<Notes> {
    let in_file = || format!("cannot read the notes {}", file.display());
    let mut bytes = Vec::new();
    plain_file::open(file).and_then(|f| f.take(NOTES_MAX + 1).read_to_end(&mut bytes)).with_context(in_file)?;
    ensure!(
        bytes.len() as u64 <= NOTES_MAX,
        "{}: longer than {NOTES_MAX} bytes, the maximum for the viewer; remove some notes",
        file.display()
    );
    Notes::parse(&bytes).map_err(|e| anyhow::anyhow!("{} cannot be used:\n  {e}", file.display()))
}

/// Versions whose place was taken out, and whose notes therefore stand where a model without its place does.
fn hidden(before: Option<&Manifest>) -> impl Iterator<Item = &Version> {
    before.into_iter().flat_map(|m| &m.versions).filter(|v| v.location_redacted)
}

/// Check the notes against the pack and against what is published.
pub(super) fn check(args: &Args, given: &Given, before: Option<&Manifest>) -> anyhow::Result<()> {
    let last = before.and_then(|m| m.versions.last()).filter(|v| v.annotations.is_some());
    let Some(notes) = &given.notes else {
        if let Some(last) = last.filter(|_| !args.no_notes) {
            let to = args.to.display().to_string();
            let at = format!("{}/{}/{}/{ANNOTATIONS}", to.trim_end_matches('/'), given.slug, last.folder);
            bail!(
                "version {} has notes ({at}); choose what this version does with them: --notes with that file keeps them, --notes with another file replaces them, --no-notes leaves them out",
                last.version
            );
        }
        return Ok(());
    };
    let in_notes = || args.notes.as_ref().map(|f| f.display().to_string()).unwrap_or_default();
    // First: what is not too long to be published can be looked at, and copied, at no cost.
    notes.to_bytes(&pack_name(&"0".repeat(64)), &given.identity).with_context(in_notes)?;
    let pack = &given.of_pack;
    let (mut here, mut there) = (Notes::default(), Vec::new());
    for note in &notes.notes {
        let of = |v: &&Version| note.made_on.as_deref().is_some_and(|made_on| same_pack(&v.pack.identity, made_on));
        match hidden(before).find(of).filter(|_| given.place.is_some()) {
            Some(version) => there.push((version, note.clone())),
            None => here.notes.push(note.clone()),
        }
    }
    here.within(pack.bounds_min, pack.bounds_max).with_context(in_notes)?;
    for (version, note) in there {
        let [min, max] = version.figures.bounds;
        let grown = (0..3).any(|k| ((max[k] - min[k]) - (pack.bounds_max[k] - pack.bounds_min[k])).abs() > SAME_SIZE);
        ensure!(
            !grown,
            "{}: the note \"{}\" was made on version {}, which had no location, and the model has another size now, so its place cannot be determined; make the note again on the published pack, or remove it from the file",
            in_notes(),
            note.title(given.language()),
            version.version
        );
        Notes { notes: vec![note], left_out: 0 }.within(min, max).with_context(in_notes)?;
    }
    if given.place.is_some() {
        notes.check_words(&given.location()).with_context(in_notes)?;
    }
    Ok(())
}

/// As they are published with a pack of this SHA-256 and identity, whose box is known.
pub(super) fn published(
    plan: &Plan,
    taken: Option<&TakenOut>,
    of_pack: &kilwa_pack::Metadata,
    sha256: &str,
    identity: &str,
) -> anyhow::Result<Option<Vec<u8>>> {
    let Some(notes) = &plan.given.notes else { return Ok(None) };
    let notes = match taken {
        Some(taken) => {
            let before = plan.facts.before.as_ref();
            let already: Vec<&str> = hidden(before).map(|v| v.pack.identity.as_str()).collect();
            notes.clone().without_place(taken.offset, &already)
        }
        None => notes.clone(),
    };
    notes.within(of_pack.bounds_min, of_pack.bounds_max).context("the notes, without their place")?;
    Ok(Some(notes.to_bytes(&pack_name(sha256), identity)?))
}

/// What is hardly meant.
pub(super) fn warnings(plan: &Plan) -> Vec<String> {
    let Some(notes) = &plan.given.notes else { return Vec::new() };
    let earlier = plan.facts.before.iter().flat_map(|m| &m.versions).map(|v| v.pack.identity.as_str());
    let known: Vec<&str> = earlier.chain([plan.given.identity.as_str()]).collect();
    let strangers = notes.strangers(&known);
    let one = |(made_on, n): (&str, usize)| {
        let short = made_on.get(..12).unwrap_or(made_on);
        format!(
            "{n} of the notes {} made on another pack ({short}…), which is not a version of this object; {}",
            plural(n, "was", "were"),
            plural(n, "its position is used unchanged", "their positions are used unchanged")
        )
    };
    strangers.into_iter().map(one).collect()
}

/// What of the file is not published, and why.
pub(super) fn left_out(plan: &Plan) -> Vec<String> {
    let Some(notes) = &plan.given.notes else { return Vec::new() };
    let without = (notes.left_out > 0).then(|| {
        format!(
            "{} no point on the model",
            counted(notes.left_out, "annotation of the notes, which names", "annotations of the notes, which name")
        )
    });
    let revealing = plan.given.place.and_then(|_: Place| notes.revealing());
    without.into_iter().chain(revealing).collect()
}
