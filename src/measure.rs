//! `kilwa measure`: values from the finest surface, each with its standard uncertainty.

use crate::source::{FileSource, open_pack};
use clap::Subcommand;
use kilwa_geometry::Aabb;
use kilwa_geometry::distance::{Vec3, dot, sub};
use kilwa_measure::{Areas, Length, Surface, Uncertainty};
use kilwa_pack::Reader;
use kilwa_pack::cut::Cut;
use serde_json::json;
use std::path::PathBuf;

/// Measure on the finest surface.
///
/// Positions are in metres, in the coordinates of the model (world coordinates, z up).
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    #[command(subcommand)]
    tool: Tool,
    /// Print as JSON.
    #[arg(long, global = true)]
    json: bool,
}

#[derive(Subcommand)]
#[command(allow_negative_numbers = true)]
enum Tool {
    /// The point of the surface nearest to a position.
    #[command(allow_negative_numbers = true)]
    Coordinate {
        /// x y z in metres.
        #[arg(num_args = 3, required = true, value_names = ["X", "Y", "Z"])]
        at: Vec<f64>,
    },
    /// The distance between the two points of the surface nearest to two positions.
    #[command(allow_negative_numbers = true)]
    Distance {
        /// Both positions: x y z x y z in metres.
        #[arg(num_args = 6, required = true, value_names = ["X1", "Y1", "Z1", "X2", "Y2", "Z2"])]
        ends: Vec<f64>,
    },
    /// The area of the whole surface, along it and in plan.
    Area,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let pack = open_pack(&args.pack)?;
    let uncertainty = Uncertainty::finest(pack.header().lattice.step(), pack.metadata().capture_accuracy);
    match &args.tool {
        Tool::Coordinate { at } => {
            let (p, away) = nearest(&pack, finite([at[0], at[1], at[2]])?)?;
            let q = p.map(|value| kilwa_measure::Quantity { value, uncertainty: uncertainty.combined() });
            let words = format!("x {} m\ny {} m\nz {} m\n{away:.4} m from the given position", q[0], q[1], q[2]);
            print(args, &json!({ "position": q, "away": away, "uncertainty": uncertainty }), &words, &uncertainty)
        }
        Tool::Distance { ends } => {
            let (a, _) = nearest(&pack, finite([ends[0], ends[1], ends[2]])?)?;
            let (b, _) = nearest(&pack, finite([ends[3], ends[4], ends[5]])?)?;
            let l = Length::between(a, b, &uncertainty);
            let words =
                format!("straight   {} m\nhorizontal {} m\nvertical   {} m", l.straight, l.horizontal, l.vertical);
            print(args, &json!({ "from": a, "to": b, "length": l, "uncertainty": uncertainty }), &words, &uncertainty)
        }
        Tool::Area => {
            let areas = areas(&pack)?;
            let words = format!("surface {:.6} m²\nplan    {:.6} m²", areas.surface, areas.plan);
            // Of the coordinates that the areas are made of: how they add up to that of an area depends on how they correlate.
            print(args, &json!({ "area": areas, "coordinate_uncertainty": uncertainty }), &words, &uncertainty)
        }
    }
}

fn finite(p: Vec3) -> anyhow::Result<Vec3> {
    anyhow::ensure!(p.iter().all(|x| x.is_finite()), "a position must be three finite numbers");
    Ok(p)
}

fn print(args: &Args, value: &serde_json::Value, words: &str, uncertainty: &Uncertainty) -> anyhow::Result<()> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    if args.json {
        serde_json::to_writer_pretty(&mut out, value)?;
        writeln!(out)?;
        return Ok(());
    }
    writeln!(out, "{words}")?;
    match uncertainty.capture {
        Some(c) => writeln!(
            out,
            "standard uncertainty of a coordinate: lattice {:.3e} m and capture {c} m",
            uncertainty.lattice
        )?,
        None => writeln!(
            out,
            "standard uncertainty of a coordinate: lattice {:.3e} m only; the accuracy of the capture is unknown",
            uncertainty.lattice
        )?,
    }
    Ok(())
}

/// The nearest point of the finest surface, in metres, and how far it is. Chunks are read nearest first and only while
/// they can still hold a nearer point.
fn nearest(pack: &Reader<FileSource>, world: Vec3) -> anyhow::Result<(Vec3, f64)> {
    let lattice = pack.header().lattice;
    let p = lattice.steps_from_world(world);
    let mut order: Vec<(f64, u32)> =
        (0u32..).zip(pack.entries()).map(|(i, e)| (box_distance(p, &e.bounds), i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let finest = Cut::finest(pack.entries());
    let mut best: Option<(f64, Vec3)> = None;
    for (lower, i) in order {
        if best.is_some_and(|b| lower > b.0) {
            break;
        }
        let chunk = pack.chunk(i)?;
        let triangles: Vec<[Vec3; 3]> = finest
            .drawn(&chunk.patches)
            .flat_map(|r| r.first..r.first + r.count)
            .map(|t| chunk.mesh.corners(t as usize).map(|c| c.map(f64::from)))
            .collect();
        if let Some((q, _)) = Surface::new(triangles).nearest(p) {
            let d = dot(sub(p, q), sub(p, q)).sqrt();
            if best.is_none_or(|b| d < b.0) {
                best = Some((d, q));
            }
        }
    }
    let (d, q) = best.ok_or_else(|| anyhow::anyhow!("the pack has no surface"))?;
    Ok((lattice.world_from_steps(q), d * lattice.step()))
}

fn box_distance(p: Vec3, b: &Aabb) -> f64 {
    if b.is_empty() {
        return f64::INFINITY;
    }
    (0..3)
        .map(|i| (f64::from(b.min[i]) - p[i]).max(p[i] - f64::from(b.max[i])).max(0.0))
        .map(|x| x * x)
        .sum::<f64>()
        .sqrt()
}

fn areas(pack: &Reader<FileSource>) -> anyhow::Result<Areas> {
    let step = pack.header().lattice.step();
    let finest = Cut::finest(pack.entries());
    let mut areas = Areas::default();
    for i in finest.refined() {
        let chunk = pack.chunk(i)?;
        for r in finest.drawn(&chunk.patches) {
            for t in r.first..r.first + r.count {
                areas.add(chunk.mesh.corners(t as usize).map(|c| c.map(|x| f64::from(x) * step)));
            }
        }
    }
    Ok(areas)
}
