use kilwa_synth::scans::*;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let mut o = ScanOptions::new(a[2].parse().unwrap(), a[3].parse().unwrap());
    if a.len() > 4 { o.noise = a[4].parse().unwrap(); }
    let t = std::time::Instant::now();
    let r = write(&o, std::path::Path::new(&a[1]), &mut |d, t| eprint!("\r{d}/{t}   ")).unwrap();
    println!("{r:?} {:?}", t.elapsed());
}
