"""Conditions for any motion, and the inspection of an open rig.

Conditions: calibration, self-test, and a person's confirmation. The inspection is at rest and without power, of the
rig and its camera: checks, and what the devices report.
"""

from __future__ import annotations

import hashlib
import math
import platform
import time
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.rig.config.settings import Axis, CameraSettings, CrossAxis, RigSettings, expired
from cutenv.rig.devices.camera import RigCamera
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import Operator
from cutenv.rig.operation.recorder import Recorder
from cutenv.rig.plant import RigPlant
from cutenv.rig.safety.monitors import CREEP
from cutenv.rig.travel import SLICE

SETTLE = 0.3  # time after switching on, before anything is checked [s]
ZERO_FORCE = 0.2  # greatest force allowed on a blade in air, after tare [N]
_NUDGE = 0.001  # [m] by which the blade is moved and brought back
_NUDGE_SPEED = 0.002  # [m/s]
_NUDGE_SHARE = 0.8  # [1] share of it that the encoder has to show
_RELIEF, _RELIEF_STEP = 0.010, 2e-4  # [m] by which a blade that presses on the tissue is raised at most, and at a time
_INSIDE = 5e-4  # [m] inside an end of travel, where a blade that returns stops
_PUSH = 0.5  # [N] that a push by hand has to read at least
_TURN = math.radians(1.0)  # [rad] by which the blade is turned and back
_SAME = 0.02  # relative difference allowed between a drive's limit and the file: whole increments


@dataclass(frozen=True)
class Check:
    """Result of one check.

    Its name, whether it passed, and what was found.
    """

    name: str
    passed: bool
    found: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.passed else 'FAIL'} {self.name}: {self.found}"


def may_move(settings: RigSettings, today: date) -> list[Check]:
    """Check the file alone: the calibration, and who answers for the rig."""
    why = expired(settings.calibration, today)
    armed = settings.armed_by.strip()
    return [
        Check("calibration", why is None, why or f"of {settings.calibration.date}"),
        Check("armed_by", bool(armed), armed or 'empty; write under "armed_by" who answers for this rig'),
    ]


def still_checks(plant: RigPlant, *, in_air: bool = True) -> list[Check]:
    """Check an open rig at rest: readings, zero in air, samples, drive limits."""
    supervisor, settings = plant.supervisor, plant.settings
    checks = []
    sample = supervisor.newest_force
    if sample is None:
        checks.append(Check("force readings", False, "none has arrived"))
    else:
        norm = math.hypot(*sample.force)
        checks.append(Check("force status", sample.status == 0, f"0x{sample.status:08X}"))
        if in_air:
            checks.append(Check("zero force", norm <= ZERO_FORCE, f"{norm:.3f} N, {ZERO_FORCE:g} N allowed"))
    axes = settings.axes
    answered = plant.spine.drive_limits()
    for name, axis in axes.items():
        moved = supervisor.axis(name)
        checks.append(
            Check(f"{name} axis", moved is not None, "no sample" if moved is None else f'"{moved.state.value}"')
        )
        checks += [_limit(name, axis, what, value) for what, value in answered[name].items()]
    for name, cross_axis in settings.cross_axes.items():
        if cross_axis.homing == "trusted":
            continue
        homed = plant.spine.about()[name].get("homed") == "yes"
        cure = (
            "" if homed else '; home it with the maker\'s tool, or write homing = "trusted" for a drive without the bit'
        )
        checks.append(Check(f"{name} homed", homed, f"the drive says {'yes' if homed else 'no'}{cure}"))
    return checks


def _limit(name: str, axis: Axis, what: str, answered: float) -> Check:
    wanted = float(getattr(axis, what))
    span = axis.high - axis.low if what in ("low", "high") else abs(wanted)
    same = abs(answered - wanted) <= _SAME * span
    return Check(f"{name} limit {what}", same, f"drive {answered:.5g}, file {wanted:.5g}")


def moving_checks(plant: RigPlant) -> list[Check]:
    """Move the released blade by 1 mm, turn it by 1 degree; check encoders."""
    checks = [_moved_and_back(plant, name, axis) for name, axis in plant.settings.cross_axes.items()]
    checks.append(_moved_and_back(plant, "blade", None))
    if plant.settings.angle is not None:
        begun = plant.angle
        turn = -_TURN if begun - _TURN > plant.settings.limits.angle_low else _TURN
        plant.travel(plant.position, speed=_NUDGE_SPEED, angle=begun + turn)
        turned = plant.angle - begun
        plant.travel(plant.position, speed=_NUDGE_SPEED, angle=begun)
        found = f"turned {math.degrees(turned):+.2f} of {math.degrees(turn):+.1f} degrees"
        checks.append(Check("hinge", turned / turn > _NUDGE_SHARE, found))
    return checks


def _first_way(plant: RigPlant, name: str) -> float:
    """Return the first way of a straight axis's self-test [m]."""
    return _NUDGE if plant.place(name) + _NUDGE < plant.settings.reaches[name].high else -_NUDGE


def _ask_direction(plant: RigPlant, name: str, axis: CrossAxis, operator: Operator) -> None:
    """Ask whether up is up, or left is left.

    With a wrong ``direction`` the encoder agrees with the commands. Raise RigError if the operator does not agree.
    """
    first, then = axis.to if _first_way(plant, name) > 0.0 else axis.to[::-1]
    if not operator.confirm(f"The blade has moved by {1e3 * _NUDGE:g} mm. Did it go {first} first, and then {then}?"):
        raise RigError(
            f"the operator has not confirmed that the blade went {first} first: nothing is cut. If it went {then}, "
            f"correct {name}.direction = {axis.direction} in the rig's file."
        )


def prove(plant: RigPlant, operator: Operator, today: date) -> None:
    """Prove stop button and force sign once a day.

    The drives are without power before and after. The day is noted beside the rig's file, for later programs of this
    computer, until its drives, sensor or bus change in the file.

    The operator pushes the blade toward the clamp by hand, as tissue would. Then the drives are switched on at rest,
    the operator presses the button, and every drive has to show that it has lost its power. Nothing else moves. Raise
    RigError if the force has the other sign or none, a drive keeps its power, or the operator does not agree.
    """
    if (note := _proof_of(plant.settings, today)) in (plant.proven, _noted(plant.note)):
        return
    _prove_sign(plant, operator)
    operator.tell(
        "The drives are switched on for the proof of the stop button; nothing moves. Keep clear of the blade."
    )
    plant.power()
    if not operator.ask_ready("Press the stop button, and leave it pressed"):
        raise RigError("the operator has not pressed the stop button: without its proof nothing moves.")
    plant.clock.sleep_until(plant.clock.now() + SETTLE)
    states = {name: plant.supervisor.axis(name) for name in plant.settings.axes}
    powered = [name for name, sample in states.items() if sample is None or sample.state is DriveState.ENABLED]
    if powered:
        raise RigError(
            f"with the stop button pressed the {' and the '.join(powered)} drive still has power: nothing moves. Is "
            "the button wired to safe torque off?"
        )
    if not operator.ask_ready("No drive has power. Release the stop button"):
        raise RigError("the operator has not released the stop button.")
    plant.clock.sleep_until(plant.clock.now() + SETTLE)
    plant.supervisor.reset(agreed=True)
    plant.proven = note
    if plant.note is not None:
        with suppress(OSError):  # where it cannot be noted, the next program asks again
            plant.note.write_text(note, encoding="utf-8")


def _proof_of(settings: RigSettings, today: date) -> str:
    """Return a proof's note: day, and hash of what is proven on this computer."""
    proven = platform.node(), settings.name, settings.axes, settings.sensor, settings.bus
    return f"{today.isoformat()} {hashlib.sha256(repr(proven).encode()).hexdigest()[:16]}\n"


def _noted(file: Path | None) -> str:
    """Return the note of the last proof, or ""."""
    try:
        return "" if file is None else file.read_text(encoding="utf-8")
    except (OSError, ValueError):
        return ""


def _prove_sign(plant: RigPlant, operator: Operator) -> None:
    """Check the force's sign as a hand pushes the blade to the clamp."""
    sensor = plant.settings.sensor
    before = plant.supervisor.newest_force
    pushed = operator.ask_ready(
        "The drives are without power. Push the blade's flat end toward the clamp by hand, with the weight of a cup "
        "or so, and press Enter while you push"
    )
    plant.clock.sleep_until(plant.clock.now() + SLICE)
    now, axis = plant.supervisor.newest_force, "xyz".index(sensor.cut_axis)
    if not pushed or before is None or now is None:
        raise RigError("the sign of the force was not proven: nothing moves.")
    against = sensor.sign * (now.force[axis] - before.force[axis])
    if against < _PUSH:
        cure = f"correct sensor.sign = {sensor.sign}" if against <= -_PUSH else "is sensor.cut_axis right"
        raise RigError(
            f"the push toward the clamp reads {against:+.2f} N against the cut, {_PUSH:g} N or more expected: {cure} "
            "in the rig's file?"
        )


def _ask_motion(plant: RigPlant, operator: Operator) -> None:
    """Ask whether the blade has moved away first.

    Neither a drive that counts its steps, nor an encoder knows that. Raise RigError if the operator does not agree.
    """
    sent = "sent the steps for" if plant.spine.counts_steps else "turned by"
    question = f"The drive has {sent} {1e3 * _NUDGE:g} mm away from the clamp, and back. Did the blade move so?"
    if not operator.confirm(question):
        raise RigError(
            "the operator has not seen the blade move as told: nothing is cut. Is the motor's supply on, is the screw "
            "coupled? If it went toward the clamp first, correct blade.direction in the rig's file."
        )


def _moved_and_back(plant: RigPlant, name: str, across: CrossAxis | None) -> Check:
    """Move a released straight axis by a millimetre and back; return the check.

    Near the far, upper or left end of its travel it goes the other way first.
    """
    start, way = plant.place(name), _first_way(plant, name)

    def moved_to(place: float) -> float:
        if across is None:
            plant.travel(place, speed=_NUDGE_SPEED)
        else:
            plant.carry(name, place, speed=_NUDGE_SPEED)
        return plant.place(name) - start

    there, back = moved_to(start + way), moved_to(start)
    well = there / way > _NUDGE_SHARE and abs(back) < (1.0 - _NUDGE_SHARE) * _NUDGE
    to = "" if across is None else f"{across.to[0]} "
    found = f"moved {to}{1e3 * there:+.3f} of {1e3 * way:+.2f} mm, and back to {1e3 * back:+.3f} mm"
    return Check("encoder" if across is None else f"{name} encoder", well, found)


def return_inside(plant: RigPlant) -> None:
    """Return a blade from beyond its travel, at creep speed.

    The operator has agreed to that. Raise RigError, RigStopped if the rig is not ready, or the blade does anything but
    return.
    """
    limits = plant.settings.limits
    plant.supervisor.release(returning=True)
    inside = min(max(plant.position, limits.low + _INSIDE), limits.high - _INSIDE)
    if not limits.low <= plant.position <= limits.high:
        plant.travel(inside, speed=CREEP)
    for name, axis in plant.settings.cross_axes.items():
        (low, high), place = axis.bounds, plant.place(name)
        if not low <= place <= high:
            plant.carry(name, min(max(place, low + _INSIDE), high - _INSIDE), speed=CREEP)


def relieve(plant: RigPlant) -> None:
    """Raise a blade that presses on tissue beyond the limit, at creep speed.

    The operator has agreed to that. Nothing else can be commanded meanwhile, and a force that grows stops it. Raise
    RigError, RigStopped if the rig is not ready, or the force does not fall within some millimetres.
    """
    start = plant.height
    plant.supervisor.release(returning=True)
    while plant.supervisor.relieving:
        if plant.height - start > _RELIEF - _RELIEF_STEP:
            plant.halt()
            raise RigError(f"the blade was raised by {1e3 * _RELIEF:g} mm, and still presses: free it by hand.")
        plant.raise_to(plant.height + _RELIEF_STEP, speed=CREEP)


def prepare(plant: RigPlant, operator: Operator, *, today: date, in_air: bool = True) -> list[Check]:
    """Run all checks before the first motion; release the rig.

    Calibration and ``armed_by``; switching on; tare and self-test at rest; the operator's typed confirmation; for a
    blade beyond an end of its travel, its slow return, if the operator agrees to that too; a millimetre to and fro. On
    a rig with axes across the cut a millimetre up and down, or to the left and right, comes first, and the operator
    confirms that up is up, and left is left. ``plant`` is already open; ``today`` counts for the age of the
    calibration; ``in_air``: True if the blade touches nothing, so that its force can be taken as zero. After a stop it
    may stand in tissue: the old zero is then kept, because a new one would hide the force on the blade. Return all
    checks; each has passed. Raise RigError if a check fails, or the operator does not agree; the drives are then
    without power.
    """
    checks = _passed(may_move(plant.settings, today))
    if in_air and not plant.settings.emulated:
        try:
            prove(plant, operator, today)
        except BaseException:
            plant.switch_off()
            raise
    place = "; it has to be in air" if in_air else ", wherever it stands"
    operator.tell(f"The drives are switched on now; the blade holds still. Keep clear of it{place}.")
    plant.power()
    try:
        plant.clock.sleep_until(plant.clock.now() + SETTLE)
        if in_air:
            plant.tare()
            plant.clock.sleep_until(plant.clock.now() + SETTLE)
        checks += _passed(still_checks(plant, in_air=in_air))
        if not operator.confirm(_question(plant, in_air), expected=plant.settings.name):
            raise RigError("the operator has not confirmed: nothing moves.")
        if (beyond := plant.supervisor.beyond) is not None:
            way = f"The {beyond}. May it creep back inside at {1e3 * CREEP:g} mm/s, and is its way clear?"
            if not operator.confirm(way):
                raise RigError(f"{beyond}, and the operator has not agreed to its return: nothing moves.")
            return_inside(plant)
        if (pressed := plant.supervisor.pressed) is not None:
            if not operator.confirm(
                f"It seems that {pressed}. May it be raised at {1e3 * CREEP:g} mm/s until it is free?"
            ):
                raise RigError(f"{pressed}, and the operator has not agreed that it is raised: nothing moves.")
            relieve(plant)
        plant.supervisor.release()
        checks += _passed(moving_checks(plant))
        if plant.spine.counts_steps or (in_air and not plant.settings.emulated):
            _ask_motion(plant, operator)
        for name, axis in plant.settings.cross_axes.items() if in_air else ():
            _ask_direction(plant, name, axis, operator)
    except BaseException as error:
        plant.halt()
        try:
            plant.switch_off()
        except RigError as worse:  # report the first error
            error.add_note(f"Besides: {worse}")
        raise
    return checks


def _question(plant: RigPlant, in_air: bool) -> str:
    """Return the question whether tare and a drive's zero are right."""
    sample = plant.supervisor.newest_force
    if in_air:
        felt = f", and in air the sensor reads {_newtons(plant.zero)}, taken as zero. Is that so, is the blade free"
    elif sample is not None:
        felt = f", and the sensor reads {_newtons(sample.force)} relative to its zero in air. May it move"
    else:
        felt = ". May it move"
    where = f"According to its drive it stands {1e3 * plant.position:.1f} mm from the clamp"
    moves = []
    if (axis := plant.settings.height) is not None:
        where += f", at a height of {1e3 * plant.height:+.1f} mm"
        moves.append(f"up and down by 1 mm, and up to {1e3 * axis.raised:g} mm before it returns")
    if plant.settings.side is not None:
        where += f", {1e3 * plant.place('side'):+.1f} mm to the left of the middle"
        moves.append("to the left and right by 1 mm")
    motion = f"will move{': ' if moves else ''}{'; '.join(moves)}"
    return f"The blade of {plant.settings.name} {motion}. {where}{felt}, and is the stop button within reach?"


def _newtons(force: tuple[float, float, float]) -> str:
    return "({:.1f}, {:.1f}, {:.1f}) N".format(*force)


def _passed(checks: list[Check]) -> list[Check]:
    failed = [f"{check.name}: {check.found}" for check in checks if not check.passed]
    if failed:
        raise RigError(f"the rig may not move. {'; '.join(failed)}.")
    return checks


LISTEN = 2.0  # time for which readings, samples and heartbeats are observed [s]
_SAME_RATE = 0.02  # relative difference allowed between measured and set rate
_LOST = 0.1  # share of the loss limit at which this check fails
_ZERO = "zero_set"  # report of a drive whose zero a person sets
_PER = {"low": "", "high": "", "speed": "_s", "acceleration": "_s2", "quick_stop": "_s2"}


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Result of an inspection."""

    checks: tuple[Check, ...]  # checks, in order
    devices: dict[str, dict[str, Any]]  # data that each device reports, and measurements of it; units are in the names

    @property
    def passed(self) -> bool:
        """True if every check has passed."""
        return all(check.passed for check in self.checks)


def inspect(plant: RigPlant, today: date) -> Inspection:
    """Inspect an open rig for some seconds.

    Nothing moves, and no drive is powered.

    The sensor is tared, until the connection ends: nothing may touch the blade. Raise RigError if a drive no longer
    answers.
    """
    checks = may_move(plant.settings, today)
    try:
        x, y, z = plant.tare()
        checks.append(Check("steady force", True, f"zero taken at ({x:.2f}, {y:.2f}, {z:.2f}) N"))
    except RigError as error:
        checks.append(Check("steady force", False, f"{error}"))
    recorder = Recorder("xyz".index(plant.settings.sensor.cut_axis))
    start = plant.clock.now()
    plant.witness = recorder
    try:
        plant.clock.sleep_until(start + LISTEN)
    finally:
        plant.witness = None
    checks += still_checks(plant)
    devices: dict[str, dict[str, Any]] = {name: dict(about) for name, about in plant.spine.about().items()}
    checks += [
        Check(f"{name} zero", about[_ZERO] == "yes", "set by hand" if about[_ZERO] == "yes" else str(about[_ZERO]))
        for name, about in devices.items()
        if _ZERO in about
    ]
    for name, limits in plant.spine.drive_limits().items():
        unit = "rad" if name == "angle" else "m"
        devices[name] |= {f"limit_{what}_{unit}{_PER[what]}": value for what, value in limits.items()}
    end = start + LISTEN
    found = [_forces(plant.settings, recorder, start, end, plant.spine.rate_error)]
    found += [_motion(plant, name, recorder, start, end) for name in devices if name != "sensor"]
    for name, more, about in found:
        checks += more
        devices[name] |= about
    return Inspection(checks=tuple(checks), devices=devices)


_Found = tuple[str, list[Check], dict[str, Any]]


def _check(name: str, passed: bool, found: str, cure: str) -> Check:
    return Check(name, bool(passed), found if passed else f"{found}; {cure}")


def _forces(settings: RigSettings, recorder: Recorder, start: float, end: float, rate_error: float) -> _Found:
    readings, limits = recorder.forces(start, end), settings.limits
    if len(readings) < 2:
        cure = "switch the sensor on, and close other programs that read it"
        return "sensor", [_check("force rate", False, "no readings", cure)], {}
    times = np.array([each.time for each in readings])
    lost = sum(each.lost for each in readings[1:])
    sent = (len(readings) - 1 + lost) / (times[-1] - times[0])
    share, gap = lost / (lost + len(readings)), float(np.diff(times).max())
    noise = np.std([each.force for each in readings], axis=0)
    checks = [
        _check(
            "force rate",
            abs(sent / settings.sensor.rate - 1.0) <= max(_SAME_RATE, rate_error),
            f"{sent:.0f} packets a second, file {settings.sensor.rate:g}",
            "set the rate in the sensor, or sensor.rate_Hz in the file",
        ),
        _check(
            "force packets lost",
            share <= _LOST * limits.lost_force,
            f"{lost} of {lost + len(readings)}",
            "give the sensor a cable and a network port of its own",
        ),
        _check(
            "force packets late",
            gap <= limits.stale_force,
            f"longest gap {1e3 * gap:.1f} ms, the blade stops at {1e3 * limits.stale_force:g} ms",
            "close other programs, or give this one real-time priority",
        ),
        _check(
            "force changes",
            len({each.counts for each in readings}) > 1,
            f"SD ({', '.join(f'{sd:.4f}' for sd in noise)}) N in x, y, z",
            "readings that never change are not real: switch the sensor off and on",
        ),
    ]
    measured = {"measured_rate_Hz": float(sent), "lost_share": share, "longest_gap_ms": 1e3 * gap}
    return "sensor", checks, measured | {f"noise_{axis}_N": float(sd) for axis, sd in zip("xyz", noise, strict=True)}


def _motion(plant: RigPlant, name: str, recorder: Recorder, start: float, end: float) -> _Found:
    settings, sample = plant.settings, plant.supervisor.axis(name)
    times = recorder.motion_times(name, start, end)
    beats = recorder.heartbeats(name, start, end)
    checks, about = [], {}
    if sample is not None:
        well = sample.state is not DriveState.FAULT
        cure = "remove the cause and switch the drive off and on; a stop is cleared by the operator"
        checks.append(_check(f"{name} drive", well, f'"{sample.state.value}"', cure))
        about["position_deg" if name == "angle" else "position_mm"] = (
            float(np.degrees(sample.position)) if name == "angle" else 1e3 * sample.position
        )
    for what, moments, limit, cure in (
        ("samples", times, settings.limits.stale_motion, "does another master send SYNC, is this computer busy?"),
        ("heartbeat", beats, settings.limits.heartbeat, "is the bus disturbed or overloaded, is this computer busy?"),
    ):
        if len(moments) < 2:
            checks.append(_check(f"{name} {what}", False, f"{len(moments)} in {LISTEN:g} s", cure))
            continue
        period, gap = float(np.median(np.diff(moments))), float(np.diff(moments).max())
        found = f"every {1e3 * period:.1f} ms, longest gap {1e3 * gap:.1f} ms, the blade stops at {1e3 * limit:g} ms"
        checks.append(_check(f"{name} {what}", gap <= limit, found, cure))
        about[f"{what}_period_ms"] = 1e3 * period
    return name, checks, about


CAMERA_RATE = 14.0  # least rate of measured frames [Hz]: 15 a second, less what counting for so short a time may miss
_STARTING = 20.0  # time for the camera's process to measure the first frame [s]
_STEP = 0.05  # [s]


def inspect_camera(settings: CameraSettings) -> Inspection:
    """Start the camera, count its frames for some seconds, end it."""
    camera, deadline = RigCamera(settings), time.monotonic() + _STARTING
    try:
        while not camera.moments and not camera.ended and time.monotonic() < deadline:
            time.sleep(_STEP)
        time.sleep(LISTEN)
        times, ended = list(camera.moments), camera.ended
    finally:
        camera.close()
    if ended or len(times) < 2:
        found = (
            f"{ended or 'no frames'}; is it plugged in and free, are source and calibration right, and is "
            "cutenv[vision] installed?"
        )
        return Inspection(checks=(Check("camera", False, found),), devices={})
    rate = (len(times) - 1) / (times[-1] - times[0])
    found = f"{rate:.1f} frames a second are measured, {CAMERA_RATE:g} needed"
    if rate < CAMERA_RATE:
        found += "; take a smaller image, or a faster computer"
    return Inspection(
        checks=(Check("camera", rate >= CAMERA_RATE, found),), devices={"camera": {"measured_rate_Hz": rate}}
    )
