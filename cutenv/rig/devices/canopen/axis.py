"""Axis of the rig on one CiA 402 drive. State machine, commands, samples, and stop."""

from __future__ import annotations

from functools import partial

from cutenv.rig.config.settings import Axis, CrossAxis
from cutenv.rig.devices.canopen import configuration
from cutenv.rig.devices.canopen import objects as o
from cutenv.rig.devices.canopen.configuration import SdoChannel
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.canopen.objects import AxisUnits
from cutenv.rig.devices.driver_bases import STATE_LIMIT, AxisDriver
from cutenv.rig.devices.loop import Clock
from cutenv.rig.devices.protocols import DriveState, MotionSample
from cutenv.rig.errors import RigError

_QUICK_STOPS, _QUICK_STOP_PERIOD = (
    20,
    0.010,
)  # quick stops before clearing a drive that still has power; [s] between them
UNDER_WAY = 5  # answers to SYNC that may be under way; more, and the bus is too late for a stop
_LIMITED = 3  # statuswords with an internal limit, from which it is no start of a motion
_REST = 0.01  # [1] share of the top speed below which an axis counts as at rest
_STATUS, _MEASURED = o.STATUS_PDO.layout, o.MEASURED_PDO.layout
_UNPOWERED = (DriveState.DISABLED, DriveState.READY, DriveState.SWITCHED_ON, DriveState.NOT_READY)


class CanopenAxis(AxisDriver):
    """Maxon EPOS4, or another drive with its objects, in profile velocity mode.

    Positions are the drive's own: it must have been homed so that zero is the clamp. A drive found with power on is
    switched off when it is opened; one found in fault stays in fault: see :meth:`clear`. ``clock`` dates events without
    a frame of their own.
    """

    device, silence, report_limit = "drive", "our heartbeat ends", 0.3

    def __init__(self, network: CanNetwork, settings: Axis, clock: Clock, *, name: str = "blade") -> None:
        super().__init__(name, settings, clock)
        self.garbled = 0  # number of frames from the drive that violated the standard and were ignored
        self.last_garbled = ""  # fault of the last such frame, as a text
        self._network = network
        self._dictionary: SdoChannel | None = None
        self._units: AxisUnits | None = None
        self._mode = 0
        self._velocity: int | None = None  # of a TPDO1 whose TPDO2 has not come yet
        self._speed = 0.0
        self._for_good = False  # the drive's quick-stop option differs from its set-up
        self._running = False  # has sent process data since it was opened
        self._limited = 0  # consecutive statuswords with an internal limit

    @property
    def units(self) -> AxisUnits:
        """Conversion to the drive's units.

        ``units.steps`` is 1000 for milli-rpm, 1 for whole rpm only. Raise RigError if the axis was never opened.
        """
        if self._units is None:
            raise RigError(f"{self.name}: the drive's units are not known before it is opened.")
        return self._units

    # Life cycle

    def _connect(self) -> None:
        network, node = self._network, self._settings.node
        self._running, self._velocity = False, None
        network.join(self)
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
        if not self._wait(lambda: self._running, STATE_LIMIT):
            raise RigError(
                f"{self.name}: node {node} took its set-up and sends no process data (TPDO1, TPDO2) on SYNC."
                f" {self.last_garbled or 'Does it hear SYNC, is another master on the bus?'}"
            )

    def _rest(self) -> None:
        if self._state not in _UNPOWERED:
            self._send_stop()
        self._power_off()
        # Sign off: otherwise the drive would take the end of our heartbeat for a fault.
        self._book.put(o.CONSUMER_HEARTBEAT, 0)
        self._network.manage(o.NMT_PRE_OPERATIONAL, self._settings.node)

    def _disconnect(self) -> None:
        node = self._settings.node
        for frame in (o.HEARTBEAT_FRAME, o.EMERGENCY_FRAME, o.STATUS_PDO.frame, o.MEASURED_PDO.frame):
            self._network.ignore(frame + node)
        if self._dictionary is not None:
            self._dictionary.close()
        self._running, self._dictionary = False, None
        self._network.leave(self)

    def limits(self) -> dict[str, float]:
        """Return the drive's own travel, "speed", "acceleration" and "quick_stop"."""
        return configuration.read_limits(self._book, self.units)

    def about(self) -> dict[str, float | str]:
        """Return the drive's identity, gear, encoder, units and response time."""
        asked = self._clock.now()
        word = self._book.read(o.STATUSWORD)
        trip = self._clock.now() - asked
        told = configuration.read_identity(self._book, self.units)
        if isinstance(self._settings, CrossAxis):
            told["homed"] = "yes" if word & o.HOMED else "no"
        return {**told, "sdo_round_trip_ms": 1e3 * trip, "state": self._state.value, "garbled_frames": self.garbled}

    # Commands

    def _switch_on(self) -> None:
        steps = {
            DriveState.DISABLED: o.SHUTDOWN,
            DriveState.READY: o.SWITCH_ON,
            DriveState.SWITCHED_ON: o.ENABLE_OPERATION,
        }
        while (state := self._state) is not DriveState.ENABLED:
            if self.latch.closed or state not in steps:
                raise RigError(f"{self.name}: {self._condition()}; clear it first.")
            self._energise(partial(self._control, steps[state]))
            self._await(lambda left=state: self._state is not left, f'leave "{state.value}"')  # type: ignore[misc]
        self._await(lambda: self._mode == o.PROFILE_VELOCITY, "show profile velocity mode")

    def _target(self, speed: float) -> float:
        return self.units.velocity(speed)

    def _send_speed(self, target: float) -> None:
        self._energise(partial(self._control, o.ENABLE_OPERATION, round(target)))

    def _send_stop(self, *, for_good: bool = False) -> None:
        if for_good:
            self._for_good = True
            self._network.send_message(*o.quick_stop_option_frame(self._settings.node, o.STOP_AND_RELEASE))
        self._control(o.QUICK_STOP)

    def disable(self) -> None:
        """Switch off the power at rest; raise RigError without rest or answer."""
        self._power_off()

    def clear(self) -> None:
        """Leave quick stop or fault for rest without power, within the latch's reset."""
        self._fresh()
        if self._for_good:
            self._book.put(o.QUICK_STOP_OPTION, o.STOP_AND_STAY)
            self._for_good = False
        for _ in range(_QUICK_STOPS):  # it may still move, and nothing else sends quick stops during a reset
            if self._state is not DriveState.ENABLED:
                break
            self._send_stop()
            self._wait(lambda: self._state is not DriveState.ENABLED, _QUICK_STOP_PERIOD)
        self._power_off()
        if self._state is DriveState.FAULT:
            self._reset_fault()
        self._network.settle(self._settings.node)  # answers that were lost while it was stopped never come

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
        self._await_rest(lambda: abs(self._speed) <= _REST * self._settings.speed)
        self._await(lambda: self._state is not DriveState.REACTING, "end its fault reaction")
        if self._state not in (DriveState.FAULT, DriveState.DISABLED):
            self._control(o.DISABLE_VOLTAGE)
            self._await(lambda: self._state in (DriveState.DISABLED, DriveState.FAULT), "switch its power off")

    def _condition(self) -> str:
        return f'the drive is in "{self._state.value}"{self._error}'

    def _control(self, controlword: int, velocity: int = 0) -> None:
        self._network.send_message(*o.command_frame(self._settings.node, controlword, velocity))

    # Reports from the drive; called by the network, from the loop

    def _status(self, data: bytes, time: float) -> None:
        if len(data) != _STATUS.size:
            return self._garble(f"TPDO1 has {len(data)} bytes, not {_STATUS.size}: {data.hex(' ')}")
        statusword, velocity, mode = _STATUS.unpack(data)
        try:
            state = o.drive_state(statusword)
        except ValueError as error:
            return self._garble(f"TPDO1: {error}")
        moved = self._may_move and state is DriveState.ENABLED
        with self._changed:
            self._state, self._mode, self._velocity = state, mode, velocity
            self._speed = self.units.speed(velocity)
            self._may_move = self._may_move and state is DriveState.ENABLED
            self._reports += 1
            self._changed.notify_all()
        if moved and (why := self._hindered(statusword, mode)) is not None and self._listener is not None:
            self._listener.emergency(self.name, o.HINDERED, why, time)

    def _hindered(self, statusword: int, mode: int) -> str | None:
        """Return why an enabled drive would not obey, or None."""
        self._limited = self._limited + 1 if statusword & o.INTERNAL_LIMIT else 0
        if mode != o.PROFILE_VELOCITY:
            return f"it has left profile velocity mode for mode {mode}"
        if not statusword & o.REMOTE:
            return "it no longer obeys the bus (remote)"
        if not statusword & o.VOLTAGE:
            return "its power stage has no voltage"
        return "a limit of its own holds it back (internal limit)" if self._limited > _LIMITED else None

    def _measured(self, data: bytes, time: float) -> None:
        if len(data) != _MEASURED.size:
            return self._garble(f"TPDO2 has {len(data)} bytes, not {_MEASURED.size}: {data.hex(' ')}")
        self._network.answered(self._settings.node)
        if self._velocity is None:  # its TPDO1 was lost; that of another SYNC would be of another instant
            return
        increments, torque = _MEASURED.unpack(data)
        if self._may_move and (late := self._network.unanswered(self._settings.node)) > UNDER_WAY:
            self._behind(late, time)
        sample = MotionSample(time, self.units.position(increments), self._speed, torque / 1000.0, self._state)
        with self._changed:
            self._velocity, self._running = None, True
            self._changed.notify_all()
        if self._listener is not None:
            self._listener.motion(self.name, sample)

    def _behind(self, late: int, time: float) -> None:
        """Report a bus that falls behind; a quick stop would be as late."""
        if self._listener is not None:
            self._listener.broken(self.name, f"{late} answers to SYNC are under way or lost: the bus is late", time)

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

    def _garble(self, why: str) -> None:
        self.garbled += 1
        self.last_garbled = why

    # Waiting

    @property
    def _book(self) -> SdoChannel:
        if self._dictionary is None:
            raise RigError(f"{self.name}: not open.")
        return self._dictionary

    def _late(self) -> str:
        return (
            f', and is in "{self._state.value}"{self._error}. Are its supply, limit switches and safe torque off '
            "inputs as they should be?"
        )

    def _fresh(self) -> None:
        self._check_open()
        seen = self._reports
        if not self._wait(lambda: self._reports > seen, self.report_limit):
            raise RigError(
                f"{self.name}: node {self._settings.node} has fallen silent: no statusword for {self.report_limit:g} s."
                " Is the drive powered, is the cable in?"
            )
