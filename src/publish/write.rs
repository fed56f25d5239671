//! From a plan to the object on disk.

use super::plan::Plan;
use super::{Args, Report, notes, pictures};
use crate::{extract, redact, source, verify};
use anyhow::{Context, bail};
use indicatif::ProgressBar;
use kilwa_pack::visible::visible;
use kilwa_server::object::Manifest;
use kilwa_server::object::assemble::{complete, is_published};
use kilwa_server::object::bag::{self, BagInfo};
use kilwa_server::object::checksums::sha256;
use kilwa_server::object::draft::{Draft, Lock};
use kilwa_server::object::layout::{ANNOTATIONS, PREVIEW, PREVIEW_MAX, pack_name};
use kilwa_server::object::record::{Preview, Publication};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

/// The pack's name in the draft, until its hash is known.
const PART: &str = "pack.part";

pub(super) fn run(args: &Args, plan: &Plan) -> anyhow::Result<Report> {
    let (shelf, facts) = (&args.to, &plan.facts);
    let bar = spinner();
    verify::sound(&plan.given.pack)?;
    std::fs::create_dir_all(shelf).with_context(|| format!("cannot make the folder {}", shelf.display()))?;
    let _lock = Lock::take(shelf)?;
    let say = |what: &str| {
        bar.set_message(visible(what).into_owned());
        Ok(())
    };
    let mut draft = Draft::begin(shelf, &facts.slug, facts.version(), &say)?;
    let folder = draft.folder();
    let part = folder.join(PART);
    bar.set_message("copying the pack");
    let taken = without_place(plan, &part)?;
    if taken.is_none() {
        copy(&plan.given.pack, &part)?;
    }
    let reader = source::open_pack(&part)?;
    let (of_pack, identity) = (reader.metadata().clone(), reader.identity());
    drop(reader);
    let (bytes, pack_sum) = draft.adopt_named(PART, pack_name)?;
    let noted = notes::published(plan, taken.as_ref(), &of_pack, &pack_sum, &identity)?;
    let notes_sum = noted.as_deref().map(sha256);
    let object = shelf.join(facts.slug.as_str());
    let is_there = |b: &&Manifest| is_published(&object, b, &pack_sum, &facts.metadata, notes_sum.as_deref());
    if let Some(before) = facts.before.as_ref().filter(is_there) {
        bail!(
            "{}: version {} has this very pack, metadata and notes; there is nothing new to publish",
            plan.at,
            before.versions.len()
        );
    }
    let pack_path = folder.join(pack_name(&pack_sum));
    let pictured = picture(&pack_path, &folder, plan, args.software, &bar)?;
    for path in &pictured.files {
        draft.adopt(path)?;
    }
    if let Some(noted) = &noted {
        draft.write(ANNOTATIONS, noted)?;
    }
    let publication = facts.publication(facts.pack_entry(bytes, pack_sum, identity), of_pack, pictured.preview);
    let publication = publication.with_notes(&folder).context("cannot read the notes")?;
    let list = args.site.then(|| "../".to_owned());
    let completed = complete(draft, facts, &publication, &plan.page, pictured.drawings, list)?;
    let bag = if args.bag { Some(wrap(shelf, &publication, &say)?) } else { None };
    if args.site {
        kilwa_server::object::site::write(shelf, &plan.page)?;
    }
    bar.finish_and_clear();
    let mut left_out = pictured.left_out;
    left_out.extend(plan.channels_left_out());
    left_out.extend(notes::left_out(plan));
    if publication.url().is_none() {
        left_out.push("oembed.json, which needs an address".to_owned());
    }
    Ok(Report {
        object: completed.object.display().to_string(),
        slug: facts.slug.to_string(),
        version: publication.version,
        published: publication.published,
        already: false,
        files: completed.files,
        bytes: completed.bytes,
        notes: publication.notes.map_or(0, |n| n.notes.notes.len()),
        pack: publication.pack,
        bag,
        left_out,
        warnings: plan.warnings(),
        advice: plan.advice(),
    })
}

/// Write the pack without its place, where that is asked for; what was taken out.
pub(super) fn without_place(plan: &Plan, to: &Path) -> anyhow::Result<Option<redact::TakenOut>> {
    let Some(place) = plan.given.place else { return Ok(None) };
    let given = &plan.given;
    let taken = redact::redact(&given.pack, to, place, &plan.facts.metadata.title, &given.keep_channels)?;
    verify::sound(to)?;
    Ok(Some(taken))
}

/// Pictures and preview of a version: their paths in its folder, and what is known of them.
pub(super) struct Pictured {
    pub(super) files: Vec<String>,
    pub(super) drawings: Vec<(String, String)>,
    pub(super) preview: Option<Preview>,
    /// What could not be made, and why.
    pub(super) left_out: Vec<String>,
}

/// Draw a pack, and make its preview, into a folder.
pub(super) fn picture(
    pack: &Path,
    folder: &Path,
    plan: &Plan,
    software: bool,
    bar: &ProgressBar,
) -> anyhow::Result<Pictured> {
    bar.set_message("drawing");
    let drawn = pictures::draw(pack, folder, &plan.facts.metadata.title, software)?;
    let (mut files, mut left_out) = (drawn.files, Vec::new());
    bar.set_message("making the preview");
    let preview = preview(pack, folder, &mut left_out)?;
    if preview.is_some() {
        files.push(PREVIEW.to_owned());
    }
    Ok(Pictured { files, drawings: drawn.drawings, preview, left_out })
}

/// A line on standard error that says what is done, only where that is a terminal.
pub(super) fn spinner() -> ProgressBar {
    let bar = ProgressBar::new_spinner();
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

/// A copy whose bytes on disk are those that were read (`adopt_named` reads them again).
fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let failed = || format!("cannot copy {} to {}", from.display(), to.display());
    let mut reader = File::open(from).with_context(failed)?;
    let mut writer = File::create_new(to).with_context(failed)?;
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = reader.read(&mut buffer).with_context(failed)?;
        if n == 0 {
            break;
        }
        writer.write_all(&buffer[..n]).with_context(failed)?;
    }
    writer.sync_all().with_context(failed)
}

fn preview(pack: &Path, folder: &Path, left_out: &mut Vec<String>) -> anyhow::Result<Option<Preview>> {
    match extract::preview::write(pack, &folder.join(PREVIEW), PREVIEW_MAX) {
        Ok(p) => Ok(Some(Preview { bytes: p.bytes, triangles: p.triangles, error: f64::from(p.error) })),
        Err(e) if e.chain().any(<dyn std::error::Error>::is::<std::io::Error>) => Err(e),
        Err(e) => {
            left_out.push(format!("{PREVIEW}: {}", e.root_cause()));
            Ok(None)
        }
    }
}

fn wrap(shelf: &Path, p: &Publication, steps: kilwa_server::object::draft::Steps<'_>) -> anyhow::Result<String> {
    let info = BagInfo {
        organization: p.metadata.publisher.clone(),
        identifier: p
            .metadata
            .identifier
            .clone()
            .or_else(|| p.metadata.url.clone())
            .unwrap_or_else(|| format!("urn:kilwa:{}", p.pack.identity)),
        description: p.metadata.title.clone(),
        date: p.published.clone(),
        tool: p.tool.clone(),
    };
    let bag = bag::wrap(shelf, &p.slug, &info, steps).context("the object is published; its bag could not be made")?;
    Ok(bag.display().to_string())
}
