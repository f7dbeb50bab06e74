"""Chapter 6: work and fracture resistance, the forward-backward protocol, and the energy account."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import measured_fracture_resistance
from cutenv.sim.tissue.tables import table
from scripts.drawings.thesis.style import (
    DISPLACEMENT_LABEL,
    FIRST,
    FORCE,
    PALE,
    SECOND,
    SOLID,
    STRAIN,
    STRESS,
    named,
    panels,
    save,
)
from scripts.validation.thesis import drawn_livers
from scripts.validation.thesis.cutting import legs, protocol
from scripts.validation.thesis.virtual_cuts import SPEEDS, cm_s, specimen, virtual_cut

TYPICAL, TOUGH = "liver 1", "liver 2"  # the tough one turns at 1 inch while it loads, not after a run
UPRIGHT = math.pi / 2
_SMOOTHING = 50  # readings

Array = NDArray[np.float64]


def resistance_by_length(path: Path, quick: bool) -> None:
    """Draw Figures 6.3 and 6.4: the work of a cut, and apparent resistance against its length."""
    figure, (work, resistance) = panels(
        1, 2, (11.0, 4.4), "Figures 6.3 and 6.4 anew: work of the blade, and apparent fracture resistance R = W*/x"
    )
    cut = virtual_cut(TYPICAL, speed=SPEEDS[1], turns=(0.1016,))
    assert cut.trace.position is not None
    x = 100 * cut.trace.position
    W = float(np.trapezoid(cut.trace.force, cut.trace.position))
    work.fill_between(x, 0.0, cut.trace.force, color=PALE, linewidth=0)
    work.plot(x, cut.trace.force, color=FORCE, linewidth=0.7)
    work.text(0.05, 0.75, f"area: W = {1e3 * W:.0f} mJ", transform=work.transAxes)
    named(work, f"6.3: force in a drawn liver, {cm_s(SPEEDS[1])}, 4 inches", DISPLACEMENT_LABEL, "force [N]")
    _draw_resistance(resistance, quick)
    save(figure, path)


def _draw_resistance(ax: Axes, quick: bool) -> None:
    data = table("6.1")
    lengths = data["cut_length_m"]
    mean, sd = data["fracture_resistance_J_m2"], data["sd_fracture_resistance_J_m2"]
    ax.errorbar(100 * lengths - 0.07, mean, sd, fmt="o", color=STRESS, label="Table 6.1, mean ± SD")
    cuts = [cut for v in drawn_livers.speeds(quick) for cut in drawn_livers.cuts(v, 90, quick)]
    for length in sorted({cut.length for cut in cuts}):
        R = np.array([cut.apparent for cut in cuts if cut.length == length])
        label = f"{len(cuts)} virtual cuts (dots), mean ± SD" if length == lengths[0] else None
        ax.plot(np.full(len(R), 100 * length + 0.22), R, ".", color=STRAIN, ms=4, alpha=0.6)
        ax.errorbar(100 * length + 0.07, R.mean(), R.std(), fmt="s", color=STRAIN, label=label)
    ax.axhline(measured_fracture_resistance().mean, color=STRESS, linewidth=0.8, linestyle=":")
    ax.set_ylim(0, 480)
    ax.set_xlim(2, 11)
    ax.legend(loc="upper left")
    named(ax, "6.4: cuts of 1 to 4 inches, all speeds", "cut length [cm]", "fracture resistance [J/m$^2$]")


def forward_backward(path: Path, quick: bool) -> None:
    """Draw Figures 6.5 to 6.7: travel, and force in the first (red) and the second (blue) cycle."""
    speed = SPEEDS[0]
    cut = protocol(TOUGH, speed)
    out, back, on, home = legs(cut)
    title = f"Figures 6.5 to 6.7 anew: forward-backward travel in a drawn liver, {cm_s(speed)}, 90°"
    figure, axes = panels(1, 3, (13.0, 4.4), title)
    travel, both, second = axes
    t, x, F = cut.trace.time, 100 * np.asarray(cut.trace.position), smoothed(cut.trace.force)
    first_cycle, second_cycle = slice(out.start, back.stop), slice(on.start, home.stop)
    for cycle, colour, name in ((first_cycle, FIRST, "first cycle"), (second_cycle, SECOND, "second cycle")):
        travel.plot(t[cycle], x[cycle], color=colour, label=name)
        both.plot(x[cycle], F[cycle], color=colour, linewidth=0.8, label=name, zorder=3 if colour == FIRST else 2)
    second.plot(x[second_cycle], F[second_cycle], color=SECOND, linewidth=0.8)
    inch_mark = {"color": "0.6", "linewidth": 0.8, "linestyle": ":"}
    for ax in (both, second):
        ax.axhline(0.0, color="0.6", linewidth=0.6)
        ax.axvline(2.54, **inch_mark)  # type: ignore[arg-type]
        ax.set_ylim(1.6 * F.min() - 0.1, 1.25 * F.max())
    left, resumed = int(back.start) - 1, int(on.start + np.argmax(x[on] >= 2.54 - 1e-3))
    both.plot(x[left], F[left], "s", color=FIRST, ms=6, mfc="none", zorder=4, label="left off at 1 inch")
    both.plot(x[resumed], F[resumed], "o", color=SECOND, ms=4, zorder=4, label="resumed at 1 inch")
    friction = float(cut.readings["true_force"][home][len(x[home]) // 2])
    second.annotate(
        "return: unloading,\nthen friction alone",
        (x[home][len(x[home]) // 2], friction),
        (0.25, 1.6 * float(F.min())),
        arrowprops={"arrowstyle": "->", "linewidth": 0.8},
        fontsize=8,
    )
    travel.legend(loc="upper left")
    both.legend(loc="upper left")
    named(travel, "6.5: travel of the blade", "time [s]", "displacement [cm]")
    named(both, "6.6: force, both cycles (mean over 50 ms)", DISPLACEMENT_LABEL, "force [N]")
    named(second, "6.7: force, second cycle", DISPLACEMENT_LABEL, "force [N]")
    save(figure, path)


def smoothed(force: Array) -> Array:
    """Return the mean over 50 ms, which is 0.05 mm of a slow cut: below the sensor's resolution, friction shows."""
    return np.convolve(force, np.full(_SMOOTHING, 1.0 / _SMOOTHING), mode="same")


def energy_account(path: Path, quick: bool) -> None:
    """Draw where the work of a cut and of its return stroke goes, at every instant."""
    plant = SimulatedPlant(specimen(TYPICAL), seed=2)
    account: dict[str, list[float]] = {}
    times, places, speed = [], [], 0.0127
    while speed > 0.0 or plant.states["blade"][0] > 0.0:
        reading = plant.advance(speed, UPRIGHT, 10)[-1]
        times.append(float(reading["time"]))
        places.append(float(reading["position"]))
        for name, value in plant.energy().items():
            account.setdefault(name, []).append(value)
        if plant.states["blade"][0] >= 0.09:
            speed = -abs(speed)
    mJ = {name: 1e3 * np.array(values) for name, values in account.items()}
    title = "Energy account of a cut of 9 cm and its return stroke, drawn liver, 1.27 cm/s"
    figure, (whole, ledger, residual) = panels(3, 1, (8.0, 8.2), title, sharex=True, height_ratios=(3, 1.2, 0.9))
    names = ("fracture", "friction", "loss", "stored")
    colours = ("#b5714f", "#e3b23c", "0.45", "#7fb2d9")
    whole.stackplot(times, [mJ[name] for name in names], labels=names, colors=colours)
    whole.plot(times, mJ["work"], color="black", linewidth=1.4, label="work of the blade")
    turn = times[int(np.argmax(places))]
    for ax in (whole, ledger, residual):
        ax.axvline(turn, color="0.5", linewidth=0.8, linestyle=":")
    whole.text(turn, 0.04 * mJ["work"].max(), " blade turns", fontsize=8)
    whole.legend(loc="upper left")
    ledger.plot(times, mJ["ledger"], color=SOLID)
    ledger.axhline(0.0, color="0.6", linewidth=0.6)
    residual.plot(times, 1e-3 * mJ["residual"], color=FORCE, linewidth=0.7)
    named(
        whole,
        "stored, fracture, friction and loss, stacked; what is missing to the work is the ledger",
        y="energy [mJ]",
    )
    named(ledger, "ledger: kinetic energy of the run, or debt to be paid by the blade", y="energy [mJ]")
    named(residual, "residual: work less all the others", "time [s]", "energy [J]")
    save(figure, path)
