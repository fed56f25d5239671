//! `kilwa verify`: every byte of packs and archive objects, and every promise that they make; on a disk or at an address.
//!
//! The target is a pack, an object (a folder with `manifest.json`), a bag with one in it, or a folder of those. Each is a unit:
//! checked by itself, reported when it is done, remembered in the state file. Memory is bounded by the largest directory of a pack and the
//! longest list of checksums, whatever the size of the files.

mod links;
mod object;
mod place;
mod progress;
mod report;
mod state;
mod web;

use crate::new_file::refuse_inputs;
use crate::secrets::shown;
use crate::source::FileSource;
use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use kilwa_archive::layout::{MANIFEST, PAGE};
use kilwa_archive::manifest::MANIFEST_MAX;
use kilwa_archive::{AccessState, Manifest, sound};
use kilwa_files::atomic::folder_of;
use kilwa_files::plain_file;
use kilwa_pack::plural::counted;
use kilwa_server::{COLLECTIONS_FILE, SITE_FILE};
use object::Check;
use place::{Folder, Place};
use progress::Progress;
use report::{Kind, Report};
use state::{State, Unit, now};
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use web::Web;
pub(crate) use web::is_address;

/// Check every byte of packs and archive objects: checksums, chunks, records, links, versions.
///
/// TARGET is a pack, an archive object, a folder of packs and objects, or the address (http or https) of one. Exits with 1 and names every
/// damaged, missing or unknown file if something is wrong. For a nightly job: --state records what was checked when.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// What to check: a pack, a folder, or an address.
    target: String,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
    /// Record in this file what was checked when.
    #[arg(long, value_name = "FILE")]
    state: Option<PathBuf>,
    /// Continue a stopped run.
    #[arg(long, requires = "state")]
    resume: bool,
    /// Skip units that were found intact less than this many days ago and have not changed since.
    #[arg(long, value_name = "DAYS", requires = "state", value_parser = clap::value_parser!(u64).range(1..=36_500))]
    older_than: Option<u64>,
    /// Forget this object, bag or pack, which was removed on purpose; otherwise it is reported as missing.
    #[arg(long, value_name = "NAME", requires = "state")]
    forget: Vec<String>,
}

/// Problems on the line that says that there are some.
const NAMED: usize = 10;
/// Longest list of objects at an address.
const LIST_MAX: u64 = 16 << 20;

/// What is checked, in order.
enum What {
    Object,
    Bag {
        /// Whether the withdrawal of its object removes it.
        is_going: bool,
    },
    Pack,
    /// A link or a special file whose name is that of a file that the server reads beside objects and packs.
    Beside,
}

/// A unit: where it is (a path from the place), what it is.
struct Item {
    path: String,
    what: What,
}

/// What was checked, for the last line.
struct Checked {
    /// Units, including those that are missing.
    units: usize,
    /// Whether it was one pack and nothing else.
    single: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let mut report = Report { target: shown(&args.target).into_owned(), ..Report::default() };
    match check_all(args, &mut report) {
        Ok(checked) => say(args, &checked, &report),
        Err(error) => {
            if args.json {
                let is_gone = !is_address(&args.target) && !Path::new(&args.target).exists();
                let kind = if is_gone { Kind::Missing } else { Kind::Unreadable };
                report.add(report.target.clone(), kind, format!("{error:#}"));
                // The error matters even if nobody reads the report.
                let text = crate::terminal::json_text(&report.to_json())?;
                drop(writeln!(crate::terminal::out(), "{text}"));
            }
            Err(error)
        }
    }
}

/// Check everything that exists, and report what the state lists and is missing.
fn check_all(args: &Args, report: &mut Report) -> anyhow::Result<Checked> {
    let (place, mut items) =
        if is_address(&args.target) { at_address(&args.target)? } else { in_folder(&args.target)? };
    if let Some(state) = args.state.as_deref().filter(|_| !is_address(&args.target)) {
        refuse_inputs(state, [Path::new(&args.target)])?;
    }
    let nothing = || {
        let target = &args.target;
        anyhow::anyhow!("{target} is not an archive object (it has no {MANIFEST}), and it contains no objects or packs")
    };
    // If there was something earlier, the state shows what is missing.
    if items.is_empty() && !args.state.as_ref().is_some_and(|path| path.exists()) {
        return Err(nothing());
    }
    let mut state = match &args.state {
        Some(path) => State::open(path, &canonical(&args.target), args.resume, args.older_than, &args.forget)?,
        None => State::default(),
    };
    let mut gone = gone(place.as_ref(), &items, &state);
    if is_address(&args.target) {
        // The list may have several pages, and only the first was read: the server is asked for the rest by name.
        gone.retain(|path| {
            let unlisted = unlisted(place.as_ref(), path);
            let is_missing = unlisted.is_none();
            items.extend(unlisted);
            is_missing
        });
        items.sort_by(|a, b| a.path.cmp(&b.path));
    }
    let checked = Checked {
        units: items.len() + gone.len(),
        single: gone.is_empty() && matches!(items[..], [Item { what: What::Pack, .. }]),
    };
    if checked.units == 0 {
        return Err(nothing());
    }
    let progress = Progress::new();
    // Only who looks wants to know how much is left.
    for item in items.iter().filter(|_| progress.is_shown()) {
        expect(place.as_ref(), item, &progress);
    }
    for path in &gone {
        let before = report.count();
        let name = if path.is_empty() { report.target.clone() } else { path.clone() };
        report.add(
            name.clone(),
            Kind::Missing,
            format!(
                "it was there at an earlier check and is gone now; restore it from a copy or, if it was removed on purpose, run this \
                 command once with --forget '{path}'"
            ),
        );
        report.objects += 1;
        print_problems(args, &checked, report, before, &name, &progress)?;
    }
    for item in &items {
        let before = report.count();
        let name = if item.path.is_empty() { report.target.clone() } else { item.path.clone() };
        progress.at(&name);
        let Some(unit) = check(place.as_ref(), item, report, &mut state, &progress)? else {
            report.skipped += 1;
            continue;
        };
        report.objects += 1;
        report.sound_objects += u64::from(unit.problems == 0);
        print_problems(args, &checked, report, before, &name, &progress)?;
        // Nothing need be there under such a name, so nothing is missed later.
        if !matches!(item.what, What::Beside) {
            state.done(unit)?;
        }
    }
    progress.clear();
    state.finish()?;
    Ok(checked)
}

/// If there are several units, print the problems of one as soon as they are known: those from `before` on.
fn print_problems(
    args: &Args,
    checked: &Checked,
    report: &Report,
    before: u64,
    name: &str,
    progress: &Progress,
) -> anyhow::Result<()> {
    let problems = report.count() - before;
    if args.json || checked.units < 2 || problems == 0 {
        return Ok(());
    }
    let text = format!("{name}: {}\n{}", counted(problems, "problem", "problems"), report.problems_from(before));
    let mut result = Ok(());
    progress.above(|| result = crate::terminal::out().write_all(text.as_bytes()));
    Ok(result?)
}

/// The units in the state that no longer exist, except the bag of a withdrawn object, which the withdrawal removes. Files beside objects
/// and packs, which earlier versions of Kilwa wrote into the state, do not count either.
fn gone(place: &dyn Place, items: &[Item], state: &State) -> Vec<String> {
    let there: BTreeSet<&str> = items.iter().map(|item| item.path.as_str()).collect();
    let has_withdrawn_object = |name: &str| {
        let slug = name.strip_suffix(".bag")?;
        let manifest = place.below(slug).read(MANIFEST, MANIFEST_MAX).ok()??;
        Some(Manifest::parse(&manifest).ok()?.access.state == AccessState::Withdrawn)
    };
    let is_gone =
        |name: &&str| !there.contains(name) && !is_read_beside(name) && has_withdrawn_object(name) != Some(true);
    state.names().filter(is_gone).map(str::to_owned).collect()
}

/// An object or pack that the list at an address does not name; `None` if the server says that it does not exist. If the server gives
/// no clear answer, the check reports that.
fn unlisted(place: &dyn Place, path: &str) -> Option<Item> {
    let (what, found) = match path {
        "" => (What::Object, place.open(MANIFEST)),
        path if is_pack(path) => (What::Pack, place.open(path)),
        path => (What::Object, place.below(path).open(MANIFEST)),
    };
    (!matches!(found, Ok(None))).then(|| Item { path: path.to_owned(), what })
}

/// The report, and whether all is well.
fn say(args: &Args, checked: &Checked, report: &Report) -> anyhow::Result<()> {
    let Checked { single, units } = *checked;
    // Skipped units have no figures of their own.
    let single = single && report.skipped == 0;
    let mut out = crate::terminal::out();
    let result = if args.json {
        let value = if single { of_pack(report) } else { report.to_json() };
        writeln!(out, "{}", crate::terminal::json_text(&value)?)
    } else {
        for note in &report.notes {
            crate::terminal::say!("kilwa: {note}");
        }
        match &report.pack {
            Some(pack) if single => writeln!(out, "{}: {}", report.target, pack.summary()),
            _ if report.count() == 0 || units > 1 => writeln!(out, "{}: {}", report.target, report.summary()),
            _ => Ok(()),
        }
    };
    if report.count() == 0 {
        return Ok(result?);
    }
    // Damage is what counts, even where nobody listens to the report.
    if units > 1 {
        let bad = report.objects - report.sound_objects;
        bail!(
            "{}: {} in {} of {}",
            report.target,
            counted(report.count(), "problem", "problems"),
            bad,
            counted(report.objects, "object", "objects")
        );
    }
    let line = |p: &report::Problem| if single { p.what.clone() } else { format!("{}: {}", p.file, p.what) };
    let mut message =
        report.problems.iter().take(if single { NAMED } else { usize::MAX }).map(line).collect::<Vec<_>>().join("\n  ");
    let left = report.count() - (message.lines().count() as u64).min(report.count());
    if left > 0 {
        let _ = write!(message, "\n  and {}", counted(left, "more damaged part", "more damaged parts"));
    }
    Err(anyhow::anyhow!(message)).with_context(|| report.target.clone())
}

/// Check a pack that something is going to be made of.
///
/// # Errors
/// When it is damaged, naming the parts, or cannot be read.
pub(crate) fn sound(path: &Path, on_read: &dyn Fn(u64)) -> anyhow::Result<()> {
    let source = FileSource::open(path)?;
    let checked = sound::check(&source, on_read).with_context(|| path.display().to_string())?;
    match checked.damage() {
        None => Ok(()),
        Some(message) => Err(anyhow::anyhow!(message).context(path.display().to_string())),
    }
}

/// The report of a single pack, as JSON.
fn of_pack(report: &Report) -> serde_json::Value {
    let damaged: Vec<&str> = report.problems.iter().map(|p| p.what.as_str()).collect();
    let mut value = serde_json::json!({ "file": report.target, "sound": damaged.is_empty(), "damaged": damaged });
    if let (Some(pack), Some(map)) = (&report.pack, value.as_object_mut()) {
        map.insert("bytes".to_owned(), pack.bytes.into());
        map.insert("chunks".to_owned(), pack.chunks.into());
        map.insert("triangles".to_owned(), pack.triangles.into());
        map.insert("stored_triangles".to_owned(), pack.stored_triangles.into());
        map.insert("border_edges".to_owned(), pack.border_edges.into());
        map.insert("sha256".to_owned(), pack.sha256.clone().into());
    }
    value
}

/// What a target is called in a state file, from wherever it is checked.
fn canonical(target: &str) -> String {
    if is_address(target) {
        return shown(target).into_owned();
    }
    Path::new(target).canonicalize().map_or_else(|_| target.to_owned(), |path| path.display().to_string())
}

/// The units below a path of this computer; a folder may have none.
fn in_folder(target: &str) -> anyhow::Result<(Box<dyn Place>, Vec<Item>)> {
    let path = Path::new(target);
    let kind = std::fs::metadata(path).with_context(|| format!("cannot open {target}"))?;
    if !kind.is_dir() {
        // A link that the person named leads to its file.
        let path = path.canonicalize().with_context(|| format!("cannot open {target}"))?;
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let folder = folder_of(&path);
        return Ok((Box::new(Folder::new(folder.to_owned())), vec![Item { path: name, what: What::Pack }]));
    }
    let place = Box::new(Folder::new(path.to_owned()));
    if let Some(what) = kind_of(path) {
        return Ok((place, vec![Item { path: String::new(), what }]));
    }
    let mut items = Vec::new();
    for entry in std::fs::read_dir(path).with_context(|| format!("cannot read {target}"))? {
        let entry = entry.with_context(|| format!("cannot read {target}"))?;
        let path = entry.file_name().to_string_lossy().into_owned();
        if path.starts_with('.') {
            continue;
        }
        let is_plain = entry.file_type().is_ok_and(|kind| kind.is_file());
        let what = if is_read_beside(&path) {
            (!is_plain).then_some(What::Beside)
        } else if entry.path().is_dir() {
            kind_of(&entry.path())
        } else {
            entry.path().extension().is_some_and(|e| e == "kilwa").then_some(What::Pack)
        };
        items.extend(what.map(|what| Item { path, what }));
    }
    items.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((place, items))
}

/// Whether a name is that of a pack.
fn is_pack(name: &str) -> bool {
    Path::new(name).extension().is_some_and(|e| e == "kilwa")
}

/// Whether the server reads a file of this name beside objects and packs. Its content is not checked here.
fn is_read_beside(name: &str) -> bool {
    name == COLLECTIONS_FILE
        || name == SITE_FILE
        || name.ends_with(".annotations.json")
        || name.ends_with(".holes.geojson")
}

/// What a folder is. One with version folders and no manifest was an object. A manifest that is not a regular file is reported when it is
/// read, and so is a folder that this user cannot read.
fn kind_of(folder: &Path) -> Option<What> {
    let is_going = is_of_withdrawn(folder);
    if is_going || folder.join("bagit.txt").is_file() {
        return Some(What::Bag { is_going });
    }
    let may_have_manifest = match folder.join(MANIFEST).symlink_metadata() {
        Ok(_) => true,
        // Only root can read the folder that file systems keep for their repairs.
        Err(e) => e.kind() != ErrorKind::NotFound && !folder.ends_with("lost+found"),
    };
    (may_have_manifest || folder.join("v1").is_dir()).then_some(What::Object)
}

/// Whether a folder is the bag of a withdrawn object. The withdrawal removes it; if it still exists, the withdrawal was interrupted.
fn is_of_withdrawn(folder: &Path) -> bool {
    let Ok(folder) = folder.canonicalize() else { return false };
    let name = folder.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let Some(slug) = name.strip_suffix(".bag") else { return false };
    let manifest = plain_file::read_at(&folder.with_file_name(slug).join(MANIFEST), MANIFEST_MAX);
    let manifest = manifest.ok().and_then(|bytes| Manifest::parse(&bytes).ok());
    manifest.is_some_and(|manifest| manifest.access.state == AccessState::Withdrawn)
}

/// What there is at an address.
fn at_address(target: &str) -> anyhow::Result<(Box<dyn Place>, Vec<Item>)> {
    let (web, name) = Web::split(target);
    if is_pack(&name) {
        return Ok((Box::new(web), vec![Item { path: name, what: What::Pack }]));
    }
    let is_object = |place: &dyn Place| place.open(MANIFEST).map(|found| found.is_some());
    if is_object(&web).with_context(|| web.name(MANIFEST))? {
        return Ok((Box::new(web), vec![Item { path: String::new(), what: What::Object }]));
    }
    // The list of a site links to its objects.
    let mut items = Vec::new();
    let page = web.read(PAGE, LIST_MAX).and_then(|page| if page.is_some() { Ok(page) } else { web.read("", LIST_MAX) });
    let page = page.with_context(|| web.name(PAGE))?.unwrap_or_default();
    let mut seen = BTreeSet::new();
    for link in links::of_html(&String::from_utf8_lossy(&page)) {
        let Some(path) = links::target(&link, "", Some(&web.name(""))) else { continue };
        let path = path.strip_suffix(PAGE).unwrap_or(&path).trim_end_matches('/').to_owned();
        if path.is_empty() || !seen.insert(path.clone()) {
            continue;
        }
        if is_pack(&path) {
            items.push(Item { path, what: What::Pack });
        } else if !path.contains('.') && is_object(web.below(&path).as_ref()).with_context(|| web.name(&path))? {
            items.push(Item { path, what: What::Object });
        }
    }
    if items.is_empty() {
        bail!("there is no object at {target} (no {MANIFEST}), and no page that links to objects or packs");
    }
    // A list links to the packs of its objects too.
    let objects: Vec<String> =
        items.iter().filter(|i| matches!(i.what, What::Object)).map(|i| format!("{}/", i.path)).collect();
    items.retain(|item| !objects.iter().any(|object| item.path.starts_with(object)));
    items.sort_by(|a, b| a.path.cmp(&b.path));
    Ok((Box::new(web), items))
}

/// Tell the bar how much there is to read.
fn expect(place: &dyn Place, item: &Item, progress: &Progress) {
    let of_manifest = || {
        let manifest = place.below(&item.path).read(MANIFEST, LIST_MAX).ok()??;
        let manifest = Manifest::parse(&manifest).ok()?;
        Some(manifest.versions.iter().map(|v| v.pack.bytes).sum())
    };
    let bytes = if let What::Pack = item.what {
        place.open(&item.path).ok().flatten().and_then(|f| f.len().ok())
    } else if let Ok(Some(files)) = place.list(&item.path) {
        Some(files.iter().map(|(_, bytes)| bytes).sum())
    } else {
        of_manifest()
    };
    progress.expect(bytes.unwrap_or(0));
}

/// One unit; `None` where it was checked before.
fn check(
    place: &dyn Place,
    item: &Item,
    report: &mut Report,
    state: &mut State,
    progress: &Progress,
) -> anyhow::Result<Option<Unit>> {
    let before = report.count();
    let mut unit = Unit { name: item.path.clone(), ..Unit::default() };
    match item.what {
        What::Object => {
            let below = if item.path.is_empty() { None } else { Some(place.below(&item.path)) };
            let place = below.as_deref().unwrap_or(place);
            return Check { place, name: &item.path, report, state, progress }.object();
        }
        What::Bag { is_going } => {
            let below = if item.path.is_empty() { None } else { Some(place.below(&item.path)) };
            let place = below.as_deref().unwrap_or(place);
            unit.stamp = state.stamp(place, "");
            if !is_going && state.is_done(&item.path, "", &unit.stamp) {
                return Ok(None);
            }
            let mut check = Check { place, name: &item.path, report, state, progress };
            check.report.lacking = is_going.then_some(0);
            bag(&mut check)?;
            if is_going {
                check.say_withdrawal();
            }
        }
        What::Pack => {
            unit.stamp = state.stamp(place, &item.path);
            if state.is_done(&item.path, "", &unit.stamp) {
                return Ok(None);
            }
            let mut check = Check { place, name: "", report, state, progress };
            if let Some(found) = check.pack(&item.path, None)? {
                check.report.pack = Some(report::PackFigures::of(&found));
            }
        }
        What::Beside => {
            if let Err(e) = place.open(&item.path) {
                report.add(item.path.as_str(), Kind::Unreadable, format!("it cannot be read: {e}"));
            }
        }
    }
    unit.problems = report.count() - before;
    unit.at = now();
    Ok(Some(unit))
}

/// A bag (RFC 8493): its two lists, and the object in it.
fn bag(check: &mut Check<'_>) -> anyhow::Result<()> {
    let lists = ["manifest-sha256.txt", "tagmanifest-sha256.txt"];
    let mut known = check.files_of(lists[1], "", false)?;
    known.extend(check.files_of(lists[0], "", false)?);
    known.insert(lists[1].to_owned());
    // Without its lists, the files of a bag that is being removed are unknown.
    if check.report.lacking.is_none() || lists.iter().all(|list| matches!(check.place.open(list), Ok(Some(_)))) {
        check.unknown("", &known, lists[0]);
    }
    let payload = check.place.below("data");
    if !matches!(payload.open(MANIFEST), Ok(Some(_))) {
        check.add(&format!("data/{MANIFEST}"), Kind::Missing, "there is no object in this bag");
        return Ok(());
    }
    let name = if check.name.is_empty() { "data".to_owned() } else { format!("{}/data", check.name) };
    let Check { report, state, progress, .. } = check;
    Check { place: payload.as_ref(), name: &name, report, state, progress }.object()?;
    Ok(())
}

/// A progress bar on standard error, shown only where that is a terminal.
pub(crate) fn progress_bar(length: u64, what: &'static str) -> ProgressBar {
    let bar = ProgressBar::new(length);
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta} left") {
        bar.set_style(style);
    }
    bar.set_message(what);
    bar
}
