"""Attacks by other participants on the CAN bus and in the sensor's network."""

from __future__ import annotations

import os
import random
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cutenv.rig.devices.canopen.network import Socketcand
from cutenv.rig.devices.netft_sensor import RdtCommand, request_bytes
from cutenv.rig.errors import RigError
from cutenv.rig.plant import rig_plant
from scripts.validation.rig.attack_scene import Attack, Scene, named


@contextmanager
def on_the_bus(scene: Scene) -> Iterator[Any]:
    """Connect another client to the gateway; yield a function that sends a frame."""
    import can

    bus = Socketcand(scene.emulator.settings.bus)
    time.sleep(0.05)  # until the hub has accepted it
    try:
        yield lambda number, data=b"": bus.send(
            can.Message(arbitration_id=number, data=data, is_extended_id=False), timeout=1.0
        )
        time.sleep(0.05)  # a connection closed with frames unread is reset, and the hub may lose what it was sent
    finally:
        bus.shutdown()


def sent(name: str, about: str, number: int, data: bytes = b"", *, times: int = 1, every: float = 0.0) -> Attack:
    """Make the attack that sends one frame so many times, ``every`` so many seconds."""

    def attack(scene: Scene) -> None:
        with on_the_bus(scene) as send:
            for _ in range(times):
                send(number, data)
                time.sleep(every)

    return named(name, about, attack)


def _command(word: int, speed: int) -> bytes:
    return struct.pack("<HiB", word, speed, 3)


FRAMES = (
    sent("foreign_quick_stop", "Send one quick stop as another master.", 0x201, _command(0x0B, 0)),
    sent("foreign_speed_once", "Send one command as another master: 3 cm/s.", 0x201, _command(0x0F, 3_960_000)),
    sent("foreign_stop_of_the_node", "Stop the node by network management (NMT).", 0x000, b"\x02\x01"),
    sent("foreign_pre_operational", "Set all nodes to pre-operational by network management.", 0x000, b"\x80\x00"),
    sent("foreign_reset_of_the_node", "Reset the node by network management (NMT).", 0x000, b"\x81\x01"),
    sent("foreign_sync", "Send SYNC every 5 ms for half a second as another master.", 0x080, times=100, every=0.005),
    sent(
        "foreign_heartbeat",
        'Send a heartbeat with state "stopped" under our number as another master.',
        0x77F, b"\x04", times=10, every=0.03,
    ),
    sent("spoofed_boot", "Send a boot-up message in the drive's name.", 0x701, b"\x00"),
    sent(
        "spoofed_emergency",
        "Send an emergency message in the drive's name.",
        0x081, struct.pack("<HB5x", 0x8611, 0x20),
    ),
)  # fmt: skip


def spoofed_position(scene: Scene) -> None:
    """Send samples in the drive's name with another position of the blade."""
    with on_the_bus(scene) as send:
        for _ in range(5):
            send(0x181, struct.pack("<HiB", 0x27, 1_980_000, 3))
            send(0x281, struct.pack("<ih", 1_000_000, 0))
            time.sleep(0.005)


def short_and_long_frames(scene: Scene) -> None:
    """Send frames of every length under each of the drive's identifiers."""
    with on_the_bus(scene) as send:
        for number in (0x181, 0x281, 0x081, 0x701, 0x581):
            for length in (0, 1, 3, 5):
                if number == 0x701 and length == 1:
                    continue
                send(number, bytes(length))


def flood_of_foreign_frames(scene: Scene) -> None:
    """Send two thousand frames with unused identifiers."""
    with on_the_bus(scene) as send:
        for i in range(2000):
            send(0x310 + i % 64, bytes(8))  # not those of our nodes' process data


def gateway_full_of_clients(scene: Scene) -> None:
    """Open thirty silent connections to the gateway."""
    settings = scene.emulator.settings.bus
    held = [socket.create_connection((settings.host, settings.port), timeout=2.0) for _ in range(30)]
    time.sleep(0.5)
    for connection in held:
        connection.close()


def gateway_hears_garbage(scene: Scene) -> None:
    """Send noise as another client of the gateway."""
    settings, noise = scene.emulator.settings.bus, random.Random(1)
    for _ in range(20):
        with socket.create_connection((settings.host, settings.port), timeout=2.0) as other:
            other.sendall(noise.randbytes(3000))


def second_program(scene: Scene) -> None:
    """Start a second program, or another environment, for the same rig: refused, and the first goes on."""
    plant = rig_plant(scene.emulator.settings)
    try:
        plant.open()
        scene.note("! two programs have one rig")
    except RigError as error:
        scene.note(f"refused: {error}")
    finally:
        plant.close()


def foreign_packets_to_us(scene: Scene) -> None:
    """Send a thousand packets to our port of the sensor from elsewhere."""
    ours = _udp_port(scene.rig.plant.spine.pid)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        for i in range(1000):
            other.sendto(struct.pack("!IIIiiiiii", i, i, 0, 10**9, 0, 0, 0, 0, 0), ("127.0.0.1", ours))


def _udp_port(pid: int) -> int:
    """Return the local port of the only UDP socket that a process has, as Linux tells it."""
    files = [os.readlink(file) for file in Path(f"/proc/{pid}/fd").iterdir()]
    lines = Path("/proc/net/udp").read_text(encoding="ascii").splitlines()[1:]
    (port,) = (int(line.split()[1].split(":")[1], 16) for line in lines if f"socket:[{line.split()[9]}]" in files)
    return port


def _ask_sensor(scene: Scene, command: RdtCommand) -> None:
    settings = scene.emulator.settings.sensor
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(request_bytes(command), (settings.address, settings.port))
        time.sleep(0.3)


def foreign_start(scene: Scene) -> None:
    """Start the sensor's stream for another client; the emulated sensor serves both, a real one only the new one."""
    _ask_sensor(scene, RdtCommand.START)


def foreign_end(scene: Scene) -> None:
    """End the sensor's stream from elsewhere."""
    _ask_sensor(scene, RdtCommand.STOP)


def foreign_bias(scene: Scene) -> None:
    """Set the sensor's zero from elsewhere in the middle of a cut: a step of the force."""
    _ask_sensor(scene, RdtCommand.BIAS)


STOPPED = (*FRAMES, spoofed_position)  # attacks that have to stop the blade
IGNORED = (  # attacks that must not stop it
    short_and_long_frames, flood_of_foreign_frames, gateway_full_of_clients, gateway_hears_garbage,
    second_program, foreign_packets_to_us,
)  # fmt: skip
EITHER = (foreign_bias, foreign_start, foreign_end)
"""Attacks that may stop it: the blade has to follow its commands, or stand."""
