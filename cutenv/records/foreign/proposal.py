"""Proposal of a mapping for a foreign file.

It says which column is what, and asks the questions that the file leaves open.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array
from cutenv.records.foreign.column_map import ColumnMap, options_text
from cutenv.records.foreign.mapped_columns import (
    GREATEST_RATE,
    LEAST_RATE,
    assumed_unit,
    time_units,
    usual_step,
    way_units,
)
from cutenv.records.foreign.named_columns import NamedColumns, bare_name, column_stem
from cutenv.records.foreign.stated_units import known_spelling
from cutenv.records.schema import UNITS, RecordError

# Words in other programs' headers, without accents; the likelier ones first.
_WAYS = (
    "position", "pos", "displacement", "displ", "disp", "travel", "stroke", "way", "weg", "standardweg", "traversenweg",
    "extension", "crosshead", "distance", "verschiebung", "deplacement", "desplazamiento", "posicion", "spostamento",
    "posizione", "pose", "verfahrweg", "kolbenweg", "deformation", "verformung", "carriage", "stage", "feed",
    "actuator", "x",
)  # fmt: skip
_DEPTHS = {"depth", "thickness", "tiefe", "dicke", "profondeur", "epaisseur", "width", "diameter", "gap"}
_FORCES = {
    "force", "kraft", "f", "fx", "fy", "fz", "load", "last", "fuerza", "forza", "standardkraft", "prufkraft", "weight",
    "gewicht", "loadcell", "kraftaufnehmer", "effort", "wrench", "cell", "hx", "scale", "reading", "charge", "newton",
}  # fmt: skip
_TIMES = {
    "time", "timestamp", "timestamps", "t", "zeit", "zeitstempel", "temps", "tiempo", "tempo", "stamp", "ts", "elapsed",
    "pruefzeit", "prufzeit", "testzeit", "date", "datetime", "datum", "uhrzeit", "clock", "millis", "micros", "seconds",
    "sec", "ms", "us", "duration", "laufzeit", "messzeit", "rostime", "epoch", "secs",
}  # fmt: skip
_ORDERS = {"seq", "sequence", "nseq", "status"}
_COUNTERS = _ORDERS | {
     "index", "idx", "count", "counter", "sample", "samples", "no", "nr", "number", "row", "point", "pt", "frame",
    "id", "line", "scan", "n", "i", "reading", "record", "cycle", "event", "messpunkt", "lfd",
}  # fmt: skip
_DERIVED = {
    "stress", "strain", "spannung", "dehnung", "energy", "work", "torque", "moment", "energie", "max", "peak",
    "rate",
}  # fmt: skip
_MOMENTS = {f"{letter}{axis}" for letter in "tm" for axis in "xyz"}  # of a wrench
_NO_FORCES = _DERIVED | _MOMENTS | {
    "drehmoment", "couple", "momento", "temperature", "temp", "temperatur", "pressure", "druck", "pression", "voltage",
    "volts", "current", "strom", "humidity", "speed", "velocity", "geschwindigkeit", "vitesse", "acceleration", "accel",
    "beschleunigung", "angle", "winkel", "rpm", "battery", "status", "nm", "nmm", "kpa", "mpa", "psi", "degc",
}  # fmt: skip
"""Words of columns that are offered as a force to nobody, though they state no unit that is known."""
_PRESSED = {"cop", "copx", "copy", "copz", "cx", "cy", "cz"}  # the centre of pressure on a plate
_NO_PLACES = {"acc", "gyro", "mag", "vel", "v", "a", "w", "omega", "quat", "q", "rot", "orientation", "euler", "normal"}
_UNCALIBRATED = {"v", "mv", "uv", "volt", "mv/v", "v/v", "count", "ct", "raw", "adc", "lsb", "bit", "digit", "dig"}
"""Units of amplifiers and converters, which a calibration turns into newtons."""
_WANTED = {
    "commanded", "command", "cmd", "target", "setpoint", "soll", "desired", "reference", "demand", "peak", "min",
    "valley",
}  # fmt: skip
_OTHER_FORCE_UNITS = ("N", "mN", "kN", "gf", "kgf", "lbf", "1")
_FEWEST_TICKS = 4  # different times of a coarse clock that show its step
_USUAL_FORCE = (0.02, 500.0)  # [N]
_MIN_READINGS = 20  # readings in which a sign or the only rising column shows
_LEAST_WAY = 2e-3  # [m] of a column that is a way rather than a depth
_FEWEST_COUNTS = 1000.0  # range of whole numbers that may be those of a converter
_HEADER_SHARE = 0.1  # share of the rows beside which an old oscilloscope writes its header
_AXES = re.compile(
    r"(?P<name>(?:.*[^a-z])?(?P<what>pose|position|pos|force|wrench|f_ext\w*)[^a-z0-9]*)(?P<place>[0-5])\W*"
)
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
_MATRIX = re.compile(r"(?:.*[^a-z])?[a-z]_t_\w*?[^a-z0-9](?P<place>1[234])\W*")  # of 4 x 4, column by column


@dataclass(frozen=True, kw_only=True)
class Question:
    """Question that a file leaves open, with possible answers."""

    about: str  # field of the mapping: "time", "force", "position" or "rate"
    text: str
    # answers as words, and as items of the mapping (``{"unit": "mN"}``) which they set
    choices: tuple[tuple[str, Mapping[str, str]], ...]
    # index of the default answer; None if none is likelier than the others
    proposed: int | None = None

    def __str__(self) -> str:
        listed = ", ".join(words for words, _ in self.choices)
        taken = f" {self.choices[self.proposed][0]} is taken." if self.proposed is not None else ""
        return f"{self.text} ({listed}){taken}" if self.choices else f"{self.text}{taken}"


@dataclass(frozen=True, kw_only=True)
class Proposal:
    """Mapping suggested by a file, with the open questions."""

    # ``{"time": "t[ms]", "force": "F", "unit": "N"}``: fields, ``rate`` and the force's ``unit``
    items: Mapping[str, str]
    questions: tuple[Question, ...] = ()  # open questions; the answers that are proposed are among the items

    @property
    def mapping(self) -> ColumnMap | None:
        """Proposed mapping; None while a question lacks a proposed answer."""
        if any(question.proposed is None for question in self.questions):
            return None
        fields = [f"{name}={text}" for name, text in self.items.items() if name != "unit"]
        return ColumnMap.parse(fields, unit=self.items.get("unit"))

    def answered(self, items: Mapping[str, str]) -> Proposal:
        """Return the proposal with items set, and answered questions removed."""
        both = {**self.items, **items}
        if "rate" in items:
            both.pop("time", None)
        rest = tuple(
            each
            for each in self.questions
            if not (
                any(set(answer) <= set(items) for _, answer in each.choices)
                or (each.about == "rate" and ("rate" in items or "time" in items))
            )
        )
        return replace(self, items=both, questions=rest)

    def __str__(self) -> str:
        """Command line options, such as ``--map time=t force=F --unit N``."""
        return options_text(self.items)


def proposal(table: NamedColumns) -> Proposal:
    """Return the mapping suggested by columns, and the open questions."""
    return _Columns(table).proposal()


class _Columns:
    """Columns of a table by what they may be."""

    def __init__(self, table: NamedColumns) -> None:
        self.table = table
        self.n = table.n_columns
        self.cells = [table.typed(k) for k in range(self.n)]
        self.words = [_words(table, k) for k in range(self.n)]
        self.filled = [each.kind != "text" and _is_filled(np.isfinite(each.values)) for each in self.cells]
        self.questions: list[Question] = []
        self.items: dict[str, str] = {}

    def ask(
        self, about: str, text: str, choices: Iterable[tuple[str, Mapping[str, str]]] = (), proposed: int | None = None
    ) -> None:
        """Add an open question."""
        self.questions.append(Question(about=about, text=text, choices=tuple(choices), proposed=proposed))

    def proposal(self) -> Proposal:
        """Return mapping and questions."""
        time = self.time()
        forces = self.forces(time)
        ways = self.ways(time, forces)
        if not forces:
            forces = self.unnamed_forces(time, ways)
        alone = sum(each.kind != "text" for each in self.cells) == 1
        if not forces and time is not None and alone and not self.quantity(time):  # force needs the one column
            forces, time = [time], None
        if not forces:
            names = ", ".join(self.table.header(k) for k in range(self.n))
            raise RecordError(
                self.table.path,
                f"none of its columns ({names}) can be a force. Export the force, too; or name its column, force=#2.",
            )
        self.ask_time(time)
        force = self.ask_force(forces)
        position = self.ask_position([k for k in ways if k not in (time, *forces)], force)
        self.add_others((time, force, position))
        return Proposal(items=self.items, questions=tuple(self.questions))

    def quantity(self, k: int) -> str:
        """Return the stated unit's quantity, "" without, or "unknown"."""
        said = self.table.stated(k)
        if not said:
            return ""
        known = known_spelling(said)
        return known.quantity if known is not None else "unknown"

    def name(self, k: int) -> str:
        """Return a column as in a mapping: bare name or place."""
        names = [bare_name(header) for header in self.table.headers]
        is_plain = re.compile(r"[^\W\d][\w .]*|/[\w./]+")  # a name, or that of a topic
        stems = [column_stem(header) for header in self.table.headers]
        plain = (
            k < len(names)
            and is_plain.fullmatch(names[k])
            and names.count(names[k]) == 1
            and [name.lower() for name in names].count(names[k].lower()) == 1
            and stems.count(names[k].lower()) <= 1
        )
        return names[k] if plain else f"#{k + 1}"

    def rises(self, k: int) -> bool:
        """Return whether a column rises like time, but for restarts."""
        values = self.cells[k].values[np.isfinite(self.cells[k].values)]
        steps = np.diff(values)
        if not len(steps):
            return len(self.table) == 1  # nothing shows that it does not
        return bool(steps.max() > 0.0) and bool((steps < 0.0).mean() < 0.1)

    def goes_by_one(self, k: int) -> bool:
        """Return whether a column grows by one per reading."""
        values = self.known(k)
        return len(values) > 2 and bool((np.diff(values) == 1.0).mean() > 0.9)

    def is_counter(self, k: int) -> bool:
        """Return whether a column counts the readings."""
        counts = not self.words[k] or bool(_COUNTERS.intersection(self.words[k]))
        return self.goes_by_one(k) and counts and not _TIMES.intersection(self.words[k]) and not self.quantity(k)

    def time(self) -> int | None:
        """Return the column that is time."""
        ranked: list[tuple[float, int]] = []
        for k in range(self.n):
            if not self.filled[k]:
                continue
            values = self.cells[k].values[np.isfinite(self.cells[k].values)]
            named = bool(_TIMES.intersection(self.words[k])) or self.words[k] == ["x", "value"]
            named &= not (_DERIVED | _ORDERS).intersection(self.words[k])
            quantity = self.quantity(k)
            dated = self.cells[k].kind in ("clock", "date")
            if quantity not in ("", "time", "unknown") or not (dated or quantity == "time" or named):
                continue
            if not self.rises(k) and len(values) > 2:
                continue
            distinct = len(np.unique(values)) / len(values)
            if distinct * len(values) < _FEWEST_TICKS and len(values) >= _MIN_READINGS:
                continue
            rank = 2.0 * (distinct > 0.9) + distinct + (0.4 if quantity == "time" else 0.2 if dated else 0.0)
            ranked.append((rank, -k))
        if ranked:
            return -max(ranked)[1]
        return None if self.table.rate is not None else self._rising()  # a stated rate is no column's to overrule

    def _rising(self) -> int | None:
        """Return the only unnamed column that rises, or rises evenly."""
        free = [k for k in range(self.n) if self.filled[k] and not self.quantity(k) and not self.is_counter(k)]
        free = [k for k in free if not {*self.words[k]} & (_FORCES | _TIMES | {*_WAYS} | _DEPTHS)]
        risen = [k for k in free if self.rises(k) and bool((np.diff(self.known(k)) >= 0.0).all())]
        if len(self.table) < _MIN_READINGS:
            return risen[0] if risen else None
        steady = [k for k in risen if bool((np.diff(self.known(k)) > 0.0).mean() > 0.9)]  # a way rests at its ends
        risen = steady if len(steady) == 1 else risen
        return risen[0] if len(risen) == 1 else None

    def forces(self, time: int | None) -> list[int]:
        """Return columns with a force unit, else those named so."""
        free = [k for k in range(self.n) if k != time and self.filled[k]]
        told = [k for k in free if self.quantity(k) == "force" or self.is_normalised(k)]
        strange = _DERIVED | _MOMENTS | _ORDERS
        named = [k for k in free if _FORCES.intersection(self.words[k]) and not strange.intersection(self.words[k])]
        if told:
            return [k for k in named if k in told] or told
        silent = [k for k in named if not self.quantity(k)]
        return silent or [k for k in named if self.quantity(k) in ("unknown", "other")]

    def is_normalised(self, k: int) -> bool:
        """Return whether a column is our own force without unit."""
        try:
            return self.table.unit(k, "force") == "1"
        except RecordError:
            return False

    def unnamed_forces(self, time: int | None, ways: Sequence[int]) -> list[int]:
        """Return possible forces among columns without unit or telling name."""
        free = [k for k in range(self.n) if k != time and self.filled[k] and not self.quantity(k)]
        free = [k for k in free if k not in ways and self.cells[k].kind == "number" and not self.is_counter(k)]
        free = [k for k in free if not _NO_FORCES.intersection(self.words[k])]
        moving = [k for k in free if np.ptp(self.known(k)) > 0.0]
        return moving or self.uncalibrated(time) or free

    def uncalibrated(self, time: int | None) -> list[int]:
        """Return columns in volts or counts, possibly of force sensors."""
        free = [k for k in range(self.n) if k != time and self.filled[k]]
        free = [k for k in free if self.table.stated(k).lower().rstrip("s") in _UNCALIBRATED]
        return [k for k in free if not _NO_FORCES.intersection(self.words[k])]

    def ways(self, time: int | None, forces: Sequence[int]) -> list[int]:
        """Return possible ways of the blade, the likeliest first."""
        free = [k for k in range(self.n) if k != time and k not in forces and self.filled[k]]
        free = [k for k in free if not (_DEPTHS | _DERIVED | _PRESSED).intersection(self.words[k])]
        told = [k for k in free if self.quantity(k) == "length"]
        named = [k for k in free if not self.quantity(k) and set(_WAYS).intersection(self.words[k])]
        named = [k for k in named if not _MOMENTS.intersection(self.words[k])]
        other = _NO_FORCES | _NO_PLACES  # whose x is no place
        named = [
            k for k in named if {*_WAYS}.intersection(self.words[k]) != {"x"} or not other.intersection(self.words[k])
        ]
        named = [k for k in named if "x" not in self.words[k] or self.words[k] == ["x"] or len(self.words[k]) > 1]
        return sorted(told or named, key=self.rank_of)

    def known(self, k: int) -> Array:
        """Return the numbers of a column that are there."""
        values = self.cells[k].values
        return values[np.isfinite(values)]

    def ask_time(self, time: int | None) -> None:
        """Set the time, or ask for the rate."""
        if time is None:
            if self.table.rate is not None:
                self.items["rate"] = f"{self.table.rate:.10g}Hz"
                return
            still = [k for k in range(self.n) if _TIMES.intersection(self.words[k]) and self.filled[k]]
            why = "no column is a time"
            if still and abs(float(self.known(still[0])[0])) > 1e8:
                why = f"the time in {self.table.header(still[0])!r} stands still: 32 bits were too few for it"
            self.ask("rate", f"How many readings a second? {why}; rate=...Hz gives them.")
            return
        name, cells = self.name(time), self.cells[time]
        if self.quantity(time) == "time" or cells.unit:
            self.items["time"] = name
            unit = self.table.unit(time, "time") or "s"
            rate = self.rate(time, unit)
            if not LEAST_RATE <= rate <= GREATEST_RATE:
                others = [other for other in time_units(replace(cells, unit="")) if other != unit]
                text = f"Its times in {unit} make {rate:.3g} readings a second. Correct the unit in the header"
                text += f"; in {others[0]} they would make {self.rate(time, others[0]):.4g}." if others else "."
                self.ask("time", text)
            return
        units = time_units(cells)
        if not units:
            self.items["time"] = name
            self.ask(
                "time",
                f"In which unit is {self.table.header(time)!r}? None makes a usual rate.",
                ((unit, {"time": f"{name}[{unit}]"}) for unit in UNITS["time"]),
            )
            return
        self.items["time"] = name if units[0] == "s" else f"{name}[{units[0]}]"
        if self.goes_by_one(time) and len(self.table) >= _MIN_READINGS and not _TIMES.intersection(self.words[time]):
            self.ask(
                "time",
                f"Is {self.table.header(time)!r}, which counts by one, a time?",
                ((unit, {"time": f"{name}[{unit}]"}) for unit in units),
            )

    def rate(self, time: int, unit: str) -> float:
        """Return a time column's rate [Hz], 0 without step."""
        step = usual_step(self.cells[time].values) * UNITS["time"][unit]
        if len(self.table) < _MIN_READINGS:
            return LEAST_RATE
        return 1.0 / step if step else 0.0

    def ask_force(self, forces: list[int]) -> int:
        """Set the force; ask for its column and unit if open."""
        chosen, others = self.component(forces)
        sign = "-" if self.counts_down(chosen) else ""
        self.items["force"] = f"{sign}{self.name(chosen)}"
        unnamed = not self.quantity(chosen) and not _FORCES.intersection(self.words[chosen])
        if others and unnamed:
            self.ask_unnamed(chosen, others)
            return chosen
        if others:
            choices = [(self.table.header(k), {"force": self.name(k)}) for k in (chosen, *others)]
            choices[0] = (choices[0][0], {"force": self.items["force"]})
            if len(others) <= 2:
                listed = ",".join(self.name(k) for k in sorted((chosen, *others)))
                choices.append((f"norm({listed})", {"force": f"norm({listed})"}))
            self.ask("force", "Which column is the force along the cut?", choices, proposed=0)
        quantity = self.quantity(chosen)
        if quantity == "force" or self.is_normalised(chosen):
            return chosen
        header = self.table.header(chosen)
        if quantity == "":
            if self.table.force_unit and not unnamed:
                self.items["unit"] = self.table.force_unit
                return chosen
            likely = self.likely_unit(chosen)
            text = f"In which unit is the force {header!r}?"
            if likely is None:
                text += " Whole numbers may be counts of a converter; calibrate them to newtons."
            else:
                self.items["unit"] = likely
            self.ask(
                "force",
                text,
                ((unit, {"unit": unit}) for unit in _OTHER_FORCE_UNITS),
                proposed=None if likely is None else _OTHER_FORCE_UNITS.index(likely),
            )
            return chosen
        said = self.table.stated(chosen)
        units = _OTHER_FORCE_UNITS if quantity == "unknown" else ("1",)
        cure = "" if quantity == "unknown" else "; calibrate it to newtons, or take it as normalised, 1"
        self.ask(
            "force",
            f"The force {header!r} is in {said!r}, which is no known unit of force{cure}. In which is it?",
            ((unit, {"unit": unit}) for unit in units),
        )
        return chosen

    def likely_unit(self, force: int) -> str | None:
        """Return the likely unit of a force without one: usually newtons.

        None for whole numbers of a converter.
        """
        values = self.known(force)
        span = float(np.ptp(values))
        if len(values) >= _MIN_READINGS and span > _FEWEST_COUNTS and bool((values % 1.0 == 0.0).all()):
            return None
        good = [unit for unit in ("N", "mN", "kN") if _USUAL_FORCE[0] <= span * UNITS["force"][unit] <= _USUAL_FORCE[1]]
        return good[0] if good else "N"

    def ask_unnamed(self, chosen: int, others: list[int]) -> None:
        """Ask which unnamed column is force; the smooth one is way."""
        free = (chosen, *others)
        going = [k for k in free if self.goes_on(k)]
        way = going[0] if len(going) == 1 and "position" not in self.items else None
        if way == chosen:
            chosen = others[0]
        free = (chosen, *(k for k in free if k != chosen))
        choices = []
        for k in free:
            unit = self.likely_unit(k) or "1"
            words, items = f"force {self.table.header(k)!r} in {unit}", {"force": self.name(k), "unit": unit}
            if way is not None and way != k:
                words += f", position {self.table.header(way)!r}"
                items["position"] = self.with_unit(way)
            choices.append((words, items))
        self.items |= choices[0][1]
        text = "Which column is the force along the cut? --unit gives another unit."
        self.ask("force", text, choices, proposed=0)

    def goes_on(self, k: int) -> bool:
        """Return whether a column moves smoothly, unlike a force."""
        values = self.known(k)
        steps = np.diff(values)
        span = float(np.ptp(values))
        return len(values) >= _MIN_READINGS and bool(
            abs(values[-1] - values[0]) > 0.5 * span > 20.0 * np.median(np.abs(steps))
        )

    def with_unit(self, k: int, sign: str = "") -> str:
        """Return a column as mapped position, its unit stated or assumed."""
        name = f"{sign}{self.name(k)}"
        unit = "" if self.table.stated(k) else assumed_unit(self.table, "position", [k])
        return f"{name}[{unit}]" if unit and unit != "m" else name

    def component(self, forces: list[int]) -> tuple[int, list[int]]:
        """Return the likeliest force column, and equally possible ones."""
        spans = {k: float(np.ptp(self.known(k))) for k in forces}
        axes = [k for k in forces if self.words[k] and re.fullmatch(r"f?[xyz]", self.words[k][-1])]
        plain = [k for k in forces if k not in axes and not _WANTED.intersection(self.words[k])]
        if len(axes) > 1 and not plain:
            chosen = max(axes, key=lambda k: spans[k])
            return chosen, [k for k in axes if k != chosen and spans[k] > 0.05 * spans[chosen]]
        forces = plain or forces
        chosen = next((k for k in forces if spans[k] > 0.0), forces[0])
        rest = [k for k in forces if k != chosen and spans[k] > 0.0 and not self.alike(k, chosen)]
        return chosen, rest

    def alike(self, k: int, other: int) -> bool:
        """Return whether two columns hold the same."""
        return np.array_equal(self.cells[k].values, self.cells[other].values, equal_nan=True)

    def counts_down(self, force: int) -> bool:
        """Return whether a force is negative under load, as in compression."""
        values = self.known(force)
        if len(values) < _MIN_READINGS:
            return False
        low, high = (float(np.quantile(values, share)) for share in (0.002, 0.998))
        if low < 0.0 and high < 0.15 * -low:
            return True
        start = values[: max(5, len(values) // 20)]
        rest = float(np.median(start))
        return bool(np.ptp(start) < 0.1 * (high - low)) and rest - low > 4.0 * (high - rest)

    def ask_position(self, ways: list[int], force: int) -> int | None:
        """Set the position away from the clamp, or ask for it."""
        moving = [k for k in ways if np.ptp(self.known(k)) > 0.0]
        if not moving:
            return self.ask_moving_depth(force)
        chosen = moving[0]
        first = self.rank_of(chosen)
        others = [k for k in moving[1:] if self.rank_of(k) == first and not self.alike(k, chosen)]
        if others and all(re.fullmatch(r"[xyz]", self.words[k][-1]) for k in (chosen, *others) if self.words[k]):
            widest = max((chosen, *others), key=lambda k: float(np.ptp(self.known(k))))
            span = float(np.ptp(self.known(widest)))
            others = [k for k in (chosen, *others) if k != widest and np.ptp(self.known(k)) > 0.05 * span]
            chosen = widest
        sign = "-" if self.runs_back(chosen, force) else ""
        name = f"{sign}{self.name(chosen)}"
        self.items["position"] = self.with_unit(chosen, sign)
        if not self.table.stated(chosen) and len(way_units(self.cells[chosen].values)) > 1:
            self.ask(
                "position",
                f"In which unit is the position {self.table.header(chosen)!r}?",
                ((each, {"position": f"{name}[{each}]"}) for each in way_units(self.cells[chosen].values)),
                proposed=0,
            )
        if others:
            choices = ((self.table.header(k), {"position": self.name(k)}) for k in others)
            self.ask(
                "position",
                "Which column is the position of the blade?",
                ((self.table.header(chosen), {"position": self.items["position"]}), *choices),
                proposed=0,
            )
        return chosen

    def ask_moving_depth(self, force: int) -> int | None:
        """Take a moving depth for the only possible position, and ask."""
        depths = [k for k in range(self.n) if k != force and self.is_depth(k) and self.moves(k)]
        if len(depths) != 1:
            self.ask_unknown_way(force)
            return None
        (chosen,) = depths
        name = self.name(chosen)
        sign = "-" if self.runs_back(chosen, force) else ""
        self.items["position"] = f"{sign}{name}"
        text = (
            f"Is {self.table.header(chosen)!r}, which moves, the position of the blade? If not, map it as depth={name}."
        )
        choice = (self.table.header(chosen), {"position": self.items["position"]})
        self.ask("position", text, (choice,), proposed=0)
        return chosen

    def is_depth(self, k: int) -> bool:
        """Return whether a column is named depth, with length unit."""
        called = {"depth", "tiefe", "profondeur"}.intersection(self.words[k])
        return bool(called) and self.filled[k] and self.quantity(k) == "length"

    def moves(self, k: int) -> bool:
        """Return whether a column moves smoothly through a usual way."""
        values = self.known(k)
        size = UNITS["position"][self.table.unit(k, "position") or "m"]
        way = float(np.ptp(values))
        return (
            len(values) >= _MIN_READINGS and way * size > _LEAST_WAY and way > 20.0 * np.median(np.abs(np.diff(values)))
        )

    def ask_unknown_way(self, force: int) -> None:
        """Ask for the unit of a position in an unknown one."""
        for k in range(self.n):
            if k == force or not self.filled[k] or self.quantity(k) != "unknown" or self.words[k] == ["x", "value"]:
                continue
            if not set(_WAYS).intersection(self.words[k]) or _DERIVED.intersection(self.words[k]):
                continue
            name, said = self.name(k), self.table.stated(k)
            choices = [(f"{unit}", {"position": f"{name}[{unit}]"}) for unit in ("mm", "cm", "m", "um", "in")]
            text = f"The position {self.table.header(k)!r} is in {said!r}, which is no known unit. In which is it?"
            self.ask("position", text, (("left out", {}), *choices), proposed=0)
            return

    def rank_of(self, k: int) -> int:
        """Return a column name's rank among ways, target values last."""
        wanted = len(_WAYS) * bool(_WANTED.intersection(self.words[k]))
        return wanted + min((_WAYS.index(word) for word in self.words[k] if word in _WAYS), default=len(_WAYS))

    def runs_back(self, way: int, force: int) -> bool:
        """Return whether a way counts toward the clamp under force."""
        position, acting = self.cells[way].values, self.cells[force].values
        known = np.isfinite(position)
        if np.count_nonzero(known) < _MIN_READINGS:
            return False
        if not known.all():  # a slower column
            position = np.interp(np.arange(len(position)), np.flatnonzero(known), position[known])
        rest = float(np.nanmedian(acting[: max(3, len(acting) // 20)]))
        loaded = np.abs(np.nan_to_num(acting - rest)) > 0.2 * float(np.nanmax(np.abs(acting - rest)))
        steps = np.diff(position)
        if self.table.parts is not None:
            steps[np.diff(self.table.parts) != 0] = 0.0
        under = steps[loaded[1:]]
        span = float(np.ptp(position))
        return bool(under.sum() < -0.3 * span and np.count_nonzero(under < 0.0) > np.count_nonzero(under > 0.0))

    def add_others(self, taken: tuple[int | None, ...]) -> None:
        """Set angle and depth where just one column fits."""
        free = [k for k in range(self.n) if k not in taken and self.filled[k]]
        angles = [k for k in free if self.quantity(k) == "angle"]
        depths = [k for k in free if self.is_depth(k) and not set(_WAYS).intersection(self.words[k])]
        for field, found, limit in (("angle", angles, np.pi), ("depth", depths, 0.1)):
            if len(found) == 1:
                size = UNITS[field][self.table.unit(found[0], field) or ""]
                values = self.known(found[0]) * size
                if len(values) == len(self.table) and values.min() >= 0.0 and values.max() <= limit:
                    self.items[field] = self.name(found[0])


def _is_filled(known: NDArray[np.bool_]) -> bool:
    """Return whether a column has readings, not only a header."""
    rows = np.flatnonzero(known)
    return len(rows) >= min(2, len(known)) and not (len(known) > 100 and rows[-1] < _HEADER_SHARE * len(known))


def _axis_of_place(header: str, headers: Sequence[str]) -> str:
    """Return a position column's axis, as of ``tip_x``, or "". The record must have all three axes and a force."""
    header, *every = [re.sub(_CAMEL, "_", each.strip()).lower() for each in (header, *headers)]
    name, axis = header[:-1], header[-1:]
    if axis not in "xyz" or not all(f"{name}{each}" in every for each in "xyz"):
        return ""
    words = set(re.findall(r"[a-z]+", name))
    if words & (_FORCES | _NO_FORCES | _NO_PLACES) or not re.fullmatch(r"(?:.*[^a-z])?p?", name):
        return ""
    forces = [{*re.findall(r"[a-z]+", each)} for each in every if each[:-1] != name]
    return axis if any(each & _FORCES for each in forces) else ""


def _words(table: NamedColumns, column: int) -> list[str]:
    """Return the words of a column's name, lower-case and without accents."""
    if column >= len(table.headers):
        return []
    header = table.headers[column].lower()
    if (found := _MATRIX.fullmatch(header)) is not None:
        return ["pose", "xyz"[int(found["place"]) - 12]]
    if (found := _AXES.fullmatch(header)) is not None:
        others = [each.lower() for each in table.headers]
        place, what = int(found["place"]), "pose" if found["what"].startswith("pos") else "force"
        places = sum(any(each.startswith(f"{found['name']}{k}") for each in others) for k in range(7))
        if places == 3 or (places == 6 and found["what"] not in ("position", "pos")):  # from 0, and not joints
            return [what, "xyz"[place]] if place < 3 else ["angle" if what == "pose" else "torque"]
    if (axis := _axis_of_place(table.headers[column], table.headers)) and not table.stated(column):
        return ["pos", axis]
    stem = re.sub(_CAMEL, " ", re.sub(r"\s*[\[(].*?[\])]", "", table.headers[column]))
    plain = unicodedata.normalize("NFD", column_stem(stem))
    return re.findall(r"[a-z]+", "".join(letter for letter in plain if not unicodedata.combining(letter)))
