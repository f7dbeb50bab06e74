"""Lines that a task draws, and the cut expected along them.

There are 64 lines of each kind, with the stiffness of a uniform slab along each.

A line's stiffness is a finite-element solution, which takes a hundred times as long as the cut.  So there is a set of
lines, the same for everybody, to the last bit, whose solutions ``scripts/derivations/lines.py`` has stored; a line that
is given is solved for when it is given, and differs from machine to machine in the last places.  Every second line of a
kind is the mirror image of the one before it.

The expected cut is that behind a blade that is led along a line. Places are given along a line and beside it.
"""

from __future__ import annotations

import itertools
import json
import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from cutenv._base import resources
from cutenv._base.arrays import Array, StructArray
from cutenv._engine.elementary import sine_and_cosine
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, SPACING
from cutenv.sim.tissue.lines import (
    LARGEST_CURVATURE,
    CutLine,
    arc,
    half_ellipse,
    length_within,
    mirrored,
    random_line,
    s_shape,
    straight,
)
from cutenv.sim.tissue.place_model import TipStiffness, along_whole_line, off_line, over_straight, stiffness_off_line
from cutenv.sim.tissue.tables import FOLDER

# Kinds of drawn lines of which "mixed" is one; their targets are drawn apart from them.
MIXED_KINDS = ("straight", "arc", "s", "excision", "random")
# All kinds of drawn lines; a half of a fusiform excision has a length of its own, and is cut from end to end.
KINDS = (*MIXED_KINDS, "fusiform")
MIXED_LINES = len(KINDS)  # number of the kind that is one of MIXED_KINDS
OF_A_KIND = 64  # lines of each kind but the straight one
# Length of each within the slab [m]: the longest cut that is drawn, and room for the blade that leads its tip.
LEAST_LENGTH = 0.13
LENGTH_TO_WIDTH = 2.5, 4.0  # range of a fusiform excision's length over its width, as surgeons plan them
# Range of the angle between each of its sides and its axis, at its ends [rad].
END_ANGLES = math.radians(25.0), math.radians(45.0)
FUSIFORM_LENGTHS = 0.060, 0.100  # range of the length of one side [m]: that from which targets are drawn
# Distance that each but the straight one comes away from the axis of the slab within the longest cut [m].
LEAST_ASIDE = 0.008
STORED: dict[str, Any] = {"element": "quad8", "formulation": "plane_stress", "poisson": 0.3}
"""The model whose solutions are stored: that of the measured liver."""
_FUSIFORM = KINDS.index("fusiform")
_MAX_POINTS = 201  # points of the longest cut that is drawn
_SEED = 29
_FILE = "lines.json"

# Record of a line, and of the stiffness of a crack on it and beside it.
LINE: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            ("within", "f8"),  # length within the slab [m]
            ("length", "f8"),  # length to cut [m]; 0: one that is drawn
            ("x_excess", "f8", (N_POINTS,)),  # x - s [m]
            ("y", "f8", (N_POINTS,)),  # [m]
            ("cosine", "f8", (N_POINTS,)),  # of its direction
            ("sine", "f8", (N_POINTS,)),
            ("curvature", "f8", (N_POINTS,)),  # [1/m]
            ("along", "f8", (N_POINTS,)),  # stiffness of a uniform slab over that along a straight line
            ("coupled", "f8", (N_POINTS,)),
            ("across", "f8", (N_POINTS,)),
            (
                "off_line",
                "f8",
                (3 * N_POINTS,),
            ),  # rates of L beside each point, see cutenv.sim.tissue.place_model [1/m]
        ],
    )
)


class DrawnLines(NamedTuple):
    """Lines, and their records, :data:`LINE` of shape (n,)."""

    lines: tuple[CutLine, ...]
    records: StructArray


def line_record(line: CutLine, found: TipStiffness, base: TipStiffness) -> StructArray:
    """Return a line's :data:`LINE` record with curved and straight stiffness."""
    record = np.zeros(1, LINE)
    record["within"] = length_within(line)
    record["x_excess"], record["y"] = line.x - np.arange(N_POINTS) * SPACING, line.y
    record["sine"], record["cosine"] = sine_and_cosine(line.angle)
    record["curvature"] = line.curvature
    record["along"], record["coupled"], record["across"] = over_straight(found, base)
    record["off_line"] = np.column_stack(off_line(line, base)).ravel()
    return record


def given_line(line: CutLine, element: str, formulation: str, poisson: float) -> DrawnLines:
    """Return a line with its record, solving the model along it."""
    from cutenv.sim.tissue.path_model import straight_stiffness

    plane = element, formulation, poisson
    found, base = _solved(line, plane), straight_stiffness(*plane)
    return DrawnLines((line,), line_record(line, found, base))


def length_of_bends(line: CutLine) -> float:
    """Return the length from which a line is straight [m]."""
    return float(SPACING * np.flatnonzero(line.curvature)[-1])


def _solved(line: CutLine, plane: tuple[str, str, float]) -> TipStiffness:
    from cutenv.sim.tissue.path_model import stiffness_at_unit_modulus  # with scikit-fem, which stored lines do without

    return stiffness_at_unit_modulus(line, *plane)


@lru_cache(maxsize=2)
def drawn_lines(element: str, formulation: str, poisson: float) -> DrawnLines:
    """Return all drawn lines: the straight one, then by kind.

    Another model than :data:`STORED` is solved for every line, which takes some ten seconds.
    """
    plane = element, formulation, poisson
    stored = stored_stiffness() if plane == tuple(STORED.values()) else None
    base = _solved(straight(), plane) if stored is None else along_whole_line(*stored[0, 0])
    lines, solved = [straight()], [base]
    for kind in range(1, len(KINDS)):
        for number in range(0, OF_A_KIND, 2):
            line = first_of_pair(kind, number)
            found = _solved(line, plane) if stored is None else along_whole_line(*stored[kind, number])
            lines += [line, mirrored(line)]
            solved += [found, TipStiffness(found.along, -found.coupled, found.across)]
    records = np.concatenate([line_record(line, found, base) for line, found in zip(lines, solved, strict=True)])
    for number in range(first_number(_FUSIFORM), len(lines)):
        records[number]["length"] = length_of_bends(lines[number])
    records.setflags(write=False)
    return DrawnLines(tuple(lines), records)


def first_number(kind: int) -> int:
    """Return the first number, at least 1, of a kind's lines."""
    return 1 + OF_A_KIND * (kind - 1)


def kind_of(number: int) -> str:
    """Return the kind of the line numbered ``number``."""
    return KINDS[0] if number == 0 else KINDS[1 + (number - 1) // OF_A_KIND]


def first_of_pair(kind: int, number: int, seed: int = _SEED) -> CutLine:
    """Draw the first line of an even-numbered pair of a kind.

    Another ``seed`` draws lines that no task has.
    """
    rng = np.random.default_rng([seed, kind, number])
    while True:
        try:
            line = _drawn(KINDS[kind], rng)
        except ValueError:  # it bends too far, or leaves the slab
            continue
        if kind == _FUSIFORM:
            if FUSIFORM_LENGTHS[0] <= length_of_bends(line) <= FUSIFORM_LENGTHS[1]:
                return line  # it leaves the slab 40 mm or more beyond its end
        elif length_within(line) >= LEAST_LENGTH and abs(line.y[:_MAX_POINTS]).max() >= LEAST_ASIDE:
            return line


def _drawn(kind: str, rng: np.random.Generator) -> CutLine:
    if kind == "arc":
        return arc(rng.uniform(0.03, 0.1), start=rng.uniform(0.005, 0.04), turn=math.radians(rng.uniform(15.0, 35.0)))
    if kind == "s":
        return s_shape(rng.uniform(0.022, 0.06), length=rng.uniform(0.05, 0.1))
    if kind == "excision":
        return half_ellipse(rng.uniform(0.06, 0.11), height=rng.uniform(0.008, 0.018))
    if kind == "fusiform":
        length = rng.uniform(FUSIFORM_LENGTHS[0] / 1.2, FUSIFORM_LENGTHS[1])
        return half_ellipse(length, 0.5 * length / rng.uniform(*LENGTH_TO_WIDTH), rng.uniform(*END_ANGLES))
    return random_line(rng, largest_curvature=rng.uniform(20.0, LARGEST_CURVATURE), least_length=LEAST_LENGTH)


def solved_stiffness() -> list[dict[str, Any]]:
    """Solve the stored model for the straight and each first line.

    Each has its kind, number, tips [m] and stiffness [1].
    """
    from cutenv.sim.tissue.path_model import stiffness_at_tips

    found = []
    for kind, number in [(0, 0), *itertools.product(range(1, len(KINDS)), range(0, OF_A_KIND, 2))]:
        line = first_of_pair(kind, number) if kind else straight()
        tips, stiffness = stiffness_at_tips(line, **STORED)
        parts = stiffness[:, (0, 0, 1), (0, 1, 1)]  # along, coupled, across
        found.append({"kind": kind, "number": number, "tips": tips, "stiffness": parts})
    return found


@lru_cache(maxsize=1)
def stored_stiffness() -> dict[tuple[int, int], tuple[Array, Array]]:
    """Return stored tips [m], (n,), and stiffness [1], (n, 2, 2)."""
    content = json.loads(resources.path(f"{FOLDER}/{_FILE}").read_text())
    found = {}
    for one in content["lines"]:
        along, coupled, across = np.array(one["stiffness"]).T
        matrix = np.stack((along, coupled, coupled, across), axis=-1).reshape(-1, 2, 2)
        found[one["kind"], one["number"]] = np.array(one["tips"]), matrix
    return found


def store(found: list[dict[str, Any]]) -> None:
    """Write solutions of :func:`solved_stiffness` where :func:`stored_stiffness` reads them."""
    lines = [one | {name: _rounded(one[name]) for name in ("tips", "stiffness")} for one in found]
    content = {
        "source": "PathModel along each drawn line (cutenv.sim.tissue.drawn_lines): "
        "stiffness along, coupled, across [1]",
        "script": "scripts/derivations/lines.py --write",
        **STORED,
        "lines": lines,
    }
    resources.path(FOLDER).joinpath(_FILE).write_text(json.dumps(content) + "\n")


def _rounded(values: Array) -> Any:
    return np.vectorize(lambda value: float(f"{value:.9g}"))(values).tolist()


# Largest curvature of a crack: it turns within the length that a blade drags along; assumed [1/m].
CRACK_CURVATURE = 100.0
_ADVANCE = 0.0002  # [m], of the tip from one turn of the crack to the next
_STEEPEST = 0.25  # least cosine of the angle between crack and line
_CHUNK = 2000  # readings whose distances to all points of a line are held at once


def along_line(line: CutLine, x: Array, y: Array) -> tuple[Array, Array]:
    """Return arc lengths and leftward distances of points [m], shape (n,)."""
    nearest = np.concatenate(
        [
            np.argmin((x[i : i + _CHUNK, None] - line.x) ** 2 + (y[i : i + _CHUNK, None] - line.y) ** 2, axis=1)
            for i in range(0, len(x), _CHUNK)
        ]
    )
    cosine, sine = np.cos(line.angle[nearest]), np.sin(line.angle[nearest])
    east, north = x - line.x[nearest], y - line.y[nearest]
    ahead, left = east * cosine + north * sine, north * cosine - east * sine
    bend = line.curvature[nearest]
    # From the tangent at the nearest point to the arc, of which it is less than half a spacing away.
    place = nearest * SPACING + ahead / (1.0 - bend * left)
    return place, left - 0.5 * bend * ahead**2


def expected_cut(line: CutLine, x: Array, y: Array, tip: Array, tissue: TissueDescription) -> Array:
    """Return the distance of mean tissue's cut left of its line [m].

    The crack turns toward the force, as the law in the plane has it; stiffness is that of a uniform slab.  ``x``, ``y``
    are places of the blade along and across the slab [m], ``tip`` the lengths of line that the tip has cut [m], all
    (n,).
    """
    from cutenv.sim.tissue.path_model import stiffness_at_unit_modulus, straight_stiffness

    plane = tissue.element, tissue.formulation, tissue.poisson
    stiffness = stiffness_at_unit_modulus(line, *plane)
    rates = off_line(line, straight_stiffness(*plane))
    reached = np.maximum.accumulate(np.clip(tip, 0.0, LENGTH))
    places = np.append(np.arange(0.0, reached[-1], _ADVANCE), reached[-1])
    blades = np.minimum(np.searchsorted(reached, places), len(reached) - 1)
    grid = np.arange(N_POINTS) * SPACING
    columns = (line.x, line.y, line.angle, line.curvature, *stiffness, *rates)
    on_line = np.column_stack([np.interp(places, grid, column) for column in columns])
    east, north, heading = float(line.x[0]), float(line.y[0]), float(line.angle[0])
    aside = np.zeros(len(places))
    for i, (_, _, angle, bend, *here) in enumerate(on_line[:-1].tolist()):
        step = places[i + 1] - places[i]
        cosine, sine = math.cos(angle), math.sin(angle)
        off_x, off_y = float(x[blades[i]]) - east, float(y[blades[i]]) - north
        ahead, left = off_x * cosine + off_y * sine, off_y * cosine - off_x * sine
        along, coupled, across = stiffness_off_line(here[:3], here[3:], float(aside[i]))
        pull, push = along * ahead + coupled * left, coupled * ahead + across * left
        if pull > 0.0:
            turn = math.remainder(angle + math.atan2(push, pull) - heading, 2.0 * math.pi)
            heading += min(max(turn, -CRACK_CURVATURE * step), CRACK_CURVATURE * step)
        way = step * (1.0 - bend * aside[i]) / max(math.cos(heading - angle), _STEEPEST)
        east, north = east + way * math.cos(heading), north + way * math.sin(heading)
        after = on_line[i + 1]
        aside[i + 1] = (north - after[1]) * math.cos(after[2]) - (east - after[0]) * math.sin(after[2])
    passed = grid[: int(reached[-1] / SPACING) + 1]
    return np.asarray(np.interp(passed, places, aside))
