"""``cutenv rig identify`` measures a rig in air, writes its file when told to, and the simulator takes it."""

from __future__ import annotations

import dataclasses
import re
from datetime import date
from pathlib import Path

import gymnasium
import pytest

from cutenv.agents.sim_to_real.identification import APPROACH, Plan, identification_from, perform
from cutenv.commands import cli
from cutenv.emulation.fake_benches import AirPlant
from cutenv.emulation.fake_rig import FakeRig
from cutenv.rig.config.settings import Identified, RigSettings, fake_settings
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import SETTLE, prepare
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.rig.toml_file import read_rig_file, to_toml, write_identified
from cutenv.sim.cutting.drive import Rig

DEPTH = ((0.0, 0.02), (0.149, 0.02))


def prepared(drive: Rig, settings: RigSettings | None = None) -> FakeRig:
    rig = FakeRig(lambda settings: AirPlant(settings, drive=drive), settings or fake_settings())
    rig.plant.open()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    prepare(rig.plant, AutomaticOperator(rig.settings), today=date.today())
    return rig


def brief(plan: Plan) -> Plan:
    """The plan without what the test is not about."""
    return dataclasses.replace(plan, turns=3, rest=6.0, sines=plan.sines[2:3])


def file_of(path: Path, identified: Identified | None = None) -> Path:
    settings = RigSettings(armed_by="a test", depth_profile=DEPTH, identified=identified or Identified())
    settings = dataclasses.replace(settings, calibration=dataclasses.replace(settings.calibration, date="2026-01-01"))
    path.write_text(to_toml(settings), encoding="utf-8")
    return path


def test_the_experiment_finds_the_drive_of_a_rig_and_brings_the_blade_back() -> None:
    rig = prepared(Rig(motor_lag=0.055, dead_time=0.006))
    before = rig.plant.position
    plan = dataclasses.replace(Plan.within(rig.settings, before), turns=3, rest=10.0)
    found = identification_from(rig.settings, plan, perform(rig.plant, plan))
    assert found["motor_lag"].value == pytest.approx(0.055, rel=0.05)
    assert found["dead_time"].value == pytest.approx(0.006, abs=0.002)
    assert found["acceleration"].value == pytest.approx(0.1, rel=0.05)
    assert found["force_noise"].value == pytest.approx(0.02, rel=0.1)
    assert found["force_resolution"].value == pytest.approx(0.05)
    assert found["backlash"].value is None
    assert rig.plant.position == pytest.approx(before, abs=1e-4)
    assert rig.plant.witness is None
    assert rig.plant.supervisor.phase == "ready"


def test_a_rig_slower_than_the_way_back_to_its_start_is_measured_too() -> None:
    settings = fake_settings()
    slow = dataclasses.replace(settings, limits=dataclasses.replace(settings.limits, speed=0.8 * APPROACH))
    rig = prepared(Rig(), slow)
    before = rig.plant.position
    plan = brief(dataclasses.replace(Plan.within(rig.settings, before), start=before - 0.01))
    assert len(perform(rig.plant, plan).steps) == 2 * len(plan.speeds)
    assert rig.plant.position == pytest.approx(before, abs=1e-4)


def test_something_in_the_way_stops_the_experiment() -> None:
    rig = prepared(Rig())
    plan = brief(Plan.within(rig.settings, rig.plant.position))

    def push(message: str) -> None:
        if message.startswith("steps"):
            rig.faults.ramp = 5.0

    with pytest.raises(RigStopped) as stop:
        perform(rig.plant, plan, tell=push)
    assert stop.value.report.cause is Cause.FORCE
    assert rig.plant.supervisor.standing


def test_what_was_measured_before_this_computer_was_late_is_kept() -> None:
    rig, told = prepared(Rig()), []
    plan = brief(Plan.within(rig.settings, rig.plant.position))

    def tell(message: str) -> None:
        told.append(message.partition(" ")[0])
        rig.faults.force_silent = told.count("sines") == 1 and message.startswith("sines")

    def again(stop: RigStopped) -> None:
        assert stop.report.cause is Cause.FORCE_STALE
        rig.faults.force_silent = False
        rig.clock.sleep_until(rig.clock.now() + SETTLE)
        rig.plant.supervisor.reset(agreed=True)
        prepare(rig.plant, AutomaticOperator(rig.settings), today=date.today())

    recorded = perform(rig.plant, plan, tell=tell, again=again)
    assert told == ["move", "sensor", "3", "steps", "sines", "stopped", "move", "sines"]
    assert (len(recorded.steps), len(recorded.sines), len(recorded.felt)) == (2 * len(plan.speeds), 1, 1)
    found = identification_from(rig.settings, plan, recorded)
    assert found["motor_lag"].value == pytest.approx(0.040, rel=0.05)


def test_the_command_prints_a_table_and_draws_a_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Plan.within
    monkeypatch.setattr(Plan, "within", lambda *given: brief(whole(*given)))
    picture = tmp_path / "fake.png"
    assert cli.main(["rig", "identify", "fake", "--picture", str(picture)]) == 0
    shown = capsys.readouterr().out
    assert "motor_lag [ms]" in shown
    assert "phase error" in shown
    assert not re.search(r"\de\+\d", shown), "tens of thousands are written out"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_what_has_no_file_cannot_be_written(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "identify", "fake", "--write"]) == 2
    assert "needs a rig's file" in capsys.readouterr().err


def test_the_simulator_takes_what_was_identified(tmp_path: Path) -> None:
    path = file_of(tmp_path / "rig.toml")
    found = Identified(date="2026-03-01", motor_lag=0.055, dead_time=0.006, backlash=80e-6, friction=20.0)
    write_identified(path, found)
    assert read_rig_file(path).identified == found
    constants = gymnasium.make("cutenv/GentleCut-v1", rig=str(path)).unwrapped.constants
    assert constants.drive == Rig(motor_lag=0.055, dead_time=0.006, backlash=80e-6)


def test_a_given_keyword_wins_over_the_rig_s_file(tmp_path: Path) -> None:
    path = file_of(tmp_path / "rig.toml", Identified(motor_lag=0.055, dead_time=0.006))
    constants = gymnasium.make("cutenv/GentleCut-v1", rig=str(path), motor_lag=0.020).unwrapped.constants
    assert constants.drive == Rig(motor_lag=0.020, dead_time=0.006)


@pytest.mark.parametrize(
    ("identified", "keywords", "message"),
    [
        (Identified(), {}, "nothing in it was identified yet"),
        (Identified(dead_time=0.09), {}, r"\[identified\] dead_time"),
        (Identified(motor_lag=0.05), {"drive": "hand"}, "is for a motor"),
    ],
)
def test_a_file_that_says_nothing_usable_is_refused(
    tmp_path: Path, identified: Identified, keywords: dict[str, str], message: str
) -> None:
    path = file_of(tmp_path / "rig.toml", identified)
    with pytest.raises(ValueError, match=message):
        gymnasium.make("cutenv/GentleCut-v1", rig=str(path), **keywords)


def test_a_rig_that_tells_its_position_too_seldom_is_refused_before_it_is_connected(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["rig", "identify", "grbl"]) == 2
    assert "every 100 ms, too seldom" in capsys.readouterr().err
