//! `kilwa publish --to s3://bucket/prefix`: made here as for a folder, then sent to a store, manifest last.

use super::plan::{Given, Plan};
use super::progress::{Progress, Stage};
use super::{Args, mapping, write};
use anyhow::{Context, anyhow, ensure};
use kilwa_server::store::{S3, S3Options};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// A part of a pack may take so long on a slow line.
const PATIENCE: Duration = Duration::from_secs(600);

/// The address of a store that `--to` names, where it names one.
pub(super) fn address(args: &Args) -> Option<&str> {
    args.to.to_str().filter(|to| to.starts_with("s3://"))
}

pub(super) fn run(args: &Args, address: &str) -> anyhow::Result<()> {
    for (given, what) in [
        (args.site, "--site"),
        (args.bag, "--bag"),
        (args.withdraw.is_some(), "--withdraw"),
        (args.token_file.is_some(), "--token-file"),
        (args.allow_http, "--allow-http"),
    ] {
        ensure!(
            !given,
            "{what} is not for stores: keys come from AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, and the rest is for folders"
        );
    }
    let given = Given::read(args)?;
    let slug = given.slug.clone();
    let mut options = S3Options::from_environment(address);
    options.endpoint.clone_from(&args.s3_endpoint);
    options.timeout = PATIENCE;
    options.retries = 5;
    let store = S3::open(&options)?;
    let at = format!("{}/{slug}", store.name());
    let shelf = crate::new_file::private_folder("kilwa-publish-").context("cannot make a temporary folder")?;
    let against = store.fetch(&slug, shelf.path()).with_context(|| at.clone())?;
    let here = Args { to: shelf.path().to_owned(), ..args.clone() };
    // Nobody knows the folder that it is made in.
    let in_words = |e: anyhow::Error| anyhow!(format!("{e:#}").replace(&*shelf.path().to_string_lossy(), store.name()));
    let mut plan = Plan::for_folder(&here).map_err(in_words)?;
    plan.at.clone_from(&at);
    if args.dry_run {
        plan.given.prepare_photographs()?;
        return mapping::print(&here, &plan);
    }
    let mut stages = write::stages(&here, &plan);
    stages.push(Stage::Send);
    let progress = Progress::new(&stages, plan.given.lengths());
    let mut report = write::run(&here, &mut plan, &progress).map_err(in_words)?;
    report.object = format!("{at}/");
    if report.already {
        progress.end();
        return super::say(args, &report);
    }
    progress.begin(Stage::Send);
    // A file is counted when the next one begins.
    let (before, all) = (AtomicU64::new(0), report.bytes);
    let on_send = |key: &str| {
        progress.more(before.load(Ordering::Relaxed), all);
        let file = key.strip_prefix(&format!("{slug}/")).map(|name| shelf.path().join(slug.as_str()).join(name));
        before.store(file.and_then(|file| file.metadata().ok()).map_or(0, |m| m.len()), Ordering::Relaxed);
    };
    store
        .send(&slug, shelf.path(), report.version, &against, &on_send)
        .with_context(|| format!("{at}: not published; what was sent is kept, and the same command continues"))?;
    progress.end();
    super::say(args, &report)
}
