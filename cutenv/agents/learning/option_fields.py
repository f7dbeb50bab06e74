"""Dataclasses as command lines.

A field is an option, its default the option's default, its meaning the help.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

T = TypeVar("T")

_KINDS = {"str": str, "int": int, "float": float}


def option(
    default: Any,
    meaning: str,
    allowed: Collection[str] | tuple[float, float] | None = None,
    *,
    metavar: str | None = None,
    resumable: bool = False,
) -> Any:
    """Declare a dataclass field as a command-line option.

    A tuple as its default makes an option that takes several texts.  ``allowed`` is every text that is, or the smallest
    and the largest number, which :func:`check_ranges` checks; ``metavar`` the placeholder in the help, by default every
    such text, or TEXT, N, X or FILE; ``resumable`` whether an interrupted run may be resumed with another value.
    """
    metadata = {"help": meaning, "allowed": allowed, "metavar": metavar, "resumable": resumable}
    return dataclasses.field(default=default, metadata=metadata)


def flag_of(name: str) -> str:
    """Return a field's name as written on the command line."""
    return "--" + name.replace("_", "-")


def declared(kind: type[Any], name: str) -> Mapping[str, Any]:
    """Return a field's :func:`option` declaration, inherited if need be."""
    fields = (vars(each).get("__dataclass_fields__", {}) for each in kind.__mro__)
    found: Mapping[str, Any] = next(own[name].metadata for own in fields if name in own and own[name].metadata)
    return found


def check_ranges(options: Any, refused: Callable[[str], BaseException]) -> None:
    """Raise ``refused(message)`` if a number is out of range.

    Call it in ``__post_init__``.
    """
    for field in dataclasses.fields(options):
        value, allowed = getattr(options, field.name), declared(type(options), field.name)["allowed"]
        if allowed is not None and not isinstance(value, str) and not allowed[0] <= value <= allowed[1]:  # or is NaN
            raise refused(f"{flag_of(field.name)} {value} is outside {allowed[0]} to {allowed[1]}")


def add_options(parser: argparse.ArgumentParser, kind: type[Any]) -> None:
    """Add a dataclass's fields to a parser, without defaults."""
    for field in dataclasses.fields(kind):
        about = declared(kind, field.name)
        flag, meaning, metavar = flag_of(field.name), about["help"], about["metavar"]
        if isinstance(field.default, bool):
            parser.add_argument(flag, action="store_true", default=argparse.SUPPRESS, help=meaning)
        elif isinstance(field.default, tuple):
            parser.add_argument(flag, nargs="+", metavar=metavar or "FILE", default=argparse.SUPPRESS, help=meaning)
        else:
            convert = _KINDS[str(field.type)]
            choices = about["allowed"] if convert is str else None
            default = f" (default {field.default})" if field.default != "" else ""
            shown = metavar or (None if choices else {str: "TEXT", int: "N", float: "X"}[convert])
            parser.add_argument(
                flag, type=convert, choices=choices, metavar=shown, default=argparse.SUPPRESS, help=meaning + default
            )


def from_options(kind: type[T], given: argparse.Namespace) -> T:
    """Make a dataclass from a parser's result of its options."""
    return kind(**{name: tuple(value) if isinstance(value, list) else value for name, value in vars(given).items()})


def parse(kind: type[T], about: str | None, argv: Sequence[str] | None = None) -> T:
    """Read a dataclass of options from a command line.

    Raises SystemExit after the help, and for an option that ``argparse`` refuses.
    """
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False
    )
    add_options(parser, kind)
    return from_options(kind, parser.parse_args(argv))


def drawn_as(arguments: Mapping[str, Any]) -> dict[str, str]:
    """Return the environment arguments that determine specimens' tissue and class."""
    tissue = {"tissue": arguments["tissue"]} if arguments.get("tissue") else {}
    return {"specimen_class": arguments["specimen_class"], **tissue}


def class_in_words(arguments: Mapping[str, Any]) -> str:
    """Describe the drawn specimens: "class mixed", "class liver of my_tissue.json"."""
    of = f" of {arguments['tissue']}" if arguments.get("tissue") else ""
    return f"class {arguments['specimen_class']}{of}"
