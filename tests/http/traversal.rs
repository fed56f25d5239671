//! Addresses that try to leave the folder, written to the socket verbatim: 400 or 404 for every spelling.

use super::check_none;
use super::client::Client;
use super::process::Server;

const UP: [&str; 12] = [
    "..",
    "%2e%2e",
    "%2E%2E",
    ".%2e",
    "%252e%252e",
    "..%00",
    "%c0%ae%c0%ae",
    "%e0%80%ae%e0%80%ae",
    "..;",
    "....",
    "..%20",
    "%u002e%u002e",
];
const SLASH: [&str; 8] = ["/", "//", "%2f", "%2F", "%5c", "\\", "%252f", "%c0%af"];
const ROOTS: [&str; 7] = ["/", "/packs/", "/viewer/", "/m/", "/broken/", "/broken/v1/", "/packs/broken.kilwa/"];

/// Whole addresses that are odd in other ways.
const ODD: [&str; 24] = [
    "/etc/passwd",
    "//etc/passwd",
    "///etc/passwd",
    "/./etc/passwd",
    "/packs//etc/passwd",
    "/packs/secret.txt",
    "/packs/.kilwa",
    "/packs/%2fetc%2fpasswd.kilwa",
    "/packs/broken.kilwa%00.txt",
    "/packs/broken%00.kilwa",
    "/packs/BROKEN.KILWA",
    "/packs/broken.kilwa/",
    "/packs/broken..kilwa",
    "/packs/broken.kilwa::$DATA",
    "/packs/con.kilwa",
    "/packs/~root.kilwa",
    "/viewer/index.html/../../secret.txt",
    "/viewer/C:%5cWindows%5cwin.ini",
    "/viewer/file:///etc/passwd",
    "/%ff%fe",
    "/%",
    "/%zz",
    "/packs/%f0%9f%92%a9.kilwa",
    "http://x/../../etc/passwd",
];

#[tokio::test]
async fn no_address_leaves_the_folder() {
    let server = Server::start(&[("broken", b"no pack, but served")], &[]);
    std::fs::write(server.folder().join("secret.txt"), "the secret").unwrap();
    std::fs::write(server.scratch().join("secret.txt"), "the secret").unwrap();
    let mut addresses: Vec<String> = ODD.iter().map(|&odd| odd.to_owned()).collect();
    for root in ROOTS {
        for up in UP {
            for slash in SLASH {
                addresses.push(format!("{root}{up}{slash}secret.txt"));
                addresses.push(format!("{root}{up}{slash}{up}{slash}{up}{slash}etc{slash}passwd"));
            }
        }
    }
    let mut wrong = Vec::new();
    let mut client = Client::connect(server.address).await.unwrap();
    for address in &addresses {
        let answer = if let Ok(answer) = client.get(address, "").await {
            answer
        } else {
            // What is no HTTP at all is answered 400 and ends the connection, so the next one begins on another.
            client = Client::connect(server.address).await.unwrap();
            client.get(address, "Connection: close\r\n").await.unwrap()
        };
        let is_told = String::from_utf8_lossy(&answer.body).contains("the secret") || answer.head.contains("root:");
        if !matches!(answer.status, 400 | 404) || is_told {
            wrong.push(format!("{address}: {}", answer.head.lines().next().unwrap_or_default()));
        }
    }
    assert!(addresses.len() >= 200);
    check_none("hostile addresses answered other than 400 or 404", addresses.len(), &wrong);
    assert_eq!(Client::connect(server.address).await.unwrap().get("/healthz", "").await.unwrap().status, 200);
}
