//! People edit `survey.toml`, also while an import runs: nothing of it is lost.

use crate::support::{Site, ptx_header, three_scans};
use kilwa_scan::import::{Options, Progress, Silent, import};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::Survey;
use std::cell::Cell;
use std::path::{Path, PathBuf};

/// Edits the file once, as soon as a station is in it.
struct Editing<'a> {
    file: PathBuf,
    edit: &'a dyn Fn(String) -> String,
    is_done: Cell<bool>,
}

impl<'a> Editing<'a> {
    fn new(survey: &Path, edit: &'a dyn Fn(String) -> String) -> Self {
        Self { file: survey.join("survey.toml"), edit, is_done: Cell::new(false) }
    }
}

impl Progress for Editing<'_> {
    fn update(&self, stage: &'static str, _: u64, _: u64) {
        let Ok(text) = std::fs::read_to_string(&self.file) else { return };
        if stage == "reading" && text.contains("[[station]]") && !self.is_done.replace(true) {
            std::fs::write(&self.file, (self.edit)(text)).unwrap();
        }
    }
}

#[test]
fn what_people_write_into_the_survey_during_an_import_is_kept() {
    let site = Site::new();
    let files = [three_scans(&site)];
    let edit = |text: String| {
        let text = text.replacen("name = \"three\"", "# by the sea\nname = \"tower\"", 1);
        format!("{text}\n[[control]]\nname = \"P1\"\nstation = \"tower\"\nat = [1, 2, 3]\n")
    };
    let progress = Editing::new(&site.survey(), &edit);
    let report = import(&site.survey(), &files, &Options::default(), &progress).unwrap();
    assert!(progress.is_done.get() && report.stations.len() == 3);
    let text = std::fs::read_to_string(site.survey().join("survey.toml")).unwrap();
    assert!(text.contains("# by the sea"), "{text}");
    let survey = Survey::open(&site.survey()).unwrap();
    let names: Vec<&str> = survey.stations.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["tower", "three-2", "three-3"]);
    assert_eq!(survey.controls.len(), 1);
    assert_eq!(site.samples("three")[0].position.x, 1.0, "the samples of the station that was renamed");
}

#[test]
fn an_import_stops_at_a_mistake_that_someone_writes_and_resumes() {
    let site = Site::new();
    let files = [three_scans(&site)];
    let edit = |text: String| format!("{text}\ntitel = 1\n");
    let progress = Editing::new(&site.survey(), &edit);
    let message = import(&site.survey(), &files, &Options::default(), &progress).unwrap_err().to_string();
    assert!(message.contains("survey.toml") && message.contains("titel"), "{message}");
    let path = site.survey().join("survey.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.ends_with("titel = 1\n"), "what was written is still there");
    std::fs::write(&path, text.replace("titel = 1\n", "")).unwrap();
    let resume = Options { resume: true, ..Options::default() };
    let report = import(&site.survey(), &files, &resume, &Silent).unwrap();
    assert_eq!((report.skipped.len(), report.stations.len()), (1, 2));
}

#[test]
fn an_import_never_replaces_the_samples_of_another_station() {
    let site = Site::new();
    let scan = |folder: &str, x: u32| {
        std::fs::create_dir_all(site.path(folder)).unwrap();
        [site.write(&format!("{folder}/scan1.ptx"), format!("{}{x} 2 3 0.5\n", ptx_header(1, 1, [0.0; 3])))]
    };
    let (a, b) = (scan("a", 1), scan("b", 7));
    import(&site.survey(), &a, &Options::default(), &Silent).unwrap();
    let path = site.survey().join("survey.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let text = text.replace("name = \"scan1\"", "name = \"nave\"").replace("stations/scan1", "./stations/Scan1");
    std::fs::rename(site.survey().join("stations/scan1.scan"), site.survey().join("stations/Scan1.scan")).unwrap();
    std::fs::write(&path, text).unwrap();
    import(&site.survey(), &b, &Options::default(), &Silent).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let names: Vec<&str> = survey.stations.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["nave", "scan1-2"]);
    assert_eq!([site.samples("Scan1")[0].position.x, site.samples("scan1-2")[0].position.x], [1.0, 7.0]);
}

#[test]
fn a_name_that_someone_gives_away_during_an_import_is_not_used_twice() {
    let site = Site::new();
    let files = [three_scans(&site)];
    // The second scan is being read, and would be three-2.
    let edit = |text: String| text.replacen("name = \"three\"", "name = \"three-2\"", 1);
    let progress = Editing::new(&site.survey(), &edit);
    let message = import(&site.survey(), &files, &Options::default(), &progress).unwrap_err().to_string();
    assert!(message.contains("three-2") && message.contains("--resume"), "{message}");
    let resume = Options { resume: true, ..Options::default() };
    import(&site.survey(), &files, &resume, &Silent).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let all: Vec<_> = survey.stations.iter().map(|s| (s.name.as_str(), s.scan.as_str())).collect();
    assert_eq!(
        all,
        [
            ("three-2", "stations/three.scan"),
            ("three-3", "stations/three-3.scan"),
            ("three-4", "stations/three-4.scan")
        ]
    );
}

/// What is where the lock should be may have been put there by others.
#[cfg(unix)]
#[test]
fn a_pipe_or_a_link_in_place_of_the_lock_is_refused_and_makes_no_file_elsewhere() {
    let site = Site::new();
    let file = site.write("a.ptx", format!("{}1 2 3 0.5\n", ptx_header(1, 1, [0.0; 3])));
    let lock = site.survey().join(".lock");
    std::fs::create_dir(site.survey()).unwrap();
    std::os::unix::fs::symlink(site.path("elsewhere"), &lock).unwrap();
    let refused = site.import(std::slice::from_ref(&file), ReadOptions::default()).unwrap_err().to_string();
    assert!(refused.contains(".lock") && !site.path("elsewhere").exists(), "{refused}");
    std::fs::remove_file(&lock).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&lock).status().unwrap().success());
    let refused = site.import(std::slice::from_ref(&file), ReadOptions::default()).unwrap_err().to_string();
    assert!(refused.contains(".lock"), "{refused}");
    std::fs::remove_file(&lock).unwrap();
    site.import(&[file], ReadOptions::default()).unwrap();
}
