"""All six components in the record of a rig without a height axis, where its file asks for them."""

from __future__ import annotations

import math

import numpy as np

from cutenv.emulation.fake_rig import fake_rig
from cutenv.rig.config.settings import SensorSettings, fake_settings
from cutenv.rig.operation.session import recorded_channels, recorded_rows
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import COMPONENTS_OF_FORCE


def recorded(components: str) -> tuple[tuple[str, ...], list[tuple[float, ...]] | None, np.ndarray]:
    """Fields beside a reading, their rows, and the force along the cut [N], of a fake rig in tissue."""
    settings = fake_settings(sensor=SensorSettings(components=components))
    rig = fake_rig(Specimen.drawn(3, 0), settings, seed=3)
    rig.plant.open()
    rig.plant.power()
    rig.clock.sleep_until(rig.clock.now() + 0.15)
    rig.plant.supervisor.release()
    rig.plant.begin()
    rows = [recorded_rows(rig.plant, rig.plant.advance(0.0127, math.pi / 2, 20)) for _ in range(100)]
    channels = None if rows[0][1] is None else [row for _, part in rows for row in part]
    return recorded_channels(settings), channels, np.array([reading.force for part, _ in rows for reading in part])


def test_a_rig_without_a_height_axis_records_all_six_if_its_file_says_so():
    names, rows, force = recorded("all")
    assert names == COMPONENTS_OF_FORCE
    six = np.array(rows)
    assert six.shape == (2000, 6)
    assert np.array_equal(six[:, 0], force)
    assert force.max() > 0.3


def test_a_rig_records_the_force_along_the_cut_alone_by_default():
    assert recorded("along")[:2] == ((), None)
