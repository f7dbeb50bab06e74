"""``cutenv rig check`` tells what is wrong with a rig, and neither powers nor moves it."""

from __future__ import annotations

import dataclasses
import json
from contextlib import closing
from datetime import date
from pathlib import Path

import pytest

from cutenv.commands import cli
from cutenv.commands.rig.check import as_json, lines
from cutenv.emulation.fake_benches import AirPlant
from cutenv.emulation.fake_rig import FakeRig, Faults
from cutenv.emulation.process import start
from cutenv.rig.config.settings import fake_settings
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.operation.preflight import SETTLE, Inspection, inspect
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.spine import Spine
from cutenv.rig.toml_file import to_toml


def inspected(**faults: object) -> Inspection:
    rig = FakeRig(AirPlant, fake_settings())
    rig.plant.open()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    for name, value in faults.items():
        assert hasattr(Faults(), name)
        setattr(rig.faults, name, value)
    found = inspect(rig.plant, date.today())
    assert rig.blade.state is DriveState.DISABLED
    assert rig.blade.target == 0.0
    return found


def failed(found: Inspection) -> set[str]:
    return {check.name for check in found.checks if not check.passed}


def test_a_rig_that_is_well_passes_every_check() -> None:
    found = inspected()
    assert failed(found) == set()
    assert found.devices["sensor"]["measured_rate_Hz"] == pytest.approx(1000.0, rel=0.01)
    assert found.devices["sensor"]["noise_x_N"] == pytest.approx(0.023, abs=0.01)
    assert found.devices["blade"]["heartbeat_period_ms"] == pytest.approx(50.0, rel=0.05)
    assert found.devices["blade"]["limit_speed_m_s"] == 0.0381
    assert any("stands 73.5 mm from the clamp" in line for line in lines(found))


def test_a_drive_whose_zero_nobody_has_set_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    about = Spine.about
    for told, fails in (("yes", set()), ("no: put the blade at the clamp", {"blade zero"})):
        monkeypatch.setattr(Spine, "about", lambda spine, told=told: {**about(spine), "blade": {"zero_set": told}})
        found = inspected()
        assert failed(found) == fails
        assert any("'cutenv rig zero' sets it" in line for line in lines(found)) == (not fails)


@pytest.mark.parametrize(
    ("fault", "value", "check"),
    [
        ("lose_every", 2, "force packets lost"),
        ("force_silent", True, "force rate"),
        ("force_frozen", True, "force changes"),
        ("force_status", 1 << 31, "force status"),
        ("side_force", 1.0, "zero force"),
        ("motion_silent", True, "blade samples"),
        ("heartbeat_silent", True, "blade heartbeat"),
    ],
)
def test_what_is_wrong_fails_a_check_with_its_cure(fault: str, value: object, check: str) -> None:
    found = inspected(**{fault: value})
    assert check in failed(found)
    (line,) = (line for line in lines(found) if "FAIL" in line and check in line)
    assert check != "force packets lost" or "cable" in line


def test_the_inspection_is_json() -> None:
    told = json.loads(json.dumps(as_json(inspected(heartbeat_silent=True))))
    assert told["passed"] is False
    assert {check["name"] for check in told["checks"] if not check["passed"]} == {"blade heartbeat", "angle heartbeat"}


def test_the_command_passes_a_fake_rig(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "check", "fake", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"] is True
    assert cli.main(["rig", "check", "fake"]) == 0
    shown = capsys.readouterr().out
    assert "checks pass" in shown
    assert "FAIL" not in shown


def test_a_rig_that_another_program_has_is_told_and_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rig.toml"
    with start(free_air=True) as emulator:
        settings = dataclasses.replace(emulator.settings, depth_profile=((0.0, 0.01), (0.15, 0.01)))
        file.write_text(to_toml(settings))
        with closing(rig_plant(settings)) as plant:
            plant.open()
            plant.power()
            assert cli.main(["rig", "check", str(file)]) == 1  # of another process: each rig has its spine's
            checked = capsys.readouterr().out
            assert "FAIL connection" in checked
            assert "another master is on the CAN bus" in checked
            told = plant.clock.now()
            while plant.supervisor.newest_force is None or plant.supervisor.newest_force.time < told:
                assert plant.clock.now() < told + 10.0, "its sensor was taken away"
                plant.clock.sleep_until(plant.clock.now() + 0.01)
            # On a busy host a drive may have stopped by itself, for want of our heartbeat; nobody commanded it.
            report = plant.supervisor.report
            assert report is None or report.cause is not Cause.FOREIGN
        cli.main(["rig", "check", str(file)])
        alone = capsys.readouterr().out
        assert "ok   blade axis" in alone, alone  # else a busy host may have gaps in its streams


def test_a_file_that_is_not_there_is_no_failed_check(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "check", str(tmp_path / "none.toml")]) == 2
    assert "no such file" in capsys.readouterr().err
