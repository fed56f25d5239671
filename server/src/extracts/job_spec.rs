//! What can be asked for: a format and how fine; and how that is called in addresses and in the cache.
//!
//! `v1-whole.ply`, `v1-100000.glb` (at most so many triangles), `v1-0.01m.stl` (within so many metres). The name is read back exactly or not at all.

use std::fmt;

/// Of the files; a change of what is written makes older ones another key.
const FORM: u32 = 2;

/// A format of meshes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// PLY, binary.
    Ply,
    /// glTF, one file.
    Glb,
    /// Wavefront OBJ.
    Obj,
    /// STL, binary.
    Stl,
}

impl Format {
    /// All of them, in the order of the form.
    pub const ALL: [Self; 4] = [Self::Ply, Self::Glb, Self::Obj, Self::Stl];

    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Ply => "ply",
            Self::Glb => "glb",
            Self::Obj => "obj",
            Self::Stl => "stl",
        }
    }

    /// The format of an ending.
    pub fn of(ending: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|f| f.ending() == ending)
    }

    /// Bytes of a triangle with its share of the vertices, on the high side.
    pub(crate) fn bytes_per_triangle(self) -> u64 {
        match self {
            Self::Ply | Self::Glb => 30,
            Self::Obj => 75,
            Self::Stl => 50,
        }
    }
}

/// How fine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Detail {
    /// Every triangle.
    Whole,
    /// A surface of so many triangles, or a few less, and more only where it cannot be simplified so far.
    Triangles(u64),
    /// The coarsest surface within so many metres.
    Error(f64),
}

impl Detail {
    /// A number of triangles as people type it, with whatever they put between thousands.
    pub(crate) fn triangles(text: &str) -> Option<Self> {
        let digits: String =
            text.chars().filter(|c| !matches!(c, ' ' | ',' | '.' | '\'' | '\u{a0}' | '\u{202f}')).collect();
        digits.parse().ok().filter(|n| *n > 0).map(Self::Triangles)
    }

    /// Metres as people type them.
    pub(crate) fn error(text: &str) -> Option<Self> {
        let metres: f64 = text.trim().replace(',', ".").parse().ok()?;
        // Rounded, so that a value is read back as it was written: six digits after the point are a thousandth of a millimetre.
        let metres = (metres * 1e6).round() / 1e6;
        (metres > 0.0 && metres <= 1e4).then_some(Self::Error(metres))
    }
}

impl fmt::Display for Detail {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Whole => f.write_str("whole"),
            Self::Triangles(n) => write!(f, "{n}"),
            Self::Error(metres) => write!(f, "{metres}m"),
        }
    }
}

/// What is asked for of a pack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct JobSpec {
    pub(crate) format: Format,
    pub(crate) detail: Detail,
}

impl JobSpec {
    /// Its name in addresses, for a version.
    pub(crate) fn name(self, version: u32) -> String {
        format!("v{version}-{}.{}", self.detail, self.format.ending())
    }

    /// The version and the job of a name.
    pub(crate) fn parse(name: &str) -> Option<(u32, Self)> {
        let (version, rest) = name.strip_prefix('v')?.split_once('-')?;
        let (detail, ending) = rest.rsplit_once('.')?;
        let detail = match detail.strip_suffix('m') {
            Some(metres) => Detail::error(metres)?,
            None if detail == "whole" => Detail::Whole,
            None => Detail::Triangles(detail.parse().ok().filter(|n| *n > 0)?),
        };
        let (version, spec) = (version.parse().ok()?, Self { format: Format::of(ending)?, detail });
        // One name for one file.
        (spec.name(version) == name).then_some((version, spec))
    }

    /// Its name in the cache, for a pack by its hash.
    pub(crate) fn key(self, hash: &str) -> String {
        format!("{hash}.{FORM}.{}.{}", self.detail, self.format.ending())
    }

    /// The length of the file at most, roughly. The temporary files made while it is written are as long again: see [`Self::disk_bytes`].
    pub(crate) fn estimate(self, triangles: u64) -> u64 {
        let written = match self.detail {
            Detail::Triangles(max) => max.min(triangles),
            // How many are within an error is known only when it is done: where it is small, all of them.
            Detail::Whole | Detail::Error(_) => triangles,
        };
        written.saturating_mul(self.format.bytes_per_triangle())
    }

    /// Disk space that it takes while it is made: the file, and scratch files of its length.
    pub(crate) fn disk_bytes(self, triangles: u64) -> u64 {
        self.estimate(triangles).saturating_mul(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn job_names_round_trip_and_other_names_are_refused() {
        for name in ["v1-whole.ply", "v12-100000.glb", "v1-0.01m.stl", "v3-0.000001m.obj"] {
            let (version, spec) = JobSpec::parse(name).unwrap();
            assert_eq!(spec.name(version), name);
        }
        for bad in [
            "",
            "v1",
            "v1-whole",
            "v1-whole.gltf",
            "v01-whole.ply",
            "v1-0100.ply",
            "v1-0.ply",
            "v1--5.ply",
            "v1-+5.ply",
            "v1-0.010m.ply",
            "v1-nanm.ply",
            "v1-infm.ply",
            "v1-1e3m.ply",
            "v1-../../x.ply",
            "v-1-whole.ply",
            "v1-whole.ply/..",
            "v1-20000m.ply",
        ] {
            assert_eq!(JobSpec::parse(bad), None, "{bad}");
        }
    }

    proptest::proptest! {
        #[test]
        fn any_name_is_parsed_or_refused(name in "v?[0-9]{0,12}[-.]?[a-z0-9.\\-+]{0,24}(\\.(ply|glb|obj|stl))?") {
            if let Some((version, spec)) = JobSpec::parse(&name) {
                proptest::prop_assert_eq!(spec.name(version), name);
                proptest::prop_assert!(!spec.key("hash").contains(['/', '\\']));
            }
        }
    }

    /// An object may contain a file of such a format, too.
    #[test]
    fn every_format_counts_as_the_model() {
        for format in Format::ALL {
            let name = JobSpec { format, detail: Detail::Whole }.name(1);
            assert!(kilwa_archive::layout::is_geometry(&name), "{name}");
        }
    }

    #[test]
    fn an_error_limit_may_need_every_triangle_and_scratch_space_is_counted() {
        let spec = |detail| JobSpec { format: Format::Stl, detail };
        let whole = spec(Detail::Whole).estimate(1_000_000);
        assert_eq!(spec(Detail::Error(0.000_001)).estimate(1_000_000), whole);
        assert!(spec(Detail::Triangles(10)).estimate(1_000_000) < whole);
        assert!(spec(Detail::Whole).disk_bytes(1_000_000) >= 2 * whole);
    }

    #[test]
    fn typed_limits_are_parsed_or_refused() {
        assert_eq!(Detail::triangles("1 000,000"), Some(Detail::Triangles(1_000_000)));
        assert_eq!(Detail::error(" 0,01 "), Some(Detail::Error(0.01)));
        for bad in ["", "0", "-1", "x", "1e5"] {
            assert_eq!(Detail::triangles(bad), None, "{bad}");
        }
        for bad in ["", "0", "-1", "x", "nan", "inf", "0.0000001", "99999"] {
            assert_eq!(Detail::error(bad), None, "{bad}");
        }
    }
}
