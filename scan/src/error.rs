//! What can go wrong with scans and surveys. Every text names the file, the place, what was found and what was expected.

use kilwa_formats::read::{Place, ReadError};
use kilwa_toml::Problems;
use std::io;
use std::path::{Path, PathBuf};

/// Why a scan or a survey was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ScanError {
    /// A file cannot be opened or read, or is malformed.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The file is of a format that is not read.
    #[error("{} is {what}; scans are read from PTX, PTS, E57, LAS, LAZ, PLY and XYZ text. {way_out}", file.display())]
    Format {
        /// The file.
        file: PathBuf,
        /// What it is.
        what: String,
        /// What to do.
        way_out: &'static str,
    },
    /// A cloud without a grid, whose station nobody gave.
    #[error("{} is an unstructured point cloud without a scanner position, so it is unknown where its points were seen from; give the position with --station X,Y,Z", file.display())]
    NoStation {
        /// The file.
        file: PathBuf,
    },
    /// The file is sound but holds nothing to import.
    #[error("{}: {what}", file.display())]
    Nothing {
        /// The file.
        file: PathBuf,
        /// What was found.
        what: String,
    },
    /// A spool of the survey is damaged.
    #[error("{}: {what}; import this station again", file.display())]
    Spool {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A mask is damaged, missing, or of another scan.
    #[error("{}: {what}; make the mask {mask} again with `kilwa scans mask`, or turn it off with `kilwa scans mask SURVEY --off {mask}`", file.display())]
    Mask {
        /// The file.
        file: PathBuf,
        /// The name of the mask.
        mask: String,
        /// What is wrong with it.
        what: String,
    },
    /// `survey.toml` is wrong; every mistake is named.
    #[error("{}:\n  {problems}", file.display())]
    Survey {
        /// The file.
        file: PathBuf,
        /// The mistakes.
        problems: Problems,
    },
    /// Something cannot be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// What.
        path: PathBuf,
        /// Why the system refused.
        source: io::Error,
    },
    /// A scratch file cannot be written or read.
    #[error("the scratch file in {} could not be written or read; if the disk is full, choose a folder on a larger disk with --scratch{way_out}", folder.display())]
    Scratch {
        /// Where it is.
        folder: PathBuf,
        /// What else helps, as the end of the sentence.
        way_out: &'static str,
        /// What the system says.
        source: io::Error,
    },
    /// A pack cannot be read.
    #[error("the model cannot be read")]
    Model {
        /// What is wrong with it.
        source: kilwa_pack::PackError,
    },
    /// The request cannot be met.
    #[error("{0}")]
    Request(String),
    /// The user stopped it.
    #[error("stopped")]
    Stopped,
}

impl ScanError {
    /// The error for something found in a file.
    pub(crate) fn malformed(file: &Path, place: Place, found: impl Into<String>, expected: impl Into<String>) -> Self {
        ReadError::Malformed { file: file.to_owned(), place, found: found.into(), expected: expected.into() }.into()
    }

    pub(crate) fn write(path: &Path) -> impl FnOnce(io::Error) -> Self + '_ {
        |source| Self::Write { path: path.to_owned(), source }
    }
}
