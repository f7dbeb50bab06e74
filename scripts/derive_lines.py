"""Solve the model along every line that a task draws, and print how closely what is stored agrees.

python scripts/derive_lines.py            prints the range of bends, places and stiffness of each kind
python scripts/derive_lines.py --write    solves first, half a minute, and writes assets/derived/lines.json
"""

from __future__ import annotations

import argparse

import numpy as np

from cutenv.tissue.drawn_lines import KINDS, OF_A_KIND, STORED, drawn_lines, kind_of, solved_stiffness, store
from cutenv.tissue.lines import length_within


def show() -> None:
    """Print what the lines of each kind are."""
    lines, records = drawn_lines(*STORED.values())
    print("| kind | lines | least radius | farthest from the axis | steepest | stiffness along | across |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    cut = slice(0, 201)  # the longest cut that is drawn
    for kind in KINDS:
        own = [n for n in range(len(lines)) if kind_of(n) == kind]
        bends = [max(abs(lines[n].curvature[cut]).max(), 1e-9) for n in own]
        radius = [1e3 / bend for bend in bends]
        shown = "-" if kind == KINDS[0] else f"{min(radius):.0f} to {max(radius):.0f} mm"
        aside = max(1e3 * abs(lines[n].y[cut]).max() for n in own)
        steep = max(np.degrees(abs(lines[n].angle[cut]).max()) for n in own)
        along, across = (np.array([records[name][n][cut] for n in own]) for name in ("along", "across"))
        assert all(length_within(lines[n]) > 0.1 for n in own)
        print(
            f"| {kind} | {len(own)} | {shown} | {aside:.0f} mm | {steep:.0f} deg "
            f"| {along.min():.2f} to {along.max():.2f} | {across.min():.2f} to {across.max():.2f} |"
        )
    print(f"\n{OF_A_KIND} lines of each kind within the longest cut, 100 mm; stiffness over that along a straight one.")


def main() -> None:
    """Write if requested, then print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write assets/derived/lines.json")
    if parser.parse_args().write:
        store(solved_stiffness())
    show()


if __name__ == "__main__":
    main()
