# SPDX-License-Identifier: MIT
"""The page of a report as JSON, which the scripts of the live page (recon/web) draw:
    {"title", "verdict", "fails": [text], "more": text, "origin": text, "span": [near_m, far_m],
    "records": [record],
     "first": [block], "sections": [{"id", "heading", "blocks": [block]}]}
A block has a "kind"; recon/web/report.js has a function for each. Depths of records are whole
millimetres (16 bits, base64), deviations centimetres and shares 1/200 (8 bits)."""
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

Block = dict[str, Any]
PAGE = pathlib.Path(__file__).resolve().parents[1] / "web"  # scripts and styles
NONE = "\N{EN DASH}"


def table(caption: str, head: Sequence[Any], rows: Sequence[Sequence[Any]],
          baselines: int = 0) -> Block:
    """The first cell of a row is its head; so many rows at the end are quiet. A head may be
    {"text", "words": True}: of a column of words, which stands at the left."""
    return {"kind": "table", "caption": caption, "head": list(head),
            "rows": [list(row) for row in rows], "baselines": baselines}


def cell(text: str, small: str = "", mark: str = "") -> Block:
    """A text, something small behind it, and a mark: "best", "good", "bad"."""
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
    """Pictures of a record of the page's list: each "truth", "spd", "radar", or "map", "error",
    "deviation", "share" and the number of its model."""
    return {"kind": "pictures", "record": record, "show": list(show), "caption": caption} | more


def chart(title: str, x: str, y: str, **more: Any) -> Block:
    return {"kind": "chart", "title": title, "x": x, "y": y, "series": [], "rules": []} | more


def add_series(one: Block, name: str, colour: str, look: str, x: Iterable[float],
               y: Iterable[float]) -> None:
    """look: "dots", "points", "line", "marked" (a line with its points) or "steps"."""
    one["series"].append({"name": name, "colour": colour, "look": look, "x": [*map(short, x)],
                          "y": [*map(short, y)]})


def short(value: float) -> float | None:
    """Five digits; None of what is no number."""
    return float(f"{value:.5g}") if np.isfinite(value) else None


def three_digits(value: float) -> str:
    """103 k"""
    value = float(f"{value:.3g}")
    size, ending = ((1e6, " M") if abs(value) >= 1e6 else (1e3, " k") if abs(value) >= 1e4
                    else (1, ""))
    return f"{value / size:.4g}{ending}"


def packed(values: NDArray[Any], unit: float, kind: str) -> str:
    """Base64 of whole units, "<u2" or "u1", taken to their ends; 0 of what is no number."""
    steps = np.clip(np.nan_to_num(values.astype(float) / unit), 0, np.iinfo(kind).max)
    return base64.b64encode(np.floor(steps + 0.5).astype(kind).tobytes()).decode()


def printable(value: Any) -> Any:
    """Texts that came from outside, in one line each, without what reorders them."""
    if isinstance(value, str):
        return run_files.printable(value)
    if isinstance(value, dict):
        return {key: printable(part) for key, part in value.items()}
    return [printable(part) for part in value] if isinstance(value, (list, tuple)) else value


def html_of(page: Block) -> str:
    """The page: recon/web/report.html with its styles, scripts and what it says."""
    def read(name: str) -> str:
        return (PAGE / name).read_text(encoding="utf-8")

    # all are one script there
    scripts = "".join(re.sub(r"(?m)^export ", "", re.sub(r"import [^\n]*\n", "", read(name)))
                      for name in ("charts.js", "maps.js", "cloud.js", "report.js"))
    parts = {"styles": "\n" + "".join(read(name) + "\n"
                                      for name in ("uPlot.min.css", "view.css", "report.css")),
             "uplot": f"\n/*\n{read('uPlot.LICENSE')}*/\n{read('uPlot.iife.min.js')}\n",
             "scripts": "\n" + scripts}
    # The page's policy: the browser obeys nothing of another hash.
    style, uplot, script = (
        f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
        for text in parts.values())
    # A "<" could end the script, or begin a comment that hides its end.
    data = json.dumps(printable(page), ensure_ascii=False, separators=(",", ":"),
                      allow_nan=False).replace("<", "\\u003c")
    parts |= {"data": data, "style_hash": style, "script_hashes": f"{uplot} {script}"}
    return re.sub(r"{{(\w+)}}", lambda found: parts[found[1]], read("report.html"))
