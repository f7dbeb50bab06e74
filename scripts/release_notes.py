#!/usr/bin/env python3
"""Print the section of CHANGELOG.md for a release, if it agrees with the version of the package.

python -m scripts.release_notes v0.1.0    the tag of the release, or the version alone
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def package_version(root: Path = ROOT) -> str:
    """Read the version from ``cutenv/__init__.py``, its only place."""
    found = re.search(r'^__version__ = "(.+)"$', (root / "cutenv" / "__init__.py").read_text(encoding="utf-8"), re.M)
    if found is None:
        raise SystemExit('cutenv/__init__.py has no line __version__ = "...". Add it.')
    return found[1]


def sections(changelog: str) -> dict[str, tuple[str, str]]:
    """Return date (or "unreleased") and text of each version in a changelog, the newest first."""
    parts = re.split(r"^## \[(.+?)\] - (.+)$", changelog, flags=re.M)[1:]
    return {version: (date.strip(), text.strip()) for version, date, text in zip(*[iter(parts)] * 3, strict=True)}


def release_notes(changelog: str, tag: str, version: str) -> str:
    """Return the notes of a release; SystemExit where the changelog has none with text and date, or the tag differs."""
    if tag.removeprefix("v") != version:
        raise SystemExit(
            f"The tag {tag} is not that of the version {version} in cutenv/__init__.py. Change one of them."
        )
    date, text = sections(changelog).get(version, ("", ""))
    if not text:
        raise SystemExit(f"CHANGELOG.md has no section about {version}. Add a section '## [{version}] - DATE'.")
    if not re.fullmatch(r"\d{4}-\d\d-\d\d", date):
        raise SystemExit(f"CHANGELOG.md gives {version} the date {date!r}. Write the day of the release: YYYY-MM-DD.")
    return text


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tag", help="v0.1.0 or 0.1.0")
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    print(release_notes(changelog, parser.parse_args().tag, package_version()))
