//! Spike: extract PACK OUT N.
use kilwa_formats::extract::*;
use kilwa_pack::Reader;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let reader = Reader::open(kilwa_pack::SliceSource(std::fs::read(&a[1]).unwrap())).unwrap();
    let out = std::path::Path::new(&a[2]);
    let output = Output::prepare(out, true).unwrap();
    let t = std::time::Instant::now();
    let request = Request {
        format: Format::Ply { ascii: false },
        max_error: None,
        max_triangles: a.get(3).map(|n| n.parse().unwrap()),
        region: None,
        window: WINDOW,
    };
    let e = extract(&reader, &request, &output, &|_, _| ()).unwrap();
    println!(
        "{} triangles, {} vertices, error {} m, {:.2} s",
        e.triangles,
        e.vertices,
        e.error,
        t.elapsed().as_secs_f64()
    );
}
