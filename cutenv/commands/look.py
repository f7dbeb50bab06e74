"""Show records before scoring: a picture, open questions, rows left out.

A file of another program needs no map: its own statements are read, and what they leave open is asked.
"""

from __future__ import annotations

import argparse
import json
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv.commands.options import command_parser, made_folder, reports_errors

if TYPE_CHECKING:  # slow to import, and --help does not need it
    from cutenv.records import ColumnMap, Imported, RecordError
    from cutenv.records.foreign.proposal import Question
    from cutenv.records.importers import OpenQuestions


@reports_errors("look")
def main(argv: Sequence[str]) -> int:
    """Show records; return 0, 1 (unreadable or ambiguous), 2 (bad options)."""
    arguments = _parser().parse_args(argv)
    from cutenv.commands.inputs import given_mapping, record_files
    from cutenv.records import RecordError
    from cutenv.records.importers import OpenQuestions

    if arguments.out is not None:
        made_folder("--out", arguments.out.parent)
    mapping = given_mapping(arguments)
    arguments.every_text = True
    asks = sys.stdin.isatty() and not (arguments.yes or arguments.json)
    found: list[tuple[Path, Imported | RecordError]] = []
    for path in record_files(arguments):
        try:
            found.append((path, _looked(path, mapping, asks=asks)))
        except OpenQuestions as error:
            found.append((path, error))
        except RecordError as error:
            found.append((path, error))
    if arguments.json:
        print(json.dumps(_as_json(found), indent=1))
    else:
        for path, each in found:
            _print(path, each)
    if arguments.out is not None:
        _write_page(arguments.out, found)
        if not arguments.json:
            print(f"page: {arguments.out}")
    return int(any(isinstance(each, RecordError) for _, each in found))


def _looked(path: Path, mapping: ColumnMap | None, *, asks: bool) -> Imported:
    """Return a file as understood, asking questions at a terminal."""
    from cutenv.records.importers import OpenQuestions, look_at

    answers: dict[str, str] = {}
    asked: set[str] = set()
    while True:
        try:
            understood = look_at(path, mapping, answers or None)
            questions = understood.questions
        except OpenQuestions as error:
            if not asks or all(each.text in asked for each in error.asked.questions):
                raise
            questions = error.asked.questions
        question = next((each for each in questions if each.text not in asked), None)
        if not asks or question is None:
            return understood
        asked.add(question.text)
        answers |= _answer(path, question)


def _answer(path: Path, question: Question) -> Mapping[str, str]:
    """Ask a question; return the answer as mapping items."""
    print(f"{path.name}: {question.text}")
    for number, (words, _) in enumerate(question.choices, 1):
        print(f"  {number}  {words}{' (Enter)' if question.proposed == number - 1 else ''}")
    said = input("> ").strip()
    if question.about == "rate" and said:
        return {"rate": said if said.lower().endswith("hz") else f"{said}Hz"}
    by_words = {words.lower(): items for words, items in question.choices}
    if said.lower() in by_words:
        return by_words[said.lower()]
    if said.isdigit() and 1 <= int(said) <= len(question.choices):
        return question.choices[int(said) - 1][1]
    return {} if question.proposed is None else question.choices[question.proposed][1]


def _print(path: Path, found: Imported | RecordError) -> None:
    from cutenv.display.report import RecordPicture
    from cutenv.display.report.look_page import record_lines
    from cutenv.records import RecordError

    print(f"{path}")
    if isinstance(found, RecordError):
        print(f"  not read: {found.reason}\n")
        return
    width = shutil.get_terminal_size((96, 24)).columns
    braille = (sys.stdout.encoding or "").lower().replace("-", "") in ("utf8", "utf16")
    for k, record in enumerate(found.records):
        facts = _facts(found, k)
        travel = "" if facts["travel_mm"] is None else f", travel {facts['travel_mm']:.1f} mm"
        unit = "N" if record.force_unit == "N" else "(normalised)"
        print(
            f"record {k + 1} of {len(found.records)}: {len(record)} readings, {facts['duration_s']:.2f} s, "
            f"{facts['rate_Hz']:.4g} Hz, peak {record.force.max():.4g} {unit}{travel}, cuts: {len(found.cuts[k])}"
        )
        print("\n".join(record_lines(RecordPicture(**found.picture(k)), width, braille=braille)))
    for note in found.notes:
        print(f"  {note}")
    for flaws in found.flaws:
        for flaw in flaws:
            print(f"  doubt: {flaw.message}")
    for question in found.questions:
        print(f"  question: {question}")
    if found.mapping is not None:
        print(f"score it: cutenv score {shlex.quote(path.as_posix())} {found.mapping}")
    print()


def _facts(found: Imported, k: int) -> dict[str, Any]:
    """Return a record in numbers."""
    record = found.records[k]
    position = record.position
    peak = float(record.force.max())
    cuts = [[float(record.time[cut.start]), float(record.time[cut.stop - 1])] for cut in found.cuts[k]]
    return {
        "file": found.path.name,
        "duration_s": record.duration,
        "peak_N": peak if record.force_unit == "N" else None,
        "travel_mm": None if position is None else 1e3 * float(position.max() - position.min()),
        "readings": len(record),
        "rate_Hz": record.sample_rate,
        "force_unit": record.force_unit,
        "cuts_s": [[begin - float(record.time[0]), end - float(record.time[0])] for begin, end in cuts],
        **({"part": record.metadata["group"]} if "group" in record.metadata else {}),
    }


def _as_json(found: Sequence[tuple[Path, Imported | RecordError]]) -> dict[str, list[Any]]:
    from cutenv.records import RecordError

    content: dict[str, list[Any]] = {
        "records": [], "questions": [], "left_out": [], "maps": [], "doubts": [], "notes": [], "refused": []
    }  # fmt: skip
    for path, each in found:
        name = path.name
        content["questions"] += [_question(name, question) for question in _questions(each)]
        if isinstance(each, RecordError):
            content["refused"].append({"file": name, "reason": each.reason})
            continue
        content["records"] += [_facts(each, k) for k in range(len(each.records))]
        content["left_out"] += [{"file": name, "count": one.count, "reason": one.reason} for one in each.left_out]
        content["notes"] += [{"file": name, "note": note} for note in each.notes]
        flaws = [flaw for some in each.flaws for flaw in some]
        content["doubts"] += [{"file": name, "kind": flaw.kind, "doubt": flaw.message} for flaw in flaws]
        if each.mapping is not None:
            content["maps"].append({"file": name, "map": str(each.mapping)})
    return content


def _questions(found: Imported | RecordError | OpenQuestions) -> tuple[Question, ...]:
    from cutenv.records import RecordError
    from cutenv.records.importers import OpenQuestions

    if isinstance(found, OpenQuestions):
        return found.asked.questions
    return () if isinstance(found, RecordError) else found.questions


def _question(name: str, question: Question) -> dict[str, Any]:
    choices = [words for words, _ in question.choices]
    taken = None if question.proposed is None else choices[question.proposed]
    return {"file": name, "about": question.about, "question": question.text, "choices": choices, "taken": taken}


def _write_page(path: Path, found: Sequence[tuple[Path, Imported | RecordError]]) -> None:
    from cutenv.display.report import RecordPicture
    from cutenv.display.report.look_page import UnderstoodFile, write_look_page
    from cutenv.records import RecordError

    files = []
    for place, each in found:
        questions = list(map(str, _questions(each)))
        if isinstance(each, RecordError):
            files.append(UnderstoodFile(name=place.name, reason=each.reason, questions=questions))
            continue
        files.append(
            UnderstoodFile(
                name=place.name,
                pictures=[RecordPicture(**each.picture(k)) for k in range(len(each.records))],
                mapping="" if each.mapping is None else str(each.mapping),
                questions=questions,
                left_out=list(map(str, each.left_out)),
                notes=each.notes,
            )
        )
    write_look_page(path, files)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "look",
        __doc__,
        examples=(
            "trial.csv",
            "lab/*.txt --out look.html",
            "trial.csv --yes --json",
            "trial.csv --map time=t force=Fx --unit mN",
        ),
        note="At a terminal an open question is asked; --yes takes the proposed answers. The last line of each file\n"
        "is the command that scores it as it is shown.",
    )  # fmt: skip
    add = parser.option
    add("records FILE", "records of any program, or folders of them", Path, nargs="+")
    add("--out PAGE.html", "page with the pictures, questions and rows left out", Path)
    add("--yes", "take the proposed answer of every question")
    add("--json", "print records, questions and rows left out as JSON")
    add("--map FIELD=COLUMN", "which column is what, as for cutenv score; without it, what the file states", nargs="+")
    add("--unit UNIT", "unit of the force: N, mN, kN, gf, kgf, lbf, or 1 if it is normalised")
    return parser
