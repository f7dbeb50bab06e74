"""Calibrate a tissue for the environments from records of cuts, with a card that shows how far to trust it."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from cutenv.atomic import replacing
from cutenv.commands.records import add_record_options, read_records
from cutenv.measurement.calibration import RESAMPLES, check_resamples, measure_cuts, tissue_of
from cutenv.tissue import CutModel, TissueDescription


def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, or 2 if the records or the options are bad."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    try:
        _check_outputs(arguments)
        check_resamples(arguments.resamples)
        _calibrate(arguments)
    except (OSError, ValueError) as error:
        print(f"cutenv calibrate: {error}", file=sys.stderr)
        return 2
    return 0


def _calibrate(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm  # an extra

    model = CutModel(element=arguments.element, formulation=arguments.formulation, poisson=arguments.poisson)
    records = read_records(arguments)
    for note in records.notes:
        print(f"note: {note}", file=sys.stderr)
    watch = partial(tqdm, desc="measuring", unit="cut", file=sys.stderr, leave=False)
    cuts, unmeasured = measure_cuts(records.traces, model, progress=watch)
    if unmeasured and not arguments.skip_bad:
        listed = "\n".join(f"  {each.name}: {each.reason}" for each in unmeasured)
        raise ValueError(f"{len(unmeasured)} records cannot be measured; --skip-bad goes on without them:\n{listed}")
    refused = [*records.refused, *unmeasured]
    tissue = tissue_of(
        cuts, model, name=arguments.name or arguments.out.stem, resamples=arguments.resamples, refused=refused
    )
    if arguments.report:  # first, for it may need an extra: a tissue without its card would look finished
        from cutenv.report.calibration_card import ValidationCard, headline, write_validation_card

        card = ValidationCard(tissue=tissue, model=model, cuts=cuts)
        data = write_validation_card(arguments.report, card)
    with replacing(arguments.out) as part:
        part.write_text(tissue.to_json() + "\n", encoding="utf-8")
    print(summary(tissue))
    if arguments.report:
        print(f"\n{headline(card)}\ncard: {arguments.report} and {data}")
    print(f"tissue: {arguments.out}")
    print(f'  import cutenv, gymnasium; gymnasium.make("cutenv/GentleCut-v1", tissue="{arguments.out}")')


def summary(tissue: TissueDescription) -> str:
    """Return every number of a calibrated tissue with its interval and provenance, as aligned text."""
    about = tissue.calibration
    assert about is not None, "made by tissue_of"
    made = f"{about.cuts} {'cut' if about.cuts == 1 else 'cuts'} of "
    made += "one specimen" if about.specimens == 1 else f"{about.specimens} specimens"
    lines = [f"{tissue.name}: {made}, SI units, 95 % intervals over cuts"]
    for each in about.evidence:
        interval = "" if each.low is None or each.high is None else f"{each.low:.4g} to {each.high:.4g}"
        why = "" if each.provenance == "measured" else f"  {each.provenance}: {each.how}"
        lines.append(f"  {each.name:25s} {getattr(tissue, each.name):11.4g}  {interval:24s}{why}".rstrip())
    lines += [f"note: {note}" for note in about.notes]
    return "\n".join(lines)


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Raise an error for a path that cannot be written, before any work."""
    if arguments.out.suffix != ".json":
        raise ValueError(f"--out {arguments.out} must end in .json.")
    if arguments.report is not None and arguments.report.suffix != ".html":
        raise ValueError(f"--report {arguments.report} must end in .html; its data go beside it as .json.")
    if arguments.report is not None and arguments.report.with_suffix(".json") == arguments.out:
        raise ValueError(f"--report {arguments.report} would write its data over --out; give it another name.")
    for path in (arguments.out, arguments.report):
        if path is not None and not path.parent.is_dir():
            raise FileNotFoundError(f"no such folder: {path.parent}; make it first.")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="cutenv calibrate",
        description=__doc__,
        epilog="Records need position, angle and depth of cut beside force; return strokes past the crack tip tell "
        "friction, several speeds and both 90 and 45 degrees tell how the modulus depends on them. What the records "
        "do not tell is pig liver's, and the result says so.",
    )
    add_record_options(parser)
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.json", help="the tissue")
    parser.add_argument("--report", type=Path, metavar="FILE.html", help="validation card; its data beside it as .json")
    parser.add_argument("--name", help="of the tissue; default the file's")
    parser.add_argument("--resamples", type=int, default=RESAMPLES, help=f"of the bootstrap, default {RESAMPLES}")
    model = parser.add_argument_group("finite-element model to which the moduli shall belong")
    model.add_argument("--element", default="quad8", choices=["quad4", "quad8"])
    model.add_argument("--formulation", default="plane_stress", choices=["plane_stress", "plane_strain"])
    model.add_argument("--poisson", type=float, default=0.3)
    return parser
