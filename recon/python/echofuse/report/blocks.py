# SPDX-License-Identifier: MIT
"""Blocks of a report, and their HTML. A block is a dictionary with a "kind"."""
from __future__ import annotations

import html
from collections.abc import Iterable, Sequence
from typing import Any

from ..runs import run_files

__all__ = ["NONE", "Block", "cell", "details", "fails", "html_of", "listed", "paragraph",
           "table", "three_digits"]

Block = dict[str, Any]
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


def three_digits(value: float) -> str:
    """Formats a value with three significant digits and a decimal prefix, e.g. "103 k"."""
    value = float(f"{value:.3g}")
    size, ending = ((1e6, " M") if abs(value) >= 1e6 else (1e3, " k") if abs(value) >= 1e4
                    else (1, ""))
    return f"{value / size:.4g}{ending}"


def safe(text: Any) -> str:
    """Escapes HTML, line breaks and other control characters."""
    return html.escape(run_files.printable(str(text)))


def element(tag: str, inner: str, look: str = "") -> str:
    return f"<{tag} class=\"{look}\">{inner}</{tag}>" if look else f"<{tag}>{inner}</{tag}>"


def table_of(block: Block) -> str:
    head = block["head"]

    def row(cells: Sequence[Any], tag: str) -> str:
        out = ""
        for i, (given, title) in enumerate(zip(cells, head)):
            c = {"text": given} if isinstance(given, str) else given
            inner = element("b" if "mark" in c else "span", safe(c["text"]), c.get("mark", ""))
            # The page below the tables shows a record if a link to its number is opened.
            inner += ", ".join(f"<a href=\"#{k}\">{k}</a>" for k in c.get("records", ()))
            inner += ", ..." * c.get("more", False)
            inner += element("small", safe(c["small"])) if "small" in c else ""
            out += element("th" if i == 0 else tag, inner,
                           "words" if isinstance(title, dict) and title.get("words") else "")
        return out

    first = len(block["rows"]) - block["baselines"]
    body = "".join(element("tr", row(cells, "td"), "baseline" * (i >= first))
                   for i, cells in enumerate(block["rows"]))
    caption = element("caption", safe(block["caption"])) if block["caption"] else ""
    return element("div", element("table", f"{caption}<thead><tr>{row(head, 'th')}</tr></thead>"
                                           f"<tbody>{body}</tbody>"), "scroll")


def html_of(blocks: Iterable[Block]) -> str:
    out = ""
    for block in blocks:
        kind = block["kind"]
        if kind == "table":
            out += table_of(block)
        elif kind == "fails":
            out += element("ul", "".join(element("li", safe(text)) for text in block["items"]),
                           "fail")
        elif kind == "list":
            out += element("dl", "".join(element("dt", safe(name)) + element("dd", safe(text))
                                         for name, text in block["rows"]))
        elif kind == "link":
            out += element("p", f"<a href=\"{safe(block['text'])}\">{safe(block['text'])}</a>")
        elif kind == "details":
            out += element("details", element("summary", safe(block["summary"]))
                           + html_of(block["blocks"]))
        else:
            out += element("p", safe(block["text"]), "" if kind == "text" else kind)
        out += "\n"
    return out
