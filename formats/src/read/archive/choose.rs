//! Which entry of an archive is the mesh: the only one with the extension of a mesh, or `scene.gltf` at the top, which is how Sketchfab names its
//! glTF. Nothing else is preferred: several meshes may be several models, levels of detail, or the same model in several formats.

use super::directory::{Archive, Entry, shown};
use crate::read::{MESH_EXTENSIONS, ReadError};
use kilwa_pack::plural::counted;

/// Extensions of archives.
const NESTED: [&str; 10] = ["zip", "7z", "rar", "tar", "gz", "tgz", "bz2", "xz", "zst", "zipx"];
/// Extensions of models and scans that are not read.
const OTHERS: [&str; 18] = [
    "fbx", "dae", "blend", "max", "ma", "mb", "3ds", "abc", "c4d", "x3d", "wrl", "off", "usd", "usda", "usdc", "las",
    "laz", "e57",
];
/// The name of a glTF of Sketchfab.
const SCENE: &str = "scene.gltf";
/// Names in a message.
const SHOWN: usize = 10;

/// The number of the mesh among the files of the archive.
///
/// # Errors
/// [`ReadError`] if there is none that is read, or several.
pub(super) fn mesh(archive: &Archive<'_>) -> Result<usize, ReadError> {
    let is_mesh = |entry: &Entry| entry.is_content() && MESH_EXTENSIONS.contains(&entry.extension().as_str());
    let found: Vec<usize> = (0..).zip(archive.files()).filter(|(_, entry)| is_mesh(entry)).map(|(i, _)| i).collect();
    match found.as_slice() {
        [one] => Ok(*one),
        [] => Err(none(archive)),
        several => {
            let scene = several.iter().find(|i| archive.files()[**i].name.eq_ignore_ascii_case(SCENE));
            scene.copied().ok_or_else(|| {
                let names = names(several.iter().map(|i| &archive.files()[*i]));
                let way_out = "Unpack it and give the mesh that is meant; if all belong together, give their folder";
                archive.needs(format!("contains {} meshes: {names}", several.len()), way_out)
            })
        }
    }
}

/// The error for an archive in the archive.
pub(super) fn nested(archive: &Archive<'_>, name: &str) -> ReadError {
    let needs = format!("contains another archive instead of a mesh, \"{}\", which is not opened", shown(name));
    archive.needs(needs, "Unpack it and the archive in it, and give the mesh")
}

/// The error for an archive without a mesh, by what it has instead.
fn none(archive: &Archive<'_>) -> ReadError {
    const EXPORT: &str = "Open it in MeshLab, Blender or CloudCompare and export it as PLY (binary, with colours)";
    let content = || archive.files().iter().filter(|entry| entry.is_content());
    let first = |extensions: &[&str]| content().find(|entry| extensions.contains(&entry.extension().as_str()));
    if content().any(|entry| entry.name.starts_with("3D/") && entry.extension() == "model") {
        let (file, way_out) = (archive.path().to_owned(), "Open it in MeshLab or Blender and export it as PLY.");
        return ReadError::Format { file, what: "a 3MF model, which is a ZIP archive", way_out };
    }
    let is_usdz = archive.path().extension().is_some_and(|extension| extension.eq_ignore_ascii_case("usdz"));
    if is_usdz && first(&["usd", "usda", "usdc"]).is_some() {
        let (file, way_out) = (archive.path().to_owned(), "Open it in Blender and export it as PLY.");
        return ReadError::Format { file, what: "a USDZ scene, which is a ZIP archive", way_out };
    }
    if let Some(other) = first(&OTHERS) {
        let needs = format!("contains no mesh in a format that is read, but \"{}\"", other.shown());
        let way_out = "If it comes from Sketchfab, choose glTF when downloading; otherwise unpack it, open the model in Blender or MeshLab and export it as PLY";
        return archive.needs(needs, way_out);
    }
    if let Some(other) = first(&NESTED) {
        return nested(archive, &other.name);
    }
    let files = counted(content().count() as u64, "file", "files");
    let names = names(content());
    let list = if names.is_empty() { String::new() } else { format!(": {names}") };
    archive.needs(format!("contains no mesh ({files}{list})"), EXPORT)
}

/// The first names in a message.
fn names<'e>(entries: impl Iterator<Item = &'e Entry>) -> String {
    let mut names: Vec<String> = entries.take(SHOWN + 1).map(Entry::shown).collect();
    if names.len() > SHOWN {
        names.truncate(SHOWN);
        names.push("…".to_owned());
    }
    names.join(", ")
}
