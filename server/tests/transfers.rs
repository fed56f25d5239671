//! What happens to a running transfer when the file changes, or access to it.

use crate::common::{noise, object, page, public};
use axum::Router;
use axum::body::{Body, BodyDataStream};
use axum::http::Request;
use futures_util::StreamExt as _;
use kilwa_archive::manifest::{Access, AccessState, Manifest};
use kilwa_server::access::{Accounts, AccountsError, Grant, Purpose};
use kilwa_server::door::Door;
use kilwa_server::{Catalogue, Clock, Site, app};
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use tower::ServiceExt as _;

const NOW: u64 = 1_795_262_400;
/// Enough bytes to take a slow reader several seconds.
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

/// How many more bytes a slow reader receives, and whether the transfer ends in an error.
async fn rest(mut body: BodyDataStream) -> (usize, bool) {
    let mut bytes = 0;
    while let Some(part) = body.next().await {
        match part {
            Ok(part) => bytes += part.len(),
            Err(_) => return (bytes, true),
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    (bytes, false)
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
async fn a_transfer_ends_when_access_does_and_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let bytes = noise(LENGTH, 1);
    let closed = |state| Access { state, reason: Some("Graves.".to_owned()), ..public() };
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
    let mut site = Site::new(Catalogue::open(&models).unwrap(), page());
    site.clock = Clock::new(|| NOW);
    site.door = Some(Arc::new(Door::open(&file, None).unwrap()));
    let app = app(site);

    let mut transfers = Vec::new();
    for (address, token) in [(&cave, &robot), (&cave, &other), (&fort, &robot), (&tomb, &robot), (&wall, &robot)] {
        transfers.push(tokio::spawn(rest(begun(&app, address, token).await)));
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
        let (bytes, is_cut) = transfer.await.unwrap();
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
