"""Generated blocks of pages: what stands between ``<!-- NAME -->`` and ``<!-- /NAME -->``."""

from __future__ import annotations

import re
from pathlib import Path


def pattern_of(name: str) -> re.Pattern[str]:
    """Return the pattern of a block with its markers."""
    return re.compile(rf"(<!-- {name} -->\n)(.*?)(<!-- /{name} -->)", re.DOTALL)


def block_of(page: Path, name: str) -> str:
    """Return what stands between a block's markers; SystemExit where they are not there once."""
    found = pattern_of(name).findall(page.read_text(encoding="utf-8"))
    if len(found) != 1:
        raise SystemExit(f"{page} has block {name} {len(found)} times: <!-- {name} --> to <!-- /{name} -->")
    return str(found[0][1])


def replaced(page: Path, name: str, block: str) -> str:
    """Return the text of a page with one block replaced."""
    block_of(page, name)
    text = page.read_text(encoding="utf-8")
    return pattern_of(name).sub(lambda match: f"{match[1]}\n{block}\n\n{match[3]}", text)
