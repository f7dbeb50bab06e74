"""Cloning: its clock goes on after an interruption, and a data set can be the teacher."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import pytest
from program import rows, run

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")
pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

import safetensors.torch  # noqa: E402

from cutenv.agents.learning import bc  # noqa: E402
from cutenv.agents.learning.arguments import BadArguments, BCArguments  # noqa: E402
from cutenv.agents.learning.run_folder import RunRequest, add_run_options, run_request  # noqa: E402
from cutenv.agents.policy import TrainedPolicy  # noqa: E402

ID = "cutenv/test/fixed-v0"
SOURCE = "fast then slow"
SMALL = BCArguments(
    environments=2, demonstrations=200, epochs=4, validations=1, validation_specimens=2, hidden=8, checkpoint_seconds=0
)


def points(folder: Path) -> list[dict[str, float]]:
    curve = rows(folder / "learning_curve.csv")
    return [{name: float(value) for name, value in row.items() if value} for row in curve]


def cloned_for_two_epochs(folder: Path, monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """Leave what an interruption does after two of four epochs, none of which was validated."""
    save = bc.save_checkpoint

    def interrupted(path, clone, cloning, _):
        save(path, clone, cloning, seconds)
        if cloning.epoch == 2:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(bc, "save_checkpoint", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bc.train(RunRequest(SMALL, folder, False), {})


def test_the_clock_goes_on_from_the_checkpoint_not_from_the_last_validation(tmp_path, monkeypatch):
    cloned_for_two_epochs(tmp_path, monkeypatch, seconds=500.0)
    assert not (tmp_path / "learning_curve.csv").exists()
    bc.train(RunRequest(SMALL, tmp_path, True), {})
    (last,) = points(tmp_path)
    assert last["decisions"] == 4 * 200
    assert 2 <= last["cuts"] <= 20  # 100 decisions in each of two environments; every epoch sees the same
    assert 500.0 <= last["seconds"] < 600.0


def test_a_checkpoint_of_an_earlier_version_has_the_time_of_the_curve(tmp_path, monkeypatch):
    cloned_for_two_epochs(tmp_path, monkeypatch, seconds=500.0)
    path = tmp_path / "checkpoint.safetensors"
    safetensors.torch.save_file(safetensors.torch.load_file(path), path, {"epoch": "2"})
    columns = "decisions,seconds,return,success,error,validation_return,validation_success"
    (tmp_path / "learning_curve.csv").write_text(f"{columns}\n200,70.0,0,0,0,0,0\n")
    bc.train(RunRequest(SMALL, tmp_path, True), {})
    assert 70.0 <= points(tmp_path)[-1]["seconds"] < 170.0


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory):
    """Record three cuts of a script as a data set, 20 decisions a second, at a fixed angle."""
    pytest.importorskip("minari", reason="data sets are an extra: pip install 'cutenv[data]'")
    pytest.importorskip("h5py", reason="data sets are an extra: pip install 'cutenv[data]'")
    folder = tmp_path_factory.mktemp("taught")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(folder / "kept"))
        about = ("--cuts", "3", "--specimen-class", "liver", "--control-hz", "20", "--angle-mode", "fixed")
        done = run("datasets", folder, "--dataset", ID, "--policy", SOURCE, *about)
        assert done.returncode == 0, done.stderr
        yield folder


def test_a_data_set_teaches_a_run_like_any_other(recorded: Path):
    small = ("--epochs", "20", "--validations", "2", "--validation-specimens", "4", "--specimens", "2")
    done = run("train --learner bc", recorded, "--name", "taught", "--dataset", ID, "--force", "unfelt", *small)
    assert done.returncode == 0, done.stderr
    assert f"differ from those of data set '{ID}'" in done.stdout
    folder = recorded / "runs" / "taught"
    for name in ("scores.csv", "summary.csv", "differences.csv", "cut.png", "checkpoint.safetensors"):
        assert (folder / name).is_file(), name
    card = TrainedPolicy.load(folder / "policy").card
    assert card.environment_arguments == {"control_hz": 20, "angle_mode": "fixed", "fixed_angle_deg": 90.0}
    assert card.features == {"history": 6, "force": False}
    told = card.training["taught_by"]
    assert told == {"dataset": ID, "source": SOURCE, "cuts": 3, "decisions": told["decisions"]}
    facts = json.loads((folder / "run.json").read_text())
    assert facts["taught_by"] == told
    assert facts["arguments"]["script"] == ""
    assert f"data set {ID}: 3 cuts by {SOURCE}" in (folder / "report.html").read_text()
    first, last = points(folder)
    assert (first["decisions"], last["decisions"]) == (10 * told["decisions"], 20 * told["decisions"])
    assert last["error"] < first["error"] < 0.7


def parsed(*given: str) -> BCArguments:
    parser = argparse.ArgumentParser(allow_abbrev=False)
    add_run_options(parser, BCArguments)
    return run_request(BCArguments, parser.parse_args(["--dataset", ID, *given]), "bc").arguments


def test_rate_and_angle_mode_are_those_of_the_data_set(recorded: Path):
    for given in ((), ("--quick",), ("--control-hz", "20", "--angle-mode", "fixed")):
        arguments = parsed(*given)
        assert (arguments.control_hz, arguments.angle_mode, arguments.script) == (20, "fixed", "")
        data, told = bc.training_data(arguments)
        assert len(data.observations) == told["decisions"] == arguments.demonstrations


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--control-hz", "10"), "--control-hz 10 contradicts .* were made with 20; leave it out"),
        (("--angle-mode", "free"), "--angle-mode free contradicts .* were made with fixed; leave it out"),
        (("--script", "force feedback"), "--script belongs to a script; leave it out"),
        (("--demonstrations", "100"), "--demonstrations belongs to a script; leave it out"),
        (("--dataset", "cutenv/none-v0"), "there is no data set 'cutenv/none-v0' .*; record one"),
    ],
)
def test_what_contradicts_the_data_set_is_refused_before_any_work(recorded: Path, given, said):
    with pytest.raises(BadArguments, match=said):
        parsed(*given)


def test_a_data_set_that_has_changed_is_not_gone_on_with(recorded: Path):
    with pytest.raises(BadArguments, match="not the 7 that this run began with; begin another run"):
        bc.training_data(BCArguments(dataset=ID, demonstrations=7))
