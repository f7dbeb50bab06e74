"""Content and layout of a picture of a cut: numbers and geometry, without drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.plant.simulator import SimulatedPlant
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.reward import FORCE_ALLOWED
from cutenv.task_quantities import TIP_TOLERANCE
from cutenv.tissue.grid import SPACING, depth_below

_BLADE_LENGTH = 0.0425  # [m] along its edge: thesis, section 3.4.1
_BLADE_CHORD = 0.007  # [m] from edge to back
_BLADE_THICKNESS = 0.0020  # [m] as drawn from above; a real one is 0.4 mm thick
_BELLY = 0.006  # [m] by which the back is shorter than the edge
_SAMPLES_PER_STROKE = 20  # 20 ms, in which a blade moves 2 px at most
_CHART_CEILING, _CHART_FLOOR = 6.0, -1.0  # [N] least range of a force chart
_CHART_STEP = 2.0  # [N] step by which it grows


@dataclass(frozen=True, kw_only=True)
class Moment:
    """State of a cut to be drawn at one moment; SI and radians.

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

    tolerance = TIP_TOLERANCE
    force_allowed_per_depth = FORCE_ALLOWED

    @classmethod
    def of(cls, plant: SimulatedPlant, cutting: GentleCutting) -> Moment:
        """Return the state of a simulated plant and the task that runs on it."""
        state = plant.states[0]
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
            totals=cutting.reward_totals,
            end=cutting.end,
            success=cutting.success,
        )

    @property
    def lag(self) -> float:
        """Distance by which the blade has carried the tip from its place at rest [m]; zero in the open cut."""
        return max(self.blade - self.tip, 0.0)

    @property
    def verdict(self) -> str:
        """End of the cut in words, or an empty string while it goes on."""
        if self.end == "finished":
            if self.success:
                return "finished: success"
            if abs(self.tip - self.target) > self.tolerance:
                return f"finished: tip {abs(self.tip - self.target) * 1e3:.1f} mm off target"
            return f"finished: blade at {math.degrees(self.angle):.0f}°, not upright"
        return {"": "", "force_limit": "stopped: force limit", "overshoot": "stopped: overshoot"}.get(
            self.end, f"stopped: {self.end}"
        )


@dataclass(frozen=True, kw_only=True)
class Layout:
    """Positions of the parts of a picture [px]; one scale along the cut for both views and the chart."""

    width: int = 960
    height: int = 720
    header: int = 42
    scale: float = 3700.0  # [px/m]
    clamp: float = 72.0  # of the clamp's edge, from the left
    cut_line: float = 233.0  # in the view from above
    blade_end: float = 520.0  # level of the blade's lower end in the view from the side
    chart_top: float = 568.0
    chart_bottom: float = 706.0
    column: float = 672.0  # of the numbers, from the left

    def along(self, along: float) -> float:
        """Return the horizontal position of a distance from the clamp [m], in pixels."""
        return self.clamp + self.scale * along

    def from_above(self, places: Array) -> Array:
        """Return the pixels of places (across, along) [m], shape (..., 2)."""
        return np.stack(
            [self.clamp + self.scale * places[..., 1], self.cut_line + self.scale * places[..., 0]], axis=-1
        )

    def from_the_side(self, places: Array) -> Array:
        """Return the pixels of places (along, height above the blade's lower end) [m], shape (..., 2)."""
        return np.stack(
            [self.clamp + self.scale * places[..., 0], self.blade_end - self.scale * places[..., 1]], axis=-1
        )

    def in_chart(self, points: Array, low: float, high: float) -> Array:
        """Return the pixels of (position of the blade [m], force [N]), shape (..., 2), in a chart of that range."""
        height = self.chart_bottom - self.chart_top
        return np.stack(
            [
                self.clamp + self.scale * points[..., 0],
                self.chart_bottom - height * (points[..., 1] - low) / (high - low),
            ],
            axis=-1,
        )


class ForceTrace:
    """Measured force over the position of the blade since the start, as far as it was shown.

    Attributes
    ----------
    low, high : float
        Range of a chart that includes it [N]; grows in steps and never shrinks.
    """

    def __init__(self) -> None:
        self._parts = [np.zeros((1, 2))]  # at the clamp, unloaded
        self._time = 0.0
        self.low, self.high = _CHART_FLOOR, _CHART_CEILING

    def add(self, readings: StructArray | None) -> bool:
        """Append new readings; return whether there were any."""
        if readings is None or readings["time"][-1] <= self._time:
            return False
        self._time = float(readings["time"][-1])
        kept = _extremes(readings["force"])
        force = readings["force"][kept]
        self._parts.append(np.stack([readings["position"][kept], force], axis=-1))
        while force.max() > 0.95 * self.high:
            self.high += _CHART_STEP
        while force.min() < 0.95 * self.low:
            self.low -= _CHART_STEP
        return True

    def whole(self) -> Array:
        """Return (position [m], force [N]) since the start, shape (n, 2)."""
        return np.concatenate(self._parts)

    def latest(self) -> Array:
        """Return (position [m], force [N]) of the last addition, preceded by the sample before it, shape (n, 2)."""
        return np.concatenate([part[-1:] for part in self._parts[-2:-1]] + self._parts[-1:])


def _extremes(force: Array) -> NDArray[np.int64]:
    """Return the indices of least and greatest of every 20 samples, and of the last one: all that is visible."""
    kept = {len(force) - 1}
    for start in range(0, len(force), _SAMPLES_PER_STROKE):
        part = force[start : start + _SAMPLES_PER_STROKE]
        kept |= {start + int(part.argmin()), start + int(part.argmax())}
    return np.array(sorted(kept))


def surface(depth: Array) -> Array:
    """Return the surface of the tissue at rest, (along, height above the blade's lower end) [m], shape (n, 2)."""
    return np.stack([np.arange(len(depth)) * SPACING, depth], axis=-1)


def blade_from_the_side(blade: float, angle: float, depth: float) -> Array:
    """Return the outline of the blade, (along, height) [m], shape (n, 2): the edge leads, over uncut tissue.

    The edge passes through ``blade`` at the surface, ``depth`` above its lower end; an inclined blade leaves a wedge of
    length depth times cot(angle) uncut. The data do not show which way a blade leans: here forward, as a hand draws it.
    """
    edge = np.array([math.cos(angle), math.sin(angle)])
    back = np.array([-math.sin(angle), math.cos(angle)])
    lower_end = np.array([blade - depth / math.tan(angle), 0.0])
    t = np.linspace(0.0, 0.5 * math.pi, 9)[:, None]
    belly = _BLADE_CHORD * np.sin(t) * back + _BELLY * (1.0 - np.cos(t)) * edge
    upper = np.array([_BLADE_LENGTH * edge + _BLADE_CHORD * back, _BLADE_LENGTH * edge])
    outline: Array = lower_end + np.concatenate([belly, upper])
    return outline


def blade_from_above(blade: float, angle: float, depth: float) -> tuple[Array, Array]:
    """Return the blade's section at the surface, and the part above it; (across, along) [m], shape (n, 2)."""
    chord = _BLADE_CHORD / math.sin(angle)
    half = 0.5 * _BLADE_THICKNESS
    section = np.array([[0.0, 0.0], [-half, -0.4 * chord], [-half, -chord], [half, -chord], [half, -0.4 * chord]])
    reach = max(_BLADE_LENGTH * math.sin(angle) - depth, 0.0) / math.tan(angle)
    overhang = np.array([[-half, -chord], [-half, reach - chord], [0.0, reach], [half, reach - chord], [half, -chord]])
    place = np.array([0.0, blade])
    return section + place, overhang + place


def front_from_the_side(tip: float, angle: float, depth: Array) -> Array:
    """Return the outline of the cut part, (along, height) [m], shape (n, 2); its front is as inclined as the blade."""
    top = surface(depth)
    end = np.array([[tip, depth_below(depth, tip)]])
    lower = max(tip - end[0, 1] / math.tan(angle), 0.0)
    return np.concatenate([top[top[:, 0] < tip], end, [[lower, 0.0], [0.0, 0.0]]])
