"""Slab with cuts along any curve at one instant, as a solid."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cutenv._base.arrays import Array
from cutenv.display.viewer import palette
from cutenv.display.viewer.solid.solids import Surface
from cutenv.records.scoring.cut_map import LINE_KEY
from cutenv.records.scoring.score_card import positions_along
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.sim.plant.freehand_plant import FreehandPlant
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.lines import WIDTH, CutLine, straight, through
from cutenv.sim.tissue.steered_model import SteeredModel
from cutenv.sim.trace import Trace

OPENING = 0.0016
"""Distance by which faces of a cut are drawn apart, far from its ends [m]: an illustration."""
_MIN_LENGTH = 0.001  # length of a cut that can be drawn [m]


@dataclass(frozen=True, kw_only=True, eq=False)
class CurvedCut:
    """Slab cut along any curve, under its blade's force.

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
        """Return the slab as a record's blade left it.

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
        if len(steps) == 0 or np.hypot(*steps.T).sum() < _MIN_LENGTH:
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


_ABOVE = 2.5e-4  # the upper face, at which lines are drawn [m]


class CurvedSolid:
    """Slab cut along any curve, as surfaces and lines."""

    width = WIDTH

    def __init__(self, cut: CurvedCut) -> None:
        self.depth = cut.depth
        self._rest = [_seen(outline) for outline in cut.rest]
        self._moved = [_seen(outline) for outline in cut.moved]
        self._line = None if cut.line is None else _seen(cut.line)

    @cached_property
    def skins(self) -> dict[str, Surface]:
        """Surfaces by name: top, bottom, rim, and cut faces."""
        edges: dict[str, list[Array]] = {"rim": [], "faces": []}
        shared = Counter(key for outline in self._rest for key in _edges(outline))
        joined = Counter(key for outline in self._moved for key in _edges(outline))
        for rest, moved in zip(self._rest, self._moved, strict=True):
            ends = zip(moved, np.roll(moved, -1, axis=0), strict=True)
            for own, drawn, (one, other) in zip(_edges(rest), _edges(moved), ends, strict=True):
                if joined[drawn] == 1:
                    edges["rim" if shared[own] == 1 else "faces"].append(np.stack((one, other)))
        skins = {name: self._walls(np.array(found).reshape(-1, 2, 2)) for name, found in edges.items()}
        return skins | {"top": self._level(self.depth), "bottom": self._level(0.0)}

    @cached_property
    def lines(self) -> Array:
        """Ends of element edges in the upper face, shape (2 n, 3) [m]."""
        ends = np.concatenate([np.stack((m, np.roll(m, -1, axis=0)), axis=1).reshape(-1, 2) for m in self._moved])
        return self._above(ends)

    @cached_property
    def wanted(self) -> Array | None:
        """Ends of the wanted line's pieces over the upper face, shape (2 n, 3) [m], or None."""
        if self._line is None:
            return None
        return self._above(np.stack((self._line[:-1], self._line[1:]), axis=1).reshape(-1, 2))

    def colours(self, surface: Surface) -> Array:
        """Return vertex colours by displacement, shape (n, 3), 0 to 1."""
        amounts = np.hypot(*(np.concatenate(self._moved) - np.concatenate(self._rest)).T)
        known: dict[tuple[float, ...], float] = {}
        for place, amount in zip(np.concatenate(self._moved), amounts, strict=True):
            known.setdefault(_key(place), float(amount))
        shade = np.array([known[_key(vertex[:2])] for vertex in surface.vertices]) / max(float(amounts.max()), 1e-9)
        table = np.array(palette.TISSUE) / 255.0
        colours: Array = table[np.rint(shade * (len(table) - 1)).astype(int)]
        return colours

    def _above(self, places: Array) -> Array:
        return np.column_stack((places, np.full(len(places), self.depth + _ABOVE)))

    def _level(self, height: float) -> Surface:
        parts = []
        for outline in self._moved:
            fan = [[0, k, k + 1] for k in range(1, len(outline) - 1)]
            vertices = np.column_stack((outline, np.full(len(outline), height)))
            parts.append(Surface(vertices=vertices, faces=np.array(fan)))
        return Surface.joined(*parts)

    def _walls(self, edges: Array) -> Surface:
        heights = np.array([0.0, 0.0, self.depth, self.depth])
        corners = edges[:, [0, 1, 1, 0]]
        vertices = np.concatenate((corners, np.broadcast_to(heights[:, np.newaxis], (len(edges), 4, 1))), axis=2)
        faces = 4 * np.arange(len(edges))[:, np.newaxis, np.newaxis] + np.array([[0, 1, 2], [0, 2, 3]])
        return Surface(vertices=vertices.reshape(-1, 3), faces=faces.reshape(-1, 3))


def _seen(outline: Array) -> Array:
    """Return places (along, left) as (across to the right, along)."""
    return np.column_stack((-outline[:, 1], outline[:, 0]))


def _key(place: Array) -> tuple[float, ...]:
    return tuple(np.round(place, 9) + 0.0)


def _edges(outline: Array) -> list[frozenset[tuple[float, ...]]]:
    """Return the edges of an element as pairs of places."""
    keys = [_key(place) for place in outline]
    return [frozenset((keys[k], keys[(k + 1) % len(keys)])) for k in range(len(keys))]
