"""Courses: the file, what each person goes through, progress from the records on disk, and what the window shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from played import DATE, TARGET, Pushing, run

from cutenv._base.language_files import course_texts
from cutenv.commands import cli
from cutenv.people.play.course import (
    FEEDBACK,
    MARKED_METRICS,
    SHIPPED_COURSES,
    Course,
    CourseTask,
    course_name,
    course_toml,
    named_course,
    read_course,
    shown_feedback,
)
from cutenv.people.play.course_progress import GIVEN_UP, CourseProgress
from cutenv.people.play.devices import MouseDevice, simple_hand
from cutenv.people.play.play_session import Session, SessionPlan
from cutenv.records import load_one

GOOD = """
name = "two"
[[task]]
name = "first"
specimen_class = "uniform"
mark = { overall_score = 1, tip_error_mm = 50 }
repetitions = 2
seeds = [6, 7]
target_length_mm = 70
[[task]]
name = "second"
specimen_class = "liver"
feedback = "never"
"""


def written(folder: Path, text: str = GOOD) -> Path:
    path = folder / "course.toml"
    path.write_text(text, encoding="utf-8")
    return path


def task(**changes: object) -> CourseTask:
    given = {"name": "one", "specimen_class": "liver", "seeds": (6,), "target_length": TARGET}
    return CourseTask(**(given | changes))  # type: ignore[arg-type]


def course(*tasks: CourseTask) -> Course:
    return Course(name="made up", about="", tasks=tasks)


def cut(progress: CourseProgress, folder: Path | None = None) -> Session:
    """The next cut of a course by a simple hand."""
    played = Session(simple_hand(TARGET), SessionPlan(countdown=0.0), folder=folder, course=progress, now=lambda: DATE)
    played.begin()
    run(played)
    return played


def test_the_file_says_what_the_course_holds(tmp_path: Path) -> None:
    first, second = read_course(written(tmp_path)).tasks
    assert (first.seeds, first.target_length, first.feedback) == ((6, 7), 0.07, "always")
    assert first.demand() == "score 1 or more and tip error 50 mm or less, 2 cuts in a row"
    assert (second.feedback, second.demand(), second.seeds) == ("never", "1 cut", ())


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('feedback = "never"', 'feedback = "newer"', "('second'): feedback must be one of .*Did you mean 'never'"),
        ("repetitions = 2", "repetitions = 0", "task 1 ('first'): repetitions = 0 is outside 1 to 1000"),
        ("repetitions = 2", "repetition = 2", "task 1 ('first'): key must be one of .*Did you mean 'repetitions'"),
        ("tip_error_mm", "tip_error", "Did you mean 'tip_error_mm'|mark 'tip_error' is not known"),
        ("overall_score = 1,", "overall_score = 101,", "mark overall_score = 101 is outside 0 to 100"),
        ('specimen_class = "liver"', "", "task 2 ('second'): specimen_class is missing. Give one of"),
        ('specimen_class = "liver"', 'specimen_class = "kidney"', "specimen_class must be one of .*got 'kidney'"),
        ('feedback = "never"', 'task = "deep"', "task must be one of .*got 'deep'"),
        ("tip_error_mm = 50", "mean_depth_error_mm = 2", "mark mean_depth_error_mm is of cuts along a wanted depth"),
        ("tip_error_mm = 50", "line_area_mm2 = 2", "mark line_area_mm2 is of cuts along a drawn line"),
        ('feedback = "never"', 'line = "arc"', "line = 'arc' is of cuts along a drawn line"),
        ('feedback = "never"', 'task = "path"\nline = "spiral"', "line must be one of .*got 'spiral'"),
        ('feedback = "never"', 'task = "path"\ntarget_length_mm = 120', "at most 100 mm"),
        ("seeds = [6, 7]", "seeds = 6", "seeds must be a list of whole numbers, got 6"),
        ("target_length_mm = 70", "target_length_mm = 7", "target_length_mm = 7 mm is outside 15 to 130 mm"),
        ('name = "second"', 'name = "first"', "two tasks are called 'first'"),
        ('feedback = "never"', "crossover = true", "crossover = true must stand in two tasks"),
        ('name = "two"', "name = 2", "name = 2 must be a text"),
        ("[[task]]", "[task", "it is not TOML"),
    ],
)
def test_a_wrong_file_is_refused_by_task_key_value_and_cure(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ValueError, match=said.replace("(", r"\(").replace(")", r"\)")) as error:
        read_course(path)
    assert str(path) in str(error.value)


def test_the_courses_that_come_along_are_valid_and_named_in_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    known = {"first cuts", "force shown or not", "wanted depth", "drawn lines"}
    assert {named_course(name).name for name in SHIPPED_COURSES} == known
    for course in map(named_course, SHIPPED_COURSES):
        for name in (course.name, *(task.name for task in course.tasks)):
            assert course_name("de", name) != name == course_name("en", name)
    with pytest.raises(SystemExit):
        cli.main(["play", "--help"])
    helped = capsys.readouterr().out
    assert all(name in helped for name in SHIPPED_COURSES)
    with pytest.raises(
        ValueError, match="neither a file nor one that comes with cutenv \\(depth, first, force-shown, path\\)"
    ):
        named_course("last")


def test_a_crossover_exchanges_the_feedback_of_half_of_the_people_and_leaves_the_specimens() -> None:
    given = named_course("force-shown")
    rules = {code: [each.feedback for each in given.for_operator(code).tasks] for code in ("P01", "P02", "S13", "S14")}
    assert rules["P01"] == rules["S13"] == ["always", "always", "never"]
    assert rules["P02"] == rules["S14"] == ["always", "never", "always"]
    assert [each.seeds for each in given.for_operator("P02").tasks] == [each.seeds for each in given.tasks]


def test_a_person_goes_on_where_the_records_say(tmp_path: Path) -> None:
    given = course(task(mark={"overall_score": 1.0}, repetitions=2, seeds=(6, 8)), task(name="two", feedback="never"))
    progress = CourseProgress(given, "P07", tmp_path)
    assert progress.specimen()[:2] == ("liver", 6)
    played = cut(progress, tmp_path)
    assert played.sight().verdict == (
        "Mark reached.",
        "Task 1 of 2, one: score 1 or more, 2 cuts in a row, 1 of 2 so far. Force: shown.",
    )
    facts = load_one(played.saved).metadata
    assert (facts["course"], facts["task"], facts["feedback"]) == ("made up", "one", "always")
    again = CourseProgress(given, "P07", tmp_path)  # another day
    assert (again.ahead(), again.specimen().seed) == (progress.ahead(), 8)
    assert CourseProgress(given, "P08", tmp_path).specimen().seed == 6  # somebody else
    cut(again, tmp_path)
    third = CourseProgress(given, "P07", tmp_path)
    assert third.task is not None
    assert third.task.name == "two"
    last = cut(third, tmp_path)
    assert last.done
    assert CourseProgress(given, "P07", tmp_path).task is None
    harder = course(task(mark={"overall_score": 101.0}, repetitions=2))  # the mark of now counts
    assert CourseProgress(harder, "P07", tmp_path).task is not None


def test_a_course_may_go_on_with_cuts_along_a_line(tmp_path: Path) -> None:
    drawn = task(name="bend", task="path", line="arc", mark={"largest_line_distance_mm": 9.0}, seeds=(3,))
    progress = CourseProgress(course(drawn), "P07", tmp_path)
    played = Session(MouseDevice(), SessionPlan(countdown=0.0), folder=tmp_path, course=progress, now=lambda: DATE)
    assert progress.ahead().endswith("Force: shown. Along the dashed line.")
    assert progress.ahead("de").endswith("Entlang der gestrichelten Linie.")
    played.device = played.cut.simple_hand()
    played.begin()
    run(played)
    path, verdict, _ = played.sight().verdict
    assert path.startswith("Path: ")
    assert verdict == "Mark reached."
    assert load_one(played.saved).metadata["environment"] == "cutenv/PathCut-v1"
    with pytest.raises(ValueError, match="takes no device that pushes"):
        Session(Pushing(), course=CourseProgress(course(drawn), "P08", tmp_path))


def test_a_course_may_go_on_with_cuts_along_a_wanted_depth(tmp_path: Path) -> None:
    wanted = task(name="deep", task="depth", mark={"mean_depth_error_mm": 0.9}, feedback="afterwards", seeds=(3,))
    given = course(task(), wanted)
    progress = CourseProgress(given, "P07", tmp_path)
    played = Session(
        simple_hand(TARGET), SessionPlan(countdown=0.0), folder=tmp_path, course=progress, now=lambda: DATE
    )
    assert played.task == "gentle"
    played.begin()
    run(played)
    assert progress.ahead().endswith("Force: shown after the cut. Along the dashed depth.")
    played.go_on()
    assert played.task == "depth"
    played.device = simple_hand(TARGET, level=played.cut.wanted_level)
    run(played)
    assert played.card is not None
    error = played.card.metrics["mean_depth_error"].value
    assert error is not None
    depth, verdict, ahead = played.sight().verdict
    assert depth.startswith(f"Depth: {1e3 * error:.1f} mm off")
    assert verdict == (
        "Mark reached."
        if 1e3 * error < 0.905
        else f"Mark missed: mean depth error 0.9 mm or less: here {1e3 * error:.3g} mm."
    )
    assert ahead == progress.ahead()
    facts = load_one(played.saved).metadata
    assert (facts["task"], facts["environment"]) == ("deep", "cutenv/DepthCut-v1")
    again = CourseProgress(given, "P07", tmp_path)  # the record on disk says the same as the cut did
    assert again.ahead() == ahead


def test_a_miss_breaks_the_row_and_a_cut_that_was_given_up_is_one(tmp_path: Path) -> None:
    played = cut(CourseProgress(course(task(mark={"overall_score": 1.0}, repetitions=2)), "P07"))
    card = played.card
    assert card is not None
    progress = CourseProgress(course(task(mark={"overall_score": 1.0}, repetitions=2)), "P07")
    for end in ("finished", GIVEN_UP, "finished"):
        progress.add(card, end)
    assert "1 of 2 so far" in progress.ahead()
    progress.add(card, "finished")
    assert progress.task is None
    free = CourseProgress(course(task(repetitions=2)), "P07")
    for end in ("finished", GIVEN_UP):
        free.add(card, end)
    assert free.verdict == "Not counted: the cut was given up."
    assert "1 of 2 so far" in free.ahead()


def test_a_course_speaks_german_too_and_has_a_word_for_every_metric(tmp_path: Path) -> None:
    given = course(task(mark={"overall_score": 101.0, "tip_error_mm": 2.5}, repetitions=2, feedback="afterwards"))
    progress = CourseProgress(given, "P07")
    assert progress.ahead("de") == (
        "Aufgabe 1 von 1, one: Punkte mindestens 101 und Abstand der Spitze vom Ziel höchstens 2,5 mm, 2 Schnitte "
        "hintereinander, bisher 0 von 2. Kraft: nach dem Schnitt gezeigt."
    )
    played = cut(CourseProgress(course(task()), "P07"))
    assert played.card is not None
    progress.add(played.card, "finished")
    assert progress.verdicts["de"].startswith("Vorgabe verfehlt: Punkte mindestens 101: hier ")
    assert {each.name for each in MARKED_METRICS.values()} <= set(course_texts("en"))


def test_a_damaged_record_is_named_and_does_not_count(tmp_path: Path) -> None:
    (tmp_path / "broken.csv").write_text('# cutenv-record/1\n# metadata: {"course": \ntime_s\n', encoding="utf-8")
    (reason,) = CourseProgress(course(task()), "P07", tmp_path).unread
    assert "broken.csv" in reason


@pytest.mark.parametrize(
    ("rule", "cutting", "costly", "after"),
    [
        ("always", (True, True, True), (True, True, True), (True, True, True)),
        ("above-limit", (False, False, True), (True, False, True), (True, True, True)),
        ("afterwards", (False, False, True), (False, False, True), (True, True, True)),
        ("never", (False, False, True), (False, False, True), (False, False, False)),
    ],
)
def test_each_rule_shows_what_it_says(rule: str, cutting: object, costly: object, after: object) -> None:
    assert shown_feedback(rule, ended=False, costs=False) == cutting
    assert shown_feedback(rule, ended=False, costs=True) == costly
    assert shown_feedback(rule, ended=True, costs=False) == after


@pytest.mark.parametrize("rule", FEEDBACK)
def test_the_window_keeps_a_hidden_force_to_itself(rule: str) -> None:
    pytest.importorskip("pygame", reason='playing is an extra: pip install "cutenv[play]"')
    from cutenv.people.play.picture import PlayPicture

    progress = CourseProgress(course(task(feedback=rule)), "P07")
    played = Session(simple_hand(TARGET), SessionPlan(countdown=0.0), course=progress)
    painter = PlayPicture()
    played.begin()
    for k in range(150):
        played.advance(k / 60.0)
    sight = played.sight()
    assert 0.5 < sight.moment.force < sight.moment.force_limit_per_depth * 0.02
    calm = painter.draw(sight).picture()
    for readings in (played.cut.cutting.readings, played.cut.readings):
        readings["force"][-1] *= 0.5  # what is seen of the force is the sensor's
    other = painter.draw(played.sight()).picture()
    assert np.array_equal(calm, other) == (rule != "always")


def test_in_a_course_no_key_changes_what_is_cut_or_shown() -> None:
    played = Session(simple_hand(TARGET), SessionPlan(countdown=0.0), course=CourseProgress(course(task()), "P07"))
    played.choose_class("vascular")
    played.show_hidden()
    played.begin()
    played.advance(0.0)
    played.advance(0.2)
    played.repeat()
    assert (played.chosen_class, played.practice, played.phase) == ("liver", False, "cutting")


def test_the_command_walks_a_course_and_refuses_what_it_sets(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("pygame", reason='playing is an extra: pip install "cutenv[play]"')
    pytest.importorskip("pymunk", reason='playing is an extra: pip install "cutenv[play]"')
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    short = (
        GOOD.replace("repetitions = 2", "repetitions = 1").replace("_mm = 70", "_mm = 20") + "target_length_mm = 20\n"
    )
    options = ["play", "--course", str(written(tmp_path, short)), "--out", str(tmp_path / "cuts")]
    assert cli.main(options) == 2
    assert "--course needs --operator CODE" in capsys.readouterr().err
    options += ["--operator", "P07"]
    assert cli.main([*options, "--seed", "3"]) == 2
    assert "--seed cannot be given with --course" in capsys.readouterr().err
    assert cli.main([*options, "--scripted", "--cuts", "2"]) == 0
    said = capsys.readouterr()
    assert "Task 1 of 2, first" in said.err
    assert said.out.splitlines()[-1] == "This cut counts. Course 'two' is done: 2 of 2 tasks."
    assert "overall score" not in said.out  # the last task shows nothing
    assert cli.main(options) == 2
    assert "is done: 2 of 2 tasks" in capsys.readouterr().err


def test_a_course_is_read_without_the_window() -> None:
    import subprocess
    import sys

    code = "import sys, cutenv.people.play.course, cutenv.people.play.course_progress; print('pygame' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "False"


def test_a_warm_up_comes_first_is_recorded_so_and_counts_for_nothing(tmp_path: Path) -> None:
    given = replace(course(task(feedback="never", attempts=1)), warm_up=1)
    progress = CourseProgress(given, "P07", tmp_path)
    assert progress.ahead() == "Warm-up 1 of 1: it counts for nothing."
    assert progress.task is not None
    assert (progress.task.feedback, progress.task.seeds, progress.task.target_length) == ("always", (), TARGET)
    played = cut(progress, tmp_path)
    assert progress.verdict == "A warm-up: it counts for nothing."
    facts = load_one(played.saved).metadata
    assert (facts["task"], facts["practice"], facts["feedback"]) == ("(warm-up)", True, "always")
    again = CourseProgress(given, "P07", tmp_path)
    assert again.ahead() == progress.ahead() == "Task 1 of 1, one: 1 cut. Force: not shown. Attempt 1 of 1."


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("warm_up = 21", "warm_up = 21 is outside 0 to 20"),
        ("warm_up = true", "warm_up must be a whole number"),
        ("demonstration = 1", "demonstration must be true or false"),
    ],
)
def test_a_wrong_beginning_is_refused(tmp_path: Path, line: str, said: str) -> None:
    with pytest.raises((TypeError, ValueError), match=said):
        read_course(written(tmp_path, f"{line}\n{GOOD}"))


def test_the_beginning_is_written_as_it_is_read(tmp_path: Path) -> None:
    given = replace(course(task()), warm_up=2, demonstration=True)
    path = tmp_path / "again.toml"
    path.write_text(course_toml(given), encoding="utf-8")
    assert read_course(path) == given
