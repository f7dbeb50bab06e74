"""Print the training time after which an agent matched the demonstrated script on validation specimens.

python agents/level.py runs/NAME ...       finished runs of ppo.py and recurrent_ppo.py; demonstrations count
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from arguments import AgentArguments
from compare import read_rows
from learning import level_after


def kept_arguments(run: Path) -> AgentArguments:
    """Return the arguments of a run that all agents share; SystemExit if there is no run."""
    path = run / "run.json"
    if not path.is_file():
        raise SystemExit(f"{path} is missing; give the folder of a finished run.")
    kept = json.loads(path.read_text())["arguments"]
    known = {field.name for field in dataclasses.fields(AgentArguments)}
    return AgentArguments(**{name: value for name, value in kept.items() if name in known})


def main() -> None:
    """Print a line for every run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    for run in parser.parse_args().runs:
        arguments, curve = kept_arguments(run), read_rows(run / "learning_curve.csv")
        if not curve or "seconds" not in curve[-1]:
            raise SystemExit(f"{run} holds no learning curve with seconds; it was made by an earlier version.")
        seconds = level_after(arguments, curve)
        after = "never" if seconds is None else f"after {seconds:.0f} s"
        print(f"{run.name}: level with {arguments.script!r} {after}, of {curve[-1]['seconds']:.0f}")


if __name__ == "__main__":
    main()
