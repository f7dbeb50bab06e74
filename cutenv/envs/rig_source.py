"""Source of an environment's rig: a file, an emulator, a fake in memory."""

from __future__ import annotations

import dataclasses
import functools
import importlib
import itertools
import re
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import cutenv
from cutenv._base.arrays import StructArray
from cutenv._base.imports import extra_named
from cutenv._base.unit_table import NAMED_UNITS
from cutenv.drivers.rig_names import settings_of
from cutenv.envs.constants import Constants
from cutenv.records.appending import AppendingRecord, CutListener, RecordingFailed
from cutenv.records.provenance import Provenance
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import (
    EMULATED,
    EMULATOR,
    FAKE,
    RIG_NAMES,
    PositionControl,
    RigSettings,
    SensorCalibration,
    across,
    fake_settings,
)
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices.camera import CAMERA_NOTE, RigCamera
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator, Operator, operator_of
from cutenv.rig.operation.session import RigSession, SpecimenKey, SpecimensByHand, recorded_channels, recorded_rows
from cutenv.rig.plant import RigPlant, rig_plant
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import read_rig_file
from cutenv.sim.cutting.drive import PDRig, Rig
from cutenv.sim.tissue.grid import depth_below

if TYPE_CHECKING:
    from cutenv.emulation.control_port import EmulatorControl
    from cutenv.emulation.fake_benches import AirPlant
    from cutenv.emulation.fake_rig import FakeRig
    from cutenv.emulation.process import RunningEmulator
    from cutenv.sim.tissue.layers import Layers
    from cutenv.sim.tissue.lines import CutLine


class FakeSpecimens:
    """Supply that lays drawn specimens on a fake rig.

    They have the ``layers``, or lie along the ``line``, set last.
    """

    def __init__(self, rig: FakeRig, constants: Constants) -> None:
        self._rig, self._constants = rig, constants
        self.layers: Layers | None = None
        self.line: CutLine | None = None

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Mount a specimen; return None, as its depth is known."""
        from cutenv.emulation.fake_benches import SpecimenPlant, SteeredBench

        constants, drive = self._constants, self._constants.drive
        if key.specimen is None:
            raise RigError("a fake rig cuts drawn specimens only.")
        mounted = MountedSpecimen(
            specimen=key.specimen, seed=key.seed, episode=key.episode, layers=self.layers, line=self.line
        )
        self._rig.mount(
            functools.partial(
                SpecimenPlant if mounted.line is None else SteeredBench,
                mounted,
                drive=drive if drive != Rig() else None,  # None: the rig's own
                sensor=constants.sensor,
                law=constants.law,
            )
        )
        return None

    def take_away(self) -> None:
        """Remove the specimen."""
        self._rig.take_away()


class EmulatedSpecimens:
    """Supply that lays drawn specimens on an emulated rig.

    They have the ``layers``, or lie along the ``line``, set last.
    """

    def __init__(self, control: EmulatorControl) -> None:
        self._control = control
        self.layers: Layers | None = None
        self.line: CutLine | None = None

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Mount a specimen; return None, as its depth is known."""
        if key.specimen is None:
            raise RigError("an emulated rig cuts drawn specimens only.")
        self._control.mount(key.specimen, seed=key.seed, episode=key.episode, layers=self.layers, line=self.line)
        return None

    def take_away(self) -> None:
        """Remove the specimen."""
        self._control.free_air()


_OPTIONS = {
    "motor_lag": ("--lag-ms", "ms"),
    "dead_time": ("--dead-time-ms", "ms"),
    "backlash": ("--backlash-mm", "mm"),
    "proportional_gain": ("--proportional-gain-N-per-m", "N_per_m"),
    "derivative_gain": ("--derivative-gain-Ns-per-m", "Ns_per_m"),
    "moved_mass": ("--moved-mass-kg", "kg"),
    "drag": ("--drag-Ns-per-m", "Ns_per_m"),
    "force_delay": ("--force-delay-ms", "ms"),
    "force_noise": ("--force-noise-N", "N"),
    "force_resolution": ("--force-resolution-N", "N"),
    "force_drift": ("--force-drift-N", "N"),
    "debt_length": ("--debt-length-mm", "mm"),
    "friction_per_depth_speed": ("--blade-friction-Ns-m2", "Ns_m2"),
}
"""Options of ``cutenv rig emulate`` by constant, with the name of the unit."""
_OF_PD_CONTROL = dataclasses.fields(PositionControl)
_AS_BUILT = {"backlash"}  # of the emulated screw by default: the simulator's default of 0 is not that of a real screw


def emulator_arguments(constants: Constants) -> list[str]:
    """Return ``cutenv rig emulate`` options of constants; ValueError if one has none."""
    changed, arguments = changed_constants(constants), []
    for own in (constants.drive, constants.sensor, constants.law):
        for name in (field.name for field in dataclasses.fields(own)):
            if name in _OPTIONS and (name in changed or name not in _AS_BUILT):
                option, unit = _OPTIONS[name]
                arguments += [option, f"{NAMED_UNITS[unit].from_si(getattr(own, name)):.6g}"]
            elif name in changed:
                raise ValueError(
                    f'{name}: an emulated rig has no such option, only {", ".join(_OPTIONS)}; rig="fake" has.'
                )
    return arguments


def changed_constants(constants: Constants) -> list[str]:
    """Return names of drive, sensor and law constants with non-default values."""
    plain = Constants()
    return [
        field.name
        for part in ("drive", "sensor", "law")
        for field in dataclasses.fields(getattr(constants, part))
        if getattr(getattr(constants, part), field.name) != getattr(getattr(plain, part), field.name, None)
    ]


class RigSource:
    """Rig named by an environment's argument, with its cut records.

    Without ``operator`` a person at the terminal is asked before anything moves, and none for an emulated or fake rig.
    ``needs_axis`` is the axis across the cut that is needed, "height" or "side", and ``by`` what needs it: an emulated
    or fake rig then has one, and a file without its section is refused.  With ``dry_run`` a fake has the rig's
    settings. ``draws`` is True if specimens are drawn by program, not mounted by hand.

    ValueError or FileNotFoundError if the file is missing or not valid.
    """

    def __init__(
        self,
        rig: str | Path,
        constants: Constants,
        *,
        operator: Operator | None = None,
        records: str | Path | None = None,
        lower_limits: dict[str, float] | None = None,
        dry_run: bool = False,
        needs_axis: str = "",
        by: str = "",
    ) -> None:
        self._rig, self._constants, self._operator = str(rig), constants, operator
        self._lower = dict(lower_limits or {})
        named = self._rig in RIG_NAMES
        control = None
        if isinstance(constants.drive, PDRig):
            control = PositionControl(**{key.name: getattr(constants.drive, key.name) for key in _OF_PD_CONTROL})
            if self._rig not in (FAKE, EMULATOR):
                raise ValueError(
                    f'drive = "pd" is for rig="{EMULATOR}" and rig="{FAKE}"; the file of a rig, here {self._rig}, has '
                    "the section [position_control] instead."
                )
        own = (
            settings_of(self._rig)
            if self._rig in RIG_NAMES and self._rig not in (FAKE, EMULATOR)
            else fake_settings(name=self._rig, position_control=control, **across(needs_axis))
        )
        self.settings = self._lowered(own if named else read_rig_file(rig))
        if needs_axis == "height":
            self.settings.require_height_axis(by=by)
        elif needs_axis == "side":
            self.settings.require_side_axis(by=by)
        if dry_run:
            from cutenv.emulation.fake_rig import FakeSensor

            self._rig = FAKE
            self.settings = dataclasses.replace(
                self.settings,
                emulated=True,
                armed_by="nobody: a dry run",
                calibration=SensorCalibration(date=datetime.now().date().isoformat()),
                sensor=dataclasses.replace(self.settings.sensor, rate=FakeSensor.rate),
            )
        if self._rig in EMULATED:
            with extra_named("rig"):  # fails now, not amid a session, for lack of a package
                importlib.import_module("cutenv.emulation.process")
        self.draws = self._rig in RIG_NAMES
        self._emulated = emulator_arguments(constants) if self._rig == EMULATOR else []
        if self._rig in EMULATED and self._rig != EMULATOR and (changed := changed_constants(constants)):
            raise ValueError(
                f'{changed[0]}: an emulated {self._rig} rig is as it is. Leave it out, or take rig="fake".'
            )
        self.supply: FakeSpecimens | EmulatedSpecimens | None = None
        """Supply of drawn specimens, once there is a session; its ``layers`` and ``line`` are for the next one laid."""
        self.fake: FakeRig | None = None  # fake rig in use, if there is one
        self._folder = None if records is None else Path(records)
        self.emulator: RunningEmulator | None = None  # running emulator, if there is one
        self._record: AppendingRecord | None = None
        self._camera: RigCamera | None = None
        self.records: list[Path] = []  # files of the finished cuts
        self.listener: CutListener | None = None  # listener to the cuts as they go on, if there is one

    def session(self) -> RigSession:
        """Make the rig's session, which connects at its first cut."""
        if self._rig == FAKE:
            from cutenv.emulation.fake_rig import FakeRig

            self.fake = fake = FakeRig(_at_clamp, self.settings)
            operator = self._operator or AutomaticOperator(self.settings)
            self.supply = FakeSpecimens(fake, self._constants)
            return RigSession(fake.plant, operator, self.supply)
        if self._rig in EMULATED:
            from cutenv.emulation.process import start

            emulator = start(
                free_air=True, across=tuple(self.settings.cross_axes), kind=self._rig,
                arguments=self._emulated,
            )  # fmt: skip
            self.emulator, self.settings = emulator, self._lowered(emulator.settings)
            operator = self._operator or AutomaticOperator(self.settings)
            self.supply = EmulatedSpecimens(emulator.control)
            return RigSession(rig_plant(self.settings), operator, self.supply, release=emulator.close)
        operator = self._operator or operator_of(self.settings)
        if self.settings.camera is not None:
            self._camera = RigCamera(self.settings.camera)
        plant = rig_plant(self.settings, file=self._rig)
        return RigSession(plant, operator, SpecimensByHand(lambda: read_rig_file(self._rig), operator, plant.lower))

    def _lowered(self, settings: RigSettings) -> RigSettings:
        settings = dataclasses.replace(settings, limits=settings.limits.lowered(**self._lower))
        refuse_contradictions(settings)
        return settings

    def begin_record(self, plant: RigPlant, *, seed: int, episode: int, **metadata: Any) -> None:
        """Begin any record of a cut; failed writing stops the blade."""
        if (listener := self.listener) is not None:
            listener.began(f"seed {seed} episode {episode}")
            plant.keep = lambda readings: listener.readings(
                readings, depth_below(plant.depth, readings["position"]), plant.began
            )
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        date, settings = datetime.now(), self.settings
        axis = settings.height
        rig = re.sub(r"[^\w.-]+", "_", settings.name)
        first = f"{date:%Y%m%dT%H%M%S}_{rig}_{seed}-{episode}"
        # On a fake rig a specimen may be cut twice in a second, by two policies.
        names = itertools.chain((first,), (f"{first}_{number}" for number in itertools.count(2)))
        name = next(each for each in names if not (self._folder / f"{each}.csv").exists())
        origin = Provenance(
            rig=settings.name,
            sensor=_sensor_name(settings) if not self.draws else f"of the {self._rig}",
            date=date.isoformat(timespec="seconds"),
            calibration={"date": settings.calibration.date, "gain": settings.calibration.gain},
        )
        record = AppendingRecord(
            self._folder / f"{name}.csv",
            {
                **origin.metadata,
                "name": name,
                "program": f"cutenv {cutenv.__version__}",
                "specimen_seed": seed,
                "specimen_episode": episode,
                "zero_N": list(plant.zero),
                "limits": {
                    "hash": plant.supervisor.limits.fingerprint,
                    "blind_way_mm": round(1e3 * plant.supervisor.limits.blind_way, 3),
                },
                **({} if axis is None else {"vertical_axis": "-" * (axis.force_sign < 0) + axis.force_axis}),
                **metadata,
            },
            channels=recorded_channels(settings),
        )
        self._record = record
        heard = plant.keep

        def keep(readings: StructArray) -> None:
            try:
                record.append(*recorded_rows(plant, readings))
            except (RecordingFailed, TypeError, ValueError) as error:  # full disk, or invalid values
                plant.supervisor.trip(Cause.EXCEPTION, f"the record cannot be kept: {error}")
            heard(readings)

        plant.keep = keep
        if self._camera is not None:
            self._camera.begin()

    def end_record(self, plant: RigPlant, **metadata: Any) -> None:
        """Finish the record of a cut, if one is being written."""
        if self.listener is not None and plant.keep is not _forget:
            stop = metadata.get("stop")
            self.listener.ended(str(metadata.get("end", "")) + (f": {stop['cause']}" if stop else ""))
        plant.keep = _forget
        record, self._record = self._record, None  # only once, if another thread closes the rig meanwhile
        if record is not None:
            told = (
                {} if self._camera is None else {CAMERA_NOTE: "its process did not answer: the depth is the profile's"}
            )
            record.close({**metadata, "overruns": plant.timing.overruns, **told})
            self.records.append(record.path)
            if self._camera is not None:
                self._camera.put_depth(record.path)

    def close_camera(self) -> None:
        """End the camera, if there is one."""
        camera, self._camera = self._camera, None
        if camera is not None:
            camera.close()


def _sensor_name(settings: RigSettings) -> str:
    sensor = settings.sensor
    return f"Net F/T at {sensor.address}" if sensor.driver == "netft" else f"by the driver {sensor.driver}"


def _forget(readings: StructArray) -> None:
    """Discard the readings."""


def _at_clamp(settings: RigSettings) -> AirPlant:
    """Return a fake rig's bench before a specimen is mounted."""
    from cutenv.emulation.fake_benches import AirPlant

    return AirPlant(settings, start=0.0)
