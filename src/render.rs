//! `kilwa render`.

/// Draw a picture without a window.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    todo!()
}
