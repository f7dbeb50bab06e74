"""``cutenv rig speed``: desired and actual speed of the blade in tissue, drawn and in numbers."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cutenv.cli import main
from cutenv.recording import load_one
from cutenv.report.speed_figure import SpeedTrial, draw_speeds


def test_a_cut_on_the_fake_rig_holds_its_speed_and_is_drawn_and_recorded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "new" / "speed.png"
    given = ["rig", "speed", "fake", "--speeds", "2.54", "--target-length", "60mm"]
    assert main([*given, "--picture", str(picture), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    found = re.search(r"desired 2\.54 cm/s, actual ([\d.]+) cm/s on average over ([\d.]+) s; .* force up to", printed)
    assert found
    assert float(found[1]) == pytest.approx(2.54, rel=0.01)
    assert float(found[2]) > 1.0
    assert picture.read_bytes().startswith(b"\x89PNG")
    (record,) = tmp_path.glob("*.csv")
    assert load_one(record).speed is not None


@pytest.mark.parametrize("speed", ["0", "3.81", "nan"])
def test_a_speed_that_was_never_measured_is_refused(speed: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rig", "speed", "fake", "--speeds", speed]) == 2
    assert "--speeds" in capsys.readouterr().err


def test_only_what_was_desired_for_a_while_counts_so_a_weak_drive_shows() -> None:
    time = 1e-3 * np.arange(1, 3001)
    desired = np.where(time < 2.0, 0.0127, 0.0)
    actual = np.where((time > 1.0) & (time < 1.1), 0.0027, desired)
    actual[:200] = 0.0  # it starts, which is no failure to hold
    trial = SpeedTrial(time, desired, actual, np.full(3000, 2.0))
    settled = trial.settled(0.0127)
    assert len(settled) == pytest.approx(1700, abs=2)
    assert "greatest difference 1.000 cm/s; force up to 2.0 N" in trial.summary(0.0127)
    assert trial.summary(0.02) == "2.00 cm/s: never held for 0.3 s"


def test_nothing_to_draw_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="there is no cut to draw"):
        draw_speeds(tmp_path / "speed.png", [])
