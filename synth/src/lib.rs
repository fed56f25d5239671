//! Synthetic sites: a stone fort, a brick wall and analytic phantoms, as PLY files or in memory.
//!
//! Inputs: a [`SiteKind`] and [`SynthOptions`]. Output: one PLY, or one per block. The same options give the same bytes on
//! every machine and with any number of threads. Sites are made piece by piece ([`piece`]) and streamed to disk
//! ([`ply`]): memory does not grow with the number of triangles. Failures: [`SynthError`]; nothing is left under a
//! final name unless the whole run succeeded.

mod folder;
mod fort;
mod noise;
mod phantom;
pub mod photos;
mod piece;
mod ply;
pub mod scans;
mod wall;

#[cfg(test)]
mod tests;

pub use phantom::Phantom;

use glam::DVec3;
use kilwa_files::atomic::folder_of;
use kilwa_files::made_folders::MadeFolders;
use kilwa_formats::RawMesh;
use kilwa_pack::plural::counted;
use piece::{Sink, Site, weld};
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// What to make.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SiteKind {
    /// A ruined stone fort with its ground, about 50 m across.
    Fort,
    /// A brick wall, 10 m by 5 m, facing south.
    Wall,
    /// A closed analytic solid.
    Phantom(Phantom),
}

impl SiteKind {
    /// The fewest triangles that still give the shape.
    pub fn fewest(self) -> u64 {
        match self {
            Self::Fort => 5_000,
            Self::Wall => 2_000,
            Self::Phantom(_) => 200,
        }
    }
}

/// How to make it.
#[derive(Debug, Clone, PartialEq)]
pub struct SynthOptions {
    /// Triangles wanted; what it comes to is within 2 % of it (phantoms: the nearest whole subdivision).
    pub triangles: u64,
    /// Seed of everything random.
    pub seed: u64,
    /// Write this many separate files, which share bit-equal border vertices.
    pub blocks: Option<u32>,
    /// Write doubles at real-world coordinates ([`UTM_ORIGIN`], [`UTM_CRS`]) instead of floats round the origin.
    pub utm: bool,
    /// Standard deviation of each coordinate of a phantom's vertices, metres: noise, independent from vertex to vertex.
    pub noise: f64,
    /// Replace files that exist.
    pub force: bool,
}

impl SynthOptions {
    /// Defaults for a number of triangles: seed 1, one file, floats, nothing replaced.
    pub fn new(triangles: u64) -> Self {
        Self { triangles, seed: 1, blocks: None, utm: false, noise: 0.0, force: false }
    }
}

/// The site's origin in the real world: easting, northing and height in metres, beside the Gereza of Kilwa Kisiwani.
pub const UTM_ORIGIN: DVec3 = DVec3::new(565_982.0, 9_009_946.0, 2.0);
/// The coordinate reference system of [`UTM_ORIGIN`]: WGS 84 / UTM zone 37S.
pub const UTM_CRS: &str = "EPSG:32737";
/// Most triangles of one file: about half as many vertices must fit a PLY `int` index (2^31 - 1).
pub const MAX_TRIANGLES: u64 = 4_000_000_000;
/// Most blocks.
pub const MAX_BLOCKS: u32 = 1_000;

/// What was made.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SynthReport {
    /// The files, in the order of the blocks.
    pub files: Vec<PathBuf>,
    /// Vertices of all files together (border vertices count in each).
    pub vertices: u64,
    /// Triangles of all files together.
    pub triangles: u64,
    /// Bytes of all files together.
    pub bytes: u64,
    /// Distance between neighbouring vertices, about, in metres.
    pub spacing: f64,
}

/// Why nothing was made.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// Fewer triangles than the shape needs.
    #[error("{} too few for this shape: ask for at least {fewest}", counted(*asked, "triangle is", "triangles are"))]
    TooFew {
        /// Asked for.
        asked: u64,
        /// Needed.
        fewest: u64,
    },
    /// More triangles than PLY's `int` vertex indices can address.
    #[error(
        "{asked} triangles are too many: their vertices would not fit the int indices of PLY; ask for at most {MAX_TRIANGLES}"
    )]
    TooMany {
        /// Asked for.
        asked: u64,
    },
    /// No blocks, or more than the site can be cut into.
    #[error("{} not possible: with so many triangles this shape can be cut into 1 to {max}", counted(*asked, "block is", "blocks are"))]
    Blocks {
        /// Asked for.
        asked: u32,
        /// Possible.
        max: u32,
    },
    /// A block that no triangle falls into.
    #[error("block {block} of {asked} would be empty: ask for fewer blocks or more triangles")]
    EmptyBlock {
        /// Which.
        block: usize,
        /// Blocks asked for.
        asked: usize,
    },
    /// The file name cannot be used.
    #[error("{}: {why}", .path.display())]
    Name {
        /// The name.
        path: PathBuf,
        /// What is wrong with it and what to do.
        why: &'static str,
    },
    /// A file cannot be written there.
    #[error(transparent)]
    Output(kilwa_files::output::OutputError),
    /// A file could not be written.
    #[error("{}: {source}", .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
}

/// Make a site and write it to `out`, or with blocks to `out` with `_000`, `_001` … before its extension.
/// `progress` is called with the triangles written so far and the number expected.
///
/// # Errors
/// [`SynthError`]; the final names are then untouched.
pub fn write(
    kind: SiteKind,
    options: &SynthOptions,
    out: &Path,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<SynthReport, SynthError> {
    let files = ply::file_names(out, options.blocks)?;
    ply::check_targets(&files, options.force)?;
    let site = site(kind, options, options.blocks.unwrap_or(1))?;
    let origin = options.utm.then_some(UTM_ORIGIN);
    let comments = comments(kind, options);
    let mut report = SynthReport { spacing: site.spacing(), ..SynthReport::default() };
    let expected = site.expected_triangles();
    // Dropped after the files are there, or removed.
    let made = MadeFolders::for_file(out);
    let _folders = made.map_err(|source| SynthError::Io { path: folder_of(out).to_owned(), source })?;
    let mut done = Vec::new();
    for (tile, path) in files.iter().enumerate() {
        let mut file = ply::Writer::create(path, origin, &comments)?;
        let before = report.triangles;
        weld(site.as_ref(), tile as u32, !options.utm, &mut file, &mut |n| progress(before + n, expected))?;
        let finished = file.finish()?;
        if finished.triangles == 0 {
            return Err(SynthError::EmptyBlock { block: tile, asked: files.len() });
        }
        report.vertices += finished.vertices;
        report.triangles += finished.triangles;
        report.bytes += finished.bytes;
        done.push(finished);
    }
    for file in done {
        file.keep(options.force)?;
    }
    report.files = files;
    Ok(report)
}

/// Make a site in memory: the same vertices and triangles, in the same order, as [`write`] puts into one file.
/// Blocks are ignored.
///
/// # Errors
/// [`SynthError::TooFew`] and [`SynthError::TooMany`].
pub fn mesh(kind: SiteKind, options: &SynthOptions) -> Result<RawMesh, SynthError> {
    struct Memory {
        mesh: RawMesh,
        origin: DVec3,
    }
    impl Sink for Memory {
        type Error = Infallible;
        fn vertex(&mut self, p: DVec3, color: [u8; 3]) -> Result<(), Infallible> {
            self.mesh.positions.push(p + self.origin);
            self.mesh.colors.push(color);
            Ok(())
        }
        fn triangle(&mut self, corners: [u32; 3]) -> Result<(), Infallible> {
            self.mesh.triangles.push(corners);
            Ok(())
        }
    }
    let site = site(kind, options, 1)?;
    let origin = if options.utm { UTM_ORIGIN } else { DVec3::ZERO };
    let mut sink = Memory { mesh: RawMesh::default(), origin };
    match weld(site.as_ref(), 0, !options.utm, &mut sink, &mut |_| {}) {
        Ok(_) => Ok(sink.mesh),
        Err(never) => match never {},
    }
}

fn site(kind: SiteKind, options: &SynthOptions, tiles: u32) -> Result<Box<dyn Site>, SynthError> {
    let asked = options.triangles;
    if asked < kind.fewest() {
        return Err(SynthError::TooFew { asked, fewest: kind.fewest() });
    }
    if asked > MAX_TRIANGLES {
        return Err(SynthError::TooMany { asked });
    }
    let limit = |max: u32| {
        let max = max.min(MAX_BLOCKS);
        if tiles == 0 || tiles > max { Err(SynthError::Blocks { asked: tiles, max }) } else { Ok(()) }
    };
    limit(MAX_BLOCKS)?;
    Ok(match kind {
        SiteKind::Fort => {
            let fort = fort::Fort::new(asked, options.seed, tiles);
            if !fort.tiles_fit() {
                limit(fort.max_tiles())?;
            }
            Box::new(fort)
        }
        SiteKind::Wall => {
            let wall = wall::Wall::new(asked, options.seed, tiles);
            limit(wall.max_tiles())?;
            Box::new(wall)
        }
        SiteKind::Phantom(phantom) => {
            let solid = phantom::Solid::new(phantom, asked, options.seed, tiles).with_noise(options.noise);
            limit(solid.strips())?;
            Box::new(solid)
        }
    })
}

fn comments(kind: SiteKind, options: &SynthOptions) -> Vec<String> {
    let name = match kind {
        SiteKind::Fort => "fort".to_owned(),
        SiteKind::Wall => "wall".to_owned(),
        SiteKind::Phantom(p) => format!("phantom {}", p.name()),
    };
    let mut lines = vec![format!("kilwa synth {name}, seed {}: made by a program, no real place", options.seed)];
    if options.noise > 0.0 {
        lines.push(format!("noise of {} m on each axis of every vertex", options.noise));
    }
    lines.push("units metre, z up".to_owned());
    if options.utm {
        lines.push(format!("crs {UTM_CRS}"));
    }
    lines
}
