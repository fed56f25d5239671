"""The preview of a pack, in an application with invenio-previewer."""

from __future__ import annotations

import logging
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import parse_qs, quote, unquote, urljoin, urlsplit

import pytest
from conftest import preview_of
from flask import Flask

Make = Callable[..., Flask]
# Everything that ends an attribute, an element or a query, and what templates and addresses treat specially.
HOSTILE = """"><script>alert(1)<svg onload=alert(1)><iframe src='javascript:alert(2)' x="&pack=evil#%22{{7*7}}%(name)s.kilwa"""


class Page(HTMLParser):
    """The elements of a page, each a tag and its attributes."""

    def __init__(self, html: str) -> None:
        """Read a page."""
        super().__init__()
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Remember an element."""
        self.elements.append((tag, dict(attrs)))

    def frame(self) -> dict[str, str | None]:
        """Return the attributes of the only frame."""
        (frame,) = [attributes for tag, attributes in self.elements if tag == "iframe"]
        return frame

    def source(self) -> tuple[str, dict[str, str]]:
        """Return the address of the only frame, without its query, and the query's parameters, each of which occurs once."""
        address = self.frame()["src"] or ""
        parts = urlsplit(address)
        assert not parts.fragment
        parameters = parse_qs(parts.query, strict_parsing=True)
        assert all(len(values) == 1 for values in parameters.values())
        return address.partition("?")[0], {name: values[0] for name, values in parameters.items()}


def test_a_pack_is_shown_by_the_viewer_of_this_site(make_app: Make, viewer_folder: Path) -> None:
    """The frame shows the viewer page, which is there, with the file, which is there and answers Range."""
    app = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder))
    page = Page(preview_of(app, "fort.kilwa"))
    address, parameters = page.source()
    assert (address, parameters["embed"], parameters["pack"]) == ("/kilwa/viewer/index.html", "1", "/records/1/files/fort.kilwa")
    assert page.frame()["title"] == "fort.kilwa"
    client = app.test_client()
    assert "Kilwa" in client.get(address).get_data(as_text=True)
    part = client.get(urljoin(address, parameters["pack"]), headers={"Range": "bytes=10-19"})
    assert (part.status_code, part.data, part.headers["Content-Range"]) == (206, bytes(range(10, 20)), "bytes 10-19/256")
    styles = [attributes["href"] for tag, attributes in page.elements if tag == "link"]
    assert [client.get(style).status_code for style in styles] == [200]


@pytest.mark.parametrize("name", ["FORT.KILWA", "a.b.kilwa", "north/fort.kilwa"])
def test_packs_are_recognised_by_the_end_of_their_name(make_app: Make, viewer_folder: Path, name: str) -> None:
    """Upper case, several dots and folders make no difference."""
    page = Page(preview_of(make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)), name))
    assert page.source()[1]["pack"] == f"/records/1/files/{name}"


@pytest.mark.parametrize("name", ["fort.ply", "kilwa", "fort.kilwa.gz", "fort.kilwa.zip", "fortkilwa"])
def test_other_files_are_left_to_other_previewers(make_app: Make, viewer_folder: Path, name: str) -> None:
    """No frame: invenio-previewer says that it cannot show the file."""
    html = preview_of(make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)), name)
    assert "iframe" not in html and "Cannot preview file" in html


def test_it_is_used_only_if_it_is_among_the_preferred_previewers(make_app: Make, viewer_folder: Path) -> None:
    """As every previewer, and templates can ask whether packs can be shown."""
    off = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder), PREVIEWER_PREFERENCE=["txt"])
    assert "iframe" not in preview_of(off, "fort.kilwa")
    on = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder))
    for app, expected in [(on, "yes"), (off, "no")]:
        with app.test_request_context():
            template = app.jinja_env.from_string("{{ 'yes' if 'kilwa' is previewable else 'no' }}")
            assert template.render() == expected


@pytest.mark.parametrize("viewer", ["folder", "https://viewer.example/kilwa/"])
def test_a_hostile_name_is_only_a_name(make_app: Make, viewer_folder: Path, viewer: str) -> None:
    """The page has the same elements as for a harmless name, and the address leads to the same file."""
    config = {"KILWA_VIEWER_FOLDER": str(viewer_folder)} if viewer == "folder" else {"KILWA_VIEWER_URL": viewer}
    app = make_app(**config)
    harmless, hostile = Page(preview_of(app, "fort.kilwa")), Page(preview_of(app, quote(HOSTILE)))
    assert [(tag, sorted(attributes)) for tag, attributes in hostile.elements] == [
        (tag, sorted(attributes)) for tag, attributes in harmless.elements
    ]
    assert hostile.frame()["title"] == HOSTILE
    address, parameters = hostile.source()
    assert address == harmless.source()[0]
    pack = urlsplit(parameters["pack"])
    assert unquote(pack.path) == f"/records/1/files/{HOSTILE}" and not pack.query and not pack.fragment


def test_a_viewer_on_another_site_gets_a_complete_address(make_app: Make) -> None:
    """It would look for a path on its own site."""
    app = make_app(KILWA_VIEWER_URL="https://viewer.example/kilwa/")
    address, parameters = Page(preview_of(app, "fort.kilwa")).source()
    assert (address, parameters["pack"]) == ("https://viewer.example/kilwa/", "http://localhost/records/1/files/fort.kilwa")


def test_a_viewer_that_the_proxy_serves_gets_a_path(make_app: Make) -> None:
    """A proxy that does not pass on its scheme and host does no harm."""
    address, parameters = Page(preview_of(make_app(KILWA_VIEWER_URL="/viewer/"), "fort.kilwa")).source()
    assert (address, parameters["pack"]) == ("/viewer/", "/records/1/files/fort.kilwa")


def test_the_viewer_is_in_the_language_of_the_page(make_app: Make, viewer_folder: Path) -> None:
    """The viewer need not guess it from the browser again."""
    app = make_app(KILWA_VIEWER_FOLDER=str(viewer_folder))
    assert Page(preview_of(app, "fort.kilwa", **{"Accept-Language": "fr"})).source()[1]["lang"] == "fr"


@pytest.mark.parametrize(
    ("config", "reason"),
    [
        ({}, "neither KILWA_VIEWER_FOLDER nor KILWA_VIEWER_URL is set"),
        ({"KILWA_VIEWER_FOLDER": "/nowhere"}, "'/nowhere/index.html' is not a file"),
        ({"KILWA_VIEWER_FOLDER": "viewer"}, "must be an absolute path"),
        ({"KILWA_VIEWER_FOLDER": "/a", "KILWA_VIEWER_URL": "/b"}, "both set"),
        ({"KILWA_VIEWER_URL": "viewer.example"}, "must be a path"),
        ({"KILWA_VIEWER_URL": "//viewer.example/"}, "must be a path"),
        ({"KILWA_VIEWER_URL": "javascript:alert(1)//"}, "must be a path"),
        ({"KILWA_VIEWER_URL": "https://viewer.example/?pack=x"}, "must be a path"),
        ({"KILWA_VIEWER_URL": "https://[::1/"}, "must be a path"),
        ({"KILWA_VIEWER_URL": 7}, "must be a path"),
    ],
)
def test_without_a_viewer_readers_get_a_message_and_the_operator_the_reason(
    make_app: Make, caplog: pytest.LogCaptureFixture, config: dict[str, object], reason: str
) -> None:
    """The reason, which names folders, is in the log; only an application in debug mode shows it."""
    with caplog.at_level(logging.ERROR):
        html = preview_of(make_app(**config), "fort.kilwa")
    assert "the viewer is not installed on this server" in html and "iframe" not in html and "KILWA" not in html
    assert reason in caplog.text
    shown = Page(preview_of(make_app(**config, DEBUG=True), "fort.kilwa"))
    assert "code" in [tag for tag, _ in shown.elements]


def test_the_page_has_no_inline_script_or_style(make_app: Make, viewer_folder: Path) -> None:
    """So it works with the policy that Invenio has by default, `default-src 'self'`."""
    page = Page(preview_of(make_app(KILWA_VIEWER_FOLDER=str(viewer_folder)), "fort.kilwa"))
    assert not [tag for tag, attributes in page.elements if tag in ("style", "script") or "style" in attributes]
