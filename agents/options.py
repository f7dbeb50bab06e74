"""Command lines from dataclasses: a field is an option, its default the option's, its meaning the help text."""

from __future__ import annotations

import argparse
import dataclasses
from typing import Any, TypeVar

T = TypeVar("T")

_KINDS = {"str": str, "int": int, "float": float}


def option(default: Any, meaning: str, choices: tuple[str, ...] | None = None, *, resumable: bool = False) -> Any:
    """Declare a field that is an option of the command line; a tuple as default accepts several texts.

    Fields with ``resumable`` may be given again when an interrupted run is resumed.
    """
    return dataclasses.field(default=default, metadata={"help": meaning, "choices": choices, "resumable": resumable})


def parse(kind: type[T], about: str | None) -> T:
    """Parse the command line into a frozen dataclass whose fields are :func:`option`."""
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        flag, meaning, choices = "--" + field.name.replace("_", "-"), field.metadata["help"], field.metadata["choices"]
        if isinstance(field.default, bool):
            parser.add_argument(flag, action="store_true", help=meaning)
        elif isinstance(field.default, tuple):
            parser.add_argument(flag, nargs="+", metavar="FILE", default=field.default, help=meaning)
        else:
            of = _KINDS[str(field.type)]
            default = f" (default {field.default})" if field.default != "" else ""
            shown = None if choices else {str: "TEXT", int: "N", float: "X"}[of]
            parser.add_argument(
                flag, type=of, choices=choices, metavar=shown, default=field.default, help=meaning + default
            )
    given = vars(parser.parse_args())
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in given.items()})
