"""Version of the record files, and their JSON content."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

SCHEMA = "cutenv-record/1"
"""Name and version of the format, in every file that :func:`cutenv.recording.save` writes."""

_NAME, _VERSION = SCHEMA.split("/")


def check_schema(text: str) -> None:
    """Raise an error for a format that this version of cutenv cannot read.

    Raises
    ------
    ValueError
        If `text` is another format, or a newer version of this one.
    """
    found = re.fullmatch(rf"{_NAME}/([0-9]{{1,9}})", text)
    if not found:
        raise ValueError(f"its schema is {shortened(text)}, not {SCHEMA!r}. Save the record again with cutenv.")
    if int(found[1]) > int(_VERSION):
        raise ValueError(
            f"its schema is {text!r}, newer than this cutenv, which reads up to {SCHEMA!r}: pip install -U cutenv"
        )
    if int(found[1]) < 1:
        raise ValueError(f"its schema is {text!r}, which never was. Save the record again with cutenv.")


def to_json(value: object) -> str:
    """Return JSON text in one line of ASCII, which no program mistakes for another encoding."""
    return json.dumps(value, allow_nan=False)


def from_json(what: str, text: str | bytes) -> Any:
    """Parse JSON; `what` names it in the message.

    Raises
    ------
    ValueError
        If it is not JSON in UTF-8, or holds NaN or infinity.
    """
    try:
        plain = text.encode() if isinstance(text, str) else text  # text that HDF5 could not decode fails here
        return json.loads(plain.decode(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise ValueError(
            f"{what} is not JSON ({error}): {shortened(text)}. Mend it or save the record again."
        ) from None


def mapping_from_json(what: str, text: str | bytes) -> Mapping[str, Any]:
    """Parse a JSON object; raises as :func:`from_json`, and for any other value."""
    return as_mapping(what, from_json(what, text))


def as_mapping(what: str, value: object) -> Mapping[str, Any]:
    """Return a value from JSON if it is an object; raise ValueError otherwise."""
    if not isinstance(value, dict):
        raise ValueError(f'{what} is {shortened(value)}. Write names and values: {{"rig": "bench 2"}}.')
    return value


def as_names(what: str, value: object) -> tuple[str, ...]:
    """Return a value from JSON if it is a list of names; raise ValueError otherwise."""
    if not (isinstance(value, list) and all(isinstance(name, str) for name in value)):
        raise ValueError(f"{what} is {shortened(value)}. Save the record again.")
    return tuple(value)


def shortened(value: object) -> str:
    """Return a value for a message, shortened."""
    text = ascii(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number")
