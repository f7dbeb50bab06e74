"""Checks of a record of force for faults.

Each fault has a name: what is seen, where, how sure, and the cure.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cutenv.records.measurement import QualityIssue, quality_issues
from cutenv.records.measurement.signal_faults import (
    Fault,
    Readings,
    Sureness,
    column_faults,
    doubled_readings,
    signal_faults,
)
from cutenv.records.scoring.validity import holds_two_cuts, is_truncated, starts_late
from cutenv.sim.trace import Trace

FAULT_NAMES = (
    "frozen", "saturated", "spike", "gap", "doubled", "drift", "offset", "sign", "aliasing", "hum", "filtered",
    "clock jump", "uneven clock", "rate", "quantised", "counts", "swapped", "cut off", "two cuts", "speed", "short",
    "range",
)  # fmt: skip
"""Names of all faults."""

_NAMES = {
    "stuck": "frozen", "constant": "frozen", "clipping": "saturated", "reversed": "sign", "clock": "uneven clock",
}  # fmt: skip
_ZERO, _ZERO_SHARE = 0.15, 0.08  # [N], and share of the range, that a force may have while nothing is touched
_UNLOADED = 5e-3  # [m] by which a blade that was drawn back touches nothing that it loads
_RISEN, _FALLEN = (0.25, 0.05), (0.35, 0.2)  # the same for its change: a blade drawn back is held by friction


def record_faults(readings: Readings) -> tuple[Fault, ...]:
    """Return all known faults in a record of force, in order of rows."""
    found = list(column_faults(readings))
    if found:  # what follows would be about numbers that are no newtons over seconds
        return _in_order([*found, *doubled_readings(readings)])
    found = list(signal_faults(readings))
    kinds = {fault.kind for fault in found}
    zero = _offset(readings)
    found += [] if zero is None else [zero[1]]
    repeated = "doubled" in kinds and bool((np.diff(readings.time) == 0.0).any())
    try:
        trace = Trace(
            time=readings.time, force=readings.force - (0.0 if zero is None else zero[0]), position=readings.position,
            speed=readings.speed, force_unit=readings.force_unit, metadata=readings.metadata,
        )  # fmt: skip
    except ValueError as error:
        if not repeated:  # they are no record until they are deleted
            found.append(Fault("range", readings.all_rows, "certain", f"{error}".partition(". ")[0], "Check the unit."))
        return _in_order(found)
    jumps = {fault.rows for fault in found if fault.kind == "clock jump"}
    for issue in quality_issues(trace):
        if issue.rows in jumps or ("quantised" in kinds and issue.kind in ("stuck", "clipping")):
            continue
        found += _of_issue(issue, trace)
    found += _of_validity(trace)
    if not {"sign", "saturated"} & {fault.kind for fault in found}:  # friction is turned round, or the peak not known
        found += _drift(readings)
    return _in_order(found)


def _in_order(found: list[Fault]) -> tuple[Fault, ...]:
    return tuple(sorted(found, key=lambda fault: fault.rows))


def _of_issue(issue: QualityIssue, trace: Trace) -> Iterator[Fault]:
    seen, _, cure = issue.message.partition(". ")
    sure: Sureness = "certain" if issue.refuse else "likely"
    first, last = issue.rows
    if issue.kind == "clipping" and np.ptp(trace.force[first : last + 1]) == 0.0:
        # One flat top alone: a sensor at its limit, or one that hung.
        sure = "possible"
        yield Fault("frozen", issue.rows, sure, seen, "Check the sensor's cable, and record again.")
    yield Fault(_NAMES.get(issue.kind, issue.kind), issue.rows, sure, seen, cure)


def _of_validity(trace: Trace) -> Iterator[Fault]:
    rows = 0, len(trace) - 1
    for kind, reason in (
        ("cut off", is_truncated(trace)), ("cut off", starts_late(trace)), ("two cuts", holds_two_cuts(trace)),
    ):  # fmt: skip
        if reason:
            seen, _, cure = reason.partition(": ")
            yield Fault(kind, rows, "likely", seen, cure[:1].upper() + cure[1:] + ".")


def _offset(readings: Readings) -> tuple[float, Fault] | None:
    """Return the force at initial rest, and its fault if nonzero."""
    rest = readings.at_rest()
    if rest is None:
        return None
    zero = float(np.median(readings.force[rest]))
    limit = _limit(readings, _ZERO, _ZERO_SHARE)
    if abs(zero) <= limit or float(np.ptp(readings.force[rest])) > 10.0 * readings.noise + limit:
        return None
    seen = f"the force is {zero:.3g} before the blade moves"
    cure = "Set the sensor to zero before the cut, or subtract it (--map tares a quiet start by itself)."
    return zero, Fault("offset", (0, (rest.stop or 1) - 1), "likely", seen, cure)


def _drift(readings: Readings) -> Iterator[Fault]:
    """Find a zero that drifted between rests out of tissue."""
    before, after = readings.at_rest(), readings.at_rest(end=True)
    if before is None or after is None or readings.position is None:
        return
    if float(readings.position.max() - readings.position[-1]) < _UNLOADED:
        return  # still in the tissue, which may press
    change = float(np.median(readings.force[after]) - np.median(readings.force[before]))
    if change > _limit(readings, *_RISEN) or change < -_limit(readings, *_FALLEN):
        seen = f"the force of the resting blade has changed by {change:.3g} from the start to the end"
        cure = "Let the sensor warm up, and set it to zero before each cut."
        yield Fault("drift", readings.all_rows, "likely", seen, cure)


def _limit(readings: Readings, newtons: float, share: float) -> float:
    """Return the force that counts as none, newtons or range share."""
    span = max(share * readings.span, 1.5 * readings.resolution)
    return max(newtons, span) if readings.force_unit == "N" else span
