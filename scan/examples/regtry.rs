fn main() {
    let args: Vec<String> = std::env::args().collect();
    let folder = std::path::Path::new(&args[1]);
    let survey = kilwa_scan::survey::Survey::open(folder).unwrap();
    let options = kilwa_scan::register::Options::default();
    let found = kilwa_scan::register::register(folder, &survey, &options, &kilwa_scan::import::Silent).unwrap();
    println!("{}", serde_json::to_string(&found).unwrap());
}
