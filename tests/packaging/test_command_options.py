"""Every sub-command's help: plain words, one spelling of each option, examples that its parser takes."""

from __future__ import annotations

import argparse
import dataclasses
import functools
import importlib
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cutenv.commands import cli, train
from cutenv.commands.options import SCREEN, made_folder, target_length
from cutenv.records.schema import parse_length

NAMES = [*(name for name in cli.COMMANDS if name != "rig"), *(f"rig {name}" for name in cli.RIG_COMMANDS)]
FRAGMENT = re.compile(r"(of|for|whose|that|which|after|to|in|from|aimed|by|where|begins?)\b(?! column)", re.IGNORECASE)


def parser_of(name: str) -> argparse.ArgumentParser:
    return importlib.import_module(cli.module_of(f"cutenv {name}"))._parser()


def check_help(parser: argparse.ArgumentParser) -> None:
    for action in options_of(parser):
        assert action.help, action.dest
        assert not FRAGMENT.match(action.help), (action.dest, action.help)
        assert not action.help.startswith("default"), (action.dest, action.help)
        takes_value = action.nargs != 0 and action.choices is None
        assert not takes_value or action.metavar, action.dest


def check_examples(name: str, parser: argparse.ArgumentParser) -> None:
    examples = re.findall(rf"^  cutenv {name}(.*)$", parser.epilog or "", re.MULTILINE)
    assert examples
    for example in examples:
        parser.parse_args(shlex.split(example))


def options_of(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in parser._actions if action.dest != "help"]


@pytest.mark.parametrize("name", NAMES)
def test_every_option_has_help_with_a_noun_or_a_verb_first_and_a_plain_placeholder(name: str) -> None:
    check_help(parser_of(name))


@pytest.mark.parametrize("name", NAMES)
def test_the_examples_of_a_command_are_taken_by_its_parser(name: str) -> None:
    check_examples(name, parser_of(name))


@pytest.mark.parametrize("name", NAMES)
def test_a_short_help_fits_a_screen_and_begins_with_the_two_commonest_uses(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    printed = {}
    for option in ("-h", "--help"):
        with pytest.raises(SystemExit) as ended:
            parser_of(name).parse_args([option])
        assert ended.value.code == 0
        printed[option] = capsys.readouterr().out.splitlines()
    rows, columns = SCREEN
    assert len(printed["-h"]) <= rows <= 24
    assert max(map(len, printed["-h"])) <= columns <= 80
    examples = [line.strip() for line in printed["--help"] if line.startswith(f"  cutenv {name}")][:2]
    assert printed["--help"][: len(examples)] == examples
    uses = re.sub(r" \\\n +", " ", "\n".join(printed["-h"])).splitlines()  # as the shell reads them
    assert uses[: len(examples)] == examples
    spelled = {action.option_strings[-1] for action in options_of(parser_of(name)) if action.option_strings}
    assert all(any(option in line for line in printed["-h"]) for option in spelled)


def test_an_unknown_option_is_answered_in_one_line_with_the_nearest_three_at_most(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for given in (["--taks", "path"], ["--specimen=3"]):
        with pytest.raises(SystemExit) as ended:
            parser_of("train").parse_args(given)
        assert ended.value.code == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert 1 <= line.count("'--") <= 3
        assert line.endswith("'cutenv train -h' lists its options.")
    assert "'--specimens'" in line


@pytest.mark.parametrize(("name", "command"), [("cutenv", cli.PROGRAM), ("cutenv rig", cli.COMMANDS["rig"])])
def test_the_help_of_a_group_begins_with_the_two_commonest_uses(name: str, command: cli.Command) -> None:
    lines = cli._GroupParser(name, command).format_help().splitlines()
    assert lines[:2] == list(command.uses)
    assert all(any(line.startswith(f"  {part} ") for line in lines) for part in command.parts)
    if name != "cutenv":  # it has more sub-commands than a screen has lines
        assert len(lines) <= SCREEN[0]
        assert max(map(len, lines)) <= SCREEN[1]
    for use in command.uses:
        words = shlex.split(use)
        place = 3 if words[1] == "rig" else 2
        parser_of(" ".join(words[1:place])).parse_args(words[place:])


@pytest.mark.parametrize("learner", train.LEARNERS)
def test_every_learner_has_options_and_examples_of_its_own(learner: str) -> None:
    parser = train._parser(learner)
    check_help(parser)
    check_examples("train", parser)
    kind = train.LEARNERS[learner][1]
    fields = {field.name for field in dataclasses.fields(kind)} | ({"from_nothing"} if kind.from_nothing else set())
    assert {action.dest for action in options_of(parser)} == fields | {"learner", "quick", "resume"}


@pytest.mark.parametrize(
    ("given", "learner"),
    [([], "ppo"), (["--learner", "bc"], "bc"), (["--resume", "run"], "bc"), (["--help", "--learner=bc"], "bc")],
)
def test_the_learner_is_the_one_given_or_that_of_a_resumed_run(
    given: list[str], learner: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("run").mkdir()
    Path("run/run.json").write_text('{"agent": "behaviour cloning"}')
    assert train._learner(given) == learner


@pytest.mark.parametrize("name", NAMES)
def test_an_option_has_one_spelling(name: str) -> None:
    parser = parser_of(name)
    spellings = {spelling for action in options_of(parser) for spelling in action.option_strings}
    assert not spellings & {"--class", "--target", "--target-mm", "--target-length-cm"}
    assert not parser.allow_abbrev


def test_the_length_of_a_cut_and_the_class_of_its_specimen_can_be_given_to_every_command_that_cuts() -> None:
    for name in ("demo", "play", "rig run", "rig evaluate"):
        spellings = {spelling for action in parser_of(name)._actions for spelling in action.option_strings}
        assert {"--target-length", "--specimen-class"} <= spellings, name


@pytest.mark.parametrize(
    ("text", "metres"),
    [
        ("80mm", 0.08),
        ("8 cm", 0.08),
        ("0.08m", 0.08),
        ("80000um", 0.08),
        ("3in", 0.0762),
        (".5in", 0.0127),
        ("8e1mm", 0.08),
    ],
)
def test_a_length_is_read_in_any_unit(text: str, metres: float) -> None:
    assert parse_length("--x", text) == pytest.approx(metres, rel=1e-15)
    assert target_length(argparse.Namespace(target_length=None)) is None


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("80", "no length with a unit"),
        ("mm", "no length"),
        ("80 furlongs", "write one of m, cm, mm, um, in"),
        ("", "no length"),
    ],
)
def test_what_is_no_length_is_refused_with_the_cure(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=f"--x.*{reason}"):
        parse_length("--x", text)
    with pytest.raises(ValueError, match=r"--target-length = 0\.2 m is outside 0\.005 to 0\.15 m"):
        target_length(argparse.Namespace(target_length="20cm"))


def test_a_folder_is_made_and_a_file_in_its_place_refused(tmp_path: Path) -> None:
    assert made_folder("--out", tmp_path / "a" / "b").is_dir()
    (tmp_path / "file").touch()
    with pytest.raises(ValueError, match=r"--out .*file is a file; give a folder"):
        made_folder("--out", tmp_path / "file")


@pytest.mark.parametrize(("arguments", "first"), [([], "usage: cutenv [-h]"), (["rig"], "usage: cutenv rig [-h]")])
def test_without_a_command_the_help_is_printed(
    arguments: list[str], first: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(arguments) == 0
    assert f"\n{first}" in capsys.readouterr().out


def test_the_help_of_score_loads_nothing_that_scores() -> None:
    code = (
        "import sys, time\n"
        "from cutenv.commands import cli\n"
        "try:\n    cli.main(['score', '--help'])\n"
        "except SystemExit: pass\n"
        "print([name for name in ('scipy', 'numba', 'matplotlib', 'cutenv.records.scoring') if name in sys.modules])\n"
        "print(time.process_time())"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    *_, loaded, seconds = ran.stdout.splitlines()
    assert loaded == "[]"
    assert float(seconds) < 0.5


def test_the_help_of_score_names_every_shipped_reference() -> None:
    from cutenv.records.scoring.reference import SHIPPED_REFERENCES

    reference = next(action for action in parser_of("score")._actions if action.dest == "reference")
    assert all(name in (reference.help or "") for name in SHIPPED_REFERENCES)


def test_ctrl_c_within_the_import_of_a_compiled_module_ends_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken_off(*_: object, cause: BaseException | None = None) -> int:
        raise ImportError("initialization failed") from cause

    monkeypatch.setattr(cli, "_run", functools.partial(broken_off, cause=KeyboardInterrupt()))
    assert cli.main(["demo"]) == cli.INTERRUPTED
    assert capsys.readouterr().err == "\ncutenv demo: interrupted; files written before are kept\n"
    monkeypatch.setattr(cli, "_run", broken_off)
    with pytest.raises(ImportError, match="initialization failed"):
        cli.main(["demo"])


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signal that stands for Ctrl-C to one process")
@pytest.mark.parametrize("arguments", [["demo", "--specimens", "1000"], ["score", "cuts.csv"]])
def test_ctrl_c_ends_in_one_line(arguments: list[str], tmp_path: Path) -> None:
    table = "time_s,force_N\n" + "".join(f"{k / 1000},{1.0 + k % 7}\n" for k in range(200_000))
    (tmp_path / "cuts.csv").write_text(table)
    command = [
        sys.executable,
        "-c",
        f"from cutenv.commands import cli\nprint('ready', flush=True)\nraise SystemExit(cli.main({arguments}))",
    ]
    ran = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert ran.stdout is not None
    assert ran.stdout.readline() == "ready\n"
    time.sleep(0.5)  # into the command, wherever it is then, and before its end on a fast machine
    ran.send_signal(signal.SIGINT)
    _, printed = ran.communicate(timeout=60)
    assert ran.returncode == cli.INTERRUPTED, printed
    assert "Traceback" not in printed
    assert printed.rstrip().splitlines()[-1] == f"cutenv {arguments[0]}: interrupted; files written before are kept"
