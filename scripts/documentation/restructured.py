"""Docstrings, which are reStructuredText in places, as Markdown."""

from __future__ import annotations

import html
import re

_ROLE = re.compile(r":(?:py:)?(?:attr|class|data|exc|func|meth|mod|obj):`(?P<name>[^`]+)`")
_RULE = re.compile(r"=+(?: +=+)+")
_UNDERLINE = re.compile(r"-{3,}")


def with_links(text: str) -> str:
    """Turn roles such as ``:class:`~cutenv.sim.trace.Trace``` into links to the object's page, else into code."""
    return _ROLE.sub(_link, text)


def _link(match: re.Match[str]) -> str:
    name = match["name"]
    target = name.lstrip("~")
    shown = target.rpartition(".")[2] if name.startswith("~") else target
    if "." not in target:
        return f"`{shown}`"
    return f'<autoref optional identifier="{html.escape(target)}"><code>{html.escape(shown)}</code></autoref>'


def with_tables(text: str) -> str:
    """Turn reStructuredText's simple tables into Markdown's."""
    lines = text.splitlines()
    out: list[str] = []
    at = 0
    while at < len(lines):
        if not _RULE.fullmatch(lines[at].strip()):
            out.append(lines[at])
            at += 1
            continue
        rules = [k for k in range(at, len(lines)) if _RULE.fullmatch(lines[k].strip())][:3]
        if len(rules) < 3:
            raise ValueError(f"a simple table has three rules, this one {len(rules)}: {lines[at : at + 4]}")
        out.extend(_table(lines, *rules))
        at = rules[2] + 1
    return "\n".join(out)


def _table(lines: list[str], top: int, middle: int, bottom: int) -> list[str]:
    """Return the Markdown lines of the simple table between three rules; a row that has no first cell continues one."""
    starts = [match.start() for match in re.finditer("=+", lines[top])]
    ends = [*starts[1:], None]
    rows: list[list[str]] = []
    for line in [*lines[top + 1 : middle], *lines[middle + 1 : bottom]]:
        cells = [line[start:end].strip() for start, end in zip(starts, ends, strict=True)]
        if cells[0]:
            rows.append(cells)
        else:
            rows[-1] = [f"{above} {cell}".strip() for above, cell in zip(rows[-1], cells, strict=True)]
    rows.insert(1, ["---"] * len(starts))
    return ["| " + " | ".join(cell.replace("|", r"\|") for cell in row) + " |" for row in rows]


def with_headings(text: str, level: int) -> str:
    """Turn a docstring's underlined section titles into Markdown headings of ``level``."""
    lines = text.splitlines()
    out: list[str] = []
    for line in lines:
        if out and out[-1].strip() and not out[-1].startswith("|") and _UNDERLINE.fullmatch(line.strip()):
            out[-1] = f"{'#' * level} {out[-1].strip()}"
        else:
            out.append(line)
    return "\n".join(out)


def markdown(docstring: str, *, level: int) -> str:
    """Return a whole docstring as Markdown, its sections under headings of ``level``."""
    return with_headings(with_tables(with_links(docstring)), level)
