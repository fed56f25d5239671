//! `kilwa publish --to https://…`: made here as for a folder, then sent to a server, which verifies it and publishes it.

use super::photographs::ColourFiles;
use super::plan::{Given, Plan};
use super::progress::{Progress, Stage};
use super::send::{Patience, SendEvent, Sender, is_loopback};
use super::write::{check, picture, without_place};
use super::{Args, Report, holes, mapping, notes, photographs, tiles};
use crate::redact::Place;
use crate::verify::is_address;
use anyhow::{Context, bail, ensure};
use kilwa_archive::assemble::is_metadata;
use kilwa_archive::checksums::{sha256, sha256_of};
use kilwa_archive::layout::{ANNOTATIONS, COLOUR_REPORT, HOLES, MANIFEST, METADATA, pack_name};
use kilwa_archive::manifest::Optional;
use kilwa_archive::{Holes, Manifest, PackEntry, Version};
use kilwa_server::upload::wire::{AnnouncedFile, AnnouncedPreview, Drawing, FORM, Intent};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Where a token is looked for.
const TOKEN: &str = "KILWA_TOKEN";
/// Longest file with a token.
const TOKEN_MAX: u64 = 4096;

/// The address that `--to` names, where it names one.
pub(super) fn address(args: &Args) -> Option<&str> {
    args.to.to_str().filter(|to| is_address(to))
}

pub(super) fn run(args: &Args, address: &str) -> anyhow::Result<()> {
    for (given, what, instead) in [
        (args.site, "--site", "the server makes these pages itself"),
        (args.bag, "--bag", "publish to a folder as well to get a bag"),
        (
            args.tiles.is_some(),
            "--tiles",
            "servers do not accept 3D Tiles. On the computer that has the objects: kilwa publish --to DIR --tiles …; or write them with kilwa extract --to tiles and serve them from a web server",
        ),
        (
            args.withdraw.is_some(),
            "--withdraw",
            "do this on the computer that has the objects: kilwa publish --withdraw NAME --to DIR --keep FOLDER --reason …",
        ),
    ] {
        ensure!(!given, "{what} is for folders: {instead}");
    }
    ensure!(
        !args.open_access,
        "--open-access opens earlier versions too, which uploads must not do; the server's administrator can publish that version to the server's folder"
    );
    check_address(address, args.allow_http)?;
    let base = address.trim_end_matches('/');
    let token = token(args)?;
    let sender = Sender::new(base, token, Patience::default());
    let mut given = Given::read(args)?;
    let at = format!("{base}/{}", given.slug);
    sender.greet(given.slug.as_str()).map_err(anyhow::Error::msg).with_context(|| at.clone())?;
    let before = manifest(&sender, given.slug.as_str(), &at)?;
    let work = crate::new_file::private_folder("kilwa-publish-").context("cannot make a temporary folder")?;
    let progress = Progress::new(&stages(&given), given.lengths());
    if args.dry_run {
        given.prepare_photographs()?;
    } else {
        check(&mut given, &progress)?;
    }
    // Whether an earlier run has come to its end, whose answer was lost: before a note for another version is asked for.
    if let Some(report) = already(&sender, &given, before.as_ref(), &at)? {
        return super::say(args, &report);
    }
    let plan = Plan::new(args, given, before, at)?;
    if args.dry_run {
        return mapping::print(args, &plan);
    }
    let report = send(args, &sender, &plan, work.path(), &progress)?;
    super::say(args, &report)
}

/// The stages of a publication to a server.
fn stages(given: &Given) -> Vec<Stage> {
    let redact = given.place.map(|_| Stage::Redact);
    let others = [Stage::Hash, Stage::Pictures, Stage::Preview, Stage::Send, Stage::Verify];
    let has_photographs = given.lengths().photographs > 0;
    let photographs = [Stage::CheckPhotographs, Stage::SmallerCopies].into_iter().filter(|_| has_photographs);
    [Stage::Check].into_iter().chain(photographs).chain(redact).chain(others).collect()
}

/// Make the version in `work`, send it, and look at what is there then.
fn send(args: &Args, sender: &Sender, plan: &Plan, work: &Path, progress: &Progress) -> anyhow::Result<Report> {
    photographs::announce(&plan.given, progress);
    let redacted = work.join("pack.kilwa");
    let taken = without_place(plan, &redacted, progress)?;
    let pack = if taken.is_some() { redacted } else { plan.given.pack.clone() };
    progress.begin(Stage::Hash);
    let (bytes, pack_sum) = hashed(&pack)?;
    let reader = crate::source::open_pack(&pack)?;
    let (of_pack, identity) = (reader.metadata().clone(), reader.identity());
    drop(reader);
    let noted = notes::published(plan, taken.as_ref(), &of_pack, &pack_sum, &identity)?;
    let pictured = picture(&pack, work, plan, args.software, progress)?;
    let listed_holes = holes::published(plan, taken.as_ref(), &of_pack)?;
    let colours = plan.given.colours.as_ref().map(|colours| colours.bytes.clone());
    let mut lists = Vec::new();
    for (path, list) in [(ANNOTATIONS, noted), (HOLES, listed_holes), (COLOUR_REPORT, colours)] {
        if let Some(list) = list {
            std::fs::write(work.join(path), list)
                .with_context(|| format!("cannot write {path} to the temporary folder"))?;
            lists.push(path.to_owned());
        }
    }
    let photos = plan.given.colours.iter().flat_map(|colours| &colours.files);
    let of_photo: BTreeMap<&str, &Path> =
        photos.clone().map(|file| (file.path.as_str(), file.from.as_path())).collect();
    let photos = photos.map(|f| AnnouncedFile { path: f.path.clone(), bytes: f.bytes, sha256: f.sha256.clone() });
    let pack_file = AnnouncedFile { path: pack_name(&pack_sum), bytes, sha256: pack_sum.clone() };
    // In the order in which publishing to a folder writes them, so that records list them in the same order.
    let pictures = announced(work, &pictured.files)?;
    let files: Vec<_> = [pack_file].into_iter().chain(pictures).chain(photos).chain(announced(work, &lists)?).collect();
    let facts = &plan.facts;
    let intent = Intent {
        kilwa_upload: FORM,
        slug: facts.slug.to_string(),
        version: facts.version(),
        published: facts.published.clone(),
        note: facts.note.clone(),
        location_redacted: facts.location_redacted,
        location_cell: match plan.given.place {
            Some(Place::Cell(cell)) => Some(cell),
            _ => None,
        },
        kept_channels: plan.given.keep_channels.clone(),
        same_object: args.same_object,
        metadata: facts.metadata.clone(),
        preview: pictured.preview.map(|p| AnnouncedPreview { triangles: p.triangles, error: p.error }),
        drawings: pictured.drawings.iter().map(|(p, w)| Drawing { path: p.clone(), words: w.clone() }).collect(),
        files,
    };
    let place = |file: &AnnouncedFile| -> PathBuf {
        match of_photo.get(file.path.as_str()) {
            _ if file.sha256 == pack_sum => pack.clone(),
            Some(from) => (*from).to_owned(),
            None => work.join(&file.path),
        }
    };
    let published = sender.publish(&intent, &place, &|event| show(progress, &event));
    let published = published.map_err(anyhow::Error::msg).with_context(|| plan.at.clone())?;
    progress.end();
    let version = published_version(sender, (&intent.slug, &plan.at), published.version, &pack_sum)?;
    let mut left_out = pictured.left_out;
    left_out.extend(plan.channels_left_out());
    left_out.extend(notes::left_out(plan));
    if facts.metadata.url.is_none() {
        left_out.push("oembed.json, which needs an address".to_owned());
    }
    let before = facts.before.as_ref();
    let lost = [tiles::lost(args, before), photographs::lost(&plan.given, before)];
    Ok(Report {
        object: format!("{}/", plan.at),
        slug: intent.slug.clone(),
        version: version.version,
        published: version.published.clone(),
        already: published.already,
        closed: false,
        owner_only: false,
        files: intent.files.len(),
        bytes: intent.files.iter().map(|f| f.bytes).sum(),
        pack: PackEntry { identity, ..version.pack.clone() },
        notes: plan.given.notes.as_ref().map_or(0, |n| n.notes.len()),
        holes: plan.given.holes.as_ref().map_or(0, |n| n.holes.len()),
        tiles: 0,
        colour_files: ColourFiles::of(&plan.given),
        bag: None,
        pages: false,
        left_out,
        warnings: plan.warnings().into_iter().chain(lost.into_iter().flatten()).collect(),
        advice: plan.advice(),
    })
}

/// Files of a folder, as they are announced.
fn announced(folder: &Path, paths: &[String]) -> anyhow::Result<Vec<AnnouncedFile>> {
    let one = |path: &String| {
        let (bytes, sha256) = hashed(&folder.join(path))?;
        Ok(AnnouncedFile { path: path.clone(), bytes, sha256 })
    };
    paths.iter().map(one).collect()
}

/// The version that the server says it published, as its manifest has it now.
///
/// # Errors
/// The manifest does not name that version with this pack.
fn published_version(
    sender: &Sender,
    (slug, at): (&str, &str),
    number: u32,
    pack_sum: &str,
) -> anyhow::Result<Version> {
    let now = manifest(sender, slug, at)?;
    let version = now.and_then(|m| m.versions.into_iter().find(|v| v.version == number));
    version.filter(|v| v.pack.sha256 == pack_sum).with_context(|| {
        format!("{at}: the server reports version {number} as published, but its manifest.json does not name it")
    })
}

fn hashed(path: &Path) -> anyhow::Result<(u64, String)> {
    let hashed = File::open(path).and_then(|f| sha256_of(BufReader::with_capacity(1 << 20, f)));
    hashed.with_context(|| format!("cannot read {}", path.display()))
}

/// What is published there already.
fn manifest(sender: &Sender, slug: &str, at: &str) -> anyhow::Result<Option<Manifest>> {
    let bytes = sender.fetch(&format!("{slug}/{MANIFEST}")).map_err(anyhow::Error::msg)?;
    bytes.map(|b| Manifest::parse(&b).with_context(|| format!("{at}/{MANIFEST}"))).transpose()
}

/// Whether this very pack and metadata are the last version.
fn already(sender: &Sender, given: &Given, before: Option<&Manifest>, at: &str) -> anyhow::Result<Option<Report>> {
    // Of a pack without its place the server says so itself, when it is sent what is meant.
    let last =
        before.and_then(|m| m.versions.last()).filter(|v| given.place.is_none() && v.pack.bytes == given.pack_bytes);
    let Some(last) = last else { return Ok(None) };
    let (bytes, pack_sum) = hashed(&given.pack)?;
    let noted = given.notes.as_ref().map(|n| n.to_bytes(&pack_name(&pack_sum), &given.identity)).transpose()?;
    let holes = given.holes.as_ref().map(Holes::to_bytes).transpose()?;
    let (noted, holes) = (noted.as_deref().map(sha256), holes.as_deref().map(sha256));
    let colours = given.colours.as_ref().map(|colours| sha256(&colours.bytes));
    let optional =
        Optional { notes: noted.as_deref(), holes: holes.as_deref(), tiles: None, colour_report: colours.as_deref() };
    if pack_sum != last.pack.sha256 || last.optional() != optional {
        return Ok(None);
    }
    let written = sender.fetch(&format!("{}/{}/{METADATA}", given.slug, last.folder)).map_err(anyhow::Error::msg)?;
    if !written.is_some_and(|w| is_metadata(&w, &given.published_metadata())) {
        return Ok(None);
    }
    Ok(Some(Report {
        object: format!("{at}/"),
        slug: given.slug.to_string(),
        version: last.version,
        published: last.published.clone(),
        already: true,
        closed: false,
        owner_only: false,
        files: 1,
        bytes,
        pack: last.pack.clone(),
        notes: given.notes.as_ref().map_or(0, |n| n.notes.len()),
        holes: given.holes.as_ref().map_or(0, |n| n.holes.len()),
        tiles: 0,
        colour_files: ColourFiles::of(given),
        bag: None,
        pages: false,
        left_out: Vec::new(),
        warnings: Vec::new(),
        advice: Vec::new(),
    }))
}

/// A token goes over the network in the clear to this computer only, unless somebody says that it may.
fn check_address(address: &str, allow_http: bool) -> anyhow::Result<()> {
    let rest = address.split_once("://").map_or("", |(_, rest)| rest);
    let host = rest.split(['/', '?', '#']).next().unwrap_or_default();
    ensure!(
        !host.is_empty() && !rest.contains(['?', '#', '@']),
        "{address} is not the address of a site; expected for example https://museum.example"
    );
    if address.get(..5).is_some_and(|start| start.eq_ignore_ascii_case("https")) || allow_http {
        return Ok(());
    }
    ensure!(
        is_loopback(address),
        "{address}: over http, anyone on the way can read the token and publish with it; use https://, or --allow-http if the network is your own"
    );
    Ok(())
}

/// The token, from a file or from the environment; never from the command line, where others of the machine could read it.
fn token(args: &Args) -> anyhow::Result<String> {
    let (text, from) = if let Some(path) = &args.token_file {
        let length = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
        ensure!(length <= TOKEN_MAX, "{}: it has {length} bytes, too many for a token", path.display());
        let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
        (text, path.display().to_string())
    } else if let Some(text) = std::env::var_os(TOKEN) {
        (text.to_string_lossy().into_owned(), TOKEN.to_owned())
    } else {
        bail!(
            "publishing to a server needs a token: its administrator makes one with `kilwa access token FILE NAME --for publish`; put it into the environment as {TOKEN}, or give a file with --token-file"
        );
    };
    let token = text.trim();
    let is_token =
        token.strip_prefix("kilwa-").is_some_and(|t| t.len() == 64 && t.bytes().all(|b| b.is_ascii_hexdigit()));
    ensure!(is_token, "{from} contains no token; a token is kilwa- followed by 64 hexadecimal digits");
    Ok(token.to_owned())
}

/// Show how far sending has got.
fn show(progress: &Progress, event: &SendEvent<'_>) {
    let at = |stage: Stage, done: u64, all: u64| {
        progress.begin(stage);
        progress.at(done, all);
    };
    match event {
        SendEvent::Sent(done, of) => at(Stage::Send, *done, *of),
        SendEvent::Verified(done, of) => at(Stage::Verify, *done, *of),
        SendEvent::Waits(why, pause) => {
            progress.say(&format!("kilwa: {why}; trying again in {} s", pause.as_secs_f32().ceil()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_sent_unencrypted_only_to_this_computer() {
        for good in
            ["https://museum.example/", "http://localhost:8080", "http://127.0.0.1:9/", "http://[::1]:80/", "HTTPS://x"]
        {
            assert!(check_address(good, false).is_ok(), "{good}");
        }
        for bad in ["http://museum.example", "http://localhost.example/", "http://10.0.0.1", "http://127.0.0.1.example"]
        {
            assert!(check_address(bad, false).unwrap_err().to_string().contains("--allow-http"), "{bad}");
            assert!(check_address(bad, true).is_ok());
        }
        for none in ["https://", "https:///x", "https://a@b/", "https://a/?x"] {
            assert!(check_address(none, true).is_err(), "{none}");
        }
    }
}
