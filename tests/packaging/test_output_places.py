"""A place for output that cannot be written is found before the work whose result would go there."""

from __future__ import annotations

import importlib
import os
from pathlib import Path

import pytest

from cutenv._base.output import check_writable
from cutenv.commands import cli

COMMANDS = {
    "demo": (["demo"], "cutenv.commands.demo:demo_cuts"),
    "demo, page": (["demo", "--page", "LOCKED/x.html", "--out", "FREE/x.png"], "cutenv.commands.demo:demo_cuts"),
    "evaluate": (["evaluate", "nothing", "--out", "LOCKED"], "cutenv.agents.learning.evaluation:evaluate"),
    "train": (["train", "--quick"], "cutenv.agents.learning.arguments:LearnerArguments.training_environments"),
    "datasets": (["datasets", "--dataset", "cutenv/x-v0", "--policy", "nothing"], "cutenv.commands.datasets:cuts_of"),
    "convert": (["convert", "FREE/a.csv", "--out", "LOCKED/b.csv"], "cutenv.records:read_record"),
    "record": (
        ["record", "--stream", "x", "--map", "force=f", "--out", "LOCKED/b.csv"],
        "cutenv.records.foreign.lsl:LslInlet",
    ),
    "calibrate": (["calibrate", "FREE/a.csv", "--out", "LOCKED/t.json"], "cutenv.commands.calibrate:read_records"),
    "score": (["score", "FREE/a.csv"], "cutenv.commands.inputs:read_records"),
    "score, example": (["score", "--example", "--out", "LOCKED"], "cutenv.commands.score:_example"),
    "study": (["study", "FREE", "--out", "LOCKED/s.html"], "cutenv.commands.studied_cuts:read_records"),
    "pass-mark": (
        ["pass-mark", "FREE", "--passing", "e", "--out", "LOCKED/s.html"],
        "cutenv.commands.studied_cuts:read_records",
    ),
    "view": (["view", "FREE/a.csv"], "cutenv.commands.view:read_records"),
    "field": (["field", "FREE/t.parquet", "--record", "FREE/a.csv"], "cutenv.vision:BeadTracks.load"),
    "play": (["play"], "cutenv.commands.play:_agent_of"),
    "single-page": (["single-page", "LOCKED/p.html"], "cutenv.commands.single_page:write_page_alone"),
    "serve": (["serve", "LOCKED"], "cutenv.people.classroom.class_store:ClassStore"),
    "serve, backup": (
        ["serve", "FREE/class", "--backup", "LOCKED/b.zip"],
        "cutenv.people.classroom.class_store:ClassStore",
    ),
    "rig run": (["rig", "run", "--policy", "coast", "--rig", "fake"], "cutenv.commands.rig.run:chosen_policy"),
    "rig run, lines": (
        ["rig", "run", "--policy", "coast", "--rig", "fake", "--out", "FREE/cuts", "--json", "LOCKED/x.json"],
        "cutenv.commands.rig.run:chosen_policy",
    ),
    "rig emulate": (["rig", "emulate", "--write", "LOCKED/e.toml"], "cutenv.emulation.process:serve"),
    "rig init": (["rig", "init", "LOCKED/new/r.toml"], "cutenv.commands.rig.init:template"),
    "rig evaluate": (
        ["rig", "evaluate", "--policy", "coast", "--rig", "fake", "--out", "LOCKED/new"],
        "cutenv.agents.sim_to_real.paired_experiment:paired_experiment",
    ),
    "rig identify": (
        ["rig", "identify", "fake", "--picture", "LOCKED/p.png"],
        "cutenv.commands.rig.identify:connected",
    ),
    "rig speed": (["rig", "speed", "simulator", "--picture", "LOCKED/p.png"], "cutenv.commands.rig.speed:_cut"),
}


@pytest.fixture
def locked(tmp_path: Path) -> Path:
    """A folder in which nothing can be made: one without the right to, or for root, whom none stops, that of Linux."""
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    return Path("/proc") if os.access(folder, os.W_OK) else folder


@pytest.mark.parametrize("name", COMMANDS)
def test_it_is_found_before_the_work(name, locked, tmp_path, monkeypatch, capsys):
    arguments, work = COMMANDS[name]
    (tmp_path / "a.csv").write_text("time_s,force_N\n" + "".join(f"{0.01 * k},{k % 7}\n" for k in range(100)))
    monkeypatch.chdir(locked)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(locked))
    importlib.import_module(work.partition(":")[0])  # before anything in it is replaced
    monkeypatch.setattr(work.replace(":", "."), never)
    given = [word.replace("LOCKED", str(locked)).replace("FREE", str(tmp_path)) for word in arguments]
    assert cli.main(given) == 2
    told = capsys.readouterr().err.strip().splitlines()[-1]
    assert told.startswith(f"cutenv {name.partition(',')[0]}: ")
    assert "[Errno" not in told, "a number in place of the option and the cure"
    assert str(locked) in told or " .: " in told or "Permission denied" in told or "cannot be made" in told


def never(*arguments: object, **keywords: object) -> None:
    raise AssertionError("the work has begun")


def test_the_message_names_the_option_the_place_and_the_cure(locked):
    with pytest.raises(OSError, match=rf"--out {locked}: nothing can be written there \(.*\)\. Give another place\."):
        check_writable("--out", locked)


def test_nothing_is_left_where_it_was_tried(tmp_path):
    check_writable("--out", tmp_path)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("out", ["file", "file/below"])
def test_a_file_in_a_folders_place_is_found_too(out, tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    for command, work in (
        (["play"], "cutenv.commands.play._agent_of"),
        (["rig", "run", "--policy", "coast", "--rig", "fake"], "cutenv.commands.rig.run.chosen_policy"),
    ):
        importlib.import_module(work.rpartition(".")[0])
        monkeypatch.setattr(work, never)
        assert cli.main([*command, "--out", str(tmp_path / out)]) == 2
        assert f"--out {tmp_path / 'file'} is a file; give a folder." in capsys.readouterr().err


@pytest.mark.parametrize(
    "command", ["play --picture", "rig identify fake --picture", "rig speed simulator --picture", "demo --out"]
)
def test_a_picture_is_a_png(command, capsys):
    assert cli.main([*command.split(), "cut.xyz"]) == 2
    assert f"{command.split()[-1]} cut.xyz is no PNG. Give a name that ends in .png." in capsys.readouterr().err
