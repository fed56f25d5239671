//! `kilwa scans`: a survey of scans, from the files of scanners to stations that can be seen.

pub(crate) mod export;
mod import;
mod list;
pub(crate) mod mask;
pub(crate) mod photos;
mod report;
mod view;

use clap::Subcommand;

/// Import laser scans into a survey, view them, mask what is not part of the site, and mesh them.
///
/// A survey is a folder: survey.toml, which you may edit, and a binary file for each station.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    Import(import::Args),
    List(list::Args),
    Mask(Box<mask::Args>),
    View(view::Args),
    Photos(photos::Args),
    Report(report::Args),
    Export(Box<export::Args>),
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
        What::Import(args) => import::run(args),
        What::List(args) => list::run(args),
        What::Mask(args) => mask::run(args),
        What::View(args) => view::run(args),
        What::Photos(args) => photos::run(args),
        What::Report(args) => report::run(args),
        What::Export(args) => export::run(args),
    }
}
