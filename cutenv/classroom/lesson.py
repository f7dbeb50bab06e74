"""One class at work: hands out specimens, repeats every cut by its own law, and keeps records that the law confirms."""

from __future__ import annotations

import dataclasses
import io
import re
import secrets
import shutil
import tempfile
import threading
import zipfile
import zlib
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv._base.output import put_in_place, whole_files
from cutenv.browser.page_alone import specimen_data
from cutenv.browser.stylus_steps import HandCut
from cutenv.classroom.analysis import Analyses
from cutenv.classroom.class_store import (
    FOREIGN,
    GOING_ON,
    KEPT,
    PREPARED,
    REFUSED,
    SAVED,
    UNFINISHED,
    ClassStore,
    CutEnd,
    HandedOutCut,
    MarkInForce,
    Place,
)
from cutenv.classroom.foreign_upload import Uploads
from cutenv.play.course import Course, CourseTask
from cutenv.play.course_progress import GIVEN_UP, CourseProgress
from cutenv.play.course_words import COURSE_WORDS
from cutenv.recording import Provenance, load_one, save
from cutenv.report.score_page import ScoredRecord, write_score_page
from cutenv.scoring import ReferenceSet, ScoreCard, score
from cutenv.scoring.reference import fitting_reference
from cutenv.scoring.score_card import whole_score
from cutenv.scoring.truth import TIP_AT_END
from cutenv.task.registry import TASKS
from cutenv.trace import Trace


def shown_card(
    card: ScoreCard, progress: CourseProgress | None, *, hidden: bool = False, mark: MarkInForce | None = None
) -> dict[str, Any]:
    """Return what the page shows of a card, whether it passes the ``mark``, and what comes next.

    Of a card that is to be ``hidden`` nothing is shown but whether it passes.
    """
    overall = None if card.overall_score is None else whole_score(card.overall_score)  # what is shown decides
    return {
        "pass_mark": None if mark is None else mark.mark,
        "passed": None if mark is None or overall is None else overall >= mark.mark,
        "score": None if hidden else overall,
        "outcome": "" if hidden else card.outcome,
        "points": [] if hidden else [dataclasses.asdict(each) for each in card.points],
        "verdict": {} if progress is None else progress.verdicts,
        "ahead": ahead_words(progress),
        "done": progress is not None and progress.task is None,
    }


def ahead_words(progress: CourseProgress | None) -> dict[str, str]:
    """Return what comes next in a course, by language; empty without a course."""
    return {} if progress is None else {language: progress.ahead(language) for language in COURSE_WORDS}


LONGEST_CUT = 30_000
"""Longest cut [ms]: the deadline of the task."""
FEWEST_MOVEMENTS = 100
"""Least number of milliseconds that makes an abandoned cut a record."""

# Facts that a record of another program may claim, and that only this server's own records may have.
_FACTS_OF_A_CONFIRMED_CUT = frozenset(("course", "task", "feedback", "crossover", "hand", "stalled_s", TIP_AT_END))


class RefusedCut(ValueError):
    """A record that the law does not confirm, or that cannot be one; the text says why."""


class Lesson:
    """A class that cuts: its store, its folder of records, and its course.

    Parameters
    ----------
    store : ClassStore
        Codes, consents and cuts.
    folder : Path
        Folder of the records, one below it for each code; created.
    course : Course, optional
        Course that everybody goes through; without one, specimens of ``specimen_class`` are drawn without end.
    specimen_class : str
        Class of specimens without a course.
    """

    def __init__(
        self, store: ClassStore, folder: Path, course: Course | None = None, specimen_class: str = "liver"
    ) -> None:
        self.store, self.folder, self.course, self.specimen_class = store, folder, course, specimen_class
        folder.mkdir(parents=True, exist_ok=True)
        self.analyses = Analyses(folder.parent / "studies", folder)
        self.uploads = Uploads()
        self._reference = ReferenceSet.shipped()
        self._progress: dict[str, tuple[int, CourseProgress]] = {}  # with the number of records that it has seen
        self._locks: dict[str, threading.Lock] = {}
        self._guard = threading.Lock()

    def close(self) -> None:
        """End what is being worked out, delete uploads that nobody kept, and close the store."""
        self.analyses.close()
        self.uploads.close()
        self.store.close()

    @property
    def course_name(self) -> str:
        """Name of the course; "" without one."""
        return "" if self.course is None else self.course.name

    @property
    def pass_mark(self) -> MarkInForce | None:
        """Pass mark in force, or None."""
        return self.store.pass_mark(self.course_name)

    def lock(self, code: str) -> threading.Lock:
        """Return the lock of a person: one cut at a time."""
        with self._guard:
            return self._locks.setdefault(code, threading.Lock())

    def progress(self, code: str) -> CourseProgress | None:
        """Return a person's progress through the course, read from the records; None without a course."""
        if self.course is None:
            return None
        there = len(whole_files((self.folder / code).glob("*.csv")))
        seen, progress = self._progress.get(code, (-1, None))
        if progress is None or seen != there:  # at first, or if another server has saved a cut
            progress = CourseProgress(self.course, code, self.folder / code)
            self._progress[code] = (there, progress)
        return progress

    def begin(self, code: str) -> dict[str, Any]:
        """Hand out the next cut: what the page needs to know; only ``ahead`` and ``done`` if the course is done."""
        with self.lock(code):
            progress = self.progress(code)
            if progress is not None and progress.task is None:
                return {"done": True, "ahead": ahead_words(progress)}
            cut = self.store.prepared(code)  # whoever loads the page again gets the same specimen
            if progress is None or progress.task is None:
                cut = cut or self.store.hand_out(code, self.specimen_class, secrets.randbelow(2**31))
                said: dict[str, Any] = {"ahead": {}, "feedback": "always"}
            else:
                cut = cut or self.store.hand_out(code, *progress.specimen(), task=progress.task.name)
                said = {"ahead": ahead_words(progress), "feedback": progress.task.feedback}
            task = self._task(code, cut)
            data = specimen_data(cut.specimen_class, cut.seed, 0, cut.target_length, task=task.task, **task.of_line)
            return data | said | {"id": cut.id, "done": False}

    def finish(self, code: str, number: str, movements: bytes, digest: str, *, stalled: float = 0.0) -> dict[str, Any]:
        """Repeat a cut by the law, and keep it if the page's readings are those of the law; return the card.

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

        Raises
        ------
        LookupError
            If no such cut was handed out to this person.
        RefusedCut
            If it has been finished before, cannot be a cut, or the law does not confirm it.
        """
        with self.lock(code):
            handed_out = self.store.cut(number, code)
            if not self._is_open(handed_out):
                raise RefusedCut(f"this cut is {handed_out.state} already.")
            try:
                cut, readings = self._repeated(handed_out, movements, digest)
            except RefusedCut as error:
                self.store.finish(number, CutEnd(state=REFUSED, reason=str(error)))
                raise
            progress = self.progress(code)
            end = cut.end or GIVEN_UP
            date = datetime.now().astimezone()
            name = _record_name(handed_out)
            origin = Provenance(
                rig="cutenv serve, simulated",
                sensor="simulated, 1 kHz",
                operator=code,
                specimen=f"{handed_out.specimen_class}, seed {handed_out.seed}, number 0",
                date=date.isoformat(timespec="seconds"),
            )
            trace = cut.trace(
                readings,
                **origin.metadata,
                **({} if progress is None else progress.metadata()),
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
                hand=dataclasses.asdict(cut.hand),
                **cut.noted,
                stalled_s=round(min(max(0.0, stalled), 3600.0), 3),  # in this order: of NaN it is 0
            )
            card = score(trace, target_length=cut.target_length, reference=self._reference)
            place = self.folder / code
            place.mkdir(exist_ok=True)
            part = place / f"{name}.{secrets.token_hex(4)}.part.csv"
            save(trace, part)
            try:  # the record of another server, which was quicker, stays
                self._note_saved(handed_out, card, end, keep=lambda: put_in_place(part, place / f"{name}.csv"))
            finally:
                part.unlink(missing_ok=True)
            hidden = progress is not None and progress.metadata()["feedback"] == "never"
            if progress is not None:
                progress.add(card, end)
                self._progress[code] = (self._progress[code][0] + 1, progress)
            return shown_card(card, progress, hidden=hidden, mark=self.pass_mark)

    def _is_open(self, cut: HandedOutCut) -> bool:
        """Return whether a cut may be finished: also the person's last one, if the server ended while it went on."""
        return cut.state in (PREPARED, GOING_ON) or (
            cut.state == UNFINISHED and self.store.cuts(cut.code)[-1].id == cut.id
        )

    def _note_saved(
        self, cut: HandedOutCut, card: ScoreCard, end: str, *, keep: Callable[[], None] = lambda: None
    ) -> None:
        record, outcome = f"{_record_name(cut)}.csv", card.outcome or end
        ended = CutEnd(state=SAVED, record=record, outcome=outcome, score=card.overall_score)
        if not self.store.finish(cut.id, ended, keep=keep):
            raise RefusedCut("this cut is finished already.")

    def recover(self) -> int:
        """Put in order what an end of the server left: return how many cuts are unfinished.

        A cut whose record was written just before is saved; every other one that went on is noted as unfinished, and
        can still be finished by a page that has gone on without the server.
        """
        for cut in self.store.cuts():
            path = self.folder / cut.code / f"{_record_name(cut)}.csv"
            if cut.state == GOING_ON and path.is_file():
                with suppress(KeyError, ValueError):  # somebody has damaged it: the cut is unfinished
                    trace, card = self._scored(path)
                    self._note_saved(cut, card, str(trace.metadata["end"]))
        return self.store.close_unfinished()

    def _repeated(self, handed_out: HandedOutCut, movements: bytes, digest: str) -> tuple[HandCut, Any]:
        task = self._task(handed_out.code, handed_out)
        kind = TASKS[task.task].hand
        numbers = len(kind.led.task.action_names)
        size = 8 * numbers
        if len(movements) % size or not FEWEST_MOVEMENTS <= len(movements) // size <= LONGEST_CUT:
            raise RefusedCut(
                f"{len(movements)} bytes are no cut: {FEWEST_MOVEMENTS} to {LONGEST_CUT} milliseconds of {size} bytes "
                "are."
            )
        stylus = np.frombuffer(movements, "<f8").reshape(-1, numbers)
        if not np.isfinite(stylus).all() or np.abs(stylus).max() > 10.0:
            raise RefusedCut("a movement of the hand is no number, or farther than any hand reaches.")
        cut = kind(
            specimen_class=handed_out.specimen_class, seed=handed_out.seed, target_length=handed_out.target_length,
            **task.of_line,
        )  # fmt: skip
        readings = cut.follow(stylus)
        if len(readings) < len(stylus):
            raise RefusedCut(f"the cut ends after {len(readings)} ms; the page sent {len(stylus)}.")
        if f"{zlib.crc32(readings.tobytes()):08x}" != digest.lower():
            raise RefusedCut("its readings are not those of the law for these movements.")
        return cut, readings

    @property
    def kinds(self) -> tuple[str, ...]:
        """Tasks that are cut in the class."""
        return ("gentle",) if self.course is None else self.course.kinds

    def _task(self, code: str, cut: HandedOutCut) -> CourseTask:
        """Return the task that a cut was handed out for; gentle cutting without a course."""
        tasks = () if self.course is None else self.course.for_operator(code).tasks
        gently = CourseTask(name="", specimen_class=cut.specimen_class)
        return next((task for task in tasks if task.name == cut.task), gently)

    def scored(self, cut: HandedOutCut) -> tuple[Trace, ScoreCard]:
        """Return the record of a saved cut and its score card; LookupError if it was not saved."""
        return self._scored(self._path(cut))

    def _scored(self, path: Path) -> tuple[Trace, ScoreCard]:
        trace = load_one(path)
        target = trace.metadata.get("target_length_m")  # a record of another program may have none
        return trace, score(trace, target_length=target, reference=fitting_reference(self._reference, trace))

    def card_page(self, code: str, number: str) -> str:
        """Return the page of a person's cut that was saved, as from ``cutenv score``; LookupError if there is none."""
        trace, card = self.scored(self.store.cut(number, code))
        target = trace.metadata.get("target_length_m")  # a record of another program may have none
        with tempfile.TemporaryDirectory() as folder, self._guard:  # one figure at a time
            page = Path(folder) / "card.html"
            write_score_page(page, ScoredRecord(trace=trace, card=card, target_length=target))
            return page.read_text(encoding="utf-8")

    def _path(self, cut: HandedOutCut) -> Path:
        if cut.state not in KEPT:
            raise LookupError(f"cut {cut.id} is {cut.state}: it has no record.")
        return self.folder / cut.code / cut.record

    def add_foreign(self, code: str, trace: Trace, target_length: float | None = None) -> str:
        """Keep a cut that another program recorded as one of a person's, scored and marked as not confirmed.

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
        name = f"{datetime.now().astimezone():%Y%m%dT%H%M%S}_foreign_{secrets.token_hex(3)}"
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
        """Return a person's cuts as the person may see them: without result where the task shows no feedback."""
        tasks = () if self.course is None else self.course.for_operator(code).tasks
        silent = {task.name for task in tasks if task.feedback == "never"}
        return [
            {"when": cut.handed_out, "state": cut.state}
            | {"outcome": "" if cut.task in silent else cut.outcome, "score": None if cut.task in silent else cut.score}
            for cut in self.store.cuts(code)
        ]

    def table(self, code: str | None = None) -> str:
        """Return the cuts of a person, or of all, as CSV."""
        header = "record,operator,class,group,task,handed_out_utc,state,confirmed_by_law,outcome,score"
        rows, places = [header], self.store.places()
        for cut in self.store.cuts(code):
            place = places.get(cut.code, Place())
            confirmed = {SAVED: "yes", FOREIGN: "no, from another program"}.get(cut.state, "no")
            person = (cut.record, cut.code, place.class_name, place.group)
            result = (cut.outcome, "" if cut.score is None else str(cut.score))
            rows.append(",".join(map(_cell, (*person, cut.task, cut.handed_out, cut.state, confirmed, *result))))
        return "\n".join(rows) + "\n"

    def records(self, code: str | None = None) -> bytes:
        """Return the records of a person, or of all, as a ZIP of CSV files, with the table of the cuts."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for cut in self.store.cuts(code):
                if cut.state in KEPT and self._path(cut).is_file():
                    archive.write(self._path(cut), f"{cut.code}/{cut.record}")
            archive.writestr("cuts.csv", self.table(code))
        return packed.getvalue()

    def delete(self, code: str) -> bool:
        """Delete all that is stored about a person; return False if there was nobody."""
        with self.lock(code):
            known = self.store.delete(code)
            self.analyses.forget(code)
            if known and re.fullmatch(r"[\w-]+", code):
                shutil.rmtree(self.folder / code, ignore_errors=True)
            self._progress.pop(code, None)
            return known


def _record_name(cut: HandedOutCut) -> str:
    """Return the name of a cut's record; it follows from the cut, so that one sent again is not kept twice."""
    handed_out = datetime.fromisoformat(cut.handed_out).astimezone()
    return f"{handed_out:%Y%m%dT%H%M%S}_{cut.specimen_class}_{cut.seed}-0_{cut.id[:6]}"


def _cell(text: str) -> str:
    """Return a cell of a CSV file that no spreadsheet takes for a formula."""
    safe = f"'{text}" if text[:1] in ("=", "+", "-", "@") else text
    return '"' + safe.replace('"', '""') + '"' if set(safe) & set(',"\n') else safe
