"""Cut at constant speeds, and draw desired and actual speed of the blade, to see whether the drive holds it in tissue.

The thesis shows the same (Figure 3.2), to conclude that the forces are those of cutting alone.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cutenv.commands.options import (
    RIG,
    add_specimen_class,
    add_target_length,
    command_parser,
    made_folder,
    reports_errors,
    target_length,
)
from cutenv.rig.errors import RigError

_SLOWEST, _FASTEST = 0.1, 2.54  # [cm/s] that the thesis measured


@reports_errors("rig speed", RigError)
def main(argv: Sequence[str]) -> int:
    """Run the command; return 0, 3 if the safety stopped a cut, or 2 if an option is bad."""
    arguments = _parser().parse_args(argv)
    from cutenv._base.validation import in_range
    from cutenv.commands.rig.run import rehearse
    from cutenv.envs import RigCutEnv
    from cutenv.policy import ConstantFeed
    from cutenv.report.speed_figure import SpeedTrial, draw_speeds

    for speed in arguments.speeds:
        in_range("--speeds", speed, _SLOWEST, _FASTEST, "cm/s", "The tissue's model is measured up to 2.54 cm/s.")
    made_folder("--picture", arguments.picture.parent)
    env = RigCutEnv(
        rig=arguments.rig, specimen_class=arguments.specimen_class, target_length=target_length(arguments),
        records=arguments.out,
    )  # fmt: skip
    angle = env.settings.fixed_angle if env.settings.angle_mode == "fixed" else math.radians(90.0)
    policies = [ConstantFeed(speed=speed / 100.0, angle=angle) for speed in arguments.speeds]
    print("rehearsing on a fake rig ...", file=sys.stderr, flush=True)
    rehearse(env, policies[0], seed=arguments.seed)
    trials: list[SpeedTrial] = []
    stopped = False
    try:
        for number, (speed, policy) in enumerate(zip(arguments.speeds, policies, strict=True)):
            print(f"cut {number + 1} of {len(policies)} at {speed:g} cm/s ...", file=sys.stderr, flush=True)
            trial, info = _cut(env, policy, seed=arguments.seed, episode=number)
            trials.append(trial)
            print(trial.summary(speed / 100.0), flush=True)
            if info.get("stop") is not None:
                print(f"  STOPPED, {info['stop']['cause']}: {info['stop']['detail']}", flush=True)
                stopped = True
                break
    finally:
        env.close()
    draw_speeds(arguments.picture, trials, title=f"{env.settings.name}: desired and actual speed of the blade")
    print(f"picture: {arguments.picture}")
    return 3 if stopped else 0


def _cut(env: Any, policy: Any, *, seed: int, episode: int) -> tuple[Any, dict[str, Any]]:
    """Cut once; return desired and actual speed at each millisecond, and the last info."""
    import numpy as np

    from cutenv.report.speed_figure import SpeedTrial
    from cutenv.task.observation import commanded_speed

    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    parts, desired, ended = [], [], False
    while not ended:
        action = policy(observation)
        observation, _, ended, _, info = env.step(action)
        readings = env.cutting.readings.copy()
        parts.append(readings)
        desired.append(np.full(len(readings), float(commanded_speed(np.float64(action[0])))))
    joined = np.concatenate(parts)
    return SpeedTrial(joined["time"], np.concatenate(desired), joined["speed"], joined["force"]), info


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "rig speed",
        __doc__,
        examples=("emulator", "my_rig.toml --speeds 0.38 1.27 2.54 --target-length 80mm --picture speed.png"),
    )
    parser.add_argument("rig", metavar="RIG", help=RIG)
    parser.add_argument(
        "--speeds", type=float, nargs="+", default=[1.27], metavar="CM_S",
        help="desired speeds [cm/s], a cut for each, 0.1 to 2.54; default 1.27",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of drawn specimens; default 0")
    add_target_length(parser, "drawn from 60mm to 100mm")
    add_specimen_class(parser, "liver")
    parser.add_argument("--out", type=Path, default=Path("cuts"), metavar="FOLDER", help="folder of the records")
    parser.add_argument(
        "--picture", type=Path, default=Path("speed.png"), metavar="FILE.png", help="picture to draw; default speed.png"
    )
    return parser
