"""Shared by the tests: an application with invenio-previewer, a record with files, and a viewer page."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import entry_points
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tomllib
from flask import Blueprint, Flask, Response, request, send_file
from flask.testing import FlaskClient
from flask_babel import Babel
from invenio_base.app import blueprint_loader
from invenio_previewer import InvenioPreviewer
from invenio_previewer.views import preview

ROOT = Path(__file__).resolve().parents[1]
PREFERENCE = ["kilwa", "txt"]


class FileObject(dict[str, Any]):
    """A file of a record, as invenio-previewer gets it from invenio-records-files."""

    def __init__(self, key: str, size: int) -> None:
        """Remember the name and the size in bytes."""
        super().__init__(size=size)
        self.key = key
        self.bucket_id = "bucket"


@pytest.fixture(scope="session", autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Make the entry points of pyproject.toml known, as pip does."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    site = tmp_path_factory.mktemp("site")
    info = site / f"kilwa_invenio-{project['version']}.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: kilwa-invenio\nVersion: {project['version']}\n")
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups))
    sys.path.insert(0, str(site))
    importlib.invalidate_caches()
    yield
    sys.path.remove(str(site))


@pytest.fixture
def viewer_folder(tmp_path: Path) -> Path:
    """Return a folder like www/dist, with a page, a module, WebAssembly, and a compressed form."""
    folder = tmp_path / "viewer"
    folder.mkdir()
    (tmp_path / "secret.txt").write_text("not for readers")
    (folder / "index.html").write_text("<!doctype html><title>Kilwa</title>")
    (folder / "app.js").write_text("export {};")
    (folder / "app.js.gz").write_bytes(b"\x1f\x8bgzip")
    (folder / "viewer_bg.wasm").write_bytes(b"\0asm")
    return folder


@pytest.fixture
def make_app(tmp_path: Path) -> Callable[..., Flask]:
    """Return a function that makes an application with this configuration.

    `/records/1/preview/NAME` is the preview of the file NAME of a record, made by invenio-previewer; `/records/1/files/NAME`
    sends that file.
    """
    content = tmp_path / "content"
    content.write_bytes(bytes(range(256)))

    def make(**config: Any) -> Flask:
        app = Flask("repository")
        bundles: dict[str, list[str]] = {"PREVIEWER_BASE_CSS_BUNDLES": [], "PREVIEWER_BASE_JS_BUNDLES": []}
        app.config.update(
            TESTING=True,
            PREVIEWER_PREFERENCE=PREFERENCE,
            PREVIEWER_RECORD_FILE_FACOTRY=lambda pid, record, filename: FileObject(filename, content.stat().st_size),
            **bundles,
        )
        app.config.update(config)
        # As invenio-i18n, which needs a database to be loaded.
        Babel(app, locale_selector=lambda: request.accept_languages.best_match(["en", "fr"]))
        InvenioPreviewer(app)
        (blueprint,) = entry_points(group="invenio_base.blueprints", name="kilwa_invenio")
        blueprint_loader(app, modules=[blueprint.load()])
        records = Blueprint("records", __name__)

        @records.route("/records/<pid_value>/preview/<path:filename>", endpoint="recid_preview")
        def record_preview(pid_value: str, filename: str) -> str:
            del filename
            page: str = preview(SimpleNamespace(pid_type="recid", pid_value=pid_value), {})
            return page

        @records.route("/records/<pid_value>/files/<path:filename>", endpoint="recid_files")
        def record_file(pid_value: str, filename: str) -> Response:
            del pid_value, filename
            return send_file(content, mimetype="application/octet-stream", conditional=True)

        app.register_blueprint(records)
        return app

    return make


def preview_of(app: Flask, quoted_name: str, query: str = "", **headers: str) -> str:
    """Return the preview of a file, whose name is quoted as in an address."""
    client: FlaskClient = app.test_client()
    response = client.get(f"/records/1/preview/{quoted_name}{query}", headers=headers)
    assert response.status_code == 200
    return response.get_data(as_text=True)
