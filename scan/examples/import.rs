//! Imports files into a survey, as `kilwa scans import` does, without the rest of the program, which takes a long time to compile: `import SURVEY FILES…`.
//! For `cargo xtask bench scans --library` and for profiles.

use kilwa_scan::import::{Options, Silent, import};
use std::path::PathBuf;

fn main() -> Result<(), kilwa_scan::ScanError> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    let [survey, files @ ..] = &paths[..] else {
        return Err(kilwa_scan::ScanError::Request("give a survey and files".to_owned()));
    };
    let report = import(survey, files, &Options::default(), &Silent)?;
    println!("{} stations", report.stations.len());
    Ok(())
}
