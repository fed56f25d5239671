//! `--holes FILE`: the list of holes that `kilwa merge --holes` wrote, read and checked before anything is written, then put into the version.
//!
//! Rims are at coordinates of the pack that was given; where its location is removed, they are moved with it. A list belongs to one surface,
//! so a new version has a list only if one is given for it.

use super::plan::{Given, Plan};
use crate::redact::TakenOut;
use anyhow::{Context, ensure};
use kilwa_archive::Holes;
use kilwa_archive::holes::HOLES_READ_MAX;
use kilwa_files::plain_file;
use std::io::Read as _;
use std::path::Path;

pub(super) fn read(file: &Path) -> anyhow::Result<Holes> {
    let mut bytes = Vec::new();
    plain_file::open(file)
        .and_then(|f| f.take(HOLES_READ_MAX + 1).read_to_end(&mut bytes))
        .with_context(|| format!("cannot read the list of holes {}", file.display()))?;
    ensure!(
        bytes.len() as u64 <= HOLES_READ_MAX,
        "{}: longer than {HOLES_READ_MAX} bytes, the maximum for a list of holes; it is sorted by area, so remove holes from its end, or merge with larger voxels",
        file.display()
    );
    Holes::parse(&bytes).with_context(|| format!("{} cannot be used", file.display()))
}

/// Check the list against the pack.
pub(super) fn check(file: Option<&Path>, given: &Given) -> anyhow::Result<()> {
    let Some(holes) = &given.holes else { return Ok(()) };
    let in_list = || file.map(|f| f.display().to_string()).unwrap_or_default();
    let pack = &given.of_pack;
    holes.same_system(pack.crs.as_deref()).with_context(in_list)?;
    holes.within(pack.bounds_min, pack.bounds_max).with_context(in_list)?;
    holes.to_bytes().with_context(in_list)?;
    Ok(())
}

/// As it is published with a pack of this box.
pub(super) fn published(
    plan: &Plan,
    taken: Option<&TakenOut>,
    of_pack: &kilwa_pack::Metadata,
) -> anyhow::Result<Option<Vec<u8>>> {
    let Some(holes) = &plan.given.holes else { return Ok(None) };
    let holes = match taken {
        Some(taken) => holes.clone().without_place(taken.offset),
        None => holes.clone(),
    };
    holes.within(of_pack.bounds_min, of_pack.bounds_max).context("the holes, without their location")?;
    Ok(Some(holes.to_bytes()?))
}
