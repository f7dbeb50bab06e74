"""A person and an agent share a cut: the agent cuts as alone, a button hands the blade over, the record says whose."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from played import COUPLING, DATE, Pushing, run
from played_window import FRAME, FakeClock, begin, post, pygame, show

from cutenv.agents.learning.demonstration import recorded
from cutenv.agents.learning.evaluation import contestant
from cutenv.agents.learning.minari_datasets import recorded_cuts
from cutenv.commands import cli
from cutenv.people.play.devices import HandMotion, MouseDevice, ScriptedDevice
from cutenv.people.play.haptics import Stylus
from cutenv.people.play.play_session import Session, SessionPlan
from cutenv.people.play.play_window import PlayWindow
from cutenv.people.play.shared_cut import SharedCut, SharingAgent
from cutenv.records import load_one, save

UPRIGHT = 0.5 * np.pi
IDLE = Stylus(0.0, UPRIGHT)


def agent(name: str = "ppo-free") -> SharingAgent:
    found = contestant(name)
    return SharingAgent(name=name, policy=found.policy, arguments=found.arguments)


def shared_cut(name: str = "ppo-free", **changes: Any) -> SharedCut:
    return SharedCut(agent=agent(name), **({"specimen_class": "liver", "seed": 1_000_003} | changes))


@pytest.mark.parametrize("name", ["ppo-free", "probe and creep"])
def test_without_the_person_it_is_the_agents_cut_in_the_environment(name: str) -> None:
    cut = shared_cut(name)
    seen: list[np.ndarray] = []
    decide = cut.agent.policy

    class Watched:
        def __call__(self, observation: np.ndarray) -> Any:
            seen.append(observation.copy())
            return decide(observation)

    object.__setattr__(cut.agent, "policy", Watched())
    while not cut.end:
        cut.tick(IDLE)
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", control_hz=10)
    policy = contestant(name).policy
    observation, _ = env.reset(seed=1_000_003)
    policy.reset(np.random.default_rng((1_000_003, 0)))
    alone = [observation]
    ended = False
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
        alone.append(observation)
    assert cut.end == info["end"]
    assert len(seen) == len(alone) - 2  # the first was asked before, after the last nothing is
    assert np.array_equal(np.array(seen), np.array(alone[1:-1]))
    assert cut.decisions == (len(alone) - 1, 0)


def test_the_blade_does_not_leap_when_it_is_taken_and_follows_the_hand_from_there() -> None:
    cut, held = shared_cut(), frozenset({"next"})
    for _ in range(1500):
        cut.tick(IDLE)
    before, angle = cut.hand, float(cut.plant.states["angle"][0])
    for _ in range(300):  # the device stands elsewhere, and rests: so does the blade
        cut.tick(Stylus(0.12, 1.3, held))
    assert abs(cut.hand - before) < 0.002
    assert float(cut.plant.states["angle"][0]) == pytest.approx(angle, abs=1e-3)
    for k in range(900):
        cut.tick(Stylus(0.12 - 1e-5 * min(k, 500), 1.3, held))
    assert cut.hand == pytest.approx(before - 0.005, abs=0.0005)
    assert cut.person_leads
    cut.tick(IDLE)
    assert not cut.person_leads
    back = cut.hand
    for _ in range(1500):
        cut.tick(IDLE)
    assert cut.hand > back + 0.003  # the agent leads again


def test_the_record_and_the_end_card_say_who_held_the_blade_and_data_sets_know_it(tmp_path: Path) -> None:
    device = ScriptedDevice(
        lambda time: HandMotion(0.004 * min(max(time - 1.0, 0.0), 1.0), UPRIGHT, held=1.0 <= time < 2.0)
    )
    session = Session(
        device,
        SessionPlan(task="shared", agent=agent(), seed=6, target_length=0.07, countdown=0.0, cuts=1),
        folder=tmp_path,
        now=lambda: DATE,
    )
    session.begin()
    run(session)
    record = load_one(session.records[0])
    told = record.metadata
    assert (told["policy"], told["decisions_of_the_person"]) == ("ppo-free", 10)
    assert told["person_led_s"] == [[1.0, 2.0]]
    assert "hand" not in told
    every = told["decisions"]
    assert session.sight().verdict == (f"You held the blade in 10 of {every} decisions; 'ppo-free' made the others.",)
    cut = recorded(record, control_hz=10)
    assert np.flatnonzero(cut.infos["is_intervention"][1:]).tolist() == list(range(10, 20))
    spoilt = dataclasses.replace(record, metadata={**told, "person_led_s": "all"})
    with pytest.raises(ValueError, match="person_led_s = 'all' must be a list of pairs of seconds"):
        recorded(spoilt, control_hz=10)
    save(
        dataclasses.replace(record, metadata={k: v for k, v in told.items() if k != "person_led_s"}),
        tmp_path / "own.csv",
    )
    with pytest.raises(ValueError, match=r"shared with an agent, and own\.csv not: give them for two data sets"):
        recorded_cuts([session.records[0], tmp_path / "own.csv"], {"control_hz": 10}, None)
    assert cli.main(["score", str(session.records[0]), "--out", str(tmp_path / "scored")]) == 0


def test_a_handle_feels_the_blade_only_while_it_leads_it() -> None:
    device = Pushing()
    session = Session(
        device, SessionPlan(task="shared", agent=agent(), seed=6, target_length=0.07, countdown=0.0, cuts=1)
    )
    session.begin()
    clock = 0.0
    for k in range(240):
        device.held = frozenset({"next"} if 120 <= k < 180 else ())
        session.advance(clock)
        clock += FRAME
    forces = np.array(device.forces)
    assert isinstance(session.cut, SharedCut)
    first, last = session.cut._led[0]
    assert not forces[:first].any()
    assert np.abs(forces[first:last]).max() > 0.05
    assert np.abs(forces).max() <= COUPLING.force_limit
    assert not forces[last:].any()


def window() -> PlayWindow:
    plan = SessionPlan(task="shared", agent=agent(), seed=6, countdown=0.0, target_length=0.07)
    session = Session(MouseDevice(), plan)
    return PlayWindow(session, clock=FakeClock())


def test_space_arrows_and_the_mouse_button_take_the_blade_while_they_are_held() -> None:
    played = window()
    begin(played)
    cut = played.session.cut
    for down, up, what in (
        (pygame.KEYDOWN, pygame.KEYUP, {"key": pygame.K_SPACE}),
        (pygame.KEYDOWN, pygame.KEYUP, {"key": pygame.K_RIGHT}),
        (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP, {"button": 1}),
    ):
        assert not cut.person_leads
        post(down, **what)
        before = cut.hand
        show(played, 30)
        assert cut.person_leads, what
        assert played.session.sight().leader == "you lead"
        moved = cut.hand - before
        assert (moved > 0.003) == (what.get("key") == pygame.K_RIGHT)  # the others hold it where it is
        post(up, **what)
        show(played, 3)
    assert not cut.person_leads
    assert "ppo-free cuts" in played.session.sight().leader
    assert 10 < cut.decisions[1] < 25


def test_a_key_that_is_still_down_at_the_end_does_not_lead_the_next_cut() -> None:
    played = window()
    begin(played)
    post(pygame.KEYDOWN, key=pygame.K_RIGHT)
    show(played, 5)
    played.session.repeat()
    show(played, 5)
    post(pygame.KEYUP, key=pygame.K_RIGHT)
    show(played, 30)
    assert not played.session.cut.person_leads


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--policy", "ppo-fre"], "Did you mean 'ppo-free'"),
        (["--policy", "ppo-free", "--task", "depth"], "does not go with --task depth"),
        (["--policy", "ppo-free", "--course", "first", "--operator", "P07"], "does not go with --course"),
        (["--policy", "planner with truth"], "knows the hidden state"),
        (["--policy", "hold one depth"], "is for the task 'depth'"),
    ],
)
def test_a_policy_that_cannot_share_the_cut_is_refused_before_a_window_opens(
    options: list[str], message: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert cli.main(["play", *options, "--out", str(tmp_path)]) == 2
    assert message in capsys.readouterr().err
