use super::*;
use kilwa_scan::import::{Options, Silent, import};
use std::fmt::Write as _;

/// A survey with one station, `tower`, that sees a wall 3 m away.
fn survey() -> (tempfile::TempDir, Survey) {
    let dir = tempfile::tempdir().unwrap();
    let (columns, rows) = (900, 40);
    let mut ptx = format!("{columns}\n{rows}\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    for column in 0..columns {
        for row in 0..rows {
            let (y, z) = (3.0 - f64::from(column) / 150.0, f64::from(row) / 20.0 - 1.0);
            writeln!(ptx, "3 {y:.4} {z:.4} 0.5").unwrap();
        }
    }
    let file = dir.path().join("tower.ptx");
    std::fs::write(&file, ptx).unwrap();
    let folder = dir.path().join("survey");
    import(&folder, &[file], &Options::default(), &Silent).unwrap();
    let survey = Survey::open(&folder).unwrap();
    (dir, survey)
}

/// A station at a place with standard deviations of x, y and z and of all rotations.
fn placed(name: &str, placement: Placement, at: [f64; 3], metres: [f64; 3], radians: f64) -> Placed {
    let mut covariance = [[0.0; 6]; 6];
    for k in 0..3 {
        covariance[k][k] = radians * radians;
        covariance[k + 3][k + 3] = metres[k] * metres[k];
    }
    let rotation = [1.0, 0.0, 0.0, 0.0];
    Placed {
        name: name.to_owned(),
        placement,
        rotation,
        translation: at,
        covariance,
        stated: None,
        scan: String::new(),
    }
}

fn link(a: &str, b: &str, residual: f64, samples: u64) -> Link {
    let stations = [a.to_owned(), b.to_owned()];
    Link { stations, overlap: 0.456, samples, residual, contradicted: 0.012, sigma: Some([0.0004, 1e-4]) }
}

fn found() -> Registration {
    let candidate = |matched_with: &str| Candidate {
        matched_with: matched_with.to_owned(),
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation: [1.0, -2.5, 0.0],
        overlap: 0.31,
        agreement: 0.9,
        contradicted: 0.0,
        residual: 0.0042,
    };
    let refused = |name: &str| Unplaced {
        scan: String::new(),
        name: name.to_owned(),
        reason: "it fits hall in 2 different poses".to_owned(),
        candidates: ["hall", "yard <b>"].map(candidate).to_vec(),
        remedy: "scan from the door & register again".to_owned(),
    };
    Registration {
        stations: vec![
            placed("hall", Placement::Anchor, [0.0; 3], [0.0; 3], 0.0),
            placed("yard <b>", Placement::Surface, [10.0, 0.0, 0.0], [0.002, 0.001, 0.001], 2e-4),
            placed("room", Placement::Surface, [10.0, 8.0, 0.5], [0.0005, 0.0005, 0.0005], 1e-4),
        ],
        unplaced: vec![refused("tower"), refused("lost")],
        links: vec![
            link("hall", "room", 0.0011, 90),
            link("hall", "yard <b>", 0.0101, 12_345),
            link("room", "yard <b>", 0.001, 5000),
        ],
        weakest_chain: ["hall", "room", "yard <b>"].map(str::to_owned).to_vec(),
        notes: vec!["the pose of <b> is not used".to_owned()],
        ..Registration::empty()
    }
}

fn page() -> String {
    let (dir, survey) = survey();
    html(&dir.path().join("survey"), &survey, &found()).unwrap()
}

#[test]
fn the_report_sums_up_and_lists_stations_and_links_worst_first() {
    let page = page();
    let summary = "3 of 5 stations are placed, 2 are not. The least certain is yard &lt;b&gt;, with standard deviations of 1.41\u{a0}mm (position) and 0.011° (rotation).";
    assert!(page.contains(summary), "{page}");
    assert!(page.contains("Note:</strong> the pose of &lt;b&gt; is not used.</p>"), "{page}");
    assert!(
        page.contains("<td class=\"word\">anchor</td>")
            && page.contains("<td>10.0000</td><td>8.0000</td><td>0.5000</td><td>0.50</td>")
    );
    let table = page.split("<h2>Links</h2>").nth(1).unwrap();
    let at = |text: &str| table.find(text).unwrap_or_else(|| panic!("{text} in {table}"));
    assert!(
        at("<td>10.1</td><td>12,345</td><td>46 %</td><td>1.2 %</td><td>0.40</td>") < at("<td>1.10</td>"),
        "{table}"
    );
    assert!(at("<td>1.10</td>") < at("<td>1.00</td>"));
}

#[test]
fn the_plan_shows_ellipses_links_and_the_weakest_chain() {
    let page = page();
    let plan = page.split("<svg class=\"plan\"").nth(1).unwrap().split("</svg>").next().unwrap();
    assert_eq!(plan.matches("class=\"chain\"").count(), 2);
    assert_eq!(plan.matches("class=\"link ").count(), 3);
    assert!(
        plan.contains("class=\"link grade-3 samples-2\"") && plan.contains("class=\"link grade-0 samples-0\""),
        "{plan}"
    );
    // 720 units are 11 m; the longer semi-axis of yard, 4.9 mm, is at most 6 % of that: enlarged 100 times.
    assert!(page.contains("95 % confidence regions of the positions, enlarged 100 times"), "{page}");
    assert_eq!(plan.matches("<ellipse").count(), 2, "the anchor has none");
    let ellipse = plan.split("<ellipse").nth(1).unwrap();
    assert!(ellipse.contains("rx=\"32.0\" ry=\"16.0\""), "{ellipse}");
    // North is up: what lies at larger y is drawn higher.
    let y = |name: &str| {
        let (_, mark) = plan.split_once(&format!("<title>{name} (")).unwrap();
        mark.split("<circle")
            .nth(1)
            .unwrap()
            .split("cy=\"")
            .nth(1)
            .unwrap()
            .split('"')
            .next()
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    assert!(y("room") < y("yard &lt;b&gt;"));
}

#[test]
fn grades_of_residuals_are_distinguished_by_more_than_colour() {
    for grade in 1..4 {
        let rule = STYLE.split(&format!(".grade-{grade} {{")).nth(1).unwrap().split('}').next().unwrap();
        assert!(rule.contains("stroke-dasharray"), "{rule}");
    }
    let page = page();
    let legend = page.split("<ul class=\"legend\">").nth(1).unwrap().split("</ul>").next().unwrap();
    for text in ["residual to 1.10 mm (the median)", "to 1.65 mm", "to 2.20 mm", "above 2.20 mm"] {
        assert!(legend.contains(text), "{legend}");
    }
    let row = page.split("<td class=\"grade\">").nth(1).unwrap();
    assert!(row.contains("grade-3") && row.split("</tr>").next().unwrap().contains("<td>10.1</td>"), "{row}");
}

#[test]
fn an_ellipse_lies_along_the_less_certain_direction() {
    let mut station = placed("a", Placement::Surface, [0.0; 3], [0.001; 3], 0.0);
    let (long, short, _) = ellipse(&station).unwrap();
    assert!((long - WITHIN_95 * 0.001).abs() < 1e-12 && (short - long).abs() < 1e-12);
    // Certain across the diagonal of x and y.
    station.covariance[3][4] = 1e-6;
    station.covariance[4][3] = 1e-6;
    let (long, short, angle) = ellipse(&station).unwrap();
    assert!((long - WITHIN_95 * 2e-6_f64.sqrt()).abs() < 1e-12 && short < 1e-9);
    assert!((angle - std::f64::consts::FRAC_PI_4).abs() < 1e-12);
}

#[test]
fn stations_that_were_not_placed_have_their_reason_picture_and_candidates() {
    let page = page();
    assert!(page.contains("</strong> it fits hall in 2 different poses.</p>"));
    assert!(page.contains("</strong> scan from the door &amp; register again.</p>"));
    let data = page.split("data:image/jpeg;base64,").nth(1).unwrap().split('"').next().unwrap();
    let picture = image::load_from_memory(&STANDARD.decode(data).unwrap()).unwrap();
    assert_eq!((picture.width(), picture.height()), (450, 20), "every second cell: at most 800 pixels");
    assert!(page.contains("There is no picture of this station: "), "`lost` is not in the survey");
    assert!(page.contains("<tr><th scope=\"row\"><bdi>hall</bdi></th>"));
    assert!(page.contains("<td>1.0000</td><td>−2.5000</td><td>0.0000</td><td>90.0°</td><td>31 %</td><td>90 %</td><td>0 %</td><td>4.20</td>"), "{page}");
}

#[test]
fn the_page_is_self_contained_and_escapes_names() {
    let page = page();
    assert!(page.starts_with("<!doctype html>") && !page.contains("<b>") && page.contains("yard &lt;b&gt;"));
    for loads in ["<script", "<link", "http:", "https:", "@import", "url("] {
        assert!(!page.contains(loads), "{loads}");
    }
    assert!(page.contains("prefers-color-scheme: dark") && page.contains("@media print"));
}

#[test]
fn a_survey_without_a_single_pose_has_no_plan() {
    let (dir, survey) = survey();
    let none = Registration { unplaced: found().unplaced, ..Registration::empty() };
    let page = html(&dir.path().join("survey"), &survey, &none).unwrap();
    assert!(
        page.contains("None of the 2 stations could be placed.") && !page.contains("<svg class=\"plan\""),
        "{page}"
    );
}

#[test]
fn numbers_are_rounded_to_their_significant_digits() {
    let lengths = [0.0, 0.000_012_3, 0.000_56, 0.001_234, 0.0456, 1.5].map(millimetres);
    assert_eq!(lengths, ["0", "0.012", "0.56", "1.23", "45.6", "1500"]);
    assert_eq!([0.0, 1e-5, 1e-3, 0.1].map(degrees), ["0", "0.0006", "0.057", "5.73"]);
    assert_eq!([0.0, 0.004, 0.0996, 1.0].map(percent), ["0 %", "0.4 %", "10 %", "100 %"]);
    assert_eq!(coordinate(-0.000_01), "0.0000");
}
