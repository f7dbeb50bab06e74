"""Cuts along a wanted depth and along a line to be scored, each made once."""

from __future__ import annotations

import functools
from typing import Any

from cutenv.agents.policy.depth_policies import HoldDepth
from cutenv.agents.policy.path_policies import PATH_SCRIPTS
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.sim.tissue.lines import half_ellipse
from cutenv.sim.trace import Trace
from scripts.validation.scoring import check_score

LINE = half_ellipse(0.11, 0.015)


@functools.cache
def map_cut(task: str) -> tuple[float, Trace, Any]:
    """A cut that holds one depth where a step is wanted, or cuts a corner: return, record, and cutting of the task."""
    if task == "depth":
        env: Any = DepthCutEnv(wanted="step", target_length=0.06)
        return *check_score.depth_cut(env, HoldDepth(), seed=4), env.cutting
    env = PathCutEnv(line=LINE, target_length=0.07)  # the blade keeps to the line, and so the cut does not
    return *check_score.path_cut(env, PATH_SCRIPTS["blade on the line"](), seed=4), env.cutting


def without(trace: Trace, *keys: str, **more: Any) -> Trace:
    """A record without some metadata, and with others."""
    return trace.with_metadata({key: value for key, value in trace.metadata.items() if key not in keys} | more)
