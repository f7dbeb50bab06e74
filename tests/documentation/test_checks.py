"""No check is forgotten: programs and blocks of pages stand in the registry, and what it names is there."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import pytest

from scripts import long_checks
from scripts.checks import BLOCKS, CHECKS, Check
from scripts.documentation import check_pages

ROOT = Path(__file__).parents[2]
FOLDERS = ("validation", "benchmarks", "derivations")  # folders of scripts/ of which every program is a check
PARTS = {"scripts.validation.rig.rig_cut_process", "scripts.benchmarks.speed.operations"}  # programs that others start


def programs() -> list[str]:
    """Return the modules of the folders that can be run."""
    paths = [path for folder in FOLDERS for path in sorted((ROOT / "scripts" / folder).rglob("*.py"))]
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts)
        for path in paths
        if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
    ]


def test_every_program_is_a_check() -> None:
    run = {check.run.split()[0] for check in CHECKS}
    assert set(programs()) - run - PARTS == set()
    assert PARTS <= set(programs())


def test_every_check_runs_a_module_that_there_is() -> None:
    assert [check.run for check in CHECKS if find_spec(check.run.split()[0]) is None] == []


def test_every_page_is_there_and_names_the_program_or_has_its_block() -> None:
    wrong = []
    for check in CHECKS:
        text = (ROOT / check.page).read_text(encoding="utf-8") if check.page else ""
        module = check.run.split()[0]
        named = module in text or f"{module.replace('.', '/')}.py" in text
        if check.page and not (named or check.block or module in ("pytest", "cutenv")):
            wrong.append((check.name, check.page))
    assert wrong == []


def test_names_and_blocks_are_given_once() -> None:
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    assert len(BLOCKS) == sum(bool(check.block) for check in CHECKS)


@pytest.mark.parametrize("check", BLOCKS.values(), ids=BLOCKS)
def test_the_function_of_a_block_is_there(check: Check) -> None:
    """It is looked for in the source: to import every program would take a minute."""
    module, path = check.printer
    spec = find_spec(module)
    assert spec is not None
    assert spec.origin is not None
    tree = ast.parse(Path(spec.origin).read_text(encoding="utf-8"))
    first, last = path.split(".")[0], path.split(".")[-1]
    names = {node.name for node in ast.walk(tree) if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
    names |= {node.id for node in ast.walk(tree) if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)}
    assert {first, last} <= names


def test_a_block_is_printed_from_what_its_program_has_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check = Check("some", "", "scripts.some --json FILE", kept=str(tmp_path / "kept.json"), prints="json:dumps")
    with pytest.raises(SystemExit, match=r"kept\.json is missing; make it by: python -m scripts\.some --json FILE"):
        check.text()
    (tmp_path / "kept.json").write_text('{"a": 1}')
    assert check.text() == '{"a": 1}'


def test_a_function_in_a_table_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    tables: Mapping[str, type] = {"one": str}
    monkeypatch.setattr(long_checks, "TABLES", tables, raising=False)
    check = Check("some", "", "scripts.some", prints="scripts.long_checks:TABLES.one.upper", given=("a",))
    assert check.text() == "A"


def test_what_takes_long_is_run_before_a_change_is_closed() -> None:
    known = " ".join(" ".join(command) for command in long_checks.CHECKS.values())
    for name in ("--side", "--grbl", "class_load", "bead_tracking", "depth_accuracy", "seen_runs", "camera_beside_rig"):
        assert re.search(rf"{name}\b", known), name


def test_the_page_of_all_checks_has_each_with_its_command() -> None:
    ((_, page),) = check_pages.pages()
    for check in CHECKS:
        assert f"`python -m {check.run}`" in page
        assert check.promise in page
