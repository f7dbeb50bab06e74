"""Fake rigs with a specimen, one also with a height axis, released and ready to cut."""

from __future__ import annotations

import dataclasses
from typing import Any

from cutenv.emulation.fake_rig import FakeRig, fake_rig
from cutenv.rig.config.settings import HEIGHT, RigSettings, fake_settings
from cutenv.sim.tissue.specimen import Specimen

SETTLE = 0.15  # [s]: every axis has sent samples and a heartbeat


def ready_rig(specimen_class: str = "liver", seed: int = 3, **limits: Any) -> FakeRig:
    """A fake rig whose blade stands at the clamp and may move; ``limits`` replace its own."""
    settings = fake_settings()
    settings = dataclasses.replace(settings, limits=dataclasses.replace(settings.limits, **limits))
    rig = fake_rig(Specimen.drawn(seed, 0, specimen_class=specimen_class), settings, seed=seed)
    rig.plant.open()
    release(rig)
    return rig


def release(rig: FakeRig) -> None:
    """Switch on and let commands through."""
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    rig.plant.supervisor.release()
    rig.plant.begin()


def height_settings(**axis: Any) -> RigSettings:
    """Settings of a fake rig with a height axis, some of whose values are replaced."""
    return fake_settings(height=dataclasses.replace(HEIGHT, **axis))


def descending_rig(seed: int = 3, **axis: Any) -> FakeRig:
    """A fake rig at the clamp, at height 0; not yet open."""
    return fake_rig(Specimen.drawn(seed, 0, specimen_class="liver"), height_settings(**axis), seed=seed)


def ready_to_descend(seed: int = 3, **axis: Any) -> FakeRig:
    """The same, released."""
    rig = descending_rig(seed, **axis)
    rig.plant.open()
    release(rig)
    return rig
