"""Slab with cuts along any curve at one instant: elements of its model at rest and displaced, and the blade."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array
from cutenv.plant.freehand_plant import FreehandPlant
from cutenv.scoring.cut_map import LINE_KEY
from cutenv.scoring.score_card import positions_along
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.tissue import measured_liver
from cutenv.tissue.lines import CutLine, straight, through
from cutenv.tissue.steered_model import SteeredModel
from cutenv.trace import Trace

OPENING = 0.0016
"""Distance by which faces of a cut are drawn apart, far from its ends [m]: an illustration."""
_LEAST = 0.001  # length of a cut that can be drawn [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class CurvedCut:
    """Slab that was cut along any curve, under the force of its blade.

    Attributes
    ----------
    name : str
        Title of the page.
    depth : float
        Mean depth of cut, to which the slab is drawn [m].
    rest, moved : list of array
        Outlines of the model's elements at rest and displaced, each of shape (3 or 4, 2): along and across the slab
        [m].
    blade : tuple of float
        Place of the blade along and across the slab [m].
    heading, angle : float
        Direction in which the blade points, to the left of the slab's axis, and its inclination [rad].
    line : array, shape (n, 2), or None
        Places of the line that was to be cut [m].
    """

    name: str
    depth: float
    rest: list[Array]
    moved: list[Array]
    blade: tuple[float, float]
    heading: float
    angle: float
    line: Array | None = None

    @classmethod
    def of_plant(cls, plant: FreehandPlant, name: str = "Cuts by a free hand") -> CurvedCut:
        """Return the slab of a plant as it is now."""
        return cls(
            name=name,
            depth=float(np.mean(plant.specimen.depth)),
            rest=plant.model.outlines(),
            moved=plant.displaced(OPENING),
            blade=plant.blade,
            heading=plant.heading,
            angle=float(plant.states["angle"][0]),
        )

    @classmethod
    def of_record(cls, trace: Trace, *, line: CutLine | None = None, target: float | None = None) -> CurvedCut:
        """Return the slab as a record's blade left it at the end.

        The cut is the one that a simulator noted, or the one that mean liver would have behind this blade, as for the
        score; the model is that of a uniform slab.

        Parameters
        ----------
        trace : Trace
            Record with the places of the blade, position and depth.
        line : CutLine, optional
            Line that was to be cut; by default the record's own, if any.
        target : float, optional
            Target length along the line [m]; by default the record's own, if any.

        Raises
        ------
        ValueError
            If the record lacks places, position or depth, or nothing was cut.
        """
        x, y, depth = trace.blade_x, trace.blade_y, trace.depth
        if x is None or y is None or trace.position is None or depth is None:
            raise ValueError("A cut in the plane is drawn from blade_x, blade_y, position and depth; record all four.")
        if line is None and trace.metadata.get(LINE_KEY) is not None:
            line = through(trace.metadata[LINE_KEY])
        else:
            trace = positions_along(line or straight(), trace)
        target = trace.metadata.get("target_length_m") if target is None else target
        tissue = measured_liver()
        path = ScoredCut(trace=trace, line=line or straight(), target_length=target, tissue=tissue).path_map.place
        model = SteeredModel(formulation=tissue.formulation, poisson=tissue.poisson)
        steps = np.diff(path, axis=0)
        if len(steps) == 0 or np.hypot(*steps.T).sum() < _LEAST:
            raise ValueError("The crack has not left the clamp in this record: there is no cut to draw.")
        headings = np.arctan2(steps[:, 1], steps[:, 0])
        model.begin(path[0], float(headings[0]))
        for place, heading in zip(path[1:], headings, strict=True):
            model.cut_to(place, float(heading))
        end = np.array([float(x[-1]), float(y[-1])])
        lag, ahead = end - model.tip, np.array([math.cos(model.angle), math.sin(model.angle)])
        if ahead @ lag < 0.0:  # behind the tip the blade holds nothing
            lag = np.zeros(2)
        frame = np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])
        return cls(
            name=str(trace.metadata.get("name", "cut")),
            depth=float(depth.mean()),
            rest=model.outlines(),
            moved=model.outlines(frame @ model.stiffness @ frame.T @ lag, OPENING),
            blade=(float(end[0]), float(end[1])),
            heading=model.angle,
            angle=0.5 * math.pi if trace.angle is None else float(trace.angle[-1]),
            line=None if line is None else np.column_stack((line.x, line.y)),
        )
