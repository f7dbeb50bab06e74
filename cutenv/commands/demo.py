"""Watch a shipped policy and the best script cut, in half a minute."""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv._base.imports import require
from cutenv._base.output import watched
from cutenv._base.result_table import Reason, aligned
from cutenv._base.validation import in_range
from cutenv.commands.options import (
    add_specimen_class,
    add_target_length,
    add_tissue,
    command_parser,
    drawn_given,
    made_picture,
    made_place,
    reports_errors,
    target_length,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from cutenv._base.arrays import StructArray
    from cutenv.agents.policy import Policy
    from cutenv.sim.plant.simulator import SimulatedPlant
    from cutenv.task.registry import RegisteredTask

UNSEEN = 3_000_000  # first seed beyond those on which agents are trained, chosen and tested

_ANGLES = ("angle_mode", "fixed_angle_deg")


@dataclass(frozen=True, kw_only=True)
class DemoCut:
    """Scores of one cut, and data to draw it."""

    reward: float
    end: str
    success: bool
    error: float  # the first of the errors that the task has in tables, such as the tip's [mm]
    peak_force_N: float
    time_s: float
    specimen_class: str
    target_length: float
    force_limit_per_depth: float
    readings: StructArray
    plant: SimulatedPlant
    picture: NDArray[np.uint8] | None
    """The cut at its end as a window shows it: of the first specimen, where the blade is also led aside or down."""


@reports_errors("demo")
def main(argv: Sequence[str]) -> int:
    """Cut, print a table, write a picture; return 0 or 2."""
    arguments = _parser().parse_args(argv)
    from cutenv.agents.learning.option_fields import class_in_words
    from cutenv.agents.policy import named_policy
    from cutenv.task.registry import task_made_as

    count = int(in_range("--specimens", arguments.specimens, 1, 1000, "1", "A handful is enough to look at."))
    seed = UNSEEN + int(in_range("--seed", arguments.seed, 0, 10**9, "1", "Give a whole number from 0."))
    require(*["meshcat"] * (arguments.page is not None))
    length = target_length(arguments)
    made_picture("--out", arguments.out)
    if arguments.page is not None:
        made_place("--page", arguments.page)
    policy = named_policy(arguments.policy)
    name, task = Path(arguments.policy).name, task_made_as(policy.card.environment)
    if arguments.page is not None and task.name != "gentle":
        raise ValueError(f"--page shows gentle cutting, and {name} cuts {task.along}. Leave it out.")
    drawn = drawn_given(arguments)
    print(f"{count} specimens of {class_in_words(vars(arguments))} on which nothing was trained or chosen\n")
    specimens = DemoSpecimens(drawn, seed, count, length)
    agent = demo_cuts(policy, policy.environment_arguments, specimens, name, task)
    # Fixed or free, the script gets the angle that the agent has; it decides as often as it was tuned for.
    angles = {key: policy.environment_arguments[key] for key in _ANGLES if key in policy.environment_arguments}
    best: Any = task.scripts[task.script]()
    script = demo_cuts(best, {**angles, **getattr(best, "environment_arguments", {})}, specimens, task.script, task)
    _print_table({name: agent, task.script: script}, task)
    same = [word for name, value in drawn.items() for word in (f"--{name.replace('_', '-')}", value)]
    compared = shlex.join([arguments.policy, task.script, *same])
    print(f"\nSo few cuts decide nothing; 200 specimens do: cutenv evaluate {compared}")
    _write({name: agent[0], task.script: script[0]}, arguments)
    return 0


@dataclass(frozen=True)
class DemoSpecimens:
    """First specimens of a seed, with target length [m]."""

    drawn: Mapping[str, str]  # class and tissue, as keyword arguments of an environment
    seed: int
    count: int
    target_length: float | None = None


def demo_cuts(
    policy: Policy,
    environment_arguments: Mapping[str, Any],
    specimens: DemoSpecimens,
    title: str = "cutting",
    task: RegisteredTask | None = None,
) -> list[DemoCut]:
    """Cut each specimen to its end, with a progress bar."""
    from cutenv.task.registry import TASKS

    task = task or TASKS["gentle"]
    arguments = {**specimens.drawn, **environment_arguments}
    if specimens.target_length is not None:
        arguments["target_length"] = specimens.target_length
    drawn = {} if task.name == "gentle" else {"render_mode": "rgb_array"}
    env = task.single(**arguments, **drawn)
    cuts = [
        _cut(env, policy, (specimens.seed, episode), task) for episode in watched(range(specimens.count), title, "cut")
    ]
    env.close()
    return cuts


def _cut(env: Any, policy: Policy, specimen: tuple[int, int], task: RegisteredTask) -> DemoCut:
    seed, episode = specimen
    observation, _ = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng((seed, episode)))
    rewards, parts, ended = [], [], False
    while not ended:
        observation, reward, ended, _, info = env.step(policy(observation))
        rewards.append(reward)
        parts.append(env.cutting.readings.copy())
    readings, truth = np.concatenate(parts), info["truth"]
    error = task.errors[0][0]
    known = {"tip_error_mm": 1e3 * abs(truth["tip_m"] - truth["target_length_m"])}
    for group in info.values():
        known |= group if isinstance(group, Mapping) else {}
    return DemoCut(
        reward=math.fsum(rewards),
        end=env.cutting.end,
        success=bool(info["is_success"]),
        error=float(known[error]),
        peak_force_N=float(readings["true_force"].max()),
        time_s=float(readings["time"][-1]),
        specimen_class=truth["specimen_class"],
        target_length=float(truth["target_length_m"]),
        force_limit_per_depth=env.force_limit_per_depth,
        readings=readings,
        plant=env.plant,
        picture=env.render() if env.render_mode and episode == 0 else None,
    )


_LISTED = 5  # specimens that are listed one by one
_COLUMNS: dict[str, Callable[[DemoCut], float]] = {
    "return": lambda cut: cut.reward,
    "success": lambda cut: float(cut.success),
    "error": lambda cut: cut.error,
    "peak force [N]": lambda cut: cut.peak_force_N,
    "time [s]": lambda cut: cut.time_s,
}


def _print_table(by_policy: Mapping[str, Sequence[DemoCut]], task: RegisteredTask) -> None:
    """Print the first specimens, then the means of all."""
    _, error, unit, _ = task.errors[0]
    titles = [f"{error} [{unit}]" if title == "error" else title for title in _COLUMNS]
    pairs = list(zip(*by_policy.values(), strict=True))
    rows = [["", *titles, ""]]
    for number, same in enumerate(pairs[:_LISTED], 1):
        about = f"specimen {number}: {same[0].specimen_class}, cut to {1e3 * same[0].target_length:.0f} mm"
        rows += [[Reason(about)], *(_cells(name, [cut]) for name, cut in zip(by_policy, same, strict=True))]
    rows += [["mean" if len(pairs) <= _LISTED else f"mean of all {len(pairs)}"]]
    rows += [_cells(name, own) for name, own in by_policy.items()]
    print("\n".join(aligned([row + [""] * (len(rows[0]) - len(row)) for row in rows], right=True)))


def _cells(name: str, own: Sequence[DemoCut]) -> list[str]:
    means = [float(np.mean([value(cut) for cut in own])) for value in _COLUMNS.values()]
    ended = own[0].end if len(own) == 1 and own[0].end != "finished" else ""
    return [f"  {name}", *(f"{mean:.2f}" for mean in means), ended]


def _write(cuts: Mapping[str, DemoCut], arguments: argparse.Namespace) -> None:
    """Write a picture of the first specimen's cuts, and a 3-D page."""
    from cutenv.display.report import CutPicture, draw_cut, draw_pictures

    (name, agent), (script_name, script) = cuts.items()
    drawn = {
        f"{whose}: return {cut.reward:.2f}, {cut.end}": cut.picture
        for whose, cut in cuts.items()
        if cut.picture is not None
    }
    if drawn:
        draw_pictures(arguments.out, drawn)
        print(f"\npicture: {arguments.out}")
        return
    cut = CutPicture(
        policy=name,
        caption=f"{name}, specimen 1: return {agent.reward:.2f} ({script_name}: {script.reward:.2f})",
        readings=agent.readings,
        depth=agent.plant.depth,
        target_length=agent.target_length,
        force_limit_per_depth=agent.force_limit_per_depth,
    )
    draw_cut(arguments.out, cut, cut.caption)
    print(f"\npicture: {arguments.out}")
    if arguments.page is not None:
        from cutenv.display.viewer.solid import ShownCut, write_view
        from cutenv.sim.plant import to_trace

        trace = to_trace(agent.plant, agent.readings, name=f"{name}, specimen 1", target_length_m=agent.target_length)
        write_view(arguments.page, ShownCut.of(trace))
        print(f"page: {arguments.page}")


def _parser() -> argparse.ArgumentParser:
    from cutenv.agents.policy import DEFAULT_SHIPPED

    parser = command_parser(
        "demo",
        __doc__,
        examples=(
            "",
            "--page cut.html",
            "--policy ppo-excision",
            "--specimens 50 --specimen-class vascular --target-length 80mm",
        ),
        note="Nothing is trained and nothing is downloaded. A few cuts show how an agent cuts, not how good it is: "
        "'cutenv evaluate' compares on hundreds.",
    )
    add = parser.option
    add(
        "--policy POLICY",
        f"shipped policy ('cutenv evaluate --list'), or folder of a trained one; default {DEFAULT_SHIPPED}",
        DEFAULT_SHIPPED,
    )
    add("--specimens N", "number of specimens; default 20", 20)
    add("--seed N", "seed of the specimens; default 0", 0)
    add_specimen_class(parser, "mixed")
    add_tissue(parser)
    add_target_length(parser, "drawn from 60mm to 100mm; along an excision, its end")
    add("--out FILE", "picture to write; default demo.png", Path("demo.png"))
    add("--page FILE", "3-D page to write, which opens from disk", Path)
    return parser
