"""A rig's file whose keys contradict each other is refused when read; what is accepted can be cut with."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Iterator
from contextlib import closing
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import settings as hypothesis_settings
from made_up_settings import FREE, USUAL, with_surprises, with_value

from cutenv.emulation.fake_benches import AirPlant, SpecimenPlant
from cutenv.emulation.fake_rig import FakeRig, FakeSensor
from cutenv.emulation.process import RunningEmulator, start
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import HEIGHT, RigSettings
from cutenv.rig.contradictions import contradictions
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.session import RigSession, SpecimenKey
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.rig.toml_file import read_rig_file, to_toml
from cutenv.sim.tissue.specimen import Specimen
from scripts.validation.rig.cutting_rig import CuttingRig

DESCENDS = dataclasses.replace(FREE, height=HEIGHT)
ATTEMPTS = 8  # at half a second of cutting in which the host does not stall
CONTRADICTORY: dict[str, tuple[RigSettings, dict[str, Any], tuple[str, ...]]] = {
    "blade and computer": (USUAL, {"blade.node": 127}, ("bus.node = 127", "blade.node = 127")),
    "hinge and computer": (FREE, {"angle.node": 127}, ("bus.node = 127", "angle.node = 127")),
    "hinge and blade": (FREE, {"angle.node": 1}, ("blade.node = 1", "angle.node = 1")),
    "the clamp is outside": (USUAL, {"limits.low": 0.01}, ("limits.low_mm = 10",)),
    "the clamp is beyond the drive": (USUAL, {"blade.low": 0.05}, ("blade.low_mm = 50", "limits.low_mm = -1")),
    "the drive ends first": (USUAL, {"limits.high": 0.4}, ("blade.high_mm = 149", "limits.high_mm = 400")),
    "no room for a cut": (USUAL, {"limits.high": 0.0}, ("limits.high_mm = 0",)),
    "a stop without end": (USUAL, {"blade.quick_stop": 0.001}, ("quick_stop_m_s2 = 0.001", "acceleration_m_s2 = 0.1")),
    "a slow stop": (USUAL, {"blade.quick_stop": 0.11}, ("quick_stop_m_s2 = 0.11", "blade.speed_cm_s = 3.81")),
    "stale at once": (USUAL, {"limits.stale_motion": 0.005}, ("stale_motion_ms = 5", "sync_ms = 5")),
    "slow SYNC": (USUAL, {"bus.sync": 0.02}, ("stale_motion_ms = 25", "sync_ms = 20")),
    "jerks": (USUAL, {"blade.acceleration": 500.0}, ("limits.acceleration_m_s2 = 1", "blade.acceleration_m_s2 = 500")),
    "in all, less than in one": (USUAL, {"limits.force_norm": 0.2}, ("force_N = 15", "force_norm_N = 0.2")),
    "metres for centimetres": (USUAL, {"blade.speed": 0.000381}, ("speed_cm_s = 2.65", "speed_cm_s = 0.0381")),
    "limit in metres": (USUAL, {"limits.speed": 0.000265}, ("limits.speed_cm_s = 0.0265",)),
    "drive's window": (USUAL, {"limits.following": 0.003}, ("following_error_mm = 2", "following_mm = 3")),
    "following within a SYNC": (USUAL, {"limits.following": 1e-5}, ("following_mm = 0.01", "sync_ms = 5")),
    "no end of braking": (USUAL, {"blade.acceleration": 0.001}, ("blade.acceleration_m_s2 = 0.001", "speed_cm_s")),
    "heartbeats": (USUAL, {"limits.heartbeat": 0.03}, ("limits.heartbeat_ms = 30",)),
    "our heartbeat": (USUAL, {"bus.heartbeat": 0.08}, ("bus.heartbeat_ms = 80",)),
    "a full bus": (USUAL, {"bus.bitrate": 50_000}, ("bitrate_bit_s = 50000", "sync_ms = 5")),
    "few readings": (USUAL, {"sensor.rate": 100.0}, ("stale_force_ms = 20", "rate_Hz = 100")),
    "tissue alone": (USUAL, {"limits.force_rise": 10.0}, ("force_rise_N_per_s = 10", "limits.speed_cm_s = 2.65")),
    "noise alone": (USUAL, {"identified.force_noise": 1.0}, ("force_rise_N_per_s = 200", "force_noise_N = 1")),
    "angle is outside": (USUAL, {"limits.angle_high": 1.2}, ("fixed_angle_deg = 90", "angle_high_deg = 68.7549")),
    "upright is outside": (FREE, {"limits.angle_high": 1.2}, ("angle_low_deg = 44", "angle_high_deg = 68.7549")),
    "the hinge ends first": (FREE, {"angle.low": 1.0}, ("angle.low_deg = 57.2958", "limits.angle_low_deg = 44")),
    "measured otherwise": (USUAL, {"identified.acceleration": 1.0}, ("n_m_s2 = 1", "n_m_s2 = 0.1")),
    "a lazy hinge": (FREE, {"angle.acceleration": 1.0}, ("angle.acceleration_deg_s2 = 57.2958", "angle.speed_deg_s")),
    "a slow hinge": (FREE, {"angle.speed": 0.1}, ("angle.speed_deg_s = 5.72958",)),
    "a hinge that goes on": (FREE, {"angle.quick_stop": 1.0}, ("quick_stop_deg_s2 = 57.2958", "speed_deg_s = 120")),
    "no increment": (USUAL, {"blade.pulses": 1}, ("blade.pulses = 1", "blade.gear = 4.4", "blade.lead_mm = 2")),
    "no such count": (USUAL, {"blade.pulses": 10**7, "blade.gear": 1e4}, ("blade.pulses = 10000000", "gear = 10000")),
    "nothing to type": (USUAL, {"name": ""}, ("name = ''",)),
    "nothing to be seen": (USUAL, {"name": "bench\n"}, ("name = 'bench\\n'",)),
    "no such bus": (USUAL, {"bus.interface": "cantact"}, ("bus.interface = 'cantact'", "bus.channel = 'can0'")),
    "no such channel": (USUAL, {"bus.interface": "kvaser"}, ("bus.interface = 'kvaser'", "bus.channel = 'can0'")),
    "checked tomorrow": (USUAL, {"calibration.date": "2999-01-01"}, ("calibration.date = 2999-01-01",)),
}  # fmt: skip
OF_HEIGHT: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "node of the blade": ({"node": 1}, ("blade.node = 1", "height.node = 1")),
    "node of the hinge": ({"node": 2}, ("angle.node = 2", "height.node = 2")),
    "a cut cannot begin": ({"lowest": 0.0}, ("height.lowest_mm = 0",)),
    "raised beyond its end": ({"raised": 0.025}, ("height.raised_mm = 25", "height.highest_mm = 25")),
    "raised by nothing": ({"raised": 0.0}, ("height.raised_mm = 0",)),
    "the drive's lower end first": ({"low": -0.01}, ("height.low_mm = -10", "height.lowest_mm = -20")),
    "the drive's upper end first": ({"high": 0.02}, ("height.high_mm = 20", "height.highest_mm = 25")),
    "the drive's window": ({"following": 0.003}, ("height.following_error_mm = 2", "height.following_mm = 3")),
    "following within a SYNC": ({"following": 1e-5}, ("height.following_mm = 0.01", "bus.sync_ms = 5")),
    "faster than the drive": ({"fastest": 0.05}, ("height.fastest_cm_s = 5", "height.speed_cm_s = 3.81")),
    "too slow to be raised": ({"fastest": 0.001}, ("height.fastest_cm_s = 0.1",)),
    "jerks": ({"acceleration": 2.0, "quick_stop": 3.0}, ("height.most_acceleration_m_s2 = 1",)),
    "a slow stop": ({"quick_stop": 0.11}, ("height.quick_stop_m_s2 = 0.11", "height.speed_cm_s = 3.81")),
    "rest takes long": ({"acceleration": 0.009, "quick_stop": 1.0}, ("height.acceleration_m_s2 = 0.009",)),
    "never counts": ({"vertical_force": 15.5}, ("height.vertical_force_N = 15.5", "limits.force_N = 15")),
    "one axis for two": ({"force_axis": "x"}, ("height.force_axis = 'x'", "sensor.cut_axis = 'x'")),
    "a coarse encoder": ({"pulses": 1, "gear": 1.0, "lead": 0.01}, ("height.pulses = 1",)),
}
CONTRADICTORY |= {
    f"height, {name}": (DESCENDS, {f"height.{field}": value for field, value in changes.items()}, keys)
    for name, (changes, keys) in OF_HEIGHT.items()
}


def changed(settings: RigSettings, changes: dict[str, Any]) -> RigSettings:
    for name, value in changes.items():
        section, _, field = name.rpartition(".")
        if section:
            settings = with_value(settings, section, field, value)
        else:
            settings = dataclasses.replace(settings, **{field: value})
    return settings


@pytest.mark.parametrize("name", CONTRADICTORY)
def test_a_contradiction_is_refused_with_both_keys(tmp_path: Path, name: str) -> None:
    settings, changes, keys = CONTRADICTORY[name]
    file = tmp_path / "rig.toml"
    file.write_text(to_toml(settings))
    read_rig_file(file)
    file.write_text(to_toml(changed(settings, changes)))
    with pytest.raises(ValueError, match=r"rig\.toml") as caught:
        read_rig_file(file)
    for key in keys:
        assert key in str(caught.value)


def test_a_calibration_of_today_is_read(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(to_toml(with_value(USUAL, "calibration", "date", date.today().isoformat())))
    read_rig_file(file)
    tomorrow = date.today() + timedelta(days=1)
    file.write_text(to_toml(with_value(USUAL, "calibration", "date", tomorrow.isoformat())))
    with pytest.raises(ValueError, match="in the future"):
        read_rig_file(file)


def test_a_limit_that_is_lowered_to_nothing_is_refused_before_anything_is_connected() -> None:
    with pytest.raises(ValueError, match=r"limits\.high_mm = 0: the shortest cut"):
        RigCutEnv(rig="fake", lower_limits={"high": 0.0})


def test_a_lower_norm_lowers_the_force_of_an_axis_with_it() -> None:
    limits = USUAL.limits.lowered(force_norm=5.0)
    assert (limits.force, limits.force_norm) == (5.0, 5.0)
    limits = USUAL.limits.lowered(force_norm=5.0, force=4.0)
    assert (limits.force, limits.force_norm) == (4.0, 5.0)
    with pytest.raises(ValueError, match="may only be lower"):
        USUAL.limits.lowered(force_norm=5.0, force=16.0)


def test_a_cut_beyond_the_travel_is_refused_before_anything_moves() -> None:
    with closing(RigCutEnv(rig="fake", target_length=0.08, lower_limits={"high": 0.085})) as env:
        with pytest.raises(ValueError, match=r"target_length = 0\.08 m: .* limits\.high_mm = 85\. .* 0\.075 m or less"):
            env.reset(seed=1)
        env.reset(seed=1, options={"target_length": 0.075})


def cut_on_a_fake(settings: RigSettings) -> None:
    """Prepare, lay a specimen, and cut in it for a second as fast as actions may; then end the cut."""
    settings = dataclasses.replace(settings, emulated=True, calibration=USUAL.calibration)
    specimen = Specimen.drawn(3, 0)
    rig = FakeRig(lambda settings: AirPlant(settings, start=0.0), settings, depth=specimen.depth)

    class Supply:
        def mount(self, key: SpecimenKey) -> None:
            rig.mount(functools.partial(SpecimenPlant, MountedSpecimen(specimen=specimen)))

    with RigSession(rig.plant, AutomaticOperator(settings), Supply(), today=date(2026, 3, 1)) as session:
        session.next_cut(SpecimenKey(seed=3, episode=0), settings.fixed_angle)
        session.start()
        turned = settings.fixed_angle if settings.angle is None else math.radians(70.0)
        for _ in range(50):
            rig.plant.advance(0.0254, turned, 20)
        session.end_cut()
        if (report := rig.plant.supervisor.report) is not None:
            raise RigStopped(report, np.zeros(0))


@hypothesis_settings(max_examples=15, deadline=None)
@given(settings=with_surprises())
@example(settings=USUAL)
@example(settings=FREE)
def test_what_is_accepted_can_be_cut_with(settings: RigSettings) -> None:
    settings = with_value(settings, "sensor", "rate", FakeSensor.rate)  # a fake reads no other
    assume(not list(contradictions(settings)))
    try:
        cut_on_a_fake(settings)
    except RigStopped as stop:
        report, limits = stop.report, settings.limits
        assert report.cause is Cause.FORCE, (settings, report)
        assert limits.force < 10.0 * settings.calibration.gain, (settings, report)  # less than the tissue takes


AT_THE_EDGE: dict[str, dict[str, Any]] = {
    "slow samples, gentle stop": {"bus.sync": 0.010, "limits.stale_motion": 0.025, "blade.quick_stop": 0.16},
    "short travel, low speed": {"limits.high": 0.030, "limits.speed": 0.0155, "limits.following": 0.0009},
}


@pytest.fixture(scope="module")
def emulator() -> Iterator[RunningEmulator]:
    with start(free_air=True) as running:
        yield running


@pytest.mark.parametrize("name", AT_THE_EDGE)
def test_what_is_accepted_can_be_cut_with_on_the_emulator(tmp_path: Path, name: str, emulator: RunningEmulator) -> None:
    file = tmp_path / "rig.toml"
    settings = dataclasses.replace(emulator.settings, depth_profile=USUAL.depth_profile)
    file.write_text(to_toml(changed(settings, AT_THE_EDGE[name])))
    with closing(CuttingRig(read_rig_file(file), emulator.control)) as rig:
        for attempt in range(ATTEMPTS):
            rig.begin(attempt)
            report = rig.cut(0.5)
            if report is None:
                return
            assert rig.host.stalls, report  # a busy host may stop it, and nothing else
    pytest.fail(f"{ATTEMPTS} times the host stalled: {report}")
