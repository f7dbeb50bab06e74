"""Rows of a cut's record: the readings, and what a rig measures beside them."""

from __future__ import annotations

from cutenv._base.arrays import StructArray
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.plant import RigPlant
from cutenv.tissue.grid import depth_below
from cutenv.trace import COMPONENTS_OF_FORCE, PLACE, Reading

Row = tuple[float, ...]


def recorded_beside(settings: RigSettings) -> tuple[str, ...]:
    """Return the fields that a rig records beside a :class:`~cutenv.trace.Reading`'s.

    With a height axis "height" and "vertical_force", with one to the side "blade_x", "blade_y" and "lateral_force";
    with either, or if its file says so, the six components.  They are what ``beside`` of
    :class:`cutenv.recording.AppendingRecord` takes.
    """
    names: tuple[str, ...] = ()
    if settings.height is not None:
        names += "height", "vertical_force"
    if settings.side is not None:
        names += *PLACE, "lateral_force"
    return names + COMPONENTS_OF_FORCE if names or settings.sensor.components == "all" else ()


def recorded_rows(plant: RigPlant, readings: StructArray) -> tuple[list[Reading], list[Row] | None]:
    """Return the rows to record of the readings that a plant has just made, and the fields beside them.

    The depth is that of the measured profile at the blade, of a blade at height 0.

    Parameters
    ----------
    plant : RigPlant
        The rig, whose ``keep`` is called with these readings.
    readings : Records
        :data:`cutenv.cutting.dtypes.READING`, shape (n,).

    Returns
    -------
    tuple of (list of Reading, list of tuple or None)
        For :meth:`cutenv.recording.AppendingRecord.append`; None where nothing is beside them.
    """
    depth = depth_below(plant.depth, readings["position"])
    columns = [readings[field].tolist() for field in ("time", "force", "position", "speed", "angle")]
    rows = list(map(Reading._make, zip(*columns, depth.tolist(), strict=True)))
    names = list(recorded_beside(plant.settings))
    return rows, None if plant.beside is None else plant.beside[names].tolist()
