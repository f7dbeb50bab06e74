"""Environments on a rig, real or emulated, through the simulator's spaces.

``cutenv/RigCut-v1`` is gentle cutting. ``cutenv/RigDepthCut-v1`` cuts along a wanted depth, on a rig with a height
axis. ``cutenv/RigPathCut-v1`` cuts along a line, on a rig with an axis to the side.
"""

from __future__ import annotations

import inspect
import math
import reprlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import gymnasium
import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import in_range, one_of
from cutenv._engine.jit import warn_before_first_compile
from cutenv.envs.constants import Constants
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.gentle_cut import CutEnv, GentleCutEnv
from cutenv.envs.gymnasium_facts import LimitedSpec, described
from cutenv.envs.path_cut import PathCutEnv
from cutenv.envs.rig_source import RigSource
from cutenv.envs.tissue_source import TissueSource
from cutenv.records.appending import CutListener
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.contradictions import AHEAD
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import Operator
from cutenv.rig.operation.session import RigSession, SpecimenKey
from cutenv.rig.operation.suitability import top_speed
from cutenv.rig.plant import RigPlant
from cutenv.rig.safety.oversight import interrupt
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.sim.plant import Plant, SimulatedPlant
from cutenv.sim.tissue.description import TissueDescription, measured_liver
from cutenv.sim.tissue.grid import POINTS_PER_METRE
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.specimen import Specimen
from cutenv.task.beginning import LONGEST
from cutenv.task.declare import WAYS, Task
from cutenv.task.depth import DepthConstants, DepthEpisode, DepthOptions
from cutenv.task.episode import Episode, Goal, TaskOptions
from cutenv.task.observation import within_reach
from cutenv.task.path import PathEpisode, PathOptions
from cutenv.task.reward import STOPPED, greatest_action
from cutenv.task.stepper import assess_readings

if TYPE_CHECKING:
    from cutenv.emulation.fake_rig import FakeRig


_SAME_ANGLE = math.radians(0.5)


class Work:
    """Reset or step in progress, which a handler that closes the rig lets end.

    A signal handler interrupts its thread anywhere, perhaps under a lock that closing (``leave``) needs.
    """

    def __init__(self, leave: Callable[[], None]) -> None:
        self._leave = leave
        self._worker: int | None = None
        self._leaving = False

    @contextmanager
    def going_on(self) -> Iterator[None]:
        """Mark a block as work, and run postponed closing at its end."""
        self._worker = threading.get_ident()
        try:
            yield
        finally:
            self._worker = None
            if self._leaving:
                self._leaving = False
                self._leave()

    def postpones(self) -> bool:
        """Return True if closing the rig must wait until work ends."""
        if self._worker != threading.get_ident():
            return False
        self._leaving = True
        return True


def numbers(action: Any, count: int) -> NDArray[np.float64] | None:
    """Return an action's ``count`` numbers, or None if invalid."""
    try:
        command = np.array(action, np.float64)
    except Exception:  # the conversion of any object may raise anything, and the blade has to be stopped first
        return None
    return command if command.shape == (count,) and np.isfinite(command).all() else None


def action_text(action: Any) -> str:
    """Return an action in short, for a message."""
    try:
        return reprlib.repr(action)
    except Exception:  # the object's own method may raise anything
        return f"a {type(action).__name__}"


def blade_angle(settings: RigSettings, mode: str | None, fixed_deg: float | None) -> tuple[str, float | None]:
    """Return angle mode, "free" or "fixed", and fixed angle [rad] or None.

    ``mode`` and ``fixed_deg`` [deg] are what a task asks for; None: as the rig has it.  ValueError if the rig cannot do
    it, or a value is not valid.
    """
    mode = settings.angle_mode if mode is None else one_of("angle_mode", mode, ("free", "fixed"))
    if mode == "free" and settings.angle_mode == "fixed":
        raise ValueError(
            f'angle_mode = "free", but the angle of rig {settings.name!r} is set by hand, at '
            f"{math.degrees(settings.fixed_angle):.0f} degrees. Use a policy that was trained with "
            'angle_mode="fixed" at that angle, or a rig with a second axis.'
        )
    fixed = settings.fixed_angle
    if fixed_deg is not None:
        in_range("fixed_angle_deg", fixed_deg, 45.0, 90.0, "deg", "Measured are 45 to 90 degrees.")
        fixed = math.radians(fixed_deg)
        if settings.angle_mode == "fixed" and abs(fixed - settings.fixed_angle) > _SAME_ANGLE:
            raise ValueError(
                f"fixed_angle_deg = {fixed_deg:g}, but the blade of rig {settings.name!r} is set to "
                f"{math.degrees(settings.fixed_angle):.1f} degrees. Turn it, and write that into its file."
            )
    return mode, fixed if mode == "fixed" else None


_UPRIGHT = math.pi / 2


class RigCutEnv(CutEnv):
    """Cut gently on a rig; policies from simulation run unchanged.

    Action, observation and reward are those of :class:`cutenv.envs.gentle_cut.GentleCutEnv`. Where that one uses hidden
    state, this one uses estimates: the tip from the measured force, with the mean tissue's stiffness and friction until
    a return stroke has measured them. Reward, cost and end come from that estimate, and ``info["estimated"]`` is True.

    Safety is below the environment (:mod:`cutenv.rig.safety.supervisor`) and independent of it. If it stops the blade,
    the cut ends with ``info["end"] == "stopped"`` and the cause in ``info["stop"]``; the rig stays stopped until the
    operator agrees to a reset, which the next ``reset`` asks for. **A software stop is not a safety function: wire the
    stop button to the drive's safe torque off.**

    The first ``reset`` prepares the rig (calibration, self-test, the operator's confirmation); each one moves the blade
    back to the clamp at 5 mm/s and asks for a new specimen. ``step`` waits for the end of its period on the rig's
    clock: decide within it.

    Ends
    ----
    Those of the simulator, and

    =========== =====================================================================================
    End         When
    =========== =====================================================================================
    stopped     the rig's safety has stopped the blade; charged as an end for safety
    =========== =====================================================================================

    Arguments
    ---------
    =============== ========== ========================================================================
    Keyword         Default    Meaning
    =============== ========== ========================================================================
    rig             "emulator" a rig's TOML file (``cutenv rig init``); "emulator": an emulated rig in a
                               process of its own; "serial": one with stepper and load cell on a serial
                               line; "grbl": one whose blade a machine with GRBL moves; "fake": one in
                               memory, on a clock of its own
    target_length   None       length of the cut [m]; None: drawn from 0.060 to 0.100 m
    specimen_class  "mixed"    of the specimens that an emulated or fake rig draws
    tissue          None       path of a tissue or specimen JSON file: what is drawn, and what the rig
                               believes to cut; None: the measured pig liver
    control_hz      50         decisions per second; divides 1000
    deadline_s      30.0       time for a cut [s]
    angle_mode      None       "free" or "fixed"; None: as the rig has it.  A rig whose angle is set by
                               hand refuses "free"
    fixed_angle_deg None       angle of the blade if fixed [deg]; None: as the rig has it
    records         None       folder for a record of every cut, written while it goes on; None: none
    lower_limits    None       limits of the rig's file made lower, by name in SI: ``{"force": 5.0}``; see
                               :data:`cutenv.rig.config.settings.LOWERED`
    dry_run         False      cut drawn specimens on a fake with this rig's settings: nothing is connected
    drive           "rig"      of an emulated or fake rig: "rig" (velocity loop) or "pd" (PD control of position);
                               a real one's file says it
    operator        None       a :class:`cutenv.rig.operation.operator.Operator`; None: the terminal, and nobody
                               for an emulated rig
    =============== ========== ========================================================================

    Besides, the weights (``weight_<term>``) and, for emulated and fake rigs, each constant of the parameter table.

    Reset options: ``target_length`` [m], ``episode`` (number of the specimen under the current seed), and ``specimen``
    (a :class:`~cutenv.sim.tissue.Specimen` or its JSON text, emulated and fake rigs only).

    Info
    ----
    ``estimated``, ``reward_terms``, ``cost`` and ``cost_terms`` (by the estimated tip and its runs),
    ``speed_out_of_range``, ``rig`` (``overruns``: commands so far that were more than 2 ms late; ``period_s``: time
    from the last command to this one; ``limited``: commands so far that were reduced to a limit) and, at the end,
    ``end``, ``is_success`` and, if it was stopped, ``stop``.

    Version history
    ---------------
    v1: the first version that is released; may change until the first comparison of agents is published.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 50}  # noqa: RUF012  as in Env
    spec = LimitedSpec()
    options_class: ClassVar[type[TaskOptions]] = TaskOptions
    """Task, and the options that it adds."""
    option_names: ClassVar[tuple[str, ...]] = ()
    """Names of those options that a rig does not decide."""
    simulated: ClassVar[type[GentleCutEnv]] = GentleCutEnv
    """Class of the simulator's environment."""
    as_simulated: ClassVar[dict[str, Any]] = {}
    """Keywords with which the simulator's specimens are like those of an emulated or fake rig."""
    needs_axis: ClassVar[str] = ""
    """Name of the axis across the cut that the task needs, "height" or "side"; empty if it needs none."""
    task_name: ClassVar[str] = "cutenv/RigCut-v1"
    """Id of the environment."""

    def __init__(
        self,
        *,
        rig: str | Path = "emulator",
        target_length: float | None = None,
        specimen_class: str = "mixed",
        tissue: str | Path | None = None,
        control_hz: int = 50,
        deadline_s: float = 30.0,
        angle_mode: str | None = None,
        fixed_angle_deg: float | None = None,
        records: str | Path | None = None,
        lower_limits: dict[str, float] | None = None,
        dry_run: bool = False,
        drive: str = "rig",
        operator: Operator | None = None,
        render_mode: None = None,
        **constants: Any,
    ) -> None:
        self._arguments = {name: value for name, value in locals().items() if name in _ARGUMENTS} | constants
        self.options = self.options_class({n: constants.pop(n) for n in self.option_names if n in constants})
        if render_mode is not None:
            raise ValueError(f"render_mode = {render_mode!r}: a rig is not drawn; record the cut and score it.")
        self.settle(self.task, control_hz, deadline_s, target_length, specimen_class)
        self.tissue = TissueSource(tissue)
        one_of("drive", drive, ("rig", "pd"))
        self.constants = Constants.from_keywords(
            constants, drive=drive, others=[*_ARGUMENTS, *self.option_names], of=type(self).__name__
        )
        self.render_mode = None

        self._source = RigSource(
            rig, self.constants, operator=operator, records=records, lower_limits=lower_limits, dry_run=dry_run,
            needs_axis=self.needs_axis, by=self.task_name,
        )  # fmt: skip
        self.angle_mode, self.fixed_angle = blade_angle(self.settings, angle_mode, fixed_angle_deg)
        self._session: RigSession | None = None
        self._work = Work(self.close)
        self._reduced = 0  # commands of this cut that were faster than the rig obeys
        self._stop: dict[str, Any] | None = None
        self._plant: RigPlant
        self.cutting: Episode
        self.specimen: Specimen | None = None
        """Specimen drawn for an emulated or fake rig; None for a real one."""

    @property
    def task(self) -> Task:
        """The task, assessed by what a rig sees."""
        return self.options.task.seen

    @property
    def session(self) -> RigSession:
        """Session with the rig, which is created at the first access."""
        if self._session is None:
            self._session = self._source.session()
        return self._session

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Move the blade slowly to the clamp; ask for a specimen.

        RigError if a check fails, or the operator does not agree.
        """
        self._check_owner()
        with self._work.going_on():
            (own, episode), length, given = self.asked(seed, options)
            if length is None:
                length = self.options.drawn_length(self.tissue.tissue or measured_liver(), own, episode)
            if length + AHEAD > (high := self.settings.limits.high):
                raise ValueError(
                    f"target_length = {length:g} m: the blade goes up to {1e3 * AHEAD:g} mm further than the tip and"
                    f" is stopped at limits.high_mm = {1e3 * high:g}. Give {high - AHEAD:g} m or less."
                )
            if not self._ended:  # an abandoned cut: come to rest, and finish its record
                self._finish("given up")
            if self._session is None:
                self._warm_up()
            self.specimen = self._specimen(given, own, episode)
            plant = self._plant = self.session.plant
            if self.specimen is not None:
                plant.depth = self.constants.knowledge.measure_depth(self.specimen.depth, own, episode)
            key = SpecimenKey(seed=own, episode=episode, target=length, specimen=self.specimen)
            self._lay(key)
            tissue = self.specimen.tissue if self.specimen is not None else self.tissue.tissue or measured_liver()
            self.cutting = self._cutting(plant, tissue, length, key)
            self._source.begin_record(
                plant,
                **self.cutting.noted,
                specimen_class=None if self.specimen is None else self.specimen.specimen_class,
                seed=own,
                episode=episode,
            )
            self._episode = episode + 1
            self._ended, self._stop, self._reduced = False, None, 0
            return self.cutting.rest(self.start_angle), self._info()

    def _lay(self, key: SpecimenKey) -> None:
        """Have a specimen laid, and the blade ready at its edge."""
        self.session.next_cut(key, self.start_angle)

    def _warm_up(self) -> None:
        """Compile kernels before the rig's watching threads can stall."""
        warn_before_first_compile(assess_readings(self.task))
        practice = SimulatedPlant(Specimen.drawn(0, 0))
        tissue = practice.specimen.tissue
        cutting = self._cutting(practice, tissue, 0.06, SpecimenKey(seed=0, episode=0))
        cutting.rest(self.start_angle)
        cutting.assess(practice.advance(0.0, _UPRIGHT, self.ticks), {}, np.zeros((self.ticks, WAYS)))
        cutting.charge_stop()

    def _cutting(self, plant: Plant, tissue: TissueDescription, length: float, key: SpecimenKey) -> Any:
        goal = Goal(
            tissue=tissue,
            weights=self.constants.weights,
            limits=self.constants.limits,
            friction_per_depth=tissue.nominal_friction_per_depth,
            target_length=length,
            deadline=self.deadline,
            ticks=self.ticks,
            key=(key.seed, key.episode),
        )
        return self.options.episode(plant, goal)

    def _specimen(self, option: Any, seed: int, episode: int) -> Specimen | None:
        if not self._source.draws:
            if option is not None:
                raise ValueError("option specimen: a real rig cuts what is laid there; leave it out.")
            return None
        laid = Specimen.from_json(option) if isinstance(option, str) else option
        laid = laid or self.tissue.specimen or self.tissue.drawn(seed, episode, self.specimen_class)
        return self.constants.wear.of(laid)

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Command speed and angle; wait until the next decision."""
        self._check_owner()
        with self._work.going_on():
            if self._ended or self._session is None:
                raise gymnasium.error.ResetNeeded("no cut is going on: call reset() before step().")
            command = numbers(action, len(self.task.action_names))
            if command is None or not within_reach(command, self.fixed_angle or math.nan):
                self._stop_for(Cause.NOT_A_NUMBER, f"the policy's action is {action_text(action)}")
                self._finish(STOPPED)
                raise ValueError(
                    f"action = {action_text(action)} must hold {len(self.task.action_names)} numbers in [-1, 1] "
                    f"({', '.join(self.task.action_names)}), none NaN or infinite."
                )
            cutting = self.cutting
            if not cutting.time:
                self._session.start()
            most = greatest_action(min(self.constants.limits.top_speed, top_speed(self.settings)))
            self._reduced += bool(abs(command[0]) > most)
            command[0] = min(max(command[0], -most), most)
            try:
                observation, reward = cutting.step(command)
            except RigStopped as stop:
                observation, reward = cutting.stopped(stop.readings)
                self._stop = stop.report.to_dict()
            if cutting.end:
                self._finish(cutting.end)
            info = self._info()
            if cutting.end:
                info["end"] = cutting.end
                info["is_success"] = cutting.success
                if self._stop is not None:
                    info["stop"] = self._stop
            return observation, reward, self._ended, False, info

    def _check_owner(self) -> None:
        if self._session is not None:
            self._session.plant.owner.check()

    def _stop_for(self, cause: Cause, detail: str) -> None:
        """Stop the blade, and keep readings until it rests."""
        plant = self._plant
        plant.supervisor.trip(cause, detail)
        if plant.supervisor.phase == "stopped":
            try:
                plant.advance(0.0, plant.angle, self.ticks)
            except RigStopped as stop:
                self._stop = stop.report.to_dict()

    def _finish(self, end: str) -> None:
        """Stop the blade, and finish the cut's record."""
        self._ended = True
        plant = self._plant
        plant.halt()
        if self._stop is None and plant.supervisor.phase == "stopped" and plant.supervisor.report is not None:
            self._stop = plant.supervisor.report.to_dict()
        self._source.end_record(plant, end=end, success=self.cutting.success, stop=self._stop)

    def _info(self) -> dict[str, Any]:
        plant, group, found = self._plant, self.task.shown_as, self.cutting.errors
        errors = {one.name: found[one.name] for one in self.task.errors if one.on_rig}
        return {
            "estimated": True,
            "reward_terms": self.cutting.reward_terms,
            "cost": self.cutting.cost,
            "cost_terms": self.cutting.cost_terms,
            "speed_out_of_range": self.cutting.speed_out_of_range,
            "rig": {
                "overruns": plant.timing.overruns,
                "period_s": plant.timing.periods[-1] if plant.timing.periods else None,
                "limited": self._reduced + plant.supervisor.limited,
            },
            **({group: errors} if group else {}),
        }

    @property
    def settings(self) -> RigSettings:
        """Settings of the rig."""
        return self._source.settings

    @property
    def lateness(self) -> str:
        """Sentence on an emulated rig's lateness, or "" if in time."""
        emulator = self._source.emulator
        return "" if emulator is None else emulator.lateness

    @property
    def draws_specimens(self) -> bool:
        """True if a program draws specimens, on emulated or fake rigs."""
        return self._source.draws

    def the_fake(self) -> FakeRig:
        """Fake rig in use; raises ValueError for another kind of rig."""
        if self.session is None or self._source.fake is None:
            raise ValueError(f"rig {self.settings.name!r} is not a fake one.")
        return self._source.fake

    def rehearsal(self) -> Self:
        """Make this environment on a fake, to try policies safely.

        The first decisions of a policy may compile or import, which stalls the threads that watch a rig, and they stop
        it.
        """
        return type(self)(**{**self._arguments, "records": None, "operator": None, "dry_run": True})

    def listen(self, listener: CutListener) -> None:
        """Report later cuts to a listener, which must not wait."""
        self._source.listener = listener

    @property
    def records(self) -> list[Path]:
        """Files of the finished cuts."""
        return self._source.records

    def close(self) -> None:
        """Stop any motion and close the rig, from any thread.

        Has no effect in a fork.

        From a signal handler during a step it stops the blade, and the rig is closed when the step ends. During a reset
        in which nothing moves it raises :class:`KeyboardInterrupt`, and the rig is then closed.
        """
        session = self._session
        if self._work.postpones():
            if session is None:
                raise KeyboardInterrupt(_CLOSED)
            return interrupt(session.plant.supervisor, Cause.OPERATOR, _CLOSED)
        if session is None or not session.plant.owner.here:
            return
        plant = session.plant
        try:
            session.close()  # before the record, which may take a disk seconds to finish
        finally:
            self._session = None
            report = plant.supervisor.report if plant.supervisor.phase == "stopped" else None
            stop = report.to_dict() if report is not None and not self._ended else self._stop
            self._ended = True
            self._source.end_record(plant, end="closed", success=False, stop=stop)
            self._source.close_camera()


_CLOSED = "the rig is being closed"
_ARGUMENTS = [
    name
    for name, argument in inspect.signature(RigCutEnv.__init__).parameters.items()
    if argument.kind is inspect.Parameter.KEYWORD_ONLY
]


_DEPTH_WEIGHTS = tuple(name for name in DepthConstants.__dataclass_fields__ if name.startswith("weight_"))


@described
class RigDepthCutEnv(RigCutEnv):
    """Cut along a wanted depth on a rig; ``cutenv/DepthCut-v1`` policies run unchanged.

    It is :class:`~cutenv.envs.rig_cut.RigCutEnv` on a rig with a height axis; a rig's file without the section
    ``[height]`` is refused.  Action and observation are those of :class:`~cutenv.envs.depth_cut.DepthCutEnv`, and so is
    the wanted depth of a seed and episode.  Where that one uses hidden state, this one uses estimates: the tip from the
    measured force, and the floor that the mean tissue would have under this blade.  The layer below is not known, so
    that ``layer_area`` and ``layer_depth`` are always 0, and no cut ends in it.

    Each ``reset`` raises the blade out of the cut, returns to the clamp, has a specimen laid with the blade at height
    0, and moves the blade to the depth that is wanted at the start.  If the blade is stopped, it stays where it is:
    nothing is raised before the operator agrees.  A blade that cannot be raised is a fault that stops.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    wanted    "mixed" "constant", "ramp", "step", "mixed" (one of these) or "profile" (height 0)
    layer     None    another layer below, of drawn specimens; None: unless ``wanted`` is "profile"
    ========= ======= =================================================================================

    The others are those of ``cutenv/RigCut-v1``, and
    {keywords}.

    Info
    ----
    That of ``cutenv/RigCut-v1``; ``reward_terms`` has the costs of the depth, and ``depth``, by the expected floor,

    {errors on a rig}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = DepthOptions
    option_names = ("wanted", "layer", *_DEPTH_WEIGHTS, "edge_length", "bedding")
    simulated = DepthCutEnv
    as_simulated: ClassVar[dict[str, Any]] = {"surface_spread": 0.0}  # they have the mean liver's surface
    needs_axis = "height"
    task_name = "cutenv/RigDepthCut-v1"
    options: DepthOptions
    cutting: DepthEpisode

    def _lay(self, key: SpecimenKey) -> None:
        assert key.target is not None  # a cut has one
        plant, supply = self.session.plant, self._source.supply
        if supply is not None and key.specimen is not None:
            cutting = self._cutting(plant, key.specimen.tissue, key.target, key)
            self._check_levels(cutting)
            supply.layers = cutting.layers_below() if self.options.layer else Layers()
        super()._lay(key)
        cutting = self._cutting(plant, self.tissue.tissue or measured_liver(), key.target, key)
        self._check_levels(cutting)
        self.session.operator.tell(f"The blade goes to a height of {1e3 * cutting.start_level:+.1f} mm, where it cuts.")
        self.session.start()
        plant.raise_to(cutting.start_level)
        plant.supervisor.lock()
        plant.begin()

    def _check_levels(self, cutting: DepthEpisode) -> None:
        """Raise RigError if wanted depth exceeds the height axis's reach."""
        axis = self.settings.require_height_axis(by=self.task_name)
        last = int((cutting.target_length + AHEAD) * POINTS_PER_METRE)
        levels = (cutting.plant.depth - cutting.whole["wanted"][0])[: last + 1]
        low, high = float(levels.min()), float(levels.max())
        if low < axis.lowest or high > axis.highest:
            raise RigError(
                f"the wanted depth needs heights of {1e3 * low:.1f} to {1e3 * high:.1f} mm, and the rig's are "
                f"{1e3 * axis.lowest:g} to {1e3 * axis.highest:g} (height.lowest_mm, highest_mm). Take another wanted "
                "depth or specimen, or an axis that reaches there."
            )

    def _warm_up(self) -> None:
        super()._warm_up()
        practice = SimulatedPlant(Specimen.drawn(0, 0))
        self._cutting(practice, practice.specimen.tissue, 0.06, SpecimenKey(seed=0, episode=0)).layers_below()


_ROOM = 1e-3  # [m] between the line and an end of the rig's travel


@described
class RigPathCutEnv(RigCutEnv):
    """Cut along a line on a rig; ``cutenv/PathCut-v1`` policies run unchanged.

    It is :class:`~cutenv.envs.rig_cut.RigCutEnv` on a rig with an axis to the side; a rig's file without the section
    ``[side]`` is refused.  Action and observation are those of :class:`~cutenv.envs.path_cut.PathCutEnv`, and so is the
    line of a seed and episode.  Where that one uses hidden state, this one uses estimates: the tip from the measured
    force, and beside the line the cut that mean tissue would have behind this blade.

    The two axes lead the blade: speed and turn become speeds along the slab and to its left, anew with every sample of
    the axes, and force and lateral force are the sensor's two, turned into the direction in which the blade goes.  **No
    axis turns the blade about its upright axis.**  The law holds for a blade that points where it goes: mount one that
    trails by itself behind a pivot, with the pivot above the force sensor, or expect other lateral forces.

    Each ``reset`` leads the blade back through the cut, the way that it came, or raises it first where the rig has a
    height axis.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    line      "mixed" as for ``cutenv/PathCut-v1``
    ========= ======= =================================================================================

    The others are those of ``cutenv/RigCut-v1``, and
    {keywords}.

    Info
    ----
    That of ``cutenv/RigCut-v1``; ``reward_terms`` has the costs of the path, and ``path``, of the estimated cut,

    {errors on a rig}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = PathOptions
    option_names = ("line", "line_limit", "weight_off_line", "weight_farthest", "crack_curvature")
    simulated = PathCutEnv
    needs_axis = "side"
    task_name = "cutenv/RigPathCut-v1"
    options: PathOptions
    cutting: PathEpisode

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.options.check_length(LONGEST if self.target_length is None else self.target_length)

    def _lay(self, key: SpecimenKey) -> None:
        assert key.target is not None  # a cut has one
        tissue = self.tissue.tissue or measured_liver() if key.specimen is None else key.specimen.tissue
        self.options.check_length(key.target)
        line = self._cutting(self.session.plant, tissue, key.target, key).line
        self._check_reach(line, key.target)
        if self._source.supply is not None:
            self._source.supply.line = line
        super()._lay(key)
        self.session.plant.begin(line)

    def _check_reach(self, line: CutLine, target: float) -> None:
        """Raise RigError if a line leaves the rig axes' reach."""
        axis = self.settings.require_side_axis(by=self.task_name)
        passed = slice(0, int((target + AHEAD) * POINTS_PER_METRE) + 1)
        right, left = float(line.y[passed].min()), float(line.y[passed].max())
        low, high = axis.bounds
        if right < low + _ROOM or left > high - _ROOM:
            raise RigError(
                f"the line goes from {1e3 * right:+.1f} to {1e3 * left:+.1f} mm to the left of the middle, and the "
                f"blade is stopped at {1e3 * low:g} and {1e3 * high:g} (side.rightmost_mm, leftmost_mm). Take another "
                "line, or an axis that reaches there."
            )
