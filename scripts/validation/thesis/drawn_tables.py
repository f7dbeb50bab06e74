"""Tables 5.1 to 5.6, equations 5.1 to 5.8 and Table 6.1 beside sampled livers that were cut and measured likewise."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cutenv.records.measurement.segments import SMALLEST_DROP
from cutenv.sim.tissue.description import CUTS_PER_LIVER
from cutenv.sim.tissue.tables import table
from scripts.derivations.specimens import CUTS_OF_TABLE_6_1, SIGNIFICANT_DROP
from scripts.validation.thesis import drawn_livers
from scripts.validation.thesis.drawn_livers import QUICK_SPEEDS_CM_S, DrawnCut, speeds
from scripts.validation.thesis.models import FORMULATIONS
from scripts.validation.thesis.moduli import CUTS, EQUATIONS, means_by_speed
from scripts.validation.thesis.rows import Check, Found, Row, check, hits, near, unclaimed
from scripts.validation.thesis.scatter import Line, Sample, coefficient_rows, joint_row, mean_row, sd_row

Array = NDArray[np.float64]
Kinds = Callable[[DrawnCut], tuple[Array, Array]]

BY_CUT = (  # Tables with a row for each cut: number, angle [deg], speed [cm/s]
    ("5.1", 45, 0.1),
    ("5.1", 45, 1.27),
    ("5.1", 45, 2.54),
    ("5.2", 90, 0.1),
    ("5.3", 90, 1.27),
    ("5.4", 90, 2.54),
)
CUTS_UPRIGHT = 12  # cuts in a mean of Table 5.5 at 90 degrees where Tables 5.2 to 5.4 list them (chapter 5)

FITTED_TO = (
    "Mean modulus and resistance of the livers, and the spread between their cuts, were fitted to Tables 5.2-5.4, 5.6 "
    "and 6.1, each as one number over all rows (scripts/derivations/specimens.py); no row was fitted by itself."
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
BEFORE_OR_AFTER = (
    "Section 5.4 has the increment of force divided by the depth of cut, section 3.4.2 the force divided by it "
    "before the increment is taken; a blade that comes into deeper tissue makes the second the smaller one. The first "
    "is compared; the second is shown."
)
BY_CHANCE = "Of rows that differ by chance alone one in twenty would miss."


TWICE = (
    "Moduli in plane strain are those in plane stress times one factor, on both sides: their rows are shown and not "
    "counted."
)
JOINT = (
    "A mean of six cuts may err by a fifth and be within its scatter. So the means of a table at one angle are also "
    "compared together; those of Table 5.5 at 90 degrees are too low in ours."
)


CONTRADICTORY = {("5.1", 45), ("5.5", 45)}
"""Table and angle [deg] that contradict Table 5.6, from which the cutting law takes LEM(v): shown, not claimed."""


def means_by_cut(number: str, speed: float, formulation: str) -> tuple[Array, Array]:
    """Return the mean LEM and the standard deviation within each cut [kPa] of one of Tables 5.1 to 5.4."""
    column = f"{formulation}_at_{speed:.2f}_cm_s_Pa" if number == "5.1" else f"{formulation}_Pa"
    return table(number)[f"lem_{column}"] / 1e3, table(number)[f"sd_{column}"] / 1e3


@check(
    "livers-by-cut",
    lambda quick: f"LEM of drawn livers cut by cut, {_number(quick)}: means, SD between and within cuts",
    "Tables 5.1-5.4",
    "scatter of both",
    most_misses=4,  # of 9 quick ones; Table 5.4, and the scatter within a cut in Tables 5.3 and 5.4
    notes=(FITTED_TO, TWICE, ONE_SHARE, BY_CHANCE, SIGNIFICANT, table("5.5").errata[1]),
)
def cuts_by_cuts(quick: bool) -> Found:
    """Compare Tables 5.1 to 5.4: mean of the cuts, standard deviation between them, and mean of those within them."""
    rows = []
    for number, angle_deg, speed in BY_CUT:
        own = drawn_livers.cuts(speed, angle_deg, quick)
        for formulation in FORMULATIONS:
            mean, sd = means_by_cut(number, speed, formulation)
            moduli = [cut.as_measured[formulation, 0.3] / 1e3 for cut in own]
            of = f"{formulation.replace('_', ' ')}, {len(own)} cuts"
            name = f"Table {number}, {angle_deg} deg, {speed:.2f} cm/s, {of}"
            between = Sample.of(mean), Sample.of(np.array([m.mean() for m in moduli]))
            within = Sample.of(sd), Sample.of(np.array([m.std() for m in moduli]))
            new = [mean_row(name, *between), sd_row(name, *between), mean_row(f"{name}, SD within a cut", *within)]
            rows += new if _claimed(number, angle_deg, formulation) else map(unclaimed, new)
    return rows, f"{hits(rows)} agree"


def average_table(
    number: str, title: str, note: str, what: str, kinds: Callable[[DrawnCut], tuple[Array, Array]]
) -> Check:
    """Return the entry of Table 5.5 or 5.6: mean and standard deviation of the cuts by speed and angle.

    ``kinds`` are the moduli of a cut by another reading and by the usual one; the ratio of their means is shown.
    """

    def found(quick: bool) -> Found:
        rows: list[Row] = []
        joint: list[Row] = []
        for angle_deg, formulation in itertools.product((90, 45), FORMULATIONS):
            references, samples = [], []
            for speed, mean, sd in zip(*means_by_speed(number, angle_deg, formulation), strict=True):
                if quick and speed not in QUICK_SPEEDS_CM_S:
                    continue
                reference = Sample(mean, sd, _cuts_behind(number, angle_deg, speed))
                ours = Sample.of(cut_means(number, angle_deg, formulation, speed, quick))
                name = f"{angle_deg} deg, {speed:.2f} cm/s, {formulation.replace('_', ' ')}, {ours.n} cuts"
                references.append(reference)
                samples.append(ours)
                new = [mean_row(name, reference, ours), sd_row(name, reference, ours)]
                rows += new if _claimed(number, angle_deg, formulation) else map(unclaimed, new)
            together = joint_row(f"{angle_deg} deg, {formulation.replace('_', ' ')}", references, samples)
            joint.append(together if _claimed(number, angle_deg, formulation) else unclaimed(together))
        shown = []
        for angle_deg in (90, 45):
            other, usual = np.mean([[kind.mean() for kind in kinds(cut)] for cut in cuts_at(angle_deg, quick)], axis=0)
            shown.append(near(f"{angle_deg} deg, all speeds: {what}", 1.0, other / usual, form=".2f"))
        summary = f"{hits(rows[::2])} means, {hits(rows[1::2])} SDs, {hits(joint)} tables of means agree"
        return rows + joint + shown, summary

    return check(
        f"livers-{number.replace('.', '-')}",
        lambda quick: f"LEM of drawn livers by speed and angle, {_number(quick)}: {title}",
        f"Table {number}",
        "scatter of both",
        most_misses=2,  # of 7 quick rows of Table 5.5, its means at 2.54 cm/s and together, and of 14 of Table 5.6
        notes=(FITTED_TO, TWICE, JOINT, BY_CHANCE, note),
    )(found)


TABLE_5_5 = average_table(
    "5.5",
    "force as measured",
    SIGNIFICANT,
    f"mean with drops of {SMALLEST_DROP:g} N over that with {SIGNIFICANT_DROP:g} N",
    lambda cut: (cut.with_small_drops, cut.as_measured["plane_stress", 0.3]),
)
TABLE_5_6 = average_table(
    "5.6",
    "force per depth of cut",
    BEFORE_OR_AFTER,
    "mean by section 3.4.2 over that by 5.4",
    lambda cut: (cut.of_force_per_depth, cut.per_depth["plane_stress", 0.3]),
)


@check(
    "livers-equations",
    lambda quick: f"Fits of LEM against speed to drawn livers, {_number(quick)}, beside those to the tables [95 %]",
    "equations 5.1-5.8",
    "scatter about both lines",
    most_misses=3,  # of 6 quick ones; the lines at 45 degrees, of four cuts that differ much
    notes=(TWICE, table("5.5").errata[1]),
)
def equations(quick: bool) -> Found:
    """Compare equations 5.1 to 5.8: the thesis's fit to its means, and the same fit to ours."""
    rows: list[Row] = []
    for each in EQUATIONS[:8]:
        speed, mean, _ = means_by_speed(each.table, each.angle_deg, each.formulation)
        present = np.isin(speed, speeds(quick))
        means = [cut_means(each.table, each.angle_deg, each.formulation, v, quick).mean() for v in speed[present]]
        fit = Line.through_logarithms if each.is_power else Line.through
        names = ("exponent", "coefficient, kPa") if each.is_power else ("slope, kPa s/cm", "intercept, kPa")
        lines = fit(speed, mean), fit(speed[present], np.array(means))
        new = coefficient_rows(each.name, *lines, slope=names[0], intercept=names[1])
        rows += new if _claimed(each.table, each.angle_deg, each.formulation) else map(unclaimed, new)
    return rows, f"{hits(rows)} coefficients agree"


@check(
    "livers-6-1",
    lambda quick: (
        f"Apparent fracture resistance of drawn livers, {len(cuts_at(90, quick))} upright cuts of all speeds, by length"
    ),
    "Table 6.1",
    "scatter of both",
    most_misses=1,  # of 6 quick ones
    notes=(
        FITTED_TO,
        "The table's SDs run from 14 to 142 J/m2: wider apart than samples of six from one population come to be.",
    ),
)
def resistance(quick: bool) -> Found:
    """Compare Table 6.1: apparent fracture resistance by length of cut, upright, all speeds."""
    data = table("6.1")
    own = cuts_at(90, quick)
    rows: list[Row] = []
    columns = ("cut_length_inch", "cut_length_m", "fracture_resistance_J_m2", "sd_fracture_resistance_J_m2")
    for inches, length, mean, sd in zip(*(data[column] for column in columns), strict=True):
        apparent = np.array([cut.apparent for cut in own if cut.length == length])
        if len(apparent):
            reference, ours = Sample(mean, sd, CUTS_OF_TABLE_6_1), Sample.of(apparent)
            name = f"{inches:g} inch, {len(apparent)} cuts, J/m2"
            rows += [mean_row(name, reference, ours), sd_row(name, reference, ours)]
    mean, sd, _ = Sample.of(np.array([cut.apparent for cut in own]))
    return rows, f"{hits(rows[::2])} means, {hits(rows[1::2])} SDs agree; all: {mean:.0f} +- {sd:.0f} J/m2"


def cuts_at(angle_deg: float, quick: bool) -> list[DrawnCut]:
    """Return the cuts of all speeds at one angle."""
    return [cut for speed in speeds(quick) for cut in drawn_livers.cuts(speed, angle_deg, quick)]


def cut_means(number: str, angle_deg: float, formulation: str, speed: float, quick: bool) -> Array:
    """Return the mean LEM [kPa] of each sampled cut, as defined in one of Tables 5.5 to 5.7."""
    own = drawn_livers.cuts(float(speed), angle_deg, quick)
    moduli = [cut.as_measured if number == "5.5" else cut.per_depth for cut in own]
    poisson = 0.499 if number == "5.7" else 0.3
    return np.array([each[formulation, poisson].mean() / 1e3 for each in moduli])


def _claimed(number: str, angle_deg: float, formulation: str) -> bool:
    """Return whether rows claim to agree: not where tables contradict each other, nor the same numbers twice."""
    return (number, angle_deg) not in CONTRADICTORY and formulation == "plane_stress"


def _cuts_behind(number: str, angle_deg: float, speed: float) -> int:
    listed = number == "5.5" and angle_deg == 90 and speed in QUICK_SPEEDS_CM_S
    return CUTS_UPRIGHT if listed else CUTS


def _number(quick: bool) -> str:
    return f"{drawn_livers.livers(quick) * CUTS_PER_LIVER} cuts each"
