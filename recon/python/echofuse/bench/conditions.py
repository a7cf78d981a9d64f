# SPDX-License-Identifier: MIT
"""Defines the conditions of the stability study. Each axis varies one property. A condition is
either a set of `echofuse-sim dataset` settings or a set of changes to a recorded run
(derive.py)."""
from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..runs.programs import UsageError
from . import derive

__all__ = ["BASE", "Axis", "World", "recorded_axes", "simulated_axes"]


@dataclass(frozen=True)
class World:
    """A condition, described by its differences from the base condition."""

    set: tuple[str, ...] = ()  #: simulator settings, each KEY=VALUE
    scenes: str = "records"  #: option of `echofuse-sim dataset` that selects the kind of scene
    at_x_m: float | None = None  #: magnitude of the x coordinate of the bodies, m; None: random
    walk_m: float = 0  #: distance that a person walks during a record, m
    fog_m: float = 0  #: visibility in fog, m; 0: clear air
    records: float = 1  #: number of training records, relative to the base condition
    changes: tuple[derive.Change, ...] = ()  #: changes to the recorded or simulated run


BASE = World()


@dataclass(frozen=True)
class Axis:
    """An axis of the study. `values` maps each label to its condition, in display order, and
    includes BASE."""

    # "matched": the training and test conditions are the same; "shifted": BASE is used for training
    kind: str
    name: str
    title: str  # title in tables and figures, including the unit
    values: dict[str, World] = field(default_factory=dict)
    # labels that --quick measures in addition to BASE; empty: all labels
    quick: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        return f"{self.kind}-{self.name}"

    @property
    def base(self) -> str:
        return next(label for label, world in self.values.items() if world == BASE)


SCENES = {"people and letters": BASE, "people": World(scenes="people"),
         "letters": World(scenes="letters"), "two people": World(scenes="two-people")}


class _Axes:
    """Collects the axes of the simulated study. `base` contains the simulator settings of the base
    condition, {key: value}."""

    def __init__(self, base: dict[str, Any]) -> None:
        self.base = base
        self.photons, self.resolution_m = base["signal_photons"], base["radar_resolution_m"]
        self.coherent = base["radar_sum"] == "coherent"
        self.antennas = max(base["radar_antennas"], 1)
        self.coherent_cm = f"coherent {100 * self.resolution_m:g} cm"
        self.echoes = {"incoherent": World(("radar_sum=incoherent",)) if self.coherent else BASE,
                       self.coherent_cm: BASE if self.coherent else World(("radar_sum=coherent",))}
        self.axes: list[Axis] = []

    def numeric(self, kind: str, name: str, title: str, values: Iterable[float],
                quick: Iterable[float], world: Callable[[float], World], at: float) -> None:
        worlds = {f"{v:g}": BASE if np.isclose(v, at, rtol=1e-9, atol=0) else world(v)
                  for v in values}
        if BASE not in worlds.values():
            raise UsageError(f"axis {kind}-{name} does not contain the base value {at:g}")
        self.axes.append(Axis(kind, name, title, worlds, tuple(f"{v:g}" for v in quick)))

    def setting(self, kind: str, name: str, title: str, key: str, values: Iterable[float],
                quick: Iterable[float], unit: float = 1) -> None:
        self.numeric(kind, name, title, values, quick, lambda v: World((f"{key}={v * unit:.9g}",)),
                     self.base[key] / unit)

    def labelled(self, kind: str, name: str, title: str, values: dict[str, World],
              quick: Sequence[str]) -> None:
        self.axes.append(Axis(kind, name, title, values, tuple(quick)))

    def at_resolution(self, m: float) -> tuple[str, ...]:
        """Returns the simulator settings for the given radar resolution. The range span and the
        number of samples per resolution cell are preserved."""
        step, span = (m * self.base["radar_step_m"] / self.resolution_m,
                      self.base["radar_step_m"] * (self.base["radar_bins"] - 1))
        return (f"radar_resolution_m={m:.9g}", f"radar_step_m={step:.9g}",
                f"radar_bins={np.floor(span / step) + 1:.9g}")

    def at_bin_width(self, ps: float) -> World:
        bins = round(self.base["bin_width_ps"] * self.base["bins"] / ps)
        return World((f"bin_width_ps={ps:.9g}", f"bins={bins}"))

    def pile_up(self, v: float, stated: bool = True) -> World:
        return World((f"pulses_per_window={self.photons / v if v else 0:.9g}",
                      *(() if stated else ("spd_detector_stated=false",))))


def _matched_sensors(axes: _Axes) -> None:
    """Adds axes that vary a sensor setting in both the training and the test data."""
    base = axes.base
    axes.setting("matched", "irf", "SPD impulse response, FWHM (ps)", "irf_fwhm_ps",
                 (2, 50, 200, 500, 1000, 2000), (2, 2000))
    axes.numeric("matched", "bin_width", "SPD bin width (ps)", (10, 50, 100, 200, 400, 800),
                 (800,), axes.at_bin_width, base["bin_width_ps"])
    axes.numeric("matched", "radar_resolution", "radar resolution (m)", (0.044, 0.1, 0.25, 0.5, 1),
                 (0.044, 1), lambda m: World(axes.at_resolution(m)), axes.resolution_m)
    axes.setting("matched", "baseline", "baseline (m)", "baseline_m", (2, 1, 0.5, 0.2, 0.1, 0),
                 (2, 0.1, 0))
    axes.setting("matched", "snr", "radar SNR (dB)", "radar_snr_db", (30, 20, 10, 5, 0), (10, 0))
    axes.setting("matched", "photons", "photons per record", "signal_photons",
                 (1e6, 1e5, 1e4, 1e3, 1e2), (1e3, 1e2))
    axes.setting("matched", "background", "SPD background (counts per signal photon)",
                 "background_counts", (0, 0.1, 1, 10, 100), (1, 10), axes.photons)
    pulses = base["pulses_per_window"]
    axes.numeric("matched", "pile_up", "pile-up (photons per laser pulse)",
                 (0, 0.01, 0.1, 0.5, 1, 2), (0.1, 2),
                 axes.pile_up, axes.photons / pulses if pulses > 0 else 0)
    axes.labelled("matched", "speckle", "sum of radar echoes",
               {"incoherent": axes.echoes["incoherent"],
                "coherent 4.4 cm": World((*axes.at_resolution(0.044), "radar_sum=coherent")),
                **axes.echoes}, ("incoherent", axes.coherent_cm))
    counts = sorted({1, 2, 4, 8} | ({axes.antennas} if axes.antennas > 8 else set()))
    axes.numeric("matched", "antennas", "radar antennas", counts, (1, 2, 8),
                 lambda n: World((f"radar_antennas={n:g}",)), axes.antennas)
    if axes.antennas > 1 or axes.coherent:
        axes.setting("matched", "looks", "radar frames per record", "radar_frames", (15, 60, 240),
                     (15,))


def _matched_scenes(axes: _Axes) -> None:
    """Adds axes that vary the scenes, the slot duration or the room. Most of these axes apply to
    both the training and the test data."""
    base = axes.base
    axes.numeric("matched", "records", "training records (factor)", (6.67, 3, 1, 0.28, 0.07),
                 (0.28,), lambda v: World(records=v), 1)
    axes.setting("matched", "size", "size of the body (factor)", "target_scale",
                 (1.5, 1, 0.7, 0.5, 0.3), (0.5,))
    axes.setting("matched", "side", "largest |x| of the bodies (m)", "target_x_m",
                 (1, 0.5, 0.25, 0.1), (0.1,))
    axes.labelled("matched", "scenes", "scenes", SCENES, ("people", "two people"))
    slot_s, frames = base["window_s"], base["radar_frames"]
    slots = sorted({slot_s} | {s for s in (3, 2, 1, 0.5, 0.25, 0.1, 0.05)
                               if axes.antennas == 1 or frames * s / slot_s > axes.antennas},
                   reverse=True)
    axes.numeric("matched", "slot", "length of a record (s)", slots, (0.5, 1), lambda s: World((
             f"window_s={s:.9g}", *(f"{key}={base[key] * s / slot_s:.9g}"
                                    for key in ("signal_photons", "background_counts")),
             f"radar_frames={max(1, round(frames * s / slot_s))}")), slot_s)
    axes.numeric("shifted", "walk", "walking people (m/s)", (0, 0.25, 0.5, 1), (0.5,),
                 lambda v: World(walk_m=v * slot_s), 0)
    axes.labelled("matched", "rooms", "rooms and wall echoes", _rooms(axes.at_resolution),
               ("corridor", "corridor echoes", "closed", "closed echoes"))


def _shifted_instrument(axes: _Axes) -> None:
    """Adds axes that vary the instrument only in the test data, as if it had changed after
    training."""
    base = axes.base
    gains = (0.25, 0.5, 1, 2, 4)
    axes.setting("shifted", "spd_delay", "SPD delay after calibration (ps)", "spd_delay_ps",
                 (0, 10, 50, 100, 200, 500), (50, 200, 500))
    axes.setting("shifted", "radar_offset", "radar offset after calibration (m)", "radar_bias_m",
                 (0, 0.01, 0.02, 0.05, 0.1, 0.2), (0.02, 0.05, 0.2))
    axes.setting("shifted", "spd_gain", "light (factor)", "signal_photons", gains, (0.25, 4),
                 axes.photons)
    axes.numeric("shifted", "radar_gain", "radar gain (factor)", gains, (0.25, 4),
                 lambda v: World(changes=(derive.gain(v),)), 1)
    axes.setting("shifted", "irf", "SPD impulse response, FWHM (ps)", "irf_fwhm_ps",
                 (100, 200, 300), (100, 300))
    axes.setting("shifted", "snr", "radar SNR (dB)", "radar_snr_db", (30, 20, 10, 5, 0), (10, 0))
    axes.setting("shifted", "baseline", "baseline (m)", "baseline_m", (0.4, 0.45, 0.5, 0.55, 0.6),
                 (0.4, 0.6))
    axes.setting("shifted", "background", "SPD background (counts per signal photon)",
                 "background_counts", (0, 0.1, 1, 10), (0.1, 1, 10), axes.photons)
    if base["pulses_per_window"] == 0:
        piled = {"none": BASE} | {
            f"{v:g}{'' if stated else ' uncorrected'}": axes.pile_up(v, stated)
            for v in (0.1, 0.5, 2) for stated in (True, False)}
        axes.labelled("shifted", "pile_up", "pile-up (photons per laser pulse), corrected or not",
                   piled, ("2", "2 uncorrected"))
    axes.labelled("shifted", "speckle", "sum of radar echoes", axes.echoes,
               ("incoherent", axes.coherent_cm))
    if axes.coherent:
        moving = ("radar_sway_m", "radar_twist_deg", "radar_breath_m")
        axes.numeric("shifted", "motion", "motion of the people (factor)", (1, 0.5, 0.2, 0), (0,),
                     lambda share: World(tuple(f"{key}={share * base[key]:.9g}"
                                               for key in moving)), 1)
    if axes.antennas > 1:
        axes.labelled("shifted", "antennas", "radar antennas",
                   {f"{axes.antennas:g}": BASE, "lost": World(("radar_antennas=1",))}, ("lost",))
        axes.numeric("shifted", "phase", "phase error of the antennas (degrees, rms)",
                     (0, 5, 15, 30, 60), (15, 30),
                     lambda deg: World((f"radar_phase_error_rad={np.radians(deg):.9g}",
                                        "radar_array_calibrated=false")), 0)


def _fog(axes: _Axes) -> None:
    """Adds one axis with fog in both the training and the test data, and one with fog only in the
    test data."""
    for kind in ("matched", "shifted"):
        axes.numeric(kind, "fog", "visibility in fog (m), 0 = no fog",
                     (0, 1000, 300, 100, 50, 20, 10, 5), (100, 20), lambda m: World(fog_m=m), 0)


def _surprises(axes: _Axes) -> None:
    """Adds axes with test conditions that are absent from the training data."""
    base = axes.base
    for sensor in ("radar", "spd"):
        axes.labelled("shifted", f"lost_{sensor}", "radar" if sensor == "radar" else "SPD",
                   {"there": BASE, "missing": World(changes=(derive.lost(sensor),))}, ("missing",))
    axes.labelled("shifted", "scenes", "scenes", SCENES
               | {"nobody": World(("background_counts=10000",), scenes="empty")},
               ("two people", "nobody"))
    aside = {f"{x:g}": World(at_x_m=x) for x in (1.1, 1.25, 1.5)}
    axes.labelled("shifted", "side", "|x| of the bodies (m)",
               {f"within {base['target_x_m']:g}": BASE} | aside, ("1.25", "1.5"))
    near, far = base["target_z_min_m"], base["target_z_max_m"]
    distances = {"2.5 to 3": (2.5, 3), f"{near:g} to {far:g}": None, "4 to 4.5": (4, 4.5),
                "4.5 to 5": (4.5, 5), "5 to 6": (5, 6)}
    axes.labelled("shifted", "distance", "z of the bodies (m)",
               {label: World((f"target_z_min_m={z[0]:g}", f"target_z_max_m={z[1]:g}"))
              if z else BASE for label, z in distances.items()}, ("4 to 4.5", "5 to 6"))


def simulated_axes(base: dict[str, Any]) -> list[Axis]:
    """Returns all axes of the simulated study. `base` contains the simulator settings of the base
    condition, {key: value}."""
    axes = _Axes(base)
    for add in (_matched_sensors, _matched_scenes, _shifted_instrument, _fog, _surprises):
        add(axes)
    return axes.axes


def _rooms(at_resolution: Callable[[float], tuple[str, ...]]) -> dict[str, World]:
    """Returns conditions for different rooms, with and without wall echoes. "RF" and "sound"
    emulate the radio sensor and the sound sensor of Turpin et al., PRL 126, 174301."""
    echoes = ("multipath_order=2",)
    direct = (*at_resolution(0.044), "radar_wall_scatter=0.1")
    sound = (*at_resolution(0.02), *echoes, "radar_wall_reflectivity=0.97",
             "radar_wall_scatter=0.03")

    def world(room: str, *settings: str) -> World:
        return World((*settings, f"background={room}",
                      *(() if room in ("room", "closed") else ("target_x_m=0.7",))))

    out = {"open": BASE, "open narrow": world("none"), "room": world("room"),
           "room echoes": world("room", *echoes)}
    for room in ("corridor", "closed"):
        out |= {room: world(room), f"{room} echoes": world(room, *echoes),
                f"{room} RF 4.4 cm direct": world(room, *direct),
                f"{room} RF 4.4 cm": world(room, *direct, *echoes),
                f"{room} sound 2 cm": world(room, *sound)}
    return out


def recorded_axes() -> list[Axis]:
    """Returns the axes that can be derived from recorded runs alone, without a simulator."""
    def both(name: str, title: str, base: str, values: dict[str, derive.Change]) -> list[Axis]:
        worlds = {base: BASE} | {label: World(changes=(change,))
                                 for label, change in values.items()}
        return [Axis(kind, name, title, worlds, tuple(values)) for kind in ("matched", "shifted")]

    shifted = [Axis("shifted", "radar_offset", "radar offset (m)", {"0": BASE} | {
        f"{m:g}": World(changes=(derive.range_offset(m),)) for m in (0.01, 0.02, 0.05, 0.1, 0.2)})]
    for sensor in ("radar", "spd"):
        shifted.append(Axis("shifted", f"lost_{sensor}", sensor,
                            {"there": BASE, "missing": World(changes=(derive.lost(sensor),))}))
    return [*both("photons", "fraction of the photons", "1",
                  {f"{s:g}": derive.thinned(s, 1) for s in (0.5, 0.1, 0.01, 0.001)}),
            *both("background", "room light (counts per record)", "0",
                  {f"{n:g}": derive.background(n, 1) for n in (1e3, 1e4, 1e5)}),
            *both("snr", "radar noise (dB below the peak)", "none",
                  {f"{db:g}": derive.noise(db, 1) for db in (20, 10, 5, 0)}),
            Axis("matched", "records", "training records (factor)",
                 {"1": BASE} | {f"{v:g}": World(records=v) for v in (0.5, 0.28, 0.07)}), *shifted]
