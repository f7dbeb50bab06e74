"""The trials of faults tell of a busy machine and go on; those of attacks tell what held and what not."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from scripts.validation.rig import loop_jitter, rig_attacks, rig_faults, rig_trials
from scripts.validation.rig.attack_scene import Outcome, Scene
from scripts.validation.rig.busy_host import LATE, Lateness, TooBusy, look

CALM = Lateness([], True)
WELL = rig_trials.Trial(
    fault="over_force", seed=0, injected=10.0, speed=0.015, cause="force limit", stated=0.011, detected=10.010,
    received=10.011, standstill=10.030, refused=True, moved=1e-6, stalls=[],
)  # fmt: skip


class Machine:
    """Trials that are made at once, until the machine is busy."""

    def __init__(self) -> None:
        self.made: list[tuple[str, int]] = []
        self.calm_for = 10**6

    def one(self, trials: object, fault: str, random: np.random.Generator) -> rig_trials.Trial:
        if len(self.made) == self.calm_for:
            raise TooBusy("this machine is too busy")
        self.made.append((fault, int(random.integers(1000))))
        return dataclasses.replace(WELL, fault=fault, seed=self.made[-1][1])


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    machine = Machine()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rig_faults.Trials, "one", lambda *given: machine.one(*given))
    monkeypatch.setattr(rig_faults, "look", lambda: CALM)
    return machine


SOME = ["--trials", "3", "--only", "over_force", "bad_status", "--json", "kept.json"]


def test_a_run_that_was_broken_off_goes_on_where_it_left_off(machine: Machine, capsys: pytest.CaptureFixture[str]):
    machine.calm_for = 4
    assert rig_faults.main(SOME) == 3
    told = capsys.readouterr().err
    assert "too busy" in told
    assert "4 trials are kept" in told
    assert not Path("kept.json").exists()
    machine.calm_for = 10**6
    assert rig_faults.main(SOME) == 1  # "bad_status" is not to be found out as a force limit
    assert "4 trials were made before" in capsys.readouterr().err
    in_pieces, machine.made = machine.made, []
    assert not rig_faults.DEFAULTS[""].with_suffix(rig_faults.PART).exists()
    kept = json.loads(Path("kept.json").read_text())
    assert [each["fault"] for each in kept["trials"]] == ["over_force"] * 3 + ["bad_status"] * 3
    rig_faults.main(SOME)
    assert machine.made == in_pieces  # as in one run


def test_a_run_of_another_seed_or_anew_begins_from_the_first(machine: Machine):
    for more in (["--seed", "1"], ["--anew"]):
        machine.calm_for, machine.made = 2, []
        assert rig_faults.main(SOME) == 3
        machine.calm_for, machine.made = 10**6, []
        rig_faults.main([*SOME, *more])
        assert len(machine.made) == 6


def test_a_busy_machine_is_told_before_the_first_trial(machine: Machine, monkeypatch, capsys):
    monkeypatch.setattr(rig_faults, "look", lambda: Lateness([0.02, 0.3], False))
    assert rig_faults.main(SOME) == 3
    told = capsys.readouterr().err
    assert machine.made == []
    assert "2 times in 4 s" in told
    assert "300 ms at most" in told
    assert "rtprio 10" in told
    assert "chrt --rr 10" in told


def test_what_cannot_be_helped_by_a_priority_is_not_told_to_be():
    with pytest.raises(TooBusy, match="though it has real-time priority") as caught:
        Lateness([0.02, 0.3], True).check()
    assert "rtprio" not in str(caught.value)
    Lateness([0.3], False).check()  # one stall in four seconds is no reason to give up


def test_the_look_counts_a_machine_that_stalls(monkeypatch):
    monkeypatch.setattr("scripts.validation.rig.busy_host.LOOKED", 0.3)
    assert all(late > LATE for late in look().late)


def test_trials_in_vain_end_at_the_look_that_finds_a_busy_machine(monkeypatch):
    trials = rig_faults.Trials(Lateness([0.02, 0.3], False).check)
    monkeypatch.setattr(trials, "_tried", lambda *_: dataclasses.replace(WELL, detected=5.0))
    with pytest.raises(TooBusy):
        trials.one("over_force", np.random.default_rng(0))
    assert trials.before["over_force"] == 1


def test_every_attack_is_listed_with_what_it_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert rig_attacks.main(["--list"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert len(listed) == len(rig_attacks.ATTACKS) + len(rig_attacks.TRIALS) >= 30
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
        (Outcome(cause="force stale", way=0.001, stalls=1), True, True, False),
    ],
)
def test_what_came_of_an_attack_is_judged(outcome: Outcome, safe: bool, stops: bool, goes_on: bool) -> None:
    assert (outcome.safe, outcome.stops, outcome.goes_on) == (safe, stops, goes_on)


@pytest.mark.parametrize(("speed", "moves"), [(0.0, False), (0.001, True)])
def test_a_blade_that_moves_on_is_seen(speed: float, moves: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """The sibling: a stop that is not one is told as such."""
    times = itertools.count()
    monkeypatch.setattr("scripts.validation.rig.attack_scene.time.sleep", lambda seconds: None)
    with Scene() as scene:
        monkeypatch.setattr(scene, "_truth", lambda: {"position_m": speed * next(times)})
        outcome = Outcome(cause="as if stopped")
        scene._look(outcome)
    assert (outcome.moves, outcome.safe) == (moves, not moves)


def test_a_second_program_is_refused_and_the_first_cuts_on() -> None:
    with Scene() as scene:
        for seed in range(3):
            came = rig_attacks.made(scene, "second_program", seed)
            if came.held:
                break
        assert came.held, came.seen
        assert "another master" in came.seen


@pytest.mark.parametrize("apart", [True, False])
def test_the_jitter_of_a_loop_is_measured_in_a_spine_and_in_a_program(apart):
    found, empty = loop_jitter.measured(loop_jitter.nothing, 0.5, apart=apart)
    for percentiles in (found, empty):
        assert len(percentiles) == len(loop_jitter.PERCENTILES)
        assert percentiles == sorted(percentiles)
        assert abs(percentiles[0]) < 500.0  # [us]: half of its calls are a millisecond after the last
