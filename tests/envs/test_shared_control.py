"""A person takes over from an agent: the info says so, records hold the action carried out, the agent leads again."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium
import numpy as np
import pyarrow.parquet as parquet
import pytest

from cutenv.agents.learning.demonstration import Demonstration, simulated
from cutenv.agents.learning.lerobot import write_lerobot
from cutenv.agents.policy import BASELINES, ConstantFeed
from cutenv.envs import RigCutEnv, SharedControl
from cutenv.people.play.devices import HandMotion, ScriptedDevice
from cutenv.people.play.haptics import Stylus
from cutenv.people.play.shared_cut import InterveningHand
from cutenv.task.observation import to_action

PERSONS = to_action(0.004, 1.2)


def shared(begin: int, end: int, action: np.ndarray = PERSONS) -> SharedControl:
    """The simulator with a person who intervenes from one decision to another."""
    count = iter(range(10**6))
    return SharedControl(
        gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", control_hz=10),
        lambda: action if begin <= next(count) < end else None,
    )


@pytest.fixture(scope="module")
def cut() -> Demonstration:
    return simulated(shared(5, 12), BASELINES["probe and creep"](), 3)


def test_the_persons_action_is_carried_out_and_recorded_while_it_intervenes(cut: Demonstration) -> None:
    led = cut.infos["is_intervention"][1:]
    assert np.flatnonzero(led).tolist() == list(range(5, 12))
    assert (cut.actions[5:12] == PERSONS).all()
    speeds = np.diff(cut.infos["position_m"])[8:12] * 10
    assert np.allclose(speeds, 0.004, atol=1e-4)


def test_without_an_intervention_the_cut_is_the_agents_to_the_last_bit() -> None:
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", control_hz=10)
    alone = simulated(env, BASELINES["probe and creep"](), 3)
    beside = simulated(shared(0, 0), BASELINES["probe and creep"](), 3)
    assert np.array_equal(alone.observations, beside.observations)
    assert np.array_equal(alone.actions, beside.actions)
    assert not beside.infos["is_intervention"].any()


def test_lerobots_frames_say_which_decisions_a_person_took(cut: Demonstration, tmp_path: Path) -> None:
    write_lerobot(tmp_path / "set", "shared", {"control_hz": 10, "specimen_class": "liver"}, [cut])
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    assert np.flatnonzero(table["complementary_info.is_intervention"]).tolist() == list(range(5, 12))
    features = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]
    assert features["complementary_info.is_intervention"]["dtype"] == "bool"


@pytest.mark.parametrize("bad", [np.array([2.0, 0.0], np.float32), np.zeros(3, np.float32), np.array([np.nan, 0.0])])
def test_a_persons_action_that_is_none_is_refused_before_anything_moves(bad: np.ndarray) -> None:
    env = shared(0, 1, bad)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"the person's action .* is not in Box"):
        env.step(PERSONS)
    assert env.unwrapped.cutting.time == 0.0


class Handle(ScriptedDevice):
    """A scripted handle whose button is down from one read to another."""

    def __init__(self, begin: int, end: int) -> None:
        super().__init__(lambda time: HandMotion(0.03 + 20.0 * time * 0.005 * 2, 1.2))
        self._begin, self._end = begin, end

    def read(self) -> Stylus:
        held = self._begin <= self._reads < self._end
        return super().read()._replace(buttons=frozenset({"next"} if held else ()))


def test_a_hand_on_a_device_leads_the_blade_from_where_it_is_while_its_button_is_held() -> None:
    handle = Handle(10, 20)
    handle.open()
    env = RigCutEnv(rig="fake", specimen_class="uniform", control_hz=10)
    controlled = SharedControl(env, InterveningHand(handle, lambda: env.session.plant.position, control_hz=10))
    observation, _ = controlled.reset(seed=5)
    policy = ConstantFeed(speed=0.0127, angle=1.31)
    policy.reset(np.random.default_rng(0))
    places, led = [], []
    for _ in range(25):
        observation, *_, info = controlled.step(policy(observation))
        places.append(env.session.plant.position)
        led.append(info["is_intervention"])
    controlled.close()
    assert led == [False] * 10 + [True] * 10 + [False] * 5
    assert abs(places[10] - places[9]) < 0.003  # no leap to where the device stands
    moved = np.diff(places)[13:18]
    assert np.allclose(moved, 2e-4, atol=1e-4)  # 0.2 mm a decision, as the handle is led
    assert places[24] - places[21] > 0.002  # the agent leads again


@pytest.mark.parametrize("jump", [0.05, -0.05, float("nan")])
def test_a_device_that_jumps_does_not_move_the_blade_until_it_is_grabbed_again(jump: float) -> None:
    place, held, blade = 0.03, frozenset({"next"}), 0.05

    class Device(ScriptedDevice):
        def read(self) -> Stylus:
            return Stylus(place, 1.2, held)

    hand = InterveningHand(Device([]), lambda: blade, control_hz=50)
    stands = to_action(0.0, 1.2)
    assert (hand() == stands).all()
    place += 0.0002
    assert (hand() == to_action(0.005, 1.2)).all()
    place += jump
    assert (hand() == stands).all()
    place = 0.0302  # even if it comes back
    assert (hand() == stands).all()
    held = frozenset()
    assert hand() is None
    held = frozenset({"next"})
    assert (hand() == stands).all()
    place += 0.0002
    assert (hand() == to_action(0.005, 1.2)).all()
