//! The pack under its temporary name: `.NAME.kilwa.part` beside the output. It is held locked, checked when it is
//! complete, and renamed; whatever goes wrong, it is removed. The final name is given to a complete, checked pack only.

use crate::progress::Bar;
use crate::source::{FileSource, open_pack};
use anyhow::Context;
use kilwa_archive::checksums::sha256_of;
use kilwa_builder::Progress;
use kilwa_builder::build::work::Stop;
use kilwa_files::atomic::{Pending, folder_of};
use kilwa_files::plain_file;
use kilwa_pack::verify::{self, Totals};
use kilwa_pack::{NO_DIAMOND, Reader};
use rayon::prelude::*;
use std::fs::{File, Metadata};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes gathered before they are written.
const BUFFER: usize = 1 << 20;

/// The file `name` with `.` before and `suffix` after.
pub(super) fn beside(output: &Path, suffix: &str) -> PathBuf {
    let name = output.file_name().unwrap_or_default().to_string_lossy();
    output.with_file_name(format!(".{name}{suffix}"))
}

/// Check the temporary name of an output: only the file of an interrupted build may be there. Through a link the pack would be written into another file.
fn refuse_others_file(part: &Path) -> anyhow::Result<Option<Metadata>> {
    let what = match std::fs::symlink_metadata(part) {
        Ok(m) if m.is_symlink() => "a link",
        Ok(m) if !m.is_file() => "not a regular file",
        Ok(m) if has_other_names(&m) => "a file that has other hard links",
        Ok(m) => return Ok(Some(m)),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(e) => return Err(e).with_context(|| format!("cannot look at {}", part.display())),
    };
    anyhow::bail!(
        "{} is {what}, but the pack is first written there; remove it, or choose another output",
        part.display()
    )
}

#[cfg(unix)]
fn has_other_names(metadata: &Metadata) -> bool {
    std::os::unix::fs::MetadataExt::nlink(metadata) > 1
}

#[cfg(not(unix))]
fn has_other_names(_: &Metadata) -> bool {
    false
}

/// Read and decode every chunk of a pack, on all threads. Returns the identity of the pack.
pub(super) fn check(path: &Path, bar: &Bar, stop: &Stop) -> anyhow::Result<String> {
    let one = |pack: &Reader<FileSource>, i| Ok(verify::chunk(i, &pack.chunk(i)?, pack.entries())?);
    Ok(check_chunks(path, bar, stop, one)?.0)
}

/// Read every chunk of a pack, on all threads, and check it with `one`, which returns its counts. Returns the identity of the pack, and the totals.
fn check_chunks(
    path: &Path,
    bar: &Bar,
    stop: &Stop,
    one: impl Fn(&Reader<FileSource>, u32) -> anyhow::Result<Totals> + Sync,
) -> anyhow::Result<(String, Totals)> {
    let pack = open_pack(path)?;
    verify::directory(pack.entries())?;
    verify::order(pack.header(), pack.entries())?;
    let total = pack.entries().len() as u32;
    let done = AtomicU64::new(0);
    let one = |i: u32| -> anyhow::Result<Totals> {
        stop.check()?;
        let totals = one(&pack, i)?;
        bar.update("checking", done.fetch_add(1, Ordering::Relaxed) + 1, u64::from(total));
        Ok(totals)
    };
    let totals = (0..total).into_par_iter().map(one).try_reduce(Totals::default, |a, b| Ok(a.plus(b)))?;
    totals.agree(pack.header(), pack.metadata())?;
    Ok((pack.identity(), totals))
}

/// The output under its temporary name.
pub(crate) struct Output {
    writer: BufWriter<File>,
    pending: Pending,
    name: PathBuf,
}

impl Output {
    /// Begin; what an interrupted build left under the temporary name is written over.
    pub(crate) fn create(name: &Path) -> anyhow::Result<Self> {
        let part = beside(name, ".part");
        let cannot =
            || format!("cannot write {}: cannot create a file in {}", name.display(), folder_of(name).display());
        refuse_others_file(&part)?;
        let file =
            File::options().create(true).truncate(false).read(true).write(true).open(&part).with_context(cannot)?;
        if let Err(fs4::TryLockError::WouldBlock) = fs4::FileExt::try_lock(&file) {
            anyhow::bail!("{} is being written by another build; wait for it", name.display());
        }
        // The open file must be the one that was checked, so that nobody else's file is overwritten.
        let (opened, there) = (file.metadata().with_context(cannot)?, refuse_others_file(&part)?);
        if !there.is_some_and(|there| plain_file::is_same_file(&opened, &there)) {
            return Err(plain_file::replaced()).with_context(cannot);
        }
        file.set_len(0).with_context(cannot)?;
        let pending = Pending::adopt(&part, name).with_context(cannot)?;
        let writer = BufWriter::with_capacity(BUFFER, file);
        Ok(Self { writer, pending, name: name.to_owned() })
    }

    /// All `bytes` of the pack were written: cut off what an earlier attempt may have left.
    pub(crate) fn complete(&mut self, bytes: u64) -> anyhow::Result<()> {
        let finish = |writer: &mut BufWriter<File>| {
            writer.flush()?;
            writer.get_ref().set_len(bytes)
        };
        finish(&mut self.writer).with_context(|| format!("cannot write {}", self.name.display()))
    }

    /// Sync the complete pack to disk; meanwhile, read and decode every chunk, on all threads. Returns the identity of the pack.
    pub(crate) fn check(&self, bar: &Bar, stop: &Stop) -> anyhow::Result<String> {
        self.while_syncing(|path| check(path, bar, stop))
    }

    /// Sync the complete pack to disk; meanwhile, run `check`, which returns the identity of the pack.
    fn while_syncing(&self, check: impl FnOnce(&Path) -> anyhow::Result<String>) -> anyhow::Result<String> {
        std::thread::scope(|scope| {
            let synced = scope.spawn(|| self.writer.get_ref().sync_all());
            let identity = check(self.pending.temporary())
                .context("the pack that was just written cannot be read back; nothing was kept")?;
            let synced = synced.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            synced.with_context(|| format!("cannot write {}", self.name.display()))?;
            Ok(identity)
        })
    }

    /// As [`Output::check`], but compare only checksums, patches and counts: the tasks decoded the chunks when they encoded
    /// them and counted `decoded`, and the checksums have not changed since.
    pub(crate) fn check_decoded(&self, decoded: Totals, bar: &Bar, stop: &Stop) -> anyhow::Result<String> {
        let one = |pack: &Reader<FileSource>, i| {
            let patches = pack.patches(i)?;
            verify::links(i, &patches, pack.entries())?;
            let triangles = |leaf: bool| {
                let counted = patches.iter().filter(|p| !leaf || p.diamond == NO_DIAMOND);
                counted.map(|p| u64::from(p.count)).sum()
            };
            let counted = Totals {
                chunks: 1,
                finest_triangles: triangles(true),
                stored_triangles: triangles(false),
                ..Totals::default()
            };
            // The borders and the box are known only for all chunks together.
            let Totals { finest_borders, finest_bounds, .. } = decoded;
            Ok(if i == 0 { Totals { finest_borders, finest_bounds, ..counted } } else { counted })
        };
        self.while_syncing(|path| {
            let (identity, totals) = check_chunks(path, bar, stop, one)?;
            anyhow::ensure!(totals == decoded, "it has {totals:?}, but the tasks encoded {decoded:?}");
            Ok(identity)
        })
    }

    /// Its SHA-256.
    pub(crate) fn sha256(&self) -> anyhow::Result<String> {
        let cannot = || format!("cannot read {}", self.pending.temporary().display());
        Ok(sha256_of(File::open(self.pending.temporary()).with_context(cannot)?).with_context(cannot)?.1)
    }

    /// Give it its name.
    pub(crate) fn keep(self, replace: bool) -> anyhow::Result<()> {
        // Without --force a file that appeared in the meantime is not replaced. The file remains locked until it has its name.
        self.pending.commit(replace).with_context(|| format!("cannot write {}", self.name.display()))
    }
}

impl Write for Output {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.writer.flush()
    }
}

impl Seek for Output {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.writer.seek(to)
    }
}
