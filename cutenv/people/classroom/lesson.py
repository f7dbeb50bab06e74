"""One class at work: hands out specimens, and keeps cuts that its law confirms."""

from __future__ import annotations

import dataclasses
import hashlib
import io
import re
import secrets
import shutil
import tempfile
import threading
import time
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv._base.arrays import Array
from cutenv._base.language_files import languages
from cutenv._base.output import put_in_place
from cutenv.display.report.page import in_languages
from cutenv.display.report.score_page import ScoredRecord, write_score_page
from cutenv.envs.tissue_source import TissueSource
from cutenv.people.browser.page_data import specimen_data
from cutenv.people.browser.stylus_steps import HandCut
from cutenv.people.browser.watched_cut import (
    MOVEMENTS,
    expert_way,
    from_runs,
    in_runs,
    kind_of_expert,
    shown_cut,
    way_of,
)
from cutenv.people.classroom.analysis import Analyses
from cutenv.people.classroom.class_courses import ClassCourses
from cutenv.people.classroom.class_store import (
    ClassStore,
    CutEnd,
    HandedOutCut,
    MarkInForce,
    NewCut,
    Place,
    SeenMovements,
)
from cutenv.people.classroom.class_tables import (
    FOREIGN,
    GOING_ON,
    KEPT,
    LEFT,
    OPEN,
    PREPARED,
    REFUSED,
    SAVED,
    TAKEN_BACK,
    UNFINISHED,
)
from cutenv.people.classroom.foreign_upload import Uploads
from cutenv.people.play.course import WARM_UP, Course, CourseTask, marked_numbers
from cutenv.people.play.course_progress import GIVEN_UP, CourseProgress
from cutenv.records import Provenance, load_one, save
from cutenv.records.csv_file import read_metadata
from cutenv.records.scoring import ReferenceSet, ScoreCard, score
from cutenv.records.scoring.reference import fitting_reference
from cutenv.records.scoring.score_card import whole_score
from cutenv.records.scoring.study.learning import next_tries
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.trace import Trace
from cutenv.task.registry import TASKS


def shown_card(
    card: ScoreCard, progress: CourseProgress | None, *, hidden: bool = False, mark: MarkInForce | None = None
) -> dict[str, Any]:
    """Return a score card's content for the page, with pass and progress.

    Of a card that is to be ``hidden`` nothing is shown but whether it passes.
    """
    overall = None if card.overall_score is None else whole_score(card.overall_score)  # what is shown decides
    return {
        "pass_mark": None if mark is None else mark.mark,
        "passed": None if mark is None or overall is None else overall >= mark.mark,
        "score": None if hidden else overall,
        "outcome": {} if hidden else in_languages(card.outcome),
        "why": {} if hidden or not card.no_score else in_languages(f"{_capital(card.no_score)}."),
        "advice": [] if hidden else _advice(card),
        "numbers": {} if hidden else {k: v for k, v in marked_numbers(card).items() if k in _CARD_NUMBERS},
        "points": [] if hidden else [dataclasses.asdict(each) for each in card.points],
        "verdict": {} if progress is None else progress.verdicts,
        "ahead": ahead_words(progress),
        "done": progress is not None and (progress.task is None or progress.waits),
    }


def _advice(card: ScoreCard) -> list[dict[str, dict[str, str]]]:
    """Return next advice, and the fault seen or "", by language."""
    return [
        {"try": in_languages(f"{_capital(each.advice)}."), "seen": in_languages(_capital(each.seen))}
        for each in next_tries([card])[:_MOST_ADVICE]
    ]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def name_of(course: Course | None) -> str:
    """Return a course's name, the key of its pass mark; "" without."""
    return "" if course is None else course.name


def ahead_words(progress: CourseProgress | None) -> dict[str, str]:
    """Return a course's next task by language; empty without a course."""
    return {} if progress is None else {language: progress.ahead(language) for language in languages()}


_MOST_ADVICE = 2  # a person attends to no more in the next cut
_CARD_NUMBERS = ("peak_force", "largest_jump", "duration")  # as on the teacher's card of the same cut
LONGEST_CUT = 30_000
"""Longest cut [ms]: the deadline of the task."""
DEVICE_AIDS = frozenset(("sound", "vibration", "pen", "serial"))
"""Aids that a person may choose in the page: what tells the force besides the picture, and what else leads the hand."""
FEWEST_MOVEMENTS = 100
"""Least number of milliseconds that makes an abandoned cut a record."""
_OWN_WAY = 0.01  # m that a hand has to go before nobody else's goes the same way bit for bit
_LEFTOVER = 60.0  # s after which a part of a record belongs to a server that was killed

# Facts that a record of another program may claim, and that only this server's own records may have.
_FACTS_OF_A_CONFIRMED_CUT = {"course", "task", "feedback", "crossover", "hand", "device_aids", "stalled_s"}
_FACTS_OF_A_CONFIRMED_CUT |= {"movements_sha256", MOVEMENTS, TIP_AT_END}

_CLOSED = {
    LEFT: "this cut was left, and so given up, when the next one was handed out.",
    TAKEN_BACK: "this cut was handed out for a task that is served no more. Load the page again.",
}


class RefusedCut(ValueError):
    """Record that the law does not confirm, or that is invalid."""


class Lesson:
    """Class that cuts: its store, records and course.

    Parameters
    ----------
    store : ClassStore
        Codes, consents and cuts.
    folder : Path
        Folder of the records, one below it for each code; created.
    course : Course, optional
        Course that everybody goes through to whom no other is given; without one, specimens of ``specimen_class`` are
        drawn without end.
    specimen_class : str
        Class of specimens without a course.
    tissue : str or Path, optional
        File of the tissue that all specimens are of, a course's too; default: the measured pig liver.
    """

    def __init__(
        self,
        store: ClassStore,
        folder: Path,
        course: Course | None = None,
        specimen_class: str = "liver",
        tissue: str | Path | None = None,
    ) -> None:
        self.store, self.folder, self.specimen_class = store, folder, specimen_class
        self.tissue = tissue
        self._of_tissue = () if tissue is None else (TissueSource(tissue).description.to_json(),)
        folder.mkdir(parents=True, exist_ok=True)
        self.courses = ClassCourses(folder.parent, course)
        self.analyses = Analyses(folder.parent / "studies", folder)
        self.uploads = Uploads()
        self._reference = ReferenceSet.shipped()
        self._locks: dict[str, threading.Lock] = {}
        self._guard = threading.Lock()

    def close(self) -> None:
        """Stop analyses, delete unkept uploads, and close the store."""
        self.analyses.close()
        self.uploads.close()
        self.store.close()

    @property
    def course(self) -> Course | None:
        """Present course of everybody without another one, or None."""
        return self.courses.main

    def course_of(self, code: str, place: Place | None = None) -> Course | None:
        """Return the course of a person, whose place may be given, or None."""
        where = self.store.places(code).get(code, Place()) if place is None else place
        return self.courses.of(where.course)

    def mark_of(self, code: str) -> MarkInForce | None:
        """Return a person's pass mark in force, or None."""
        return self.store.pass_mark(name_of(self.course_of(code)))

    def put(self, codes: Sequence[str], **places: str) -> None:
        """Put people into places of the store; check the course."""
        key = places.get("course")
        if key and key not in self.courses.further():
            raise ValueError(f"there is no course {key!r} in this class. Choose one of those on the page.")
        self.store.put(codes, **places)

    def drop_course(self, key: str) -> None:
        """Delete a further course, whose people go on in the class's; "" restores the starting one."""
        if key:
            self.store.put([code for code, place in self.store.places().items() if place.course == key], course="")
        self.courses.drop(key)

    def lock(self, code: str) -> threading.Lock:
        """Return the lock of a person: one cut at a time."""
        with self._guard:
            return self._locks.setdefault(code, threading.Lock())

    def progress(
        self, code: str, cuts: Iterable[HandedOutCut] | None = None, place: Place | None = None
    ) -> CourseProgress | None:
        """Return a person's progress through the person's course; None without one.

        It is counted from the cuts in the database.  A cut that was left or refused counts as given up.  Records that
        cannot be read, of cuts that an earlier version saved without their numbers, stand in ``unread``: they are read
        again the next time.
        """
        course = self.course_of(code, place)
        if course is None:
            return None
        progress = CourseProgress(course, code, clock=self.store.clock)
        for cut in self.store.cuts(code) if cuts is None else cuts:
            known = cut
            if cut.state == SAVED and cut.numbers is None:
                try:
                    known = self._noted(cut)
                except (OSError, KeyError, ValueError) as error:
                    progress.unread.append(f"{cut.record}: {error}")
                    continue
            if known.course != course.name or known.task not in (WARM_UP, *(task.name for task in course.tasks)):
                continue
            if known.task == WARM_UP and known.state in (SAVED, LEFT, REFUSED):
                progress.skip(WARM_UP)
            elif known.task == WARM_UP:
                continue
            elif known.state == UNFINISHED:
                progress.skip(known.task)
            elif known.state in (SAVED, LEFT, REFUSED):
                progress.count(known.task, known.numbers or {}, known.ended if known.state == SAVED else GIVEN_UP)
        return progress

    def _noted(self, cut: HandedOutCut) -> HandedOutCut:
        """Note a saved cut's results from its record, if still missing."""
        trace, card = self.scored(cut)
        end, course = str(trace.metadata["end"]), str(trace.metadata.get("course", ""))
        self.store.note(cut.id, CutEnd(state=SAVED, ended=end, numbers=marked_numbers(card)), course)
        return cut._replace(numbers=marked_numbers(card), ended=end, course=course)

    def begin(self, code: str) -> dict[str, Any]:
        """Hand out the next cut as page data.

        If the course is done, it has ``ahead`` and ``done`` only. Raises OSError if it is not known how far the person
        is, because a record cannot be read now.
        """
        with self.lock(code):
            cut = self.store.hand_out(code, lambda cuts: self._next(code, cuts))
            course, progress = self.course_of(code), self.progress(code)
            ahead = ahead_words(progress)
            if cut is None:
                return {"done": True, "ahead": ahead}
            task = self._task(code, cut)
            assert task is not None  # it was handed out by the present course
            data = specimen_data(
                cut.specimen_class, cut.seed, 0, cut.target_length, task=task.task, tissue=self.tissue, **task.of_line
            )
            shown = bool(course is not None and course.demonstration and progress is not None and progress.fresh)
            return data | {
                "ahead": ahead, "feedback": task.feedback, "id": cut.id, "done": False, "demonstration": shown,
            }  # fmt: skip

    def _next(self, code: str, cuts: Sequence[HandedOutCut]) -> NewCut | None:
        """Return the next cut to hand out; None after the course."""
        progress = self.progress(code, cuts)
        if progress is None:
            free = CourseTask(name="", specimen_class=self.specimen_class)
            return NewCut(self.specimen_class, secrets.randbelow(2**31), terms=self._terms("", free))
        if progress.unread:
            raise OSError(f"a record of yours cannot be read ({progress.unread[0]}). Tell your teacher")
        task = progress.task
        if task is None or progress.waits:
            return None
        course = progress.course.name
        return NewCut(*progress.specimen(), course, task.name, self._terms(course, task))

    def finish(
        self, code: str, number: str, movements: bytes, digest: str, *, stalled: float = 0.0, aids: Iterable[str] = ()
    ) -> dict[str, Any]:
        """Repeat a cut by the law, keep it if confirmed, return its card.

        Parameters
        ----------
        code, number : str
            The person, and the cut that was handed out.
        movements : bytes
            Position of the hand [m] and angle of the blade [rad] of every millisecond, and where a depth is wanted the
            level of the blade above that at the start, along a line the place across [m]; float64, little endian.
        digest : str
            CRC-32 of the page's readings as they lie in memory, in 8 hexadecimal digits. It need not withstand forgery:
            what is kept are the readings that the law finds here.
        stalled : float
            Time lost by the page [s].
        aids : iterable of str
            Which of :data:`DEVICE_AIDS` were on; others are ignored.

        Raises
        ------
        LookupError
            If no such cut was handed out to this person.
        RefusedCut
            If it has been finished before, cannot be a cut, the law does not confirm it, or no hand can have made it.
        """
        with self.lock(code):
            handed_out = self.store.cut(number, code)
            if not self._is_open(handed_out):
                raise RefusedCut(_CLOSED.get(handed_out.state, f"this cut is {handed_out.state} already."))
            task = self._task(code, handed_out)
            if task is None:
                self.store.finish(number, CutEnd(state=TAKEN_BACK, reason="its task is served no more"))
                raise RefusedCut(_CLOSED[TAKEN_BACK])
            stalled = min(max(0.0, stalled), 3600.0)  # in this order: of NaN it is 0
            try:
                self._check_time(handed_out, movements, task)
                cut, readings = self._repeated(handed_out, task, movements, digest)
            except RefusedCut as error:
                self.store.finish(number, CutEnd(state=REFUSED, reason=str(error), stalled=stalled))
                raise
            progress = self.progress(code)  # without this cut
            end = cut.end or GIVEN_UP
            seen = _digest_of(movements, task)
            date = self.store.clock().astimezone()
            name = _record_name(handed_out)
            origin = Provenance(
                rig="cutenv serve, simulated",
                sensor="simulated, 1 kHz",
                operator=code,
                specimen=f"{cut.specimen_words}, seed {handed_out.seed}, number 0",
                date=date.isoformat(timespec="seconds"),
            )
            trace = cut.trace(
                readings,
                **origin.metadata,
                **({} if progress is None else progress.facts(task)),
                name=name,
                program=f"cutenv {cutenv.__version__}",
                specimen_class=handed_out.specimen_class,
                specimen_seed=handed_out.seed,
                specimen_episode=0,
                target_length_m=cut.target_length,
                **{TIP_AT_END: round(float(readings["tip"][-1]), 6)},
                end=end,
                success=cut.success,
                device="browser",
                **({"device_aids": used} if (used := sorted(DEVICE_AIDS & set(aids))) else {}),
                hand=dataclasses.asdict(cut.hand),
                **cut.noted,
                stalled_s=round(stalled, 3),
                **({} if seen is None else {"movements_sha256": seen}),
                **{MOVEMENTS: in_runs(_rows(movements, task))},
            )
            card = score(trace, target_length=cut.target_length, reference=self._reference)
            place = self.folder / code
            place.mkdir(exist_ok=True)
            _sweep(place)
            part = place / f"{name}.{secrets.token_hex(4)}.part.csv"
            try:  # the record of another server, which was quicker, stays
                save(trace, part)
                self._note_saved(handed_out, trace, card, keep=lambda: put_in_place(part, place / f"{name}.csv"))
            except SeenMovements as error:
                self.store.finish(number, CutEnd(state=REFUSED, reason=str(error), stalled=stalled))
                raise RefusedCut(str(error)) from None
            finally:
                part.unlink(missing_ok=True)
            if progress is not None:
                progress.add(card, end, task)
            return shown_card(
                card,
                progress,
                hidden=task.feedback == "never",
                mark=None if task.name == WARM_UP else self.mark_of(code),
            )

    def _is_open(self, cut: HandedOutCut) -> bool:
        """Return whether a cut may be finished, also after a server restart."""
        return cut.state in OPEN

    def _check_time(self, cut: HandedOutCut, movements: bytes, task: CourseTask) -> None:
        """Raise RefusedCut for a cut not begun, or finished too soon."""
        if cut.state == PREPARED:
            raise RefusedCut("it was never begun.")
        took = (self.store.clock() - datetime.fromisoformat(cut.begun)).total_seconds()
        lasts = len(movements) / _movement_size(task) / 1e3
        if 0.0 <= took < lasts:  # less than nothing: the clock was set back
            raise RefusedCut(f"it lasts {lasts:.1f} s, and was sent {took:.1f} s after it had begun.")

    def _note_saved(
        self, cut: HandedOutCut, trace: Trace, card: ScoreCard, *, keep: Callable[[], None] = lambda: None
    ) -> None:
        facts = trace.metadata
        end = str(facts["end"])
        ended = CutEnd(
            state=SAVED, record=f"{_record_name(cut)}.csv", outcome=card.outcome or end, score=card.overall_score,
            ended=end, numbers=marked_numbers(card), movements=facts.get("movements_sha256"),
            stalled=float(facts.get("stalled_s", 0.0)),
        )  # fmt: skip
        if not self.store.finish(cut.id, ended, keep=keep):
            raise RefusedCut("this cut is finished already.")

    def recover(self) -> int:
        """Tidy up after a server's end; return how many cuts broke off.

        A cut whose record was written just before is saved; every other one that went on is noted as broken off, and
        can still be finished by a page that has gone on without the server.  Parts of records are deleted.
        """
        for cut in self.store.cuts():
            path = self.folder / cut.code / f"{_record_name(cut)}.csv"
            if cut.state == GOING_ON and path.is_file():
                with suppress(KeyError, ValueError):  # somebody has damaged it: the cut is broken off
                    self._note_saved(cut, *self._scored(path))
        for place in self.folder.glob("*/"):
            _sweep(place)
        return self.store.break_off()

    def _repeated(
        self, handed_out: HandedOutCut, task: CourseTask, movements: bytes, digest: str
    ) -> tuple[HandCut, Any]:
        kind, size = TASKS[task.task].hand, _movement_size(task)
        if len(movements) % size or not FEWEST_MOVEMENTS <= len(movements) // size <= LONGEST_CUT:
            raise RefusedCut(
                f"{len(movements)} bytes are no cut: {FEWEST_MOVEMENTS} to {LONGEST_CUT} milliseconds of {size} bytes "
                "are."
            )
        stylus = _rows(movements, task)
        if not np.isfinite(stylus).all() or np.abs(stylus).max() > 10.0:
            raise RefusedCut("a movement of the hand is no number, or farther than any hand reaches.")
        cut = kind(**_key(handed_out), **task.of_line, tissue=self.tissue)
        readings = cut.follow(stylus)
        if len(readings) < len(stylus):
            raise RefusedCut(f"the cut ends after {len(readings)} ms; the page sent {len(stylus)}.")
        if f"{zlib.crc32(readings.tobytes()):08x}" != digest.lower():
            raise RefusedCut("its readings are not those of the law for these movements.")
        return cut, readings

    def replay(self, code: str, number: str) -> dict[str, Any]:
        """Return a saved cut for replay: specimen, movements and expert's way.

        The expert is a cut of the same specimen that the teacher has chosen, "example", or else the one that the task
        names, the "planner" or an "agent". Raises LookupError if there is no such cut, it has no movements, or its task
        hides the force. Raises OSError or ValueError if its record cannot be read.
        """
        cut = self.store.cut(number, code)
        task = self._task_once(code, cut)
        if cut.state != SAVED or task is None or task.feedback == "never":
            raise LookupError("this cut is not shown again.")
        example = next((each for each in self.store.cuts() if each.example and _same_specimen(each, cut)), None)
        expert = None
        if example is not None and example.id != number:
            with suppress(OSError, LookupError, ValueError):  # its record is damaged: another takes its place
                expert = self._way(example, task)
        movements = in_runs(self._movements(cut))
        by = kind_of_expert(task.expert) if expert is None else "example"
        kind, seed, target = cut.specimen_class, cut.seed, cut.target_length
        key: dict[str, Any] = {"task": task.task, "tissue": self.tissue, **task.of_line}
        if expert is None:
            expert = expert_way(kind, seed, 0, target, **key, expert=task.expert)
        specimen = specimen_data(kind, seed, 0, target, **key)
        return {"specimen": specimen, "movements": movements, "expert": expert, "by": by}

    def demonstration(self, code: str) -> dict[str, Any]:
        """Return a course's demonstration as :meth:`replay`; LookupError without."""
        course = self.course_of(code)
        if course is None or not course.demonstration:
            raise LookupError("there is no demonstration.")
        task = course.for_operator(code).tasks[0]
        key: dict[str, Any] = {"task": task.task, "tissue": self.tissue, **task.of_line}
        kind, target = task.specimen_class, task.target_length
        with self._guard:  # some seconds of work, once
            seed, movements = shown_cut(kind, target, **key)
            expert = expert_way(kind, seed, 0, target, **key, expert=task.expert)
        specimen = specimen_data(kind, seed, 0, target, **key)
        return {"specimen": specimen, "movements": movements, "expert": expert, "by": kind_of_expert(task.expert)}

    def _movements(self, cut: HandedOutCut) -> Array:
        """Return a saved cut's movements, shape (n, k); LookupError if not kept."""
        runs = read_metadata(self._path(cut)).get(MOVEMENTS)
        if runs is None:
            raise LookupError("this cut was kept without the movements of the hand.")
        return from_runs(runs)

    def _way(self, cut: HandedOutCut, task: CourseTask) -> dict[str, list[float]]:
        made = TASKS[task.task].hand(**_key(cut), **task.of_line, tissue=self.tissue)
        readings = made.follow(self._movements(cut))
        return way_of(readings, dict(zip(made.channel_fields, made.channels, strict=True)))

    def courses_open_to(self, class_name: str) -> list[Course]:
        """Return the common course, then further ones given in a class."""
        keys = {place.course for place in self.store.places().values() if place.class_name == class_name}
        main = [] if self.course is None else [self.course]
        return main + [course for key, course in self.courses.further().items() if key in keys]

    @property
    def kinds(self) -> tuple[str, ...]:
        """Tasks that are cut in the class."""
        found = [kind for course in self.courses.all() for kind in course.kinds]
        return tuple(dict.fromkeys(found if self.course is not None else ["gentle", *found]))

    def _task(self, code: str, cut: HandedOutCut) -> CourseTask | None:
        """Return the task a cut was handed out for, gentle without a course, or None."""
        return self._task_in(self.course_of(code), code, cut)

    def _task_in(self, course: Course | None, code: str, cut: HandedOutCut) -> CourseTask | None:
        if course is None:
            tasks: Sequence[CourseTask] = (CourseTask(name="", specimen_class=cut.specimen_class),)
        else:
            tasks = (course.warm_up_task, *course.for_operator(code).tasks)
        return next((task for task in tasks if self._terms(name_of(course), task) == cut.terms), None)

    def _task_once(self, code: str, cut: HandedOutCut) -> CourseTask | None:
        """Return a cut's task in any course of the class, or None."""
        courses = [*self.courses.all(), *([] if cut.course else [None])]
        return next(filter(None, (self._task_in(course, code, cut) for course in courses)), None)

    def _terms(self, course: str, task: CourseTask) -> str:
        """Return a digest of what defines a task's cuts.

        Mark, repetitions and feedback are not in it: they may change while people cut.
        """
        defined = (course, task.name, task.task, task.line, task.specimen_class, task.seeds, task.target_length)
        return hashlib.sha256(repr(defined + self._of_tissue).encode()).hexdigest()[:32]

    def scored(self, cut: HandedOutCut) -> tuple[Trace, ScoreCard]:
        """Return a saved cut's record and score card; LookupError if unsaved."""
        return self._scored(self._path(cut))

    def _scored(self, path: Path) -> tuple[Trace, ScoreCard]:
        trace = load_one(path)
        target = trace.metadata.get("target_length_m")  # a record of another program may have none
        return trace, score(trace, target_length=target, reference=fitting_reference(self._reference, trace))

    def card_page(self, code: str, number: str, language: str = "en") -> str:
        """Return a saved cut's page as ``cutenv score``'s; LookupError if none."""
        trace, card = self.scored(self.store.cut(number, code))
        target = trace.metadata.get("target_length_m")  # a record of another program may have none
        with tempfile.TemporaryDirectory() as folder, self._guard:  # one figure at a time
            page = Path(folder) / "card.html"
            write_score_page(page, ScoredRecord(trace=trace, card=card, target_length=target), language=language)
            return page.read_text(encoding="utf-8")

    def _path(self, cut: HandedOutCut) -> Path:
        if cut.state not in KEPT:
            raise LookupError(f"cut {cut.id} is {cut.state}: it has no record.")
        if Path(cut.record).name != cut.record:
            raise LookupError(f"cut {cut.id} has no record in the folder of its person.")
        return self.folder / cut.code / cut.record

    def add_foreign(self, code: str, trace: Trace, target_length: float | None = None) -> str:
        """Save another program's cut for a person, scored but unconfirmed.

        Parameters
        ----------
        code : str
            The person.
        trace : Trace
            The record, whose person agreed to its being kept.
        target_length : float, optional
            Length aimed at [m].

        Returns
        -------
        str
            Number of the cut.

        Raises
        ------
        LookupError
            If there is no such person.
        TypeError, ValueError
            If the record cannot be scored or kept.
        """
        if not self.store.knows(code):
            raise LookupError("There is no such code.")
        facts = {key: value for key, value in trace.metadata.items() if key not in _FACTS_OF_A_CONFIRMED_CUT}
        facts |= {} if target_length is None else {"target_length_m": target_length}
        name = f"{self.store.clock().astimezone():%Y%m%dT%H%M%S}_foreign_{secrets.token_hex(3)}"
        facts |= {"name": name, "operator": code, "consent": True, "confirmed_by_law": False}
        kept = trace.with_metadata(facts)
        card = score(kept, target_length=target_length, reference=fitting_reference(self._reference, kept))
        with self.lock(code):
            place = self.folder / code
            place.mkdir(exist_ok=True)
            save(kept, place / f"{name}.csv")
            end = CutEnd(
                state=FOREIGN, record=f"{name}.csv", outcome=card.outcome, score=card.overall_score,
                reason=card.no_score,
            )  # fmt: skip
            return self.store.add_foreign(code, end)

    def history(self, code: str) -> list[dict[str, Any]]:
        """Return a person's cuts, without results where feedback is off."""
        silent = {
            (name, task.name)
            for course in self.courses.all()
            for task in course.for_operator(code).tasks
            for name in (course.name, "")  # an earlier version noted no course
            if task.feedback == "never"
        }
        cuts = [(cut, (cut.course, cut.task) in silent) for cut in self.store.cuts(code)]
        return [
            {"id": cut.id, "when": cut.handed_out, "state": cut.state, "stalled": cut.stalled}
            | {"warm_up": cut.task == WARM_UP}
            | {"replay": cut.state == SAVED and not hidden and self._task_once(code, cut) is not None}
            | {"outcome": {} if hidden else in_languages(cut.outcome)}
            | {"score": None if hidden else cut.score}
            for cut, hidden in cuts
        ]

    def table(self, code: str | None = None) -> str:
        """Return the cuts of a person, or of all, as CSV."""
        header = "record,operator,class,group,task,handed_out_utc,state,confirmed_by_law,outcome,score,stalled_s,reason"
        rows, places = [header], self.store.places()
        for cut in self.store.cuts(code):
            place = places.get(cut.code, Place())
            confirmed = {SAVED: "yes", FOREIGN: "no, from another program"}.get(cut.state, "no")
            person = (cut.record, cut.code, place.class_name, place.group)
            result = (cut.outcome, "" if cut.score is None else str(cut.score), f"{cut.stalled:g}", cut.reason)
            rows.append(",".join(map(_cell, (*person, cut.task, cut.handed_out, cut.state, confirmed, *result))))
        return "\n".join(rows) + "\n"

    def records(self, code: str | None = None) -> bytes:
        """Return records of one person or all, with their table, as ZIP of CSV files."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for cut in self.store.cuts(code):
                if cut.state in KEPT and self._path(cut).is_file():
                    archive.write(self._path(cut), f"{cut.code}/{cut.record}")
            archive.writestr("cuts.csv", self.table(code))
        return packed.getvalue()

    def delete(self, code: str) -> bool:
        """Delete all data about a person; return False if unknown."""
        with self.lock(code):
            known = self.store.delete(code)
            self.analyses.forget(code)
            if known and re.fullmatch(r"[\w-]+", code):
                shutil.rmtree(self.folder / code, ignore_errors=True)
            return known


def _record_name(cut: HandedOutCut) -> str:
    """Return a cut's record name, derived from the cut against duplicates."""
    handed_out = datetime.fromisoformat(cut.handed_out).astimezone()
    return f"{handed_out:%Y%m%dT%H%M%S}_{cut.specimen_class}_{cut.seed}-0_{cut.id[:6]}"


def _key(cut: HandedOutCut) -> dict[str, Any]:
    return {"specimen_class": cut.specimen_class, "seed": cut.seed, "target_length": cut.target_length}


def _same_specimen(one: HandedOutCut, other: HandedOutCut) -> bool:
    return (*_key(one).values(), one.terms) == (*_key(other).values(), other.terms)


def _rows(movements: bytes, task: CourseTask) -> Array:
    return np.frombuffer(movements, "<f8").reshape(-1, _movement_size(task) // 8)


def _movement_size(task: CourseTask) -> int:
    return 8 * len(TASKS[task.task].hand.led.task.action_names)


def _digest_of(movements: bytes, task: CourseTask) -> str | None:
    """Return the SHA-256 of movements; None for a hand nearly at rest."""
    return hashlib.sha256(movements).hexdigest() if np.ptp(_rows(movements, task)[:, 0]) > _OWN_WAY else None


def _sweep(place: Path) -> None:
    """Delete partial records that a killed server left for a person."""
    for part in place.glob("*.part.csv"):
        with suppress(OSError):  # its server is done with it
            if part.stat().st_mtime < time.time() - _LEFTOVER:
                part.unlink()


def _cell(text: str) -> str:
    """Return a CSV cell that spreadsheets do not take for a formula."""
    safe = f"'{text}" if text[:1] in ("=", "+", "-", "@") else text
    return '"' + safe.replace('"', '""') + '"' if set(safe) & set(',"\n') else safe
