"""Session with a rig, and the rows of its records.

It is prepared once, then cuts one supplied specimen after another.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import date
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv.rig.config.mounted_specimen import measured_depth
from cutenv.rig.config.settings import RigSettings, SafetyLimits
from cutenv.rig.devices.loop import SystemClock, undisturbed
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import Operator
from cutenv.rig.operation.preflight import SETTLE, Check, prepare
from cutenv.rig.plant import RigPlant
from cutenv.rig.safety.oversight import guarded
from cutenv.rig.safety.stop_causes import ENDS_SESSION, WATCH, Cause, RigStopped
from cutenv.rig.travel import RAISE_SPEED
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import COMPONENTS_OF_FORCE, PLACE, Reading

Row = tuple[float, ...]


def recorded_channels(settings: RigSettings) -> tuple[str, ...]:
    """Return the fields that a rig records beside a :class:`~cutenv.sim.trace.Reading`'s.

    With a height axis "height" and "vertical_force", with one to the side "blade_x", "blade_y" and "lateral_force";
    with either, or if its file says so, the six components.  They are what ``beside`` of
    :class:`cutenv.records.AppendingRecord` takes.
    """
    names: tuple[str, ...] = ()
    if settings.height is not None:
        names += "height", "vertical_force"
    if settings.side is not None:
        names += *PLACE, "lateral_force"
    return names + COMPONENTS_OF_FORCE if names or settings.sensor.components == "all" else ()


def recorded_rows(plant: RigPlant, readings: StructArray) -> tuple[list[Reading], list[Row] | None]:
    """Return rows to record of the latest readings, with channels.

    The depth is that of the measured profile at the blade, of a blade at height 0. They are for
    :meth:`cutenv.records.AppendingRecord.append`; None where nothing is beside the ``readings``, shape (n,), that
    ``plant.keep`` is called with.
    """
    depth = depth_below(plant.depth, readings["position"])
    columns = [readings[field].tolist() for field in ("time", "force", "position", "speed", "angle")]
    rows = list(map(Reading._make, zip(*columns, depth.tolist(), strict=True)))
    names = list(recorded_channels(plant.settings))
    return rows, None if plant.channels is None else plant.channels[names].tolist()


@dataclass(frozen=True, kw_only=True)
class SpecimenKey:
    """Key of a drawn specimen.

    A real rig only records the key: it cuts the tissue on its bench.
    """

    seed: int
    episode: int
    target: float | None = None  # length of the cut [m], along which the depth has to be known
    specimen: Specimen | None = None  # specimen as drawn or given; None if no program has drawn it


class SpecimenSource(Protocol):
    """Supply that lays the next specimen, the blade without power."""

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Mount a specimen; return its depth, shape (301,) [m], None if already known."""
        ...

    def take_away(self) -> None:
        """Remove the specimen that holds the blade, anywhere in its travel."""
        ...


class SpecimensByHand:
    """Supply by a person, who has measured each specimen's depth.

    The depth is measured by caliper and written into the rig's file. ``profile`` reads the rig's file again: each
    specimen has its own depth; ``lower`` is given the limits in the file, whenever it is read: those that were lowered
    count from the next cut on.
    """

    def __init__(
        self, profile: Callable[[], RigSettings], operator: Operator, lower: Callable[[SafetyLimits], None]
    ) -> None:
        self._profile, self._operator, self._lower = profile, operator, lower

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Ask for a new specimen.

        Return its depth along the cut, shape (301,) [m]. Raise RigError if the operator does not confirm that it is
        there, or its depth is not known.
        """
        what = (
            f"The drives are without power. Lay specimen {key.episode + 1}: edge at the clamp, depth_profile in the "
            "rig's file as measured on it; leave the blade where it is. Then take your hands away: the power comes back"
        )
        if not self._operator.ask_ready(what):
            raise RigError("no new specimen was laid: nothing is cut.")
        try:
            settings = self._profile()
            self._lower(settings.limits)
            return measured_depth(settings, key.target)
        except (OSError, ValueError) as error:
            raise RigError(f"the depth of the specimen is not known: {error}") from error

    def take_away(self) -> None:
        """Do nothing: the operator has taken the specimen away."""


RETURN_SPEED = 0.005  # speed of the return to the clamp between cuts [m/s]: always slow
_HELD = (Cause.FORCE, Cause.TORQUE)  # causes that last for as long as the specimen holds the blade at rest
_ATTEMPTS = 3  # to reach the clamp; the operator agrees to each
_PATIENCE = 1.0  # [s] for readings to be fresh again after this computer was busy
START_POSITION = 0.0  # position of the blade at the start of a cut [m]
START_HEIGHT = 0.0  # height of the blade's lower end at the start of a cut [m], on a rig with a height axis
# greatest change of the force at rest since the blade was in air [N]: beyond it the blade touches something
DRIFT = 1.0
_PUSHED = 5e-4  # [m] from the clamp, beyond which somebody has moved the blade


class RigSession:
    """Session with one rig, opened and closed as a context.

    ``plant`` is not yet opened; ``release`` is called at the end, after the plant is closed: it ends an emulator, for
    example; ``today`` counts for the age of the calibration.
    """

    def __init__(
        self,
        plant: RigPlant,
        operator: Operator,
        supply: SpecimenSource,
        *,
        release: Callable[[], None] | None = None,
        today: date | None = None,
    ) -> None:
        self.plant, self.operator = plant, operator
        self._supply, self._today = supply, today or date.today()
        self.checks: list[Check] = []  # checks of the preparation; empty before
        self._stack = ExitStack()
        if release is not None:
            self._stack.callback(release)
        self._air: tuple[float, float, float] | None = None  # [N] zero of the blade in air
        self._opened = False
        self._held = False  # by a specimen, at the force limit
        self._in_time = isinstance(plant.clock, SystemClock)

    def open(self) -> None:
        """Connect, and install every stop; nothing moves. Later calls do nothing."""
        if not self._opened:
            if self._in_time:
                self._stack.enter_context(undisturbed())
            self._stack.callback(self.plant.close)
            self.plant.open()
            self._stack.enter_context(guarded(self.plant.supervisor))
            self.plant.clock.sleep_until(self.plant.clock.now() + SETTLE)
            self._opened = True

    def next_cut(self, key: SpecimenKey, angle: float) -> None:
        """Prepare, go to the clamp, change the specimen, tare.

        The blade moves slowly, and the specimen is changed without power. ``angle``: angle at which the cut starts
        [rad]. Raise RigError if a check fails or the operator does not agree; nothing moves then; RigStopped if the
        blade was stopped on the way.
        """
        self.open()
        plant = self.plant
        for attempt in range(1, _ATTEMPTS + 1):
            self._be_ready()
            try:
                self._raise()
                self.operator.tell(f"The blade returns to the clamp at {1e3 * RETURN_SPEED:g} mm/s.")
                plant.retrace(speed=RETURN_SPEED)
                plant.travel(START_POSITION, speed=RETURN_SPEED, angle=angle)
                self._lower()
                break
            except RigStopped as stop:
                if attempt == _ATTEMPTS or stop.report.cause in ENDS_SESSION:
                    raise
        checks, self.checks = self.checks, []  # if the specimen is not laid as it should be, everything is asked again
        plant.switch_off()  # hands are in the travel from here on
        depth = self._supply.mount(key)
        if depth is not None:
            plant.depth = depth
        self.operator.tell("The drives are switched on again.")
        plant.power()
        plant.clock.sleep_until(plant.clock.now() + SETTLE)
        try:
            self._check_at_rest()
        except RigError:
            plant.switch_off()
            raise
        self.checks = checks
        plant.begin()

    def _raise(self) -> None:
        """Raise the blade out of the cut; after a stop :meth:`_be_ready` has asked."""
        axis = self.plant.settings.height
        if axis is not None and self.plant.height < axis.raised:
            self.operator.tell(f"The blade is raised to {1e3 * axis.raised:g} mm at {1e3 * RAISE_SPEED:g} mm/s.")
            self.plant.raise_to(axis.raised)

    def _lower(self) -> None:
        """Lower the blade at the clamp to a cut's start height."""
        if self.plant.settings.height is not None:
            self.operator.tell(f"The blade is lowered to {1e3 * START_HEIGHT:g} mm at {1e3 * RAISE_SPEED:g} mm/s.")
            self.plant.raise_to(START_HEIGHT)

    def _check_at_rest(self) -> None:
        """Check that the blade stayed and its force only drifted; tare."""
        plant = self.plant
        if abs(plant.position - START_POSITION) > _PUSHED:
            raise RigError(
                f"the blade was moved to {1e3 * plant.position:.1f} mm while the specimen was laid: begin the cut "
                "again, and leave it at the clamp."
            )
        for name in plant.settings.cross_axes:
            if abs(plant.place(name)) > _PUSHED:  # START_HEIGHT is 0, as is the middle
                raise RigError(
                    f"without power the {name} axis went to {1e3 * plant.place(name):+.1f} mm: it needs a brake or a "
                    "screw that holds it. Begin the cut again when it does."
                )
        zero = plant.tare()
        off = max(abs(now - then) for now, then in zip(zero, self._air or zero, strict=True))
        if off > DRIFT:
            raise RigError(
                f"the force at rest has changed by {off:.1f} N since the blade was in air ({DRIFT:g} N allowed): it "
                "touches something, or the sensor drifts. Free it, or let the sensor warm up, and begin again."
            )

    def _be_ready(self) -> None:
        """Reset a stop if the operator agrees, prepare if necessary, release."""
        supervisor = self.plant.supervisor
        if (why := supervisor.latched) is not None:
            report = supervisor.report
            question = f"The blade was stopped ({why}). Is the cause removed, and may the stop be reset?"
            supervisor.reset(agreed=self.operator.confirm(question))
            self.checks = []
            self._held |= report is not None and str(report) == why and report.cause in _HELD
        if self._held:
            self._free_the_blade()
        if not self.checks:
            self.checks = prepare(self.plant, self.operator, today=self._today, in_air=self._air is None)
            if self._air is None:
                self._air = self.plant.zero
        else:
            self.start()

    def _free_the_blade(self) -> None:
        """Have the specimen taken off; after a reset the drives are unpowered."""
        what = (
            "The drives are without power. Take the specimen off the blade: held by it, the blade would be stopped "
            "again. Then take your hands away"
        )
        if not self.operator.ask_ready(what):
            raise RigError("the specimen still holds the blade: nothing moves.")
        self._supply.take_away()
        self._held = False

    def start(self) -> None:
        """Release the rig for the cut's commands.

        Until here it is locked, however long a policy takes to be ready. Raise RigError if a signal is missing or
        wrong, and stays so.
        """
        clock, deadline = self.plant.clock, self.plant.clock.now() + _PATIENCE
        while True:
            try:
                return self.plant.supervisor.release()
            except RigError:
                if clock.now() > deadline:
                    raise
            clock.sleep_until(clock.now() + WATCH)

    def end_cut(self) -> None:
        """Bring the blade to rest and lock the rig."""
        self.plant.owner.check()
        self.plant.halt()

    def close(self) -> None:
        """Stop any motion and close the rig.

        May be called twice. The report names an exception under way as the cause.

        Does nothing in a fork of the process that has opened it.
        """
        if not self.plant.owner.here:
            return
        self._stack.__exit__(*sys.exc_info())

    def __enter__(self) -> RigSession:
        return self

    def __exit__(self, *error: Any) -> None:
        if self.plant.owner.here:
            self._stack.__exit__(*error)
