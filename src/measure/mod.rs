//! `kilwa measure`: values from the finest surface, each with its standard uncertainty.
//!
//! One file per part: `place` (points on the surface), `sweep` (all of the surface, or what a box test passes), `whole` (sums over
//! the surface), `cutting` (sections, profiles, contours), `output` (files), `report` (what is printed). The geometry is `kilwa_measure`'s,
//! the same that the page uses.

mod cutting;
mod output;
mod place;
mod report;
mod saved;
mod sweep;
mod whole;

use crate::source::{FileSource, open_pack};
use clap::Subcommand;
use kilwa_geometry::distance::Vec3;
use kilwa_measure::{LengthUnit, Plane, PointTool, Space, Task, ToolName, Uncertainty};
use kilwa_pack::Reader;
use place::{Given, Place, along_rays, places, positions};
use report::Report;
use serde_json::json;
use std::path::PathBuf;

/// Measure on the finest surface.
///
/// Positions are three numbers each, in metres, in the coordinates of the model (world coordinates, z up); what counts is
/// the point of the surface nearest to each.
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
    /// Unit that values are printed in: m, cm, mm, km, ft, ftUS, in.
    #[arg(long, global = true, default_value = "m", value_parser = unit)]
    unit: LengthUnit,
    /// Take positions as they are instead of the nearest points of the surface.
    #[arg(long, global = true)]
    exact: bool,
    /// Points are given as rays, six numbers each: origin and direction; what counts is where they meet the surface first.
    #[arg(long, global = true, conflicts_with = "exact")]
    rays: bool,
    /// Add the measurement to this document (.json), which is made where it is not there.
    #[arg(long, global = true, value_name = "FILE")]
    save: Option<PathBuf>,
    /// What the saved measurement is called.
    #[arg(long, global = true, requires = "save")]
    name: Option<String>,
}

/// Numbers of positions.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
pub(crate) struct Points {
    /// x y z of each, metres.
    #[arg(required = true, num_args = 1.., value_name = "X Y Z", value_delimiter = ',')]
    at: Vec<f64>,
}

/// A plane in space.
#[derive(clap::Args)]
#[group(multiple = false)]
pub(crate) struct PlaneArgs {
    /// A point and a normal: X,Y,Z,NX,NY,NZ in world coordinates.
    #[arg(long, value_name = "X,Y,Z,NX,NY,NZ", allow_hyphen_values = true, value_delimiter = ',')]
    plane: Option<Vec<f64>>,
    /// The upright plane x = METRES, seen from the east.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    x: Option<f64>,
    /// The upright plane y = METRES, seen from the south.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    y: Option<f64>,
    /// The level plane z = METRES, seen from above.
    #[arg(long, value_name = "METRES", allow_hyphen_values = true)]
    z: Option<f64>,
}

#[derive(Subcommand)]
#[command(allow_negative_numbers = true)]
enum Tool {
    /// The point of the surface nearest to a position.
    Coordinate(Points),
    /// From the first point to the last by way of the others: straight, horizontal, vertical.
    #[command(allow_negative_numbers = true)]
    Distance {
        #[command(flatten)]
        points: Points,
        /// Back to the first point.
        #[arg(long)]
        closed: bool,
        /// Along the surface too: in the plane through two points that stands upright on it, as a tape lies.
        #[arg(long, conflicts_with_all = ["closed", "exact"])]
        along: bool,
    },
    /// The angle at the second of three points.
    #[command(allow_negative_numbers = true)]
    Angle {
        #[command(flatten)]
        points: Points,
        /// Between the planes fitted to the first and to the second half of six points or more.
        #[arg(long)]
        planes: bool,
    },
    /// The height of the last point above the plane fitted to the others.
    Height(Points),
    /// Area of the polygon through points: in its plane, in plan, and of the surface inside; without points, of the whole surface.
    #[command(allow_negative_numbers = true)]
    Area {
        /// x y z of each corner, metres.
        #[arg(num_args = 1.., value_name = "X Y Z", value_delimiter = ',')]
        at: Vec<f64>,
        /// How far in front of and behind the polygon's plane the surface counts, metres.
        #[arg(long, value_name = "METRES")]
        reach: Option<f64>,
    },
    /// The volume that a closed surface encloses; with points, cut and fill of the surface inside the polygon against a plane.
    #[command(allow_negative_numbers = true)]
    Volume {
        /// x y z of each corner, metres.
        #[arg(num_args = 1.., value_name = "X Y Z", value_delimiter = ',')]
        at: Vec<f64>,
        #[command(flatten)]
        against: PlaneArgs,
        /// How far in front of and behind the plane the surface counts, metres.
        #[arg(long, value_name = "METRES")]
        reach: Option<f64>,
    },
    /// Radius and diameter of the circle fitted to points.
    Circle(Points),
    /// Where a plane cuts the surface, at full resolution, as drawing or data.
    Section {
        #[command(flatten)]
        plane: PlaneArgs,
        #[command(flatten)]
        output: output::OutputArgs,
    },
    /// What the upright planes along a line cut, straightened.
    #[command(allow_negative_numbers = true)]
    Profile {
        #[command(flatten)]
        points: Points,
        #[command(flatten)]
        output: output::OutputArgs,
    },
    /// Lines of equal height.
    Contours {
        /// Height from line to line, metres.
        #[arg(long, value_name = "METRES")]
        interval: f64,
        #[command(flatten)]
        output: output::OutputArgs,
    },
    /// Measure everything in a document of saved measurements again, and say what differs.
    Again(saved::AgainArgs),
    /// How far the surface inside a polygon (or all of it) is from a plane: the one fitted to the corners, or one given.
    #[command(allow_negative_numbers = true)]
    Deviation {
        /// x y z of each corner, metres.
        #[arg(num_args = 1.., value_name = "X Y Z", value_delimiter = ',')]
        at: Vec<f64>,
        #[command(flatten)]
        from: PlaneArgs,
        /// How far in front of and behind the plane the surface counts, metres.
        #[arg(long, value_name = "METRES")]
        reach: Option<f64>,
    },
}

fn unit(symbol: &str) -> Result<LengthUnit, String> {
    let all: Vec<&str> = LengthUnit::ALL.iter().map(|(_, s)| *s).collect();
    LengthUnit::from_symbol(symbol).ok_or_else(|| format!("one of {} is wanted", all.join(", ")))
}

/// A pack with what every tool needs of it.
pub(super) struct Subject {
    pub(super) pack: Reader<FileSource>,
    pub(super) space: Space,
    /// Of one coordinate of one point.
    pub(super) point: Uncertainty,
    /// What values are printed in.
    pub(super) unit: LengthUnit,
    given: Given,
}

impl Subject {
    fn places(&self, numbers: &[f64]) -> anyhow::Result<Vec<Place>> {
        let positions = positions(numbers)?;
        match self.given {
            Given::Rays => along_rays(&self.pack, &positions),
            given => places(&self.pack, &positions, given == Given::Exact),
        }
    }

    /// The whole model's box, local metres.
    fn bounds(&self) -> (Vec3, Vec3) {
        let m = self.pack.metadata();
        (self.space.local_from_world(m.bounds_min), self.space.local_from_world(m.bounds_max))
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let pack = open_pack(&args.pack)?;
    let space = Space::new(pack.header().lattice);
    let point = Uncertainty::finest(space.step(), pack.metadata().capture_accuracy);
    let given = match (args.exact, args.rays) {
        (true, _) => Given::Exact,
        (_, true) => Given::Rays,
        _ => Given::Near,
    };
    let subject = Subject { pack, space, point, unit: args.unit, given };
    if let Tool::Again(again) = &args.tool {
        anyhow::ensure!(args.save.is_none(), "--save belongs to one measurement, not to a document of them");
        let all_same = saved::again(&subject, again, args.json)?;
        anyhow::ensure!(all_same, "not everything measures the same as when it was saved");
        return Ok(());
    }
    let report = measure(&subject, &args.tool)?;
    if let Some(to) = &args.save {
        saved::save(&subject, &report, to, args.name.as_deref())?;
    }
    report.print(&subject, args.json)
}

fn measure(s: &Subject, tool: &Tool) -> anyhow::Result<Report> {
    match tool {
        Tool::Coordinate(points) => on_points(s, ToolName::Coordinate, PointTool::Coordinate, &points.at),
        Tool::Distance { points, closed: true, .. } => {
            on_points(s, ToolName::Perimeter, PointTool::Perimeter, &points.at)
        }
        Tool::Distance { points, along, .. } => {
            let mut report = on_points(s, ToolName::Distance, PointTool::Distance, &points.at)?;
            if *along {
                report.task_mut().tool = ToolName::Along;
                cutting::along(s, &s.places(&points.at)?, &mut report)?;
            }
            Ok(report)
        }
        Tool::Angle { points, planes: false } => on_points(s, ToolName::Angle, PointTool::Angle, &points.at),
        Tool::Angle { points, planes: true } => on_points(s, ToolName::PlaneAngle, PointTool::PlaneAngle, &points.at),
        Tool::Height(points) => on_points(s, ToolName::Height, PointTool::Height, &points.at),
        Tool::Circle(points) => on_points(s, ToolName::Circle, PointTool::Circle, &points.at),
        Tool::Area { at, reach } if at.is_empty() => {
            anyhow::ensure!(reach.is_none(), "--reach belongs to a polygon; give its corners");
            whole::area(s)
        }
        Tool::Area { at, reach } => whole::polygon_area(s, &s.places(at)?, *reach),
        Tool::Volume { at, against, reach } if at.is_empty() => {
            let alone = reach.is_none() && against.plane(s)?.is_none();
            anyhow::ensure!(alone, "a plane and --reach belong to a polygon; give its corners");
            whole::volume(s)
        }
        Tool::Volume { at, against, reach } => whole::cut_fill(s, &s.places(at)?, against.plane(s)?, *reach),
        Tool::Deviation { at, from, reach } => whole::deviation(s, &s.places(at)?, from.plane(s)?, *reach),
        Tool::Section { plane, output } => {
            let plane = plane.plane(s)?;
            let plane = plane.ok_or_else(|| anyhow::anyhow!("which plane? Give --plane, --x, --y or --z"))?;
            cutting::section(s, plane, output)
        }
        Tool::Profile { points, output } => {
            let line = positions(&points.at)?;
            let local: Vec<Vec3> = line.iter().map(|p| s.space.local_from_world(*p)).collect();
            cutting::profile(s, &local, output)
        }
        Tool::Contours { interval, output } => cutting::contours(s, *interval, output),
        Tool::Again(_) => anyhow::bail!("a document is measured as a whole"),
    }
}

fn on_points(s: &Subject, name: ToolName, tool: PointTool, numbers: &[f64]) -> anyhow::Result<Report> {
    let places = s.places(numbers)?;
    let local: Vec<Vec3> = places.iter().map(|p| p.local).collect();
    let readings = tool.measure(&local, &s.space, &s.point)?;
    let mut report = Report::new(Task::on_points(name, local, &s.space), readings);
    if s.given == Given::Near
        && let [only] = &places[..]
    {
        report.remark(format!("{:.4} m from the given position", only.away));
    }
    report.add("points", json!(places));
    Ok(report)
}

impl PlaneArgs {
    /// The plane asked for, in local metres.
    fn plane(&self, s: &Subject) -> anyhow::Result<Option<Plane>> {
        let world = |at: Vec3, normal: Vec3| Plane::new(s.space.local_from_world(at), normal).map(Some);
        // The other coordinates of a point of the plane do not matter; those of the origin keep numbers small.
        let mut at = s.space.world_from_local([0.0; 3]);
        Ok(match (&self.plane, self.x, self.y, self.z) {
            (Some(p), ..) => {
                let &[x, y, z, nx, ny, nz] = &p[..] else {
                    anyhow::bail!("a plane is six numbers, X,Y,Z,NX,NY,NZ; {} are given", p.len())
                };
                world([x, y, z], [nx, ny, nz])?
            }
            (_, Some(x), ..) => {
                at[0] = x;
                world(at, [1.0, 0.0, 0.0])?
            }
            (_, _, Some(y), _) => {
                at[1] = y;
                world(at, [0.0, -1.0, 0.0])?
            }
            (_, _, _, Some(z)) => {
                at[2] = z;
                world(at, [0.0, 0.0, 1.0])?
            }
            _ => None,
        })
    }
}
