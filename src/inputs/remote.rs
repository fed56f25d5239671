//! Meshes in object stores, `s3://bucket/wall.ply`, for `kilwa plan` and the task that reads the inputs.
//!
//! The first bytes of a mesh show its format. `kilwa plan` therefore makes an *outline* of each mesh: a local sparse file with the same length and
//! the same first bytes. The whole mesh is downloaded when it is read, and must then be the same object: its ETag and length are part of the plan.
//! Formats whose meshes refer to other files are refused, and so are GLBs that do, because those files are not downloaded.

mod glb;

use crate::new_file::{PrivateFolder, private_folder_in};
use crate::stores;
use anyhow::{Context, bail};
use kilwa_builder::BuildError;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_formats::read;
use kilwa_store::{Address, ObjectError, ObjectInfo, Objects};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Bytes at the beginning of a mesh that its outline contains.
const BEGINNING: u64 = 1 << 16;
/// Maximum length of a matrix file.
const MATRIX: u64 = 1 << 16;
/// What a GLB begins with.
const GLB: &[u8] = b"glTF";
/// Folder of the downloaded meshes, in the scratch folder.
const FOLDER: &str = "inputs";

/// Permission to read meshes from stores.
#[derive(Debug, Clone)]
pub(crate) struct Allowed {
    /// Existing folder for outlines.
    pub(crate) scratch: PathBuf,
    pub(crate) stop: Stop,
}

/// A mesh in a store.
#[derive(Debug, Clone)]
pub(crate) struct Remote {
    pub(crate) address: Address,
    pub(crate) about: ObjectInfo,
    objects: Objects,
}

/// The outlines of meshes; they are removed when it is dropped.
#[derive(Debug)]
pub(crate) struct Outlines {
    folder: PrivateFolder,
    all: Vec<(PathBuf, Remote)>,
}

impl Outlines {
    /// Make the outlines of the arguments; `with_matrices`: each with the matrix file next to it.
    ///
    /// # Errors
    /// If there is no such object, or its format cannot be read from a store.
    pub(crate) fn of(given: &[PathBuf], allowed: &Allowed, with_matrices: bool) -> anyhow::Result<Self> {
        let folder = private_folder_in(&allowed.scratch, "kilwa-inputs-");
        let folder = folder.with_context(|| format!("cannot make a folder in {}", allowed.scratch.display()))?;
        let mut outlines = Self { folder, all: Vec::new() };
        for given in given {
            let address = stores::address(given)?.with_context(|| format!("{} is not an address", given.display()))?;
            let objects = stores::objects(&address.bucket, &allowed.stop)?;
            outlines.add(address, objects, with_matrices)?;
        }
        Ok(outlines)
    }

    fn add(&mut self, address: Address, objects: Objects, with_matrix: bool) -> anyhow::Result<()> {
        let cannot = || format!("cannot read {address}");
        let about = objects.info(&address.path).with_context(cannot)?;
        let about = about.with_context(|| format!("{address} does not exist; give the address of one object"))?;
        let beginning = match about.bytes.min(BEGINNING) {
            0 => Vec::new(),
            bytes => objects.read(&address.path, 0..bytes).with_context(cannot)?.to_vec(),
        };
        let outline = self.path(&address);
        if outline.exists() {
            bail!("{address} was given twice");
        }
        write_outline(&outline, &beginning, about.bytes)
            .with_context(|| format!("cannot write {}", outline.display()))?;
        let matrix = Path::new(address.path.as_ref()).with_extension("xf");
        if let (true, Some(key)) = (with_matrix, matrix.to_str()) {
            let url = format!("s3://{}/{key}", address.bucket);
            let cannot = || format!("cannot read {url}");
            // Parsed like an address, because a path made from text would be escaped again.
            let matrix = Address::parse(&url).with_context(cannot)?;
            let found = objects.read_all(&matrix.path, MATRIX).with_context(cannot)?;
            found.map_or(Ok(()), |bytes| std::fs::write(outline.with_extension("xf"), bytes))?;
        }
        let format = read::recognise(&outline).map_err(|e| anyhow::anyhow!(self.in_words(&e.to_string())))?;
        let is_whole = ["PLY", "STL", "Nexus"].contains(&format.name) || beginning.starts_with(GLB);
        if !is_whole {
            bail!(
                "{address}: meshes of the format {} may refer to other files, which are not downloaded from a store; use PLY, STL, GLB or Nexus, or copy the mesh with its files to a folder that all machines see",
                format.name
            );
        }
        if beginning.starts_with(GLB)
            && let Some(uri) = glb::refers_to(&objects, &address, about.bytes, &beginning).with_context(cannot)?
        {
            bail!(
                "{address} refers to the file {}, which is not downloaded from a store; embed it (export one GLB with all pictures and buffers), or copy the mesh with its files to a folder that all machines see",
                kilwa_pack::visible::visible(&uri)
            );
        }
        self.all.push((outline, Remote { address, about, objects }));
        Ok(())
    }

    /// The path of the outline of an object.
    fn path(&self, address: &Address) -> PathBuf {
        below(self.folder.path(), address)
    }

    /// The outlines.
    pub(crate) fn paths(&self) -> impl Iterator<Item = &PathBuf> {
        self.all.iter().map(|(outline, _)| outline)
    }

    /// The object that this outline belongs to.
    pub(crate) fn remote(&self, path: &Path) -> Option<Remote> {
        self.all.iter().find(|(outline, _)| outline == path).map(|(_, remote)| remote.clone())
    }

    /// A message with the paths of outlines replaced by the addresses of their objects.
    pub(crate) fn in_words(&self, message: &str) -> String {
        message.replace(&*self.folder.path().to_string_lossy(), "s3:/")
    }
}

impl Remote {
    /// Copy it to the scratch folder; `before` of the `total` bytes of all inputs have already been downloaded.
    ///
    /// # Errors
    /// [`BuildError::Inputs`] if it has changed since it was planned, or cannot be read.
    pub(crate) fn fetch(&self, work: &Work<'_>, before: u64, total: u64) -> Result<PathBuf, BuildError> {
        let to = below(&downloads(work.scratch.folder()), &self.address);
        let address = &self.address;
        let made = to.parent().map_or(Ok(()), std::fs::create_dir_all);
        made.map_err(|e| BuildError::Inputs { why: format!("cannot make a folder for {}: {e}", to.display()) })?;
        let progress = &mut |done: u64, _: u64| work.progress.update("downloading", before + done, total);
        self.objects.download(&address.path, &self.about, &to, progress).map_err(|e| match e {
            ObjectError::Stopped => BuildError::Stopped,
            ObjectError::Changed | ObjectError::Missing => BuildError::Inputs {
                why: format!("{address} was changed or removed while it was read; run `kilwa plan` again"),
            },
            e => BuildError::Inputs { why: format!("cannot read {address}: {e}") },
        })?;
        Ok(to)
    }
}

/// A message with the paths of downloaded files replaced by the addresses of their objects.
pub(crate) fn in_words(message: &str, scratch: &Path) -> String {
    message.replace(&*downloads(scratch).to_string_lossy(), "s3:/")
}

/// The folder that meshes are downloaded to.
pub(crate) fn downloads(scratch: &Path) -> PathBuf {
    scratch.join(FOLDER)
}

/// The file for an object; files are in the order of addresses.
fn below(folder: &Path, address: &Address) -> PathBuf {
    let parts = address.path.parts();
    parts.fold(folder.join(&address.bucket), |path, part| path.join::<&str>(part.as_ref()))
}

fn write_outline(path: &Path, beginning: &[u8], bytes: u64) -> std::io::Result<()> {
    path.parent().map_or(Ok(()), std::fs::create_dir_all)?;
    let mut file = File::options().write(true).create_new(true).open(path)?;
    file.write_all(beginning)?;
    file.set_len(bytes)
}
