"""A session without a window: countdown, cut, record and score by a fake clock; and a listener that is told of it."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from played import DATE, TARGET, begun, run, session, whole

from cutenv.commands import cli
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.people.play import played_cut as played_cut
from cutenv.people.play.devices import HandMotion, MouseDevice, ScriptedDevice
from cutenv.people.play.hand_model import MAX_HAND_SPEED
from cutenv.people.play.play_session import GIVEN_UP, LONGEST_STALL, ListenedSession, Session, SessionPlan
from cutenv.records import load_one


def test_a_whole_cut_is_counted_down_cut_recorded_and_scored(tmp_path: Path) -> None:
    played = session(tmp_path)
    assert played.phase == "ready"
    played.begin()
    assert (played.phase, played.sight().countdown) == ("countdown", 1.0)
    clock = run(played, until="cutting")
    assert clock == pytest.approx(1.0, abs=0.05)
    assert played.cut.cutting.time < 0.05
    run(played, clock=clock)
    assert played.cut.end == "finished"
    trace = load_one(played.saved)
    for name in ("time", "force", "position", "speed", "angle"):
        assert np.array_equal(getattr(trace, name), played.cut.readings[name])
    assert trace.sample_rate == pytest.approx(1000.0)
    assert trace.known == ("time", "force", "position", "speed", "angle", "depth")
    assert played.card is not None
    assert played.card.overall_score is not None


def test_the_record_says_what_was_cut_by_whom_and_when(tmp_path: Path) -> None:
    played = whole(tmp_path)
    told = load_one(played.saved).metadata
    assert told["operator"] == "P07"
    assert told["date"] == DATE.isoformat()
    assert (told["specimen_class"], told["specimen_seed"], told["specimen_episode"]) == ("liver", 6, 0)
    assert told["target_length_m"] == TARGET
    assert (told["end"], told["success"]) == ("finished", played.cut.cutting.success)
    assert (told["practice"], told["stalled_s"], told["attempt"]) == (False, 0.0, 1)


def test_from_the_record_the_specimen_can_be_drawn_again(tmp_path: Path) -> None:
    played = whole(tmp_path, target_length=None)
    told = load_one(played.saved).metadata
    env = GentleCutEnv(specimen_class=told["specimen_class"])
    env.reset(seed=told["specimen_seed"], options={"episode": told["specimen_episode"]})
    assert env.specimen == played.cut.plant.specimen
    assert env.cutting.target_length == told["target_length_m"]


def test_the_command_that_scores_takes_the_record_and_gives_the_same_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("tqdm", reason="reading records by command is an extra")
    played = whole(tmp_path)
    assert cli.main(["score", str(played.saved), "--out", str(tmp_path)]) == 0
    assert played.card is not None
    assert played.card.headline() in capsys.readouterr().out


def records_at(frame: float) -> np.ndarray:
    played = session()
    played.begin()
    run(played, frame=frame)
    return played.cut.readings


def test_the_record_is_the_same_at_60_and_at_20_pictures_a_second() -> None:
    assert np.array_equal(records_at(1.0 / 60.0), records_at(1.0 / 20.0))


def test_a_stall_is_made_up_for_in_part_and_the_record_tells_the_rest(tmp_path: Path) -> None:
    played = session(tmp_path)
    played.begin()
    clock = run(played, until="cutting") + 1.0
    played.advance(clock)
    before = played.cut.cutting.time
    assert played.advance(clock + 5.0) == round(1000 * LONGEST_STALL)
    assert played.cut.cutting.time - before == pytest.approx(LONGEST_STALL)
    run(played, clock=clock + 5.0)
    trace = load_one(played.saved)
    # The second before is a stall too.
    assert trace.metadata["stalled_s"] == pytest.approx(6.0 - 2 * LONGEST_STALL, abs=0.05)
    assert np.diff(trace.time) == pytest.approx(0.001)


def test_a_clock_that_stands_or_goes_back_moves_nothing() -> None:
    played, _ = begun()
    readings = len(played.cut.readings)
    assert played.advance(0.0) == 0
    assert len(played.cut.readings) == readings


def test_closing_in_the_middle_of_a_cut_keeps_what_was_cut(tmp_path: Path) -> None:
    played, clock = begun(tmp_path)
    for k in range(120):
        played.advance(clock + k / 60.0)
    felt = played.cut.readings.copy()
    played.close()
    played.close()
    assert len(played.records) == 1
    trace = load_one(played.records[0])
    assert trace.metadata["end"] == GIVEN_UP
    assert trace.metadata["success"] is False
    assert np.array_equal(trace.force, felt["force"])
    assert [path.suffix for path in tmp_path.iterdir()] == [".csv"]


def test_closing_before_a_cut_leaves_no_record(tmp_path: Path) -> None:
    played, _ = begun(tmp_path)
    played.advance(1.01)
    played.close()
    assert list(tmp_path.iterdir()) == []


def test_a_cut_that_was_given_up_at_once_is_scored_without_an_error(tmp_path: Path) -> None:
    played = Session(ScriptedDevice(lambda time: HandMotion(0.0, 1.57)), SessionPlan(countdown=0.0), folder=tmp_path)
    played.begin()
    for k in range(10):
        played.advance(0.02 * k)
    played.close()
    assert load_one(played.records[0]).metadata["end"] == GIVEN_UP
    assert played.card is not None


@pytest.mark.parametrize("moment", ["before", "amid", "after"])
def test_a_cut_in_which_practice_ever_was_on_is_marked(tmp_path: Path, moment: str) -> None:
    played = session(tmp_path)
    if moment == "before":
        played.show_hidden(True)
    played.begin()
    clock = run(played, until="cutting")
    if moment == "amid":
        played.show_hidden(True)
        played.show_hidden(False)
    run(played, clock=clock)
    if moment == "after":
        played.show_hidden(True)
    assert load_one(played.saved).metadata["practice"] is (moment != "after")


def test_the_next_specimen_is_another_and_repeating_brings_the_same() -> None:
    played = session()
    first = played.cut.plant.specimen
    played.begin()
    clock = run(played)
    played.repeat()
    assert played.cut.plant.specimen == first
    run(played, clock=clock)
    played.go_on()
    assert played.cut.plant.specimen != first
    assert played.number == 1


def test_repeating_amid_a_cut_keeps_the_record_of_both(tmp_path: Path) -> None:
    played, clock = begun(tmp_path)
    for k in range(60):
        played.advance(clock + k / 60.0)
    played.repeat()
    run(played, clock=clock + 1.0)
    told = [load_one(path).metadata for path in played.records]
    assert [(each["end"], each["attempt"]) for each in told] == [(GIVEN_UP, 1), ("finished", 2)]


def test_no_record_takes_the_place_of_another(tmp_path: Path) -> None:
    for _ in range(2):
        whole(tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_class_chosen_amid_a_cut_is_that_of_the_next_specimen_and_not_of_a_repeated_one() -> None:
    played, clock = begun()
    played.choose_class("uniform")
    assert played.cut.specimen_class == "liver"
    played.repeat()
    assert played.cut.specimen_class == "liver"
    run(played, clock=clock)
    played.go_on()
    assert played.cut.specimen_class == "uniform"


def test_keys_that_would_begin_a_cut_do_nothing_while_one_goes_on() -> None:
    played, _ = begun()
    cut = played.cut
    played.go_on()
    assert (played.phase, played.cut) == ("cutting", cut)


def test_after_as_many_cuts_as_there_were_to_be_none_begins() -> None:
    played = whole(cuts=1)
    played.go_on()
    assert (played.done, played.phase) == (True, "ended")


def test_the_hand_is_never_faster_than_the_fastest_measured() -> None:
    played = Session(
        ScriptedDevice(lambda time: HandMotion(0.14, 1.57)), SessionPlan(seed=6, countdown=0.0, target_length=TARGET)
    )
    played.begin()
    played.advance(0.0)
    fastest = 0.0
    for k in range(1, 100):
        played.advance(0.02 * k)
        fastest = max(fastest, float(played.cut.plant.states["hand_speed"][0]))
    assert 0.99 * MAX_HAND_SPEED < fastest < 1.001 * MAX_HAND_SPEED


def test_the_hand_comes_to_where_it_is_meant_to_be_without_swinging_beyond() -> None:
    played = Session(ScriptedDevice(lambda time: HandMotion(0.02, 1.57)), SessionPlan(seed=6, countdown=0.0))
    played.begin()
    hands = []
    for k in range(300):
        played.advance(0.01 * k)
        hands.append(float(played.cut.plant.states["hand"][0]))
    assert hands[-1] == pytest.approx(0.02, abs=1e-5)
    assert max(hands) < 0.02 + 5e-5


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"operator": "Anna Schmidt"}, "may identify a person"),
        ({"specimen_class": "lever"}, "liver"),
        ({"cuts": 0}, "cuts"),
        ({"seed": -1}, "seed"),
        ({"countdown": float("nan")}, "countdown"),
    ],
)
def test_bad_arguments_are_refused_before_anything_is_written(
    tmp_path: Path, changes: dict[str, object], says: str
) -> None:
    folder = tmp_path / "cuts"
    with pytest.raises(ValueError, match=says):
        session(folder, **changes)
    assert not folder.exists()


def test_a_mouse_that_jumps_leads_no_farther_than_the_specimen() -> None:
    played = Session(MouseDevice(), SessionPlan(seed=6, countdown=0.0))
    played.device.move(5.0)
    played.device.move(-0.001)
    assert played.device.read().position == pytest.approx(0.1485)


def test_a_session_needs_neither_pygame_nor_pymunk_before_there_is_a_window() -> None:
    code = (
        "import sys; sys.modules['pygame'] = sys.modules['pymunk'] = None\n"
        "from cutenv.people.play import Session\nfrom cutenv.people.play.devices import simple_hand\n"
        "Session(simple_hand(0.07)).begin()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


class Heard:
    def __init__(self) -> None:
        self.told: list[str] = []
        self.parts: list[tuple[Any, Any, float]] = []

    def began(self, name: str) -> None:
        self.told.append(f"begin {name}")

    def readings(self, readings: Any, depth: Any, origin: float) -> None:
        self.parts.append((readings, depth, origin))

    def ended(self, cause: str) -> None:
        self.told.append(f"end {cause}")


def listened(clock: list[float]) -> tuple[Session, Heard]:
    played, heard = session(cuts=1), Heard()
    played.after_advance = ListenedSession(played, heard, clock=lambda: clock[0])
    return played, heard


def test_every_reading_of_a_cut_is_told_once_and_its_end() -> None:
    clock = [0.0]
    played, heard = listened(clock)
    played.begin()
    while played.phase != "ended":
        clock[0] += 1 / 60
        played.advance(clock[0])
    told = np.concatenate([part for part, _, _ in heard.parts])
    assert np.array_equal(told, played.cut.readings)
    assert all(len(part) == len(depth) for part, depth, _ in heard.parts)
    assert len({origin for _, _, origin in heard.parts}) == 1
    assert heard.parts[-1][2] + told["time"][-1] == pytest.approx(clock[0], abs=0.02)
    assert heard.told == ["begin liver seed 6 number 0", "end finished"]


def test_a_stall_moves_the_stamps_and_a_closed_session_ends_its_cut() -> None:
    clock = [0.0]
    played, heard = listened(clock)
    played.begin()
    run(played, until="cutting")
    for step in (1.1, 1.2, 4.0, 4.1):  # the third lost more than two seconds
        clock[0] = step
        played.advance(step)
    played.close()
    assert heard.told[-1] == "end given up"
    first, last = heard.parts[0], heard.parts[-1]
    assert last[2] - first[2] > 2.0
    assert last[2] + last[0]["time"][-1] == pytest.approx(4.1, abs=0.11)
