"""Where the viewer page is, and how this application serves its files if they are in a folder.

Configuration:

* `KILWA_VIEWER_FOLDER`: a folder with the built viewer page, which is served below `/kilwa/viewer/`; or
* `KILWA_VIEWER_URL`: the address of a viewer page that another server sends, absolute or beginning with `/`;
* `KILWA_PACK_ORIGINS`: with a folder, a list of other origins from which packs may come, such as `https://s3.example.org`.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urlsplit

from flask import Blueprint, Flask, Response, abort, current_app, request, send_from_directory, url_for
from werkzeug.security import safe_join

FOLDER = "KILWA_VIEWER_FOLDER"
URL = "KILWA_VIEWER_URL"
ORIGINS = "KILWA_PACK_ORIGINS"

# What the viewer page needs: its own files, WebAssembly, and pictures that it makes itself, as `kilwa serve` allows it.
_POLICY = {
    "default-src": "'self'",
    "script-src": "'self' 'wasm-unsafe-eval'",
    "worker-src": "'self'",
    "img-src": "'self' data: blob:",
    "object-src": "'none'",
    "base-uri": "'self'",
    "form-action": "'self'",
    "frame-ancestors": "'self'",
}
# The system's table of media types may be incomplete, and browsers refuse modules and WebAssembly of another type.
_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
    ".wasm": "application/wasm",
}
_COMPRESSED = {"br": ".br", "gzip": ".gz"}
_ORIGIN = re.compile(r"https?://(\*\.)?[A-Za-z0-9.-]+(:[0-9]{1,5})?")


class NotConfigured(Exception):
    """The viewer page is not installed, or its configuration is wrong; the text is for the operator."""


def create_blueprint(app: Flask) -> Blueprint:
    """Return the blueprint with the template of the preview and the files of the viewer page.

    Raises `NotConfigured`, which stops the application, if `KILWA_PACK_ORIGINS` is not a list of origins.
    """
    policy = policy_of(app)
    header = "; ".join(f"{part} {value}" for part, value in policy.items())

    def viewer_file(name: str) -> Response:
        response = _send(name)
        response.headers["Content-Security-Policy"] = header
        return response

    # Flask-Talisman, which Invenio uses, gives every response the policy of its view, or else that of the application.
    viewer_file.talisman_view_options = {"content_security_policy": policy, "frame_options": "SAMEORIGIN"}  # type: ignore[attr-defined]
    blueprint = Blueprint("kilwa_invenio", __name__, url_prefix="/kilwa", template_folder="templates", static_folder="static")
    blueprint.add_url_rule("/viewer/<path:name>", "viewer_file", viewer_file)
    return blueprint


def policy_of(app: Flask) -> dict[str, str]:
    """Return the Content-Security-Policy of the viewer's files, by directive. Raises `NotConfigured`."""
    origins = app.config.get(ORIGINS) or []
    if not isinstance(origins, (list, tuple)):
        raise NotConfigured(f"{ORIGINS} is {origins!r}; it must be a list of origins")
    for origin in origins:
        if not (isinstance(origin, str) and _ORIGIN.fullmatch(origin)):
            raise NotConfigured(f"{ORIGINS} contains {origin!r}; expected an origin such as 'https://s3.example.org'")
    return {**_POLICY, "connect-src": " ".join(["'self'", *origins])} if origins else _POLICY


def viewer_page() -> str:
    """Return the address of the viewer page: absolute, or a path of this site. Raises `NotConfigured` if there is none."""
    folder, url = current_app.config.get(FOLDER), current_app.config.get(URL)
    if folder and url:
        raise NotConfigured(f"{FOLDER} and {URL} are both set; remove one of them")
    if folder:
        page = Path(folder) / "index.html"
        if not page.is_absolute():
            raise NotConfigured(f"{FOLDER} is {str(folder)!r}; it must be an absolute path")
        if not page.is_file():
            raise NotConfigured(f"{FOLDER} is {str(folder)!r}, but {str(page)!r} is not a file that this application can read")
        return url_for("kilwa_invenio.viewer_file", name="index.html")
    if not url:
        raise NotConfigured(f"neither {FOLDER} nor {URL} is set")
    if not _is_page(url):
        raise NotConfigured(f"{URL} is {url!r}; it must be a path such as '/viewer/' or an address that begins with https://")
    return str(url)


def _is_page(url: object) -> bool:
    """Return whether this is an address of a page, to which parameters can be added."""
    if not isinstance(url, str):
        return False
    try:
        parts = urlsplit(url)
    except ValueError:
        return False
    if parts.query or parts.fragment:
        return False
    return bool(parts.hostname) if parts.scheme in ("http", "https") else url.startswith("/") and not url.startswith("//")


def _send(name: str) -> Response:
    """Return a file of the folder, compressed beforehand if the browser accepts that."""
    folder = current_app.config.get(FOLDER)
    path = safe_join(str(folder), name) if folder else None
    if path is None:
        abort(404)
    encoding = next((e for e, end in _COMPRESSED.items() if request.accept_encodings[e] > 0 and Path(path + end).is_file()), None)
    response = send_from_directory(str(folder), name + _COMPRESSED.get(encoding or "", ""), conditional=True)
    if encoding:
        response.headers["Content-Encoding"] = encoding
    response.vary.add("Accept-Encoding")
    if media_type := _TYPES.get(Path(name).suffix):
        response.headers["Content-Type"] = media_type
    # The names of the viewer's files do not change with their content, so each is asked for again, and answered with 304.
    response.headers["Cache-Control"] = "no-cache"
    response.headers["X-Content-Type-Options"] = "nosniff"
    return response
