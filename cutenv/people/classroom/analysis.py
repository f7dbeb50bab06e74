"""Studies and pass marks of a class, run one by one in processes.

A study takes many seconds of processor time.  In a process of its own, and of low priority, it keeps nobody's cut
waiting, and its pages are those of ``cutenv study`` and ``cutenv pass-mark``.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
import re
import secrets
import shutil
import subprocess
import sys
import threading
import time
import zipfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple

from cutenv.display.report.page import write_table

STUDY_KIND, PASS_MARK_KIND = "study", "pass-mark"
_PROGRAM = """
import json, os, sys
if hasattr(os, "nice"):
    os.nice(10)
from cutenv.commands.cli import main
sys.exit(main(json.load(sys.stdin)))
"""
_MAX_DURATION = 3600.0  # s
_LEFT = 24 * 3600.0  # s after which a folder belongs to a server that was killed
_TABLE, _SAID, _TROUBLE = "people.csv", "said.txt", "trouble.txt"
_SHOWN = (".html", ".csv", ".json")


class StudiedRecord(NamedTuple):
    """Relative path of a record, "" of a cut that was left; person; group or ""."""

    record: str
    code: str
    group: str


@dataclass(kw_only=True)
class Analysis:
    """One study or setting of pass marks, with its pages."""

    kind: str
    title: str
    people: tuple[str, ...]
    folder: Path
    began: str = field(default_factory=lambda: datetime.now().astimezone().isoformat(timespec="seconds"))
    state: str = "waiting"
    """"waiting", "working", "done" or "failed"."""

    @property
    def id(self) -> str:
        """Name of its folder."""
        return self.folder.name

    def files(self) -> dict[str, Path]:
        """Return its pages and tables by name, once it is done."""
        found = sorted(self.folder.iterdir()) if self.state == "done" else []
        return {path.name: path for path in found if path.suffix in _SHOWN}

    def packed(self) -> bytes:
        """Return its pages and tables as a ZIP."""
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, path in self.files().items():
                archive.write(path, name)
        return packed.getvalue()

    def progress(self) -> tuple[str, int] | None:
        """Return the stage ("reading", "scoring", "drawing") and progress [%], or None."""
        last = self._text(_TROUBLE).replace("\r", "\n").strip().rpartition("\n")[2]
        found = re.match(r"(\w+):\s+(\d+)%", last)
        return None if found is None else (found[1], int(found[2]))

    def said(self) -> str:
        """Return what the command printed, or why it failed."""
        if self.state != "failed":
            return self._text(_SAID).replace(f"{self.folder}{os.sep}", "")
        lines = [line for line in re.split(r"[\r\n]+", self._text(_TROUBLE)) if line.strip() and "%|" not in line]
        whole = "\n".join(lines)
        return whole.partition(f"cutenv {self.kind}: ")[2].replace(f"{self.folder}{os.sep}", "") or whole

    def marks(self) -> Mapping[str, Any]:
        """Return pass marks of the overall score by method, {} without."""
        path = self.files().get(f"{PASS_MARK_KIND}.json")
        metrics = {} if path is None else json.loads(path.read_text(encoding="utf-8"))["metrics"]
        marks: Mapping[str, Any] = metrics.get("overall_score", {}).get("marks", {})
        return marks

    def _text(self, name: str) -> str:
        path = self.folder / name
        return path.read_text(encoding="utf-8", errors="replace") if path.is_file() else ""


class Analyses:
    """Analyses of one class, kept until the server ends."""

    def __init__(self, folder: Path, records: Path) -> None:
        self._folder, self._records = folder.resolve(), records.resolve()
        self._made: dict[str, Analysis] = {}
        self._worker = ThreadPoolExecutor(1)
        self._process: tuple[str, subprocess.Popen[str]] | None = None
        self._guard = threading.Lock()

    def all(self) -> list[Analysis]:
        """Return all, the latest first."""
        return list(self._made.values())[::-1]

    def find(self, number: str) -> Analysis:
        """Return one by its id; LookupError if there is none."""
        try:
            return self._made[number]
        except KeyError:
            raise LookupError("There is no such study; it is gone when the server ends. Make it again.") from None

    def start(self, kind: str, title: str, rows: Sequence[StudiedRecord], options: Sequence[str] = ()) -> Analysis:
        """Begin an analysis of ordered rows, or line it up behind the present one."""
        self._sweep()
        made = Analysis(
            kind=kind,
            title=title,
            people=tuple(dict.fromkeys(row.code for row in rows)),
            folder=self._folder / secrets.token_urlsafe(9),
        )
        made.folder.mkdir(parents=True)
        grouped = any(row.group for row in rows)
        cells = [
            (Path(row.record).name, row.code, order, *([row.group or "none"] * grouped))
            for order, row in enumerate(rows, 1)
        ]
        write_table(made.folder / _TABLE, [("record", "operator", "order", *(["group"] * grouped)), *cells])
        paths = [str(self._records / row.record) for row in rows if row.record]
        arguments = [kind, *paths, f"--name={title}", "--skip-bad"]
        arguments += ["--operators", str(made.folder / _TABLE), "--out", str(made.folder / f"{kind}.html"), *options]
        if kind == STUDY_KIND:
            arguments += ["--sheets", str(made.folder)]
        self._made[made.id] = made
        self._worker.submit(self._run, made, arguments)
        return made

    def drop(self, number: str) -> None:
        """Stop an analysis if running and delete its pages, if any."""
        with self._guard:
            made = self._made.pop(number, None)
            if self._process is not None and self._process[0] == number:
                self._process[1].kill()
        if made is not None:
            shutil.rmtree(made.folder, ignore_errors=True)

    def forget(self, code: str) -> None:
        """Delete every analysis that includes a person, also of other servers."""
        for made in self.all():
            if code in made.people:
                self.drop(made.id)
        for table in self._folder.glob(f"*/{_TABLE}"):
            with table.open(newline="", encoding="utf-8") as file:
                mine = any(row["operator"] == code for row in csv.DictReader(file))
            if mine:
                shutil.rmtree(table.parent, ignore_errors=True)

    def close(self) -> None:
        """End what is at work, and delete all pages."""
        for made in self.all():
            self.drop(made.id)
        self._worker.shutdown(cancel_futures=True)
        with contextlib.suppress(OSError):  # not there, or another server's pages are in it
            self._folder.rmdir()

    def _sweep(self) -> None:
        for folder in self._folder.glob("*"):
            if folder.name not in self._made and folder.stat().st_mtime < time.time() - _LEFT:
                shutil.rmtree(folder, ignore_errors=True)

    def _run(self, made: Analysis, arguments: Sequence[str]) -> None:
        with self._guard:
            if made.id not in self._made:  # dropped while it waited
                return
            said = (made.folder / _SAID).open("w", encoding="utf-8")
            trouble = (made.folder / _TROUBLE).open("w", encoding="utf-8")
            with said, trouble:
                process = subprocess.Popen(
                    [sys.executable, "-P", "-c", _PROGRAM],
                    stdin=subprocess.PIPE,
                    stdout=said,
                    stderr=trouble,
                    text=True,
                    encoding="utf-8",
                    env=os.environ | {"PYTHONUTF8": "1"},
                )
            self._process = (made.id, process)
            made.state = "working"
        try:
            process.communicate(json.dumps(list(arguments)), timeout=_MAX_DURATION)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        with self._guard:
            self._process = None
            made.state = "done" if process.returncode == 0 else "failed"
