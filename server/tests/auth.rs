//! Models that are not public are available only to users with a grant, and only until it expires.

use crate::common::{Answer, ask, get, object, pack, page, public};
use axum::Router;
use axum::body::Body;
use axum::http::{Request, StatusCode};
use kilwa_archive::manifest::{Access, AccessState};
use kilwa_server::access::{Accounts, AccountsError, Grant, Purpose, Sessions};
use kilwa_server::auth::Auth;
use kilwa_server::{Catalogue, Clock, Site, app};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;
use tower::ServiceExt;

/// 2026-11-21T12:00:00Z.
const NOW: u64 = 1_795_262_400;

/// A site with a restricted object, one under embargo and a public one, and a clock that can be set.
struct Museum {
    app: Router,
    clock: Arc<AtomicU64>,
    folder: tempfile::TempDir,
    token: String,
    bytes: Vec<u8>,
    address: String,
}

impl Museum {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let models = folder.path().join("models");
        std::fs::create_dir(&models).unwrap();
        let closed = |state, until: Option<&str>| Access {
            state,
            until: until.map(str::to_owned),
            reason: Some("Graves.".to_owned()),
            ..public()
        };
        let bytes = pack("cave");
        let cave = object(&models, "cave", std::slice::from_ref(&bytes), closed(AccessState::Restricted, None));
        object(&models, "tomb", &[pack("tomb")], closed(AccessState::Embargo, Some("2027-01-01")));
        object(&models, "fort", &[pack("fort")], public());
        object(&models, "gone", &[pack("gone")], closed(AccessState::Withdrawn, None));
        let mut accounts = Accounts::new().unwrap();
        accounts.set_user("amina", &Grant::Objects(vec!["cave".to_owned()]), Some("a long sentence")).unwrap();
        accounts.set_user("omar", &Grant::Objects(Vec::new()), Some("another sentence")).unwrap();
        accounts.set_user("robot", &Grant::All, None).unwrap();
        let token = accounts.add_token("robot", Purpose::View, 30, NOW).unwrap();
        accounts.create(&folder.path().join("access.json")).unwrap();
        let clock = Arc::new(AtomicU64::new(NOW));
        let mut site = Site::new(Catalogue::open(&models).unwrap(), page());
        let time = Arc::clone(&clock);
        site.clock = Clock::new(move || time.load(Ordering::Relaxed));
        let auth = Auth::open(&folder.path().join("access.json"), Some(&folder.path().join("audit.jsonl"))).unwrap();
        site.auth = Some(Arc::new(auth.with_freshness(Duration::ZERO)));
        let address = format!("/cave/{}", cave.versions[0].pack.url);
        Self { app: app(site), clock, folder, token, bytes, address }
    }

    async fn post(&self, uri: &str, headers: &[(&str, &str)], form: &str) -> Answer {
        let mut request = Request::post(uri).header("host", "museum.example");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let response = self.app.clone().oneshot(request.body(Body::from(form.to_owned())).unwrap()).await.unwrap();
        Answer::of(response).await
    }

    /// The session's cookie.
    async fn sign_in(&self, name: &str, password: &str) -> Option<String> {
        let form = format!("name={name}&password={}&next=%2Fcave%2F", password.replace(' ', "+"));
        let answer = self.post("/sign-in", &[("origin", "http://museum.example")], &form).await;
        cookie(&answer).filter(|_| answer.status == StatusCode::SEE_OTHER)
    }

    fn accounts(&self) -> PathBuf {
        self.folder.path().join("access.json")
    }

    async fn fetch(&self, uri: &str, cookie: &str) -> Answer {
        ask(&self.app, "GET", uri, &[("cookie", cookie)]).await
    }
}

/// `name=value` of the cookie that an answer sets.
fn cookie(answer: &Answer) -> Option<String> {
    let set = answer.header("set-cookie");
    (!set.is_empty()).then(|| set.split(';').next().unwrap_or_default().to_owned())
}

fn change(file: &Path, how: impl FnOnce(&mut Accounts)) {
    let changed = Accounts::change(file, |accounts| {
        how(accounts);
        Ok::<_, AccountsError>(())
    });
    changed.unwrap();
}

#[tokio::test]
async fn a_granted_reader_signs_in_opens_the_model_and_gets_its_bytes() {
    let m = Museum::new();
    let refused = m.fetch(&m.address, "").await;
    assert_eq!(refused.status, StatusCode::UNAUTHORIZED);
    assert_eq!(refused.header("kilwa-open"), "/cave/open");
    assert!(refused.text().contains("Graves.") && get(&m.app, "/cave/").await.status == StatusCode::OK);
    let response = m.post("/cave/open", &[], "").await;
    assert_eq!(response.status, StatusCode::UNAUTHORIZED);
    assert!(
        response.text().contains("/sign-in?next=%2Fcave%2F") && response.text().contains("Graves."),
        "{}",
        response.text()
    );

    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    assert_eq!(m.fetch(&m.address, &session).await.status, StatusCode::UNAUTHORIZED, "a session alone gets no bytes");
    let opened = m.post("/cave/open", &[("cookie", &session)], "").await;
    assert_eq!(opened.status, StatusCode::NO_CONTENT);
    let set = opened.header("set-cookie").to_owned();
    assert!(set.contains("Path=/cave/;") && set.contains("HttpOnly") && set.contains("SameSite=Strict"), "{set}");
    let capability = cookie(&opened).unwrap();
    let whole = m.fetch(&m.address, &capability).await;
    assert_eq!((whole.status, &whole.body[..]), (StatusCode::OK, &m.bytes[..]));
    assert_eq!(whole.header("cache-control"), "private, no-store", "nobody on the way keeps it");
    let several = m.fetch(&format!("{}/30-39,10-19", m.address), &capability).await;
    assert_eq!(
        (several.status, several.body[..] == [&m.bytes[30..40], &m.bytes[10..20]].concat()),
        (StatusCode::OK, true)
    );
    assert_eq!(several.header("cache-control"), "private, no-store");
    let part = ask(&m.app, "GET", &m.address, &[("cookie", &capability), ("range", "bytes=10-19")]).await;
    assert_eq!((part.status, &part.body[..]), (StatusCode::PARTIAL_CONTENT, &m.bytes[10..20]));
}

#[tokio::test]
async fn an_expired_capability_is_renewed_without_signing_in_again() {
    let m = Museum::new();
    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    let capability = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    m.clock.store(NOW + 599, Ordering::Relaxed);
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::OK);
    m.clock.store(NOW + 600, Ordering::Relaxed);
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED);
    let next = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    assert_eq!(m.fetch(&m.address, &next).await.status, StatusCode::OK);
    m.clock.store(NOW + 13 * 3600, Ordering::Relaxed);
    assert_eq!(m.post("/cave/open", &[("cookie", &session)], "").await.status, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn nobody_without_a_grant_gets_a_byte() {
    let m = Museum::new();
    let other = m.sign_in("omar", "another sentence").await.expect("signs in");
    assert_eq!(m.post("/cave/open", &[("cookie", &other)], "").await.status, StatusCode::FORBIDDEN);
    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    assert_eq!(m.post("/tomb/open", &[("cookie", &session)], "").await.status, StatusCode::FORBIDDEN, "not granted");
    assert_eq!(m.post("/gone/open", &[("cookie", &session)], "").await.status, StatusCode::GONE);
    assert_eq!(m.post("/fort/open", &[], "").await.status, StatusCode::NO_CONTENT, "public");
    assert_eq!(m.post("/nothing/open", &[], "").await.status, StatusCode::NOT_FOUND);
    assert_eq!(m.post("/cave/index.html", &[], "").await.status, StatusCode::METHOD_NOT_ALLOWED);
    let capability = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    let tomb = kilwa_archive::Manifest::parse(&get(&m.app, "/tomb/manifest.json").await.body).unwrap();
    let tomb = format!("/tomb/{}", tomb.versions[0].pack.url);
    assert_eq!(m.fetch(&tomb, &capability).await.status, StatusCode::UNAUTHORIZED, "it is for another pack");
    for text in
        ["kilwa_pack=", "kilwa_pack=k1.9999999999.amina.00", "kilwa_pack=k1", &capability[..capability.len() - 1]]
    {
        assert_eq!(m.fetch(&m.address, text).await.status, StatusCode::UNAUTHORIZED, "{text}");
    }
    assert_eq!(m.fetch("/packs/cave.kilwa", &capability).await.status, StatusCode::FORBIDDEN);
    // Ranges of a closed model are refused.
    for ranges in ["0-9", "0-9,20-29", "x", ""] {
        let closed = m.fetch(&format!("{}/{ranges}", m.address), "").await;
        assert_eq!((closed.status, closed.header("kilwa-ranges")), (StatusCode::UNAUTHORIZED, ""), "{ranges}");
        let pinned = format!("/packs/cave.kilwa/{ranges}");
        assert!(m.fetch(&pinned, &capability).await.status.is_client_error(), "{pinned}");
        assert_eq!(m.fetch(&format!("{tomb}/{ranges}"), &capability).await.status, StatusCode::UNAUTHORIZED);
    }
}

#[tokio::test]
async fn an_embargoed_model_opens_to_everybody_when_the_embargo_ends() {
    let m = Museum::new();
    let tomb = kilwa_archive::Manifest::parse(&get(&m.app, "/tomb/manifest.json").await.body).unwrap();
    let tomb = format!("/tomb/{}", tomb.versions[0].pack.url);
    let new_year = 1_798_761_600;
    for (now, status) in
        [(new_year - 1, StatusCode::UNAUTHORIZED), (new_year, StatusCode::OK), (new_year + 1, StatusCode::OK)]
    {
        m.clock.store(now, Ordering::Relaxed);
        assert_eq!(get(&m.app, &tomb).await.status, status, "{now}");
    }
}

#[tokio::test]
async fn a_token_is_for_programs_and_works_until_it_is_revoked() {
    let m = Museum::new();
    let bearer = format!("Bearer {}", m.token);
    let with = |value: String| {
        let (app, address) = (m.app.clone(), m.address.clone());
        async move { ask(&app, "GET", &address, &[("authorization", &value)]).await.status }
    };
    assert_eq!(with(bearer.clone()).await, StatusCode::OK);
    assert_eq!(with(bearer[..bearer.len() - 1].to_owned()).await, StatusCode::UNAUTHORIZED);
    let id = Accounts::read(&m.accounts()).unwrap().user("robot").unwrap().tokens[0].id.clone();
    change(&m.accounts(), |a| a.revoke(&id).unwrap());
    assert_eq!(with(bearer).await, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn a_revoked_grant_takes_effect_at_once_and_a_lost_accounts_file_lets_nobody_in() {
    let m = Museum::new();
    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    let capability = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::OK);
    change(&m.accounts(), |a| a.set_user("amina", &Grant::Objects(Vec::new()), None).unwrap());
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED);
    // A restored grant revives no session; an additional one ends none.
    change(&m.accounts(), |a| a.set_user("amina", &Grant::Objects(vec!["cave".to_owned()]), None).unwrap());
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED);
    assert_eq!(m.post("/cave/open", &[("cookie", &session)], "").await.status, StatusCode::UNAUTHORIZED);
    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    let capability = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    change(&m.accounts(), |a| a.set_user("amina", &Grant::All, None).unwrap());
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::OK);
    std::fs::write(m.accounts(), "{ damaged").unwrap();
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED);
    assert!(m.sign_in("amina", "a long sentence").await.is_none());
    assert_eq!(get(&m.app, "/fort/").await.status, StatusCode::OK, "what is public stays so");
}

#[tokio::test]
async fn password_guessing_is_slowed_down_and_logged_without_the_guesses() {
    let m = Museum::new();
    let mut statuses = Vec::new();
    for i in 0..8 {
        let form = format!("name=amina&password=guess-number-{i}");
        statuses.push(m.post("/sign-in", &[], &form).await.status);
    }
    assert_eq!(statuses[..6], [StatusCode::FORBIDDEN; 6]);
    assert_eq!(statuses[6..], [StatusCode::TOO_MANY_REQUESTS; 2]);
    assert!(m.sign_in("amina", "a long sentence").await.is_none(), "the right one has to wait too");
    m.clock.store(NOW + 10, Ordering::Relaxed);
    assert!(m.sign_in("amina", "a long sentence").await.is_some());
    let record = std::fs::read_to_string(m.folder.path().join("audit.jsonl")).unwrap();
    assert!(record.contains("sign-in-failed") && record.contains("\"sign-in\""), "{record}");
    assert!(!record.contains("guess-number") && !record.contains("sentence") && !record.contains("k1."), "{record}");
}

#[tokio::test]
async fn no_other_site_can_sign_a_reader_in_or_out_or_send_them_elsewhere() {
    let m = Museum::new();
    let right = "name=amina&password=a+long+sentence";
    for headers in [
        vec![("origin", "https://evil.example")],
        vec![("origin", "null")],
        vec![("sec-fetch-site", "cross-site")],
        vec![("sec-fetch-site", "same-site"), ("origin", "http://museum.example")],
        vec![("sec-fetch-site", "same-origin"), ("origin", "null")],
        // Another scheme or port is another site: whoever can change plain http could else act for a reader of the site behind TLS.
        vec![("origin", "https://museum.example")],
        vec![("origin", "http://museum.example:8080")],
        vec![("origin", "http://museum.example@evil.example")],
        vec![("origin", "http://museum.example"), ("origin", "https://evil.example")],
        vec![("origin", "museum.example")],
    ] {
        for uri in ["/sign-in", "/sign-out", "/cave/open"] {
            assert_eq!(m.post(uri, &headers, right).await.status, StatusCode::FORBIDDEN, "{headers:?} {uri}");
        }
    }
    for next in ["//evil.example/", "https://evil.example/", "/\\evil.example", "javascript:alert(1)", "/a b", ""] {
        let encoded = next.bytes().fold(String::new(), |s, b| format!("{s}%{b:02X}"));
        let answer = m.post("/sign-in", &[], &format!("{right}&next={encoded}")).await;
        assert_eq!((answer.status, answer.header("location")), (StatusCode::SEE_OTHER, "/"), "{next}");
    }
    let form = get(&m.app, "/sign-in?next=%22%3E%3Cscript%3E&lang=ar").await;
    assert!(form.text().contains("dir=\"rtl\"") && !form.text().contains("<script"), "{}", form.text());
    assert!(form.header("cache-control").contains("no-store"));
}

#[tokio::test]
async fn every_page_of_the_portal_leads_to_signing_in_or_out_and_back() {
    let m = Museum::new();
    let out = get(&m.app, "/?page=2").await;
    assert!(out.text().contains("href=\"/sign-in?next=%2F%3Flang%3Den&amp;lang=en\""), "{}", out.text());
    assert!(out.header("vary").contains("Cookie") && !out.text().contains("/sign-out"));
    let session = m.sign_in("amina", "a long sentence").await.unwrap();
    let signed_in = m.fetch("/", &session).await;
    let html = signed_in.text();
    assert!(html.contains("You are signed in as amina.") && html.contains(">Sign out</button>"), "{html}");
    assert!(!html.contains("/sign-in?"), "{html}");
    assert_eq!(signed_in.header("cache-control"), "private, no-cache");
    // The form for signing in has the way in as its content alone.
    assert!(!get(&m.app, "/sign-in").await.text().contains("class=\"account\""));
    for (next, wanted) in [("%2Fmap%3Flang%3Dsw", "/map?lang=sw"), ("%2F%2Fevil.example%2F", "/"), ("https:x", "/")] {
        let session = m.sign_in("amina", "a long sentence").await.unwrap();
        let answer = m.post("/sign-out", &[("cookie", &session)], &format!("next={next}")).await;
        assert_eq!((answer.status, answer.header("location")), (StatusCode::SEE_OTHER, wanted));
        assert!(m.fetch("/", &session).await.text().contains("/sign-in?"), "the session has ended");
    }
}

#[tokio::test]
async fn without_accounts_there_is_no_sign_in() {
    let m = Museum::new();
    let site = Site::new(Catalogue::open(&m.folder.path().join("models")).unwrap(), page());
    let app = app(site);
    assert_eq!(get(&app, &m.address).await.status, StatusCode::FORBIDDEN);
    assert_eq!(get(&app, "/sign-in").await.status, StatusCode::NOT_FOUND);
    assert!(!get(&app, "/").await.text().contains("sign-in"));
}

#[tokio::test]
async fn a_wrong_clock_grants_no_access_and_the_server_reports_it() {
    let m = Museum::new();
    let tomb = kilwa_archive::Manifest::parse(&get(&m.app, "/tomb/manifest.json").await.body).unwrap();
    let tomb = format!("/tomb/{}", tomb.versions[0].pack.url);
    let session = m.sign_in("amina", "a long sentence").await.expect("signs in");
    let capability = cookie(&m.post("/cave/open", &[("cookie", &session)], "").await).unwrap();
    let bearer = format!("Bearer {}", m.token);
    let with_token = || async { ask(&m.app, "GET", &m.address, &[("authorization", &bearer)]).await.status };
    let (day, new_year) = (86_400, 1_798_761_600);
    assert_eq!(with_token().await, StatusCode::OK);
    // Set back, to before everything was issued and to 1970: nothing issued later works, and the embargo holds.
    for back in [NOW - 2 * day, 0] {
        m.clock.store(back, Ordering::Relaxed);
        assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED, "{back}");
        assert_eq!(m.post("/cave/open", &[("cookie", &session)], "").await.status, StatusCode::UNAUTHORIZED, "{back}");
        assert_eq!(with_token().await, StatusCode::UNAUTHORIZED, "{back}");
        let closed = get(&m.app, &tomb).await;
        assert_eq!(closed.status, StatusCode::UNAUTHORIZED);
        assert!(closed.text().contains("Public from 1 January 2027"), "{}", closed.text());
        assert_eq!(get(&m.app, "/fort/").await.status, StatusCode::OK, "what is public stays so");
    }
    // Forward and back again around the end of the embargo: access always follows the clock.
    for (now, status) in
        [(new_year, StatusCode::OK), (new_year - 1, StatusCode::UNAUTHORIZED), (NOW, StatusCode::UNAUTHORIZED)]
    {
        m.clock.store(now, Ordering::Relaxed);
        assert_eq!(get(&m.app, &tomb).await.status, status, "{now}");
    }
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::OK, "right again, as before");
    // Sessions issued while the clock is ahead are invalid once it is correct.
    m.clock.store(NOW + 400 * day, Ordering::Relaxed);
    assert_eq!(with_token().await, StatusCode::UNAUTHORIZED, "the token has ended");
    let ahead = m.sign_in("amina", "a long sentence").await.expect("signs in");
    m.clock.store(NOW, Ordering::Relaxed);
    assert_eq!(m.post("/cave/open", &[("cookie", &ahead)], "").await.status, StatusCode::UNAUTHORIZED);
    let auth = Auth::open(&m.accounts(), None).unwrap();
    let message = auth.doubt_of_clock(NOW - 2 * day).expect("a doubt");
    assert!(
        message.contains("the clock of this computer says 2026-11-19") && message.contains("clock is corrected"),
        "{message}"
    );
    assert_eq!(auth.doubt_of_clock(NOW), None);
}

/// Another server over the same accounts and models, with sessions kept elsewhere.
fn another(m: &Museum, sessions: Sessions) -> Router {
    let mut site = Site::new(Catalogue::open(&m.folder.path().join("models")).unwrap(), page());
    site.clock = Clock::new(|| NOW);
    let auth = Auth::open(&m.accounts(), None).unwrap().with_freshness(Duration::ZERO);
    site.auth = Some(Arc::new(auth.with_sessions(sessions)));
    app(site)
}

async fn post(app: &Router, uri: &str, cookie: &str, form: &str) -> Answer {
    let request = Request::post(uri).header("host", "museum.example").header("cookie", cookie);
    Answer::of(app.clone().oneshot(request.body(Body::from(form.to_owned())).unwrap()).await.unwrap()).await
}

async fn begin(app: &Router) -> (String, String) {
    let signed = post(app, "/sign-in", "", "name=amina&password=a+long+sentence&next=%2F").await;
    let session = cookie(&signed).expect("signs in");
    let capability = cookie(&post(app, "/cave/open", &session, "").await).expect("opens");
    (session, capability)
}

#[tokio::test]
async fn signing_out_ends_the_session_and_the_access_it_gave() {
    let m = Museum::new();
    let [(one, opened), (two, other)] = [begin(&m.app).await, begin(&m.app).await];
    let out = m.post("/sign-out", &[("cookie", &one)], "").await;
    assert_eq!((out.status, out.header("location")), (StatusCode::SEE_OTHER, "/"));
    assert!(out.header("set-cookie").contains("Max-Age=0"));
    for (cookie, status) in [(&opened, StatusCode::UNAUTHORIZED), (&other, StatusCode::OK)] {
        assert_eq!(m.fetch(&m.address, cookie).await.status, status);
    }
    assert_eq!(m.post("/cave/open", &[("cookie", &one)], "").await.status, StatusCode::UNAUTHORIZED);
    assert!(!m.fetch("/sign-in", &one).await.text().contains("signed in as"));
    assert!(m.fetch("/sign-in", &two).await.text().contains("signed in as amina"));
    // Signing out again, without a session or with an unknown one, is no error.
    for cookie in [&one, "", "kilwa_session=k2.9999999999.amina.00.00"] {
        assert_eq!(m.post("/sign-out", &[("cookie", cookie)], "").await.status, StatusCode::SEE_OTHER, "{cookie}");
    }
    let (three, _) = begin(&m.app).await;
    assert_eq!(m.post("/sign-out", &[("cookie", &two)], "everywhere=1").await.status, StatusCode::SEE_OTHER);
    for session in [&two, &three] {
        assert_eq!(m.post("/cave/open", &[("cookie", session)], "").await.status, StatusCode::UNAUTHORIZED);
    }
    assert_eq!(m.fetch(&m.address, &other).await.status, StatusCode::UNAUTHORIZED);
    let record = std::fs::read_to_string(m.folder.path().join("audit.jsonl")).unwrap();
    assert_eq!(record.matches("\"sign-out\"").count(), 2, "{record}");
}

#[tokio::test]
async fn the_administrator_can_end_sessions_on_every_server() {
    let m = Museum::new();
    let (session, capability) = begin(&m.app).await;
    change(&m.accounts(), |a| a.sign_out("amina").unwrap());
    assert_eq!(m.fetch(&m.address, &capability).await.status, StatusCode::UNAUTHORIZED);
    assert_eq!(m.post("/cave/open", &[("cookie", &session)], "").await.status, StatusCode::UNAUTHORIZED);
    let (session, _) = begin(&m.app).await;
    change(&m.accounts(), |a| {
        a.remove_user("amina").unwrap();
        a.set_user("amina", &Grant::Objects(vec!["cave".to_owned()]), Some("a long sentence")).unwrap();
    });
    assert_eq!(
        m.post("/cave/open", &[("cookie", &session)], "").await.status,
        StatusCode::UNAUTHORIZED,
        "another amina"
    );
}

#[tokio::test]
async fn a_restart_revives_no_ended_session_and_servers_share_a_session_folder() {
    let m = Museum::new();
    let opens = |app: Router, session: String| async move { post(&app, "/cave/open", &session, "").await.status };
    // In memory a restart ends all, and no server knows the sessions of another.
    let first = another(&m, Sessions::default());
    let (session, capability) = begin(&first).await;
    assert_eq!(opens(first.clone(), session.clone()).await, StatusCode::NO_CONTENT);
    let restarted = another(&m, Sessions::default());
    assert_eq!(opens(restarted.clone(), session).await, StatusCode::UNAUTHORIZED);
    assert_eq!(ask(&restarted, "GET", &m.address, &[("cookie", &capability)]).await.status, StatusCode::UNAUTHORIZED);
    // In a folder it ends none, and one that was ended on any of the servers is ended on all, also after a restart.
    let folder = m.folder.path().join("sessions");
    let open = || another(&m, Sessions::in_folder(&folder).unwrap());
    let servers = [open(), open(), open()];
    for trial in 0..200 {
        let pick = |k: usize| &servers[(trial / 3_usize.pow(k as u32)) % 3];
        let (session, capability) = if trial < 3 { begin(pick(0)).await } else { begin_directly(&m, &folder) };
        let kept = begin_directly(&m, &folder);
        assert_eq!(opens(pick(1).clone(), session.clone()).await, StatusCode::NO_CONTENT, "{trial}");
        assert_eq!(post(pick(2), "/sign-out", &session, "").await.status, StatusCode::SEE_OTHER);
        let last = if trial % 50 == 0 { open() } else { pick(3).clone() };
        assert_eq!(opens(last.clone(), session).await, StatusCode::UNAUTHORIZED, "{trial}");
        assert_eq!(ask(&last, "GET", &m.address, &[("cookie", &capability)]).await.status, StatusCode::UNAUTHORIZED);
        assert_eq!(opens(last.clone(), kept.0.clone()).await, StatusCode::NO_CONTENT, "another goes on: {trial}");
        // A user has so many at once.
        post(&last, "/sign-out", &kept.0, "").await;
    }
}

/// A session and a capability without hashing a password, which takes long.
fn begin_directly(m: &Museum, folder: &Path) -> (String, String) {
    let accounts = Accounts::read(&m.accounts()).unwrap();
    let holder = Sessions::in_folder(folder).unwrap().begin("amina", NOW).unwrap();
    let (stamp, c) = (accounts.user("amina").unwrap().stamp(), accounts.capabilities());
    let pack = m.address.split("pack.").nth(1).unwrap().trim_end_matches(".kilwa");
    let capability = c.for_pack(pack, &holder, &stamp, NOW);
    (format!("kilwa_session={}", c.session(&holder, &stamp, NOW)), format!("kilwa_pack={capability}"))
}

#[tokio::test]
async fn a_reader_is_informed_if_a_session_cannot_be_stored_or_ended() {
    let m = Museum::new();
    let folder = m.folder.path().join("sessions");
    let app = another(&m, Sessions::in_folder(&folder).unwrap());
    let (session, _) = begin(&app).await;
    std::fs::rename(&folder, m.folder.path().join("moved")).unwrap();
    let signed = post(&app, "/sign-in", "", "name=amina&password=a+long+sentence&next=%2F").await;
    assert_eq!((signed.status, cookie(&signed)), (StatusCode::SERVICE_UNAVAILABLE, None));
    assert!(signed.text().contains("cannot sign anybody in"), "{}", signed.text());
    assert_eq!(post(&app, "/cave/open", &session, "").await.status, StatusCode::UNAUTHORIZED);
}

#[tokio::test]
async fn signing_out_works_or_reports_that_it_failed() {
    let m = Museum::new();
    let before = std::fs::read(m.accounts()).unwrap();
    let keep = |bytes: &[u8]| std::fs::write(m.accounts(), bytes).unwrap();
    let opens = async |session: &str| m.post("/cave/open", &[("cookie", session)], "").await.status;
    let (session, _) = begin(&m.app).await;
    keep(b"{");
    for form in ["", "everywhere=1"] {
        let out = m.post("/sign-out", &[("cookie", &session)], form).await;
        assert_eq!((out.status, out.header("set-cookie")), (StatusCode::SERVICE_UNAVAILABLE, ""), "{form}");
        assert!(out.text().contains("still signed in"), "{}", out.text());
    }
    // Without a session there is nothing to end.
    assert_eq!(m.post("/sign-out", &[], "").await.status, StatusCode::SEE_OTHER);
    keep(&before);
    assert_eq!(opens(&session).await, StatusCode::NO_CONTENT, "the session continues, as the response states");
    assert_eq!(m.post("/sign-out", &[("cookie", &session)], "").await.status, StatusCode::SEE_OTHER);
    assert_eq!(opens(&session).await, StatusCode::UNAUTHORIZED);
    // A clock that is wrong for an hour hides a session, but does not end it.
    for (clock, form) in [(NOW + 13 * 3600, ""), (NOW - 3600, ""), (NOW + 13 * 3600, "everywhere=1")] {
        let [(session, _), (other, _)] = [begin(&m.app).await, begin(&m.app).await];
        m.clock.store(clock, Ordering::Relaxed);
        assert_eq!(m.post("/sign-out", &[("cookie", &session)], form).await.status, StatusCode::SEE_OTHER);
        m.clock.store(NOW, Ordering::Relaxed);
        assert_eq!(opens(&session).await, StatusCode::UNAUTHORIZED, "{clock}: it was ended");
        let goes_on = if form.is_empty() { StatusCode::NO_CONTENT } else { StatusCode::UNAUTHORIZED };
        assert_eq!(opens(&other).await, goes_on, "{clock} {form}");
    }
}

#[tokio::test]
async fn an_unreadable_session_folder_is_reported_and_ends_no_session() {
    let m = Museum::new();
    let (folder, moved) = (m.folder.path().join("sessions"), m.folder.path().join("moved"));
    let app = another(&m, Sessions::in_folder(&folder).unwrap());
    let (session, _) = begin(&app).await;
    std::fs::rename(&folder, &moved).unwrap();
    std::fs::write(&folder, "no folder").unwrap();
    let out = post(&app, "/sign-out", &session, "").await;
    assert_eq!((out.status, out.header("set-cookie")), (StatusCode::SERVICE_UNAVAILABLE, ""));
    std::fs::remove_file(&folder).unwrap();
    std::fs::rename(&moved, &folder).unwrap();
    assert_eq!(post(&app, "/cave/open", &session, "").await.status, StatusCode::NO_CONTENT);
    assert_eq!(post(&app, "/sign-out", &session, "").await.status, StatusCode::SEE_OTHER);
    assert_eq!(post(&app, "/cave/open", &session, "").await.status, StatusCode::UNAUTHORIZED);
}
