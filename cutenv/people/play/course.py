"""Course: TOML file of tasks with specimens, marks, repetitions and feedback."""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import date, datetime, time, timedelta
from pathlib import Path
from typing import Any, NamedTuple

from cutenv._base import resources
from cutenv._base.language_files import course_texts, local_number, shipped_names
from cutenv._base.unit_table import Unit, shown_unit
from cutenv._base.validation import in_range, one_of
from cutenv.agents.policy import ORACLE, experts
from cutenv.records.provenance import check_operator
from cutenv.records.scoring import MAP_METRICS, ScoreCard, all_metrics
from cutenv.records.scoring.score_card import whole_score
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.beginning import LONGEST
from cutenv.task.registry import TASKS, RegisteredTask, tasks_with


def course_words(language: str, key: str, **values: object) -> str:
    """Return a translated sentence, feedback rule or metric name with values."""
    return course_texts(language).get(key, key.replace("_", " ")).format(**values)


def course_name(language: str, name: str) -> str:
    """Return a packaged course's or task's name translated, others unchanged."""
    return shipped_names(language).get(name, name)


FEEDBACK = {rule: course_words("en", rule) for rule in ("always", "above-limit", "afterwards", "never")}
"""Rules of when a person sees the force, with their words."""


class ShownFeedback(NamedTuple):
    """Feedback shown now: present force, its trace, result after the cut."""

    force: bool = True
    trace: bool = True
    result: bool = True


def shown_feedback(rule: str, *, ended: bool, costs: bool) -> ShownFeedback:
    """Return what a rule of :data:`FEEDBACK` shows; a high force ``costs``."""
    after = ended and rule != "never"
    whole = rule == "always" or after
    return ShownFeedback(force=whole or (rule == "above-limit" and costs), trace=whole, result=after or not ended)


SHIPPED_COURSES = {path.stem: path for path in sorted(resources.path("courses").glob("*.toml"))}
"""Courses that come with the package, by name."""
WARM_UP = "(warm-up)"
"""Name under which warm-up cuts are recorded; no task of a course is called so."""
_SCORE = "overall_score"
_MAX_CHARACTERS = 200  # characters of a name or an explanation
_MOST_SEED = 2**31 - 1


@dataclass(frozen=True, kw_only=True)
class MarkedMetric:
    """Metric that a mark may limit: name, unit of the limit, sense."""

    name: str
    unit: Unit
    more: bool


def _marked_metrics() -> dict[str, MarkedMetric]:
    marked = {_SCORE: MarkedMetric(name=_SCORE, unit=Unit("1", "1"), more=True)}
    for name, metric in all_metrics().items():
        unit = shown_unit(metric.unit.replace("F", "N"))
        suffix = "" if unit.sign == "1" else "_" + unit.sign.replace("/", "_per_").replace(" ", "_")
        if metric.direction != "none":
            marked[name + suffix] = MarkedMetric(name=name, unit=unit, more=metric.direction == "higher")
    return marked


MARKED_METRICS: Mapping[str, MarkedMetric] = _marked_metrics()
"""Metrics that a mark may limit, by the key in a course's file, which ends with the unit."""


def marked_numbers(card: ScoreCard) -> dict[str, float]:
    """Return a card's known metrics that a mark may limit [SI]."""
    found = {_SCORE: card.overall_score} | {name: value.value for name, value in card.metrics.items()}
    names = dict.fromkeys(about.name for about in MARKED_METRICS.values())
    return {name: float(value) for name in names if (value := found.get(name)) is not None}


@dataclass(frozen=True, kw_only=True)
class CourseTask:
    """One task of a course."""

    name: str
    specimen_class: str  # "uniform", "liver", "vascular" or "mixed"
    task: str = "gentle"
    line: str = "mixed"  # "straight", "arc", "s", "excision", "random", or "mixed", any of these
    feedback: str = "always"  # one of FEEDBACK
    repetitions: int = 1  # cuts in a row that reach the mark; without one, finished cuts
    mark: Mapping[str, float] = field(default_factory=dict)  # limits in the unit of the key, of MARKED_METRICS
    seeds: tuple[int, ...] = ()  # of the specimens, in turn; () if each cut draws a new one
    target_length: float | None = None  # [m]; None: drawn from 0.060 to 0.100
    crossover: bool = False  # the two tasks exchange their feedback for operators with an even number
    attempts: int | None = None  # after them the task is over, reached or not
    expert: str = ORACLE  # whose way a replay and a demonstration show
    opens: datetime | None = None  # cuts are handed out from then on, on the machine's clock if without zone
    closes: datetime | None = None  # and up to then

    @property
    def of_line(self) -> dict[str, Any]:
        """Kind of line as keyword of a cut; empty without one."""
        return {"line": self.line} if TASKS[self.task].line else {}

    def misses(self, numbers: Mapping[str, float], language: str = "en") -> tuple[str, ...]:
        """Return missed limits in words, by :func:`marked_numbers`; () if none."""
        return tuple(words for key, limit in self.mark.items() if (words := _missed(key, limit, numbers, language)))

    def demand(self, language: str = "en") -> str:
        """Return in words what has to be reached, and how often."""
        cuts = course_words(language, "cuts" if self.repetitions > 1 else "one cut", times=self.repetitions)
        if not self.mark:
            return cuts
        limits = course_words(language, "and").join(_limit(key, limit, language) for key, limit in self.mark.items())
        return course_words(language, "in a row", limits=limits, cuts=cuts) if self.repetitions > 1 else limits


@dataclass(frozen=True, kw_only=True)
class Course:
    """Course of several tasks in order."""

    name: str
    about: str
    tasks: tuple[CourseTask, ...]
    demonstration: bool = False  # a cut is shown in the browser before a person's first one
    warm_up: int = 0  # cuts before the first task that count for nothing

    @property
    def warm_up_task(self) -> CourseTask:
        """Warm-up task: the first on new specimens, force shown, no mark."""
        first = self.tasks[0]
        return CourseTask(
            name=WARM_UP,
            specimen_class=first.specimen_class,
            task=first.task,
            line=first.line,
            expert=first.expert,
            target_length=first.target_length,
        )

    @property
    def kinds(self) -> tuple[str, ...]:
        """Tasks that are cut in it, each once."""
        return tuple(dict.fromkeys(task.task for task in self.tasks))

    def for_operator(self, operator: str) -> Course:
        """Return a person's course, a crossover's feedback swapped for even numbers.

        The number is the first one in the code, so that codes counted from 1 on are divided into equal halves. Raises
        TypeError or ValueError if the code may identify a person.
        """
        check_operator(operator)
        digits = re.search(r"\d+", operator)
        assert digits is not None  # every valid code has a number
        pair = [task for task in self.tasks if task.crossover]
        if not pair or int(digits[0]) % 2:
            return self
        other = {pair[0].name: pair[1].feedback, pair[1].name: pair[0].feedback}
        tasks = (dataclasses.replace(task, feedback=other.get(task.name, task.feedback)) for task in self.tasks)
        return dataclasses.replace(self, tasks=tuple(tasks))


def named_course(given: str) -> Course:
    """Read a course by file path or packaged name; ValueError if none."""
    if given in SHIPPED_COURSES:
        return read_course(SHIPPED_COURSES[given])
    if not Path(given).is_file():
        names = ", ".join(SHIPPED_COURSES)
        raise ValueError(f"course {given!r} is neither a file nor one that comes with cutenv ({names}).")
    return read_course(Path(given))


def read_course(path: Path) -> Course:
    """Read the file of a course.

    Raises ValueError if it is no TOML, or a key is unknown, missing, of a wrong type or out of range; it names file,
    task, key, value and cure.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except UnicodeDecodeError:
        raise ValueError(f"{path}: it is not UTF-8 text. Save it as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"{path}: it is not TOML: {error}.") from None
    try:
        return course_of(content)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from None


def course_of(content: Mapping[str, Any]) -> Course:
    """Return the course of a file's content; errors as of :func:`read_course`."""
    _known_keys(content, ("name", "about", "demonstration", "warm_up", "task"))
    given = content.get("task")
    if not isinstance(given, list) or not given or not all(isinstance(each, dict) for each in given):
        raise ValueError("it has no tasks. Begin each task with a line [[task]].")
    tasks = tuple(_task(number, each) for number, each in enumerate(given, 1))
    for task in tasks:
        if sum(other.name == task.name for other in tasks) > 1:
            raise ValueError(f"two tasks are called {task.name!r}. Give each a name of its own.")
    pair = [task for task in tasks if task.crossover]
    if pair and (len(pair) != 2 or pair[0].feedback == pair[1].feedback):
        raise ValueError(
            "crossover = true must stand in two tasks with different feedback, which are compared; "
            f"here it stands in {len(pair)} ({', '.join(f'{each.name!r}: {each.feedback}' for each in pair)})."
        )
    return Course(
        name=_text("name", content),
        about=_text("about", content, ""),
        tasks=tasks,
        demonstration=_truth("demonstration", content.get("demonstration", False)),
        warm_up=_whole("warm_up", content.get("warm_up", 0), 0, 20, "Give how many cuts; 0 for none."),
    )


def course_toml(course: Course) -> str:
    """Return a course as file text, as :func:`read_course` reads it."""
    parts = [_entries(course_content(course))]
    parts += [f"[[task]]\n{_entries(task_content(task))}" for task in course.tasks]
    return "\n".join(parts)


def course_content(course: Course) -> dict[str, Any]:
    """Return a course file's non-default keys above the tasks."""
    further = {"demonstration": course.demonstration, "warm_up": course.warm_up}
    return {"name": course.name, "about": course.about} | {key: value for key, value in further.items() if value}


def task_content(task: CourseTask) -> dict[str, Any]:
    """Return a task's non-default keys as in a file."""
    least = CourseTask(name="", specimen_class="")
    fields = {_FIELDS.get(key, key): key for key in _TASK_KEYS}
    found = {key: getattr(task, name) for name, key in fields.items() if getattr(task, name) != getattr(least, name)}
    if task.target_length is not None:
        found["target_length_mm"] = round(1e3 * task.target_length, 9)
    return {key: list(value) if isinstance(value, tuple) else value for key, value in found.items()}


def _entries(content: Mapping[str, Any]) -> str:
    return "".join(f"{key} = {_toml(value)}\n" for key, value in content.items())


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_toml(each)}" for key, each in value.items()) + " }"
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, float):
        return repr(int(value)) if value.is_integer() else repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON's texts, lists and truths are TOML's


def _task(number: int, given: Mapping[str, Any]) -> CourseTask:
    called = f" ({given['name']!r})" if isinstance(given.get("name"), str) else ""
    try:
        _known_keys(given, _TASK_KEYS)
        if "specimen_class" not in given:
            raise ValueError(f"specimen_class is missing. Give one of {', '.join(CLASSES)}.")
        if _text("name", given) == WARM_UP:
            raise ValueError(f"name = {WARM_UP!r} is that of the warm-up. Give another name.")
        kind = _TASK_KEYS["task"](given.get("task", "gentle"))
        for key in given.get("mark", {}):
            for other, metrics in MAP_METRICS.items():
                if kind != other and key in MARKED_METRICS and MARKED_METRICS[key].name in metrics:
                    raise ValueError(_of_another(f"mark {key}", TASKS[other]))
        if "line" in given and not TASKS[kind].line:
            other_task = next(task for task in TASKS.values() if task.line)
            raise ValueError(_of_another(f"line = {given['line']!r}", other_task))
        if TASKS[kind].line and "target_length_mm" in given:
            longest = f"A drawn line is long enough for cuts of at most {1e3 * LONGEST:.0f} mm."
            in_range("target_length_mm", given["target_length_mm"], 15.0, 1e3 * LONGEST, "mm", longest)
        if "expert" in given:
            one_of("expert", given["expert"], experts(kind))
        task = CourseTask(**{_FIELDS.get(key, key): _TASK_KEYS[key](given[key]) for key in given})
        if task.attempts is not None and task.attempts < task.repetitions:
            raise ValueError(
                f"attempts = {task.attempts} is less than repetitions = {task.repetitions}: nobody could reach it."
            )
        if task.opens and task.closes and task.closes <= task.opens:
            raise ValueError(f"closes = {task.closes:%Y-%m-%d %H:%M} is not after opens. Give a later moment.")
        return task
    except (TypeError, ValueError) as error:
        raise ValueError(f"task {number}{called}: {error}") from None


def _of_another(key: str, task: RegisteredTask) -> str:
    return f'{key} is of cuts {task.along}. Write task = "{task.name}", or leave it out.'


def _known_keys(given: Mapping[str, Any], known: Mapping[str, Any] | tuple[str, ...]) -> None:
    for key in given:
        one_of("key", key, known)


def _text(key: str, given: Mapping[str, Any], default: str | None = None) -> str:
    value = given.get(key, default)
    if value is None:
        raise ValueError(f'{key} is missing. Write {key} = "..." above.')
    if not isinstance(value, str) or (not value.strip() and default is None) or len(value) > _MAX_CHARACTERS:
        raise ValueError(f"{key} = {value!r} must be a text of 1 to {_MAX_CHARACTERS} characters.")
    return value.strip()


def _whole(key: str, value: Any, low: int, high: int, cure: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{key} must be a whole number, got {value!r}. {cure}")
    return int(in_range(key, value, low, high, "1", cure))


def _length(value: Any) -> float:
    return in_range("target_length_mm", value, 15.0, 130.0, "mm", "Write 80 for 8 cm.") / 1e3


def _seeds(value: Any) -> tuple[int, ...]:
    cure = "Give whole numbers, such as seeds = [1, 2, 3], or leave the key out for a new specimen each time."
    if not isinstance(value, list) or not value:
        raise TypeError(f"seeds must be a list of whole numbers, got {value!r}. {cure}")
    return tuple(_whole("seeds", each, 0, _MOST_SEED, cure) for each in value)


def _mark(value: Any) -> dict[str, float]:
    cure = "Write mark = { overall_score = 60 }, or leave the key out."
    if not isinstance(value, dict) or not value:
        raise TypeError(f"mark must be limits by name, got {value!r}. {cure}")
    for key in value:
        one_of("mark", key, MARKED_METRICS)
    return {
        key: in_range(f"mark {key}", limit, 0.0 if key == _SCORE else -1e6, 100.0 if key == _SCORE else 1e6, "1", cure)
        for key, limit in value.items()
    }


def _moment(key: str, value: Any) -> datetime:
    cure = f"Write {key} = 2026-12-01, or {key} = 2026-12-01T08:00:00."
    if isinstance(value, datetime):
        return value.astimezone()  # without a zone, on this machine's clock
    if not isinstance(value, date):
        raise TypeError(f"{key} must be a date, or a date with a time, got {value!r}. {cure}")
    whole = datetime.combine(value, time.min)  # the day is part of it
    return (whole + timedelta(days=1) if key == "closes" else whole).astimezone()


def _truth(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError(f"{key} must be true or false, got {value!r}.")
    return value


_FIELDS = {"target_length_mm": "target_length"}
_TASK_KEYS: Mapping[str, Callable[[Any], Any]] = {
    "name": str.strip,
    "task": lambda value: one_of("task", value, tasks_with("played")),
    "line": lambda value: one_of("line", value, (*KINDS, "mixed")),
    "specimen_class": lambda value: one_of("specimen_class", value, CLASSES),
    "feedback": lambda value: one_of("feedback", value, FEEDBACK),
    "repetitions": lambda value: _whole("repetitions", value, 1, 1000, "Give how many cuts."),
    "mark": _mark,
    "seeds": _seeds,
    "target_length_mm": _length,
    "crossover": lambda value: _truth("crossover", value),
    "attempts": lambda value: _whole("attempts", value, 1, 1000, "Give how many cuts count."),
    "expert": str,
    "opens": lambda value: _moment("opens", value),
    "closes": lambda value: _moment("closes", value),
}
"""Keys of a task in the file, and what reads their values."""


def _limit(key: str, limit: float, language: str) -> str:
    about = MARKED_METRICS[key]
    name, shown = course_words(language, about.name), _shown(limit, about, language)
    return course_words(language, "at least" if about.more else "at most", name=name, limit=shown)


def _missed(key: str, limit: float, numbers: Mapping[str, float], language: str) -> str:
    """Return in words how a cut misses a limit, or ""."""
    about = MARKED_METRICS[key]
    value = numbers.get(about.name)
    asked = _limit(key, limit, language)
    if value is None:
        return course_words(language, "unknown", limit=asked)
    # What is shown decides: a whole score, other numbers with three digits.
    value = whole_score(value) if key == _SCORE else float(f"{about.unit.from_si(value):.3g}")
    kept = value >= limit if about.more else value <= limit
    return "" if kept else course_words(language, "here", limit=asked, value=_shown(value, about, language))


def _shown(value: float, about: MarkedMetric, language: str) -> str:
    number = local_number(f"{value:.3g}", language)
    return number + (f" {about.unit.sign}" if about.unit.sign != "1" else "")
