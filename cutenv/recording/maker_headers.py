"""Headers of laboratory programs that state names, units and rate in lines of their own, above the numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from cutenv.recording.cell_values import NUMBER_PATTERNS, cell_values
from cutenv.recording.stated_units import known_spelling

_END = "***End_of_Header***"
_LABCHART = ("Interval=", "ExcelDateTime=", "TimeFormat=", "DateFormat=", "ChannelTitle=", "Range=", "UnitName=",
             "TopValue=", "BottomValue=", "BlockName=")  # fmt: skip
_NUMBER = NUMBER_PATTERNS["."].replace(r"\.", "[.,]")
_RATE = re.compile(
    r"(?:sampl\w*[ _.-]*(?:rate|freq\w*)|samplerate|samples?[ _]per[ _]second|abtast(?:rate|frequenz)|"
    r"messrate|data ?rate|scan rate|acquisition rate|frequency|fs|rate)\b[^\d\n]{0,14}?"
    + rf"({_NUMBER})\s*(k?Hz|[kK]?S/s|1/s|samples?/s\w*|)",
    re.IGNORECASE,
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
    """Statements of a header.

    Attributes
    ----------
    lines : list of str
        Lines of the file, those of the header blank.
    names, units : tuple of str
        Names and units of the columns; empty if the header states none.
    rate : float or None
        Readings a second [Hz].
    starts : tuple of float
        Beginning of each segment [s]; empty if there is one.
    maker : str
        Program that wrote the file, for the reader.
    """

    lines: list[str]
    names: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    rate: float | None = None
    starts: tuple[float, ...] = field(default=())
    maker: str = ""


def maker_header(lines: list[str]) -> MakerHeader:
    """Return what the header of a known program states; the lines as they are for any other."""
    first = lines[0].lstrip('"').strip()
    if first.startswith("LabVIEW Measurement"):
        return _labview(lines)
    if any(line.startswith(("Interval=", "ChannelTitle=")) for line in lines[:20]):
        return _labchart(lines)
    if len(lines) > 4 and re.search(rf"{_NUMBER}\s*\S+/sample|samples?/sec", lines[1], re.IGNORECASE):
        return _biopac(lines)
    return MakerHeader(lines=lines)


def stated_rate(above: Sequence[str]) -> float | None:
    """Return the readings a second that the lines above a table state [Hz]; None if they state none, or several."""
    rates = set()
    for line in above:
        plain = re.sub(r'["\t;:=,]+(?=\D|$)|(?<=\D)["\t;:=,]+', " ", line)
        if found := _RATE.search(plain):
            rates.add(_float(found[1]) * _SIZE.get(found[2].lower(), 1.0))
        elif found := _STEP.search(plain):
            said = found["ahead"] or found["unit"]
            unit = known_spelling(said) if said else None
            size = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}.get(unit.unit if unit else "s")
            if size and _float(found["number"]) > 0.0:
                rates.add(1.0 / (_float(found["number"]) * size))
    good = {rate for rate in rates if 1.0 <= rate <= 1e6}
    return good.pop() if len(good) == 1 else None


def _float(text: str) -> float:
    return float(text.replace(",", "."))


def _labview(lines: list[str]) -> MakerHeader:
    """Read a LabVIEW measurement file (.lvm): a header of the file, then one of each segment."""
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
    """Read the header that LabChart writes in front of every block."""
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
    """Read the text header of AcqKnowledge: interval, number of channels, then name and unit of each."""
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
