"""Cuts by a person: straight on, along a wanted depth, or along a drawn line.

The environment's own task at 1 kHz, with every reading kept, scored as any other cut.  Near the target words say what
is still missing to finish, also from what a rig measures.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._base.validation import in_range
from cutenv.agents.policy.interface import in_si
from cutenv.agents.policy.tip_estimate import CUT_ESTIMATE, TipEstimate
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv, to_path_action
from cutenv.people.play.hand_led_cut import HandLedCut
from cutenv.people.play.hand_model import PLAYED_HAND, descent_toward, hand_over_slab, speed_toward, steered_toward
from cutenv.people.play.handle_body import Handle, HandlePose
from cutenv.people.play.haptics import FeltForce, Stylus
from cutenv.records.scoring import ReferenceSet, ScoreCard, score
from cutenv.records.scoring.points import DEADLINE
from cutenv.records.scoring.truth import TIP_AT_END
from cutenv.sim.cutting.dtypes import READING, TICK
from cutenv.sim.plant.protocol import to_trace
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.quantities import ANGLE_TOLERANCE, TIP_TOLERANCE
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.trace import Trace
from cutenv.task.assessment import FORCE_UNLOADED, NEAR_TARGET, SPEED_AT_REST
from cutenv.task.observation import COMPONENTS, to_action
from cutenv.task.path import PATH_CUT
from cutenv.task.reward import TIME_AT_REST, WITHDRAWN

UPDATES_HZ = round(1.0 / TICK)
FEWEST_READINGS = 100
"""Least number of readings that makes an abandoned cut a record: a tenth of a second."""
_ESTIMATED_EVERY = 20  # ms: as often as an agent decides
_SHORTEST_RETREAT = 1e-3  # [m] to advise: a hand cannot aim at less
_AT_LATERAL = [each.name for each in PATH_CUT.all_components].index("lateral")
_LATERAL = PATH_CUT.all_components[_AT_LATERAL]


@dataclass(frozen=True, kw_only=True)
class NearTarget:
    """Measured and estimated state of a cut near its target."""

    force: float  # measured [N]
    elastic: float  # the tissue's part of it as estimated [N]
    friction: float  # of the moving blade, estimated [N]
    stiffness: float  # K of the slab at the tip, estimated [N/m]
    speed: float  # of the blade [m/s]
    angle: float  # [rad]; pi/2 is upright
    rested: float  # at rest and unloaded so far [s]
    withdrawn: float  # drawn back since the tissue was last loaded [m]


def missing_to_finish(cut: NearTarget, *, force_shown: bool = True) -> tuple[str, ...]:
    """Return what is missing to finish a cut, most urgent first.

    Without ``force_shown`` it names no force, nor the distance that follows from it.
    """
    missing = []
    if abs(0.5 * math.pi - cut.angle) > ANGLE_TOLERANCE:
        missing.append(f"turn the blade upright: {math.degrees(cut.angle):.0f}°")
    # Friction is estimated: a blade at rest whose rest does not count is loaded, whatever the estimate says.
    if cut.rested == 0.0 and (abs(cut.speed) < SPEED_AT_REST or cut.force > cut.friction + FORCE_UNLOADED):
        # While the blade draws back, friction lowers the force: nothing is felt once friction holds what still pulls.
        back = max((cut.elastic - cut.friction) / cut.stiffness, _SHORTEST_RETREAT)
        words = f"{max(cut.force, 0.0):.1f} N still pull: draw back {back * 1e3:.0f} mm"
        missing.append(words if force_shown else "it still pulls: draw back")
    else:
        words = f"hold still for {max(TIME_AT_REST - cut.rested, 0.0):.1f} s"
        if cut.rested == 0.0:
            words += f", or draw back {max(WITHDRAWN - cut.withdrawn, 0.0) * 1e3:.0f} mm"
        missing.append(words)
    return tuple(missing)


class PlayedCut(HandLedCut):
    """Cut of one specimen by a person's hand.

    It is an episode of ``GentleCutEnv(drive="hand", control_hz=1000)`` with the same seed: specimen, target, ends and
    reward are those of an agent. Its decisions are a millisecond apart.

    Parameters
    ----------
    specimen_class : str
        "uniform", "liver", "vascular" or "mixed".
    seed, episode : int
        Key of specimen, target and noise.
    target_length : float, optional
        Length of the cut [m]; drawn from 0.060 to 0.100 by default.
    handle : Handle, optional
        Handle for the picture, which follows the cut.
    **task
        Further arguments of the environment.

    Raises
    ------
    ValueError
        If a value is out of range.
    """

    channels: tuple[str, ...] = ()
    """Channels of the record that a cut straight on has not, as fields of a trace."""

    def __init__(
        self,
        *,
        specimen_class: str = "liver",
        seed: int = 0,
        episode: int = 0,
        target_length: float | None = None,
        handle: Handle | None = None,
        **task: Any,
    ) -> None:
        self.specimen_class, self.seed, self.episode = specimen_class, seed, episode
        in_range("seed", seed, 0, 2**63 - 1, "1", "Give a whole number from 0.")
        self._env = self.environment(
            specimen_class=specimen_class,
            target_length=target_length,
            deadline_s=DEADLINE,
            control_hz=UPDATES_HZ,
            **self._drive(),
            **task,
        )
        self._handle = handle
        self._first, self._info = self._env.reset(seed=seed, options={"episode": episode})
        self._readings: StructArray = np.zeros(round(DEADLINE * UPDATES_HZ) + 1, READING)
        self._further = np.zeros((len(self._readings), len(self.channels)))
        self._count = 0
        self._tip_estimate = TipEstimate()
        self._estimate: Struct = np.zeros(1, CUT_ESTIMATE)[0]
        self.end = ""
        """Cause of the end, one of the environment's ends; empty while the cut goes on."""

    def _drive(self) -> dict[str, Any]:
        return {"drive": "hand", **dataclasses.asdict(PLAYED_HAND)}

    @property
    def plant(self) -> SimulatedPlant:
        """Simulated plant of this cut."""
        return self._env.plant

    @property
    def truth(self) -> dict[str, Any]:
        """Hidden state and energies [J] for practice, as in ``info``."""
        told: dict[str, Any] = self._info["truth"] | self._info["energy"]
        return told

    @property
    def readings(self) -> StructArray:
        """Every reading so far, shape (n,); existing ones do not change."""
        return self._readings[: self._count]

    @property
    def hand(self) -> float:
        """Hand's position from the clamp [m], to which the blade is coupled."""
        return float(self.plant.states["hand"][0])

    @property
    def hand_place(self) -> tuple[float, float]:
        """Hand's place along and left across the slab [m]."""
        return self.hand, 0.0

    @property
    def lateral_force(self) -> Array:
        """Measured blade force to its right so far [N], or shape (0,)."""
        return np.zeros(0)

    @property
    def pose(self) -> HandlePose | None:
        """Pose of the drawn handle, if there is one."""
        return None if self._handle is None else self._handle.pose

    def tick(self, stylus: Stylus) -> None:
        """Advance a millisecond by a person's hand, until the end."""
        if self.end:
            return
        state = self.plant.states[0]
        self._observation, _, ended, _, self._info = self._env.step(self.action(stylus))
        assert self.cutting.readings is not None  # at least one step was made
        self._readings[self._count] = reading = self.cutting.readings[0]
        if self._count % _ESTIMATED_EVERY == 0:
            gentle = self._observation[: len(COMPONENTS)]
            self._estimate = self._tip_estimate.estimates(in_si(gentle)[None])[0]
        self._further[self._count] = self._sampled()
        self._count += 1
        if ended:
            self.end = self._info["end"]
        if self._handle is not None:
            self._handle.step(
                hand=float(state["hand"]),
                hand_speed=float(state["hand_speed"]),
                angle=float(state["angle"]),
                force=float(reading["true_force"]),
                depth=float(depth_below(self.plant.depth, state["blade"])),
            )

    def _sampled(self) -> tuple[float, ...]:
        return ()

    def _noted(self) -> dict[str, Any]:
        """Return what the record notes of another task."""
        noted = self.cutting.noted_map
        return noted and {"environment": self.cutting.task.environment, **noted}

    def _channel(self, name: str) -> Array:
        return self._further[: self._count, self.channels.index(name)]

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the environment's action for what the person wants."""
        return to_action(speed_toward(stylus.position, self.plant.states[0]), stylus.angle)

    def felt(self, felt: FeltForce, stylus: Stylus) -> float:
        """Return the force for the person's hand by the coupling [N]."""
        return felt.update(stylus.position, float(self.readings["position"][-1]))

    @property
    def map_words(self) -> str:
        """Depth or path so far in words, or ""."""
        return ""

    @property
    def leader_words(self) -> str:
        """Words for who leads now, "" if only a person does."""
        return ""

    def missing(self, *, practice: bool, force_shown: bool = True) -> tuple[str, ...]:
        """Return what is missing to finish, empty far from the target.

        It is told from what a rig measures; in ``practice``, a tip that is short of the target is all that is missing.
        Without ``force_shown`` no force is named.
        """
        progress = self.cutting.progress[0]
        if self.end or not self._count or progress["furthest"] < self.target_length - NEAR_TARGET:
            return ()
        short = self.target_length - float(self.plant.states["tip"][0])
        if practice and short > TIP_TOLERANCE:
            return (f"the tip is {short * 1e3:.1f} mm short: cut on",)
        reading, estimate = self._readings[self._count - 1], self._estimate
        depth = depth_below(self.plant.depth, float(reading["position"]))
        near = NearTarget(
            force=float(reading["force"]),
            elastic=float(estimate["elastic"]),
            friction=float(self._tip_estimate.memory[0]["friction_per_depth"]) * depth,
            stiffness=float(estimate["stiffness"]),
            speed=float(reading["speed"]),
            angle=float(reading["angle"]),
            rested=float(progress["quiet"]),
            withdrawn=float(progress["loaded_at"]) - float(reading["position"]),
        )
        return missing_to_finish(near, force_shown=force_shown)

    def trace(self, **metadata: object) -> Trace:
        """Return the trace that a rig would have recorded.

        Raises ValueError if there are fewer than two readings.
        """
        noted = {"target_length_m": self.target_length, TIP_AT_END: round(float(self.readings["tip"][-1]), 6)}
        trace = to_trace(self.plant, self.readings, **noted, **self._noted(), **metadata)
        further: dict[str, Any] = {name: self._channel(name).copy() for name in self.channels}
        return dataclasses.replace(trace, **further)

    def card(self, trace: Trace) -> ScoreCard:
        """Return its record's score as ``cutenv score``, with noted tip."""
        return score(trace, target_length=self.target_length, reference=ReferenceSet.shipped())


class PlayedDepthCut(PlayedCut):
    """Cut of one specimen by a hand along a wanted depth.

    The blade goes to the level that is asked for.

    It is an episode of ``DepthCutEnv(drive="hand", control_hz=1000)`` with the same seed.  Along the cut the hand holds
    the blade by a spring; up and down the blade is led as a drive leads it.
    """

    environment = DepthCutEnv
    channels = ("height", "vertical_force")
    third = "level"

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self._start = self.level

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the environment's action, with descent to the wanted level."""
        descent = descent_toward(self.level, self._start + stylus.level)
        return np.append(super().action(stylus), np.float32(np.clip(descent, -1.0, 1.0)))

    def _sampled(self) -> tuple[float, ...]:
        return self.level, float(self.cutting.across[0])

    @property
    def map_words(self) -> str:
        """Depth of the cut so far in words."""
        found = self.cutting.errors
        opened = found["layer_mm"]
        below = f"{opened:.1f} mm into the layer below" if opened > 0.0 else "the layer below is not opened"
        return f"Depth: {found['mean_error_mm']:.1f} mm off the wanted one in the mean; {below}."


class PlayedPathCut(PlayedCut):
    """Cut of one specimen by a hand along a drawn line.

    The blade points where the hand is moved.

    It is an episode of ``PathCutEnv(drive="hand", control_hz=1000)`` with the same seed.  The blade hangs on the hand
    by a spring, behind it; it turns toward the place where the hand is wanted, at the task's rate of turn at most.
    """

    environment = PathCutEnv
    channels = ("blade_x", "blade_y", "lateral_force")
    third = "across"

    @property
    def places(self) -> Array:
        """Blade places along and across the slab [m], shape (n, 2)."""
        return self._further[: self._count, :2]

    @property
    def lateral_force(self) -> Array:
        """Measured blade force to its right [N], shape (n,)."""
        return self._channel("lateral_force")

    @property
    def hand_place(self) -> tuple[float, float]:
        """Hand's place along and left across [m], ahead of the blade."""
        along, across = hand_over_slab(self.plant.states[0], self.cutting.motion[0])
        return float(along), float(across)

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the environment's action: speed, and turn toward the hand."""
        speed, turn = steered_toward(
            self.plant.states[0], self.cutting.motion[0], (stylus.position, stylus.across), PLAYED_HAND.motor_lag,
            PLAYED_HAND.acceleration,
        )  # fmt: skip
        return to_path_action(float(speed), stylus.angle, float(turn))

    def _sampled(self) -> tuple[float, ...]:
        return *self.cutting.blade_place, _LATERAL.scale * float(self._observation[_AT_LATERAL])

    @property
    def map_words(self) -> str:
        """Path of the cut so far in words."""
        found = self.cutting.errors
        mean, largest = found["mean_distance_mm"], found["largest_distance_mm"]
        area = found["area_mm2"]
        return f"Path: {mean:.1f} mm off the line in the mean, {largest:.1f} mm at most; {area:.0f} mm² between them."
