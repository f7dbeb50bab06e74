"""An emulated rig with a height axis: the law with vertical motion under its motors, and a further node on the bus."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from contextlib import closing

import numpy as np
import pytest
from hand_moved_drive import INCREMENT

from cutenv.commands.rig.emulate import _options, _parser
from cutenv.emulation.can_hub import Frame
from cutenv.emulation.canopen_rig import EmulatedRig, Options
from cutenv.emulation.control_port import answered
from cutenv.emulation.mechanics import ARM, EmulatedTissue
from cutenv.emulation.tissue_in_plane import TissueInPlane
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import across
from cutenv.rig.devices.canopen.objects import HOMED
from cutenv.rig.errors import RigError
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.lines import arc

UPRIGHT = math.pi / 2
WAY = np.linspace(0.0, 0.03, 1501)[1:]


def layered(sensor: SensorParameters | None = None) -> EmulatedTissue:
    return EmulatedTissue(sensor, axes=("height",))


def mounted(of: Callable[[SensorParameters], EmulatedTissue], **more) -> EmulatedTissue:
    bench, what = of(SensorParameters()), MountedSpecimen(seed=3, episode=1, **more)
    bench.mount(what.drawn(), what, position=0.0, angle=UPRIGHT)
    return bench


def test_at_height_0_the_readings_are_those_of_a_rig_without_the_axis_to_the_last_bit():
    plain, low = mounted(EmulatedTissue), mounted(layered)
    readings = [(plain.advance(x, UPRIGHT), low.advance(x, UPRIGHT)) for x in WAY]
    assert [one for one, _ in readings] == [other for _, other in readings]
    assert (plain.true_force, plain.tip) == (low.true_force, low.tip)
    assert abs(low.forces["height"]) < 1.0
    assert low.true_force > 0.5


def test_a_lower_blade_cuts_deeper_and_a_rising_one_is_held_down():
    plain, lower = mounted(layered), mounted(layered)
    for k, x in enumerate(WAY):
        plain.advance(x, UPRIGHT)
        lower.places["height"] = -3e-6 * k
        lower.advance(x, UPRIGHT)
    assert lower.true_force > plain.true_force
    pushed = lower.forces["height"]
    for _ in range(200):
        lower.places["height"] += 5e-6
        lower.advance(WAY[-1], UPRIGHT)
    assert lower.forces["height"] < min(0.0, pushed)
    lower.take_away()
    lower.advance(0.0, UPRIGHT)
    assert (lower.true_force, lower.forces["height"]) == (0.0, 0.0)


def test_a_specimen_is_laid_only_with_the_blade_at_height_0():
    bench, what = layered(), MountedSpecimen()
    bench.places["height"] = 0.005
    with pytest.raises(RigError, match=r"the height axis stands at 5\.0 mm: move it to 0 \(within 2 mm\)"):
        bench.mount(what.drawn(), what, position=0.0, angle=UPRIGHT)
    bench.places["height"] = -0.0019
    bench.mount(what.drawn(), what, position=0.0, angle=UPRIGHT)


def test_the_option_adds_a_third_node_with_its_own_dictionary_that_says_it_is_homed():
    assert _options(_parser().parse_args([])).cross_axes == {}
    options = _options(_parser().parse_args(["--height", "--free-air"]))
    with closing(EmulatedRig(options)) as rig:
        sent: list[Frame] = []
        rig.hub.send = sent.append
        assert [node.number for node in rig.nodes.values()] == [1, 2, 3]
        for tick in range(5):
            rig.step(1000.0 + 1e-3 * tick)
        before = rig.nodes["blade"].dictionary[0x6065]
        rig.nodes["height"].dictionary[0x6065] = 1234
        assert rig.nodes["blade"].dictionary[0x6065] == before
        rig.nodes["height"].receive(Frame(0x603, bytes.fromhex("4041600000000000")), 1000.005)
        answer = next(frame.data for frame in sent if frame.identifier == 0x583)
        assert struct.unpack_from("<H", answer, 4)[0] & HOMED
        assert not rig.nodes["blade"].dictionary[0x6041] & HOMED
        assert abs(rig.axes["height"].increments()) * INCREMENT < 1e-6


def test_the_sensor_gets_the_vertical_force_and_a_torque_by_its_arm():
    rig = EmulatedRig(Options(mounted=None, cross_axes=across("height")))
    loads = []
    try:
        rig.sensor.send = loads.append
        rig.inject("over_force", {"force_N": 20.0})
        rig.inject("over_lift", {"force_N": -8.0})
        for tick in range(50):
            rig.step(1000.0 + 1e-3 * tick)
    finally:
        rig.close()
    fx, _, fz, _, ty, _ = np.mean(loads[20:], axis=0)
    assert (fx, fz, ty) == (
        pytest.approx(20.0, abs=0.1),
        pytest.approx(-8.0, abs=0.1),
        pytest.approx(-20.0 * ARM, abs=0.01),
    )


def test_layers_are_laid_by_the_control_port_on_a_rig_with_the_axis_alone():
    asked = {"do": "specimen", "seed": 3, "layers": {"boundary": 0.01, "deep_toughness": 2.0}}
    with closing(EmulatedRig(Options(mounted=None, cross_axes=across("height")))) as rig:
        assert answered(rig, asked)["ok"]
        assert rig.bench.mounted.layers == Layers(boundary=0.01, deep_toughness=2.0)
        assert answered(rig, {"do": "truth"})["height_m"] == 0.0
    with closing(EmulatedRig(Options(mounted=None))) as rig:
        assert "layers: this rig has no height axis" in answered(rig, asked)["error"]
        assert "height_m" not in answered(rig, {"do": "truth"})


def test_steps_of_the_encoders_do_not_turn_a_blade_at_rest():
    tissue = TissueInPlane(Specimen.drawn(3), arc(0.1, turn=math.radians(20.0)))
    along = np.linspace(0.0, 0.03, 2000)
    for x in along:
        tissue.advance(float(x), 0.0, UPRIGHT)
    for x in along[:-400:-1]:  # back, so that friction pulls the other way
        tissue.advance(float(x), 0.0, UPRIGHT)
    rest, force, heading = float(x), tissue.force, tissue.plant.heading
    step = 1e-6  # of an encoder
    for k in range(200):
        tissue.advance(rest, step * (k % 2), UPRIGHT)
    assert tissue.plant.heading == pytest.approx(heading, abs=0.1)
    assert tissue.force == pytest.approx(force, abs=0.05)
