//! Residuals on the surface: distances between what a station saw and what the others saw in the same place.

use super::result::{Placed, Registration};
use super::view;
use crate::ScanError;
use crate::import::Progress;
use crate::survey::{Station, Survey};
use glam::DVec3;
use kilwa_scan_core::Pose;
use kilwa_scan_core::register::adjust;
use rayon::prelude::*;
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Surfaces farther apart than this are not the same, in voxel edges.
const REACH: f64 = 1.0;
/// The share of the residuals within the colour scale; larger ones have the strongest colour.
const SCALE_SHARE: f64 = 0.95;
/// Minimum residual at the ends of the colour scale, metres.
const MIN_SCALE: f64 = 0.0005;
/// Where only one station saw the surface.
const SINGLE_COLOR: [u8; 3] = [110, 110, 110];

/// A sample of the surface that a station saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// In survey coordinates, metres.
    pub position: DVec3,
    /// The mean signed distance from the surfaces of the other stations, metres: positive if it is nearer to their scanners. `None` where no other station saw the surface.
    pub distance: Option<f64>,
}

/// Samples of all registered stations, spread evenly (one per station and voxel), with their residuals.
///
/// # Errors
/// [`ScanError::Spool`], [`ScanError::Mask`], [`ScanError::Read`] for damaged files; [`ScanError::Request`] if threads cannot be started; [`ScanError::Stopped`].
pub fn residuals(
    folder: &Path,
    survey: &Survey,
    found: &Registration,
    threads: usize,
    progress: &(dyn Progress + Sync),
) -> Result<Vec<Residual>, ScanError> {
    let pose = |s: &Station| found.entry(s).map(Placed::pose);
    let placed: Vec<(&Station, Pose)> = survey.stations.iter().filter_map(|s| Some((s, pose(s)?))).collect();
    let (stations, poses): (Vec<&Station>, Vec<Pose>) = placed.into_iter().unzip();
    super::in_threads(threads, || {
        let (views, edge) = view::load_all(folder, &stations, progress)?;
        let done = AtomicU64::new(0);
        let of_station = |k: usize| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let others: Vec<(usize, Pose)> =
                (0..views.len()).filter(|j| *j != k).map(|j| (j, poses[k].then(poses[j].inverse()))).collect();
            let residual = |sample: &kilwa_scan_core::register::image::Point| {
                let distances = others.iter().filter_map(|(j, other_from_own)| {
                    adjust::distance(&views[*j].shape, sample, *other_from_own, REACH * edge)
                });
                let (sum, weight) = distances.fold((0.0, 0.0), |(sum, all), (d, w)| (sum + w * d, all + w));
                Residual { position: poses[k].apply(sample.position), distance: (weight > 0.0).then(|| sum / weight) }
            };
            let out: Vec<Residual> = views[k].points.iter().map(residual).collect();
            progress.update("comparing surfaces", done.fetch_add(1, Ordering::Relaxed) + 1, views.len() as u64);
            Ok(out)
        };
        let all: Vec<Vec<Residual>> = (0..views.len()).into_par_iter().map(of_station).collect::<Result<_, _>>()?;
        Ok(all.into_iter().flatten().collect())
    })
}

/// Write residuals as a coloured point cloud (PLY, binary): blue where the sample is behind the surface of the others, red in front of it, grey where no other station saw it; the property
/// `residual` contains the distance in metres, NaN where there is none. Returns the distance shown in the strongest colours, metres.
///
/// # Errors
/// Those of the writer.
pub fn write_residuals(out: &mut dyn Write, residuals: &[Residual]) -> io::Result<f64> {
    let mut sizes: Vec<f64> = residuals.iter().filter_map(|r| r.distance).map(f64::abs).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let max =
        sizes.get((SCALE_SHARE * sizes.len() as f64) as usize).or(sizes.last()).copied().unwrap_or(0.0).max(MIN_SCALE);
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    let millimetres = 1e3 * max;
    writeln!(out, "comment residuals of a registration: blue -{millimetres:.2} mm, red +{millimetres:.2} mm")?;
    writeln!(out, "element vertex {}", residuals.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property double {axis}")?;
    }
    for color in ["red", "green", "blue"] {
        writeln!(out, "property uchar {color}")?;
    }
    writeln!(out, "property float residual\nend_header")?;
    for residual in residuals {
        for value in residual.position.to_array() {
            out.write_all(&value.to_le_bytes())?;
        }
        out.write_all(&residual.distance.map_or(SINGLE_COLOR, |distance| color(distance / max)))?;
        out.write_all(&residual.distance.map_or(f32::NAN, |distance| distance as f32).to_le_bytes())?;
    }
    Ok(max)
}

/// From blue (-1) over near white (0) to red (1).
fn color(value: f64) -> [u8; 3] {
    let (end, part) = if value < 0.0 { ([33, 80, 200], -value) } else { ([200, 40, 40], value) };
    let part = part.min(1.0);
    end.map(|end: u8| (part * f64::from(end) + (1.0 - part) * 240.0).round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_has_every_sample_with_its_colour_and_distance() {
        let at = |distance| Residual { position: DVec3::new(5e5, 4e6, 12.25), distance };
        let all = [at(Some(-0.002)), at(None), at(Some(0.0)), at(Some(0.002))];
        let mut bytes = Vec::new();
        let most = write_residuals(&mut bytes, &all).unwrap();
        assert!((most - 0.002).abs() < 1e-12);
        let text = String::from_utf8_lossy(&bytes);
        assert!(text.contains("element vertex 4") && text.contains("red +2.00 mm"), "{text}");
        let end = b"end_header\n";
        let start = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let rows: Vec<&[u8]> = bytes[start..].chunks(31).collect();
        assert_eq!(rows.len(), 4);
        assert_eq!(rows[0][..8], 5e5_f64.to_le_bytes());
        let colours: Vec<&[u8]> = rows.iter().map(|row| &row[24..27]).collect();
        assert_eq!(colours, [&[33, 80, 200][..], &SINGLE_COLOR, &[240; 3], &[200, 40, 40]]);
        let distances: Vec<f32> = rows.iter().map(|row| f32::from_le_bytes(row[27..].try_into().unwrap())).collect();
        assert!(distances[1].is_nan() && distances[3] == 0.002, "{distances:?}");
    }

    #[test]
    fn a_few_large_residuals_do_not_hide_the_others() {
        let all: Vec<Residual> = (0..1000)
            .map(|k| Residual {
                position: DVec3::ZERO,
                distance: Some(if k % 100 == 0 { 0.1 } else { 0.001 * f64::from(k) / 1000.0 }),
            })
            .collect();
        assert!(write_residuals(&mut Vec::new(), &all).unwrap() < 0.0011);
        assert!(write_residuals(&mut Vec::new(), &[]).unwrap() > 0.0);
    }
}
