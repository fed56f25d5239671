"""The previewer: which files it shows, and the page for one of them.

invenio-previewer calls `can_preview` and `preview` of this module (entry point group `invenio_previewer.previewers`).
"""

from __future__ import annotations

from typing import Protocol
from urllib.parse import urlencode, urljoin

from flask import current_app, render_template, request
from flask_babel import get_locale
from invenio_previewer.proxies import current_previewer

from kilwa_invenio.viewer import NotConfigured, viewer_page

previewable_extensions = ["kilwa"]


class File(Protocol):
    """What is used of `invenio_previewer.api.PreviewFile` and of its counterpart in InvenioRDM."""

    @property
    def filename(self) -> str:
        """Name of the file."""

    @property
    def uri(self) -> str:
        """Address from which the file can be downloaded."""

    def has_extensions(self, *extensions: str) -> bool:
        """Return whether the name ends with one of these, each with its dot."""


def can_preview(file: File) -> bool:
    """Return whether the file is a pack, by its name."""
    return file.has_extensions(*(f".{extension}" for extension in previewable_extensions))


def preview(file: File) -> str:
    """Return the page that shows the pack, or one that says that the viewer is not installed."""
    source = reason = None
    try:
        source = address(file)
    except NotConfigured as error:
        reason = str(error)
        current_app.logger.error("Kilwa packs cannot be previewed: %s", reason)
    return render_template(
        "kilwa_invenio/preview.html",
        file=file,
        source=source,
        # The reason names settings and folders: only for developers; the log has it in any case.
        reason=reason if current_app.debug else None,
        js_bundles=current_previewer.js_bundles,
        css_bundles=current_previewer.css_bundles,
    )


def address(file: File) -> str:
    """Return the address of the viewer page with this file.

    The address of the file is a path if the viewer page is on the same site, so that a proxy that does not pass on the scheme
    or the host does no harm. Raises `NotConfigured`.
    """
    page = viewer_page()
    pack = file.uri if page.startswith("/") else urljoin(request.url, file.uri)
    parameters = {"embed": "1", "pack": pack}
    locale = get_locale()
    if locale is not None:
        parameters["lang"] = locale.language
    return f"{page}?{urlencode(parameters)}"
