//! `kilwa measure`: values from the finest surface, each with its standard uncertainty.
//!
//! One file per part: `place` (the points that are meant), `sweep` (the finest surface of a file), `output` and `saved` (files), `report` (what is
//! printed). What is measured and how is `kilwa_measure`'s, the same for the page: here arguments become a [`Task`].

mod output;
mod place;
mod report;
mod saved;
mod sweep;

use crate::new_file::refuse_inputs;
use crate::source::open_pack;
use clap::Subcommand;
use glam::DVec3;
use kilwa_geometry::LengthUnit;
use kilwa_measure::unit::shown;
use kilwa_measure::{Leaves, Outcome, Place, Plane, Reading, Space, Task, ToolName, Uncertainty};
use kilwa_pack::plural::counted;
use place::{Given, places, positions};
use serde_json::json;
use std::io::Write as _;
use std::path::PathBuf;
use sweep::FileLeaves;

/// Measure on the finest surface.
///
/// Positions are three numbers each, in metres, in the coordinates of the model (world coordinates, z up); each is
/// replaced by the nearest point of the surface.
#[derive(clap::Args)]
#[command(allow_negative_numbers = true)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    #[command(subcommand)]
    tool: Tool,
    /// Print as JSON.
    #[arg(long, global = true)]
    json: bool,
    /// Unit that values are printed in: m, dm, cm, mm, km, ft, us-ft, in.
    #[arg(long, global = true, default_value = "m", value_parser = unit)]
    unit: LengthUnit,
    /// Use positions as given instead of the nearest points of the surface.
    #[arg(long, global = true)]
    exact: bool,
    /// How far a position may be from the surface, metres; farther ones are refused (default: 1 % of the model's diagonal, at
    /// least twice the median edge length).
    #[arg(long, global = true, value_name = "METRES", value_parser = tolerance, conflicts_with_all = ["exact", "rays"])]
    tolerance: Option<f64>,
    /// Points are given as rays, six numbers each: origin and direction; each is replaced by its first hit on the surface.
    #[arg(long, global = true, conflicts_with = "exact")]
    rays: bool,
    /// Standard pointing uncertainty of the positions in metres, on each axis: one value for all, or one for each (default: 0).
    #[arg(long, global = true, value_name = "METRES", value_parser = tolerance, value_delimiter = ',')]
    pointing: Vec<f64>,
    /// Add the measurement to this document (.json), which is created if missing.
    #[arg(long, global = true, value_name = "FILE")]
    save: Option<PathBuf>,
    /// Name of the measurement in the document and the citation.
    #[arg(long, global = true)]
    name: Option<String>,
    /// Print a citation.
    #[arg(long, global = true, conflicts_with = "json")]
    cite: bool,
    /// When it was measured, for the document and the citation.
    #[arg(long, global = true, value_name = "YYYY-MM-DD")]
    date: Option<String>,
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
    /// Distance from the first point to the last through the others: straight, horizontal, vertical.
    #[command(allow_negative_numbers = true)]
    Distance {
        #[command(flatten)]
        points: Points,
        /// Close the path, back to the first point.
        #[arg(long)]
        closed: bool,
        /// Also along the surface, like a tape: in the plane through two points that is perpendicular to it.
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
    /// The profile along a line: its vertical planes cut the surface, unrolled into one plane.
    #[command(allow_negative_numbers = true)]
    Profile {
        #[command(flatten)]
        points: Points,
        #[command(flatten)]
        output: output::OutputArgs,
    },
    /// Lines of equal height.
    Contours {
        /// Height between contour lines, metres.
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

impl Tool {
    /// The output options of a tool that makes a drawing.
    fn output(&self) -> Option<&output::OutputArgs> {
        match self {
            Self::Section { output, .. } | Self::Profile { output, .. } | Self::Contours { output, .. } => Some(output),
            _ => None,
        }
    }
}

fn unit(symbol: &str) -> Result<LengthUnit, String> {
    LengthUnit::parse(symbol).ok_or_else(|| format!("expected one of {}", LengthUnit::symbols()))
}

/// A length that nothing may be longer than.
fn tolerance(text: &str) -> Result<f64, String> {
    let metres = text.parse().ok().filter(|metres: &f64| *metres >= 0.0 && metres.is_finite());
    metres.ok_or_else(|| "expected a length in metres, 0 or more".to_owned())
}

/// A pack with what every tool needs of it.
struct Subject {
    leaves: FileLeaves,
    space: Space,
    /// Of one coordinate of one point.
    point: Uncertainty,
    /// The units that values are printed in.
    unit: LengthUnit,
    given: Given,
    /// Of pointing, metres: one for all places, or one for each.
    pointing: Vec<f64>,
}

impl Subject {
    fn places(&self, numbers: &[f64]) -> anyhow::Result<Vec<Place>> {
        pollster::block_on(places(&self.leaves, numbers, self.given))
    }

    /// Measure.
    fn measure(&self, task: &Task) -> anyhow::Result<Outcome> {
        Ok(pollster::block_on(kilwa_measure::measure(&self.leaves, task))?)
    }
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let leaves = FileLeaves { pack: open_pack(&args.pack)? };
    let kilwa_measure::job::Subject { space, point, .. } = kilwa_measure::job::Subject::new(&leaves);
    let given = match (args.exact, args.rays) {
        (true, _) => Given::Exact,
        (_, true) => Given::Rays,
        _ => Given::Near {
            tolerance: args.tolerance.unwrap_or_else(|| place::default_tolerance(leaves.index().metadata())),
        },
    };
    let subject = Subject { leaves, space, point, unit: args.unit, given, pointing: args.pointing.clone() };
    if let Tool::Again(again) = &args.tool {
        anyhow::ensure!(args.save.is_none(), "--save cannot be used with `again`, only with a single measurement");
        let all_same = saved::again(&subject, again, args)?;
        anyhow::ensure!(all_same, "some values differ from the saved ones");
        return Ok(());
    }
    if let Some(to) = &args.save {
        refuse_inputs(to, [args.pack.as_path()])?;
    }
    if let Some(output) = args.tool.output() {
        output.check(&args.pack)?;
        if let Some(to) = &args.save {
            output.refuse_document(to)?;
        }
    }
    let outcome = measure(&subject, &args.tool)?;
    let fits = |r: &Reading| {
        let shown = shown(r.quantity, r.dimension, args.unit).0;
        shown.value.is_finite() && shown.uncertainty.is_finite()
    };
    anyhow::ensure!(
        outcome.readings.iter().all(fits),
        "the result in {} is too large for a number; choose a larger --unit",
        args.unit.symbol()
    );
    if let Some(to) = &args.save {
        saved::save(&subject, &outcome, to, args)?;
    }
    let cited = args.cite.then(|| saved::measurement(&outcome, args, outcome.task.tool.name().to_owned()));
    report::print(outcome, &subject, args.json)?;
    if let Some(cited) = cited {
        writeln!(crate::terminal::out(), "{}", saved::citation(&subject, &cited))?;
    }
    Ok(())
}

fn measure(s: &Subject, tool: &Tool) -> anyhow::Result<Outcome> {
    let bare = |name| Task::on_points(name, Vec::new(), &s.space);
    match tool {
        Tool::Coordinate(points) => on_places(s, &bare(ToolName::Coordinate), &points.at),
        Tool::Distance { points, closed: true, .. } => on_places(s, &bare(ToolName::Perimeter), &points.at),
        Tool::Distance { points, along: true, .. } => on_places(s, &bare(ToolName::Along), &points.at),
        Tool::Distance { points, .. } => on_places(s, &bare(ToolName::Distance), &points.at),
        Tool::Angle { points, planes: false } => on_places(s, &bare(ToolName::Angle), &points.at),
        Tool::Angle { points, planes: true } => on_places(s, &bare(ToolName::PlaneAngle), &points.at),
        Tool::Height(points) => on_places(s, &bare(ToolName::Height), &points.at),
        Tool::Circle(points) => on_places(s, &bare(ToolName::Circle), &points.at),
        Tool::Area { at, reach } => {
            anyhow::ensure!(!at.is_empty() || reach.is_none(), "--reach needs a polygon; give its corners");
            on_places(s, &Task { reach: *reach, ..bare(ToolName::Area) }, at)
        }
        Tool::Volume { at, against, reach } if at.is_empty() => {
            let alone = reach.is_none() && against.plane(s)?.is_none();
            anyhow::ensure!(alone, "a plane and --reach need a polygon; give its corners");
            s.measure(&bare(ToolName::Volume))
        }
        Tool::Volume { at, against, reach } => {
            on_places(s, &Task { plane: against.plane(s)?, reach: *reach, ..bare(ToolName::CutFill) }, at)
        }
        Tool::Deviation { at, from, reach } => {
            let plane = from.plane(s)?;
            if at.is_empty() {
                let hint = "from which plane? Give --plane, --x, --y or --z, or a polygon";
                anyhow::ensure!(plane.is_some(), hint);
                anyhow::ensure!(reach.is_none(), "--reach needs a polygon; give its corners");
            }
            on_places(s, &Task { plane, reach: *reach, ..bare(ToolName::Deviation) }, at)
        }
        Tool::Section { plane, output } => {
            let plane = plane.plane(s)?;
            anyhow::ensure!(plane.is_some(), "which plane? Give --plane, --x, --y or --z");
            to_file(s, &Task { plane, ..bare(ToolName::Section) }, output)
        }
        Tool::Profile { points, output } => {
            let line = positions(&points.at)?.into_iter().map(|p| s.space.local_from_world(p)).collect();
            to_file(s, &Task::on_points(ToolName::Profile, line, &s.space), output)
        }
        Tool::Contours { interval, output } => {
            to_file(s, &Task { interval: Some(*interval), ..bare(ToolName::Contours) }, output)
        }
        Tool::Again(_) => anyhow::bail!("a document is measured as a whole"),
    }
}

/// A task on the places that numbers mean.
fn on_places(s: &Subject, task: &Task, numbers: &[f64]) -> anyhow::Result<Outcome> {
    let places = s.places(numbers)?;
    let points = Task::on_points(task.tool, places.iter().map(|p| p.local).collect(), &s.space);
    let pointing = match s.pointing[..] {
        [all] => vec![all; places.len()],
        _ => s.pointing.clone(),
    };
    anyhow::ensure!(
        pointing.is_empty() || pointing.len() == places.len(),
        "--pointing gives {}, but {}; give one for all, or one for each",
        counted(pointing.len(), "number", "numbers"),
        counted(places.len(), "position is given", "positions are given")
    );
    let mut outcome = s.measure(&Task { local: points.local, world: points.world, pointing, ..task.clone() })?;
    if places.is_empty() {
        return Ok(outcome);
    }
    if let [only] = &places[..] {
        outcome.add("away", json!(only.away));
    }
    if let Given::Near { tolerance } = s.given {
        outcome.add("tolerance", json!(tolerance));
    }
    outcome.add("points", json!(places));
    Ok(outcome)
}

/// A task whose lines may go to a file.
fn to_file(s: &Subject, task: &Task, output: &output::OutputArgs) -> anyhow::Result<Outcome> {
    let mut outcome = s.measure(task)?;
    output.write(s, &mut outcome)?;
    Ok(outcome)
}

impl PlaneArgs {
    /// The plane asked for, in local metres.
    fn plane(&self, s: &Subject) -> anyhow::Result<Option<Plane>> {
        let world = |at: DVec3, normal: DVec3| Plane::new(s.space.local_from_world(at), normal).map(Some);
        // The other coordinates of a point of the plane do not matter; those of the origin keep numbers small.
        let mut at = s.space.world_from_local(DVec3::ZERO);
        Ok(match (&self.plane, self.x, self.y, self.z) {
            (Some(p), ..) => {
                let &[x, y, z, nx, ny, nz] = &p[..] else {
                    anyhow::bail!("a plane is six numbers, X,Y,Z,NX,NY,NZ; {} are given", p.len())
                };
                world(DVec3::new(x, y, z), DVec3::new(nx, ny, nz))?
            }
            (_, Some(x), ..) => {
                at.x = x;
                world(at, DVec3::X)?
            }
            (_, _, Some(y), _) => {
                at.y = y;
                world(at, DVec3::NEG_Y)?
            }
            (_, _, _, Some(z)) => {
                at.z = z;
                world(at, DVec3::Z)?
            }
            _ => None,
        })
    }
}
