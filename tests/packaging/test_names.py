"""One word, one thing: no public name has two definitions without a reason; docstrings begin with their subject."""

from __future__ import annotations

import ast
import builtins
import functools
import inspect
import re
from collections import defaultdict
from dataclasses import fields
from pathlib import Path

import pytest

from cutenv.sim.cutting.motion import Motion
from cutenv.task.declare import Task
from scripts.documentation import measure_codebase

ROOT = Path(__file__).parents[2]

REASONS = {  # public names that several modules define, with the reason
    "CUT": "a stream of random numbers, and the dtype of a simulated cut",
    "Function": "type variable",
    "INCLINED": "the same angle, pi/4; no module that all of them import is about angles",
    "T": "type variable",
    "begin": "begins a row of lanes, and the hook of a task",
    "count": "counts within a table, and the hook of a task",
    "expect": "expects the mean tissue of a task, and the hook that does it",
    "measure": "measures a force, and the hook of a task",
    "TASK": "a stream of random numbers, and a dtype",
    "UPRIGHT": "the same angle, pi/2; no module that all of them import is about angles",
    "initiation_excess": "the same quantity: of the law, compiled, and estimated from records",
    "loading_ratio": "the same quantity: of the law, compiled, and of a tissue description",
    "main": "entry point of each command",
    "overshoot": "a task quantity, and the metric of that name, which its registry takes from the function",
    "read": "one interface of all file formats",
    "run_learner": "one interface of all learners",
    "tip_error": "a task quantity, and the metric of that name, which its registry takes from the function",
    "train": "one interface of all learners",
    "wedge": "a task quantity, and the metric of that name, which its registry takes from the function",
    "write": "one interface of all file formats",
}

HOOKS = {"renew_row", "respond_row"} | {field.name for declaration in (Task, Motion) for field in fields(declaration)}
"""Functions that a task or a motion of the blade declares bear the names of what they are declared as."""

SAME_FILE_NAMES = {"depth": "the depth of cut: measured along records, and wanted by a task"}
"""File names that several folders hold, with the reason; ``__init__`` is in every package."""


@functools.cache
def defined_names(path: Path) -> set[str]:
    """Public names that a module defines at its top level: classes, functions, constants, type aliases."""
    names: set[str] = set()
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, (ast.Assign, ast.AnnAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                parts = target.elts if isinstance(target, ast.Tuple) else [target]
                names.update(part.id for part in parts if isinstance(part, ast.Name))
    return {name for name in names if not name.startswith("_")}


def defined_twice(package: Path) -> dict[str, list[str]]:
    """Return public names that several modules define, with those modules."""
    places: dict[str, list[str]] = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        for name in defined_names(path):
            places[name].append(path.relative_to(package).with_suffix("").as_posix())
    return {name: found for name, found in places.items() if len(found) > 1}


def hooks(name: str, places: list[str]) -> bool:
    """Whether a name is that of a hook, in the modules that declare tasks and motions."""
    return name in HOOKS and all(place.startswith(("task/", "sim/cutting/")) for place in places)


def files_twice(package: Path) -> dict[str, list[str]]:
    """Return file names that several folders hold; a command's file is named after the command."""
    places: dict[str, list[str]] = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        relative = path.relative_to(package).as_posix()
        if path.stem != "__init__" and not relative.startswith("commands/"):
            places[path.stem].append(relative)
    return {name: found for name, found in places.items() if len(found) > 1}


def test_no_public_name_is_defined_twice_without_a_reason() -> None:
    twice = defined_twice(ROOT / "cutenv")
    unexplained = {name: places for name, places in twice.items() if name not in REASONS and not hooks(name, places)}
    assert unexplained == {}


def test_every_reason_is_still_needed() -> None:
    assert sorted(set(REASONS) - set(defined_twice(ROOT / "cutenv"))) == []


def test_a_name_that_is_defined_twice_is_noticed(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text("class Record: ...\nLIMIT, _HIDDEN = 1, 2\n")
    (tmp_path / "other.py").write_text("def read(): ...\nRecord = dict[str, int]\nLIMIT: int = 3\n_HIDDEN = 4\n")
    assert defined_twice(tmp_path) == {"Record": ["one", "other"], "LIMIT": ["one", "other"]}


def test_record_means_a_recorded_cut() -> None:
    for path in sorted((ROOT / "cutenv").rglob("*.py")):
        words = {"Record", "Records"} & defined_names(path)
        assert not words, f"{path.relative_to(ROOT)} defines {words}"


def test_no_file_name_stands_for_two_things_without_a_reason() -> None:
    twice = files_twice(ROOT / "cutenv")
    assert {name: places for name, places in twice.items() if name not in SAME_FILE_NAMES} == {}
    assert sorted(set(SAME_FILE_NAMES) - set(twice)) == []


FOLDERS = ("cutenv", "agents", "scripts", "examples")


@pytest.mark.parametrize("folder", FOLDERS)
def test_every_docstring_names_its_subject(folder: str) -> None:
    found, wrong = 0, []
    for path in sorted((ROOT / folder).rglob("*.py")):
        for line, text in measure_codebase.docstrings(ast.parse(path.read_text(encoding="utf-8"))):
            found += 1
            if measure_codebase.FRAGMENT.match(text.strip()):
                wrong.append(f"{path.relative_to(ROOT)}:{line}: {text.strip().splitlines()[0]}")
    assert found > 0, f"no docstring found in {folder}: nothing was checked"
    assert not wrong, "begin with the noun or verb instead:\n" + "\n".join(wrong)


def test_a_docstring_begins_with_few_words() -> None:
    assert measure_codebase.summary_words(ROOT) <= 10.0


WORDS = {"beside": "channels", "laid": "mounted", "told": "what is reported", "untold": "pending"}
"""Words that no public name has, each with a word that a reader would search for."""


def public_names(path: Path) -> set[str]:
    """Names that a user of a module meets: those of it, of its classes and of what their functions take."""
    names = {path.stem}

    def meet(body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                if node.name.startswith("_") and node.name != "__init__":
                    continue
                names.add(node.name)
                if isinstance(node, ast.ClassDef):
                    meet(node.body)
                else:
                    taken = node.args
                    every = (*taken.posonlyargs, *taken.args, *taken.kwonlyargs, taken.vararg, taken.kwarg)
                    names.update(each.arg for each in every if each is not None)
            elif isinstance(node, (ast.Assign, ast.AnnAssign)):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names.update(part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name))

    meet(ast.parse(path.read_text(encoding="utf-8")).body)
    return {name for name in names if not name.startswith("_")}


def test_no_public_name_has_a_word_of_a_dialect() -> None:
    for path in sorted((ROOT / "cutenv").rglob("*.py")):
        found = {name for name in public_names(path) if WORDS.keys() & set(name.lower().split("_"))}
        assert not found, f"{path.relative_to(ROOT)} has {found}; see WORDS"


def test_a_word_of_a_dialect_is_noticed_wherever_a_user_meets_it(tmp_path: Path) -> None:
    (tmp_path / "one.py").write_text(
        "UNTOLD = 1\nclass Rig:\n laid: int = 0\n def move(self, *, beside): ...\n def _told(self, told): ...\n"
    )
    assert public_names(tmp_path / "one.py") == {"one", "UNTOLD", "Rig", "laid", "move", "self", "beside"}


WIDE, WIDEST = 60, 9
ENVIRONMENTS = {"envs/gentle_cut.py:GentleCutEnv", "envs/rig_cut.py:RigCutEnv"}
"""Classes whose keywords are the options of an environment, which Gymnasium passes one by one."""


def test_functions_take_records_rather_than_many_numbers() -> None:
    counts = {}
    for path in sorted((ROOT / "cutenv").rglob("*.py")):
        for owner in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            for function in ast.iter_child_nodes(owner):
                if isinstance(function, ast.FunctionDef):
                    taken = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
                    count = sum(argument.arg not in ("self", "cls") for argument in taken)
                    of = function.name if not isinstance(owner, ast.ClassDef) else owner.name
                    counts[f"{path.relative_to(ROOT / 'cutenv').as_posix()}:{of}", function.lineno] = count
    wide = {place: count for place, count in counts.items() if count > 5}
    assert len(wide) <= WIDE, f"merge some arguments into a record: {sorted(wide)}"
    assert {place for (place, _), count in wide.items() if count > WIDEST} == ENVIRONMENTS


SECTION = re.compile(r"^(Parameters|Returns|Yields|Attributes)\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", re.M | re.S)
QUOTED = re.compile(r'"[^"]*"|`[^`]*`|\{[^}]*\}')


def documented_types(docstring: str) -> set[str]:
    """Class names in the types of a docstring's sections, by numpydoc."""
    found: set[str] = set()
    for title, entries in SECTION.findall(inspect.cleandoc(docstring)):
        for line in entries.splitlines():
            name, colon, kind = line.partition(" : ")
            if line and not line.startswith(" ") and (colon or title in ("Returns", "Yields")):
                found.update(re.findall(r"(?<![\w.])[A-Z]\w*[a-z]\w*", QUOTED.sub("", kind or name)))
    return found


def test_the_types_that_docstrings_name_exist():
    known, named = set(dir(builtins)), []
    for path in (ROOT / "cutenv").rglob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        known |= defined_names(path)
        for node in ast.walk(tree):
            if isinstance(node, ast.Import | ast.ImportFrom):
                known.update(alias.asname or alias.name for alias in node.names)
        named += [
            (path, line, kind) for line, text in measure_codebase.docstrings(tree) for kind in documented_types(text)
        ]
    assert len(named) > 100
    assert [f"{path}:{line} {kind}" for path, line, kind in named if kind not in known] == []


def test_a_type_that_does_not_exist_is_seen():
    assert documented_types("Do.\n\nParameters\n----------\nx : Shift or None\n    A `Thing`.\n") == {"Shift", "None"}


BARE = re.compile(
    "_(FEW|FEWEST|MANY|MOST|LEAST|LARGEST|SMALLEST|LONGEST|SHORTEST|FARTHEST|NEAREST|FASTEST|SLOWEST|DEEPEST|WIDEST"
    "|HIGHEST|LOWEST|AGAIN|ALIKE|ENOUGH|TOLD)"
)


def test_a_private_limit_is_named_after_what_it_limits():
    bare = [
        f"{path.relative_to(ROOT)}: {node.id}"
        for path in sorted((ROOT / "cutenv").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) and BARE.fullmatch(node.id)
    ]
    assert bare == []
