//! `kilwa publish --withdraw`: the files go to a folder outside, a tombstone stays.

use super::Args;
use super::progress::Progress;
use super::write::waits;
use anyhow::{Context, anyhow, bail};
use kilwa_archive::Slug;
use kilwa_archive::keep::{Folders, check_outside};
use kilwa_archive::location::Location;
use kilwa_archive::site::{self, Listed};
use kilwa_archive::withdraw::{Outlook, Withdrawal, Withdrawn, outlook, withdraw};
use kilwa_pack::plural::counted;
use std::io::Write as _;
use std::path::Path;

pub(super) fn run(args: &Args, slug: &str) -> anyhow::Result<()> {
    let slug = Slug::new(slug)?;
    let keep = args.keep.as_ref().context("state with --keep where to move the files")?;
    let reason = args.reason.as_deref().map(str::trim).filter(|r| !r.is_empty());
    let reason = reason.context("state with --reason why it is withdrawn")?;
    let day = match &args.date {
        Some(day) => day.clone(),
        None => super::today()?,
    };
    if !args.to.join(slug.as_str()).is_dir() {
        bail!("there is no {} in {}", slug, args.to.display());
    }
    check_outside(&args.to, keep)?;
    checked_reason(args, &slug, reason)?;
    if args.dry_run {
        return say_outlook(args, &slug, keep, &ready(args, &slug)?);
    }
    // Pages that list the object must not go on listing it, whether or not --site was given.
    let page = || {
        let has_pages = args.site || site::lists(&args.to, &slug, true);
        has_pages.then(|| kilwa_server::Page::load(args.www.as_deref())).transpose()
    };
    let check_site = || if args.site { site::check(&args.to) } else { Ok(()) };
    // Checked before anything is created, and again under the lock, when nobody else can change it.
    check_site()?;
    page()?;
    let folders = Folders::lock(&args.to, keep, &slug, &waits(&Progress::new(&[], 0)), &|_| Ok(()))?;
    check_site()?;
    let page = page()?;
    let done = withdraw(&folders, &slug, &Withdrawal { reason, day: &day }, &|_| Ok(()))?;
    if done.before && !done.changed && page.is_none() {
        return Err(nothing_left(args, &slug, &done.day));
    }
    if let Some(page) = &page {
        let listed = if args.site { Listed::All } else { Listed::AsBefore };
        let written = site::write(folders.shelf(), page, listed, &|_| Ok(()));
        written.map_err(|e| e.after("the object is withdrawn, but the pages of the folder were not written"))?;
    }
    say_done(args, &slug, &done, page.is_some())
}

/// Nothing was left to do.
fn nothing_left(args: &Args, slug: &Slug, day: &str) -> anyhow::Error {
    anyhow!("{}/{slug} was already withdrawn on {day}; nothing was changed", args.to.display())
}

/// What was done, which may be what an earlier command did not come to.
fn say_done(args: &Args, slug: &Slug, done: &Withdrawn, has_pages: bool) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let Withdrawn { kept, day, before, changed } = done;
    let kept = kept.display().to_string();
    if args.json {
        let report = serde_json::json!({ "withdrawn": slug.as_str(), "kept": kept, "date": day, "already": before, "pages": has_pages });
        return Ok(writeln!(out, "{report:#}")?);
    }
    let at = args.to.display();
    if !before {
        let pages = if has_pages { "; the pages of the folder were written" } else { "" };
        return Ok(writeln!(out, "{at}/{slug}: withdrawn; its files are in {kept}{pages}")?);
    }
    let now = [
        changed.then_some("leftovers of an interrupted command were removed"),
        has_pages.then_some("the pages of the folder were written"),
    ];
    let now: Vec<&str> = now.into_iter().flatten().collect();
    Ok(writeln!(out, "{at}/{slug}: was already withdrawn on {day}; {}", now.join(", and "))?)
}

/// The reason is published: of an object whose place is withheld it states none.
fn checked_reason(args: &Args, slug: &Slug, reason: &str) -> anyhow::Result<()> {
    if !outlook(&args.to, slug)?.is_withheld {
        return Ok(());
    }
    // The true place is not known any more: what has the form of a coordinate is refused.
    match Location::unknown().find(reason) {
        Some(finding) => bail!("--reason: {finding}; nothing was changed"),
        None => Ok(()),
    }
}

/// What is left to be done, which must be something.
fn ready(args: &Args, slug: &Slug) -> anyhow::Result<Outlook> {
    let there = outlook(&args.to, slug)?;
    let has_pages = args.site || site::lists(&args.to, slug, true);
    if let Some(day) = there.withdrawn.as_ref().filter(|_| there.is_done() && !has_pages) {
        return Err(nothing_left(args, slug, day));
    }
    Ok(there)
}

/// What would be done.
fn say_outlook(args: &Args, slug: &Slug, keep: &Path, there: &Outlook) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let (files, bytes) = there.going;
    if args.json {
        let report = serde_json::json!({ "would_withdraw": slug.as_str(), "title": there.title, "files": files, "bytes": bytes, "bag": there.bag, "keep": keep.display().to_string() });
        return Ok(writeln!(out, "{report:#}")?);
    }
    let bag = if there.bag { ", and its bag" } else { "" };
    Ok(writeln!(
        out,
        "Would withdraw {}/{slug}, \"{}\": {}, {}{bag}, would be moved to {}; metadata, citations and a page with the reason would stay.\nNothing was written.",
        args.to.display(),
        there.title,
        counted(files, "file", "files"),
        kilwa_files::size::text(bytes),
        keep.join(slug.as_str()).display()
    )?)
}
