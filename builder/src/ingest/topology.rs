//! How triangles relate to their neighbours, bucket by bucket: welded vertices, true-border bits, normals, and which
//! tetrahedra want to be split.
//!
//! Input: `buckets` and `halo`. A point belongs to the bucket that it lies in, an edge to the first bucket of its two
//! ends; all triangles at them are there, own ones or halo. Output: `welded`, each bucket as an indexed mesh
//! ([`Welded`]); `replies`, for each bucket what others found out about its triangles; `split_requests`.
//!
//! Normals are sums of the doubled areas, in integers, so that the order of triangles does not matter.

use super::IngestOptions;
use super::buckets::{Buckets, point_of_words};
use super::components::{Components, Joining, LocalComponents, Part};
use super::lattice::Lengths;
use super::resolve::Resolved;
use super::scatter::{HALO_HEAD, Scattered, bytes_per_triangle};
use super::spill::{Lists, Spill};
use super::split_requests::{self, Above, Group, SplitRequests};
use super::weld::Weld;
use super::words::{Layout, append_words, normal_of_word, word_of_normal, words_of_bytes};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::scratch::{ScratchError, ScratchFile};
use glam::I64Vec3;
use kilwa_geometry::tetra::max_level;
use kilwa_geometry::{Aabb, DiamondKey, Lattice, LatticePoint, normal};
use kilwa_simplify::Precision;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

pub(crate) const WELDED: &str = "welded";
pub(crate) const REPLIES: &str = "replies";

/// Words of a reply: place of the triangle, bits, three normals.
pub(super) const REPLY: usize = 5;
/// Set in a corner's number where the edge from it is a border.
pub(super) const BORDER: u32 = 1 << 31;
/// One in so many points is sampled for the roughness of the surface.
const ROUGHNESS_SAMPLE: u64 = 16;
/// Distances are counted in parts of a step.
const ROUGHNESS_PARTS: f64 = 4096.0;
/// Most triangles of a bucket: what fits beside the bits of an edge's name.
const MAX: usize = 1 << 28;

/// Numbers of the whole model.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counts {
    /// Distinct lattice positions.
    pub points: u64,
    /// Distinct vertices: positions with their attributes.
    pub vertices: u64,
    /// Edges used by one triangle.
    pub border_edges: u64,
    /// Edges used by more than two triangles.
    pub non_manifold_edges: u64,
    /// Edges of two triangles that run along it the same way.
    pub inconsistent_edges: u64,
    /// Duplicates of another triangle, whichever way they face.
    pub duplicate_triangles: u64,
}

impl Counts {
    fn add(&mut self, o: &Self) {
        self.points += o.points;
        self.vertices += o.vertices;
        self.border_edges += o.border_edges;
        self.non_manifold_edges += o.non_manifold_edges;
        self.inconsistent_edges += o.inconsistent_edges;
        self.duplicate_triangles += o.duplicate_triangles;
    }
}

/// What the stage leaves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Topology {
    pub(super) places: Vec<WeldedPlace>,
    pub(super) replies: Lists,
    /// Level and midpoint of the diamonds that are wanted, sorted.
    #[serde(rename = "wishes")]
    pub(super) split_requests: Vec<(u8, LatticePoint)>,
    pub(super) whole: Whole,
}

/// What is known about the whole model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Whole {
    pub(super) counts: Counts,
    pub(super) components: Components,
    /// Median distance of a point from its neighbours, in lattice units: see [`Local::roughness`].
    pub(super) roughness: f64,
    /// Smallest and largest coordinates.
    pub(super) bounds: [LatticePoint; 2],
}

/// Where a bucket is in `welded`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct WeldedPlace {
    /// First byte.
    pub(super) at: u64,
    pub(super) words: u64,
    pub(super) triangles: u64,
    pub(super) crc32: u32,
}

/// Results for some buckets, for the following stages.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct Findings {
    /// The results of each bucket.
    pub(super) above: Vec<Above>,
    pub(super) parts: Vec<Part>,
    /// How many numbers their components have, if other regions are to be joined with them.
    pub(super) numbers: u32,
    /// The requested diamonds, as level and midpoint.
    pub(super) keys: Vec<(u8, LatticePoint)>,
    /// Groups of triangles with their places, so small that a leaf holds a few of them; empty if the region is the whole model.
    pub(super) groups: Vec<Group>,
    pub(super) counts: Counts,
    /// See [`Lengths::sparse`].
    pub(super) roughness: Vec<(u32, u64)>,
    pub(super) bounds: Option<[LatticePoint; 2]>,
}

/// A bucket as an indexed mesh.
#[derive(Debug, Default)]
pub(super) struct Welded {
    /// Words of all vertices.
    pub(super) vertices: Vec<u32>,
    /// The point of each vertex.
    pub(super) point_of: Vec<u32>,
    /// The normal of each point; not used where vertices have their own.
    pub(super) normals: Vec<u32>,
    /// Points that other buckets may use too.
    pub(super) shared: Vec<u32>,
    /// Corners as numbers of vertices, with [`BORDER`]; in the order of `buckets`.
    pub(super) triangles: Vec<[u32; 3]>,
}

impl Welded {
    /// Write it: four lengths, then the lists.
    fn write(&self, file: &ScratchFile) -> Result<WeldedPlace, ScratchError> {
        let lengths = [self.point_of.len(), self.normals.len(), self.shared.len(), self.triangles.len()];
        let mut words: Vec<u32> = lengths.iter().map(|n| *n as u32).collect();
        for list in [&self.vertices, &self.point_of, &self.normals, &self.shared] {
            words.extend_from_slice(list);
        }
        words.extend_from_slice(self.triangles.as_flattened());
        let at = append_words(file, &mut words)?;
        let crc32 = crc32fast::hash(bytemuck::cast_slice(&words));
        Ok(WeldedPlace { at, words: words.len() as u64, triangles: self.triangles.len() as u64, crc32 })
    }

    /// Read what was written at a place.
    pub(super) fn read(file: &ScratchFile, place: WeldedPlace, layout: Layout) -> Result<Self, ScratchError> {
        let bytes = file.read(place.at, place.words * 4)?;
        let whole = || ScratchError::damaged(file.path(), format!("the bucket at byte {} is not whole", place.at));
        Self::of_bytes(&bytes, place, layout).ok_or_else(whole)
    }

    /// Parse the bucket at a place from its bytes; `None` if they are damaged.
    pub(super) fn of_bytes(bytes: &[u8], place: WeldedPlace, layout: Layout) -> Option<Self> {
        if crc32fast::hash(bytes) != place.crc32 {
            return None;
        }
        let words = words_of_bytes(bytes);
        let (head, mut rest) = words.split_at_checked(4)?;
        let mut take = |n: usize| -> Option<Vec<u32>> {
            let (list, after) = rest.split_at_checked(n)?;
            rest = after;
            Some(list.to_vec())
        };
        let [vertices, normals, shared, triangles] = std::array::from_fn(|i| head[i] as usize);
        Some(Self {
            vertices: take(vertices.checked_mul(layout.vertex())?)?,
            point_of: take(vertices)?,
            normals: take(normals)?,
            shared: take(shared)?,
            triangles: take(triangles.checked_mul(3)?)?.as_chunks::<3>().0.to_vec(),
        })
    }
}

/// The stage.
pub(super) fn topology(
    work: &Work<'_>,
    resolved: &Resolved,
    scattered: &Scattered,
    options: &IngestOptions,
) -> Result<Topology, BuildError> {
    let buckets = Buckets::of_shape(scattered.cube_log2, scattered.shape.clone());
    let joining = Joining::create(work.scratch)?;
    let region = Region {
        work,
        layout: resolved.layout,
        lattice: &resolved.lattice,
        scattered,
        buckets: &buckets,
        leaf_triangles: options.leaf_triangles,
        precision: options.precision,
        joining: &joining,
        is_all: true,
    };
    let Welding { places, replies, findings } = region.weld()?;
    let (split_requests, whole) = join(work, &buckets, options.leaf_triangles, joining, vec![findings])?;
    Ok(Topology { places, replies, split_requests, whole })
}

/// Buckets whose triangles are in the scratch folder: all, or those of one region.
pub(super) struct Region<'a> {
    pub(super) work: &'a Work<'a>,
    pub(super) layout: Layout,
    pub(super) lattice: &'a Lattice,
    pub(super) scattered: &'a Scattered,
    /// All buckets of the model.
    pub(super) buckets: &'a Buckets,
    pub(super) leaf_triangles: usize,
    pub(super) precision: Precision,
    pub(super) joining: &'a Joining,
    /// Whether the region is the whole model.
    pub(super) is_all: bool,
}

/// The results of a region in addition to the file [`WELDED`].
pub(super) struct Welding {
    /// By bucket, starting with the first of the region.
    pub(super) places: Vec<WeldedPlace>,
    /// For every bucket of the model.
    pub(super) replies: Lists,
    pub(super) findings: Findings,
}

impl Region<'_> {
    /// Weld the buckets, and determine how their triangles relate to their neighbours.
    pub(super) fn weld(&self) -> Result<Welding, BuildError> {
        let Self { work, layout, scattered, buckets, .. } = *self;
        let files = (scattered.own.open(work.scratch)?, scattered.halo.open(work.scratch)?);
        let welded = work.scratch.create(WELDED)?;
        let replies = Mutex::new(Spill::create(work.scratch, REPLIES, buckets.len(), &[0], work.memory / 16)?);
        let done = AtomicU64::new(0);
        let all: Vec<usize> = scattered.own.range().map(|b| b as usize).collect();
        let one = |bucket: usize| -> Result<Finished, BuildError> {
            let finished = self.bucket((&files.0, &files.1), bucket, &welded, &replies)?;
            let done = done.fetch_add(1, Ordering::Relaxed) + 1;
            work.progress.update("joining triangles", done, all.len() as u64);
            Ok(finished)
        };
        let cost = |b: usize| scattered.triangles_in(layout, b) * bytes_per_triangle(layout);
        let budget = work.memory / 10 * 9;
        let run = |of: &[usize]| -> Result<Vec<(usize, Finished)>, BuildError> {
            let done = work.run_jobs(of.len(), budget, |i| cost(of[i]), |i| one(of[i]))?;
            Ok(of.iter().copied().zip(done).collect())
        };
        let (large, small): (Vec<usize>, Vec<usize>) = all.iter().partition(|b| cost(**b) > budget);
        let mut finished = run(&small)?;
        if self.is_all {
            let mut known = vec![Above::default(); buckets.len()];
            for (b, f) in &finished {
                known[*b] = f.above.clone();
            }
            self.refuse_crowded_leaves(
                &files.0,
                known,
                finished.iter().flat_map(|(_, f)| &f.keys).copied().collect(),
                &large,
            )?;
        } else {
            self.refuse_piles(&files.0, &large)?;
        }
        finished.extend(run(&large)?);
        finished.sort_unstable_by_key(|(bucket, _)| *bucket);
        let mut findings = Findings::default();
        let (mut places, mut bounds, mut roughness) = (Vec::new(), Aabb::EMPTY, Lengths::default());
        for (_, f) in finished {
            places.push(f.place);
            findings.above.push(f.above);
            findings.parts.push(f.part);
            findings.keys.extend(f.keys.iter().map(|k| (k.level, k.midpoint)));
            // Only tasks need the groups.
            findings.groups.extend(f.groups.into_iter().filter(|_| !self.is_all));
            findings.counts.add(&f.counts);
            roughness.merge(&f.roughness);
            bounds = bounds.union(&f.bounds);
        }
        findings.keys.sort_unstable_by_key(|(level, midpoint)| DiamondKey { level: *level, midpoint: *midpoint });
        findings.keys.dedup();
        findings.roughness = roughness.sparse();
        findings.bounds = (bounds != Aabb::EMPTY).then_some([bounds.min, bounds.max]);
        let replies = replies.into_inner().unwrap_or_else(PoisonError::into_inner).finish()?;
        Ok(Welding { places, replies, findings })
    }

    fn bucket(
        &self,
        files: (&ScratchFile, &ScratchFile),
        bucket: usize,
        welded: &ScratchFile,
        replies: &Mutex<Spill>,
    ) -> Result<Finished, BuildError> {
        let local = Local::read(self.scattered, self.layout, files, bucket, self.buckets)?;
        let edges = local.edges();
        let normals = if self.layout.normals { Vec::new() } else { local.normals(self.precision) };
        let answers = local.answers(&edges.borders, &normals);
        {
            let mut replies = replies.lock().unwrap_or_else(PoisonError::into_inner);
            for (to, words) in &answers {
                replies.push(*to as usize, words)?;
            }
        }
        let (above, keys, groups) = local.split_requests(self.buckets, self.leaf_triangles);
        let counts = local.counts(&edges);
        let (_, part) = local.components(self.joining)?;
        let roughness = local.roughness(&normals);
        let bounds = local.bounds();
        let place = local.into_welded(&edges.borders, normals).write(welded)?;
        Ok(Finished { place, above, keys, groups, counts, part, roughness, bounds })
    }
}

/// Join the results of all regions, in their order: the requested diamonds, and what is known about the whole model.
pub(super) fn join(
    work: &Work<'_>,
    buckets: &Buckets,
    leaf_triangles: usize,
    joining: Joining,
    regions: Vec<Findings>,
) -> Result<(Vec<(u8, LatticePoint)>, Whole), BuildError> {
    let (mut above, mut parts, mut keys) = (Vec::new(), Vec::new(), Vec::new());
    let (mut counts, mut lengths, mut bounds) = (Counts::default(), Lengths::default(), Aabb::EMPTY);
    for region in regions {
        above.extend(region.above);
        parts.extend(region.parts);
        keys.extend(region.keys);
        counts.add(&region.counts);
        lengths.add_sparse(&region.roughness);
        region.bounds.into_iter().flatten().for_each(|p| bounds.add(p));
    }
    let wanted = split_requests::above(buckets, &above, buckets.cube_log2(), leaf_triangles);
    keys.extend(wanted.into_iter().map(|k| (k.level, k.midpoint)));
    keys.sort_unstable_by_key(|(level, midpoint)| DiamondKey { level: *level, midpoint: *midpoint });
    keys.dedup();
    let components = joining.finish(work.scratch, work.memory / 4, &parts)?.components;
    let roughness = lengths.percentile(0.5) / ROUGHNESS_PARTS;
    Ok((keys, Whole { counts, components, roughness, bounds: [bounds.min, bounds.max] }))
}

struct Finished {
    place: WeldedPlace,
    above: Above,
    keys: Vec<DiamondKey>,
    groups: Vec<Group>,
    counts: Counts,
    part: Part,
    roughness: Lengths,
    bounds: Aabb,
}

/// A bucket in memory: its own triangles, then those of others that touch it.
pub(super) struct Local {
    layout: Layout,
    bucket: u32,
    weld: Weld,
    /// Own triangles.
    own: usize,
    own_vertices: usize,
    own_points_count: usize,
    /// Corners as vertices, and as points.
    triangles: Vec<[u32; 3]>,
    points: Vec<[u32; 3]>,
    /// Bucket and place of each halo triangle.
    heads: Vec<[u32; 2]>,
    /// The bucket of each point.
    owner: Vec<u32>,
}

/// What the edges say.
struct Edges {
    /// Bits of the border edges that belong to this bucket, by triangle.
    borders: Vec<u8>,
    counts: Counts,
}

impl Local {
    /// Read and weld a bucket; `files` are that of own and that of halo triangles.
    pub(super) fn read(
        scattered: &Scattered,
        layout: Layout,
        files: (&ScratchFile, &ScratchFile),
        bucket: usize,
        buckets: &Buckets,
    ) -> Result<Self, BuildError> {
        let mut words = Vec::new();
        scattered.own.read(files.0, bucket, &mut words)?;
        let n = words.len() / layout.triangle();
        if n > MAX {
            let why = format!("{n} triangles at one place, which space cannot divide; at most {MAX}");
            return Err(BuildError::TooLarge { why });
        }
        let mut local = Self::weld(&words, layout, bucket as u32);
        words.clear();
        scattered.halo.read(files.1, bucket, &mut words)?;
        local.weld_halo(&words, buckets);
        Ok(local)
    }

    fn weld(words: &[u32], layout: Layout, bucket: u32) -> Self {
        let n = words.len() / layout.triangle();
        let mut local = Self {
            layout,
            bucket,
            weld: Weld::new(layout.vertex(), n * 5 / 9),
            own: n,
            own_vertices: 0,
            own_points_count: 0,
            triangles: Vec::with_capacity(n),
            points: Vec::with_capacity(n),
            heads: Vec::new(),
            owner: Vec::new(),
        };
        words.chunks_exact(layout.triangle()).for_each(|t| local.add(t));
        local.own_vertices = local.weld.vertex_count();
        local.own_points_count = local.weld.point_count();
        local
    }

    fn add(&mut self, corners: &[u32]) {
        let width = self.layout.vertex();
        let vertices: [u32; 3] = std::array::from_fn(|k| self.weld.vertex(&corners[k * width..][..width]));
        self.triangles.push(vertices);
        self.points.push(vertices.map(|v| self.weld.point_of[v as usize]));
    }

    fn weld_halo(&mut self, words: &[u32], buckets: &Buckets) {
        for t in words.chunks_exact(HALO_HEAD + self.layout.triangle()) {
            self.heads.push([t[0], t[1]]);
            self.add(&t[HALO_HEAD..]);
        }
        self.weld.close();
        let mut last = None;
        let owner = |p| {
            let position = self.weld.position_of_point(p);
            // Nearly every point is in the same bucket as the point before it.
            let bucket = last.filter(|b| buckets.is_inside(*b, position)).unwrap_or_else(|| buckets.of_point(position));
            last = Some(bucket);
            bucket
        };
        self.owner = (0..self.weld.point_count() as u32).map(owner).collect();
    }

    /// All edges, by their smaller and then their larger end.
    fn edges(&self) -> Edges {
        let mut out = Edges { borders: vec![0; self.triangles.len()], counts: Counts::default() };
        let mut starts = vec![0u32; self.owner.len() + 1];
        let ends = |p: &[u32; 3]| [(p[0], p[1]), (p[1], p[2]), (p[2], p[0])];
        for p in &self.points {
            for (a, b) in ends(p) {
                starts[a.min(b) as usize] += 1;
            }
        }
        let mut sum = 0;
        for s in &mut starts {
            sum += *s;
            *s = sum;
        }
        // Filled from the end of each list, so that the starts are right when all are in.
        let mut edges = vec![0u64; sum as usize];
        for (t, p) in self.points.iter().enumerate() {
            for (k, (a, b)) in ends(p).into_iter().enumerate() {
                let at = &mut starts[a.min(b) as usize];
                *at -= 1;
                edges[*at as usize] = (u64::from(a.max(b)) << 32) | (t as u64 * 8 + k as u64 * 2 + u64::from(a < b));
            }
        }
        for (low, range) in starts.windows(2).enumerate() {
            let at_point = &mut edges[range[0] as usize..range[1] as usize];
            at_point.sort_unstable();
            for same in at_point.chunk_by(|a, b| a >> 32 == b >> 32) {
                self.edge(low as u32, same, &mut out);
            }
        }
        out
    }

    /// One edge: the triangles at it as `triangle * 8 + corner * 2 + direction`, below the number of its larger end.
    fn edge(&self, low: u32, uses: &[u64], out: &mut Edges) {
        let high = (uses[0] >> 32) as u32;
        let name = |e: u64| e as u32;
        if self.owner[low as usize].min(self.owner[high as usize]) == self.bucket {
            match uses {
                [e] => {
                    out.borders[(name(*e) >> 3) as usize] |= 1 << (name(*e) >> 1 & 3);
                    out.counts.border_edges += 1;
                }
                [a, b] => out.counts.inconsistent_edges += u64::from(a & 1 == b & 1),
                _ => out.counts.non_manifold_edges += 1,
            }
        }
        if uses.len() > 1 {
            // Own triangles whose third point is the largest: each triangle is looked at from one of its edges.
            let third = |e: u64| {
                let (t, k) = ((name(e) >> 3) as usize, (name(e) >> 1 & 3) as usize);
                let p = self.points[t][(k + 2) % 3];
                (t < self.own && p > high).then_some(p)
            };
            if let [a, b] = uses {
                out.counts.duplicate_triangles += u64::from(third(*a).is_some() && third(*a) == third(*b));
            } else {
                let mut thirds: Vec<u32> = uses.iter().filter_map(|e| third(*e)).collect();
                thirds.sort_unstable();
                out.counts.duplicate_triangles += thirds.windows(2).filter(|w| w[0] == w[1]).count() as u64;
            }
        }
    }

    /// Area-weighted normals of the points of this bucket, in words; 0 for points of others.
    fn normals(&self, precision: Precision) -> Vec<u32> {
        let mut sums = vec![[0i128; 3]; self.owner.len()];
        for (vertices, points) in self.triangles.iter().zip(&self.points) {
            let [a, b, c] = vertices.map(|v| I64Vec3::from(self.weld.position(v).map(i64::from)));
            let n = (b - a).cross(c - a);
            for p in points {
                let s = &mut sums[*p as usize];
                (0..3).for_each(|i| s[i] += i128::from(n[i]));
            }
        }
        let word = |s: &[i128; 3]| word_of_normal(precision.normal(normal::encode(s.map(|x| x as f64).into())));
        sums.iter().zip(&self.owner).map(|(s, owner)| if *owner == self.bucket { word(s) } else { 0 }).collect()
    }

    /// What the buckets of the halo triangles want to know: bucket, and the words of a reply.
    fn answers(&self, borders: &[u8], normals: &[u32]) -> Vec<(u32, [u32; REPLY])> {
        let mut out = Vec::new();
        for (i, head) in self.heads.iter().enumerate() {
            let t = self.own + i;
            let mut reply = [head[1], u32::from(borders[t]), 0, 0, 0];
            for (k, p) in self.points[t].iter().enumerate() {
                if !self.layout.normals && self.owner[*p as usize] == self.bucket {
                    reply[1] |= 8 << k;
                    reply[2 + k] = normals[*p as usize];
                }
            }
            if reply[1] != 0 {
                out.push((head[0], reply));
            }
        }
        out
    }

    fn split_requests(&self, buckets: &Buckets, leaf_triangles: usize) -> (Above, Vec<DiamondKey>, Vec<Group>) {
        let mut sums = Vec::with_capacity(self.own);
        let mut sizes = Vec::with_capacity(self.own);
        for vertices in &self.triangles[..self.own] {
            let corners = vertices.map(|v| self.weld.position(v));
            sums.push(split_requests::sum_of(corners));
            sizes.push(split_requests::size_of(corners));
        }
        let deepest = max_level(buckets.cube_log2());
        let (keys, groups) = (Vec::new(), Vec::new());
        let mut requests = SplitRequests { sums: &sums, sizes: &sizes, leaf_triangles, deepest, keys, groups };
        let above = requests.collect(&buckets.tetrahedra()[self.bucket as usize]);
        (above, requests.keys, requests.groups)
    }

    fn counts(&self, edges: &Edges) -> Counts {
        let own = |p: u32| self.owner[p as usize] == self.bucket;
        Counts {
            points: self.owner.iter().filter(|o| **o == self.bucket).count() as u64,
            vertices: self.weld.point_of.iter().filter(|p| own(**p)).count() as u64,
            ..edges.counts
        }
    }

    fn bounds(&self) -> Aabb {
        let mut bounds = Aabb::EMPTY;
        for p in 0..self.own_points_count as u32 {
            bounds.add(point_of_words(self.weld.position_of_point(p)));
        }
        bounds
    }

    /// Own triangles by their points.
    pub(super) fn own_points(&self) -> &[[u32; 3]] {
        &self.points[..self.own]
    }

    /// The components of the bucket's own triangles, made known to other buckets.
    pub(super) fn components(&self, joining: &Joining) -> Result<(LocalComponents, Part), ScratchError> {
        let mut components = LocalComponents::of(self.own_points(), self.own_points_count);
        let place = |p: u32| (p, point_of_words(self.weld.position_of_point(p)));
        let part = joining.add(&mut components, self.seen_by_others().map(place))?;
        Ok((components, part))
    }

    /// For one in [`ROUGHNESS_SAMPLE`] points, how far it lies from the plane through the mean of its neighbours that
    /// is at right angles to its normal: in parts of a step.
    fn roughness(&self, normals: &[u32]) -> Lengths {
        let mut lengths = Lengths::default();
        let mut slots = vec![u32::MAX; self.owner.len()];
        let mut sampled = Vec::new();
        for (p, owner) in (0u32..).zip(&self.owner) {
            let [x, y, z] = self.weld.position_of_point(p).map(u64::from);
            let mixed = (x ^ y.rotate_left(21) ^ z.rotate_left(42)).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40;
            if *owner == self.bucket && mixed.is_multiple_of(ROUGHNESS_SAMPLE) {
                slots[p as usize] = sampled.len() as u32;
                sampled.push((p, I64Vec3::ZERO, 0i64));
            }
        }
        for (vertices, points) in self.triangles.iter().zip(&self.points) {
            for k in 0..3 {
                if let Some((_, sum, n)) = sampled.get_mut(slots[points[k] as usize] as usize) {
                    let at = vertices.map(|v| I64Vec3::from(self.weld.position(v).map(i64::from)));
                    *sum += at[(k + 1) % 3] + at[(k + 2) % 3] - 2 * at[k];
                    *n += 2;
                }
            }
        }
        for (p, sum, n) in sampled {
            let word = match self.layout.normal() {
                Some(at) => self.weld.vertices[self.weld.vertex_at[p as usize] as usize * self.layout.vertex() + at],
                None => normals[p as usize],
            };
            let normal = normal::decode(normal_of_word(word));
            let away = normal.dot(sum.as_dvec3()) / n.max(1) as f64;
            lengths.add_square((away * ROUGHNESS_PARTS).powi(2));
        }
        lengths
    }

    /// Own points that other buckets may use too.
    fn seen_by_others(&self) -> impl Iterator<Item = u32> {
        let mut shared: Vec<bool> = self.owner[..self.own_points_count].iter().map(|o| *o != self.bucket).collect();
        for p in self.points[self.own..].iter().flatten() {
            if let Some(s) = shared.get_mut(*p as usize) {
                *s = true;
            }
        }
        (0u32..).zip(shared).filter(|(_, s)| *s).map(|(p, _)| p)
    }

    /// What the bucket's own triangles use.
    fn into_welded(mut self, borders: &[u8], mut normals: Vec<u32>) -> Welded {
        let shared = self.seen_by_others().collect();
        for (t, bits) in self.triangles.iter_mut().zip(borders) {
            for (k, corner) in t.iter_mut().enumerate() {
                *corner |= if bits >> k & 1 == 1 { BORDER } else { 0 };
            }
        }
        self.triangles.truncate(self.own);
        self.weld.vertices.truncate(self.own_vertices * self.layout.vertex());
        self.weld.point_of.truncate(self.own_vertices);
        normals.truncate(self.own_points_count);
        Welded {
            vertices: self.weld.vertices,
            point_of: self.weld.point_of,
            normals,
            shared,
            triangles: self.triangles,
        }
    }
}
