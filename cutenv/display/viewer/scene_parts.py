"""The scene of a cut, described once.

Parts, places, colours and labels.

The window and the view in 3-D draw from this description, and so does the page, which receives it as data. A place is
given by two formulas of named quantities, from above (across, along), from the side (along, height above the specimen's
lower face) [m], in the chart (along [m], force [N]). The scalpel's own frame has z up along the straight part of the
edge from the blade's point, and y toward the edge, 0 at that straight part. Its measures are common ones, rounded: they
serve the picture, and nothing is computed from them.

Formulas are written once as text, evaluated here with NumPy, and handed as trees to the page's script.
"""

from __future__ import annotations

import ast
import dataclasses
import itertools
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.language_files import ENGLISH, texts_by_key
from cutenv.display.viewer import palette
from cutenv.sim.quantities import TIP_TOLERANCE
from cutenv.sim.tissue.grid import LENGTH, SPACING

Tree = float | str | list[Any]
"""A number, a name, or a list of a function's name and its arguments."""

_SIGNS: dict[type[ast.operator], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}
_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "abs": np.abs,
    "acos": np.arccos,
    "atan2": np.arctan2,
    "clip": np.clip,
    "cos": np.cos,
    "max": np.maximum,
    "min": np.minimum,
    "sin": np.sin,
    "sqrt": np.sqrt,
    "tan": np.tan,
}


class SceneFormula:
    """Formula of numbers, names, the four operations, and some functions.

    The text is as in Python, ``"blade - depth / tan(angle)"``; ``tree`` is the formula as JSON can hold it. Raises
    ValueError if the text holds anything else.
    """

    def __init__(self, text: str) -> None:
        self.tree = _tree(ast.parse(text, mode="eval").body, text)

    def __call__(self, values: Mapping[str, Any]) -> Any:
        """Return the value, with names and further functions from ``values``."""
        return _value(self.tree, values)


def _tree(node: ast.expr, text: str) -> Tree:
    match node:
        case ast.Constant(value=int() | float() as number):
            return float(number)
        case ast.Name(id=name):
            return name
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            return ["-", 0.0, _tree(operand, text)]
        case ast.BinOp(left=left, op=sign, right=right) if type(sign) in _SIGNS:
            return [_SIGNS[type(sign)], _tree(left, text), _tree(right, text)]
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            return [name, *(_tree(each, text) for each in arguments)]
    raise ValueError(f"formula = {text!r} holds {ast.unparse(node)!r}; use numbers, names, + - * / and functions.")


def _value(tree: Tree, values: Mapping[str, Any]) -> Any:
    if isinstance(tree, float):
        return tree
    if isinstance(tree, str):
        return values[tree]
    name, *arguments = tree
    function = _FUNCTIONS.get(name) or values[name]
    return function(*(_value(each, values) for each in arguments))


PointRows = tuple[tuple[float, ...], ...]

BLADE_LENGTH = 0.0425
"""Length of a No. 10 blade, from its point to the end in the handle [m]: thesis, section 3.4.1."""
CHORD = 0.007
"""Distance from the edge to the back [m]."""
BELLY = 0.013
"""Length over which the edge curves from the point, which is at the back [m]."""
EDGE_END = 0.031
"""Distance from the point to where the blade narrows [m]."""
HANDLE_START, HANDLE_LENGTH = 0.034, 0.05
"""Distance from the blade's point to the handle, and length of the part of it that is drawn [m]."""
HANDLE_WIDTHS: PointRows = ((0.0, 0.00308), (0.004, 0.0056), (0.013, 0.0056), (0.022, 0.009), (HANDLE_LENGTH, 0.009))
"""Distance from the handle's start, and its width there [m]."""
NARROWED = 0.0012
"""By which the tang is narrower than the blade, on both sides [m]."""
BELOW = 0.0085
"""Depth below level 0 that is drawn where blades descend [m]."""
LARGEST_DISPLACEMENT = 0.012
"""Displacement at the dark end of the tissue's colours [m]."""
RULER_STEP, RULER_LABELLED = 0.01, 5
"""Distance between the ruler's lines [m], and how many there are from one number to the next."""
CHART_FLOOR, CHART_CEILING, CHART_STEP, CHART_FILLED = -1.0, 6.0, 2.0, 0.95
"""Least range of the force chart, the step by which it grows [N], and the share of it that a force fills at most."""
CHART_SAMPLES = 20
"""Samples of which the chart draws the least and the greatest force: 20 ms, in which a blade moves 2 px at most."""

TINT = (
    ("steel", "0"),
    ("costs", "force_allowed_per_depth * limited_at(blade)"),
    ("limit", "force_limit_per_depth * limited_at(blade)"),
)
"""Roles of the blade's colour, and the size of the force [N] from which it is that; between them it is mixed."""

WORDS = {
    key: texts_by_key(ENGLISH)[key] for key in ("above", "side", "chart", "target", "tip", "lag", "wanted", "layer")
}
"""Titles of the views and labels of the parts, in English."""
NUMBERS = {
    "degrees": ("angle * 180 / pi", 0),
    "target_mm": ("1000 * target", 1),
    "tolerance_mm": ("1000 * tolerance", 0),
    "lag_mm": ("1000 * lag", 1),
}
"""Numbers in the words: formula and digits."""

DERIVED = {
    "pi": repr(math.pi),
    "tolerance": repr(TIP_TOLERANCE),
    "depth": "depth_at(blade)",
    "lag": "max(blade - tip, 0)",
    "engaged": "max(depth - level, 0)",
    # The height of the belly above the scalpel's origin is p + q - r cos(t - turn), with t from 0 at the point to pi/2.
    "p": f"{CHORD} * cos(angle)",
    "q": f"{BELLY} * sin(angle)",
    "r": "sqrt(p * p + q * q)",
    "turn": "atan2(p, q)",
    "lowest_at": "max(turn, 0)",
    "lowest": "p + q - r * cos(lowest_at - turn)",
    "meets_at": "min(turn + acos(clip(cos(lowest_at - turn) - engaged / r, -1, 1)), 0.5 * pi)",
    "straight": "max(engaged + lowest - q, 0) / sin(angle)",
    "meets_y": f"{CHORD} * (sin(meets_at) - 1)",
    "meets_z": f"{BELLY} * (1 - cos(meets_at)) + straight",
    # The scalpel's origin, so that the edge meets the surface where the blade is and the lowest point is at its level.
    "scalpel_along": "blade - meets_y * sin(angle) - meets_z * cos(angle)",
    "scalpel_height": "level - lowest",
    "overhang": f"max(scalpel_height + {BLADE_LENGTH} * sin(angle) - depth, 0) / tan(angle)",
    "front_below": "max(tip - (depth_at(tip) - floor_at(tip)) / tan(angle), 0)",
    "grip": "0.058",  # [m] height of the fingers
    "held_at": "blade + (grip - depth) / tan(angle) - 0.0035",
}
"""Quantities in order, from those of the moment: blade, tip, angle, hand, force and so on, ``depth_at`` of the tissue,
and ``limited_at``, the depth of cut to which limits of force belong.

Heights are above the plane to which a blade at level 0 cuts: ``level`` of the blade's lower end, ``floor_at`` of the
floor of the cut, ``wanted_at`` of the wanted floor, ``layer_at`` of the layer below, ``bottom`` of what is drawn.
"""

# Half the gap of a cut drawn open, an ellipse of 2.5 mm at most, and how far it moves the tissue at its side.
_ALONG_CUT = "clip(along / max(tip, 1e-9), 0, 1)"
HALF_GAP = SceneFormula(f"min(0.0025, 0.05 * tip) * 2 * sqrt({_ALONG_CUT} * (1 - {_ALONG_CUT}))")
"""Half the gap [m] of the cut drawn open, at ``along`` [m]; zero ahead of the tip. An illustration, not the model."""
_AWAY = "(1 - abs(across) / half_width)"
OPENED_ASIDE = SceneFormula(f"{_AWAY} * {_AWAY}")
"""Share of half the gap by which tissue at ``across`` [m] gives way."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScenePart:
    """Area, line, mark or label of the scene."""

    name: str
    view: str  # "above", "side" or "chart"
    own: tuple[str, ...] = ()  # names of a point's own numbers
    rows: PointRows = ((),)  # those numbers, point by point
    place: tuple[str, str]  # formulas of quantities and own numbers
    carried: bool = False  # from tissue at rest, of a point's own side (-1, 1), to where the tissue is
    fill: str = ""  # role of an area's colour, "" for none; "tint" is the blade's
    line: str = ""  # role of the colour of a line, or of an area's edge
    width: float = 1.0  # [px]
    dash: float = 0.0  # [px]
    opacity: float = 1.0
    mark: PointRows = ()  # outline around each place [px], of constant size
    words: str = ""  # key of the label at the place
    align: str = "center"  # of the label, at the place: its foot, or "left", its middle
    shown: str = ""  # condition: "truth", "hand", "force", "depth" (is wanted) or "layer" (below)
    standing: bool = False  # stays during a cut

    @property
    def formulas(self) -> tuple[SceneFormula, SceneFormula]:
        """Return the two formulas of the place."""
        return _formula(self.place[0]), _formula(self.place[1])


CLAMP = {"length": 0.0054, "height": 0.012}
"""Length of the clamp's edge and height of its lower jaw, as drawn [m]."""


def blade_edge(count: int = 24) -> Array:
    """Return the elliptic edge, (y, z) [m], shape (count, 2), from the point."""
    t = np.linspace(0.0, 0.5 * math.pi, count - 1)
    belly = np.stack([-CHORD * (1.0 - np.sin(t)), BELLY * (1.0 - np.cos(t))], axis=-1)
    return np.concatenate([belly, [[0.0, EDGE_END]]])


def _blade_outline() -> PointRows:
    shoulder, back = EDGE_END + 0.0022, NARROWED - CHORD
    tang = [(-NARROWED, shoulder), (-NARROWED, BLADE_LENGTH), (back, BLADE_LENGTH), (-CHORD, shoulder)]
    return (*_rows(blade_edge()), *tang)


def _handle_outline() -> PointRows:
    front = [(0.5 * (width - CHORD), HANDLE_START + z) for z, width in HANDLE_WIDTHS]
    back = [(0.5 * (-width - CHORD), HANDLE_START + z) for z, width in reversed(HANDLE_WIDTHS)]
    return (*front, *back)


def _rows(points: Any) -> PointRows:
    return tuple(tuple(float(value) for value in row) for row in points)


def _round_mark(radius: float) -> PointRows:
    t = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    return _rows(radius * np.stack([np.cos(t), np.sin(t)], axis=-1))


_DIAMOND: PointRows = ((0, -6), (6, 0), (0, 6), (-6, 0))
_ALONG = _rows((along,) for along in np.arange(round(LENGTH / SPACING) + 1) * SPACING)
_SHARES = np.linspace(0.0, 1.0, 25).tolist()
_ACROSS = [*((-1.0, share) for share in reversed(_SHARES)), *((1.0, share) for share in _SHARES)]
_FACES = [*((-1.0, 1.0 - math.cos(t)) for t in np.linspace(0, math.pi, 61).tolist())]
_FACES += [(1.0, share) for _, share in reversed(_FACES)]
_SCALPEL = ("scalpel_along + y * sin(angle) + z * cos(angle)", "scalpel_height - y * cos(angle) + z * sin(angle)")
_SPRING = _rows((s, 0.0 if k in (0, 11) else (-1.0) ** k) for k, s in enumerate(np.linspace(0.0, 1.0, 12)))
_BAND: PointRows = ((-1, 0), (1, 0), (1, 1), (-1, 1))
_UPRIGHT: PointRows = ((0,), (1,))

PARTS = (
    # From above, upon the tissue.
    ScenePart(
        name="target band", view="above", own=("side", "share", "off"), carried=True, fill="target", opacity=0.3,
        rows=tuple((*row, off) for off, rows in ((-1.0, _ACROSS), (1.0, _ACROSS[::-1])) for row in rows),
        place=("side * share * half_width", "target + off * tolerance"),
    ),
    ScenePart(
        name="target line", view="above", own=("side", "share"), carried=True, line="target", width=2.0,
        rows=tuple(_ACROSS), place=("side * share * half_width", "target"),
    ),
    ScenePart(
        name="target label", view="above", own=("side",), carried=True, rows=((-1,),), words="target", line="target",
        place=("0 - half_width", "target"),
    ),
    ScenePart(
        name="open cut", view="above", own=("side", "share"), carried=True, fill="gap", rows=tuple(_FACES),
        place=("0", "0.5 * share * tip"),
    ),
    *(
        ScenePart(
            name=f"hand, {name}", view="above", place=("0", "hand"), mark=((0, 9 * y), (-6, 20 * y), (6, 20 * y)),
            fill="hand", line="edge", shown="hand",
        )
        for name, y in (("left", -1), ("right", 1))
    ),
    ScenePart(
        name="blade from above", view="above", own=("x", "back"), fill="tint", line="edge",
        rows=((0, 0), (-1, 0.4), (-1, 1), (1, 1), (1, 0.4)),
        place=("x * 0.001", f"blade - back * {CHORD} / sin(angle)"),
    ),
    ScenePart(
        name="blade above the tissue", view="above", own=("x", "back", "up"), fill="light steel", line="edge",
        rows=((-1, 1, 0), (-1, 1, 1), (0, 0, 1), (1, 1, 1), (1, 1, 0)), opacity=0.5,
        place=("x * 0.001", f"blade - back * {CHORD} / sin(angle) + up * overhang"),
    ),
    ScenePart(
        name="tip from above", view="above", place=("0", "tip + lag"), mark=_DIAMOND, fill="tip", line="edge",
        shown="truth",
    ),
    ScenePart(
        name="tip label", view="above", place=("0 - 0.01", "tip + lag + 0.005"), words="tip", line="ink", shown="truth",
    ),
    # From the side.
    ScenePart(
        name="tissue at rest", view="side", own=("along", "up"), fill="tissue", line="tissue edge", standing=True,
        rows=(*((*row, 1.0) for row in _ALONG), (LENGTH, 0.0), (0.0, 0.0)),
        place=("along", "up * depth_at(along) + (1 - up) * bottom"),
    ),
    ScenePart(
        name="layer below", view="side", own=("along", "up"), fill="layer", standing=True, shown="layer",
        rows=(*((*row, 1.0) for row in _ALONG), (LENGTH, 0.0), (0.0, 0.0)),
        place=("along", "max(up * layer_at(along) + (1 - up) * bottom, bottom)"),
    ),
    ScenePart(
        name="target band at the side", view="side", own=("off", "up"), rows=_BAND, fill="target", opacity=0.3,
        place=("target + off * tolerance", "0.0227 * up"),
    ),
    ScenePart(
        name="target line at the side", view="side", own=("up",), rows=_UPRIGHT, line="target", width=2.0,
        place=("target", "0.0227 * up"),
    ),
    ScenePart(
        name="cut part", view="side", own=("share", "up"), fill="cut face", shown="truth",
        rows=(
            *((share, 1.0) for share in np.linspace(0.0, 1.0, 151).tolist()),
            *((share, 0.0) for share in np.linspace(1.0, 0.0, 151).tolist()),
        ),
        place=(
            "share * (up * tip + (1 - up) * front_below)",
            "up * depth_at(share * tip) + (1 - up) * floor_at(share * front_below)",
        ),
    ),
    ScenePart(
        name="wanted floor", view="side", own=("along",), rows=_ALONG, line="target", width=2.0, dash=6.0,
        shown="depth", place=("along", "max(wanted_at(along), bottom)"),
    ),
    ScenePart(
        name="wanted label", view="side", place=("0.1", "max(wanted_at(0.1), bottom) + 0.0015"), words="wanted",
        line="ink", shown="depth",
    ),
    ScenePart(
        name="layer label", view="side", place=("0.1", "bottom + 0.001"), words="layer", line="paper", standing=True,
        shown="layer",
    ),
    ScenePart(
        name="blade", view="side", own=("y", "z"), rows=_blade_outline(), place=_SCALPEL, fill="tint", line="edge",
    ),
    ScenePart(
        name="handle", view="side", own=("y", "z"), rows=_handle_outline(), place=_SCALPEL, fill="handle", line="edge",
        shown="hand",
    ),
    ScenePart(
        name="spring", view="side", own=("share", "aside"), rows=_SPRING, line="hand", width=2.0, shown="hand",
        place=("held_at + share * (hand - blade)", "grip + 0.00125 * aside"),
    ),
    ScenePart(
        name="hand", view="side", place=("held_at + hand - blade", "grip"), mark=_round_mark(8.0), fill="hand",
        shown="hand",
    ),
    ScenePart(
        name="lag", view="side", own=("share",), rows=_UPRIGHT, line="ink", width=3.0, shown="truth",
        place=("tip + share * lag", "depth_at(tip + share * lag)"),
    ),
    ScenePart(
        name="lag label", view="side", place=("blade + 0.0022", "max(depth - 0.004, 0.0025)"),
        words="lag", align="left", line="ink", shown="truth",
    ),
    ScenePart(
        name="tip", view="side", place=("tip", "depth_at(tip)"), mark=_DIAMOND, fill="tip", line="edge", shown="truth",
    ),
    # The chart of the force.
    ScenePart(
        name="force limit", view="chart", own=("along",), rows=_ALONG, line="limit", width=2.0, standing=True,
        place=("along", "force_limit_per_depth * limited_at(along)"),
    ),
    ScenePart(
        name="force that costs", view="chart", own=("along",), rows=_ALONG, line="costs", width=2.0, dash=6.0,
        standing=True, place=("along", "force_allowed_per_depth * limited_at(along)"),
    ),
    ScenePart(
        name="target band in the chart", view="chart", own=("off", "up"), rows=_BAND, fill="target", opacity=0.3,
        place=("target + off * tolerance", "chart_low + up * (chart_high - chart_low)"),
    ),
    ScenePart(
        name="target line in the chart", view="chart", own=("up",), rows=_UPRIGHT, line="target", width=2.0,
        place=("target", "chart_low + up * (chart_high - chart_low)"),
    ),
    ScenePart(
        name="present force", view="chart", place=("blade", "force"), mark=_round_mark(5.0), fill="ink", shown="force",
    ),
)  # fmt: skip
"""Parts in the order in which they are drawn, after the tissue from above."""

_FORMULAS: dict[str, SceneFormula] = {
    text: SceneFormula(text)
    for text in itertools.chain(
        DERIVED.values(),
        *(part.place for part in PARTS),
        (text for text, _ in NUMBERS.values()),
        (text for _, text in TINT),
    )
}


def _formula(text: str) -> SceneFormula:
    return _FORMULAS[text]


def scene_data() -> dict[str, Any]:
    """Return the scene for a page: formulas as trees, colours by role."""
    parts = []
    for part in PARTS:
        told = dataclasses.asdict(part)
        parts.append(told | {"place": [each.tree for each in part.formulas]})
    return {
        "quantities": [(name, _formula(text).tree) for name, text in DERIVED.items()],
        "numbers": {name: (_formula(text).tree, digits) for name, (text, digits) in NUMBERS.items()},
        "parts": parts,
        "half_gap": HALF_GAP.tree,
        "opened_aside": OPENED_ASIDE.tree,
        "tint": [(role, _formula(text).tree) for role, text in TINT],
        "below": BELOW,
        "chord": CHORD,
        "largest_displacement": LARGEST_DISPLACEMENT,
        "ruler": {"step": RULER_STEP, "labelled": RULER_LABELLED},
        "clamp": CLAMP,
        "chart": {
            "low": CHART_FLOOR, "high": CHART_CEILING, "step": CHART_STEP, "filled": CHART_FILLED,
            "samples": CHART_SAMPLES,
        },
        "colours": {"light": palette.LIGHT, "dark": palette.DARK},
        "shades": {"light": palette.TISSUE, "dark": palette.DARK_TISSUE},
    }  # fmt: skip
