"""A person's cuts told to a listener while they go on."""

from __future__ import annotations

import time
from collections.abc import Callable

from cutenv.people.play.course_progress import GIVEN_UP
from cutenv.people.play.play_session import Session
from cutenv.people.play.played_cut import PlayedCut
from cutenv.records.appending import CutListener
from cutenv.sim.tissue.grid import depth_below

_LOST = 0.1  # [s] by which a cut's time may lag behind the clock before the difference is a stall


class ListenedSession:
    """Follower of a session.

    Call it after every advance, with what is new passed on to a listener.

    Parameters
    ----------
    session : Session
        Session of cuts.
    listener : CutListener
        Listener to them.
    clock : callable
        Clock in seconds, that of the listener's stamps.
    """

    def __init__(self, session: Session, listener: CutListener, clock: Callable[[], float] = time.monotonic) -> None:
        self._session, self._listener, self._clock = session, listener, clock
        self._cut: PlayedCut | None = None
        self._sent, self._origin = 0, 0.0

    def __call__(self) -> None:
        """Pass on a cut's beginning, new readings and end."""
        cut = self._session.cut if self._session.phase == "cutting" else None
        if cut is not self._cut and self._cut is not None:
            self._pass_on(self._cut)
            self._listener.ended(self._cut.end or GIVEN_UP)
        if cut is not self._cut and cut is not None:
            self._sent, self._origin = 0, self._clock()
            self._listener.began(f"{cut.specimen_class} seed {cut.seed} number {cut.episode}")
        self._cut = cut
        if cut is not None:
            self._pass_on(cut)

    def _pass_on(self, cut: PlayedCut) -> None:
        new = cut.readings[self._sent :]
        if not len(new):
            return
        late = self._clock() - (self._origin + float(new["time"][-1]))
        if late > _LOST:  # time that a stall has taken from the cut
            self._origin += late
        self._sent += len(new)
        self._listener.readings(new.copy(), depth_below(cut.plant.depth, new["position"]), self._origin)
