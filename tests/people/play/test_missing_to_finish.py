"""Near the target the window says what is still missing to finish, and following it finishes the cut."""

from __future__ import annotations

import math

import pytest
from played import TARGET, session

from cutenv.people.play.haptics import Stylus
from cutenv.people.play.play_session import Session
from cutenv.people.play.played_cut import NearTarget, missing_to_finish
from cutenv.task.assessment import NEAR_TARGET

UPRIGHT = math.pi / 2
AT_REST = {
    "force": 0.0, "elastic": 0.0, "friction": 0.2, "stiffness": 200.0, "speed": 0.0, "angle": UPRIGHT,
    "rested": 0.1, "withdrawn": 0.0,
}  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({}, ["hold still for 0.2 s"]),
        ({"angle": math.radians(62.0)}, ["turn the blade upright: 62°", "hold still for 0.2 s"]),
        ({"angle": math.radians(80.5)}, ["hold still for 0.2 s"]),
        ({"rested": 0.0, "force": 1.9, "elastic": 1.8}, ["1.9 N still pull: draw back 8 mm"]),
        ({"rested": 0.0, "force": 0.25, "speed": -0.01}, ["hold still for 0.3 s, or draw back 20 mm"]),
        ({"rested": 0.0, "force": 0.25}, ["0.2 N still pull: draw back 1 mm"]),
    ],
    ids=["resting", "inclined", "upright enough", "pulled", "drawing back", "more friction assumed than there is"],
)  # fmt: skip
def test_each_thing_that_is_missing_is_said(changes: dict[str, float], says: list[str]) -> None:
    assert list(missing_to_finish(NearTarget(**(AT_REST | changes)))) == says


class Obedient:
    """Hand that leads beyond the target, and then does what it is told."""

    coupling = None

    def __init__(self) -> None:
        self.position, self.angle = 0.0, math.radians(60.0)
        self.leads = True
        self.told: tuple[str, ...] = ("",)

    def open(self) -> None:
        pass

    def read(self) -> Stylus:
        if self.leads:
            self.position += 1.5e-5
            self.leads = self.position < TARGET + 0.012
        elif "turn" in self.told[0]:
            self.angle = UPRIGHT
        elif "N still pull" in self.told[-1]:
            self.position -= 1e-5
        return Stylus(self.position, self.angle)

    def push(self, force: float) -> None:
        pass

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def near() -> tuple[Session, Obedient]:
    """A session whose blade has come near its target, and whose hand has gone as far as it means to."""
    hand = Obedient()
    played = session(countdown=0.0)
    played.device = hand
    played.begin()
    clock = 0.0
    while hand.leads:
        played.advance(clock)
        clock += 0.02
        furthest = float(played.cut.cutting.progress[0]["furthest"])
        assert bool(played.sight().missing) == (furthest >= TARGET - NEAR_TARGET)
    return played, hand


def test_the_words_do_not_depend_on_the_hidden_tip_unless_in_practice(near: tuple[Session, Obedient]) -> None:
    cut = near[0].cut
    state = cut.plant.states
    said, tip = cut.missing(practice=False), float(state["tip"][0])
    state["tip"] = TARGET - 0.0042
    assert cut.missing(practice=False) == said
    assert cut.missing(practice=True) == ("the tip is 4.2 mm short: cut on",)
    state["tip"] = TARGET - 0.001
    assert cut.missing(practice=True) == said
    state["tip"] = tip


def test_a_hand_that_does_what_is_said_finishes_upright(near: tuple[Session, Obedient]) -> None:
    played, hand = near
    clock = played.cut.cutting.time
    while played.phase == "cutting":
        hand.told = played.sight().missing or hand.told
        clock += 0.02
        played.advance(clock)
    assert played.cut.end == "finished"
    assert "not upright" not in played.sight().moment.verdict
    assert played.sight().missing == ()
