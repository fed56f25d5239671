//! The location of a divided build.

use crate::stores;
use anyhow::{Context, bail};
use kilwa_builder::build::work::Stop;
use kilwa_builder::tasks::{ObjectFolder, PLAN, SharedFolder, Store};
use kilwa_store::Address;
use std::fmt;
use std::path::{Path, PathBuf};

/// What the name of a build's folder begins with; its key follows.
pub(super) const BUILD_FOLDER: &str = "kilwa-build-";

/// A folder that all machines see, or a part of an object store.
#[derive(Debug, Clone)]
pub(super) enum Place {
    Folder(PathBuf),
    Store(Address),
}

impl Place {
    /// The place that an argument names.
    pub(super) fn of(given: &Path) -> anyhow::Result<Self> {
        Ok(stores::address(given)?.map_or_else(|| Self::Folder(given.to_owned()), Self::Store))
    }

    /// The place for all builds; creates the folder.
    pub(super) fn made(given: &Path) -> anyhow::Result<Self> {
        match Self::of(given)? {
            Self::Folder(folder) => {
                std::fs::create_dir_all(&folder)
                    .with_context(|| format!("cannot make the folder {}", folder.display()))?;
                let absolute = std::path::absolute(&folder);
                Ok(Self::Folder(absolute.with_context(|| format!("cannot use {}", folder.display()))?))
            }
            store @ Self::Store(_) => Ok(store),
        }
    }

    /// `name` below it.
    pub(super) fn join(&self, name: &str) -> Self {
        match self {
            Self::Folder(folder) => Self::Folder(folder.join(name)),
            Self::Store(address) => Self::Store(address.join(name)),
        }
    }

    /// As it is given to commands.
    pub(super) fn text(&self) -> anyhow::Result<String> {
        match self {
            Self::Folder(folder) => {
                let text = folder.to_str();
                Ok(text.with_context(|| format!("the name {} is not UTF-8 text", folder.display()))?.to_owned())
            }
            Self::Store(address) => Ok(address.to_string()),
        }
    }

    /// The key of the build whose folder this is.
    pub(super) fn key(&self) -> Option<String> {
        let name = match self {
            Self::Folder(folder) => folder.file_name()?.to_str()?,
            Self::Store(address) => address.path.filename()?,
        };
        name.strip_prefix(BUILD_FOLDER).map(str::to_owned)
    }

    /// How its files are read and written; requests to a store end when `stop` is set.
    pub(super) fn store(&self, stop: &Stop) -> anyhow::Result<Box<dyn Store>> {
        Ok(match self {
            Self::Folder(folder) => Box::new(SharedFolder::new(folder)),
            Self::Store(address) => {
                Box::new(ObjectFolder::new(stores::objects(&address.bucket, stop)?, address.path.clone()))
            }
        })
    }

    /// Refuse a store in which several machines could create the same object: the second attempt to create the plan must fail.
    pub(super) fn refuse_unfit(&self, store: &dyn Store) -> anyhow::Result<()> {
        let Self::Store(address) = self else { return Ok(()) };
        let plan = store.read_all(PLAN)?.context("the build was removed meanwhile; run the same command again")?;
        if store.create_new(PLAN, &plan)? {
            // Nobody can build here. If it cannot be removed, the reason to refuse is the same.
            drop(store.remove(PLAN));
            bail!(
                "the store of {address} ignores the condition If-None-Match: * and replaces objects, so machines could overwrite each other's results; use a store with conditional writes, such as Amazon S3, MinIO, Ceph, Cloudflare R2 or SeaweedFS 4.48"
            );
        }
        Ok(())
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => folder.display().fmt(f),
            Self::Store(address) => address.fmt(f),
        }
    }
}
