"""The code that a stop relies on is as small as the safety page says, and its flags are known."""

from __future__ import annotations

import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "rig" / "safety.md"
TRUSTED = (
    "spine.py", "spine_process.py",
    "safety/monitors.py", "safety/oversight.py", "safety/stop_causes.py", "safety/supervisor.py",
    "devices/protocols.py", "devices/driver_bases.py", "devices/loop.py", "devices/reading_stream.py",
    "devices/canopen/axis.py", "devices/canopen/configuration.py", "devices/canopen/network.py",
    "devices/canopen/objects.py", "devices/netft_sensor.py",
)  # fmt: skip
"""Files from sensor and bus to stop, of drives on a CAN bus and a Net F/T."""
FLAGS = {
    "AxisDriver._may_move": "switched on by us, and neither stopped, lost nor in error since; of one axis",
    "CanopenAxis._for_good": "the drive has another quick-stop option than its set-up",
    "CanopenAxis._running": "the drive has sent samples since it was opened: a restart can be told from a start",
    "_Served._leaving": "the loop has begun to close the rig, once",
    "_Served._over": "the program has ended, or has closed the rig",
    "_Turn.stopped": "an action is no longer repeated",
}
"""Attributes that are set to True or False, besides phase and withheld heartbeats, which the latch holds."""
LOCKS = ("threading.Lock", "threading.RLock", "threading.Condition", "threading.Event")


def trees() -> Iterator[ast.Module]:
    for name in TRUSTED:
        yield ast.parse((ROOT / "cutenv" / "rig" / name).read_text(encoding="utf-8"))


def calls() -> Counter[str]:
    return Counter(ast.unparse(node.func) for tree in trees() for node in ast.walk(tree) if isinstance(node, ast.Call))


def assigned(node: ast.AST) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Each target of an assignment with its value, also of those that assign several at once."""
    if isinstance(node, ast.AnnAssign) and node.value is not None:
        yield node.target, node.value
    for target in getattr(node, "targets", ()) if isinstance(node, ast.Assign) else ():
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            yield from zip(target.elts, node.value.elts, strict=True)
        else:
            yield target, node.value


def flags() -> set[str]:
    return {
        f"{kind.name}.{target.attr}"
        for tree in trees()
        for kind in ast.walk(tree)
        if isinstance(kind, ast.ClassDef)
        for node in ast.walk(kind)
        for target, value in assigned(node)
        if isinstance(target, ast.Attribute) and ast.unparse(target.value) == "self"
        if isinstance(value, ast.Constant) and isinstance(value.value, bool)
    }


def test_a_flag_that_the_latch_does_not_hold_is_one_that_is_known() -> None:
    """A new flag that says whether anything may move belongs into the table of phases and events."""
    assert {flag.replace("CanopenAxis._may_move", "AxisDriver._may_move") for flag in flags()} == set(FLAGS)


def test_bus_and_sensor_are_read_by_the_loop() -> None:
    """Two threads judge a rig of a CAN bus and a Net F/T: the loop, and the one that takes commands."""
    began = {
        name
        for name in TRUSTED
        for node in ast.walk(ast.parse((ROOT / "cutenv" / "rig" / name).read_text(encoding="utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "threading.Thread"
    }
    assert began == {"devices/loop.py", "safety/oversight.py"}


def test_the_page_says_how_much_has_to_be_believed() -> None:
    lines = sum(len((ROOT / "cutenv" / "rig" / name).read_text(encoding="utf-8").splitlines()) for name in TRUSTED)
    made = calls()
    threads, locks = made["threading.Thread"] + made["Attempt"], sum(made[kind] for kind in LOCKS)
    said = re.search(
        r"(\d+) files of ([\d,]+) lines,\s+(\d+) places at which a thread\s+begins,\s+(\d+) locks, conditions and "
        r"events,\s+(\d+) flags", PAGE.read_text(encoding="utf-8"),
    )  # fmt: skip
    assert said is not None
    counted = [len(TRUSTED), round(lines, -2), threads, locks, len(FLAGS)]
    assert [int(number.replace(",", "")) for number in said.groups()] == counted
