"""A cut as the metrics see it: the record, what was aimed at, where the tip was, and the force at a fixed rate."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from cutenv.measurement import DepthProfile, ReturnStroke, fit_return_stroke
from cutenv.measurement.depth import SHALLOWEST
from cutenv.measurement.strokes import STANDSTILL, blade_speed
from cutenv.scoring.metric import Unavailable
from cutenv.tissue import CutModel, TissueDescription, measured_liver
from cutenv.trace import Trace
from cutenv.validation import array_in_range, in_range

Array = NDArray[np.float64]

RATE = 100.0
"""At which force and motion are compared [Hz]: a hand moves below 10 Hz."""
BANDWIDTH = 5.0
"""Of the force whose rate and jerk are taken [Hz]: Butterworth of order 2, to and fro, so without delay."""
_FEWEST_HZ = 20.0  # readings a second below which nothing is known of 5 Hz
_JUMP_WINDOW, _JUMP = 0.02, 0.3e-3  # [s], [m]: as the environment estimates jumps, see cutenv.task.estimate
_ROUNDS = 4  # of a = x - F/K(a)


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """What only a simulator knows.

    Parameters
    ----------
    tip : array_like of shape (n,)
        Crack tip at every instant of the trace [m].
    jump : array_like of shape (n,)
        Unstable growth in that instant [m].
    resistance : float
        Mean fracture resistance of the cut tissue, friction's share included [J/m2].
    """

    tip: Array
    jump: Array
    resistance: float

    def __post_init__(self) -> None:
        for name in ("tip", "jump"):
            object.__setattr__(self, name, array_in_range(name, getattr(self, name), -0.05, 0.5, "m", "8 cm is 0.08."))
        in_range("resistance", self.resistance, 1.0, 1e6, "J/m2", "0.211 kJ/m2 is 211.")


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredCut:
    """One cut, and what the metrics need of it, computed when asked for.

    Parameters
    ----------
    trace : Trace
        The record.
    target_length : float, optional
        Aimed at, from the clamp [m].
    truth : Truth, optional
        Of a simulated cut; else the tip is estimated.
    tissue : TissueDescription, optional
        What the tip is estimated with where no return stroke tells; default pig liver.
    """

    trace: Trace
    target_length: float | None = None
    truth: Truth | None = None
    tissue: TissueDescription = field(default_factory=measured_liver)

    def __post_init__(self) -> None:
        if self.target_length is not None:
            in_range("target_length", self.target_length, 0.005, 0.15, "m", "8 cm is 0.08.")
        if self.truth is not None and len(self.truth.tip) != len(self.trace):
            raise ValueError(f"truth has {len(self.truth.tip)} instants and the trace {len(self.trace)}.")

    @property
    def time(self) -> Array:
        """[s], shape (n,)."""
        return self.trace.time

    @property
    def force(self) -> Array:
        """In the trace's unit, shape (n,)."""
        return self.trace.force

    @property
    def position(self) -> Array:
        """Of the blade [m], shape (n,)."""
        return self._field("position")

    @property
    def depth(self) -> Array:
        """Of the cut at the blade, no less than 0.5 mm [m], shape (n,)."""
        return np.maximum(self._field("depth"), SHALLOWEST)

    @property
    def angle(self) -> Array:
        """Of the blade [rad], shape (n,)."""
        return self._field("angle")

    @property
    def length(self) -> float:
        """Aimed at [m]."""
        if self.target_length is None:
            raise Unavailable("no target length was given")
        return self.target_length

    @property
    def newtons(self) -> Array:
        """Force [N], shape (n,)."""
        if self.trace.force_unit != "N":
            raise Unavailable("the force is normalised")
        return self.trace.force

    @cached_property
    def advancing(self) -> NDArray[np.bool_]:
        """Whether the blade moves forward over new ground, shape (n,); everywhere where position is not known."""
        if self.trace.position is None:
            return np.ones(len(self.trace), bool)
        x = self.position
        forward = blade_speed(self.time, x) > STANDSTILL
        chosen: NDArray[np.bool_] = forward & (x >= np.maximum.accumulate(x) - 1e-4)
        if not chosen.any():
            raise Unavailable("the blade never advances")
        return chosen

    @cached_property
    def weights(self) -> Array:
        """Duration for which each instant stands [s], shape (n,)."""
        step = np.diff(self.time)
        return np.asarray(0.5 * (np.append(step, 0.0) + np.append(0.0, step)))

    def mean(self, values: Array) -> float:
        """Mean of ``values`` over the time in which the blade advances."""
        w = self.weights[self.advancing]
        return float(w @ values[self.advancing] / w.sum())

    @property
    def tip_source(self) -> str:
        """Where the tip comes from: "truth", "return stroke", "estimated" or "unknown"."""
        if self.truth is not None:
            return "truth"
        if self.trace.position is None or self.trace.depth is None or self.trace.force_unit != "N":
            return "unknown"
        return "estimated" if self._return_stroke is None else "return stroke"

    @cached_property
    def tip(self) -> Array:
        """Of the crack at every instant [m], shape (n,)."""
        if self.truth is not None:
            return self.truth.tip
        return self._estimated_tip

    @cached_property
    def jumps(self) -> Array:
        """Unstable growth [m], at instants or in windows of 20 ms where it is estimated."""
        if self.truth is not None:
            return self.truth.jump
        # The tip's advance beyond the blade's own, over a time longer than the sensor's noise.
        start, end = float(self.time[0]), float(self.time[-1])
        borders = np.arange(start, end, _JUMP_WINDOW)
        a = np.interp(borders, self.time, self.tip)
        x = np.interp(borders, self.time, self.position)
        run = np.diff(a) - np.maximum(np.diff(x), 0.0)
        return np.where(run > _JUMP, run, 0.0)

    @cached_property
    def even_time(self) -> Array:
        """Instants at 100 Hz [s]."""
        return np.arange(float(self.time[0]), float(self.time[-1]), 1.0 / RATE)

    @cached_property
    def smooth_force(self) -> Array:
        """Force at 100 Hz below 5 Hz, while the blade advances."""
        if self.trace.sample_rate < _FEWEST_HZ:
            raise Unavailable(f"fewer than {_FEWEST_HZ:g} readings a second")
        if len(self.even_time) < 30:
            raise Unavailable("shorter than 0.3 s")
        even = np.interp(self.even_time, self.time, self.force)
        return np.asarray(sosfiltfilt(butter(2, BANDWIDTH, fs=RATE, output="sos"), even))

    @cached_property
    def even_advancing(self) -> NDArray[np.bool_]:
        """:attr:`advancing` at 100 Hz."""
        return np.asarray(np.interp(self.even_time, self.time, self.advancing.astype(float)) > 0.5)

    def _field(self, name: str) -> Array:
        values: Array | None = getattr(self.trace, name)
        if values is None:
            raise Unavailable(f"{name} was not recorded")
        return values

    @cached_property
    def profile(self) -> DepthProfile:
        """Depth of cut by place."""
        _ = self.position, self.depth  # say which one is missing
        return DepthProfile.recorded(self.trace, by="score")

    @cached_property
    def model(self) -> CutModel:
        """The finite-element model that the modulus belongs to; the cut lies within it."""
        model = self.tissue.cut_model()
        if float(self.position.max()) > model.length:
            raise Unavailable("the cut is longer than the model's specimen, 15 cm")
        return model

    @cached_property
    def modulus(self) -> float:
        """Local effective modulus that the tip is estimated with [Pa]: the return stroke's, or else the tissue's."""
        back, model = self._return_stroke, self.model
        if back is None or back.stiffness <= 0.0:
            return self.tissue.intercept_90
        return back.stiffness / float(model.stiffness(back.tip) * self.profile.at(back.tip))

    @cached_property
    def elastic_force(self) -> Array:
        """Force less friction, and no less than zero [N], shape (n,)."""
        back = self._return_stroke
        friction = self.tissue.friction_share * self.tissue.fracture_resistance
        if back is not None:
            friction = back.friction_per_depth
        return np.maximum(self.newtons - friction * self.profile.at(self.position), 0.0)

    @cached_property
    def _return_stroke(self) -> ReturnStroke | None:
        return fit_return_stroke(self.trace, self.profile)

    @cached_property
    def _estimated_tip(self) -> Array:
        """Blade less elastic force over stiffness; a cut never heals, so it never goes back."""
        x, B, model, elastic = self.position, self.profile, self.model, self.elastic_force
        back = self._return_stroke
        moves = self.advancing
        a = x.copy()
        for _ in range(_ROUNDS):
            K = self.modulus * np.asarray(model.stiffness(np.clip(a, 0.0, model.length)))
            a = x - elastic / (K * np.maximum(B.at(a), SHALLOWEST))
        a = np.where(moves & (elastic > 0.0), a, -np.inf)
        tip = np.maximum(np.maximum.accumulate(a), min(float(x[0]), 0.0))
        return np.minimum(tip, back.tip) if back is not None else tip
