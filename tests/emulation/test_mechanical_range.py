"""The thesis's mechanical range: any angle and 3.81 cm/s, emulated and fake; flagged outside what was measured."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from cutenv.commands import cli
from cutenv.emulation.canopen_rig import RANGES, EmulatedRig, Options
from cutenv.emulation.fake_benches import AirPlant
from cutenv.emulation.fake_rig import FakeRig
from cutenv.emulation.process import emulated_settings
from cutenv.rig.config.settings import fake_settings
from cutenv.rig.toml_file import read_rig_file, to_toml

WIDE = RANGES["thesis"]


@pytest.fixture
def rig() -> Iterator[EmulatedRig]:
    made = EmulatedRig(Options(range="thesis"))
    yield made
    made.close()


def placed(rig: EmulatedRig, angle_deg: float, position: float = 0.0) -> float:
    """Put the blade there at once, advance by 5 ms, and return the tissue's force [N]."""
    for name, place in (("angle", math.radians(angle_deg)), ("blade", position)):
        motor = rig.axes[name].motor
        motor["position"] = motor["carriage"] = motor["demand_position"] = place
    for k in range(5):
        rig.step(0.001 * k)
    return rig.bench.true_force


def flags(rig: EmulatedRig) -> list[str]:
    return [event["what"] for event in rig.events() if "measured range" in event["what"]]


def test_the_tissue_answers_as_at_the_nearest_measured_angle(rig: EmulatedRig):
    beyond = placed(rig, 10.0, 0.004)
    with closing(EmulatedRig(Options(range="thesis"))) as again:
        assert beyond == pytest.approx(placed(again, 45.0, 0.004), rel=1e-6)
        assert beyond > 0.1


def test_leaving_and_coming_back_are_noted(rig: EmulatedRig):
    placed(rig, 90.0)
    assert flags(rig) == []
    placed(rig, 130.0)
    placed(rig, 60.0)
    assert flags(rig) == ["outside the measured range", "inside the measured range"]


def test_a_speed_beyond_the_measured_is_noted(rig: EmulatedRig):
    rig.axes["blade"].motor["carriage_speed"] = rig.axes["blade"].motor["speed"] = 0.0381
    rig.step(0.0)
    assert flags(rig) == ["outside the measured range"]


def test_its_file_is_a_rig_without_contradictions(tmp_path: Path):
    settings = emulated_settings({"can": 1, "sensor": 2, "page": "http://127.0.0.1:3/", "range": "thesis"})
    settings = dataclasses.replace(settings, depth_profile=((0.0, 0.02), (0.149, 0.02)))
    path = tmp_path / "wide.toml"
    path.write_text(to_toml(settings), encoding="utf-8")
    read = read_rig_file(path)
    assert (read.limits.angle_low, read.limits.angle_high) == pytest.approx((0.0, math.pi))
    assert read.limits.speed >= 0.0381
    assert read.blade.high - read.blade.low == pytest.approx(0.2)


def test_a_fake_goes_to_every_angle_and_to_the_top_speed():
    wide = fake_settings(blade=WIDE.blade, limits=WIDE.limits)
    wide = dataclasses.replace(wide, angle=dataclasses.replace(wide.angle, low=WIDE.angle.low, high=WIDE.angle.high))
    air = AirPlant(wide)
    for _ in range(2000):
        air.step(0.0, math.radians(-90.0), False)
    assert air.motion[2] == pytest.approx(WIDE.angle.low)
    for _ in range(700):
        air.step(0.0381, 0.0, False)
    assert air.motion[1] == pytest.approx(0.0381, rel=1e-3)
    assert FakeRig(AirPlant, wide).settings.limits.angle_high == math.pi


def test_a_start_outside_the_measured_angles_is_refused(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["rig", "emulate", "--range", "thesis", "--angle-deg", "130"]) == 2
    assert "angle = 2.26893 rad is outside" in capsys.readouterr().err
