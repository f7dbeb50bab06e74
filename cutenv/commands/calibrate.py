"""Calibrate a tissue from records of cuts, with a card on its accuracy."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections import Counter
from collections.abc import Sequence
from operator import attrgetter
from pathlib import Path

from cutenv._base.imports import require
from cutenv._base.output import atomic_write, watched
from cutenv.commands import options
from cutenv.commands.inputs import read_records
from cutenv.records import Provenance, TissueHandling
from cutenv.records.measurement.calibration import RESAMPLES, check_resamples, measure_cuts, tissue_of, with_findings
from cutenv.records.measurement.measured_cut import MeasuredCut, in_layers
from cutenv.records.measurement.wear import blade_wear
from cutenv.records.measurement.within_specimens import compare_settings
from cutenv.sim.tissue import CutModel, TissueDescription
from cutenv.sim.trace import Trace


@options.reports_errors("calibrate")
def main(argv: Sequence[str]) -> int:
    """Calibrate; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    _check_outputs(arguments)
    check_resamples(arguments.resamples)
    require(*["statsmodels"] * arguments.within_specimens)
    boundary = options.layer_depth_given(arguments)
    capsule = options.length_given(arguments, "capsule_thickness", (1e-5, 0.005), "Write 0.2mm.")
    model = CutModel(element=arguments.element, formulation=arguments.formulation, poisson=arguments.poisson)
    records = read_records(arguments)
    for note in [*records.notes, *differences_in_handling(records.traces)]:
        print(f"note: {note}", file=sys.stderr)
    cuts, unmeasured = measure_cuts(records.traces, model, progress=lambda cuts: watched(cuts, "measuring", "cut"))
    if unmeasured and not arguments.skip_bad:
        listed = "\n".join(f"  {each.name}: {each.reason}" for each in unmeasured)
        raise ValueError(f"{len(unmeasured)} records cannot be measured; --skip-bad goes on without them:\n{listed}")
    refused = [*records.refused, *unmeasured]
    cuts, layers = in_layers(cuts, records.traces, model, boundary=boundary, capsule_thickness=capsule)
    tissue = tissue_of(cuts, model, name=arguments.name or arguments.out.stem, resamples=arguments.resamples)
    tissue = with_findings(tissue, refused, layers)
    compared = settings_table(cuts) if arguments.within_specimens else ""
    worn = "\n".join(blade_wear(cuts).lines) if arguments.blade_wear else ""
    if arguments.report:  # first, for it may need an extra: a tissue without its card would look finished
        from cutenv.display.report.calibration_card import ValidationCard, calibration_headline, write_validation_card

        card = ValidationCard(tissue=tissue, model=model, cuts=cuts)
        data = write_validation_card(arguments.report, card)
    with atomic_write(arguments.out) as part:
        part.write_text(tissue.to_json() + "\n", encoding="utf-8")
    print(summary(tissue))
    for table in filter(None, (compared, worn)):
        print(f"\n{table}")
    if arguments.report:
        print(f"\n{calibration_headline(card)}\ncard: {arguments.report} and {data}")
    print(f"tissue: {arguments.out}")
    print(f'  import cutenv, gymnasium; gymnasium.make("cutenv/GentleCut-v1", tissue="{arguments.out}")')
    return 0


def summary(tissue: TissueDescription) -> str:
    """Return the values of a calibrated tissue with interval and provenance."""
    about = tissue.calibration
    assert about is not None, "made by tissue_of"
    made = f"{about.cuts} {'cut' if about.cuts == 1 else 'cuts'} of "
    made += "one specimen" if about.specimens == 1 else f"{about.specimens} specimens"
    lines = [f"{tissue.name}: {made}, SI units, 95 % intervals over cuts"]
    for each in about.evidence:
        interval = "" if each.low is None or each.high is None else f"{each.low:.4g} to {each.high:.4g}"
        value = attrgetter(each.name)(tissue)
        why = "" if each.provenance == "measured" else f"  {each.provenance}: {each.how}"
        lines.append(f"  {each.name:25s} {value:11.4g}  {interval:24s}{why}".rstrip())
    lines += [f"note: {note}" for note in about.notes]
    return "\n".join(lines)


def settings_table(cuts: Sequence[MeasuredCut]) -> str:
    """Return modulus and resistance relative to the reference setting, as text. The ratios are within specimens."""
    lines = []
    for found in compare_settings(cuts):
        lines.append(
            f"{found.quantity} over that at {found.reference}, within {found.specimens} specimens, 95 % intervals"
        )
        lines += [
            f"  {each.setting!s:25s} {each.ratio:11.3f}  {each.low:.3f} to {each.high:.3f}, {each.cuts} cuts"
            for each in found.effects
        ]
        spread = f"standard deviation {100 * found.between_sd:.0f} % between specimens"
        lines.append(f"  {spread}, {100 * found.within_sd:.0f} % between cuts of one at the same setting")
        if found.without_reference:
            lines.append(f"  note: no reference cut on {', '.join(found.without_reference)}")
    return "\n".join(lines)


def differences_in_handling(traces: Sequence[Trace]) -> list[str]:
    """Return notes on differences in tissue handling; raise ValueError if a record's handling is not valid."""
    handled = [Provenance.from_metadata(trace.metadata).handling or TissueHandling() for trace in traces]
    notes = []
    for part in dataclasses.fields(TissueHandling):
        counts = Counter(getattr(each, part.name) for each in handled)
        if len(counts) > 1:
            said = ", ".join(f"{'not noted' if value is None else value} ({n} cuts)" for value, n in counts.items())
            notes.append(f"the tissue's handling differs in {part.name}: {said}")
    return notes


def _check_outputs(arguments: argparse.Namespace) -> None:
    """Refuse output paths that cannot be written."""
    if arguments.out.suffix != ".json":
        raise ValueError(f"--out {arguments.out} must end in .json.")
    if arguments.report is not None and arguments.report.suffix != ".html":
        raise ValueError(f"--report {arguments.report} must end in .html; its data go beside it as .json.")
    if arguments.report is not None and arguments.report.with_suffix(".json") == arguments.out:
        raise ValueError(f"--report {arguments.report} would write its data over --out; give it another name.")
    for option, path in (("--out", arguments.out), ("--report", arguments.report)):
        if path is not None:
            options.made_place(option, path)


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "calibrate",
        __doc__,
        examples=(
            "cuts/*.csv --out tissue.json --report tissue.html",
            "stepped/*.csv --layer-depth 12mm --out tissue.json",
            'rig/*.txt --map "time=t[ms]" "force=Fx" "position=x[mm]" angle=90deg depth=20mm --out tissue.json',
        ),
        note="Records need position, angle and depth of cut beside force. Return strokes past the crack tip give the\n"
        "friction; several speeds, and both 90 and 45 degrees, give the modulus's dependence on them. What the\n"
        "records do not give is taken from pig liver, and the result marks it so.",
    )
    add = parser.option
    options.add_record_options(parser)
    add("--out FILE.json", "tissue file to write", Path, required=True)
    add("--report FILE.html", "validation card; its data beside it as .json", Path)
    add("--name NAME", "name of the tissue; default the file's")
    add("--resamples N", f"bootstrap resamples for the intervals; default {RESAMPLES}", RESAMPLES)
    options.add_layer_depth(parser, "searched in records of cuts in steps of depth")
    add(
        "--capsule-thickness LENGTH",
        "thickness of the capsule, with its unit: 0.2mm; default: nothing is said of a capsule",
    )
    add(
        "--within-specimens",
        "compare speeds and angles within specimens too, by a mixed model whose random effect is the specimen; "
        "needs cutenv[stats]",
    )
    add(
        "--blade-wear",
        "tell the blade's wear from the cuts, in the order given: the rise of R with the length cut before, "
        "blade_used_m in the records' metadata, else the sum of the cuts before",
    )
    model = parser.add_argument_group("finite-element model that the moduli belong to")
    options.add_option(model, "--element", "element; default quad8", "quad8", choices=["quad4", "quad8"])
    options.add_option(
        model,
        "--formulation",
        "plane model; default plane_stress",
        "plane_stress",
        choices=["plane_stress", "plane_strain"],
    )
    options.add_option(model, "--poisson NU", "Poisson's ratio; default 0.3", 0.3)
    return parser
