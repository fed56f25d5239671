use glam::{DMat3, DMat4, DVec3};
use kilwa_scan_core::Pose;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let folder = std::path::Path::new(&args[1]);
    let survey = kilwa_scan::survey::Survey::open(folder).unwrap();
    if let Some(path) = args.get(2) {
    let text = std::fs::read_to_string(path).unwrap();
    let mut poses = std::collections::HashMap::new();
    let (mut name, mut position) = (String::new(), DVec3::ZERO);
    let numbers = |line: &str| -> Vec<f64> {
        line.split('=').nth(1).unwrap().replace(['[', ']'], " ").split(',').map(|v| v.trim().parse().unwrap()).collect()
    };
    for line in text.lines() {
        if line.starts_with("name") { name = line.split('"').nth(1).unwrap().to_owned(); }
        if line.starts_with("position") { position = DVec3::from_slice(&numbers(line)); }
        if line.starts_with("rotation") {
            let r = numbers(line);
            let m = DMat3::from_cols_array(&[r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]]);
            let m = DMat4::from_translation(position) * DMat4::from_mat3(m);
            poses.insert(name.clone(), Pose::from_matrix(m).unwrap().0);
        }
    }
    let found = kilwa_scan::register::trial(folder, &survey, &|n| poses[n]);
    println!("{}", serde_json::to_string(&found).unwrap());
    return;
    }
    let options = kilwa_scan::register::Options::default();
    let found = kilwa_scan::register::register(folder, &survey, &options, &kilwa_scan::import::Silent).unwrap();
    println!("{}", serde_json::to_string(&found).unwrap());
}
