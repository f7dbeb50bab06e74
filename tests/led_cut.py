"""Cuts whose every instant is kept: by the compiled law, or by a law in plain Python that was changed on purpose."""

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
from cutenv.sim.cutting import friction as cutting_friction
from cutenv.sim.cutting import law as cutting_law
from cutenv.sim.cutting import row as cutting_row
from cutenv.sim.cutting import update as cutting_update
from cutenv.sim.cutting.drive import Hand, advance_command, coupling_step, lag_gain
from cutenv.sim.cutting.dtypes import (
    DRIVE,
    READING,
    STATE,
    TICK,
    LawParameters,
    law_records,
    new_state,
    profile_records,
)
from cutenv.sim.cutting.friction import Grip
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.row import ONE
from cutenv.sim.cutting.simulate import follow
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue.description import TissueDescription, tables_only
from cutenv.sim.tissue.specimen import N_POINTS, SPACING, Specimen

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
    plant = SimulatedPlant(specimen, law=parameters)
    cuts = plant.cuts
    states = new_state(len(positions) + 1, angles[0])
    if start is not None:
        states[0] = start
    cuts["states"][0] = states[:1]
    readings = np.zeros(len(positions), READING)
    path = np.stack((np.asarray(positions, dtype=float), angles, 0.0 * angles), axis=-1)
    _lead(cuts, plant.shared, states, path, dt, readings)
    return LedCut(cuts["profiles"][0, 0], cuts["laws"][0, 0], states, readings)


_follow = follow(STRAIGHT)


@numba.njit
def _lead(cuts, shared, states, path, dt, readings):
    for i in range(len(path)):
        _follow(cuts, shared, path[i : i + 1], dt, readings[i : i + 1], path[:0, 0])
        states[i + 1] = cuts[0].states[0]


_PARTS = (cutting_friction, cutting_law, cutting_row, cutting_update)
_IMPORT = rf"^from ({'|'.join(part.__name__ for part in _PARTS)}) import (\([^)]*\)|.*)\n"


def changed_law(*changes: tuple[str, str]) -> ModuleType:
    """The cutting law in plain Python, with parts of its source replaced: physics broken on purpose."""
    sources = [Path(str(part.__file__)).read_text() for part in _PARTS]
    sources = [
        re.sub(r"^@(njit(_internal|_inline)?|compiled_for\(.*\))\n", "", source, flags=re.MULTILINE)
        for source in sources
    ]
    for old, new in changes:
        found = sum(source.count(old) for source in sources)
        if found != 1:  # no AssertionError, which is what a broken law is to raise
            raise LookupError(f"the law holds {found} times: {old}")
        sources = [source.replace(old, new) for source in sources]
    law = ModuleType("changed_law")  # one for all parts, so that what was changed in one is what the others call
    for source in sources:
        exec(compile(re.sub(_IMPORT, "", source, flags=re.MULTILINE), "changed_law", "exec"), law.__dict__)
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
    """Like :func:`lead`, by another law: plain Python on plain objects, a row whose lanes are lists of one number."""
    angles = _along(positions, angles)
    profiles, laws = profile_records([specimen]), law_records([specimen], parameters)
    states, readings = new_state(len(positions) + 1, angles[0]), np.zeros(len(positions), READING)
    rows = np.zeros(1, ONE)
    plain = law_module.plain_views(rows, states[:1], laws, np.zeros(1, DRIVE))
    law_module.take_tissue(rows[0], plain, profiles[0], 0, 0)
    law_module.begin(rows[0], plain, 1)
    row = SimpleNamespace(**{name: rows[0][name].tolist() for name in ONE.names})
    along = [SimpleNamespace(**{name: profiles[0][name].tolist() for name in profiles.dtype.names})]
    law = law_module.cut_row(STRAIGHT)
    path = zip(np.asarray(positions, dtype=float).tolist(), angles.tolist(), strict=True)
    for i, (x, angle) in enumerate(path):
        row.dx[0], row.next_angle[0], row.turns = x - row.blade[0], angle, int(angle != row.angle[0])
        law(row, None, along, dt)
        row.felt[0] = row.force[0]
        law_module.note(row, 0, readings[i], dt)
        states[i + 1] = tuple(getattr(row, name)[0] for name in STATE.names)
    return LedCut(profiles[0], laws[0], states, readings)


class PulledBlade:
    """The blade of a hand outside tissue, a millisecond at a time."""

    def __init__(self, hand: Hand, travel: float = 0.149) -> None:
        self.state, self.drive = new_state(1, UPRIGHT)[0], hand.records(travel)[0]

    def step(self, speed: float, friction: Grip) -> float:
        """Move the hand at a commanded ``speed`` [m/s]; the blade's displacement [m]."""
        s = self.state
        advance_command(s, self.drive, lag_gain(self.drive, TICK), speed, TICK)
        dx = coupling_step(self.drive, s, 0.0, friction, TICK)
        s.speed = dx / TICK
        s.blade += dx
        return float(dx)


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
