//! `kilwa extract`.

/// Give the mesh back from a pack.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    todo!()
}
