use super::*;

pub(crate) fn sample() -> Manifest {
    let sha256 = "ab".repeat(32);
    let version = |n: u32| Version {
        version: n,
        folder: version_folder(n),
        published: "2026-11-21".to_owned(),
        note: "First publication".to_owned(),
        pack: PackEntry {
            url: format!("v{n}/{}", pack_name(&sha256)),
            bytes: 5,
            sha256: sha256.clone(),
            identity: "0123456789abcdef".repeat(2),
        },
        checksums: FileEntry { url: format!("v{n}/checksums.sha256"), bytes: 1, sha256: sha256.clone() },
        annotations: (n == 2).then(|| FileEntry {
            url: "v2/annotations.json".to_owned(),
            bytes: 1,
            sha256: sha256.clone(),
        }),
        holes: (n == 2).then(|| FileEntry { url: "v2/holes.geojson".to_owned(), bytes: 1, sha256: sha256.clone() }),
        tiles: None,
        colour_report: None,
        photographs: None,
        figures: Figures {
            bounds: [glam::DVec3::ZERO, glam::DVec3::ONE],
            crs: None,
            units: "m".to_owned(),
            source_units: "m".to_owned(),
            triangles: 7,
            points: None,
            vertices: 5,
            spacing: 0.1,
            accuracy: None,
        },
        location_redacted: false,
    };
    Manifest {
        kilwa: FORM,
        slug: "fort".to_owned(),
        title: "Fort".to_owned(),
        description: None,
        language: "en".to_owned(),
        place: None,
        captured: None,
        subjects: Vec::new(),
        creators: Vec::new(),
        url: None,
        identifier: None,
        rights: RightsEntry { uri: "u".to_owned(), label: "l".to_owned(), short: "s".to_owned(), holder: None },
        citation: "Fort.".to_owned(),
        access: Access { state: AccessState::Public, until: None, reason: None, contact: None, withdrawn: None },
        current: 2,
        versions: vec![version(1), version(2)],
        page: FileEntry { url: "index.html".to_owned(), bytes: 1, sha256 },
        tool: "kilwa".to_owned(),
    }
}

#[test]
fn a_manifest_round_trips() {
    let manifest = sample();
    let bytes = manifest.to_bytes().unwrap();
    assert_eq!(Manifest::parse(&bytes), Ok(manifest));
}

#[test]
fn impossible_values_in_a_manifest_are_refused_with_their_field() {
    let refuse = |change: &dyn Fn(&mut serde_json::Value)| {
        let mut value = serde_json::to_value(sample()).unwrap();
        change(&mut value);
        Manifest::parse(&serde_json::to_vec(&value).unwrap()).unwrap_err().to_string()
    };
    assert!(refuse(&|v| v["kilwa"] = 2.into()).contains("newer kilwa"));
    assert!(refuse(&|v| v["slug"] = "../x".into()).starts_with("slug"));
    assert!(refuse(&|v| v["versions"][1]["pack"]["url"] = "v1/../../x".into()).starts_with("versions[1].pack.url"));
    assert!(refuse(&|v| v["versions"][1]["version"] = 3.into()).starts_with("versions[1].version"));
    assert!(refuse(&|v| v["versions"][0]["checksums"]["url"] = "v2/checksums.sha256".into()).contains("checksums.url"));
    assert!(refuse(&|v| v["versions"][1]["annotations"]["url"] = "v2/x.json".into()).contains("annotations.url"));
    assert!(refuse(&|v| v["versions"][1]["holes"]["url"] = "v2/x.geojson".into()).contains("holes.url"));
    assert!(refuse(&|v| v["current"] = 9.into()).starts_with("current"));
    assert!(refuse(&|v| v["access"]["state"] = "embargo".into()).starts_with("access.until"));
    assert!(refuse(&|v| v["page"]["url"] = "/etc/passwd".into()).starts_with("page.url"));
    assert!(refuse(&|v| v["surprise"] = 1.into()).contains("surprise"));
    assert!(Manifest::parse(b"{").is_err() && Manifest::parse(b"[]").is_err() && Manifest::parse(b"").is_err());
}

#[test]
fn changing_any_byte_breaks_the_seal() {
    let bytes = sample().to_bytes().unwrap();
    assert_eq!(seal_of(&bytes), Seal::Whole);
    for at in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[at] ^= 1;
        assert_ne!(seal_of(&changed), Seal::Whole, "byte {at}");
    }
    // A manifest without a seal is accepted, like those of earlier versions.
    let text = unsealed(&bytes).unwrap().0;
    assert_eq!((seal_of(&text), Manifest::parse(&text)), (Seal::None, Ok(sample())));
}

#[test]
fn a_duplicate_key_is_refused_with_its_line() {
    let text = String::from_utf8(sample().to_bytes().unwrap()).unwrap();
    for twice in [
        text.replacen("{\n", "{\n  \"kilwa\": 2,\n", 1),
        text.replacen("\"access\": {", "\"access\": {\n    \"state\": \"withdrawn\",", 1),
        text.replacen("\"figures\": {", "\"figures\": {\n        \"crs\": \"EPSG:32737\",\n        \"crs\": null,", 1),
    ] {
        assert_ne!(twice, text);
        let refused = Manifest::parse(twice.as_bytes()).unwrap_err().to_string();
        assert!(refused.contains("duplicate key") && refused.contains("line"), "{refused}");
    }
}
