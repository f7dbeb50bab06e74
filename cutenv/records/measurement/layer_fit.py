"""Fit of layers over depth: relative toughness and modulus.

Each section of a cut gives two numbers (:mod:`cutenv.records.measurement.depth_sections`): its fracture energy,

    E = G (A + (rho_c - 1) A_c + (rho_d - 1) A_d),

with the area opened in all, in the capsule and in the layer below; and the stiffness of unloading,

    K = M kappa(a) D_e(D; mu_c, mu_d),

with the effective depth of a slab in layers (:func:`cutenv.sim.tissue.layers.layered_depth`).  G and M of each cut are
free: livers differ, and the ratios are found within cuts.  Least squares of the logarithms; tissue that varies along a
cut is the error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.special import fdtrc, stdtrit

from cutenv._base.arrays import Array
from cutenv.records.measurement.depth_sections import DepthSection
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.description import Evidence
from cutenv.sim.tissue.layers import Layers, layered_depth
from cutenv.sim.tissue.slab import effective_depth

FEWEST_TOUCHED = 2  # smallest number of sections that open a layer, below which nothing is said of it
_TOUCHED = 0.03  # share of a section's area in a layer from which on it is opened
_MAX_INTERVAL_RATIO = 10.0  # ratio of an interval's ends from which on a number is not identified
_FEWEST_FREE = 3  # degrees of freedom
_STEP, _MARGIN = 0.25e-3, 0.5e-3  # [m] of the search for the boundary, and from the least and the greatest depth
_CHANCE = 1e-3  # probability of so good a fit by chance, below which a layer whose place is not known is believed
_ROUNDS = 3  # of weighing energies against stiffnesses by their own scatter
_LEAST_SCATTER = np.array([0.03, 0.04])
"""Error of a section's energy and stiffness in tissue that does not vary [1]: that of virtual cuts of one tissue, and
that of the effective depth in layers beside bricks (``scripts/derivations/layers.py``)."""
_RANGE = math.log(100.0)  # of a ratio, either way
_HOW = "least squares of the sections' {what} within cuts"
_OF = {"toughness": "fracture energies", "modulus": "stiffnesses of unloading"}


@dataclass(frozen=True, kw_only=True, eq=False)
class LayerFit:
    """Layers found in a set of cuts."""

    layers: Layers  # a number that is not identified is the assumed one
    # how each number was found, with its 95 % interval, or why it is assumed; names are ``layers.<field>``
    evidence: tuple[Evidence, ...]
    # relative standard error of each number that was found [1]; of the boundary the error itself [m]
    errors: dict[str, float]
    # of the tissue between the layers, cut by cut: fracture part of the resistance [J/m2], modulus of the material
    # [Pa], shape (n_cuts,)
    resistance: Array
    modulus: Array
    # standard deviation of the sections about the fit, of the logarithms of energies and stiffnesses [1]
    scatter: dict[str, float]

    @property
    def found(self) -> tuple[str, ...]:
        """Names of the layers' fields that were found."""
        return tuple(self.errors)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sections:
    """Sections of all cuts as arrays, shape (n,)."""

    sections: list[DepthSection]
    cut: Array
    kappa: Array
    effective: Array
    depth: Array
    deepest: Array
    before: Array
    after: Array
    width: Array

    @classmethod
    def of(cls, cuts: Sequence[Sequence[DepthSection]], model: CutModel) -> _Sections:
        pairs = [(n, each) for n, sections in enumerate(cuts) for each in sections]
        tips = np.array([each.back.tip for _, each in pairs])
        depth = np.array([each.depth for _, each in pairs])
        return cls(
            sections=[each for _, each in pairs],
            cut=np.array([n for n, _ in pairs]),
            kappa=np.asarray(model.stiffness(np.clip(tips, 0.0, model.length))),
            effective=effective_depth(tips, depth),
            depth=depth,
            deepest=np.array([float(each.floor_after.max()) for _, each in pairs]),
            before=np.array([each.floor_before for _, each in pairs]),
            after=np.array([each.floor_after for _, each in pairs]),
            width=np.array([each.width for _, each in pairs]),
        )

    def areas(self, top: float, bottom: float) -> Array:
        deeper = np.clip(self.after, top, bottom) - np.clip(self.before, top, bottom)
        return np.asarray((self.width * deeper).sum(axis=1))

    def log_energy(self) -> Array:
        return np.log([max(each.fracture_energy, 1e-9) for each in self.sections])

    def log_stiffness(self) -> Array:
        return np.log([each.back.stiffness for each in self.sections]) - np.log(self.kappa)

    def within(self, values: Array) -> Array:
        """Return values less the mean of their cut."""
        count = np.bincount(self.cut)
        return np.asarray(values - (np.bincount(self.cut, values) / np.maximum(count, 1))[self.cut])


def fit_layers(
    cuts: Sequence[Sequence[DepthSection]],
    model: CutModel,
    *,
    boundary: float | None = None,
    capsule_thickness: float | None = None,
) -> LayerFit:
    """Find layers from sections of cuts in depth steps.

    The depth at which the layer below begins, `boundary` [m], is searched by default. Without `capsule_thickness` [m]
    nothing is said of a capsule, whose thickness and toughness no cut tells apart. Numbers that the records do not tell
    are those of :class:`~cutenv.sim.tissue.Layers`, one tissue throughout, and marked as assumed with the reason.
    """
    known = _Sections.of([each for each in cuts if each], model)
    if not known.sections:
        raise ValueError("no record has a way back past the tip at one height: there is no section to find layers by.")
    fixed = {"capsule_thickness": capsule_thickness or 0.0, "boundary": 0.1 if boundary is None else boundary}
    why: dict[str, str] = {}
    free = _identifiable(known, boundary, capsule_thickness, why)
    if "boundary" in free:
        free, fixed["boundary"] = _searched(known, free, fixed, why)
    solved = _solved(known, free, fixed)
    for name in [each for each in free if each != "boundary" and solved.width(each) > _MAX_INTERVAL_RATIO]:
        why[name] = f"its interval spans a factor of {solved.width(name):.0f}: the records do not tell it"
    kept = [name for name in free if name not in why]
    if not [name for name in kept if name.startswith("deep")]:
        kept = [name for name in kept if name != "boundary"]
        if boundary is None:
            fixed["boundary"] = 0.1
            why.setdefault("boundary", "neither toughness nor modulus of a layer below is identified")
    if kept != free:
        solved = _solved(known, kept, fixed)
    given = {"boundary": boundary, "capsule_thickness": capsule_thickness}
    return _fit_of(known, solved, {name for name, value in given.items() if value is not None}, why)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Solved:
    """Least-squares solution with covariance, in logarithms but for the boundary."""

    names: list[str]
    values: Array
    covariance: Array
    dof: int
    weights: Array
    layers: Any
    scatter: tuple[float, float]

    def error(self, name: str) -> float:
        i = self.names.index(name)
        return math.sqrt(float(self.covariance[i, i]))

    def interval(self, name: str) -> tuple[float, float, float]:
        """Return a number's value and 95 % interval ends."""
        value, half = float(self.values[self.names.index(name)]), self.error(name)
        half *= float(stdtrit(max(self.dof, 1), 0.975))
        if name == "boundary":
            return value, value - half, value + half
        return math.exp(value), math.exp(value - min(half, _RANGE)), math.exp(value + min(half, _RANGE))

    def width(self, name: str) -> float:
        _, low, high = self.interval(name)
        return high / low


def _identifiable(
    known: _Sections, boundary: float | None, capsule_thickness: float | None, why: dict[str, str]
) -> list[str]:
    """Return names of numbers to find; ``why`` explains the others."""
    free: list[str] = []
    deepest = 1e3 * float(known.deepest.max())
    if capsule_thickness is None:
        for name in ("capsule_thickness", "capsule_toughness", "capsule_modulus"):
            why[name] = "its thickness was not given, and no cut tells thickness and toughness apart"
    else:
        free += ["capsule_toughness", "capsule_modulus"]
        if np.ptp(np.log(known.depth)) < math.log(1.3):
            for name in free:
                why[name] = "the sections do not differ in depth by a factor of 1.3"
            free = []
    spare = 2 * (len(known.sections) - len(set(known.cut.tolist()))) - len(free) - 3
    if spare < _FEWEST_FREE:
        reason = (
            f"{len(known.sections)} sections in {len(set(known.cut.tolist()))} cuts are too few; cut in more steps of "
            "depth, or more cuts"
        )
        why |= dict.fromkeys(("boundary", "deep_toughness", "deep_modulus", *free), reason)
        return []
    if boundary is None:
        return [*free, "boundary", "deep_toughness", "deep_modulus"]
    touched = known.areas(boundary, 1.0) > _TOUCHED * known.areas(0.0, 1.0)
    if touched.sum() < FEWEST_TOUCHED or touched.all():
        reason = (
            f"{touched.sum()} of {len(touched)} sections open the layer at {1e3 * boundary:g} mm; the deepest goes "
            f"down to {deepest:.1f} mm. Some must open it, and some must not"
        )
        why |= dict.fromkeys(("deep_toughness", "deep_modulus"), reason)
        return free
    return [*free, "deep_toughness", "deep_modulus"]


def _searched(
    known: _Sections, free: list[str], fixed: dict[str, float], why: dict[str, str]
) -> tuple[list[str], float]:
    """Search the layer's depth; return free numbers and depth [m]."""
    others = [name for name in free if name != "boundary"]
    depths = np.concatenate([[each.depth for each in known.sections], known.deepest])
    places = np.arange(float(depths.min()) + _MARGIN, float(depths.max()) - _MARGIN, _STEP)
    without = [name for name in others if not name.startswith("deep")]
    alone = _solved(known, without, fixed)
    if len(places):
        tries = [_solved(known, others, fixed | {"boundary": float(b)}) for b in places]
        weights = min(tries, key=lambda each: _squares(known, each, each.weights) / each.dof).weights
        squares = [_squares(known, each, weights) for each in tries]
        best = int(np.argmin(squares))
        dof = max(tries[best].dof - 1, 1)
        ratio = (_squares(known, alone, weights) - squares[best]) / 3.0 / max(squares[best] / dof, 1.0)
        chance = float(fdtrc(3, dof, ratio)) * len(places) ** 0.5  # one place among neighbours that resemble it
        if chance < _CHANCE:
            return free, float(places[best])
        reason = f"one tissue throughout fits as well (chance of a better fit by a layer somewhere: {chance:.2g})"
    else:
        reason = f"all sections are {1e3 * float(depths.min()):.1f} to {1e3 * float(depths.max()):.1f} mm deep"
    why |= dict.fromkeys(("boundary", "deep_toughness", "deep_modulus"), reason)
    return without, 0.1


def _solved(known: _Sections, names: list[str], fixed: dict[str, float]) -> _Solved:
    """Fit the named numbers, weighting energies and stiffnesses by scatter."""
    start = [fixed["boundary"] if name == "boundary" else 0.0 for name in names]
    reach = (float(known.depth.min()), float(known.deepest.max()))
    low = [reach[0] if name == "boundary" else -_RANGE for name in names]
    high = [max(reach[1], reach[0] + 1e-4) if name == "boundary" else _RANGE for name in names]
    scale = [1e-3 if name == "boundary" else 1.0 for name in names]
    energy, stiffness, cuts = known.log_energy(), known.log_stiffness(), len(set(known.cut.tolist()))
    n = len(energy)
    weights = np.ones(2)

    def apart(values: Array) -> tuple[Array, Array]:
        layers = _layers_of(names, values, fixed)
        return (
            known.within(energy - np.log(_tough_area(known, layers))),
            known.within(stiffness - np.log(_layered(known, layers))),
        )

    def weighed(values: Array, weights: Array) -> Array:
        return np.concatenate([w * each for w, each in zip(weights, apart(values), strict=True)])

    values, squares = np.array(start), 0.0
    jacobian: Any = np.zeros((2 * n, len(names)))
    kinds = [sum(name.endswith(kind) for name in names) + 0.5 * ("boundary" in names) for kind in _OF]
    free = [max(n - cuts - count, 1.0) for count in kinds]
    for _ in range(_ROUNDS):
        if names:
            found = least_squares(
                weighed,
                np.clip(values, np.add(low, 1e-9), np.subtract(high, 1e-9)), bounds=(low, high), x_scale=scale,
                args=(weights,),
            )  # fmt: skip
            values, jacobian = found.x, found.jac
        used, left = weights, apart(values)
        squares = float(sum(w**2 * each @ each for w, each in zip(weights, left, strict=True)))
        scatter = [math.sqrt(float(each @ each) / count) for each, count in zip(left, free, strict=True)]
        weights = np.asarray(1.0 / np.maximum(scatter, _LEAST_SCATTER))
    dof = 2 * (n - cuts) - len(names)
    covariance = np.zeros((0, 0))
    if names:
        normal = jacobian.T @ jacobian
        covariance = np.linalg.pinv(normal) * max(squares / max(dof, 1), 1.0)
    return _Solved(
        names=names, values=values, covariance=covariance, dof=dof, weights=used,
        layers=_layers_of(names, values, fixed), scatter=(scatter[0], scatter[1]),
    )  # fmt: skip


def _squares(known: _Sections, solved: _Solved, weights: Array) -> float:
    """Return a solution's weighted sum of squares."""
    energy = known.within(known.log_energy() - np.log(_tough_area(known, solved.layers)))
    stiffness = known.within(known.log_stiffness() - np.log(_layered(known, solved.layers)))
    return float(weights[0] ** 2 * energy @ energy + weights[1] ** 2 * stiffness @ stiffness)


def _layers_of(names: list[str], values: Array, fixed: dict[str, float]) -> Any:
    """Return layers with the given numbers, not checked."""
    numbers = {name: 1.0 for name in ("capsule_toughness", "capsule_modulus", "deep_toughness", "deep_modulus")} | fixed
    for name, value in zip(names, values.tolist(), strict=True):
        numbers[name] = value if name == "boundary" else math.exp(value)
    return SimpleNamespace(**numbers)


def _tough_area(known: _Sections, layers: Any) -> Array:
    """Return each section's area weighted by layer toughness [m2]."""
    area = known.areas(0.0, 1.0)
    area = area + (layers.capsule_toughness - 1.0) * known.areas(0.0, layers.capsule_thickness)
    return np.asarray(area + (layers.deep_toughness - 1.0) * known.areas(layers.boundary, 1.0))


def _layered(known: _Sections, layers: Any) -> Array:
    """Return each section's effective depth at its end [m]."""
    pairs = zip(known.depth.tolist(), known.effective.tolist(), strict=True)
    return np.array([layered_depth(layers, depth, effective) for depth, effective in pairs])


def _fit_of(known: _Sections, solved: _Solved, given: set[str], why: dict[str, str]) -> LayerFit:
    """Return the fit with its evidence."""
    numbers, evidence, errors = dict(vars(solved.layers)), [], {}
    for name in Layers.__dataclass_fields__:
        field_name = f"layers.{name}"
        if name in solved.names:
            value, low, high = solved.interval(name)
            numbers[name] = float(f"{value:.4g}")
            kind = "fracture energies and stiffnesses" if name == "boundary" else _OF[name.rpartition("_")[2]]
            errors[name] = solved.error(name)
            how = _HOW.format(what=kind)
            evidence.append(Evidence(name=field_name, provenance="measured", how=how, low=low, high=high))
        elif name in given and name not in why:
            evidence.append(Evidence(name=field_name, provenance="choice", how="as it was given"))
        else:
            evidence.append(Evidence(name=field_name, provenance="assumed", how=why.get(name, "not asked for")))
    areas, energy = _tough_area(known, solved.layers), np.exp(known.log_energy())
    moduli = np.exp(known.log_stiffness()) / _layered(known, solved.layers)
    count = np.bincount(known.cut)
    return LayerFit(
        layers=Layers(**{name: float(numbers[name]) for name in Layers.__dataclass_fields__}),
        evidence=tuple(evidence),
        errors=errors,
        resistance=np.bincount(known.cut, energy) / np.bincount(known.cut, areas),
        modulus=np.bincount(known.cut, moduli) / count,
        scatter={"energies": solved.scatter[0], "stiffnesses": solved.scatter[1]},
    )
