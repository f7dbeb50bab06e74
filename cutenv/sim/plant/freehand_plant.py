"""Simulated slab that is cut where the blade is led, solved again as it opens."""

from __future__ import annotations

import math
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray, joined_records
from cutenv._base.validation import in_range
from cutenv.sim.cutting.steering import begin_steering
from cutenv.sim.plant.third_axis_plants import SteeredPlant
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.sim.tissue.lines import SIDE_MARGIN, WIDTH, CutLine, straight
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.tissue.steered_model import SteeredModel

NODES_AHEAD = 3  # nodes for which the model tells the stiffness of a crack that goes straight on
_ELEMENT = 0.01  # of the model to which the measured moduli belong [m]
FREE_SIDE = 0.5 * WIDTH - SIDE_MARGIN  # largest distance of the blade to the axis of the slab [m]
_CHUNK = 10  # milliseconds after which the tip is followed: the crack turns no sooner


class Grown(NamedTuple):
    """Stiffness over that of a straight cut at points of the line, and any end."""

    ways: Array
    ratios: Array
    end: str | None


class GrowingModel:
    """Finite-element model whose crack follows that of a cut.

    It tells the stiffness along a line, at whose start the cut begins; the specimen's profiles lie along it.  ``model``
    is copied; by default it is a new one with elements of 5 mm.
    """

    def __init__(self, specimen: Specimen, line: CutLine, model: SteeredModel | None = None) -> None:
        in_range("line.y at its start", line.y[0], -FREE_SIDE, FREE_SIDE, "m", "Begin within the slab.")
        tissue, self.line = specimen.tissue, line
        self.model = (
            SteeredModel(formulation=tissue.formulation, poisson=tissue.poisson) if model is None else model.copy()
        )
        self._grid = np.arange(N_POINTS) * SPACING
        self._own: Array = specimen.stiffness()
        self._straight = CutModel(formulation=tissue.formulation, poisson=tissue.poisson)
        self._ratios = np.empty((N_POINTS, 2, 2))
        self._frames = np.moveaxis(
            np.array([[np.cos(line.angle), -np.sin(line.angle)], [np.sin(line.angle), np.cos(line.angle)]]), -1, 0
        )

    def begin(self, profile: Struct, steering: Struct, length: float = 0.0) -> None:
        """Begin a cut, led along ``length`` of the line [m], replacing the line's stiffness."""
        line = self.line
        self.model.begin((float(line.x[0]), float(line.y[0])), float(line.angle[0]))
        for i in range(1, round(length / SPACING) + 1):
            self.model.cut_to((line.x[i], line.y[i]), float(line.angle[i]))
        steering["reach"], steering["side"] = WIDTH, FREE_SIDE
        steering["off_line"] = 0.0  # the model stands where the tip does
        self.tell(steering, self.looked_ahead(), 0.0)
        begin_steering(profile, steering, length)

    def lead(self, way: list[tuple[float, float, float]]) -> Grown:
        """Lead the crack along places [m] and directions; tell once a node is passed."""
        passed = 0
        try:
            for x, y, angle in way:
                passed += self.model.cut_to((x, y), angle)
        except ValueError as error:
            return Grown(np.zeros(0), np.zeros(0), str(error))
        return self.looked_ahead() if passed else Grown(np.zeros(0), np.zeros(0), None)

    def looked_ahead(self) -> Grown:
        """Return the stiffness at the tip and at straight-on nodes."""
        ahead, places, stiffness = self.model.copy(), [], []
        if len(ahead.path) > 1:
            places.append(ahead.tip)
            stiffness.append(self._in_plane(ahead))
        for _ in range(NODES_AHEAD):
            try:
                ahead.go_straight_on()
            except ValueError:
                break
            places.append(ahead.tip)
            stiffness.append(self._in_plane(ahead))
        ways, found = np.array([self._arc_length(place) for place in places]), np.array(stiffness)
        # A crack shorter than an element of the measured moduli has the stiffness of one as long, as in a line's table.
        known = ways >= min(self._straight.tips[0] - 0.5 * SPACING, ways.max())
        base = np.asarray(self._straight.stiffness(np.clip(ways[known], self._straight.tips[0], LENGTH)))
        return Grown(ways[known], found[known] / base[:, np.newaxis, np.newaxis], None)

    def _in_plane(self, model: SteeredModel) -> Array:
        """Return a tip's stiffness along and across the slab."""
        c, s = math.cos(model.angle), math.sin(model.angle)
        frame = np.array([[c, -s], [s, c]])
        return frame @ model.converted_stiffness(_ELEMENT) @ frame.T  # type: ignore[no-any-return]

    def _arc_length(self, place: Array) -> float:
        """Return a place's arc length along the line [m]."""
        line = self.line
        i = int(np.argmin((line.x - place[0]) ** 2 + (line.y - place[1]) ** 2))
        along = (place[0] - line.x[i]) * math.cos(line.angle[i]) + (place[1] - line.y[i]) * math.sin(line.angle[i])
        return float(min(max(i * SPACING + along, 0.0), LENGTH))

    def tell(self, steering: Struct, grown: Grown, tip: float) -> None:
        """Write the stiffness from ``tip`` [m] on, held beyond the last node."""
        first = max(int(np.searchsorted(self._grid, tip, side="right")) - 1, 0)
        order = np.argsort(grown.ways)
        ways, ratios = grown.ways[order], grown.ratios[order]
        at = self._grid[first:]
        for i in (0, 1):
            for j in (0, 1):
                self._ratios[first:, i, j] = np.interp(at, ways, ratios[:, i, j])
        frames = self._frames[first:]
        turned = np.einsum("nri,nrs,nsj->nij", frames, self._ratios[first:], frames)
        own = self._own[first:]
        steering["along"][first:], steering["coupled"][first:] = own * turned[:, 0, 0], own * turned[:, 0, 1]
        steering["sideways"][first:] = own * turned[:, 1, 1]

    def displaced(self, lag: Array, opening: float = 0.0) -> list[Array]:
        """Return element outlines, (3 or 4, 2) [m], displaced by ``lag`` [m].

        ``opening`` is the distance by which the faces of cuts are drawn apart, far from their ends [m].
        """
        c, s = math.cos(self.model.angle), math.sin(self.model.angle)
        frame = np.array([[c, -s], [s, c]])
        if frame[:, 0] @ lag < 0.0:  # behind the tip the blade holds nothing
            lag = np.zeros(2)
        return self.model.outlines(frame @ self.model.stiffness @ frame.T @ lag, opening)


class FreehandPlant(SteeredPlant):
    """Simulated slab, cut by a blade that is led anywhere: its model follows the crack.

    The blade is driven where it points and turned to the left and right, as with
    :class:`~cutenv.sim.plant.SteeredPlant`.  Whenever the crack passes a node, its 2 x 2 stiffness is computed for the
    cut as it is, and for :data:`NODES_AHEAD` nodes straight on; the force responds at the crack's next turn.

    Parameters
    ----------
    line : CutLine, optional
        Line at whose start the cut begins, by default the axis of the slab; it only tells places, and where the
        specimen's profiles lie.
    model : SteeredModel, optional
        Model of the slab, with earlier cuts if it has any, which is copied; by default a new one with elements of
        5 mm.
    background : bool
        Whether the model is solved in a second thread, while the force comes from the last stiffness.  What is cut
        then depends on the speed of the machine; without it, it is the same at every run.
    **arguments
        Those of :class:`~cutenv.sim.plant.SteeredPlant`.

    Attributes
    ----------
    end : str or None
        Why the crack could not be followed further: it met a cut, or a side of the slab.
    """

    def __init__(
        self,
        specimen: Specimen,
        line: CutLine | None = None,
        *,
        model: SteeredModel | None = None,
        background: bool = False,
        **arguments: Any,
    ) -> None:
        line = straight() if line is None else line
        self._growing_model = GrowingModel(specimen, line, model)
        super().__init__(specimen, line, **arguments)
        self.end: str | None = None
        self._noted = (float(line.x[0]), float(line.y[0]))
        self._way: list[tuple[float, float, float]] = []
        self._solver = ThreadPoolExecutor(1, "model") if background else None
        self._growing: Future[Grown] | None = None
        self._growing_model.begin(self.profiles[0], self.steerings[0])

    @property
    def model(self) -> SteeredModel:
        """Mesh and cuts; with ``background``, look at it after :meth:`settle`."""
        return self._growing_model.model

    def _advance(self, speed: float, angle: float, ticks: int, further: float) -> StructArray:
        """Advance in parts, with the model following the crack between them."""
        if ticks <= _CHUNK:
            felt = super()._advance(speed, angle, ticks, further)
            self._follow()
            return felt
        readings, across = [], []
        for start in range(0, ticks, _CHUNK):
            readings.append(super()._advance(speed, angle, min(_CHUNK, ticks - start), further))
            across.append(self._across)
            self._follow()
        self._across = np.concatenate(across)
        return joined_records(readings)

    def settle(self) -> None:
        """Wait until the model has followed the crack."""
        while self._growing is not None or (self._way and self.end is None):
            if self._growing is not None:
                self._growing.result()
            self._follow()

    @property
    def cut(self) -> Array:
        """Nodes of the cut in the model, shape (n, 2) [m]."""
        return self.model.path

    def displaced(self, opening: float = 0.0) -> list[Array]:
        """Return the model's displaced element outlines, each (3 or 4, 2) [m].

        ``opening`` is the distance by which the faces of cuts are drawn apart, far from their ends [m].
        """
        self.settle()
        return self._growing_model.displaced(np.subtract(self.blade, self.tip), opening)

    def _follow(self) -> None:
        """Record the tip's place, and let the model follow."""
        x, y = self.tip
        steering = self.steerings[0]
        if math.dist((x, y), self._noted) > 0.5 * SPACING:
            self._noted = (x, y)
            self._way.append((x, y, math.atan2(steering["tip_across"], steering["tip_ahead"])))
        if self._growing is not None and self._growing.done():
            self._accept(self._growing.result())
            self._growing = None
        if self._way and self._growing is None and self.end is None:
            way, self._way = self._way, []
            if self._solver is None:
                self._accept(self._growing_model.lead(way))
            else:
                self._growing = self._solver.submit(self._growing_model.lead, way)

    def _accept(self, grown: Grown) -> None:
        self.end = grown.end
        if len(grown.ways):
            self._growing_model.tell(self.steerings[0], grown, float(self.states["tip"][0]))
