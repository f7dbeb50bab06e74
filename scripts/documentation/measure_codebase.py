#!/usr/bin/env python3
"""Measure the structure and the language of the code base, and print a Markdown table.

    python -m scripts.documentation.measure_codebase               this checkout
    python -m scripts.documentation.measure_codebase --at 7b6279b HEAD
                                                                   revisions of this repository
    python -m scripts.documentation.measure_codebase --at 7b6279b --json FILE
                                                                   keep the numbers

The kept numbers of earlier revisions are in ``docs/development/measures-before.json``, for clones without history.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import io
import json
import math
import os
import re
import statistics
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from scripts import ROOT

BEFORE = Path("docs/development/measures-before.json")  # numbers of earlier revisions, relative to the checkout
PACKAGE = "cutenv"
RIG = "cutenv.rig"
CODE = ("cutenv", "agents", "scripts")  # folders whose docstrings and words are counted
FRAGMENT = re.compile(r"(Of|What|How|Where|Why|Whether|As)\b")
"""Match the first word of a docstring that does not name its subject."""
WORD = "told"

Measures = dict[str, float | None]
"""Value of each measure by its key in `LABELS`; None where a tool or a file is missing."""

LABELS = {  # row label of each measure in the table
    "readme_lines": "README, lines",
    "layers": "layers of the import contract",
    "wings": "packages directly in `cutenv/`",
    "loose_modules": "modules loose in `cutenv/`",
    "import_cycles": "import cycles, also of two files",
    "loaded_cutenv": "modules of cutenv that `gymnasium.make` of GentleCut loads",
    "loaded_rig": "... of these in `cutenv.rig`",
    "step_functions": "functions of cutenv in one `env.step`",
    "batch_functions": "... in one step of a vector environment",
    "both_functions": "... in both together",
    "both_modules": "... in so many modules",
    "repeated_names": "public top-level names defined in two modules or more",
    "docstrings": "docstrings in cutenv, agents and scripts",
    "fragments": "... that begin with Of, What, How, Where, Why, Whether or As",
    "d401": "... not in the imperative (ruff D401)",
    "summary_words": "words of a first paragraph in cutenv, mean",
    "word": f'"{WORD}" in cutenv, agents and scripts',
    "files": "files of cutenv",
    "file_median": "lines a file, median",
    "file_p90": "... 90th percentile",
    "file_largest": "... largest",
    "function_median": "lines a function of cutenv, median",
    "function_longest": "... longest",
    "lines_cutenv": "lines of Python: cutenv",
    "lines_agents": "... agents",
    "lines_scripts": "... scripts",
    "lines_examples": "... examples",
    "lines_tests": "... tests",
    "lines_docs": "lines of Markdown in docs",
    "pages": "pages in docs",
    "examples": "examples",
}

_LOAD = f"""
import re, sys
import gymnasium
import {PACKAGE}
ids = [id for id in gymnasium.registry if re.fullmatch(r"{PACKAGE}/GentleCut-v\\d+", id)]
gymnasium.make(max(ids, key=lambda id: int(id.rpartition("-v")[2])))
print(*sorted(name for name in sys.modules if name.partition(".")[0] == {PACKAGE!r}))
"""
_STEP = f"""
import re, sys
import gymnasium
import {PACKAGE}
ids = [id for id in gymnasium.registry if re.fullmatch(r"{PACKAGE}/GentleCut-v\\d+", id)]
name = max(ids, key=lambda id: int(id.rpartition("-v")[2]))
env = MADE
env.reset(seed=0)
action = env.action_space.sample()
if action.dtype.kind == "f":
    action[..., 0] = 0.5
for _ in range(10):
    env.step(action)
entered = set()
def enter(frame, event, argument):
    code = frame.f_code
    place = code.co_filename
    if event == "call" and ("/{PACKAGE}/" in place or place.startswith("<fused")) and not code.co_name.startswith("<"):
        entered.add((frame.f_globals.get("__name__"), code.co_name))
sys.setprofile(enter)
env.step(action)
sys.setprofile(None)
print(*map(":".join, entered))
"""


def measures(root: Path = ROOT) -> Measures:
    """Measure a checkout; nothing is written there but Python's bytecode."""
    package = _sources(root, PACKAGE)
    sizes = [_line_count(path) for path in package]
    functions = [size for path in package for size in _function_sizes(_tree(path))]
    loaded = loaded_modules(root)
    single, batch = (entered_in_step(root, made) for made in ("gymnasium.make(name)", "gymnasium.make_vec(name, 2)"))
    result: Measures = {
        "readme_lines": _line_count(root / "README.md"),
        "layers": layer_count(root),
        "wings": sum(1 for path in (root / PACKAGE).glob("*/__init__.py")),
        "loose_modules": sum(1 for path in (root / PACKAGE).glob("*.py") if not path.stem.startswith("__")),
        "import_cycles": len(import_cycles(root)),
        "loaded_cutenv": len(loaded),
        "loaded_rig": sum(1 for name in loaded if name == RIG or name.startswith(f"{RIG}.")),
        "step_functions": len(single),
        "batch_functions": len(batch),
        "both_functions": len(single | batch),
        "both_modules": len({name.partition(":")[0] for name in single | batch}),
        "repeated_names": len(repeated_names(root)),
        "docstrings": sum(1 for path in _sources(root, *CODE) for _ in docstrings(_tree(path))),
        "fragments": len(fragments(root)),
        "d401": d401_count(root),
        "summary_words": summary_words(root),
        "word": sum(path.read_text(encoding="utf-8").lower().count(WORD) for path in _sources(root, *CODE)),
        "files": len(sizes),
        "file_median": statistics.median(sizes),
        "file_p90": _percentile(sizes, 0.9),
        "file_largest": max(sizes),
        "function_median": statistics.median(functions) if functions else None,
        "function_longest": max(functions, default=None),
    }
    for folder in ("cutenv", "agents", "scripts", "examples", "tests"):
        result[f"lines_{folder}"] = sum(map(_line_count, _sources(root, folder)))
    pages = sorted((root / "docs").rglob("*.md"))
    result["lines_docs"] = sum(map(_line_count, pages))
    result["pages"] = len(pages) + len(list((root / "docs").rglob("*.ipynb")))
    result["examples"] = len([path for path in (root / "examples").glob("*.py") if not path.stem.startswith("_")])
    assert list(result) == list(LABELS)
    return result


def markdown(columns: dict[str, Measures]) -> str:
    """Make a Markdown table with one column for each set of measures, named by its key."""
    rows = [["", *columns], ["---", *("---:" for _ in columns)]]
    rows += [[label, *(_shown(column.get(key)) for column in columns.values())] for key, label in LABELS.items()]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)


def comparison(root: Path = ROOT) -> str:
    """Make the table of the kept numbers of earlier revisions beside those of the checkout."""
    return markdown({**kept(root / BEFORE), "now": measures(root)})


def kept(path: Path) -> dict[str, Measures]:
    """Read numbers that ``--json`` has written; SystemExit with the cure if there is no such file."""
    if not path.is_file():
        raise SystemExit(
            f"{path} is missing; make it by: python -m scripts.documentation.measure_codebase "
            f"--at REVISION --json {path}"
        )
    return json.loads(path.read_text(encoding="utf-8"))


def layer_count(root: Path) -> int | None:
    """Count the layers of the first exhaustive layer contract of import-linter; None if there is none."""
    path = root / "pyproject.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    contracts = table.get("tool", {}).get("importlinter", {}).get("contracts", [])
    return next((len(one["layers"]) for one in contracts if one["type"] == "layers" and one.get("exhaustive")), None)


def import_cycles(root: Path, *folders: str) -> list[list[str]]:
    """Find the groups of modules, of cutenv by default, that import each other, directly or by way of others.

    Imports inside functions and for type checking count as well.
    """
    modules = {_module_name(root, path): path for path in _sources(root, *(folders or (PACKAGE,)))}
    names = sorted(modules)
    index = {name: number for number, name in enumerate(names)}
    edges = [(index[name], index[other]) for name in names for other in _imported(name, modules)]
    rows, columns = np.array(edges, dtype=int).reshape(-1, 2).T
    graph = csr_array((np.ones(len(edges)), (rows, columns)), shape=(len(names), len(names)))
    _, labels = connected_components(graph, directed=True, connection="strong")
    groups = defaultdict(list)
    for name, label in zip(names, labels, strict=True):
        groups[label].append(name)
    return [group for group in groups.values() if len(group) > 1]


def loaded_modules(root: Path) -> list[str]:
    """List the modules of cutenv that a fresh process has loaded when it has made the environment GentleCut."""
    return _answered(root, _LOAD)


def entered_in_step(root: Path, made: str) -> set[str]:
    """List the functions of cutenv, as ``module:function``, that one step of an environment enters in plain Python."""
    return set(_answered(root, _STEP.replace("MADE", made), NUMBA_DISABLE_JIT="1"))


def _answered(root: Path, program: str, **settings: str) -> list[str]:
    variables = os.environ | {"PYTHONPATH": str(root), "PYTHONDONTWRITEBYTECODE": "1"} | settings
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=root, env=variables, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise SystemExit(f"The environment of {root} cannot be made:\n{done.stderr.strip()}")
    return done.stdout.split()


def repeated_names(root: Path) -> dict[str, list[str]]:
    """Find the public functions, classes and constants of cutenv that two modules or more define, with the modules."""
    places = defaultdict(list)
    for path in _sources(root, PACKAGE):
        for name in sorted(set(_defined(_tree(path)))):
            places[name].append(_module_name(root, path))
    return {name: where for name, where in sorted(places.items()) if len(where) > 1}


def fragments(root: Path) -> list[str]:
    """List the docstrings whose first word does not name their subject, each with its file and line."""
    return [
        f"{path.relative_to(root).as_posix()}:{line}: {text.strip().partition(chr(10))[0]}"
        for path in _sources(root, *CODE)
        for line, text in docstrings(_tree(path))
        if FRAGMENT.match(text.strip())
    ]


def docstrings(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield line and text of every docstring: of modules, classes, functions and attributes."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if not isinstance(body, list):
            continue
        documented = isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        for number, statement in enumerate(body):
            match statement:
                case ast.Expr(value=ast.Constant(value=str(text))):
                    after_assignment = number > 0 and isinstance(body[number - 1], ast.Assign | ast.AnnAssign)
                    if after_assignment or (documented and number == 0):
                        yield statement.lineno, text


def summary_words(root: Path) -> float:
    """Count the words of the first paragraph of a docstring of cutenv, on average."""
    texts = [inspect.cleandoc(text) for path in _sources(root, PACKAGE) for _, text in docstrings(_tree(path))]
    return round(statistics.mean(len(text.partition("\n\n")[0].split()) for text in texts), 1)


def d401_count(root: Path) -> int | None:
    """Count the docstrings of functions that are not in the imperative; None without ruff."""
    folders = [folder for folder in CODE if (root / folder).is_dir()]
    command = ["-m", "ruff", "check", "--isolated", "--no-cache", "--exit-zero", "--select", "D401"]
    done = subprocess.run(
        [sys.executable, *command, "--output-format", "json", *folders],
        cwd=root, capture_output=True, text=True, check=False,
    )  # fmt: skip
    return len(json.loads(done.stdout)) if done.returncode == 0 else None


def _sources(root: Path, *folders: str) -> list[Path]:
    """List the Python files below folders of the checkout."""
    return sorted(path for folder in folders for path in (root / folder).rglob("*.py"))


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _line_count(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def _function_sizes(tree: ast.Module) -> list[int]:
    """Return the lines of each function, from ``def`` to its end."""
    functions = (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))
    return [(node.end_lineno or node.lineno) - node.lineno + 1 for node in functions]


def _percentile(sizes: Sequence[int], share: float) -> int:
    """Return the smallest size that ``share`` of the sizes do not exceed."""
    return sorted(sizes)[math.ceil(share * len(sizes)) - 1]


def _module_name(root: Path, path: Path) -> str:
    folder, *inside = path.relative_to(root).with_suffix("").parts
    parts = [folder, *inside] if folder == PACKAGE else inside  # programs are imported from their folder
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imported(name: str, modules: dict[str, Path]) -> set[str]:
    """Return the modules among ``modules`` that the module ``name`` imports anywhere in its file."""
    package = name if modules[name].stem == "__init__" else name.rpartition(".")[0]
    found = set()
    for node in ast.walk(_tree(modules[name])):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inside = {f"{base}.{alias.name}" for alias in node.names}
            found |= {each if each in modules else base for each in inside}
    return (found & set(modules)) - {name}


def _defined(tree: ast.Module) -> Iterator[str]:
    """Yield the public names that a module defines at its top level."""
    for node in tree.body:
        match node:
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name) | ast.AsyncFunctionDef(name=name):
                names = [name]
            case ast.Assign(targets=targets):
                names = [part.id for target in targets for part in ast.walk(target) if isinstance(part, ast.Name)]
            case ast.AnnAssign(target=ast.Name(id=name)):
                names = [name]
            case _:
                names = []
        yield from (name for name in names if not name.startswith("_"))


def _shown(value: float | None) -> str:
    return "not measured" if value is None else f"{value:,g}" if value != int(value) else f"{int(value):,}"


def _extract(revision: str, folder: Path) -> None:
    """Write the files of a revision of this repository to a folder."""
    command = ["git", "-C", str(ROOT), "archive", "--format=tar", revision]
    done = subprocess.run(command, capture_output=True, check=False)
    if done.returncode != 0:
        raise SystemExit(f"revision {revision}: {done.stderr.decode(errors='replace').strip()}")
    with tarfile.open(fileobj=io.BytesIO(done.stdout)) as archive:
        archive.extractall(folder, filter="data")


def _counted(root: Path, what: str) -> list[str]:
    """Return what was counted, one a line."""
    match what:
        case "cycles":
            return [" <-> ".join(group) for group in import_cycles(root)]
        case "docstrings":
            return fragments(root)
        case "loaded":
            return loaded_modules(root)
        case _:
            return [f"{name}: {', '.join(where)}" for name, where in repeated_names(root).items()]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--at", nargs="+", metavar="REVISION", default=[], help="measure revisions instead")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers as JSON, too")
    parser.add_argument("--list", choices=["cycles", "docstrings", "loaded", "names"], help="list what was counted")
    arguments = parser.parse_args()
    if arguments.list:
        print(*_counted(ROOT, arguments.list), sep="\n")
        return
    columns = {} if arguments.at else {"now": measures()}
    for revision in arguments.at:
        with tempfile.TemporaryDirectory() as extracted:
            _extract(revision, Path(extracted))
            columns[revision] = measures(Path(extracted))
    if arguments.json:
        arguments.json.write_text(json.dumps(columns, indent=1) + "\n", encoding="utf-8")
    print(markdown(columns))


if __name__ == "__main__":
    main()
