"""A rig's file tells depth and height: a profile covers the whole cut, the section [height] is read in SI."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_up_settings import FREE, USUAL
from scripted_operator import ScriptedOperator

from cutenv.rig.config.mounted_specimen import measured_depth
from cutenv.rig.config.settings import HEIGHT, HeightAxis, RigSettings, SafetyLimits
from cutenv.rig.contradictions import contradictions
from cutenv.rig.errors import RigError
from cutenv.rig.operation.session import SpecimenKey, SpecimensByHand
from cutenv.rig.toml_file import read_rig_file, template, to_toml


def of(*points: tuple[float, float]) -> RigSettings:
    return RigSettings(depth_profile=points)


def test_depth_is_linear_between_points_and_constant_beyond() -> None:
    depth = measured_depth(of((0.001, 0.010), (0.061, 0.016), (0.101, 0.012)))
    place = np.arange(301) * 0.0005
    assert depth.shape == (301,)
    assert depth[2] == pytest.approx(0.010, rel=1e-12)
    assert np.array_equal(depth[:2], [0.010, 0.010])
    assert depth[62] == pytest.approx(0.013, rel=1e-12)  # 31 mm
    assert np.array_equal(depth[place > 0.101], np.full(sum(place > 0.101), 0.012))


@given(depths=st.lists(st.floats(0.001, 0.06), min_size=2, max_size=6))
def test_no_depth_lies_beyond_those_measured(depths: list[float]) -> None:
    along = measured_depth(of(*zip(np.linspace(0.0, 0.15, len(depths)).tolist(), depths, strict=True)))
    assert min(depths) <= along.min() * (1 + 1e-12)
    assert along.max() <= max(depths) * (1 + 1e-12)


def test_a_profile_must_reach_the_target_that_is_cut_to() -> None:
    settings = of((0.0, 0.01), (0.08, 0.01))
    assert measured_depth(settings, 0.08)[-1] == 0.01
    with pytest.raises(ValueError, match="ends at 80 mm, and the blade goes to 90 mm"):
        measured_depth(settings, 0.09)


def test_a_short_travel_needs_a_short_profile() -> None:
    short = RigSettings(limits=SafetyLimits(high=0.03), depth_profile=((0.0, 0.01), (0.03, 0.01)))
    assert measured_depth(short).shape == (301,)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ((), "has 0 points, and needs 2 or more. Measure the specimen"),
        (((0.0, 0.01), (0.0, 0.01), (0.1, 0.01)), "goes from 0 to 0 mm; positions must rise"),
        (((0.0, 0.01), (0.1, 0.0009)), "depth = 0.9 mm is outside 1 to 60 mm"),
        (((0.0, 0.01), (0.1, float("nan"))), "depth = nan mm"),
        (((float("nan"), 0.01), (0.1, 0.01)), "position = nan mm"),
    ],
)
def test_a_bad_profile_is_refused_in_millimetres(points: tuple[tuple[float, float], ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measured_depth(of(*points))


def test_every_specimen_has_the_profile_that_stands_in_the_file_when_it_is_laid() -> None:
    profiles = [of((0.0, 0.01), (0.15, 0.01)), of((0.0, 0.02), (0.15, 0.02)), of((0.0, 0.02), (0.07, 0.02))]
    operator = ScriptedOperator([("without power", True)] * 3)
    supply = SpecimensByHand(lambda: profiles.pop(0), operator, lambda limits: None)
    for episode, depth in enumerate((0.01, 0.02)):
        laid = supply.mount(SpecimenKey(seed=0, episode=episode, target=0.08))
        assert laid is not None
        assert laid[0] == depth
    with pytest.raises(RigError, match=r"depth of the specimen is not known.* ends at 70 mm"):
        supply.mount(SpecimenKey(seed=0, episode=2, target=0.08))


DESCENDS = dataclasses.replace(FREE, height=HEIGHT)


def test_a_file_with_a_height_axis_comes_back(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    odd = dataclasses.replace(
        DESCENDS, height=dataclasses.replace(HEIGHT, direction=-1, lowest=-0.0125, force_axis="y", force_sign=-1)
    )
    file.write_text(to_toml(odd))
    assert read_rig_file(file).height == odd.height
    assert "\nlowest_mm = -12.5\n" in file.read_text()
    assert list(odd.axes) == ["blade", "angle", "height"]


def test_a_file_without_it_reads_as_before_and_the_template_has_it_commented_out(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(to_toml(USUAL))
    assert read_rig_file(file) == USUAL
    assert USUAL.height is None
    assert list(USUAL.axes) == ["blade"]
    lines = template().splitlines()
    assert "# [height]" in lines
    assert "[height]" not in lines


def test_the_commented_section_is_read_when_its_comment_marks_are_taken_off(tmp_path: Path) -> None:
    block = to_toml(USUAL).split("# # The axis that raises", 1)[1].split("\n\n", 1)[0]
    block = re.sub(r"^# (FILL IN: )?", "", re.sub(r"^# ", "", block, flags=re.M), flags=re.M)
    block = "\n".join(line for line in block.splitlines() if re.match(r"\[height\]|\w+ = ", line))
    (tmp_path / "rig.toml").write_text(f"{to_toml(USUAL)}\n{block}\n")
    assert read_rig_file(tmp_path / "rig.toml").height == HeightAxis()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("lowest_mm = -12.0", "must be below highest_mm = -13|highest_mm = -13 mm is outside 0"),
        ("vertical_force_N = 0", "vertical_force_N = 0 N is outside 0.1 to 1000 N"),
        ("fastest_cm_s = true", "fastest_cm_s must be one real number in cm/s, got True"),
        ('force_axis = "up"', "force_axis"),
        ("force_sign = 2", "force_sign"),
        ('homing = "no"', "homing"),
        ("depth_mm = 3", "depth_mm"),
    ],
)
def test_a_wrong_value_is_refused_by_file_section_and_key(tmp_path: Path, line: str, message: str) -> None:
    text, name = to_toml(DESCENDS), line.split(" = ")[0]
    head, section = text.split("[height]", 1)
    changed = re.sub(rf"^{name} = .*$", line, section, count=1, flags=re.M)
    if changed == section:
        changed = f"\n{line}{section}"
    if line.startswith("lowest"):
        changed = re.sub(r"^highest_mm = .*$", "highest_mm = -13.0", changed, count=1, flags=re.M)
    (tmp_path / "rig.toml").write_text(f"{head}[height]{changed}")
    with pytest.raises(ValueError, match=message) as caught:
        read_rig_file(tmp_path / "rig.toml")
    assert "height" in str(caught.value)


def test_the_usual_axis_contradicts_nothing() -> None:
    assert not list(contradictions(DESCENDS))
    assert not list(contradictions(dataclasses.replace(USUAL, height=HEIGHT)))
