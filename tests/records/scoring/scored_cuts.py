"""Virtual cuts to be scored, and what may be done to a record without changing the cut."""

from __future__ import annotations

import dataclasses
import functools
import json
import math
from typing import Any

import numpy as np
from recorded_cut import recorded_cut

from cutenv.records.scoring import ScoreCard
from cutenv.sim.tissue import measured_liver
from cutenv.sim.trace import Trace

TARGET = 0.075  # [m]


@functools.cache
def cut(kind: str) -> Trace:
    """A cut of a drawn liver, 8 cm, felt with noise: upright or slicing, there and back or one way, or force alone."""
    quick = recorded_cut("liver", speed=0.0127, angle_deg=90.0, turns=(0.08, 0.0))
    return {
        "upright, and back": lambda: quick.trace,
        "upright, one way": lambda: recorded_cut("liver", speed=0.0127, angle_deg=90.0, turns=(0.08,)).trace,
        "slicing, and back": lambda: recorded_cut("liver", speed=0.0089, angle_deg=45.0, turns=(0.08, 0.0)).trace,
        "two cycles": lambda: recorded_cut("liver", speed=0.0165, angle_deg=60.0, turns=(0.04, 0.02, 0.08, 0.0)).trace,
        "upright, encoder of 20 um": lambda: changed(
            quick.trace, position=np.round(quick.trace.position / 20e-6) * 20e-6, speed=None
        ),
        "force alone, 30 Hz": lambda: force_alone(rated(quick.trace, 30.0)),
    }[kind]()


CUTS = [
    "upright, and back",
    "upright, one way",
    "slicing, and back",
    "two cycles",
    "upright, encoder of 20 um",
    "force alone, 30 Hz",
]


def changed(trace: Trace, **changes: Any) -> Trace:
    """The trace with other fields."""
    return dataclasses.replace(trace, **changes)


def force_alone(trace: Trace) -> Trace:
    """Time and normalised force only."""
    return Trace(time=trace.time, force=trace.force / 2.5, force_unit="1")


def rated(trace: Trace, rate: float) -> Trace:
    """The trace read at another rate [Hz], every so many readings: no sensor averages."""
    step = max(1, round(trace.sample_rate / rate))
    return trace.select(slice(None, None, step))


def rested(trace: Trace, seconds: float) -> Trace:
    """The trace with a rest appended, in which the force is what it was at the end, noise included."""
    step = (trace.time[-1] - trace.time[0]) / (len(trace) - 1)
    n = round(seconds / step)
    quiet = trace.force[trace.time > trace.time[-1] - 0.1]
    columns: dict[str, Any] = {
        name: np.append(getattr(trace, name), np.full(n, getattr(trace, name)[-1])) for name in trace.known
    }
    columns["time"] = np.append(trace.time, trace.time[-1] + step * np.arange(1, n + 1))
    columns["force"] = np.append(trace.force, np.resize(quiet, n))
    if "speed" in columns:
        columns["speed"][len(trace) :] = 0.0
    return Trace(**columns, force_unit=trace.force_unit, metadata=trace.metadata)


CHANGES: dict[str, Any] = {
    "time_shift": lambda trace: changed(trace, time=trace.time + 1234.567),
    "force_scale": lambda trace: changed(trace, force=3.7 * trace.force),
    "force_offset": lambda trace: changed(trace, force=trace.force + 0.2),
    "resampling": lambda trace: rated(trace, 200.0),
    "rest_after": lambda trace: rested(trace, 1.0),
    "units": lambda trace: changed(
        trace, force=2.0 * trace.force, depth=None if trace.depth is None else 2.0 * trace.depth
    ),
}
"""By invariance, what it says does not matter, done to a record."""
TISSUES = {"units": dataclasses.replace(measured_liver(), thickness=2.0 * measured_liver().thickness)}
"""By invariance, what it says does not matter, done to the tissue: a cut is deep or shallow for its slab."""


@functools.cache
def ends_under_force(kind: str) -> bool:
    """Whether tissue is loaded at the end of the cut."""
    trace = cut(kind)
    return bool(trace.force[-50:].mean() > 0.2)


def check_card(card: ScoreCard) -> None:
    """Every number is finite or has a reason, and every form of the card can be made."""
    json.loads(card.to_json())
    assert str(card)
    assert card._repr_html_()
    for name, scored in card.metrics.items():
        assert (scored.value is None) == bool(scored.unavailable), name
        assert scored.value is None or math.isfinite(scored.value), name
    assert (card.overall_score is None) == bool(card.no_score)
