//! Compares registered poses with the true ones, aligned at the anchor or at the first fixed station by composing poses.
//!
//! Pose errors follow the convention of the covariances in `registration.json`: a rotation about the axes of the survey through the station (radians), then a
//! translation (metres).

use anyhow::{Context, Result, ensure};
use serde_json::Value;

/// Maximum errors of a correct pose: metres, degrees.
const WRONG: [f64; 2] = [0.05, 0.5];
/// The limits of the 95 % region for one to six degrees of freedom.
pub(super) const CHI_SQUARE_95: [f64; 6] = [3.841, 5.991, 7.815, 9.488, 11.070, 12.592];

type Vector = [f64; 3];
/// Rows.
type Matrix = [[f64; 3]; 3];

/// A rotation, then a translation.
#[derive(Clone, Copy)]
struct Pose {
    rotation: Matrix,
    translation: Vector,
}

/// True poses by name.
pub(super) struct Truth(Vec<(String, Pose)>);

/// The error of a station that is neither the anchor nor fixed.
pub(super) struct Error {
    pub(super) name: String,
    off: [f64; 6],
    covariance: [[f64; 6]; 6],
}

/// The result of a program.
pub(super) struct Found {
    /// Number of true stations, and number of placed stations, including the anchor.
    pub(super) stations: usize,
    pub(super) placed: usize,
    pub(super) errors: Vec<Error>,
    /// The errors of all placed stations after the rigid motion that best aligns their positions: millimetres, degrees. The error of the anchor is then not
    /// included in those of all others.
    pub(super) aligned: Vec<[f64; 2]>,
    /// Names and reasons.
    pub(super) refused: Vec<(String, String)>,
}

impl Error {
    pub(super) fn millimetres(&self) -> f64 {
        length([self.off[3], self.off[4], self.off[5]]) * 1e3
    }

    pub(super) fn degrees(&self) -> f64 {
        length([self.off[0], self.off[1], self.off[2]]).to_degrees()
    }

    pub(super) fn is_wrong(&self) -> bool {
        // NaN counts as wrong.
        !(self.millimetres() <= WRONG[0] * 1e3 && self.degrees() <= WRONG[1])
    }

    /// The squared Mahalanobis distance of a part of the error; `None` without a covariance, infinite if the covariance is singular.
    pub(super) fn mahalanobis(&self, part: &[usize]) -> Option<f64> {
        if self.covariance.iter().flatten().all(|v| *v == 0.0) {
            return None;
        }
        let n = part.len();
        // The Cholesky factor and forward substitution; the squared norm of the solution is the squared distance.
        let (mut factor, mut solved, mut sum) = ([[0.0; 6]; 6], [0.0; 6], 0.0);
        for i in 0..n {
            for j in 0..=i {
                let known: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
                let rest = self.covariance[part[i]][part[j]] - known;
                factor[i][j] = if i == j { rest.sqrt() } else { rest / factor[j][j] };
            }
            let known: f64 = (0..i).map(|k| factor[i][k] * solved[k]).sum();
            solved[i] = (self.off[part[i]] - known) / factor[i][i];
            sum += solved[i] * solved[i];
        }
        Some(if sum.is_nan() { f64::INFINITY } else { sum })
    }
}

impl Truth {
    /// From the text of `truth/poses.toml` of `kilwa synth scans`.
    pub(super) fn parse(text: &str) -> Result<Self> {
        let mut all = Vec::new();
        for station in text.split("[[station]]").skip(1) {
            let value = |key: &str| {
                let line = station.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
                let line = line.with_context(|| format!("a station of the truth has no {key}"))?;
                serde_json::from_str::<Value>(line).with_context(|| format!("{key} = {line}"))
            };
            let name = value("name")?.as_str().context("a name is not a string")?.to_owned();
            let (position, rotation) = (numbers(&value("position")?)?, numbers::<9>(&value("rotation")?)?);
            let row = |k: usize| [rotation[3 * k], rotation[3 * k + 1], rotation[3 * k + 2]];
            all.push((name, Pose { rotation: [row(0), row(1), row(2)], translation: position }));
        }
        ensure!(!all.is_empty(), "the truth has no stations");
        Ok(Self(all))
    }

    /// Evaluates a result in the format of `registration.json`.
    pub(super) fn judge(&self, found: &Value) -> Result<Found> {
        let text = |value: &Value| value.as_str().unwrap_or_default().to_owned();
        let list = |key: &str| found[key].as_array().with_context(|| format!("there is no list of {key}"));
        let mut all = Vec::new();
        for station in list("stations")? {
            let (name, own) = (text(&station["name"]), quaternion(numbers(&station["rotation"])?));
            let pose = Pose { rotation: own, translation: numbers(&station["translation"])? };
            let (_, truth) =
                self.0.iter().find(|(known, _)| *known == name).with_context(|| format!("{name} is unknown"))?;
            all.push((name, text(&station["placement"]), pose, *truth, numbers::<36>(&station["covariance"])?));
        }
        let base = |kind: &str| all.iter().find(|station| station.1 == kind);
        let base = base("anchor").or_else(|| base("fixed")).or_else(|| all.first());
        // Transforms the true frame to that of the result.
        let turn = base.map_or(IDENTITY, |(_, _, pose, truth, _)| product(pose.rotation, transposed(truth.rotation)));
        let shift =
            base.map_or([0.0; 3], |(_, _, pose, truth, _)| minus(pose.translation, apply(turn, truth.translation)));
        let (mut errors, mut offs) = (Vec::new(), Vec::new());
        for (name, placement, pose, truth, covariance) in &all {
            let spin = product(pose.rotation, transposed(product(turn, truth.rotation)));
            let [a, b, c] = rotation_vector(spin);
            let [x, y, z] = minus(minus(pose.translation, apply(turn, truth.translation)), shift);
            offs.push((pose.translation, [a, b, c], [x, y, z]));
            if placement == "anchor" || placement == "fixed" {
                continue;
            }
            let row = |k: usize| std::array::from_fn(|j| covariance[6 * k + j]);
            errors.push(Error { name: name.clone(), off: [a, b, c, x, y, z], covariance: std::array::from_fn(row) });
        }
        let refused = list("unplaced")?.iter().map(|one| (text(&one["name"]), text(&one["reason"]))).collect();
        Ok(Found { stations: self.0.len(), placed: all.len(), errors, aligned: aligned(&offs), refused })
    }
}

/// Errors (millimetres, degrees) that remain after the small rigid motion that aligns the positions best. Each station: its position, its rotation error, and its translation error.
fn aligned(stations: &[(Vector, Vector, Vector)]) -> Vec<[f64; 2]> {
    let mean = |of: &dyn Fn(&(Vector, Vector, Vector)) -> Vector| -> Vector {
        std::array::from_fn(|k| stations.iter().map(|s| of(s)[k]).sum::<f64>() / stations.len().max(1) as f64)
    };
    let (middle, shift) = (mean(&|s| s.0), mean(&|s| s.2));
    // Least squares for the rotation: (sum of r² I - r rᵀ) turn = sum of r × error.
    let (mut matrix, mut moment) = ([[0.0; 3]; 3], [0.0; 3]);
    for (position, _, off) in stations {
        let (r, e) = (minus(*position, middle), minus(*off, shift));
        let square = r.iter().map(|v| v * v).sum::<f64>();
        for i in 0..3 {
            for (j, value) in matrix[i].iter_mut().enumerate() {
                *value += if i == j { square - r[i] * r[j] } else { -r[i] * r[j] };
            }
            moment[i] += cross(r, e)[i];
        }
    }
    let turn = solved(matrix, moment).unwrap_or([0.0; 3]);
    let rest = |(position, spin, off): &(Vector, Vector, Vector)| {
        let lever = cross(turn, minus(*position, middle));
        [length(minus(minus(*off, shift), lever)) * 1e3, length(minus(*spin, turn)).to_degrees()]
    };
    stations.iter().map(rest).collect()
}

/// Cramer's rule; `None` if the matrix is singular, as for stations on a line.
fn solved(matrix: Matrix, right: Vector) -> Option<Vector> {
    let columns = transposed(matrix);
    let volume = |[a, b, c]: Matrix| (0..3).map(|k| a[k] * cross(b, c)[k]).sum::<f64>();
    let whole = volume(columns);
    let scale = (matrix[0][0] + matrix[1][1] + matrix[2][2]).powi(3);
    (whole.abs() > 1e-9 * scale).then(|| {
        std::array::from_fn(|k| {
            let mut replaced = columns;
            replaced[k] = right;
            volume(replaced) / whole
        })
    })
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// All numbers of nested lists.
fn numbers<const N: usize>(value: &Value) -> Result<[f64; N]> {
    fn collect(value: &Value, out: &mut Vec<f64>) {
        match value {
            Value::Array(list) => list.iter().for_each(|value| collect(value, out)),
            other => out.push(other.as_f64().unwrap_or(f64::NAN)),
        }
    }
    let mut out = Vec::new();
    collect(value, &mut out);
    out.try_into().map_err(|out: Vec<f64>| anyhow::anyhow!("{} numbers where {N} are expected", out.len()))
}

/// The matrix of a quaternion w, x, y, z.
fn quaternion([w, x, y, z]: [f64; 4]) -> Matrix {
    let n = (w * w + x * x + y * y + z * z).sqrt();
    let [w, x, y, z] = [w / n, x / n, y / n, z / n];
    [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
}

/// The rotation vector of a rotation matrix; near half a turn, only its length is meaningful.
fn rotation_vector(r: Matrix) -> Vector {
    let v = [r[2][1] - r[1][2], r[0][2] - r[2][0], r[1][0] - r[0][1]].map(|v| v / 2.0);
    let (sine, cosine) = (length(v), (r[0][0] + r[1][1] + r[2][2] - 1.0) / 2.0);
    if sine > 1e-12 {
        return v.map(|v| v * sine.atan2(cosine) / sine);
    }
    if cosine > 0.0 { v } else { [std::f64::consts::PI, 0.0, 0.0] }
}

fn product(a: Matrix, b: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

fn transposed(a: Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn apply(a: Matrix, v: Vector) -> Vector {
    std::array::from_fn(|i| (0..3).map(|k| a[i][k] * v[k]).sum())
}

fn minus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|k| a[k] - b[k])
}

fn length(v: Vector) -> f64 {
    v.iter().map(|v| v * v).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRUTH: &str = "seed = 1\n\n[[station]]\nname = \"a\"\ncolumns = 8\n# site_from_scan\nposition = [1.0, 2.0, 0.5]\n\
        rotation = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]\nwritten_position = [9.0, 9.0, 9.0]\n[station.samples]\nempty = 3\n\
        \n[[station]]\nname = \"b\"\nposition = [4.0, 2.0, 0.5]\nrotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n";

    #[test]
    fn alignment_removes_a_small_rigid_motion_of_all_stations() {
        let positions = [[0.0, 0.0, 0.0], [10.0, 0.0, 1.0], [0.0, 8.0, 0.0], [5.0, 5.0, 3.0]];
        let (turn, shift) = ([1e-4, -2e-4, 3e-4], [0.01, 0.02, -0.03]);
        let moved = |p: Vector| (p, turn, std::array::from_fn(|k| cross(turn, p)[k] + shift[k]));
        let mut stations = positions.map(moved);
        for [millimetres, degrees] in aligned(&stations) {
            assert!(millimetres < 1e-9 && degrees < 1e-9, "{millimetres} {degrees}");
        }
        stations[3].2[0] += 0.004;
        let worst = aligned(&stations).into_iter().map(|[mm, _]| mm).fold(0.0, f64::max);
        assert!((1.0..4.0).contains(&worst), "{worst}");
    }

    /// Station `a` as the anchor at the origin, and `b` displaced by `off` along x and rotated by `turned` about z.
    fn found(off: f64, turned: f64) -> Found {
        let truth = Truth::parse(TRUTH).unwrap();
        // In the frame of `a`, which is turned by a quarter, `b` stands at y = -3 and is turned back by a quarter.
        let half = (turned - std::f64::consts::FRAC_PI_2) / 2.0;
        let mut covariance = [[0.0; 6]; 6];
        for (k, row) in covariance.iter_mut().enumerate() {
            row[k] = 1e-6;
        }
        covariance[3][4] = 0.9e-6;
        covariance[4][3] = 0.9e-6;
        let none = [[0.0; 6]; 6];
        let json = serde_json::json!({
            "stations": [
                {"name": "a", "placement": "anchor", "rotation": [1.0, 0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0], "covariance": none},
                {"name": "b", "placement": "surface", "rotation": [half.cos(), 0.0, 0.0, half.sin()], "translation": [off, -3.0, 0.0], "covariance": covariance},
            ],
            "unplaced": [{"name": "c", "reason": "It sees nothing."}],
        });
        truth.judge(&json).unwrap()
    }

    #[test]
    fn the_true_pose_has_no_error_in_any_frame() {
        let found = found(0.0, 0.0);
        assert_eq!((found.stations, found.placed, found.errors.len()), (2, 2, 1));
        assert_eq!(found.refused, [("c".to_owned(), "It sees nothing.".to_owned())]);
        let error = &found.errors[0];
        assert!(error.millimetres() < 1e-9 && error.degrees() < 1e-9 && !error.is_wrong());
    }

    #[test]
    fn errors_are_measured_and_large_ones_are_wrong() {
        let error = &found(0.049, 0.49_f64.to_radians()).errors[0];
        assert!(
            (error.millimetres() - 49.0).abs() < 1e-6 && (error.degrees() - 0.49).abs() < 1e-6 && !error.is_wrong()
        );
        assert!(found(0.051, 0.0).errors[0].is_wrong() && found(0.0, 0.51_f64.to_radians()).errors[0].is_wrong());
    }

    #[test]
    fn the_mahalanobis_distance_accounts_for_correlations() {
        let error = &found(0.002, 0.001).errors[0];
        let near = |part: &[usize], expected: f64| {
            let own = error.mahalanobis(part).unwrap();
            assert!((own - expected).abs() < 1e-6, "{part:?}: {own}, expected {expected}");
        };
        near(&[3], 4.0);
        near(&[2], 1.0);
        // With a correlation of 0.9, an error of 2 standard deviations along x and none along y is unlikely.
        near(&[3, 4, 5], 4.0 / (1.0 - 0.81));
        near(&[0, 1, 2, 3, 4, 5], 4.0 / (1.0 - 0.81) + 1.0);
    }
}
