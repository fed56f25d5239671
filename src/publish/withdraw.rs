//! `kilwa publish --withdraw`: the files go to a folder outside, a tombstone stays.

use super::Args;
use super::write::{locked, spinner};
use anyhow::{Context, bail, ensure};
use kilwa_server::object::Slug;
use kilwa_server::object::location::Location;
use kilwa_server::object::site;
use kilwa_server::object::withdraw::{Outlook, Withdrawal, outlook, withdraw};
use std::io::Write as _;
use std::path::Path;

pub(super) fn run(args: &Args, slug: &str) -> anyhow::Result<()> {
    let slug = Slug::new(slug)?;
    let keep = args.keep.as_ref().context("say with --keep where the files go")?;
    let reason = args.reason.as_deref().map(str::trim).filter(|r| !r.is_empty());
    let reason = reason.context("say with --reason why it is withdrawn")?;
    let day = match &args.date {
        Some(day) => day.clone(),
        None => super::today()?,
    };
    let absolute = |p: &std::path::Path| std::path::absolute(p).with_context(|| p.display().to_string());
    ensure!(
        !absolute(keep)?.starts_with(absolute(&args.to)?),
        "{} is in {}, from where a web server would go on serving the files; give a folder outside with --keep",
        keep.display(),
        args.to.display()
    );
    if !args.to.join(slug.as_str()).is_dir() {
        bail!("there is no {} in {}", slug, args.to.display());
    }
    checked_reason(args, &slug, reason)?;
    if args.dry_run {
        return say_outlook(args, &slug, keep, &ready(args, &slug)?);
    }
    let page = args.site.then(|| kilwa_server::Page::load(args.www.as_deref())).transpose()?;
    let lock = locked(&args.to, &spinner())?;
    let write_site = || page.as_ref().map_or(Ok(()), |page| site::write(&lock, page, &|_| Ok(())));
    // Whether anything is left to do is known when nobody else does it.
    if let Err(done) = ready(args, &slug) {
        write_site()?;
        return Err(done);
    }
    let kept = withdraw(&lock, &slug, &Withdrawal { reason, day: &day, keep }, &|_| Ok(()))?;
    write_site()?;
    let mut out = crate::terminal::out();
    if args.json {
        let report = serde_json::json!({ "withdrawn": slug.as_str(), "kept": kept.display().to_string(), "date": day });
        writeln!(out, "{report:#}")?;
    } else {
        writeln!(out, "{}/{slug}: withdrawn; its files are in {}", args.to.display(), kept.display())?;
    }
    Ok(())
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
    let is_done = there.going.0 == 0 && !there.bag;
    if let Some(day) = there.withdrawn.as_ref().filter(|_| is_done) {
        bail!("{}/{slug} was withdrawn on {day} already; nothing was changed", args.to.display());
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
        "Would withdraw {}/{slug}, \"{}\": {files} files, {}{bag}, would leave it for {}; metadata, citations and a page with the reason would stay.\nNothing was written.",
        args.to.display(),
        there.title,
        super::plan::human(bytes),
        keep.join(slug.as_str()).display()
    )?)
}
