//! Picks: the same triangle as looking at every triangle finds, at any distance of the eye, never clipped geometry.

use super::check_none;
use super::oracle::between;
use super::phantoms::phantom;
use fastrand::Rng;
use glam::DVec3;
use kilwa_geometry::LatticePoint;
use kilwa_geometry::distance::ray_triangle;
use kilwa_measure::{Picked, Picker, Plane, Ray};
use kilwa_pack::{Chunk, NO_DIAMOND, Reader, SliceSource};
use std::path::Path;

/// A pack in memory with all chunks decoded.
pub(crate) struct Open {
    pub(crate) reader: Reader<SliceSource<Vec<u8>>>,
    pub(crate) chunks: Vec<Chunk>,
}

impl Open {
    pub(crate) fn of(pack: &Path) -> Self {
        let reader = Reader::open(SliceSource(std::fs::read(pack).unwrap())).unwrap();
        let chunks = (0..reader.entries().len() as u32).map(|i| reader.chunk(i).unwrap()).collect();
        Self { reader, chunks }
    }

    pub(crate) fn finest(&self) -> impl Iterator<Item = [LatticePoint; 3]> {
        self.chunks.iter().flat_map(|c| {
            c.patches
                .iter()
                .filter(|p| p.diamond == NO_DIAMOND)
                .flat_map(|p| p.first..p.first + p.count)
                .map(|t| c.mesh.corners(t as usize))
        })
    }

    pub(crate) fn pick(&self, ray: Ray, clips: Vec<Plane>) -> Option<Picked> {
        let mut picker = Picker::new(ray, clips);
        for (enters, i) in picker.order((0u32..).zip(self.reader.entries().iter().map(|e| &e.bounds))) {
            if !picker.wants(enters) {
                break;
            }
            let chunk = &self.chunks[i as usize];
            for p in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
                for t in p.first..p.first + p.count {
                    picker.add(chunk.mesh.corners(t as usize));
                }
            }
        }
        picker.picked().copied()
    }

    /// A ray from somewhere round the model towards a point near it, lattice units.
    pub(crate) fn random_ray(&self, random: &mut Rng) -> Ray {
        let corners = self.finest().flatten().map(glam::IVec3::as_dvec3);
        let (low, high) = corners.fold((DVec3::MAX, DVec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        let size = (high - low).length();
        let middle = (low + high) * 0.5;
        let away = loop {
            let d = DVec3::from([0, 1, 2].map(|_| between(random, -1.0, 1.0)));
            if (0.01..1.0).contains(&d.length_squared()) {
                break d / d.length();
            }
        };
        let far = size * between(random, 0.7, 30.0);
        let origin = middle + away * far;
        let towards = DVec3::from([0, 1, 2].map(|k| between(random, low[k], high[k])));
        Ray { origin, direction: towards - origin }
    }
}

#[test]
fn ten_thousand_rays_agree_with_testing_every_triangle() {
    let mut random = Rng::with_seed(11);
    let (mut wrong, mut rays, mut hits) = (0, 0, 0);
    for (shape, place) in [("stepped-wall", "origin"), ("sphere", "utm"), ("bent-wall", "far"), ("ramp", "utm")] {
        let open = Open::of(&phantom(shape, place).pack);
        let all: Vec<[DVec3; 3]> = open.finest().map(|t| t.map(glam::IVec3::as_dvec3)).collect();
        for _ in 0..2500 {
            let ray = open.random_ray(&mut random);
            let slow = all.iter().filter_map(|t| ray_triangle(ray.origin, ray.direction, *t)).min_by(f64::total_cmp);
            let found = open.pick(ray, Vec::new());
            rays += 1;
            hits += usize::from(slow.is_some());
            wrong += usize::from(found.map(|p| p.t.to_bits()) != slow.map(f64::to_bits));
        }
    }
    assert!(hits > rays / 2, "{hits}");
    check_none("rays whose pick differs from looking at every triangle", rays, wrong);
}

#[test]
fn picks_never_return_clipped_geometry() {
    let mut random = Rng::with_seed(12);
    let open = Open::of(&phantom("stepped-wall", "utm").pack);
    let all: Vec<[DVec3; 3]> = open.finest().map(|t| t.map(glam::IVec3::as_dvec3)).collect();
    let (mut clipped, mut wrong, mut rays) = (0, 0, 0);
    for _ in 0..2000 {
        let ray = open.random_ray(&mut random);
        let at = all[(random.f64() * all.len() as f64) as usize][0];
        let plane = Plane::new(at, [0, 1, 2].map(|_| between(&mut random, -1.0, 1.0)).into()).unwrap();
        let found = open.pick(ray, vec![plane]);
        let kept = |t: &f64| plane.distance(ray.at(*t)) >= 0.0;
        let hits = all.iter().filter_map(|t| ray_triangle(ray.origin, ray.direction, *t));
        let slow = hits.filter(kept).min_by(f64::total_cmp);
        rays += 1;
        clipped += usize::from(found.is_some_and(|p| plane.distance(p.point) < 0.0));
        wrong += usize::from(found.map(|p| p.t.to_bits()) != slow.map(f64::to_bits));
    }
    check_none("picks of clipped geometry", rays, clipped);
    check_none("picks behind a clip plane that differ from looking at every triangle", rays, wrong);
}

#[test]
fn a_ray_gives_the_same_digits_for_any_arrival_order_of_chunks() {
    // Zoom, cache and network change which chunks are there first, and nothing else.
    let open = Open::of(&phantom("bent-wall", "utm").pack);
    let mut random = Rng::with_seed(13);
    let mut different = 0;
    for _ in 0..200 {
        let ray = open.random_ray(&mut random);
        let first =
            open.pick(ray, Vec::new()).map(|p| (p.t.to_bits(), p.point.to_array().map(f64::to_bits), p.corners));
        for _ in 0..10 {
            let mut order: Vec<usize> = (0..open.chunks.len()).collect();
            for i in (1..order.len()).rev() {
                order.swap(i, (random.f64() * (i + 1) as f64) as usize);
            }
            let mut picker = Picker::new(ray, Vec::new());
            for i in order {
                let chunk = &open.chunks[i];
                for p in chunk.patches.iter().filter(|p| p.diamond == NO_DIAMOND) {
                    for t in (p.first..p.first + p.count).rev() {
                        picker.add(chunk.mesh.corners(t as usize));
                    }
                }
            }
            let again = picker.picked().map(|p| (p.t.to_bits(), p.point.to_array().map(f64::to_bits), p.corners));
            different += usize::from(again != first);
        }
    }
    check_none("picks along 200 rays whose digits depend on the order of arrival", 2000, different);
}
