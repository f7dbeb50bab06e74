"""Reference sets.

Many scored cuts of known origin, among which a cut's metrics are ranked as percentiles.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.resources import path as resource
from cutenv._base.validation import one_of
from cutenv.records.scoring.cut_metrics import METRICS
from cutenv.sim.trace import Trace

REFERENCE_SCHEMA = "cutenv-reference/1"
SHIPPED_REFERENCES = {"baselines": "reference/baselines.csv", "force-alone": "reference/force_alone.csv"}
"""Reference sets that come with the package, by name: from the present tissue model, and from the first one.

Records of force alone use the first, frozen: they are not cuts of ours, and their scores should not move.
"""
FEWEST_REFERENCE_CUTS = 20  # number of cuts in a reference set below which no percentile is given
_TIE = 1e-4  # tolerance relative to the value, or to the largest one: the files hold five digits


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceSet:
    """Metrics of many cuts.

    Attributes
    ----------
    about : str
        Origin: who cut what, in a sentence.
    groups : tuple of str, length n
        Group that made each cut.
    values : mapping of str to ndarray of shape (n,)
        Values by metric; NaN where a cut has none.
    """

    name: str
    about: str
    force_unit: str
    groups: tuple[str, ...]
    values: Mapping[str, Array]

    def __post_init__(self) -> None:
        for name, values in self.values.items():
            one_of("metric", name, METRICS)
            if len(values) != len(self.groups):
                raise ValueError(f"metric {name} has {len(values)} values for {len(self.groups)} cuts.")

    def __len__(self) -> int:
        return len(self.groups)

    def percentile(self, name: str, value: float) -> float | None:
        """Return the share of worse cuts, ties half [%], or None.

        The share is None for too few values, or a metric without direction.
        """
        metric = METRICS[one_of("metric", name, METRICS)]
        known = self.values.get(name, np.zeros(0))
        known = known[np.isfinite(known)]
        if len(known) < FEWEST_REFERENCE_CUTS or metric.direction == "none":
            return None
        sign = 1.0 if metric.direction == "lower" else -1.0
        same = np.isclose(known, value, rtol=_TIE, atol=_TIE * float(np.abs(known).max()))
        worse = np.sum((sign * known > sign * value) & ~same) + 0.5 * np.sum(same)
        return float(100.0 * worse / len(known))

    @classmethod
    @cache
    def shipped(cls, name: str = "baselines") -> ReferenceSet:
        """Load a reference set that comes with the package."""
        return cls.load(resource(SHIPPED_REFERENCES[one_of("reference set", name, SHIPPED_REFERENCES)]))

    @classmethod
    def of(
        cls, rows: Sequence[tuple[str, Mapping[str, float | None]]], *, name: str, about: str, force_unit: str
    ) -> ReferenceSet:
        """Build a reference set from cuts' (group, metrics)."""
        if not rows:
            raise ValueError("a reference set needs cuts; there is none.")
        values = {
            metric: np.array([np.nan if row.get(metric) is None else row[metric] for _, row in rows], np.float64)
            for metric in METRICS
        }
        kept = {metric: column for metric, column in values.items() if np.isfinite(column).any()}
        return cls(name=name, about=about, force_unit=force_unit, groups=tuple(group for group, _ in rows), values=kept)

    def save(self, path: Path) -> None:
        """Write the set as CSV, below a comment with its description."""
        head = {"schema": REFERENCE_SCHEMA, "name": self.name, "about": self.about, "force_unit": self.force_unit}
        with path.open("w", newline="", encoding="utf-8") as file:
            file.write(f"# {json.dumps(head)}\n")
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["group", *self.values])
            for i, group in enumerate(self.groups):
                cells = [f"{column[i]:.5g}" if np.isfinite(column[i]) else "" for column in self.values.values()]
                writer.writerow([group, *cells])

    @classmethod
    def load(cls, path: Path) -> ReferenceSet:
        """Load a :meth:`save` file; ValueError for anything else."""
        with path.open(newline="", encoding="utf-8") as file:
            first = file.readline()
            rows = list(csv.reader(file))
        try:
            head = json.loads(first.removeprefix("# "))
            if head["schema"] != REFERENCE_SCHEMA:
                raise ValueError(f"schema {head['schema']!r}")
            names, body = rows[0][1:], rows[1:]
            columns = [[float(row[k]) if row[k] else np.nan for row in body] for k in range(1, len(names) + 1)]
            return cls(
                name=head["name"],
                about=head["about"],
                force_unit=head["force_unit"],
                groups=tuple(row[0] for row in body),
                values={name: np.array(column) for name, column in zip(names, columns, strict=True)},
            )
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise ValueError(f"{path} is not a reference set ({error}); ReferenceSet.save writes one.") from None


def fitting_reference(reference: ReferenceSet | None, trace: Trace) -> ReferenceSet | None:
    """Return the reference set for a record.

    It is None if its force is in another unit and cannot be compared.

    A record of force alone is compared with the set for such records.
    """
    if reference is not None and reference.name == "baselines" and trace.position is None:
        reference = ReferenceSet.shipped("force-alone")
    return reference if reference is not None and reference.force_unit == trace.force_unit else None
