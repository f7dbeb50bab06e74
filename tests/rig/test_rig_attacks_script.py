"""``scripts/rig_attacks.py`` tells what held from what did not."""

from __future__ import annotations

import pytest
import rig_attacks
from attack_scene import Outcome, Scene


def test_every_attack_is_listed_with_what_it_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig_attacks.main(["--list"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert len(listed) == len(rig_attacks.ATTACKS) + len(rig_attacks.POLICIES) >= 30
    assert all(line.endswith(".") for line in listed)


@pytest.mark.parametrize(
    ("outcome", "safe", "stops", "goes_on"),
    [
        (Outcome(cause="force limit", way=0.001), True, True, False),
        (Outcome(cause="force limit", way=0.006), True, False, False),
        (Outcome(cause="force limit", way=0.001, moves=True), False, False, False),
        (Outcome(cause="force limit", way=0.001, refused=False), False, False, False),
        (Outcome(cause=None, way=0.02), True, False, True),
        (Outcome(cause=None, way=0.02, notes=["! two programs have one rig"]), False, False, False),
        (Outcome(cause="force stale", way=0.001, stalls=1), True, True, True),
    ],
)
def test_what_came_of_an_attack_is_judged(outcome: Outcome, safe: bool, stops: bool, goes_on: bool) -> None:
    assert (outcome.safe, outcome.stops, outcome.goes_on) == (safe, stops, goes_on)


def test_a_blade_that_moves_on_is_seen_by_the_emulator() -> None:
    """The sibling: a stop that is not one is told as such."""
    with Scene() as scene:
        rig = scene.rig
        rig.begin(1)
        rig.cut(0.1)
        outcome = Outcome(cause="as if stopped")
        rig.plant.supervisor._held_until = float("inf")  # nobody misses the next command
        scene._look(outcome, {})
        if rig.plant.supervisor.phase == "ready":  # else a stall of the host has stopped it
            assert outcome.moves
            assert not outcome.safe


def test_a_second_program_is_refused_and_the_first_cuts_on() -> None:
    with Scene() as scene:
        for seed in range(3):
            held, seen = rig_attacks.made(scene, "second_program", seed)
            if held:
                break
        assert held, seen
        assert "another master" in seen
