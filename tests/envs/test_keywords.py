"""The keywords of the environment: what they do, and what a wrong one is told."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from whole_cut import ENVIRONMENT, FASTEST, INCLINED, UPRIGHT, cut, legs, make

from cutenv.agents.policy import ConstantFeed, NoAction
from cutenv.envs.constants import Knowledge
from cutenv.sim.cutting.drive import Hand, Rig
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.reward import Limits, RewardWeights

TISSUE = dataclasses.replace(measured_liver(), name="softer", intercept_90=30e3, intercept_45=25e3)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("weight_jmp", "weight_jump"),
        ("weight_acuracy", "weight_accuracy"),
        ("accelaration", "acceleration"),
        ("forcenoise", "force_noise"),
        ("specimen_clas", "specimen_class"),
        ("control_Hz", "control_hz"),
        ("target_lenght", "target_length"),
        ("anglemode", "angle_mode"),
        ("deadline", "deadline_s"),
        ("rewards_from", "reward_from"),
    ],
)
def test_a_misspelt_argument_constant_or_weight_is_an_error_that_names_the_nearest(typed, meant):
    with pytest.raises(TypeError, match=rf"{typed!r}.*Did you mean '{meant}'"):
        make(**{typed: 0.1})


def test_a_constant_of_the_tissue_is_unexpected_and_the_message_tells_where_it_belongs():
    with pytest.raises(TypeError, match=r"unexpected keyword argument 'intercept_90'\. It belongs to the tissue"):
        make(intercept_90=30e3)


@pytest.mark.parametrize(
    ("keywords", "meant"),
    [
        ({"specimen_class": "vascullar"}, "vascular"),
        ({"angle_mode": "fixd"}, "fixed"),
        ({"reward_from": "estimated"}, "estimate"),
        ({"drive": "hands"}, "hand"),
    ],
)
def test_a_misspelt_choice_names_the_nearest(keywords, meant):
    with pytest.raises(ValueError, match=rf"^{next(iter(keywords))} must be one of .* Did you mean '{meant}'"):
        make(**keywords)


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"start_before_target": 0.004}, r"start_before_target = 0\.004 m is outside 0\.005 to 0\.13 m"),
        ({"start_before_target": 10}, "start_before_target = 10 m is outside .*10 mm is 0.01"),
        ({"start_before_target": 0.06}, r"must be less than the target length, which can be 0\.06 m"),
        ({"start_before_target": 0.02, "target_length": 0.02}, "must be less than the target length"),
    ],
)
def test_a_start_that_is_not_before_the_target_is_refused(keywords, message):
    with pytest.raises(ValueError, match=message):
        make(**keywords)


def test_the_nearest_start_is_no_success_by_doing_nothing():
    env = make(start_before_target=0.005)
    env.reset(seed=0)
    ended = False
    while not ended:
        _, _, ended, _, info = env.step(np.array([0.0, 1.0], np.float32))
    assert info["end"] == "finished"
    assert not info["is_success"]


def test_a_start_is_checked_against_the_target_length_of_a_reset():
    for env in (make(start_before_target=0.03), gymnasium.make_vec(ENVIRONMENT, num_envs=2, start_before_target=0.03)):
        with pytest.raises(ValueError, match="must be less than the target length"):
            env.reset(seed=0, options={"target_length": 0.03})


def test_a_misspelt_reset_option_names_the_nearest():
    env = make()
    with pytest.raises(ValueError, match="Did you mean 'target_length'"):
        env.reset(options={"target_lenght": 0.08})


@pytest.mark.parametrize(
    ("keywords", "message"),
    [
        ({"target_length": 80}, r"target_length = 80 m is outside 0.015 to 0.13 m\. .*80 mm is 0.08"),
        ({"target_length": math.nan}, r"target_length = nan m is outside .*80 mm is 0.08"),
        ({"control_hz": 0}, r"control_hz = 0 Hz is outside 1 to 1000 Hz\. Give decisions per second"),
        ({"control_hz": 33}, r"control_hz = 33 does not divide 1000\. Take one of 1, 2, 4, 5, 8, 10, 20, .*, 1000\."),
        ({"fixed_angle_deg": 1.57}, r"fixed_angle_deg = 1.57 deg is outside 45 to 90 deg\. \w+"),
        ({"deadline_s": math.inf}, r"deadline_s = inf s is outside 1 to 3600 s"),
        ({"weight_jump": -0.1}, r"jump = -0.1 is outside 0 to 100\. Default 0.03"),
        ({"acceleration": 100.0}, r"acceleration = 100 m/s2 is outside 0.001 to 10 m/s2\. Default 0.1"),
        ({"force_delay": 10}, r"force_delay = 10 s is outside 0 to 0.063 s\. Default 0.01"),
        ({"rotation_rate": 90}, r"rotation_rate = 90 rad/s is outside 0.01 to 20 rad/s\. Default 1.57"),
        ({"force_noise": math.nan}, r"force_noise = nan N is outside 0 to 10 N\. Default 0.02"),
        ({"depth_noise": 0.5}, r"depth_noise = 0.5 m is outside 0 to 0.01 m\. Default 0.0005"),
    ],
)
def test_a_value_out_of_range_is_named_with_unit_range_and_cure(keywords, message):
    with pytest.raises(ValueError, match=message):
        make(**keywords)


@pytest.mark.parametrize(
    "keywords", [{"control_hz": "50"}, {"target_length": "0.08"}, {"weight_jump": None}, {"deadline_s": True}]
)
def test_a_value_that_is_no_number_is_refused_by_name(keywords):
    name = next(iter(keywords)).removeprefix("weight_")
    with pytest.raises(TypeError, match=f"{name} must be one real number"):
        make(**keywords)


def test_a_target_length_given_at_reset_is_checked_alike_and_holds_for_one_cut():
    env = make(target_length=0.07)
    with pytest.raises(ValueError, match=r"80 mm is 0\.08"):
        env.reset(seed=0, options={"target_length": 80})
    lengths = [env.reset(options=options)[1]["truth"]["target_length_m"] for options in ({"target_length": 0.09}, None)]
    assert lengths == [0.09, 0.07]


def test_a_reset_that_was_refused_leaves_the_next_one_alone():
    env, untouched = make(), make()
    for each in (env, untouched):
        each.reset(seed=0)
    for options in ({"episode": -1}, {"target_length": 80}, {"specimen": 5}, {"episode": 1.5}, {"specimen": "{}"}):
        with pytest.raises((ValueError, TypeError)):
            env.reset(options=options)
    np.testing.assert_array_equal(env.reset()[0], untouched.reset()[0])
    assert env.unwrapped.specimen == untouched.unwrapped.specimen


def test_lengths_are_drawn_from_60_to_100_mm():
    env = make(specimen_class="uniform")
    env.reset(seed=0)
    lengths = [env.reset()[1]["truth"]["target_length_m"] for _ in range(300)]
    assert min(lengths) >= 0.06
    assert max(lengths) <= 0.10
    assert np.mean(lengths) == pytest.approx(0.08, abs=0.003)
    assert np.ptp(lengths) > 0.038


@pytest.mark.parametrize("specimen_class", CLASSES)
def test_the_class_of_specimens_is_the_one_asked_for(specimen_class):
    env = make(specimen_class=specimen_class)
    env.reset(seed=0)
    met = [env.reset()[1]["truth"]["specimen_class"] for _ in range(60)]
    if specimen_class == "mixed":
        assert set(met) == {"liver", "vascular"}
        assert 15 <= met.count("liver") <= 45
    else:
        assert set(met) == {specimen_class}


def test_a_tissue_file_is_where_specimens_are_drawn_from(tmp_path):
    path = tmp_path / "tissue.json"
    path.write_text(TISSUE.to_json())
    for given in (str(path), path):
        env = make(tissue=given)
        env.reset(seed=0)
        assert env.unwrapped.specimen.tissue == TISSUE
    first = env.unwrapped.specimen
    env.reset()
    assert env.unwrapped.specimen != first


def test_a_specimen_file_is_cut_in_every_episode(tmp_path):
    path = tmp_path / "specimen.json"
    specimen = Specimen.draw(np.random.default_rng(0), tissue=TISSUE, specimen_class="vascular")
    path.write_text(specimen.to_json())
    env = make(tissue=str(path))
    for _ in range(3):
        env.reset()
        assert env.unwrapped.specimen == specimen


@pytest.mark.parametrize("text", ["not json", "[]", "5", '{"schema": "cutenv-tisue/1"}', "{}"])
def test_a_file_that_is_no_tissue_says_what_it_should_be(tmp_path, text):
    path = tmp_path / "file.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"neither a tissue \(cutenv-tissue/2\) nor a specimen \(cutenv-specimen/2\)"):
        make(tissue=str(path))


@pytest.mark.parametrize("broken", [{"intercept_90": None}, {"eta90": 28}, {"etta90": 0.28}])
def test_a_tissue_file_with_a_wrong_field_names_it(tmp_path, broken):
    path = tmp_path / "tissue.json"
    path.write_text(json.dumps(json.loads(TISSUE.to_json()) | broken))
    with pytest.raises((ValueError, TypeError), match=next(iter(broken))):
        make(tissue=str(path))


def test_a_missing_tissue_file_is_named():
    with pytest.raises(FileNotFoundError, match=r"no_such\.json.*give the path"):
        make(tissue=str(Path("no_such.json")))


@pytest.mark.parametrize("degrees", [45.0, 60.0, 90.0])
def test_a_fixed_angle_ignores_the_second_number_of_the_action(degrees):
    env, twin = (make(angle_mode="fixed", fixed_angle_deg=degrees) for _ in range(2))
    np.testing.assert_array_equal(env.reset(seed=0)[0], twin.reset(seed=0)[0])
    for second in np.linspace(-2.0, 2.0, 30):
        one, other = env.step(np.float32([0.8, second])), twin.step(np.float32([0.8, -second]))
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:] == other[1:]
        assert np.degrees(env.unwrapped.cutting.readings["angle"]) == pytest.approx(degrees)


@pytest.mark.parametrize(("name", "twice"), [("jump", 0.06), ("progress", 1.2), ("accuracy", 0.4), ("success", 0.4)])
def test_a_weight_given_by_keyword_changes_its_term_alone(name, twice):
    plain, heavy = (
        cut(make(**keywords), ConstantFeed(speed=0.01), 3).totals for keywords in ({}, {f"weight_{name}": twice})
    )
    assert heavy == pytest.approx(plain | {name: 2.0 * plain[name]})
    assert abs(plain[name]) > 0.01


def constants() -> list[tuple[str, str, float]]:
    """Every constant by keyword, with another value than its default."""
    groups = [("rig", group) for group in (Rig, SensorParameters, LawParameters, Limits, Knowledge)] + [("hand", Hand)]
    other = {
        "dead_time": 0.01,
        "backlash": 1e-3,
        "debt_length": 1e-5,
        "force_drift": 0.1,
        "friction_per_depth_speed": 100.0,
        "relaxing_share": 0.3,
    }
    other |= {"force_limit_per_depth": 500.0}
    return [
        (drive, field.name, other.get(field.name, 0.5 * field.default))
        for drive, group in groups
        for field in dataclasses.fields(group)
    ] + [
        ("rig", "weight_" + field.name, 0.5 * field.default)
        for field in dataclasses.fields(RewardWeights)
        if field.name not in ("accuracy", "success")  # this cut gains neither; see the test above
    ]


TOUGH = Specimen.homogeneous(modulus=30e3, fracture_resistance=500.0, depth=0.015)
EVENTFUL = legs((4.0, FASTEST, UPRIGHT), (0.6, -FASTEST, INCLINED), (2.4, FASTEST, math.radians(70)))


@pytest.mark.parametrize(("drive", "name", "value"), constants())
def test_every_constant_of_the_parameter_table_is_taken_and_matters(drive, name, value):
    keywords = {"drive": drive, "deadline_s": 6.0} | ({"relaxing_share": 0.3} if name == "creep_time" else {})
    plain, changed = (
        cut(make(**keywords, **more), EVENTFUL, target_length=0.13, specimen=TOUGH) for more in ({}, {name: value})
    )
    assert changed.total != plain.total or not np.array_equal(changed.observations, plain.observations)


@pytest.mark.parametrize("deadline", [1.0, 12.5, 40.0])
def test_the_deadline_ends_a_cut_and_is_seen_coming(deadline):
    record = cut(make(deadline_s=deadline), NoAction())
    assert record.end == "deadline"
    assert len(record.readings) == round(1000 * deadline)
    assert record.observations[0][9] == pytest.approx((deadline - 0.02) / 30.0, abs=1e-6)
    assert record.observations[-1][9] == pytest.approx(0.0, abs=1e-6)
