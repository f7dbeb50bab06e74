"""A Python that sees some installed packages alone, as if the others were not installed."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts.documentation.licences import PROJECT, brought

ROOT = Path(__file__).parents[2]
ALWAYS = {"pip", "setuptools", "cutenv"}
HOOK = """
import os
import sys
from importlib.machinery import PathFinder

HIDDEN = frozenset(os.environ["HIDDEN_MODULES"].split())
PACKAGES = frozenset(os.environ["HIDDEN_PACKAGES"].split())


class VisibleFinder(PathFinder):
    @classmethod
    def find_spec(cls, name, path=None, target=None):
        return None if name.partition(".")[0] in HIDDEN else super().find_spec(name, path, target)

    @classmethod
    def find_distributions(cls, *context):
        for each in PathFinder.find_distributions(*context):
            if each.metadata["Name"].lower().replace("_", "-") not in PACKAGES:
                yield each


sys.meta_path[sys.meta_path.index(PathFinder)] = VisibleFinder
"""
COMMAND = """
import sys

from cutenv.commands.cli import main

sys.exit(main())
"""


def required(installed: Iterable[str]) -> list[str]:
    """Requirements of the project and the extras, and of what else is installed."""
    found = [*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["compile"]]
    for each in map(Requirement, installed):
        extras = PROJECT["optional-dependencies"]
        found += [line for extra in each.extras for line in extras[extra]] if each.name == "cutenv" else [str(each)]
    return found


@cache
def hidden(installed: frozenset[str]) -> tuple[frozenset[str], frozenset[str]]:
    """Modules and packages of this environment that pip would not have installed for these requirements."""
    seen = brought(required(installed)) | ALWAYS
    by_module = {
        module: {canonicalize_name(package) for package in packages}
        for module, packages in packages_distributions().items()
    }
    modules = {module for module, packages in by_module.items() if not packages & seen}
    return frozenset(modules), frozenset().union(*by_module.values()) - seen


def environment(folder: Path, installed: frozenset[str], *, checkout: bool = False) -> dict[str, str]:
    """Variables of processes that see `installed` alone, by files in `folder`; the checkout's programs, if so asked."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "sitecustomize.py").write_text(HOOK)
    (folder / "cutenv-command").write_text(COMMAND)
    modules, packages = hidden(installed)
    if not checkout:
        modules |= {"agents", "scripts", "tests"}
    return os.environ | {
        "PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)]),
        "HIDDEN_MODULES": " ".join(modules),
        "HIDDEN_PACKAGES": " ".join(packages),
    }


def missing(printed: str) -> list[str]:
    """Return the lines in which a program names a package that is not installed."""
    return re.findall(r"No module named .*|.* not installed: pip install.*|.* an extra: pip install.*", printed)
