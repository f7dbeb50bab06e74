"""A metric: a pure function of one cut, with everything that a reader of its number must know."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

from cutenv.validation import one_of

if TYPE_CHECKING:
    from cutenv.scoring.cut import ScoredCut

Direction = Literal["lower", "higher", "none"]
Invariance = Literal["time_shift", "force_scale", "force_offset", "resampling", "rest_after", "units"]

INVARIANCES: dict[Invariance, str] = {
    "time_shift": "the clock may start anywhere",
    "force_scale": "the force may be normalised by any number",
    "force_offset": "a sensor's zero does not matter",
    "resampling": "the rate of readings does not matter, from 200 Hz on, within 5 %",
    "rest_after": "a second of rest in the unloaded tissue after the cut adds nothing, within 2 %",
    "units": "doubling a cut's force and depth and the slab's thickness together changes nothing",
}
"""What a metric may promise; each has one test for all that do."""


class Unavailable(ValueError):
    """Why a metric cannot be had from a cut."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One number of a cut.

    Attributes
    ----------
    name : str
        ``*_error`` falls to zero.
    unit : str
        "1" for a pure number; "F" stands for the force unit of the record.
    direction : {"lower", "higher", "none"}
        Which is better; "none" is reported and never rewarded.
    meaning, formula, source, validity : str
        What it is; how it is computed; whence; and where it holds.
    needs : tuple of str
        Fields of the trace beside time and force, and "newtons", "target_length", "tip".
    invariances : tuple of str
        Of :data:`INVARIANCES`.
    function : callable
        From a :class:`~cutenv.scoring.cut.ScoredCut` to a float; raises :class:`Unavailable`.
    """

    name: str
    unit: str
    direction: Direction
    meaning: str
    formula: str
    source: str
    validity: str
    needs: tuple[str, ...]
    invariances: tuple[Invariance, ...]
    function: Callable[[ScoredCut], float]

    def __post_init__(self) -> None:
        one_of("direction", self.direction, get_args(Direction))
        for each in self.invariances:
            one_of("invariance", each, INVARIANCES)


METRICS: dict[str, Metric] = {}
"""Every metric by name, in the order of the card."""


def metric(
    unit: str,
    direction: Direction,
    *,
    formula: str,
    source: str,
    validity: str,
    needs: tuple[str, ...] = (),
    invariances: tuple[Invariance, ...] = (),
) -> Callable[[Callable[[ScoredCut], float]], Callable[[ScoredCut], float]]:
    """Enter a function of a cut into :data:`METRICS` under its own name; its docstring's first line is its meaning."""

    def enter(function: Callable[[ScoredCut], float]) -> Callable[[ScoredCut], float]:
        name = function.__name__
        METRICS[name] = Metric(
            name=name,
            unit=unit,
            direction=direction,
            meaning=(function.__doc__ or "").strip().partition("\n")[0],
            formula=formula,
            source=source,
            validity=validity,
            needs=needs,
            invariances=invariances,
            function=function,
        )
        return function

    return enter
