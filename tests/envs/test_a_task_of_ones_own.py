"""A task that is declared in a file of its own has everything that its declaration and its entry say."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from steady_cut import ENTRY, LIMIT, SURGE, SteadyCutEnv, SteadyCutVectorEnv

import cutenv
from cutenv.commands import cli
from cutenv.commands.options import add_task, command_parser
from cutenv.display.report.page import term_meanings
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.people.play.haptics import Stylus
from cutenv.task.declare import Task
from cutenv.task.registry import TASKS

FEED = np.array([0.5, 1.0], np.float32)


def cut(env, action=FEED, seed=3):
    """Observations, rewards and infos of a cut under one action."""
    observation, _ = env.reset(seed=seed)
    found, ended = [(observation, 0.0, {})], False
    while not ended:
        observation, reward, ended, _, info = env.step(action)
        found.append((observation, reward, info))
    return found


def test_its_cost_is_charged_as_it_grows_and_its_component_shows_it():
    own, plain = cut(SteadyCutEnv(specimen_class="liver")), cut(GentleCutEnv(specimen_class="liver"))
    largest = 0.0
    for (observation, reward, info), (other, gentle, _) in zip(own[1:-1], plain[1:-1], strict=False):
        np.testing.assert_array_equal(observation[:-1], other)
        grown = 0.01 * float(observation[-1]) - largest
        assert info["reward_terms"]["surge"] == pytest.approx(-0.3 * grown / 0.01, abs=1e-6)
        assert reward == pytest.approx(gentle + info["reward_terms"]["surge"], abs=1e-12)
        largest += grown
        assert info["steady"]["surge_mm"] == pytest.approx(1e3 * largest, abs=1e-3)
        assert info["truth"]["ahead_m"] == info["truth"]["target_length_m"] - info["truth"]["tip_m"]
    assert largest > 0.001
    assert "``surge_mm``" in SteadyCutEnv.__doc__


def test_its_end_and_its_weight_hold():
    totals = [
        sum(info["reward_terms"]["surge"] for *_, info in cut(SteadyCutEnv(weight_surge=weight))[1:])
        for weight in (0.5, 2.0)
    ]
    assert totals[1] == pytest.approx(4.0 * totals[0])
    assert totals[0] < 0.0
    ends = set()
    for seed in range(12):
        last = cut(SteadyCutEnv(specimen_class="vascular"), np.array([1.0, 1.0], np.float32), seed)[-1]
        ends.add(last[2]["end"])
        if last[2]["end"] == "surge":
            assert 0.01 * last[0][-1] > LIMIT
    assert "surge" in ends
    with pytest.raises(TypeError, match="weight_surge"):
        SteadyCutEnv(weight_surg=1.0)


def test_a_batch_of_it_equals_single_ones():
    env = SteadyCutVectorEnv(2, specimen_class="vascular")
    observations, _ = env.reset(seed=[3, 4])
    singles = [SteadyCutEnv(specimen_class="vascular") for _ in range(2)]
    for single, seed, observation in zip(singles, (3, 4), observations, strict=True):
        np.testing.assert_array_equal(single.reset(seed=seed)[0], observation)
    for _ in range(60):
        observations, rewards, ended, _, infos = env.step(np.tile(FEED, (2, 1)))
        assert not ended.any()
        for single, observation, reward in zip(singles, observations, rewards, strict=True):
            own, own_reward, _, _, info = single.step(FEED)
            np.testing.assert_array_equal(own, observation)
            assert own_reward == reward
            assert info["steady"]["surge_mm"] in infos["steady"]["surge_mm"]


def test_costs_without_a_group_of_the_info_are_refused():
    with pytest.raises(ValueError, match="shown_as"):
        Task(place="own:STEADY", environment="own/SteadyCut-v0", costs=SURGE)


def test_it_is_assessed_by_what_a_rig_sees_as_well():
    found = cut(SteadyCutEnv(specimen_class="uniform", reward_from="estimate"))
    assert found[-1][0][-1] > 0.0
    assert "surge" in found[-1][2]["reward_terms"]


@pytest.fixture
def registered():
    cutenv.register(ENTRY)
    yield
    del TASKS[ENTRY.name], gymnasium.registry[ENTRY.id]


def test_its_docstring_has_what_it_declares():
    doc = SteadyCutEnv.__doc__
    assert "12  largest largest growth of the tip in one decision m    0.01  0" in doc
    assert "surge 0.3    largest growth of the tip in one decision / 10 mm" in doc
    assert "surge the tip has grown by more than 6 mm" in doc
    assert "``weight_surge``" in doc


@pytest.mark.usefixtures("registered")
def test_once_it_is_registered_gymnasium_makes_it_and_reports_know_its_cost():
    assert isinstance(gymnasium.make(ENTRY.id).unwrapped, SteadyCutEnv)
    assert isinstance(gymnasium.make_vec(ENTRY.id, num_envs=2), SteadyCutVectorEnv)
    assert term_meanings()["surge"] == "surge of the tip"


@pytest.mark.usefixtures("registered")
def test_a_person_can_cut_it_and_commands_offer_it():
    cut = TASKS["steady"].played(specimen_class="uniform")
    cut.tick(Stylus(0.0, float(np.pi / 2)))
    assert len(cut.readings) == 1
    parser = command_parser("play", "")
    add_task(parser, "played")
    assert parser.parse_args(["--task", "steady"]).task == "steady"
    assert "steady (without a surge)" in parser.format_help()


@pytest.mark.usefixtures("registered")
def test_an_agent_learns_it_and_is_compared_with_its_script(tmp_path, monkeypatch, capsys):
    pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
    monkeypatch.chdir(tmp_path)
    small = ["--environments", "4", "--rollout", "32", "--batch-size", "64", "--timesteps", "128"]
    few = ["--demonstrations", "64", "--validations", "1", "--validation-specimens", "2", "--specimens", "2"]
    assert cli.main(["train", "--task", "steady", "--name", "small", *small, *few]) == 0
    page = (tmp_path / "runs" / "small" / "report.html").read_text(encoding="utf-8")
    assert "Learning to cut without a surge" in page
    assert "surge of the tip" in page
    assert cli.main(["evaluate", "--list"]) == 0
    assert "task steady:\n  steady feed\n" in capsys.readouterr().out
    assert cli.main(["evaluate", "steady feed", "runs/small", "--specimens", "2"]) == 0
    printed = capsys.readouterr().out
    assert "runs/small" in printed
    assert "steady feed minus each other" in printed
