//! Takes blocks of vertex columns and keeps them as the attributes of the mesh.
//!
//! Invariant: after each block all kept attributes have one value per vertex. Positions may be not finite here;
//! `finish` drops those vertices.

use super::ReadError;
use super::colors;
use super::elements::Columns;
use super::plan::{Plan, Role};
use super::scalar::Scalar;
use crate::raw::{Findings, RawMesh};
use std::path::Path;

pub(super) struct Vertices {
    /// Columns of x, y and z.
    xyz: [usize; 3],
    /// Columns of red, green and blue, and their type.
    rgb: Option<([usize; 3], Scalar)>,
    alpha: Option<(usize, Scalar)>,
    normal: Option<[usize; 3]>,
    /// Columns, names and types of the further channels.
    channels: Vec<(usize, String, Scalar)>,

    positions: Vec<[f64; 3]>,
    /// Colours of 8 bits, which need no second look.
    bytes: Vec<[u8; 3]>,
    /// Colours of other types, until the largest value is known.
    wide: Vec<[f32; 3]>,
    alphas: Vec<f32>,
    normals: Vec<[f32; 3]>,
    scalars: Vec<Vec<f32>>,
}

impl Vertices {
    /// Room for all vertices that the plan declares, which the file has been found long enough for.
    pub(super) fn new(plan: &Plan, path: &Path) -> Result<Self, ReadError> {
        let too_large = |what: String| ReadError::TooLarge { file: path.to_owned(), what };
        let n = usize::try_from(plan.vertices).ok().filter(|&n| n < u32::MAX as usize).ok_or_else(|| {
            too_large(format!(
                "{} vertices; a file may have up to {} of them: split it into blocks",
                plan.vertices,
                u32::MAX - 1
            ))
        })?;
        let no_memory = |_| too_large(format!("no memory for {n} vertices: split the file into blocks"));
        let find = |role| plan.columns.iter().position(|c| c.role == role);
        let three =
            |role: fn(usize) -> Role| -> Option<[usize; 3]> { Some([find(role(0))?, find(role(1))?, find(role(2))?]) };
        let channels: Vec<_> = plan
            .channels
            .iter()
            .enumerate()
            .filter_map(|(i, name)| find(Role::Channel(i)).map(|at| (at, name.clone(), plan.columns[at].kind)))
            .collect();
        let mut vertices = Self {
            xyz: three(Role::Position).unwrap_or_default(),
            rgb: three(Role::Color).zip(plan.vertex_colors()),
            alpha: find(Role::Alpha).map(|at| (at, plan.columns[at].kind)),
            normal: three(Role::Normal),
            positions: Vec::new(),
            bytes: Vec::new(),
            wide: Vec::new(),
            alphas: Vec::new(),
            normals: Vec::new(),
            scalars: vec![Vec::new(); channels.len()],
            channels,
        };
        vertices.positions.try_reserve_exact(n).map_err(no_memory)?;
        match vertices.rgb {
            Some((_, Scalar::U8)) => vertices.bytes.try_reserve_exact(n).map_err(no_memory)?,
            Some(_) => vertices.wide.try_reserve_exact(n).map_err(no_memory)?,
            None => {}
        }
        if vertices.alpha.is_some() {
            vertices.alphas.try_reserve_exact(n).map_err(no_memory)?;
        }
        if vertices.normal.is_some() {
            vertices.normals.try_reserve_exact(n).map_err(no_memory)?;
        }
        for scalars in &mut vertices.scalars {
            scalars.try_reserve_exact(n).map_err(no_memory)?;
        }
        Ok(vertices)
    }

    /// The positions read so far.
    pub(super) fn positions(&self) -> &[[f64; 3]] {
        &self.positions
    }

    /// Keep a block of rows.
    pub(super) fn absorb(&mut self, columns: &Columns, findings: &mut Findings) {
        self.positions.extend(rows(columns, self.xyz));
        match self.rgb {
            Some((at, Scalar::U8)) => {
                self.bytes.extend(rows(columns, at).map(|color| color.map(|v| byte(v, findings))));
            }
            // Some writers say char and mean uchar.
            Some((at, Scalar::I8)) => {
                self.wide.extend(rows(columns, at).map(|c| c.map(|v| if v < 0.0 { v + 256.0 } else { v } as f32)));
            }
            Some((at, _)) => self.wide.extend(rows(columns, at).map(|c| c.map(|v| v as f32))),
            None => {}
        }
        if let Some((at, _)) = self.alpha {
            self.alphas.extend(columns[at].iter().map(|&v| v as f32));
        }
        if let Some(at) = self.normal {
            self.normals.extend(rows(columns, at).map(|n| {
                if n.iter().all(|v| v.is_finite()) {
                    n.map(|v| v as f32)
                } else {
                    findings.add_many("normals that are not finite set to zero", 1);
                    [0.0; 3]
                }
            }));
        }
        for (scalars, (at, ..)) in self.scalars.iter_mut().zip(&self.channels) {
            scalars.extend(columns[*at].iter().map(|&v| v as f32));
        }
    }

    /// The attributes as a mesh without triangles.
    pub(super) fn into_mesh(self, mut findings: Findings) -> RawMesh {
        let colors = match self.rgb {
            Some((_, Scalar::U8)) => self.bytes,
            Some((_, kind)) => colors::to_bytes(&self.wide, kind, &mut findings),
            None => Vec::new(),
        };
        let mut scalars = Vec::new();
        for ((_, name, kind), values) in self.channels.into_iter().zip(self.scalars) {
            if matches!(kind, Scalar::F64 | Scalar::I32 | Scalar::U32) {
                findings.add("channels narrowed to 32-bit floats", || name.clone());
            }
            scalars.push((name, values));
        }
        if let Some((_, kind)) = self.alpha {
            let full = colors::full_scale(kind, colors::largest(self.alphas.iter()));
            if self.alphas.iter().any(|&a| a != full) {
                scalars.push(("alpha".to_owned(), self.alphas.iter().map(|a| a / full).collect()));
            }
        }
        RawMesh { positions: self.positions, colors, normals: self.normals, scalars, triangles: Vec::new(), findings }
    }
}

/// Three columns as rows.
fn rows(columns: &Columns, [a, b, c]: [usize; 3]) -> impl Iterator<Item = [f64; 3]> {
    columns[a].iter().zip(&columns[b]).zip(&columns[c]).map(|((&a, &b), &c)| [a, b, c])
}

/// A colour component of 8 bits; only text can hold another value.
#[inline]
fn byte(value: f64, findings: &mut Findings) -> u8 {
    let byte = value as u8;
    if f64::from(byte) == value {
        return byte;
    }
    if (0.0..=255.0).contains(&value) {
        findings.add_many("colours rounded to 8 bits", 1);
        value.round() as u8
    } else {
        findings.add_many("colours outside their range clamped", 1);
        byte
    }
}
