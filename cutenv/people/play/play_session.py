"""Session of cuts by one person, without a window.

Specimens, countdown, 1 kHz by a given clock, record and score.  A listener may follow the cuts while they go on,
and a thread may run the session, so that devices that push do not wait for pictures.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

import cutenv
from cutenv._base.arrays import Array, StructArray
from cutenv._base.validation import in_range, one_of
from cutenv.display.viewer.scene import Moment
from cutenv.envs.tissue_source import TissueSource
from cutenv.people.play.course import FEEDBACK, CourseTask, ShownFeedback, shown_feedback
from cutenv.people.play.course_progress import GIVEN_UP, CourseProgress
from cutenv.people.play.devices import LedHand
from cutenv.people.play.hand_model import PLAYED_HAND
from cutenv.people.play.handle_body import Handle, HandlePose
from cutenv.people.play.haptics import FeltForce, HapticDevice, Stylus
from cutenv.people.play.played_cut import FEWEST_READINGS, UPDATES_HZ, PlayedCut
from cutenv.people.play.shared_cut import SharedCut, SharingAgent
from cutenv.records import Provenance, save
from cutenv.records.appending import CutListener
from cutenv.records.scoring import ScoreCard
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.tissue import CutModel
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.registry import TASKS, tasks_with

COUNTDOWN = 3.0
"""Duration of the countdown before every cut [s]."""
LONGEST_STALL = 0.25
"""Longest stall that is made up for [s]; time beyond it is lost to the cut, and the record states it."""
SHARED_TASK = "shared"
"""Name of the task of gentle cutting that is shared with an agent."""
_LOST = 0.1  # [s] by which a cut's time may lag behind the clock before the difference is a stall


def _kind_of_cut(task: str) -> type[PlayedCut]:
    return SharedCut if task == SHARED_TASK else TASKS[task].played


def _has_line(task: str) -> bool:
    return task != SHARED_TASK and TASKS[task].line


@dataclass(frozen=True, kw_only=True)
class SessionPlan:
    """Cuts of a session.

    Task, specimens and number; a course gives specimens, tasks and targets in its place.

    Attributes
    ----------
    task : str
        A task of :data:`cutenv.task.registry.TASKS` that can be played, or "shared": an agent cuts, and the person
        takes over while a button is held.
    line : str, optional
        Kind of line of a task along one, as of :class:`~cutenv.envs.path_cut.PathCutEnv`; default "mixed".
    agent : SharingAgent, optional
        Agent of the task "shared".
    specimen_class : str
        Class of the first specimens; see :meth:`Session.choose_class`.
    seed : int
        Seed of the session; specimen number i is its episode i.
    target_length : float, optional
        Target length of every cut [m]; drawn from 0.060 to 0.100 by default.
    practice : bool
        True to show hidden quantities.
    tissue : str or Path, optional
        File of the tissue that all specimens are of, a course's too; default: the measured pig liver.
    cuts : int, optional
        Number of cuts; unlimited by default.
    countdown : float
        Duration of the countdown before every cut [s].

    Raises
    ------
    ValueError
        If a value is out of range, or line or agent do not go with the task.
    """

    task: str = "gentle"
    line: str | None = None
    agent: SharingAgent | None = None
    specimen_class: str = "liver"
    seed: int = 0
    target_length: float | None = None
    practice: bool = False
    tissue: str | Path | None = None
    cuts: int | None = None
    countdown: float = COUNTDOWN

    def __post_init__(self) -> None:
        one_of("task", self.task, (*tasks_with("played"), SHARED_TASK))
        if self.line is not None and not _has_line(self.task):
            raise ValueError(f"line = {self.line!r} needs a task along a line: task={self.task!r} has no line.")
        if (self.agent is not None) != (self.task == SHARED_TASK):
            raise ValueError('an agent and task="shared" belong together, and no course has them.')
        one_of("specimen_class", self.specimen_class, CLASSES)
        TissueSource(self.tissue)  # refuses a file that is none
        if self.cuts is not None:
            in_range("cuts", self.cuts, 1, 10_000, "1", "Give how many.")
        in_range("countdown", self.countdown, 0.0, 60.0, "s", "Give seconds.")

    @property
    def of_task(self) -> dict[str, Any]:
        """Arguments of the task's cut alone."""
        return {name: value for name in ("line", "agent") if (value := getattr(self, name)) is not None}


PlayPhase = Literal["ready", "countdown", "cutting", "ended"]


@dataclass(frozen=True, kw_only=True)
class ViewState:
    """State of a session to be drawn; nothing in it changes."""

    phase: PlayPhase
    countdown: float
    moment: Moment
    readings: StructArray
    hand: float
    hand_place: tuple[float, float]
    """Along and across the slab, to the left [m]."""
    lateral_force: Array
    """Force on the blade to its right at every reading [N]; of shape (0,) where it is not steered."""
    pose: HandlePose | None
    missing: tuple[str, ...]
    practice: bool
    practised: bool
    truth: dict[str, Any]
    specimen_class: str
    chosen_class: str
    serial: int
    model: CutModel
    number: int
    finished: int
    count: int | None
    card: ScoreCard | None
    saved: Path | None
    operator: str | None
    shown: ShownFeedback
    feedback_words: str
    task: str
    verdict: tuple[str, ...]
    leader: str
    """Words that say who leads a shared cut; empty where only a person cuts."""
    done: bool


class Session:
    """Session of cuts one after the other, each recorded.

    Parameters
    ----------
    device : HapticDevice
        Device that the person holds.
    plan : SessionPlan
        What is cut.
    folder : Path, optional
        Folder for records, a CSV for each cut; it is created. Default: nothing is written.
    operator : str, optional
        Anonymous code, see :class:`cutenv.records.Provenance`.
    handle : bool
        True to simulate a handle for the picture (needs pymunk).
    course : CourseProgress, optional
        Course of the person: it gives specimens, targets and feedback, and ends the session when it is done.
    now : callable
        Returns date and time of day, for the records.

    Raises
    ------
    ValueError
        If an argument is out of range, or the operator's code looks like a name.
    """

    def __init__(
        self,
        device: HapticDevice,
        plan: SessionPlan = SessionPlan(),
        *,
        folder: Path | None = None,
        operator: str | None = None,
        handle: bool = False,
        course: CourseProgress | None = None,
        now: Callable[[], datetime] = lambda: datetime.now().astimezone(),
    ) -> None:
        self.device = device
        self.task, self._of_task, self._tissue = plan.task, plan.of_task, plan.tissue
        if plan.agent is not None and course is not None:
            raise ValueError('an agent and task="shared" belong together, and no course has them.')
        kinds = (self.task,) if course is None else course.course.kinds
        if device.coupling is not None and any(map(_has_line, kinds)):
            raise ValueError("a cut along a line takes no device that pushes: its force would be one in the plane.")
        operator = operator if course is None else course.operator
        self.chosen_class, self.seed, self._target_length = plan.specimen_class, plan.seed, plan.target_length
        self.folder = folder
        self._origin = Provenance(rig="cutenv play, simulated", sensor="simulated, 1 kHz", operator=operator)
        self.operator = operator
        self.practice, self.count, self._countdown = plan.practice, plan.cuts, plan.countdown
        self.course = course
        self._with_handle, self._now = handle, now
        self.number = 0
        """Number of the present specimen, counted from 0."""
        self.finished = 0
        """Number of cuts that came to one of the task's ends."""
        self.records: list[Path] = []
        """Files written, in order."""
        self.after_advance: Callable[[], None] = lambda: None
        """Called after every advance, and when the session is closed."""
        self._attempts = 0
        self._serial = 0
        self._held: frozenset[str] = frozenset()
        self._clock: float | None = None
        self._ticks = 0
        self.phase: PlayPhase = "ready"
        self.card: ScoreCard | None = None
        """Score of the cut that has ended."""
        self.saved: Path | None = None
        """Record of that cut, if there is a folder."""
        self._felt: FeltForce | None = None
        self._task, self._feedback = "", "always"
        self._given: CourseTask | None = None  # by the course
        # Compile now, on cuts that are discarded, rather than while the clock of the first one runs.
        for kind in kinds:
            _kind_of_cut(kind)(tissue=self._tissue, **self._of_task).tick(Stylus(0.0, float(np.pi / 2)))
        self._prepare()
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
        device.open()

    # Requests of the person

    def begin(self) -> None:
        """Start the present specimen's countdown, unless cutting."""
        if self.phase == "ready":
            self._countdown_ticks = round(self._countdown * UPDATES_HZ)
            self.phase = "countdown"

    def go_on(self) -> None:
        """Begin, or prepare the next specimen after a cut.

        It does nothing during a cut, or when all cuts are done.
        """
        if self.phase == "ended" and not self.done:
            self.number += 1 if self.course is None else 0  # a course has seeds, each with one specimen
            self._attempts = 0
            self._prepare()
        self.begin()

    def repeat(self) -> None:
        """Repeat the specimen, abandoning a cut in progress.

        The abandoned cut is recorded as such. A course has no repetition.
        """
        if self.phase == "ready" or self.course is not None:
            return
        self._give_up()
        self._prepare(self.cut.specimen_class)
        self.begin()

    def choose_class(self, specimen_class: str | None = None) -> None:
        """Choose the next specimen's class, by default the following one.

        The choice counts at once if no cut has begun. A course chooses by itself.
        """
        if self.course is not None:
            return
        after = CLASSES[(CLASSES.index(self.chosen_class) + 1) % len(CLASSES)]
        self.chosen_class = one_of("specimen_class", specimen_class or after, CLASSES)
        if self.phase == "ready":
            self._prepare()

    def show_hidden(self, practice: bool | None = None) -> None:
        """Switch practice on or off, by default to the other.

        A cut in which it was ever on is marked.

        A course has none.
        """
        if self.course is not None:
            return
        self.practice = not self.practice if practice is None else practice
        self._practised |= self.practice and self.phase in ("countdown", "cutting")

    def forget_force(self) -> None:
        """Release a pushing device for a millisecond; reset its energy account."""
        if self._felt is not None:
            self._felt.forget()

    def close(self) -> None:
        """Abandon and record a cut in progress; release the device.

        Further calls do nothing.
        """
        self._give_up()
        self.after_advance()
        self.device.close()

    @property
    def done(self) -> bool:
        """True when all requested cuts, or the course, are done."""
        over = self.course is not None and (self.course.task is None or self.course.waits)
        return over or (self.count is not None and self.finished >= self.count)

    # Time

    def advance(self, clock: float) -> int:
        """Advance to the time of a clock, millisecond by millisecond.

        Return their number.

        Parameters
        ----------
        clock : float
            Time [s] from any origin, never decreasing; the first call sets the start.
        """
        if self._clock is None:
            self._clock = clock
        due = int((clock - self._clock) * UPDATES_HZ + 1e-6) - self._ticks
        most = round(LONGEST_STALL * UPDATES_HZ)
        if due > most:
            self._stalled += (due - most) * TICK if self.phase == "cutting" else 0.0
            self._clock += (due - most) * TICK
            due = most
        for _ in range(due):
            self._ticks += 1
            self._tick()
        self.after_advance()
        return max(due, 0)

    def _tick(self) -> None:
        if self.phase == "countdown":
            self._countdown_ticks -= 1
            if self._countdown_ticks <= 0:
                self._start()
        elif self.phase == "cutting":
            if isinstance(self.device, LedHand):
                self.device.keep_near(*self.cut.hand_place)
            self._stylus = self.device.read()
            self.cut.tick(self._stylus)
            if self._felt is not None:
                self.device.push(self.cut.felt(self._felt, self._stylus))
            if self.cut.end:
                self.finished += 1
                self._finish(self.cut.end)
        self._press(self._stylus.buttons if self.phase == "cutting" else self._buttons())

    def _buttons(self) -> frozenset[str]:
        return self.device.read().buttons if self._felt is not None else frozenset()

    def _press(self, buttons: frozenset[str]) -> None:
        """Act on buttons at the moment they are pressed."""
        pressed, self._held = buttons - self._held, buttons
        if "next" in pressed:
            self.go_on()
        if "repeat" in pressed:
            self.repeat()

    # One cut

    def _prepare(self, specimen_class: str | None = None) -> None:
        """Prepare the present specimen, of the chosen or repeated class."""
        if self.course is not None:
            self.course.verdicts = {}
            self.chosen_class, self.seed, self._target_length = self.course.specimen()
            task = self._given = self.course.task
            assert task is not None  # else there is no specimen
            self._task, self._feedback = self.course.ahead(), task.feedback
            self.task, self._of_task = task.task, task.of_line
        self.cut = _kind_of_cut(self.task)(
            specimen_class=specimen_class or self.chosen_class,
            seed=self.seed,
            episode=self.number,
            target_length=self._target_length,
            handle=Handle(PLAYED_HAND) if self._with_handle else None,
            tissue=self._tissue,
            **self._of_task,
        )
        self._serial += 1
        self.phase = "ready"
        self._countdown_ticks = 0
        self._stylus = Stylus(0.0, float(np.pi / 2))
        self._felt = None if self.device.coupling is None else self.device.coupling.felt()
        self._stalled = 0.0
        self._practised = False
        self._date = self._now()
        self.card = None
        self.saved = None

    def _start(self) -> None:
        self.device.open()
        self._attempts += 1
        self._practised |= self.practice
        self._date = self._now()
        self.phase = "cutting"

    def _give_up(self) -> None:
        if self.phase == "cutting":
            self._finish(GIVEN_UP)

    def _finish(self, end: str) -> None:
        self.phase = "ended"
        if self._felt is not None:
            self.device.push(0.0)
        if len(self.cut.readings) < FEWEST_READINGS:
            return
        origin = dataclasses.replace(
            self._origin,
            specimen=f"{self.cut.specimen_words}, seed {self.seed}, number {self.number}",
            date=self._date.isoformat(timespec="seconds"),
        )
        name = f"{self._date:%Y%m%dT%H%M%S}_{self.cut.specimen_class}_{self.seed}-{self.number}_{self._attempts}"
        noted = {} if self.course is None or self._given is None else self.course.facts(self._given)
        practice = self._practised or noted.pop("practice", False)
        trace = self.cut.trace(
            **origin.metadata,
            name=name,
            program=f"cutenv {cutenv.__version__}",
            specimen_class=self.cut.specimen_class,
            specimen_seed=self.seed,
            specimen_episode=self.number,
            attempt=self._attempts,
            practice=practice,
            end=end,
            success=bool(self.cut.end) and self.cut.cutting.success,
            device=type(self.device).__name__,
            hand=dataclasses.asdict(PLAYED_HAND),
            stalled_s=round(self._stalled, 3),
            **noted,
        )
        if self.folder is not None:
            self.saved = _unused(self.folder, name)
            save(trace, self.saved)
            self.records.append(self.saved)
        self.card = self.cut.card(trace)
        if self.course is not None:
            self.course.add(self.card, end, self._given)

    def _verdict(self) -> tuple[str, ...]:
        """Return what the end card says beside the score."""
        told = (self.cut.map_words,) if self.cut.map_words and self._feedback != "never" else ()
        return told if self.course is None else (*told, self.course.verdict, self.course.ahead())

    def sight(self) -> ViewState:
        """Return the state to be drawn now."""
        moment = Moment.of(self.cut.plant, self.cut.cutting)
        costs = moment.force > moment.force_allowed_per_depth * depth_below(moment.depth, moment.blade)
        shown = shown_feedback(self._feedback, ended=self.phase == "ended", costs=costs)
        missing = self.cut.missing(practice=self.practice, force_shown=shown.force)
        return ViewState(
            phase=self.phase,
            countdown=self._countdown_ticks * TICK,
            moment=moment,
            readings=self.cut.readings,
            hand=self.cut.hand,
            hand_place=self.cut.hand_place,
            lateral_force=self.cut.lateral_force,
            pose=self.cut.pose,
            missing=missing if self.phase == "cutting" else (),
            practice=self.practice,
            practised=self._practised,
            truth=self.cut.truth,
            specimen_class=self.cut.specimen_class,
            chosen_class=self.chosen_class,
            serial=self._serial,
            model=self.cut.plant.specimen.cut_model(),
            number=self.number,
            finished=self.finished,
            count=self.count,
            card=self.card,
            saved=self.saved,
            operator=self.operator,
            shown=shown,
            feedback_words=f"force: {FEEDBACK[self._feedback]}",
            task=self._task,
            done=self.done,
            verdict=self._verdict(),
            leader=self.cut.leader_words,
        )


def _unused(folder: Path, name: str) -> Path:
    """Return a path for that name without an existing file."""
    path, k = folder / f"{name}.csv", 2
    while path.exists():
        path, k = folder / f"{name}.{k}.csv", k + 1
    return path


class ListenedSession:
    """Follower of a session, called after every advance, by the listener's clock [s]."""

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


class Servo:
    """Thread that advances a session every millisecond until it is stopped.

    Python's timing is not guaranteed: another thread may delay it by some 5 ms. ``VirtualCoupling(period=0.005)``
    allows for that; the session makes up for the missed milliseconds. After a delay beyond the coupling's period the
    force begins anew from zero. The session is to be used under ``lock`` only from now on. ``longest`` is the longest
    time between two advances so far [s], which the coupling's period must cover, and ``late`` the number of those
    beyond it; :meth:`stop` raises the ``error`` that ended the thread early.
    """

    def __init__(self, session: Session, clock: Callable[[], float] = time.perf_counter) -> None:
        self.lock = threading.Lock()
        self.longest = 0.0
        self.late = 0
        self.error: Exception | None = None
        self._session, self._clock = session, clock
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="cutenv servo", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        last = self._clock()
        try:
            while not self._stopped.wait(TICK):
                now = self._clock()
                with self.lock:
                    coupling = self._session.device.coupling
                    if coupling is not None and now - last > coupling.period:
                        self.late += 1
                        self._session.forget_force()
                    self._session.advance(now)
                self.longest, last = max(self.longest, now - last), now
        except Exception as error:  # stop() raises it
            self.error = error
        finally:
            self._session.device.push(0.0)  # in any case the force ends

    def stop(self) -> None:
        """Stop and join the thread; raise its error, if any."""
        self._stopped.set()
        self._thread.join()
        if self.error is not None:
            raise self.error
