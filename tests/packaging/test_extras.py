"""An extra holds what its commands need, and nothing that a hospital would ask about."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from cutenv._base.imports import EXTRAS_OF_MODULE, extra_named
from cutenv._base.output import watched
from cutenv.commands import cli
from scripts.documentation import licences
from scripts.documentation.licences import brought

PROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {name: {Requirement(line).name for line in lines} for name, lines in PROJECT["optional-dependencies"].items()}
CALLED = {
    "PIL": "pillow",
    "can": "python-can",
    "cv2": "opencv-python-headless",
    "pygame": "pygame-ce",
    "python_calamine": "python-calamine",
    "sb3_contrib": "sb3-contrib",
    "serial": "pyserial",
    "stable_baselines3": "stable-baselines3",
    "umsgpack": "meshcat",  # comes with it
}
SERVERS = {"ipython", "pyngrok", "pyzmq", "tornado"}


@pytest.mark.parametrize(
    ("module", "extra"), [(module, extra) for module, extras in EXTRAS_OF_MODULE.items() for extra in extras]
)
def test_the_extra_that_an_error_names_brings_the_module(module: str, extra: str) -> None:
    assert CALLED.get(module, module) in EXTRAS[extra]


@pytest.mark.parametrize("extra", ["view", "play", "rig"])
def test_pictures_play_and_rig_bring_no_server_and_no_tunnel(extra: str) -> None:
    assert not brought(EXTRAS[extra]) & SERVERS


def test_the_page_in_3_d_does_bring_them_so_the_check_can_fail() -> None:
    pytest.importorskip("meshcat", reason="the 3-D viewer is an extra: pip install 'cutenv[view3d]'")
    assert brought(EXTRAS["view3d"]) & SERVERS


def test_a_progress_bar_that_is_not_installed_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "tqdm", None)
    assert list(watched([1, 2, 3], "counting", "number")) == [1, 2, 3]


def test_a_library_of_an_extra_that_is_missing_is_told_with_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "canopen", None)
    with pytest.raises(ModuleNotFoundError, match=re.escape("pip install 'cutenv[rig]'")), extra_named("rig"):
        import canopen  # noqa: F401


def test_a_record_is_scored_without_the_libraries_of_pages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cutenv.commands.score.find_spec", lambda name: None)
    assert cli.main(["score", "--example", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    assert "overall score" in printed.out
    assert "no page: jinja2 and matplotlib are an extra: pip install 'cutenv[view]'" in printed.err
    assert [path.name for path in tmp_path.iterdir()] == ["example.csv"]


@pytest.mark.parametrize("learner", ["ppo", "bc", "iql"])
@pytest.mark.parametrize(("package", "options"), [("tensorboard", "--tensorboard"), ("matplotlib", "--specimens 2")])
def test_a_training_misses_what_it_will_need_before_it_begins(
    learner: str, package: str, options: str, tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("cutenv._base.imports.find_spec", lambda name: None if name == package else name)
    assert cli.main(["train", "--learner", learner, "--quick", *options.split()]) == 1
    assert f"{package} is not installed: pip install 'cutenv[rl]'" in capsys.readouterr().err
    assert not (tmp_path / "runs").exists()


def test_the_demo_misses_the_library_of_its_page_before_it_cuts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("cutenv._base.imports.find_spec", lambda name: None)
    assert cli.main(["demo", "--page", str(tmp_path / "cut.html"), "--out", str(tmp_path / "cut.png")]) == 1
    printed = capsys.readouterr()
    assert "pip install 'cutenv[view3d]'" in printed.err
    assert printed.out == ""


def test_the_table_of_the_install_page_names_every_extra() -> None:
    page = (Path(__file__).parents[2] / "docs/getting-started/install.md").read_text(encoding="utf-8")
    table = page.partition("| extra |")[2].partition("\n\n")[0]
    named = [line.split("`")[1] for line in table.splitlines() if line.startswith("| `")]
    assert sorted(named) == sorted(EXTRAS.keys() - {"dev"})


def test_the_licence_of_everything_that_an_extra_installs_is_on_its_page_and_none_is_gpl() -> None:
    page = (Path(__file__).parents[2] / "docs/reference/licences.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| ([\w-]+) \| (.+?) \|", page, re.MULTILINE))
    names = set().union(*map(brought, licences.EXTRAS.values()))
    assert len(names) > 10
    missing = names - listed.keys() - {"backports-zstd"}  # of some Pythons alone
    assert not missing, f"python -m scripts.update_docs licences: {missing}"
    assert not [name for name, licence in listed.items() if re.search(r"\bA?GPL|not stated", licence)]
