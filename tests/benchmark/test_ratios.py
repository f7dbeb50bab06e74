"""How fast things are beside each other: bounds so wide that only a real loss breaks them, never a busy machine.

Beside each bound stands what was measured on 2 cores; what is required of a quiet machine,
``scripts/benchmarks/speed/bench.py`` prints.
"""

from __future__ import annotations

import csv
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import VectorEnv

import cutenv  # noqa: F401  registers the environment
from cutenv._engine.parallel import make_queue
from cutenv.display.viewer.drawn_slab import Slab
from cutenv.records import AppendingRecord
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.simulate import hold_some
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.mesh import ELEMENT_KINDS, CutMesh
from cutenv.sim.tissue.tip_response import stiffness_matrix, tip_responses
from cutenv.sim.trace import Reading
from scripts.benchmarks.speed.batch import bare, hold_in_single_file
from scripts.benchmarks.speed.factorisation import factorising_per_tip
from scripts.benchmarks.speed.vertical_motion import MOTIONS, descending_rates

pytestmark = pytest.mark.benchmark(group="ratios")

Way = Callable[[], Any]
Ratio = Callable[[Way, Way], float]
FINE = (40, 75)
TIP = 0.0713  # between two corners of either mesh [m]


def steps(env: gymnasium.Env[Any, Any], count: int = 100) -> Way:
    """Step slowly onwards, beginning anew where a cut ends."""
    env.reset(seed=0)
    action = np.full(env.action_space.shape or (), 0.15, np.float32)

    def take() -> None:
        for _ in range(count):
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

    return take


def batch(name: str, count: int, mode: str = "vector_entry_point") -> VectorEnv[Any, Any, Any]:
    env = gymnasium.make_vec(name, num_envs=count, vectorization_mode=mode)
    env.reset(seed=0)
    return env


def batch_steps(env: VectorEnv[Any, Any, Any]) -> Way:
    actions = np.full(env.action_space.shape or (), 0.15, np.float32)
    return lambda: env.step(actions)


def test_a_step_is_about_a_step_of_pendulum(ratio):
    """20 force updates cost no more than three steps of a pendulum; measured: 0.9."""
    env = gymnasium.make("cutenv/GentleCut-v1")
    assert ratio(steps(env), steps(gymnasium.make("Pendulum-v1"))) < 3.0


def test_a_batch_is_faster_than_a_loop(ratio):
    """A batch of 256 takes less than half the time of as many pendulums in a loop; measured: 0.06."""
    env = batch("cutenv/GentleCut-v1", 256)
    assert ratio(batch_steps(env), batch_steps(batch("Pendulum-v1", 256, "sync"))) < 0.5


def in_rows_and_in_single_file() -> tuple[Way, Way]:
    """20 updates of 256 cuts on one core, in rows and one cut after the other."""
    cuts = batch("cutenv/GentleCut-v1", 256).unwrapped.cuts  # type: ignore[attr-defined]
    rows, files = bare(cuts), bare(cuts)
    commands, felt = np.tile((0.005, 1.0, 0.0), (256, 1)), np.empty((256, 2))
    return (
        lambda: hold_some(STRAIGHT)(make_queue(256), 0, rows, commands, 20, felt),
        lambda: hold_in_single_file(make_queue(256), 0, files, commands, 20, felt),
    )


def check_rows(ratio: Ratio, rows: Way, files: Way) -> None:
    """Rows of cuts take less than 0.7 of the time; measured: 0.4, and 1.0 where no loop becomes vector instructions."""
    assert ratio(rows, files) < 0.7


def test_rows_of_cuts_are_faster_than_single_file(ratio):
    check_rows(ratio, *in_rows_and_in_single_file())


def test_a_blade_that_presses_down_is_not_much_slower():
    """A blade that presses down takes less than 8 times as long as one of GentleCut-v1; measured: 3.3, once 24."""
    found = descending_rates(MOTIONS["pressing down"], 64)
    assert found.gentle / found.own < 8.0


def test_a_larger_batch_costs_no_more_for_each(ratio):
    """Eight times as many take less than 24 times as long; measured: 5."""
    assert ratio(*(batch_steps(batch("cutenv/GentleCut-v1", count)) for count in (2048, 256))) < 24.0


def test_resetting_a_batch_is_so_many_steps_of_it(ratio):
    """Measured: 21, for steps are cheap; 100 are allowed."""
    env, other = (batch("cutenv/GentleCut-v1", 256) for _ in range(2))
    assert ratio(env.reset, batch_steps(other)) < 100.0


def test_a_force_update_is_a_fraction_of_a_pendulums_step(ratio):
    """Measured: 0.08."""
    plant = SimulatedPlant(Specimen.mean())

    def updates() -> None:
        for _ in range(100):
            plant.advance(0.005, 1.0, 1)

    assert ratio(updates, steps(gymnasium.make("Pendulum-v1"))) < 0.5


def test_a_displacement_is_not_solved_for(ratio):
    """A displacement takes less than a fifth of one factorisation with its solves; measured: 0.03."""
    model = CutModel()
    mesh = CutMesh(kind=ELEMENT_KINDS["quad8"], divisions=(8, 15), size=(model.width, model.length))
    stiffness = stiffness_matrix(mesh, model.formulation, model.poisson)
    assert (
        ratio(lambda: model.displacement(TIP, 1.0, 1e4, 0.01), lambda: tip_responses(mesh, stiffness, slipping=False))
        < 0.2
    )


def test_a_displacement_on_the_fine_mesh_grows_less_than_its_equations(ratio):
    """21 times the equations; measured: 1.6 times as long."""
    fine, coarse = CutModel(divisions=FINE), CutModel()
    assert ratio(*(lambda m=model: m.displacement(TIP, 1.0, 1e4, 0.01) for model in (fine, coarse))) < 15.0


def test_the_viewers_lattice_is_a_product_more(ratio):
    """Measured: 3.4; when it picked the corners of each element for every picture, 20."""
    model = CutModel(divisions=FINE)
    slab = Slab(model)
    assert ratio(lambda: slab.displacement(TIP, 0.01), lambda: model.displacement(TIP, 1.0, 1e4, 0.01)) < 10.0


def test_one_factorisation_serves_all_tips(ratio):
    """Measured: 0.08; an eighth is required of a quiet machine."""
    model = CutModel()
    mesh = CutMesh(kind=ELEMENT_KINDS["quad8"], divisions=(8, 15), size=(model.width, model.length))
    stiffness = stiffness_matrix(mesh, model.formulation, model.poisson)
    once, each = (
        (lambda: tip_responses(mesh, stiffness, slipping=False)),
        (lambda: factorising_per_tip(mesh, stiffness)),
    )
    assert ratio(once, each) < 0.35


@pytest.mark.parametrize(("cheaper", "dearer"), [("quad4", "quad8"), ("quad8", "hex20")])
def test_the_models_of_table_4_3_are_in_order_of_effort(ratio, cheaper, dearer):
    """On a smaller mesh, for bricks take long; measured: 0.4 and 0.17."""

    def whole(element: str) -> Way:
        divisions = (4, 8, 2) if element == "hex20" else (4, 8)
        formulation = "solid" if element == "hex20" else "plane_stress"
        return lambda: CutModel(element, formulation, divisions=divisions).stiffness(TIP)

    assert ratio(whole(cheaper), whole(dearer)) < 1.0


def test_a_growing_record_costs_little_beside_plain_csv(ratio: Ratio, tmp_path: Path) -> None:
    """20 readings at a time; measured 1.2, 76 us."""
    fresh = itertools.count()

    def block() -> list[Reading]:
        first = 20 * next(fresh)
        return [Reading(i * 1e-3, i / 7e6, i / 3e7, 0.001 / 3, 1.57 / 3, 0.01 / 3) for i in range(first, first + 20)]

    with AppendingRecord(tmp_path / "cut.csv") as record, (tmp_path / "plain.csv").open("w") as plain:
        rows = csv.writer(plain)

        def append() -> None:
            for _ in range(50):
                record.append(block())

        def write() -> None:
            for _ in range(50):
                rows.writerows(block())
                plain.flush()

        assert ratio(append, write) < 4.0
