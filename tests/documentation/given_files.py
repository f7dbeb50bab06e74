"""Files that pages suppose their reader has: records of cuts, tables of people, an export of another program."""

from __future__ import annotations

import dataclasses
from functools import cache
from pathlib import Path

import made_up_study
import virtual_session

from cutenv.records import save
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Layers, Specimen
from cutenv.sim.trace import Trace
from scripts.validation.measurement.stepped_cuts import stepped_cut


@cache
def _cut(seed: int) -> Trace:
    plant = SimulatedPlant(Specimen.drawn(seed))
    legs = [Leg(position=0.0, speed=0.0127, dwell=0.5), Leg(position=0.09, speed=0.0127, dwell=0.2)]
    return to_trace(plant, run(plant, [*legs, Leg(position=0.0, speed=0.0254, dwell=0.5)]), specimen=f"liver {seed}")


def of_operator(trace: Trace, operator: str) -> Trace:
    return dataclasses.replace(trace, metadata={**trace.metadata, "operator": operator})


def _people(folder: Path) -> None:
    """Write records of several people, and their table with two ratings beside the folder."""
    table = made_up_study.write_records(folder).rename(folder.parent / "operators.csv")
    first, *lines = table.read_text().splitlines()
    rated = [f"{line},{2 + i % 3},{30 + 10 * (i % 5)}" for i, line in enumerate(lines)]
    (folder.parent / "class.csv").write_text("\n".join([f"{first},rater_a,rater_b", *rated]) + "\n")


def _export(path: Path) -> None:
    """Write a cut as another program does: another language's names and decimals, the force in millinewtons."""
    cut = _cut(3)
    rows = zip(cut.time, -1e3 * cut.force, 1e3 * cut.position, strict=True)
    text = "\n".join(";".join(f"{value:.4f}".replace(".", ",") for value in row) for row in rows)
    path.write_text(f"Zeit [s];Kraft X [mN];Weg [mm]\n{text}\n")


def give(page: str, folder: Path) -> None:
    """Write what a page supposes into a folder."""
    cuts = [of_operator(_cut(seed), f"P0{seed}") for seed in (3, 4, 5)]
    if page == "how-to/browser.md":
        for number in range(2 * len(cuts)):
            save(cuts[number % len(cuts)], folder / f"cut_{number}.csv")
        return
    for place in ("cuts", "our_people", "records", "series", "stepped"):
        (folder / place).mkdir()
    if page == "how-to/calibrate.md":
        for trace in virtual_session.traces()[:12]:
            save(trace, folder / "records" / f"{trace.metadata['name'].replace(' ', '_')}.csv")
        for seed in range(3):
            trace, _ = stepped_cut(Specimen.drawn(seed), Layers(boundary=0.010, deep_toughness=3.0), end="finished")
            save(trace, folder / "stepped" / f"liver{seed}.csv")
    else:
        _people(folder / "records")
    for number in range(21):  # as many as a reference set takes
        cut = cuts[number % len(cuts)]
        save(cut, folder / "our_people" / f"cut_{number}.csv")
    for cut in cuts:
        save(cut, folder / "cuts" / f"{cut.metadata['operator']}.csv")
    for number in range(6):  # of one blade, more than it takes to fit its wear
        save(cuts[number % len(cuts)], folder / "series" / f"cut_{number}.csv")
    for name in ("cut.csv", "my_cut.csv"):
        save(cuts[0], folder / name)
    _export(folder / "trial12.csv")
