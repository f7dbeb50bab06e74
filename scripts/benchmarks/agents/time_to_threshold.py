"""Print the time of training after which an agent did as well as the demonstrated script, on validation specimens.

python -m scripts.benchmarks.agents.time_to_threshold runs/NAME ...
    finished runs of 'cutenv train'; demonstrations count
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from pathlib import Path

from cutenv.agents.learning.arguments import LearnerArguments
from cutenv.agents.learning.on_policy import time_to_threshold
from cutenv.agents.learning.statistics import read_rows


def kept_arguments(run: Path) -> LearnerArguments:
    """Return the options of a run that every learner has; SystemExit if there is no run."""
    path = run / "run.json"
    if not path.is_file():
        raise SystemExit(f"{path} is missing; give the folder of a finished run.")
    kept = json.loads(path.read_text())["arguments"]
    known = {field.name for field in dataclasses.fields(LearnerArguments)}
    return LearnerArguments(**{name: value for name, value in kept.items() if name in known})


def main() -> None:
    """Print a line for every run."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN")
    for run in parser.parse_args().runs:
        arguments, curve = kept_arguments(run), read_rows(run / "learning_curve.csv")
        if not curve or "seconds" not in curve[-1]:
            raise SystemExit(f"{run} contains no learning curve with seconds; it was made by an earlier version.")
        seconds = time_to_threshold(arguments, curve)
        after = "never" if seconds is None else f"after {seconds:.0f} s"
        print(f"{run.name}: as good as {arguments.script!r} {after}, of {curve[-1]['seconds']:.0f}")


if __name__ == "__main__":
    main()
