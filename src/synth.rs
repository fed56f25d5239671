//! `kilwa synth`.

/// Make a synthetic site.
#[derive(clap::Args)]
pub(crate) struct Args {}

pub(crate) fn run(_args: &Args) -> anyhow::Result<()> {
    todo!()
}
