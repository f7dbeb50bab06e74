"""Recover what was put into virtual cuts with depth: fracture resistance by area, and layers with their intervals.

    python -m scripts.validation.measurement.layers                     some minutes; writes runs/layers/layers.json

A study is some cuts in steps of depth (scripts/validation/measurement/stepped_cuts.py), each of another drawn liver,
with noise of both forces; the surface is known to the given error.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.records.measurement.depth_sections import DepthSection, depth_sections, opened_resistance
from cutenv.records.measurement.measured_cut import find_layers
from cutenv.sim.tissue import CutModel, Layers, Specimen
from cutenv.sim.tissue.grid import SPACING
from cutenv.sim.trace import Trace
from scripts.tables import keep_json, kept_json, markdown_table
from scripts.validation.measurement.stepped_cuts import DEPTHS, stepped_cut

KEPT = Path("runs") / "layers" / "layers.json"
CUTS = 6  # number of cuts in a study
SURFACE_ERROR = 0.0003  # error of the depth as measured beforehand, one for each cut [m]
PUT_IN: Mapping[str, Layers] = {  # layers that are put in, by name
    "one tissue": Layers(),
    "tougher and stiffer from 10 mm": Layers(boundary=0.010, deep_toughness=3.0, deep_modulus=2.0),
    "weaker and softer from 9 mm": Layers(boundary=0.009, deep_toughness=0.4, deep_modulus=0.5),
    "a capsule of 0.5 mm, ten times as tough": Layers(
        capsule_thickness=0.0005, capsule_toughness=10.0, capsule_modulus=3.0
    ),
}
GIVEN: Mapping[str, Mapping[str, Mapping[str, Any]]] = {  # numbers that the analysis is told, by what was put in
    "one tissue": {"nothing given": {}, "layer said to begin at 10 mm": {"boundary": 0.010}},
    "tougher and stiffer from 10 mm": {"its depth given": {"boundary": 0.010}, "nothing given": {}},
    "weaker and softer from 9 mm": {"its depth given": {"boundary": 0.009}, "nothing given": {}},
    "a capsule of 0.5 mm, ten times as tough": {"its thickness given": {"capsule_thickness": 0.0005}},
}
SHALLOW = (0.002, 0.010, 0.003, 0.006)  # depths of cuts that tell of a capsule [m]


def cut_in_steps(layers: Layers, study: int, number: int) -> tuple[Trace, list[DepthSection], dict[str, float]]:
    """Cut one drawn liver; return the record, its sections, and what the law was given."""
    specimen = Specimen.drawn(1000 + study, number)
    rng = np.random.default_rng([study, number])
    depths = SHALLOW if layers.capsule_thickness else DEPTHS
    surface = np.maximum(specimen.depth + SURFACE_ERROR * rng.standard_normal(), 1e-4)
    trace, cut = stepped_cut(
        specimen, layers, depths=depths if number % 2 else depths[::-1], depth=surface, seed=study, episode=number
    )
    sections = depth_sections(trace)
    energy = cut.plant.energy()
    floor = cut.plant.floor
    cells = int(float(cut.plant.states["tip"][0]) / SPACING + 0.5) + 1
    area = SPACING * float(floor[:cells].sum())
    return (
        trace,
        sections,
        {
            "resistance": energy["fracture"] / area + specimen.friction_per_depth,
            "friction": specimen.friction_per_depth,
        },
    )


def measure(studies: int) -> dict[str, Any]:
    """Make all studies of all that is put in; return what was found."""
    model, found = CutModel(), []
    resistances = []
    for name, layers in PUT_IN.items():
        for study in range(studies):
            cuts = [cut_in_steps(layers, study, number) for number in range(CUTS)]
            for _, sections, truth in cuts:
                if sections and name == "one tissue":
                    resistances.append({**opened_resistance(sections), **truth, "phi": sections[0].friction_per_depth})
            for told, given in GIVEN[name].items():
                fit, _ = find_layers([trace for trace, _, _ in cuts], model, **given)
                row: dict[str, Any] = {"put in": name, "told": told, "study": study}
                for each in fit.evidence:
                    field = each.name.removeprefix("layers.")
                    measured = each.provenance == "measured"
                    row[field] = [getattr(fit.layers, field), each.low, each.high] if measured else None
                    if measured:
                        row[f"{field} error"] = fit.errors[field]
                found.append(row)
    return {"studies": studies, "cuts": CUTS, "rows": found, "resistances": resistances}


def tables(kept: Mapping[str, Any]) -> str:
    """Return two Markdown tables: resistance by what counts as work, and the layers."""
    return f"{resistance_table(kept['resistances'])}\n\n{layer_table(kept)}"


def resistance_table(rows: Sequence[Mapping[str, float]]) -> str:
    """Return the fracture resistance of cuts through one tissue over what was put in, by what counts as work."""
    names = {
        "both works": "work along and down, less friction, over the area",
        "along": "work along the cut alone, less friction, over the area",
        "component ahead": "force along the cut over new ground, over the area",
        "norm ahead": "norm of both forces over new ground, over the area (thesis)",
    }
    truth = np.array([row["resistance"] for row in rows])
    lines = []
    for key, said in names.items():
        ratio = np.array([row[key] for row in rows]) / truth
        low, middle, high = np.quantile(ratio, [0.05, 0.5, 0.95])
        lines.append((said, f"{middle:.3f}", f"{low:.3f} to {high:.3f}"))
    norm = np.array([row["norm ahead"] / row["component ahead"] for row in rows])
    friction = np.array([row["phi"] / row["friction"] for row in rows])
    head = ("R found by", "over R put in, median", "5 to 95 % of cuts")
    return (
        f"{markdown_table(head, lines)}\n\n"
        f"{len(rows)} cuts of drawn livers in steps of depth. The norm gives {np.median(norm):.3f} times what the "
        f"force along the cut gives (5 to 95 %: {np.quantile(norm, 0.05):.3f} to {np.quantile(norm, 0.95):.3f}). "
        f"Friction per depth is {np.median(friction):.3f} of that put in ({np.quantile(friction, 0.05):.3f} to "
        f"{np.quantile(friction, 0.95):.3f})."
    )


def layer_table(kept: Mapping[str, Any]) -> str:
    """Return what was put in, what was found, and how often the interval holds it."""
    lines = []
    for name, layers in PUT_IN.items():
        for told in GIVEN[name]:
            rows = [row for row in kept["rows"] if (row["put in"], row["told"]) == (name, told)]
            fields = [field for field in Layers.__dataclass_fields__ if any(row[field] for row in rows)]
            if not fields:
                lines.append((name, told, "none", "", f"0 of {len(rows)}", "", "", ""))
            for field in fields:
                true, scale = getattr(layers, field), 1e3 if field == "boundary" else 1.0
                cases = [row for row in rows if row[field]]
                values = np.array([row[field] for row in cases], dtype=float)
                errors = np.array([row[f"{field} error"] for row in cases])
                relative = field != "boundary"
                ratio = np.log(values[:, 0] / true) if relative else values[:, 0] - true
                inside = np.mean((values[:, 1] <= true) & (true <= values[:, 2]))
                real = field != "boundary" or true < 0.1
                spread = f"{100 * ratio.std():.0f} %" if relative else f"{1e3 * ratio.std():.2f} mm"
                told_error = f"{100 * np.median(errors):.0f} %" if relative else f"{1e3 * np.median(errors):.2f} mm"
                unit = " mm" if field == "boundary" else ""
                put = f"{scale * true:.3g}{unit}" if real else "none"
                lines.append(
                    (
                        name, told, field.replace("_", " "), put, f"{len(cases)} of {len(rows)}",
                        f"{scale * float(np.median(values[:, 0])):.3g}{unit}", f"{spread}, told {told_error}",
                        f"{100 * inside:.0f} %" if real else "",
                    )
                )  # fmt: skip
    head = (
        "put in", "the analysis is told", "number", "put in", "identified in", "found, median",
        "spread between studies, and standard error as told", "95 % interval holds it",
    )  # fmt: skip
    return (
        f"{markdown_table(head, lines)}\n\n{kept['studies']} studies of {kept['cuts']} cuts each, surface known to "
        f"{1e3 * SURFACE_ERROR:g} mm."
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=40, metavar="N", help="studies of each kind; default 40")
    parser.add_argument("--print", action="store_true", help="print the kept tables without measuring again")
    arguments = parser.parse_args()
    if arguments.studies < 2:
        parser.error(f"--studies {arguments.studies} is less than 2")
    if not arguments.print:
        keep_json(KEPT, measure(arguments.studies))
    print(tables(kept_json(KEPT, "scripts.validation.measurement.layers")))
