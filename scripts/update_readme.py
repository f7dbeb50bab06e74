"""Print every number of the README: rewrite the blocks between its markers, or check them.

    python scripts/update_readme.py parameters agreement specimens speed training --run runs/NAME
    python scripts/update_readme.py --check parameters          fails if a block is not what it would print
    python scripts/update_readme.py --picture                   draws assets/pictures/cut.png

A block stands between ``<!-- NAME -->`` and ``<!-- /NAME -->``.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import io
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import gymnasium
import numpy as np

import cutenv.bench
from cutenv.cutting.drive import Rig
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.envs.constants import Knowledge
from cutenv.parameter import parameter_table
from cutenv.policy import ConstantFeed
from cutenv.report import draw_cut
from cutenv.task.weights import Limits
from cutenv.tissue import measured_liver
from cutenv.tissue.description import TissueDescription

ROOT = Path(__file__).parents[1]
SCORES = ("return", "success", "tip_error_mm", "peak_force_N", "time_s")


def markdown(header: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """A Markdown table."""
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def parameters(_: argparse.Namespace) -> str:
    """Every constant of tissue, law, drive, sensor and task, with provenance."""
    liver = measured_liver()
    rows = []
    for row in parameter_table(TissueDescription, LawParameters, Rig, SensorParameters, Knowledge, Limits):
        value = getattr(liver, row["name"], row["default"])
        sweep = "" if row["sweep"] is None else f"{row['sweep'][0]:.4g} to {row['sweep'][1]:.4g}"
        rows.append((f"`{row['name']}`", f"{value:.4g}", row["unit"], row["provenance"], row["why"], sweep))
    return markdown(("constant", "default", "unit", "provenance", "source or reason", "sweep"), rows)


def agreement(_: argparse.Namespace) -> str:
    """What the thesis and independent calculations say, beside ours."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "agreement.md"
        program = [sys.executable, str(ROOT / "scripts" / "reproduce_thesis.py"), "--out", folder]
        subprocess.run([*program, "--markdown", str(table)], check=True, stdout=subprocess.DEVNULL)
        return table.read_text().strip()


def speed(_: argparse.Namespace) -> str:
    """What ``cutenv bench`` prints on this machine."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        cutenv.bench.main([])
    return "```\n" + printed.getvalue().rstrip() + "\n```"


def specimens(_: argparse.Namespace) -> str:
    """What ``scripts/fit_specimens.py`` prints: virtual measurement of drawn specimens beside the tables."""
    program = [sys.executable, str(ROOT / "scripts" / "fit_specimens.py"), "--livers", "150"]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True)
    return "```\n" + done.stdout.strip() + "\n```"


def training(arguments: argparse.Namespace) -> str:
    """The evaluation of a training run, from its summary.csv."""
    if arguments.run is None:
        raise SystemExit("training needs --run runs/NAME, the folder of a finished training run.")
    with (arguments.run / "summary.csv").open() as file:
        values = {(row["policy"], row["score"]): row for row in csv.DictReader(file)}
    policies = list(dict.fromkeys(policy for policy, _ in values))
    rows = []
    for policy in policies:
        cells = [values[policy, score] for score in SCORES]
        shown = [
            f"{float(cell['mean']):.2f} [{float(cell['low_95']):.2f}, {float(cell['high_95']):.2f}]" for cell in cells
        ]
        rows.append((policy, *shown))
    return markdown(("policy", "return", "success", "tip error [mm]", "peak force [N]", "time [s]"), rows)


BLOCKS: dict[str, Callable[[argparse.Namespace], str]] = {
    "parameters": parameters,
    "agreement": agreement,
    "specimens": specimens,
    "speed": speed,
    "training": training,
}


def replaced(text: str, name: str, block: str) -> str:
    """The README with one block replaced."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise SystemExit(f"README.md has no block {name}: <!-- {name} --> to <!-- /{name} -->")
    return pattern.sub(lambda match: f"{match[1]}\n{block}\n\n{match[2]}", text)


def draw_picture(path: Path) -> None:
    """One cut by a script on measured liver, above its force trace."""
    env = gymnasium.make("cutenv/GentleCut-v0", specimen_class="liver", target_length=0.08)
    observation, _ = env.reset(seed=0)
    policy = ConstantFeed(speed=0.0127, angle=math.radians(75.0))
    policy.reset(np.random.default_rng(0))
    parts, ended = [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.unwrapped.cutting.readings.copy())  # type: ignore[attr-defined]
    specimen = env.unwrapped.specimen  # type: ignore[attr-defined]
    draw_cut(
        path,
        np.concatenate(parts),
        specimen.depth,
        target_length=0.08,
        force_limit_per_depth=1000.0,
        title="1.27 cm/s and 75 degrees through a slice of liver, then stop and unload",
    )


def main() -> None:
    """Rewrite or check blocks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blocks", nargs="*", choices=[*BLOCKS, []], metavar="BLOCK", help=", ".join(BLOCKS))
    parser.add_argument("--run", type=Path, help="folder of the training run to quote")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--picture", action="store_true", help="draw the picture")
    arguments = parser.parse_args()
    if arguments.picture:
        draw_picture(ROOT / "assets" / "pictures" / "cut.png")
    readme = ROOT / "README.md"
    text = readme.read_text()
    for name in arguments.blocks:
        new = replaced(text, name, BLOCKS[name](arguments))
        if arguments.check and new != text:
            raise SystemExit(f"README.md: block {name} is not what scripts/update_readme.py {name} prints")
        text = new
    if not arguments.check:
        readme.write_text(text)


if __name__ == "__main__":
    main()
