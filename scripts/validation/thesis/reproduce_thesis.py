"""Print the thesis's numbers and ours, misses included, and draw its figures.

    python -m scripts.validation.thesis.reproduce_thesis          everything, some minutes; figures into figures/

scripts/derivations/specimens.py prints how well sampled livers reproduce the measured spread.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from tqdm import tqdm

from cutenv._base.result_table import aligned
from scripts import ROOT
from scripts.drawings.thesis import FIGURES, NOT_DRAWN, draw
from scripts.validation.thesis import COMPARISONS, Comparison

MARKS = {True: "ok", False: "MISS", None: "--"}


def underlined(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return text columns under ``header``, with a line below it."""
    line = ["-" * max(map(len, column)) for column in zip(header, *rows, strict=True)]
    return "\n".join(aligned([header, line, *rows]))


def text_of(name: str, comparison: Comparison) -> str:
    """Return all rows of one comparison, then its notes."""
    rows = [(MARKS[row.agrees], row.what, row.reference, row.ours, row.tolerance) for row in comparison.rows]
    title = f"{name}: {comparison.title} [{comparison.source}]  {comparison.verdict}"
    notes = "".join(f"\n     note: {note}" for note in comparison.notes)
    return f"\n{title}\n{underlined(('', 'what', 'reference', 'ours', 'tolerance'), rows)}{notes}"


def summary_of(done: dict[str, Comparison]) -> str:
    """Return one line per comparison, then the misses by name and their number."""
    rows = [(name, c.title, c.source, c.ours, c.tolerance, c.verdict) for name, c in done.items()]
    text = underlined(("name", "what", "reference", "ours", "tolerance", "verdict"), rows)
    misses = [
        f"  MISS  {name}: {row.what}: {row.ours} for {row.reference}" for name, c in done.items() for row in c.misses
    ]
    claims = sum(len(c.claims) for c in done.values())
    shown = sum(len(c.rows) for c in done.values()) - claims
    closing = f"{claims - len(misses)} of {claims} rows agree, {len(misses)} miss; {shown} more are shown, not claimed."
    return "\n".join([text, "", *misses, closing])


def markdown_of(done: dict[str, Comparison]) -> str:
    """Return the summary as a Markdown table."""
    lines = ["| what | reference | ours | tolerance | verdict |", "|---|---|---|---|---|"]
    for c in done.values():
        verdict = f"**{c.verdict}**" if c.misses else c.verdict
        lines.append(f"| {c.title} | {c.source} | {c.ours} | {c.tolerance} | {verdict} |")
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str] | None = None) -> int:
    """Compare, print and draw; return the number of rows that miss."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "figures", help="folder of the figures")
    parser.add_argument(
        "--only",
        action="append",
        choices=[*COMPARISONS, *FIGURES],
        metavar="NAME",
        help=f"may be repeated; comparisons: {', '.join(COMPARISONS)}; figures: {', '.join(FIGURES)}",
    )
    parser.add_argument("--quick", action="store_true", help="fewer speeds, specimens and policies")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="also write the summary there")
    arguments = parser.parse_args(argv)
    chosen = arguments.only or [*COMPARISONS, *FIGURES]

    began = time.perf_counter()
    done: dict[str, Comparison] = {}
    drawn: list[Path] = []
    with tqdm(chosen, desc="thesis", unit="part") as parts:
        for name in parts:
            parts.set_postfix_str(name)
            if name in COMPARISONS:
                done[name] = COMPARISONS[name](arguments.quick)
                tqdm.write(text_of(name, done[name]))
            else:
                drawn.append(draw(name, arguments.out, arguments.quick))
    if done:
        print(f"\nSummary\n{summary_of(done)}")
    if arguments.markdown:
        arguments.markdown.write_text(markdown_of(done))
        print(f"Markdown: {arguments.markdown}")
    for path in drawn:
        print(f"figure: {path}")
    if len(drawn) == len(FIGURES):
        print("\n".join(f"not drawn: {numbers}: {why}" for numbers, why in NOT_DRAWN.items()))
    print(f"{time.perf_counter() - began:.0f} s. The spread of drawn livers: python -m scripts.derivations.specimens")
    return sum(len(c.misses) for c in done.values())


if __name__ == "__main__":
    main()
