//! Recognises files of formats that are not read by their first bytes, so that the refusal can say what the file is and what to do.
//!
//! Input: the first bytes and the length of the file. The name of the file is looked at only where the content fits
//! several formats (plain columns of numbers, a damaged glTF), and only for the wording of the refusal.

use super::ReadError;
use std::path::Path;

const EXPORT: &str = "Open it in MeshLab, Blender or CloudCompare and export it as PLY (binary, with colours).";
const MESH_FIRST: &str = "It is a point cloud: make a mesh of it first (for example Poisson reconstruction in CloudCompare or MeshLab) and export that as PLY or OBJ.";
const SCAN: &str = "Use `kilwa scans import` for scans; to build from a point cloud, make a mesh of it first (for example Poisson reconstruction in CloudCompare or MeshLab) and export that as PLY or OBJ.";
const UNPACK: &str = "Unpack it first and use the mesh inside.";

/// A format: how it is called in a sentence, and the way out.
type Known = (&'static str, &'static str);

const UTF_16: Known =
    ("a text file in UTF-16", "Save it again as UTF-8 or plain ASCII (in a text editor: Save as, encoding).");

/// Formats recognised by fixed bytes at the beginning.
const SIGNATURES: &[(&[u8], Known)] = &[
    (b"KILWAPCK", ("already a Kilwa pack", "Use it as it is with `kilwa info`, `kilwa render` or `kilwa serve`.")),
    (b"glTF", ("a glTF binary (GLB)", EXPORT)),
    (b"LASF", ("a LAS or LAZ point cloud", SCAN)),
    (b"ASTM-E57", ("an E57 scan", SCAN)),
    (b"# .PCD", ("a PCD point cloud", MESH_FIRST)),
    (b"\x1f\x8b", ("a gzip file", UNPACK)),
    (b"BZh", ("a bzip2 file", UNPACK)),
    (b"\xfd7zXZ\x00", ("an xz file", UNPACK)),
    (b"\x28\xb5\x2f\xfd", ("a Zstandard file", UNPACK)),
    (b"7z\xbc\xaf\x27\x1c", ("a 7-Zip archive", UNPACK)),
    (b"Rar!", ("a RAR archive", UNPACK)),
    (b"Kaydara FBX Binary", ("an FBX scene", EXPORT)),
    (b"; FBX", ("an FBX scene", EXPORT)),
    (b"DRACO", ("a Draco mesh", "Decode it with `draco_decoder` to PLY.")),
    (b"OCTM", ("an OpenCTM mesh", EXPORT)),
    (b"BLENDER", ("a Blender file", "Open it in Blender and export the mesh as PLY.")),
    (b"PXR-USDC", ("a USD scene", EXPORT)),
    (b"#usda", ("a USD scene", EXPORT)),
    (b"Ogawa", ("an Alembic scene", EXPORT)),
    (b"# vtk DataFile", ("a VTK file", EXPORT)),
    (b"#VRML", ("a VRML scene", EXPORT)),
    (b"#X3D", ("an X3D scene", EXPORT)),
    (b"ISO-10303-21", ("a STEP or IFC model", EXPORT)),
    (b"\x89HDF\r\n\x1a\n", ("an HDF5 file", EXPORT)),
    (b"\x89PNG", ("a PNG picture", "Give the mesh.")),
    (b"\xff\xd8\xff", ("a JPEG picture", "Give the mesh.")),
    (b"%PDF", ("a PDF document", "Give the mesh.")),
    (b"\xff\xfe", UTF_16),
    (b"\xfe\xff", UTF_16),
    (
        b"\xef\xbb\xbfply",
        (
            "a PLY file behind a byte order mark, which PLY does not allow",
            "Save it again without the mark (in a text editor: UTF-8 without BOM).",
        ),
    ),
];

/// Formats by file name, for files whose content is not recognised.
const BY_NAME: &[(&str, Known)] = &[
    ("obj", ("named as a Wavefront OBJ mesh, but its content does not look like one", EXPORT)),
    ("stl", ("named as an STL mesh, but its content is not one (it may be truncated)", EXPORT)),
    ("glb", ("named as a glTF binary, but its content is not one", EXPORT)),
    ("gltf", ("named as a glTF scene, but its content is not one", EXPORT)),
    (
        "ply",
        (
            "named as a PLY, but does not begin with a line \"ply\"",
            "It is damaged or another file: copy or export it again.",
        ),
    ),
    ("e57", ("named as an E57 scan, but its content is not one", SCAN)),
    ("las", ("named as a LAS point cloud, but its content is not one", SCAN)),
    ("laz", ("named as a LAZ point cloud, but its content is not one", SCAN)),
];

/// The error for a file in none of the formats of `FORMATS`, which names the format where it is known.
pub(super) fn refusal(start: &[u8], total: u64, path: &Path) -> ReadError {
    let by_name = || BY_NAME.iter().find(|(e, _)| has_extension(path, e)).map(|(_, known)| *known);
    let unknown = ("of a format that Kilwa does not know", "Export the mesh as PLY.");
    let (what, way_out) = recognise(start, total).or_else(by_name).unwrap_or(unknown);
    ReadError::Format { file: path.to_owned(), what, way_out }
}

fn recognise(start: &[u8], total: u64) -> Option<Known> {
    if start.is_empty() {
        return Some(("empty (0 bytes)", "Export the mesh again as PLY."));
    }
    if let Some((_, known)) = SIGNATURES.iter().find(|(bytes, _)| start.starts_with(bytes)) {
        return Some(*known);
    }
    if is_binary_stl(start, total) {
        return Some(("an STL mesh (binary)", EXPORT));
    }
    let text = start.trim_ascii_start();
    if text.starts_with(b"solid") && contains(text, b"facet") {
        return Some(("an STL mesh (text)", EXPORT));
    }
    if text.starts_with(b"{") || text.starts_with(b"[") {
        return json(text);
    }
    if text.starts_with(b"<") {
        return Some(xml(text));
    }
    if text.starts_with(b"OFF") || text.starts_with(b"COFF") || text.starts_with(b"NOFF") {
        return Some(("an OFF mesh", EXPORT));
    }
    plain_text(text)
}

/// 80 bytes of free text, the number of triangles, 50 bytes for each. The length decides, because many writers begin
/// the free text with "solid" as a text STL does.
fn is_binary_stl(start: &[u8], total: u64) -> bool {
    match start.get(80..84) {
        Some(&[a, b, c, d]) => total == 84 + 50 * u64::from(u32::from_le_bytes([a, b, c, d])),
        _ => false,
    }
}

fn json(text: &[u8]) -> Option<Known> {
    let keys = [&b"\"asset\""[..], b"\"accessors\"", b"\"bufferViews\"", b"\"meshes\""];
    keys.iter().any(|key| contains(text, key)).then_some(("a glTF scene", EXPORT))
}

fn xml(text: &[u8]) -> Known {
    if contains(text, b"<COLLADA") {
        ("a COLLADA scene", EXPORT)
    } else if contains(text, b"<X3D") {
        ("an X3D scene", EXPORT)
    } else {
        ("an XML or HTML file", "Give the mesh as PLY.")
    }
}

/// MTL by the keyword of the first line that says something; PTS, PTX and XYZ by lines of numbers alone.
fn plain_text(text: &[u8]) -> Option<Known> {
    let says_something = |line: &&[u8]| !line.is_empty() && !line.starts_with(b"#");
    let line = text.split(|&b| b == b'\n' || b == b'\r').map(<[u8]>::trim_ascii).find(says_something)?;
    let word = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
    match word {
        b"newmtl" => Some(("a Wavefront material library", "Export the mesh that uses it as PLY.")),
        _ if is_number(word) => Some(("a text file of numbers (as PTS, PTX and XYZ point clouds are)", SCAN)),
        _ => None,
    }
}

fn is_number(word: &[u8]) -> bool {
    std::str::from_utf8(word).is_ok_and(|w| w.parse::<f64>().is_ok())
}

fn contains(text: &[u8], part: &[u8]) -> bool {
    text.windows(part.len()).any(|w| w == part)
}

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().and_then(|e| e.to_str()).is_some_and(|e| e.eq_ignore_ascii_case(extension))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(start: &[u8], name: &str) -> String {
        refusal(start, start.len() as u64, Path::new(name)).to_string()
    }

    #[test]
    fn a_binary_stl_that_begins_with_solid_is_an_stl() {
        let mut bytes = b"solid made by a scanner".to_vec();
        bytes.resize(80, b' ');
        bytes.extend(1u32.to_le_bytes());
        bytes.resize(84 + 50, 0);
        assert!(message(&bytes, "a.stl").contains("STL mesh (binary)"));
    }

    #[test]
    fn the_format_is_recognised_by_content_not_by_name() {
        assert!(message(b"# red\nnewmtl red\nKd 1 0 0\n", "scan.obj").contains("Wavefront material library"));
        assert!(message(b"glTF\x02\0\0\0", "scan.ply").contains("GLB"));
        assert!(message(b"LASF....", "scan.ply").contains("LAS"));
    }

    #[test]
    fn a_refusal_lists_the_supported_formats_and_what_to_do() {
        let text = message(b"Rar!....", "site.rar");
        assert!(text.contains("site.rar") && text.contains("reads PLY") && text.contains("Unpack it"), "{text}");
    }

    #[test]
    fn an_empty_file_and_noise_are_refused() {
        assert!(message(b"", "a.ply").contains("0 bytes"));
        assert!(message(&[0, 1, 2, 3], "a.dat").contains("does not know"));
        assert!(message(b"plywood is not a mesh", "a.ply").contains("does not begin with a line \"ply\""));
    }
}
