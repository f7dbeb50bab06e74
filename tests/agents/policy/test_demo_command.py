"""``cutenv demo``: a shipped agent beside the best script, a picture, a page; nothing trained, no torch."""

from __future__ import annotations

import math
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("safetensors", reason="trained policies are an extra: pip install 'cutenv[view]'")
pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from cutenv.agents.policy import BASELINES, shipped
from cutenv.commands import cli
from cutenv.commands.demo import UNSEEN, DemoSpecimens, demo_cuts

ROW = re.compile(r"^  (\S.*?)((?: +-?\d+\.\d\d){5})(?:  \w+)?$", re.MULTILINE)


def rows(shown: str) -> list[tuple[str, list[float]]]:
    return [(name, [float(number) for number in numbers.split()]) for name, numbers in ROW.findall(shown)]


def test_the_means_are_those_of_the_specimens_and_a_picture_is_written(tmp_path, capsys):
    out = tmp_path / "cut.png"
    assert cli.main(["demo", "--specimens", "2", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert printed.count("force_limit") == 2, "both fail at the second specimen, and it is told how"
    assert "cutenv evaluate ppo-free 'return stroke' --specimen-class mixed\n" in printed
    shown = rows(printed)
    first, second, mean = shown[:2], shown[2:4], shown[4:]
    for k, name in enumerate(("ppo-free", "return stroke")):
        assert {first[k][0], second[k][0], mean[k][0]} == {name}
        halves = [(a + b) / 2.0 for a, b in zip(first[k][1], second[k][1], strict=True)]
        assert mean[k][1] == pytest.approx(halves, abs=0.011)
    assert out.read_bytes().startswith(b"\x89PNG")


def test_of_many_specimens_the_first_are_listed_and_all_are_in_the_means(tmp_path, capsys):
    assert cli.main(["demo", "--specimens", "7", "--out", str(tmp_path / "cut.png")]) == 0
    printed = capsys.readouterr().out
    assert "specimen 5:" in printed
    assert "specimen 6:" not in printed
    assert "mean of all 7\n" in printed
    assert len(rows(printed)) == 2 * 5 + 2


def test_an_agent_of_another_task_cuts_beside_that_tasks_script(tmp_path, capsys):
    out = tmp_path / "cut.png"
    line = ["demo", "--policy", "ppo-excision", "--specimens", "2", "--out", str(out)]
    assert cli.main(line) == 0
    printed = capsys.readouterr().out
    assert "mean distance to the line [mm]" in printed
    shown = rows(printed)
    assert [name for name, _ in shown] == ["ppo-excision", "excision by force"] * 3
    assert all(numbers[2] > 0.0 for _, numbers in shown)
    height, width = (int.from_bytes(out.read_bytes()[at : at + 4], "big") for at in (20, 16))
    assert height > width  # both cuts, one above the other
    assert cli.main([*line, "--page", str(tmp_path / "cut.html")]) == 2
    assert "--page shows gentle cutting" in capsys.readouterr().err


def test_the_page_shows_the_first_specimen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("meshcat", reason="the 3-D viewer is an extra: pip install 'cutenv[view3d]'")
    page = tmp_path / "cut.html"
    assert cli.main(["demo", "--specimens", "1", "--out", str(tmp_path / "cut.png"), "--page", str(page)]) == 0
    assert "ppo-free, specimen 1" in page.read_text(encoding="utf-8")
    assert f"page: {page}" in capsys.readouterr().out


def test_a_seed_draws_the_same_cut_again_and_another_draws_another() -> None:
    policy = shipped("ppo-free")
    same = [
        demo_cuts(policy, policy.environment_arguments, DemoSpecimens({"specimen_class": "liver"}, UNSEEN + seed, 1))[0]
        for seed in (0, 0, 1)
    ]
    assert same[0].reward == same[1].reward != same[2].reward


def test_agent_and_script_meet_the_same_specimens() -> None:
    policy = shipped("ppo-free")
    agent = demo_cuts(policy, policy.environment_arguments, DemoSpecimens({"specimen_class": "mixed"}, UNSEEN, 2))
    script = demo_cuts(BASELINES["fast then slow"](), {}, DemoSpecimens({"specimen_class": "mixed"}, UNSEEN, 2))
    for one, other in zip(agent, script, strict=True):
        assert (one.target_length, one.specimen_class) == (other.target_length, other.specimen_class)
        assert (one.plant.depth == other.plant.depth).all()
        assert math.isfinite(one.reward)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--policy", "ppo-fre"], "neither shipped"),
        (["--specimens", "0"], "--specimens = 0 is outside 1"),
        (["--seed", "-1"], "--seed = -1 is outside 0"),
        (["--out", "a_file/cut.png"], "is a file; give a folder"),
        (["--page", "a_file/cut.html"], "is a file; give a folder"),
    ],
)
def test_bad_options_are_refused_before_anything_is_cut(options, told, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a_file").touch()
    assert cli.main(["demo", *options]) == 2
    captured = capsys.readouterr()
    assert told in captured.err
    assert captured.out == ""


def test_the_demo_loads_no_learning_library(tmp_path: Path) -> None:
    code = (
        "import sys; from cutenv.commands import cli\n"
        f"assert cli.main(['demo', '--specimens', '1', '--out', {str(tmp_path / 'cut.png')!r}]) == 0\n"
        "assert not {'torch', 'stable_baselines3', 'minari'} & set(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
