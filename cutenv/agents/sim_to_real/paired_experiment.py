"""Comparison of one policy in the simulator and on a rig.

It cuts the same specimens, recorded and assessed alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range
from cutenv.agents.policy import Policy, PrivilegedPolicy
from cutenv.agents.sim_to_real import FEWEST_SPECIMENS, Agreement, ClockKept, ComparedCut
from cutenv.agents.sim_to_real.identification import LOST_TIME
from cutenv.agents.sim_to_real.specimen_twin import fit_twin, held_out
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import save
from cutenv.rig.errors import RigError
from cutenv.rig.operation.suitability import simulator_keywords
from cutenv.rig.safety.stop_causes import ENDS_SESSION, Cause
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant.protocol import to_trace
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.specimen import Specimen
from cutenv.task.reward import STOPPED

DRAWS = 5  # number of simulated cuts of each specimen, which differ only by the noise of the force sensor
_OUR_HEARTBEAT = "0x8130"  # Emergency of a drive that has missed this computer's heartbeat
_ATTEMPTS = 5  # for one specimen
_NOISE_KEY = 1_000_003  # added to a seed for every further draw of noise
ProgressCallback = Callable[[str, int], None]


@dataclass(kw_only=True)
class PairedCuts:
    """Cuts of a comparison."""

    simulator: list[list[ComparedCut]]  # several cuts of each specimen
    rig: list[ComparedCut]  # one cut of each specimen
    paired: bool  # True if both cut the same specimens
    clock: ClockKept  # timing of the rig's control clock
    between: list[str]  # notes on cuts that were repeated, and the reason if the rig ended early
    # True if the simulator's are twins of the rig's; both sides then hold the part of each cut that was held out
    twins: bool = False

    @property
    def agreement(self) -> Agreement:
        """Return the agreement over specimens cut on both sides."""
        simulator = self.simulator[: len(self.rig)] if self.paired else self.simulator
        return Agreement(self.rig, simulator, paired=self.paired, twins=self.twins)


def simulator_like(rig: RigCutEnv, **arguments: Any) -> GentleCutEnv:
    """Make the simulator's environment with a rig's constants and estimates.

    Further keywords of :class:`~cutenv.envs.gentle_cut.GentleCutEnv` override those of the rig.
    """
    fixed = rig.fixed_angle is not None
    control = rig.settings.position_control
    return rig.simulated(
        reward_from="estimate",
        drive="rig" if control is None else "pd",
        angle_mode="fixed" if fixed else "free",
        fixed_angle_deg=float(np.degrees(rig.start_angle)) if fixed else 90.0,
        **{**rig.as_simulated, **rig.options.given, **simulator_keywords(rig.settings), **arguments},
    )


def cut_once(
    env: GentleCutEnv | RigCutEnv,
    policy: Policy,
    *,
    seed: int,
    episode: int,
    noise: int = 0,
    specimen: Specimen | None = None,
    target_length: float | None = None,
    depth: NDArray[np.float64] | None = None,
) -> ComparedCut:
    """Cut one specimen.

    The policy's random numbers depend on seed and episode alone, the key of the specimen unless ``specimen`` is what is
    cut.  ``noise`` is the number of the draw of the simulated sensor's; ``target_length`` [m] is by default as the
    environment has it; ``depth``, (301,), is that of a ``specimen`` as it is known in the simulator [m], by default as
    it is.

    Raises ValueError if the policy needs hidden state; RigError if a check of the rig fails, its operator does not
    agree, or it was stopped before the blade had moved.
    """
    if isinstance(policy, PrivilegedPolicy):
        raise ValueError("this policy needs the hidden state, which no rig knows; choose another.")
    given = {"specimen": specimen, "target_length": target_length}
    options = {"episode": episode, **{name: value for name, value in given.items() if value is not None}}
    observation, _ = env.reset(seed=seed, options=options)
    if (noise or specimen is not None) and isinstance(env, GentleCutEnv):
        length, known = env.cutting.target_length, env.plant.depth if specimen is None else specimen.depth
        depth = known if depth is None else depth
        env.set_up(env.specimen, length, seed=seed, episode=episode, depth=depth, noise=noise * _NOISE_KEY)
        observation = env.cutting.rest(env.start_angle)
    policy.reset(np.random.default_rng([seed, episode]))
    cutting, plant = env.cutting, env.cutting.plant
    parts, beside, value, ended = [], [], 0.0, False
    while not ended:
        observation, reward, ended, _, _ = env.step(policy(observation))
        value += reward
        assert cutting.readings is not None  # at least one step was made
        parts.append(cutting.readings.copy())
        beside.append(cutting.channels)
    if sum(map(len, parts)) < 2:
        raise RigError("the blade was stopped before it had moved: there is no cut.")
    about = {**cutting.noted, "specimen_seed": seed, "specimen_episode": episode}
    measured: dict[str, Any] = {name: np.concatenate([each[name] for each in beside]) for name in beside[0]}
    trace = to_trace(
        plant, np.concatenate(parts),
        name=f"{seed}-{episode}", end=cutting.end, success=cutting.success, **about,
    )  # fmt: skip
    trace = dataclasses.replace(trace, **measured)
    return ComparedCut(trace=trace, value=value, success=cutting.success, end=cutting.end)


def simulate_cuts(
    env: GentleCutEnv,
    policy: Policy,
    *,
    seed: int,
    specimens: int,
    draws: int = DRAWS,
    specimen: Specimen | None = None,
    progress: ProgressCallback | None = None,
) -> list[list[ComparedCut]]:
    """Cut every specimen ``draws`` times with varied sensor noise.

    Return the cuts by specimen.  With a ``specimen`` all of them are that one.
    """
    cuts = []
    for episode in range(specimens):
        key: dict[str, Any] = {"seed": seed, "episode": episode, "specimen": specimen}
        cuts.append([cut_once(env, policy, noise=draw, **key) for draw in range(draws)])
        if progress is not None:
            progress("simulator", episode + 1)
    return cuts


def cut_twins(
    env: GentleCutEnv,
    policy: Policy,
    rig: Sequence[ComparedCut],
    *,
    seed: int,
    draws: int = DRAWS,
    progress: ProgressCallback | None = None,
) -> tuple[list[ComparedCut], list[list[ComparedCut]], list[str]]:
    """Let a policy cut twins of rig specimens, keeping the held-out parts.

    ``seed`` is that of what the twins do not know, the tissue beyond the fitted part and the sensor's noise; each twin
    is cut ``draws`` times, with another draw of both.  Return the held-out parts of the rig's cuts, those of the
    simulator's, and notes on cuts that are too short for a twin.
    """
    tissue = env.tissue.tissue or measured_liver()
    kept, simulated, notes = [], [], []
    for episode, cut in enumerate(rig):
        try:
            twin = fit_twin(cut.trace, tissue, law=env.constants.law, force_delay=env.constants.sensor.force_delay)
        except ValueError as error:
            notes.append(f"specimen {episode + 1} has no twin: {error}")
            continue
        length = cut.trace.metadata.get("target_length_m")
        rng = np.random.default_rng([seed, episode])
        key: dict[str, Any] = {"seed": seed, "episode": episode, "target_length": length}
        known = twin.specimen.depth
        twins = []
        for draw in range(draws):
            measured = env.constants.knowledge.measure_depth(known, seed + _NOISE_KEY * (draw + 1), episode)
            laid = twin.drawn(rng, measured)
            twins.append(cut_once(env, policy, noise=draw + 1, specimen=laid, depth=known, **key))
        parts = [dataclasses.replace(each, trace=held_out(each.trace, twin.until)) for each in (cut, *twins)]
        kept.append(parts[0])
        simulated.append(parts[1:])
        if progress is not None:
            progress("simulator", episode + 1)
    return kept, simulated, notes


def cut_on_rig(
    env: RigCutEnv,
    policy: Policy,
    *,
    seed: int,
    specimens: int,
    specimen: Specimen | None = None,
    progress: ProgressCallback | None = None,
) -> tuple[list[ComparedCut], ClockKept, list[str]]:
    """Cut every specimen once; again as :func:`cut_again` does.

    Return cuts, the timing of the control clock over all of them, and notes on cuts that were repeated and on the
    reason if the rig ended early: the cuts until then are still useful.

    Raises RigError if the rig cannot be created.
    """
    cuts: list[ComparedCut] = []
    parts: list[tuple[list[float], list[float], int, float, int]] = []
    between: list[str] = []
    for episode in range(specimens):
        cut = cut_again(env, policy, between, seed=seed, episode=episode, specimen=specimen)
        if cut is None:
            break
        cuts.append(cut)
        timing = env.session.plant.timing
        parts.append((timing.periods, timing.latencies, timing.overruns, timing.skipped, timing.garbled))
        if progress is not None:
            progress("rig", len(cuts))
    return cuts, ClockKept.of(env.ticks * TICK, parts), between


def cut_again(
    env: RigCutEnv, policy: Policy, between: list[str], *, seed: int, episode: int, **given: Any
) -> ComparedCut | None:
    """Cut one specimen as :func:`cut_once` does.

    Again, up to four times, if the rig was stopped by a delay of the computer; notes on that are added to ``between``.
    Return None if the rig cannot go on, and the last note says why.
    """
    lost = False
    for _ in range(_ATTEMPTS):
        try:
            cut = cut_once(env, policy, seed=seed, episode=episode, **given)
        except RigError as error:
            between.append(f"specimen {episode + 1}: {error}")
            lost = lost or _time_was_lost(env)
            if not lost:
                return None
            if not _time_was_lost(env):
                env.close()  # drives that were left in mid-motion are connected again
            continue
        if cut.end == STOPPED:
            report = env.session.plant.supervisor.report
            if _time_was_lost(env):
                lost = True
                between.append(f"specimen {episode + 1} was cut again: {report}")
                continue
            if report is not None and report.cause in ENDS_SESSION:
                between.append(f"specimen {episode + 1}: {report}")
                return None
        return cut
    return None


def _time_was_lost(env: RigCutEnv) -> bool:
    """Return True if the rig was stopped by computers, not cutting."""
    supervisor = env.session.plant.supervisor
    report = supervisor.report
    if supervisor.phase != "stopped" or report is None:
        return False
    return report.cause in LOST_TIME or (report.cause is Cause.DRIVE and _OUR_HEARTBEAT in report.detail)


def paired_experiment(
    rig: RigCutEnv,
    simulator: GentleCutEnv,
    policy: Policy,
    *,
    seed: int = 0,
    specimens: int = 12,
    draws: int = DRAWS,
    specimen: Specimen | None = None,
    unknown: bool | None = None,
    progress: ProgressCallback | None = None,
) -> PairedCuts:
    """Let a policy cut equal specimens in simulator and on rig.

    They are the episodes 0, 1, ... of the seed, or all the same ``specimen``, where its tissue is known, such as blocks
    from one mould; the simulator cuts each ``draws`` times, 2 to 100. Specimens that are not drawn are made equal by
    their twins, which are fitted to the first half of each record; the second halves are compared. Tasks with a third
    axis have no twins: then the two sides are two samples. ``unknown`` treats an emulated or fake rig's specimens as
    those of a lab.
    """
    in_range("specimens", specimens, FEWEST_SPECIMENS, 10_000, "1", "A dozen is a beginning.")
    in_range("draws", draws, 2, 100, "1", "Noise needs two simulated cuts or more.")
    unknown = not rig.draws_specimens if unknown is None else unknown
    laid = specimen if rig.draws_specimens else None  # a lab lays it
    twins = unknown and specimen is None and not rig.needs_axis
    expected: list[list[ComparedCut]] = []
    if not twins:
        expected = simulate_cuts(
            simulator, policy, seed=seed, specimens=specimens, draws=draws, specimen=specimen, progress=progress
        )
    cuts, clock, between = cut_on_rig(rig, policy, seed=seed, specimens=specimens, specimen=laid, progress=progress)
    if twins:
        cuts, expected, notes = cut_twins(simulator, policy, cuts, seed=seed, draws=draws, progress=progress)
        between += notes
    paired = twins or specimen is not None or not unknown
    return PairedCuts(simulator=expected, rig=cuts, paired=paired, clock=clock, between=between, twins=twins)


def save_records(folder: Path, cuts: Sequence[Sequence[ComparedCut]], about: Mapping[str, Any]) -> list[Path]:
    """Write simulated cuts as rig records ``EPISODE-DRAW.csv``; return paths."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for episode, draws in enumerate(cuts):
        for draw, cut in enumerate(draws):
            metadata = {**cut.trace.metadata, **about, "noise_draw": draw}
            paths.append(folder / f"{episode:03d}-{draw}.csv")
            save(cut.trace.with_metadata(metadata), paths[-1])
    return paths
