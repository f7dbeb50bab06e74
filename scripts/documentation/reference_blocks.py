"""Blocks of pages that are printed from the package itself: constants, metrics, files, tables of the thesis."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cutenv._base.validation import parameter_table
from cutenv.drivers.slow_profile import RATES, grbl_settings, slow_settings
from cutenv.envs.constants import Knowledge
from cutenv.records.scoring import INVARIANCES, MAP_METRICS, METRICS, Metric
from cutenv.rig.operation.suitability import suitability_lines
from cutenv.rig.toml_file import template
from cutenv.sim.cutting.descent import DescentParameters
from cutenv.sim.cutting.drive import PDRig, Rig
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.cutting.steering import SteeringParameters
from cutenv.sim.tissue import Layers, measured_liver
from cutenv.sim.tissue import tables as thesis_tables
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.specimen import BladeWear, SurfaceSpread
from cutenv.task.depth import DepthConstants
from cutenv.task.path import PathConstants
from cutenv.task.reward import CUT_ENDS, REWARD, Limits
from scripts.tables import markdown_table


def parameters() -> str:
    """Return every constant of tissue, law, drive, sensor and task, with provenance."""
    liver = measured_liver()
    rows: list[tuple[str, ...]] = []
    for row in parameter_table(
        TissueDescription,
        LawParameters,
        Rig,
        PDRig,
        BladeWear,
        SensorParameters,
        Knowledge,
        Limits,
        Layers,
        DescentParameters,
        SteeringParameters,
        DepthConstants,
        PathConstants,
        SurfaceSpread,
    ):
        if any(known[0] == f"`{row['name']}`" for known in rows):
            continue  # both drives of a rig have it, with the same default
        value = getattr(liver, row["name"], row["default"])
        sweep = "" if row["sensitivity"] is None else f"{row['sensitivity'][0]:.4g} to {row['sensitivity'][1]:.4g}"
        rows.append((f"`{row['name']}`", f"{value:.4g}", row["unit"], row["provenance"], row["source"], sweep))
    return markdown_table(("constant", "default", "unit", "provenance", "source or reason", "sweep"), rows)


def other_tissues() -> str:
    """Return Table 6.2: fracture resistance of other tissues."""
    data, rows = thesis_tables.table("6.2"), []
    columns = data["fracture_resistance_J_m2"], data["sd_fracture_resistance_J_m2"]
    for note, mean, sd in zip(data.notes[1:], *columns, strict=True):
        of, _, remark = note.partition(": ")[2].rstrip(".").partition("; ")
        tissue, _, measured = of.partition(", ")
        rows.append((tissue, measured, remark if np.isnan(mean) else f"{mean:.0f} ± {sd:.0f}"))
    return markdown_table(("tissue", "source, test, criterion, material", "fracture resistance [J/m²]"), rows)


def errata() -> str:
    """Return the errata of the thesis that are kept with its tables."""
    return markdown_table(("table", "erratum"), [(number, text) for number, text in thesis_tables.errata()])


def metrics() -> str:
    """Return every metric of a score card, and what each invariance means."""
    promises = "\n".join(f"- `{name}`: {meaning}" for name, meaning in INVARIANCES.items())
    return f"{metric_table(METRICS)}\n\n{promises}"


def map_metrics(task: str) -> str:
    """Return the metrics of cuts along a wanted depth or a line."""
    return metric_table(MAP_METRICS[task])


def metric_table(among: Mapping[str, Metric]) -> str:
    """Return metrics as a table: meaning, formula, unit, source and promised invariances."""
    rows = []
    for each in among.values():
        cells = (each.meaning, each.formula, each.unit, each.direction, each.validity, each.source)
        promised = ", ".join(f"`{name}`" for name in each.invariances)
        rows.append((f"`{each.name}`", *(cell.replace("|", r"\|") for cell in cells), promised))
    header = ("metric", "meaning", "formula", "unit", "better", "valid for", "source", "unchanged by")
    return markdown_table(header, rows)


def weights() -> str:
    """Return the keyword of every weight of the reward."""
    changeable = [term for term in REWARD if term.weight is not None]
    rows = [(f"`weight_{term.name}`", f"{term.weight:g}", term.text) for term in changeable]
    return markdown_table(("keyword", "default", "charged for"), rows)


def ends() -> str:
    """Return the ends of a cut in order of precedence."""
    return markdown_table(("end", "when"), [(f"`{end.name}`", end.text.replace("``", "`")) for end in CUT_ENDS])


def tissue_file() -> str:
    """Return the tissue file of measured liver."""
    return f"```json\n{measured_liver().to_json()}\n```"


def rig_file() -> str:
    """Return the file that ``cutenv rig init my_rig.toml`` writes."""
    return f"```toml\n{template('my_rig').rstrip()}\n```"


def slow_rig() -> str:
    """Return what a serial rig with each converter can do, as ``cutenv rig check`` says."""
    lines = [
        f"{converter}, {rate:g} readings a second\n"
        + "\n".join(f"  {line}" for line in suitability_lines(slow_settings("", converter=converter)))
        for converter, rate in RATES.items()
    ]
    lines.append("GRBL, with hx711\n" + "\n".join(f"  {line}" for line in suitability_lines(grbl_settings("", ""))))
    return "```text\n" + "\n\n".join(lines) + "\n```"
