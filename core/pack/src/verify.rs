//! Properties of a valid pack beyond its checksums, chunk by chunk: that the directory is correct for each
//! chunk, and that nothing of the finest level is lost. [`crate::Reader::open`] has checked header, metadata,
//! directory and footer before.

use crate::chunk::PatchRange;
use crate::directory::children_of;
use crate::reader::check_spheres;
use crate::{Children, Chunk, DirectoryEntry, HEAD_BYTES, Header, Metadata, NO_DIAMOND, PAGE_BYTES, PackError};
use glam::DVec3;
use kilwa_geometry::{Aabb, Sphere};
use serde::{Deserialize, Serialize};

/// Rounding that a sphere may be short of, relative to its radius and to the coordinates.
const SLACK: f64 = 1e-9;
/// Largest possible colour error: the root mean square of differences of at most 255.
const MAX_COLOR_ERROR: f32 = 255.0;

/// Counts that grow chunk by chunk and are compared with header and metadata at the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Chunks seen.
    pub chunks: u64,
    /// Triangles of leaf patches: the finest level.
    pub finest_triangles: u64,
    /// True-border edges of leaf patches.
    pub finest_borders: u64,
    /// Triangles of all patches.
    pub stored_triangles: u64,
    /// Box of the leaf patches.
    pub finest_bounds: Aabb,
}

impl Default for Totals {
    fn default() -> Self {
        Self { chunks: 0, finest_triangles: 0, finest_borders: 0, stored_triangles: 0, finest_bounds: Aabb::EMPTY }
    }
}

impl Totals {
    /// Add another part's counts.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self {
            chunks: self.chunks + other.chunks,
            finest_triangles: self.finest_triangles + other.finest_triangles,
            finest_borders: self.finest_borders + other.finest_borders,
            stored_triangles: self.stored_triangles + other.stored_triangles,
            finest_bounds: self.finest_bounds.union(&other.finest_bounds),
        }
    }

    /// Compare with what header and metadata say, all chunks having been counted.
    ///
    /// # Errors
    /// [`PackError::Invalid`] when a triangle or border is missing or occurs twice, or the model is not as large as
    /// the metadata says.
    pub fn agree(&self, header: &Header, metadata: &Metadata) -> Result<(), PackError> {
        for (what, found, announced) in [
            ("chunks", self.chunks, u64::from(header.entry_count)),
            ("triangles of the finest level", self.finest_triangles, header.triangles),
            ("stored triangles", self.stored_triangles, header.stored_triangles),
            ("border edges of the finest level", self.finest_borders, metadata.border_edges),
        ] {
            if found != announced {
                return Err(PackError::invalid("pack", format!("{found} {what} are there, {announced} are announced")));
            }
        }
        if self.finest_bounds.is_empty() {
            return Ok(());
        }
        let far = |a: DVec3, b: DVec3| {
            let rounding = header.lattice.step() + a.abs() * f64::EPSILON * 4.0;
            (a - b).abs().cmpgt(rounding).any()
        };
        let corners = [self.finest_bounds.min, self.finest_bounds.max].map(|p| header.lattice.world_from_lattice(p));
        let [low, high] = corners;
        if far(low, metadata.bounds_min) || far(high, metadata.bounds_max) {
            let (low, high) = (low.to_array(), high.to_array());
            let why = format!("the model reaches from {low:?} to {high:?} m, which is not what the metadata says");
            return Err(PackError::invalid("metadata", why));
        }
        Ok(())
    }
}

/// Check the directory on its own: the children stated by an entry are those that name it as a parent; every sphere contains the spheres below it;
/// colour errors are possible.
///
/// # Errors
/// [`PackError::Invalid`] naming the entry.
pub fn directory(entries: &[DirectoryEntry]) -> Result<(), PackError> {
    // The value of the root entry has no meaning and may be infinite.
    for (index, entry) in entries.iter().enumerate().skip(1) {
        if entry.color_error > MAX_COLOR_ERROR {
            let why = format!("a colour error of {} is not possible; it can be at most 255", entry.color_error);
            return Err(PackError::invalid(format!("directory entry {index}"), why));
        }
    }
    for (index, (entry, found)) in entries.iter().zip(children_of(entries)).enumerate() {
        let listed = entry.children.map(|c| Children { is_whole: false, ..c });
        if listed.is_some() && listed != found {
            let why = format!(
                "the children that it lists ({listed:?}) are not those that name it as their parent ({found:?})"
            );
            return Err(PackError::invalid(format!("directory entry {index}"), why));
        }
    }
    check_spheres(entries)
}

/// Check the order of the parts: directory page 1 follows the first chunks that end in the head, or would follow them if it existed.
///
/// # Errors
/// [`PackError::Invalid`] with the correct offset.
pub fn order(header: &Header, entries: &[DirectoryEntry]) -> Result<(), PackError> {
    let mut at = header.first_page.saturating_add(PAGE_BYTES as u64);
    for entry in entries {
        let end = at.saturating_add(u64::from(entry.encoded_bytes));
        if end > HEAD_BYTES {
            break;
        }
        at = end;
    }
    if header.other_pages == at {
        return Ok(());
    }
    let why = format!("it says that directory page 1 is at byte {}; it must be at byte {at}", header.other_pages);
    Err(PackError::invalid("header", why))
}

/// Check one decoded chunk against the directory: its geometry ([`geometry`]) and its links ([`links`]).
///
/// # Errors
/// [`PackError::Invalid`] naming the chunk.
pub fn chunk(index: u32, chunk: &Chunk, entries: &[DirectoryEntry]) -> Result<Totals, PackError> {
    let what = format!("chunk {index}");
    let Some(entry) = entries.get(index as usize) else {
        return Err(PackError::invalid(what, "it has no directory entry"));
    };
    let totals = geometry(&what, chunk, &entry.bounds, &entry.sphere)?;
    links(index, &chunk.patches, entries)?;
    Ok(totals)
}

/// Check the geometry of a decoded chunk: `bounds` must be its exact box, and `sphere` must contain all its vertices. Errors call the chunk `what`.
/// Returns its counts.
///
/// # Errors
/// [`PackError::Invalid`] naming the chunk.
pub fn geometry(what: &str, chunk: &Chunk, bounds: &Aabb, sphere: &Sphere) -> Result<Totals, PackError> {
    let bad = |why: String| Err(PackError::invalid(what, why));
    let found = Aabb::of(&chunk.mesh.positions);
    if found != *bounds && !(found.is_empty() && bounds.is_empty()) {
        return bad("its box is not the one in the directory".to_owned());
    }
    for p in &chunk.mesh.positions {
        if p.as_dvec3().distance(sphere.center) > sphere.radius * (1.0 + SLACK) + SLACK {
            return bad(format!("the vertex at {:?} lies outside its bounding sphere", p.to_array()));
        }
    }
    let mut totals = Totals { chunks: 1, ..Totals::default() };
    let mut borders = chunk.mesh.borders.iter();
    let mut triangles = chunk.mesh.triangles.iter();
    for patch in &chunk.patches {
        let count = u64::from(patch.count);
        let bits: u64 = borders.by_ref().take(patch.count as usize).map(|b| u64::from(b.count_ones())).sum();
        let of_patch = triangles.by_ref().take(patch.count as usize);
        totals.stored_triangles += count;
        if patch.diamond != NO_DIAMOND {
            of_patch.for_each(drop);
            continue;
        }
        totals.finest_triangles += count;
        totals.finest_borders += bits;
        for position in of_patch.flatten().filter_map(|&v| chunk.mesh.positions.get(v as usize)) {
            totals.finest_bounds.add(*position);
        }
    }
    Ok(totals)
}

/// Check the patch table of a chunk against the directory: every patch's diamond must have this entry among its parents, and there must be no
/// leaf patch if the children replace all of the chunk.
///
/// # Errors
/// [`PackError::Invalid`] naming the chunk.
pub fn links(index: u32, patches: &[PatchRange], entries: &[DirectoryEntry]) -> Result<(), PackError> {
    let bad = |why: String| Err(PackError::invalid(format!("chunk {index}"), why));
    let is_replaced = entries.get(index as usize).and_then(|entry| entry.children).is_some_and(|c| c.is_whole);
    for patch in patches {
        if patch.diamond == NO_DIAMOND {
            if patch.count > 0 && is_replaced {
                return bad("it has a leaf patch, but by the directory its children replace all of it".to_owned());
            }
            continue;
        }
        let below = entries.get(patch.diamond as usize);
        if !below.is_some_and(|below| below.parents().any(|parent| parent == index)) {
            return bad(format!("a patch names diamond {}, which does not name it as a parent", patch.diamond));
        }
    }
    Ok(())
}
