//! The plan of a publication, checked: metadata, pack, name, version, day, viewer, disk space. Changes nothing on disk.

use super::photographs::{self, Colours};
use super::progress::{Lengths, Progress, Stage};
use super::{Args, copies, holes, notes, tiles};
use crate::redact::{self, Place};
use crate::source::{open_pack, read_named};
use anyhow::{Context, bail, ensure};
use kilwa_archive::assemble::{Facts, Following, agree, existing, further, has_metadata};
use kilwa_archive::location::Location;
use kilwa_archive::metadata::plain_capture;
use kilwa_archive::metadata::plausible;
use kilwa_archive::record::europeana_lacks;
use kilwa_archive::rights::Rights;
use kilwa_archive::{Holes, Manifest, Metadata, Notes, Slug};
use kilwa_builder::build::machine;
use kilwa_files::size;
use kilwa_server::Page;
use std::path::{Path, PathBuf};

/// Largest metadata file that is read, bytes; its reader names the limit.
const METADATA_MAX: u64 = 2 << 20;
/// Disk space for pictures, records and the preview, beside pack and viewer.
const RESERVE: u64 = 64 << 20;

/// What was given, read and checked by itself.
pub(super) struct Given {
    /// The pack that was given.
    pub(super) pack: PathBuf,
    pub(super) of_pack: kilwa_pack::Metadata,
    pub(super) identity: String,
    pub(super) pack_bytes: u64,
    /// As it was written.
    metadata: Metadata,
    rights: Rights,
    crs: Option<String>,
    pub(super) slug: Slug,
    pub(super) place: Option<Place>,
    /// Scalar channels that are kept although the place is taken out.
    pub(super) keep_channels: Vec<String>,
    /// Notes on it, at places of the pack that was given.
    pub(super) notes: Option<Notes>,
    /// The holes of its surface, at coordinates of the pack that was given.
    pub(super) holes: Option<Holes>,
    /// The colour report, and the photographs.
    pub(super) colours: Option<Colours>,
}

impl Given {
    pub(super) fn read(args: &Args) -> anyhow::Result<Self> {
        let (pack, file) =
            (args.pack.as_ref().context("give a pack")?, args.metadata.as_ref().context("give --metadata FILE")?);
        let (metadata, text) = read_metadata_text(file)?;
        let in_file = || file.display().to_string();
        let rights = Rights::parse(&metadata.rights.uri).map_err(anyhow::Error::msg).with_context(in_file)?;
        let reader = open_pack(pack)?;
        let of_pack = reader.metadata().clone();
        let crs = agree(&metadata, &of_pack)
            .map_err(anyhow::Error::msg)
            .with_context(|| format!("{} and {} do not agree", in_file(), pack.display()))?;
        let slug = match &metadata.slug {
            Some(slug) => Slug::new(slug)?,
            None => Slug::of_title(&metadata.title),
        };
        // A title may give a reserved name.
        let slug = Slug::new(slug.as_str()).with_context(|| format!("{}: give slug = \"…\"", in_file()))?;
        if let Some(place) = args.redact_location {
            check_cell(place, &of_pack)?;
        }
        let colours = Colours::read(args, &metadata, &of_pack, file)?;
        let given = Self {
            colours,
            pack: pack.clone(),
            identity: reader.identity(),
            pack_bytes: reader.header().file_bytes,
            of_pack,
            metadata,
            rights,
            crs,
            slug,
            place: args.redact_location,
            keep_channels: args.keep_channel.clone(),
            notes: args.notes.as_deref().map(notes::read).transpose()?,
            holes: args.holes.as_deref().map(holes::read).transpose()?,
        };
        holes::check(args.holes.as_deref(), &given)?;
        tiles::check(args, &given)?;
        given.check_withheld(&in_file(), &text, args.version_note.as_deref())?;
        if given.place.is_some() {
            redact::checked_channels(&reader, &given.keep_channels, &given.location())?;
        }
        Ok(given)
    }

    /// Where the place is taken out, no text that is published may give it away: those of the metadata file, of the pack, and the note of the version.
    fn check_withheld(&self, file: &str, text: &str, version_note: Option<&str>) -> anyhow::Result<()> {
        let Some(place) = self.place else { return Ok(()) };
        let location = self.location();
        Metadata::check_withheld(text, &location).map_err(|problems| {
            anyhow::anyhow!("{file} reveals the location that --redact-location removes:\n  {problems}")
        })?;
        // What is made of the fields: the name in the address, addresses of identifiers.
        if let Some((field, finding)) = self.published_metadata().giving_away(&location) {
            bail!("{file}: {field}: {finding}");
        }
        if let Some(finding) = location.find_in_name(self.slug.as_str()) {
            bail!("{file}: slug: {finding}; give slug = \"…\"");
        }
        if let Some(finding) = version_note.and_then(|note| location.find(note)) {
            bail!("--version-note: {finding}");
        }
        let of_pack = redact::published_metadata(&self.of_pack, place, &self.metadata.title, &self.keep_channels);
        let value = serde_json::to_value(&of_pack).context("cannot read the pack's metadata")?;
        if let Err((name, what)) = plain_capture(&of_pack) {
            bail!("{}: {name} {what} when you build the pack again", self.pack.display());
        }
        if let Some((field, finding)) = location.find_in_json(&value, &|at| at == "crs") {
            bail!("{}: {field}: {finding}; build the pack again", self.pack.display());
        }
        Ok(())
    }

    /// Compare the photographs with the colour report and make their smaller copies, for a publication that is not made.
    pub(super) fn prepare_photographs(&mut self) -> anyhow::Result<()> {
        let progress = Progress::new(&[Stage::CheckPhotographs, Stage::SmallerCopies], self.lengths());
        photographs::prepare(self, &progress)?;
        progress.end();
        Ok(())
    }

    /// Bytes that take time.
    pub(super) fn lengths(&self) -> Lengths {
        Lengths { pack: self.pack_bytes, photographs: self.colours.as_ref().map_or(0, Colours::length) }
    }

    /// Language of the texts.
    pub(super) fn language(&self) -> &str {
        &self.metadata.language
    }

    /// Where the model truly is, as far as pack and metadata say.
    pub(super) fn location(&self) -> Location {
        let bounds = [self.of_pack.bounds_min, self.of_pack.bounds_max];
        let location = Location::of(bounds, self.crs.as_deref(), self.metadata.place.as_ref());
        // A cell of the reference system is published with its name.
        if matches!(self.place, Some(Place::Cell(_))) { location.with_known_system() } else { location }
    }

    /// What will be published of the metadata.
    pub(super) fn published_metadata(&self) -> Metadata {
        let metadata = self.metadata.clone();
        if self.place.is_some() { metadata.without_location() } else { metadata }
    }
}

/// The note of a first version without a given one.
const FIRST: &str = "First publication";

/// What is going to be published. It is decided twice: before anything is written, so that a mistake is named at once, and again when the version
/// has been made and the folder is locked, by what is published then.
pub(super) struct Plan {
    pub(super) given: Given,
    pub(super) facts: Facts,
    /// The object's folder or address, for messages.
    pub(super) at: String,
    pub(super) page: Page,
    /// Other objects of the folder that show the same model with its place, in words.
    published_elsewhere: Option<String>,
}

impl Plan {
    /// The plan for a version that follows the existing ones at `at`.
    pub(super) fn new(args: &Args, given: Given, before: Option<Manifest>, at: String) -> anyhow::Result<Self> {
        let page = Page::load(args.www.as_deref())?;
        let facts = decide(args, &given, before, &at, args.version_note.as_deref())?;
        Ok(Self { given, facts, at, page, published_elsewhere: None })
    }

    /// Decide again, by what is published now; everything that was decided before is forgotten.
    pub(super) fn renew(&mut self, args: &Args, before: Option<Manifest>) -> anyhow::Result<()> {
        self.facts = decide(args, &self.given, before, &self.at, args.version_note.as_deref())?;
        Ok(())
    }

    /// For a folder of this computer, which must have enough space.
    pub(super) fn for_folder(args: &Args) -> anyhow::Result<Self> {
        let given = Given::read(args)?;
        ensure!(
            !is_in_object(&args.to),
            "{} is itself an object; give the folder that contains it with --to",
            args.to.display()
        );
        let object = args.to.join(given.slug.as_str());
        let before = existing(&object).map_err(anyhow::Error::msg)?;
        let at = object.display().to_string();
        let again = before.as_ref().filter(|m| !args.dry_run && may_be_there(args, &given, &object, m));
        let note = again.and_then(|m| m.versions.last()).map(|v| v.note.clone()).or_else(|| args.version_note.clone());
        let page = Page::load(args.www.as_deref())?;
        let facts = decide(args, &given, before, &at, note.as_deref())?;
        let mut plan = Self { given, facts, at, page, published_elsewhere: None };
        plan.published_elsewhere = plan.same_model_in(&args.to);
        plan.check_disk(args)?;
        if args.site {
            kilwa_archive::site::check(&args.to)?;
        }
        Ok(plan)
    }

    /// Objects in a folder that reveal the location withheld here, by comparison of the two. Manifests that cannot be read
    /// are passed over.
    fn same_model_in(&self, shelf: &Path) -> Option<String> {
        self.given.place?;
        let pack = &self.given.of_pack;
        let is_same = |v: &kilwa_archive::Version| {
            let f = &v.figures;
            let counts = (f.triangles, f.vertices, f.spacing) == (pack.triangles, pack.vertices, pack.median_edge);
            !v.location_redacted && (v.pack.identity == self.given.identity || counts)
        };
        let entries = std::fs::read_dir(shelf).into_iter().flatten().flatten();
        let others = entries.filter(|e| e.file_name().to_string_lossy() != self.facts.slug.as_str());
        let manifests = others.filter_map(|e| existing(&e.path()).ok().flatten());
        let mut names: Vec<String> = manifests.filter(|m| m.versions.iter().any(is_same)).map(|m| m.slug).collect();
        names.sort();
        (!names.is_empty()).then(|| {
            format!(
                "the same model with its location is published as {}; comparing the two reveals this one's. Withdraw that one and delete the location from its tombstone (docs/publish.md)",
                names.join(", ")
            )
        })
    }

    /// Whether the folder can be written to and has enough space.
    fn check_disk(&self, args: &Args) -> anyhow::Result<()> {
        let shelf = &args.to;
        let Lengths { pack, photographs } = self.given.lengths();
        let included = self.given.colours.as_ref().and_then(|colours| colours.included);
        let copies = copies::expected_bytes(included.map_or(0, |included| included.photographs));
        let needed = pack + photographs + copies + self.page.bytes() + RESERVE + tiles::need(args, &self.given);
        let at = match self.facts.before {
            Some(_) => shelf.join(self.facts.slug.as_str()),
            None => nearest_there(shelf)?,
        };
        // Without a name, so that nothing of it can be left.
        tempfile::tempfile_in(&at).with_context(|| {
            format!("cannot write to {}: choose a folder that you may write to, or ask its administrator; nothing was changed", at.display())
        })?;
        if let Some(free) = machine::free_space(&at).filter(|free| *free < needed) {
            bail!(
                "the disk that holds {} has {} free, but about {} are needed; free space, or use --to with a folder on another disk. Nothing was changed",
                shelf.display(),
                size::text(free),
                size::text(needed)
            );
        }
        Ok(())
    }

    /// Scalar channels that are not published, and why.
    pub(super) fn channels_left_out(&self) -> Vec<String> {
        let given = &self.given;
        let scalars = given.of_pack.scalars.iter().map(|s| s.name.as_str());
        let names: Vec<&str> =
            scalars.filter(|n| given.place.is_some() && !given.keep_channels.iter().any(|k| k == n)).collect();
        let warning = || {
            format!(
                "the scalar channels {}, which may hold coordinates; --keep-channel NAME keeps one that does not",
                names.join(", ")
            )
        };
        (!names.is_empty()).then(warning).into_iter().collect()
    }

    /// Values that are probably mistakes.
    pub(super) fn warnings(&self) -> Vec<String> {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
        let today = kilwa_archive::date::day_of(now.as_secs());
        let mut all = plausible::warnings(&self.facts.metadata, &self.given.of_pack, &today);
        all.extend(notes::warnings(self));
        all.extend(photographs::warnings(&self.given));
        all.extend(self.published_elsewhere.iter().cloned());
        all
    }

    /// What would make the object better.
    pub(super) fn advice(&self) -> Vec<String> {
        let m = &self.facts.metadata;
        let mut all = Vec::new();
        let mut say = |missing: bool, text: &str| {
            if missing {
                all.push(text.to_owned());
            }
        };
        say(m.creators.is_empty(), "[[creators]]: citations and DataCite name nobody");
        say(m.publisher.is_none(), "publisher: DataCite requires one");
        say(m.description.is_none(), "description: search engines and link previews show it");
        say(m.url.is_none(), "url: without it links are relative and there is no oembed.json");
        say(m.identifier.is_none(), "identifier: a DOI or ARK outlives the address");
        say(
            self.facts.accuracy.is_none(),
            "capture.accuracy: without it, the uncertainty of measurements leaves out the survey",
        );
        say(m.capture.is_none(), "[capture]: how the site was captured");
        all.extend(europeana_lacks(m, &self.facts.rights));
        all
    }
}

/// What is published, if what was given is to follow `before`.
fn decide(args: &Args, given: &Given, before: Option<Manifest>, at: &str, note: Option<&str>) -> anyhow::Result<Facts> {
    let published = day(args, &given.metadata, before.as_ref())?;
    notes::check(args, given, before.as_ref())?;
    let note = match &before {
        Some(m) => {
            let following = Following {
                at,
                metadata: &given.metadata,
                pack: &given.of_pack,
                identity: &given.identity,
                redacted: given.place.is_some(),
                same_object: args.same_object,
                open_access: args.open_access,
                today: &published,
                note,
                published: &published,
            };
            further(m, &following).map_err(anyhow::Error::msg)?
        }
        None => note.unwrap_or(FIRST).to_owned(),
    };
    let accuracy = given.metadata.capture.as_ref().and_then(|c| c.accuracy);
    Ok(Facts {
        metadata: given.published_metadata(),
        rights: given.rights.clone(),
        slug: given.slug.clone(),
        before,
        published,
        note,
        location_redacted: given.place.is_some(),
        crs: if given.place == Some(Place::Nowhere) { None } else { given.crs.clone() },
        accuracy: given.of_pack.capture_accuracy.or(accuracy),
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
    })
}

/// Whether the last version says that it was made by a command with these options.
pub(super) fn is_same_request(args: &Args, m: &Manifest) -> bool {
    let note = args.version_note.as_deref().map_or(FIRST, str::trim);
    m.versions
        .last()
        .is_some_and(|last| last.note.trim() == note && args.date.as_ref().is_none_or(|day| *day == last.published))
}

/// Whether an earlier run of this very command seems to have published the last version, so that no note for another one is asked for. Whether it has
/// is known when the pack is hashed.
fn may_be_there(args: &Args, given: &Given, object: &Path, m: &Manifest) -> bool {
    let Some(last) = m.versions.last().filter(|_| is_same_request(args, m)) else { return false };
    let is_pack = last.pack.identity == given.identity && last.pack.bytes == given.pack_bytes;
    last.location_redacted == given.place.is_some()
        && last.tiles.is_some() == args.tiles.is_some()
        && last.colour_report.is_some() == args.colour_report.is_some()
        && (is_pack || given.place.is_some())
        && has_metadata(object, last, &given.published_metadata())
}

/// A text, or which line has what is not UTF-8, as it was most likely meant.
pub(crate) fn in_utf8(bytes: Vec<u8>) -> Result<String, String> {
    String::from_utf8(bytes).map_err(|e| {
        let (bytes, at) = (e.as_bytes(), e.utf8_error().valid_up_to());
        let line = bytes.iter().take(at).filter(|b| **b == b'\n').count();
        let whole = bytes.split(|b| *b == b'\n').nth(line).unwrap_or_default();
        // Latin-1 is the first 256 characters of Unicode.
        let meant: String = whole.iter().map(|b| char::from(*b)).filter(|c| !c.is_control()).take(80).collect();
        format!(
            "line {}: the file is not UTF-8 but seems to be Latin-1 (`{meant}`); save it as UTF-8 (in Notepad: Save as, Encoding), or: iconv -f LATIN1 -t UTF-8",
            line + 1
        )
    })
}

pub(crate) fn read_metadata(file: &Path) -> anyhow::Result<Metadata> {
    read_metadata_text(file).map(|(metadata, _)| metadata)
}

/// The same, with the text that they were read from.
fn read_metadata_text(file: &Path) -> anyhow::Result<(Metadata, String)> {
    let in_file = || file.display().to_string();
    let length = std::fs::metadata(file).with_context(|| format!("cannot read the metadata {}", in_file()))?.len();
    ensure!(
        length <= METADATA_MAX,
        "{}: it has {length} bytes, too many for a metadata file; kilwa metadata init writes one to start from",
        in_file()
    );
    let bytes = read_named(file, METADATA_MAX)?;
    let text = in_utf8(bytes).map_err(|message| anyhow::anyhow!("{}: {message}", in_file()))?;
    let metadata = Metadata::parse(&text);
    let metadata = metadata.map_err(|problems| anyhow::anyhow!("{} cannot be used:\n  {problems}", in_file()))?;
    Ok((metadata, text))
}

/// Widest cell, metres: a quarter of the way around the Earth.
const CELL_MAX: f64 = 1e7;

fn check_cell(place: Place, pack: &kilwa_pack::Metadata) -> anyhow::Result<()> {
    let Place::Cell(cell) = place else { return Ok(()) };
    let widest = (0..2).map(|k| pack.bounds_max[k] - pack.bounds_min[k]).fold(0.0, f64::max);
    ensure!(
        cell <= CELL_MAX,
        "--redact-location={cell}: a cell of {cell} m is larger than the maps of any reference system; omit the number to remove the location altogether"
    );
    ensure!(
        cell > widest,
        "--redact-location={cell}: a cell of {cell} m does not hide a model {widest:.0} m wide; give one much larger than the model, 10000 for example"
    );
    Ok(())
}

/// A folder inside of an object, where no object can be.
fn is_in_object(folder: &Path) -> bool {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.ancestors().any(kilwa_archive::layout::is_object)
}

/// Day of publication: asked for, in the metadata (first version), SOURCE_DATE_EPOCH, today.
fn day(args: &Args, metadata: &Metadata, before: Option<&Manifest>) -> anyhow::Result<String> {
    let written = metadata.published.clone().filter(|_| before.is_none());
    let day = match args.date.clone().or(written) {
        Some(day) => day,
        None => super::today()?,
    };
    // A day in the future would appear in citations, and keep every later version waiting for it.
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let today = kilwa_archive::date::day_of(now.as_secs());
    ensure!(
        day <= today || args.date.is_some(),
        "published: {day} is in the future (today is {today}, UTC); correct it in the metadata. To publish later, set an embargo in [access]"
    );
    Ok(day)
}

fn nearest_there(folder: &Path) -> anyhow::Result<PathBuf> {
    let absolute = std::path::absolute(folder).with_context(|| folder.display().to_string())?;
    let there = absolute.ancestors().find(|p| p.exists()).unwrap_or(Path::new("/")).to_owned();
    ensure!(there.is_dir(), "{} is a file; give a folder with --to", there.display());
    Ok(there)
}
