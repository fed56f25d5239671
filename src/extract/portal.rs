//! Extracts for whoever asks `kilwa serve` for one (`kilwa_server::extracts`): the same meshes as those of `kilwa extract`.

use super::choose;
use super::format::{Format, Target};
use super::output::Output;
use super::stream;
use anyhow::Context;
use kilwa_pack::Reader;
use kilwa_server::extracts::{Detail, Extract, Failure, Format as Wanted, Pack, is_not_given};
use std::path::Path;

/// The share of the work that is done when all chunks are read; the rest is putting the file together.
const READ: f64 = 0.9;

/// Takes meshes out of packs.
pub(crate) struct ForPortal;

impl Extract for ForPortal {
    fn extract(
        &self,
        pack: &Pack,
        to: &Path,
        format: Wanted,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), Failure> {
        write(pack, to, format, detail, progress).map_err(|e| {
            let causes = || e.chain().filter_map(|cause| cause.downcast_ref::<std::io::Error>());
            if causes().any(no_room) {
                Failure::Full
            } else if causes().any(is_not_given) {
                Failure::Away
            } else {
                Failure::Other(format!("{e:#}"))
            }
        })
    }
}

fn no_room(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{QuotaExceeded, StorageFull};
    matches!(e.kind(), StorageFull | QuotaExceeded)
}

fn write(
    pack: &Pack,
    to: &Path,
    format: Wanted,
    detail: Detail,
    progress: &(dyn Fn(f64) + Sync),
) -> anyhow::Result<()> {
    let of_pack = || pack.to_string();
    let reader = Reader::open(pack.open()?).with_context(of_pack)?;
    let (error, triangles) = match detail {
        Detail::Whole => (None, None),
        Detail::Triangles(most) => (None, Some(most)),
        Detail::Error(metres) => (Some(metres), None),
    };
    let chosen = choose::choose(&reader, error, triangles, None).with_context(of_pack)?;
    let format = match format {
        Wanted::Ply => Format::Ply { ascii: false },
        Wanted::Glb => Format::Glb,
        Wanted::Obj => Format::Obj,
        Wanted::Stl => Format::Stl,
    };
    let target = Target::new(&reader, &chosen, None, format).with_context(of_pack)?;
    let mut encoder = format.encoder(&target);
    // Another server that uses the same cache may have made it meanwhile: the same bytes.
    let output = Output::prepare(to, true)?;
    let mut scratch = output.scratch()?;
    let told = |share: f64| progress(share * READ);
    let counts = stream::stream(&reader, &chosen, None, &mut *encoder, &mut scratch, &told).with_context(of_pack)?;
    anyhow::ensure!(counts.triangles > 0, "{pack}: it holds no triangle");
    output.write(|out| encoder.assemble(out, &mut scratch, counts))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_builder::{BuildOptions, Silent, build_pack};
    use kilwa_formats::RawMesh;
    use std::sync::Mutex;

    #[test]
    fn it_gives_the_file_of_kilwa_extract_and_tells_how_far_it_is() {
        let work = tempfile::tempdir().expect("a folder");
        let n = 60u32;
        let mesh = RawMesh {
            positions: (0..=n)
                .flat_map(|j| (0..=n).map(move |i| [f64::from(i), f64::from(j), f64::from((i * j) % 7) * 0.1]))
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
        for wanted in Wanted::ALL {
            for (detail, options) in [
                (Detail::Whole, None),
                (Detail::Triangles(2000), Some(("max_triangles", 2000.0))),
                (Detail::Error(0.3), Some(("max_error", 0.3))),
            ] {
                let made = work.path().join(format!("made.{}", wanted.ending()));
                let shares = Mutex::new(Vec::new());
                let told = |share: f64| shares.lock().expect("alone").push(share);
                ForPortal.extract(&Pack::here(&pack), &made, wanted, detail, &told).expect("makes it");
                let shares = shares.into_inner().expect("alone");
                assert!(shares.is_sorted() && shares.last() == Some(&READ), "{shares:?}");
                let by_hand = work.path().join(format!("by-hand.{}", wanted.ending()));
                let of = |name: &str| options.filter(|(n, _)| *n == name).map(|(_, v)| v);
                super::super::run(&super::super::Args {
                    pack: pack.clone(),
                    output: by_hand.clone(),
                    max_error: of("max_error"),
                    max_triangles: of("max_triangles").map(|n| n as u64),
                    region: None,
                    ascii: false,
                    force: true,
                    json: true,
                })
                .expect("extracts");
                assert!(
                    std::fs::read(&made).expect("reads") == std::fs::read(&by_hand).expect("reads"),
                    "{wanted:?} {detail:?}"
                );
            }
        }
        let Err(Failure::Other(why)) = ForPortal.extract(
            &Pack::here(&work.path().join("none.kilwa")),
            &work.path().join("x.ply"),
            Wanted::Ply,
            Detail::Whole,
            &|_| {},
        ) else {
            panic!("there is no such pack")
        };
        assert!(why.contains("none.kilwa"), "{why}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_told_apart() {
        let full = std::io::Error::from_raw_os_error(28);
        let wrapped = anyhow::Error::from(full).context("cannot write the scratch files beside the output");
        assert!(wrapped.chain().filter_map(|c| c.downcast_ref::<std::io::Error>()).any(no_room));
    }
}
