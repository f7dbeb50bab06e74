"""Content and layout of a picture of a cut, without drawing."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.display.viewer.scene_parts import (
    BELOW,
    CHART_CEILING,
    CHART_FILLED,
    CHART_FLOOR,
    CHART_SAMPLES,
    CHART_STEP,
    DERIVED,
    NUMBERS,
    WORDS,
    SceneFormula,
    ScenePart,
)
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.quantities import ANGLE_TOLERANCE, FORCE_ALLOWED, TIP_TOLERANCE
from cutenv.sim.tissue.grid import depth_below
from cutenv.task.episode import Episode, ShownDepth, ShownPath


@dataclass(frozen=True, kw_only=True)
class Moment:
    """State of a cut to be drawn at one moment.

    SI and radians.

    ``tip`` and ``lag`` are hidden truth; a rig and its task know the rest.
    """

    blade: float
    tip: float
    speed: float
    angle: float
    force: float
    depth: Array
    target: float
    time: float
    deadline: float
    force_limit_per_depth: float
    totals: dict[str, float]
    end: str
    success: bool
    shown_depth: ShownDepth | None = None
    shown_path: ShownPath | None = None

    tolerance = TIP_TOLERANCE
    force_allowed_per_depth = FORCE_ALLOWED

    @classmethod
    def of(cls, plant: SimulatedPlant, cutting: Episode) -> Moment:
        """Return the state of a simulated plant and its task."""
        state, shown = plant.states[0], cutting.shown_depth
        return cls(
            blade=float(state["blade"]),
            tip=float(state["tip"]),
            speed=float(state["speed"]),
            angle=float(state["angle"]),
            force=0.0 if cutting.readings is None else float(cutting.readings["force"][-1]),
            depth=plant.profiles[0]["depth"],
            target=cutting.target_length,
            time=cutting.time,
            deadline=cutting.deadline,
            force_limit_per_depth=cutting.force_limit_per_depth,
            totals=cutting.shown_totals,
            end=cutting.end,
            success=cutting.success,
            shown_depth=shown,
            shown_path=cutting.shown_path,
        )

    @property
    def lag(self) -> float:
        """Distance the blade carries the tip [m], zero in open cuts."""
        return max(self.blade - self.tip, 0.0)

    def quantities(
        self,
        *,
        hand: float = 0.0,
        angle: float | None = None,
        chart: tuple[float, float] = (CHART_FLOOR, CHART_CEILING),
    ) -> dict[str, Any]:
        """Return the scene's quantities by name; SI and radians.

        Parameters
        ----------
        hand : float
            Position of the hand that leads [m].
        angle : float, optional
            Angle at which the blade is drawn [rad], where it is not the measured one.
        chart : tuple of float
            Range of the force chart [N].
        """
        values = {
            "blade": self.blade,
            "tip": self.tip,
            "angle": self.angle if angle is None else angle,
            "force": self.force,
            "target": self.target,
            "hand": hand,
            "force_limit_per_depth": self.force_limit_per_depth,
            "force_allowed_per_depth": self.force_allowed_per_depth,
            "chart_low": chart[0],
            "chart_high": chart[1],
            "depth_at": lambda along: depth_below(self.depth, along),
        }
        if self.shown_depth is not None:
            values |= quantities_of_depth(self.shown_depth)
        return derived_quantities(values)

    @property
    def conditions(self) -> tuple[str, ...]:
        """Conditions of parts for cuts with wanted depth, else empty."""
        return () if self.shown_depth is None else ("depth",)

    @property
    def depth_at_blade(self) -> float | None:
        """Depth of the blade below the wanted floor [m], or None."""
        if self.shown_depth is None:
            return None
        return float(depth_below(self.shown_depth.wanted, self.blade)) - self.shown_depth.level

    @property
    def verdict(self) -> str:
        """End of the cut in words, empty before it."""
        if self.end == "finished":
            if self.success:
                return "finished: success"
            if abs(self.tip - self.target) > self.tolerance:
                off = max(
                    abs(self.tip - self.target), self.tolerance + 1e-4
                )  # rounded, it does not look like a success
                return f"finished: tip {1e3 * off:.1f} mm off target"
            if self.shown_depth is not None and abs(0.5 * math.pi - self.angle) <= ANGLE_TOLERANCE:
                return "finished: not as deep as wanted"
            if self.shown_path is not None and abs(0.5 * math.pi - self.angle) <= ANGLE_TOLERANCE:
                return "finished: not along the line"
            return f"finished: blade at {math.degrees(self.angle):.0f}°, not upright"
        words = {"force_limit": "force limit", "layer": "the layer below was opened too deep",
                 "off_line": "the cut came too far from the line"}  # fmt: skip
        return f"stopped: {words.get(self.end, self.end)}" if self.end else ""


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Positions of the parts of a picture [px].

    One scale along the cut for both views and the chart.
    """

    width: int = 960
    height: int = 720
    header: int = 42
    scale: float = 3700.0  # [px/m]
    clamp: float = 72.0  # of the clamp's edge, from the left
    cut_line: float = 233.0  # in the view from above
    blade_end: float = 520.0  # lower end of the view from the side: that of a blade at level 0,
    below: float = 0.0  # or this much below it
    chart_top: float = 568.0
    chart_bottom: float = 706.0
    column: float = 672.0  # of the numbers, from the left

    def along(self, along: Any) -> Any:
        """Return horizontal pixels of distances from the clamp [m]."""
        return self.clamp + self.scale * along

    def with_depth(self) -> Layout:
        """Return the layout that also shows depths below level 0."""
        return replace(self, below=self.scale * BELOW)

    def place(self, view: str, places: Array, chart: tuple[float, float] = (CHART_FLOOR, CHART_CEILING)) -> Array:
        """Return a view's pixels, shape (..., 2); ``chart`` range in N."""
        if view == "above":
            return np.stack([self.along(places[..., 1]), self.cut_line + self.scale * places[..., 0]], axis=-1)
        if view == "side":
            level = self.blade_end - self.below
            return np.stack([self.along(places[..., 0]), level - self.scale * places[..., 1]], axis=-1)
        share = (places[..., 1] - chart[0]) / (chart[1] - chart[0])
        height = self.chart_bottom - self.chart_top
        return np.stack([self.along(places[..., 0]), self.chart_bottom - height * share], axis=-1)


class ForceTrace:
    """Measured force over blade position since the start, as shown.

    Attributes
    ----------
    low, high : float
        Range of a chart that includes it [N]; grows in steps and never shrinks.
    """

    def __init__(self) -> None:
        self._parts = [np.zeros((1, 2))]  # at the clamp, unloaded
        self._time = 0.0
        self.low, self.high = CHART_FLOOR, CHART_CEILING

    def add(self, readings: StructArray | None) -> bool:
        """Append new readings; return whether there were any."""
        if readings is None or readings["time"][-1] <= self._time:
            return False
        self._time = float(readings["time"][-1])
        kept = _extremes(readings["force"])
        force = readings["force"][kept]
        self._parts.append(np.stack([readings["position"][kept], force], axis=-1))
        while force.max() > CHART_FILLED * self.high:
            self.high += CHART_STEP
        while force.min() < CHART_FILLED * self.low:
            self.low -= CHART_STEP
        return True

    @property
    def range(self) -> tuple[float, float]:
        """Least and greatest force of the chart [N]."""
        return self.low, self.high

    def whole(self) -> Array:
        """Return (position [m], force [N]) since the start, shape (n, 2)."""
        return np.concatenate(self._parts)

    def latest(self) -> Array:
        """Return the last addition and one sample before, shape (n, 2).

        Columns are position [m] and force [N].
        """
        return np.concatenate([part[-1:] for part in self._parts[-2:-1]] + self._parts[-1:])


def _extremes(force: Array) -> NDArray[np.int64]:
    """Return indices of extremes of every 20 samples, and the last."""
    kept = {len(force) - 1}
    for start in range(0, len(force), CHART_SAMPLES):
        part = force[start : start + CHART_SAMPLES]
        kept |= {start + int(part.argmin()), start + int(part.argmax())}
    return np.array(sorted(kept))


_DERIVED = {name: SceneFormula(text) for name, text in DERIVED.items()}
_NUMBERS = {name: (SceneFormula(text), digits) for name, (text, digits) in NUMBERS.items()}


AT_LEVEL_ZERO: dict[str, Any] = {"level": 0.0, "bottom": 0.0, "floor_at": lambda along: 0.0 * along}
"""Quantities of a blade that neither rises nor descends."""


def quantities_of_depth(shown: ShownDepth) -> dict[str, Any]:
    """Return the quantities of a cut whose depth is wanted."""
    heights = {
        "depth_at": shown.surface, "limited_at": shown.surface - shown.wanted, "floor_at": shown.floor,
        "wanted_at": shown.wanted, "layer_at": shown.layer,
    }  # fmt: skip
    along = {name: partial(depth_below, each) for name, each in heights.items()}
    return {"level": shown.level, "bottom": -BELOW} | along


def derived_quantities(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a moment's quantities with those derived from them."""
    known = AT_LEVEL_ZERO | {"limited_at": values["depth_at"]} | dict(values)
    for name, formula in _DERIVED.items():
        known[name] = formula(known)
    return known


def rest_places(part: ScenePart, quantities: Mapping[str, Any]) -> tuple[Array, Array]:
    """Return a part's places, shape (n, 2), and its points' numbers.

    Those of a carried part are in tissue at rest.
    """
    own = np.array(part.rows, dtype=np.float64)
    values = {**quantities, **dict(zip(part.own, own.T, strict=True))}
    places = [np.broadcast_to(formula(values), len(own)) for formula in part.formulas]
    return np.stack(places, axis=-1), own


def scene_label(key: str, quantities: Mapping[str, Any]) -> str:
    """Return a title or label with its numbers."""
    numbers = {name: f"{formula(quantities):.{digits}f}" for name, (formula, digits) in _NUMBERS.items()}
    return WORDS[key].format(**numbers)
