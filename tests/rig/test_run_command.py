"""``cutenv rig run``: a policy from simulation on a rig, unchanged, within limits that may only be lowered."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import pytest

from cutenv.commands.cli import main
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.rig.config.settings import fake_settings
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import to_toml


def run(*arguments: str) -> int:
    return main(["rig", "run", *arguments])


def fixed_rig(folder: Path, degrees: float = 75.0) -> str:
    """The file of a rig whose blade is set by hand."""
    settings = fake_settings(
        name="bench 2", angle_mode="fixed", angle=None, fixed_angle=math.radians(degrees), emulated=False,
        depth_profile=((0.0, 0.02), (0.15, 0.02)),
    )  # fmt: skip
    file = folder / "rig.toml"
    file.write_text(to_toml(settings))
    return str(file)


def test_a_shipped_policy_cuts_and_everything_is_told(tmp_path, capsys):
    told = tmp_path / "told.jsonl"
    pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[view]'")
    arguments = ("--policy", "ppo-free", "--rig", "fake", "--target-length", "40mm", "--out", str(tmp_path))
    status = run(*arguments, "--cuts", "2", "--json", str(told))
    assert status == 0
    lines = [json.loads(line) for line in told.read_text().splitlines()]
    assert [line["episode"] for line in lines] == [0, 1]
    for line in lines:
        trace = load_one(line["record"])
        assert trace.metadata["end"] == line["end"]
        assert trace.duration == pytest.approx(line["time_s"], abs=0.11)
        assert line["stop"] is None
    printed = capsys.readouterr().out
    assert printed.count("in full: cutenv score") == 2


def test_it_needs_no_torch(tmp_path):
    pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[view]'")
    code = (
        "import sys; from cutenv.commands.cli import main; "
        "arguments = ['--policy', 'ppo-free', '--rig', 'fake', '--target-length', '30mm']; "
        f"status = main(['rig', 'run', *arguments, '--out', {str(tmp_path)!r}]); "
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules); sys.exit(status)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


def test_a_policy_with_a_free_angle_is_refused_on_a_rig_set_by_hand(tmp_path, capsys):
    pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[view]'")
    assert run("--policy", "ppo-free", "--rig", fixed_rig(tmp_path), "--out", str(tmp_path)) == 2
    error = capsys.readouterr().err
    assert "set by hand, at 75 degrees" in error
    assert 'angle_mode="fixed"' in error
    assert not list(tmp_path.glob("*.csv"))


def test_a_shipped_policy_cuts_on_a_rig_set_by_hand_where_the_blade_stands_as_in_its_training(tmp_path, capsys):
    pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[view]'")
    upright = fixed_rig(tmp_path, 90.0)
    assert run("--policy", "ppo-fixed", "--rig", upright, "--dry-run", "1") == 0
    assert "the cut, on a drawn specimen" in capsys.readouterr().out
    assert run("--policy", "ppo-fixed", "--rig", fixed_rig(tmp_path, 75.0), "--dry-run", "1") == 2
    assert "is set to 75.0 degrees. Turn it" in capsys.readouterr().err


def test_hardware_asks_a_person_and_without_a_terminal_nothing_is_connected(tmp_path, capsys):
    arguments = ("--policy", "fast then slow", "--rig", fixed_rig(tmp_path), "--out", str(tmp_path))
    assert run(*arguments) == 2
    assert "terminal" in capsys.readouterr().err


def test_a_dry_run_connects_to_nothing_and_prints_the_frames(tmp_path, capsys):
    status = run("--policy", "fast then slow", "--rig", fixed_rig(tmp_path, 60.0), "--dry-run", "0.5")
    printed = capsys.readouterr().out
    assert status == 0
    assert "nothing was connected, nothing was sent" in printed
    cut = printed.partition("the cut, on a drawn specimen")[2]
    # 1.9 cm/s through a lead of 2 mm and a gear of 4.4 are 2508 rpm: 2,508,000 milli-rpm, little endian.
    assert "201#0F 00 E0 44 26 00 03" in cut
    assert "202#" not in printed


def test_limits_may_only_be_lower(tmp_path, capsys):
    assert run("--policy", "fast then slow", "--rig", "fake", "--force-limit-N", "20", "--out", str(tmp_path)) == 2
    assert "only be lower" in capsys.readouterr().err
    status = run("--policy", "fast then slow", "--rig", "fake", "--force-limit-N", "1.5", "--out", str(tmp_path))
    printed = capsys.readouterr().out
    assert status == 3  # somebody has to look at it
    assert "STOPPED, force limit" in printed
    assert "at rest" in printed


def test_a_lower_speed_slows_every_command_down(tmp_path, capsys):
    arguments = ("--policy", "fast then slow", "--rig", "fake", "--out", str(tmp_path), "--target-length", "60mm")
    assert run(*arguments, "--speed-limit-cm-s", "1") == 0
    (record,) = tmp_path.glob("*.csv")
    assert load_one(record).speed.max() < 0.01


@pytest.mark.parametrize(
    ("policy", "named"),
    [
        ("planner with truth", "hidden state, which no rig knows"),
        ("ppo-fre", "Did you mean 'ppo-free'"),
        ("fast than slow", "Did you mean 'fast then slow'"),
        ("constant 0.6 cm/s", "Did you mean 'constant 2.16 cm/s 90 deg' or "),
    ],
)
def test_policies_that_cannot_be_are_named(policy, named, tmp_path, capsys):
    assert run("--policy", policy, "--rig", "fake", "--out", str(tmp_path)) == 2
    said = capsys.readouterr().err
    assert named in said
    assert len(said) < 250


def test_a_rig_that_is_no_file_says_how_to_write_one(tmp_path, capsys):
    assert run("--policy", "fast then slow", "--rig", "nowhere.toml", "--out", str(tmp_path)) == 2
    assert "cutenv rig init" in capsys.readouterr().err


def test_a_policy_of_ones_own_cuts_too(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_policy.py").write_text(
        "import time\n"
        "import numpy as np\n"
        "class Steady:\n"
        "    def reset(self, rng): pass\n"
        "    def __call__(self, observation):\n"
        "        time.sleep(0.021)\n"
        "        return np.array([1.0, 1.0], np.float32)\n"
    )
    monkeypatch.chdir(tmp_path)
    assert run("--policy", "my_policy:Steady", "--rig", "fake", "--out", str(tmp_path), "--target-length", "30mm") == 0
    printed = capsys.readouterr()
    assert "cut 1:" in printed.out
    assert "commands more than 2 ms late" not in printed.out  # the fake's clock stands while a policy decides
    assert "ms a decision, and has 20 ms: on a rig it is late" in printed.err
    assert printed.err.startswith("loading my_policy:Steady ...\n")  # before a module that may take long
    assert run("--policy", "my_policy:Stedy", "--rig", "fake", "--out", str(tmp_path)) == 2
    assert "MODULE:CLASS" in capsys.readouterr().err


def test_an_angle_that_nobody_turns_is_said_to_be_ignored(tmp_path, capsys):
    assert run("--policy", "90-45-90", "--rig", fixed_rig(tmp_path), "--out", str(tmp_path)) == 2  # no terminal here
    assert "set by hand, at 75 degrees: angles that the policy asks for are ignored" in capsys.readouterr().out


def test_who_ends_the_program_ends_all_its_cuts(tmp_path, monkeypatch, capsys):
    told = tmp_path / "told.jsonl"
    step = RigCutEnv.step

    def interrupted(env, action):
        if env.cutting.time > 1.0:
            env.session.plant.supervisor.trip(Cause.INTERRUPTED, "SIGTERM")
        return step(env, action)

    monkeypatch.setattr(RigCutEnv, "step", interrupted)
    kept = ["--out", str(tmp_path), "--json", str(told)]
    assert run("--policy", "probe and creep", "--rig", "fake", "--cuts", "5", *kept) == 130
    (line,) = [json.loads(line) for line in told.read_text().splitlines()]
    assert line["stop"]["cause"] == "interrupted"
