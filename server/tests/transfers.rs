//! What happens to a running transfer when the file changes, or access to it.

use crate::common::{Answer, fresh, noise, object, page, public};
use crate::eventually::eventually_async;
use axum::Router;
use axum::body::{Body, BodyDataStream};
use axum::http::Request;
use futures_util::StreamExt as _;
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_archive::manifest::{Access, AccessState, Manifest};
use kilwa_server::access::{Accounts, AccountsError, Grant, Purpose};
use kilwa_server::auth::Auth;
use kilwa_server::extracts::{Extracts, Failure};
use kilwa_server::{Catalogue, Clock, Site, app};
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tower::ServiceExt as _;

const NOW: u64 = 1_795_262_400;
/// Far more than is on its way to a reader at once.
const LENGTH: usize = 16 << 20;

/// A transfer whose first bytes have arrived.
async fn begun(app: &Router, address: &str, token: &str) -> BodyDataStream {
    let request = Request::get(address).header("authorization", format!("Bearer {token}"));
    let response = app.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
    assert_eq!(response.status(), 200, "{address}");
    let mut body = response.into_body().into_data_stream();
    body.next().await.unwrap().unwrap();
    body
}

/// How many more bytes a reader receives, and whether the transfer ends in an error.
async fn rest(mut body: BodyDataStream) -> (usize, bool) {
    let mut bytes = 0;
    while let Some(part) = body.next().await {
        match part {
            Ok(part) => bytes += part.len(),
            Err(_) => return (bytes, true),
        }
    }
    (bytes, false)
}

/// A site that looks at everything again for every request, and before every piece of a running transfer.
fn always_checking(models: &Path) -> Site {
    let mut site = Site::new(fresh(models), page());
    site.clock = Clock::new(|| NOW);
    site.recheck = Duration::ZERO;
    site
}

fn closed(state: AccessState) -> Access {
    Access { state, reason: Some("Graves.".to_owned()), ..public() }
}

fn change_access(models: &Path, slug: &str, access: Access) {
    let path = models.join(slug).join("manifest.json");
    let mut manifest = Manifest::parse(&std::fs::read(&path).unwrap()).unwrap();
    manifest.access = access;
    let new = path.with_extension("new");
    std::fs::write(&new, manifest.to_bytes().unwrap()).unwrap();
    std::fs::rename(new, path).unwrap();
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_transfer_ends_when_access_ends_and_others_continue() {
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let bytes = noise(LENGTH, 1);
    let address_of = |slug: &str, access: Access| {
        let manifest = object(&models, slug, std::slice::from_ref(&bytes), access);
        format!("/{slug}/{}", manifest.versions[0].pack.url)
    };
    let cave = address_of("cave", closed(AccessState::Restricted));
    let fort = address_of("fort", public());
    let tomb = address_of("tomb", public());
    let wall = address_of("wall", public());
    let mut accounts = Accounts::new().unwrap();
    for robot in ["robot", "other"] {
        accounts.set_user(robot, &Grant::All, None).unwrap();
    }
    let robot = accounts.add_token("robot", Purpose::View, 30, NOW).unwrap();
    let other = accounts.add_token("other", Purpose::View, 30, NOW).unwrap();
    let file = folder.path().join("access.json");
    accounts.create(&file).unwrap();
    let mut site = always_checking(&models);
    site.auth = Some(Arc::new(Auth::open(&file, None).unwrap().with_freshness(Duration::ZERO)));
    let app = app(site);

    let mut transfers = Vec::new();
    for (address, token) in [(&cave, &robot), (&cave, &other), (&fort, &robot), (&tomb, &robot), (&wall, &robot)] {
        transfers.push(begun(&app, address, token).await);
    }
    let removed = Accounts::change(&file, |accounts| {
        accounts.remove_user("robot")?;
        Ok::<_, AccountsError>(())
    });
    removed.unwrap();
    change_access(&models, "fort", closed(AccessState::Withdrawn));
    change_access(&models, "tomb", closed(AccessState::Restricted));
    let mut ended = Vec::new();
    for transfer in transfers {
        let (bytes, is_cut) = rest(transfer).await;
        ended.push(is_cut);
        assert_eq!(is_cut, bytes < LENGTH - 16 * 1024, "cut short, or whole");
    }
    assert_eq!(ended, [true, false, true, true, false], "removed, still allowed, withdrawn, closed, public");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_file_overwritten_during_a_transfer_is_never_sent_as_a_mixture() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("wall.kilwa");
    std::fs::write(&path, noise(LENGTH, 1)).unwrap();
    // As though the file had been there for an hour, because the clocks of some file systems are coarse.
    File::options()
        .write(true)
        .open(&path)
        .unwrap()
        .set_modified(SystemTime::now() - Duration::from_secs(3600))
        .unwrap();
    let app = app(Site::new(Catalogue::open(dir.path()).unwrap(), page()));
    let body = begun(&app, "/packs/wall.kilwa", "").await;
    let mut file = File::options().write(true).open(&path).unwrap();
    file.write_all(&noise(LENGTH, 2)).unwrap();
    let (bytes, is_cut) = rest(body).await;
    assert!(is_cut && bytes < LENGTH / 2, "{bytes} bytes of two files");
}

/// Length of a file that is sent in many pieces.
const FILE: usize = 256 << 10;
/// The same for a file that is sent from memory.
const SMALL_FILE: usize = 60 << 10;

/// Writes a mesh as long as the other files.
fn mesh(to: &Path) -> Result<(), Failure> {
    std::fs::write(to, noise(FILE, 3)).map_err(|e| Failure::Other(e.to_string()))
}

/// The reader.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Who {
    /// Anybody.
    Anybody,
    /// With a token but no grants.
    Stranger,
    /// With a token and a grant for everything.
    Robot,
    /// With another token and a grant for everything.
    Other,
    /// Signed in with a password and granted everything; has opened the model in the browser.
    Visitor,
}

/// What happens during the transfer.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Change {
    None,
    /// The model is restricted, put under embargo or withdrawn.
    To(AccessState),
    /// Its folder is moved away.
    Moved,
    UserRemoved,
    TokenRevoked,
    GrantRevoked,
    SignedOut,
}

/// Create an object whose files are long enough for the test. Returns the addresses at which they are served.
fn long_object(models: &Path, slug: &str, access: Access) -> Vec<(String, Option<&'static str>)> {
    let mut manifest = object(models, slug, &[noise(FILE, 1)], access);
    let root = models.join(slug);
    let list = root.join("v1/checksums.sha256");
    let mut sums = Checksums::parse(&std::fs::read_to_string(&list).unwrap()).unwrap();
    std::fs::create_dir_all(root.join("v1/iiif")).unwrap();
    let long = ["preview.glb", "annotations.json", "iiif/annotations.json", "poster.jpg"];
    for name in long {
        let bytes = noise(FILE, name.len() as u64);
        std::fs::write(root.join("v1").join(name), &bytes).unwrap();
        sums.add(name, sha256(&bytes));
    }
    std::fs::write(root.join("annotations.json"), noise(SMALL_FILE, 5)).unwrap();
    let text = sums.to_text();
    std::fs::write(&list, &text).unwrap();
    let entry = &mut manifest.versions[0].checksums;
    (entry.bytes, entry.sha256) = (text.len() as u64, sha256(text.as_bytes()));
    std::fs::write(root.join("manifest.json"), manifest.to_bytes().unwrap()).unwrap();

    let pack = &manifest.versions[0].pack;
    let (last, half) = (FILE - 1, FILE / 2);
    let packs = [
        format!("/{slug}/{}", pack.url),
        format!("/packs/{slug}.kilwa"),
        format!("/packs/{slug}.{}.kilwa", pack.sha256),
    ];
    let mut addresses = Vec::new();
    for pack in packs {
        addresses.push((format!("{pack}/0-{last}"), None));
        addresses.push((format!("{pack}/{half}-{last},0-{}", half - 1), None));
        addresses.push((pack.clone(), Some("bytes=0-")));
        addresses.push((pack, None));
    }
    addresses.extend(long.map(|name| (format!("/{slug}/v1/{name}"), None)));
    addresses.push((format!("/{slug}/v1/preview.glb"), Some("bytes=1-")));
    addresses.push((format!("/{slug}/annotations.json"), None));
    addresses.push((format!("/packs/{slug}.annotations.json"), None));
    addresses.push((format!("/{slug}/extract/v1-whole.ply"), None));
    addresses
}

async fn send(app: &Router, request: axum::http::request::Builder, form: &str) -> Answer {
    let request = request.header("host", "museum.example").body(Body::from(form.to_owned())).unwrap();
    Answer::of(app.clone().oneshot(request).await.unwrap()).await
}

/// `name=value` of the cookie that an answer sets.
fn cookie(answer: &Answer) -> String {
    answer.header("set-cookie").split(';').next().unwrap_or_default().to_owned()
}

/// Whether a transfer must end: a request at the same address would be refused now.
fn must_end(address: &str, who: Who, change: Change) -> bool {
    let is_public_only = address.starts_with("/packs/");
    match change {
        Change::None => false,
        Change::To(AccessState::Withdrawn) | Change::Moved => true,
        // Pictures are for everybody.
        _ if Path::new(address).extension().is_some_and(|end| end == "jpg") => false,
        Change::To(_) => is_public_only || matches!(who, Who::Anybody | Who::Stranger),
        Change::UserRemoved | Change::TokenRevoked | Change::GrantRevoked | Change::SignedOut => true,
    }
}

/// Every address that serves a model, and every way in which access to it can end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_transfer_of_a_model_ends_once_a_request_for_it_would_be_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (models, file) = (folder.path().join("models"), folder.path().join("access.json"));
    std::fs::create_dir(&models).unwrap();
    let mut accounts = Accounts::new().unwrap();
    let all = Grant::All;
    for robot in ["removed", "revoked", "ungranted", "other"] {
        accounts.set_user(robot, &all, None).unwrap();
    }
    accounts.set_user("stranger", &Grant::Objects(Vec::new()), None).unwrap();
    accounts.set_user("visitor", &all, Some("a long sentence")).unwrap();
    let mut token = |name: &str| accounts.add_token(name, Purpose::View, 30, NOW).unwrap();
    let (removed, revoked, ungranted) = (token("removed"), token("revoked"), token("ungranted"));
    let (other, stranger) = (token("other"), token("stranger"));
    accounts.create(&file).unwrap();

    let (embargo, restricted, withdrawn) = (AccessState::Embargo, AccessState::Restricted, AccessState::Withdrawn);
    let cases = [
        ("open", AccessState::Public, Who::Anybody, Change::None),
        ("closing", AccessState::Public, Who::Anybody, Change::To(restricted)),
        ("embargoed", AccessState::Public, Who::Anybody, Change::To(embargo)),
        ("withdrawn", AccessState::Public, Who::Anybody, Change::To(withdrawn)),
        ("moved", AccessState::Public, Who::Anybody, Change::Moved),
        ("to-stranger", AccessState::Public, Who::Stranger, Change::To(restricted)),
        ("to-granted", AccessState::Public, Who::Other, Change::To(restricted)),
        ("from-granted", restricted, Who::Other, Change::To(withdrawn)),
        ("unchanged", restricted, Who::Other, Change::None),
        ("user", restricted, Who::Robot, Change::UserRemoved),
        ("token", restricted, Who::Robot, Change::TokenRevoked),
        ("grant", restricted, Who::Robot, Change::GrantRevoked),
        ("session", restricted, Who::Visitor, Change::SignedOut),
    ];
    let addresses: Vec<_> = cases
        .iter()
        .map(|(slug, state, ..)| {
            let access = if *state == AccessState::Public { public() } else { closed(*state) };
            long_object(&models, slug, access)
        })
        .collect();
    let mut site = always_checking(&models);
    site.auth = Some(Arc::new(Auth::open(&file, None).unwrap().with_freshness(Duration::ZERO)));
    site.extracts = Some(
        Extracts::with_extractor(folder.path().join("cache"), 140_000_000, Arc::new(|_, to, _, _, _| mesh(to)))
            .unwrap(),
    );
    let app = app(site);
    let post = Request::post("/sign-in");
    let signed_in = send(&app, post, "name=visitor&password=a+long+sentence&next=%2F").await;
    let session = cookie(&signed_in);
    assert_eq!(signed_in.status, 303, "{}", signed_in.text());

    let mut transfers = Vec::new();
    for ((slug, state, who, change), addresses) in cases.into_iter().zip(addresses) {
        let (name, value) = match (who, change) {
            (Who::Anybody, _) => ("authorization", String::new()),
            (Who::Stranger, _) => ("authorization", format!("Bearer {stranger}")),
            (Who::Other, _) => ("authorization", format!("Bearer {other}")),
            (Who::Robot, Change::UserRemoved) => ("authorization", format!("Bearer {removed}")),
            (Who::Robot, Change::TokenRevoked) => ("authorization", format!("Bearer {revoked}")),
            (Who::Robot, _) => ("authorization", format!("Bearer {ungranted}")),
            (Who::Visitor, _) => {
                let open = Request::post(format!("/{slug}/open")).header("cookie", &session);
                let opened = send(&app, open, "").await;
                assert_eq!(opened.status, 204, "{}", opened.text());
                ("cookie", format!("{session}; {}", cookie(&opened)))
            }
        };
        let form = Request::post(format!("/{slug}/extract")).header(name, &value);
        assert_eq!(send(&app, form, "format=ply&detail=whole").await.status, 303, "{slug}");
        for (address, range) in addresses {
            // Closed models have no address there.
            if state != AccessState::Public && address.starts_with("/packs/") {
                continue;
            }
            let response = eventually_async(&address, async || {
                let request = Request::get(&address).header(name, &value);
                let request = if let Some(range) = range { request.header("range", range) } else { request };
                let response = app.clone().oneshot(request.body(Body::empty()).unwrap()).await.unwrap();
                (response.status() != 202).then_some(response)
            })
            .await;
            assert!(response.status().is_success(), "{address}: {}", response.status());
            let length: usize = response.headers()["content-length"].to_str().unwrap().parse().unwrap();
            let mut body = response.into_body().into_data_stream();
            let first = body.next().await.unwrap().unwrap().len();
            assert!(first <= 16 << 10, "{address}: {first} bytes at once");
            transfers.push((address, range, who, change, length, first, body));
        }
    }

    for (slug, _, _, change) in cases {
        match change {
            Change::To(state) => {
                let until = (state == AccessState::Embargo).then(|| "2999-01-01".to_owned());
                change_access(&models, slug, Access { until, ..closed(state) });
            }
            Change::Moved => std::fs::rename(models.join(slug), folder.path().join(slug)).unwrap(),
            _ => {}
        }
    }
    let changed = Accounts::change(&file, |accounts| {
        accounts.remove_user("removed")?;
        accounts.set_user("ungranted", &Grant::Objects(Vec::new()), None)?;
        let id = accounts.of_token(&revoked, NOW).unwrap().1.id.clone();
        accounts.revoke(&id)
    });
    changed.unwrap();
    let out = Request::post("/sign-out").header("cookie", &session);
    assert_eq!(send(&app, out, "").await.status, 303);

    let mut wrong = Vec::new();
    for (address, range, who, change, length, first, body) in transfers {
        let (more, is_cut) = rest(body).await;
        assert_eq!(is_cut, first + more < length, "{address}: cut short, or whole");
        if is_cut != must_end(&address, who, change) {
            wrong.push(format!("{address} {range:?} {who:?} {change:?}: ended: {is_cut}"));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
