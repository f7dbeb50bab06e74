"""Recorded cut to be shown: blade, force, tip and elastic field at evenly spaced instants."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Indices
from cutenv._base.validation import in_range
from cutenv.measurement import DepthProfile
from cutenv.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY, wanted_depth
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.tissue import CutModel
from cutenv.tissue.grid import SPACING
from cutenv.trace import Trace

COLOURINGS = ("displacement", "energy")
"""Quantities that the tissue's colour can show."""
INSTANTS = 160
"""Number of instants shown of a record; a page grows with it."""

_FLATTEST = math.radians(10.0)  # least angle of a blade that can be drawn
_CURE = (
    "A cut is drawn where the blade was: give the columns, or what was constant, as in "
    "--map time=t force=Fx position=x[mm] angle=90deg depth=20mm --unit N."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShownCut:
    """Cut at the instants that are shown; SI and radians, arrays of shape (n,).

    Attributes
    ----------
    name : str
        Name of the record.
    time : ndarray
        Time since the record's first instant [s].
    force, position, speed, angle : ndarray
        Recorded force [N], position [m], speed [m/s] and angle [rad].
    tip : ndarray
        Position of the crack tip, in tissue at rest [m]; estimated, 0 to the specimen's length.
    shift : ndarray
        Distance by which the elastic force carries the tip along the line [m].
    depth : DepthProfile
        Depth of cut by position.
    modulus : float
        Local effective modulus from which tip and field are computed [Pa].
    tip_source : str
        "return stroke" or "estimated".
    angle_known : bool
        True if the record holds the angle; otherwise the blade is drawn upright.
    target : float or None
        Target length, from the clamp [m].
    model : CutModel
        Finite-element model whose field displaces the tissue.
    whole_time, whole_force : ndarray of shape (m,)
        The record's own instants [s] and force [N].
    height : ndarray or None
        Height of the blade's lower end [m]; 0 cuts as deep as ``depth``.  None if the record does not hold it.
    floor, wanted : DepthProfile or None
        Depth of the floor of the cut below the surface as it is at the end, and the wanted depth, by position; None
        where there is no height, or no wanted depth.
    layer : float or None
        Depth below the surface at which another layer begins [m].
    """

    name: str
    time: Array
    force: Array
    position: Array
    speed: Array
    angle: Array
    tip: Array
    shift: Array
    depth: DepthProfile
    modulus: float
    tip_source: str
    angle_known: bool
    target: float | None
    model: CutModel
    whole_time: Array
    whole_force: Array
    height: Array | None = None
    floor: DepthProfile | None = None
    wanted: DepthProfile | None = None
    layer: float | None = None

    @classmethod
    def of(cls, trace: Trace, *, target: float | None = None, instants: int = INSTANTS) -> ShownCut:
        """Compute what is shown of a record.

        Parameters
        ----------
        trace : Trace
            Record with position and depth, and force in newtons.
        target : float, optional
            Target length, from the clamp [m], 0.005 to 0.15; by default the record's own ``target_length_m``, if any.
        instants : int
            Number of instants, 2 to 2000, evenly spaced in time; at most as many as the record has.

        Raises
        ------
        ValueError
            If the record lacks a necessary column, or the blade lies flat or leaves the specimen.
        """
        count = int(in_range("instants", instants, 2, 2000, "1", "A page with 160 has about 6 MB."))
        try:
            trace.require("position", "depth", by="view")
        except ValueError as error:
            raise ValueError(f"{error} {_CURE}") from None
        trace.require_newtons(by="view")
        position = np.asarray(trace.position)
        angle = np.full(len(trace), math.pi / 2) if trace.angle is None else trace.angle
        _check_angle(angle)
        cut = ScoredCut(trace=trace, target_length=_target(trace, target))
        model, depth = cut.model, cut.profile if trace.height is None else DepthProfile.recorded(trace, by="view")
        # The reading that is nearest to each of the evenly spaced instants.
        even = np.linspace(trace.time[0], trace.time[-1], min(count, len(trace)))
        shown = np.unique(np.searchsorted(0.5 * (trace.time[1:] + trace.time[:-1]), even))
        tip = np.clip(cut.tip[shown], 0.0, model.length)
        stiffness = cut.stiffness(cut.modulus, tip)
        speed = trace.blade_speed if trace.speed is None else trace.speed
        return cls(
            name=str(trace.metadata.get("name", "cut")),
            time=trace.time[shown] - trace.time[0],
            force=trace.force[shown],
            position=position[shown],
            speed=speed[shown],
            angle=angle[shown],
            tip=tip,
            shift=cut.elastic_force[shown] / stiffness,
            depth=depth,
            modulus=cut.modulus,
            tip_source=cut.tip_source,
            angle_known=trace.angle is not None,
            target=cut.target_length,
            model=model,
            whole_time=trace.time - trace.time[0],
            whole_force=trace.force,
            **_of_height(trace, cut, shown),
        )

    def __len__(self) -> int:
        return len(self.time)

    def field(self, i: int) -> Array:
        """Return the displacement of the nodes at an instant [m], shape (n_nodes, dim)."""
        a = float(self.tip[i])
        # The tip moves by F/(kappa E B); with E = B = 1 that force is kappa times the shift.
        return self.model.displacement(a, float(self.model.stiffness(a) * self.shift[i]), modulus=1.0, thickness=1.0)


def _target(trace: Trace, given: float | None) -> float | None:
    if given is not None:
        return given
    own = trace.metadata.get("target_length_m")
    return (
        None
        if own is None
        else in_range("target_length_m", own, 0.005, 0.15, "m", "Give --target-length 80mm instead.")
    )


def _of_height(trace: Trace, cut: ScoredCut, shown: Indices) -> dict[str, Any]:
    """Return what is shown of a record whose blade also moves up and down; nothing of others."""
    if trace.height is None:
        return {}
    # The whole record is shown, also of a cut that did not come to an end.
    whole = trace if "end" in trace.metadata else trace.with_metadata({**trace.metadata, "end": "unknown"})
    floor = (cut if whole is trace else dataclasses.replace(cut, trace=whole)).floor
    wanted, layer = trace.metadata.get(WANTED_DEPTH_KEY), trace.metadata.get(LAYER_DEPTH_KEY)
    cure = "12 mm is 0.012."
    return {
        "height": trace.height[shown],
        "floor": DepthProfile(position=np.arange(len(floor), dtype=np.float64) * SPACING, depth=floor),
        "wanted": None if wanted is None else wanted_depth(wanted, name=f"metadata {WANTED_DEPTH_KEY}"),
        "layer": None if layer is None else in_range(f"metadata {LAYER_DEPTH_KEY}", layer, 0.0005, 0.1, "m", cure),
    }


def _check_angle(angle: Array) -> None:
    worst = float(angle[np.argmax(np.abs(angle - math.pi / 2))])
    if not _FLATTEST <= worst <= math.pi - _FLATTEST:
        raise ValueError(
            f"angle = {math.degrees(worst):.0f} deg lies flat; a blade is drawn from 10 to 170 deg against the "
            "surface. Upright is 90 deg: if the record counts from upright, map it again."
        )
