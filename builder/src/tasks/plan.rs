//! A build that several machines share: its plan, which tasks it has, and which of them are done.

use super::ingest::BASIS;
use super::manifest::TaskOutput;
use super::regions::LEVELS;
use super::shards::{ByteRange, Shards};
use super::{Manifest, Outcome, SharedFile, Store, Task};
use crate::build::journal::Plan;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::build::{report, tool};
use crate::ingest::divided::Basis;
use crate::ingest::surface::Surface;
use crate::partition::{Partition, part, tree_file};
use crate::scratch::{seal, unseal};
use glam::DVec3;
use kilwa_pack::Metadata;
use kilwa_pack::plural::counted;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::hash::BuildHasher;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// Name of the plan in the store.
pub const PLAN: &str = "plan.json";

/// Files of a task that are uploaded at the same time.
const UPLOADS: usize = 4;

/// Bytes copied at a time.
const COPY_BLOCK: u64 = 1 << 22;

/// What is built, and in what portions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SharedPlan {
    /// The program, the options and the inputs.
    pub plan: Plan,
    /// What else changes how the inputs are read, as text.
    pub reading: String,
    /// Triangles of a task.
    pub task_triangles: u64,
    /// The command line that it was planned with, for the task that reads the inputs.
    pub arguments: Vec<String>,
    /// The folder that relative paths in the arguments start from.
    pub working_folder: String,
}

impl SharedPlan {
    /// Identifies the build: the same for the same inputs, options, program and task size. 32 hexadecimal digits.
    pub fn key(&self) -> String {
        let mut plan = self.plan.clone();
        // Other inodes or other permissions do not make another file.
        plan.inputs.iter_mut().for_each(|input| input.stamp.clear());
        let bytes = serde_json::to_vec(&(plan, &self.reading, self.task_triangles)).unwrap_or_default();
        format!("{:032x}", u128::from_be_bytes(kilwa_pack::checksum(&bytes)))
    }
}

/// A task as it is handed to a worker: `tasks/TASK.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TaskFile {
    /// Where the build is: a folder.
    pub build: String,
    /// [`SharedPlan::key`] of the build.
    pub key: String,
    /// The program that planned it; a worker with another version refuses.
    pub tool: String,
    /// The task.
    pub task: Task,
}

/// A task in the list of those of a build.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TaskEntry {
    /// Its name.
    pub id: String,
    /// The task.
    pub task: Task,
    /// Whether it is done.
    pub done: bool,
    /// All tasks of earlier waves must be done first.
    pub wave: u32,
    /// Estimated number of triangles, if known.
    pub triangles: Option<u64>,
    /// Where on the model it is, metres.
    pub near: Option<DVec3>,
}

/// The results of the ingest for the next tasks, in addition to its files.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct IngestState {
    /// Triangles of the model.
    pub(super) triangles: u64,
    pub(super) regions: Vec<RegionEntry>,
}

/// A region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct RegionEntry {
    /// The place of its description in the file of regions: first byte, number of bytes.
    pub(super) at: u64,
    pub(super) bytes: u64,
    pub(super) triangles: u64,
    /// A point in its middle, metres.
    pub(super) near: DVec3,
}

/// What the ingest knows, for all other tasks.
#[derive(Serialize, Deserialize)]
pub(super) struct Stated {
    pub(super) basis: Basis,
    pub(super) metadata: report::Stated,
}

/// The results of the ingest.
pub(super) struct Ingest {
    pub(super) stated: Stated,
    pub(super) state: IngestState,
    pub(super) manifest: Manifest,
}

/// The results of the task that grows the tree, in addition to the tree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct TreeState {
    pub(super) surface: Surface,
    pub(super) metadata: Metadata,
    pub(super) color_bits: u8,
    pub(super) normal_bits: u8,
    pub(super) shards: Shards,
}

/// What is known once the tree has grown.
pub(super) struct Divided {
    pub(super) state: TreeState,
    pub(super) manifest: Manifest,
}

/// A build in a store.
pub struct SharedBuild {
    store: Box<dyn Store>,
    /// What is built.
    pub plan: SharedPlan,
    bytes_read: AtomicU64,
}

impl SharedBuild {
    /// Begin a build, or open it if it exists already.
    ///
    /// # Errors
    /// [`BuildError::Shared`] if the store fails or contains another build.
    pub fn begin(store: Box<dyn Store>, plan: SharedPlan) -> Result<Self, BuildError> {
        let bytes = seal(&serde_json::to_vec(&plan).unwrap_or_default());
        if store.create_new(PLAN, &bytes)? {
            return Ok(Self { store, plan, bytes_read: AtomicU64::new(0) });
        }
        let found = Self::open(store)?;
        if found.plan.key() != plan.key() {
            return Err(found.damaged(PLAN, "it is the plan of another build"));
        }
        Ok(found)
    }

    /// Open an existing build.
    ///
    /// # Errors
    /// [`BuildError::Shared`] if there is none.
    pub fn open(store: Box<dyn Store>) -> Result<Self, BuildError> {
        let place = store.display_path(PLAN);
        let refused = |why: &str| BuildError::Shared { doing: "use", place: place.clone(), why: why.to_owned() };
        let bytes = store.read_all(PLAN)?.ok_or_else(|| refused("there is no build; start one with `kilwa plan`"))?;
        let text = std::str::from_utf8(&bytes).ok().and_then(|text| unseal(text.trim_end_matches('\n')));
        let plan: Option<SharedPlan> = text.and_then(|text| serde_json::from_str(text).ok());
        let plan = plan.ok_or_else(|| refused("it is damaged, or not a plan of Kilwa"))?;
        if plan.plan.tool != tool() {
            let (planned, this) = (&plan.plan.tool, tool());
            let why =
                format!("{planned} planned this build, and this is {this}; install the same version on every machine");
            return Err(BuildError::Inputs { why });
        }
        Ok(Self { store, plan, bytes_read: AtomicU64::new(0) })
    }

    /// Where its files are.
    pub fn store(&self) -> &dyn Store {
        self.store.as_ref()
    }

    pub(super) fn damaged(&self, name: &str, why: impl Into<String>) -> BuildError {
        BuildError::Shared { doing: "use", place: self.store.display_path(name), why: why.into() }
    }

    /// A file that a task left is not what it wrote.
    pub(super) fn damaged_file(&self, file: &SharedFile, why: &str) -> BuildError {
        let task = file.name.strip_prefix("files/").and_then(|n| n.split('.').next()).unwrap_or_default();
        let manifest = self.store.display_path(&format!("done/{task}.json"));
        self.damaged(&file.name, format!("it is damaged: {why}; remove {manifest}, and run the task {task} again"))
    }

    /// Read a byte range of a file that a task left.
    pub(super) fn read(&self, file: &SharedFile, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        self.bytes_read.fetch_add(bytes, Ordering::Relaxed);
        self.store.read(&file.name, at, bytes)
    }

    /// Read a file that a task left.
    pub(super) fn read_whole(&self, file: &SharedFile) -> Result<Vec<u8>, BuildError> {
        self.read(file, 0, file.bytes)
    }

    /// Copy a file from a task to the scratch folder, as `local`, and check its CRC-32.
    pub(super) fn download(
        &self,
        file: &SharedFile,
        crc32: u32,
        work: &Work<'_>,
        local: &str,
    ) -> Result<(), BuildError> {
        let (to, mut sum) = (work.scratch.create(local)?, crc32fast::Hasher::new());
        for at in (0..file.bytes).step_by(COPY_BLOCK as usize) {
            work.stop.check()?;
            let bytes = self.read(file, at, COPY_BLOCK.min(file.bytes - at))?;
            sum.update(&bytes);
            to.append(&bytes)?;
        }
        if sum.finalize() == crc32 { Ok(()) } else { Err(self.damaged_file(file, "it does not match its checksum")) }
    }

    /// Read a checksummed line of JSON in a file from a task.
    pub(super) fn sealed<T: DeserializeOwned>(&self, file: &SharedFile, at: u64, bytes: u64) -> Result<T, BuildError> {
        let bytes = self.read(file, at, bytes)?;
        let text = std::str::from_utf8(&bytes).ok().and_then(|text| unseal(text.strip_suffix('\n')?));
        let text = text.ok_or_else(|| self.damaged_file(file, "it does not match its checksum"))?;
        serde_json::from_str(text).map_err(|e| self.damaged_file(file, &e.to_string()))
    }

    /// Whether a task is done. The task that it was made from must be done.
    ///
    /// # Errors
    /// [`BuildError::Inputs`] if that one is not done; [`BuildError::Shared`] if the store fails.
    pub(super) fn state(&self, task: Task) -> Result<State, BuildError> {
        let of = match task {
            Task::Ingest => None,
            Task::Region { .. } | Task::Tree => Some((Task::Ingest, BASIS)),
            Task::Leaves { .. } | Task::Level { .. } | Task::Tail => Some((Task::Tree, tree_file::TREE)),
        };
        let Some((before, content)) = of else { return self.state_where(task, None) };
        let manifest = self.finished(before)?;
        self.state_where(task, Some(&self.file(&manifest, content)?.name))
    }

    /// Whether a task is done; it must have been made from the file `of`.
    fn state_where(&self, task: Task, of: Option<&str>) -> Result<State, BuildError> {
        let Some(bytes) = self.store.read_all(&manifest_name(task))? else { return Ok(State::Pending) };
        let text = std::str::from_utf8(&bytes).ok().and_then(|text| unseal(text.trim_end_matches('\n')));
        let manifest: Option<Manifest> = text.and_then(|text| serde_json::from_str(text).ok());
        let Some(manifest) = manifest else {
            return Ok(State::Damaged { why: "its manifest is damaged".to_owned(), bytes, manifest: None });
        };
        if let Some(file) = manifest.files.values().find(|file| !is_of_a_task(&file.name)) {
            // Not passed on, so that nobody removes the file that it names.
            let why = format!("its manifest names {:?}, which no task writes", file.name);
            return Ok(State::Damaged { why, bytes, manifest: None });
        }
        let fault = if manifest.of.as_deref() == of {
            self.fault(&manifest)?
        } else {
            Some("it was made from an outdated result of an earlier task".to_owned())
        };
        Ok(match fault {
            Some(why) => State::Damaged { why, bytes, manifest: Some(manifest) },
            None => State::Done(manifest),
        })
    }

    /// What is wrong with the files that a manifest names.
    fn fault(&self, manifest: &Manifest) -> Result<Option<String>, BuildError> {
        for file in manifest.files.values() {
            let found = self.store.length(&file.name)?;
            if found != Some(file.bytes) {
                let bytes = |n| counted(n, "byte", "bytes");
                let found = found.map_or_else(|| "is missing".to_owned(), |n| format!("has {}", bytes(n)));
                let place = self.store.display_path(&file.name);
                return Ok(Some(format!("its file {place} {found}; it should have {}", bytes(file.bytes))));
            }
        }
        Ok(None)
    }

    /// Remove the manifest of a task whose files are damaged, unless it has been replaced since, and the files that it
    /// names, so that the task can run again.
    pub(super) fn remove_manifest(
        &self,
        task: Task,
        bytes: &[u8],
        manifest: Option<&Manifest>,
    ) -> Result<(), BuildError> {
        let name = manifest_name(task);
        if self.store.read_all(&name)?.is_some_and(|now| now == bytes) {
            self.store.remove(&name)?;
            manifest.map_or(Ok(()), |manifest| self.remove_files(manifest))?;
        }
        Ok(())
    }

    /// The manifest of a task that must be done by now.
    ///
    /// # Errors
    /// [`BuildError::Inputs`] if it is not; [`BuildError::Shared`] if the store fails.
    pub fn finished(&self, task: Task) -> Result<Manifest, BuildError> {
        Self::done_or(task, self.state(task)?)
    }

    /// The same for a task that must have been made from the file `of`.
    pub(super) fn finished_of(&self, task: Task, of: Option<&str>) -> Result<Manifest, BuildError> {
        Self::done_or(task, self.state_where(task, of)?)
    }

    fn done_or(task: Task, state: State) -> Result<Manifest, BuildError> {
        let id = task.id();
        let why = match state {
            State::Done(manifest) => return Ok(manifest),
            State::Pending => format!("the task {id} is not done yet, and its result is needed; run it first"),
            State::Damaged { why, .. } => {
                format!("the result of the task {id} is needed, but {why}; run that task again")
            }
        };
        Err(BuildError::Inputs { why })
    }

    /// One of the files that a task left.
    pub(super) fn file<'a>(&self, manifest: &'a Manifest, content: &str) -> Result<&'a SharedFile, BuildError> {
        let task = &manifest.task;
        manifest.files.get(content).ok_or_else(|| BuildError::Shared {
            doing: "use",
            place: self.store.display_path(&format!("done/{task}.json")),
            why: format!("it lists no file of {content}; remove it, and run the task again"),
        })
    }

    /// What the ingest left.
    pub(super) fn ingest(&self) -> Result<Ingest, BuildError> {
        let manifest = self.finished(Task::Ingest)?;
        let (state, file) = (self.state_of(&manifest)?, self.file(&manifest, BASIS)?);
        Ok(Ingest { stated: self.sealed(file, 0, file.bytes)?, state, manifest })
    }

    /// The division of the tree into shards.
    pub(super) fn divided(&self) -> Result<Divided, BuildError> {
        let manifest = self.finished(Task::Tree)?;
        Ok(Divided { state: self.state_of(&manifest)?, manifest })
    }

    /// A part of the tree.
    pub(super) fn part(&self, divided: &Divided, range: ByteRange) -> Result<Partition, BuildError> {
        let file = self.file(&divided.manifest, tree_file::TREE)?;
        let bytes = self.read(file, range.at, range.bytes)?;
        part::from_bytes(&bytes)
            .ok_or_else(|| self.damaged_file(file, "a part of the tree does not match its checksum"))
    }

    /// The same, with the levels of all tetrahedra of the tree.
    pub(super) fn part_with_levels(&self, divided: &Divided, range: ByteRange) -> Result<Partition, BuildError> {
        let file = self.file(&divided.manifest, LEVELS)?;
        let mut levels = self.read_whole(file)?;
        let sum = levels.split_off(levels.len().saturating_sub(4));
        if sum != crc32fast::hash(&levels).to_le_bytes() {
            return Err(self.damaged_file(file, "it does not match its checksum"));
        }
        Ok(Partition { levels, ..self.part(divided, range)? })
    }

    /// What a task states in its manifest.
    pub(super) fn state_of<T: DeserializeOwned>(&self, manifest: &Manifest) -> Result<T, BuildError> {
        T::deserialize(&manifest.state).map_err(|e| {
            let task = &manifest.task;
            let why =
                format!("its contents are not valid for that task ({e}); remove it, and run the task {task} again");
            self.damaged(&format!("done/{task}.json"), why)
        })
    }

    /// All known tasks: until the ingest is done, only the ingest; until the tree has grown, all tasks up to the one that grows it.
    ///
    /// # Errors
    /// [`BuildError::Shared`] if the store fails.
    pub fn tasks(&self) -> Result<Vec<TaskEntry>, BuildError> {
        let listed = |task: Task, of: Option<&str>, wave, triangles, near| -> Result<TaskEntry, BuildError> {
            let done = matches!(self.state_where(task, of)?, State::Done(_));
            Ok(TaskEntry { id: task.id(), task, done, wave, triangles, near })
        };
        let State::Done(ingest) = self.state(Task::Ingest)? else {
            return Ok(vec![listed(Task::Ingest, None, 0, None, None)?]);
        };
        let IngestState { triangles, regions } = self.state_of(&ingest)?;
        let mut tasks = vec![listed(Task::Ingest, None, 0, Some(triangles), None)?];
        let basis = Some(self.file(&ingest, BASIS)?.name.as_str());
        for (region, about) in (0u32..).zip(&regions) {
            tasks.push(listed(Task::Region { region }, basis, 1, Some(about.triangles), Some(about.near))?);
        }
        tasks.push(listed(Task::Tree, basis, 2, None, None)?);
        let State::Done(tree) = self.state_where(Task::Tree, basis)? else { return Ok(tasks) };
        let TreeState { shards, .. } = self.state_of(&tree)?;
        let of = Some(self.file(&tree, tree_file::TREE)?.name.as_str());
        for (shard, about) in (0u32..).zip(&shards.leaves) {
            tasks.push(listed(Task::Leaves { shard }, of, 3, Some(about.triangles), Some(about.near))?);
        }
        let mut wave = 4;
        for level in &shards.levels {
            for (shard, about) in (0u32..).zip(&level.shards) {
                let task = Task::Level { level: level.level, shard };
                tasks.push(listed(task, of, wave, Some(about.triangles), Some(about.near))?);
            }
            wave += 1;
        }
        tasks.push(listed(Task::Tail, of, wave, Some(shards.tail_triangles), None)?);
        Ok(tasks)
    }

    /// Upload what a task made, then create its manifest.
    pub(super) fn complete(
        &self,
        task: Task,
        work: &Work<'_>,
        made: TaskOutput,
        seconds: f64,
        cpu_seconds: Option<f64>,
    ) -> Result<Outcome, BuildError> {
        // Two attempts at a task never write the same file.
        let attempt = std::hash::RandomState::new().hash_one(std::process::id());
        let mut manifest = Manifest {
            task: task.id(),
            tool: tool(),
            of: made.of,
            files: BTreeMap::new(),
            state: made.state,
            seconds,
            cpu_seconds,
            bytes_read: self.bytes_read.load(Ordering::Relaxed),
            bytes_written: 0,
        };
        let mut names = Vec::new();
        for (content, local) in &made.files {
            let bytes = work.scratch.length(local).unwrap_or(0);
            let name = format!("files/{}.{attempt:016x}.{content}", task.id());
            manifest.bytes_written += bytes;
            names.push((name.clone(), work.scratch.path(local)));
            manifest.files.insert(content.clone(), SharedFile { name, bytes });
        }
        // They wait for the disk or the network, not for the processor.
        let uploading = Work { threads: UPLOADS, ..*work };
        let upload = |i: usize| {
            let (name, local): &(String, PathBuf) = &names[i];
            self.still_there()?;
            self.store.upload(name, local)
        };
        if let Err(error) = uploading.run_jobs(names.len(), UPLOADS as u64, |_| 1, upload) {
            drop(self.remove_files(&manifest));
            return Err(error);
        }
        let created = self.still_there().and_then(|()| {
            self.store.create_new(&manifest_name(task), &seal(&serde_json::to_vec(&manifest).unwrap_or_default()))
        });
        if matches!(created, Ok(true)) {
            // Requests may have been retried for minutes; the build may be gone by now.
            if matches!(self.store.length(PLAN), Ok(None)) {
                self.store.remove(&manifest_name(task))?;
                self.remove_files(&manifest)?;
                self.still_there()?;
            }
            return Ok(Outcome { manifest, already_done: false });
        }
        // The manifest may still be our own, if the response of a network file system or store was lost.
        let found = self.finished(task);
        if found.as_ref().is_ok_and(|found| *found == manifest) {
            return Ok(Outcome { manifest, already_done: false });
        }
        // An unreadable manifest may be our own, and then its files are needed. If the build is gone, nobody else would remove them.
        if found.is_ok() || matches!(self.store.length(PLAN), Ok(None)) {
            self.remove_files(&manifest)?;
        }
        created.and(found).map(|manifest| Outcome { manifest, already_done: true })
    }

    /// Parts of a build must not reappear after it was assembled and removed.
    fn still_there(&self) -> Result<(), BuildError> {
        let there = self.store.length(PLAN)?.is_some();
        let why = || "the build was assembled or removed meanwhile; there is nothing left to do".to_owned();
        there.then_some(()).ok_or_else(|| BuildError::Inputs { why: why() })
    }

    fn remove_files(&self, of: &Manifest) -> Result<(), BuildError> {
        of.files.values().try_for_each(|file| self.store.remove(&file.name))
    }
}

/// Whether a file name is one that tasks use for their results.
fn is_of_a_task(name: &str) -> bool {
    name.strip_prefix("files/").is_some_and(|name| !name.contains(['/', '\\']))
}

/// Whether a task is done.
pub(super) enum State {
    /// Not done.
    Pending,
    /// Outcome, but its manifest or its files have been lost or damaged since: the reason.
    Damaged {
        /// The reason.
        why: String,
        /// The manifest as it was read.
        bytes: Vec<u8>,
        /// What it says, if it can be read.
        manifest: Option<Manifest>,
    },
    /// Done.
    Done(Manifest),
}

fn manifest_name(task: Task) -> String {
    format!("done/{}.json", task.id())
}
