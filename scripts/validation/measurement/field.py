"""Measure how well beads and force give back what was put in; print the marks, and what the thesis says of them.

    python -m scripts.validation.measurement.field            everything, some minutes

Cuts are simulated; a finer mesh than that of the measurement, driven by the force, moves 98 beads as in the thesis (7 x
14, about 1 cm apart), each located to 0.1 mm along every axis, 29.97 times a second
(scripts/validation/measurement/filmed_cuts.py).
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.records.measurement import MeasuredCut, measure_cut
from cutenv.records.measurement.prediction import predicted_ramps
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.tables import table
from cutenv.vision.field_comparison import (
    MeanModulus,
    ZoneModuli,
    compare_field,
    estimate_zone_moduli,
    measure_filmed_cut,
    zones_as_measured,
)
from scripts.tables import markdown_table
from scripts.validation.measurement.filmed_cuts import filmed_cut, slice_of_zones
from scripts.validation.thesis.models import FROM_THE_CLAMP, FROM_THE_LINE, TIP, TIP_DISPLACEMENT, displacement_of_beads

Array = NDArray[np.float64]
FIELD_MARK, MODULUS_MARK = 0.15, 0.10  # RMS [mm]; relative error of a zone's modulus
DEPTH = 0.02  # of the slices [m]
BRICKS: dict[str, Any] = {"element": "hex20", "formulation": "solid", "divisions": (16, 30, 2), "thickness": DEPTH}
LEM_AVERAGE = 81e3  # of five cuts at 0.1 cm/s, section 7.4 [Pa]
LINES = (-0.03, -0.01, 0.01, 0.03)  # of the four cuts of one piece, about 2 cm apart (3.3.2) [m] from its middle
PIECE: dict[str, Any] = {"width": 0.08, "length": 0.12, "divisions": (8, 12)}  # of section 3.2


class Slice(NamedTuple):
    """A slice to be filmed: its zones, and how its beads are moved."""

    name: str
    borders: Sequence[float]
    moduli: Sequence[float]
    options: dict[str, Any] | None = None


SLICES = (
    Slice("one zone", [], [40e3]),
    Slice("one zone, beads moved by bricks", [], [40e3], BRICKS),
    Slice("one zone, 1.27 cm/s", [], [40e3], {"speed": 0.0127}),
    Slice("two zones", [0.05], [25e3, 50e3]),
    Slice("three zones", [0.03, 0.06], [60e3, 30e3, 45e3]),
    Slice("four zones, borders inside elements", [0.025, 0.05, 0.075], [25e3, 60e3, 30e3, 50e3]),
    Slice("three zones, beads moved by bricks", [0.03, 0.06], [60e3, 30e3, 45e3], BRICKS),
    Slice("three zones, beads to 0.3 mm", [0.03, 0.06], [60e3, 30e3, 45e3], {"noise": 3e-4}),
)


def marked(value: float, mark: float, text: str) -> str:
    """Return the text of a number, and MISS if it is above its mark."""
    return text if value <= mark else f"**{text} MISS**"


def filmed_slices(slices: Sequence[Slice]) -> tuple[str, str, str]:
    """Return tables of field, of the modulus measured twice, and of the zones' moduli."""
    fields, twice, zones = [], [], []
    for each in tqdm(slices, desc="filmed cuts"):
        cut = filmed_cut(slice_of_zones(each.borders, each.moduli, DEPTH), **(each.options or {}))
        measured = measure_filmed_cut(cut.tracks, cut.trace, CutModel())
        found = estimate_zone_moduli(measured, each.borders)
        field = compare_field(measured, found.borders, found.modulus)
        thesis = compare_field(measured, *zones_as_measured(measured.moduli))
        rms = [1e3 * field.rms(rows) for rows in (None, field.near, field.far)]
        fields.append(
            (
                each.name,
                marked(rms[0], FIELD_MARK, f"{rms[0]:.3f}"),
                *(f"{value:.3f}" for value in (*rms[1:], 1e3 * field.noise, field.slope, field.correlation)),
                f"{1e3 * thesis.rms():.3f}",
            )
        )
        if len(each.moduli) == 1:
            image = measured.by_image()
            means = (MeanModulus.of(measured.by_force[image.ramp]), MeanModulus.of(image.modulus))
            twice.append((each.name, f"{each.moduli[0] / 1e3:.1f}", *(_interval(mean) for mean in means)))
        alone = [estimate_zone_moduli(measured, each.borders, data=data) for data in ("beads", "force")]
        zones += [(each.name, *row) for row in _zone_rows(each, found, alone)]
    heads = ("slice", "all", "near", "far", "noise", "slope", "correlation", "ramps' own LEM, as the thesis")
    return (
        markdown_table(heads, fields),
        markdown_table(("slice", "put in", "by force", "by image"), twice),
        markdown_table(("slice", "zone", "put in", "found", "error", "beads alone", "force alone"), zones),
    )


def _interval(mean: MeanModulus) -> str:
    return f"{mean.mean / 1e3:.1f} [{mean.low / 1e3:.1f}, {mean.high / 1e3:.1f}]"


def _zone_rows(each: Slice, found: ZoneModuli, alone: Sequence[ZoneModuli]) -> list[tuple[str, ...]]:
    rows = []
    for i, true in enumerate(each.moduli):
        error = found.modulus[i] / true - 1.0
        interval = f"{found.modulus[i] / 1e3:.1f} [{found.low[i] / 1e3:.1f}, {found.high[i] / 1e3:.1f}]"
        off = marked(abs(error), MODULUS_MARK, f"{100 * error:+.1f} %")
        rows.append((str(i + 1), f"{true / 1e3:.0f}", interval, off, *(f"{z.modulus[i] / 1e3:.1f}" for z in alone)))
    return rows


def four_lines() -> str:
    """Return unit stiffness along each of four lines in one piece over that of a lone centred one, by order."""
    places = np.array([0.03, 0.06, 0.09])
    centred = CutModel(**PIECE).stiffness(places)
    rows = []
    for number, line in enumerate(LINES):
        earlier = tuple((other - line, float(PIECE["length"])) for other in LINES[:number])
        models = (CutModel(offset=line, **PIECE), CutModel(offset=line, earlier_cuts=earlier, **PIECE))
        ratios = [np.asarray(model.stiffness(places)) / centred for model in models]
        cells = [f"{alone:.2f}, {after:.2f}" for alone, after in zip(*ratios, strict=True)]
        rows.append((f"{number + 1}", f"{100 * line:+.0f}", *cells))
    return markdown_table(("cut", "x [cm]", *(f"at {100 * a:.0f} cm" for a in places)), rows)


def table_7_1() -> str:
    """Return Table 7.1 with our fit to its finite elements, and which beads agree with its experiment."""
    data, ours = table("7.1"), 100 * displacement_of_beads()
    rows = []
    for bead, fem, own, moved in zip(
        data["bead"], data["fem_displacement_cm"], ours, data["experimental_displacement_cm"], strict=True
    ):
        agrees = abs(fem / moved - 1.0) <= 0.25 + 1e-9
        fitted = marked(10 * abs(own - fem), 0.2, f"{own:.2f}")
        rows.append((f"{bead:.0f}", f"{fem:.2f}", fitted, f"{moved:.2f}", "yes" if agrees else "**no**"))
    printed = ("bead", "finite elements, thesis", "fit", "experiment, thesis", "elements within 25 %")
    return markdown_table(printed, rows)


def layout() -> str:
    """Return the layout that was fitted to Table 7.1, in words."""
    beside = " and ".join(f"{100 * x:g}" for x in FROM_THE_LINE)
    return (
        f"Layout of the fit: beads 1 to 4 and 5 to 8 lie {beside} cm beside the line, {100 * FROM_THE_CLAMP[0]:g} to "
        f"{100 * FROM_THE_CLAMP[-1]:g} cm from the clamp; the tip at {100 * TIP:g} cm moves by "
        f"{1000 * TIP_DISPLACEMENT:g} mm. It is a fit, found by hand, of four numbers to eight; Figure 7.12, which "
        "shows the places, is lost."
    )


def section_7_4(livers: int) -> str:
    """Return how five cuts predict the sixth, of the same liver and of another one, in livers of the thesis's mean.

    The liver's stiffness is such that LEM_avg is about 81 kPa.
    """
    model, mean = CutModel(), float(table("5.6")["lem_plane_stress_90_deg_Pa"][0])
    rows = []
    for number in tqdm(range(livers), desc="livers of six cuts"):
        cuts = [cut_of_liver(number, i, LEM_AVERAGE / mean, model) for i in range(6)]
        other = cut_of_liver(1000 + number, 0, None, model)
        average = float(np.mean([cut.material_modulus for cut in cuts[:5]]))
        lem = float(np.mean([cut.moduli.mean for cut in cuts[:5]]))
        same, different = (_error(cut, average, model) for cut in (cuts[5], other))
        rows.append((lem, same, different))
    lem, same, different = np.array(rows).T
    return "\n".join(
        [
            f"LEM_avg of the thesis, five cuts of one liver at 0.1 cm/s: {LEM_AVERAGE / 1e3:.0f} kPa",
            f"mean of Table 5.6 at 0.1 cm/s, 90 degrees:              {mean / 1e3:.0f} kPa "
            f"(SD {table('5.6')['sd_plane_stress_90_deg_Pa'][0] / 1e3:.0f})",
            f"cuts of Table 5.1 at 0.1 cm/s, one to a liver:          {_range_of_5_1()} kPa",
            f"LEM_avg of {livers} virtual livers, {LEM_AVERAGE / mean:.2f} times as stiff:   "
            f"{lem.mean() / 1e3:.0f} kPa ({lem.min() / 1e3:.0f} to {lem.max() / 1e3:.0f})",
            f"sixth cut from LEM_avg, same liver:  RMS {100 * np.median(same):.0f} % of the peak (median)",
            f"a cut of another liver from it:      RMS {100 * np.median(different):.0f} % of the peak (median)",
            f"the same liver is predicted better in {int((same < different).sum())} of {livers}",
        ]
    )


def _range_of_5_1() -> str:
    cuts = table("5.1")["lem_plane_stress_at_0.10_cm_s_Pa"] / 1e3
    return f"{cuts.min():.0f} to {cuts.max():.0f}"


def cut_of_liver(liver: int, number: int, factor: float | None, model: CutModel) -> MeasuredCut:
    """Make and measure a cut of a drawn liver at 0.1 cm/s, by ``factor`` as stiff as the mean, or drawn too."""
    specimen = Specimen.draw(generator(74, 10 * liver + number), liver_factor=factor)
    plant = SimulatedPlant(specimen, seed=74, episode=10 * liver + number)
    legs = [Leg(position=0.0, speed=0.001, dwell=0.5), Leg(position=0.1, speed=0.001), Leg(position=0.0, speed=0.0127)]
    return measure_cut(to_trace(plant, run(plant, legs)), model)


def _error(cut: MeasuredCut, modulus: float, model: CutModel) -> float:
    """Return the RMS difference of predicted and measured force on the ramps over the largest force [1]."""
    ramps = predicted_ramps(cut, model, modulus)
    squares = np.concatenate([(ramp.predicted - ramp.measured) ** 2 for ramp in ramps])
    return float(np.sqrt(squares.mean()) / max(ramp.measured.max() for ramp in ramps))


def main(argv: Sequence[str] | None = None) -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="three slices, and two livers for section 7.4")
    quick = parser.parse_args(argv).quick
    field, twice, zones = filmed_slices([SLICES[i] for i in (0, 3, 4)] if quick else SLICES)
    parts = {
        f"Field: RMS of the difference of tracked and computed displacements [mm]; mark {FIELD_MARK} mm": field,
        "The same cut measured twice: modulus, 95 % interval of the mean [kPa]": twice,
        f"Moduli of zones from beads and force together [kPa]; mark {100 * MODULUS_MARK:.0f} %": zones,
        "Four cuts of one piece: unit stiffness over that of a lone centred cut, without and after the earlier cuts": (
            four_lines()
        ),
        "Table 7.1: displacement during one loading section [cm]": f"{table_7_1()}\n\n{layout()}",
        "Section 7.4: a cut predicted from five others": f"```\n{section_7_4(2 if quick else 12)}\n```",
    }
    print("\n\n".join(f"### {title}\n\n{text}" for title, text in parts.items()))


if __name__ == "__main__":
    main()
