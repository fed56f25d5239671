//! From a plan to the object on disk.

use super::photographs::ColourFiles;
use super::plan::{Given, Plan, is_same_request};
use super::progress::{Progress, Stage};
use super::{Args, Report, holes, notes, photographs, pictures, tiles};
use crate::{redact, source, verify};
use anyhow::{Context, ensure};
use kilwa_archive::assemble::{Landing, complete, is_published, write_viewer};
use kilwa_archive::bag::{self, BagInfo};
use kilwa_archive::checksums::sha256;
use kilwa_archive::created_folders::CreatedFolders;
use kilwa_archive::draft::{Draft, Steps};
use kilwa_archive::layout::{ANNOTATIONS, COLOUR_REPORT, HOLES, PREVIEW, PREVIEW_MAX, pack_name, version_folder};
use kilwa_archive::lock::{Lock, PATIENCE};
use kilwa_archive::manifest::Optional;
use kilwa_archive::modes::{settle_published, unshared_with};
use kilwa_archive::next::settle;
use kilwa_archive::record::Preview;
use kilwa_archive::site::{self, Listed};
use kilwa_archive::{AccessState, Manifest, Slug};
use kilwa_formats::extract;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// The pack's name in the draft, until its hash is known.
const PART: &str = "pack.part";

/// The stages of a publication to a folder.
pub(super) fn stages(args: &Args, plan: &Plan) -> Vec<Stage> {
    let copy = if plan.given.place.is_some() { Stage::Redact } else { Stage::Copy };
    let tiles = args.tiles.map(|_| Stage::Tiles);
    let has_photographs = plan.given.lengths().photographs > 0;
    let of_photographs = |stage| has_photographs.then_some(stage);
    let mut all = vec![Stage::Check];
    all.extend([Stage::CheckPhotographs, Stage::SmallerCopies].into_iter().filter_map(of_photographs));
    all.extend([copy, Stage::Hash, Stage::Pictures, Stage::Preview]);
    all.extend(tiles);
    all.extend(of_photographs(Stage::Photographs));
    all.push(Stage::Records);
    all
}

pub(super) fn run(args: &Args, plan: &mut Plan, progress: &Progress) -> anyhow::Result<Report> {
    run_with(args, plan, progress, &|pack, folder, plan| picture(pack, folder, plan, args.software, progress))
}

/// Makes pictures and preview of a pack in a folder.
type Picture<'a> = &'a dyn Fn(&Path, &Path, &Plan) -> anyhow::Result<Pictured>;

/// Whatever takes long is done in a hidden folder and keeps nobody from publishing. Then the folder is locked, and the version is decided by what is
/// published at that moment.
fn run_with(args: &Args, plan: &mut Plan, progress: &Progress, picture: Picture<'_>) -> anyhow::Result<Report> {
    let (shelf, slug) = (&args.to, plan.facts.slug.clone());
    check(&mut plan.given, progress)?;
    photographs::announce(&plan.given, progress);
    let say = |_: &str| Ok(());
    // Removed again if nothing is published to it.
    let (_folders, lock) = CreatedFolders::create_locked(shelf, &|| waits(progress)(shelf), &say)?;
    let mut draft = Draft::begin(&lock, &slug, &say)?;
    drop(lock);
    let made = Prepared::of(args, plan, &mut draft, picture, progress)?;
    progress.begin(Stage::Records);
    write_viewer(&mut draft, &plan.page)?;
    let lock = locked(shelf, progress)?;
    if args.site {
        site::check(shelf)?;
    }
    let (planned, before) = (plan.facts.version(), settle(&lock, &slug, &say)?);
    plan.facts.before.clone_from(&before);
    let noted = notes::published(plan, made.taken.as_ref(), &made.of_pack, &made.pack_sum, &made.identity)?;
    let listed_holes = holes::published(plan, made.taken.as_ref(), &made.of_pack)?;
    let colours = plan.given.colours.as_ref().map(|colours| colours.bytes.clone());
    let object = shelf.join(slug.as_str());
    let sums = [&noted, &listed_holes, &colours].map(|list| list.as_deref().map(sha256));
    let tiles = made.tiles.as_ref().map(|tiles| tiles.published.sha256.as_str());
    let [notes_sum, holes_sum, colour_report] = sums.each_ref().map(Option::as_deref);
    let optional = Optional { notes: notes_sum, holes: holes_sum, tiles, colour_report };
    let is_there = |b: &&Manifest| is_published(&object, b, &made.pack_sum, &plan.facts.metadata, optional);
    if let Some(before) = before.as_ref().filter(is_there) {
        ensure!(
            is_same_request(args, before),
            "{}: version {} has the same pack, metadata, notes, holes, 3D Tiles and colour report; there is nothing new to publish",
            plan.at,
            before.versions.len()
        );
        drop(draft);
        return already(args, plan, before, &made, &lock, &say);
    }
    let lost = [tiles::lost(args, before.as_ref()), photographs::lost(&plan.given, before.as_ref())];
    plan.renew(args, before)?;
    let facts = &plan.facts;
    for (path, list) in [(ANNOTATIONS, &noted), (HOLES, &listed_holes), (COLOUR_REPORT, &colours)] {
        if let Some(list) = list {
            draft.write(path, list)?;
        }
    }
    let entry = facts.pack_entry(made.bytes, made.pack_sum, made.identity);
    let publication = facts.publication(entry, made.of_pack, made.pictured.preview);
    let publication = publication.with_notes(&draft.folder()).context("cannot read the notes")?;
    let publication = publication.with_holes(&draft.folder()).context("cannot read the holes")?;
    let mut publication = publication.with_colours(&draft.folder()).context("cannot read the colour report")?;
    publication.tiles = made.tiles.as_ref().map(|tiles| tiles.published.clone());
    let list = listed(args, &slug).map(|_| "../".to_owned());
    let landing = Landing { viewer: &plan.page, drawings: made.pictured.drawings, list };
    let completed = complete(draft, &lock, facts, &publication, landing)?;
    let (bag, pages) = around(args, plan, &lock, (&publication.published, &publication.pack.identity), &say)?;
    let mut left_out = made.pictured.left_out;
    left_out.extend(plan.channels_left_out());
    left_out.extend(notes::left_out(plan));
    if publication.url().is_none() {
        left_out.push("oembed.json, which needs an address".to_owned());
    }
    let mut warnings = plan.warnings();
    warnings.extend(lost.into_iter().flatten());
    if let Some(tiles) = made.tiles {
        warnings.extend(tiles.warnings);
        left_out.extend(tiles.left_out);
    }
    if publication.version != planned {
        warnings.push(format!(
            "version {planned} was published by somebody else while this one was made; this one is version {}",
            publication.version
        ));
    }
    Ok(Report {
        object: completed.object.display().to_string(),
        slug: facts.slug.to_string(),
        version: publication.version,
        published: publication.published,
        already: false,
        closed: closed_files(plan),
        owner_only: is_for_owner_only(args, &completed.object, publication.version, &mut warnings)?,
        files: completed.files,
        bytes: completed.bytes,
        notes: publication.notes.map_or(0, |n| n.notes.notes.len()),
        holes: publication.holes.map_or(0, |n| n.count),
        tiles: publication.tiles.map_or(0, |tiles| tiles.tiles),
        colour_files: ColourFiles::of(&plan.given),
        pack: publication.pack,
        bag,
        pages,
        left_out,
        warnings,
        advice: plan.advice(),
    })
}

/// Whether the geometry is kept from other users of this computer.
fn closed_files(plan: &Plan) -> bool {
    cfg!(unix) && plan.facts.metadata.access() != AccessState::Public
}

/// Whether only the owner can read the closed files because they could not be given to the group of the folder. Adds a warning if so.
fn is_for_owner_only(args: &Args, object: &Path, version: u32, warnings: &mut Vec<String>) -> anyhow::Result<bool> {
    let Some(group) = unshared_with(&object.join(version_folder(version)), &args.to)? else { return Ok(false) };
    warnings.push(format!(
        "you are not in {}, the group of {}: only you can read the pack, preview, notes, holes, 3D Tiles and photographs; a server that runs as another user cannot. \
         Ask an administrator to add you to that group, log in again, and run the same command again",
        group_name(group),
        args.to.display()
    ));
    Ok(true)
}

/// The name of a group from `/etc/group`, or its number if it is not listed there.
fn group_name(group: u32) -> String {
    let list = std::fs::read_to_string("/etc/group").unwrap_or_default();
    let mut lines = list.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let line = lines.find(|line| line.get(2).and_then(|id| id.parse().ok()) == Some(group));
    line.map_or_else(|| format!("group {group}"), |line| line[0].to_owned())
}

/// Lock the folder of objects. Prints a message if the command has to wait.
fn locked(shelf: &Path, progress: &Progress) -> anyhow::Result<Lock> {
    Ok(Lock::wait(shelf, PATIENCE, &|| waits(progress)(shelf))?)
}

/// Prints that the command waits for the lock of a folder.
pub(super) fn waits(progress: &Progress) -> impl Fn(&Path) {
    |folder| {
        let line = format!(
            "kilwa: another kilwa command is publishing to or withdrawing from {}; waiting for up to {} minutes",
            folder.display(),
            PATIENCE.as_secs() / 60
        );
        progress.say(&line);
    }
}

/// The files of a version that are made without knowing what is published.
struct Prepared {
    taken: Option<redact::TakenOut>,
    of_pack: kilwa_pack::Metadata,
    identity: String,
    bytes: u64,
    pack_sum: String,
    pictured: Pictured,
    tiles: Option<tiles::Made>,
}

impl Prepared {
    fn of(
        args: &Args,
        plan: &Plan,
        draft: &mut Draft<'_>,
        picture: Picture<'_>,
        progress: &Progress,
    ) -> anyhow::Result<Self> {
        let folder = draft.folder();
        let part = folder.join(PART);
        let taken = without_place(plan, &part, progress)?;
        if taken.is_none() {
            progress.begin(Stage::Copy);
            copy(&plan.given.pack, &part, progress, None)?;
        }
        let reader = source::open_pack(&part)?;
        let (of_pack, identity) = (reader.metadata().clone(), reader.identity());
        drop(reader);
        progress.begin(Stage::Hash);
        let (bytes, pack_sum) = draft.adopt_named(PART, pack_name)?;
        let pictured = picture(&folder.join(pack_name(&pack_sum)), &folder, plan)?;
        for path in &pictured.files {
            draft.adopt(path)?;
        }
        let tiles = tiles::make(args, &plan.given, &folder.join(pack_name(&pack_sum)), draft, progress)?;
        photographs::copy_into(&plan.given, draft, progress)?;
        Ok(Self { taken, of_pack, identity, bytes, pack_sum, pictured, tiles })
    }
}

/// An earlier run has published this version: what it did not come to is done.
fn already(
    args: &Args,
    plan: &Plan,
    before: &Manifest,
    made: &Prepared,
    lock: &Lock,
    steps: Steps<'_>,
) -> anyhow::Result<Report> {
    let last = before.versions.last().context("a manifest has versions")?;
    let settled = settle_published(lock, &plan.facts.slug, before, steps);
    settled.map_err(|e| e.after("the version is published, but the permissions of its files are not set"))?;
    let (bag, pages) = around(args, plan, lock, (&last.published, &last.pack.identity), steps)?;
    Ok(Report {
        object: plan.at.clone(),
        slug: plan.facts.slug.to_string(),
        version: last.version,
        published: last.published.clone(),
        already: true,
        closed: closed_files(plan),
        owner_only: false,
        files: 1,
        bytes: made.bytes,
        pack: last.pack.clone(),
        notes: plan.given.notes.as_ref().map_or(0, |n| n.notes.len()),
        holes: plan.given.holes.as_ref().map_or(0, |n| n.holes.len()),
        tiles: made.tiles.as_ref().map_or(0, |made| made.published.tiles),
        colour_files: ColourFiles::of(&plan.given),
        bag,
        pages,
        left_out: Vec::new(),
        warnings: Vec::new(),
        advice: Vec::new(),
    })
}

/// Write the pack without its place, if requested; what was taken out.
pub(super) fn without_place(plan: &Plan, to: &Path, progress: &Progress) -> anyhow::Result<Option<redact::TakenOut>> {
    let Some(place) = plan.given.place else { return Ok(None) };
    progress.begin(Stage::Redact);
    let given = &plan.given;
    let taken = redact::redact(&given.pack, to, place, &plan.facts.metadata.title, &given.keep_channels)?;
    let all = to.metadata().map_or(0, |m| m.len());
    verify::sound(to, &|bytes| progress.more(bytes, all))?;
    Ok(Some(taken))
}

/// Check the pack and the photographs, and make the smaller copies of these.
pub(super) fn check(given: &mut Given, progress: &Progress) -> anyhow::Result<()> {
    let all = given.pack_bytes;
    progress.begin(Stage::Check);
    verify::sound(&given.pack, &|bytes| progress.more(bytes, all))?;
    photographs::prepare(given, progress)
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
    progress: &Progress,
) -> anyhow::Result<Pictured> {
    progress.begin(Stage::Pictures);
    let title = &plan.facts.metadata.title;
    let drawn = pictures::draw(pack, folder, title, software, &|done, all| progress.at(done, all))?;
    let (mut files, mut left_out) = (drawn.files, Vec::new());
    progress.begin(Stage::Preview);
    let preview = preview(pack, folder, &mut left_out)?;
    if preview.is_some() {
        files.push(PREVIEW.to_owned());
    }
    Ok(Pictured { files, drawings: drawn.drawings, preview, left_out })
}

/// A copy whose bytes on disk are those that were read (the draft reads them again). `all` is the length of all files of the stage, if there are several.
pub(super) fn copy(from: &Path, to: &Path, progress: &Progress, all: Option<u64>) -> anyhow::Result<()> {
    let failed = || format!("cannot copy {} to {}", from.display(), to.display());
    let mut reader = File::open(from).with_context(failed)?;
    let mut writer = File::create_new(to).with_context(failed)?;
    let all = match all {
        Some(all) => all,
        None => reader.metadata().with_context(failed)?.len(),
    };
    let mut buffer = vec![0; 1 << 20];
    loop {
        let n = reader.read(&mut buffer).with_context(failed)?;
        if n == 0 {
            break;
        }
        writer.write_all(&buffer[..n]).with_context(failed)?;
        progress.more(n as u64, all);
    }
    writer.sync_all().with_context(failed)
}

fn preview(pack: &Path, folder: &Path, left_out: &mut Vec<String>) -> anyhow::Result<Option<Preview>> {
    let write = || -> anyhow::Result<_> {
        let reader = source::open_pack(pack)?;
        extract::preview(&reader, &folder.join(PREVIEW), PREVIEW_MAX).with_context(|| pack.display().to_string())
    };
    match write() {
        Ok(p) => Ok(Some(Preview { bytes: p.bytes, triangles: p.triangles, error: f64::from(p.error) })),
        Err(e) if e.chain().any(<dyn std::error::Error>::is::<std::io::Error>) => Err(e),
        Err(e) => {
            left_out.push(format!("{PREVIEW}: {}", e.root_cause()));
            Ok(None)
        }
    }
}

/// Which objects the pages of the folder are to list. Pages that list the object already must not go on showing an earlier version of it,
/// whether or not `--site` was given.
fn listed(args: &Args, slug: &Slug) -> Option<Listed> {
    let all = args.site.then_some(Listed::All);
    // A list that cannot be read is left as it is: written again, it would lack what only it named.
    all.or_else(|| site::lists(&args.to, slug, false).then_some(Listed::AsBefore))
}

/// Write the object's bag and the pages of the folder, if they are requested or list the object already; returns the bag's folder and whether pages
/// were written.
fn around(
    args: &Args,
    plan: &Plan,
    lock: &Lock,
    (published, identity): (&str, &str),
    steps: Steps<'_>,
) -> anyhow::Result<(Option<String>, bool)> {
    let m = &plan.facts.metadata;
    let identifier = m.identifier.clone().or_else(|| m.url.clone());
    let info = BagInfo {
        organization: m.publisher.clone(),
        identifier: identifier.unwrap_or_else(|| format!("urn:kilwa:{identity}")),
        description: m.title.clone(),
        date: published.to_owned(),
        tool: plan.facts.tool.clone(),
    };
    let mut bag = None;
    if args.bag {
        let made = bag::wrap(lock, &plan.facts.slug, &info, steps);
        let made = made.map_err(|e| e.after("the version is published, but its bag was not made"))?;
        bag = Some(made.display().to_string());
    }
    let listed = listed(args, &plan.facts.slug);
    if let Some(listed) = listed {
        let made = site::write(lock, &plan.page, listed, steps);
        made.map_err(|e| e.after("the version is published, but the pages of the folder were not written"))?;
    }
    Ok((bag, listed.is_some()))
}

#[cfg(test)]
#[path = "races.rs"]
mod races;
