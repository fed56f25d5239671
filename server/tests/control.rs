//! Control points that are marked in the pages of a survey: the page, the sample at a place of a picture, how well pairs fit, and the entries for `survey.toml`.

use crate::common::{Answer, ask, get};
use crate::survey::{add, edit, masked, registered, room, serve, survey};
use axum::Router;
use axum::body::Body;
use axum::http::{Request, StatusCode};
use glam::{DQuat, DVec3};
use kilwa_geometry::LengthUnit;
use kilwa_scan::import::{Options, Silent, import};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::register::{self, Candidate, Placement, apply};
use kilwa_scan::survey::Survey;
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::Path;
use tower::ServiceExt as _;

async fn post(app: &Router, body: impl Into<Body>) -> Answer {
    let request = Request::builder().method("POST").uri("/control/fit").body(body.into()).unwrap();
    Answer::of(app.clone().oneshot(request).await.unwrap()).await
}

fn parsed(answer: &Answer) -> Value {
    assert_eq!(
        (answer.status, answer.header("content-type")),
        (StatusCode::OK, "application/json"),
        "{}",
        answer.text()
    );
    serde_json::from_slice(&answer.body).unwrap()
}

fn point(value: &Value) -> DVec3 {
    DVec3::from_array(serde_json::from_value(value.clone()).unwrap())
}

#[tokio::test]
async fn a_cell_of_a_picture_leads_to_its_sample() {
    let (_dir, folder) = survey();
    let (app, surveyed) = serve(&folder);
    // The picture is turned: rows of the scan rise, and its azimuth grows to the left.
    for (column, row) in [(0_u32, 0_u32), (17, 30), (59, 39)] {
        let azimuth = f64::from(column) * std::f64::consts::TAU / 60.0;
        let elevation = (f64::from(row) / 40.0 - 0.5) * 2.4;
        let ray = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
        let range = (DVec3::new(3.0, 3.0, 1.5) / ray.abs()).min_element();
        let found = parsed(&get(&app, &format!("/stations/east/at/{}-{}.json", 59 - column, 39 - row)).await);
        assert_eq!(found["cell"], json!([59 - column, 39 - row]));
        assert!(point(&found["at"]).distance(ray * range) < 2e-4, "{found}: {}", ray * range);
        assert!((found["range"].as_f64().unwrap() - range).abs() < 2e-4, "{found}");
        // Half of what neighbouring rays are apart on a wall: at least 3.4° of the range.
        let sigma = found["sigma"].as_f64().unwrap();
        assert!(sigma > 0.5 * range * 0.06 && sigma < range, "{found}");
    }
    let near = parsed(&get(&app, "/stations/east/at/20-20.json").await)["sigma"].as_f64().unwrap();
    let far = parsed(&get(&app, "/stations/east/at/20-20.json?width=3").await)["sigma"].as_f64().unwrap();
    assert!((far / near - 3.0).abs() < 0.02, "seen from afar, a place is marked less exactly: {near} {far}");
    let drawn = surveyed.drawn();
    let first = get(&app, "/stations/east/at/5-6.json").await;
    let etag = first.header("etag").to_owned();
    assert!(etag.len() > 30 && first.header("cache-control") == "no-cache");
    let again = ask(&app, "GET", "/stations/east/at/5-6.json", &[("if-none-match", &etag)]).await;
    assert_eq!((again.status, again.body.len()), (StatusCode::NOT_MODIFIED, 0));
    assert_ne!(get(&app, "/stations/east/at/5-6.json?width=2").await.header("etag"), etag);
    assert_eq!(surveyed.drawn(), drawn, "the picture is drawn once");
}

#[tokio::test]
async fn empty_and_masked_places_have_no_sample() {
    let (_dir, folder) = survey();
    // Sky in the upper half, but for the cells of every tenth column.
    let ptx = room(60, 40, [20.0, 0.0], false);
    let cell = |(k, line): (usize, &str)| {
        let (column, row) = (k.wrapping_sub(10) / 40, k.wrapping_sub(10) % 40);
        let is_sky = k >= 10 && row >= 20 && column % 10 != 0;
        if is_sky { "0 0 0 0\n".to_owned() } else { format!("{line}\n") }
    };
    add(&folder, "open", &ptx.lines().enumerate().map(cell).collect::<String>());
    let (app, _) = serve(&folder);
    let sky = get(&app, "/stations/open/at/24-10.json").await;
    assert_eq!((sky.status, sky.header("content-type")), (StatusCode::NOT_FOUND, "application/json"), "{}", sky.text());
    assert!(sky.text().contains("no sample"), "{}", sky.text());
    // Column 30 of the scan is column 29 of the picture.
    assert_eq!(get(&app, "/stations/open/at/29-10.json").await.status, StatusCode::OK);
    let near = parsed(&get(&app, "/stations/open/at/27-10.json?width=4").await);
    assert_eq!(near["cell"], json!([29, 10]), "seen as one pixel, it is the nearest sample");

    let before = get(&app, "/stations/west/at/20-20.json").await;
    assert_eq!(before.status, StatusCode::OK);
    masked(&folder, "all", [50.0, 60.0], &["west"]);
    let etag = before.header("etag").to_owned();
    let hidden = ask(&app, "GET", "/stations/west/at/20-20.json", &[("if-none-match", &etag)]).await;
    assert_eq!(hidden.status, StatusCode::NOT_FOUND, "{}", hidden.text());
    edit(&folder, |text| text.replace("on = true", "on = false"));
    assert_eq!(get(&app, "/stations/west/at/20-20.json").await.status, StatusCode::OK);
}

#[tokio::test]
async fn a_place_in_the_panorama_of_a_cloud_is_the_nearest_point_there() {
    let (_dir, folder) = survey();
    let mut text = String::new();
    // A wall at x = 4, and points behind it in the same directions.
    for (y, z) in (-40..=40).flat_map(|y| (-20..=20).map(move |z| (f64::from(y) * 0.05, f64::from(z) * 0.05))) {
        writeln!(text, "4.0 {y:.3} {z:.3}\n6.0 {:.3} {:.3}", 1.5 * y, 1.5 * z).unwrap();
    }
    let file = folder.with_file_name("cloud.xyz");
    std::fs::write(&file, text).unwrap();
    let read = ReadOptions { station: Some(DVec3::ZERO), ..ReadOptions::default() };
    import(&folder, &[file], &Options { read, resume: false }, &Silent).unwrap();
    let (app, _) = serve(&folder);
    let html = get(&app, "/stations/cloud/").await.text();
    let number =
        |key: &str| html.split(&format!("data-{key}=\"")).nth(1).unwrap().split('"').next().unwrap().to_owned();
    let [width, height]: [u32; 2] = ["width", "height"].map(|key| number(key).parse().unwrap());
    // Straight ahead is in the middle.
    let found = parsed(&get(&app, &format!("/stations/cloud/at/{}-{}.json?width=2", width / 2, height / 2)).await);
    let at = point(&found["at"]);
    assert!((at.x - 4.0).abs() < 1e-4 && at.truncate().y.abs() < 0.2 && at.z.abs() < 0.2, "{found}");
    assert_eq!(get(&app, "/stations/cloud/at/0-0.json").await.status, StatusCode::NOT_FOUND);
    assert_eq!(get(&app, &format!("/stations/cloud/at/{width}-0.json")).await.status, StatusCode::NOT_FOUND);
}

#[tokio::test]
async fn hostile_places_are_refused() {
    let (dir, folder) = survey();
    let (app, _) = serve(&folder);
    for place in [
        "60-0",
        "0-40",
        "4294967295-0",
        "4294967296-0",
        "-1-0",
        "00-0",
        "+1-0",
        "1e1-0",
        "NaN-0",
        "0",
        "0-0-0",
        "a-b",
        "",
    ] {
        let a = get(&app, &format!("/stations/west/at/{place}.json")).await;
        assert_eq!(a.status, StatusCode::NOT_FOUND, "{place}: {}", a.text());
    }
    for address in ["/stations/none/at/0-0.json", "/stations/..%2fwest/at/0-0.json", "/stations/west/at/0-0.png"] {
        assert_eq!(get(&app, address).await.status, StatusCode::NOT_FOUND, "{address}");
    }
    for width in ["0", "65", "-1", "01", "NaN", "1e9", "99999999999999999999", ""] {
        let a = get(&app, &format!("/stations/west/at/0-0.json?width={width}")).await;
        assert_eq!(a.status, StatusCode::BAD_REQUEST, "{width}: {}", a.text());
    }
    let long = format!("/stations/west/at/0-0.json?width={}", "1".repeat(3000));
    assert_eq!(get(&app, &long).await.status, StatusCode::URI_TOO_LONG);
    assert_eq!(ask(&app, "POST", "/stations/west/at/0-0.json", &[]).await.status, StatusCode::METHOD_NOT_ALLOWED);

    let scan = folder.join("stations/west.scan");
    let mut bytes = std::fs::read(&scan).unwrap();
    bytes[256 + 20 * 700] ^= 1;
    std::fs::write(&scan, &bytes).unwrap();
    let a = get(&app, "/stations/west/at/42-20.json").await;
    assert!(a.status == StatusCode::SERVICE_UNAVAILABLE && a.text().contains("is damaged"), "{}", a.text());
    assert!(!a.text().contains(folder.to_str().unwrap()), "it is no concern of readers where the folder is");
    let elsewhere = dir.path().join("elsewhere.scan");
    std::fs::rename(&scan, &elsewhere).unwrap();
    std::os::unix::fs::symlink(&elsewhere, &scan).unwrap();
    let a = get(&app, "/stations/west/at/42-20.json").await;
    assert!(a.status == StatusCode::SERVICE_UNAVAILABLE && a.text().contains("is a link"), "{}", a.text());
}

/// Pairs of the same places: coordinates in `west`, and turned and moved in `east`.
fn pairs(places: &[[f64; 3]]) -> Vec<Value> {
    let turn = DQuat::from_rotation_z(1.0);
    let mark = |at: DVec3| json!({ "at": at.to_array(), "sigma": 0.002 });
    let pair = |at: &[f64; 3]| {
        let at = DVec3::from_array(*at);
        json!({ "a": mark(at), "b": mark(turn * at + DVec3::new(5.0, -2.0, 0.3)) })
    };
    places.iter().map(pair).collect()
}

const PLACES: [[f64; 3]; 4] = [[1.0, 2.0, 0.5], [-3.0, 2.5, 1.25], [2.0, -3.0, -1.0], [3.0, 1.0, 0.25]];

fn question(pairs: &[Value]) -> String {
    json!({ "a": "west", "b": "east", "pairs": pairs }).to_string()
}

#[tokio::test]
async fn pairs_are_aligned_and_the_wrong_one_is_named() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    for (number, state, missing) in [(0, "few", 3), (1, "few", 2), (2, "few", 1), (3, "fits", 0), (4, "fits", 0)] {
        let found = parsed(&post(&app, question(&pairs(&PLACES[..number]))).await);
        assert_eq!((&found["state"], &found["missing"]), (&json!(state), &json!(missing)), "{found}");
        assert_eq!(found["pairs"].as_array().unwrap().len(), number);
        assert!(found["suspect"].is_null() && found["again"] == json!(false), "{found}");
        for point in found["pairs"].as_array().unwrap() {
            assert!(
                if number < 3 { point["residual"].is_null() } else { point["residual"].as_f64() < Some(1e-9) },
                "{found}"
            );
        }
    }
    let line: Vec<_> = (0..4).map(|k| [f64::from(k), 1.0, 0.0]).collect();
    let found = parsed(&post(&app, question(&pairs(&line))).await);
    assert!(found["state"] == json!("line") && found["pairs"][0]["residual"].is_null(), "{found}");
    let mut wrong = pairs(&PLACES);
    wrong[2]["b"]["at"][1] = json!(wrong[2]["b"]["at"][1].as_f64().unwrap() + 0.12);
    let found = parsed(&post(&app, question(&wrong)).await);
    assert_eq!((&found["state"], &found["suspect"]), (&json!("check"), &json!("west+east-3")), "{found}");
    let residual = found["pairs"][2]["residual"].as_f64().unwrap();
    assert!((0.03..0.12).contains(&residual), "the wrong pair also moves the alignment: {found}");
    // Of three pairs, any may be the wrong one.
    let mut wrong = pairs(&PLACES[..3]);
    wrong[2]["b"]["at"][1] = json!(wrong[2]["b"]["at"][1].as_f64().unwrap() + 0.6);
    let found = parsed(&post(&app, question(&wrong)).await);
    assert!(found["state"] == json!("check") && found["suspect"].is_null(), "{found}");
}

#[tokio::test]
async fn registering_again_is_not_proposed_for_two_fixed_stations() {
    let (_dir, folder) = survey();
    registered(&folder).save(&folder).unwrap();
    let (app, _) = serve(&folder);
    let asked = question(&pairs(&PLACES));
    let found = parsed(&post(&app, asked.clone()).await);
    assert_eq!((&found["again"], &found["fixed"]), (&json!(true), &json!(false)), "both are registered: {found}");
    for (name, again) in [("west", true), ("east", false)] {
        let line = format!("name = \"{name}\"\n");
        edit(&folder, |text| text.replace(&line, &format!("{line}fixed = true\n")));
        let found = parsed(&post(&app, asked.clone()).await);
        assert_eq!((&found["again"], &found["fixed"]), (&json!(again), &json!(!again)), "{name}: {found}");
    }
}

#[tokio::test]
async fn what_was_marked_is_not_used_for_the_same_source_in_other_units() {
    let (_dir, folder) = survey();
    let identity = |html: &str| html.split("data-identity=\"").nth(1).unwrap()[..16].to_owned();
    let (app, _) = serve(&folder);
    let before = identity(&get(&app, "/control/?a=west&b=east").await.text());
    let other = folder.with_file_name("other");
    let read = ReadOptions { units: LengthUnit::parse("ft").unwrap(), ..ReadOptions::default() };
    let files = ["west", "east"].map(|name| folder.with_file_name(format!("{name}.ptx")));
    import(&other, &files, &Options { read, resume: false }, &Silent).unwrap();
    let (app, _) = serve(&other);
    assert_ne!(identity(&get(&app, "/control/?a=west&b=east").await.text()), before);
}

#[tokio::test]
async fn the_entries_have_names_of_their_own_and_are_known_once_they_are_in_the_file() {
    let (_dir, folder) = survey();
    let other = "\n[[control]]\nname = \"west+east-7\"\nat = [1.0, 1.0, 1.0]\n";
    edit(&folder, |text| format!("{text}{other}"));
    let (app, _) = serve(&folder);
    let found = parsed(&post(&app, question(&pairs(&PLACES[..2]))).await);
    let entries = found["entries"].as_str().unwrap().to_owned();
    assert_eq!(entries.matches("[[control]]").count(), 4, "{entries}");
    for part in [
        "name = \"west+east-8\"\nstation = \"west\"\nat = [1.0000, 2.0000, 0.5000]\nsigma = 0.002\n",
        "station = \"east\"",
    ] {
        assert!(entries.contains(part), "{part}: {entries}");
    }
    assert_eq!(found["pairs"][1]["label"], json!("9"));
    // The same names in the other order of the stations, with the coordinates exchanged.
    let swapped: Vec<Value> =
        pairs(&PLACES[..2]).iter().map(|pair| json!({ "a": pair["b"], "b": pair["a"] })).collect();
    let body = json!({ "a": "east", "b": "west", "pairs": swapped }).to_string();
    assert!(
        parsed(&post(&app, body).await)["entries"]
            .as_str()
            .unwrap()
            .contains("name = \"west+east-8\"\nstation = \"east\"")
    );

    edit(&folder, |text| text + &entries);
    Survey::open(&folder).unwrap();
    // What was marked is found again, though written with four digits; a third pair gets the next number.
    let found = parsed(&post(&app, question(&pairs(&PLACES[..3]))).await);
    let known: Vec<_> =
        (0..3).map(|k| (found["pairs"][k]["name"].clone(), found["pairs"][k]["known"].clone())).collect();
    let expected = [("west+east-8", true), ("west+east-9", true), ("west+east-10", false)];
    assert_eq!(known, expected.map(|(name, known)| (json!(name), json!(known))), "{found}");
    assert!(found["known"] == json!([]) && found["state"] == json!("fits"), "{found}");
    assert_eq!(found["entries"].as_str().unwrap().matches("[[control]]").count(), 2, "{found}");
    // Those that were not marked here count too.
    let found = parsed(&post(&app, question(&pairs(&PLACES[2..3]))).await);
    assert_eq!((found["known"].as_array().unwrap().len(), &found["state"]), (2, &json!("fits")), "{found}");
}

#[tokio::test]
async fn hostile_pairs_are_refused() {
    let (_dir, folder) = survey();
    let (app, _) = serve(&folder);
    let good = question(&pairs(&PLACES));
    assert_eq!(post(&app, good.clone()).await.status, StatusCode::OK);
    let many: Vec<Value> = std::iter::repeat_n(pairs(&[[1.0, 2.0, 3.0]]), 65).flatten().collect();
    let pair = |at: &str, sigma: &str| {
        format!(
            "{{\"a\":\"west\",\"b\":\"east\",\"pairs\":[{{\"a\":{{\"at\":{at},\"sigma\":{sigma}}},\"b\":{{\"at\":[0,0,0],\"sigma\":1}}}}]}}"
        )
    };
    assert_eq!(post(&app, pair("[1,2,3]", "1")).await.status, StatusCode::OK);
    for body in [
        String::new(),
        "{".to_owned(),
        "[]".to_owned(),
        "\u{0}".to_owned(),
        "[".repeat(15_000),
        good.replace("\"a\":\"west\"", "\"a\":\"west\",\"a\":\"west\""),
        good.replace("\"a\":\"west\"", "\"a\":\"east\""),
        good.replace("\"a\":\"west\"", "\"a\":\"west\",\"more\":1"),
        question(&many),
        pair("[1,2]", "1"),
        pair("[1,2,3,4]", "1"),
        pair("[1e400,2,3]", "1"),
        pair("[NaN,2,3]", "1"),
        pair("[null,2,3]", "1"),
        pair("[1e7,2,3]", "1"),
        pair("[1,2,3]", "0"),
        pair("[1,2,3]", "-1"),
        pair("[1,2,3]", "1e9"),
        pair("[1,2,3]", "\"1\""),
    ] {
        let a = post(&app, body.clone()).await;
        assert_eq!(a.status, StatusCode::BAD_REQUEST, "{}: {}", body.chars().take(200).collect::<String>(), a.text());
    }
    assert_eq!(post(&app, question(&many[..64])).await.status, StatusCode::OK);
    assert_eq!(post(&app, good.replace("\"a\":\"west\"", "\"a\":\"../west\"")).await.status, StatusCode::NOT_FOUND);
    assert_eq!(post(&app, " ".repeat(20_000)).await.status, StatusCode::PAYLOAD_TOO_LARGE);
    assert_eq!(get(&app, "/control/fit").await.status, StatusCode::METHOD_NOT_ALLOWED);
    edit(&folder, |text| format!("{text}\n[[control]]\nnaem = \"x\"\n"));
    assert_eq!(post(&app, good).await.status, StatusCode::SERVICE_UNAVAILABLE);
}

#[tokio::test]
async fn the_page_shows_both_stations_and_other_pages_lead_to_it() {
    let (_dir, folder) = survey();
    add(&folder, "lost", &room(60, 40, [20.0, 0.0], false));
    let mut found = registered(&folder);
    let candidate = Candidate {
        matched_with: "east".to_owned(),
        rotation: [1.0, 0.0, 0.0, 0.0],
        translation: [0.0; 3],
        overlap: 0.1,
        agreement: 0.5,
        contradicted: 0.2,
        residual: 0.01,
    };
    found.unplaced[0].candidates.push(candidate);
    found.save(&folder).unwrap();
    let (app, _) = serve(&folder);
    let start = get(&app, "/control/").await.text();
    assert!(start.contains("<h1>Control points</h1>") && start.contains("<option value=\"lost\">"), "{start}");
    assert!(!start.contains("/control.js") && !start.contains("class=\"zoom\""), "nothing to mark yet: {start}");
    let html = get(&app, "/control/?a=west&b=east").await.text();
    assert!(
        html.contains("src=\"/stations/west/intensity.png?") && html.contains("src=\"/stations/east/intensity.png?"),
        "{html}"
    );
    assert!(
        html.contains("<option value=\"west\" selected>") && html.contains("data-side=\"b\" data-station=\"east\""),
        "{html}"
    );
    assert!(html.contains("src=\"/control.js\"") && !html.contains("style=") && !html.contains("onclick"), "{html}");
    assert!(html.contains("Add this text to the end of survey.toml"), "messages of the script: {html}");
    // Only one of them has colours; the other one keeps the best that it has.
    let html = get(&app, "/control/?a=west&b=east&show=colour&lang=fr").await.text();
    assert!(
        html.contains("src=\"/stations/west/intensity.png?") && html.contains("src=\"/stations/east/colour.png?"),
        "{html}"
    );
    assert!(html.contains("href=\"/control/?a=west&amp;b=east&amp;show=range&amp;lang=fr\""), "{html}");
    let html = get(&app, "/control/?a=west&b=west").await.text();
    assert!(html.contains("Choose two different stations.") && !html.contains("class=\"zoom\""), "{html}");
    for unknown in ["/control/?a=none", "/control/?a=west&b=none", "/control/?b=..%2fwest"] {
        assert_eq!(get(&app, unknown).await.status, StatusCode::NOT_FOUND, "{unknown}");
    }
    assert_eq!(get(&app, &format!("/control/?a={}", "x".repeat(3000))).await.status, StatusCode::URI_TOO_LONG);
    assert_eq!(get(&app, "/control").await.header("location"), "/control/");
    // A station that could not be placed is shown with the one that it fits best.
    let html = get(&app, "/control/?a=lost").await.text();
    assert!(html.contains("data-station=\"lost\"") && html.contains("data-station=\"east\""), "{html}");
    let html = get(&app, "/control/?a=lost&b=").await.text();
    assert!(!html.contains("class=\"zoom\""), "none was chosen: {html}");

    let plan = get(&app, "/").await.text();
    assert!(plan.contains("href=\"/control/\"") && plan.contains("href=\"/control/?a=lost&amp;b=east\""), "{plan}");
    assert!(get(&app, "/stations/west/?lang=sw").await.text().contains("href=\"/control/?a=west&amp;lang=sw\""));
    assert_eq!(get(&app, "/control.js").await.header("content-type"), "text/javascript; charset=utf-8");
    for (language, text) in
        [("fr", "Points de contrôle"), ("pt", "Pontos de controlo"), ("sw", "Nukta za udhibiti"), ("ar", "نقاط الضبط")]
    {
        assert!(get(&app, &format!("/control/?lang={language}")).await.text().contains(text), "{language}");
    }
}

/// A room that looks the same after half a turn, from two places in it, without poses.
fn ambiguous(folder: &Path, places: [DVec3; 2]) {
    for (name, at) in ["first", "second"].into_iter().zip(places) {
        let mut ptx = "120\n60\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".to_owned();
        for (column, row) in (0..120).flat_map(|column| (0..60).map(move |row| (column, row))) {
            let (azimuth, elevation) = (f64::from(column) * 0.052_36, (f64::from(row) - 29.5) * 0.048);
            let ray = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
            let p = ray * ((DVec3::new(3.0, 2.5, 1.5) * ray.signum() - at) / ray).min_element();
            writeln!(ptx, "{:.6} {:.6} {:.6} 0.5", p.x, p.y, p.z).unwrap();
        }
        add(folder, name, &ptx);
    }
}

#[tokio::test]
async fn stations_that_could_not_be_placed_are_registered_from_the_entries() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("survey");
    let places = [DVec3::new(-1.0, 0.4, -0.2), DVec3::new(0.9, -0.7, 0.3)];
    ambiguous(&folder, places);
    let run = || {
        let survey = Survey::open(&folder).unwrap();
        let found = register::register(&folder, &survey, &register::Options::default(), &Silent).unwrap();
        (survey, found)
    };
    let (_, before) = run();
    assert_eq!(before.unplaced.len(), 2, "both poses fit");
    let (app, _) = serve(&folder);
    let mut marked = Vec::new();
    for place in [DVec3::new(3.0, 1.0, 0.5), DVec3::new(-3.0, -1.0, 0.0), DVec3::new(0.4, 2.5, -1.0)] {
        let mut pair = serde_json::Map::new();
        for ((side, name), at) in [("a", "first"), ("b", "second")].into_iter().zip(places) {
            // The cell nearest to the place, in a picture whose columns run to the right and whose rows run down.
            let seen = place - at;
            let column = (seen.y.atan2(seen.x).rem_euclid(std::f64::consts::TAU) / 0.052_36).round() as i64 % 120;
            let row = ((seen.z / seen.length()).asin() / 0.048 + 29.5).round() as i64;
            let found = parsed(&get(&app, &format!("/stations/{name}/at/{}-{}.json", 119 - column, 59 - row)).await);
            assert!(point(&found["at"]).distance(seen) < 0.2, "{place}: {found}");
            pair.insert(side.to_owned(), json!({ "at": found["at"], "sigma": found["sigma"] }));
        }
        marked.push(pair);
    }
    let body = json!({ "a": "first", "b": "second", "pairs": marked }).to_string();
    let answer = parsed(&post(&app, body.clone()).await);
    assert!(answer["state"] == json!("fits") && answer["again"] == json!(false), "{answer}");
    edit(&folder, |text| text + answer["entries"].as_str().unwrap());
    let (survey, found) = run();
    assert!(found.unplaced.is_empty(), "{:?}", found.unplaced);
    let mut placements: Vec<Placement> = found.stations.iter().map(|placed| placed.placement).collect();
    placements.sort_by_key(|placement| *placement == Placement::Control);
    assert_eq!(placements, [Placement::Anchor, Placement::Control]);
    let at = |name: &str| DVec3::from_array(found.stations.iter().find(|s| s.name == name).unwrap().translation);
    let off = (at("second") - at("first")).distance(places[1] - places[0]);
    assert!(off < 0.2, "{off} m, with samples 15 cm apart");
    apply(&folder, &survey, &found).unwrap();
    let after = parsed(&post(&app, body).await);
    assert!(after["again"] == json!(true) && after["entries"] == json!(""), "{after}");
}
