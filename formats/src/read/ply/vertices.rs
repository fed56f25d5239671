//! Takes blocks of vertex columns and hands them on as attributes.
//!
//! What must be known of the whole file before the first vertex goes out (the range of colours of a wide type, whether
//! `alpha` is opaque throughout) a [`Scan`] finds out in a first pass, which only such files need.

use super::ReadError;
use super::colors::{Scale, full_scale, needs_scan};
use super::elements::Columns;
use super::plan::{Column, Field, Keep, Plan, Role};
use super::scalar::Scalar;
use crate::Diagnostics;
use crate::read::sink::{VertexBlock, VertexSink};
use glam::{DVec3, Vec3};

/// What a first pass over colours and alpha found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scan {
    /// The largest finite colour component, at least 0.
    largest_color: f32,
    /// The largest finite alpha, at least 0.
    largest_alpha: f32,
    /// The smallest alpha; NaN counts as the smallest.
    smallest_alpha: f32,
}

impl Default for Scan {
    fn default() -> Self {
        Self { largest_color: 0.0, largest_alpha: 0.0, smallest_alpha: f32::INFINITY }
    }
}

impl Scan {
    /// Whether the vertices of this plan need one.
    pub(super) fn is_needed(plan: &Plan) -> bool {
        plan.vertex_colors().is_some_and(needs_scan) || plan.columns.iter().any(|c| c.role == Role::Alpha)
    }

    /// The fields with only the columns kept that a scan looks at.
    pub(super) fn fields(fields: &[Field], columns: &[Column]) -> Vec<Field> {
        let mut fields = fields.to_vec();
        for field in &mut fields {
            let looked_at = |at: usize| match columns[at].role {
                Role::Alpha => true,
                Role::Color(_) => needs_scan(columns[at].kind),
                _ => false,
            };
            if !matches!(field.keep, Keep::Column(at) if looked_at(at)) {
                field.keep = Keep::Nothing;
            }
        }
        fields
    }

    /// Look at a block.
    pub(super) fn absorb(&mut self, values: &Columns, columns: &[Column]) {
        for (values, column) in values.iter().zip(columns) {
            let values = values.iter().map(|&v| v as f32);
            match column.role {
                Role::Color(_) => self.largest_color = largest(self.largest_color, values),
                Role::Alpha => {
                    for v in values {
                        if v.is_finite() {
                            self.largest_alpha = self.largest_alpha.max(v);
                        }
                        if v < self.smallest_alpha || v.is_nan() {
                            self.smallest_alpha = v;
                        }
                    }
                }
                _ => {}
            }
        }
    }

    /// Whether nothing that follows can change what matters: of colours and alpha of a byte each, that alpha varies.
    pub(super) fn is_settled(&self, columns: &[Column]) -> bool {
        let bytes = columns.iter().all(|c| !matches!(c.role, Role::Alpha | Role::Color(_)) || c.kind == Scalar::U8);
        bytes && self.smallest_alpha < 255.0
    }
}

/// The larger of `before` and the largest finite value.
pub(super) fn largest(before: f32, values: impl Iterator<Item = f32>) -> f32 {
    values.filter(|v| v.is_finite()).fold(before, f32::max)
}

/// How vertices are put together.
pub(super) struct Vertices {
    /// Columns of x, y and z.
    xyz: [usize; 3],
    /// Columns of red, green and blue, and their scale.
    rgb: Option<([usize; 3], Scale)>,
    normal: Option<[usize; 3]>,
    /// Columns of the channels, and what their values are divided by.
    channels: Vec<(usize, f32)>,

    positions: Vec<DVec3>,
    colors: Vec<[u8; 3]>,
    normals: Vec<Vec3>,
    scalars: Vec<Vec<f32>>,
}

impl Vertices {
    /// Declares the channels to the sink.
    pub(super) fn new(
        plan: &Plan,
        scan: Scan,
        sink: &mut dyn VertexSink,
        diagnostics: &mut Diagnostics,
    ) -> Result<Self, ReadError> {
        let find = |role| plan.columns.iter().position(|c| c.role == role);
        let three =
            |role: fn(usize) -> Role| -> Option<[usize; 3]> { Some([find(role(0))?, find(role(1))?, find(role(2))?]) };
        let mut names = Vec::new();
        let mut channels = Vec::new();
        for (i, name) in plan.channels.iter().enumerate() {
            if let Some(at) = find(Role::Channel(i)) {
                if matches!(plan.columns[at].kind, Scalar::F64 | Scalar::I32 | Scalar::U32) {
                    diagnostics.add("channels narrowed to 32-bit floats", || name.clone());
                }
                names.push(name.clone());
                channels.push((at, 1.0));
            }
        }
        if let Some(at) = find(Role::Alpha) {
            let full = full_scale(plan.columns[at].kind, scan.largest_alpha);
            // Of no vertices, or opaque throughout: no channel.
            if scan.smallest_alpha != f32::INFINITY && (scan.smallest_alpha != full || scan.largest_alpha != full) {
                names.push("alpha".to_owned());
                channels.push((at, full));
            }
        }
        if !names.is_empty() {
            sink.channels(&names)?;
        }
        let scale = plan.vertex_colors().map(|kind| Scale::new(kind, scan.largest_color, diagnostics));
        Ok(Self {
            xyz: three(Role::Position).unwrap_or_default(),
            rgb: three(Role::Color).zip(scale),
            normal: three(Role::Normal),
            positions: Vec::new(),
            colors: Vec::new(),
            normals: Vec::new(),
            scalars: vec![Vec::new(); channels.len()],
            channels,
        })
    }

    /// Hand on a block of rows.
    pub(super) fn absorb(
        &mut self,
        columns: &Columns,
        sink: &mut dyn VertexSink,
        diagnostics: &mut Diagnostics,
    ) -> Result<(), ReadError> {
        self.positions.clear();
        self.positions.extend(rows(columns, self.xyz));
        self.colors.clear();
        if let Some((at, scale)) = self.rgb {
            self.colors.extend(rows(columns, at).map(|color| scale.color(color, diagnostics)));
        }
        self.normals.clear();
        if let Some(at) = self.normal {
            self.normals.extend(rows(columns, at).map(|n| {
                if n.is_finite() {
                    n.as_vec3()
                } else {
                    diagnostics.add_many("normals that are not finite set to zero", 1);
                    Vec3::ZERO
                }
            }));
        }
        for (scalars, (at, full)) in self.scalars.iter_mut().zip(&self.channels) {
            scalars.clear();
            scalars.extend(columns[*at].iter().map(|&v| v as f32 / full));
        }
        let Self { positions, colors, normals, scalars, .. } = self;
        sink.vertices(&VertexBlock { positions, colors, normals, scalars })
    }
}

/// Three columns as rows.
fn rows(columns: &Columns, [a, b, c]: [usize; 3]) -> impl Iterator<Item = DVec3> {
    columns[a].iter().zip(&columns[b]).zip(&columns[c]).map(|((&a, &b), &c)| DVec3::new(a, b, c))
}
