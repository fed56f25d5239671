//! `kilwa measure`.

/// Measure on the finest surface.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    todo!()
}
