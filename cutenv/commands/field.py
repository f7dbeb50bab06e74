"""Compare tracked beads with the model; measure a cut by force and image."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv.commands import options

if TYPE_CHECKING:  # what computes is slow to import, and --help does not need it
    from cutenv.sim.tissue import CutModel

_ELEMENT = 0.01  # size of the thesis's elements [m]
_CURE = "Write 80mm or 8cm."


@options.reports_errors("field")
def main(argv: Sequence[str]) -> int:
    """Compare and measure; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    from cutenv.commands.inputs import chosen_cut, read_records
    from cutenv.display.report.film_pages import FieldResult, write_field_page
    from cutenv.vision import BeadTracks

    model, truth = _model(arguments), _truth(arguments.truth)
    thickness = options.length_given(arguments, "thickness", (1e-4, 0.5), _CURE)
    if arguments.zones is not None and arguments.zones < 1:
        raise ValueError(f"--zones {arguments.zones}: give 1 or more.")
    options.made_place("--out", arguments.out or Path("field.html"))
    tracks = BeadTracks.load(arguments.tracks)
    records = read_records(arguments)
    for note in records.notes:
        print(f"note: {note}", file=sys.stderr)
    trace = chosen_cut(records, arguments.cut)
    result = FieldResult.of(tracks, trace, model, thickness=thickness, zones=arguments.zones, truth=truth)
    for flag in result.flags:
        print(f"note: {flag}", file=sys.stderr)
    path = arguments.out or Path(re.sub(r"[^\w.-]+", "_", result.name) + "_field.html")
    data = write_field_page(path, result)
    print(result.headline())
    print(f"page: {path} and {data}")
    return 0


def _model(arguments: argparse.Namespace) -> CutModel:
    """Return the model of a slab, in elements of about 1 cm."""
    from cutenv.sim.tissue import CutModel

    width, length = (options.length_given(arguments, name, (0.02, 1.0), _CURE) or 0.0 for name in ("width", "length"))
    offset = options.length_given(arguments, "offset", (-0.5, 0.5), _CURE) or 0.0
    divisions = (2 * max(1, round(width / (2 * _ELEMENT))), max(2, round(length / _ELEMENT)))
    return CutModel(width=width, length=length, divisions=divisions, offset=offset)


def _truth(given: float | None) -> float | None:
    from cutenv._base.validation import in_range

    return None if given is None else in_range("--truth", given, 100.0, 1e9, "Pa", "40 kPa is 40000.")


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "field",
        __doc__,
        examples=(
            "tracks.parquet --record cut.csv",
            "tracks.parquet --record cut.csv --zones 3 --out field.html",
            "tracks.parquet --record cut.csv --width 8cm --length 12cm --thickness 25mm",
        ),
        note="The record needs position, angle and depth of cut beside force in newtons, on the clock of the tracks.",
    )
    add = parser.option
    add("tracks TRACKS", "tracks of beads, a Parquet file", Path)
    options.add_record_options(
        parser, files=1, metavar="FILE", about="record of the same cut: CSV, Parquet or HDF5", option="--record"
    )
    options.add_cut(parser)
    add("--zones N", "number of zones along the cut whose moduli are estimated; default none", int)
    add("--width LENGTH", "width of the slab; default 8cm", "8cm")
    add("--length LENGTH", "length of the slab; default 15cm", "15cm")
    add(
        "--offset LENGTH",
        "distance of the cut line from the middle of the slab, towards +x, in whole centimetres; default 0",
    )
    add("--thickness LENGTH", "thickness of the slab; default as deep as the cut: it is cut through")
    add(
        "--truth PASCALS",
        "modulus that was put in, to be shown beside those found; default what the tracks say of it",
        float,
    )
    add("--out PAGE", "page to write; default NAME_field.html, here", Path)
    return parser
