# SPDX-License-Identifier: MIT
"""Figures, panels and their ticks, and names beside points: what the plots share (python3-matplotlib)."""
from __future__ import annotations

import pathlib
from collections.abc import Sequence
from typing import Any, Union

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import NDArray

from . import run as runs

COLOURS = {"spd": "#0b5cad", "radar": "#a64200", "depth": "#00695c", "both": "#16191d", "papers": "#5b0f75",
           "grey": "#6a7078", "bad": "#b3201a"}
NO_RETURN = "#e8eaed"
Path = str | pathlib.Path


Panels = Union[Axes, Sequence[Axes], None]


def figure(columns: int = 1, rows: int = 1, wide: float = 4.6, high: float = 3.4, ax: Panels = None) -> tuple[Figure, NDArray[Any]]:
    """A new figure and its panels, or those that are given. Raises ValueError for too few."""
    if ax is not None:
        axes = np.atleast_1d(np.array(ax, object)).ravel()
        if len(axes) < columns * rows:
            raise ValueError(f"ax: {len(axes)} panels; expected {columns * rows}")
        return axes[0].figure, axes[:columns * rows]
    made = Figure(figsize=(wide * columns, high * rows), layout="constrained")
    FigureCanvasAgg(made)
    axes = made.subplots(rows, columns, squeeze=False).ravel()
    for panel in axes:
        panel.spines[["top", "right"]].set_visible(False)
    return made, axes


def opened(run: runs.Run | Path) -> runs.Run:
    return run if isinstance(run, runs.Run) else runs.open(run)


def plain_log(ax: Axes, *sides: str) -> None:
    """Logarithmic axes "x", "y" with plain numbers at their ticks: 0.1, 1, 10; of few decades also 3, or 2 and 5."""
    for side in sides:
        ax.set(**{f"{side}scale": "log"})
        axis = getattr(ax, f"{side}axis")
        low, high = sorted(getattr(ax, f"get_{side}lim")())
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if high < 30 * low else (1, 3) if high < 300 * low else (1,)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}".replace(",", " ")))
        axis.set_minor_formatter(NullFormatter())


def place_names(ax: Axes, points: Sequence[tuple[float, float, float, str, str]],
                steps: Sequence[tuple[float, float]] = ()) -> None:
    """Names (x, y, half a bar, name, colour) beside their points, over no other name, point, bar and step of a line, and
    nearer to no other point; a far one has a line to its point. The figure's layout must be final."""
    renderer = ax.figure.canvas.get_renderer()
    at, share = ax.transData.transform([point[:2] for point in points]), ax.figure.transFigure.inverted().transform
    ends = [ax.transData.transform([(x, max(y - bar, 1e-9)), (x, y + bar)])[:, 1] for x, y, bar, *_ in points]
    frame = ax.get_window_extent()
    bars = [(x - 5, min(y, low) - 5, x + 5, max(y, high) + 5) for (x, y), (low, high) in zip(at, ends)]
    corners = ax.transData.transform(steps).tolist() if steps else []
    bars += [(x, y - 2, end, y + 2) for (x, y), (end, _) in zip(corners, corners[1:])]
    texts = [ax.text(0, 0, name, fontsize=8, color=colour, ha="center", va="center", transform=ax.figure.transFigure)
             for *_, name, colour in points]
    sizes = [(box.width + 4, box.height + 2) for box in (text.get_window_extent(renderer) for text in texts)]

    def box_of(k: int, px: float, py: float) -> tuple[float, float, float, float]:
        (wide, high) = sizes[k]
        return px - wide / 2, py - high / 2, px + wide / 2, py + high / 2

    def placed(order: Sequence[int]) -> tuple[float, dict[int, tuple[float, float]]]:
        taken, total, out = list(bars), 0.0, {}
        for k in order:
            x, y = at[k]

            def cost(px: float, py: float) -> float:
                here = box_of(k, px, py)
                over = sum(max(0, min(here[2], b[2]) - max(here[0], b[0])) * max(0, min(here[3], b[3]) - max(here[1], b[1]))
                           for b in taken)
                out = max(0, frame.x0 - here[0]) + max(0, here[2] - frame.x1) + max(0, frame.y0 - here[1]) + max(0, here[3] - frame.y1)
                strays = sum(np.hypot(px - qx, py - qy) < np.hypot(px - x, py - y) for qx, qy in at if (qx, qy) != (x, y))
                away = np.hypot(max(abs(px - x) - sizes[k][0] / 2, 0), max(abs(py - y) - sizes[k][1] / 2, 0))
                return float(over + 1e4 * out + 30 * strays + max(away - 12, 0))

            out[k] = min(((x + np.cos(t) * (away + sizes[k][0] / 2), y + np.sin(t) * (away + sizes[k][1] / 2))
                          for away in 8 * 1.35 ** np.arange(11) for t in np.arange(16) * np.pi / 8), key=lambda p: cost(*p))
            total += cost(*out[k])
            taken.append(box_of(k, *out[k]))
        return total, out

    orders = [np.argsort(sign * at[:, side]).tolist() for side in (0, 1) for sign in (-1, 1)]
    for k, (px, py) in min((placed(order) for order in orders), key=lambda one: one[0])[1].items():
        texts[k].set_position(share((px, py)))
        left, low, right, high = box_of(k, px, py)
        x, y = at[k]
        end = np.clip(x, left, right), np.clip(y, low, high)
        if np.hypot(end[0] - x, end[1] - y) > 12:
            ax.annotate("", share(end), share((x, y)), "figure fraction", "figure fraction",
                        arrowprops={"arrowstyle": "-", "lw": 0.6, "color": points[k][4]})
