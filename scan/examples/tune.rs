use kilwa_scan::colour::*;
use kilwa_scan::photos::{self, Source};
use std::path::{Path, PathBuf};
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let survey = kilwa_scan::survey::Survey::open(Path::new(&a[3])).unwrap();
    let poses = PathBuf::from(&a[2]).join("sparse");
    let set =
        photos::read(Path::new(&a[2]), &photos::Options { poses: Some(&poses), stations: &survey.stations }).unwrap();
    let inputs: Vec<Input> = set
        .photos
        .iter()
        .filter_map(|p| {
            let Source::File(path) = &p.source else { return None };
            Some(Input { name: p.name.clone(), path: path.clone(), mask: None, camera: p.posed()?, exposure: None })
        })
        .collect();
    let bytes = std::fs::read(&a[1]).unwrap();
    let reader = kilwa_pack::Reader::open(kilwa_pack::SliceSource(bytes)).unwrap();
    let o = Options { memory: 2 << 30, threads: 2, scratch: std::env::temp_dir() };
    let t = std::time::Instant::now();
    let (c, r) = colour(&reader, &inputs, &o, &kilwa_scan::import::Silent).unwrap();
    let out = kilwa_formats::extract::Output::prepare(Path::new(&a[4]), true).unwrap();
    kilwa_formats::extract::extract_repainted(
        &reader,
        kilwa_formats::extract::Format::of(Path::new(&a[4]), false).unwrap(),
        &c,
        &out,
        &|_, _| (),
    )
    .unwrap();
    println!(
        "{} photos, coloured {:.3}, places {}, brightness {:.3}, scratch {} MB, {:.1} s",
        inputs.len(),
        r.coloured as f64 / r.vertices as f64,
        r.places,
        r.brightness,
        r.scratch >> 20,
        t.elapsed().as_secs_f64()
    );
}
