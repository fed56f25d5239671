//! `kilwa info`.

/// Say what a pack is.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    todo!()
}
