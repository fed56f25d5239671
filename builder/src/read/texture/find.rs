//! Finds the files that a mesh file names: written on another system, moved to another folder, in another case.

use std::path::{Path, PathBuf};

/// The file that `name` means, seen from `folder`: as it is written (with `\` as `/`), else by its last part alone in
/// the folder, each time with the case of letters ignored where nothing fits exactly. The first of several in order.
pub fn find_file(folder: &Path, name: &str) -> Option<PathBuf> {
    let name = name.trim().trim_matches('"').replace('\\', "/");
    if name.is_empty() {
        return None;
    }
    let exact = folder.join(&name);
    if exact.is_file() {
        return Some(exact);
    }
    let last = name.rsplit('/').next().unwrap_or(&name);
    ignoring_case(folder, &name).or_else(|| ignoring_case(folder, last))
}

/// Go down part by part; where a part does not exist, take the entry that differs in case only.
fn ignoring_case(folder: &Path, name: &str) -> Option<PathBuf> {
    let mut here = if name.starts_with('/') { PathBuf::from("/") } else { folder.to_owned() };
    for part in name.split('/').filter(|p| !p.is_empty() && *p != ".") {
        let exact = here.join(part);
        here = if part == ".." || exact.exists() {
            exact
        } else {
            let lower = part.to_lowercase();
            let entries = std::fs::read_dir(&here).ok()?;
            let fits = |path: &PathBuf| path.file_name().is_some_and(|n| n.to_string_lossy().to_lowercase() == lower);
            entries.filter_map(|entry| entry.ok().map(|e| e.path())).filter(fits).min()?
        };
    }
    here.is_file().then_some(here)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_systems_cases_and_folders_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let maps = folder.path().join("Maps");
        std::fs::create_dir(&maps).unwrap();
        let file = maps.join("Wall Nord.JPG");
        std::fs::write(&file, b"x").unwrap();
        std::fs::write(folder.path().join("plain.png"), b"x").unwrap();
        for name in ["Maps/Wall Nord.JPG", "maps\\wall nord.jpg", ".\\MAPS\\Wall Nord.jpg", "\"Maps/Wall Nord.JPG\""] {
            assert_eq!(find_file(folder.path(), name).unwrap().canonicalize().unwrap(), file.canonicalize().unwrap());
        }
        for name in ["C:\\Users\\scan\\Plain.png", "/home/scan/plain.png", "plain.png", "PLAIN.PNG"] {
            assert!(find_file(folder.path(), name).unwrap().ends_with("plain.png"), "{name}");
        }
        for name in ["", " ", "none.png", "Maps", ".."] {
            assert_eq!(find_file(folder.path(), name), None, "{name}");
        }
    }
}
