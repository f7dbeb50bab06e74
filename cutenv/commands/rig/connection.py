"""Connection to a rig by name, with an empty bench.

It is guarded, and is for work in a lab before any cut.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import NamedTuple

from cutenv.rig.config.settings import EMULATED, FAKE, RigSettings, fake_settings
from cutenv.rig.devices.loop import FakeClock, undisturbed
from cutenv.rig.errors import RigError
from cutenv.rig.operation.preflight import SETTLE
from cutenv.rig.plant import RigPlant, rig_plant
from cutenv.rig.safety.oversight import guarded
from cutenv.rig.toml_file import read_rig_file


class Connection(NamedTuple):
    """Connected rig; nothing has moved, and the drives have no power."""

    settings: RigSettings
    plant: RigPlant


@contextmanager
def connected(rig: str, *, clock: FakeClock | None = None) -> Iterator[Connection]:
    """Connect to a rig, with every stop installed.

    It is closed at the end of the block. ``rig`` is its TOML file, or one of
    :data:`~cutenv.rig.config.settings.RIG_NAMES`: these have the blade in air. Raise FileNotFoundError, ValueError if
    the file is missing or not valid; RigError if the rig is not there, or differs from its file.
    """
    emulator = None
    with ExitStack() as stack:
        if rig == FAKE:
            from cutenv.emulation.fake_benches import AirPlant
            from cutenv.emulation.fake_rig import FakeRig

            fake = FakeRig(AirPlant, fake_settings(name=FAKE), clock=clock)
            settings, plant = fake.settings, fake.plant
        else:
            if rig in EMULATED:
                from cutenv.emulation.process import start

                emulator = stack.enter_context(start(free_air=True, kind=rig))
                settings = emulator.settings
            else:
                settings = read_rig_file(rig)
            plant = rig_plant(settings, file=None if rig in EMULATED else rig)
            stack.enter_context(undisturbed())
        stack.callback(plant.close)
        plant.open()
        stack.enter_context(guarded(plant.supervisor))
        plant.clock.sleep_until(plant.clock.now() + SETTLE)
        try:
            yield Connection(settings, plant)
        except RigError as error:
            if emulator is None or not (late := emulator.lateness):
                raise
            raise RigError(f"{error} ({late})") from error
