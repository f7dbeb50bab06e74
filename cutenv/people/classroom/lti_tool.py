"""LTI 1.3 tool of the class: platforms, key, launches and grades."""

from __future__ import annotations

from cutenv._base.language_files import texts_by_key
from cutenv.people.classroom.lesson import Lesson
from cutenv.people.classroom.lti_grades import GradeCourier
from cutenv.people.classroom.lti_keys import KEY_FILE, AccessTokens, ToolKey
from cutenv.people.classroom.lti_launch import LaunchDoor
from cutenv.people.classroom.lti_people import LtiPeople
from cutenv.people.classroom.lti_platforms import PLATFORMS_FILE, PlatformFile


class LtiTool:
    """The class as a tool of learning platforms, in its language."""

    def __init__(self, lesson: Lesson, language: str = "en") -> None:
        folder = lesson.folder.parent
        self.file = PlatformFile(folder / PLATFORMS_FILE)
        self.key = ToolKey(folder / KEY_FILE)
        self.people = LtiPeople(lesson.store)
        self.door = LaunchDoor(self.file, self.people, lesson.store.clock)
        self.tokens = AccessTokens(self.key, lesson.store.clock)
        said = texts_by_key(language)["grade_comment"]
        self.grades = GradeCourier(lesson, self.people, self.file, self.tokens, said)

    def troubles(self) -> list[str]:
        """Return what keeps grades from the platforms now."""
        found = [self.file.trouble, *self.grades.troubles.values(), *(row.trouble for row in self.people.grades())]
        return list(dict.fromkeys(filter(None, found)))
