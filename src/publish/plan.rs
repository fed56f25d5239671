//! What is going to be published, checked: metadata, pack, name, version, day, viewer, room. Changes nothing on disk.

use super::Args;
use crate::redact::Place;
use crate::source::open_pack;
use anyhow::{Context, bail, ensure};
use kilwa_builder::machine;
use kilwa_server::Page;
use kilwa_server::object::layout::{MANIFEST, version_folder};
use kilwa_server::object::manifest::MANIFEST_MAX;
use kilwa_server::object::metadata::crs;
use kilwa_server::object::rights::Rights;
use kilwa_server::object::{AccessState, Manifest, Metadata, Slug};
use std::path::{Path, PathBuf};

/// Largest metadata file that is read, bytes; its reader names the limit.
const METADATA_MAX: u64 = 2 << 20;
/// Room for pictures, records and the preview, beside pack and viewer.
const ROOM: u64 = 64 << 20;

/// Everything that is known before anything is written.
pub(super) struct Plan {
    /// The pack that was given.
    pub(super) pack: PathBuf,
    pub(super) of_pack: kilwa_pack::Metadata,
    pub(super) pack_bytes: u64,
    /// As it will be published: without the place where that is asked for.
    pub(super) metadata: Metadata,
    pub(super) rights: Rights,
    pub(super) crs: Option<String>,
    pub(super) accuracy: Option<f64>,
    pub(super) shelf: PathBuf,
    pub(super) slug: Slug,
    /// What is published already.
    pub(super) before: Option<Manifest>,
    pub(super) version: u32,
    pub(super) published: String,
    pub(super) note: String,
    pub(super) page: Page,
    pub(super) place: Option<Place>,
}

impl Plan {
    pub(super) fn new(args: &Args) -> anyhow::Result<Self> {
        let (pack, file) =
            (args.pack.as_ref().context("give a pack")?, args.metadata.as_ref().context("give --metadata FILE")?);
        let mut metadata = read_metadata(file)?;
        let in_file = || file.display().to_string();
        let rights = Rights::parse(&metadata.rights.uri).map_err(anyhow::Error::msg).with_context(in_file)?;
        let reader = open_pack(pack)?;
        let of_pack = reader.metadata().clone();
        let crs =
            agree(&metadata, &of_pack).with_context(|| format!("{} and {} do not agree", in_file(), pack.display()))?;
        let accuracy = of_pack.capture_accuracy.or_else(|| metadata.capture.as_ref().and_then(|c| c.accuracy));
        let slug = match &metadata.slug {
            Some(slug) => Slug::new(slug)?,
            None => Slug::of_title(&metadata.title),
        };
        // A title may give a reserved name.
        let slug = Slug::new(slug.as_str()).with_context(|| format!("{}: give slug = \"…\"", in_file()))?;
        ensure!(
            !is_in_object(&args.to),
            "{} is an object itself; give the folder that holds it with --to",
            args.to.display()
        );
        let before = existing(&args.to, &slug)?;
        let version = before.as_ref().map_or(1, |m| m.versions.len() as u32 + 1);
        let plain = if args.redact_location.is_some() { None } else { Some(&metadata) };
        let note = match (&before, &args.version_note) {
            (Some(m), note) => further(m, &metadata, note.as_deref(), args, plain.is_none())?,
            (None, note) => note.as_deref().unwrap_or("First publication").to_owned(),
        };
        let published = day(args, &metadata, before.as_ref())?;
        if let Some(place) = args.redact_location {
            check_cell(place, &of_pack)?;
            metadata = metadata.without_location();
        }
        let page = Page::load(args.www.as_deref())?;
        let pack_bytes = reader.header().file_bytes;
        let plan = Self {
            pack: pack.clone(),
            of_pack,
            pack_bytes,
            metadata,
            rights,
            crs: if args.redact_location == Some(Place::Nowhere) { None } else { crs },
            accuracy,
            shelf: args.to.clone(),
            slug,
            before,
            version,
            published,
            note,
            page,
            place: args.redact_location,
        };
        plan.check_disk()?;
        if args.site {
            kilwa_server::object::site::check(&plan.shelf)?;
        }
        Ok(plan)
    }

    /// The object's folder.
    pub(super) fn object(&self) -> PathBuf {
        self.shelf.join(self.slug.as_str())
    }

    /// Whether the folder can be written to and has room.
    fn check_disk(&self) -> anyhow::Result<()> {
        let needed = self.pack_bytes + self.page.bytes() + ROOM;
        let at = if self.before.is_some() { self.object() } else { nearest_there(&self.shelf)? };
        let probe = tempfile::Builder::new().prefix(kilwa_server::object::draft::HIDDEN).tempfile_in(&at);
        probe.with_context(|| {
            format!("cannot write to {}: give a folder with --to that you may write to, or ask whoever keeps it; nothing was changed", at.display())
        })?;
        if let Some(free) = machine::free_space(&at).filter(|free| *free < needed) {
            bail!(
                "the disk that holds {} has {} free, and about {} are needed; make room, or give a folder on another disk with --to. Nothing was changed",
                self.shelf.display(),
                human(free),
                human(needed)
            );
        }
        Ok(())
    }

    /// What would make the object better.
    pub(super) fn advice(&self) -> Vec<String> {
        let m = &self.metadata;
        let mut all = Vec::new();
        let mut say = |missing: bool, text: &str| {
            if missing {
                all.push(text.to_owned());
            }
        };
        say(m.creators.is_empty(), "[[creators]]: citations and DataCite name nobody");
        say(m.publisher.is_none(), "publisher: DataCite and Europeana ask for one");
        say(m.description.is_none(), "description: search engines and cards show it");
        say(m.url.is_none(), "url: without it links are relative and there is no oembed.json");
        say(m.identifier.is_none(), "identifier: a DOI or ARK outlives the address");
        say(self.accuracy.is_none(), "capture.accuracy: what a measurement on the model is worth");
        say(m.capture.is_none(), "[capture]: how it was captured");
        all
    }
}

fn read_metadata(file: &Path) -> anyhow::Result<Metadata> {
    let in_file = || file.display().to_string();
    let length = std::fs::metadata(file).with_context(|| format!("cannot read the metadata {}", in_file()))?.len();
    ensure!(
        length <= METADATA_MAX,
        "{}: {length} bytes are no metadata file; kilwa metadata init writes one to begin with",
        in_file()
    );
    let bytes = std::fs::read(file).with_context(|| format!("cannot read the metadata {}", in_file()))?;
    let text = String::from_utf8(bytes).map_err(|e| {
        let line = e.as_bytes().iter().take(e.utf8_error().valid_up_to()).filter(|b| **b == b'\n').count() + 1;
        anyhow::anyhow!(
            "{}: line {line}: the file is not UTF-8; save it as UTF-8 (in Notepad: Save as, Encoding)",
            in_file()
        )
    })?;
    let lines = Metadata::parse(&text);
    lines.map_err(|problems| anyhow::anyhow!("{} cannot be used:\n  {problems}", in_file()))
}

/// Whether pack and metadata say the same; the reference system.
fn agree(m: &Metadata, pack: &kilwa_pack::Metadata) -> anyhow::Result<Option<String>> {
    if m.model.units != pack.source_units {
        bail!(
            "model.units is \"{}\", and the pack was built from a mesh in \"{}\"; correct model.units, or build the pack again with --units {}",
            m.model.units,
            pack.source_units,
            m.model.units
        );
    }
    let in_pack = match &pack.crs {
        Some(text) => crs::normalise(text)
            .map_err(anyhow::Error::msg)
            .context("the pack's reference system; build it again with the right --crs, or without")?,
        None => None,
    };
    let given = match m.model.crs.as_deref() {
        None => in_pack.clone(),
        Some("local") => None,
        Some(other) => Some(other.to_owned()),
    };
    if given != in_pack {
        let name = |c: &Option<String>| c.clone().unwrap_or_else(|| "local coordinates".to_owned());
        bail!(
            "model.crs says {}, and the pack {}; correct model.crs, or build the pack again with the right --crs",
            name(&given),
            name(&in_pack)
        );
    }
    if let Some(text) = &in_pack {
        crs::holds(text, pack.bounds_min, pack.bounds_max).map_err(anyhow::Error::msg)?;
    }
    let accuracy = m.capture.as_ref().and_then(|c| c.accuracy);
    if let (Some(said), Some(built)) = (accuracy, pack.capture_accuracy)
        && said != built
    {
        bail!("capture.accuracy is {said} m, and the pack says {built} m; correct one of them");
    }
    Ok(in_pack)
}

fn check_cell(place: Place, pack: &kilwa_pack::Metadata) -> anyhow::Result<()> {
    let Place::Cell(cell) = place else { return Ok(()) };
    let widest = (0..2).map(|k| pack.bounds_max[k] - pack.bounds_min[k]).fold(0.0, f64::max);
    ensure!(
        cell > widest && cell <= 1e7,
        "--redact-location={cell}: a cell of {cell} m does not hide a model {widest:.0} m wide; give one much larger than the model, 10000 for example"
    );
    Ok(())
}

/// A folder inside of an object, where no object can be.
fn is_in_object(folder: &Path) -> bool {
    let absolute = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    absolute.ancestors().any(kilwa_server::object::layout::is_object)
}

/// The manifest of the object with this name, where there is one.
fn existing(shelf: &Path, slug: &Slug) -> anyhow::Result<Option<Manifest>> {
    let object = shelf.join(slug.as_str());
    if !object.exists() {
        return Ok(None);
    }
    let path = object.join(MANIFEST);
    let there = || {
        format!(
            "{} is there and is no object of kilwa; give another name with slug = \"…\" in the metadata, or move it away",
            object.display()
        )
    };
    let length = std::fs::metadata(&path).with_context(there)?.len();
    ensure!(length <= MANIFEST_MAX, "{}: {length} bytes are no manifest", path.display());
    let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
    let manifest = Manifest::parse(&bytes).with_context(|| path.display().to_string())?;
    Ok(Some(manifest))
}

/// Checks of a further version; its note.
fn further(
    m: &Manifest,
    metadata: &Metadata,
    note: Option<&str>,
    args: &Args,
    redacted: bool,
) -> anyhow::Result<String> {
    let (slug, shelf) = (&m.slug, args.to.display());
    let is_same = metadata.title == m.title
        || metadata.slug.as_deref() == Some(slug)
        || metadata.identifier.is_some() && metadata.identifier == m.identifier;
    ensure!(
        is_same,
        "{shelf}/{slug} is \"{}\", another model; give this one another name with slug = \"…\" in the metadata (or slug = \"{slug}\" if it is a new version of that one)",
        m.title
    );
    ensure!(
        m.access.state != AccessState::Withdrawn,
        "{shelf}/{slug} was withdrawn{}; publish under another name",
        m.access.withdrawn.as_ref().map(|d| format!(" on {d}")).unwrap_or_default()
    );
    let open = m.versions.iter().find(|v| !v.location_redacted);
    if let Some(open) = open.filter(|_| redacted) {
        bail!(
            "version {} of {shelf}/{slug} tells the place, and versions are never changed; withdraw it first \
             (kilwa publish --withdraw {slug} --to {shelf} --keep FOLDER --reason …) and publish under another name",
            open.version
        );
    }
    let hidden = m.versions.iter().find(|v| v.location_redacted);
    if let Some(hidden) = hidden.filter(|_| !redacted) {
        bail!(
            "version {} of {shelf}/{slug} was published without its place, and a version that tells it would tell that one's too; \
             give --redact-location again, or publish under another name",
            hidden.version
        );
    }
    let next = m.versions.len() + 1;
    let note = note.map(str::trim).filter(|n| !n.is_empty());
    let note = note.with_context(|| {
        format!(
            "{shelf}/{slug} is published already; to add version {next}, say what is new in it: --version-note \"…\""
        )
    })?;
    Ok(note.to_owned())
}

/// Day of publication: asked for, in the metadata (first version), SOURCE_DATE_EPOCH, today.
fn day(args: &Args, metadata: &Metadata, before: Option<&Manifest>) -> anyhow::Result<String> {
    let written = metadata.published.clone().filter(|_| before.is_none());
    let day = match args.date.clone().or(written) {
        Some(day) => day,
        None => super::today()?,
    };
    // A day to come would stand in citations, and keep every later version waiting for it.
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    let today = kilwa_server::object::date::day_of(now.as_secs());
    ensure!(
        day <= today || args.date.is_some(),
        "published: {day} is in the future (today is {today}, UTC); correct it in the metadata. An embargo is said with [access]"
    );
    if let Some(last) = before.and_then(|m| m.versions.last()) {
        ensure!(
            last.published <= day,
            "version {} was published on {}, after {day}; correct --date, SOURCE_DATE_EPOCH or the clock",
            version_folder(last.version),
            last.published
        );
    }
    Ok(day)
}

fn nearest_there(folder: &Path) -> anyhow::Result<PathBuf> {
    let absolute = std::path::absolute(folder).with_context(|| folder.display().to_string())?;
    let there = absolute.ancestors().find(|p| p.exists()).unwrap_or(Path::new("/")).to_owned();
    ensure!(there.is_dir(), "{} is a file; give a folder with --to", there.display());
    Ok(there)
}

/// Bytes for people.
pub(super) fn human(bytes: u64) -> String {
    match bytes {
        0..1_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}
