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
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

import cutenv
from cutenv.browser.page_alone import specimen_data
from cutenv.browser.stylus_steps import HandCut
from cutenv.classroom.class_store import GOING_ON, PREPARED, REFUSED, SAVED, UNFINISHED, ClassStore, HandedOutCut
from cutenv.plant.protocol import recorded_trace
from cutenv.play.course import Course
from cutenv.play.course_progress import GIVEN_UP, CourseProgress
from cutenv.play.course_words import COURSE_WORDS
from cutenv.recording import Provenance, load_one, save
from cutenv.report.score_page import ScoredRecord, write_score_page
from cutenv.scoring import ReferenceSet, ScoreCard, score
from cutenv.scoring.scored_cut import TIP_AT_END
from cutenv.trace import Trace

LONGEST_CUT = 30_000
"""Longest cut [ms]: the deadline of the task."""
FEWEST_MOVEMENTS = 100
"""Least number of milliseconds that makes an abandoned cut a record."""


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
        self._reference = ReferenceSet.shipped()
        self._progress: dict[str, tuple[int, CourseProgress]] = {}  # with the number of records that it has seen
        self._locks: dict[str, threading.Lock] = {}
        self._guard = threading.Lock()

    def lock(self, code: str) -> threading.Lock:
        """Return the lock of a person: one cut at a time."""
        with self._guard:
            return self._locks.setdefault(code, threading.Lock())

    def progress(self, code: str) -> CourseProgress | None:
        """Return a person's progress through the course, read from the records; None without a course."""
        if self.course is None:
            return None
        there = sum(1 for _ in (self.folder / code).glob("*.csv"))
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
            data = specimen_data(cut.specimen_class, cut.seed, 0, cut.target_length)
            return data | said | {"id": cut.id, "done": False}

    def finish(self, code: str, number: str, movements: bytes, digest: str, *, stalled: float = 0.0) -> dict[str, Any]:
        """Repeat a cut by the law, and keep it if the page's readings are those of the law; return the card.

        Parameters
        ----------
        code, number : str
            The person, and the cut that was handed out.
        movements : bytes
            Position of the hand [m] and angle of the blade [rad] of every millisecond, float64, little endian.
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
                self.store.finish(number, REFUSED, reason=str(error))
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
            trace = recorded_trace(
                readings,
                cut.measured_depth,
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
                stalled_s=round(min(max(0.0, stalled), 3600.0), 3),  # in this order: of NaN it is 0
            )
            card = score(trace, target_length=cut.target_length, reference=self._reference)
            place = self.folder / code
            place.mkdir(exist_ok=True)
            save(trace, place / f"{name}.csv")
            self._note_saved(handed_out, card, end)
            hidden = progress is not None and progress.metadata()["feedback"] == "never"
            if progress is not None:
                progress.add(card, end)
                self._progress[code] = (self._progress[code][0] + 1, progress)
            return shown_card(card, progress, hidden=hidden)

    def _is_open(self, cut: HandedOutCut) -> bool:
        """Return whether a cut may be finished: also the person's last one, if the server ended while it went on."""
        return cut.state in (PREPARED, GOING_ON) or (
            cut.state == UNFINISHED and self.store.cuts(cut.code)[-1].id == cut.id
        )

    def _note_saved(self, cut: HandedOutCut, card: ScoreCard, end: str) -> None:
        record = f"{_record_name(cut)}.csv"
        if not self.store.finish(cut.id, SAVED, record=record, outcome=card.outcome or end, score=card.overall_score):
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
        if len(movements) % 16 or not FEWEST_MOVEMENTS <= len(movements) // 16 <= LONGEST_CUT:
            raise RefusedCut(
                f"{len(movements)} bytes are no cut: {FEWEST_MOVEMENTS} to {LONGEST_CUT} milliseconds of 16 bytes are."
            )
        stylus = np.frombuffer(movements, "<f8").reshape(-1, 2)
        if not np.isfinite(stylus).all() or np.abs(stylus).max() > 10.0:
            raise RefusedCut("a movement of the hand is no number, or farther than any hand reaches.")
        cut = HandCut(
            specimen_class=handed_out.specimen_class, seed=handed_out.seed, target_length=handed_out.target_length
        )
        readings = cut.follow(stylus)
        if len(readings) < len(stylus):
            raise RefusedCut(f"the cut ends after {len(readings)} ms; the page sent {len(stylus)}.")
        if f"{zlib.crc32(readings.tobytes()):08x}" != digest.lower():
            raise RefusedCut("its readings are not those of the law for these movements.")
        return cut, readings

    def scored(self, cut: HandedOutCut) -> tuple[Trace, ScoreCard]:
        """Return the record of a saved cut and its score card; LookupError if it was not saved."""
        return self._scored(self._path(cut))

    def _scored(self, path: Path) -> tuple[Trace, ScoreCard]:
        trace = load_one(path)
        return trace, score(trace, target_length=float(trace.metadata["target_length_m"]), reference=self._reference)

    def card_page(self, code: str, number: str) -> str:
        """Return the page of a person's cut that was saved, as from ``cutenv score``; LookupError if there is none."""
        trace, card = self.scored(self.store.cut(number, code))
        target = float(trace.metadata["target_length_m"])
        with tempfile.TemporaryDirectory() as folder, self._guard:  # one figure at a time
            page = Path(folder) / "card.html"
            write_score_page(page, ScoredRecord(trace=trace, card=card, target_length=target))
            return page.read_text(encoding="utf-8")

    def _path(self, cut: HandedOutCut) -> Path:
        if cut.state != SAVED:
            raise LookupError(f"cut {cut.id} is {cut.state}: it has no record.")
        return self.folder / cut.code / cut.record

    def records(self, code: str | None = None) -> bytes:
        """Return the records of a person, or of all, as a ZIP of CSV files, with a table of the cuts."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            cuts = self.store.cuts(code)
            rows = ["record,operator,task,handed_out_utc,state,outcome,score"]
            for cut in cuts:
                score_words = "" if cut.score is None else str(cut.score)
                texts = (cut.record, cut.code, cut.task, cut.handed_out, cut.state, cut.outcome, score_words)
                rows.append(",".join(_cell(text) for text in texts))
                if cut.state == SAVED and self._path(cut).is_file():
                    archive.write(self._path(cut), f"{cut.code}/{cut.record}")
            archive.writestr("cuts.csv", "\n".join(rows) + "\n")
        return packed.getvalue()

    def delete(self, code: str) -> bool:
        """Delete all that is stored about a person; return False if there was nobody."""
        with self.lock(code):
            known = self.store.delete(code)
            if known and re.fullmatch(r"[\w-]+", code):
                shutil.rmtree(self.folder / code, ignore_errors=True)
            self._progress.pop(code, None)
            return known


def shown_card(card: ScoreCard, progress: CourseProgress | None, *, hidden: bool = False) -> dict[str, Any]:
    """Return what the page shows of a card, and what comes next; nothing of the card if it is to be ``hidden``."""
    return {
        "score": None if hidden or card.overall_score is None else round(card.overall_score),
        "outcome": "" if hidden else card.outcome,
        "points": [] if hidden else [dataclasses.asdict(each) for each in card.points],
        "verdict": {} if progress is None else progress.verdicts,
        "ahead": ahead_words(progress),
        "done": progress is not None and progress.task is None,
    }


def ahead_words(progress: CourseProgress | None) -> dict[str, str]:
    """Return what comes next in a course, by language; empty without a course."""
    return {} if progress is None else {language: progress.ahead(language) for language in COURSE_WORDS}


def _record_name(cut: HandedOutCut) -> str:
    """Return the name of a cut's record; it follows from the cut, so that one sent again is not kept twice."""
    handed_out = datetime.fromisoformat(cut.handed_out).astimezone()
    return f"{handed_out:%Y%m%dT%H%M%S}_{cut.specimen_class}_{cut.seed}-0_{cut.id[:6]}"


def _cell(text: str) -> str:
    """Return a cell of a CSV file that no spreadsheet takes for a formula."""
    safe = f"'{text}" if text[:1] in ("=", "+", "-", "@") else text
    return '"' + safe.replace('"', '""') + '"' if set(safe) & set(',"\n') else safe
