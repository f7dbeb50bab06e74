"""Channels that a program writes below one another, each with its own header, as rows of a table: Igor and Spike2."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

_WAVES = re.compile(r"WAVES\S*\s+(?P<names>.+)", re.IGNORECASE)
_SCALE = re.compile(
    r"SetScale(?P<form>/[PI])?\s+(?P<axis>[xyzd])\s+(?P<numbers>[^\"]*)\"(?P<unit>[^\"]*)\"\s*,\s*(?P<waves>.+)"
)


@dataclass(kw_only=True)
class ChannelBlock:
    """Channels whose values stand in the same lines.

    Attributes
    ----------
    names, units : list of str
        Their names, and their units, "" where the file states none.
    rows : list of int
        Places of the lines that hold the values.
    step : float or None
        Time between two values [s].
    """

    names: list[str]
    units: list[str]
    rows: list[int] = field(default_factory=list)
    step: float | None = None


def igor_blocks(lines: list[str]) -> list[ChannelBlock]:
    """Return the waves of an Igor text file (.itx), with the scale that ``SetScale`` gives them."""
    blocks: list[ChannelBlock] = []
    inside = False
    for i, line in enumerate(lines):
        text = line.strip()
        if (found := _WAVES.fullmatch(text)) is not None:
            names = [name.strip(" '\"") for name in re.split(r"[\t,]\s*|\s+(?=')", found["names"]) if name.strip()]
            blocks.append(ChannelBlock(names=names, units=[""] * len(names)))
        elif text.upper() in ("BEGIN", "END"):
            inside = text.upper() == "BEGIN"
        elif inside and blocks and text:
            blocks[-1].rows.append(i)
        elif text.startswith("X "):
            for command in text[2:].split(";"):
                _scale(command.strip(), blocks)
    return blocks


def _scale(command: str, blocks: list[ChannelBlock]) -> None:
    """Take step and unit of the waves that a command of Igor names."""
    found = _SCALE.fullmatch(command)
    if found is None:
        return
    named = {name.strip(" '\"") for name in found["waves"].split(",")}
    numbers = [float(text) for text in found["numbers"].split(",") if text.strip()]
    for block in blocks:
        for k, name in enumerate(block.names):
            if name not in named:
                continue
            if found["axis"] == "x" and found["unit"] == "s" and len(numbers) > 1:
                steps = max(1, len(block.rows) - 1)
                block.step = (numbers[1] - numbers[0]) / steps if found["form"] == "/I" else numbers[1]
            elif found["axis"] in ("y", "d"):
                block.units[k] = found["unit"]


def spike2_blocks(lines: list[str]) -> list[ChannelBlock]:
    """Return the waveforms of Spike2's text output: channel, kind, name, unit, and a line of begin and step."""
    blocks: list[ChannelBlock] = []
    i = 0
    while i < len(lines):
        if not lines[i].startswith('"CHANNEL"'):
            i += 1
            continue
        head = []
        while i < len(lines) and not lines[i].startswith('"START"'):
            head.append(lines[i].strip().strip('"'))
            i += 1
        if i == len(lines):
            break
        start = lines[i].split("\t")
        told = [text for text in head if text]
        i += 1
        rows = []
        while i < len(lines) and not lines[i].startswith('"'):
            rows += [i] if lines[i].strip() else []
            i += 1
        if len(told) >= 4 and told[1].lower().startswith("waveform") and len(start) > 2:
            blocks.append(ChannelBlock(names=[told[2]], units=[told[3]], rows=rows, step=float(start[2])))
    return blocks


def joined_rows(lines: list[str], blocks: list[ChannelBlock]) -> list[str] | None:
    """Return the lines with the values of all channels in those of the first block, the others blank.

    None if their numbers of values or their steps differ.
    """
    if not blocks or len({(len(block.rows), block.step) for block in blocks}) > 1 or not blocks[0].rows:
        return None
    kept = [""] * len(lines)
    for places in zip(*(block.rows for block in blocks), strict=True):
        kept[places[0]] = "\t".join(re.sub(r"[ \t]+", "\t", lines[place].strip()) for place in places)
    return kept
