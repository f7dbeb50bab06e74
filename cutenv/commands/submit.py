"""Enter a policy on the leaderboard, with the actions of all cuts.

The specimens are drawn from the policy's own files. A policy is a folder that holds policy.safetensors and card.json,
the folder of a training run, the name of a shipped policy or a script, or a class of your own, MODULE:CLASS.  Several
are the training seeds of one entry.  The digest of their files determines the specimens.  With --check every cut of a
file is repeated from its seed and actions; it is refused if any return differs in its last bit.  With the policies
beside --check, their files must have the digest, and they must act as the file says.
"""

from __future__ import annotations

import argparse
import datetime
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv._base.output import check_writable, progress_bar
from cutenv.commands.options import command_parser, reports_errors

if TYPE_CHECKING:
    from cutenv.agents.learning.benchmark import Submission
    from cutenv.agents.learning.evaluation import Contestant

CutRows = list[dict[str, Any]]


@reports_errors("submit")
def main(argv: Sequence[str]) -> int:
    """Make or check a submission; return 2 on bad input."""
    given = _parser().parse_args(argv)
    if given.check is not None:
        if given.salt is not None:
            raise ValueError("--salt is kept in the file; leave it out with --check.")
        checked(given.check, given.policies)
    else:
        _submit(given)
    return 0


def checked(path: Path, policies: Sequence[str] = ()) -> tuple[Submission, list[CutRows], CutRows]:
    """Repeat all cuts of a file; return entry and scores.

    The scores are those of its runs and of the script, and each cut's row is printed. The script is the protocol's, on
    the same specimens. With the policies that were submitted, their files and actions are checked as well. Raise
    OSError, ValueError if the file cannot be read, is damaged, a cut's return differs, or the policies are not those of
    the file.
    """
    from cutenv.agents.learning.benchmark import entry_digest, entry_files, read_submission, replayed
    from cutenv.agents.learning.evaluation import contestant, evaluate

    entry = read_submission(path)
    entrants = [contestant(name) for name in policies]
    if policies:
        found = entry_digest([entry_files(name) for name in policies])
        if found != entry.digest:
            raise ValueError(
                f"{path}: its digest is {entry.digest}, but that of {', '.join(policies)} is {found}. Refused. "
                "Give the policies that were submitted, unchanged."
            )
    with progress_bar("repeating", "cut", total=len(entry.runs) * entry.protocol.specimens) as update:
        rows = replayed(entry, entrants, update)
    by = " by the policies' own actions" if policies else ""
    print(f"{path}: every return of {sum(map(len, rows))} cuts repeated to the last bit{by}")
    protocol = entry.protocol
    best, shared = {protocol.script: contestant(protocol.script)}, {"specimen_class": protocol.training_class}
    script = evaluate(best, entry.seeds, shared, processes=1, description=protocol.script)
    _print_row(entry, rows, script)
    return entry, rows, script


def _submit(given: argparse.Namespace) -> None:
    if not given.policies:
        raise ValueError("name a policy to submit, or a file to --check.")
    if given.author is None:
        raise ValueError("--author is missing; give the name that the leaderboard shows.")
    if not given.out.absolute().parent.is_dir() or given.out.is_dir():
        raise ValueError(f"--out {given.out}: give a file in a folder that exists.")
    check_writable("--out", given.out.absolute().parent)
    from cutenv.agents.learning.benchmark import (
        QUICK,
        Protocol,
        Submission,
        check_text,
        entry_digest,
        entry_files,
        entry_seeds,
        returns_after,
        submitted_run,
        write_submission,
    )
    from cutenv.agents.learning.evaluation import contestant
    from cutenv.agents.learning.statistics import read_rows
    from cutenv.agents.policy.shipped import policy_folder

    policy, salt = given.name or Path(given.policies[0]).name, given.salt or ""
    for option, text in (("--author", given.author), ("--code", given.code), ("--name", policy), ("--salt", salt)):
        check_text(option, text, empty=option in ("--code", "--salt"))
    protocol = QUICK if given.quick else Protocol()
    names = [str(policy_folder(name)) for name in given.policies]
    if len(set(names)) < len(names):
        raise ValueError("a policy is named twice; give each training run once.")
    entrants = [contestant(name) for name in names]  # all are read before the first cut
    kind = _kind(names, entrants, given.kind)
    digest = entry_digest([entry_files(name) for name in names])
    seeds, runs = entry_seeds(digest, protocol, salt), []
    with progress_bar("cutting", "cut", total=len(entrants) * protocol.specimens) as update:
        for name, one in zip(names, entrants, strict=True):
            after = returns_after(read_rows(Path(name).parent / "learning_curve.csv"))
            runs.append(submitted_run(one, after, protocol, seeds, update))
    today = datetime.date.fromtimestamp(time.time()).isoformat()
    entry = Submission(policy, given.author, given.code, today, kind, digest, salt, protocol, tuple(runs))
    write_submission(given.out, entry)
    print(f"{given.out}: {given.out.stat().st_size / 1e3:.0f} kB, to be attached as it is")
    checked(given.out)


def _kind(names: Sequence[str], entrants: Sequence[Contestant], given: str | None) -> str:
    """Return the kind of entry, by cards or option."""
    from cutenv.agents.learning.benchmark import ENTRY_KINDS, recorded_kind

    known = ", ".join(map(repr, ENTRY_KINDS))
    if given is not None and given not in ENTRY_KINDS:
        raise ValueError(f"--kind {given!r} is not known; give one of {known}.")
    told = [recorded_kind(name, one.policy) or given for name, one in zip(names, entrants, strict=True)]
    kinds = {kind for kind in (*told, given) if kind is not None}
    if None in told:
        raise ValueError(f"--kind is missing: no card tells how this was made; give one of {known}.")
    if len(kinds) > 1:
        raise ValueError(f"--kind: the policies are of kinds {', '.join(sorted(kinds))}; an entry is of one.")
    return kinds.pop()


def _print_row(entry: Submission, runs: Sequence[CutRows], script: CutRows) -> None:
    from cutenv.agents.learning.benchmark import shown, standing

    protocol = entry.protocol
    print(f"\n{entry.policy}, by {entry.author}, {entry.date}{', ' if entry.code else ''}{entry.code}")
    kind = f"protocol {protocol.version} of {protocol.environment}"
    print(f"{kind}: {protocol.specimens} specimens of class {protocol.training_class}, {_runs(len(runs))}")
    print(f"kind: {entry.kind}; specimens drawn from digest {entry.digest[:12]}{_salted(entry.salt)}\n")
    for column, interval in standing(runs, script, protocol).items():
        print(f"  {column.heading:20s} {shown(interval, column.factor, column.digits, '+' if column.paired else '')}")
    if protocol.version == "quick":
        print("\nOf few specimens: a quick one is no entry. Submit it without --quick.")


def _salted(salt: str) -> str:
    return f" with salt {salt!r}" if salt else ""


def _runs(count: int) -> str:
    return "1 run" if count == 1 else f"{count} runs"


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "submit",
        __doc__,
        examples=(
            'my_policy/ --author "A. Name" --code https://example.org/my_policy',
            'runs/ppo-seed0 runs/ppo-seed1 --name "my PPO" --author "A. Name"',
            "ppo-free --quick --author me",
            "--check submission.json",
            "--check submission.json my_policy/",
        ),
    )
    add = parser.option
    add("policies POLICY", "folder of a policy or run, or a name; see above", nargs="*")
    add("--author NAME", "name that the leaderboard shows")
    add("--code LINK", "link to the code that made the policy", "")
    add("--name TEXT", "name of the entry; default that of the first policy")
    add(
        "--kind KIND",
        "how it was made, where no card tells: 'script', 'from scratch', 'with demonstrations' or "
        "'correction of a script'",
    )
    add("--salt TEXT", "text of a competition's host, from which the specimens are drawn as well")
    add("--out FILE", "file to write; default submission.json", Path("submission.json"))
    add("--quick", "cut few specimens: a trial, and no entry")
    add(
        "--check FILE",
        "repeat every cut of a submission, by its policies too if they are named, and print its row",
        Path,
    )
    return parser
