"""Attacks on a rig by its own drivers, in the spine's process: each fails as a driver of others may."""

from __future__ import annotations

import time

from scripts.validation.rig.attack_scene import Attack, Scene, named


def ordered(name: str, about: str, order: str, *, pressed: bool = False) -> Attack:
    """Make the attack that orders a driver to misbehave, and lets the force be too strong if it is ``pressed``."""

    def attack(scene: Scene) -> None:
        scene.orders.give(order)
        if pressed:
            time.sleep(0.03)
            scene.emulator.control.inject("over_force")

    return named(name, about, attack)


STOPPED = (
    ordered(
        "command_hangs",
        "Let the blade's driver not return from a command, and the force be too strong.",
        "command hangs", pressed=True,
    ),
    ordered(
        "quick_stop_hangs",
        "Let the blade's driver not return from a quick stop; the drive has to stop by its own watch.",
        "quick stop hangs", pressed=True,
    ),
    ordered(
        "quick_stop_raises",
        "Let the blade's driver raise OSError at every quick stop; the drive has to stop by its own watch.",
        "quick stop raises", pressed=True,
    ),
    ordered(
        "reading_hangs",
        "Let the blade's driver not return from reading, which holds the loop: the next command has to stop it.",
        "reading hangs",
    ),
    ordered("command_raises", "Let the blade's driver raise OSError at a command.", "command raises"),
    ordered(
        "times_in_the_future",
        "Stamp a reading of the sensor with the time of day, and let it fall silent.",
        "time ahead",
    ),
    ordered(
        "times_that_are_none", "Stamp a reading of the sensor with no number, and let it fall silent.",
        "time is no number",
    ),
    ordered("forces_that_are_none", "Let the sensor report a force that is no number.", "force is no number"),
    ordered("places_that_are_none", "Let the blade's driver report a place that is no number.", "place is no number"),
    ordered("readings_backwards", "Let the numbers of the sensor's readings go back by a thousand.", "numbers go back"),
    ordered(
        "watchdog_ended",
        "End the watchdog, and let the sensor fall silent: the drive's own watch, or a command, has to stop it.",
        "watchdog ends",
    ),
    ordered("socket_taken_away", "Close the descriptor of the CAN connection under the driver.", "bus is closed"),
    ordered(
        "spine_interpreter_held",
        "Hold the spine's interpreter for 200 ms: the drive has to stop by its own watch.",
        "interpreter is held",
    ),
)  # fmt: skip
IGNORED: tuple[Attack, ...] = ()
EITHER: tuple[Attack, ...] = ()
