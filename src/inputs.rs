//! The inputs of a verb that reads meshes: which files, and where each belongs.
//!
//! Input: file names, folders (every mesh in them, recognised by its content, not those in subfolders) and patterns
//! that the shell has left alone (`'blocks/*.ply'`). Output: each file once, sorted by path, so that the order of the arguments does
//! not matter, each with the map from its own coordinates to metres, z up.
//!
//! Refused: a file that does not exist or of a format that is not read, a file named twice, a pattern that nothing
//! matches, a folder without meshes, a folder with something that is named like a mesh but is not one, something that matches a pattern but is not
//! a readable regular file (a broken link, a folder, a pipe), a matrix that cannot place a mesh.

pub(crate) mod remote;

use self::remote::{Allowed, Outlines, Remote};
use crate::named_files::{Wanted, named, refuse_link_out, refuse_twice};
use crate::stations::merged::Merging;
use crate::stations::{self, StationInput};
use anyhow::{Context, bail};
use glam::{DMat4, DVec3};
use kilwa_builder::build::journal::PlannedInput;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::Spool;
use kilwa_builder::{BuildError, Interruptible, Progress, Provenance};
use kilwa_files::atomic::folder_of;
use kilwa_files::plain_file;
use kilwa_formats::Up;
use kilwa_formats::read::texture::detail::Detail;
use kilwa_formats::read::{self, MESH_EXTENSIONS, Placed, Placement, ReadError, ReadOptions, Replaced};
use kilwa_geometry::LengthUnit;
use kilwa_pack::metadata::{SourceFile, sum_lines};
use kilwa_scan::survey;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Which meshes are read, and how their coordinates are interpreted.
#[derive(Clone, clap::Args)]
pub(crate) struct InputArgs {
    /// Mesh files (PLY, OBJ, STL, glTF, Nexus, 3D Tiles tilesets), ZIP downloads from Sketchfab, folders of meshes, quoted patterns such as 'blocks/*.ply', or surveys of scans.
    ///
    /// Several are joined, and matching vertices are welded; their order does not matter.
    #[arg(required = true, value_name = "INPUT")]
    pub(crate) inputs: Vec<PathBuf>,
    /// Units of the inputs: m, dm, cm, mm, km, ft, us-ft, in (default: m).
    #[arg(long, value_parser = units)]
    pub(crate) units: Option<LengthUnit>,
    /// Axis that points up in the inputs: z or y (default: z for PLY, OBJ and STL, y for glTF).
    #[arg(long, value_parser = up)]
    pub(crate) up: Option<Up>,
    /// Added to all coordinates, in the units and axes of the inputs, after --transform.
    #[arg(long, value_name = "X,Y,Z", value_parser = origin, allow_hyphen_values = true)]
    pub(crate) origin: Option<DVec3>,
    /// A 4 × 4 matrix that places every input: 16 numbers as text, row by row, as MeshLab and scanalyze write it; or
    /// `auto`: each NAME.ply has its own in NAME.xf beside it.
    #[arg(long, value_name = "FILE.xf|auto")]
    pub(crate) transform: Option<PathBuf>,
    /// Split triangles of OBJ and glTF so that no edge spans more than this many texels of a texture; the surface stays the same.
    ///
    /// Without it, vertices take the colour of the texture at their position, and nothing is split.
    #[arg(long, value_name = "TEXELS", value_parser = texels)]
    pub(crate) texture_detail: Option<f64>,
    /// Read files outside a mesh's own folder if it names them (materials, pictures, buffers), and meshes that links
    /// in a given folder lead to.
    ///
    /// Their contents become part of the pack. Use it only for meshes that you trust.
    #[arg(long)]
    pub(crate) allow_outside: bool,
    /// Also read what the masks of a survey mask.
    #[arg(long)]
    pub(crate) unmasked: bool,
    /// Whether meshes may be in object stores; set by the verbs that allow it.
    #[arg(skip)]
    pub(crate) stores: Option<Allowed>,
}

/// One input.
#[derive(Debug, Clone)]
pub(crate) struct InputFile {
    /// Where it is.
    pub(crate) path: PathBuf,
    /// The axis that points up in it.
    pub(crate) up: Up,
    /// From its coordinates to metres, z up.
    pub(crate) placement: Placement,
    /// How it is meshed, if it is a station of a survey.
    pub(crate) station: Option<StationInput>,
    /// The object, if the mesh is in a store; until it is downloaded, the path is that of its outline.
    pub(crate) remote: Option<Remote>,
}

impl InputFile {
    /// Its path or address, for messages and for the order of the inputs.
    pub(crate) fn place(&self) -> PathBuf {
        self.remote.as_ref().map_or_else(|| self.path.clone(), |remote| remote.address.to_string().into())
    }
}

/// All inputs.
#[derive(Debug)]
pub(crate) struct Inputs {
    /// How they are read.
    options: ReadOptions,
    /// The matrix files.
    matrices: Vec<PathBuf>,
    /// Sorted by path; at least one.
    pub(crate) files: Vec<InputFile>,
    /// Files in given folders that are no meshes that can be read.
    pub(crate) passed_over: Vec<PathBuf>,
    /// How the stations are merged, if they are; all files are stations then.
    pub(crate) merging: Option<Box<Merging>>,
    /// What the metadata records instead of the files.
    pub(crate) provenance: Option<Provenance>,
    /// Outlines of the meshes in stores.
    outlines: Option<Outlines>,
}

/// Bytes of the metadata block that names of sources may take: half of it, so that there is room for the rest and for
/// a picture in the head of the pack.
const SOURCE_BYTES: usize = 32 * 1024;

pub(crate) fn units(name: &str) -> Result<LengthUnit, String> {
    LengthUnit::parse(name).ok_or_else(|| format!("give one of {}", LengthUnit::symbols()))
}

pub(crate) fn up(name: &str) -> Result<Up, String> {
    match name {
        "z" => Ok(Up::Z),
        "y" => Ok(Up::Y),
        _ => Err("give z or y".to_owned()),
    }
}

pub(crate) fn origin(text: &str) -> Result<DVec3, String> {
    let numbers: Vec<f64> = text.split(',').map_while(|part| part.trim().parse().ok()).collect();
    match numbers.as_slice() {
        &[x, y, z] if text.matches(',').count() == 2 && [x, y, z].iter().all(|v| v.is_finite()) => {
            Ok(DVec3::new(x, y, z))
        }
        _ => Err("expected three numbers with commas between them, for example 500000,9000000,0".to_owned()),
    }
}

pub(crate) fn texels(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|v| (1.0..=65536.0).contains(v))
        .ok_or_else(|| "expected a number from 1 to 65536".to_owned())
}

impl Inputs {
    /// Find all that the arguments name.
    ///
    /// With `points`, they must be surveys, whose stations need no grid.
    pub(crate) fn find(args: &InputArgs, points: bool) -> anyhow::Result<Self> {
        let is_remote = |given: &PathBuf| given.to_str().is_some_and(kilwa_store::is_address);
        let (remote, local): (Vec<PathBuf>, Vec<PathBuf>) = args.inputs.iter().cloned().partition(is_remote);
        let (surveys, mut meshes): (Vec<PathBuf>, Vec<PathBuf>) =
            local.into_iter().partition(|given| survey::is_survey(given));
        if points && let Some(other) = meshes.first() {
            bail!(
                "{} is no survey; --points builds the points of surveys: import point clouds with `kilwa scans import {0} -o survey/`",
                other.display()
            );
        }
        let is_auto = args.transform.as_ref().is_some_and(|file| file.as_os_str() == "auto");
        let outlines = match (remote.first(), &args.stores) {
            (None, _) => None,
            (Some(first), None) => {
                bail!("{}: only `kilwa plan` reads meshes from a store; copy it to this machine first", first.display())
            }
            (Some(_), Some(allowed)) => Some(Outlines::of(&remote, allowed, is_auto)?),
        };
        meshes.extend(outlines.iter().flat_map(Outlines::paths).cloned());
        let in_words = |e: anyhow::Error| match &outlines {
            Some(outlines) => anyhow::anyhow!(outlines.in_words(&format!("{e:#}"))),
            None => e,
        };
        let (named, mut passed_over) = named(&meshes, args.allow_outside, &MESHES).map_err(in_words)?;
        let common = match &args.transform {
            Some(file) if file.as_os_str() != "auto" => matrix(file)?,
            _ => Placement::IDENTITY,
        };
        let matrices = match &args.transform {
            Some(_) if is_auto => named.iter().map(|path| path.with_extension("xf")).collect(),
            file => file.iter().cloned().collect(),
        };
        let mut files = Vec::with_capacity(named.len());
        for path in named {
            let format = read::recognise(&path)?;
            let up = args.up.unwrap_or(format.up);
            let own = if is_auto { own_matrix(&path, args.allow_outside).map_err(in_words)? } else { common };
            let placement = own
                .then(&Placement::translation(args.origin.unwrap_or_default()))
                .then(&Placement::to_metres(args.units.unwrap_or_default(), up));
            let remote = outlines.as_ref().and_then(|outlines| outlines.remote(&path));
            files.push(InputFile { path, up, placement, station: None, remote });
        }
        for folder in &surveys {
            let origin = Placement::translation(args.origin.unwrap_or_default());
            for (path, station) in stations::of(folder, args.unmasked, points)? {
                let placement = common.then(&origin);
                files.push(InputFile { path, up: Up::Z, placement, station: Some(station), remote: None });
            }
        }
        if outlines.is_some() {
            files.sort_by_cached_key(InputFile::place);
        }
        if !surveys.is_empty() {
            files.sort_by_cached_key(InputFile::place);
            refuse_twice(&files.iter().map(|file| file.path.clone()).collect::<Vec<_>>())?;
        }
        passed_over.sort();
        let detail = args.texture_detail.map(|texels| Arc::new(Detail::new(texels)));
        let options = ReadOptions { detail, allow_outside: args.allow_outside, ..ReadOptions::default() };
        Ok(Self { options, matrices, files, passed_over, merging: None, provenance: None, outlines })
    }

    /// Refuse an output that would replace an input. Files that the meshes refer to are known only when the meshes are read; they
    /// are refused then, before anything is replaced.
    pub(crate) fn refuse_as_output(&mut self, output: &Path) -> anyhow::Result<()> {
        let read = self.files.iter().map(|file| &file.path).chain(&self.matrices);
        crate::new_file::refuse_inputs(output, read.map(PathBuf::as_path))?;
        let Ok(real) = output.canonicalize() else { return Ok(()) };
        let cannot = || format!("cannot read the metadata of {}", output.display());
        self.options.replaced = Some(Arc::new(Replaced::new(real.metadata().with_context(cannot)?)));
        Ok(())
    }

    /// A text that differs if the placement of a file, or how it is meshed, differs.
    fn placement_of(&self, file: &InputFile) -> String {
        match &file.station {
            Some(station) => {
                let merging = self.merging.as_ref().map(|merging| merging.plan()).unwrap_or_default();
                format!("{:?} {station:?}{merging}", file.placement)
            }
            None => format!("{:?} {:?}", file.placement, self.options.detail.as_ref().map(|d| d.texels())),
        }
    }

    /// Download the inputs that are in stores to the scratch folder, unless this was done before.
    pub(crate) fn fetch(&mut self, work: &Work<'_>) -> Result<(), BuildError> {
        let Some(outlines) = &self.outlines else { return Ok(()) };
        let of_outline = |file: &&mut InputFile| outlines.remote(&file.path).is_some();
        let wanted: Vec<&mut InputFile> = self.files.iter_mut().filter(of_outline).collect();
        let total = wanted.iter().filter_map(|file| Some(file.remote.as_ref()?.about.bytes)).sum();
        let mut before = 0;
        for file in wanted {
            if let Some(remote) = &file.remote {
                file.path = remote.fetch(work, before, total)?;
                before += remote.about.bytes;
            }
        }
        Ok(())
    }

    /// The axis that points up, as the metadata has it: that of most inputs where they differ.
    pub(crate) fn up(&self) -> Up {
        let y = self.files.iter().filter(|f| f.up == Up::Y).count();
        if 2 * y > self.files.len() { Up::Y } else { Up::Z }
    }

    /// The names of all files, for messages; the first few where there are many.
    pub(crate) fn names(&self) -> String {
        const SHOWN: usize = 5;
        let shown: Vec<String> = self.files.iter().take(SHOWN).map(|f| f.place().display().to_string()).collect();
        let more = self.files.len().saturating_sub(SHOWN);
        if more > 0 { format!("{} and {more} more", shown.join(", ")) } else { shown.join(", ") }
    }

    /// What the metadata says of the files: each with its SHA-256, sorted by name. Where they are too many, the last
    /// entry represents all that have no entry of their own.
    ///
    /// Fails where a file cannot be read, or two have the same content and the same place: a surface that is there twice.
    pub(crate) fn sources(&self, progress: &dyn Progress, stop: &Stop) -> Result<Vec<SourceFile>, BuildError> {
        let mut all: Vec<(SourceFile, &InputFile)> = Vec::with_capacity(self.files.len());
        let mut seen: BTreeMap<String, &InputFile> = BTreeMap::new();
        for file in &self.files {
            let source = source_file(&file.path, progress, stop)?;
            if let Some(same) = seen.get(&source.sha256)
                && (&same.placement, &same.station) == (&file.placement, &file.station)
            {
                return Err(ReadError::Twice { file: file.path.clone(), other: same.path.clone() }.into());
            }
            seen.entry(source.sha256.clone()).or_insert(file);
            all.push((source, file));
        }
        let mut sources: Vec<SourceFile> = all.into_iter().map(|(source, _)| source).collect();
        sources.sort_by(|a, b| (&a.name, &a.sha256).cmp(&(&b.name, &b.sha256)));
        Ok(summarised(sources))
    }
}

impl kilwa_builder::Inputs for Inputs {
    fn plan(&self) -> Result<Vec<PlannedInput>, BuildError> {
        let planned = |file: &InputFile| {
            if let Some(Remote { address, about, .. }) = &file.remote {
                return Ok(PlannedInput {
                    path: address.to_string(),
                    bytes: about.bytes,
                    modified: None,
                    placement: self.placement_of(file),
                    stamp: String::new(),
                    tag: about.tag.clone(),
                });
            }
            let cannot = |source| ReadError::Open { file: file.path.clone(), source };
            let path = file.path.canonicalize().map_err(cannot)?;
            let about = path.metadata().map_err(cannot)?;
            let modified = about.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
            Ok(PlannedInput {
                path: path.display().to_string(),
                bytes: about.len(),
                modified: modified.and_then(|t| u64::try_from(t.as_nanos()).ok()),
                placement: self.placement_of(file),
                stamp: plain_file::stamp(&about),
                tag: None,
            })
        };
        self.files.iter().map(planned).collect()
    }

    fn is_unchanged(
        &self,
        number: usize,
        sources: &[SourceFile],
        progress: &dyn Progress,
        stop: &Stop,
    ) -> Result<bool, BuildError> {
        let Some(file) = self.files.get(number) else { return Ok(false) };
        // Sources are identified only by name.
        if self.files.iter().filter(|other| other.path.file_name() == file.path.file_name()).count() != 1 {
            return Ok(false);
        }
        Ok(sources.contains(&source_file(&file.path, progress, stop)?))
    }

    fn deliver(&mut self, spool: &mut Spool, work: &Work<'_>) -> Result<Provenance, BuildError> {
        self.fetch(work)?;
        let total: u64 = self.files.iter().map(|f| f.path.metadata().map_or(0, |about| about.len())).sum();
        work.scratch.folder().clone_into(&mut self.options.scratch);
        self.options.memory = self.options.memory.min(work.memory / 2);
        self.options.document = work.memory / 2;
        self.options.picture = work.memory / 2;
        if self.options.detail.is_some() {
            for (i, file) in (0..).zip(self.files.iter().filter(|file| file.station.is_none())) {
                work.stop.check()?;
                read::note_detail(&file.path, &self.options, &mut |_, _| ())?;
                work.progress.update("measuring pictures", i + 1, self.files.len() as u64);
            }
        }
        if let Some(merging) = &self.merging {
            spool.input(&merging.folder)?;
            let capture = merging.deliver(&mut Interruptible::new(spool, work.stop, &merging.folder), work)?;
            return Ok(Provenance { sources: self.sources(work.progress, work.stop)?, capture });
        }
        let mut before = 0;
        for file in &self.files {
            work.stop.check()?;
            spool.input(&file.path)?;
            let mut of_file = 0;
            let progress = &mut |done: u64, all: u64| {
                of_file = all;
                work.progress.update("reading", before + done, total.max(before + done));
            };
            let mut sink = Interruptible::new(spool, work.stop, &file.path);
            let mut placed = Placed::new(&mut sink, file.placement);
            if let Some(station) = &file.station {
                let bytes = file.path.metadata().map_or(0, |about| about.len());
                let share = |done: u64, all: u64| (done as f64 / all.max(1) as f64 * bytes as f64) as u64;
                stations::deliver(&file.path, station, &mut placed, &mut |done, all| {
                    progress(share(done, all), bytes);
                })?;
                before += bytes;
                continue;
            }
            let done = read::read_into_with(&file.path, &self.options, &mut placed, progress);
            if self.options.replaced.as_ref().is_some_and(|output| output.is_met()) {
                return Err(ReadError::Replaced { file: file.path.clone() }.into());
            }
            done?;
            before += of_file;
        }
        if let Some(provenance) = &self.provenance {
            return Ok(provenance.clone());
        }
        Ok(Provenance { sources: self.sources(work.progress, work.stop)?, capture: None })
    }
}

/// As many as there is room for; the rest as one entry: how many, their bytes, and the SHA-256 of their lines as
/// `sha256sum` writes them.
pub(crate) fn summarised(mut sources: Vec<SourceFile>) -> Vec<SourceFile> {
    let mut bytes = 0;
    let fits = |s: &SourceFile| {
        // {"name":"…","bytes":…,"sha256":"…"}, a name escaped at the most.
        bytes += 130 + s.name.escape_default().count();
        bytes <= SOURCE_BYTES
    };
    let own = sources.iter().map(fits).take_while(|fits| *fits).count();
    if own < sources.len() {
        let rest = sources.split_off(own);
        let lines = sum_lines(rest.iter().map(|s| (s.sha256.as_str(), s.name.as_str())));
        let bytes = rest.iter().map(|s| s.bytes).sum();
        sources.push(SourceFile::of_further(rest.len(), bytes, hexadecimal(&Sha256::digest(lines))));
    }
    sources
}

const MESHES: Wanted = Wanted {
    what: "mesh",
    formats: "PLY, OBJ, STL, glTF, Nexus, 3D Tiles",
    is_named: is_named_as_mesh,
    recognise: recognise_in_folder,
};

/// Fails unless a file in a folder is a mesh. Tilesets are refused: the tiles beside one are the same surface at several levels of detail.
/// So are archives, because what was unpacked from one is likely to lie beside it.
fn recognise_in_folder(path: &Path) -> anyhow::Result<()> {
    if read::archive::is_archive(path) {
        bail!("{} is an archive; give the file itself instead of its folder", path.display());
    }
    if read::recognise(path)?.is_tileset() {
        bail!("{} is a 3D Tiles tileset; give the file itself instead of its folder", path.display());
    }
    Ok(())
}

fn is_named_as_mesh(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    let is_tileset = path.file_name().is_some_and(|name| name.eq_ignore_ascii_case("tileset.json"));
    is_tileset || MESH_EXTENSIONS.iter().any(|e| e.eq_ignore_ascii_case(extension))
}

/// The matrix beside an input.
fn own_matrix(input: &Path, allow_outside: bool) -> anyhow::Result<Placement> {
    let file = input.with_extension("xf");
    if !file.is_file() {
        let name = file.display();
        bail!(
            "{name} does not exist: with --transform auto, every input needs a matrix file beside it (1 0 0 0  0 1 0 0  0 0 1 0  0 0 0 1 means no change)"
        );
    }
    if !allow_outside {
        let folder = folder_of(input);
        let real = folder.canonicalize().with_context(|| format!("{} cannot be opened", folder.display()))?;
        refuse_link_out(&file, &real)?;
    }
    matrix(&file)
}

/// The matrix in a file.
fn matrix(file: &Path) -> anyhow::Result<Placement> {
    /// More is no matrix.
    const MAX: u64 = 64 * 1024;
    let mut text = String::new();
    read::open_regular(file)
        .and_then(|(f, _)| f.take(MAX).read_to_string(&mut text))
        .with_context(|| format!("cannot read {}", file.display()))?;
    let words = text.lines().flat_map(|line| line.split('#').next().unwrap_or_default().split_whitespace());
    let mut numbers = Vec::new();
    for word in words {
        // Not the word itself: where this is another file than was meant, its content is nobody's business.
        let place = numbers.len() + 1;
        let number: f64 =
            word.parse().with_context(|| format!("{}: word {place} is not a number; 16 are needed", file.display()))?;
        numbers.push(number);
    }
    if numbers.len() != 16 {
        bail!("{} has {} numbers; a 4 × 4 matrix has 16, row by row", file.display(), numbers.len());
    }
    Placement::from_matrix(DMat4::from_cols_slice(&numbers).transpose())
        .map_err(|why| anyhow::anyhow!("{}: {why}", file.display()))
}

/// Name, length and hash of a file.
pub(crate) fn source_file(path: &Path, progress: &dyn Progress, stop: &Stop) -> Result<SourceFile, BuildError> {
    let cannot = |source| ReadError::Open { file: path.to_owned(), source };
    let (mut file, total) = read::open_regular(path).map_err(cannot)?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    let mut bytes = 0;
    loop {
        stop.check()?;
        let n = file.read(&mut buffer).map_err(cannot)?;
        if n == 0 {
            break;
        }
        hash.update(&buffer[..n]);
        bytes += n as u64;
        progress.update("hashing", bytes, total);
    }
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    Ok(SourceFile { name, bytes, sha256: hexadecimal(&hash.finalize()) })
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, b| {
        // Writing to a string cannot fail.
        let _ = write!(text, "{b:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use kilwa_builder::Silent;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        input: InputArgs,
    }

    const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

    struct Site(tempfile::TempDir);

    impl Site {
        fn new(files: &[(&str, &str)]) -> Self {
            let site = Self(tempfile::tempdir().unwrap());
            for (name, text) in files {
                std::fs::write(site.path(name), text).unwrap();
            }
            site
        }

        fn path(&self, name: &str) -> PathBuf {
            self.0.path().join(name)
        }

        fn find(&self, args: &[&str]) -> anyhow::Result<Inputs> {
            let inside = |a: &&str| {
                if a.starts_with('-') || a.contains(',') { (*a).to_owned() } else { self.path(a).display().to_string() }
            };
            let args: Vec<String> = std::iter::once("kilwa".to_owned()).chain(args.iter().map(inside)).collect();
            Inputs::find(&Cli::try_parse_from(args)?.input, false)
        }

        fn names(&self, args: &[&str]) -> Vec<String> {
            let found = self.find(args).unwrap_or_else(|e| panic!("{e:#}"));
            found.files.iter().map(|f| f.path.file_name().unwrap().to_string_lossy().into_owned()).collect()
        }

        fn refusal(&self, args: &[&str]) -> String {
            format!("{:#}", self.find(args).err().unwrap())
        }
    }

    fn three() -> Site {
        Site::new(&[("b.obj", TRIANGLE), ("a.obj", TRIANGLE), ("c[1].dat", TRIANGLE), ("notes.txt", "of the survey")])
    }

    #[test]
    fn the_result_does_not_depend_on_the_order_of_arguments() {
        let site = three();
        assert_eq!(site.names(&["b.obj", "a.obj"]), ["a.obj", "b.obj"]);
        assert_eq!(site.names(&["a.obj", "b.obj"]), ["a.obj", "b.obj"]);
    }

    #[test]
    fn folders_give_every_file_with_mesh_content_and_patterns_every_match() {
        let site = three();
        std::fs::create_dir(site.path("further")).unwrap();
        std::fs::write(site.path("further/d.obj"), TRIANGLE).unwrap();
        assert_eq!(site.names(&[""]), ["a.obj", "b.obj", "c[1].dat"]);
        assert_eq!(site.find(&[""]).unwrap().passed_over, [site.path("notes.txt")]);
        assert_eq!(site.names(&["?.obj"]), ["a.obj", "b.obj"]);
        assert_eq!(site.names(&["*/*.obj", "b.*"]), ["b.obj", "d.obj"]);
        assert_eq!(site.names(&["c[1].dat"]), ["c[1].dat"], "a name that is there is no pattern");
    }

    #[test]
    fn inputs_that_are_missing_repeated_or_no_mesh_are_refused_by_name() {
        let site = three();
        assert!(site.refusal(&["none.obj"]).contains("none.obj cannot be opened"));
        assert!(site.refusal(&["x*.obj"]).contains("no file matches"));
        assert!(site.refusal(&["a.obj", "?.obj"]).contains("a.obj is given twice"));
        // Not with a pattern that matches the folders of other tests, which come and go.
        std::fs::create_dir(site.path("further")).unwrap();
        assert!(site.refusal(&["a.obj", "./b.obj", "further/../b.*"]).contains("are the same file"));
        assert!(site.refusal(&["notes.txt"]).contains("notes.txt"));
        let empty = Site::new(&[("notes.txt", "of the survey")]);
        assert!(empty.refusal(&[""]).contains("contains no readable mesh"));
        std::fs::write(site.path("d.ply"), "cut").unwrap();
        assert!(site.refusal(&[""]).contains("d.ply"), "a damaged block does not go missing without a word");
    }

    /// For example a block on a disk that is not mounted, or something that is not what its name says.
    #[cfg(unix)]
    #[test]
    fn an_unreadable_block_is_refused_by_name() {
        use std::os::unix::fs::symlink;
        type Make<'a> = (&'a dyn Fn(&Site), &'a str);
        let makes: [Make<'_>; 7] = [
            (
                &|site| symlink("/gone/d.obj", site.path("d.obj")).unwrap(),
                "a link to /gone/d.obj, which does not exist",
            ),
            (&|site| symlink("d.obj", site.path("d.obj")).unwrap(), "symbolic links"),
            (
                &|site| {
                    let made = std::process::Command::new("mkfifo").arg(site.path("d.obj")).status();
                    assert!(made.unwrap().success());
                },
                "a pipe",
            ),
            (&|site| drop(std::os::unix::net::UnixListener::bind(site.path("d.obj")).unwrap()), "a socket"),
            (&|site| symlink("/dev/zero", site.path("d.obj")).unwrap(), "a device"),
            (&|site| std::fs::create_dir(site.path("d.obj")).unwrap(), "a folder"),
            (
                &|site| {
                    std::fs::create_dir(site.path("blocks")).unwrap();
                    symlink("blocks", site.path("d.obj")).unwrap();
                },
                "a folder",
            ),
        ];
        for (make, cause) in makes {
            let site = Site::new(&[("a.obj", TRIANGLE)]);
            make(&site);
            let folder = site.0.path().file_name().unwrap().to_str().unwrap().to_owned();
            let exact = format!("../{}*/d.obj", &folder[..folder.len() - 1]);
            for input in ["", "*.obj", "[ad].obj", &exact] {
                let message = site.refusal(&[input]);
                assert!(message.contains("d.obj") && message.contains(cause), "{input:?}: {message}");
            }
            std::fs::rename(site.path("d.obj"), site.path("d.txt")).unwrap();
            assert_eq!(site.names(&["", "--allow-outside"]), ["a.obj"], "{cause}");
        }
    }

    #[test]
    fn coordinates_are_transformed_by_matrix_then_origin_then_units() {
        let site = three();
        std::fs::write(site.path("a.xf"), "# scan a\n0 -1 0 10\n1 0 0 20\n0 0 1 30\n0 0 0 1\n").unwrap();
        let place = |args: &[&str], p: [f64; 3]| site.find(args).unwrap().files[0].placement.place(p.into()).to_array();
        assert_eq!(place(&["a.obj"], [1.0, 2.0, 3.0]), [1.0, 2.0, 3.0]);
        let all = ["a.obj", "--transform", "a.xf", "--units=cm", "--origin=100,-200,0.5"];
        assert_eq!(place(&all, [1.0, 0.0, 0.0]), [1.1, -1.79, 0.305]);
        assert_eq!(place(&["a.obj", "--up=y"], [1.0, 2.0, 3.0]), [1.0, -3.0, 2.0]);
    }

    #[test]
    fn each_input_has_its_own_matrix_with_auto() {
        let site = three();
        std::fs::write(site.path("a.xf"), "1 0 0 5  0 1 0 0  0 0 1 0  0 0 0 1").unwrap();
        let auto = |inputs: &[&str]| {
            let mut args: Vec<String> = inputs.iter().map(|i| site.path(i).display().to_string()).collect();
            args.extend(["--transform".to_owned(), "auto".to_owned()]);
            args.insert(0, "kilwa".to_owned());
            Inputs::find(&Cli::try_parse_from(args).unwrap().input, false)
        };
        assert_eq!(auto(&["a.obj"]).unwrap().files[0].placement.place(DVec3::ZERO), DVec3::new(5.0, 0.0, 0.0));
        assert!(format!("{:#}", auto(&["a.obj", "b.obj"]).unwrap_err()).contains("b.xf does not exist"));
    }

    #[test]
    fn invalid_matrices_are_refused_with_the_reason() {
        let site = three();
        for (text, reason) in [
            ("1 2 3", "has 3 numbers"),
            ("a", "is not a number"),
            ("1 0 0 0 0 1 0 0 0 0 1 0 5 5 5 1", "column by column"),
            ("1 0 0 0 0 1 0 0 0 0 0 0 0 0 0 1", "flattens"),
        ] {
            std::fs::write(site.path("m.xf"), text).unwrap();
            let message = site.refusal(&["a.obj", "--transform", "m.xf"]);
            assert!(message.contains("m.xf") && message.contains(reason), "{message}");
        }
    }

    #[test]
    fn a_gltf_is_y_up_by_default() {
        let gltf = r#"{"asset":{"version":"2.0"},"meshes":[],"accessors":[]}"#;
        let site = Site::new(&[("a.gltf", gltf), ("b.obj", TRIANGLE)]);
        let ups = |args: &[&str]| site.find(args).unwrap().files.iter().map(|f| f.up).collect::<Vec<_>>();
        assert_eq!(ups(&["a.gltf", "b.obj"]), [Up::Y, Up::Z]);
        assert_eq!(ups(&["a.gltf", "b.obj", "--up=z"]), [Up::Z, Up::Z]);
    }

    #[test]
    fn the_same_content_is_refused_at_the_same_position_and_accepted_elsewhere() {
        let site = three();
        let two = site.find(&["a.obj", "b.obj"]).unwrap();
        let message = format!("{:#}", two.sources(&Silent, &Stop::default()).unwrap_err());
        assert!(
            message.contains("a.obj") && message.contains("b.obj") && message.contains("same content"),
            "{message}"
        );
        let mut moved = two;
        moved.files[1].placement = Placement::translation(DVec3::new(5.0, 0.0, 0.0));
        assert_eq!(moved.sources(&Silent, &Stop::default()).unwrap().len(), 2);
    }

    #[test]
    fn an_input_is_unchanged_if_its_content_is_the_same() {
        use kilwa_builder::Inputs as _;
        let site = three();
        std::fs::write(site.path("b.obj"), format!("# b\n{TRIANGLE}")).unwrap();
        let inputs = site.find(&["a.obj", "b.obj"]).unwrap();
        let sources = inputs.sources(&Silent, &Stop::default()).unwrap();
        let is_unchanged = |number| inputs.is_unchanged(number, &sources, &Silent, &Stop::default()).unwrap();
        assert!(is_unchanged(0) && is_unchanged(1) && !is_unchanged(2));
        let before = inputs.plan().unwrap();
        // File times may advance in steps of a few milliseconds: wait for the next one.
        let began = std::time::Instant::now();
        while is_unchanged(1) {
            assert!(began.elapsed().as_secs() < 60, "it has changed");
            std::fs::write(site.path("b.obj"), format!("# c\n{TRIANGLE}")).unwrap();
        }
        assert!(is_unchanged(0));
        assert_ne!(inputs.plan().unwrap()[1].stamp, before[1].stamp);
    }

    #[test]
    fn thousands_of_sources_are_named_as_far_as_space_allows_and_then_counted() {
        let source = |i: u64| SourceFile { name: format!("block_{i:05}.ply"), bytes: i, sha256: format!("{i:064x}") };
        let few: Vec<SourceFile> = (0..100).map(source).collect();
        assert_eq!(summarised(few.clone()), few);
        let many = summarised((0..5000).map(source).collect());
        let (last, own) = many.split_last().unwrap();
        assert_eq!(own, (0..own.len() as u64).map(source).collect::<Vec<_>>());
        assert!(own.len() > 150 && serde_json::to_vec(&many).unwrap().len() <= SOURCE_BYTES + 300);
        assert_eq!(last.stands_for(), Some(5000 - own.len()));
        assert_eq!(last.bytes, (own.len() as u64..5000).sum::<u64>());
        // The hash holds every byte of the rest.
        let mut other: Vec<SourceFile> = (0..5000).map(source).collect();
        other[4999].sha256 = "f".repeat(64);
        assert_ne!(summarised(other).last().unwrap().sha256, last.sha256);
    }
}
