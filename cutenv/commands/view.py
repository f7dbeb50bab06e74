"""Show a recorded cut in 3-D: a page that opens from disk."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

from cutenv.commands import options
from cutenv.commands.inputs import chosen_cut, read_records
from cutenv.display.viewer.solid import COLOURINGS, CurvedCut, ShownCut, write_curved_view, write_view


@options.reports_errors("view")
def main(argv: Sequence[str]) -> int:
    """Write the page; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    target, line = options.target_length(arguments), options.line_given(arguments)
    options.made_place("--out", arguments.out or Path("view.html"))
    records = read_records(arguments)
    for note in records.notes:
        print(f"note: {note}", file=sys.stderr)
    for each in records.refused:
        print(f"left out: {each.name}: {each.reason}", file=sys.stderr)
    trace = chosen_cut(records, arguments.cut)
    path: Path
    if trace.blade_x is None and line is None:
        cut = ShownCut.of(trace, target=target)
        path = arguments.out or page_of(cut.name)
        size = write_view(path, cut, colour=arguments.colour or COLOURINGS[0])
        print(f"page: {path} ({size / 1e6:.1f} MB, {len(cut)} instants)")
    else:
        if arguments.colour not in (None, COLOURINGS[0]):
            raise ValueError(f"--colour {arguments.colour}: a cut in the plane shows displacement; leave it out.")
        curved = CurvedCut.of_record(trace, line=line, target=target)
        path = arguments.out or page_of(curved.name)
        print(f"page: {path} ({write_curved_view(path, curved) / 1e6:.1f} MB, as the record ends)")
    if arguments.open:
        import webbrowser

        webbrowser.open(path.resolve().as_uri())
    return 0


def page_of(name: str) -> Path:
    """Return the default path of a cut's page."""
    return Path(re.sub(r"[^\w.-]+", "_", name) + "_view.html")


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "view",
        __doc__,
        examples=("cut.csv --open", "cuts.csv --cut 2 --target-length 80mm --out second.html"),
        note="A record needs position and depth of cut beside force in newtons; without angle the blade is upright.\n"
        "A record with the places of the blade is shown as the slab at its end.",
    )
    add = parser.option
    options.add_record_options(parser, files=1, about="record of cuts: CSV, Parquet or HDF5")
    options.add_cut(parser)
    options.add_target_length(parser, "the record's own")
    options.add_line(parser, "of records with the places of the blade", "the record's own")
    add("--colour", f"what the tissue's colour shows; default {COLOURINGS[0]}", choices=COLOURINGS)
    add("--out PAGE", "page to write; default NAME_view.html, here", Path)
    add("--open", "open the page in the browser")
    return parser
