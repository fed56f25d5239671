//! `cargo xtask screens`: the pictures of docs/screens, of the page as it is now, for a person to look at.

use crate::process::{command, compile_kilwa, root, run as run_command};
use crate::{setup, web};
use anyhow::Result;
use std::path::PathBuf;

/// Take the pictures of the viewer in docs/screens again: every shading, panel, dialog and trouble, at both sizes, in both themes.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// Where they go, in place of docs/screens.
    #[arg(long)]
    to: Option<PathBuf>,
    /// Only those that are not there.
    #[arg(long)]
    missing: bool,
    /// Beginnings of the names of those to take: `mode-`, `note`, `help-phone`. All where none is given (half an hour without a graphics card).
    names: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    web::run(&web::Args::default())?;
    let program = compile_kilwa("dev")?;
    let tests = setup::npm_packages("tests/browser")?;
    let mut node = command("node", &["screens.mjs"])?;
    node.current_dir(&tests).env("KILWA", program).env("CHROMIUM", setup::chromium()?);
    if let Some(to) = &args.to {
        node.arg("--to").arg(std::path::absolute(to)?);
    }
    if args.missing {
        node.arg("--missing");
    }
    run_command(node.args(&args.names))?;
    println!("screens: look at them in {}", args.to.clone().unwrap_or(root()?.join("docs/screens")).display());
    Ok(())
}
