"""Batched rollout of a trained policy: all cuts in one vector environment, bit for bit equal to single cuts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv.cutting.dtypes import READING, TICK
from cutenv.cutting.simulate import simulate
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.learning.finished_cut import FinishedCut
from cutenv.policy import TrainedPolicy
from cutenv.task.cuts import Cuts
from cutenv.task.episode_dtypes import TERMS
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, SPEED_SCALE, all_within_reach


def batched_rollout(policy: TrainedPolicy, seeds: Sequence[int], arguments: Mapping[str, Any]) -> list[FinishedCut]:
    """Return the first cut of each seed, in environments made with ``arguments``."""
    environments = GentleCutVectorEnv(len(seeds), **arguments)
    batch = policy.batch(len(seeds))
    observations, _ = environments.reset(seed=list(seeds))
    start = Cuts(*(part.copy() for part in environments.cuts))
    fixed = environments.single.fixed_angle or np.nan
    over, none_waits = np.zeros(len(seeds), bool), np.zeros(len(seeds), bool)
    totals, over_limit = np.zeros((len(seeds), len(TERMS))), np.zeros(len(seeds))
    commanded: list[np.ndarray] = []
    result: dict[int, FinishedCut] = {}
    while not over.all():  # cuts that are over start again, and are ignored
        commands = np.array(batch(observations), np.float64)
        observations, _, ended, _, info = environments.step(commands)  # type: ignore[arg-type]  # takes float64 too
        all_within_reach(commands, none_waits, fixed)  # writes the fixed angle into them
        commanded.append(commands)
        going = ~over
        totals[going] += np.stack([info["reward_terms"][name] for name in TERMS], axis=1)[going]
        over_limit[going] = np.maximum(over_limit, info["cost"]["force_N"])[going]
        for n in np.flatnonzero(ended & going).tolist():
            updates = round(float(environments.cuts.progresses["time"][n]) / TICK)
            truth = {name: values[n] for name, values in info["truth"].items() if not name.startswith("_")}
            readings = replayed(start, n, np.array(commanded)[:, n], environments.single.ticks, updates)
            assert readings["tip"][-1] == truth["tip_m"], "a repeated cut gives the same tip"
            result[n] = FinishedCut(
                seed=int(seeds[n]),
                end=str(info["end"][n]),
                success=bool(info["is_success"][n]),
                truth=truth,
                reward_totals=dict(zip(TERMS, totals[n].tolist(), strict=True)),
                over_limit_N=float(over_limit[n]),
                readings=readings,
                depth=start.profiles["depth"][n].copy(),
                resistance=start.specimens["fracture_resistance"][n].copy(),
            )
            over[n] = True
    return [result[n] for n in range(len(seeds))]


def replayed(start: Cuts, n: int, commands: np.ndarray, ticks: int, updates: int) -> StructArray:
    """Simulate cut ``n`` again by its commands, shape (decisions, 2), in [-1, 1]; return every reading."""
    readings = np.zeros(len(commands) * ticks, READING)
    speeds, angles = SPEED_SCALE * commands[:, 0], ANGLE_CENTRE + ANGLE_SCALE * commands[:, 1]
    copies = [part[n : n + 1].copy() for part in start[:5]]
    arguments: list[Any] = [*(part[0] for part in copies), speeds, angles, TICK, readings]
    simulate(*arguments)
    return readings[:updates]
