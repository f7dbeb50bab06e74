"""Truth of the model of a cut that is not known beforehand: other models, symmetry, refinement, fracture mechanics.

Rows of the table of scripts/validation/physics/steering.py.  With faces that open the model is one of a crack, for
which there are closed forms: an edge crack in tension (Tada, Paris and Irwin), a kink (Cotterell and Rice 1980) and an
arc under pressure (Sih, Paris and Erdogan 1962, the example of Cotterell and Rice).
"""

from __future__ import annotations

import itertools
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from cutenv.sim.tissue import CutModel, PathModel, Specimen, SteeredModel
from cutenv.sim.tissue.drawn_lines import KINDS, LEAST_LENGTH, STORED, along_line, first_of_pair, given_line
from cutenv.sim.tissue.elasticity import lame_parameters
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.lines import CutLine, arc, half_ellipse, length_within, random_line, s_shape, straight
from cutenv.sim.tissue.path_model import straight_stiffness
from cutenv.sim.tissue.place_model import stiffness_off_line
from cutenv.sim.tissue.split_mesh import SplitMesh, SplitStiffness
from scripts.validation.physics.curves.calculix import compliance
from scripts.validation.physics.promises import Row

ELEMENT = 0.01
"""Elements at the tip to which stiffnesses are converted [m]: those of the model that the measured moduli belong to."""
EXACT = 1e-10
OFF_LINE, FARTHEST_OFF = 0.05, 0.07
"""Error of a line's table for tips beside it that 95 % of them keep within, and all of them [1]."""
_OTHER_SEED = 31
_PARTS = ("along", "coupled, over that along", "across")
_NEAR_AXIS = 0.02  # distance of a line to the slab's axis [m] beyond which the side is near, and elements are oblique
_BESIDE_FROM = 0.04  # length of a line after which a crack runs as far beside it as it is to [m]
_STEP = 0.02  # of an element, by which the tip moves for a derivative
KINKS = (15.0, 30.0, 45.0)  # angles of kinks [degrees]


def led_along(line: CutLine, model: SteeredModel, length: float) -> tuple[Any, Any]:
    """Lead a cut along a line; return the arc length of each node [m], and the converted stiffness there, (n, 2, 2)."""
    model.begin(angle=float(line.angle[0]))
    ways = np.arange(0.0, min(length, length_within(line) - 0.01), 1e-4)
    grid = np.arange(len(line.x)) * 5e-4
    x, y, angle = (np.interp(ways, grid, values) for values in (line.x, line.y, line.angle))
    found = [
        (ways[i], model.converted_stiffness(ELEMENT))
        for i in range(1, len(ways))
        if model.cut_to((x[i], y[i]), angle[i])
    ]
    return np.array([way for way, _ in found]), np.array([stiffness for _, stiffness in found])


def at(ways: Any, stiffness: Any, places: Any) -> Any:
    """Interpolate stiffnesses at arc lengths, shape (n, 2, 2)."""
    parts = [np.interp(places, ways, stiffness[:, i, j]) for i in (0, 1) for j in (0, 1)]
    return np.stack(parts, axis=-1).reshape(-1, 2, 2)


def check_other_models(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check the steered model against those of known lines, on the same mesh and on others."""
    uneven = np.random.default_rng(0).uniform(0.5, 2.0, 16 * 30)
    plain, model = CutModel(divisions=(16, 30), relative_modulus=uneven), SteeredModel(relative_modulus=uneven)
    model.begin()
    errors = []
    for a in plain.tips:
        model.cut_to((a, 0.0))
        errors.append(abs(1.0 / model.compliance[0, 0] / plain.stiffness(a) - 1.0))
    yield _small("steered model on a straight line of an uneven slab against CutModel, same mesh", max(errors), EXACT)
    line = half_ellipse()
    drawn, model = PathModel(line), SteeredModel((8, 15), line=line)
    model.begin(angle=float(line.angle[0]))
    errors = []
    for k, expected in enumerate(drawn.stiffness):
        across, along = drawn.mesh.nodes[drawn.mesh.tip_pairs[k, 0, 0]]
        middle, end = (float(np.interp(x, line.x, line.angle)) for x in (0.5 * (along + model.tip[0]), along))
        model.advance((along, -across), end, middle)
        errors.append(abs(model.stiffness - expected).max())
    yield _small("steered model on half an excision against PathModel, same mesh", max(errors), EXACT)
    model, before, errors, softer = SteeredModel((8, 15)), [], [], []
    for y, length in ((0.03, 0.08), (0.01, 0.08), (-0.01, 0.08), (-0.03, 0.08)):
        model.begin((0.0, y))
        model.cut_to((length, y))
        earlier = tuple((y - other, cut) for other, cut in before)
        found = 1.0 / model.compliance[0, 0]
        errors.append(abs(found / CutModel(offset=-y, earlier_cuts=earlier).stiffness(length) - 1.0))
        softer.append(found / CutModel(offset=-y).stiffness(length))
        before.append((y, length))
    yield _small("four parallel cuts of 8 cm, 2 cm apart, against CutModel, same mesh", max(errors), EXACT)
    shown = ", ".join(f"{each:.3f}" for each in softer)
    yield Row("stiffness of each of the four over that in a slab without the others", shown)
    plain = CutModel()
    for divisions in ((16, 30), (32, 60)):
        model, errors = SteeredModel(divisions), []
        model.begin()
        for a in plain.tips[1:13]:
            model.cut_to((a, 0.0))
            errors.append(abs(model.converted_stiffness(ELEMENT)[0, 0] / plain.stiffness(a) - 1.0))
        size = f"{150 / divisions[1]:g} mm"
        what = f"elements of {size} converted to 10 mm, on a straight cut of 20 to 130 mm, against CutModel"
        yield Row(what, f"{100 * max(errors):.3f} %", "0.1 %", bool(max(errors) <= 1e-3))
    lines = {
        "half an excision": line, "arc": arc(0.04), "S": s_shape(0.03, 0.08),
        "random": random_line(np.random.default_rng(2)),
    }  # fmt: skip
    worst = np.zeros((2, 2))
    for each in lines.values():
        known, (ways, found) = led_along(each, SteeredModel(line=each), 0.1), led_along(each, SteeredModel(), 0.1)
        within = (ways >= 0.02) & (ways <= known[0][-1])
        expected = at(*known, ways[within])
        worst = np.maximum(worst, (abs(found[within] - expected) / expected[:, :1, :1]).max(axis=0))
    yield Row(
        "a mesh that does not know the line against one that follows it, on four lines: along, coupled, across",
        ", ".join(f"{100 * worst[i, j]:.1f} %" for i, j in ((0, 0), (0, 1), (1, 1))), "3 %", bool(worst.max() <= 0.03),
    )  # fmt: skip
    refined = [at(*led_along(line, SteeredModel((8 * n, 15 * n)), 0.07), [0.05])[0] for n in (1, 2, 4)]
    last = abs(refined[2] - refined[1]).max() / refined[2][0, 0]
    for name, (i, j) in {"along": (0, 0), "coupled": (0, 1), "across": (1, 1)}.items():
        shown = ", ".join(f"{each[i, j]:.4f}" for each in refined)
        what = f"stiffness {name} at 50 mm of half an excision with 10, 5, 2.5 mm elements, converted; last change"
        yield Row(what, shown, "1 %", bool(last <= 0.01))


def beside(line: CutLine, distance: float) -> CutLine:
    """Return a line that leaves another one within 40 mm, to run so far beside it, to the left [m]."""
    s = np.arange(len(line.x)) * SPACING
    part = np.minimum(s / _BESIDE_FROM, 1.0)
    gap = distance * part**3 * (10.0 - 15.0 * part + 6.0 * part**2)
    x, y = line.x - gap * np.sin(line.angle), line.y + gap * np.cos(line.angle)
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    angle = np.unwrap(np.arctan2(np.gradient(y, s), np.gradient(x, s)))
    return CutLine(*(np.interp(s, way, values) for values in (x, y, angle)), np.zeros_like(s))


def check_table(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check the table of a line, which a batch of cuts looks up, for cracks that a mesh did not know beforehand."""
    lines = {"straight": straight(), "half an excision": half_ellipse(), "arc": arc(0.05), "S": s_shape(0.04, 0.08)}
    for distance in (0.0, 0.003):
        worst: dict[str, Any] = {}
        for name, line in lines.items():
            ways = [line] if distance == 0.0 else [beside(line, sign * distance) for sign in (-1.0, 1.0)]
            found = [_table_errors(line, way, *led_along(way, SteeredModel(), 0.08)) for way in ways]
            worst[name] = np.concatenate([errors[feet <= _NEAR_AXIS] for errors, feet in found]).max(axis=0)
        for k, part in enumerate(_PARTS):
            largest = max(each[k] for each in worst.values())
            shown = ", ".join(f"{100 * each[k]:.1f} %" for each in worst.values())
            what = f"table of a line for a crack {1e3 * distance:g} mm beside it, {part}: {', '.join(worst)}"
            yield Row(what, shown, "5 %", bool(largest <= OFF_LINE))


def lines_not_fitted() -> list[CutLine]:
    """Return lines from which the place model has learned nothing: of the kinds that are drawn, and others."""
    drawn = [first_of_pair(kind, number, _OTHER_SEED) for kind in range(1, len(KINDS)) for number in range(0, 8, 2)]
    fixed = [half_ellipse(), half_ellipse(0.06, 0.014), half_ellipse(0.11, 0.018), arc(0.05), s_shape(0.024, 0.07)]
    return [straight(), *drawn, *fixed, *(random_line(np.random.default_rng(seed)) for seed in (0, 3, 7))]


def check_beside(
    _: Sequence[Specimen],
    lines: Sequence[CutLine] | None = None,
    distances: Sequence[float] = (0.001, 0.002, 0.003, 0.004),
) -> Iterator[Row]:
    """Check the table of lines that the place model has not seen, for cracks beside them on finer meshes that know."""
    lines = lines_not_fitted() if lines is None else lines
    near, far = [], []
    for distance in distances:
        found, axis = [], []
        for line, sign in itertools.product(lines, (-1.0, 1.0)):
            model = PathModel(beside(line, sign * distance), (16, 30))
            errors, foot = _table_errors(line, model.line, model.tips, model.converted_stiffness(ELEMENT))
            found.append(errors)
            axis.append(foot)
        errors, within = np.concatenate(found), np.concatenate(axis) <= _NEAR_AXIS
        near.append(errors[within])
        far.append(errors[~within])
        yield _share_and_most(f"{1e3 * distance:g} mm beside {len(lines)} lines not fitted", near[-1])
    yield _share_and_most("of all these", np.concatenate(near))
    if sum(map(len, far)):
        row = _share_and_most("where the line is 20 to 30 mm from the axis of the slab", np.concatenate(far))
        yield Row(row.what, row.found)


def _share_and_most(where: str, errors: Any) -> Row:
    """Return the row of what 95 % of the errors keep within, and all; along, coupled over that along, across."""
    share, most = np.percentile(errors, 95.0, axis=0), errors.max(axis=0)
    shown = "; ".join(", ".join(f"{100 * each:.1f} %" for each in values) for values in (share, most))
    what = f"error of {len(errors)} tips {where}, along, coupled, across: 95 % of them; all"
    return Row(what, shown, "5 %; 7 %", bool(share.max() <= OFF_LINE and most.max() <= FARTHEST_OFF))


def _table_errors(line: CutLine, way: CutLine, tips: Any, stiffness: Any) -> tuple[Any, Any]:
    """Return the errors of a line's table for tips on ``way``, and how far their feet are from the slab's axis [m].

    The errors, shape (m, 3), are those of tips beside 40 to 130 mm of the line: along, coupled and across, in the frame
    of the crack. ``tips`` are lengths of ``way`` [m], ``stiffness``, shape (n, 2, 2), is along it and to its left [1].
    """
    grid = np.arange(N_POINTS) * SPACING
    table, base = given_line(line, **STORED).records[0], straight_stiffness(**STORED).along
    x, y, angle = (np.interp(tips, grid, values) for values in (way.x, way.y, way.angle))
    places, asides = along_line(line, x, y)
    errors, feet = [], []
    for place, aside, direction, true in zip(places, asides, angle, stiffness, strict=True):
        if _BESIDE_FROM <= place <= min(length_within(line), LEAST_LENGTH):
            own = [float(np.interp(place, grid, base * table[name])) for name in ("along", "coupled", "across")]
            rates = [float(np.interp(place, grid, table["off_line"][k::3])) for k in range(3)]
            along, coupled, across = stiffness_off_line((own[0], own[1], own[2]), (rates[0], rates[1], rates[2]), aside)
            turn = direction - float(np.interp(place, grid, line.angle))
            frame = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            gap = abs(frame.T @ np.array([[along, coupled], [coupled, across]]) @ frame - true)
            errors.append([gap[0, 0] / true[0, 0], gap[0, 1] / true[0, 0], gap[1, 1] / true[1, 1]])
            feet.append(abs(float(np.interp(place, grid, line.y))))
    return np.array(errors).reshape(-1, 3), np.array(feet)


def check_turned(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check that a square specimen turned in the plane has the same stiffness in its own frame."""
    lame, n, found = lame_parameters("plane_stress", 0.3), 8, []
    for angle in np.radians([0.0, 17.0, 90.0, 211.0]):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        square = np.stack(np.meshgrid(np.linspace(0, 0.08, n + 1), np.linspace(-0.04, 0.04, n + 1), indexing="ij"), -1)
        mesh = SplitMesh(square @ turn.T)
        body = SplitStiffness(mesh, np.ones((n, n)), lame, opens=False)
        places = [(k, n) for k in range(10)]
        for before, place, after in zip(places[:-2], places[1:-1], places[2:], strict=True):
            body.double(place, angle, (before[0] // 2 * 2, n), (-(-after[0] // 2) * 2, n))
        body.renew(sorted({cell for place in places for cell in mesh.cells_at(place)}))
        load = np.zeros((len(body.system), 2))
        tip = body.touched((10, n))
        load[tip] = turn
        found.append(turn.T @ body.system.solve(load)[tip])
    worst = max(abs(each - found[0]).max() for each in found)
    yield _small("compliance of a square specimen turned by 17, 90 and 211 degrees against that at rest", worst, EXACT)


def edge_crack(length: float) -> tuple[SteeredModel, Any]:
    """Return a slab of 8 x 24 cm with a crack from its right side in the middle, and forces of a unit tension."""
    model = SteeredModel((32, 96), length=0.24, faces="open")
    forces = np.zeros_like(model.mesh.positions)
    share = np.zeros(65)
    share[:-1:2] += 1.0 / 6.0
    share[2::2] += 1.0 / 6.0
    share[1::2] = 4.0 / 6.0
    forces[-1, :, 0] = share * (0.08 / 32)
    model.begin((0.12, -0.04), 0.5 * math.pi)
    if length:
        model.cut_to((0.12, length - 0.04))
    return model, forces


def released(model: SteeredModel, direction: float, element: float, energy: Callable[[SteeredModel], float]) -> float:
    """Return the energy that growth of the last node releases per length, over modulus, by the stiffness derivative."""
    ahead = []
    for sign in (1.0, -1.0):
        moved, way = model.copy(), element * (1.0 + sign * _STEP)
        moved.advance(model.tip + way * np.array([math.cos(direction), math.sin(direction)]))
        ahead.append(energy(moved))
    return 0.5 * (ahead[0] - ahead[1]) / (2.0 * _STEP * element)


def check_second_solver(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check the compliance of a bent cut against CalculiX, which has elements and constraints of its own."""
    program = shutil.which("ccx")
    what = "compliance at the tip of a bent cut in plane strain against CalculiX on the same mesh, relative"
    if program is None:
        yield Row(what, "CalculiX (ccx) is not installed")
        return
    model = SteeredModel(formulation="plane_strain")
    model.begin()
    for point in ((0.03, 0.004), (0.05, 0.015), (0.055, 0.025)):
        model.cut_to(point)
    other = compliance(model.doubled_mesh(), program)
    yield _small(what, float(abs(other / model.compliance - 1.0).max()), 1e-5)


def check_fracture(_: Sequence[Specimen]) -> Iterator[Row]:
    """Check energies that cracks release against closed forms, and two ways to find them against each other."""
    element, a = 0.0025, 0.02
    model, forces = edge_crack(a - element)

    def pulled(each: SteeredModel) -> float:
        return each.pushed(forces)

    by_derivative = released(model, 0.5 * math.pi, element, pulled)
    at_tip = model.copy()
    at_tip.cut_to((0.12, a - 0.04))
    longer = at_tip.copy()
    longer.cut_to((0.12, a + element - 0.04))
    by_force = 0.5 * (pulled(longer) - pulled(model)) / (2.0 * element)
    x = a / 0.08
    shape = 1.12 - 0.231 * x + 10.55 * x**2 - 21.72 * x**3 + 30.39 * x**4
    intensity = math.sqrt(by_force) / math.sqrt(math.pi * a)
    yield _close("edge crack in tension: stress intensity over tension and root of pi a", intensity, shape, 0.02)
    what = "energy release of that crack: compliance of two lengths over the stiffness derivative"
    yield _close(what, by_force / by_derivative, 1.0, 0.04)

    slid, faces = SteeredModel(), np.zeros((61, 33, 2))
    faces[-1, 0] = faces[-1, -1] = (0.0, 1.0)
    slid.begin()
    slid.cut_to((0.05, 0.012))

    def sheared(each: SteeredModel) -> float:
        return each.pushed(faces)

    direction = math.atan2(0.012, 0.05)
    step = 0.005 / math.cos(direction)
    by_derivative = released(slid, direction, step, sheared)
    far = slid.copy()
    way = np.array([math.cos(direction), math.sin(direction)])
    far.advance(slid.tip + step * way)
    far.advance(slid.tip + 2.0 * step * way)
    by_force = 0.5 * (sheared(far) - sheared(slid)) / (2.0 * step)
    what = "energy release of a slanted cut whose faces slide, pulled aside at the far end, over the derivative"
    yield _close(what, by_force / by_derivative, 1.0, 0.05)

    kinked = {}
    for kink in (0.0, *KINKS):
        turned = at_tip.copy()
        direction = math.radians(90.0 - kink)
        turned.advance(at_tip.tip + element * np.array([math.cos(direction), math.sin(direction)]))
        kinked[kink] = (pulled(turned) - pulled(at_tip)) / element
    for kink in KINKS:
        half = math.radians(kink) / 2.0
        first = 0.75 * math.cos(half) + 0.25 * math.cos(3.0 * half)
        second = 0.25 * (math.sin(half) + math.sin(3.0 * half))
        what = f"energy release of a kink of {kink:g} degrees over that straight on, against Cotterell and Rice"
        yield _close(what, kinked[kink] / kinked[0.0], first**2 + second**2, 0.05)


def check_arcs(_: Sequence[Specimen], half_angles: Sequence[float] = (20.0, 45.0)) -> Iterator[Row]:
    """Check the energy that arcs under pressure release against the closed form of a large plate."""
    radius, size, cells = 0.0225, 0.3, 120
    whole = SteeredModel((cells, cells), width=size, length=size, faces="open")
    for half_angle in half_angles:
        alpha = math.radians(half_angle)
        steps = round(2.0 * radius * alpha / (size / cells))
        angles = np.linspace(-alpha, alpha, steps + 1)
        angles = np.append(angles, 2.0 * angles[-1] - angles[-2])  # one node further, for the derivative
        place = np.array([0.5 * size, -radius]) + radius * np.column_stack((np.sin(angles), np.cos(angles)))
        plate, energies = whole.copy(), []
        plate.begin(place[0], float(-angles[0]))
        for point, angle in zip(place[1:], -angles[1:], strict=True):
            plate.advance(point, float(angle))
            energies.append(plate.pushed(pressure=1.0))
        found = 0.5 * (energies[-1] - energies[-3]) / (radius * float(angles[-1] - angles[-3]))
        exact = math.pi * radius * math.sin(alpha) / (1.0 + math.sin(0.5 * alpha) ** 2) ** 2
        what = f"energy release of an arc of {2 * half_angle:g} degrees under pressure over the closed form"
        yield _close(what, found / exact, 1.0, 0.05)


def _small(what: str, found: float, allowed: float) -> Row:
    return Row(what, f"{found:.1e}", f"{allowed:.0e}", bool(found <= allowed))


def _close(what: str, found: float, expected: float, within: float) -> Row:
    promised = f"{expected:.3f} within {100 * within:g} %"
    return Row(what, f"{found:.3f}", promised, bool(abs(found / expected - 1.0) <= within))
