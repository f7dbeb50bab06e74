"""Version of the record files, and what stands in them as JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

SCHEMA = "cutenv-record/1"
"""Stands in every file that :func:`cutenv.recording.save` writes: name and version of the format."""

_NAME, _VERSION = SCHEMA.split("/")


def check_schema(text: str) -> None:
    """Refuse a format that this version of cutenv does not read.

    Raises
    ------
    ValueError
        If `text` is another format, or a newer version of this one.
    """
    found = re.fullmatch(rf"{_NAME}/([0-9]{{1,9}})", text)
    if not found:
        raise ValueError(f"its schema is {shown(text)}, not {SCHEMA!r}. Save the record again with cutenv.")
    if int(found[1]) > int(_VERSION):
        raise ValueError(
            f"its schema is {text!r}, newer than this cutenv, which reads up to {SCHEMA!r}: pip install -U cutenv"
        )
    if int(found[1]) < 1:
        raise ValueError(f"its schema is {text!r}, which never was. Save the record again with cutenv.")


def to_json(value: object) -> str:
    """JSON text in one line of ASCII, which no program on the way mistakes for another encoding."""
    return json.dumps(value, allow_nan=False)


def from_json(what: str, text: str | bytes) -> Any:
    """Read JSON; `what` names it in the message.

    Raises
    ------
    ValueError
        If it is not JSON in UTF-8, or holds NaN or infinity.
    """
    try:
        plain = text.encode() if isinstance(text, str) else text  # what HDF5 could not decode does not pass here
        return json.loads(plain.decode(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{what} is not JSON ({error}): {shown(text)}. Mend it or save the record again.") from None


def mapping_from_json(what: str, text: str | bytes) -> Mapping[str, Any]:
    """Read a JSON object; raises as :func:`from_json`, and for anything else."""
    return as_mapping(what, from_json(what, text))


def as_mapping(what: str, value: object) -> Mapping[str, Any]:
    """Return what was read from JSON if it is an object, or raise ValueError."""
    if not isinstance(value, dict):
        raise ValueError(f'{what} is {shown(value)}. Write names and values: {{"rig": "bench 2"}}.')
    return value


def as_names(what: str, value: object) -> tuple[str, ...]:
    """Return what was read from JSON if it is a list of names, or raise ValueError."""
    if not (isinstance(value, list) and all(isinstance(name, str) for name in value)):
        raise ValueError(f"{what} is {shown(value)}. Save the record again.")
    return tuple(value)


def shown(value: object) -> str:
    """What stands in a file, as far as a message has room for it."""
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number")
