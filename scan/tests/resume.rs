//! An import that is stopped goes on where it was, and gives the same survey.

use crate::support::{Site, ptx_header, three_scans};
use kilwa_scan::ScanError;
use kilwa_scan::import::{Options, Progress, Silent, import};
use kilwa_scan::survey::Survey;
use std::cell::Cell;

/// Stops after so many reports.
struct StopAfter(Cell<u32>);

impl Progress for StopAfter {
    fn update(&self, _: &'static str, _: u64, _: u64) {
        self.0.set(self.0.get().saturating_sub(1));
    }

    fn is_stopped(&self) -> bool {
        self.0.get() == 0
    }
}

#[test]
fn an_import_stopped_anywhere_and_resumed_gives_the_same_survey() {
    let site = Site::new();
    let file = three_scans(&site);
    let files = [file];
    let whole = site.path("whole");
    import(&whole, &files, &Options::default(), &Silent).unwrap();
    let text = std::fs::read_to_string(whole.join("survey.toml")).unwrap();
    let resume = Options { resume: true, ..Options::default() };
    for stop in [1, 5, 6, 7, 8] {
        let folder = site.path(&format!("stopped{stop}"));
        let stopped = import(&folder, &files, &Options::default(), &StopAfter(Cell::new(stop)));
        assert!(matches!(stopped, Err(ScanError::Stopped)), "{stop}");
        // As a killed process leaves it.
        std::fs::create_dir_all(folder.join("stations")).unwrap();
        std::fs::write(folder.join("stations/.kilwa-abcdef.part"), "half").unwrap();
        let before = Survey::open(&folder).map_or(0, |survey| survey.stations.len());
        let report = import(&folder, &files, &resume, &Silent).unwrap();
        assert_eq!((report.skipped.len(), report.stations.len()), (before, 3 - before));
        assert_eq!(std::fs::read_to_string(folder.join("survey.toml")).unwrap(), text);
        let names = |folder: &std::path::Path| {
            let mut names: Vec<_> =
                std::fs::read_dir(folder.join("stations")).unwrap().map(|e| e.unwrap().file_name()).collect();
            names.sort();
            names
        };
        assert_eq!(names(&folder), names(&whole));
        for name in names(&whole) {
            let read = |folder: &std::path::Path| std::fs::read(folder.join("stations").join(&name)).unwrap();
            assert!(read(&folder) == read(&whole), "{name:?}");
        }
    }
}

#[test]
fn a_scan_in_the_survey_is_not_silently_imported_again() {
    let site = Site::new();
    let files = [site.write("a.ptx", format!("{}1 2 3 0.5\n", ptx_header(1, 1, [0.0; 3])))];
    import(&site.survey(), &files, &Options::default(), &Silent).unwrap();
    let message = import(&site.survey(), &files, &Options::default(), &Silent).unwrap_err().to_string();
    assert!(message.contains("a.ptx: scan 1 is already in the survey, as station a; use --resume"), "{message}");
    // The same name, another content: another station.
    let files = [site.write("a.ptx", format!("{}1 2 4 0.5\n", ptx_header(1, 1, [0.0; 3])))];
    let report = import(&site.survey(), &files, &Options::default(), &Silent).unwrap();
    assert_eq!(report.stations[0].station.name, "a-2");
}
