//! Measuring on decoded lattice geometry, in `f64`, on the CPU: what a researcher cites.
//!
//! Every value comes from the finest surface, so it does not depend on zoom, cache, network or GPU, and carries its
//! standard uncertainty: the lattice spacing, and the capture accuracy where the metadata knows it. Pure: geometry in,
//! numbers out; who has the chunks hands their triangles over. Trigonometry is `libm`'s, so that native programs and
//! wasm agree to the last digit. Where there is no meaningful number there is a [`Refusal`], a sentence that says why.
//!
//! Two kinds of tools: on points ([`PointTool`]), and on the surface, which is summed up or cut triangle by triangle
//! ([`Areas`], [`Enclosed`], [`CutFill`], [`Deviation`], [`Cutter`]); sums of parts are joined in a fixed order, so that
//! the number of threads does not matter. Lengths are local metres: see [`Space`].

pub mod angle;
pub mod area;
pub mod circle;
pub mod clip;
pub mod deviation;
pub mod drawing;
mod dxf;
pub mod interval;
pub mod job;
pub mod leaves;
pub mod lines;
pub mod message;
pub mod path;
pub mod pick;
pub mod place;
pub mod plane;
pub mod points;
pub mod polygon;
pub mod profile;
pub mod quantity;
pub mod refusal;
pub mod region;
pub mod remark;
pub mod roughness;
pub mod saved;
pub mod section;
pub mod sheet;
pub mod snap;
pub mod space;
pub mod sum;
pub mod surface;
mod svg;
pub mod tools;
pub mod unit;
pub mod volume;

pub use area::{Areas, PolygonArea};
pub use circle::Circle;
pub use clip::{Clip, ClipState};
pub use deviation::Deviation;
pub use drawing::{Drawing, DrawnLine};
pub use job::{Outcome, measure};
pub use leaves::{Failure, Leaves, Read};
pub use lines::{Format, Line, Lines};
pub use message::{Message, ToMessage};
pub use pick::{Hit, Picked, Picker, Ray};
pub use place::Place;
pub use plane::{Plane, PlaneFit};
pub use quantity::{Length, Quantity, Uncertainty};
pub use refusal::{Refusal, Target};
pub use region::Region;
pub use remark::Remark;
pub use saved::{Document, Measurement, PackName, Task, ToolName};
pub use section::{Cutter, Polyline, Section};
pub use space::Space;
pub use sum::Sum;
pub use surface::Surface;
pub use tools::PointTool;
pub use unit::{Dimension, Reading};
pub use volume::{CutFill, CutFillVolume, Enclosed};
