"""Reference pages of the Python API: one for each package that lists its public names, and for a few modules."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from scripts import ROOT

PACKAGE = ROOT / "cutenv"
FOLDER = "reference/api"
MODULES = (
    "cutenv.agents.learning.arguments",
    "cutenv.agents.learning.evaluation",
    "cutenv.agents.learning.seeds",
    "cutenv.agents.learning.statistics",
    "cutenv.agents.sb3",
    "cutenv.envs.vector",
    "cutenv.people.play.course",
    "cutenv.people.play.play_session",
    "cutenv.people.play.play_window",
    "cutenv.records.measurement.depth_sections",
    "cutenv.records.scoring.cut_metrics",
    "cutenv.rig.config.settings",
    "cutenv.rig.devices.protocols",
    "cutenv.drivers.conformance",
    "cutenv.rig.safety.supervisor",
    "cutenv.sim.tissue.lines",
    "cutenv.sim.trace",
    "cutenv.task.observation",
    "cutenv.task.reward",
    "cutenv.vision.beads",
    "cutenv.vision.fluoroscopy",
    "cutenv.vision.projection",
)
"""Public modules that belong to no package with a list of names; a test finds those that a page or an example uses."""
INTERNAL = ("cutenv.rig.devices.canopen", "cutenv.display.viewer.solid")
"""Packages whose names are for their neighbours only."""


def modules() -> list[str]:
    """Return the names of all modules that have a page."""
    for name in (*MODULES, *INTERNAL):
        _source(name)
    packages = [path.parent for path in PACKAGE.rglob("__init__.py") if path.parent != PACKAGE]
    dotted = {".".join(("cutenv", *path.relative_to(PACKAGE).parts)) for path in packages}
    return sorted({name for name in dotted if name not in INTERNAL and _public_names(name)} | set(MODULES))


def pages() -> Iterator[tuple[str, str, str]]:
    """Yield path below ``docs``, title in the navigation and Markdown of every page."""
    yield f"{FOLDER}/index.md", "All modules", _index()
    for name in modules():
        yield f"{FOLDER}/{_file(name)}", name, f"# {name}\n\n::: {name}\n    options:\n      show_root_heading: false\n"


def _index() -> str:
    intro = "Everything public, by module. Lengths are in metres, angles in radians unless a name carries a unit."
    rows = [f"| [`{name}`]({_file(name)}) | {_summary(name)} |" for name in modules()]
    return "\n".join(["# Python API", "", intro, "", "| module | what it holds |", "| --- | --- |", *rows, ""])


def _file(module: str) -> str:
    return f"{module.removeprefix('cutenv.')}.md"


def _source(module: str) -> Path:
    path = PACKAGE.parent.joinpath(*module.split("."))
    source = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    if not source.is_file():
        raise FileNotFoundError(f"{module} has no source {source}: correct the lists in {Path(__file__).name}.")
    return source


def _summary(module: str) -> str:
    docstring = ast.get_docstring(ast.parse(_source(module).read_text(encoding="utf-8"))) or ""
    return docstring.partition("\n")[0].replace("|", r"\|")


def _public_names(module: str) -> bool:
    """Return True if a module lists its public names in ``__all__``."""
    tree = ast.parse(_source(module).read_text(encoding="utf-8"))
    targets = [target for node in tree.body if isinstance(node, ast.Assign) for target in node.targets]
    return any(isinstance(target, ast.Name) and target.id == "__all__" for target in targets)
