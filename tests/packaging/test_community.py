"""Files for those who cite, report, contribute or release agree with the package."""

from __future__ import annotations

import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

import cutenv
from scripts import release_notes, start

ROOT = Path(__file__).parents[2]


WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
FORMS = [ROOT / ".github" / "ISSUE_TEMPLATE" / f"{name}.yml" for name in ("bug", "feature")]
PYPROJECT = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
CHANGELOG = "# Changelog\n\n## [0.2.0] - unreleased\n\nNew.\n\n## [0.1.0] - 2026-11-30\n\n### Added\n\n- All.\n"


def load(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))


def commands(workflow: Path) -> list[str]:
    """Lines that the workflow runs."""
    steps = [step for job in load(workflow)["jobs"].values() for step in job["steps"]]
    return [line for step in steps for line in step.get("run", "").splitlines()]


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_has_a_trigger_rights_and_time_limits(workflow: Path) -> None:
    content = load(workflow)
    assert content["on"]
    assert content["permissions"]
    for job in content["jobs"].values():
        assert job["timeout-minutes"] <= 180
        assert all("uses" in step or "run" in step for step in job["steps"])


def test_the_root_holds_what_it_should_and_nothing_that_a_run_left() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("needs a checkout")
    names = {name.partition("/")[0] for name in listed.stdout.split("\0")} - {""}
    folders = {name for name in names if (ROOT / name).is_dir()} - {".ci", ".github"}
    assert folders == {"agents", "assets", "cutenv", "docs", "examples", "scripts", "tests"}
    assert {Path(name).suffix for name in names - folders} <= {"", ".md", ".txt", ".toml", ".yml", ".yaml", ".cff"}


def test_whoever_installs_dev_has_what_contributors_are_told_to_run() -> None:
    told = re.findall(r"^    ([\w-]+) ", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"), re.MULTILINE)
    dev = tomllib.loads(PYPROJECT)["project"]["optional-dependencies"]["dev"]
    assert {*told} - {"python3"} == {"pre-commit"}
    assert any(line.startswith("pre-commit") for line in dev)


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_a_workflow_runs_files_that_exist(workflow: Path) -> None:
    named = {word.lstrip("@") for line in commands(workflow) for word in re.findall(r"[@\w./-]+", line)}
    files = {name for name in named if name.startswith(("scripts/", "tests/"))}
    assert "scripts/start.py" in files
    assert [name for name in files if not (ROOT / name).is_file()] == []


@pytest.mark.parametrize(("workflow", "job"), [("ci", "test"), ("nightly", "linux"), ("nightly", "portable")])
def test_tests_run_on_the_pythons_of_the_classifiers(workflow: str, job: str) -> None:
    matrix = load(ROOT / ".github" / "workflows" / f"{workflow}.yml")["jobs"][job]["strategy"]["matrix"]
    assert matrix["python"] == start.supported_pythons(PYPROJECT)


def test_every_job_uses_a_python_of_the_classifiers() -> None:
    named = [
        step["with"]["python-version"]
        for workflow in WORKFLOWS
        for job in load(workflow)["jobs"].values()
        for step in job["steps"]
        if "setup-python" in step.get("uses", "")
    ]
    assert len(named) == 7
    assert set(named) - {"${{ matrix.python }}"} <= set(start.supported_pythons(PYPROJECT))


def test_lint_runs_what_the_tests_run() -> None:
    run = commands(ROOT / ".github" / "workflows" / "ci.yml")
    for program in ("ruff check .", "ruff format --check .", "mypy", "lint-imports"):
        assert f".venv/bin/{program}" in run


def test_nothing_is_uploaded_to_an_index_by_itself() -> None:
    assert not [line for path in WORKFLOWS for line in commands(path) if re.search(r"twine|pypi|publish", line, re.I)]


@pytest.mark.parametrize("workflow", ["ci", "nightly"])
def test_the_portable_job_runs_the_list(workflow: str) -> None:
    job = load(ROOT / ".github" / "workflows" / f"{workflow}.yml")["jobs"]["portable"]
    assert job["strategy"]["matrix"]["system"] == ["windows-latest", "macos-latest"]
    assert shlex.split(job["steps"][-1]["run"])[-1] == "@tests/portable.txt"


@pytest.mark.parametrize("form", FORMS, ids=lambda path: path.stem)
def test_an_issue_form_has_what_github_asks_for(form: Path) -> None:
    content = load(form)
    assert {"name", "description", "body"} <= set(content)
    fields = [part for part in content["body"] if part["type"] != "markdown"]
    assert all(part["attributes"]["label"] for part in fields)
    assert len({part["id"] for part in fields}) == len(fields)
    assert any(part.get("validations", {}).get("required") for part in fields)


def test_the_citation_names_the_authors_and_the_licence_of_the_package() -> None:
    citation, project = load(ROOT / "CITATION.cff"), tomllib.loads(PYPROJECT)["project"]
    assert citation["cff-version"] == "1.2.0"
    assert citation["authors"] == project["authors"]
    assert citation["license"] == project["license"]
    assert citation["references"][0]["authors"][0]["family-names"] == "Chanthasopeephan"


def test_hooks_run_tools_of_the_environment() -> None:
    hooks = [hook for repo in load(ROOT / ".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]]
    assert [repo["repo"] for repo in load(ROOT / ".pre-commit-config.yaml")["repos"]] == ["local"]
    assert {hook["id"] for hook in hooks} == {"ruff-check", "ruff-format", "mypy"}
    assert all(hook["language"] == "system" for hook in hooks)


def test_the_newest_section_of_the_changelog_is_that_of_the_version() -> None:
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert next(iter(release_notes.sections(changelog))) == cutenv.__version__ == release_notes.package_version()


@pytest.mark.parametrize("tag", ["v0.1.0", "0.1.0"])
def test_notes_of_a_release_are_its_section(tag: str) -> None:
    assert release_notes.release_notes(CHANGELOG, tag, "0.1.0") == "### Added\n\n- All."


@pytest.mark.parametrize(
    ("tag", "version", "message"),
    [
        ("v0.1.0", "0.2.0", r"not that of the version 0\.2\.0"),
        ("v0.2.0", "0.2.0", "'unreleased'.*day of the release"),
        ("v0.3.0", "0.3.0", r"no section about 0\.3\.0"),
    ],
)
def test_a_release_that_is_not_ready_is_refused(tag: str, version: str, message: str) -> None:
    with pytest.raises(SystemExit, match=message):
        release_notes.release_notes(CHANGELOG, tag, version)
