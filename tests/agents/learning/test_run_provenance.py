"""What a run's results are of: where it began stays known when it goes on."""

from __future__ import annotations

import json
import platform
import subprocess
from pathlib import Path

import numpy as np
import pytest

import cutenv
from cutenv._base import resources
from cutenv.agents.learning import run_folder


@pytest.fixture
def at(monkeypatch):
    """Let git tell of a commit, with changes or without."""

    def set_to(commit, changes=""):
        monkeypatch.setattr(run_folder, "git", lambda *arguments: commit if arguments[0] == "rev-parse" else changes)

    return set_to


def recorded(run):
    facts = run_folder.origin(run, ["numpy"])
    run_folder.write_facts(run, facts)
    return facts


def test_a_new_run_is_of_the_present_commit_and_versions(tmp_path, at):
    at("a" * 40)
    assert recorded(tmp_path) == {
        "versions": {"numpy": np.__version__, "python": platform.python_version()},
        "commit": "a" * 40,
        "uncommitted_changes": False,
    }
    assert run_folder.marked(recorded(tmp_path)) == "a" * 40


def test_a_run_that_goes_on_keeps_where_it_began_and_lists_other_commits_once(tmp_path, at):
    at("a" * 40)
    recorded(tmp_path)
    assert "resumed_at_commits" not in recorded(tmp_path)
    for commit, changes in (("b" * 40, ""), ("b" * 40, ""), ("a" * 40, " M agents/ppo.py"), ("a" * 40, "")):
        at(commit, changes)
        facts = recorded(tmp_path)
    assert facts["commit"] == "a" * 40
    assert not facts["uncommitted_changes"]
    assert facts["resumed_at_commits"] == ["b" * 40, "a" * 40 + "+changes"]


def test_versions_stay_those_of_the_beginning_and_a_file_of_an_earlier_version_is_filled_up(tmp_path, at):
    at("a" * 40)
    facts = recorded(tmp_path)
    run_folder.write_facts(tmp_path, facts | {"versions": {"numpy": "0.1"}})
    assert recorded(tmp_path)["versions"] == {"numpy": "0.1"}
    (tmp_path / "run.json").write_text(json.dumps({"arguments": {}}))
    assert run_folder.marked(recorded(tmp_path)) == "a" * 40


def test_an_installed_package_is_of_no_commit_though_a_repository_may_be_around_it(tmp_path, monkeypatch):
    """A virtual environment often lies in somebody's own repository."""
    assert resources._CHECKOUT.parent == Path(cutenv.__file__).parents[1]
    for command in (
        ["git", "init", "-q"],
        ["git", "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty", "-m", "theirs"],
    ):
        subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    site = tmp_path / "site-packages"
    site.mkdir()
    monkeypatch.setattr(resources, "_CHECKOUT", site / "assets")
    assert resources.git("rev-parse", "HEAD") is None
    (site / "pyproject.toml").touch()
    assert len(resources.git("rev-parse", "HEAD")) == 40
