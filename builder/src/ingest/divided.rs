//! The ingest in parts, for a build that is divided among many machines: the same functions as in [`super::ingest`],
//! run region by region.
//!
//! | part | input | output |
//! |---|---|---|
//! | [`sort`] | the spool | [`Basis`], and the triangles of each region ([`RegionFiles`]) |
//! | [`weld`] | the triangles of one region | `welded`, `replies`, `links`; [`Findings`] for the whole model, [`RegionIndex`] of its files |
//! | [`Joined`] | the findings and links of all regions | the tree, and what is known of the surface |
//! | [`fill`] | the tree, the buckets below some of its tetrahedra, and the replies to them ([`Regions`]) | the patches and records of these leaves |
//!
//! The buckets and regions depend on the memory of the machine that sorts; the result does not.

use super::buckets::Buckets;
use super::components::Joining;
use super::corners::Slots;
use super::crowded::refuse_leaves;
use super::leaves::{self, Welds};
use super::resolve::Resolved;
use super::scatter::Scattered;
use super::spill::Lists;
use super::topology::{self, Region, Welded, WeldedPlace};
use super::words::words_of_bytes;
use super::{IngestOptions, Sorted, Spooled, Stages};
use crate::build::Provenance;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::Surface;
use crate::partition::Partition;
use crate::scratch::ScratchError;
use glam::DVec3;
use kilwa_geometry::{DiamondKey, Lattice};
use kilwa_simplify::Precision;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;

pub(crate) use super::buckets::Run;
pub(crate) use super::components::LINKS;
pub(crate) use super::topology::{Findings, REPLIES, WELDED};

/// What is known once the triangles are sorted into regions.
#[derive(Serialize, Deserialize)]
pub(crate) struct Basis {
    spooled: Spooled,
    resolved: Resolved,
    /// Without the places of triangles.
    scattered: Scattered,
    provenance: Provenance,
    leaf_triangles: usize,
    color_bits: u8,
    normal_bits: u8,
}

/// The files with the triangles of a region: its own, and those of other regions that touch it.
#[derive(Serialize, Deserialize)]
pub(crate) struct RegionFiles {
    own: Lists,
    halo: Lists,
}

/// Index of the files of a region.
#[derive(Serialize, Deserialize)]
pub(crate) struct RegionIndex {
    /// The first bucket.
    first: u32,
    /// By bucket, starting with the first.
    places: Vec<WeldedPlace>,
    /// By bucket, including those of other regions: the place of the replies, and the checksum of their bytes.
    replies: BTreeMap<u32, (Vec<(u64, u32)>, u32)>,
}

/// Sort the triangles of a spool into regions of about `region` triangles.
///
/// # Errors
/// As [`super::ingest`].
pub(crate) fn sort(
    work: &Work<'_>,
    spooled: Spooled,
    options: &IngestOptions,
    provenance: Provenance,
    region: u64,
) -> Result<(Basis, Vec<RegionFiles>), BuildError> {
    let mut stages = Stages { work, unchecked: BTreeMap::new() };
    let Sorted { spooled, mut resolved, mut scattered } =
        Sorted::find(&mut stages, Some(spooled), options, Some(region))?;
    let files = |r: usize| RegionFiles { own: scattered.own.of_file(r), halo: scattered.halo.of_file(r) };
    let regions = (0..scattered.regions.len()).map(files).collect();
    (resolved.samples, resolved.slots) = (Vec::new(), Slots::default());
    (scattered.own, scattered.halo) = (Lists::default(), Lists::default());
    let Precision { color_bits, normal_bits } = options.precision;
    let leaf_triangles = options.leaf_triangles;
    Ok((Basis { spooled, resolved, scattered, provenance, leaf_triangles, color_bits, normal_bits }, regions))
}

impl Basis {
    /// Triangles of the whole model.
    pub(crate) fn triangles(&self) -> u64 {
        self.scattered.triangles
    }

    /// Triangles of a region.
    pub(crate) fn triangles_of(&self, region: &RegionFiles) -> u64 {
        let words: u64 = region.own.range().map(|b| region.own.words(b as usize) as u64).sum();
        words / self.resolved.layout.triangle() as u64
    }

    /// The position of a region: a point in its middle, metres.
    fn near(&self, buckets: &Buckets, region: &RegionFiles) -> DVec3 {
        let Range { start, end } = region.own.range();
        let middle = buckets.tetrahedra()[u32::midpoint(start, end.max(start + 1) - 1) as usize];
        self.resolved.lattice.world_from_lattice(DiamondKey::of(&middle).midpoint)
    }

    /// The positions of regions: a point in the middle of each, metres.
    pub(crate) fn positions(&self, regions: &[RegionFiles]) -> Vec<DVec3> {
        let buckets = self.buckets();
        regions.iter().map(|region| self.near(&buckets, region)).collect()
    }

    /// The lattice.
    pub(crate) fn lattice(&self) -> &Lattice {
        &self.resolved.lattice
    }

    fn buckets(&self) -> Buckets {
        Buckets::of_shape(self.scattered.cube_log2, self.scattered.shape.clone())
    }

    /// The runs of buckets that the leaves of the tree are made of.
    pub(crate) fn runs(&self, tree: &Partition) -> Vec<Run> {
        self.buckets().runs(tree)
    }
}

impl RegionFiles {
    /// The names of its files, with their checksums (CRC-32).
    pub(crate) fn files(&self) -> impl Iterator<Item = (&str, u32)> {
        self.own.files.iter().chain(&self.halo.files).map(|file| (file.name.as_str(), file.crc32))
    }
}

/// Weld the triangles of a region, whose files are in the scratch folder.
///
/// # Errors
/// [`BuildError`]: a place has more triangles than a chunk can hold; the scratch folder fails.
pub(crate) fn weld(
    work: &Work<'_>,
    basis: &Basis,
    region: &RegionFiles,
) -> Result<(Findings, RegionIndex), BuildError> {
    let (shape, tally) = (basis.scattered.shape.clone(), basis.scattered.tally.clone());
    let (own, halo) = (region.own.clone(), region.halo.clone());
    let scattered = Scattered { own, halo, shape, tally, regions: Vec::new(), ..basis.scattered };
    let (buckets, joining) = (basis.buckets(), Joining::create(work.scratch)?);
    let welding = Region {
        work,
        layout: basis.resolved.layout,
        lattice: &basis.resolved.lattice,
        scattered: &scattered,
        buckets: &buckets,
        leaf_triangles: basis.leaf_triangles,
        precision: Precision { color_bits: basis.color_bits, normal_bits: basis.normal_bits },
        joining: &joining,
        is_all: false,
    };
    let topology::Welding { places, replies, mut findings } = welding.weld()?;
    findings.numbers = joining.hand_over()?;
    let to = replies.range().filter(|bucket| !replies.extents(*bucket as usize).is_empty());
    let index = to.map(|b| (b, (replies.extents(b as usize).to_vec(), replies.crc32(b as usize)))).collect();
    Ok((findings, RegionIndex { first: region.own.range().start, places, replies: index }))
}

impl RegionIndex {
    /// Its buckets.
    pub(crate) fn buckets(&self) -> Range<u32> {
        self.first..self.first + self.places.len() as u32
    }

    /// Triangles of one of its buckets; 0 for other buckets.
    pub(crate) fn triangles(&self, bucket: u32) -> u64 {
        self.place(bucket).map_or(0, |place| place.triangles)
    }

    /// Whether it contains one of these buckets, or replies to one.
    pub(crate) fn concerns(&self, buckets: &Range<u32>) -> bool {
        let own = self.buckets();
        (own.start < buckets.end && buckets.start < own.end) || self.replies.range(buckets.clone()).next().is_some()
    }

    fn place(&self, bucket: u32) -> Option<WeldedPlace> {
        bucket.checked_sub(self.first).and_then(|i| self.places.get(i as usize)).copied()
    }
}

/// Joins all regions, in their order.
pub(crate) struct Joined<'a> {
    work: &'a Work<'a>,
    basis: &'a Basis,
    joining: Joining,
    findings: Vec<Findings>,
}

/// The result of joining all regions.
pub(crate) struct Grown {
    /// The numbers of triangles of its leaves are not set.
    pub(crate) tree: Partition,
    /// Triangles of each tetrahedron that is a leaf, estimated from the groups of triangles.
    pub(crate) estimate: Vec<f64>,
    pub(crate) surface: Surface,
}

impl<'a> Joined<'a> {
    /// Start without any region.
    ///
    /// # Errors
    /// [`ScratchError`] if the scratch folder fails.
    pub(crate) fn new(work: &'a Work<'a>, basis: &'a Basis) -> Result<Self, ScratchError> {
        Ok(Self { work, basis, joining: Joining::create(work.scratch)?, findings: Vec::new() })
    }

    /// Add a region. Returns what to add to the numbers of its links; `None` if the findings are not those of a region.
    pub(crate) fn add(&mut self, mut findings: Findings) -> Option<u32> {
        let numbers = findings.numbers;
        let first = self.joining.make_room(numbers)?;
        let whole = findings.parts.iter_mut().all(|part| part.renumber(first, numbers));
        self.findings.push(findings);
        whole.then_some(first)
    }

    /// Add links of the region for which [`Joined::add`] returned `first`.
    ///
    /// # Errors
    /// [`ScratchError`] if the scratch folder fails.
    pub(crate) fn links(&self, records: &[u128], first: u32) -> Result<(), ScratchError> {
        self.joining.take(records, first)
    }

    /// Grow the tree; `triangles` returns the number of triangles of a bucket.
    ///
    /// # Errors
    /// [`BuildError::TooLarge`] if a leaf does not fit into a chunk; the scratch folder fails.
    pub(crate) fn grow(self, triangles: impl Fn(u32) -> u64) -> Result<Grown, BuildError> {
        let Self { work, basis, joining, mut findings } = self;
        let groups: Vec<_> = findings.iter_mut().map(|f| std::mem::take(&mut f.groups)).collect();
        let buckets = basis.buckets();
        let (keys, whole) = topology::join(work, &buckets, basis.leaf_triangles, joining, findings)?;
        let keys = keys.into_iter().map(|(level, midpoint)| DiamondKey { level, midpoint });
        let tree = leaves::tree_of(basis.resolved.cube_log2, keys);
        refuse_leaves(&buckets, &basis.resolved.lattice, triangles, &tree)?;
        let mut estimate = vec![0.0; tree.tetrahedra.len()];
        for (sum, n) in groups.into_iter().flatten() {
            estimate[tree.leaf_at(sum.map(i64::from).into()) as usize] += f64::from(n);
        }
        let Basis { spooled, resolved, scattered, provenance, .. } = basis;
        let (spooled, resolved, scattered) = (spooled.clone(), resolved.clone(), scattered.clone());
        let surface = Sorted { spooled, resolved, scattered }.surface(&whole, provenance.clone());
        Ok(Grown { tree, estimate, surface })
    }
}

/// The files of regions.
pub(crate) trait RegionStore: Sync {
    /// A range of bytes of a region's file with this content, [`WELDED`] or [`REPLIES`].
    ///
    /// # Errors
    /// [`BuildError`] if it cannot be read.
    fn read(&self, region: usize, content: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError>;

    /// The error for such a range that is damaged.
    fn damaged(&self, region: usize, content: &str, at: u64) -> BuildError;
}

/// The regions that contain some runs of buckets, or have replies to them.
struct Regions<'a> {
    basis: &'a Basis,
    indices: &'a [RegionIndex],
    store: &'a dyn RegionStore,
}

impl Regions<'_> {
    fn place(&self, bucket: u32) -> Option<(usize, WeldedPlace)> {
        self.indices.iter().enumerate().find_map(|(region, index)| Some((region, index.place(bucket)?)))
    }
}

impl Welds for Regions<'_> {
    fn triangles(&self, bucket: u32) -> u64 {
        self.place(bucket).map_or(0, |(_, place)| place.triangles)
    }

    fn welded(&self, bucket: u32) -> Result<Welded, BuildError> {
        let Some((region, place)) = self.place(bucket) else {
            let why = format!("the region with bucket {bucket} is missing; run `kilwa plan` again");
            return Err(BuildError::Inputs { why });
        };
        let bytes = self.store.read(region, WELDED, place.at, place.words.saturating_mul(4))?;
        let welded = Welded::of_bytes(&bytes, place, self.basis.resolved.layout);
        welded.ok_or_else(|| self.store.damaged(region, WELDED, place.at))
    }

    fn replies(&self, bucket: u32) -> Result<Vec<u32>, BuildError> {
        let mut all = Vec::new();
        for (region, index) in self.indices.iter().enumerate() {
            let Some((pieces, crc32)) = index.replies.get(&bucket) else { continue };
            let mut sum = crc32fast::Hasher::new();
            for (at, words) in pieces {
                let bytes = self.store.read(region, REPLIES, *at, 4 * u64::from(*words))?;
                sum.update(&bytes);
                all.extend(words_of_bytes(&bytes));
            }
            if sum.finalize() != *crc32 {
                return Err(self.store.damaged(region, REPLIES, pieces.first().map_or(0, |(at, _)| *at)));
            }
        }
        Ok(all)
    }
}

/// Fill the leaves of some runs into the files of [`super::surface`]. `indices` are those of all regions that concern
/// them, in the order in which the store numbers its regions. Returns the number of leaves that hold more triangles than they should.
///
/// # Errors
/// [`BuildError`]: a file of a region cannot be read or is damaged; the scratch folder fails.
pub(crate) fn fill(
    work: &Work<'_>,
    basis: &Basis,
    indices: &[RegionIndex],
    store: &dyn RegionStore,
    tree: &Partition,
    runs: &[Run],
) -> Result<u64, BuildError> {
    let from = Regions { basis, indices, store };
    let filled = leaves::fill(work, basis.resolved.layout, &from, tree, runs)?;
    Ok(filled.triangles.iter().filter(|(_, n)| *n > basis.leaf_triangles as u64).count() as u64)
}
