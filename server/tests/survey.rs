//! A survey as it is served: its pages, pictures and parts of pictures; what is kept, what is damaged, and what is not given out.

use crate::common::{Answer, ask, get, page};
use axum::Router;
use axum::http::StatusCode;
use kilwa_scan::import::{Options, Silent, import};
use kilwa_scan::mask::{self, MaskReader, Recipe, Request, make};
use kilwa_scan::panorama::{Show, mask_color, range_color, render};
use kilwa_scan::register::{Candidate, Link, Placed, Placement, Registration, Unplaced};
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::Survey;
use kilwa_server::{Catalogue, SITE_FILE, Site, SiteFile, Surveyed, app};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A room of 6 × 6 × 3 m as a PTX scan from its middle, which is `at`; with colours or without.
pub(crate) fn room(columns: u32, rows: u32, at: [f64; 2], has_color: bool) -> String {
    let [x, y] = at;
    let pose = format!("1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} 0 1\n");
    let mut text = format!("{columns}\n{rows}\n{x} {y} 0\n1 0 0\n0 1 0\n0 0 1\n{pose}");
    for column in 0..columns {
        for row in 0..rows {
            let azimuth = f64::from(column) * std::f64::consts::TAU / f64::from(columns);
            let elevation = (f64::from(row) / f64::from(rows) - 0.5) * 2.4;
            let ray = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
            let walls = ray.iter().zip([3.0, 3.0, 1.5]).map(|(d, half): (&f64, f64)| half / d.abs());
            let range = walls.fold(f64::INFINITY, f64::min);
            let [x, y, z] = ray.map(|d| d * range);
            write!(text, "{x:.4} {y:.4} {z:.4} {:.3}", 1.0 / range).unwrap();
            // Another colour for every cell.
            let color = [row % 256, column % 256, column / 256 * 20].map(|c| c.to_string()).join(" ");
            if has_color {
                write!(text, " {color}").unwrap();
            }
            text.push('\n');
        }
    }
    text
}

/// Two stations, `west` without colours, `east` with; a folder around them.
pub(crate) fn survey() -> (tempfile::TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("survey");
    add(&folder, "west", &room(60, 40, [0.0, 0.0], false));
    add(&folder, "east", &room(60, 40, [8.0, 1.0], true));
    (dir, folder)
}

pub(crate) fn add(folder: &Path, name: &str, ptx: &str) {
    let file = folder.with_file_name(format!("{name}.ptx"));
    std::fs::write(&file, ptx).unwrap();
    import(folder, &[file], &Options::default(), &Silent).unwrap();
}

pub(crate) fn masked(folder: &Path, name: &str, limits: [f32; 2], stations: &[&str]) {
    let stations = stations.iter().map(|s| (*s).to_owned()).collect();
    let request = Request { name: name.to_owned(), recipe: Recipe::Intensity(limits), stations };
    make(folder, &request, &Silent).unwrap();
}

pub(crate) fn serve(folder: &Path) -> (Router, Arc<Surveyed>) {
    let mut site = Site::new(Catalogue::open(folder).unwrap(), page());
    let surveyed = Arc::new(Surveyed::open(folder).unwrap());
    site.survey = Some(Arc::clone(&surveyed));
    (app(site), surveyed)
}

/// Change `survey.toml`.
pub(crate) fn edit(folder: &Path, change: impl FnOnce(String) -> String) {
    let file = folder.join("survey.toml");
    let text = change(std::fs::read_to_string(&file).unwrap());
    std::fs::write(&file, text).unwrap();
}

/// Width, height and pixels of a PNG.
fn pixels(png: &Answer) -> (u32, u32, Vec<u8>) {
    assert_eq!((png.status, png.header("content-type")), (StatusCode::OK, "image/png"), "{}", png.text());
    let mut reader = png::Decoder::new(std::io::Cursor::new(&png.body)).read_info().unwrap();
    let mut out = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut out).unwrap();
    out.truncate(info.buffer_size());
    (info.width, info.height, out)
}

#[tokio::test]
async fn the_plan_and_the_list_show_every_station() {
    let (_dir, folder) = survey();
    edit(&folder, |text| {
        let text = text.replacen("version = 1", "version = 1\ntitle = \"Fort <east>\"\ncrs = \"EPSG:32737\"", 1);
        let controls = "[[control]]\nname = \"P1\"\nat = [4.0, 3.0, 0.0]\n\
            [[control]]\nname = \"P2\"\nstation = \"east\"\nat = [-1.0, 0.0, 0.0]\n";
        let photograph =
            "[[photograph]]\nfile = \"a.jpg\"\nrotation = [1.0, 0.0, 0.0, 0.0]\ntranslation = [1.0, 1.0, 1.0]\n";
        format!("{text}\n{controls}{photograph}")
    });
    let (app, _) = serve(&folder);
    let a = get(&app, "/").await;
    let html = a.text();
    assert_eq!(a.status, StatusCode::OK, "{html}");
    assert!(
        html.contains("Fort &lt;east&gt;") && !html.contains("<east>") && html.contains("2 stations · 4,800 samples")
    );
    for name in ["west", "east"] {
        assert!(html.contains(&format!("href=\"/stations/{name}/\"")), "{name} in the list");
        assert!(html.contains(&format!("<a href=\"#station-{name}\" class=\"station\"")), "{name} on the plan");
    }
    assert!(html.contains("8.000; 1.000; 0.000 m") && html.contains(">90.0°<") && html.contains("60 × 40"), "{html}");
    assert!(
        html.contains("<title>P1</title>")
            && html.contains("<title>P2</title>")
            && html.contains("class=\"photograph\"")
    );
    assert!(html.contains(">N</text>"), "up is north in a known system");
    assert!(!html.contains("style=") && !html.contains("onclick"), "nothing that the policy forbids");
    let plan = html.split("<image href=\"").nth(1).unwrap().split('"').next().unwrap();
    let (width, height, gray) = pixels(&get(&app, plan).await);
    assert!(width == 300 && height < width, "the rooms lie side by side: {width} × {height}");
    let dark = gray.iter().skip(1).step_by(2).filter(|alpha| **alpha > 0).count();
    assert!(dark > 200, "{dark} pixels of walls");
    let other = get(&app, "/?lang=ar").await.text();
    assert!(other.contains("dir=\"rtl\"") && other.contains("محطتان") && other.contains("/stations/west/?lang=ar"));
}

#[tokio::test]
async fn stations_without_a_pose_are_listed_apart() {
    let (_dir, folder) = survey();
    edit(&folder, |text| {
        let keep = |line: &&str| !line.starts_with("rotation") && !line.starts_with("translation");
        let (west, east) = text.split_at(text.find("name = \"east\"").unwrap());
        format!("{west}{}", east.lines().filter(keep).fold(String::new(), |all, line| all + line + "\n"))
    });
    let (app, _) = serve(&folder);
    let html = get(&app, "/").await.text();
    assert!(html.contains("id=\"unknown\">Pose unknown") && !html.contains("<a href=\"#station-east\""), "{html}");
    assert!(get(&app, "/stations/east/").await.text().contains("<dd>Pose unknown</dd>"));
    edit(&folder, |text| {
        text.lines()
            .filter(|l| !l.starts_with("rotation") && !l.starts_with("translation"))
            .fold(String::new(), |all, line| all + line + "\n")
    });
    let html = get(&app, "/").await.text();
    assert!(html.contains("so there is no plan") && !html.contains("<svg class=\"content\""));
    assert_eq!(get(&app, "/plan.png").await.status, StatusCode::NOT_FOUND);
}

/// The result of registering [`survey`] with an additional station `lost`; `west` is the anchor.
pub(crate) fn registered(folder: &Path) -> Registration {
    let survey = Survey::open(folder).unwrap();
    let placed = |name: &str, placement: Placement, variance: f64| {
        let pose = survey.station(name).unwrap().pose.unwrap();
        let q = pose.rotation;
        let mut covariance = [[0.0; 6]; 6];
        for (k, row) in covariance.iter_mut().enumerate() {
            row[k] = variance;
        }
        let (rotation, translation) = ([q.w, q.x, q.y, q.z], pose.translation.to_array());
        Placed {
            name: name.to_owned(),
            placement,
            rotation,
            translation,
            covariance,
            stated: None,
            scan: String::new(),
        }
    };
    let stations = ["west", "east"].map(str::to_owned);
    let link = Link { stations, overlap: 0.5, samples: 1200, residual: 0.0023, contradicted: 0.0, sigma: None };
    Registration {
        stations: vec![placed("west", Placement::Anchor, 0.0), placed("east", Placement::Surface, 1e-6)],
        unplaced: vec![Unplaced {
            scan: String::new(),
            name: "lost".to_owned(),
            reason: "it fits west in <2> different poses".to_owned(),
            candidates: Vec::new(),
            remedy: "scan from a position between it and the others".to_owned(),
        }],
        links: vec![link],
        weakest_chain: ["west", "east"].map(str::to_owned).to_vec(),
        ..Registration::empty()
    }
}

#[tokio::test]
async fn links_are_listed_with_their_residuals_and_the_weakest_chain_is_drawn() {
    let (_dir, folder) = survey();
    add(&folder, "far", &room(60, 40, [16.0, 0.0], false));
    let mut found = registered(&folder);
    let pose = Survey::open(&folder).unwrap().station("far").unwrap().pose.unwrap();
    let far = Placed { name: "far".to_owned(), translation: pose.translation.to_array(), ..found.stations[1].clone() };
    found.stations.push(far);
    let stations = ["east", "far"].map(str::to_owned);
    let sigma = Some([0.0004, 1e-4]);
    found.links.push(Link { stations, overlap: 0.31, samples: 100, residual: 0.0101, contradicted: 0.012, sigma });
    found.save(&folder).unwrap();
    let (app, _) = serve(&folder);
    let html = get(&app, "/").await.text();
    let rows: Vec<&str> = html.split("id=\"links\"").nth(1).unwrap().split("<tr role=\"row\">").skip(2).collect();
    assert!(
        rows.len() == 2 && rows[0].contains("<bdi>east</bdi> – <bdi>far</bdi>"),
        "largest residual first: {rows:?}"
    );
    for part in ["grade-3", "10.1 mm", ">100<", "31 %", "1.2 %", "0.40 mm; 0.0057°"] {
        assert!(rows[0].contains(part), "{part}: {}", rows[0]);
    }
    assert!(rows[1].contains("grade-0") && rows[1].contains("50 %") && rows[1].contains(">–<"), "{}", rows[1]);
    let plan = html.split("<svg class=\"content\"").nth(1).unwrap().split("</svg>").next().unwrap();
    assert_eq!(plan.matches("<line class=\"chain\"").count(), 1, "{plan}");
    assert!(html.contains("Weakest chain: <bdi>west</bdi> – <bdi>east</bdi>"), "{html}");
    for (language, text) in [("fr", "10,1 mm"), ("pt", "Cadeia mais fraca"), ("sw", "Mwingiliano"), ("ar", "التداخل")]
    {
        assert!(get(&app, &format!("/?lang={language}")).await.text().contains(text), "{language}");
    }
    let css = get(&app, "/survey.css").await.text();
    for grade in 1..4 {
        let rule = css.split(&format!(".grade-{grade} {{")).nth(1).unwrap().split('}').next().unwrap();
        assert!(rule.contains("stroke-dasharray"), "grades differ by more than their colours: {rule}");
    }
}

#[tokio::test]
async fn the_page_shows_the_result_of_a_registration() {
    let (_dir, folder) = survey();
    add(&folder, "lost", &room(60, 40, [20.0, 0.0], false));
    edit(&folder, |text| {
        let keep = |line: &&str| !line.starts_with("rotation") && !line.starts_with("translation");
        let (others, lost) = text.split_at(text.find("name = \"lost\"").unwrap());
        format!("{others}{}", lost.lines().filter(keep).fold(String::new(), |all, line| all + line + "\n"))
    });
    let (app, _) = serve(&folder);
    let before = get(&app, "/").await.text();
    assert!(!before.contains("class=\"link") && !before.contains("Standard deviation"), "{before}");
    assert!(before.contains("id=\"unknown\""), "without a registration, `lost` is listed as unknown");
    let found = registered(&folder);
    found.save(&folder).unwrap();
    let html = get(&app, "/").await.text();
    assert!(
        html.contains("<line class=\"link grade-0 samples-2\"") && html.contains("2.30 mm · 1,200 samples"),
        "{html}"
    );
    assert!(html.contains("≤ 2.30 mm") && html.contains("> 4.60 mm".replace('>', "&gt;").as_str()), "{html}");
    let cells = |name: &str| {
        let row = html.split(&format!("<tr role=\"row\" id=\"station-{name}\"")).nth(1).unwrap();
        row.split("</tr>").next().unwrap().to_owned()
    };
    assert!(cells("west").contains(">anchor</td>") && cells("west").contains(">–</bdi>"), "{}", cells("west"));
    assert!(cells("east").contains(">surface</td>") && cells("east").contains("1.00 mm; 0.057°"), "{}", cells("east"));
    assert!(html.contains("Reason: <bdi lang=\"en\">it fits west in &lt;2&gt; different poses</bdi>"), "{html}");
    assert!(html.contains("What to do: <bdi lang=\"en\">scan from a position between it and the others</bdi>"));
    assert!(html.contains("id=\"refused\"") && !html.contains("id=\"unknown\""), "each station once");
    assert!(!html.contains("style="), "no inline styles, which the policy forbids");
    for (language, text) in [("fr", "1,00 mm"), ("pt", "Desvio padrão"), ("sw", "nanga"), ("ar", "محطة مرجعية")]
    {
        assert!(get(&app, &format!("/?lang={language}")).await.text().contains(text), "{language}");
    }
    // A pose that was changed by hand is no longer the registered one.
    edit(&folder, |text| text.replacen("translation = [8.0, 1.0, 0.0]", "translation = [8.5, 1.0, 0.0]", 1));
    let html = get(&app, "/").await.text();
    assert!(html.contains("pose changed since the registration") && !html.contains("class=\"link"), "{html}");
}

#[tokio::test]
async fn stations_that_could_not_be_placed_are_shown_with_their_picture_and_candidates() {
    let (_dir, folder) = survey();
    add(&folder, "lost", &room(60, 40, [20.0, 0.0], false));
    let mut found = registered(&folder);
    let candidate = |matched_with: &str, x: f64, residual: f64| Candidate {
        matched_with: matched_with.to_owned(),
        // Half a turn about the vertical axis.
        rotation: [0.0, 0.0, 0.0, 1.0],
        translation: [x, -1.25, 0.5],
        overlap: 0.12,
        agreement: 0.93,
        contradicted: 0.045,
        residual,
    };
    found.unplaced[0].candidates = vec![candidate("west", 3.0, 0.01), candidate("east", 4.0, 0.02)];
    found.unplaced[0].candidates.extend([candidate("west", 4000.0, 0.03), candidate("removed", 3.0, 0.04)]);
    found.save(&folder).unwrap();
    let (app, _) = serve(&folder);
    let html = get(&app, "/").await.text();
    let list = html.split("id=\"refused\"").nth(1).unwrap().split("</section>").next().unwrap();
    assert!(
        list.contains(
            "src=\"/stations/lost/range.png\" width=\"60\" height=\"40\" alt=\"Range image of station lost\""
        ),
        "{list}"
    );
    assert_eq!(pixels(&get(&app, "/stations/lost/range.png").await).0, 60);
    let rows: Vec<&str> = list.split("<tr role=\"row\">").skip(2).collect();
    assert_eq!(rows.len(), 3, "without the station that is not in the survey: {list}");
    for part in ["<bdi>west</bdi>", "3.000; −1.250; 0.500 m", "270.0°", ">12 %<", ">93 %<", ">4.5 %<", ">10.0 mm<"] {
        assert!(rows[0].contains(part), "{part}: {}", rows[0]);
    }
    // Without the one far outside.
    let plan = html.split("<svg class=\"content\"").nth(1).unwrap().split("</svg>").next().unwrap();
    assert_eq!(plan.matches("<g class=\"candidate\" role=\"img\">").count(), 2, "{plan}");
    assert!(plan.contains("<title>Candidate pose of lost, matched with east</title>"), "{plan}");
    assert!(html.contains("</svg> Candidate pose of an unplaced station"), "{html}");
    for (language, text) in [("fr", "Concordance"), ("pt", "Concordância"), ("sw", "Ulinganifu"), ("ar", "التوافق")]
    {
        assert!(get(&app, &format!("/?lang={language}")).await.text().contains(text), "{language}");
    }
    // Relative to a station whose pose was changed since, a candidate has no position.
    edit(&folder, |text| text.replacen("translation = [8.0, 1.0, 0.0]", "translation = [8.5, 1.0, 0.0]", 1));
    let html = get(&app, "/").await.text();
    assert_eq!(html.matches("<title>Candidate pose of lost").count(), 1);
    let list = html.split("id=\"refused\"").nth(1).unwrap().split("</section>").next().unwrap();
    assert!(list.contains("3.000; −1.250") && !list.contains("4.000; −1.250"), "{list}");
    std::fs::remove_file(folder.join("stations/lost.scan")).unwrap();
    let html = get(&app, "/").await.text();
    assert!(html.contains("id=\"refused\"") && !html.contains("range.png\" alt"), "{html}");
}

#[tokio::test]
async fn a_registration_that_cannot_be_read_is_reported() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    std::fs::write(folder.join("registration.json"), "{\"version\": 1").unwrap();
    let a = get(&app, "/").await;
    let html = a.text();
    assert!(a.status == StatusCode::OK && html.contains("registration.json cannot be read."), "{html}");
    assert!(html.contains("class=\"station\"") && !html.contains(&*folder.to_string_lossy()), "{html}");
    assert_eq!(get(&app, "/registration.json").await.status, StatusCode::NOT_FOUND);
    #[cfg(unix)]
    {
        let elsewhere = folder.with_file_name("elsewhere.json");
        registered(&folder).save(&folder).unwrap();
        std::fs::rename(folder.join("registration.json"), &elsewhere).unwrap();
        std::os::unix::fs::symlink(&elsewhere, folder.join("registration.json")).unwrap();
        let html = get(&app, "/").await.text();
        assert!(html.contains("links are not followed") && !html.contains("class=\"link"), "{html}");
    }
}

#[tokio::test]
async fn stations_that_lie_on_top_of_each_other_are_reported() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    assert!(!get(&app, "/").await.text().contains("the same pose"));
    add(&folder, "third", &room(60, 40, [8.0, 1.0], false));
    assert!(get(&app, "/").await.text().contains("2 stations have exactly the same pose"));
}

#[tokio::test]
async fn pictures_are_those_of_scans_view() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    for (name, show) in [("range", Show::Range), ("intensity", Show::Intensity), ("colour", Show::Colour)] {
        let (width, height, found) = pixels(&get(&app, &format!("/stations/east/{name}.png")).await);
        let mut reader = Reader::open(&folder.join("stations/east.scan")).unwrap();
        let picture = render(&mut reader, show, &mut [], 4096).unwrap();
        assert_eq!((width, height), (60, 40), "{name}");
        assert!(found == picture.pixels, "{name}");
    }
    let html = get(&app, "/stations/east/?show=intensity").await.text();
    assert!(html.contains("alt=\"Intensity image of station east") && html.contains("from dark, 0."), "{html}");
    assert!(html.contains("aria-current=\"page\">Intensity</a>") && !html.contains("style="));
    let html = get(&app, "/stations/west/?show=colour").await.text();
    assert!(!html.contains("show=colour") && html.contains("alt=\"Range image of station west"), "{html}");
    for address in
        ["/stations/west/colour.png", "/stations/west/mask.png", "/stations/west/other.png", "/stations/west/range.jpg"]
    {
        assert_eq!(get(&app, address).await.status, StatusCode::NOT_FOUND, "{address}");
    }
}

#[tokio::test]
async fn a_large_station_has_parts_with_every_cell() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("survey");
    add(&folder, "wide", &room(2600, 30, [0.0, 0.0], true));
    masked(&folder, "near", [0.0, 0.5], &[]);
    let (app, surveyed) = serve(&folder);
    let html = get(&app, "/stations/wide/").await.text();
    assert!(html.contains("data-parts=\"/stations/wide/range\"") && html.contains("data-width=\"2600\""), "{html}");
    assert_eq!(pixels(&get(&app, "/stations/wide/range.png").await).0, 1300);
    for (name, show) in [("colour", Show::Colour), ("mask", Show::Mask)] {
        // The same cells, drawn in one piece.
        let survey = Survey::open(&folder).unwrap();
        let station = survey.station("wide").unwrap();
        let mut reader = mask::open(&folder, station, show == Show::Mask).unwrap();
        let masks = station.masks.iter().filter(|_| show == Show::Mask);
        let masks = masks.map(|mask| MaskReader::open(&folder.join(&mask.file), &mask.name));
        let mut masks = masks.collect::<Result<Vec<_>, _>>().unwrap();
        let picture = render(&mut reader, show, &mut masks, 4096).unwrap();
        // The grey below masks depends on all cells that are drawn.
        let shown = |pixel: &[u8]| (show == Show::Colour || pixel == mask_color(0).1).then(|| pixel.to_vec());
        let mut seen = 0;
        for (column, expected) in [(0, 1024), (1, 1024), (2, 552)] {
            let (width, height, part) = pixels(&get(&app, &format!("/stations/wide/{name}/{column}-0.png")).await);
            assert_eq!((width, height), (expected, 30), "{name} {column}");
            for (row, line) in part.chunks(3 * width as usize).enumerate() {
                let from = 3 * (row * 2600 + column as usize * 1024);
                for (k, (own, whole)) in line.chunks(3).zip(picture.pixels[from..].chunks(3)).enumerate() {
                    assert_eq!(shown(own), shown(whole), "{name}: cell {k} in row {row} of part {column}");
                    seen += usize::from(shown(own).is_some());
                }
            }
        }
        assert!(seen > 10_000, "{name}: {seen}");
    }
    for address in ["3-0", "0-1", "-0-0", "00-0", "0", "4294967295-0", "a-b"] {
        let a = get(&app, &format!("/stations/wide/range/{address}.png")).await;
        assert_eq!(a.status, StatusCode::NOT_FOUND, "{address}");
    }
    let drawn = surveyed.drawn();
    get(&app, "/stations/wide/colour/1-0.png").await;
    assert_eq!(surveyed.drawn(), drawn, "parts are kept too");
}

#[tokio::test]
async fn a_picture_is_drawn_once_for_all_who_ask_at_once() {
    let (_dir, folder) = survey();
    let (app, surveyed) = serve(&folder);
    let requests = (0..16).map(|_| get(&app, "/stations/west/range.png"));
    let answers = futures_util::future::join_all(requests).await;
    assert!(answers.iter().all(|a| a.body == answers[0].body && a.status == StatusCode::OK));
    assert_eq!(surveyed.drawn(), 1);
    let plans = futures_util::future::join_all((0..8).map(|_| get(&app, "/plan.png"))).await;
    assert!(plans.iter().all(|a| a.body == plans[0].body));
    assert_eq!(surveyed.drawn(), 2);
}

#[tokio::test]
async fn a_change_of_the_survey_a_scan_or_a_mask_gives_another_picture() {
    let (_dir, folder) = survey();
    masked(&folder, "bright", [0.0, 0.4], &["west"]);
    let (app, surveyed) = serve(&folder);
    let first = get(&app, "/stations/west/range.png").await;
    let tag = first.header("etag").to_owned();
    assert!(tag.len() > 30 && first.header("cache-control") == "no-cache");
    let again = ask(&app, "GET", "/stations/west/range.png", &[("if-none-match", &tag)]).await;
    assert_eq!((again.status, again.body.len(), again.header("etag")), (StatusCode::NOT_MODIFIED, 0, tag.as_str()));
    assert_eq!(surveyed.drawn(), 1, "what is unchanged is not drawn");
    let plan = get(&app, "/plan.png").await;
    let east = get(&app, "/stations/east/range.png").await;

    // A mask is switched off.
    edit(&folder, |text| text.replace("on = true", "on = false"));
    let off = ask(&app, "GET", "/stations/west/range.png", &[("if-none-match", &tag)]).await;
    assert!(off.status == StatusCode::OK && off.body != first.body && off.header("etag") != tag);
    let unmasked = get(&app, "/plan.png").await;
    assert_ne!(unmasked.header("etag"), plan.header("etag"));

    // A station is moved: its own picture stays, the plan does not.
    edit(&folder, |text| text.replace("8.0, 1.0, 0.0", "9.0, 5.0, 0.0").replace("8, 1, 0", "9, 5, 0"));
    assert!(get(&app, "/").await.text().contains("9.000; 5.000; 0.000 m"));
    assert_ne!(get(&app, "/plan.png").await.header("etag"), unmasked.header("etag"));
    assert_eq!(get(&app, "/stations/east/range.png").await.header("etag"), east.header("etag"));

    // A scan is replaced.
    std::fs::copy(folder.join("stations/east.scan"), folder.join("new")).unwrap();
    std::fs::rename(folder.join("new"), folder.join("stations/west.scan")).unwrap();
    let replaced = get(&app, "/stations/west/range.png").await;
    assert!(replaced.status == StatusCode::OK && replaced.header("etag") != off.header("etag"));
    assert!(get(&app, "/stations/west/").await.text().contains("show=colour"), "it has colours now");

    // A station is added while it is served.
    add(&folder, "third", &room(60, 40, [0.0, 7.0], false));
    assert!(get(&app, "/").await.text().contains("3 stations"));
    assert_eq!(get(&app, "/stations/third/").await.status, StatusCode::OK);
}

#[tokio::test]
async fn masks_have_a_picture_with_a_legend() {
    let (_dir, folder) = survey();
    masked(&folder, "far", [0.3, 2.0], &[]);
    masked(&folder, "near", [0.0, 0.6], &["west"]);
    edit(&folder, |text| text.replacen("on = true", "on = false", 1));
    let (app, _) = serve(&folder);
    let html = get(&app, "/stations/west/?show=mask").await.text();
    assert!(html.contains("swatch mask-0") && html.contains("swatch mask-1") && html.contains(" · off"), "{html}");
    assert!(html.contains("<bdi>near</bdi>") && html.contains(" samples"));
    let (.., found) = pixels(&get(&app, "/stations/west/mask.png").await);
    for number in 0..2 {
        let color = mask_color(number).1;
        assert!(found.chunks_exact(3).any(|pixel| pixel == color), "mask {number}");
    }
}

#[tokio::test]
async fn a_damaged_station_is_shown_with_the_reason_and_the_others_work() {
    let (_dir, folder) = survey();
    masked(&folder, "far", [0.3, 2.0], &["east"]);
    let (app, _) = serve(&folder);
    let scan = folder.join("stations/west.scan");
    let sound = std::fs::read(&scan).unwrap();

    // In its samples, which are only read for pictures.
    let mut bytes = sound.clone();
    bytes[256 + 20 * 700] ^= 1;
    std::fs::write(&scan, &bytes).unwrap();
    let a = get(&app, "/stations/west/").await;
    let html = a.text();
    assert_eq!(a.status, StatusCode::OK);
    assert!(
        html.contains("role=\"alert\"") && html.contains("stations/west.scan: the block at byte 256 is damaged"),
        "{html}"
    );
    assert!(!html.contains(folder.to_str().unwrap()), "it is no concern of readers where the folder is");
    let picture = get(&app, "/stations/west/range.png").await;
    assert!(picture.status == StatusCode::SERVICE_UNAVAILABLE && picture.text().contains("is damaged"));
    let html = get(&app, "/").await.text();
    assert!(html.contains("This station cannot be read.") && html.contains("the block at byte 256"), "{html}");
    assert_eq!(pixels(&get(&app, "/plan.png").await).0, 300);
    assert_eq!(get(&app, "/stations/east/range.png").await.status, StatusCode::OK);

    // In its header, and missing.
    std::fs::write(&scan, &sound[..100]).unwrap();
    assert!(get(&app, "/").await.text().contains("This station cannot be read."));
    std::fs::remove_file(&scan).unwrap();
    let html = get(&app, "/stations/west/").await.text();
    assert!(html.contains("This station cannot be read.") && html.contains("stations/west.scan"), "{html}");
    std::fs::write(&scan, &sound).unwrap();
    assert!(!get(&app, "/").await.text().contains("cannot be read"), "it was put back");

    // A mask.
    let mask = std::fs::read_dir(folder.join("stations")).unwrap().map(|e| e.unwrap().path());
    let mask = mask.into_iter().find(|path| path.extension().is_some_and(|e| e == "mask")).unwrap();
    std::fs::write(&mask, "no mask").unwrap();
    let html = get(&app, "/stations/east/").await.text();
    assert!(html.contains("make the mask far again"), "{html}");
    assert!(get(&app, "/").await.text().contains("make the mask far again"));
}

#[tokio::test]
async fn mistakes_in_survey_toml_are_shown_until_they_are_corrected() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    let sound = std::fs::read_to_string(folder.join("survey.toml")).unwrap();
    edit(&folder, |text| format!("{text}\n[[control]]\nnaem = \"x\"\n"));
    for address in ["/", "/stations/west/"] {
        let a = get(&app, address).await;
        assert_eq!(a.status, StatusCode::SERVICE_UNAVAILABLE, "{address}");
        assert!(a.text().contains("survey.toml has mistakes") && a.text().contains("naem"), "{}", a.text());
    }
    assert_eq!(get(&app, "/healthz").await.status, StatusCode::OK);
    std::fs::write(folder.join("survey.toml"), sound).unwrap();
    assert_eq!(get(&app, "/").await.status, StatusCode::OK);
    std::fs::write(folder.join("survey.toml"), "version = 1\n").unwrap();
    assert!(get(&app, "/").await.text().contains("no stations yet"));
}

#[tokio::test]
async fn nothing_but_pages_and_pictures_is_given_out() {
    let (dir, folder) = survey();
    std::fs::write(folder.join("secret.kilwa"), crate::common::pack("secret")).unwrap();
    let (app, _) = serve(&folder);
    for address in [
        "/stations/none/",
        "/stations/none",
        "/stations/none/range.png",
        "/stations/../survey.toml/",
        "/stations/..%2f..%2fsurvey/range.png",
        "/stations/west.scan",
        "/survey.toml",
        "/packs/secret.kilwa",
        "/m/secret",
        "/models.json",
        "/sign-in",
        "/uploads",
        "/oai",
    ] {
        let a = get(&app, address).await;
        assert_eq!(a.status, StatusCode::NOT_FOUND, "{address}: {}", a.text());
    }
    assert!(get(&app, "/stations/none/?lang=fr").await.text().contains("Plan et toutes les stations"));
    let a = get(&app, "/stations/west").await;
    assert_eq!((a.status, a.header("location")), (StatusCode::PERMANENT_REDIRECT, "/stations/west/"));
    assert_eq!(ask(&app, "POST", "/stations/west/", &[]).await.status, StatusCode::METHOD_NOT_ALLOWED);
    assert_eq!(ask(&app, "HEAD", "/stations/west/range.png", &[]).await.body.len(), 0);

    // A link to a sound scan elsewhere is no file of the survey.
    let elsewhere = dir.path().join("elsewhere.scan");
    std::fs::rename(folder.join("stations/west.scan"), &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, folder.join("stations/west.scan")).unwrap();
    assert_eq!(get(&app, "/stations/west/range.png").await.status, StatusCode::SERVICE_UNAVAILABLE);
    let html = get(&app, "/").await.text();
    assert!(html.contains("stations/west.scan is a link") && html.contains("links are not followed"), "{html}");
    // A path out of the folder is a mistake of the file.
    edit(&folder, |text| text.replace("stations/west.scan", "../elsewhere.scan"));
    assert!(get(&app, "/").await.text().contains("expected a file inside the folder of the survey"));
}

#[tokio::test]
async fn scripts_and_styles_are_files_of_the_site_and_have_the_colours_of_pictures() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    let style = get(&app, "/survey.css").await;
    assert_eq!(style.header("content-type"), "text/css; charset=utf-8");
    let css = style.text();
    let rgb = |[r, g, b]: [u8; 3]| format!("rgb({r} {g} {b})");
    for number in 0..7 {
        assert!(css.contains(&format!(".mask-{number} {{ background: {}", rgb(mask_color(number).1))), "{number}");
    }
    let ramp: Vec<_> = (0..6).map(|k| rgb(range_color(k as f32 / 5.0))).collect();
    assert!(css.contains(&ramp.join(", ")), "{ramp:?}");
    let script = get(&app, "/survey.js").await;
    assert_eq!(script.header("content-type"), "text/javascript; charset=utf-8");
    let known = ask(&app, "GET", "/survey.js", &[("if-none-match", script.header("etag"))]).await;
    assert_eq!(known.status, StatusCode::NOT_MODIFIED);
    assert!(get(&app, "/").await.header("content-security-policy").contains("script-src 'self'"));
}

/// As the pages of models do.
#[tokio::test]
async fn the_pages_of_a_survey_name_the_institution() {
    let (_dir, folder) = survey();
    std::fs::write(
        folder.join(SITE_FILE),
        "name = \"Museum\"\nlogo = \"logo.svg\"\nimprint = \"https://m.example/\"\n",
    )
    .unwrap();
    std::fs::write(folder.join("logo.svg"), "<svg/>").unwrap();
    let mut site = Site::new(Catalogue::open(&folder).unwrap(), page());
    site.survey = Some(Arc::new(Surveyed::open(&folder).unwrap()));
    site.institution = Some(Arc::new(SiteFile::beside(site.catalogue.shelf().unwrap())));
    let app = app(site);
    for address in ["/", "/stations/west/", "/control/?a=west&b=east", "/stations/none/", "/nothing"] {
        let html = get(&app, address).await.text();
        assert!(html.contains("<img src=\"/logo.svg\"") && html.contains("Museum</span>"), "{address}: {html}");
        assert!(html.contains("<a href=\"https://m.example/\">Legal notice</a>"), "{address}: {html}");
    }
    for address in ["/logo.svg", "/site.css"] {
        assert_eq!(get(&app, address).await.status, StatusCode::OK, "{address}");
    }
    assert_eq!(get(&app, "/site.toml").await.status, StatusCode::NOT_FOUND);
}
