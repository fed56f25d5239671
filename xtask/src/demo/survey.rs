//! The whole pipeline, from scans and photographs to the pack: mask, register, merge, colour, and a report of the survey.

use super::{remove, remove_all, run_kilwa, timed};
use crate::process::{command, run_to};
use anyhow::Result;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The size of the simulated survey.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Survey {
    pub(super) stations: u32,
    /// Columns of a scan.
    pub(super) columns: u32,
    pub(super) photographs: u32,
    pub(super) panoramas: u32,
    /// Width and height of a photograph, pixels.
    pub(super) size: [u32; 2],
    /// Error of the poses of the photographs, pixels. If it is not 0, the poses are refined; small photographs have too little detail for that.
    pub(super) pose_error: u32,
}

/// Folder of the simulated photographs, with their ground truth.
const PICTURES: &str = "photographs";

/// The photographs of the survey in `folder`.
pub(super) fn photographs(folder: &Path) -> PathBuf {
    folder.join(PICTURES).join("photos")
}

/// The report on the colours of the survey in `folder`.
pub(super) fn colour_report(folder: &Path) -> PathBuf {
    folder.join("colour.json")
}

/// Simulates the survey in `folder` and makes `pack` from it. Only the first station has its true pose. Leaves the survey (with all samples), the photographs and
/// the reports beside the pack.
pub(super) fn make(
    times: &mut Vec<(&'static str, Duration)>,
    kilwa: &Path,
    folder: &Path,
    pack: &Path,
    made: Survey,
) -> Result<()> {
    let [scans, pictures, survey, merged] = ["scans", PICTURES, "survey", "merged.kilwa"].map(|name| folder.join(name));
    let [registered, merge, report] = ["registration.html", "merge.json", "report.html"].map(|name| folder.join(name));
    let colour = colour_report(folder);
    for file in [&merged, &registered, &merge, &colour, &report] {
        remove(file)?;
    }
    remove_all(&pictures)?;
    let Survey { stations, columns, photographs: count, panoramas, size: [width, height], pose_error } = made;
    let [stations, columns, count, panoramas, error] =
        [stations, columns, count, panoramas, pose_error].map(|n| n.to_string());
    let synth = ["synth", "scans", "--poses", "rough", "--surveyed", "1"];
    let args = [&synth[..], &["--stations", &stations, "--columns", &columns, "-o"]].concat();
    timed(times, "scan", || run_kilwa(kilwa, &args, &[&scans]))?;
    let size = format!("{width}x{height}");
    let synth = ["synth", "photos", "--photos", &count, "--panoramas", &panoramas];
    let args = [&synth[..], &["--size", &size, "--pose-error", &error, "-o"]].concat();
    timed(times, "photograph", || run_kilwa(kilwa, &args, &[&pictures]))?;
    timed(times, "import", || run_kilwa(kilwa, &["scans", "import", "-o"], &[&survey, &scans]))?;
    // The survey contains every sample of the scans.
    remove_all(&scans)?;
    timed(times, "mask mixed pixels", || run_kilwa(kilwa, &["scans", "mask", "--mixed"], &[&survey]))?;
    let args = ["register", "--fixed", "scan_001", "--report"];
    timed(times, "register", || run_kilwa(kilwa, &args, &[&registered, &survey]))?;
    // Needs the poses of the other stations.
    timed(times, "mask what moved", || run_kilwa(kilwa, &["scans", "mask", "--seen-through"], &[&survey]))?;
    timed(times, "merge", || {
        let mut command = command(&kilwa.to_string_lossy(), &["merge", "--fill", "coarser", "--json", "-o"])?;
        run_to(command.args([&merged, &survey]), &merge)
    })?;
    let refine: &[&str] = if pose_error > 0 { &["--refine"] } else { &[] };
    timed(times, "colour", || {
        let mut command = command(&kilwa.to_string_lossy(), &["colour"])?;
        command.args(refine).args([&survey, &merged]);
        command.arg("--photos").arg(photographs(folder)).arg("--report").arg(&colour);
        crate::process::run(command.arg("-o").arg(pack))
    })?;
    remove(&merged)?;
    timed(times, "report", || {
        let mut command = command(&kilwa.to_string_lossy(), &["scans", "report"])?;
        command.arg(&survey).arg("--merge").arg(&merge).arg("--colour").arg(&colour);
        crate::process::run(command.arg("-o").arg(&report))
    })
}
