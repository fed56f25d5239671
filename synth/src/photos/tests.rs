//! Properties of simulated photographs.

use super::*;
use std::path::Path;
use std::time::Instant;

#[test]
#[ignore = "for looking"]
fn look() {
    let mut options = PhotoOptions::new(16, (320, 240));
    options.panoramas = 2;
    let start = Instant::now();
    let session = Session::new(&options).unwrap();
    println!("session {:?}", start.elapsed());
    let out = Path::new("/tmp/look");
    let _ = std::fs::remove_dir_all(out);
    let start = Instant::now();
    let report = write(&options, out, &mut |_, _| {}).unwrap();
    println!("{:?} {report:?}", start.elapsed());
    for photo in session.photos() {
        println!("{} {:?} {:?} ev {:.2}", photo.name, photo.carrier, photo.position, photo.exposure.ev);
    }
}
