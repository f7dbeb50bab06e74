"""Comparison of two runs: ratios of new to old numbers."""

from __future__ import annotations

from scripts.benchmarks.speed.record import Record


def compared(old: Record, new: Record) -> list[str]:
    """Return lines with the ratio new/old of every number of ``new``, and the numbers that only one of them contains.

    Benchmarks that ``new`` leaves out are left out: they were not asked for.
    """
    lines = [
        f"new/old, old: cutenv {old.version} of {old.date}",
        "  (of a rate, unit 1/s, above 1 is faster; of a time, below 1 is)",
    ]
    for what in sorted({*old.machine, *new.machine}):
        before, after = (record.machine.get(what, "unknown") for record in (old, new))
        if before != after:
            lines.append(f"  not alike: {what} was {before}, is {after}")
    for benchmark, numbers in new.numbers.items():
        lines.append(benchmark)
        earlier = old.numbers.get(benchmark, {})
        width = max((len(name) for name in {*numbers, *earlier}), default=0)
        for name in [*numbers, *(name for name in earlier if name not in numbers)]:
            lines.append(f"  {name:{width}s}  {_ratio(name, old, new, benchmark)}")
    return lines


def _ratio(name: str, old: Record, new: Record, benchmark: str) -> str:
    before, after = (record.numbers.get(benchmark, {}).get(name) for record in (old, new))
    if before is None or after is None:
        return f"only in the {'new' if before is None else 'old'} run"
    if before.unit != after.unit:
        return f"was in {before.unit}, is in {after.unit}"
    numbers = f"({before.value:.5g} -> {after.value:.5g}{'' if after.unit == '1' else ' ' + after.unit})"
    return f"   -    {numbers}" if before.value == 0.0 else f"{after.value / before.value:7.3f} {numbers}"
