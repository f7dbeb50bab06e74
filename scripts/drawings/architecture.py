"""Draw the one picture of the architecture, assets/pictures/architecture.svg, from the list below.

    python -m scripts.drawings.architecture

A row is one package of ``cutenv``, or two that do not know each other, each with its purpose and the packages inside.
A module imports only from rows below its own.  Change the list when a package changes;
``tests/documentation/test_pages.py`` checks that every one is in a box.
"""

from __future__ import annotations

from html import escape
from typing import NamedTuple

from scripts import ROOT

PICTURE = ROOT / "assets" / "pictures" / "architecture.svg"


class Wing(NamedTuple):
    """A box of the picture."""

    packages: tuple[str, ...]
    does: str
    colour: str

    @property
    def parts(self) -> str:
        """Names of the packages inside."""
        inside = [path.parent.name for each in self.packages for path in (ROOT / "cutenv" / each).glob("*/__init__.py")]
        return ", ".join(sorted(inside))


ROWS = (
    (Wing(("commands",), "the program cutenv and its commands", "#5b7db1"),),
    (Wing(("people",), "cuts by hand: in a window, in a browser, in a class", "#5b7db1"),),
    (Wing(("agents",), "policies, learners, comparison of simulator and rig", "#3f8f6b"),),
    (Wing(("envs",), "Gymnasium environments", "#3f8f6b"),),
    (Wing(("emulation",), "emulated rig on real wires, fake rig in memory", "#b5574a"),),
    (Wing(("drivers",), "optional drivers of a rig, conformance tests", "#b5574a"),),
    (
        Wing(("rig",), "safety, drivers, operation", "#b5574a"),
        Wing(("display",), "pictures of a cut, report pages", "#8a6fb0"),
    ),
    (Wing(("vision",), "what cameras and X-rays saw of a cut", "#8a6fb0"),),
    (Wing(("task",), "observation, reward, ends", "#3f8f6b"),),
    (Wing(("records",), "files of cuts, measured and scored; the simulator is not seen", "#8a6fb0"),),
    (Wing(("sim",), "tissue, cutting law, drive, sensor", "#8f6a1f"),),
    (Wing(("_engine", "_base"), "private: compiled kernels, random numbers, files, checks", "#777777"),),
)

WIDTH, HEIGHT, GAP, PAD = 860, 62, 10, 10


def box(wing: Wing, x: float, y: float, width: float) -> str:
    """Return a wing as SVG."""
    name = ", ".join(wing.packages)
    return (
        f'<rect x="{x:g}" y="{y:g}" width="{width:g}" height="{HEIGHT}" rx="6" fill="{wing.colour}"/>'
        f'<text x="{x + 12:g}" y="{y + 23:g}" font-size="16" font-weight="bold">{escape(name)}</text>'
        f'<text x="{x + 12:g}" y="{y + 41:g}" font-size="12">{escape(wing.does)}</text>'
        f'<text x="{x + 12:g}" y="{y + 55:g}" font-size="10.5" font-family="monospace">{escape(wing.parts)}</text>'
    )


def picture() -> str:
    """Return the whole SVG."""
    height = PAD * 2 + len(ROWS) * (HEIGHT + GAP) - GAP
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" role="img" '
        'font-family="sans-serif" fill="#ffffff">',
        "<title>The wings of cutenv: a module imports only from rows below its own</title>",
    ]
    for number, row in enumerate(ROWS):
        width = (WIDTH - 2 * PAD - (len(row) - 1) * GAP) / len(row)
        y = PAD + number * (HEIGHT + GAP)
        parts += [box(wing, PAD + place * (width + GAP), y, width) for place, wing in enumerate(row)]
    return "\n".join([*parts, "</svg>\n"])


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
    print(PICTURE)
