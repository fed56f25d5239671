//! Makes the mesh of a pack on request: the same file as `kilwa extract` writes.

use super::{Detail, Failure, Format, Pack, is_not_given};
use kilwa_formats::extract::{self, ExtractError, Output, Request};
use kilwa_pack::Reader;
use std::error::Error;
use std::io;
use std::path::Path;

/// The share of the work that is done when all chunks are read; the rest is putting the file together.
const READ: f64 = 0.9;

/// Write the mesh of `pack` to `to`; `progress` is called with the completed share, 0 to 1.
///
/// # Errors
/// [`Failure`]; no files are left then.
pub(super) fn extract(
    pack: &Pack,
    to: &Path,
    format: Format,
    detail: Detail,
    progress: &(dyn Fn(f64) + Sync),
) -> Result<(), Failure> {
    let source = pack.open().map_err(|e| failure(pack, &e))?;
    let reader = Reader::open(source).map_err(|e| failure(pack, &e))?;
    let (max_error, max_triangles) = match detail {
        Detail::Whole => (None, None),
        Detail::Triangles(max) => (None, Some(max)),
        Detail::Error(metres) => (Some(metres), None),
    };
    let format = match format {
        Format::Ply => extract::Format::Ply { ascii: false },
        Format::Glb => extract::Format::Glb { compressed: false },
        Format::Obj => extract::Format::Obj,
        Format::Stl => extract::Format::Stl,
    };
    let request = Request { format, max_error, max_triangles, region: None, window: extract::WINDOW };
    let on_progress = |done: u64, all: u64| progress(READ * done as f64 / all.max(1) as f64);
    // Another server that uses the same cache may have made it meanwhile: the same bytes.
    let written =
        Output::prepare(to, true).and_then(|output| extract::extract(&reader, &request, &output, &on_progress));
    written.map(drop).map_err(|e: ExtractError| failure(pack, &e))
}

/// Why there is no file: the reader sees whether trying again may help.
fn failure(pack: &Pack, error: &(dyn Error + 'static)) -> Failure {
    let causes = || std::iter::successors(Some(error), cause);
    let mut system = causes().filter_map(|cause| cause.downcast_ref::<io::Error>());
    if system.clone().any(no_room) {
        Failure::Full
    } else if system.any(is_not_given) {
        Failure::Away
    } else {
        let texts: Vec<String> = causes().map(ToString::to_string).collect();
        Failure::Other(format!("{pack}: {}", texts.join(": ")))
    }
}

fn cause<'e>(error: &&'e (dyn Error + 'static)) -> Option<&'e (dyn Error + 'static)> {
    (**error).source()
}

fn no_room(e: &io::Error) -> bool {
    use io::ErrorKind::{QuotaExceeded, StorageFull};
    matches!(e.kind(), StorageFull | QuotaExceeded)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_builder::{BuildOptions, Silent, build_pack};
    use kilwa_formats::RawMesh;
    use std::sync::Mutex;

    #[test]
    fn the_mesh_equals_the_file_of_kilwa_extract_and_progress_is_reported() {
        let work = tempfile::tempdir().expect("a folder");
        let n = 60u32;
        let mesh = RawMesh {
            positions: (0..=n)
                .flat_map(|j| {
                    (0..=n).map(move |i| glam::DVec3::new(f64::from(i), f64::from(j), f64::from((i * j) % 7) * 0.1))
                })
                .collect(),
            triangles: (0..n)
                .flat_map(|j| (0..n).map(move |i| i + j * (n + 1)))
                .flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]])
                .collect(),
            ..RawMesh::default()
        };
        let pack = work.path().join("square.kilwa");
        std::fs::write(&pack, build_pack(mesh, &BuildOptions::default(), &Silent).expect("builds").bytes)
            .expect("writes");
        for wanted in Format::ALL {
            for (detail, max_error, max_triangles) in [
                (Detail::Whole, None, None),
                (Detail::Triangles(2000), None, Some(2000)),
                (Detail::Error(0.3), Some(0.3), None),
            ] {
                let made = work.path().join(format!("made.{}", wanted.ending()));
                let shares = Mutex::new(Vec::new());
                let on_progress = |share: f64| shares.lock().expect("alone").push(share);
                super::extract(&Pack::here(&pack), &made, wanted, detail, &on_progress).expect("makes it");
                let shares = shares.into_inner().expect("alone");
                assert!(shares.is_sorted() && shares.last() == Some(&READ), "{shares:?}");
                let by_hand = work.path().join(format!("by-hand.{}", wanted.ending()));
                let format = extract::Format::of(&by_hand, false).expect("known");
                let reader = Reader::open(Pack::here(&pack).open().expect("opens")).expect("a pack");
                let output = Output::prepare(&by_hand, true).expect("writable");
                let request = Request { format, max_error, max_triangles, region: None, window: extract::WINDOW };
                extract::extract(&reader, &request, &output, &|_, _| ()).expect("extracts");
                assert!(
                    std::fs::read(&made).expect("reads") == std::fs::read(&by_hand).expect("reads"),
                    "{wanted:?} {detail:?}"
                );
            }
        }
        let none = Pack::here(&work.path().join("none.kilwa"));
        let made = super::extract(&none, &work.path().join("x.ply"), Format::Ply, Detail::Whole, &|_| {});
        let Err(Failure::Other(why)) = made else { panic!("there is no such pack") };
        assert!(why.contains("none.kilwa"), "{why}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_distinguished_from_other_failures() {
        let pack = Pack::here(Path::new("none.kilwa"));
        let full = ExtractError::Scratch(io::Error::from_raw_os_error(28));
        assert_eq!(failure(&pack, &full), Failure::Full);
    }
}
