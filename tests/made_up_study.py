"""A made-up study: records of hands that saw at the force more or less, novices who learn and experts who do not."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cutenv.records import save
from cutenv.records.scoring import score
from cutenv.records.scoring.study import StudiedCut, Study
from cutenv.sim.trace import Trace

NOVICES, EXPERTS = ("N01", "N02", "N03", "N04", "N05"), ("E01", "E02", "E03", "E04")
SESSIONS, CUTS = ("1", "2"), 8  # cuts of a session


def sawing(roughness: float, rng: np.random.Generator) -> Trace:
    """Two seconds of force at 100 Hz [N]: a ramp, and a sawing hand on top of it."""
    time = np.arange(200) / 100.0
    sway = roughness * np.sin(2.0 * np.pi * rng.uniform(1.0, 2.0) * time + rng.uniform(0.0, 6.0))
    return Trace(time=time, force=2.0 + 0.5 * time + sway, force_unit="N")


def traces() -> list[tuple[str, str, str, str, Trace]]:
    """Record name, operator, group, session and record of every cut, in the order in which they were made."""
    rng = np.random.default_rng(5)
    rows = []
    for operator in (*NOVICES, *EXPERTS):
        group = "novice" if operator in NOVICES else "expert"
        own = rng.uniform(0.45, 0.6) if group == "novice" else rng.uniform(0.15, 0.3)
        for number in range(2 * CUTS):
            learning = 0.4 * np.exp(-number / 5.0) if group == "novice" else 0.0
            trace = sawing(own + learning + rng.normal(0.0, 0.05), rng)
            rows.append((f"{operator}_{number + 1:02d}", operator, group, SESSIONS[number // CUTS], trace))
    return rows


def study(**options: object) -> Study:
    """The study, scored."""
    cuts = [
        StudiedCut(card=score(trace, name=record), operator=operator, group=group, session=session)
        for record, operator, group, session, trace in traces()
    ]
    return Study(name="made up", cuts=cuts, **options)  # type: ignore[arg-type]


def write_records(folder: Path) -> Path:
    """The records as files in ``folder``, and their table of operators beside them; its path."""
    lines = ["record,operator,group,session,order"]
    for record, operator, group, session, trace in traces():
        save(trace, folder / f"{record}.csv")
        lines.append(f"{record}.csv,{operator},{group},{session},{int(record[-2:])}")
    table = folder / "operators.csv"
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return table
