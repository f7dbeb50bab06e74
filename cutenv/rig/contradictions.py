"""Contradictions in a rig's file.

Keys that are each in range but cannot be true at the same time.

A rig that is accepted here can be used for cuts: in normal operation it crosses no limit.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from cutenv._base.validation import one_of
from cutenv.rig.config.file_schema import setting_text
from cutenv.rig.config.settings import Axis, CrossAxis, HeightAxis, Reach, RigSettings
from cutenv.rig.devices.canopen.configuration import PRODUCER_PERIOD
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE, INTERFACES, bus_arguments
from cutenv.rig.devices.canopen.objects import AxisUnits
from cutenv.rig.devices.driver_registry import KIND_OF_ROLE, axes_driven_by, driven_roles, traits_of
from cutenv.rig.operation.session import RETURN_SPEED
from cutenv.rig.plant import REST_WITHIN, TURN_RATE
from cutenv.rig.safety.monitors import RISE_OVER
from cutenv.rig.travel import RAISE_SPEED, SLOW_TURN

AHEAD = 0.010  # distance by which the blade is ahead of the tip in tissue [m]
SHORTEST_TRAVEL = 0.015 + AHEAD  # far end of travel that the shortest cut needs [m]
_CLAMP_ROOM = 5e-4  # [m] before the clamp: a blade that returns to it overshoots by less
_UPRIGHT_ROOM = math.radians(0.5)  # [rad] beyond 90 degrees, for the same reason
_STOP_WITHIN = 0.25  # [s] allowed for a quick stop from the axis's top speed
_TURNING_WITHIN = 0.25  # [s] from rest to the rate that a cut demands of a hinge
_SETTLING = 6.0  # lags of the velocity loop until the blade counts as at rest
_COARSEST = 2e-5  # [m] coarsest increment: with a larger one, creeping motion would not be seen
_LONGEST_SYNC = 0.020  # [s] on a CAN bus
_FULL = 0.8  # [1] greatest load of a bus: beyond it frames come late
_SYNC_BITS, _AXIS_BITS = 55, 365  # bits of a SYNC, and of an axis's command and two answers, with all stuffing
_TISSUE_RISE = 15.0 / 0.0254  # [N/m] rise of the force along the cut in tissue
_NOISE, _RESOLUTION = 0.02, 0.05  # [N] of a sensor that is not identified
_NOISY = 6.0  # standard deviations that noise alone may reach
_MEASURED_AS_TOLD = 2.0  # [1] greatest ratio of the identified acceleration to the one set in the drive

Found = Iterator["Contradiction"]


class Contradiction(NamedTuple):
    """Keys that cannot be true together."""

    keys: tuple[str, ...]  # section and field of each key, such as ``"limits.high"``
    why: str  # consequence, and cure


def refuse_contradictions(settings: RigSettings) -> None:
    """Raise an error for a rig whose keys contradict each other.

    Raise ValueError if keys contradict each other; names every contradiction, with keys and values as in the file.
    """
    for role, driver in driven_roles(settings).items():
        traits_of(KIND_OF_ROLE[role], driver).check(settings, role)
    found = [
        f"{' and '.join(setting_text(settings, key) for key in each.keys)}: {each.why}"
        for each in contradictions(settings)
    ]
    if found:
        raise ValueError(" ".join(found))


def contradictions(settings: RigSettings) -> Found:
    """Yield every contradiction among a rig's settings."""
    yield from _names(settings)
    yield from _nodes(settings)
    yield from _bus(settings)
    yield from _travel(settings)
    for name, reach in settings.reaches.items():
        yield from _straight(settings, name, reach)
    yield from _brakes(settings)
    yield from _forces(settings)
    yield from _turns(settings)
    yield from _measured(settings)
    for name, cross_axis in settings.cross_axes.items():
        yield from _across(settings, name, cross_axis)
    if settings.height is not None:
        yield from _heights(settings, settings.height)
    for name, axis in axes_driven_by(settings, "canopen").items():
        yield from _counts(name, axis)


def _names(settings: RigSettings) -> Found:
    name = settings.name
    if not name or name != name.strip() or not name.isprintable():
        yield Contradiction(
            ("name",), "the operator confirms by typing it: give a name that can be seen, without spaces around it."
        )


def _nodes(settings: RigSettings) -> Found:
    axes = axes_driven_by(settings, "canopen")
    nodes = {"bus.node": settings.bus.node} | {f"{name}.node": axis.node for name, axis in axes.items()}
    keys = list(nodes)
    for i, one in enumerate(keys):
        for other in keys[i + 1 :]:
            if nodes[one] == nodes[other]:
                yield Contradiction((one, other), "every node of a CAN bus needs a number of its own.")


def _bus(settings: RigSettings) -> Found:
    bus, limits, sync = settings.bus, settings.limits, settings.bus.sync
    if 2.0 * sync > limits.stale_motion:
        yield Contradiction(
            ("limits.stale_motion", "bus.sync"),
            "samples come once in that period, and one may be late: allow two periods or more.",
        )
    axes = axes_driven_by(settings, "canopen")
    if not axes:
        return
    if sync > _LONGEST_SYNC:
        yield Contradiction(("bus.sync",), f"on a CAN bus it is {1e3 * _LONGEST_SYNC:g} ms at most.")
    try:
        one_of("interface", bus.interface, INTERFACES)
        bus_arguments(bus)
    except ValueError as error:
        yield Contradiction(("bus.interface", "bus.channel"), f"{error}")
    if 2.0 * bus.heartbeat > DRIVE_PATIENCE:
        yield Contradiction(
            ("bus.heartbeat",), f"a drive stops after {1e3 * DRIVE_PATIENCE:g} ms without one; two must fit into that."
        )
    if 1.5 * PRODUCER_PERIOD > limits.heartbeat:
        yield Contradiction(
            ("limits.heartbeat",),
            f"a drive sends one every {1e3 * PRODUCER_PERIOD:g} ms, and one may be late: allow 75 ms or more.",
        )
    load = (_SYNC_BITS + _AXIS_BITS * len(axes)) / bus.bitrate / sync
    if load > _FULL:
        yield Contradiction(
            ("bus.bitrate", "bus.sync"),
            f"the frames of a SYNC fill the bus to {load:.0%}. Raise the bit rate, in all drives too, or the period.",
        )


def _travel(settings: RigSettings) -> Found:
    limits = settings.limits
    if limits.low > -_CLAMP_ROOM:
        yield Contradiction(
            ("limits.low",), f"the clamp, where every cut begins, is at 0 mm: give {-1e3 * _CLAMP_ROOM:g} mm or less."
        )
    if limits.high < SHORTEST_TRAVEL:
        yield Contradiction(("limits.high",), f"the shortest cut needs {1e3 * SHORTEST_TRAVEL:g} mm.")
    if limits.speed < RETURN_SPEED:
        yield Contradiction(
            ("limits.speed",), f"the blade returns to the clamp at {1e2 * RETURN_SPEED:g} cm/s. Allow that."
        )


def _straight(settings: RigSettings, name: str, reach: Reach) -> Found:
    """Yield contradictions between a straight axis's drive and its limits."""
    axis, own = reach.axis, ("limits", "low", "high", "speed", "acceleration", "following")
    if isinstance(axis, CrossAxis):
        own = (name, *axis.ends, "fastest", "most_acceleration", "following")
    low, high, speed, acceleration, following = (f"{own[0]}.{field}" for field in own[1:])
    if axis.low > reach.low:
        yield Contradiction((f"{name}.low", low), _drive_first(f"Lower {name}.low_mm, or raise the limit"))
    if axis.high < reach.high:
        yield Contradiction((f"{name}.high", high), _drive_first(f"Raise {name}.high_mm, or lower the limit"))
    if axis.driver == "canopen" and axis.following_error < reach.following:
        cure = "Widen the drive's window, or lower the limit"
        yield Contradiction((f"{name}.following_error", following), _drive_first(cure))
    if reach.following < reach.speed * settings.bus.sync:
        why = "the blade moves further than that between two samples. Allow more."
        yield Contradiction((following, speed, "bus.sync"), why)
    if reach.speed > axis.speed:
        why = "the drive goes no faster than its own speed; the limit must be within it."
        yield Contradiction((speed, f"{name}.speed"), why)
    if reach.acceleration < axis.acceleration:
        why = "the drive accelerates beyond the limit by itself. Lower its own acceleration."
        yield Contradiction((acceleration, f"{name}.acceleration"), why)


def _drive_first(cure: str) -> str:
    return f"the drive would fall into a fault before the limit stops it. {cure}."


def _brakes(settings: RigSettings) -> Found:
    for name, axis in settings.axes.items():
        if axis.quick_stop < axis.acceleration:
            yield Contradiction(
                (f"{name}.quick_stop", f"{name}.acceleration"), "a quick stop must not be gentler than a plain one."
            )
        if axis.speed > _STOP_WITHIN * axis.quick_stop:
            yield Contradiction(
                (f"{name}.quick_stop", f"{name}.speed"),
                f"from its top speed it takes {axis.speed / axis.quick_stop:.2g} s to stop, and may take "
                f"{_STOP_WITHIN:g}. Raise the one, or lower the other.",
            )
    blade, lag = settings.blade, settings.identified.motor_lag or 0.0
    resting = settings.limits.speed / blade.acceleration + _SETTLING * lag
    if resting > 0.5 * REST_WITHIN:
        keys = ("blade.acceleration", "limits.speed") + (("identified.motor_lag",) if lag else ())
        yield Contradiction(
            keys, f"at the end of a cut the blade takes {resting:.2g} s to rest, and may take {0.5 * REST_WITHIN:g}."
        )


def _forces(settings: RigSettings) -> Found:
    limits, rate, measured = settings.limits, settings.sensor.rate, settings.identified
    noise = _NOISE if measured.force_noise is None else measured.force_noise
    step = _RESOLUTION if measured.force_resolution is None else measured.force_resolution
    noisy = _NOISY * noise + step
    sources = tuple(
        f"identified.{name}" for name in ("force_noise", "force_resolution") if getattr(measured, name) is not None
    )
    if limits.force_norm < limits.force:
        yield Contradiction(
            ("limits.force", "limits.force_norm"),
            "the force of one axis is never above that of all three: its limit would never count.",
        )
    for name, fewest in (("stale_force", 3), ("frozen_force", 5), ("late_force", 3)):
        if getattr(limits, name) * rate < fewest:
            yield Contradiction(
                (f"limits.{name}", "sensor.rate"),
                f"it must be the time of {fewest} readings or more. Allow {1e3 * fewest / rate:.3g} ms.",
            )
    if limits.force_rise < _TISSUE_RISE * limits.speed:
        yield Contradiction(
            ("limits.force_rise", "limits.speed"),
            f"in tissue, force rises by {_TISSUE_RISE * limits.speed:.3g} N/s at that speed. Allow more, or go slower.",
        )
    rise = math.sqrt(2.0) * noisy / RISE_OVER  # noise of a difference of two readings
    if limits.force_rise < rise:
        yield Contradiction(
            ("limits.force_rise", *sources), f"the sensor's noise alone rises by up to {rise:.3g} N/s. Allow more."
        )
    if limits.force < noisy:
        yield Contradiction(("limits.force", *sources), f"the sensor's noise alone reaches {noisy:.2g} N. Allow more.")


def _turns(settings: RigSettings) -> Found:
    limits, hinge = settings.limits, settings.angle
    if hinge is None:
        if not limits.angle_low <= settings.fixed_angle <= limits.angle_high:
            yield Contradiction(
                ("fixed_angle", "limits.angle_low", "limits.angle_high"), "the fixed angle is outside its limits."
            )
        return
    if not limits.angle_low + 4.0 * _UPRIGHT_ROOM <= math.pi / 2 <= limits.angle_high - _UPRIGHT_ROOM:
        yield Contradiction(
            ("limits.angle_low", "limits.angle_high"),
            "a cut begins upright, at 90 deg, and turns from there: allow 88 to 90.5 deg at least.",
        )
    if hinge.low > limits.angle_low:
        yield Contradiction(("angle.low", "limits.angle_low"), _drive_first("Lower angle.low_deg, or raise the limit"))
    if hinge.high < limits.angle_high:
        yield Contradiction(
            ("angle.high", "limits.angle_high"), _drive_first("Raise angle.high_deg, or lower the limit")
        )
    if min(hinge.speed, TURN_RATE) > _TURNING_WITHIN * hinge.acceleration:
        yield Contradiction(
            ("angle.acceleration", "angle.speed"),
            f"it takes longer than {_TURNING_WITHIN:g} s to turn as fast as a cut asks for, up to "
            f"{math.degrees(TURN_RATE):g} deg/s. Raise its acceleration.",
        )
    if hinge.speed < SLOW_TURN:
        yield Contradiction(
            ("angle.speed",), f"the blade turns back at {math.degrees(SLOW_TURN):g} deg/s between cuts. Allow that."
        )


def _across(settings: RigSettings, name: str, axis: CrossAxis) -> Found:
    low, high = axis.bounds
    lowest, highest = (f"{name}.{end}" for end in axis.ends)
    if low > -_CLAMP_ROOM:
        yield Contradiction((lowest,), f"a cut begins at {name} 0: give {-1e3 * _CLAMP_ROOM:g} mm or less.")
    if high < _CLAMP_ROOM:
        yield Contradiction((highest,), f"a cut begins at {name} 0: give {1e3 * _CLAMP_ROOM:g} mm or more.")
    if axis.fastest < RAISE_SPEED:
        yield Contradiction(
            (f"{name}.fastest",), f"between cuts the blade is moved at {1e2 * RAISE_SPEED:g} cm/s. Allow that."
        )
    if (resting := axis.fastest / axis.acceleration) > 0.5 * REST_WITHIN:
        yield Contradiction(
            (f"{name}.acceleration", f"{name}.fastest"),
            f"at the end of a cut the blade takes {resting:.2g} s to rest, and may take {0.5 * REST_WITHIN:g}.",
        )
    if axis.force_axis == settings.sensor.cut_axis:
        yield Contradiction(
            (f"{name}.force_axis", "sensor.cut_axis"), "one axis of the sensor cannot lie along the cut and across it."
        )


def _heights(settings: RigSettings, axis: HeightAxis) -> Found:
    if not _CLAMP_ROOM < axis.raised <= axis.highest - _CLAMP_ROOM:
        yield Contradiction(
            ("height.raised", "height.highest"),
            f"the blade is raised above height 0, and stays {1e3 * _CLAMP_ROOM:g} mm below its limit.",
        )
    if axis.vertical_force > settings.limits.force:
        yield Contradiction(
            ("height.vertical_force", "limits.force"),
            "the limit of each axis of the sensor is lower: this one would never count.",
        )
    if settings.side is not None and settings.side.force_axis == axis.force_axis:
        yield Contradiction(
            ("height.force_axis", "side.force_axis"), "one axis of the sensor cannot lie upwards and to the side."
        )


def _measured(settings: RigSettings) -> Found:
    measured, told = settings.identified.acceleration, settings.blade.acceleration
    if measured and not 1.0 / _MEASURED_AS_TOLD <= measured / told <= _MEASURED_AS_TOLD:
        yield Contradiction(
            ("identified.acceleration", "blade.acceleration"),
            "it was measured with another setting of the drive. Identify the rig again.",
        )


def _counts(name: str, axis: Axis) -> Found:
    """Yield contradictions if no drive can express this axis in its units."""
    mechanics = (f"{name}.pulses", f"{name}.gear", f"{name}.lead")
    refusals = []
    for steps in (1000, 1):  # newer drives know milli-rpm, older ones whole rpm
        try:
            units = AxisUnits(axis=axis, steps=steps)
        except ValueError as error:
            refusals.append(f"{error}")
    if len(refusals) == 2:
        yield Contradiction(mechanics, refusals[0])
    elif units.increments(axis.following_error) == 0:
        yield Contradiction(
            (*mechanics, f"{name}.following_error"), "the window is less than one increment of the encoder."
        )
    elif name != "angle" and units.position(1) * axis.direction > _COARSEST:
        yield Contradiction(
            mechanics,
            f"an increment of the encoder is {1e3 * abs(units.position(1)):.2g} mm, and a creeping blade moves "
            f"{1e3 * _COARSEST:g} mm between two checks.",
        )
