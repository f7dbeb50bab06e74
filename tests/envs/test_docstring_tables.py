"""The class docstring is the specification, and one entry in one table is all that a term or a component takes."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import math
import re

import numpy as np
import pytest
from whole_cut import FASTEST, INCLINED, UPRIGHT, cut, legs, make

from cutenv.agents.policy import ConstantFeed, NoAction
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.cutting.drive import DRIVES, Rig
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.observation import CLIP, COMPONENTS
from cutenv.task.reward import Limits

DOC = inspect.getdoc(GentleCutEnv) or ""


def section(doc: str, title: str) -> str:
    """The text below an underlined title, up to the next one."""
    found = re.search(rf"^{title}\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", doc, re.M | re.S)
    assert found, f"the docstring has no section {title!r}"
    return found[1]


def rows(doc: str, title: str) -> list[dict[str, str]]:
    """The simple table of a section, row by row: {heading: cell}."""
    lines = section(doc, title).splitlines()
    bars = [number for number, line in enumerate(lines) if re.fullmatch(r"=+( =+)+", line)]
    columns = [match.span() for match in re.finditer(r"=+", lines[bars[0]])]
    columns[-1] = (columns[-1][0], None)
    head, *body = [
        [line[start:stop].strip() for start, stop in columns]
        for line in (lines[bars[0] + 1], *lines[bars[1] + 1 : bars[2]])
    ]
    return [dict(zip(head, cells, strict=True)) for cells in body]


def check_actions(doc: str) -> None:
    for number, (row, reach) in enumerate(
        zip(rows(doc, "Action"), [(-100 * FASTEST, 100 * FASTEST, "cm/s"), (45.0, 90.0, "deg")], strict=True)
    ):
        low, high = re.findall(r"-?[\d.]+", row["-1 to 1 is"])[:2]
        assert (int(row["Num"]), float(low), float(high), row["Unit"]) == (number, *reach)


def check_arguments(doc: str) -> None:
    signature = inspect.signature(GentleCutEnv.__init__)
    defaults = {
        name: given.default
        for name, given in signature.parameters.items()
        if name != "self" and given.kind is not inspect.Parameter.VAR_KEYWORD
    }
    table = {row["Keyword"]: row for row in rows(doc, "Arguments")}
    assert {name: ast.literal_eval(row["Default"]) for name, row in table.items()} == defaults
    for name, choices in {
        "specimen_class": CLASSES,
        "angle_mode": ("free", "fixed"),
        "reward_from": ("truth", "estimate"),
        "drive": DRIVES,
        "render_mode": GentleCutEnv.metadata["render_modes"],
    }.items():
        assert set(re.findall(r'"([a-z_]+)"', table[name]["Meaning"])) == set(choices)


CHECKS = {
    check_actions: ("-2.54 to 2.54", "-25.4 to 25.4"),
    check_arguments: ("50      decisions", "20      decisions"),
}


@pytest.mark.parametrize("check", CHECKS)
def test_a_table_of_the_docstring_is_what_the_code_does(check):
    check(DOC)
    printed, wrong = CHECKS[check]
    assert DOC.count(printed) == 1
    with pytest.raises(AssertionError):
        check(DOC.replace(printed, wrong))


def test_the_spaces_are_those_of_the_docstring():
    env = make()
    assert str(env.action_space).replace(".0", "") == "Box(-1, 1, (2,), float32)"
    assert "``Box(-1, 1, (2,), float32)``" in section(DOC, "Action")
    size = len(COMPONENTS)
    assert f"``Box(-{CLIP:g}, {CLIP:g}, ({size},), float32)``" in section(DOC, "Observation")
    assert env.observation_space.shape == (size,)
    assert env.observation_space.dtype == np.float32
    assert (env.observation_space.high == CLIP).all()
    assert (env.observation_space.low == -CLIP).all()


@pytest.mark.parametrize("sign", [1, -1])
def test_the_ends_of_the_action_are_the_documented_speed_and_angle(sign):
    env = make(specimen_class="uniform", force_limit_per_depth=1e5, deadline_s=3.0)
    angle = UPRIGHT if sign > 0 else INCLINED
    policy = legs((1.5, FASTEST, angle), (1.0, sign * FASTEST, angle))
    readings = cut(env, policy).readings[2400]
    assert readings["speed"] == pytest.approx(sign * FASTEST, rel=1e-3)
    assert readings["angle"] == pytest.approx(angle, abs=1e-6)


def test_each_documented_constant_and_reset_option_exists():
    arguments = section(DOC, "Arguments")
    constants = {field.name for group in (Rig, SensorParameters, Limits) for field in dataclasses.fields(group)}
    besides, options = arguments.split("Reset options:")
    named = set(re.findall(r"``([a-z_]+)``", besides))
    assert named >= {"acceleration", "motor_lag", "rotation_rate", "force_noise", "force_resolution", "force_delay"}
    assert named <= constants
    env = make()
    given = {"specimen": env.unwrapped, "target_length": 0.07, "episode": 3}
    env.reset(seed=0)
    given["specimen"] = env.unwrapped.specimen
    assert set(re.findall(r"``([a-z]\w+)``", options)) == set(given)
    env.reset(options=given)


def test_info_holds_what_the_docstring_lists_and_nothing_else():
    text = section(DOC, "Info")
    env = make()
    _, at_reset = env.reset(seed=0)
    at_end = cut(env, ConstantFeed(speed=FASTEST)).infos[-1]
    listed = re.findall(r"``(\w+)``", text)
    assert listed == list(at_end)
    assert set(at_end) - set(at_reset) == {"end", "is_success"}
    for energy in at_end["energy"]:
        assert energy in text


def test_doing_nothing_returns_what_the_docstring_says():
    said = float(re.search(r"Doing nothing returns (-\d+\.\d+)", DOC)[1])
    for specimen_class in CLASSES:
        assert cut(make(specimen_class=specimen_class), NoAction()).total == pytest.approx(said, abs=1e-9)


def test_the_numbers_of_the_ends_stand_in_the_docstring():
    from cutenv.task import assessment, reward

    text = section(DOC, "Ends")
    for number in (
        f"within {1e3 * assessment.NEAR_TARGET:g} mm of the target; then",
        f"at rest for {reward.TIME_AT_REST:g} s or drawn back {1e3 * reward.WITHDRAWN:g} mm",
        f"at rest a speed below {1e3 * assessment.SPEED_AT_REST:g} mm/s",
        f"friction + {assessment.FORCE_UNLOADED:g} N",
        f"{1e3 * reward.OVERSHOOT_ALLOWED:g} mm beyond",
        f"within {1e3 * reward.TIP_TOLERANCE:g} mm",
        f"within {math.degrees(assessment.ANGLE_TOLERANCE):g} degrees",
    ):
        assert number in text
