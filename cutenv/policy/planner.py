"""Planners: the best plan of a whole cut through tissue that is known, or assumed to be the mean tissue."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from cutenv._base.arrays import Array, Array32, Indices, StructArray
from cutenv._base.validation import in_range
from cutenv.cutting.dtypes import READING
from cutenv.cutting.sensor import SensorParameters
from cutenv.plant.simulator import SimulatedPlant
from cutenv.policy.plan import KNOTS, PLAN, STRETCH, UPRIGHT, roll_out_all
from cutenv.policy.scripted import INCLINED, Script
from cutenv.policy.signals import DISTANCE_COLUMN, POSITION_COLUMN, to_actions
from cutenv.policy.unloading import StopAndUnload
from cutenv.task.episode_dtypes import TERMS
from cutenv.task.gentle_cutting import GentleCutting
from cutenv.task.observation import to_action
from cutenv.task.weights import Limits, RewardWeights
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.specimen import Specimen

_FASTEST, _SLOWEST = 0.0254, 0.001  # [m/s]
_DEADLINE, _TICKS = 30.0, 20  # [s], [ms]: the environment's defaults
_NEVER = 1.0  # [m], a place that no blade reaches


class Search:
    """Random local search over plans, started from the best of a grid of constant ones.

    Parameters
    ----------
    cutting : GentleCutting
        A cut at its start on a simulated plant; it is copied and not changed.
    """

    def __init__(self, cutting: GentleCutting) -> None:
        if not isinstance(cutting.plant, SimulatedPlant):
            raise TypeError(f"plans need a SimulatedPlant to simulate, got {type(cutting.plant).__name__}.")
        start = cutting.plant.snapshot()
        self._task, progress = cutting.assessment()
        self._target = cutting.target_length
        self._profiles, self._law, self._drive = start.profiles, start.laws, start.drives
        # Index 0: start; index 1: working copy.
        self._state, self._sensor, self._progress = (np.repeat(r, 2) for r in (start.states, start.sensors, progress))
        self._readings, self._terms = np.zeros(cutting.ticks, READING), np.zeros(len(TERMS))
        self._commands = np.zeros((math.ceil(1e3 * cutting.deadline / cutting.ticks), 2))

    def returns(self, plans: StructArray) -> Array:
        """Return the return of each plan, shape (n,)."""
        returns = np.zeros(len(plans))
        roll_out_all(
            self._state, self._profiles, self._law, self._drive, self._sensor, self._task, self._progress, plans,
            self._readings, self._terms, self._commands, returns,
        )  # fmt: skip
        return returns

    def commands(self, plan: StructArray) -> Array:
        """Return speed [m/s] and angle [rad] at each decision of a plan, shape (1,); shape (decisions, 2)."""
        self.returns(plan)
        return self._commands.copy()

    def best(self, rng: np.random.Generator, *, rounds: int, offspring: int = 16) -> tuple[StructArray, float]:
        """Search for ``rounds`` rounds; return the best plan found, shape (1,), and its return."""
        plans = self.plain_plans()
        plan, value = _better(plans, self.returns(plans), plans[:1], -math.inf)
        size = 1.0
        for _ in range(rounds):
            tries = self.varied(plan, size, offspring, rng)
            before = value
            plan, value = _better(tries, self.returns(tries), plan, value)
            size = min(1.3 * size, 1.0) if value > before else max(0.7 * size, 0.05)
        return plan, value

    def plain_plans(self) -> StructArray:
        """Return a grid of plans with one speed and one angle throughout, and many positions to stop."""
        speeds, angles = np.array([0.0254, 0.0190, 0.0127, 0.0064]), np.radians([45.0, 60.0, 90.0])
        stops = self._target + np.linspace(-0.004, 0.044, 33)  # the blade leads the tip by up to 4 cm
        v, theta, stop = (grid.ravel() for grid in np.meshgrid(speeds, angles, stops, indexing="ij"))
        plans = np.zeros(len(v), PLAN)
        plans["speed"], plans["angle"] = v[:, None], theta[:, None]
        plans["upright_from"] = plans["slow_from"] = _NEVER
        plans["last_speed"] = v
        plans["stop"] = stop
        plans["retreat"] = 0.010
        plans["rest_lag"] = 0.5e-3
        return plans

    def varied(self, plan: StructArray, size: float, count: int, rng: np.random.Generator) -> StructArray:
        """Return ``count`` mutations of ``plan``, shape (1,): each number is changed with a probability of 1/3."""
        plans = np.repeat(plan, count)

        def change(name: str, step: float, low: float, high: float) -> None:
            values = plans[name]
            chosen = rng.random(values.shape) < 1.0 / 3.0
            plans[name] = np.clip(values + size * step * chosen * rng.standard_normal(values.shape), low, high)

        change("speed", 0.006, _SLOWEST, _FASTEST)
        change("angle", math.radians(12.0), INCLINED, UPRIGHT)
        change("last_speed", 0.006, _SLOWEST, _FASTEST)
        change("stop", 0.002, 0.5 * self._target, self._target + 0.05)
        change("retreat", 0.004, 0.002, _FASTEST)
        change("rest_lag", 1e-3, 0.0, 0.004)
        for name in ("upright_from", "slow_from"):
            near = np.where(plans[name] == _NEVER, self._target - 0.010, plans[name])
            moved = near + size * 0.005 * rng.standard_normal(count)
            plans[name] = np.where(rng.random(count) < 1.0 / 3.0, moved, plans[name])
        return plans


def _better(plans: StructArray, returns: Array, plan: StructArray, value: float) -> tuple[StructArray, float]:
    k = int(np.argmax(returns))
    return (plans[k : k + 1].copy(), float(returns[k])) if returns[k] > value else (plan, value)


class PlannerWithTruth:
    """The oracle: it knows the specimen and plans the whole cut; an upper bound that no real policy can reach.

    Its plans come from a search, so the true optimum is slightly better.

    Parameters
    ----------
    rounds : int
        Number of rounds of the search.
    """

    def __init__(self, *, rounds: int = 20) -> None:
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", "20 come within 0.002 of 200."))

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut."""
        self._rng = rng
        self._commands: list[tuple[float, float]] = []

    def set_state(self, cutting: GentleCutting) -> None:
        """Plan the cut that is about to begin."""
        search = Search(cutting)
        plan, _ = search.best(self._rng, rounds=self._rounds)
        self._commands = [(speed, angle) for speed, angle in search.commands(plan).tolist()]
        self._commands.reverse()

    def __call__(self, observation: Array32) -> Array32:
        """Return the next command of the plan, whatever the observation."""
        if not self._commands:
            raise RuntimeError("this planner must be shown the cut: call set_state(env.unwrapped.cutting) after reset.")
        return to_action(*self._commands.pop())


class PlannerNominal(Script):
    """A planner for the mean liver: it follows the plan and stops where the tip is estimated to reach the target.

    Parameters
    ----------
    tissue : TissueDescription, optional
        Default: the measured pig liver.
    rounds : int
        Number of rounds of the search.
    """

    def __init__(
        self, *, tissue: TissueDescription | None = None, rounds: int = 20, unloading: StopAndUnload | None = None
    ) -> None:
        super().__init__(unloading)
        self._tissue = tissue or measured_liver()
        self._rounds = int(in_range("rounds", rounds, 0, 10**6, "1", "20 come within 0.002 of 200."))
        self._plans: dict[float, StructArray] = {}

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; plans are kept."""
        super().begin(rngs)
        self._chosen = np.zeros(len(rngs), PLAN)

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        super().forget(cuts)
        self._chosen[cuts] = np.zeros((), PLAN)

    def command(self, seen: Array) -> Array32:
        """Return the plans' commands for the present positions."""
        position, plans = seen[:, POSITION_COLUMN], self._chosen
        for n in np.flatnonzero(plans["stop"] == 0.0):  # not yet chosen
            plans[n] = self.plan_for(position[n] + seen[n, DISTANCE_COLUMN])[0]
        each, segment = np.arange(len(plans)), np.clip((position / STRETCH).astype(int), 0, KNOTS - 1)
        speeds = np.where(position >= plans["slow_from"], plans["last_speed"], plans["speed"][each, segment])
        angles = np.where(position >= plans["upright_from"], UPRIGHT, plans["angle"][each, segment])
        return to_actions(speeds, angles)

    def plan_for(self, target: float) -> StructArray:
        """Return the plan for a target length [m], rounded to a centimetre, shape (1,); cached."""
        length = round(target, 2)
        if length not in self._plans:
            self._plans[length] = Search(_mean_cut(self._tissue, length)).best(
                np.random.default_rng(0), rounds=self._rounds
            )[0]
        return self._plans[length]


def _mean_cut(tissue: TissueDescription, target: float) -> GentleCutting:
    specimen = Specimen.mean(tissue)
    plant = SimulatedPlant(specimen, sensor=SensorParameters(force_noise=0.0))
    return GentleCutting(
        plant,
        tissue,
        RewardWeights(),
        Limits(),
        truth=plant.profiles,
        friction_per_depth=specimen.friction_per_depth,
        target_length=target,
        deadline=_DEADLINE,
        ticks=_TICKS,
    )
