"""A rig by its name, connected to and guarded, with nothing on its bench: for what a lab does before it cuts."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

from cutenv.rig.air_bench import AirBench
from cutenv.rig.clock import FakeClock
from cutenv.rig.fake import FakeRig, fake_settings
from cutenv.rig.guard import guarded
from cutenv.rig.hardware import rig_plant
from cutenv.rig.operator import AutomaticOperator, Operator, TerminalOperator
from cutenv.rig.plant import RigPlant
from cutenv.rig.preparation import SETTLE
from cutenv.rig.real_time import preferred
from cutenv.rig.settings import RigSettings
from cutenv.rig.toml_file import read

FAKE, EMULATOR = "fake", "emulator"
"""Names that are no files: a rig in memory on a clock of its own, and an emulated one in a process of its own."""


class Connection(NamedTuple):
    """A rig that is connected to; nothing has moved, and the drives have no power."""

    settings: RigSettings
    plant: RigPlant


@contextmanager
def connected(rig: str, *, clock: FakeClock | None = None) -> Iterator[Connection]:
    """Connect to a rig, and be ready to stop it whatever happens; it is left at the end.

    Parameters
    ----------
    rig : str
        A rig's TOML file, "emulator" or "fake"; the latter two have the blade in free air.
    clock : FakeClock, optional
        Of a fake rig.

    Raises
    ------
    FileNotFoundError, ValueError
        If the file is missing or says what cannot be.
    RigError
        If the rig is not there, or not what its file says.
    """
    with ExitStack() as stack:
        if rig == FAKE:
            fake = FakeRig(AirBench, fake_settings(name=FAKE), clock=clock)
            settings, plant = fake.settings, fake.plant
        else:
            if rig == EMULATOR:
                from cutenv.rig.emulator.process import start

                settings = stack.enter_context(start(free_air=True)).settings
            else:
                settings = read(rig)
            plant = rig_plant(settings)
            stack.enter_context(preferred())
        stack.callback(plant.close)
        plant.open()
        stack.enter_context(guarded(plant.supervisor, plant.clock))
        plant.clock.sleep_until(plant.clock.now() + SETTLE)
        yield Connection(settings, plant)


def operator_of(settings: RigSettings) -> Operator:
    """Whom to ask before a rig moves: a person at the terminal; nobody for an emulated or fake one.

    Raises
    ------
    RigError
        If there is no terminal.
    """
    return AutomaticOperator(settings) if settings.emulated else TerminalOperator()


def settings_of(rig: str) -> RigSettings:
    """What is known of a rig before it is connected to.

    Raises
    ------
    FileNotFoundError, ValueError
        If its file is missing or says what cannot be.
    """
    return fake_settings(name=rig) if rig in (FAKE, EMULATOR) else read(rig)
