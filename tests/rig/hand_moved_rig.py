"""A whole rig on a clock moved by hand: the real plant, supervisor and CANopen axis, and the emulated drive's node.

Between them lies a bus without threads: what is sent gets to the node at once, what the node sends comes back after
``way`` seconds, and anybody else may put frames on it.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from cutenv.emulation.can_hub import Frame
from cutenv.emulation.emulated_axis import EmulatedAxis
from cutenv.emulation.emulated_drive import Node
from cutenv.emulation.mechanics import Mechanics
from cutenv.rig.config.settings import Axis, Bus, RigSettings, fake_settings
from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.loop import FakeClock
from cutenv.rig.devices.protocols import DriveState, ForceListener, ForceSample
from cutenv.rig.plant import RigPlant
from cutenv.rig.spine import Spine

TICK = 0.001  # [s]
SETTLE = 0.15  # [s]: the axis has sent samples and a heartbeat
WAY = 0.0005  # [s] of a frame over a gateway
UPRIGHT = 1.5707963267948966


class Message(NamedTuple):
    """What the network makes of a frame, as python-can's class does."""

    arbitration_id: int
    data: bytes
    is_extended_id: bool = False
    is_error_frame: bool = False
    is_remote_frame: bool = False


class HandMovedNetwork(CanNetwork):
    """The rig's own network but for its adapter."""

    def __init__(self, settings: Bus, clock: FakeClock) -> None:
        super().__init__(settings, clock)
        # of a frame from the drive to the rig [s]; it may change at any instant, frames keep their order
        self.way = WAY
        self.lost = 0  # so many of the next frames of the rig do not get to the drive
        self.sent: list[tuple[float, int, bytes]] = []
        self.to_drive: Callable[[Frame], None] = lambda frame: None
        self._coming: deque[tuple[float, Frame]] = deque()

    def _open(self) -> None:
        self._use(self, Message)

    def shutdown(self) -> None:
        """Do nothing: there is no bus to leave."""

    def send(self, message: Message, timeout: float) -> None:
        """As python-can's bus: to the drive."""
        self.sent.append((self._clock.now(), message.arbitration_id, message.data))
        if self.lost > 0:
            self.lost -= 1
        else:
            self.to_drive(Frame(message.arbitration_id, message.data))

    def from_drive(self, frame: Frame) -> None:
        """On its way to the rig; an answer to an SDO is there at once, for its client waits in the machine's time."""
        if frame.identifier >> 7 == 0x580 >> 7:
            self._handle(frame.identifier, frame.data)
        else:
            self._coming.append((self._clock.now() + self.way, frame))

    def put(self, number: int, data: bytes) -> None:
        """A frame of somebody else: to the drive, and to the rig after its way."""
        self.to_drive(Frame(number, data))
        self._coming.append((self._clock.now() + self.way, Frame(number, data)))

    def recv(self, timeout: float) -> Message | None:
        """Return the next frame that has arrived, or None."""
        if not self._coming or self._coming[0][0] > self._clock.now() + 1e-9:
            return None
        frame = self._coming.popleft()[1]
        return Message(frame.identifier, frame.data)


class HandMovedSensor:
    """In air: six counts that flicker."""

    rate, rate_error, axes = 1000.0, 0.001, "xyz"

    def __init__(self, clock: FakeClock) -> None:
        self._clock = clock
        self._turns: Any = None
        self._sequence = 0

    def open(self, listener: ForceListener) -> None:
        def send(now: float) -> None:
            self._sequence += 1
            count = self._sequence * 7919 % 1009
            listener.force(ForceSample(now, (1e-6 * count,) * 3, (count,) * 6, 0, self._sequence, 0))

        self._turns = self._clock.every(TICK, send, "sensor")

    def tare(self, samples: int = 200) -> tuple[float, float, float]:
        self._clock.sleep_until(self._clock.now() + samples / self.rate)
        return (0.0, 0.0, 0.0)

    def about(self) -> dict[str, float | str]:
        return {}

    def close(self) -> None:
        if self._turns is not None:
            self._turns.stop()


class HandMovedRig:
    """One axis, the blade's; ``node`` is its drive, ``axis`` its motor."""

    def __init__(self, **limits: Any) -> None:
        settings = fake_settings(angle_mode="fixed", angle=None, blade=Axis(low=-0.002, high=0.149))
        self.settings: RigSettings = dataclasses.replace(
            settings, limits=dataclasses.replace(settings.limits, **limits)
        )
        self.clock = FakeClock()
        self.network = HandMovedNetwork(self.settings.bus, self.clock)
        self.motor = EmulatedAxis("blade", self.settings.blade, Mechanics(), position=0.0, margin=0.003)
        self.events: list[tuple[float, str]] = []
        self.node = Node(self.motor, self.network.from_drive, self._happened)
        self.network.to_drive = lambda frame: self.node.receive(frame, self.clock.now())
        self.driver = CanopenAxis(self.network, self.settings.blade, self.clock)
        self.plant = RigPlant(Spine(self.settings, self.clock, [self.driver], HandMovedSensor(self.clock)))
        self.supervisor = self.plant.supervisor
        self.enabled: list[float] = []  # when the drive got its power on [s]
        self._was = self.node.state
        enter = self.node._enter

        def noted(state: DriveState) -> None:
            if state is DriveState.ENABLED and self.node.state is not state:
                self.enabled.append(self.clock.now())
            enter(state)

        self.node._enter = noted  # type: ignore[method-assign]
        self.clock.every(TICK, self._tick, "drive")

    def _happened(self, what: str, **details: Any) -> None:
        self.events.append((self.clock.now(), what))

    def _tick(self, now: float) -> None:
        self.node.tick(now)
        self.motor.turn(0.0)

    @property
    def position(self) -> float:
        """Of the carriage [m]."""
        return float(self.motor.motor["carriage"])

    @property
    def speed(self) -> float:
        """Of the carriage [m/s]."""
        return float(self.motor.motor["carriage_speed"])

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now() + seconds)

    def ready(self) -> HandMovedRig:
        """Open, with power, released."""
        self.wait(0.01)
        self.plant.open()
        self.go_on()
        return self

    def go_on(self) -> None:
        """What an operator does who agrees: reset, switch on, release."""
        self.supervisor.reset(agreed=True)
        self.plant.power()
        self.wait(SETTLE)
        self.supervisor.release()
        self.plant.begin()

    def cut(self, speed: float, seconds: float) -> None:
        for _ in range(round(seconds / 0.020)):
            self.plant.advance(speed, UPRIGHT, 20)
