"""Tables 5.1 to 5.6, equations 5.1 to 5.8 and Table 6.1 beside sampled livers that were cut and measured likewise."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from fit_specimens import CUTS_OF_TABLE_6_1, SIGNIFICANT_DROP
from numpy.typing import NDArray

from cutenv.measurement.segments import SMALLEST_DROP
from cutenv.tissue.tables import table
from cutenv.tissue.variance_components import CUTS_PER_LIVER
from reproduction import drawn_livers
from reproduction.drawn_livers import QUICK_SPEEDS_CM_S, DrawnCut, speeds
from reproduction.rows import Comparison, Row, hits, near, unclaimed
from reproduction.scatter import Line, Sample, coefficient_rows, mean_row, sd_row

Array = NDArray[np.float64]

FORMULATIONS = ("plane_stress", "plane_strain")
BY_CUT = (
    ("5.1", 45, 0.1),
    ("5.1", 45, 1.27),
    ("5.1", 45, 2.54),
    ("5.2", 90, 0.1),
    ("5.3", 90, 1.27),
    ("5.4", 90, 2.54),
)
"""Tables with a row for each cut: number, angle [deg], speed [cm/s]."""
CUTS_UPRIGHT, CUTS = 12, 6
"""Cuts in a mean of Table 5.5 at 90 degrees where Tables 5.2 to 5.4 list them, and in all others (chapter 5)."""

FITTED_TO = (
    "Mean modulus and resistance of the livers, and the spread between their cuts, were fitted to Tables 5.2-5.4, 5.6 "
    "and 6.1, each as one number over all rows (scripts/fit_specimens.py); no row was fitted by itself."
)
SIGNIFICANT = (
    f"Drops of {SIGNIFICANT_DROP:g} N and more count as significant; the thesis does not give its own limit. With "
    f"{SMALLEST_DROP:g} N the shallow beginning of a cut shows segments too, and moduli without depth come out lower."
)
ONE_SHARE = (
    "Within a cut, and in the mean at 2.54 cm/s, the livers show less than Tables 5.3 and 5.4: the law takes its speed "
    "from Table 5.6, by which cuts at that speed were 1.7 cm deep, not 1.4, and has one share of stable growth along "
    "a cut."
)
BY_CHANCE = "Of rows that differ by chance alone one in twenty would miss."


class Measured(NamedTuple):
    """Selection of the moduli of one table from a cut."""

    poisson: float
    moduli: Callable[[DrawnCut], dict[tuple[str, float], Array]]


AVERAGES = {
    "5.5": Measured(0.3, lambda cut: cut.as_measured),
    "5.6": Measured(0.3, lambda cut: cut.per_depth),
    "5.7": Measured(0.499, lambda cut: cut.per_depth),
}
EQUATIONS = (
    ("5.1", "5.5", 90, "plane_stress"),
    ("5.2", "5.5", 90, "plane_strain"),
    ("5.3", "5.5", 45, "plane_stress"),
    ("5.4", "5.5", 45, "plane_strain"),
    ("5.5", "5.6", 90, "plane_stress"),
    ("5.6, printed as 5.7", "5.6", 90, "plane_strain"),
    ("5.7, printed as 5.6", "5.6", 45, "plane_stress"),
    ("5.8", "5.6", 45, "plane_strain"),
)
CONTRADICTORY = {("5.1", 45), ("5.5", 45)}
"""Table and angle [deg] that contradict Table 5.6, from which the cutting law takes LEM(v): shown, not claimed."""


def cuts_by_cuts(quick: bool) -> Comparison:
    """Compare Tables 5.1 to 5.4: mean of the cuts, standard deviation between them, and mean of those within them."""
    rows = []
    for number, angle_deg, speed in BY_CUT:
        data, own = table(number), drawn_livers.cuts(speed, angle_deg, quick)
        for formulation in FORMULATIONS:
            column = f"{formulation}_at_{speed:.2f}_cm_s_Pa" if number == "5.1" else f"{formulation}_Pa"
            moduli = [cut.as_measured[formulation, 0.3] / 1e3 for cut in own]
            name = (
                f"Table {number}, {angle_deg} deg, {speed:.2f} cm/s, {formulation.replace('_', ' ')}, {len(own)} cuts"
            )
            between = Sample.of(data[f"lem_{column}"] / 1e3), Sample.of(np.array([m.mean() for m in moduli]))
            within = Sample.of(data[f"sd_{column}"] / 1e3), Sample.of(np.array([m.std() for m in moduli]))
            new = [mean_row(name, *between), sd_row(name, *between), mean_row(f"{name}, SD within a cut", *within)]
            rows += map(unclaimed, new) if (number, angle_deg) in CONTRADICTORY else new
    return Comparison(
        title=f"LEM of drawn livers cut by cut, {_number(quick)}: means, SD between and within cuts",
        source="Tables 5.1-5.4",
        ours=f"{hits(rows)} agree",
        tolerance="scatter of both",
        rows=tuple(rows),
        notes=(
            FITTED_TO,
            ONE_SHARE,
            BY_CHANCE,
            SIGNIFICANT,
            table("5.5").errata[1],
        ),
    )


def average_tables(number: str) -> Callable[[bool], Comparison]:
    """Return the comparison with Table 5.5 or 5.6: mean and standard deviation of the cuts by speed and angle."""

    def compare(quick: bool) -> Comparison:
        rows: list[Row] = []
        for angle_deg in (90, 45):
            for formulation in FORMULATIONS:
                for speed, mean, sd in zip(*_printed(number, angle_deg, formulation), strict=True):
                    if quick and speed not in QUICK_SPEEDS_CM_S:
                        continue
                    reference = Sample(mean, sd, _cuts_behind(number, angle_deg, speed))
                    ours = Sample.of(cut_means(number, angle_deg, formulation, speed, quick))
                    name = f"{angle_deg} deg, {speed:.2f} cm/s, {formulation.replace('_', ' ')}, {ours.n} cuts"
                    new = [mean_row(name, reference, ours), sd_row(name, reference, ours)]
                    rows += map(unclaimed, new) if (number, angle_deg) in CONTRADICTORY else new
        claims, notes = list(rows), [FITTED_TO, BY_CHANCE]
        rows += OTHER_READINGS[number](quick) if number in OTHER_READINGS else []
        notes.append(NOTES[number])
        means, sds = claims[::2], claims[1::2]
        return Comparison(
            title=f"LEM of drawn livers by speed and angle, {_number(quick)}: {TITLES[number]}",
            source=f"Table {number}",
            ours=f"{hits(means)} means, {hits(sds)} SDs agree",
            tolerance="scatter of both",
            rows=tuple(rows),
            notes=tuple(notes),
        )

    return compare


TITLES = {
    "5.5": "force as measured",
    "5.6": "force per depth of cut",
}
NOTES = {
    "5.5": SIGNIFICANT,
    "5.6": "Section 5.4 has the increment of force divided by the depth of cut, section 3.4.2 the force divided by it "
    "before the increment is taken; a blade that comes into deeper tissue makes the second the smaller one. The first "
    "is compared; the second is shown.",
}


def other_limit(quick: bool) -> list[Row]:
    """Return moduli without depth for a lower limit of a drop over those for the usual one, by angle."""
    what = f"mean with drops of {SMALLEST_DROP:g} N over that with {SIGNIFICANT_DROP:g} N"
    return _shown(what, lambda cut: (cut.with_small_drops, cut.as_measured["plane_stress", 0.3]), quick)


def other_reading(quick: bool) -> list[Row]:
    """Return moduli by increments of F/B over those by increments of F over B, by angle."""
    what = "mean by section 3.4.2 over that by 5.4"
    return _shown(what, lambda cut: (cut.of_force_per_depth, cut.per_depth["plane_stress", 0.3]), quick)


OTHER_READINGS = {"5.5": other_limit, "5.6": other_reading}


def _shown(what: str, moduli: Callable[[DrawnCut], tuple[Array, Array]], quick: bool) -> list[Row]:
    """Return the mean over the cuts of one kind of moduli over that of another, for each angle."""
    rows = []
    for angle_deg in (90, 45):
        own = [cut for speed in speeds(quick) for cut in drawn_livers.cuts(speed, angle_deg, quick)]
        other, usual = np.mean([[kind.mean() for kind in moduli(cut)] for cut in own], axis=0)
        rows.append(near(f"{angle_deg} deg, all speeds: {what}", 1.0, other / usual, form=".2f"))
    return rows


def equations(quick: bool) -> Comparison:
    """Compare equations 5.1 to 5.8: the thesis's fit to its means, and the same fit to ours."""
    rows: list[Row] = []
    for equation, number, angle_deg, formulation in EQUATIONS:
        speed, mean, _ = _printed(number, angle_deg, formulation)
        present = np.isin(speed, speeds(quick))
        ours = np.array([cut_means(number, angle_deg, formulation, v, quick).mean() for v in speed[present]])
        power = number == "5.5" and angle_deg == 45
        fit = Line.through_logarithms if power else Line.through
        names = ("exponent", "coefficient, kPa") if power else ("slope, kPa s/cm", "intercept, kPa")
        new = coefficient_rows(
            f"({equation}) {angle_deg} deg {formulation.replace('_', ' ')}",
            fit(speed, mean),
            fit(speed[present], ours),
            slope=names[0],
            intercept=names[1],
        )
        rows += map(unclaimed, new) if (number, angle_deg) in CONTRADICTORY else new
    return Comparison(
        title=f"Fits of LEM against speed to drawn livers, {_number(quick)}, beside those to the tables [95 %]",
        source="equations 5.1-5.8",
        ours=f"{hits(rows)} coefficients agree",
        tolerance="scatter about both lines",
        rows=tuple(rows),
        notes=(table("5.5").errata[1],),
    )


def resistance(quick: bool) -> Comparison:
    """Compare Table 6.1: apparent fracture resistance by length of cut, upright, all speeds."""
    data = table("6.1")
    own = [cut for speed in speeds(quick) for cut in drawn_livers.cuts(speed, 90, quick)]
    rows: list[Row] = []
    columns = ("cut_length_inch", "cut_length_m", "fracture_resistance_J_m2", "sd_fracture_resistance_J_m2")
    for inches, length, mean, sd in zip(*(data[column] for column in columns), strict=True):
        apparent = np.array([cut.apparent for cut in own if cut.length == length])
        if len(apparent):
            reference, ours = Sample(mean, sd, CUTS_OF_TABLE_6_1), Sample.of(apparent)
            name = f"{inches:g} inch, {len(apparent)} cuts, J/m2"
            rows += [mean_row(name, reference, ours), sd_row(name, reference, ours)]
    mean, sd, _ = Sample.of(np.array([cut.apparent for cut in own]))
    return Comparison(
        title=f"Apparent fracture resistance of drawn livers, {len(own)} upright cuts of all speeds, by length",
        source="Table 6.1",
        ours=f"{hits(rows[::2])} means, {hits(rows[1::2])} SDs agree; all: {mean:.0f} +- {sd:.0f} J/m2",
        tolerance="scatter of both",
        rows=tuple(rows),
        notes=(
            FITTED_TO,
            "The table's SDs run from 14 to 142 J/m2: wider apart than samples of six from one population come to be.",
        ),
    )


def cut_means(number: str, angle_deg: float, formulation: str, speed: float, quick: bool) -> Array:
    """Return the mean LEM [kPa] of each sampled cut, as defined in one of Tables 5.5 to 5.7."""
    poisson, moduli = AVERAGES[number]
    own = drawn_livers.cuts(float(speed), angle_deg, quick)
    return np.array([moduli(cut)[formulation, poisson].mean() / 1e3 for cut in own])


def _printed(number: str, angle_deg: float, formulation: str) -> tuple[Array, Array, Array]:
    """Return the speeds [cm/s], means and standard deviations [kPa] of a table."""
    data = table(number)
    mean, sd = (data[f"{x}_{formulation}_{angle_deg}_deg_Pa"] / 1e3 for x in ("lem", "sd"))
    present = np.isfinite(mean)
    return data["speed_cm_s"][present], mean[present], sd[present]


def _cuts_behind(number: str, angle_deg: float, speed: float) -> int:
    listed = number == "5.5" and angle_deg == 90 and speed in QUICK_SPEEDS_CM_S
    return CUTS_UPRIGHT if listed else CUTS


def _number(quick: bool) -> str:
    return f"{drawn_livers.livers(quick) * CUTS_PER_LIVER} cuts each"
