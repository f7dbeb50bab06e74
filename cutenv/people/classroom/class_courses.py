"""Courses of a class: a common one and further ones for some."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from cutenv._base.output import atomic_write
from cutenv.people.classroom.class_store import PLACE_NAME
from cutenv.people.play.course import Course, course_toml, read_course

COURSE_FILE = "course.toml"
"""Name of the file of a course that was edited, in the class's folder."""
COURSE_FOLDER = "courses"
"""Name of the folder of further courses, a file each."""


class ClassCourses:
    """Courses of one class, as their files are now.

    In the class's folder, ``course.toml`` takes the place of the course of the start, and every file in ``courses`` is
    a further course, called by the file's name without ``.toml``.
    """

    def __init__(self, folder: Path, given: Course | None = None) -> None:
        self._folder, self._given = folder, given
        self._read: dict[Path, tuple[tuple[int, ...], Course | None]] = {}

    def file(self, key: str = "") -> Path:
        """Return the file of a further course, or the class's, ""."""
        return self._folder / COURSE_FOLDER / f"{key}.toml" if key else self._folder / COURSE_FILE

    @property
    def main(self) -> Course | None:
        """Course of everybody without another one, or None."""
        return self._course(self.file(), self._given)

    def further(self) -> dict[str, Course]:
        """Return the further courses by key."""
        files = sorted((self._folder / COURSE_FOLDER).glob("*.toml"))
        found = {path.stem: self._course(path) for path in files if PLACE_NAME.fullmatch(path.stem)}
        return {key: course for key, course in found.items() if course is not None}

    def files(self) -> list[Path]:
        """Return the files of all courses of the class."""
        found = [self.file(), *(self.file(key) for key in self.further())]
        return [path for path in found if path.is_file()]

    def all(self) -> list[Course]:
        """Return all courses, that of the class first."""
        main = self.main
        return [*([] if main is None else [main]), *self.further().values()]

    def of(self, key: str) -> Course | None:
        """Return the course of a key, or the class's course."""
        course = self._course(self.file(key)) if PLACE_NAME.fullmatch(key) else None
        return self.main if course is None else course

    def named(self, name: str) -> Course | None:
        """Return the course of a name, or None."""
        return next((course for course in self.all() if course.name == name), None)

    def set(self, course: Course, key: str = "") -> None:
        """Set the course of a key, or of the class, "".

        Raises ValueError if the key is none, or another course has the same name, by which progress and pass marks are
        kept.
        """
        if key and not PLACE_NAME.fullmatch(key):
            raise ValueError(f"course {key!r} is no name: give up to 32 letters, digits and blanks, such as nurses.")
        others = {"": self.main, **self.further()}
        if any(other is not None and other.name == course.name for each, other in others.items() if each != key):
            raise ValueError(f"another course of the class is called {course.name!r}. Give each a name of its own.")
        self.file(key).parent.mkdir(exist_ok=True)
        with atomic_write(self.file(key)) as part:
            part.write_text(course_toml(course), encoding="utf-8")

    def drop(self, key: str = "") -> None:
        """Delete a further course's file, or restore the starting course, ""."""
        if not key or PLACE_NAME.fullmatch(key):
            self.file(key).unlink(missing_ok=True)

    def new_key(self, name: str) -> str:
        """Return an unused key for a further course of a name."""
        base = re.sub(r"[\W_]+", "-", name.lower()).strip("-")[:24] or "course"
        keys = (base if k < 2 else f"{base}-{k}" for k in range(1, 1000))
        return next(key for key in keys if not self.file(key).exists())

    def _course(self, path: Path, otherwise: Course | None = None) -> Course | None:
        """Return a file's course; the last sound one if damaged, else ``otherwise``."""
        try:
            about = path.stat()
        except OSError:
            return otherwise
        stamp, known = (about.st_mtime_ns, about.st_size, about.st_ino), self._read.get(path, ((), otherwise))
        if stamp != known[0]:
            with suppress(OSError, ValueError):
                known = self._read[path] = (stamp, read_course(path))
        return known[1]
