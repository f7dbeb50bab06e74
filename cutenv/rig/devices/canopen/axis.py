"""Axis of the rig on one CiA 402 drive: state machine, commands, samples, and stop."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable

from cutenv.rig.config.axes import Axis, CrossAxis
from cutenv.rig.devices.canopen import configuration
from cutenv.rig.devices.canopen import objects as o
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.canopen.sdo_channel import SdoChannel
from cutenv.rig.devices.canopen.units import AxisUnits
from cutenv.rig.devices.clock import Clock
from cutenv.rig.devices.drivers import MotionListener
from cutenv.rig.devices.latch import Event, Latch
from cutenv.rig.devices.samples import DriveState, MotionSample
from cutenv.rig.errors import RigError

_log = logging.getLogger(__name__)

_STATE_LIMIT = 1.0  # [s] for a drive to change its state
_STATUS_LIMIT = 0.3  # [s] for a statusword to arrive
_TOLD, _TOLD_EVERY = 20, 0.010  # quick stops before clearing a drive that still has power; [s] between them
_REST = 0.01  # [1] share of the top speed below which an axis counts as at rest
_STATUS, _MEASURED = o.STATUS_PDO.layout, o.MEASURED_PDO.layout
_UNPOWERED = (DriveState.DISABLED, DriveState.READY, DriveState.SWITCHED_ON, DriveState.NOT_READY)


class CanopenAxis:
    """A Maxon EPOS4, or another drive with its objects, in profile velocity mode; a ``MotionDriver``.

    Positions are the drive's own: it must have been homed so that zero is the clamp. After :meth:`quick_stop` nothing
    that could give the drive power or speed is sent until the latch is reset, because on some drives a command would
    start the blade again.

    Parameters
    ----------
    network : CanNetwork
        Network shared by the axes of a rig.
    settings : Axis
        Settings of this axis.
    clock : Clock
        Clock that dates events without a frame of their own.
    name : str
        "blade" or "angle".
    """

    def __init__(self, network: CanNetwork, settings: Axis, clock: Clock, *, name: str = "blade") -> None:
        self.name = name
        self.latch = Latch()  # until a supervisor replaces it by the shared one
        self.garbled = 0
        """Number of frames from the drive that violated the standard and were ignored."""
        self.last_garbled = ""
        """Fault of the last such frame, as a text."""
        self._network, self._settings, self._clock = network, settings, clock
        self._listener: MotionListener | None = None
        self._dictionary: SdoChannel | None = None
        self._units: AxisUnits | None = None
        self._changed = threading.Condition()  # guards what is below; held for moments only
        self._state = DriveState.NOT_READY
        self._mode = 0
        self._velocity: int | None = None  # of a TPDO1 whose TPDO2 has not come yet
        self._speed = 0.0
        self._statuses = 0
        self._may_move = False
        self._for_good = False  # the drive's quick-stop option differs from its set-up
        self._running = False  # has sent process data since it was opened
        self._error = ""
        self._lost: str | None = None

    @property
    def units(self) -> AxisUnits:
        """Conversion to the drive's units; ``units.steps`` is 1000 for milli-rpm, 1 for whole rpm only.

        Raises
        ------
        RigError
            If the axis was never opened.
        """
        if self._units is None:
            raise RigError(f"{self.name}: the drive's units are not known before it is opened.")
        return self._units

    @property
    def mode(self) -> int:
        """Mode of operation that the drive reports; 3 is profile velocity."""
        return self._mode

    # Life cycle of an axis

    def open(self, listener: MotionListener) -> None:
        """Connect, check the drive's identity, write and verify the set-up; samples arrive from now on, nothing moves.

        A drive found with power on is switched off first; one found in fault stays in fault: see :meth:`clear`.

        Raises
        ------
        RigError
            If it is open already, the bus is missing, no drive or a wrong one answers, or the set-up is not accepted.
        """
        if self._listener is not None:
            raise RigError(f"{self.name}: it is open already; close it first.")
        self._network.join(self)
        self._listener = listener
        self._may_move = self._running = False
        self._error, self._lost, self._velocity = "", None, None
        try:
            self._connect()
        except BaseException:
            self._leave()
            raise

    def _connect(self) -> None:
        network, node = self._network, self._settings.node
        dictionary = self._dictionary = SdoChannel(network, node, self.name)
        network.listen(o.HEARTBEAT_FRAME + node, self._heartbeat)
        network.listen(o.EMERGENCY_FRAME + node, self._emergency)
        network.manage(o.NMT_PRE_OPERATIONAL, node)
        configuration.check_identity(dictionary, self.name, self._settings, network.settings)
        dictionary.put(o.CONTROLWORD, o.DISABLE_VOLTAGE)
        self._units = configuration.configure(dictionary, self.name, self._settings, network.settings)
        network.listen(o.STATUS_PDO.frame + node, self._status)
        network.listen(o.MEASURED_PDO.frame + node, self._measured)
        network.manage(o.NMT_START, node)
        if not self._wait(lambda: self._running, _STATE_LIMIT):
            raise RigError(
                f"{self.name}: node {node} took its set-up and sends no process data (TPDO1, TPDO2) on SYNC."
                f" {self.last_garbled or 'Does it hear SYNC, is another master on the bus?'}"
            )

    def close(self) -> None:
        """Leave the axis at rest without power, and leave the bus; never raises, and may be called twice."""
        if self._listener is None:
            return
        try:
            if self._state not in _UNPOWERED:
                self._control(o.QUICK_STOP)
            self._power_off()
            # Sign off: otherwise the drive would take the end of our heartbeat for a fault.
            self._book.put(o.CONSUMER_HEARTBEAT, 0)
            self._network.manage(o.NMT_PRE_OPERATIONAL, self._settings.node)
        except Exception as error:  # a lost drive or any other error: leave the bus anyway
            _log.warning("%s: not closed in order: %s", self.name, error, exc_info=not isinstance(error, RigError))
        finally:
            self._leave()

    def _leave(self) -> None:
        node = self._settings.node
        for frame in (o.HEARTBEAT_FRAME, o.EMERGENCY_FRAME, o.STATUS_PDO.frame, o.MEASURED_PDO.frame):
            self._network.ignore(frame + node)
        if self._dictionary is not None:
            self._dictionary.close()
        self._may_move = self._running = False
        self._listener = self._dictionary = None
        self._network.leave(self)

    def limits(self) -> dict[str, float]:
        """Return the drive's own "low", "high" (software limits), "speed", "acceleration" and "quick_stop".

        Raises
        ------
        RigError
            If it is not open, or the drive does not answer.
        """
        return configuration.read_limits(self._book, self.units)

    def about(self) -> dict[str, float | str]:
        """Return the drive's report about itself: identity, gear, encoder, units, and its response time.

        Raises
        ------
        RigError
            If it is not open, or the drive does not answer.
        """
        asked = self._clock.now()
        word = self._book.read(o.STATUSWORD)
        trip = self._clock.now() - asked
        told = configuration.read_identity(self._book, self.units)
        if isinstance(self._settings, CrossAxis):
            told["homed"] = "yes" if word & o.HOMED else "no"
        return {**told, "sdo_round_trip_ms": 1e3 * trip, "state": self._state.value, "garbled_frames": self.garbled}

    # Commands

    def enable(self) -> None:
        """Switch the power on, at zero speed. Clears no fault: see :meth:`clear`.

        Raises
        ------
        RigError
            If it was stopped, is in fault, or does not power on in time.
        """
        self._fresh()
        steps = {
            DriveState.DISABLED: o.SHUTDOWN,
            DriveState.READY: o.SWITCH_ON,
            DriveState.SWITCHED_ON: o.ENABLE_OPERATION,
        }
        while (state := self._state) is not DriveState.ENABLED:
            if self.latch.closed or state not in steps:
                raise RigError(f'{self.name}: the drive is in "{state.value}"{self._error}; clear it first.')
            self._energise(steps[state], 0)
            self._await(lambda left=state: self._state is not left, f'leave "{state.value}"')  # type: ignore[misc]
        self._await(lambda: self._mode == o.PROFILE_VELOCITY, "show profile velocity mode")
        with self._changed:
            self._may_move = self._state is DriveState.ENABLED and not self.latch.closed
        if not self._may_move:
            raise RigError(f"{self.name}: stopped while it was powered on{self._error}; clear it first.")

    def command(self, speed: float) -> None:
        """Put a target speed [m/s or rad/s] on the bus, without waiting for an answer.

        Raises
        ------
        TypeError, ValueError
            If the speed is not a number, or beyond the axis's top speed.
        RigError
            If the axis is not enabled, was stopped, or the bus is broken.
        """
        velocity = self.units.velocity(speed)
        if not self._may_move:
            raise RigError(f"{self.name}: {self._lost or self._why_still()}.")
        self._energise(o.ENABLE_OPERATION, velocity)

    def quick_stop(self, *, for_good: bool = False) -> None:
        """Put a quick stop on the bus: at once, from any thread, without waiting, in any state.

        With ``for_good``, the drive's quick-stop option is also set so that no command ends the stop before rest, and
        the drive then loses its power.

        Raises
        ------
        RigError
            If the bus does not accept it, or the axis was never opened.
        """
        self.latch.happens(Event.STOP)
        self._may_move = False
        if for_good:
            self._for_good = True
            self._network.send_message(*o.quick_stop_option_frame(self._settings.node, o.STOP_AND_RELEASE))
        self._control(o.QUICK_STOP)

    def withhold_heartbeat(self, why: str) -> None:
        """End this computer's heartbeat until :meth:`clear`: the drive's own watchdog then stops it; SYNC goes on."""
        self.latch.happens(Event.STOP)
        self._may_move = False
        _log.warning("%s: %s: our heartbeat ends", self.name, why)
        self._network.withhold_heartbeat()

    def disable(self) -> None:
        """Switch off the power of an axis at rest.

        Raises
        ------
        RigError
            If it does not come to rest, or does not answer.
        """
        self._power_off()

    def clear(self) -> None:
        """Leave quick stop or fault for rest without power, within the latch's reset.

        Raises
        ------
        RigError
            If the fault stays because its cause does, or the drive does not answer.
        """
        self._network.resume_heartbeat()
        self._fresh()
        if self._for_good:
            self._book.put(o.QUICK_STOP_OPTION, o.STOP_AND_STAY)
            self._for_good = False
        for _ in range(_TOLD):  # it may still move, and nothing else sends quick stops during a reset
            if self._state is not DriveState.ENABLED:
                break
            self._control(o.QUICK_STOP)
            self._wait(lambda: self._state is not DriveState.ENABLED, _TOLD_EVERY)
        self._power_off()
        if self._state is DriveState.FAULT:
            self._reset_fault()

    def _reset_fault(self) -> None:
        self._control(o.DISABLE_VOLTAGE)  # the drive resets at the rising edge of the bit, so it must see it low
        self._fresh()
        self._error = ""
        self._control(o.FAULT_RESET)
        self._await(lambda: self._state is not DriveState.FAULT, "leave its fault")
        self._power_off()

    def _power_off(self) -> None:
        self._may_move = False
        self._fresh()
        settings = self._settings
        stopping = settings.speed / min(settings.quick_stop, settings.acceleration) + _STATUS_LIMIT
        self._await(lambda: abs(self._speed) <= _REST * settings.speed, "come to rest", stopping)
        self._await(lambda: self._state is not DriveState.REACTING, "end its fault reaction")
        if self._state not in (DriveState.FAULT, DriveState.DISABLED):
            self._control(o.DISABLE_VOLTAGE)
            self._await(lambda: self._state in (DriveState.DISABLED, DriveState.FAULT), "switch its power off")

    def _why_still(self) -> str:
        return f'not enabled, the drive is in "{self._state.value}"{self._error}'

    def _energise(self, controlword: int, velocity: int) -> None:
        """Send a frame that may start the blade, but never after a quick stop from another thread."""
        if self.latch.closed:
            raise RigError(f"{self.name}: stopped; clear it first.")
        self._control(controlword, velocity)
        if self.latch.closed:  # stopped between the two lines above: the quick stop has to be the last frame
            self._control(o.QUICK_STOP)
            raise RigError(f"{self.name}: stopped; clear it first.")

    def _control(self, controlword: int, velocity: int = 0) -> None:
        self._network.send_message(*o.command_frame(self._settings.node, controlword, velocity))

    # Reports from the drive; called by the network's reader

    def _status(self, data: bytes, time: float) -> None:
        if len(data) != _STATUS.size:
            return self._garble(f"TPDO1 has {len(data)} bytes, not {_STATUS.size}: {data.hex(' ')}")
        statusword, velocity, mode = _STATUS.unpack(data)
        try:
            state = o.drive_state(statusword)
        except ValueError as error:
            return self._garble(f"TPDO1: {error}")
        with self._changed:
            self._state, self._mode, self._velocity = state, mode, velocity
            self._speed = self.units.speed(velocity)
            self._may_move = self._may_move and state is DriveState.ENABLED
            self._statuses += 1
            self._changed.notify_all()

    def _measured(self, data: bytes, time: float) -> None:
        if len(data) != _MEASURED.size:
            return self._garble(f"TPDO2 has {len(data)} bytes, not {_MEASURED.size}: {data.hex(' ')}")
        if self._velocity is None:  # its TPDO1 was lost; that of another SYNC would be of another instant
            return
        increments, torque = _MEASURED.unpack(data)
        sample = MotionSample(time, self.units.position(increments), self._speed, torque / 1000.0, self._state)
        with self._changed:
            self._velocity, self._running = None, True
            self._changed.notify_all()
        if self._listener is not None:
            self._listener.motion(self.name, sample)

    def _heartbeat(self, data: bytes, time: float) -> None:
        if len(data) != 1:
            return self._garble(f"heartbeat has {len(data)} bytes, not 1: {data.hex(' ')}")
        state = data[0] & 0x7F  # the eighth bit toggles in node guarding
        if self._running and state == o.NMT_BOOT_UP:
            self.lost(f"node {self._settings.node} has restarted and lost its set-up; open it again", time)
        elif self._running and state != o.NMT_OPERATIONAL:
            self.lost(f"node {self._settings.node} is not operational any more (state {state}); open it again", time)
        if self._listener is not None:
            self._listener.alive(self.name, time)

    def _emergency(self, data: bytes, time: float) -> None:
        if len(data) != o.EMERGENCY.size:
            return self._garble(f"emergency has {len(data)} bytes, not {o.EMERGENCY.size}: {data.hex(' ')}")
        code = o.EMERGENCY.unpack(data)[0]
        if code >> 8 == 0:  # "error reset or no error"
            return
        meaning = o.error_meaning(code)
        with self._changed:
            self._may_move = False
            self._error = f" (0x{code:04X}, {meaning})"
        if self._listener is not None:
            self._listener.emergency(self.name, code, meaning, time)

    def overheard(self, number: int, data: bytes, time: float) -> None:
        """Report a frame with which another master commands the drive."""
        what = o.command_of_another(number, data, self._settings.node, self._network.settings.node)
        if what is not None and self._listener is not None:
            self._listener.foreign(self.name, what, time)

    def lost(self, why: str, time: float) -> None:
        """Take the network's report that the drive cannot be reached since ``time`` [s]; pass on only the first."""
        with self._changed:
            first, self._lost = self._lost is None, self._lost or why
            self._may_move = False
            self._changed.notify_all()
        if first and self._listener is not None:
            self._listener.broken(self.name, why, time)

    def _garble(self, why: str) -> None:
        self.garbled += 1
        self.last_garbled = why

    # Waiting

    @property
    def _book(self) -> SdoChannel:
        if self._dictionary is None:
            raise RigError(f"{self.name}: not open.")
        return self._dictionary

    def _wait(self, come: Callable[[], bool], limit: float) -> bool:
        """Wait until ``come()`` is true and return whether it is; raise RigError if the drive cannot be reached."""
        self._clock.wait_for(lambda: come() or self._lost is not None, limit, self._changed)
        if self._lost is not None:
            raise RigError(f"{self.name}: {self._lost}.")
        return come()

    def _await(self, come: Callable[[], bool], what: str, limit: float = _STATE_LIMIT) -> None:
        if not self._wait(come, limit):
            raise RigError(
                f'{self.name}: the drive does not {what} within {limit:.1f} s, and is in "{self._state.value}"'
                f"{self._error}. Are its supply, limit switches and safe torque off inputs as they should be?"
            )

    def _fresh(self) -> None:
        """Wait for a statusword younger than now, because an older one does not reflect the last command."""
        self._book  # noqa: B018  # raises if the axis is not open
        seen = self._statuses
        if not self._wait(lambda: self._statuses > seen, _STATUS_LIMIT):
            raise RigError(
                f"{self.name}: node {self._settings.node} has fallen silent: no statusword for {_STATUS_LIMIT:g} s."
                " Is the drive powered, is the cable in?"
            )
