"""``cutenv rig init`` writes a rig's file once, and never over another."""

from __future__ import annotations

from pathlib import Path

import pytest

from cutenv import cli
from cutenv.rig.toml_file import read_rig_file
from cutenv.rig.toml_text import template


def test_a_new_file_is_the_template_with_the_rig_s_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bench.toml"
    assert cli.main(["rig", "init", str(path), "--name", 'bench "2"']) == 0
    assert path.read_text(encoding="utf-8") == template('bench "2"')
    assert "nothing moves while armed_by is empty" in capsys.readouterr().out
    with pytest.raises(ValueError, match="only a person can supply"):
        read_rig_file(path)


def test_a_new_file_of_a_slow_rig_tells_all_missing_lines_at_once_and_has_no_section_of_other_drives(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slow.toml"
    cli.main(["rig", "init", str(path), "--profile", "serial"])
    assert "[height]" not in path.read_text(encoding="utf-8")
    capsys.readouterr()
    assert cli.main(["rig", "check", str(path)]) == 2
    told = capsys.readouterr().err
    for line in ("depth_profile", "blade.lead_mm", "blade.options.port", "blade.options.steps", "sensor.options.port",
                 "sensor.options.counts_per_N", "calibration.date"):  # fmt: skip
        assert line in told


def test_without_a_name_the_rig_is_called_as_its_file(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    cli.main(["rig", "init", str(path)])
    assert path.read_text(encoding="utf-8") == template("bench")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("mine.toml", "is there already, and is left"),
        ("rig.txt", "must end in .toml"),
        ("gone/rig.toml", "No such file"),
    ],
)
def test_nothing_is_written_where_it_should_not_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str
) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("mine")
    assert cli.main(["rig", "init", str(tmp_path / name)]) == 2
    assert message in capsys.readouterr().err
    assert mine.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [mine]


def test_help_lists_the_commands_of_the_rig(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["rig", "--help"])
    shown = capsys.readouterr().out
    assert all(name in shown and command.summary in shown for name, command in cli.RIG_COMMANDS.items())


def test_an_unknown_command_of_the_rig_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["rig", "ini"])
    assert "init" in capsys.readouterr().err
