"""``cutenv/GentleCut-v1``: cut measured liver to a target length, gently."""

from __future__ import annotations

import inspect
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.validation import in_range, one_of
from cutenv._engine.jit import warn_before_first_compile
from cutenv.envs.constants import Constants, rig_constants
from cutenv.envs.gymnasium_facts import LimitedSpec, described, flat_info, most_steps
from cutenv.envs.tissue_source import TissueSource
from cutenv.sim.cutting.drive import DRIVES
from cutenv.sim.plant.simulator import ANGLE_RANGE, SimulatedPlant
from cutenv.sim.tissue.specimen import CLASSES, Specimen
from cutenv.sim.tissue.specimen_kernels import sample_all_profiles
from cutenv.task.beginning import LONGEST, SHORTEST, begin_one
from cutenv.task.declare import Task
from cutenv.task.episode import Episode, Goal, TaskOptions
from cutenv.task.info import COST, GROUPS, OUT_OF_RANGE
from cutenv.task.observation import CLIP, within_reach
from cutenv.task.reward import greatest_action
from cutenv.task.stepper import step_one

RESET_OPTIONS = ("specimen", "target_length", "episode")  # options of a reset
_UPDATES_HZ = 1000
_GROUPS = tuple((group, tuple(field.name for field in fields)) for group, fields in GROUPS.items())


class CutEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """Environment of cuts by seed and number, in the simulator or on a rig."""

    options: TaskOptions  # those that the task adds
    fixed_angle: float | None = None  # of the blade [rad]; None: an action turns it
    _seed: int | None = None
    _episode = 0
    _ended = True

    def settle(
        self, task: Task, control_hz: float, deadline_s: float, target_length: float | None, specimen_class: str
    ) -> None:
        """Check and keep what every cut shares; make the spaces."""
        one_of("specimen_class", specimen_class, CLASSES)
        check_rate(control_hz)
        self.deadline = in_range("deadline_s", deadline_s, 1.0, 3600.0, "s", "Give the seconds for a cut.")
        self.target_length = None if target_length is None else checked_length(target_length)
        self.specimen_class = specimen_class
        self.ticks = round(_UPDATES_HZ / control_hz)
        self.most_steps = most_steps(self.deadline, self.ticks)
        """Decisions after which a cut has ended, whatever was done."""
        self.metadata = {**self.metadata, "render_fps": control_hz}
        self.action_space = spaces.Box(-1.0, 1.0, (len(task.action_names),), np.float32)
        self.observation_space = spaces.Box(-CLIP, CLIP, (len(task.all_components),), np.float32)

    def asked(self, seed: int | None, options: dict[str, Any] | None) -> tuple[tuple[int, int], float | None, Any]:
        """Return a reset's seed and episode, target length [m] and specimen, if given."""
        super().reset(seed=seed)
        options = options or {}
        for name in options:
            one_of("option", name, RESET_OPTIONS)
        if seed is not None or self._seed is None:
            self._seed, self._episode = int(self.np_random.integers(2**63)) if seed is None else seed, 0
        episode = self._episode if options.get("episode") is None else checked_episode(options["episode"])
        length = self.target_length
        if options.get("target_length") is not None:
            length = checked_length(options["target_length"])
        return (self._seed, episode), length, options.get("specimen")

    @property
    def start_angle(self) -> float:
        """Angle of the blade at the start of a cut [rad]."""
        return ANGLE_RANGE[1] if self.fixed_angle is None else self.fixed_angle


@described
class GentleCutEnv(CutEnv):
    """Cut gently from the clamp to a target length.

    The crack tip is scored, not the blade, which leads it.  A scalpel cuts a slab of liver, 8 cm wide, 15 cm long and
    2.5 cm thick, clamped along the edge where the cut starts.  The blade drags tissue along (F = K (x - a)), the crack
    follows in sudden runs of several millimetres, and its tip is hidden: an agent sees a force.  Physics at 1 kHz,
    decisions at ``control_hz``.  Model and data: ``cutenv docs``. Many at once: ``gymnasium.make_vec``, see
    :class:`cutenv.envs.vector.GentleCutVectorEnv`.

    Action
    ------
    ``Box(-1, 1, (2,), float32)``; values outside are clipped, NaN is refused with a ValueError.

    {actions}

    A speed action has a dead zone, so that noise about 0 does not move the blade: -1 to -0.1: 2.54 to 0 cm/s back;
    -0.1 to 0.1: rest; 0.1 to 1: 0 to 2.54 cm/s forward.  ``cutenv.task.observation.to_action`` gives the action for
    a speed.  The drive follows through its lag and limits.  With ``angle_mode="fixed"`` the second number is ignored.

    Observation
    -----------
    ``{space}``: (value - offset) / scale, clipped; only what a rig can know.

    {components}

    Reward
    ------
    What is gained, at most 1 in all (progress, accuracy, success), less costs that add up at every millisecond, less a
    cost at the end.

    {terms}

    The stopping distance is v^2 / (2 x 0.1 m/s2): a blade that needs longer to stop than success allows for is not
    under control, whatever it meets.

    Doing nothing returns -0.1.  No return exceeds 1.  An end for safety also pays the time left, the whole weights of
    accuracy and success, a full wedge, and twice the weight of stored energy.  Weights can be replaced by keyword
    (``weight_jump=0.2``).  A miss gains nothing and is not charged: to a learner that discounts, a charge at the end is
    a reason to put off the end.

    Ends
    ----
    All are ``terminated``; ``truncated`` is always False; ``info["end"]`` names which: of several in one millisecond,
    the first counts.

    {ends}

    Unloaded is a force below friction + 0.1 N, at rest a speed below 0.5 mm/s.  Drawing back counts from where the
    tissue was last loaded; so an agent whose actions are noisy can finish too.

    Success (``info["is_success"]``): finished, tip within 3 mm of the target, blade within 10 degrees of upright.

    Arguments
    ---------
    =================== ======= ===========================================================================
    Keyword             Default Meaning
    =================== ======= ===========================================================================
    specimen_class      "mixed" "uniform", "liver", "vascular" (tough inclusions) or "mixed" (half each)
    target_length       None    length of the cut [m]; None: drawn from 0.060 to 0.100 m
    start_before_target None    the cut is already made to this far before the target [m]; None: not at all
    tissue              None    path of a tissue or specimen JSON file; None: the measured pig liver
    control_hz          50      decisions per second; divides 1000
    deadline_s          30.0    time for a cut [s]
    angle_mode          "free"  "free" or "fixed"
    fixed_angle_deg     90.0    angle of the blade if fixed [deg], 45 to 90
    reward_from         "truth" "truth" or "estimate" (tip from force, as on a rig)
    drive               "rig"   "rig" (holds position), "pd" (PD control) or "hand" (yields to force)
    rig                 None    a rig's TOML file; what it says of the rig replaces the parameter table's
    flat_info           False   True: infos are numbers alone, without groups
    render_mode         None    "rgb_array" or "human"
    =================== ======= ===========================================================================

    Besides, each constant of the parameter table (``acceleration``, ``motor_lag``, ``rotation_rate``, ``dead_time``,
    ``backlash``, ``force_noise``, ``force_resolution``, ``force_delay``, ``force_limit_per_depth``, ...; SI units) and
    each weight (``weight_<term>``), but that of safety, can be given by keyword, and wins over the rig's file; an
    unknown name is an error that names the nearest.

    Reset options: ``specimen`` (a :class:`~cutenv.sim.tissue.Specimen` or its JSON text), ``target_length`` [m],
    ``episode`` (number of the episode under the current seed).

    Info
    ----
    ``truth`` (hidden state), ``energy`` (in joules since reset: work, stored, fracture, friction, loss, ledger and
    residual, which is work minus all the others), ``reward_terms`` (of this step), ``cost_terms`` (of this
    step, in millimetres: overshoot_mm, by how much the tip's overshoot beyond the target grew, and long_runs_mm, the
    part of each run that is longer than 4 mm), ``cost`` (their sum; no part of the reward), ``speed_out_of_range``
    (blade outside 0.1 to 2.54 cm/s: the tissue answers as at the nearest measured speed) and, at the end, ``end`` and
    ``is_success``.

    Flat info
    ---------
    With ``flat_info=True``, for wrappers that take neither dictionaries nor text, an entry of a group is named after
    both (``truth_tip_m``), and all are numbers: ``truth_specimen_class`` counts in "uniform", "liver", "vascular" from
    0, ``end`` in the table above from 1, and flags are 0 or 1.  ``end`` and ``is_success`` are then there at every
    step, 0 until the end.

    Version history
    ---------------
    v1: the first version that is released; may change until the first comparison of agents is published.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "human"], "render_fps": 50}  # noqa: RUF012  as in Env
    spec = LimitedSpec()
    options_class: ClassVar[type[TaskOptions]] = TaskOptions
    """Task, and the options that it adds."""

    def __init__(
        self,
        *,
        specimen_class: str = "mixed",
        target_length: float | None = None,
        start_before_target: float | None = None,
        tissue: str | Path | None = None,
        control_hz: int = 50,
        deadline_s: float = 30.0,
        angle_mode: str = "free",
        fixed_angle_deg: float = 90.0,
        reward_from: str = "truth",
        drive: str = "rig",
        rig: str | Path | None = None,
        flat_info: bool = False,
        render_mode: str | None = None,
        **constants: Any,
    ) -> None:
        self.from_truth = reward_from == "truth"
        self.options = self.options_class(constants)
        self.task: Task = self.options.task if self.from_truth else self.options.task.seen
        """The task, as its reward is assessed."""
        one_of("angle_mode", angle_mode, ("free", "fixed"))
        one_of("reward_from", reward_from, ("truth", "estimate"))
        one_of("drive", drive, DRIVES)
        one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        in_range("fixed_angle_deg", fixed_angle_deg, 45.0, 90.0, "deg", "Measured are 45 to 90 degrees.")
        if angle_mode == "free" and fixed_angle_deg != 90.0:
            raise ValueError(f'fixed_angle_deg = {fixed_angle_deg:g} needs angle_mode="fixed"; it is "free".')
        self.settle(self.task, control_hz, deadline_s, target_length, specimen_class)
        self.tissue = TissueSource(tissue)
        self.start_before_target = start_before_target
        self.check_start(SHORTEST if self.target_length is None else self.target_length)
        self.render_mode = render_mode
        self.flat_info = one_of("flat_info", flat_info, (False, True))
        self.fixed_angle = math.radians(fixed_angle_deg) if angle_mode == "fixed" else None
        measured = {} if rig is None else rig_constants(rig, drive=drive)
        self.constants = Constants.from_keywords(
            {**measured, **constants},
            drive=drive,
            others=[*ARGUMENTS, *self.options_class.names],
            of=type(self).__name__,
        )
        self.greatest_action = greatest_action(self.constants.limits.top_speed)
        """Speed action to which faster ones are reduced."""
        self._check_dead_time()
        self.options.check_length(LONGEST if self.target_length is None else self.target_length)
        self._stepped = False  # a planner is shown cuts at their start, and steps none
        self._viewer: Any = None
        self._undrawn: list[StructArray] = []  # readings since the last picture
        self.plant: SimulatedPlant
        self.cutting: Episode
        self.specimen: Specimen

    def _check_dead_time(self) -> None:
        dead_time = getattr(self.constants.drive, "dead_time", 0.0)
        if dead_time * _UPDATES_HZ >= self.ticks:
            raise ValueError(
                f"dead_time = {dead_time:g} s is not below the {self.ticks} ms between decisions: no command would "
                "ever act. Decide less often (control_hz), or correct it."
            )

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw the next specimen, with the blade at the clamp.

        See the class for ``options``.
        """
        if self._seed is None:
            warn_before_first_compile(begin_one(self.task), sample_all_profiles)
        key, length, given = self.asked(seed, options)
        if length is not None:
            self.check_start(length)
        specimen = self.given_specimen(given)
        if specimen is None:
            specimen = self.options.surface.of(self.tissue.drawn(*key, self.specimen_class), *key)
        specimen = self.constants.wear.of(specimen)
        length = length or self.options.drawn_length(specimen.tissue, *key)
        depth = self.constants.knowledge.measure_depth(specimen.depth, *key)
        self.set_up(specimen, length, seed=key[0], episode=key[1], depth=depth)
        self._episode = key[1] + 1
        self._ended = False
        observation = self.cutting.rest(self.start_angle)
        if self.render_mode == "human":
            self.render()
        return observation, self._told(self._info())

    def check_start(self, length: float) -> None:
        """Raise ValueError unless 5 mm <= ``start_before_target`` < length [m]."""
        self.options.check_length(length)
        if self.start_before_target is None:
            return
        cure = "Distances are in metres: 10 mm is 0.01."
        if in_range("start_before_target", self.start_before_target, 0.005, 0.130, "m", cure) >= length:
            raise ValueError(
                f"start_before_target = {self.start_before_target:g} m must be less than the target length, which can "
                f"be {length:g} m. Give less, or None to begin at the clamp."
            )

    def given_specimen(self, option: Any) -> Specimen | None:
        """Return the specimen from option or ``tissue`` file; None: draw one."""
        if option is None:
            return self.tissue.specimen
        if isinstance(option, str):
            return Specimen.from_json(option)
        if not isinstance(option, Specimen):
            raise TypeError(f"specimen must be a cutenv.sim.tissue.Specimen or its JSON text, got {option!r}.")
        return option

    def set_up(
        self,
        specimen: Specimen,
        length: float,
        *,
        seed: int,
        episode: int,
        depth: NDArray[np.float64],
        noise: int = 0,
        begun: bool = True,
    ) -> None:
        """Put the blade to the start of a cut of ``length`` [m].

        ``depth`` [m] is that known to the lab.  ``noise`` is added to the seed of the sensor's noise.  Without
        ``begun`` what the task adds is left as it is before a cut begins.
        """
        constants, tissue = self.constants, specimen.tissue
        self.specimen = specimen
        self._undrawn.clear()
        self.plant = SimulatedPlant(
            specimen,
            drive=constants.drive,
            sensor=constants.sensor,
            law=constants.law,
            seed=seed + noise,
            episode=episode,
            angle=self.start_angle,
            depth=depth,
            motion=self.task.motion,
        )
        goal = Goal(
            tissue=tissue,
            weights=constants.weights,
            limits=constants.limits,
            start=0.0 if self.start_before_target is None else length - self.start_before_target,
            friction_per_depth=specimen.friction_per_depth if self.from_truth else tissue.nominal_friction_per_depth,
            target_length=length,
            deadline=self.deadline,
            ticks=self.ticks,
            key=(seed, episode) if begun else None,
        )
        self.cutting = self.options.episode(self.plant, goal, from_truth=self.from_truth)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Command target speed and angle until the next decision; see the class."""
        if self._ended:
            raise gymnasium.error.ResetNeeded("no cut is going on: call reset() before step().")
        command, names = np.array(action, np.float64), self.task.action_names
        if command.shape != (len(names),) or not within_reach(command, self.fixed_angle or math.nan):
            raise ValueError(
                f"action = {action!r} must hold {len(names)} numbers in [-1, 1] ({', '.join(names)}), "
                "and none may be NaN."
            )
        if (most := self.greatest_action) < 1.0:
            command[0] = min(max(command[0], -most), most)
        if not self._stepped:
            warn_before_first_compile(step_one(self.task))
            self._stepped = True
        cutting = self.cutting
        observation, reward = cutting.step(command)
        if self.render_mode is not None and cutting.readings is not None:
            self._undrawn.append(cutting.readings.copy())
        info = self._info()
        if cutting.end:
            self._ended = True
            info["end"] = cutting.end
            info["is_success"] = cutting.success
        if self.render_mode == "human":
            self.render()
        return observation, reward, self._ended, False, self._told(info)

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        return flat_info(info, self.task.ends) if self.flat_info else info

    def _info(self) -> dict[str, Any]:
        numbers = self.cutting.info()
        following = iter(numbers)  # the groups are the first fields, in order; slices and strict=True would take longer
        info: dict[str, Any] = {group: dict(zip(names, following)) for group, names in _GROUPS}  # noqa: B905
        info["truth"]["specimen_class"] = self.specimen.specimen_class
        info["cost"], info["speed_out_of_range"] = numbers[COST], numbers[OUT_OF_RANGE] > 0
        if group := self.task.shown_as:
            truth, info[group] = self.cutting.truth_and_errors
            info["truth"] |= truth
            info["reward_terms"] |= self.cutting.whole_terms
        return info

    @property
    def force_limit_per_depth(self) -> float:
        """Force per depth of cut that ends an episode [N/m]."""
        return self.constants.limits.force_limit_per_depth

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the cut: an "rgb_array" (height, width, 3), or a window."""
        if self.render_mode is None:
            gymnasium.logger.warn('render() needs gymnasium.make(..., render_mode="rgb_array" or "human").')
            return None
        if not hasattr(self, "plant"):
            raise gymnasium.error.ResetNeeded("there is nothing to draw yet: call reset() before render().")
        if self._viewer is None:
            from cutenv.display.viewer import CutViewer  # drawing is an extra

            self._viewer = CutViewer(window=self.render_mode == "human", fps=self.metadata["render_fps"])
        readings = np.concatenate(self._undrawn) if self._undrawn else None
        self._undrawn.clear()
        picture: NDArray[np.uint8] = self._viewer.draw(self.plant, self.cutting, readings)
        return picture if self.render_mode == "rgb_array" else None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._viewer is not None:
            self._viewer.close()
            self._viewer = None


def check_rate(control_hz: float) -> None:
    """Refuse a decision rate [Hz] that does not divide the physics' rate."""
    in_range("control_hz", control_hz, 1, _UPDATES_HZ, "Hz", "Give decisions per second, 50 by default.")
    if _UPDATES_HZ % control_hz or control_hz % 1:
        rates = ", ".join(str(rate) for rate in range(1, _UPDATES_HZ + 1) if _UPDATES_HZ % rate == 0)
        raise ValueError(f"control_hz = {control_hz:g} does not divide {_UPDATES_HZ}. Take one of {rates}.")


ARGUMENTS = [
    name
    for name, argument in inspect.signature(GentleCutEnv.__init__).parameters.items()
    if argument.kind is inspect.Parameter.KEYWORD_ONLY
]
"""Keywords of the environment that are no constants."""


def checked_episode(episode: float) -> int:
    """Return an episode number as int; raise ValueError if invalid."""
    cure = "Give the whole number of an episode, counted from 0."
    if in_range("episode", episode, 0, 2**63, "1", cure) % 1.0:
        raise ValueError(f"episode = {episode:g} is not a whole number. {cure}")
    return int(episode)


def checked_length(length: float) -> float:
    """Return a target length [m]; raise ValueError if it cannot fit."""
    return in_range(
        "target_length", length, 0.015, 0.130, "m", "Lengths are in metres: 80 mm is 0.08; a specimen is 0.15 m long."
    )


def listed(names: Sequence[str]) -> str:
    """Return names as a text: "speed and angle"."""
    return " and ".join([*([", ".join(names[:-1])] if len(names) > 1 else []), names[-1]])
