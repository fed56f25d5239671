//! Files that sections, profiles and contours are written to.

use super::Subject;
use super::saved::write_whole;
use crate::new_file::check_output;
use kilwa_files::atomic::folder_of;
use kilwa_measure::job::pack_name;
use kilwa_measure::{Format, Leaves, Outcome};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Where a drawing goes.
#[derive(clap::Args)]
pub(crate) struct OutputArgs {
    /// The file to write; its extension chooses the format: .svg, .dxf, .csv, .json or .geojson.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Scale of the drawing on paper, for example 1:50.
    #[arg(long, default_value = "1:50", value_parser = scale)]
    scale: f64,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
}

fn scale(text: &str) -> Result<f64, String> {
    let number = text.strip_prefix("1:").unwrap_or(text).parse::<f64>();
    match number {
        Ok(n) if n.is_finite() && (0.001..=1e7).contains(&n) => Ok(n),
        _ => Err("expected a scale such as 1:50".to_owned()),
    }
}

impl OutputArgs {
    /// Report what would prevent writing, before the work is done.
    pub(super) fn check(&self, pack: &Path) -> anyhow::Result<()> {
        let Some(path) = &self.output else { return Ok(()) };
        Self::format(path)?;
        check_output(path, self.force, [pack])
    }

    /// Refuse to write over the document to which the measurement is saved.
    pub(super) fn refuse_document(&self, document: &Path) -> anyhow::Result<()> {
        let Some(path) = &self.output else { return Ok(()) };
        let real = |path: &Path| {
            let whole = || Some(folder_of(path).canonicalize().ok()?.join(path.file_name()?));
            path.canonicalize().ok().or_else(whole)
        };
        let is_file = |a: &Path, b: &Path| {
            let (a, b) = (std::fs::metadata(a).ok()?, std::fs::metadata(b).ok()?);
            Some(kilwa_files::plain_file::is_same_file(&a, &b))
        };
        let is_same =
            is_file(path, document).unwrap_or(false) || real(path).is_some_and(|path| real(document) == Some(path));
        anyhow::ensure!(!is_same, "-o and --save both name {}; choose another file for -o", path.display());
        Ok(())
    }

    /// Write the lines, where a file was asked for; `output` of the details says where.
    pub(super) fn write(&self, s: &Subject, outcome: &mut Outcome) -> anyhow::Result<()> {
        let (Some(path), Some(lines)) = (&self.output, &outcome.lines) else { return Ok(()) };
        let text = lines.write(Self::format(path)?, &pack_name(s.leaves.index()), &s.point, self.scale);
        let text = text.ok_or_else(|| anyhow::anyhow!("nothing to draw"))?;
        write_whole(path, &text, self.force)?;
        outcome.add("output", json!(path.display().to_string()));
        Ok(())
    }

    fn format(path: &Path) -> anyhow::Result<Format> {
        let ending = path.extension().and_then(|e| e.to_str());
        ending.and_then(Format::from_ending).ok_or_else(|| {
            anyhow::anyhow!("{}: the file extension must be .svg, .dxf, .csv, .json or .geojson", path.display())
        })
    }
}
