"""A session with a rig that raises its blade: nothing is raised before the operator's yes; all of it is recorded."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scripted_operator import ScriptedOperator

from cutenv.envs.constants import Constants
from cutenv.envs.rig_source import RigSource
from cutenv.records import load_one
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.operation.session import SpecimenKey
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import COMPONENTS_OF_FORCE, Reading

UPRIGHT = math.pi / 2
SPECIMEN = Specimen.drawn(3, 0, specimen_class="liver")
KEY = SpecimenKey(seed=3, episode=0, specimen=SPECIMEN)
MOVES = "will move: up and down by 1 mm, and up to 20 mm before it returns"
UP = ("Did it go up first, and then down?", True)


def source(answers: list[tuple[str, bool | str]], records: Path | None = None) -> RigSource:
    made = RigSource(
        "fake", Constants(), operator=ScriptedOperator(answers), records=records, needs_axis="height", by="DepthCut-v1"
    )
    loose = dataclasses.replace(made.settings.limits, force_rise=5e3, force=100.0, force_norm=150.0)
    made.settings = dataclasses.replace(made.settings, limits=loose)
    return made


def test_a_cut_is_prepared_cut_and_recorded_with_height_and_six_components(tmp_path):
    rig = source([(MOVES, "fake"), UP], tmp_path)
    with rig.session() as session:
        rig.supply.layers = Layers(boundary=0.012, deep_toughness=3.0)
        session.next_cut(KEY, UPRIGHT)
        plant = session.plant
        assert plant.height == pytest.approx(0.0, abs=3e-5)
        assert [check.name for check in session.checks][-3:] == ["height encoder", "encoder", "hinge"]
        assert float(rig.fake.bench.plant.descents["deep_toughness"][0]) == 3.0
        plant.depth = SPECIMEN.depth
        rig.begin_record(plant, seed=3, episode=0)
        session.start()
        made = [plant.advance(0.012, UPRIGHT, 20, 0.002 if k < 40 else -0.003) for k in range(80)]
        heights = plant.channels["height"].tolist()
        session.end_cut()
        rig.end_record(plant, end="a test")
        assert 0.0 < plant.height < 0.002  # end of the cut: it rests where it is
    trace = load_one(rig.records[0])
    readings = np.concatenate(made)
    # Where no axis moves the blade sideways, no place of it is recorded: it would be a made-up zero.
    assert trace.known == (*Reading._fields, "height", "vertical_force", *COMPONENTS_OF_FORCE)
    assert np.array_equal(trace.force, readings["force"])
    assert np.array_equal(trace.position, readings["position"])
    assert trace.height[-20:].tolist() == heights
    assert np.array_equal(trace.force_z, trace.vertical_force)
    assert np.array_equal(trace.force_x, trace.force)  # of the fake: the cut lies along x
    assert np.ptp(trace.vertical_force) > 0.1
    assert trace.metadata["vertical_axis"] == "z"


def test_after_a_stop_nothing_is_raised_before_the_operators_yes():
    rig = source([(MOVES, "fake"), UP, ("The blade was stopped (operator", False)])
    with rig.session() as session:
        session.next_cut(KEY, UPRIGHT)
        session.start()
        plant = session.plant
        for _ in range(50):
            plant.advance(0.01, UPRIGHT, 20, 0.002)
        plant.supervisor.trip(Cause.OPERATOR, "a test")
        plant.clock.sleep_until(plant.clock.now() + 1.0)
        depth = rig.fake.bench.cross_motion("height")[0]
        assert depth < -0.0015
        with pytest.raises(RigError, match="not agreed"):
            session.next_cut(KEY, UPRIGHT)
        plant.clock.sleep_until(plant.clock.now() + 1.0)
        assert rig.fake.bench.cross_motion("height")[0] == depth
        session.operator.unasked[:] = [("The blade was stopped", True), (MOVES, "no")]
        with pytest.raises(RigError, match="not confirmed"):
            session.next_cut(KEY, UPRIGHT)
        assert rig.fake.bench.cross_motion("height")[0] == depth
        session.operator.unasked[:] = [(f"at a height of {1e3 * depth:+.1f} mm", "fake")]
        session.next_cut(KEY, UPRIGHT)
        raised = "The blade is raised to 20 mm at 5 mm/s."
        assert session.operator.messages.index(raised) < session.operator.messages.index(
            "The drives are switched on again."
        )
        assert plant.height == pytest.approx(0.0, abs=3e-5)


def test_a_blade_that_cannot_be_raised_out_of_the_cut_is_stopped_and_stays_so():
    rig = source([(MOVES, "fake"), UP])
    with rig.session() as session:
        session.next_cut(KEY, UPRIGHT)
        session.start()
        plant = session.plant
        for _ in range(50):
            plant.advance(0.01, UPRIGHT, 20, 0.002)
        session.end_cut()
        rig.fake.faults.height.one_way = True
        session.operator.unasked[:] = [("cannot be raised", True), (MOVES, "fake"), ("cannot be raised", False)]
        with pytest.raises(RigError):
            session.next_cut(KEY, UPRIGHT)
        assert plant.supervisor.report.cause is Cause.NOT_RAISED
        assert plant.supervisor.phase == "stopped"
        with pytest.raises(RigStopped):
            plant.advance(0.0, UPRIGHT, 20, -0.001)


def test_a_blade_that_went_the_other_way_is_not_raised():
    rig = source([(MOVES, "fake"), (UP[0], False)])
    with rig.session() as session:
        with pytest.raises(RigError, match=r"If it went down, correct height.direction = 1 in the rig's file"):
            session.next_cut(KEY, UPRIGHT)
        assert session.plant.supervisor.phase == "unready"
        assert {rig.fake.blade.state, rig.fake.across["height"].state} == {DriveState.DISABLED}
        assert abs(rig.fake.bench.cross_motion("height")[0]) < 5e-5


def test_an_axis_that_sinks_without_power_is_noticed():
    rig = source([(MOVES, "fake"), UP])
    with rig.session() as session:
        supply, mount = rig.supply, rig.supply.mount

        def sink(key):
            mount(key)
            rig.fake.bench.plant.descents["level"] = -0.002

        supply.mount = sink
        with pytest.raises(RigError, match=r"the height axis went to -2.0 mm: it needs a brake"):
            session.next_cut(KEY, UPRIGHT)
