"""Appearance of a cut: units, depth, the forward-backward protocol, and energy under any policy."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.records.measurement import loading_segments
from cutenv.sim.cutting.drive import Hand, Rig
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import Specimen
from scripts.validation.thesis import drawn_livers
from scripts.validation.thesis.measuring import LIVERS, watched
from scripts.validation.thesis.rows import Found, Row, at_most, check, holds, near
from scripts.validation.thesis.virtual_cuts import INCH, SPEEDS, VirtualCut, cm_s, virtual_cut

TRAVEL = 0.12  # of the thesis's cuts [m]
RANK_CORRELATION = -0.5  # reached by chance once in twenty times by 12 numbers, and never by 150
DEPTHS_CM = (0.5, 1.0, 2.0)
POLICY_SECONDS = 8.0
_HOLD = 50  # ticks for which a random policy keeps its command
_CLEAR = 2e-3  # distance from the ends of the crack beyond which only friction is left [m]

Array = NDArray[np.float64]


@check("units", "Units per length fall with speed", "section 3.3.2, Figure 3.3", "shown")
def units_fall_with_speed(quick: bool) -> Found:
    """Check section 3.3.2: "more loading and unloading" in slow cutting."""
    rows = []
    for kind in watched(("2 cm", *(LIVERS[: 1 if quick else 3])), "units by speed"):
        cuts = [virtual_cut(kind, speed=v, turns=(TRAVEL,)) for v in SPEEDS]
        runs = [int(np.count_nonzero(cut.readings["jump"])) for cut in cuts]
        ramps = [len(loading_segments(cut.trace)) for cut in cuts]
        for what, counts in (("crack runs", runs), ("loading segments found", ramps)):
            text = ", ".join(str(n) for n in counts)
            falls = counts[0] > counts[1] > counts[2]
            rows.append(holds(f"{kind}: {what} in 12 cm at 0.1, 1.27, 2.54 cm/s", "fall with speed", text, falls))
    rows += [_units_of_drawn_livers(angle_deg, quick) for angle_deg in (90, 45)]
    return rows, f"{rows[1].ours} segments in 12 cm at 0.1, 1.27, 2.54 cm/s"


def _units_of_drawn_livers(angle_deg: float, quick: bool) -> Row:
    """Count units in many cuts per speed, each in another place: the number falls on average, not in every pair."""
    speeds = drawn_livers.speeds(quick)
    counts = [[cut.segments for cut in drawn_livers.cuts(v, angle_deg, quick)] for v in speeds]
    averages = [float(np.mean(numbers)) for numbers in counts]
    rank = float(stats.spearmanr(speeds, averages).statistic)
    means = ", ".join(f"{average:.0f}" for average in averages)
    what = f"drawn livers, {angle_deg:g} deg: mean number of steady segments in 12 cm at {len(speeds)} speeds"
    ours = f"{means} (rank correlation with speed {rank:.2f})"
    return holds(what, "fall with speed", ours, rank < RANK_CORRELATION)


@check("depth", "Force follows depth of cut, force per depth does not", "sections 3.3.2, 5.4", "shown")
def force_follows_depth(quick: bool) -> Found:
    """Check sections 3.3.2 and 5.4: the force follows the depth of cut, the force per depth does not."""
    rows = []
    cuts = {depth: virtual_cut(f"{depth:g} cm", turns=(TRAVEL,)) for depth in DEPTHS_CM}
    peaks = {depth: float(cut.readings["true_force"].max()) for depth, cut in cuts.items()}
    for depth in DEPTHS_CM[:-1]:
        ratio = peaks[2.0] / peaks[depth]
        rows.append(near(f"peak force at 2 cm over that at {depth:g} cm", 2.0 / depth, ratio, relative=0.02))
        per_depth = ratio * depth / 2.0
        rows.append(near(f"the same, force per depth of cut, {depth:g} cm", 1.0, per_depth, relative=0.02))
    bulge = virtual_cut("bulge", turns=(TRAVEL,))
    hilltops, depth_there = hilltop_forces(bulge)
    cv_force, cv_per_depth = (float(x.std() / x.mean()) for x in (hilltops, hilltops / depth_there))
    correlation = float(np.corrcoef(hilltops, depth_there)[0, 1])
    what, ours = "bulge: CV of hilltop force; of hilltop force per depth", f"{cv_force:.2f}; {cv_per_depth:.2f}"
    rows += [
        holds("bulge: correlation of hilltop force and depth", "near 1", f"{correlation:.3f}", correlation > 0.95),
        holds(what, "large; small", ours, cv_per_depth < 0.25 * cv_force),
    ]
    return rows, f"along the bulge: CV {cv_force:.2f} of the force, {cv_per_depth:.2f} per depth"


def hilltop_forces(cut: VirtualCut) -> tuple[Array, Array]:
    """Return the force [N] from which each crack run started, and the depth of cut at the blade there [m]."""
    before = np.flatnonzero(cut.readings["jump"]) - 1
    before = before[before >= 0]
    assert cut.trace.depth is not None
    return np.asarray(cut.readings["true_force"][before]), cut.trace.depth[before]


def protocol(kind: str, speed: float) -> VirtualCut:
    """Cut by the protocol of section 6.2: cut 1 inch, return, travel on to 2 inches, return."""
    return virtual_cut(kind, speed=speed, turns=(INCH, 0.0, 2 * INCH, 0.0))


def legs(cut: VirtualCut) -> tuple[slice, slice, slice, slice]:
    """Return the readings of the four strokes: forward and back, forward and back."""
    x = cut.readings["position"]
    clear = 3e-6  # distance at which the blade has arrived at a turning point [m]
    first = int(np.argmax(x >= INCH - clear))
    start = first + int(np.argmax(x[first:] <= clear))
    second = start + int(np.argmax(x[start:] >= 2 * INCH - clear))
    return slice(0, first), slice(first, start), slice(start, second), slice(second, len(x))


@check(
    "forward-backward",
    "Forward-backward protocol: friction to and fro, force where it left off, energy",
    "Figures 6.5-6.7",
    "shape; 1 % of friction and force",
)
def forward_backward(quick: bool) -> Found:
    """Check Figures 6.5 to 6.7: friction in the open crack is the same to and fro, the cut resumes, energy closes."""
    rows: list[Row] = []
    for kind in ("2 cm", "liver 1"):
        for speed in SPEEDS[:1] if quick else SPEEDS:
            rows += _protocol_rows(protocol(kind, speed), f"{kind}, {cm_s(speed)}")
    friction = max(abs(100 * float(row.ours) - 100) for row in rows if "friction" in row.what)
    resumed = [100 * float(row.ours) for row in rows if "resumes" in row.what]
    residual = max(float(row.ours) for row in rows if "residual" in row.what)
    return (
        rows,
        f"within {friction:.1f} %; resumes at {min(resumed):.1f} to {max(resumed):.1f} % of what it was; "
        f"residual {residual:.0e}",
    )


def _protocol_rows(cut: VirtualCut, name: str) -> list[Row]:
    _, back, on, _ = legs(cut)
    x, F, tip = (cut.readings[field] for field in ("position", "true_force", "tip"))
    first_tip = float(tip[back][0])
    crack = np.linspace(_CLEAR, first_tip - _CLEAR, 200)
    F_back = np.interp(crack, x[back][::-1], F[back][::-1])
    F_on = np.interp(crack, x[on], F[on])
    elastic = cut.readings["elastic_force"]
    left, resumed = float(elastic[back.start]), float(np.interp(INCH - 1e-5, x[on], elastic[on]))
    met = float(x[on][int(np.argmax(elastic[on] > 0.0))])
    work, residual = cut.energy["work"], abs(cut.energy["residual"])
    return [
        near(f"{name}: friction forward in the crack over friction back", 1.0, _ratio(F_on, -F_back), relative=0.01),
        near(f"{name}: the blade meets the tip again, mm", 1e3 * first_tip, 1e3 * met, absolute=0.05, form=".2f"),
        near(f"{name}: force resumes at 1 inch over the force it left", 1.0, resumed / left, relative=0.01, form=".3f"),
        at_most(f"{name}: energy residual over max(work, 1 mJ)", residual / max(work, 1e-3), 1e-9),
    ]


def _ratio(numerator: Array, denominator: Array) -> float:
    """Return the mean ratio, or NaN if the two do not vary together."""
    ratio = numerator / denominator
    return float(ratio.mean()) if float(np.ptp(ratio)) < 0.05 else math.nan


@check(
    "energy",
    f"Energy identity under random policies (every 5 ms of {POLICY_SECONDS:g} s)",
    "law, balance (6.1)-(6.4)",
    "1e-9",
)
def energy_identity(quick: bool) -> Found:
    """Check the energy under random policies: speeds and angles every 50 ms, in random specimens, by rig and hand."""
    worst, policies = [], 4 if quick else 20
    for number in tqdm(range(policies), desc="energy under random policies", unit="policy", leave=False):
        rng = generator(6, number)
        drive = Rig() if number % 2 == 0 else Hand()
        plant = SimulatedPlant(Specimen.draw(rng, specimen_class="mixed"), drive=drive, seed=number)
        largest = 0.0
        for _ in range(round(POLICY_SECONDS * 1e3 / _HOLD)):
            speed, angle = rng.uniform(-0.6, 1.0) * 0.0254, math.radians(rng.uniform(45.0, 90.0))
            for _ in range(_HOLD // 5):
                plant.advance(speed, angle, 5)
                energy = plant.energy()
                largest = max(largest, abs(energy["residual"]) / max(energy["work"], 1e-3))
        worst.append(largest)
    rows = [
        at_most(f"random policy {i + 1}, {'rig' if i % 2 == 0 else 'hand'}: residual over max(work, 1 mJ)", value, 1e-9)
        for i, value in enumerate(worst)
    ]
    return rows, f"{max(worst):.0e} of max(work, 1 mJ) in {policies} policies"
