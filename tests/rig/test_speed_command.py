"""``cutenv rig speed``: desired beside actual speed of simulator, rigs without hardware, and records."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cutenv.commands import cli
from cutenv.records import save
from cutenv.records.measurement import speed_tracking
from cutenv.sim.cutting.drive import PDRig, Rig
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant import SimulatedPlant, to_trace
from cutenv.sim.tissue import Specimen
from cutenv.sim.trace import Trace

SPEED = 0.0127
SOFT = PDRig(proportional_gain=20e3, derivative_gain=3e3)


def cut(drive: Rig | PDRig) -> Trace:
    plant = SimulatedPlant(Specimen.drawn(3, 0), drive=drive, sensor=SensorParameters(force_noise=0.0))
    readings = [
        plant.advance(speed, np.pi / 2, ticks).copy() for speed, ticks in ((0.0, 200), (SPEED, 5000), (0.0, 400))
    ]
    return to_trace(plant, np.concatenate(readings))


def test_a_velocity_loop_that_holds_position_keeps_the_desired_speed():
    found = speed_tracking(cut(Rig()), SPEED)
    assert found.mean == pytest.approx(SPEED, rel=1e-3)
    assert found.worst_error <= 0.02 * SPEED + 1e-9  # where the steady part begins and ends
    assert np.all(found.desired[found.steady] == SPEED)
    assert np.all(found.desired[:200] == 0.0)


def test_the_softer_pd_control_is_the_more_the_actual_speed_departs():
    stiff, soft = speed_tracking(cut(PDRig()), SPEED), speed_tracking(cut(SOFT), SPEED)
    runs = slice(1500, 3500)  # without start and end
    off = [np.abs(found.actual[found.steady][runs] - SPEED).max() for found in (stiff, soft)]
    assert off[1] > 3.0 * off[0]
    assert soft.mean == pytest.approx(SPEED, rel=0.01)


def test_a_record_without_speed_is_read_from_its_positions():
    trace = dataclasses.replace(cut(Rig()), speed=None)
    assert speed_tracking(trace, SPEED).mean == pytest.approx(SPEED, rel=2e-3)


def test_a_speed_that_was_never_reached_is_refused_with_the_greatest():
    with pytest.raises(
        ValueError, match=r"98 % of the desired 2\.5 cm/s in 0 readings .* greatest speed is 1\.27 cm/s"
    ):
        speed_tracking(cut(Rig()), 0.025)


@pytest.mark.parametrize("source", ["simulator", "fake"])
def test_the_command_draws_a_cut_under_pd_control(source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    picture = tmp_path / "speed.png"
    assert cli.main(["rig", "speed", source, "--drive", "pd", "--picture", str(picture)]) == 0
    assert "mean actual speed   1.27 cm/s" in capsys.readouterr().out
    assert picture.stat().st_size > 10_000


def test_the_command_reads_a_record(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    save([cut(SOFT)], tmp_path / "cut.csv")
    assert cli.main(["rig", "speed", str(tmp_path / "cut.csv"), "--speed-cm-s", "1.27"]) == 0
    assert "desired speed       1.27 cm/s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["cut.csv"], "--speed-cm-s: a record does not hold the desired speed"),
        (["rig.toml"], "a real rig is not moved by this command: 'cutenv rig run --rig rig.toml"),
        (["simulator", "--speed-cm-s", "4"], "--speed-cm-s = 4 cm/s is outside 0.05 to 3.81"),
        (["emulator", "--speed-cm-s", "3"], "--speed-cm-s = 3 cm/s is outside 0.05 to 2.54"),
        (["emulator", "--drive", "hand"], 'rig "emulator" has a motor'),
        (["simulator", "--set", "motor_lag"], "--set 'motor_lag' is no NAME=NUMBER"),
        (["simulator", "--drive", "pd", "--set", "proportional_gian=1e4"], "Did you mean 'proportional_gain'"),
    ],
)
def test_bad_options_are_refused_with_a_cure(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["rig", "speed", *arguments]) == 2
    assert message in capsys.readouterr().err
