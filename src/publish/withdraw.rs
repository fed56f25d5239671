//! `kilwa publish --withdraw`: the files go to a folder outside, a tombstone stays.

use super::Args;
use anyhow::{Context, bail, ensure};
use kilwa_server::object::Slug;
use kilwa_server::object::draft::Lock;
use kilwa_server::object::withdraw::withdraw;
use std::io::Write as _;

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
    let _lock = Lock::take(&args.to)?;
    std::fs::create_dir_all(keep).with_context(|| format!("cannot make the folder {}", keep.display()))?;
    let kept = withdraw(&args.to, &slug, reason, &day, keep, &|_| Ok(()))?;
    if args.site {
        kilwa_server::object::site::write(&args.to, &kilwa_server::Page::load(args.www.as_deref())?)?;
    }
    let mut out = std::io::stdout().lock();
    if args.json {
        let report = serde_json::json!({ "withdrawn": slug.as_str(), "kept": kept.display().to_string(), "date": day });
        writeln!(out, "{report:#}")?;
    } else {
        writeln!(out, "{}/{slug}: withdrawn; its files are in {}", args.to.display(), kept.display())?;
    }
    Ok(())
}
