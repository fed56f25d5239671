//! What a build says of itself: the report for people and machines, the metadata and the header of the pack.

use crate::assemble::PackSummary;
use crate::build::options::BuildOptions;
use crate::ingest::surface::{ColoredBy, Diagnostic, Surface};
use crate::levels::Levels;
use glam::DVec3;
use kilwa_formats::Up;
use kilwa_pack::{Header, Metadata};
use std::collections::BTreeMap;

/// What a build reports.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct BuildReport {
    /// Triangles of the finest level.
    pub triangles: u64,
    /// Points, if the pack is made of points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub points: Option<u64>,
    /// Distinct lattice positions.
    pub vertices: u64,
    /// Lattice spacing, metres.
    pub step: f64,
    /// Size of the model, metres.
    pub extent: DVec3,
    /// Smallest corner of the model, metres.
    pub bounds_min: DVec3,
    /// See [`Surface::facing`].
    pub facing: DVec3,
    /// Where the colours come from.
    pub colored_by: ColoredBy,
    /// Median edge length, metres.
    pub median_edge: f64,
    /// Edges used by one triangle.
    pub border_edges: u64,
    /// Edges used by more than two triangles.
    pub non_manifold_edges: u64,
    /// Edges of two triangles that run along it the same way: neighbours that face apart.
    pub inconsistent_edges: u64,
    /// Triangles that stand a second time, whichever way they face.
    pub duplicate_triangles: u64,
    /// Connected components, triangles joined by points.
    pub components: u64,
    /// Triangles of the largest component.
    pub largest_component: u64,
    /// The length that one edge in a hundred is shorter than, metres.
    pub short_edge: f64,
    /// Estimated standard deviation of the noise along the normal, metres; see [`Surface::noise`].
    pub noise: f64,
    /// Diagnostics of reading and preparing: kind, count and first places.
    #[serde(rename = "findings")]
    pub diagnostics: BTreeMap<String, Diagnostic>,
    /// Leaves that space could not split down to the patch size.
    pub overfull_leaves: u64,
    /// Diamonds that kept more than nine tenths of their triangles.
    pub stuck_diamonds: u64,
    /// Triangles in them.
    pub stuck_triangles: u64,
    /// The file.
    pub pack: PackSummary,
    /// The last stage that an earlier, interrupted build had completed, where this one continued after it.
    pub resumed_after: Option<String>,
    /// Damaged scratch files whose stages were done again.
    pub redone: Vec<String>,
    /// The most bytes that stood in the scratch folder at a time.
    pub scratch_peak_bytes: u64,
    /// The stages of this run, in their order.
    pub stages: Vec<StageTime>,
}

/// How long a stage took.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct StageTime {
    /// Its name.
    pub stage: String,
    /// Seconds by the clock.
    pub seconds: f64,
    /// Seconds of processor time, all threads, where the system says.
    pub cpu_seconds: Option<f64>,
}

impl BuildReport {
    /// All but the file.
    pub(crate) fn of(levels: &Levels) -> Self {
        let s = &levels.surface;
        let [min, max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
        let stuck = || levels.refined.iter().map(|r| r.triangles).filter(|(fine, coarse)| coarse * 10 > fine * 9);
        Self {
            triangles: s.triangles,
            points: None,
            vertices: s.points,
            step: s.lattice.step(),
            extent: max - min,
            bounds_min: min,
            facing: s.facing,
            colored_by: s.colored_by.clone(),
            median_edge: s.median_edge,
            border_edges: s.border_edges,
            non_manifold_edges: s.non_manifold_edges,
            inconsistent_edges: s.inconsistent_edges,
            duplicate_triangles: s.duplicate_triangles,
            components: s.components,
            largest_component: s.largest_component,
            short_edge: s.short_edge,
            noise: s.noise,
            diagnostics: s.diagnostics.clone(),
            overfull_leaves: levels.tree.overfull_leaves,
            stuck_diamonds: stuck().count() as u64,
            stuck_triangles: stuck().map(|(_, coarse)| u64::from(coarse)).sum(),
            pack: PackSummary::default(),
            resumed_after: None,
            redone: Vec::new(),
            scratch_peak_bytes: 0,
            stages: Vec::new(),
        }
    }
}

pub(crate) fn header_of(levels: &Levels) -> Header {
    let s = &levels.surface;
    Header::new(s.lattice, s.cube_log2, s.triangles, levels.attributes)
}

/// The metadata that come from the options.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Stated {
    title: String,
    units: String,
    up: String,
    crs: Option<String>,
    capture_accuracy: Option<f64>,
    pub(crate) color_bits: u8,
    pub(crate) normal_bits: u8,
    shaped: BTreeMap<String, String>,
}

impl Stated {
    pub(crate) fn of(options: &BuildOptions) -> Self {
        let mut shaped = BTreeMap::new();
        shaped.insert("step".to_owned(), if options.step.is_some() { "given" } else { "derived" }.to_owned());
        let precision = options.precision();
        shaped.insert("color-bits".to_owned(), precision.color_bits.to_string());
        shaped.insert("normal-bits".to_owned(), precision.normal_bits.to_string());
        shaped.insert("coarse-color-bits".to_owned(), precision.coarse().color_bits.to_string());
        shaped.insert("coarse-normal-bits".to_owned(), precision.coarse().normal_bits.to_string());
        let positions =
            "made ones rounded to a power of two of the step, at most their distance from what they stand for";
        shaped.insert("coarse-positions".to_owned(), positions.to_owned());
        shaped.insert("leaf-triangles".to_owned(), options.leaf_triangles.to_string());
        Self {
            title: options.title.clone(),
            units: options.units.symbol().to_owned(),
            up: if options.up == Up::Z { "z" } else { "y" }.to_owned(),
            crs: options.crs.clone(),
            capture_accuracy: options.capture_accuracy,
            color_bits: options.color_bits,
            normal_bits: options.normal_bits,
            shaped,
        }
    }
}

pub(crate) fn metadata(s: &Surface, stated: &Stated) -> Metadata {
    let [bounds_min, bounds_max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
    // A value given by the user takes precedence; its parts are unknown.
    let capture = s.capture.filter(|_| stated.capture_accuracy.is_none());
    Metadata {
        title: stated.title.clone(),
        source_units: stated.units.clone(),
        source_up: stated.up.clone(),
        crs: stated.crs.clone(),
        lattice_step: s.lattice.step(),
        bounds_min,
        bounds_max,
        median_edge: s.median_edge,
        triangles: s.triangles,
        vertices: s.points,
        border_edges: s.border_edges,
        scalars: s.scalars.clone(),
        sources: s.sources.clone(),
        tool: format!("kilwa {}", env!("CARGO_PKG_VERSION")),
        options: stated.shaped.clone(),
        capture_accuracy: stated.capture_accuracy.or(capture.map(|capture| capture.accuracy)),
        capture_registration: capture.map(|capture| capture.registration),
        capture_instrument: capture.map(|capture| capture.instrument),
        repairs: s.diagnostics.iter().map(|(kind, f)| (kind.clone(), f.count)).collect(),
    }
}
