"""Shows Kilwa packs in the file preview of InvenioRDM and other repositories made with Invenio.

This package adds the previewer `kilwa` to invenio-previewer. The viewer itself is not part of it: the operator installs the
files of Kilwa's viewer page (docs/hosting/invenio.md).
"""

__version__ = "0.1.0"
