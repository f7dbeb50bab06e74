"""Force statistics and loading segments of 207 real hand-held scalpel cuts.

    python -m scripts.validation.records.real_records  reads ../shared/data beside the repository
    python -m scripts.validation.records.real_records --out FOLDER
                                                       also draws the segments of some cuts, and a summary by trial

The cuts are elliptical excisions in a skin phantom with a No. 10 blade: 18 trials, 180 samples a cut at 30
Hz, of which the first 120 are the cut.  The force is a pure number, normalised to the largest of the data
set; there is no position, so neither a modulus nor a fracture resistance can be computed.  Loading segments are
lines against time: they have a rate (dF/dt) and the drop that ended them, and no slope.  In a hand's cut a drop need
not be a run of the crack: the force also falls if a hand slows down or eases off, and the record does not show which.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from cutenv._base.result_table import aligned
from cutenv.records import ColumnMap, load_foreign
from cutenv.records.measurement import Segment, loading_segments
from cutenv.records.measurement.segments import STRAIGHT_RAMP
from cutenv.sim.trace import Trace
from scripts import ROOT

DATA = ROOT.parent / "shared" / "data" / "scalpel_excision_forces.csv"
CUT_SAMPLES = 120
COLUMNS = ColumnMap(time="time_s", force="force_normalised", unit="1", split_by=("trial", "cut"))
SMALLEST_DROP = 0.05  # of the largest force of the data set; noise is 0.003 in the median cut (second differences)
SHOWN = ("T01", "T04", "T07", "T13", "T15", "T18")  # trials of which a cut is drawn: smooth ones, and sawing ones
LICENCE = "MIT, (c) Arturas Straizys"
SOURCE = "straizys/elliptical-excision-force-model; Communications Engineering 2023, s44172-023-00086-z"


def read_cuts(path: Path) -> list[Trace]:
    """Read every cut of the file, force only, unit "1"; metadata: trial, cut, cut_samples, source, licence."""
    if not path.is_file():
        raise FileNotFoundError(
            f"No file {path}. The recorded cuts are not part of this repository: put "
            f"scalpel_excision_forces.csv there, or name it with --data."
        )
    facts = {"cut_samples": CUT_SAMPLES, "source": SOURCE, "licence": LICENCE}
    cuts = []
    for record in load_foreign(path, COLUMNS, search=None).records:
        group = record.metadata["group"]
        cuts.append(replace(record, metadata={"trial": group["trial"], "cut": int(group["cut"]), **facts}))
    return cuts


def force_statistics(cuts: list[Trace]) -> dict[str, float]:
    """Compute statistics of the cutting phase of one trial's cuts; force is a pure number, its rate per second.

    ``mean`` and ``peak`` are means over the cuts, ``sd`` the mean standard deviation within a cut,
    ``cv_of_means`` and ``cv_of_peaks`` standard deviations between cuts (population) over their means,
    ``rms_rate`` the root mean square of dF/dt over all cuts.
    """
    phases = [cut.select(slice(0, CUT_SAMPLES)) for cut in cuts]
    means, peaks, deviations = (
        np.array([statistic(phase.force) for phase in phases]) for statistic in (np.mean, np.max, np.std)
    )
    rates = np.concatenate([np.diff(phase.force) / np.diff(phase.time) for phase in phases])
    return {
        "cuts": len(cuts),
        "mean": float(means.mean()),
        "peak": float(peaks.mean()),
        "sd": float(deviations.mean()),
        "cv_of_means": float(means.std() / means.mean()),
        "cv_of_peaks": float(peaks.std() / peaks.mean()),
        "rms_rate": float(np.sqrt(np.mean(rates**2))),
    }


def by_trial(traces: list[Trace]) -> dict[str, list[Trace]]:
    """Return the cuts of each trial, in the order of the file."""
    trials: dict[str, list[Trace]] = {}
    for trace in traces:
        trials.setdefault(trace.metadata["trial"], []).append(trace)
    return trials


def segments_of(cut: Trace) -> list[Segment]:
    """Find the loading segments of the cutting phase; the smallest drop is the same for all cuts, for comparison."""
    return loading_segments(cut.select(slice(0, CUT_SAMPLES)), smallest_drop=SMALLEST_DROP)


def segment_statistics(cuts: list[Trace]) -> dict[str, float]:
    """Compute statistics of the loading segments of one trial's cuts; force is a pure number, its rate per second.

    ``drops`` and ``drops_sd`` are mean and standard deviation (population) of their number in a cut, ``drop`` their
    mean size, ``straight`` the share of straight ramps. Of these ``first_rate`` is the median rate of the ramps
    that begin the cuts, as the blade is set on; ``rate``, ``rate_low`` and ``rate_high`` median and quartiles of all
    later ones; NaN where there is none.
    """
    found = [segments_of(cut) for cut in cuts]
    numbers = np.array([sum(s.drop > 0.0 for s in segments) for segments in found])
    drops = [s.drop for segments in found for s in segments if s.drop > 0.0]
    first, later = straight_rates(found)
    low, median, high = np.quantile(later, [0.25, 0.5, 0.75]) if later else (np.nan,) * 3
    return {
        "cuts": len(cuts),
        "drops": float(numbers.mean()),
        "drops_sd": float(numbers.std()),
        "drop": float(np.mean(drops)) if drops else float("nan"),
        "straight": (len(first) + len(later)) / max(sum(len(segments) for segments in found), 1),
        "first_rate": float(np.median(first)) if first else float("nan"),
        "rate": float(median),
        "rate_low": float(low),
        "rate_high": float(high),
    }


def straight_rates(found: list[list[Segment]]) -> tuple[list[float], list[float]]:
    """Return the rates [1/s] of the straight ramps of some cuts: those that begin a cut, and all later ones."""
    straight = [s for segments in found for s in segments if s.r_squared >= STRAIGHT_RAMP]
    return [s.rate for s in straight if s.after_standstill], [s.rate for s in straight if not s.after_standstill]


def table(traces: list[Trace]) -> str:
    """Return force statistics as aligned text: a row for each trial, and one for all cuts together."""
    heads = ["trial", "cuts", "mean", "peak", "SD", "CV of means", "CV of peaks", "RMS dF/dt [1/s]"]
    rows = []
    for trial, cuts in [*by_trial(traces).items(), ("all", traces)]:
        n, *numbers = force_statistics(cuts).values()
        rows.append([trial, f"{n:.0f}", *(f"{number:.3f}" for number in numbers)])
    return "\n".join(aligned([heads, *rows], right=True))


def segment_table(traces: list[Trace]) -> str:
    """Return loading segments as aligned text: a row for each trial, and one for all cuts together."""
    heads = [
        "trial",
        "cuts",
        "drops a cut",
        "SD",
        "mean drop",
        "straight",
        "first dF/dt [1/s]",
        "later dF/dt [1/s]",
        "quartiles",
    ]
    rows = []
    for trial, cuts in [*by_trial(traces).items(), ("all", traces)]:
        found = segment_statistics(cuts)
        quartiles = f"{found['rate_low']:.2f} to {found['rate_high']:.2f}"
        numbers = [f"{found[name]:.2f}" for name in ("drops", "drops_sd", "drop", "straight", "first_rate", "rate")]
        rows.append([trial, f"{len(cuts)}", *(number.replace("nan", "-") for number in (*numbers, quartiles))])
    return "\n".join(aligned([heads, *rows], right=True))


def draw_cuts(traces: list[Trace], path: Path) -> None:
    """Draw force against time of some cuts, with their segments and drops."""
    from scripts.drawings.thesis.style import FORCE, STRAIN, STRESS, named, panels, save

    trials = by_trial(traces)
    shown = [trials[name][len(trials[name]) // 2] for name in SHOWN if name in trials]
    title = f"Loading segments of hand-held cuts, from the force alone (drops of {SMALLEST_DROP:g} and more)"
    figure, axes = panels(len(shown) // 2, 2, (11.0, 8.5), title, sharex=True, sharey=True)
    for ax, cut in zip(axes, shown, strict=True):
        end = cut.time[CUT_SAMPLES - 1]
        ax.axvspan(end, cut.time[-1], color="0.93", linewidth=0)
        ax.plot(cut.time, cut.force, color="0.55", linewidth=0.8, label="force as recorded")
        found = segments_of(cut)
        for s in found:
            ends = cut.time[[s.start, s.stop - 1]]
            colour = STRESS if s.drop > 0.0 else STRAIN
            style = "-" if s.r_squared >= STRAIGHT_RAMP else (0, (1, 1))
            line = s.force + s.rate * (ends - s.time)
            ax.plot(ends, line, color=colour, linewidth=2.0, linestyle=style, solid_capstyle="butt")
            if s.drop > 0.0:
                hilltop, t = cut.force[s.stop], cut.time[s.stop]
                arrow = {"arrowstyle": "-|>", "color": FORCE, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
                ax.annotate("", (t, hilltop - s.drop), (t, hilltop), arrowprops=arrow)
        ax.axhline(0.0, color="0.8", linewidth=0.6)
        drops = sum(s.drop > 0.0 for s in found)
        rates = ", ".join(f"{s.rate:.2f}" for s in found)
        trial, number = cut.metadata["trial"], cut.metadata["cut"]
        named(ax, f"{trial}, cut {number}: {drops} drop{'s' * (drops != 1)}; dF/dt {rates} 1/s")
    key = axes[0]
    key.plot([], [], color=STRESS, linewidth=2.0, label="loading segment, ended by a drop")
    key.plot([], [], color=STRAIN, linewidth=2.0, label="loading segment, none followed")
    key.plot([], [], color="0.3", linewidth=2.0, linestyle=(0, (1, 1)), label="not straight: its rate is not used")
    key.plot([], [], marker=r"$\downarrow$", color=FORCE, ms=7, linewidth=0, label="drop, from hilltop to valley")
    key.text(end + 0.05, 0.02, " the cut\n has ended", fontsize=7, transform=key.get_xaxis_transform())
    figure.legend(*key.get_legend_handles_labels(), loc="outside lower center", ncols=5)
    for ax in axes[-2:]:
        ax.set_xlabel("time [s]")
    for ax in axes[::2]:
        ax.set_ylabel("force, normalised [1]")
    axes[0].set_xlim(0.0, cut.time[-1])
    save(figure, path)


def draw_trials(traces: list[Trace], path: Path) -> None:
    """Draw by trial: number of drops in a cut, their sizes, and loading rates."""
    from scripts.drawings.thesis.style import INCLINED, UPRIGHT, named, panels, save

    trials = by_trial(traces)
    title = f"Loading segments of {len(traces)} hand-held cuts by trial (drops of {SMALLEST_DROP:g} and more)"
    figure, axes = panels(3, 1, (9.5, 8.5), title, sharex=True)
    numbers, sizes, rates = axes
    for at, cuts in enumerate(trials.values()):
        found = [segments_of(cut) for cut in cuts]
        counts = [sum(s.drop > 0.0 for s in segments) for segments in found]
        values, times = np.unique(counts, return_counts=True)
        numbers.scatter(np.full(len(values), at), values, s=14 * times, color=UPRIGHT, alpha=0.45, linewidth=0)
        numbers.plot([at - 0.35, at + 0.35], [np.mean(counts)] * 2, color="black", linewidth=1.4)
        drops = [s.drop for segments in found for s in segments if s.drop > 0.0]
        first, later = straight_rates(found)
        for ax, shift, sample, colour in (
            (sizes, 0.0, drops, UPRIGHT),
            (rates, -0.17, first, INCLINED),
            (rates, 0.17, later, UPRIGHT),
        ):
            spots = at + shift + 0.1 * (np.arange(len(sample)) % 5 - 2) / 2
            ax.plot(spots, sample, ".", color=colour, ms=3.5, alpha=0.5, markeredgewidth=0)
            if sample:
                low, median, high = np.quantile(sample, [0.25, 0.5, 0.75])
                ax.plot([at + shift] * 2, [low, high], color=colour, linewidth=4, alpha=0.45, solid_capstyle="butt")
                ax.plot([at + shift - 0.14, at + shift + 0.14], [median] * 2, color="black", linewidth=1.4)
    rates.set_yscale("log")
    rates.plot([], [], ".", color=INCLINED, label="first ramp of a cut")
    rates.plot([], [], ".", color=UPRIGHT, label="later ramps")
    rates.legend(loc="lower left", ncols=2)
    rates.set_xticks(range(len(trials)), list(trials))
    rates.set_xlim(-0.7, len(trials) - 0.3)
    sizes.set_ylim(bottom=0.0)
    named(numbers, "drops in a cut: dots, by how many cuts; line, mean", y="drops in 4 s")
    named(sizes, "size of the drops: dots; bar, quartiles; line, median", y="drop, normalised [1]")
    named(rates, "loading rate of the straight ramps: dots; bar, quartiles; line, median", "trial", "dF/dt [1/s]")
    save(figure, path)


def draw(traces: list[Trace], folder: Path) -> list[Path]:
    """Draw both pictures into ``folder``, which is created if missing."""
    from matplotlib import rc_context

    from scripts.drawings.thesis.style import STYLE

    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / "real_cuts.png", folder / "real_trials.png"]
    with rc_context(STYLE):
        for path, drawing in zip(paths, (draw_cuts, draw_trials), strict=True):
            drawing(traces, path)
    return paths


def main() -> int:
    """Read and print; return 2 if the file is missing or another."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=DATA, metavar="FILE", help="scalpel_excision_forces.csv")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="draw real_cuts.png and real_trials.png there")
    arguments = parser.parse_args()
    try:
        traces = read_cuts(arguments.data)
        of_segments = segment_table(traces)
    except (FileNotFoundError, ValueError) as error:
        print(error, file=sys.stderr)
        return 2
    rate = np.mean([trace.sample_rate for trace in traces])
    print(f"{len(traces)} hand-held scalpel cuts at {rate:.1f} Hz, the first {CUT_SAMPLES} samples of each.")
    print('Force is normalised to the largest of the data set (unit "1"); no position was recorded.\n')
    print(table(traces))
    print(f"\nLoading segments: ramps against time, parted by drops of {SMALLEST_DROP:g} and more.")
    print(f"Rates are those of straight ramps (R squared of {STRAIGHT_RAMP:g} and more).\n")
    print(of_segments)
    if arguments.out is not None:
        for path in draw(traces, arguments.out):
            print(f"picture: {path}")
    print(f"\nSource: {SOURCE}. Licence: {LICENCE}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
