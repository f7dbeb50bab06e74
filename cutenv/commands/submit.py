"""Enter a policy on the leaderboard: let it cut the benchmark's held-out specimens, and keep the actions of every cut.

A policy is a folder that holds policy.safetensors and card.json, the folder of a training run, the name of a shipped
policy or a script, or a class of your own, MODULE:CLASS.  Several are the training seeds of one entry.  With
--check every cut of a file is repeated from its seed and actions; it is refused if any return differs in its last bit.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv.commands.options import command_parser, reports_errors

if TYPE_CHECKING:
    from cutenv.learning.benchmark import Submission


@reports_errors("submit")
def main(argv: Sequence[str]) -> int:
    """Make or check a submission; 2 if an option or the file is bad."""
    given = _parser().parse_args(argv)
    if given.check is not None:
        if given.policies:
            raise ValueError("--check takes a file alone; leave the policies out.")
        checked(given.check)
    else:
        _submit(given)
    return 0


def checked(path: Path) -> tuple[Submission, list[list[dict[str, Any]]]]:
    """Repeat every cut of a file, print its row, and return the entry and the scores of its runs.

    Raises
    ------
    OSError, ValueError
        If the file cannot be read, is damaged, or a cut's return differs.
    """
    from cutenv.learning.benchmark import read_submission, replayed

    entry = read_submission(path)
    with _progress("repeating", len(entry.runs) * entry.protocol.specimens) as update:
        rows = replayed(entry, update)
    print(f"{path}: every return of {sum(map(len, rows))} cuts repeated to the last bit")
    _print_row(entry, rows)
    return entry, rows


def _submit(given: argparse.Namespace) -> None:
    if not given.policies:
        raise ValueError("name a policy to submit, or a file to --check.")
    if given.author is None:
        raise ValueError("--author is missing; give the name that the leaderboard shows.")
    if not given.out.absolute().parent.is_dir() or given.out.is_dir():
        raise ValueError(f"--out {given.out}: give a file in a folder that exists.")
    from cutenv.learning.benchmark import (
        QUICK,
        Protocol,
        Submission,
        check_text,
        returns_after,
        submitted_run,
        write_submission,
    )
    from cutenv.learning.evaluation import contestant
    from cutenv.learning.statistics import read_rows
    from cutenv.policy.shipped import policy_folder

    policy = given.name or Path(given.policies[0]).name
    for option, text in (("--author", given.author), ("--code", given.code), ("--name", policy)):
        check_text(option, text, empty=option == "--code")
    protocol = QUICK if given.quick else Protocol()
    names = [str(policy_folder(name)) for name in given.policies]
    if len(set(names)) < len(names):
        raise ValueError("a policy is named twice; give each training run once.")
    entrants = [contestant(name) for name in names]  # all are read before the first cut
    runs = []
    with _progress("cutting", len(entrants) * protocol.specimens) as update:
        for name, one in zip(names, entrants, strict=True):
            after = returns_after(read_rows(Path(name).parent / "learning_curve.csv"))
            runs.append(submitted_run(one, after, protocol, update))
    today = datetime.date.fromtimestamp(time.time()).isoformat()
    write_submission(given.out, Submission(policy, given.author, given.code, today, protocol, tuple(runs)))
    print(f"{given.out}: {given.out.stat().st_size / 1e3:.0f} kB, to be attached as it is")
    checked(given.out)


def _print_row(entry: Submission, runs: Sequence[Sequence[dict[str, Any]]]) -> None:
    from cutenv.learning.benchmark import shown, standing
    from cutenv.learning.evaluation import contestant, evaluate

    protocol = entry.protocol
    best, shared = {protocol.script: contestant(protocol.script)}, {"specimen_class": protocol.training_class}
    script = evaluate(best, protocol.test_seeds, shared, processes=1, description=protocol.script)
    print(f"\n{entry.policy}, by {entry.author}, {entry.date}{', ' if entry.code else ''}{entry.code}")
    kind = f"protocol {protocol.version} of {protocol.environment}"
    print(f"{kind}: {protocol.specimens} specimens of class {protocol.training_class}, {_runs(len(runs))}\n")
    for column, interval in standing(runs, script, protocol).items():
        print(f"  {column.heading:20s} {shown(interval, column.factor, column.digits, '+' if column.paired else '')}")
    if protocol.version == "quick":
        print("\nOf few specimens: a quick one is no entry. Submit it without --quick.")


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"


@contextlib.contextmanager
def _progress(description: str, cuts: int) -> Iterator[Callable[[int], Any]]:
    """Show progress of cuts on standard error; yields the function that counts them."""
    from tqdm import tqdm

    with tqdm(total=cuts, desc=description, unit="cut", leave=False) as bar:
        yield bar.update


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "submit",
        __doc__,
        examples=(
            'my_policy/ --author "A. Name" --code https://example.org/my_policy',
            'runs/ppo-seed0 runs/ppo-seed1 --name "my PPO" --author "A. Name"',
            "ppo-free --quick --author me",
            "--check submission.json",
        ),
    )
    parser.add_argument("policies", nargs="*", metavar="POLICY", help="folder of a policy or run, or a name; see above")
    parser.add_argument("--author", metavar="NAME", help="name that the leaderboard shows")
    parser.add_argument("--code", default="", metavar="LINK", help="link to the code that made the policy")
    parser.add_argument("--name", metavar="TEXT", help="name of the entry; default that of the first policy")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("submission.json"),
        metavar="FILE",
        help="file to write; default submission.json",
    )
    parser.add_argument("--quick", action="store_true", help="cut few specimens: a trial, and no entry")
    parser.add_argument(
        "--check", type=Path, metavar="FILE", help="repeat every cut of a submission, and print its row"
    )
    return parser
