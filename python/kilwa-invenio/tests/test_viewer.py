"""The files of the viewer page, sent from the operator's folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from flask import Flask
from flask_talisman import Talisman

from kilwa_invenio.viewer import NotConfigured

Make = Callable[..., Flask]


def policy_parts(header: str) -> dict[str, list[str]]:
    """Return the sources of each directive of a Content-Security-Policy."""
    return {name: sources for name, *sources in (part.split() for part in header.split(";"))}


@pytest.mark.parametrize("with_talisman", [False, True])
def test_the_viewer_may_do_what_it_needs_whatever_the_policy_of_the_site(
    make_app: Make, viewer_folder: Path, with_talisman: bool
) -> None:
    """The policy of the site, as Invenio sets it by default, would forbid WebAssembly; it stays as it is for other pages."""
    app = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder))
    if with_talisman:
        Talisman(app, content_security_policy={"default-src": "'self'", "object-src": "'none'"}, force_https=False)
    client = app.test_client()
    response = client.get("/kilwa/viewer/index.html")
    policy = policy_parts(response.headers["Content-Security-Policy"])
    assert policy["script-src"] == ["'self'", "'wasm-unsafe-eval'"] and policy["frame-ancestors"] == ["'self'"]
    assert policy["default-src"] == ["'self'"] and "connect-src" not in policy
    assert response.headers.get("X-Frame-Options", "SAMEORIGIN") == "SAMEORIGIN"
    if with_talisman:
        page = client.get("/records/1/preview/fort.kilwa")
        assert policy_parts(page.headers["Content-Security-Policy"]) == {"default-src": ["'self'"], "object-src": ["'none'"]}


def test_packs_may_come_from_named_origins(make_app: Make, viewer_folder: Path) -> None:
    """A repository may redirect downloads to its object storage."""
    app = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder), KILWA_PACK_ORIGINS=["https://s3.example.org", "http://minio:9000"])
    header = app.test_client().get("/kilwa/viewer/index.html").headers["Content-Security-Policy"]
    assert policy_parts(header)["connect-src"] == ["'self'", "https://s3.example.org", "http://minio:9000"]


@pytest.mark.parametrize(
    "origins", ["https://s3.example.org", ["s3.example.org"], ["https://a; script-src *"], [7], ["https://a/b"]]
)
def test_other_values_stop_the_application(make_app: Make, origins: object) -> None:
    """Nothing but origins reaches the policy."""
    with pytest.raises(NotConfigured, match="KILWA_PACK_ORIGINS"):
        make_app(KILWA_PACK_ORIGINS=origins)


@pytest.mark.parametrize(
    ("name", "media_type"),
    [("index.html", "text/html"), ("app.js", "text/javascript"), ("viewer_bg.wasm", "application/wasm")],
)
def test_files_have_the_types_that_browsers_require(make_app: Make, viewer_folder: Path, name: str, media_type: str) -> None:
    """Whatever the system's table of types says."""
    response = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)).test_client().get(f"/kilwa/viewer/{name}")
    assert (response.status_code, response.mimetype) == (200, media_type)
    assert response.headers["X-Content-Type-Options"] == "nosniff"


def test_compressed_forms_are_sent_to_browsers_that_accept_them(make_app: Make, viewer_folder: Path) -> None:
    """An unchanged file is not sent again."""
    client = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)).test_client()
    plain = client.get("/kilwa/viewer/app.js")
    packed = client.get("/kilwa/viewer/app.js", headers={"Accept-Encoding": "gzip, br"})
    assert "Content-Encoding" not in plain.headers and plain.data == b"export {};"
    assert packed.headers["Content-Encoding"] == "gzip" and packed.data == b"\x1f\x8bgzip"
    assert packed.mimetype == "text/javascript" and "Accept-Encoding" in packed.headers["Vary"]
    refused = client.get("/kilwa/viewer/app.js", headers={"Accept-Encoding": "gzip;q=0"})
    assert "Content-Encoding" not in refused.headers
    headers = {"Accept-Encoding": "gzip", "If-None-Match": packed.headers["ETag"]}
    assert client.get("/kilwa/viewer/app.js", headers=headers).status_code == 304


@pytest.mark.parametrize(
    "name", ["../secret.txt", "..%2fsecret.txt", "a/../../secret.txt", "%2fetc%2fpasswd", "", "nothing.js", "."]
)
def test_nothing_but_files_of_the_folder_is_sent(make_app: Make, viewer_folder: Path, name: str) -> None:
    """Also not what lies beside it."""
    client = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)).test_client()
    response = client.get(f"/kilwa/viewer/{name}", headers={"Accept-Encoding": "gzip"}, follow_redirects=True)
    assert response.status_code == 404


def test_without_a_folder_nothing_is_sent(make_app: Make) -> None:
    """The viewer is elsewhere, or nowhere."""
    assert make_app(KILWA_VIEWER_URL="/viewer/").test_client().get("/kilwa/viewer/index.html").status_code == 404
