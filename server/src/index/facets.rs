//! The facet values of every object, in memory, so that they are counted without asking the database for each: with ten
//! thousand objects that is the larger part of a search.
//!
//! Input: the tables `has` and `value`. Invariant: it is that of the `generation` that it names, which every change of the index counts up;
//! whoever finds another generation reads it again. Some 30 bytes for each object and value.

use super::search::{Count, Facet, FacetCounts};
use rusqlite::Connection;
use std::sync::{Arc, Mutex, PoisonError};

/// See the module.
pub(super) struct Facets {
    generation: i64,
    /// Objects, rising, and where in `has` theirs begin; one more at the end.
    objects: Vec<i64>,
    begins: Vec<usize>,
    /// Places in `values`.
    has: Vec<u32>,
    values: Vec<(Facet, String)>,
}

/// The one that is held.
#[derive(Default)]
pub(super) struct Held(Mutex<Option<Arc<Facets>>>);

impl Held {
    /// That of the index as it is now.
    pub(super) fn now(&self, connection: &Connection) -> Result<Arc<Facets>, rusqlite::Error> {
        let generation = connection.prepare_cached("SELECT n FROM generation")?.query_row([], |row| row.get(0))?;
        let held = self.0.lock().unwrap_or_else(PoisonError::into_inner).clone();
        if let Some(held) = held.filter(|held| held.generation == generation) {
            return Ok(held);
        }
        let read = Arc::new(Facets::read(connection, generation)?);
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::clone(&read));
        Ok(read)
    }
}

impl Facets {
    fn read(connection: &Connection, generation: i64) -> Result<Self, rusqlite::Error> {
        let (mut numbers, mut values) = (Vec::new(), Vec::new());
        let mut statement = connection.prepare_cached("SELECT id, facet, value FROM value ORDER BY id")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let (id, facet): (i64, i64) = (row.get(0)?, row.get(1)?);
            if let Some(facet) = Facet::ALL.into_iter().find(|f| *f as i64 == facet) {
                numbers.push(id);
                values.push((facet, row.get(2)?));
            }
        }
        let mut facets = Self { generation, objects: Vec::new(), begins: Vec::new(), has: Vec::new(), values };
        let mut statement = connection.prepare_cached("SELECT object, value FROM has ORDER BY object")?;
        let mut rows = statement.query([])?;
        while let Some(row) = rows.next()? {
            let (object, value): (i64, i64) = (row.get(0)?, row.get(1)?);
            if facets.objects.last() != Some(&object) {
                facets.objects.push(object);
                facets.begins.push(facets.has.len());
            }
            facets.has.extend(numbers.binary_search(&value).ok().and_then(|at| u32::try_from(at).ok()));
        }
        facets.begins.push(facets.has.len());
        Ok(facets)
    }

    /// How many of these objects have each value: the `most` most frequent of each facet, of one facet only if `only` is given.
    pub(super) fn count(&self, objects: &[i64], only: Option<Facet>, max: usize) -> FacetCounts {
        let mut counts = vec![0_u64; self.values.len()];
        for object in objects {
            let Ok(at) = self.objects.binary_search(object) else { continue };
            let range = self.begins.get(at).zip(self.begins.get(at + 1));
            let has = range.and_then(|(from, to)| self.has.get(*from..*to)).unwrap_or_default();
            for value in has {
                if let Some(count) = counts.get_mut(*value as usize) {
                    *count += 1;
                }
            }
        }
        let mut facets: FacetCounts = Facet::ALL.into_iter().map(|f| (f, Vec::new())).collect();
        for ((facet, value), count) in self.values.iter().zip(counts) {
            if count > 0 && only.is_none_or(|only| only == *facet) {
                facets.entry(*facet).or_default().push(Count { value: value.clone(), count });
            }
        }
        for counts in facets.values_mut() {
            counts.sort_by(|a, b| b.count.cmp(&a.count).then_with(|| a.value.cmp(&b.value)));
            counts.truncate(max);
        }
        facets
    }
}
