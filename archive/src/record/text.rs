//! `LICENSE.txt` and `README.txt`: for a person who has this folder and nothing else, perhaps in fifty years.

use super::{Publication, citation};
use crate::layout::{ANNOTATIONS, CHECKSUMS, COLOUR_REPORT, DRAWINGS, HOLES, PHOTOGRAPHS, PREVIEW, TILESET};
use crate::numbers::size;
use crate::rights::Rights;
use glam::DVec3;
use kilwa_pack::plural::counted;
use std::fmt::Write as _;

pub(super) fn licence(p: &Publication) -> String {
    let m = &p.metadata;
    let mut s = format!("{}\n\nRights: {}\n{}\n", m.title, p.rights.label, p.rights.uri);
    if let Some(holder) = &m.rights.holder {
        let _ = writeln!(s, "\nRights holder: {holder}");
    }
    if let Some(statement) = &m.rights.statement {
        let _ = write!(s, "\n{}\n", wrapped(statement));
    }
    let photographs = photographs(p);
    let means = if p.rights.is_creative_commons() {
        "The address above leads to a summary and to the full text of the licence, in many languages."
    } else {
        "The address above leads to an explanation of this statement."
    };
    let _ = write!(
        s,
        "\n{}\n\nThis is about the model: the pack, the preview, the pictures and the texts of this folder. The viewer in the\n\
         folder \"viewer\" is the program Kilwa, under the Apache License 2.0 or the MIT License, at your option.\n\n\
         {photographs}How to cite it:\n\n{}\n",
        means,
        wrapped(&citation(p))
    );
    s
}

/// The rights in the photographs, which need not be those in the model.
fn photographs(p: &Publication) -> String {
    let Some((_, field)) = p.photographs() else { return String::new() };
    let label = Rights::parse(&field.rights).map(|rights| rights.label).unwrap_or_default();
    let mut s = format!(
        "The photographs in the folder \"{PHOTOGRAPHS}\" have rights of their own: {label}\n{}\n",
        field.rights
    );
    if !field.creators.is_empty() {
        let _ = writeln!(s, "Photographers: {}", field.creators.join("; "));
    }
    if let Some(holder) = &field.holder {
        let _ = writeln!(s, "Rights holder: {holder}");
    }
    if let Some(credit) = &field.credit {
        let _ = writeln!(s, "{}", wrapped(credit));
    }
    s.push('\n');
    s
}

pub(super) fn readme(p: &Publication) -> String {
    let m = &p.metadata;
    let line = "=".repeat(m.title.chars().count().min(100));
    let mut s = format!("{}\n{line}\n\n", m.title);
    if let Some(description) = &m.description {
        let _ = write!(s, "{}\n\n", wrapped(description));
    }
    let DVec3 { x, y, z } = p.size();
    let f = &p.figures;
    let crs = f.crs.as_deref().unwrap_or("none: local coordinates");
    let _ = write!(
        s,
        "A 3D model of {}, {x:.2} x {y:.2} x {z:.2} m.\n\
         Version {} of {}: {}\nUnits: metres, z up. Reference system: {crs}.\n\
         Standard uncertainty of the capture: {}.\nRights: {} ({})\n\n",
        match f.points {
            Some(points) => counted(points, "point", "points").to_string(),
            None => format!(
                "{} and {}",
                counted(f.triangles, "triangle", "triangles"),
                counted(f.vertices, "vertex", "vertices")
            ),
        },
        p.version,
        p.published,
        p.note,
        f.accuracy.map_or_else(|| "not stated".to_owned(), |a| format!("{a} m")),
        p.rights.label,
        p.rights.uri
    );
    if p.location_redacted {
        s.push_str("The location was removed or made coarser before publication, in every file of this folder.\n\n");
    }
    files(&mut s, p);
    without_kilwa(&mut s, p);
    let _ = write!(s, "\nHOW TO CITE IT\n\n{}\n", wrapped(&citation(p)));
    s
}

fn files(s: &mut String, p: &Publication) {
    let pack = p.pack_file();
    let _ =
        write!(s, "WHAT IS IN THIS FOLDER\n\n  {pack}\n      The model: the whole mesh, and coarser forms of it.\n");
    if let Some(preview) = p.preview {
        let what = if preview.error > 0.0 {
            format!(
                "A coarser form of {} (within {:.4} m)",
                counted(preview.triangles, "triangle", "triangles"),
                preview.error
            )
        } else {
            "The whole mesh".to_owned()
        };
        let _ = write!(s, "  {PREVIEW}\n      {what} as glTF 2.0, which most 3D programs open.\n");
    }
    if let Some(n) = &p.notes {
        let _ = write!(
            s,
            "  {ANNOTATIONS}\n      {} on places of the model (W3C Web Annotations): x, y and z are metres, as in the pack.\n",
            counted(n.notes.notes.len(), "note", "notes")
        );
    }
    if let Some(n) = &p.holes {
        let _ = write!(
            s,
            "  {HOLES}\n      {} of the surface with cause, area and rim (GeoJSON): x, y and z are metres, as in the pack.\n",
            counted(n.count, "hole", "holes")
        );
    }
    if let Some(c) = &p.colours {
        let _ = write!(
            s,
            "  {COLOUR_REPORT}\n      How the model was coloured: {} with pose, residual and share; those left out with the reason.\n",
            counted(c.report.photographs.len(), "photograph", "photographs")
        );
    }
    if let Some((included, _)) = p.photographs() {
        let _ = write!(
            s,
            "  {PHOTOGRAPHS}/\n      {} that the colours come from, and their masks ({}). LICENSE.txt states their rights.\n",
            counted(included.photographs, "photograph", "photographs"),
            size(included.bytes)
        );
        if included.copies > 0 {
            s.push_str(
                "      The folders \"previews\" and \"thumbnails\" contain smaller copies, which the page shows.\n",
            );
        }
    }
    if let Some(t) = &p.tiles {
        let place = if t.is_on_globe { "placed on the globe" } else { "in the coordinates of the pack" };
        let _ = write!(
            s,
            "  {TILESET}\n      All levels of detail as OGC 3D Tiles 1.1, {place}: {}, for CesiumJS and other viewers.\n",
            counted(t.tiles, "tile", "tiles")
        );
    }
    let _ = write!(
        s,
        "  poster.jpg, {DRAWINGS}/\n      Pictures; plan and elevations to scale.\n  \
           metadata/\n      Dublin Core, DataCite, Europeana, paradata (how it was captured), and all that was written about it.\n  \
           iiif/manifest.json, ro-crate-metadata.json, linkset.json\n      The same for programs.\n  \
           citation.*, LICENSE.txt\n      How to cite it; what you may do with it.\n  \
           viewer/\n      The program that shows the model in a web browser. It has to come from a web server: in the folder above this one\n      \
             run  python3 -m http.server  and open http://localhost:8000/\n  \
           {CHECKSUMS}\n      SHA-256 of every file here. To check them:  sha256sum -c {CHECKSUMS}\n"
    );
}

/// The exit: with Kilwa, with this folder's program, with nothing but the description of the format.
fn without_kilwa(s: &mut String, p: &Publication) {
    let pack = p.pack_file();
    let short = format!("{}...kilwa", pack.get(..13).unwrap_or(pack));
    let whole = if p.figures.points.is_some() {
        "(also .obj, .stl, .glb, as a square for each point). This gives every point of the survey, its colours."
    } else {
        "(also .obj, .stl, .glb). This gives the whole mesh: every triangle of the survey, its colours."
    };
    let _ = write!(
        s,
        "\nHOW TO GET THE MESH OUT\n\n\
         1. With the program kilwa:   kilwa extract {short} -o mesh.ply\n   \
            {whole}\n\
         2. Without it: {PREVIEW}, where it is here, is an ordinary glTF 2.0 file (y up, in metres, the model at zero).\n\
         3. With nothing but this: the pack is a single file, all integers little-endian, in this order.\n   \
            a. Header, 256 bytes: it begins with the letters KILWAPCK. Origin and step of a lattice stand in it: every\n      \
               position is origin + step * integer, in metres, z up.\n   \
            b. Metadata: JSON that can be read with a text editor, directly behind the header.\n   \
            c. A directory of chunks, and the chunks. The mesh is the union of the patches that name no diamond.\n   \
            The full description is docs/FORMAT.md of Kilwa; bytes 8 to 11 of the pack are the version of the\n   \
            format. A reader in Python, tests/format/read_pack.py, was written from it. Both belong to every copy of the source of Kilwa.\n"
    );
}

/// Lines of at most 100 characters; paragraphs stay.
fn wrapped(text: &str) -> String {
    let mut s = String::new();
    for (i, paragraph) in text.lines().enumerate() {
        if i > 0 {
            s.push('\n');
        }
        let mut width = 0;
        for word in paragraph.split_whitespace() {
            let n = word.chars().count();
            if width > 0 && width + 1 + n > 100 {
                s.push('\n');
                width = 0;
            } else if width > 0 {
                s.push(' ');
                width += 1;
            }
            s.push_str(word);
            width += n;
        }
    }
    s
}
