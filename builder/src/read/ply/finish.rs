//! From what was read to the mesh: wedges for the colours of faces, vertices without a position dropped, and the check
//! that something is left.

use super::ReadError;
use super::colors;
use super::faces::{Faces, NOT_FINITE};
use super::plan::Plan;
use super::vertices::Vertices;
use crate::raw::{Findings, RawMesh};
use std::collections::HashMap;
use std::path::Path;

const NO_POSITION: &str = "vertices without a finite position dropped";

/// Put the mesh together.
pub(super) fn finish(
    plan: &Plan,
    vertices: Vertices,
    faces: Faces,
    findings: Findings,
    path: &Path,
) -> Result<RawMesh, ReadError> {
    let mut mesh = vertices.into_mesh(findings);
    let (triangles, colors) = faces.into_triangles();
    mesh.triangles = triangles;
    let mut colors = colors.map(|c| colors::to_bytes(&c.raw, c.kind, &mut mesh.findings));
    drop_without_position(&mut mesh, colors.as_mut());
    if let Some(colors) = colors {
        split_wedges(&mut mesh, &colors, path)?;
    }
    if mesh.triangles.is_empty() {
        let reasons: Vec<String> = mesh.findings.iter().map(|(kind, n, _)| format!("{n} {kind}")).collect();
        return Err(ReadError::NoTriangles {
            file: path.to_owned(),
            found: format!("of its {} faces none is left ({})", plan.faces, reasons.join("; ")),
            way_out: "Export the mesh again and give that",
        });
    }
    Ok(mesh)
}

/// Drop the vertices without a finite position and the triangles at them, with their colours.
fn drop_without_position(mesh: &mut RawMesh, colors: Option<&mut Vec<[u8; 3]>>) {
    let finite = |p: &[f64; 3]| p.iter().all(|v| v.is_finite());
    if mesh.positions.iter().all(finite) {
        return;
    }
    let keep: Vec<bool> = mesh.positions.iter().map(finite).collect();
    for (number, p) in mesh.positions.iter().enumerate().filter(|(number, _)| !keep[*number]) {
        mesh.findings.add(NO_POSITION, || format!("vertex {number} ({} {} {})", p[0], p[1], p[2]));
    }
    let stays = |t: &[u32; 3]| t.iter().all(|&i| keep[i as usize]);
    if let Some(colors) = colors {
        let mut triangles = mesh.triangles.iter();
        colors.retain(|_| triangles.next().is_some_and(stays));
    }
    let findings = &mut mesh.findings;
    mesh.triangles.retain(|t| {
        if !stays(t) {
            findings.add(NOT_FINITE, || format!("triangle of the vertices {}, {} and {}", t[0], t[1], t[2]));
        }
        stays(t)
    });
    retain_vertices(mesh, &keep);
}

/// Drop the vertices that are not to be kept; no triangle may name one.
fn retain_vertices(mesh: &mut RawMesh, keep: &[bool]) {
    fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
        let mut kept = keep.iter();
        values.retain(|_| kept.next().copied().unwrap_or_default());
    }
    retain(&mut mesh.positions, keep);
    retain(&mut mesh.colors, keep);
    retain(&mut mesh.normals, keep);
    for (_, values) in &mut mesh.scalars {
        retain(values, keep);
    }
    let mut next = 0;
    let new_index: Vec<u32> = keep
        .iter()
        .map(|&k| {
            let index = next;
            next += u32::from(k);
            index
        })
        .collect();
    mesh.triangles.iter_mut().flatten().for_each(|i| *i = new_index[*i as usize]);
}

/// Give each triangle's colour to its corners; a vertex where triangles of several colours meet becomes several.
fn split_wedges(mesh: &mut RawMesh, colors: &[[u8; 3]], path: &Path) -> Result<(), ReadError> {
    let mut first: Vec<Option<[u8; 3]>> = vec![None; mesh.positions.len()];
    let mut wedges: HashMap<(u32, [u8; 3]), u32> = HashMap::new();
    let mut origins = Vec::new();
    let vertices = mesh.positions.len();
    for (triangle, &color) in mesh.triangles.iter_mut().zip(colors) {
        for corner in triangle {
            if *first[*corner as usize].get_or_insert(color) == color {
                continue;
            }
            let next = u32::try_from(vertices + origins.len()).map_err(|_| ReadError::TooLarge {
                file: path.to_owned(),
                what: "colours per face split it into more than 4294967295 vertices: split it into blocks".to_owned(),
            })?;
            let wedge = *wedges.entry((*corner, color)).or_insert(next);
            if wedge == next {
                origins.push((*corner as usize, color));
            }
            *corner = wedge;
        }
    }
    mesh.findings.add_many("triangles whose colour was given to their vertices", colors.len() as u64);
    mesh.findings.add_many("vertices split so that faces keep their colours", origins.len() as u64);
    mesh.colors = first.into_iter().map(Option::unwrap_or_default).collect();
    mesh.colors.extend(origins.iter().map(|(_, color)| *color));
    append_copies(&mut mesh.positions, &origins);
    append_copies(&mut mesh.normals, &origins);
    for (_, values) in &mut mesh.scalars {
        append_copies(values, &origins);
    }
    Ok(())
}

/// Append a copy of the value of each wedge's vertex; nothing where the attribute is absent.
fn append_copies<T: Copy>(values: &mut Vec<T>, origins: &[(usize, [u8; 3])]) {
    if !values.is_empty() {
        values.reserve_exact(origins.len());
        for &(origin, _) in origins {
            let value = values[origin];
            values.push(value);
        }
    }
}
