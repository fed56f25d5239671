//! `--colour-report FILE` and `--photos DIR`: the report that `kilwa colour --report` wrote, and the photographs that the colours come from, become part of
//! the version: `colour-report.json` and `photographs/`.
//!
//! [`Colours::read`] checks the report against the pack and finds the photographs by name and length; [`Colours::verify`] compares their bytes with the
//! report; both happen before anything is written. Photographs are copied byte for byte, with what they state about themselves (EXIF), so neither is
//! published without the location of the model. Only photographs that a colour comes from are included, with their masks.

use super::plan::Given;
use super::progress::{Progress, Stage};
use super::write::copy;
use super::{Args, copies};
use crate::new_file::PrivateFolder;
use anyhow::{Context, bail, ensure};
use kilwa_archive::checksums::{Checksum, sha256_of};
use kilwa_archive::colour_report::{COLOUR_REPORT_READ_MAX, PHOTOGRAPH_MAX, Paths, Photograph};
use kilwa_archive::draft::Draft;
use kilwa_archive::metadata::PhotographsField;
use kilwa_archive::record::Included;
use kilwa_archive::rights::{CHOICES, Rights};
use kilwa_archive::{ColourReport, Manifest, Metadata};
use kilwa_files::{plain_file, size};
use kilwa_pack::plural::{counted, plural};
use kilwa_pack::visible::visible;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

/// Most photographs that a message lists.
const LISTED: usize = 10;

/// The report, as it is published, and the photographs.
pub(super) struct Colours {
    /// Bytes of `colour-report.json`.
    pub(super) bytes: Vec<u8>,
    pub(super) report: ColourReport,
    /// Photographs, masks and smaller copies that the version includes, each once.
    pub(super) files: Vec<Found>,
    /// Their number and length.
    pub(super) included: Option<Included>,
    /// Their paths in the version.
    pub(super) paths: Paths,
    /// Short name of their rights.
    rights: String,
    /// Values that are probably mistakes.
    pub(super) warnings: Vec<String>,
    /// Where the smaller copies are.
    copies: Option<PrivateFolder>,
}

/// A photograph, a mask or a smaller copy on this computer.
pub(super) struct Found {
    pub(super) from: PathBuf,
    /// Its path in the version.
    pub(super) path: String,
    pub(super) bytes: u64,
    pub(super) sha256: Checksum,
}

impl Colours {
    /// Read and check what `--colour-report` and `--photos` name. `file` is the metadata file, for messages.
    ///
    /// # Errors
    /// What is wrong, and what to do.
    pub(super) fn read(
        args: &Args,
        metadata: &Metadata,
        of_pack: &kilwa_pack::Metadata,
        file: &Path,
    ) -> anyhow::Result<Option<Self>> {
        let Some(path) = &args.colour_report else { return Ok(None) };
        ensure!(
            args.redact_location.is_none(),
            "--redact-location: the positions of cameras in a colour report, and what photographs state and show, can reveal the location, so neither can be published without it; omit --colour-report and --photos"
        );
        let in_report = || path.display().to_string();
        let mut report = read_report(path)?;
        let mut warnings = report.same_photographs(&of_pack.sources).with_context(in_report)?;
        let (mut files, mut paths, mut rights) = (Vec::new(), Paths::default(), String::new());
        if let Some(folder) = &args.photos {
            rights = required_rights(metadata.photographs.as_ref(), file)?;
            (files, paths) = find(folder, &mut report)?;
            warnings.extend(positions(&files, metadata, of_pack));
        } else {
            without_paths(&mut report);
        }
        let bytes = report.to_bytes().with_context(in_report)?;
        let included = Included::of(&report);
        Ok(Some(Self { bytes, report, files, included, paths, rights, warnings, copies: None }))
    }

    /// Add smaller copies, which the report names already, from a folder.
    pub(super) fn add(&mut self, copies: Vec<Found>, folder: PrivateFolder) -> anyhow::Result<()> {
        let mut paths: BTreeSet<String> = self.files.iter().map(|file| file.path.clone()).collect();
        self.files.extend(copies.into_iter().filter(|copy| paths.insert(copy.path.clone())));
        self.bytes = self.report.to_bytes().context("cannot add the smaller copies to the colour report")?;
        self.included = Included::of(&self.report);
        self.copies = Some(folder);
        Ok(())
    }

    /// Compare the bytes of every file with the report. Calls `on_read` with the number of bytes that were read.
    ///
    /// # Errors
    /// Names those that differ.
    pub(super) fn verify(&self, on_read: &dyn Fn(u64)) -> anyhow::Result<()> {
        let mut changed = Vec::new();
        for file in &self.files {
            let opened = plain_file::open(&file.from).map(|file| Counting { file, on_read });
            let (_, sum) = opened
                .and_then(|file| sha256_of(BufReader::with_capacity(1 << 20, file)))
                .with_context(|| format!("cannot read {}", file.from.display()))?;
            if sum != file.sha256 {
                changed.push(file.from.display().to_string());
            }
        }
        refuse(&[], &changed)
    }

    /// Bytes of all files that are included.
    pub(super) fn length(&self) -> u64 {
        self.included.map_or(0, |included| included.all_bytes())
    }

    /// What is included, in words.
    pub(super) fn summary(&self) -> Option<String> {
        let included = self.included?;
        let masks = in_words(included.masks);
        let photographs = counted(included.photographs, "photograph", "photographs");
        let copies = match included.copies {
            0 => String::new(),
            n => format!(
                "; {} for the page, {}",
                counted(n, "smaller copy", "smaller copies"),
                size::text(included.copy_bytes)
            ),
        };
        Some(format!("{photographs}{masks}, {} ({}){copies}", size::text(included.bytes), self.rights))
    }

    /// The report, in words.
    pub(super) fn report_in_words(&self) -> String {
        let (used, left_out) = (self.report.photographs.len(), self.report.left_out.len());
        let left_out = if left_out > 0 { format!(", {left_out} left out") } else { String::new() };
        format!("{}{left_out}", counted(used, "photograph", "photographs"))
    }
}

/// What a version includes, for the report of the command.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct ColourFiles {
    /// Whether it has a colour report.
    pub(super) colour_report: bool,
    pub(super) photographs: u64,
    pub(super) masks: u64,
    /// Bytes of photographs and masks.
    pub(super) photograph_bytes: u64,
    /// Smaller copies of photographs, for the page.
    pub(super) photograph_copies: u64,
    pub(super) photograph_copy_bytes: u64,
}

impl ColourFiles {
    pub(super) fn of(given: &Given) -> Self {
        let Some(colours) = &given.colours else { return Self::default() };
        let none = Self { colour_report: true, ..Self::default() };
        colours.included.map_or(none, |included| Self {
            photographs: included.photographs,
            masks: included.masks,
            photograph_bytes: included.bytes,
            photograph_copies: included.copies,
            photograph_copy_bytes: included.copy_bytes,
            ..none
        })
    }

    /// Print it, if there is anything.
    pub(super) fn print(&self, out: &mut impl Write) -> std::io::Result<()> {
        if self.colour_report {
            writeln!(out, "  with the colour report")?;
        }
        if self.photographs > 0 {
            let masks = in_words(self.masks);
            let photographs = counted(self.photographs, "photograph", "photographs");
            writeln!(out, "  with {photographs}{masks}, {}", size::text(self.photograph_bytes))?;
        }
        if self.photograph_copies > 0 {
            let copies = counted(self.photograph_copies, "smaller copy", "smaller copies");
            writeln!(out, "  with {copies} of them for the page, {}", size::text(self.photograph_copy_bytes))?;
        }
        Ok(())
    }
}

/// ` and 2 masks`, if there are any.
fn in_words(masks: u64) -> String {
    if masks > 0 { format!(" and {}", counted(masks, "mask", "masks")) } else { String::new() }
}

/// State what will be published, with its size, before anything is written.
pub(super) fn announce(given: &Given, progress: &Progress) {
    if let Some(summary) = given.colours.as_ref().and_then(Colours::summary) {
        progress.say(&format!("kilwa: also publishes {summary}"));
    }
}

/// Compare the photographs with the report, and make their smaller copies, with progress.
pub(super) fn prepare(given: &mut Given, progress: &Progress) -> anyhow::Result<()> {
    let Some(colours) = given.colours.as_mut().filter(|colours| !colours.files.is_empty()) else { return Ok(()) };
    progress.begin(Stage::CheckPhotographs);
    colours.verify(&|bytes| progress.more(bytes, colours.length()))?;
    copies::make(colours, progress)
}

/// Copy the photographs into the draft.
///
/// # Errors
/// If the disk refuses, or a photograph changes meanwhile.
pub(super) fn copy_into(given: &Given, draft: &mut Draft<'_>, progress: &Progress) -> anyhow::Result<()> {
    let Some(colours) = given.colours.as_ref().filter(|colours| !colours.files.is_empty()) else { return Ok(()) };
    progress.begin(Stage::Photographs);
    for file in &colours.files {
        let to = draft.folder().join(&file.path);
        if let Some(folder) = to.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
        }
        copy(&file.from, &to, progress, Some(colours.length()))?;
        let (bytes, sum) = draft.adopt(&file.path)?;
        ensure!(
            (bytes, &sum) == (file.bytes, &file.sha256),
            "{} changed while it was copied; nothing was published",
            file.from.display()
        );
    }
    Ok(())
}

/// A warning if the previous version has a colour report or photographs and this one does not.
pub(super) fn lost(given: &Given, before: Option<&Manifest>) -> Option<String> {
    let last = before.and_then(|m| m.versions.last())?;
    let included = given.colours.as_ref().and_then(|colours| colours.included);
    if last.photographs.is_some() && included.is_none() {
        return Some(
            "the previous version has photographs, and this one has none (--colour-report, --photos)".to_owned(),
        );
    }
    (last.colour_report.is_some() && given.colours.is_none())
        .then(|| "the previous version has a colour report, and this one has none (--colour-report)".to_owned())
}

/// Values that are probably mistakes.
pub(super) fn warnings(given: &Given) -> impl Iterator<Item = String> {
    given.colours.iter().flat_map(|colours| colours.warnings.iter().cloned())
}

fn read_report(path: &Path) -> anyhow::Result<ColourReport> {
    let mut bytes = Vec::new();
    plain_file::open(path)
        .and_then(|f| f.take(COLOUR_REPORT_READ_MAX + 1).read_to_end(&mut bytes))
        .with_context(|| format!("cannot read the colour report {}", path.display()))?;
    ensure!(
        bytes.len() as u64 <= COLOUR_REPORT_READ_MAX,
        "{}: longer than {COLOUR_REPORT_READ_MAX} bytes, the maximum for a colour report",
        path.display()
    );
    ColourReport::parse(&bytes).with_context(|| format!("{} cannot be used", path.display()))
}

/// The short name of the rights in the photographs, without which they are not published.
fn required_rights(field: Option<&PhotographsField>, file: &Path) -> anyhow::Result<String> {
    let field = field.with_context(|| {
        format!(
            "{}: photographs need a statement of rights of their own, which need not be that of the model; add a line [photographs] and below it rights = \"…\": {CHOICES}",
            file.display()
        )
    })?;
    Ok(Rights::parse(&field.rights).map_err(anyhow::Error::msg)?.short)
}

fn without_paths(report: &mut ColourReport) {
    for photo in &mut report.photographs {
        forget_paths(photo);
    }
}

/// Those of an earlier version, whose report was given.
fn forget_paths(photo: &mut Photograph) {
    (photo.path, photo.mask_path) = (None, None);
    (photo.preview, photo.thumbnail) = (None, None);
}

/// Find the photographs and masks that colours come from in a folder, and give them their paths in the version.
fn find(folder: &Path, report: &mut ColourReport) -> anyhow::Result<(Vec<Found>, Paths)> {
    ensure!(folder.is_dir(), "{} is not a folder; give the folder of the photographs with --photos", folder.display());
    let mut search = Search::default();
    walk(folder, &mut search.index).with_context(|| format!("cannot read {}", folder.display()))?;
    for photo in &mut report.photographs {
        let [wanted, of_mask] = Wanted::of(photo);
        forget_paths(photo);
        if photo.is_used() {
            photo.path = wanted.map_or(Ok(None), |wanted| search.photograph(&photo.name, &wanted))?;
            photo.mask_path = of_mask.map_or(Ok(None), |wanted| search.mask(&wanted))?;
        }
    }
    refuse(&search.missing, &search.changed)?;
    Ok((search.found, search.paths))
}

/// A search for the files that a report names.
#[derive(Default)]
struct Search {
    /// Files of the folder by their names.
    index: BTreeMap<String, Vec<PathBuf>>,
    paths: Paths,
    /// Files that were found, each once.
    found: Vec<Found>,
    placed: BTreeSet<String>,
    /// Names of the others.
    missing: Vec<String>,
    changed: Vec<String>,
}

impl Search {
    /// The path in the version of a photograph that was found.
    fn photograph(&mut self, name: &str, wanted: &Wanted) -> anyhow::Result<Option<String>> {
        let Some(from) = self.file(wanted)? else { return Ok(None) };
        let path = self.paths.photograph(name, ending(&from)?, &wanted.sha256);
        Ok(Some(self.add(from, path, wanted)))
    }

    /// The path in the version of a mask that was found.
    fn mask(&mut self, wanted: &Wanted) -> anyhow::Result<Option<String>> {
        let Some(from) = self.file(wanted)? else { return Ok(None) };
        ensure!(ending(&from)? == "png", "{} is a mask, but not a PNG file", from.display());
        let path = self.paths.mask(wanted.name(), &wanted.sha256);
        Ok(Some(self.add(from, path, wanted)))
    }

    fn add(&mut self, from: PathBuf, path: String, wanted: &Wanted) -> String {
        if self.placed.insert(path.clone()) {
            self.found.push(Found { from, path: path.clone(), bytes: wanted.bytes, sha256: wanted.sha256.clone() });
        }
        path
    }

    /// The file; None if it is missing or has changed, which is noted.
    fn file(&mut self, wanted: &Wanted) -> anyhow::Result<Option<PathBuf>> {
        let name = || visible(wanted.name()).to_string();
        match wanted.among(&self.index)? {
            Choice::Found(from) => return Ok(Some(from)),
            Choice::Changed => self.changed.push(name()),
            Choice::Missing => self.missing.push(name()),
        }
        Ok(None)
    }
}

/// A file that the report names.
struct Wanted {
    /// File names that it can have.
    names: Vec<String>,
    bytes: u64,
    sha256: Checksum,
}

/// Which file of a folder it is.
enum Choice {
    Found(PathBuf),
    /// There is one of its name, with other content.
    Changed,
    Missing,
}

impl Wanted {
    /// A photograph and its mask. In the folder of a published version they have the names of their paths.
    fn of(photo: &Photograph) -> [Option<Self>; 2] {
        let names = |file: &str, path: Option<&String>| {
            let published = path.and_then(|path| path.rsplit('/').next());
            [Some(file), published].into_iter().flatten().map(str::to_owned).collect()
        };
        let photograph =
            Self { names: names(&photo.file, photo.path.as_ref()), bytes: photo.bytes, sha256: photo.sha256.clone() };
        let mask = photo.mask.as_ref().zip(photo.mask_bytes.zip(photo.mask_sha256.clone()));
        let mask =
            mask.map(|(file, (bytes, sha256))| Self { names: names(file, photo.mask_path.as_ref()), bytes, sha256 });
        [Some(photograph), mask]
    }

    /// The name for messages.
    fn name(&self) -> &str {
        self.names.first().map_or("", String::as_str)
    }

    fn among(&self, index: &BTreeMap<String, Vec<PathBuf>>) -> anyhow::Result<Choice> {
        let named: Vec<&PathBuf> = self.names.iter().filter_map(|name| index.get(name)).flatten().collect();
        let mut same = Vec::new();
        for path in &named {
            let length = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
            if length == self.bytes && !same.contains(path) {
                same.push(*path);
            }
        }
        ensure!(
            self.bytes <= PHOTOGRAPH_MAX,
            "{}: it has {}, more than the maximum of {}",
            self.name(),
            size::text(self.bytes),
            size::text(PHOTOGRAPH_MAX)
        );
        match same.as_slice() {
            [] if named.is_empty() => Ok(Choice::Missing),
            [] => Ok(Choice::Changed),
            // Compared with its hash together with all others.
            [one] => Ok(Choice::Found((*one).clone())),
            several => {
                for path in several {
                    let hashed = File::open(path).and_then(|f| sha256_of(BufReader::with_capacity(1 << 20, f)));
                    let (_, sum) = hashed.with_context(|| format!("cannot read {}", path.display()))?;
                    if sum == self.sha256 {
                        return Ok(Choice::Found((*path).clone()));
                    }
                }
                Ok(Choice::Changed)
            }
        }
    }
}

/// Files of a folder by their names. Links are not followed.
fn walk(folder: &Path, index: &mut BTreeMap<String, Vec<PathBuf>>) -> std::io::Result<()> {
    let mut entries: Vec<_> = std::fs::read_dir(folder)?.collect::<Result<_, _>>()?;
    entries.sort_by_key(std::fs::DirEntry::file_name);
    for entry in entries {
        let kind = entry.file_type()?;
        if kind.is_dir() {
            walk(&entry.path(), index)?;
        } else if kind.is_file() {
            index.entry(entry.file_name().to_string_lossy().into_owned()).or_default().push(entry.path());
        }
    }
    Ok(())
}

/// The ending that belongs to the format of a picture.
fn ending(path: &Path) -> anyhow::Result<&'static str> {
    let mut head = Vec::new();
    let read = plain_file::open(path).and_then(|file| file.take(8).read_to_end(&mut head));
    read.with_context(|| format!("cannot read {}", path.display()))?;
    match head.as_slice() {
        [0xff, 0xd8, 0xff, ..] => Ok("jpg"),
        b"\x89PNG\r\n\x1a\n" => Ok("png"),
        _ => bail!("{} is neither JPEG nor PNG", path.display()),
    }
}

/// Refuse photographs that are missing or differ from the report, by name.
fn refuse(missing: &[String], changed: &[String]) -> anyhow::Result<()> {
    let listed = |names: &[String]| {
        let more = names.len().saturating_sub(LISTED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        format!("{}{more}", names[..names.len().min(LISTED)].join(", "))
    };
    let mut problems = Vec::new();
    if !missing.is_empty() {
        problems.push(format!(
            "{} of the colour report {} not in the folder given with --photos: {}",
            counted(missing.len(), "file", "files"),
            plural(missing.len(), "is", "are"),
            listed(missing)
        ));
    }
    if !changed.is_empty() {
        problems.push(format!(
            "{} changed since the model was coloured: {}",
            counted(changed.len(), "file has", "files have"),
            listed(changed)
        ));
    }
    ensure!(
        problems.is_empty(),
        "{}. Give the folder of the original photographs, or publish without --photos",
        problems.join("; ")
    );
    Ok(())
}

/// A warning if photographs state where they were included, and the model's location is not published.
fn positions(files: &[Found], metadata: &Metadata, of_pack: &kilwa_pack::Metadata) -> Option<String> {
    let is_public = of_pack.crs.is_some() || metadata.place.as_ref().is_some_and(|place| place.latitude.is_some());
    let stating = files.iter().filter(|file| !is_public && kilwa_scan::photos::states_position(&file.from)).count();
    (stating > 0).then(|| {
        format!(
            "{} where {} taken (EXIF), and the location of the model is not published otherwise",
            counted(stating, "photograph states", "photographs state"),
            plural(stating, "it was", "they were")
        )
    })
}

/// Reports what is read.
struct Counting<'a> {
    file: File,
    on_read: &'a dyn Fn(u64),
}

impl Read for Counting<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.file.read(buffer)?;
        (self.on_read)(n as u64);
        Ok(n)
    }
}
