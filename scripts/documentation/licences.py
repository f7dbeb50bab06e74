"""Licences of everything that pip installs for the package and its extras, read from the installed packages.

python -m scripts.documentation.licences  the table of docs/reference/licences.md, from an environment that has it all
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, metadata, requires

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from scripts import ROOT
from scripts.tables import markdown_table

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
NOT_USERS = ("dev", "docs", "distributed", "force-dimension")
"""Extras of those who work on cutenv, and two that are installed in environments of their own."""
EXTRAS = {  # requirements of the package itself ("") and of every extra for users
    "": PROJECT["dependencies"],
    **{name: lines for name, lines in PROJECT["optional-dependencies"].items() if name not in NOT_USERS},
}
_SAID = {
    "Apache Software License": "Apache-2.0", "BSD License": "BSD", "MIT License": "MIT",
    "Python Software Foundation License": "PSF-2.0", "ISC License (ISCL)": "ISC", "zlib/libpng License": "Zlib",
    "Mozilla Public License 2.0 (MPL 2.0)": "MPL-2.0", "Historical Permission Notice and Disclaimer (HPND)": "HPND",
    "GNU Lesser General Public License v3 (LGPLv3)": "LGPL-3.0",
    "GNU Library or Lesser General Public License (LGPL)": "LGPL",
}  # fmt: skip


def brought(lines: Iterable[str]) -> set[str]:
    """Return the names of all packages that pip installs for these requirements, as far as they are installed here."""
    found: set[str] = set()
    waiting = [Requirement(line) for line in lines]
    while waiting:
        wanted = waiting.pop()
        name = canonicalize_name(wanted.name)
        if name in found or not _applies(wanted, {""}):
            continue
        try:
            further = requires(name) or []
        except PackageNotFoundError:
            continue
        found.add(name)
        extras = {"", *wanted.extras}
        waiting += [each for each in map(Requirement, further) if _applies(each, extras)]
    return found


def _applies(wanted: Requirement, extras: set[str]) -> bool:
    return wanted.marker is None or any(wanted.marker.evaluate({"extra": extra}) for extra in extras)


def licence(name: str) -> str:
    """Return the licence that an installed package states, "not stated" if none."""
    told = metadata(name)
    if expression := told.get("License-Expression"):
        return str(expression)
    classified = [each.rpartition(" :: ")[2] for each in told.get_all("Classifier") or [] if each.startswith("License")]
    named = [_SAID.get(each, each) for each in classified if each != "OSI Approved"]
    text = (told.get("License") or "").strip().partition("\n")[0]
    return " AND ".join(named) or (text if 0 < len(text) < 40 else "not stated")


def table() -> str:
    """Return every package with its licence, and the extra that brings it; that of the package itself is "core"."""
    by: dict[str, list[str]] = {}
    for extra, lines in EXTRAS.items():
        for name in brought(lines):
            by.setdefault(name, []).append(extra or "core")
    rows = [
        (name, licence(name).replace("|", "/"), "core" if "core" in extras else ", ".join(extras))
        for name, extras in sorted(by.items())
    ]
    return markdown_table(("package", "licence", "brought by"), rows)


if __name__ == "__main__":
    print(table())
