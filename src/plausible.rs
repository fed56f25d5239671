//! Whether a mesh was read as it was meant: its units, the axis that points up, its reference system, its pictures. What is doubtful is a warning
//! with the option that would mend it; nothing is refused, because every one of these may be right.

use crate::info::{grouped, metres};
use glam::DVec3;
use kilwa_archive::metadata::crs;
use kilwa_builder::{ColoredBy, Diagnostic};
use kilwa_formats::Up;
use kilwa_geometry::LengthUnit;
use kilwa_pack::plural::plural;
use std::collections::BTreeMap;

/// A model that is wider than this, metres, is rather in other units, unless it has map coordinates.
const WIDE: f64 = 1000.0;
/// The same for a closed surface, which is rather an object than a site.
const WIDE_CLOSED: f64 = 200.0;
/// Narrower than this, metres: nothing that is surveyed.
const NARROW: f64 = 0.005;
/// Coordinates beyond this, metres, are those of a map, which are in metres.
const MAP: f64 = 100_000.0;
/// The share of a surface that faces one way on the whole, from which on it means something.
const OPEN: f64 = 0.05;
/// The cosine of the angle to an axis, within which the surface faces along it.
const ALONG: f64 = 0.8;

/// Diagnostics that stand above the report, because something that the mesh names is missing from the model: their names, and what one of them is
/// called.
const LOST: [(&str, &str); 6] = [
    ("pictures left out", "picture left out"),
    (
        "pictures that cannot be read; what they cover has the colour of its material",
        "picture that cannot be read; what it covers has the colour of its material",
    ),
    (
        "pictures that cannot be read; what they cover keeps its vertex colours, if any",
        "picture that cannot be read; what it covers keeps its vertex colours, if any",
    ),
    ("pictures named in the header not read", "picture named in the header not read"),
    (
        "material libraries that are missing; colours and pictures are left out",
        "material library that is missing; its colours and pictures are left out",
    ),
    ("materials that no library defines, left out", "material that no library defines, left out"),
];

/// How the inputs were read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReadAs<'a> {
    /// The units that were asked for.
    pub(crate) units: Option<LengthUnit>,
    /// The axis that was asked for.
    pub(crate) given_up: Option<Up>,
    /// The axis that points up.
    pub(crate) up: Up,
    /// The reference system, if one was given.
    pub(crate) crs: Option<&'a str>,
}

impl ReadAs<'_> {
    /// The units and the axis, and whether somebody chose them.
    pub(crate) fn words(&self) -> String {
        let default = |is_default: bool| if is_default { " (default)" } else { "" };
        let units = self.units.unwrap_or_default().symbol();
        let up = if self.up == Up::Z { "z" } else { "y" };
        format!("units: {units}{}, up: {up}{}", default(self.units.is_none()), default(self.given_up.is_none()))
    }
}

/// What is judged.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Model<'a> {
    /// Smallest and largest corner, metres.
    pub(crate) bounds: [DVec3; 2],
    /// See [`kilwa_builder::ingest::surface::Surface::facing`].
    pub(crate) facing: DVec3,
    pub(crate) is_closed: bool,
    pub(crate) diagnostics: &'a BTreeMap<String, Diagnostic>,
}

/// What is doubtful, worst first: a sentence each.
pub(crate) fn warnings(model: &Model<'_>, read: &ReadAs<'_>) -> Vec<String> {
    let mut all: Vec<String> = LOST.iter().filter_map(|names| lost(names, model.diagnostics.get(names.0)?)).collect();
    all.extend(size(model, read));
    all.extend(axis(model, read));
    let [low, high] = model.bounds;
    all.extend(read.crs.and_then(|system| crs::holds(system, low, high).err()));
    all
}

/// Whether a diagnostic is among the warnings, and need not be listed again.
pub(crate) fn is_warning(kind: &str) -> bool {
    LOST.iter().any(|(name, _)| *name == kind)
}

fn lost((several, one): &(&str, &str), found: &Diagnostic) -> Option<String> {
    let kind = if found.count == 1 { one } else { several };
    let places = if found.places.is_empty() { String::new() } else { format!(" ({})", found.places.join("; ")) };
    (found.count > 0).then(|| format!("{} {kind}{places}", found.count))
}

fn size(model: &Model<'_>, read: &ReadAs<'_>) -> Option<String> {
    let [low, high] = model.bounds;
    let size = (high - low).max_element();
    let has_map_coordinates = low.abs().max(high.abs()).truncate().max_element() > MAP;
    if read.units.is_some() || has_map_coordinates {
        return None;
    }
    let wide = if model.is_closed { WIDE_CLOSED } else { WIDE };
    if size > wide {
        let (cm, mm) = (metres(size / 100.0), metres(size / 1000.0));
        return Some(format!(
            "the model is {} wide if its units are metres. If they are millimetres, use --units mm ({mm}); if \
             centimetres, --units cm ({cm}); if it is that wide, --units m",
            metres(size)
        ));
    }
    (size < NARROW).then(|| {
        format!(
            "the model is only {} wide if its units are metres; give the units of the file with --units",
            metres(size)
        )
    })
}

fn axis(model: &Model<'_>, read: &ReadAs<'_>) -> Option<String> {
    let share = model.facing.length();
    if read.given_up.is_some() || share < OPEN {
        return None;
    }
    let facing = model.facing / share;
    // In the pack z is up and y north; y of a file with y up is z there, and its z is -y.
    let (is_other, other, own) = match read.up {
        Up::Z => (facing.y > ALONG, "y", "z"),
        Up::Y => (facing.y < -ALONG, "z", "y"),
    };
    is_other.then(|| {
        format!(
            "the surface is open and faces mostly along the {other} axis of the file, as terrain or a statue on its base \
             would be if {other} pointed up. If the model lies on its side, use --up {other}; if not, --up {own}"
        )
    })
}

/// Where the colours of so many vertices come from, and how much of the pictures they hold.
pub(crate) fn colors(by: &ColoredBy, vertices: u64, triangles: u64, is_split: bool) -> String {
    let pictures = match by {
        ColoredBy::Nothing => return "none".to_owned(),
        ColoredBy::Vertices => return "of the vertices or their materials".to_owned(),
        ColoredBy::Triangles => return "of the triangles".to_owned(),
        ColoredBy::Channel(name) => return format!("grey, from the channel {name}"),
        ColoredBy::Pictures(pictures) => pictures,
    };
    let (n, texels) = (grouped(pictures.count), grouped(pictures.texels));
    let from = format!("from {n} {} of {texels} texels", plural(pictures.count, "picture", "pictures"));
    // Texels from a vertex to the next: pictures are grids, and so, roughly, are vertices.
    let apart = (pictures.texels as f64 / vertices.max(1) as f64).sqrt();
    if apart < 1.5 {
        return format!("{from}; the vertices are as dense as the texels");
    }
    let kept = format!(
        "{from}, sampled at {} vertices about {apart:.0} texels apart; finer detail is lost",
        grouped(vertices)
    );
    if is_split {
        return kept;
    }
    // A quarter of the way: each triangle becomes 16.
    let detail = (apart / 4.0).ceil().max(2.0);
    let after = triangles as f64 * (apart / detail).powi(2);
    format!(
        "{kept}. --texture-detail {detail:.0} would keep detail of {detail:.0} texels, with about {after:.1e} triangles"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_formats::Pictures;

    const AS_METRES: ReadAs<'static> = ReadAs { units: None, given_up: None, up: Up::Z, crs: None };

    fn model(size: f64, facing: DVec3, none: &BTreeMap<String, Diagnostic>) -> Model<'_> {
        Model { bounds: [DVec3::ZERO, DVec3::new(size, size, 0.7 * size)], facing, is_closed: false, diagnostics: none }
    }

    #[test]
    fn implausible_units_are_reported_for_an_object_but_not_for_a_site() {
        let none = BTreeMap::new();
        let say = |model: &Model<'_>, read: &ReadAs<'_>| warnings(model, read).join("\n");
        let head = model(2100.0, DVec3::ZERO, &none);
        assert!(
            say(&head, &AS_METRES).contains("2100.000 m wide")
                && say(&head, &AS_METRES).contains("--units mm (2.100 m)")
        );
        assert_eq!(say(&head, &ReadAs { units: Some(LengthUnit::Metre), ..AS_METRES }), "");
        assert_eq!(say(&model(54.0, DVec3::ZERO, &none), &AS_METRES), "");
        let closed = Model { is_closed: true, ..model(210.0, DVec3::ZERO, &none) };
        assert!(say(&closed, &AS_METRES).contains("--units mm (210.000 mm)"));
        let map = DVec3::new(566_000.0, 9_010_000.0, 0.0);
        let landscape = Model { bounds: [map, map + 2100.0], ..head };
        assert_eq!(say(&landscape, &AS_METRES), "");
        assert!(say(&landscape, &ReadAs { crs: Some("EPSG:32601"), ..AS_METRES }).is_empty());
        assert!(
            say(&model(54.0, DVec3::ZERO, &none), &ReadAs { crs: Some("EPSG:32737"), ..AS_METRES })
                .contains("UTM 37 S")
        );
        assert!(say(&model(0.002, DVec3::ZERO, &none), &AS_METRES).contains("2.000 mm"));
    }

    #[test]
    fn a_surface_that_faces_along_the_other_axis_is_doubted() {
        let none = BTreeMap::new();
        let lies = |facing: DVec3, read: ReadAs<'_>| warnings(&model(10.0, facing, &none), &read).len() == 1;
        let read_as_y = ReadAs { up: Up::Y, ..AS_METRES };
        assert!(lies(DVec3::Y * 0.6, AS_METRES) && lies(-DVec3::Y * 0.6, read_as_y));
        for (facing, read) in [
            (DVec3::Z * 0.6, AS_METRES),
            (-DVec3::Y * 0.6, AS_METRES),
            (DVec3::Z * 0.6, read_as_y),
            (DVec3::Y * 0.01, AS_METRES),
            (DVec3::Y * 0.6, ReadAs { given_up: Some(Up::Z), ..AS_METRES }),
        ] {
            assert!(!lies(facing, read), "{facing} {read:?}");
        }
    }

    #[test]
    fn the_line_of_colours_states_how_much_of_the_pictures_is_lost() {
        let pictures = ColoredBy::Pictures(Pictures { count: 1, texels: 4_194_304 });
        let line = colors(&pictures, 2500, 5000, false);
        assert!(line.contains("1 picture of 4,194,304 texels") && line.contains("about 41 texels apart"), "{line}");
        assert!(line.contains("--texture-detail 11 would keep detail of 11 texels"), "{line}");
        assert!(!colors(&pictures, 2500, 5000, true).contains("--texture-detail"));
        assert!(colors(&pictures, 4_000_000, 8_000_000, false).contains("as dense as the texels"));
        assert_eq!(
            colors(&ColoredBy::Channel("intensity".to_owned()), 9, 9, false),
            "grey, from the channel intensity"
        );
    }
}
