//! An archive object: everything that `kilwa publish` promises of it.
//!
//! Manifest and its seal; the landing page; each version's list of checksums, every file on it, every chunk of its pack; files that nobody
//! lists; records that must be there and agree with the manifest; links; and, where it was checked before, that no version of then is
//! gone or changed. Problems are collected; nothing ends the check of the rest.

use super::links;
use super::place::{Bytes, Place};
use super::progress::Progress;
use super::report::{Kind, Report};
use super::state::{State, Unit, now};
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_archive::colour_report::COLOUR_REPORT_MAX;
use kilwa_archive::draft::HIDDEN;
use kilwa_archive::holes::HOLES_MAX;
use kilwa_archive::keep::{KEEPING, KEEPING_TEXT};
use kilwa_archive::layout::{
    ANNOTATIONS, CHECKSUMS, CITATIONS, COLOUR_REPORT, CRATE, DATACITE, DUBLIN_CORE, EDM, HOLES, IIIF, LICENCE, LINKSET,
    MANIFEST, METADATA, PAGE, PARADATA, POSTER, README, TILES, TILESET, is_photograph, version_of,
};
use kilwa_archive::manifest::{FileEntry, MANIFEST_MAX, Seal, seal_of};
use kilwa_archive::next::NEXT;
use kilwa_archive::notes::NOTES_MAX;
use kilwa_archive::record::Included;
use kilwa_archive::sound;
use kilwa_archive::{AccessState, ColourReport, Holes, Manifest, Metadata, Notes, Version};
use kilwa_pack::Source;
use kilwa_pack::plural::counted;
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

/// Longest list of checksums, landing page or record that is read into memory.
const LIST_MAX: u64 = 64 << 20;
/// What every version has.
const REQUIRED: [&str; 13] = [
    DUBLIN_CORE,
    DATACITE,
    EDM,
    PARADATA,
    METADATA,
    IIIF,
    LINKSET,
    CRATE,
    CITATIONS[0],
    CITATIONS[1],
    CITATIONS[2],
    LICENCE,
    README,
];
/// Records with links.
const LINKING: [&str; 3] = [LINKSET, CRATE, IIIF];
/// Files whose contents are checked beside their checksums.
const CHECKED: [&str; 7] = [LINKSET, CRATE, IIIF, METADATA, ANNOTATIONS, HOLES, COLOUR_REPORT];

/// Contents of [`CHECKED`] by path, as they were read for their checksums.
type Kept = BTreeMap<String, Vec<u8>>;

/// A file whose bytes are kept while they are read, from the first to the last.
struct Keeping<'a> {
    file: &'a dyn Source,
    kept: RefCell<Vec<u8>>,
}

impl Source for Keeping<'_> {
    fn len(&self) -> std::io::Result<u64> {
        self.file.len()
    }

    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        let bytes = self.file.read_at(offset, length)?;
        self.kept.borrow_mut().extend(&bytes);
        Ok(bytes)
    }
}

/// What the check of one unit needs.
pub(crate) struct Check<'a> {
    /// Where its files are.
    pub(crate) place: &'a dyn Place,
    /// Its name in reports and in the state: `""` for what was to be checked itself.
    pub(crate) name: &'a str,
    /// What was found.
    pub(crate) report: &'a mut Report,
    /// What is known from before.
    pub(crate) state: &'a mut State,
    /// The bar.
    pub(crate) progress: &'a Progress,
}

impl Check<'_> {
    /// A path in the unit as reports call it.
    pub(crate) fn path(&self, path: &str) -> String {
        match (self.name, path) {
            ("", "") => self.place.name(""),
            ("", path) => path.to_owned(),
            (name, "") => name.to_owned(),
            (name, path) => format!("{name}/{path}"),
        }
    }

    pub(crate) fn add(&mut self, path: &str, kind: Kind, what: impl Into<String>) {
        if let Some(lacking) = self.report.lacking.as_mut().filter(|_| kind == Kind::Missing) {
            *lacking += 1;
            return;
        }
        let path = self.path(path);
        self.report.add(path, kind, what);
    }

    /// Add a note on the withdrawal that was filling or removing this. From here on, missing files are problems again.
    pub(crate) fn say_withdrawal(&mut self) {
        let lacking = self.report.lacking.take().unwrap_or(0);
        let (name, lacking) = (self.path(""), counted(lacking, "file", "files"));
        let again = "run the same `kilwa publish --withdraw` again to finish";
        self.report
            .notes
            .push(format!("{name}: a withdrawal is in progress or was interrupted ({lacking} missing); {again}"));
    }

    /// Whether a withdrawal has not yet put all files of the object here.
    fn is_being_kept(&self) -> bool {
        let Ok(Some(files)) = self.place.list("") else { return false };
        files.iter().any(|(path, _)| path == KEEPING)
            && self.place.read(KEEPING, LIST_MAX).is_ok_and(|mark| mark.as_deref() == Some(KEEPING_TEXT.as_bytes()))
    }

    /// A file that must be there.
    fn open(&mut self, path: &str, listed_in: &str) -> Option<Bytes> {
        match self.place.open(path) {
            Ok(Some(file)) => return Some(file),
            Ok(None) => self.add(path, Kind::Missing, format!("it is missing; {listed_in} lists it")),
            Err(e) => self.add(path, Kind::Unreadable, format!("it cannot be read: {e}")),
        }
        None
    }

    /// All of a small file that must be there.
    pub(crate) fn read(&mut self, path: &str, listed_in: &str) -> Option<Vec<u8>> {
        match self.place.read(path, LIST_MAX) {
            Ok(Some(bytes)) => {
                self.report.files += 1;
                self.report.bytes += bytes.len() as u64;
                return Some(bytes);
            }
            Ok(None) => self.add(path, Kind::Missing, format!("it is missing; {listed_in} lists it")),
            Err(e) => self.add(path, Kind::Unreadable, format!("it cannot be read: {e}")),
        }
        None
    }

    /// A small file with the bytes that an entry of the manifest promises.
    fn entry(&mut self, entry: &FileEntry) -> Option<Vec<u8>> {
        let bytes = self.read(&entry.url, MANIFEST)?;
        let found = sha256(&bytes);
        if found == entry.sha256 && bytes.len() as u64 == entry.bytes {
            return Some(bytes);
        }
        self.add(
            &entry.url,
            Kind::Damaged,
            differs(&found, bytes.len() as u64, &entry.sha256, Some(entry.bytes), MANIFEST),
        );
        None
    }

    /// Any file with the checksum that a list promises.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub(crate) fn listed(&mut self, path: &str, expected: &str, list: &str) -> anyhow::Result<()> {
        self.listed_and_kept(path, expected, list, 0).map(drop)
    }

    /// The same; its bytes, sound or not, if there are some and at most `limit`: over a network, no file is requested twice.
    ///
    /// # Errors
    /// When the state cannot be written.
    fn listed_and_kept(
        &mut self,
        path: &str,
        expected: &str,
        list: &str,
        limit: u64,
    ) -> anyhow::Result<Option<Vec<u8>>> {
        // Taken before the files are read, so that a change meanwhile gives another stamp.
        let stamp = self.state.stamp(self.place, path);
        let Some(file) = self.open(path, list) else { return Ok(None) };
        let of_state = self.path(path);
        let length = file.len().unwrap_or(u64::MAX);
        if self.state.has(&of_state, length, expected, &stamp) {
            self.progress.bytes(length);
            let count = usize::try_from(length).ok().filter(|_| length <= limit);
            return Ok(count.and_then(|count| file.read_at(0, count).ok()));
        }
        self.progress.at(path.rsplit('/').next().unwrap_or_default());
        let keeping = Keeping { file: file.as_ref(), kept: RefCell::default() };
        let is_kept = length <= limit;
        let source: &dyn Source = if is_kept { &keeping } else { file.as_ref() };
        match sound::sha256(source, &|n| self.progress.bytes(n)) {
            Ok((bytes, found)) => {
                self.report.files += 1;
                self.report.bytes += bytes;
                if found == expected {
                    self.state.file(&of_state, bytes, expected, &stamp)?;
                } else {
                    self.add(path, Kind::Damaged, differs(&found, bytes, expected, None, list));
                }
                Ok(is_kept.then(|| keeping.kept.into_inner()))
            }
            Err(e) => {
                self.add(path, Kind::Unreadable, format!("it cannot be read: {e}"));
                Ok(None)
            }
        }
    }

    /// A pack, by its chunks and by its checksum; what is known of it, where it is sound.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub(crate) fn pack(
        &mut self,
        path: &str,
        expected: Option<(&str, &str)>,
    ) -> anyhow::Result<Option<sound::Checked>> {
        let list = expected.map_or(MANIFEST, |(_, list)| list);
        let stamp = self.state.stamp(self.place, path);
        let Some(file) = self.open(path, list) else { return Ok(None) };
        let of_state = self.path(path);
        if let (Some((sum, _)), Ok(bytes)) = (expected, file.len())
            && self.state.has(&of_state, bytes, sum, &stamp)
        {
            self.progress.bytes(bytes);
            return Ok(None);
        }
        self.progress.at(path.rsplit('/').next().unwrap_or_default());
        let checked = match sound::check(file.as_ref(), &|n| self.progress.bytes(n)) {
            Ok(checked) => checked,
            Err(e) => {
                self.add(path, Kind::Unreadable, format!("it cannot be read: {e}"));
                return Ok(None);
            }
        };
        self.report.files += 1;
        self.report.packs += 1;
        self.report.bytes += checked.bytes;
        self.report.chunks += checked.totals.map_or(0, |t| t.chunks);
        let mut sound = checked.damaged.is_empty();
        for what in &checked.damaged {
            self.add(path, Kind::Damaged, what.clone());
        }
        if checked.more > 0 {
            self.add(path, Kind::Damaged, counted(checked.more, "more damaged part", "more damaged parts").to_string());
        }
        if let Some((sum, list)) = expected
            && let Some(found) = checked.sha256.as_deref().filter(|found| *found != sum)
        {
            self.add(path, Kind::Damaged, differs(found, checked.bytes, sum, None, list));
            sound = false;
        }
        if let Some(sum) = checked.sha256.as_deref().filter(|_| sound) {
            self.state.file(&of_state, checked.bytes, sum, &stamp)?;
        }
        Ok(sound.then_some(checked))
    }

    /// All of an object; its unit for the state. `None` where it was checked before and is left out.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub(crate) fn object(&mut self) -> anyhow::Result<Option<Unit>> {
        let before = self.report.count();
        let stamp = self.state.stamp(self.place, "");
        let mut unit = Unit { name: self.name.to_owned(), stamp, ..Unit::default() };
        let known = self.state.unit(self.name).cloned().unwrap_or_default();
        let bytes = match self.place.read(MANIFEST, MANIFEST_MAX) {
            Ok(Some(bytes)) => bytes,
            Ok(None) => {
                self.add(
                    MANIFEST,
                    Kind::Missing,
                    "it is missing; without it, Kilwa cannot tell what belongs to the object",
                );
                return Ok(Some(self.close(unit, before)));
            }
            Err(e) => {
                self.add(MANIFEST, Kind::Unreadable, format!("it cannot be read: {e}"));
                return Ok(Some(self.close(unit, before)));
            }
        };
        unit.manifest = sha256(&bytes);
        if self.state.is_done(self.name, &unit.manifest, &unit.stamp) {
            return Ok(None);
        }
        self.report.files += 1;
        self.report.bytes += bytes.len() as u64;
        match seal_of(&bytes) {
            Seal::Whole => {}
            Seal::None => {
                let name = self.path(MANIFEST);
                self.report.notes.push(format!("{name} has no seal: it was written by hand or by an earlier kilwa, so a change in it may not be noticed"));
            }
            Seal::Broken => self.add(
                MANIFEST,
                Kind::Damaged,
                "its seal does not match: it was damaged, or changed by hand. Take it from a copy, or publish a version with `kilwa publish`",
            ),
        }
        match Manifest::parse(&bytes) {
            Ok(manifest) => {
                unit.versions = manifest.versions.iter().map(|v| (v.version, v.checksums.sha256.clone())).collect();
                self.history(&known, &unit.versions);
                // A bag that is being removed has its own note.
                let is_kept = self.report.lacking.is_none() && self.is_being_kept();
                if is_kept {
                    self.report.lacking = Some(0);
                }
                self.contents(&manifest)?;
                if is_kept {
                    self.say_withdrawal();
                    // It is checked again next time.
                    unit.manifest.clear();
                }
            }
            Err(e) => {
                self.add(MANIFEST, Kind::Damaged, e.to_string());
                // Earlier versions are remembered.
                unit.versions.clone_from(&known.versions);
                self.without_manifest()?;
            }
        }
        Ok(Some(self.close(unit, before)))
    }

    fn close(&mut self, mut unit: Unit, before: u64) -> Unit {
        unit.problems = self.report.count() - before;
        unit.at = now();
        unit
    }

    /// Versions are only added: those of the last check are there and the same.
    fn history(&mut self, known: &Unit, now: &[(u32, String)]) {
        for (version, sum) in &known.versions {
            let at = format!("v{version}");
            match now.iter().find(|(number, _)| number == version).map(|(_, sum)| sum) {
                None => self.add(
                    &at,
                    Kind::History,
                    "this version existed at an earlier check, but the manifest no longer names it",
                ),
                Some(other) if other != sum => {
                    self.add(
                        &at,
                        Kind::History,
                        "this version differs from that of an earlier check, but versions must not change",
                    );
                }
                Some(_) => {}
            }
        }
    }

    /// The landing page. Where publishing or withdrawing was cut off between manifest and page, the page lies beside it, and the old one is shown by
    /// static hosts.
    fn page(&mut self, manifest: &Manifest) -> Option<Vec<u8>> {
        let page = self.place.read(&format!("{NEXT}/{PAGE}"), LIST_MAX).ok().flatten();
        let Some(page) = page.filter(|page| sha256(page) == manifest.page.sha256) else {
            return self.entry(&manifest.page);
        };
        self.report.files += 1;
        self.report.bytes += page.len() as u64;
        let path = self.path(PAGE);
        let again = "run the same `kilwa publish` again to finish";
        self.report
            .notes
            .push(format!("{path} is still the old page: a change was interrupted after it took effect. {again}"));
        Some(page)
    }

    fn contents(&mut self, manifest: &Manifest) -> anyhow::Result<()> {
        let page = self.page(manifest);
        let mut there: BTreeSet<String> = [MANIFEST, PAGE].map(str::to_owned).into();
        there.extend(self.report.lacking.map(|_| KEEPING.to_owned()));
        let mut complete = true;
        let mut records = Vec::new();
        for version in &manifest.versions {
            if manifest.access.state == AccessState::Withdrawn && self.is_gone(version) {
                let name = self.path(&version.folder);
                self.report.notes.push(format!("{name} is withdrawn; its files are gone"));
                continue;
            }
            let is_left = manifest.access.state == AccessState::Withdrawn
                && matches!(self.place.open(&version.pack.url), Ok(Some(_)));
            if is_left {
                let name = self.path(&version.pack.url);
                let again = "run the same `kilwa publish --withdraw` again to finish";
                self.report
                    .notes
                    .push(format!("{name} is withdrawn but still there: the withdrawal was interrupted. {again}"));
            }
            complete &= self.version(manifest, version, &mut there, &mut records)?;
        }
        self.extra(manifest, &there);
        // A withdrawn object links to files that are gone.
        if complete && manifest.access.state != AccessState::Withdrawn {
            let home = manifest.url.as_deref();
            let page = page.map(|bytes| links::of_html(&String::from_utf8_lossy(&bytes)));
            self.links(PAGE, page.unwrap_or_default(), &there, home);
            for (path, links) in records {
                self.links(&path, links, &there, home);
            }
        }
        Ok(())
    }

    fn is_gone(&self, version: &Version) -> bool {
        matches!(self.place.open(&version.checksums.url), Ok(None))
    }

    /// One version; whether its list could be read. Adds its files to `there`, and the links of its records.
    fn version(
        &mut self,
        manifest: &Manifest,
        version: &Version,
        there: &mut BTreeSet<String>,
        records: &mut Vec<(String, Vec<String>)>,
    ) -> anyhow::Result<bool> {
        let folder = &version.folder;
        there.insert(version.checksums.url.clone());
        let Some(text) = self.entry(&version.checksums) else {
            // Its list may be among the files that are missing.
            if let (Some(_), Ok(Some(files))) = (self.report.lacking, self.place.list(folder)) {
                there.extend(files.into_iter().map(|(path, _)| path));
            }
            return Ok(false);
        };
        let list = match Checksums::parse(&String::from_utf8_lossy(&text)) {
            Ok(list) => list,
            Err(e) => {
                self.add(&version.checksums.url, Kind::Damaged, e.to_string());
                return Ok(false);
            }
        };
        let in_folder = |path: &str| format!("{folder}/{path}");
        for path in REQUIRED.iter().chain([&POSTER]).filter(|path| list.get(path).is_none()) {
            let what = "every version needs it, but the list of checksums does not name it: the version is incomplete";
            self.add(&in_folder(path), Kind::Incomplete, what);
        }
        let pack = version.pack.url.strip_prefix(&format!("{folder}/")).unwrap_or_default();
        if list.get(pack) != Some(&version.pack.sha256) {
            let what = format!("{CHECKSUMS} does not list it with the checksum that {MANIFEST} has");
            self.add(&version.pack.url, Kind::Incomplete, what);
        }
        let name = in_folder(CHECKSUMS);
        let mut kept = Kept::new();
        let withdrawn = manifest.access.state == AccessState::Withdrawn;
        for (path, sum) in list.iter() {
            there.insert(in_folder(path));
            // Of what is withdrawn records and citations stay; the rest was removed.
            let stays = path.starts_with("metadata/") || CITATIONS.contains(&path);
            if withdrawn && !stays && matches!(self.place.open(&in_folder(path)), Ok(None)) {
                continue;
            }
            if path == pack {
                if let Some(checked) = self.pack(&in_folder(path), Some((sum, &name)))? {
                    self.figures(version, &checked);
                }
            } else if is_tileset(path) {
                // There may be many: only their links are kept.
                let bytes = self.listed_and_kept(&in_folder(path), sum, &name, LIST_MAX)?;
                if let Some(value) = bytes.and_then(|bytes| self.record(&in_folder(path), &bytes)) {
                    records.push((in_folder(path), links::of_tileset(&value)));
                }
            } else {
                let limit = if CHECKED.contains(&path) { LIST_MAX } else { 0 };
                let bytes = self.listed_and_kept(&in_folder(path), sum, &name, limit)?;
                kept.extend(bytes.map(|bytes| (path.to_owned(), bytes)));
            }
        }
        for path in LINKING {
            if let Some(value) = kept.get(path).and_then(|bytes| self.record(&in_folder(path), bytes)) {
                records.push((in_folder(path), links::of_json(&value)));
            }
        }
        self.agrees(manifest, version, &kept);
        self.notes(version, &list, &kept);
        self.holes(version, &list, &kept);
        self.tiles(version, &list);
        self.colours(version, &list, &kept);
        Ok(true)
    }

    /// The notes are those that the manifest names, can be read, and are on the model. Damage is named where their checksum is compared.
    fn notes(&mut self, version: &Version, list: &Checksums, kept: &Kept) {
        let path = format!("{}/{ANNOTATIONS}", version.folder);
        if version.optional().notes != list.get(ANNOTATIONS) {
            let what = format!("{CHECKSUMS} and {MANIFEST} disagree about the notes of the version");
            self.add(&path, Kind::Incomplete, what);
            return;
        }
        let Some(entry) = &version.annotations else { return };
        let Some(bytes) = kept.get(ANNOTATIONS).filter(|bytes| bytes.len() as u64 <= NOTES_MAX) else { return };
        if sha256(bytes) != entry.sha256 {
            return;
        }
        let [min, max] = version.figures.bounds;
        if bytes.len() as u64 != entry.bytes {
            self.add(
                &path,
                Kind::Incomplete,
                format!("it has {}; {MANIFEST} says {}", counted(bytes.len(), "byte", "bytes"), entry.bytes),
            );
        }
        if let Err(e) = Notes::parse(bytes).and_then(|notes| notes.within(min, max)) {
            self.add(&path, Kind::Incomplete, format!("its notes cannot be read: {e}"));
        }
    }

    /// Check the list of holes in the same way.
    fn holes(&mut self, version: &Version, list: &Checksums, kept: &Kept) {
        let path = format!("{}/{HOLES}", version.folder);
        if version.optional().holes != list.get(HOLES) {
            let what = format!("{CHECKSUMS} and {MANIFEST} disagree about the holes of the version");
            self.add(&path, Kind::Incomplete, what);
            return;
        }
        let Some(entry) = &version.holes else { return };
        let Some(bytes) = kept.get(HOLES).filter(|bytes| bytes.len() as u64 <= HOLES_MAX) else { return };
        if sha256(bytes) != entry.sha256 {
            return;
        }
        if bytes.len() as u64 != entry.bytes {
            self.add(
                &path,
                Kind::Incomplete,
                format!("it has {}; {MANIFEST} says {}", counted(bytes.len(), "byte", "bytes"), entry.bytes),
            );
        }
        let [min, max] = version.figures.bounds;
        if let Err(e) = Holes::parse(bytes).and_then(|holes| holes.within(min, max)) {
            self.add(&path, Kind::Incomplete, format!("its holes cannot be read: {e}"));
        }
    }

    /// The 3D Tiles are those that the manifest names.
    fn tiles(&mut self, version: &Version, list: &Checksums) {
        if version.optional().tiles != list.get(TILESET) {
            let what = format!("{CHECKSUMS} and {MANIFEST} disagree about the 3D Tiles of the version");
            self.add(&format!("{}/{TILESET}", version.folder), Kind::Incomplete, what);
        }
    }

    /// The colour report is the one that the manifest names, and the photographs of the version are those that it names. Damage is named where
    /// checksums are compared.
    fn colours(&mut self, version: &Version, list: &Checksums, kept: &Kept) {
        let path = format!("{}/{COLOUR_REPORT}", version.folder);
        if version.optional().colour_report != list.get(COLOUR_REPORT) {
            let what = format!("{CHECKSUMS} and {MANIFEST} disagree about the colour report of the version");
            self.add(&path, Kind::Incomplete, what);
            return;
        }
        let listed: BTreeSet<(&str, &str)> = list.iter().filter(|(path, _)| is_photograph(path)).collect();
        let Some(entry) = &version.colour_report else {
            if let Some((photograph, _)) = listed.first() {
                let what = format!("{CHECKSUMS} lists {photograph}, but there is no colour report that names it");
                self.add(&path, Kind::Incomplete, what);
            }
            return;
        };
        let Some(bytes) = kept.get(COLOUR_REPORT).filter(|bytes| bytes.len() as u64 <= COLOUR_REPORT_MAX) else {
            return;
        };
        if sha256(bytes) != entry.sha256 {
            return;
        }
        let report = match ColourReport::parse(bytes) {
            Ok(report) => report,
            Err(e) => {
                self.add(&path, Kind::Incomplete, format!("its colour report cannot be read: {e}"));
                return;
            }
        };
        let named: BTreeSet<(&str, &str)> = report.files().iter().map(|file| (file.path, file.sha256)).collect();
        if let Some((photograph, _)) = named.symmetric_difference(&listed).next() {
            let what = format!("{CHECKSUMS} and the colour report disagree about {photograph}");
            self.add(&path, Kind::Incomplete, what);
        }
        let included = Included::of(&report).map(|included| (included.files(), included.all_bytes()));
        if included != version.photographs.as_ref().map(|entry| (entry.files, entry.bytes)) {
            let what = format!("{MANIFEST} states another number or length of photographs than the colour report");
            self.add(&path, Kind::Incomplete, what);
        }
    }

    /// A record as JSON. Damage is named where its checksum is compared.
    fn record(&mut self, path: &str, bytes: &[u8]) -> Option<serde_json::Value> {
        match kilwa_pack::json::from_slice(bytes) {
            Ok(value) => Some(value),
            Err(e) => {
                self.add(path, Kind::Incomplete, format!("it is not usable JSON: {e}"));
                None
            }
        }
    }

    /// The manifest's numbers are the pack's.
    fn figures(&mut self, version: &Version, checked: &sound::Checked) {
        let path = version.pack.url.clone();
        let mut differ = |what: &str, of_pack: &str, of_manifest: &str| {
            if of_pack != of_manifest {
                let message = format!("its {what} is {of_pack}; {MANIFEST} says {of_manifest}");
                self.add(&path, Kind::Incomplete, message);
            }
        };
        differ("identity", checked.identity.as_deref().unwrap_or_default(), &version.pack.identity);
        differ("length", &checked.bytes.to_string(), &version.pack.bytes.to_string());
        let triangles = checked.totals.map_or(0, |t| t.finest_triangles);
        differ("number of triangles", &triangles.to_string(), &version.figures.triangles.to_string());
    }

    /// The metadata can be read, and the manifest of the current version says the same.
    fn agrees(&mut self, manifest: &Manifest, version: &Version, kept: &Kept) {
        let path = format!("{}/{METADATA}", version.folder);
        let Some(value) = kept.get(METADATA).and_then(|bytes| self.record(&path, bytes)) else { return };
        match serde_json::from_value::<Metadata>(value) {
            Ok(metadata) if version.version == manifest.current && metadata.title != manifest.title => {
                self.add(&path, Kind::Incomplete, format!("its title differs from that in {MANIFEST}"));
            }
            Ok(_) => {}
            Err(e) => self.add(&path, Kind::Incomplete, format!("it is not the metadata of an object: {e}")),
        }
    }

    /// Files that nobody lists.
    fn extra(&mut self, manifest: &Manifest, there: &BTreeSet<String>) {
        let files = match self.place.list("") {
            Ok(Some(files)) => files,
            Ok(None) => return,
            Err(e) => {
                self.add("", Kind::Unreadable, format!("its files cannot be listed: {e}"));
                return;
            }
        };
        let began = self.begun_version(manifest);
        if let Some(folder) = &began {
            let path = self.path(folder);
            let note = "is a version whose publication was interrupted; it is not published, and the next publication removes it";
            self.report.notes.push(format!("{path} {note}"));
        }
        let mut hidden = BTreeSet::new();
        for (path, _) in files.iter().filter(|(path, _)| !there.contains(path)) {
            let first = path.split('/').next().unwrap_or_default();
            if began.as_deref() == Some(first) {
                continue;
            }
            if let Some(part) = path.split('/').find(|part| part.starts_with(HIDDEN)) {
                let end = path.find(part).unwrap_or_default() + part.len();
                hidden.insert(path.get(..end).unwrap_or(path).to_owned());
                continue;
            }
            let of_version = path.split_once('/').and_then(|(folder, _)| version_of(folder)).is_some();
            let by = if of_version {
                format!("its version's {CHECKSUMS} does not list it")
            } else {
                format!("{MANIFEST} does not name it")
            };
            self.add(path, Kind::Extra, format!("unknown file: {by}"));
        }
        for path in hidden {
            let path = self.path(&path);
            let note =
                "belongs to a publication that is in progress or was interrupted; the next one removes leftovers";
            self.report.notes.push(format!("{path} {note}"));
        }
    }

    /// The folder of a version that was cut off before the manifest named it: the manifest that would have lies beside it.
    fn begun_version(&self, manifest: &Manifest) -> Option<String> {
        let next = self.place.read(&format!("{NEXT}/{MANIFEST}"), MANIFEST_MAX).ok()??;
        let next = Manifest::parse(&next).ok()?;
        let is_next = |v: &&Version| v.version as usize == manifest.versions.len() + 1;
        next.versions.iter().find(is_next).map(|v| v.folder.clone())
    }

    /// Links that stay in the object lead to a file of it.
    fn links(&mut self, from: &str, links: Vec<String>, there: &BTreeSet<String>, home: Option<&str>) {
        let folder = from.rfind('/').and_then(|at| from.get(..=at)).unwrap_or_default().to_owned();
        let mut seen = BTreeSet::new();
        for link in links {
            let Some(path) = links::target(&link, &folder, home).filter(|path| seen.insert(path.clone())) else {
                continue;
            };
            let leads = match path.strip_suffix('/') {
                Some("") => there.contains(PAGE),
                Some(folder) => there.range(format!("{folder}/")..).next().is_some_and(|p| p.starts_with(&path)),
                None => there.contains(&path),
            };
            if !leads {
                self.add(from, Kind::Link, format!("it links to {path}, which does not exist"));
            }
        }
    }

    /// The manifest says nothing: what the version folders say of themselves is checked all the same.
    fn without_manifest(&mut self) -> anyhow::Result<()> {
        let Ok(Some(files)) = self.place.list("") else { return Ok(()) };
        let lists = files.iter().filter(|(path, _)| {
            path.split_once('/').is_some_and(|(folder, name)| version_of(folder).is_some() && name == CHECKSUMS)
        });
        for (path, _) in lists {
            let folder = path.strip_suffix(CHECKSUMS).unwrap_or_default();
            let mut known = self.files_of(path, folder, true)?;
            known.insert(path.clone());
            self.unknown(folder.trim_end_matches('/'), &known, path);
        }
        Ok(())
    }

    /// Every file of a list of checksums, below `folder` (with its chunks, where they are to be `decoded`); the paths on it.
    ///
    /// # Errors
    /// When the state cannot be written.
    pub(crate) fn files_of(
        &mut self,
        list_path: &str,
        folder: &str,
        decoded: bool,
    ) -> anyhow::Result<BTreeSet<String>> {
        let Some(text) = self.read(list_path, "a bag or version") else { return Ok(BTreeSet::new()) };
        let list = match Checksums::parse(&String::from_utf8_lossy(&text)) {
            Ok(list) => list,
            Err(e) => {
                self.add(list_path, Kind::Damaged, e.to_string());
                return Ok(BTreeSet::new());
            }
        };
        let mut paths = BTreeSet::new();
        for (path, sum) in list.iter() {
            let at = format!("{folder}{path}");
            if decoded && super::is_pack(path) {
                self.pack(&at, Some((sum, list_path)))?;
            } else {
                self.listed(&at, sum, list_path)?;
            }
            paths.insert(at);
        }
        Ok(paths)
    }

    /// Name the files below a folder that are not among those that are known.
    pub(crate) fn unknown(&mut self, folder: &str, known: &BTreeSet<String>, list: &str) {
        let Ok(Some(files)) = self.place.list(folder) else { return };
        for (path, _) in files.iter().filter(|(path, _)| !known.contains(path)) {
            self.add(path, Kind::Extra, format!("unknown file: {list} does not list it"));
        }
    }
}

fn differs(found: &str, bytes: u64, expected: &str, length: Option<u64>, list: &str) -> String {
    let lengths = match length {
        Some(expected) if expected != bytes => {
            format!("; it has {} instead of {expected}", counted(bytes, "byte", "bytes"))
        }
        _ => String::new(),
    };
    format!(
        "it is not what was published: its SHA-256 is {found}, {list} says {expected}{lengths}. Take it from a copy"
    )
}

/// Whether a file of a version is JSON of its 3D Tiles.
fn is_tileset(path: &str) -> bool {
    path.strip_prefix(TILES).is_some_and(|rest| rest.starts_with('/') && rest.rsplit('.').next() == Some("json"))
}
