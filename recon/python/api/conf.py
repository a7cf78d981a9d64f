# SPDX-License-Identifier: MIT
"""Configures Sphinx for the API pages (scripts/manual --api OUT). The build reports each public
name without a docstring."""
import pathlib
import sys
from typing import Any

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from sphinx.pycode import ModuleAnalyzer  # noqa: E402
from sphinx.util import logging  # noqa: E402

project = "echofuse"
extensions = ["sphinx.ext.autodoc"]
autodoc_default_options = {"members": True, "undoc-members": True, "member-order": "bysource"}
html_theme = "alabaster"
toc_object_entries_show_parents = "hide"


def require_text(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    without = [] if any(lines) else [name]
    if what == "class":
        texts = ModuleAnalyzer.for_module(obj.__module__).find_attr_docs()
        without += [f"{name}.{field}" for field in vars(obj).get("__annotations__", {})
                    if not field.startswith("_") and (obj.__qualname__, field) not in texts]
    for missing in without:
        logging.getLogger(__name__).warning("%s has no docstring", missing)


def setup(app: Any) -> None:
    app.connect("autodoc-process-docstring", require_text)
