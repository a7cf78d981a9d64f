# SPDX-License-Identifier: MIT
"""Pages of the Python package: scripts/manual --api OUT. A public name without a text is an
error."""
import pathlib
import sys
from typing import Any

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sphinx.util import logging  # noqa: E402

project = "echofuse"
extensions = ["sphinx.ext.autodoc"]
autodoc_default_options = {"members": True, "undoc-members": True, "member-order": "bysource"}
autodoc_typehints = "description"
html_theme = "alabaster"


def require_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    if not any(lines):
        logging.getLogger(__name__).warning("%s: %s without a text", name, what)


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", require_text)
