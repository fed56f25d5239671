use super::*;
use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Request, StatusCode};
use kilwa_archive::Metadata;
use serde_json::{Value as Json, json};
use std::fs;
use std::sync::Arc;
use tempfile::TempDir;
use tower::ServiceExt as _;

const HOST: &str = "127.0.0.1:4321";
const FILE: &str = "# Ours.\r\ntitle = 'Fort' # the working title\r\n\r\n[rights]\r\nuri = \"CC BY 4.0\"\r\nold = 1\r\n\r\n[model]\r\nunits = \"m\"\r\n\r\n\
    # Amina drew.\r\n[[creators]]\r\nname = \"Juma, Amina\"\r\n";

/// A form over a file in a folder of its own.
struct TestForm {
    folder: TempDir,
    editor: Arc<Editor>,
    app: Router,
}

impl TestForm {
    fn new(text: Option<&str>) -> Self {
        Self::knowing(text, None)
    }

    fn knowing(text: Option<&str>, known: Option<Known>) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("gereza.toml");
        if let Some(text) = text {
            fs::write(&path, text).unwrap();
        }
        let editor = Arc::new(Editor::open(&path, known).unwrap());
        let app = form(Arc::clone(&editor), HOST.parse().unwrap());
        Self { folder, editor, app }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("gereza.toml")
    }

    fn text(&self) -> String {
        fs::read_to_string(self.path()).unwrap()
    }

    fn address(&self, rest: &str) -> String {
        format!("/{}/{rest}", self.editor.secret())
    }

    async fn ask(
        &self,
        method: &str,
        uri: &str,
        headers: &[(&str, &str)],
        body: String,
    ) -> (StatusCode, HeaderMap, String) {
        let mut request = Request::builder().method(method).uri(uri);
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let response = self.app.clone().oneshot(request.body(Body::from(body)).unwrap()).await.unwrap();
        let (parts, body) = response.into_parts();
        let bytes = axum::body::to_bytes(body, usize::MAX).await.unwrap();
        (parts.status, parts.headers, String::from_utf8(bytes.to_vec()).unwrap())
    }

    /// Open the page, and what it would send.
    async fn open(&self) -> (String, Values) {
        let (status, _, html) = self.ask("GET", &self.address(""), &[("host", HOST)], String::new()).await;
        assert_eq!(status, 200, "{html}");
        let hash = html.split("data-hash=\"").nth(1).unwrap().split('"').next().unwrap().to_owned();
        (hash, self.editor.show().unwrap().values)
    }

    async fn post(&self, what: &str, body: Json) -> (StatusCode, Json) {
        let origin = format!("http://{HOST}");
        let headers = [("host", HOST), ("origin", origin.as_str()), ("content-type", "application/json")];
        let (status, _, text) = self.ask("POST", &self.address(what), &headers, body.to_string()).await;
        (status, serde_json::from_str(&text).unwrap_or_else(|_| json!(text)))
    }

    async fn save(&self, hash: &str, values: &Values) -> (StatusCode, Json) {
        self.post("save", json!({ "hash": hash, "lang": "en", "values": values })).await
    }
}

fn put(values: &mut Values, name: &str, value: &str) {
    values.fields.insert(name.to_owned(), value.to_owned());
}

#[tokio::test]
async fn opening_and_saving_without_changes_leaves_the_same_bytes() {
    let form = TestForm::new(Some(FILE));
    let before = fs::metadata(form.path()).unwrap().modified().unwrap();
    let (hash, values) = form.open().await;
    assert_eq!(form.save(&hash, &values).await.0, 200);
    assert_eq!(form.text(), FILE);
    assert_eq!(fs::metadata(form.path()).unwrap().modified().unwrap(), before, "it is not written at all");
    assert!(form.editor.written().is_empty());
}

#[tokio::test]
async fn changing_one_field_changes_only_its_line_and_comments_stay() {
    let form = TestForm::new(Some(FILE));
    let (hash, mut values) = form.open().await;
    put(&mut values, "title", "Gereza");
    let (status, answer) = form.save(&hash, &values).await;
    assert_eq!((status.as_u16(), &answer["file"]), (200, &json!("gereza.toml")));
    assert_eq!(form.text(), FILE.replace("'Fort'", "\"Gereza\""));
    // And once more, from the answer: the page is not loaded again.
    put(&mut values, "rights.uri", "CC0");
    assert_eq!(form.save(answer["hash"].as_str().unwrap(), &values).await.0, 200);
    assert_eq!(form.text(), FILE.replace("'Fort'", "\"Gereza\"").replace("CC BY 4.0", "CC0"));
    assert_eq!(form.editor.written().len(), 1);
}

#[tokio::test]
async fn a_new_file_passes_the_check_and_a_draft_says_what_is_missing() {
    let form = TestForm::new(None);
    let (hash, mut values) = form.open().await;
    assert!(!form.path().exists(), "looking writes nothing");
    put(&mut values, "title", "Fort \"Gereza\"");
    let (status, answer) = form.save(&hash, &values).await;
    let places: Vec<_> = answer["faults"].as_array().unwrap().iter().map(|f| f["place"].as_str().unwrap()).collect();
    assert_eq!((status.as_u16(), places), (200, vec!["rights.uri", "model.units"]));
    put(&mut values, "rights.uri", "CC BY 4.0");
    put(&mut values, "model.units", "mm");
    put(&mut values, "place.latitude", "-8.9577");
    put(&mut values, "place.longitude", "39.5228");
    let creator = [("name", "Juma, Amina"), ("orcid", "0000-0002-1825-0097")];
    let fields = creator.map(|(k, v)| (k.to_owned(), v.to_owned())).into();
    values.blocks.get_mut("creators").unwrap().push(kilwa_archive::metadata::document::Block { from: None, fields });
    let (status, answer) = form.save(answer["hash"].as_str().unwrap(), &values).await;
    assert_eq!((status.as_u16(), &answer["faults"]), (200, &json!([])));
    let m = Metadata::parse(&form.text()).unwrap();
    assert_eq!((m.title.as_str(), m.creators[0].name.as_str()), ("Fort \"Gereza\"", "Juma, Amina"));
    assert_eq!(m.place.unwrap().latitude, Some(-8.9577));
    assert!(form.text().contains("# REQUIRED. The name of the model.\ntitle = "), "the comments of the template");
}

#[tokio::test]
async fn values_that_are_wrong_are_refused_with_their_field_and_nothing_is_written() {
    let form = TestForm::new(Some(FILE));
    for (name, value) in [
        ("published", "21.11.2026"),
        ("identifier", "no identifier"),
        ("place.latitude", "95"),
        ("place.country", "Tanzania"),
        ("capture.accuracy", "3 mm"),
        ("model.crs", "EPSG:4326"),
        ("url", "museum.example"),
    ] {
        let (hash, mut values) = form.open().await;
        put(&mut values, name, value);
        let (status, answer) = form.save(&hash, &values).await;
        assert_eq!((status.as_u16(), &answer["kind"]), (422, &json!("wrong")), "{name}");
        let fault = answer["faults"].as_array().unwrap().iter().find(|f| f["place"] == name).unwrap();
        assert!(
            !fault["advice"].as_str().unwrap().is_empty() && !fault["check"].as_str().unwrap().is_empty(),
            "{fault}"
        );
        assert_eq!(form.text(), FILE);
    }
    let (hash, mut values) = form.open().await;
    values.blocks.get_mut("creators").unwrap()[0].fields.insert("orcid".into(), "0000-0002-1825-0098".into());
    let (_, answer) = form.save(&hash, &values).await;
    assert!(answer["faults"].to_string().contains("creators.0.orcid"), "{answer}");
}

#[tokio::test]
async fn a_file_that_changed_on_the_disk_is_never_overwritten_and_a_copy_is_possible_only_then() {
    let form = TestForm::new(Some(FILE));
    let (hash, mut values) = form.open().await;
    put(&mut values, "title", "Mine");
    let copy = |hash: &str, values: &Values| json!({ "hash": hash, "lang": "en", "values": values, "copy": true });
    let theirs = FILE.replace("'Fort'", "'Theirs'");
    fs::write(form.path(), &theirs).unwrap();
    assert_eq!(form.post("save", copy(&hash, &values)).await.0, 409, "nobody was asked yet");
    let (status, answer) = form.save(&hash, &values).await;
    assert_eq!((status.as_u16(), &answer), (409, &json!({ "kind": "changed", "copy": "gereza-2.toml" })));
    // A name that is taken meanwhile is not used.
    fs::write(form.folder.path().join("gereza-2.toml"), "other").unwrap();
    let (status, answer) = form.post("save", copy(&hash, &values)).await;
    assert_eq!((status.as_u16(), &answer["file"], &answer["isCopy"]), (200, &json!("gereza-3.toml"), &json!(true)));
    assert_eq!(form.text(), theirs);
    assert_eq!(fs::read_to_string(form.folder.path().join("gereza-2.toml")).unwrap(), "other");
    let mine = form.folder.path().join("gereza-3.toml");
    assert_eq!(fs::read_to_string(&mine).unwrap(), FILE.replace("'Fort'", "\"Mine\""));
    // From now on it is the copy that is edited.
    put(&mut values, "title", "Mine too");
    assert_eq!(form.save(answer["hash"].as_str().unwrap(), &values).await.0, 200);
    assert!(fs::read_to_string(&mine).unwrap().contains("Mine too"));
    assert_eq!(fs::read_dir(form.folder.path()).unwrap().count(), 3, "no other file");
}

#[tokio::test]
async fn a_file_that_appears_or_disappears_meanwhile_counts_as_changed() {
    let form = TestForm::new(None);
    let (hash, mut values) = form.open().await;
    fs::write(form.path(), FILE).unwrap();
    put(&mut values, "title", "Mine");
    assert_eq!(form.save(&hash, &values).await.0, 409);
    let (hash, values) = form.open().await;
    fs::remove_file(form.path()).unwrap();
    assert_eq!(form.save(&hash, &values).await.0, 409);
    assert!(!form.path().exists());
}

#[tokio::test]
async fn a_file_that_is_damaged_meanwhile_counts_as_changed() {
    for damaged in [&b"title = "[..], b"title = \"\xe9\"\n", &vec![b'#'; (1 << 20) + 1]] {
        let form = TestForm::new(Some(FILE));
        let (hash, mut values) = form.open().await;
        put(&mut values, "title", "Mine");
        fs::write(form.path(), damaged).unwrap();
        assert_eq!(form.save(&hash, &values).await.1, json!({ "kind": "changed", "copy": "gereza-2.toml" }));
        let copy = json!({ "hash": hash, "lang": "en", "values": values, "copy": true });
        assert_eq!(form.post("save", copy).await.0, 200);
        assert_eq!(fs::read(form.path()).unwrap(), damaged);
    }
}

#[tokio::test]
async fn what_could_not_be_read_again_is_not_written() {
    let form = TestForm::new(Some(FILE));
    let (hash, mut values) = form.open().await;
    put(&mut values, "description", &"x".repeat((1 << 20) + 1));
    let (status, answer) = form.save(&hash, &values).await;
    assert!(status == 500 && answer["why"].as_str().unwrap().contains("too long for a metadata file"), "{answer}");
    assert_eq!(form.text(), FILE);
}

#[tokio::test]
async fn a_line_break_in_a_field_of_one_line_is_shown_and_not_dropped() {
    let file = FILE.replacen("[rights]\r\n", "[rights]\r\nholder = \"Museum\\nof Kilwa\"\r\n", 1);
    let form = TestForm::new(Some(&file));
    let (_, _, html) = form.ask("GET", &form.address(""), &[("host", HOST)], String::new()).await;
    assert!(html.contains("Museum\nof Kilwa</textarea>"));
    let (hash, mut values) = form.open().await;
    let (status, answer) = form.save(&hash, &values).await;
    assert_eq!((status.as_u16(), &answer["faults"][0]["place"]), (422, &json!("rights.holder")), "{answer}");
    assert_eq!(form.text(), file);
    put(&mut values, "rights.holder", "Museum of Kilwa");
    assert_eq!(form.save(&hash, &values).await.0, 200);
    assert_eq!(form.text(), file.replace("Museum\\nof Kilwa", "Museum of Kilwa"));
}

#[tokio::test]
async fn every_request_needs_the_secret_the_host_and_if_it_writes_the_origin() {
    let form = TestForm::new(Some(FILE));
    let (hash, mut values) = form.open().await;
    put(&mut values, "title", "Stolen");
    let body = json!({ "hash": hash, "lang": "en", "values": values }).to_string();
    let json = ("content-type", "application/json");
    let own = format!("http://{HOST}");
    let page = form.address("");
    let save = form.address("save");
    for (method, uri, headers, status) in [
        ("GET", "/", vec![("host", HOST)], 404),
        ("GET", "/0123456789abcdef0123456789abcdef/", vec![("host", HOST)], 404),
        ("GET", "/metadata.js", vec![("host", HOST)], 404),
        ("GET", &page, vec![], 403),
        ("GET", &page, vec![("host", "evil.example:4321")], 403),
        ("GET", &page, vec![("host", "127.0.0.1:80")], 403),
        ("POST", &save, vec![("host", HOST), json], 403),
        ("POST", &save, vec![("host", HOST), json, ("origin", "null")], 403),
        ("POST", &save, vec![("host", HOST), json, ("origin", "http://evil.example")], 403),
        ("POST", &save, vec![("host", HOST), json, ("origin", "https://127.0.0.1:4321")], 403),
        ("POST", &save, vec![("host", "evil.example"), json, ("origin", "http://evil.example")], 403),
        ("POST", "/wrong/save", vec![("host", HOST), json, ("origin", own.as_str())], 404),
        ("POST", &save, vec![("host", HOST), ("content-type", "text/plain"), ("origin", own.as_str())], 415),
        ("PUT", &save, vec![("host", HOST), json, ("origin", own.as_str())], 405),
    ] {
        let (given, answered, _) = form.ask(method, uri, &headers, body.clone()).await;
        assert_eq!(given.as_u16(), status, "{method} {uri} {headers:?}");
        assert!(answered.contains_key("content-security-policy"), "{uri}");
    }
    let large = json!({ "hash": hash, "lang": "x".repeat(5 << 20), "values": values });
    assert_eq!(form.post("save", large).await.0, 413);
    assert_eq!(form.text(), FILE);
    assert!(!*form.editor.done.borrow(), "and none of them ends the program");
    assert_eq!(form.post("done", json!(null)).await, (StatusCode::OK, json!({ "written": [] })));
    assert!(*form.editor.done.borrow());
}

#[tokio::test]
async fn the_page_has_every_field_in_every_language_and_a_strict_policy() {
    let form = TestForm::new(Some(FILE));
    for code in kilwa_messages::languages() {
        let address = format!("{}?lang={code}", form.address(""));
        let (_, headers, html) = form.ask("GET", &address, &[("host", HOST)], String::new()).await;
        let policy = headers["content-security-policy"].to_str().unwrap();
        assert!(policy.starts_with("default-src 'none'; script-src 'self';") && !policy.contains("unsafe"), "{policy}");
        assert_eq!(headers["cache-control"], "no-store");
        assert!(
            html.contains(&format!("<html lang=\"{code}\""))
                && !html.contains(" style=\"")
                && !html.contains(" onclick")
        );
        for section in kilwa_archive::metadata::schema::SECTIONS {
            for field in section.fields {
                let row = if section.is_repeated { format!("{}.new", section.path) } else { section.path.to_owned() };
                let id = if row.is_empty() { field.key.to_owned() } else { format!("{row}.{}", field.key) };
                assert!(
                    html.contains(&format!("id=\"{id}\"")) && html.contains(&format!("<label for=\"{id}\">")),
                    "{id}"
                );
            }
        }
        // A message that is missing is shown as its key.
        for prefix in [">f-", ">h-", ">s-", ">d-", ">add-", ">row-", "\"row-"] {
            assert!(!html.contains(prefix), "{code}: {prefix}");
        }
        for name in ["style.css", "metadata.css", "metadata.js", "kilwa.svg"] {
            assert!(html.contains(&format!("\"{name}\"")));
            assert_eq!(form.ask("GET", &form.address(name), &[("host", HOST)], String::new()).await.0, 200, "{name}");
        }
    }
}

#[tokio::test]
async fn values_of_a_pack_fill_only_empty_fields() {
    let known = Known {
        title: Some("Of the pack".into()),
        units: Some("m".into()),
        crs: Some("EPSG:32737".into()),
        ..Known::default()
    };
    let form = TestForm::knowing(Some(FILE), Some(known.clone()));
    let shown = form.editor.show().unwrap();
    assert!(shown.is_filled);
    assert_eq!((&*shown.values.fields["title"], &*shown.values.fields["model.crs"]), ("Fort", "EPSG:32737"));
    assert_eq!(form.text(), FILE);
    let new = TestForm::knowing(None, Some(known));
    assert_eq!(new.editor.show().unwrap().values.fields["title"], "Of the pack");
}

#[tokio::test]
async fn a_read_only_file_is_shown_as_such_and_not_replaced() {
    let form = TestForm::new(Some(FILE));
    let mut permissions = fs::metadata(form.path()).unwrap().permissions();
    permissions.set_readonly(true);
    fs::set_permissions(form.path(), permissions).unwrap();
    assert!(form.editor.is_read_only() && form.editor.show().unwrap().is_read_only);
    let (hash, mut values) = form.open().await;
    put(&mut values, "title", "Other");
    let (status, answer) = form.save(&hash, &values).await;
    assert_eq!(status, 500);
    assert!(answer["why"].as_str().unwrap().contains("gereza.toml is read-only"), "{answer}");
    assert_eq!(form.text(), FILE);
}

#[test]
fn what_cannot_be_edited_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let refusal = |path: &Path| Editor::open(path, None).unwrap_err().to_string();
    assert!(refusal(folder.path()).contains("is a folder; give the name of a file"));
    assert!(refusal(&folder.path().join("no/such.toml")).contains("does not exist; make this folder first"));
    let file = folder.path().join("m.toml");
    for (bytes, message) in [
        (&b"title = \"Fort\"\nrights\n"[..], "line 2"),
        (b"title = \"F\"\nx = \"\xe9\"\n", "line 2: the file is not UTF-8"),
        (b"title = \xe2\x80\x9cFort\xe2\x80\x9d\n", "typographic quotation marks"),
    ] {
        fs::write(&file, bytes).unwrap();
        let why = refusal(&file);
        assert!(why.contains(message) && why.contains("m.toml"), "{why}");
    }
    fs::write(&file, vec![b'#'; (1 << 20) + 1]).unwrap();
    assert!(refusal(&file).contains("too long for a metadata file"));
}

#[cfg(unix)]
#[test]
fn a_link_to_nothing_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("link.toml");
    std::os::unix::fs::symlink("none.toml", &link).unwrap();
    let why = Editor::open(&link, None).unwrap_err().to_string();
    assert!(why.contains("link.toml is a link to a file that does not exist"), "{why}");
}

#[cfg(unix)]
#[tokio::test]
async fn a_link_stays_a_link_and_permissions_stay() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let form = TestForm::new(Some(FILE));
    fs::set_permissions(form.path(), fs::Permissions::from_mode(0o640)).unwrap();
    let link = form.folder.path().join("link.toml");
    symlink("gereza.toml", &link).unwrap();
    let editor = Editor::open(&link, None).unwrap();
    let shown = editor.show().unwrap();
    let mut values = shown.values;
    put(&mut values, "title", "Through the link");
    assert!(matches!(editor.save(&shown.seen.hash, &values, false), Saved::Written { .. }));
    assert!(link.is_symlink() && form.text().contains("Through the link"));
    assert_eq!(fs::metadata(form.path()).unwrap().permissions().mode() & 0o777, 0o640);
}
