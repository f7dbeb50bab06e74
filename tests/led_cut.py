"""Cuts whose every instant is kept: by the compiled law, or by a law that was changed on purpose."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numba
import numpy as np
from hypothesis import strategies as st

from cutenv._engine.randomness import generator
from cutenv.cutting import blade as cutting_blade
from cutenv.cutting import friction as cutting_friction
from cutenv.cutting import law as cutting_law
from cutenv.cutting import relaxation as cutting_relaxation
from cutenv.cutting.dtypes import LAW, READING, STATE, new_state
from cutenv.cutting.law import cut
from cutenv.cutting.parameters import LawParameters, law_records, profile_records
from cutenv.tissue.description import TissueDescription, tables_only
from cutenv.tissue.specimen import N_POINTS, SPACING, Specimen

UPRIGHT, INCLINED = math.radians(90.0), math.radians(45.0)


class LedCut(NamedTuple):
    """A cut along a given path: row 0 of ``states`` is the start, reading i was taken in row i + 1."""

    profile: Any
    law: Any
    states: Any
    readings: Any

    @property
    def end(self) -> Any:
        return self.states[-1]

    @property
    def stored(self) -> Any:
        """Stored energy in every state [J]: K (x - a - g)^2 / 2 from the profile, and that of what has crept, g."""
        held = np.maximum(self.states["blade"] - self.states["creep"] - self.states["tip"], 0.0)
        return 0.5 * self.along("stiffness", self.states["tip"]) * held**2 + self.states["locked"]

    @property
    def lag(self) -> Any:
        """How far the blade stands ahead of the tip in every state [m]; 0 in the open crack."""
        return np.maximum(self.states["blade"] - self.states["tip"], 0.0)

    def along(self, name: str, position: Any) -> Any:
        """A quantity of the profile at ``position`` [m]."""
        return np.interp(position, np.arange(N_POINTS) * SPACING, self.profile[name])


def liver(**changes: Any) -> TissueDescription:
    """The tissue that the tables give, with the eta90 of the law's worked-out check."""
    return tables_only(**({"eta90": 0.28} | changes))


def homogeneous(*, tissue: TissueDescription | None = None, **changes: float) -> Specimen:
    """The specimen of the worked-out check: 48.36 kPa, 211 J/m2, 2 cm deep, no friction."""
    values = {"modulus": 48.36e3, "fracture_resistance": 211.0, "depth": 0.02, "friction_share": 0.0}
    return Specimen.homogeneous(tissue=tissue or liver(), **(values | changes))


def toughening() -> Specimen:
    """Tissue in which the force of a fast feed stays below R B, so that stable growth borrows all the way."""
    resistance = 211.0 + 30e3 * np.clip(np.arange(N_POINTS) * SPACING - 0.015, 0.0, None)
    return dataclasses.replace(homogeneous(), fracture_resistance=resistance)


def lead(
    specimen: Specimen,
    positions: Any,
    angles: Any = UPRIGHT,
    *,
    dt: float = 1e-3,
    parameters: LawParameters | None = None,
    start: Any = None,
) -> LedCut:
    """Lead the blade exactly along ``positions`` [m] at ``angles`` [rad], one each ``dt`` [s].

    ``start`` is the state to begin with; by default blade and tip stand at the clamp, at the first angle.
    """
    angles = _along(positions, angles)
    profile, law = profile_records([specimen])[0], law_records([specimen], parameters)[0]
    states = new_state(len(positions) + 1, angles[0])
    if start is not None:
        states[0] = start
    readings = np.zeros(len(positions), READING)
    _lead(states, profile, law, np.asarray(positions, dtype=float), angles, dt, readings)
    return LedCut(profile, law, states, readings)


@numba.njit
def _lead(states, profile, law, positions, angles, dt, readings):
    for i in range(len(positions)):
        states[i + 1] = states[i]
        dx = positions[i] - states[i].blade
        elastic, friction, jump = cut(states[i + 1], profile, law, dx, angles[i], dt)
        readings[i].time = (i + 1) * dt
        readings[i].position = states[i + 1].blade
        readings[i].speed = dx / dt
        readings[i].angle = angles[i]
        readings[i].true_force = elastic + friction
        readings[i].elastic_force = elastic
        readings[i].tip = states[i + 1].tip
        readings[i].jump = jump


def changed_law(*changes: tuple[str, str]) -> ModuleType:
    """The cutting law in plain Python, with parts of its source replaced: physics broken on purpose."""
    modules = []
    sources = [
        re.sub("^@njit(_internal|_inline)?\n", "", Path(part.__file__).read_text(), flags=re.MULTILINE)
        for part in (cutting_blade, cutting_friction, cutting_relaxation, cutting_law)
    ]
    for old, new in changes:
        found = sum(source.count(old) for source in sources)
        if found != 1:  # no AssertionError, which is what a broken law is to raise
            raise LookupError(f"the law holds {found} times: {old}")
        sources = [source.replace(old, new) for source in sources]
    for source in sources:
        module = ModuleType("changed_law")
        exec(compile(source, "changed_law", "exec"), module.__dict__)
        modules.append(module)
    blade, friction, relaxation, law = modules
    law.leaning, law.sweeping = blade.leaning, blade.sweeping
    for name in ("deflected", "friction_force", "friction_work"):
        setattr(law, name, getattr(friction, name))
    law.relaxed = relaxation.relaxed
    return law


def lead_by(
    law_module: ModuleType,
    specimen: Specimen,
    positions: Any,
    angles: Any = UPRIGHT,
    *,
    dt: float = 1e-3,
    parameters: LawParameters | None = None,
) -> LedCut:
    """Like :func:`lead`, by another law: plain Python on plain objects."""
    angles = _along(positions, angles)
    profile, law = profile_records([specimen])[0], law_records([specimen], parameters)[0]
    along = SimpleNamespace(**{name: profile[name].tolist() for name in profile.dtype.names})
    constants = SimpleNamespace(**{name: law[name].item() for name in LAW.names})
    states = new_state(len(positions) + 1, angles[0])
    state = SimpleNamespace(**{name: states[0][name].item() for name in STATE.names})
    readings = np.zeros(len(positions), READING)
    path = zip(np.asarray(positions, dtype=float).tolist(), angles.tolist(), strict=True)
    for i, (x, angle) in enumerate(path):
        dx = x - state.blade
        elastic, friction, jump = law_module.cut(state, along, constants, dx, angle, dt)
        states[i + 1] = tuple(vars(state)[name] for name in STATE.names)
        force = elastic + friction
        readings[i] = ((i + 1) * dt, force, state.blade, dx / dt, angle, force, elastic, state.tip, jump)
    return LedCut(profile, law, states, readings)


def residual_of(cut: LedCut) -> Any:
    """Work minus all the other energies in every state [J]."""
    s = cut.states
    return s["work"] - cut.stored - s["fracture"] - s["friction"] - s["loss"] - s["ledger"]


def turning_work(cut: LedCut) -> Any:
    """R B^2 |d cot(theta)| / 2 for every turn toward upright up to every state [J]."""
    swept = np.maximum(np.diff(-1.0 / np.tan(cut.states["angle"])), 0.0)
    x = cut.states["blade"][:-1]
    return np.concatenate(([0.0], np.cumsum(0.5 * cut.along("toughness", x) * cut.along("depth", x) * swept)))


def recorded_work(cut: LedCut) -> Any:
    """Work [J] of the recorded force over the recorded motion up to every state; turning is no such motion.

    By the trapezoid rule.
    """
    x, force = (np.concatenate(([0.0], cut.readings[name])) for name in ("position", "true_force"))
    return np.concatenate(([0.0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(x))))


def _along(positions: Any, angles: Any) -> Any:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(angles, dtype=float), np.shape(positions)))


def constant_feed(speed: float, *, to: float = 0.1, dt: float = 1e-3) -> Any:
    """Positions [m] of a blade driven from the clamp at ``speed`` [m/s]."""
    return np.arange(1, round(to / speed / dt) + 1) * (speed * dt)


def through(turning_points: Any, step: float, *, start: float = 0.0) -> Any:
    """Positions [m] from ``start`` through ``turning_points``, in steps of at most ``step`` [m]."""
    legs, x = [np.zeros(0)], start
    for target in turning_points:
        count = max(1, math.ceil(abs(target - x) / step))
        legs.append(np.linspace(x, target, count + 1)[1:])
        x = target
    return np.concatenate(legs)


class Policy(NamedTuple):
    """What a driver may do, leg by leg: place [m], speed [m/s], stroke [m] and number of strokes, angle."""

    legs: tuple[tuple[float, float, float, int, float], ...]

    def path(self, dt: float = 1e-3) -> tuple[Any, Any]:
        """Positions [m] and angles [rad], one each ``dt`` [s]; the blade turns at 90 deg/s at most."""
        positions, angles = [np.zeros(0)], [np.zeros(0)]
        x, theta = 0.0, UPRIGHT
        for place, speed, amplitude, strokes, angle in self.legs:
            turning_points = [place, *[max(place - amplitude, 0.0), place] * strokes]
            leg = through(turning_points, speed * dt, start=x)
            turn = np.arange(1, len(leg) + 1) * (UPRIGHT * dt)
            positions.append(leg)
            angles.append(theta + np.clip(angle - theta, -turn, turn))
            x, theta = place, float(angles[-1][-1])
        return np.concatenate(positions), np.concatenate(angles)


def policies(most_legs: int = 6) -> st.SearchStrategy[Policy]:
    """Feed, reversal, dither and turning, at the measured speeds and angles."""
    leg = st.tuples(
        st.floats(0.0, 0.1),
        st.floats(0.002, 0.0254),
        st.one_of(st.just(0.0), st.floats(1e-6, 0.01)),
        st.integers(0, 8),
        st.one_of(st.sampled_from([UPRIGHT, INCLINED]), st.floats(INCLINED, UPRIGHT)),
    )
    return st.lists(leg, min_size=1, max_size=most_legs).map(lambda legs: Policy(tuple(legs)))


@st.composite
def specimens(draw: st.DrawFn) -> Specimen:
    """Drawn livers with and without vessels, and homogeneous tissue in and beyond the measured range."""
    share, eta90 = draw(st.sampled_from([0.0, 0.2, 0.4])), draw(st.floats(0.2, 0.45))
    kind = draw(st.sampled_from(["homogeneous", "liver", "vascular"]))
    if kind == "homogeneous":
        return homogeneous(
            modulus=draw(st.floats(20e3, 100e3)),
            fracture_resistance=draw(st.floats(80.0, 500.0)),
            depth=draw(st.floats(0.001, 0.02)),
            friction_share=share,
            tissue=liver(eta90=eta90),
        )
    rng = generator(draw(st.integers(0, 2**32)))
    return Specimen.draw(rng, specimen_class=kind, tissue=liver(eta90=eta90, friction_share=share))
