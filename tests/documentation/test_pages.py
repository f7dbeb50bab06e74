"""The pages of the documentation agree with the code."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import importlib
import io
import math
import pkgutil
import re
import shlex
from collections.abc import Iterator
from functools import cache

import pytest
from packaging.requirements import Requirement
from page_code import CONTRIBUTORS, DOCS, PAGES, ROOT, code_of

from cutenv.commands import cli
from cutenv.emulation.emulated_bench import FAULTS
from cutenv.records import UNITS, load, load_operators
from cutenv.rig.config.settings import HeightAxis, SafetyLimits, SideAxis
from cutenv.rig.devices.driver_registry import SHIPPED_DRIVERS, DriverKind
from cutenv.rig.safety.stop_causes import STILL
from cutenv.task.reward import RewardWeights
from scripts.documentation import api_pages

USERS = [page for page in PAGES if not page.startswith(CONTRIBUTORS)]


def blocks(page: str, language: str) -> Iterator[str]:
    """The code of a page in one language, but for what is marked as never run."""
    for block in code_of(page):
        if block.language == language and not block.marked.startswith("not"):
            yield block.text


def imported() -> Iterator[tuple[str, str, str]]:
    """Place, module and name of everything that pages and examples import from the package."""
    code = [(page, text) for page in PAGES for text in blocks(page, "python")]
    code += [(path.name, path.read_text(encoding="utf-8")) for path in sorted((ROOT / "examples").glob("*.py"))]
    for place, text in code:
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("cutenv."):
                yield from ((place, node.module or "", alias.name) for alias in node.names)


def test_what_pages_and_examples_import_is_in_the_reference_and_public():
    documented = api_pages.modules()
    assert [name for name in documented if any(part.startswith("_") for part in name.split("."))] == []
    used = list(imported())
    assert len(used) > 50
    for place, module, name in used:
        assert module in documented, f"{place} imports {name} from {module}, which has no page"
        listed = getattr(importlib.import_module(module), "__all__", None)
        assert not name.startswith("_"), place
        assert listed is None or name in listed, f"{place} imports {name}, which {module} does not list"


def commands(page: str) -> Iterator[list[str]]:
    """Every command of a page, as words, without what follows a pipe."""
    for block in code_of(page):
        if block.language == "bash" and not block.marked:
            yield from block.commands()


@cache
def help_of(*names: str) -> str:
    """Return the output of ``cutenv NAMES --help``."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), pytest.raises(SystemExit) as ended:
        cli.main([*names, "--help"])
    assert ended.value.code == 0
    return printed.getvalue()


@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_are_there_with_their_options(page):
    for words in commands(page):
        if words[0] == "cutenv" and not words[1].startswith("-"):
            learner = words[2:4] if words[1:3] == ["train", "--learner"] else []
            listed = help_of(*(words[1:3] if words[1] == "rig" else [words[1], *learner]))
            for option in (word.partition("=")[0] for word in words if word.startswith("--")):
                assert re.search(rf"{re.escape(option)}\b", listed), f"{' '.join(words)}: there is no {option}"
        for program in (word for word in words if word.endswith(".py")):
            assert (ROOT / program).is_file()


OPTIONS_OF_EXTRAS = {"--page": "view3d", "--picture": "view"}


def extras_of(words: list[str]) -> set[str]:
    """The extras that a command of cutenv needs."""
    if words[0] != "cutenv" or not (command := cli.COMMANDS.get(words[1])):
        return set()
    part = command.parts.get(words[2]) if command.parts else None
    needed = {command.extra, part.extra if part else ""}
    return (needed | {extra for option, extra in OPTIONS_OF_EXTRAS.items() if option in words}) - {""}


@pytest.mark.parametrize("page", USERS)
def test_a_page_installs_the_extras_that_its_commands_need(page):
    for block in code_of(page):
        installed = {extra for each in block.installed for extra in Requirement(each).extras}
        for words in block.commands() if block.language == "bash" and not block.marked else ():
            assert extras_of(words) <= installed, f"{' '.join(words)} after {sorted(block.installed)}"


@pytest.mark.parametrize("page", ["../README.md", "index.md"])
def test_a_table_of_commands_names_the_extras_that_they_need(page):
    rows = re.findall(r"^\|.*`cutenv .*\|$", (DOCS / page).read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) >= 7
    for row in rows:
        for command in re.findall(r"`(cutenv .*?)`", row):
            assert extras_of(shlex.split(command)) <= {"view", *re.findall(r"`(\w+)`", row)}, row


@pytest.mark.parametrize("page", PAGES)
def test_the_names_and_files_that_a_page_mentions_are_there(page):
    text = (DOCS / page).read_text(encoding="utf-8")
    for name in re.findall(r"`(cutenv(?:\.\w+)+)`", text):
        assert pkgutil.resolve_name(name) is not None
    for path in re.findall(r"`((?:agents|assets|cutenv|docs|examples|scripts|tests)/[\w./-]*)`", text):
        assert re.search(r"-v\d+$", path) or (ROOT / path).exists(), path  # an environment or a data set


def test_a_page_that_shows_code_is_run():
    assert sum(1 for page in PAGES for _ in blocks(page, "python")) >= 20
    assert sum(words[0] == "cutenv" for page in PAGES for words in commands(page)) >= 50


def test_the_picture_of_the_architecture_shows_every_part_of_the_package_once():
    from scripts.drawings import architecture

    shown = [package for row in architecture.ROWS for wing in row for package in wing.packages]
    there = {
        path.stem for path in (ROOT / "cutenv").iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()
    }
    assert sorted(shown) == sorted(there - {"__init__", "__main__"})
    assert architecture.PICTURE.read_text(encoding="utf-8") == architecture.picture()


def shown(page: str, language: str, number: int = 0) -> str:
    return list(blocks(page, language))[number]


def test_the_record_that_is_shown_loads_as_the_text_above_it_says(tmp_path):
    text = shown("how-to/foreign-records.md", "csv")
    (tmp_path / "rig.csv").write_text(text)
    first, second = load(tmp_path / "rig.csv")
    assert list(first.force) == [0.05, 0.31]
    assert (first.metadata["cut"], second.metadata["cut"]) == (3, 4)
    assert first.speed == pytest.approx([0.0254, 0.0254])
    assert second.angle == pytest.approx([math.pi / 4] * 2)
    (tmp_path / "rig.csv").write_text(text.partition("\n")[2])  # without the metadata
    assert load(tmp_path / "rig.csv", force="-x")[1].force == pytest.approx(second.force)


def test_the_record_of_a_person_that_is_shown_loads(tmp_path):
    (tmp_path / "cut.csv").write_text(shown("how-to/score-cuts.md", "csv"))
    (cut,) = load(tmp_path / "cut.csv")
    assert cut.known == ("time", "force", "position", "angle", "depth")
    assert cut.position == pytest.approx([0.0, 1e-5])


def test_the_table_of_operators_that_is_shown_loads(tmp_path):
    (tmp_path / "operators.csv").write_text(shown("how-to/study.md", "csv"))
    rows = load_operators(tmp_path / "operators.csv")
    assert [(row.record, row.group, row.order) for row in rows] == [
        ("N01_01.csv", "novice", 1.0),
        ("N01_02.csv", "novice", 2.0),
        ("E01_01.csv", "expert", 1.0),
    ]


def test_the_units_that_are_listed_are_those_that_are_understood():
    page = (DOCS / "how-to" / "score-cuts.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| (`(?:time|force|position|speed|angle)`.*?) \| (.*) \|$", page, re.MULTILINE))
    found = {re.findall(r"`(\w+)`", fields)[0]: re.findall(r"`(\w+)`", units) for fields, units in listed.items()}
    found["depth"] = found["position"]
    assert found == {field: [unit for unit in units if "/" not in unit] for field, units in UNITS.items()}


def test_the_weights_that_are_listed_are_those_of_the_reward():
    page = (DOCS / "how-to" / "train.md").read_text(encoding="utf-8")
    listed = {
        name: float(weight) for name, weight in re.findall(r"^\| `weight_(\w+)` \| ([\d.]+) \|", page, re.MULTILINE)
    }
    assert listed == dataclasses.asdict(RewardWeights())


def test_the_limits_that_are_listed_are_the_defaults():
    page = (DOCS / "rig" / "what-stops-it.md").read_text(encoding="utf-8")
    limits = SafetyLimits()
    for value in (
        f"{limits.force:g} N, or all three together beyond {limits.force_norm:g} N",
        f"faster than {limits.force_rise:g} N/s",
        f"no reading for {1e3 * limits.stale_force:g} ms; {1e3 * limits.late_force:g} ms later than before; "
        f"{100 * limits.lost_force:g} % lost over 100 ms; all counts equal for {1e3 * limits.frozen_force:g} ms",
        f"beyond {100 * limits.speed:g} cm/s; {limits.acceleration:g} m/s²",
        f"outside {1e3 * limits.low:g} to {1e3 * limits.high:g} mm; "
        f"{math.degrees(limits.angle_low):g} to {math.degrees(limits.angle_high):g} degrees",
        f"blade {1e3 * limits.following:g} mm from where it should be",
        f"no sample of an axis for {1e3 * limits.stale_motion:g} ms",
        f"no heartbeat of a drive for {1e3 * limits.heartbeat:g} ms",
    ):
        assert value in page
    assert "at one count for 200 ms" in page
    axis = HeightAxis()
    for value in (
        f"blade outside {1e3 * axis.lowest:g} to {1e3 * axis.highest:g} mm",
        f"up or down beyond {100 * axis.fastest:g} cm/s; {axis.most_acceleration:g} m/s²",
        f"beyond {axis.vertical_force:g} N, up or down",
        f"| {1e3 * axis.following:g} mm from where it should be",
    ):
        assert value in page
    side = SideAxis()
    for value in (
        f"blade outside {1e3 * side.rightmost:g} to {1e3 * side.leftmost:g} mm from the middle",
        f"to either side beyond {100 * side.fastest:g} cm/s; {side.most_acceleration:g} m/s²",
        f"| {1e3 * side.following:g} mm from where it should be",
    ):
        assert value in page
    assert STILL == 0.2


def test_every_fault_of_the_emulator_is_listed():
    page = (DOCS / "rig" / "emulator.md").read_text(encoding="utf-8")
    assert set(re.findall(r"`(\w+)`", re.search(r"\| fault \|.*?\n\n", page, re.DOTALL)[0])) == set(FAULTS)


def test_every_driver_that_is_shipped_is_on_the_page_of_drivers():
    names = [name for of_kind in DriverKind for name in SHIPPED_DRIVERS[of_kind]]
    assert len(names) > 5
    page = (ROOT / "docs/development/driver.md").read_text(encoding="utf-8")
    assert [name for name in names if f'`"{name}"`' not in page] == []


def test_every_folder_of_tests_is_in_the_table_of_folders():
    folders = {path.relative_to(ROOT / "tests").parts[0] for path in (ROOT / "tests").glob("*/**/test_*.py")}
    page = (ROOT / "docs/development/testing.md").read_text(encoding="utf-8")
    table = page.partition("## Rules")[0]
    assert set(re.findall(r"^\| `tests/(\w+)` \|", table, re.MULTILINE)) == folders
