//! From a plan to the object on disk.

use super::plan::Plan;
use super::{Args, Report, pictures};
use crate::{extract, redact, sheet, source, verify};
use anyhow::{Context, bail};
use indicatif::ProgressBar;
use kilwa_server::object::bag::{self, BagInfo};
use kilwa_server::object::draft::{Draft, Lock};
use kilwa_server::object::layout::{CRATE, PREVIEW, VIEWER, pack_name, version_folder};
use kilwa_server::object::manifest::{Access, FORM, Figures, FileEntry, RightsEntry};
use kilwa_server::object::page::{self, Surroundings};
use kilwa_server::object::record::{Preview, Publication, citation, records, ro_crate};
use kilwa_server::object::{AccessState, Manifest, PackEntry, Version};
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;
use std::time::Duration;

/// Largest preview, bytes.
const PREVIEW_BYTES: u64 = 5_000_000;
/// The pack's name in the draft, until its hash is known.
const PART: &str = "pack.part";

pub(super) fn run(args: &Args, plan: &Plan) -> anyhow::Result<Report> {
    let bar = spinner();
    verify::sound(&plan.pack)?;
    std::fs::create_dir_all(&plan.shelf).with_context(|| format!("cannot make the folder {}", plan.shelf.display()))?;
    let _lock = Lock::take(&plan.shelf)?;
    let say = |what: &str| {
        bar.set_message(what.to_owned());
        Ok(())
    };
    let mut draft = Draft::begin(&plan.shelf, &plan.slug, plan.version, &say)?;
    let folder = draft.folder();
    let part = folder.join(PART);
    bar.set_message("copying the pack");
    if let Some(place) = plan.place {
        redact::redact(&plan.pack, &part, place, &plan.metadata.title)?;
        verify::sound(&part)?;
    } else {
        copy(&plan.pack, &part)?;
    }
    let of_pack = source::open_pack(&part)?.metadata().clone();
    let identity = sheet::identity(&source::FileSource::open(&part)?)?;
    let (bytes, sha256) = draft.adopt_named(PART, pack_name)?;
    let file = pack_name(&sha256);
    let pack = PackEntry { url: format!("{}/{file}", version_folder(plan.version)), bytes, sha256, identity };
    refuse_the_same(plan, &pack)?;
    let pack_path = folder.join(&file);
    bar.set_message("drawing");
    let drawn = pictures::draw(&pack_path, &folder, &plan.metadata.title, args.software)?;
    for path in &drawn.files {
        draft.adopt(path)?;
    }
    let mut left_out = Vec::new();
    bar.set_message("making the preview");
    let preview = preview(&pack_path, &folder, &mut left_out)?;
    if preview.is_some() {
        draft.adopt(PREVIEW)?;
    }
    let publication = publication(plan, pack, of_pack, preview);
    if publication.url().is_none() {
        left_out.push("oembed.json, which needs an address".to_owned());
    }
    for (path, bytes) in records(&publication) {
        draft.write(path, &bytes)?;
    }
    for (name, bytes) in plan.page.files().filter(|(name, _)| !name.starts_with("examples/")) {
        draft.write(&format!("{VIEWER}/{name}"), bytes)?;
    }
    let crate_ = ro_crate(&publication, draft.files());
    draft.write(CRATE, &crate_)?;
    let (files, size) = (draft.files().len() + 1, draft.files().iter().map(|(_, bytes, _)| bytes).sum());
    let earlier = plan.before.as_ref().map(|m| m.versions.clone()).unwrap_or_default();
    let around = Surroundings { earlier, drawings: drawn.drawings, list: args.site.then(|| "../".to_owned()) };
    let html = page::landing(plan.page.html(), &publication, &around);
    let object = draft.finish(html.as_bytes(), |checksums, page| manifest(plan, &publication, checksums, page))?;
    let bag = if args.bag { Some(wrap(plan, &publication, &say)?) } else { None };
    if args.site {
        kilwa_server::object::site::write(&plan.shelf, &plan.page)?;
    }
    bar.finish_and_clear();
    Ok(Report {
        object: object.display().to_string(),
        slug: plan.slug.to_string(),
        version: plan.version,
        published: plan.published.clone(),
        files,
        bytes: size,
        pack: publication.pack,
        bag,
        left_out,
        advice: plan.advice(),
    })
}

/// A line on standard error that says what is done, only where that is a terminal.
fn spinner() -> ProgressBar {
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

/// A version that differs in nothing is a mistake.
fn refuse_the_same(plan: &Plan, pack: &PackEntry) -> anyhow::Result<()> {
    let Some(last) = plan.before.as_ref().and_then(Manifest::current) else { return Ok(()) };
    let path = plan.object().join(&last.folder).join(kilwa_server::object::layout::METADATA);
    let written = std::fs::read(&path).ok().and_then(|b| serde_json::from_slice(&b).ok());
    if last.pack.sha256 == pack.sha256 && written.as_ref() == Some(&plan.metadata) {
        bail!(
            "{}: version {} has this very pack and metadata; there is nothing new to publish",
            plan.object().display(),
            last.version
        );
    }
    Ok(())
}

fn preview(pack: &Path, folder: &Path, left_out: &mut Vec<String>) -> anyhow::Result<Option<Preview>> {
    match extract::preview::write(pack, &folder.join(PREVIEW), PREVIEW_BYTES) {
        Ok(p) => Ok(Some(Preview { bytes: p.bytes, triangles: p.triangles, error: f64::from(p.error) })),
        Err(e) if e.chain().any(<dyn std::error::Error>::is::<std::io::Error>) => Err(e),
        Err(e) => {
            left_out.push(format!("{PREVIEW}: {}", e.root_cause()));
            Ok(None)
        }
    }
}

fn publication(plan: &Plan, pack: PackEntry, of_pack: kilwa_pack::Metadata, preview: Option<Preview>) -> Publication {
    let first = plan.before.as_ref().and_then(|m| m.versions.first());
    Publication {
        metadata: plan.metadata.clone(),
        rights: plan.rights.clone(),
        slug: plan.slug.clone(),
        version: plan.version,
        published: plan.published.clone(),
        first_published: first.map_or_else(|| plan.published.clone(), |v| v.published.clone()),
        note: plan.note.clone(),
        pack,
        figures: Figures {
            bounds: [of_pack.bounds_min, of_pack.bounds_max],
            crs: plan.crs.clone(),
            units: "m".to_owned(),
            source_units: of_pack.source_units.clone(),
            triangles: of_pack.triangles,
            vertices: of_pack.vertices,
            spacing: of_pack.median_edge,
            accuracy: plan.accuracy,
        },
        of_pack,
        location_redacted: plan.place.is_some(),
        preview,
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
    }
}

fn manifest(plan: &Plan, p: &Publication, checksums: FileEntry, page: FileEntry) -> Manifest {
    let m = &p.metadata;
    let mut versions = plan.before.as_ref().map(|b| b.versions.clone()).unwrap_or_default();
    versions.push(Version {
        version: p.version,
        folder: version_folder(p.version),
        published: p.published.clone(),
        note: p.note.clone(),
        pack: p.pack.clone(),
        checksums,
        figures: p.figures.clone(),
        location_redacted: p.location_redacted,
    });
    let access = m.access.as_ref();
    Manifest {
        kilwa: FORM,
        slug: p.slug.to_string(),
        title: m.title.clone(),
        description: m.description.clone(),
        language: m.language.clone(),
        place: p.place(),
        captured: m.capture.as_ref().and_then(|c| c.date.clone()),
        subjects: m.subjects.clone(),
        creators: m.creators.iter().map(|a| a.name.clone()).collect(),
        url: m.url.clone(),
        identifier: m.identifier.clone(),
        rights: RightsEntry {
            uri: p.rights.uri.clone(),
            label: p.rights.label.clone(),
            short: p.rights.short.clone(),
            holder: m.rights.holder.clone(),
        },
        citation: citation(p),
        access: Access {
            state: access.map_or(AccessState::Public, |a| a.state),
            until: access.and_then(|a| a.until.clone()),
            reason: access.and_then(|a| a.reason.clone()),
            contact: access.and_then(|a| a.contact.clone()),
            withdrawn: None,
        },
        current: p.version,
        versions,
        page,
        tool: p.tool.clone(),
    }
}

fn wrap(plan: &Plan, p: &Publication, steps: kilwa_server::object::draft::Steps<'_>) -> anyhow::Result<String> {
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
    let bag = bag::wrap(&plan.shelf, &plan.slug, &info, steps)
        .context("the object is published; its bag could not be made")?;
    Ok(bag.display().to_string())
}
