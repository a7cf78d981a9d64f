# SPDX-License-Identifier: MIT
"""Builds the contents of a report as JSON, drawn by the scripts of the live page (recon/web):
    {"title", "verdict", "fails": [text], "more": text, "origin": text, "span": [near_m, far_m],
    "records": [record],
     "first": [block], "sections": [{"id", "heading", "blocks": [block]}]}
A block has a "kind"; recon/web/report.js has one function per kind. The units of
packed values (base64) are 1 mm for depths (16 bits), 1 cm for deviations (8 bits) and 1/200 for
relative depths ("share", 8 bits)."""
from __future__ import annotations

import base64
import hashlib
import json
import pathlib
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..runs import run_files

__all__ = ["NONE", "PAGE", "Block", "add_series", "cell", "chart", "details", "fails", "html_of",
           "listed", "packed", "paragraph", "pictures", "printable", "short", "table",
           "three_digits"]

Block = dict[str, Any]
PAGE = pathlib.Path(__file__).resolve().parents[1] / "web"  # folder with the scripts and styles
NONE = "\N{EN DASH}"


def table(caption: str, head: Sequence[Any], rows: Sequence[Sequence[Any]],
          baselines: int = 0) -> Block:
    """Returns a table block. The first cell of each row is its title. The last `baselines` rows are
    dimmed. A column with the head {"text": ..., "words": True} is left-aligned."""
    return {"kind": "table", "caption": caption, "head": list(head),
            "rows": [list(row) for row in rows], "baselines": baselines}


def cell(text: str, small: str = "", mark: str = "") -> Block:
    """Returns a table cell with a string, a note in small print, and a mark ("best", "good" or
    "bad")."""
    return {"text": text} | ({"small": small} if small else {}) | ({"mark": mark} if mark else {})


def paragraph(text: str, kind: str = "text") -> Block:
    return {"kind": kind, "text": text}


def fails(sentences: Sequence[str]) -> list[Block]:
    return [{"kind": "fails", "items": list(sentences)}] if sentences else []


def listed(rows: Iterable[Sequence[str]]) -> list[Block]:
    return [{"kind": "list", "rows": [list(row) for row in rows if row[1]]}]


def details(summary: str, *blocks: Block) -> Block:
    return {"kind": "details", "summary": summary, "blocks": list(blocks)}


def pictures(record: int, show: Sequence[str], caption: str, **more: Any) -> Block:
    """Returns a block with pictures of page["records"][record]. `show` lists the pictures: "truth",
    "spd", "radar", or "map", "error", "deviation" or "share" followed by the number of the
    model."""
    return {"kind": "pictures", "record": record, "show": list(show), "caption": caption} | more


def chart(title: str, x: str, y: str, **more: Any) -> Block:
    return {"kind": "chart", "title": title, "x": x, "y": y, "series": [], "rules": []} | more


def add_series(block: Block, name: str, colour: str, look: str, x: Iterable[float],
               y: Iterable[float]) -> None:
    """Adds a curve to a chart; `look` is "dots", "points", "line", "marked" (line with points) or
    "steps"."""
    block["series"].append({"name": name, "colour": colour, "look": look, "x": [*map(short, x)],
                          "y": [*map(short, y)]})


def short(value: float) -> float | None:
    """Rounds to five significant digits; returns None for NaN and infinity."""
    return float(f"{value:.5g}") if np.isfinite(value) else None


def three_digits(value: float) -> str:
    """Formats a value with three significant digits and a decimal prefix, e.g. "103 k"."""
    value = float(f"{value:.3g}")
    size, ending = ((1e6, " M") if abs(value) >= 1e6 else (1e3, " k") if abs(value) >= 1e4
                    else (1, ""))
    return f"{value / size:.4g}{ending}"


def packed(values: NDArray[Any], unit: float, kind: str) -> str:
    """Encodes values in base64. Each value is divided by `unit`, clipped to the range of the
    unsigned integer type `kind`, and rounded. NaN becomes 0."""
    steps = np.clip(np.nan_to_num(values.astype(float) / unit), 0, np.iinfo(kind).max)
    return base64.b64encode(np.floor(steps + 0.5).astype(kind).tobytes()).decode()


def printable(value: Any) -> Any:
    """Escapes line breaks and other control characters in all strings."""
    if isinstance(value, str):
        return run_files.printable(value)
    if isinstance(value, dict):
        return {key: printable(part) for key, part in value.items()}
    return [printable(part) for part in value] if isinstance(value, (list, tuple)) else value


def html_of(page: Block) -> str:
    """Returns the HTML page: recon/web/report.html with styles, scripts and data inserted."""
    def read(name: str) -> str:
        return (PAGE / name).read_text(encoding="utf-8")

    # joins all modules into one script without import and export statements
    scripts = "".join(re.sub(r"(?m)^export ", "", re.sub(r"import [^\n]*\n", "", read(name)))
                      for name in ("charts.js", "maps.js", "cloud.js", "report.js"))
    parts = {"styles": "\n" + "".join(read(name) + "\n"
                                      for name in ("uPlot.min.css", "view.css", "report.css")),
             "uplot": f"\n/*\n{read('uPlot.LICENSE')}*/\n{read('uPlot.iife.min.js')}\n",
             "scripts": "\n" + scripts}
    # Content security policy: the browser runs only scripts and styles with these hashes.
    style, uplot, script = (
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in parts.values())
    # Escapes "<", which could end the script element or begin a comment.
    data = json.dumps(printable(page), ensure_ascii=False, separators=(",", ":"),
                      allow_nan=False).replace("<", "\\u003c")
    parts |= {"data": data, "style_hash": style, "script_hashes": f"{uplot} {script}"}
    return re.sub(r"{{(\w+)}}", lambda found: parts[found[1]], read("report.html"))
