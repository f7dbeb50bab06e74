"""All faults of a rig, many times each, in real time on an emulated one in a separate process.

    python -m scripts.validation.rig.rig_faults           10 trials of each fault, about a quarter of an hour
    python -m scripts.validation.rig.rig_faults --height  faults of a height axis, with the blade in air
    python -m scripts.validation.rig.rig_faults --side    faults of an axis to the side, with the blade in air
    python -m scripts.validation.rig.rig_faults --serial  faults of a serial rig: board, stepper, load cell
    python -m scripts.validation.rig.rig_faults --grbl    faults of a rig with GRBL and a load cell
    python -m scripts.validation.rig.rig_faults --json runs/rig-faults.json
                                                          for scripts/update_docs.py rig-faults

The blade cuts sampled specimens at 1.5 cm/s (a slow rig: 4.5 mm/s) when the fault occurs, at a random instant.  All
times are of one clock.  The machine's own delays are counted (a thread of the rig or of the emulator that was late by
more than 5 ms), and the times of such trials are kept apart.  If such a delay has stopped the rig before the fault, or
something in such a trial is not as promised, it does not count, and is made again.  A machine that is too busy is
refused at once (exit code 3), with what to ask for.

Trials are stored as they are made, in runs/rig-faults.part.json, those of the other kinds in
rig-faults-height.part.json, rig-faults-side.part.json and so on there.  An interrupted run
continues where it left off when the command is given again; --anew starts from the beginning.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import statistics
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from cutenv._base.result_table import aligned
from cutenv.emulation.process import RunningEmulator, start
from cutenv.rig.config.settings import EMULATOR
from cutenv.rig.errors import RigError
from scripts.tables import keep_json, markdown_table
from scripts.validation.rig.busy_host import TooBusy, look
from scripts.validation.rig.cross_trials import CrossingRig, cross_trial
from scripts.validation.rig.cutting_rig import CuttingRig
from scripts.validation.rig.rig_cut_process import trial_in_child
from scripts.validation.rig.rig_trials import (
    BY_THE_DRIVE,
    EXPECTED,
    EXPECTED_ACROSS,
    EXPECTED_OF_GRBL,
    EXPECTED_OF_SERIAL,
    GAP,
    IN_CHILD,
    SPOILS,
    WAY,
    Trial,
    trial,
)

KNOWN = {"": EXPECTED, **EXPECTED_ACROSS, "serial": EXPECTED_OF_SERIAL, "grbl": EXPECTED_OF_GRBL}
"""Faults by the kind of rig, "" that of the drives on a bus."""
DEFAULTS = {kind: Path("runs") / f"rig-faults{kind and f'-{kind}'}.json" for kind in KNOWN}
"""Files of the trials from which the documentation is made, by kind of rig."""
PART = ".part.json"  # end of the name of a file of a run that goes on
_ATTEMPTS = 8  # at a trial that the host's stalls prevent
_LOOKED_AT = (1, 4)  # failed attempts after which the machine's load is checked
HEADER = (
    "fault", "found out as", "stopped", "latched", "stated [ms]", "found out after [ms]", "quick stop on the bus [ms]",
    "at rest [ms]", "way since the fault [mm]", "host stalled",
)  # fmt: skip


class Trials:
    """Runs trials, on a new emulator where a fault has left the last one unusable.

    ``check`` is called after failed attempts, and raises :class:`TooBusy` if more would fail too; ``before`` counts the
    trials that were made again, by fault.
    """

    def __init__(self, check: Callable[[], None] | None = None, *, kind: str = "") -> None:
        self._check, self.kind = check, kind
        self.before: Counter[str] = Counter()
        self._emulator: RunningEmulator | None = None
        self._rig: CuttingRig | None = None

    def one(self, fault: str, random: np.random.Generator) -> Trial:
        """Run one trial of the fault, at an instant sampled by ``random``."""
        for attempt in range(_ATTEMPTS):
            if self._check is not None and attempt in _LOOKED_AT:
                self.close()
                self._check()
            seed, after = int(random.integers(1000)), float(random.uniform(0.4, 1.4))
            try:
                done = self._tried(fault, seed, after)
            except RigError as error:  # a busy host keeps the rig from becoming ready
                print(f"{fault}: no trial, {error}", file=sys.stderr)
                self.close()
                self.before[fault] += 1
                continue
            if fault in SPOILS:
                self.close()  # its carriage is no longer where the encoder reports
            spoiled = done.wrong() if done.stalls else []
            if not (done.before or spoiled):
                return done
            why = "; ".join(spoiled) or f"stopped before ({done.detail or done.speed})"
            print(f"{fault}: made again, {why}", file=sys.stderr)
            self.before[fault] += 1
        raise RigError(f"{fault}: {_ATTEMPTS} times the rig had stopped before the fault came: is this machine busy?")

    def _tried(self, fault: str, seed: int, after: float) -> Trial:
        if self.kind in EXPECTED_ACROSS:
            return self._tried_across(fault, seed, after)
        emulator = self._emulator = self._emulator or start(kind=self.kind or EMULATOR)
        if fault in IN_CHILD:
            self._leave()
            return trial_in_child(emulator, fault, seed=seed, after=after)
        if self._rig is None:
            self._rig = CuttingRig(emulator.settings, emulator.control)
        return trial(self._rig, emulator.control, fault, seed=seed, after=after)

    def _tried_across(self, fault: str, seed: int, after: float) -> Trial:
        emulator = self._emulator = self._emulator or start(across=(self.kind,), free_air=True)
        if not isinstance(self._rig, CrossingRig):
            self._rig = CrossingRig(emulator.settings, emulator.control)
        return cross_trial(self._rig, emulator.control, fault, seed=seed, after=after)

    def _leave(self) -> None:
        if self._rig is not None:
            self._rig.close()
            self._rig = None

    def close(self) -> None:
        """End rig and emulator."""
        self._leave()
        if self._emulator is not None:
            self._emulator.close()
            self._emulator = None

    def __enter__(self) -> Trials:
        return self

    def __exit__(self, *error: Any) -> None:
        self.close()


def _spread(values: Sequence[float | None], scale: float = 1e3, digits: int = 1) -> str:
    """Return median and maximum as the text of a cell."""
    known = [scale * value for value in values if value is not None]
    return f"{statistics.median(known):.{digits}f}, {max(known):.{digits}f}" if known else "-"


def row(fault: str, trials: Sequence[Trial], before: int) -> tuple[str, ...]:
    """Return one line of the table: median and maximum over the trials in which the host did not stall."""
    calm = [each for each in trials if not each.stalls]
    stalled = [each for each in trials if each.stalls]
    stated = sorted({round(1e3 * each.stated) for each in trials if each.stated is not None})
    causes = Counter("nothing" if each.cause is None else str(each.cause) for each in trials)
    host = f"{len(stalled)}" if stalled else "0"
    if stalled:
        late = max(max(each.stalls or [0.0]) for each in stalled)
        host += f" (by {1e3 * late:.0f} ms: {_spread([each.times['detection'] for each in stalled])})"
    if before:
        host += f" + {before} again"
    by_drive = fault in BY_THE_DRIVE
    return (
        fault,
        "; ".join(f"{cause} {count}" if len(causes) > 1 else cause for cause, count in causes.most_common()),
        f"{sum(each.stopped for each in trials)} of {len(trials)}",
        f"{sum(each.latched for each in trials)} of {len(trials)}",
        "/".join(map(str, stated)) or "-",
        _spread([each.times["detection"] for each in calm]),
        "by the drive" if by_drive else _spread([each.times["quick_stop"] for each in calm]),
        _spread([each.times["standstill"] for each in calm]),
        _spread([each.way for each in calm], digits=2),
        host,
    )


def rows(kept: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the table of trials stored by :func:`as_json`."""
    by_fault: dict[str, list[Trial]] = {}
    for each in kept["trials"]:
        by_fault.setdefault(each["fault"], []).append(Trial(**each))
    return [row(fault, trials, kept["before"].get(fault, 0)) for fault, trials in by_fault.items()]


def as_json(trials: Sequence[Trial], before: Counter[str], seed: int = 0) -> dict[str, Any]:
    """Return trials as JSON content; times in seconds, distances in metres."""
    return {"trials": [dataclasses.asdict(each) for each in trials], "before": dict(before), "seed": seed}


def left_off(file: Path, seed: int) -> tuple[list[Trial], Counter[str]]:
    """Return the trials of an interrupted run with this seed, and how often the rig had stopped before the fault."""
    if not file.exists():
        return [], Counter()
    kept = json.loads(file.read_text(encoding="utf-8"))
    if kept["seed"] != seed:
        return [], Counter()
    return [Trial(**each) for each in kept["trials"]], Counter(kept["before"])


def markdown(kept: dict[str, Any]) -> str:
    """Return the table for the documentation."""
    table = markdown_table(HEADER, rows(kept))
    again = sum(kept["before"].values())
    made = f"{len(kept['trials'])} trials, {again} more made again: the host had stopped them before, or spoiled them."
    if "bus_gap" not in {each["fault"] for each in kept["trials"]}:
        return f"{table}\n\n{made}"
    allowed = f"Found out counts as kept up to {1e3 * WAY:g} ms beyond the stated time: the ways of frames and events."
    gap = f"bus_gap is a bus that is off for {1e3 * GAP:g} ms: the first quick stop is lost, and sent again."
    return f"{table}\n\n{made} {allowed} {gap}"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the trials; return 0 if all is as promised, 1 if something is not, 3 if the machine is too busy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--trials", type=int, default=10, metavar="N", help="of each fault; default 10")
    kinds = parser.add_mutually_exclusive_group()
    abouts = {
        "height": "a height axis", "side": "an axis to the side", "serial": "a serial rig",
        "grbl": "a rig with GRBL and a load cell",
    }  # fmt: skip
    for kind, about in abouts.items():
        kinds.add_argument(
            f"--{kind}", action="store_const", const=kind, dest="kind", default="", help=f"faults of {about}"
        )
    add("--only", nargs="+", metavar="FAULT", help="; ".join(
        f"{kind or 'usual'}: {', '.join(known)}" for kind, known in KNOWN.items()
    ))  # fmt: skip
    add("--seed", type=int, default=0, help="of specimens and instants; default 0")
    add("--json", type=Path, metavar="FILE", help=f"keep every trial there; the documentation is made from "
        f"{', '.join(map(str, DEFAULTS.values()))}")  # fmt: skip
    add("--anew", action="store_true", help="begin from the first trial, though a run was broken off")
    arguments = parser.parse_args(argv)
    known, part = KNOWN[arguments.kind], DEFAULTS[arguments.kind].with_suffix(PART)
    arguments.only = arguments.only or list(known)
    if unknown := [fault for fault in arguments.only if fault not in known]:
        parser.error(f"no fault {unknown[0]!r}; there are {', '.join(known)}")
    trials, before = ([], Counter()) if arguments.anew else left_off(part, arguments.seed)
    if trials:
        print(f"{len(trials)} trials were made before ({part}); it goes on from there.", file=sys.stderr)
    try:
        check_host()
        with Trials(check_host, kind=arguments.kind) as on:
            on.before = before
            for fault, number in tqdm(planned(arguments, trials), unit="trial", leave=False):
                trials.append(on.one(fault, np.random.default_rng([arguments.seed, number, *fault.encode()])))
                keep_json(part, as_json(trials, before, arguments.seed))
    except TooBusy as busy:
        left = f"{len(trials)} trials are kept in {part}: give the command again, and it goes on from there."
        print(f"rig_faults: {busy}\n{left}", file=sys.stderr)
        return 3
    trials = [each for fault in arguments.only for each in _of(fault, trials)[: arguments.trials]]
    kept = as_json(trials, Counter({fault: before[fault] for fault in arguments.only}), arguments.seed)
    if arguments.json is not None:
        keep_json(arguments.json, kept)
    part.unlink(missing_ok=True)
    wrong = [
        f"{fault}, trial {number}: {why}"
        for fault in arguments.only
        for number, each in enumerate(_of(fault, trials))
        for why in each.wrong()
    ]
    print("\n".join(aligned([HEADER, *rows(kept)])))
    print(f"\nmedian, greatest; {len(trials)} trials, {len(wrong)} not as promised")
    print("\n".join(wrong))
    return 1 if wrong else 0


def check_host() -> None:
    """Raise :class:`TooBusy` if the machine is."""
    look().check()


def planned(arguments: argparse.Namespace, made: Sequence[Trial]) -> list[tuple[str, int]]:
    """Return fault and number of every trial that is still to be run: those of a fault are run in order."""
    return [(fault, number) for fault in arguments.only for number in range(len(_of(fault, made)), arguments.trials)]


def _of(fault: str, trials: Sequence[Trial]) -> list[Trial]:
    return [each for each in trials if each.fault == fault]


if __name__ == "__main__":
    sys.exit(main())
