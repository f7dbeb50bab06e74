"""Laboratory programs' file headers with names, units and rate."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from cutenv.records.foreign.cell_values import NUMBER_PATTERNS, CellValues, cell_values
from cutenv.records.foreign.stated_units import known_spelling
from cutenv.records.foreign.table_layouts import ChannelBlock, igor_blocks, joined_rows, spike2_blocks

_END = "***End_of_Header***"
_LABCHART = ("Interval=", "ExcelDateTime=", "TimeFormat=", "DateFormat=", "ChannelTitle=", "Range=", "UnitName=",
             "TopValue=", "BottomValue=", "BlockName=")  # fmt: skip
_NUMBER = NUMBER_PATTERNS["."].replace(r"\.", "[.,]")
_RATE = re.compile(
    r"(?:sampl\w*[ _.-]*(?:rate|freq\w*)|samplerate|samples?[ _]per[ _]second|abtast(?:rate|frequenz)|"
    r"messrate|data ?rate|scan rate|acquisition rate|frequency|fs|rate)(?:_hz)?\b[^\d\n]{0,14}?"
    + rf"({_NUMBER})\s*(k?Hz|[kK]?S/s|1/s|samples?/s\w*|)",
    re.IGNORECASE,
)
_READINGS = re.compile(rf"sampling\W{{1,6}}({_NUMBER})\s*(k?Hz|[kK]?S/s|(?:data|samples?)/s\w*)", re.IGNORECASE)
_FORCE_UNIT = re.compile(
    r"[\s#%\"]*(?:force|load|kraft)?[ _]?(?:units?|einheit)\"?\s*[:=,;\t ]+\"?([a-z]{1,6})[\s\",;]*", re.IGNORECASE
)
_STEP = re.compile(
    r"(?:sampl\w*[ _.-]*(?:interval|period|time)|interval|delta[ _]?[xt]|d[xt]|time ?step|increment|schrittweite|"
    r"abtast(?:intervall|zeit)|messintervall|datarate interval)\b"
    r"(?:\s*[\[(](?P<ahead>\w+)[\])])?[^\d\n]{0,14}?" + rf"(?P<number>{_NUMBER})\s*(?P<unit>[a-zA-Z\u00b5\u03bc]*)",
    re.IGNORECASE,
)
_SIZE = {"khz": 1e3, "ks/s": 1e3}


@dataclass(frozen=True, kw_only=True)
class MakerHeader:
    """Statements of a header."""

    lines: list[str]  # lines of the file, those of the header blank
    names: tuple[str, ...] = ()  # names and units of the columns; empty if the header states none
    units: tuple[str, ...] = ()
    rate: float | None = None  # readings a second [Hz]
    starts: tuple[float, ...] = field(default=())  # beginning of each segment [s]; empty if there is one
    maker: str = ""  # program that wrote the file, for the reader
    # counts of a unit, by the name of the column whose whole numbers are counts
    counts: Mapping[str, float] = field(default_factory=dict)

    def scaled(self, names: Sequence[str], typed: Callable[[int], CellValues]) -> Callable[[int], CellValues]:
        """Return the column reader, with the header's counts as unit."""
        if not self.counts:
            return typed

        @functools.cache
        def in_units(k: int) -> CellValues:
            cells = typed(k)
            counts = self.counts.get(names[k]) if k < len(names) else None
            if counts is None or (cells.values % 1.0 != 0.0).any():
                return cells
            return replace(cells, values=cells.values / counts)

        return in_units


def maker_header(lines: list[str]) -> MakerHeader:
    """Return a known program's header; for others the lines unchanged."""
    first = lines[0].lstrip('"').strip()
    if first.startswith("LabVIEW Measurement"):
        return _labview(lines)
    if any(line.startswith(("Interval=", "ChannelTitle=")) for line in lines[:20]):
        return _labchart(lines)
    if len(lines) > 4 and re.search(rf"{_NUMBER}\s*\S+/sample|samples?/sec", lines[1], re.IGNORECASE):
        return _biopac(lines)
    if first.startswith("channel names:"):
        return _signal_express(lines)
    if first == "IGOR":
        return _channels(lines, igor_blocks(lines), "Igor")
    if first.startswith("INFORMATION") and any(line.startswith('"CHANNEL"') for line in lines):
        return _channels(lines, spike2_blocks(lines), "Spike2")
    if first.startswith("# OpenSignals"):
        return _open_signals(lines)
    if re.match(r"Record Length,[^,]*,,", lines[0]):
        return _beside(lines)
    if first in ("Devices", "Trajectories", "Model Outputs") and len(lines) > 5:
        return _vicon(lines)
    if any("Counts per Unit Force" in line for line in lines[:20]):
        return _net_ft(lines)
    return MakerHeader(lines=lines)


def stated_rate(above: Sequence[str]) -> float | None:
    """Return the rate stated above a table [Hz]; None unless unique."""
    rates = set()
    for line in above:
        plain = re.sub(r'["\t;:=,]+(?=\D|$)|(?<=\D)["\t;:=,]+', " ", line)
        if found := _RATE.search(plain) or _READINGS.search(plain):
            rates.add(_float(found[1]) * _SIZE.get(found[2].lower(), 1.0))
        elif found := _STEP.search(plain):
            said = found["ahead"] or found["unit"]
            unit = known_spelling(said) if said else None
            size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}.get(unit.unit if unit else "s")
            if size and _float(found["number"]) > 0.0:
                rates.add(1.0 / (_float(found["number"]) * size))
    good = {rate for rate in rates if 1.0 <= rate <= 1e6}
    return good.pop() if len(good) == 1 else None


def stated_force_unit(above: Sequence[str]) -> str:
    """Return the force unit stated above a table; "" unless unique."""
    found = (_FORCE_UNIT.fullmatch(line) for line in above)
    known = [known_spelling(said[1]) for said in found if said is not None]
    units = {each.unit for each in known if each is not None and each.quantity == "force"}
    return units.pop() if len(units) == 1 else ""


def _float(text: str) -> float:
    return float(text.replace(",", "."))


def _labview(lines: list[str]) -> MakerHeader:
    """Read a LabVIEW measurement file (.lvm) with its segments."""
    kind = next((line for line in lines[:30] if line.startswith("Separator")), "Separator\tTab")
    separator = next((sign for name, sign in (("Comma", ","), ("Semicolon", ";")) if name in kind), "\t")
    kept = list(lines)
    stated: list[dict[str, list[str]]] = []
    file_facts: dict[str, list[str]] = {}
    current: dict[str, list[str]] = {}
    names: tuple[str, ...] = ()
    inside = True
    for i, line in enumerate(lines):
        cells = [cell.strip() for cell in line.split(separator)]
        if not inside and cells[0] == "Channels":
            inside, current = True, {}
        if inside:
            kept[i] = ""
            current.setdefault(cells[0], cells[1:])
            if cells[0] == _END:
                inside = False
                if "Channels" in current:
                    stated.append(current)
                    below = lines[i + 1].split(separator) if i + 1 < len(lines) else []
                    names = names or tuple(cell.strip() for cell in below)
                    kept[i + 1 : i + 2] = [""] * bool(below)
                else:
                    file_facts, current = current, {}
    if not stated:  # a header without one of a segment
        return MakerHeader(lines=kept, maker="LabVIEW")
    columns = (file_facts.get("X_Columns") or ["One"])[0]
    segment = stated[0]
    channels = int((segment["Channels"] or ["1"])[0] or 1)
    said = [*segment.get("Y_Unit_Label", []), *[""] * channels][:channels]
    is_time = (segment.get("X_Dimension") or ["Time"])[0] in ("Time", "")
    ahead = "s" if is_time else ""
    units = [each for unit in said for each in (ahead, unit)] if columns == "Multi" else [ahead, *said]
    steps = [_float(step) for step in segment.get("Delta_X", []) if step]
    clocks = cell_values([(each.get("Time") or ["0"])[0].replace(",", ".") for each in stated], ".")
    clock = clocks.values - clocks.values[0] if clocks.kind == "clock" else [0.0] * len(stated)
    starts = []
    for each, behind in zip(stated, clock, strict=True):
        x0 = next((_float(cell) for cell in each.get("X0", []) if cell), 0.0)
        starts.append((x0 if columns == "No" else 0.0) + float(behind))
    rate = 1.0 / steps[0] if columns == "No" and is_time and steps and steps[0] > 0.0 else None
    return MakerHeader(
        lines=kept,
        names=names,
        units=tuple(units),
        rate=rate,
        starts=tuple(starts) if len(starts) > 1 else (),
        maker="LabVIEW",
    )


def _labchart(lines: list[str]) -> MakerHeader:
    """Read the header in front of every LabChart block."""
    kept = ["" if line.startswith(_LABCHART) else line for line in lines]
    stated = {
        key.rstrip("="): line[len(key) :] for key in _LABCHART for line in reversed(lines) if line.startswith(key)
    }
    names = [cell.strip() for cell in stated.get("ChannelTitle", "").split("\t") if cell.strip()]
    units = [cell.strip() for cell in stated.get("UnitName", "").lstrip("\t").split("\t")]
    units = ["" if unit == "*" else unit for unit in units]
    step = [part for part in re.split(r"\s+", stated.get("Interval", "").strip()) if part]
    rate = None
    if step:
        unit = known_spelling(step[1]) if len(step) > 1 else None
        size = {"ms": 1e-3, "us": 1e-6, "min": 60.0}.get(unit.unit if unit else "s", 1.0)
        rate = 1.0 / (_float(step[0]) * size)
    return MakerHeader(
        lines=kept,
        names=("Time", *names),
        units=("s", *[*units, *[""] * len(names)][: len(names)]),
        rate=rate,
        maker="LabChart",
    )


def _biopac(lines: list[str]) -> MakerHeader:
    """Read AcqKnowledge's text header: interval, channel count, names and units."""
    found = re.search(rf"({_NUMBER})\s*(\S+)", lines[1])
    count = re.search(r"(\d+)\s+channel", lines[2])
    if found is None or count is None:
        return MakerHeader(lines=lines)
    unit = known_spelling(found[2].partition("/")[0])
    size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}.get(unit.unit if unit else "", 0.0)
    rate = _float(found[1]) if "/sec" in lines[1] else 1.0 / (_float(found[1]) * size) if size else None
    channels = int(count[1])
    pairs = lines[3 : 3 + 2 * channels]
    rest = 3 + 2 * channels
    above = next((i for i in range(rest, min(rest + 4, len(lines))) if "CH" in lines[i]), None)
    kept = [*[""] * rest, *lines[rest:]]
    names, units = [line.strip() for line in pairs[::2]], [line.strip() for line in pairs[1::2]]
    if above is not None:
        time = lines[above].split("\t")[0].split(",")[0].strip()
        kept[above] = ""
        counts = re.findall(r"\d+", lines[above + 1]) if above + 1 < len(kept) else []
        below = re.fullmatch(r"[\d\s,;]*", lines[above + 1]) if counts else None
        if below and len(counts) == channels and len(set(counts)) == 1:  # the number of samples of each channel
            kept[above + 1] = ""
        if not time.startswith("CH"):
            names, units = ["Time", *names], [time, *units]
    return MakerHeader(lines=kept, names=tuple(names), units=tuple(units), rate=rate, maker="AcqKnowledge")


def _channels(lines: list[str], blocks: list[ChannelBlock], maker: str) -> MakerHeader:
    """Join channels that stand below one another."""
    kept = joined_rows(lines, blocks)
    if kept is None:
        return MakerHeader(lines=lines)
    step = blocks[0].step
    return MakerHeader(
        lines=kept,
        names=tuple(name for block in blocks for name in block.names),
        units=tuple(unit for block in blocks for unit in block.units),
        rate=1.0 / step if step else None,
        maker=maker,
    )


def _signal_express(lines: list[str]) -> MakerHeader:
    """Read SignalExpress text: names, starts and steps below their headings."""
    below = {lines[i].strip().rstrip(":"): lines[i + 1].split("\t") for i in range(min(20, len(lines) - 1))}
    end = next((i for i, line in enumerate(lines[:20]) if line.startswith("data:")), None)
    steps = {_float(cell) for cell in below.get("dt", []) if cell.strip()}
    if end is None or len(steps) != 1 or min(steps) <= 0.0:
        return MakerHeader(lines=lines)
    return MakerHeader(
        lines=[*[""] * (end + 1), *lines[end + 1 :]],
        names=tuple(cell.strip() for cell in below.get("channel names", [])),
        rate=1.0 / steps.pop(),
        maker="SignalExpress",
    )


def _open_signals(lines: list[str]) -> MakerHeader:
    """Read OpenSignals' JSON header: columns and rate; whole numbers are raw."""
    try:
        (device,) = json.loads(lines[1].lstrip("# ")).values()
        names, sensors, rate = device["column"], device["sensor"], float(device["sampling rate"])
    except (ValueError, KeyError, AttributeError, TypeError):
        return MakerHeader(lines=lines)
    rows = [line.split() for line in lines if line[:1].isdigit()]
    raw = len(sensors) * ("raw",) if rows and all(cell.lstrip("-").isdigit() for cell in rows[-1]) else ()
    names = [*names[: len(names) - len(sensors)], *(device.get("label") or names)[-len(sensors) :]]
    units = [""] * (len(names) - len(raw)) + [*raw]
    return MakerHeader(lines=lines, names=tuple(names), units=tuple(units), rate=rate, maker="OpenSignals")


def _beside(lines: list[str]) -> MakerHeader:
    """Read older Tektronix files, with the header in the first columns."""
    rows = [line.split(",") for line in lines]
    said = {row[0].strip(): row[1].strip() for row in rows[:30] if len(row) > 4 and row[0].strip()}
    kept = [",".join(row[3:5]) if len(row) > 4 else line for row, line in zip(rows, lines, strict=True)]
    units = (said.get("Horizontal Units", "s"), said.get("Vertical Units", ""))
    return MakerHeader(lines=kept, names=("Time", said.get("Source") or "CH1"), units=units, maker="Tektronix")


def _net_ft(lines: list[str]) -> MakerHeader:
    """Read ATI's Net F/T header: unit and counts per unit."""
    facts = dict(re.findall(r'"([\w ]+):(?: |",\s*")([^"]*)"', " ".join(lines[:20])))
    counts, units = {}, {}
    for what, letter in (("Force", "F"), ("Torque", "T")):
        number = _float(facts.get(f"Counts per Unit {what}", "1"))
        for axis in "xyz":
            counts[f"{letter}{axis}"], units[f"{letter}{axis}"] = number, facts.get(f"{what} Units", "")
    above = next((i for i, line in enumerate(lines[:20]) if re.search(r"\bFx\b", line)), None)
    if above is None:
        return MakerHeader(lines=lines)
    names = tuple(name.strip(' "') for name in lines[above].split(","))
    kept = [*[""] * (above + 1), *lines[above + 1 :]]
    said = tuple(units.get(name, "") for name in names)
    return MakerHeader(lines=kept, names=names, units=said, counts=counts, maker="Net F/T")


def _vicon(lines: list[str]) -> MakerHeader:
    """Read a Vicon Nexus table's header: rate, devices, names, units."""
    rate = re.fullmatch(rf"({_NUMBER})[,\t; ]*", lines[1].strip())
    above = next((i for i, line in enumerate(lines[:8]) if line.startswith("Frame")), None)
    if rate is None or above is None or above + 1 >= len(lines):
        return MakerHeader(lines=lines)
    separator = next((sign for sign in "\t;" if sign in lines[above]), ",")
    names, units = ([cell.strip() for cell in lines[i].split(separator)] for i in (above, above + 1))
    return MakerHeader(
        lines=[*[""] * (above + 2), *lines[above + 2 :]],
        names=tuple(names),
        units=tuple(units),
        rate=_float(rate[1]),
        maker="Vicon Nexus",
    )
