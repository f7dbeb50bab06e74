"""Which rig an environment cuts on: hardware by its file, an emulator of its own, or a fake in memory."""

from __future__ import annotations

import dataclasses
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import cutenv
from cutenv.cutting.drive import Rig
from cutenv.cutting.records import Records
from cutenv.envs.constants import Constants
from cutenv.plant.protocol import depth_along
from cutenv.recording.appending import AppendingRecord, RecordingFailed
from cutenv.recording.provenance import Provenance
from cutenv.rig.causes import Cause
from cutenv.rig.drivers import RigError
from cutenv.rig.emulator.bench import Laid
from cutenv.rig.fake import CutBench, FakeRig, fake_settings
from cutenv.rig.hardware import rig_plant
from cutenv.rig.operator import AutomaticOperator, Operator, TerminalOperator
from cutenv.rig.plant import RigPlant
from cutenv.rig.session import RigSession
from cutenv.rig.settings import RigSettings
from cutenv.rig.supply import HandSupply, SpecimenKey
from cutenv.rig.toml_file import read
from cutenv.tissue.description import load_description, measured_liver
from cutenv.tissue.specimen import Specimen
from cutenv.trace import Reading

if TYPE_CHECKING:
    from cutenv.rig.emulator.control import EmulatorControl

FAKE, EMULATOR = "fake", "emulator"


class FakeSupply:
    """Lays drawn specimens on a fake rig."""

    def __init__(self, rig: FakeRig, constants: Constants) -> None:
        self._rig, self._constants = rig, constants

    def lay(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Lay it; its depth is known to the one who has drawn it."""
        specimen, constants = key.specimen, self._constants
        if specimen is None:
            raise RigError("a fake rig cuts drawn specimens only.")
        drive = constants.drive
        self._rig.lay(
            lambda settings: CutBench(
                specimen,
                settings,
                drive=drive if isinstance(drive, Rig) else None,
                sensor=constants.sensor,
                law=constants.law,
                seed=key.seed,
                episode=key.episode,
            )
        )
        return None


class EmulatorSupply:
    """Has an emulated rig lay the specimens that are drawn here, which it draws itself from the same key."""

    def __init__(self, control: EmulatorControl, specimen_class: str, tissue: Path | None) -> None:
        self._control, self._class, self._tissue = control, specimen_class, tissue

    def lay(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Lay it; its depth is known to the one who has drawn it.

        Raises
        ------
        RigError
            If the specimen is another one than the emulator draws.
        """
        laid = Laid(
            seed=key.seed,
            episode=key.episode,
            specimen_class=self._class,
            tissue=None if self._tissue is None else load_description(self._tissue),
        )
        if key.specimen is None or key.specimen.to_json() != laid.drawn().to_json():
            raise RigError('an emulated rig draws its specimens itself: give seed and episode, or rig="fake".')
        self._control.specimen(seed=key.seed, episode=key.episode, specimen_class=self._class, tissue=self._tissue)
        return None


_OPTIONS_OF_EMULATOR = {
    "motor_lag": ("--lag-ms", 1e3),
    "dead_time": ("--dead-time-ms", 1e3),
    "backlash": ("--backlash-mm", 1e3),
    "force_delay": ("--force-delay-ms", 1e3),
    "force_noise": ("--force-noise-N", 1.0),
}


def emulator_options(constants: Constants) -> list[str]:
    """Options of ``cutenv rig emulate`` for the constants of drive and sensor that are not the default.

    Raises
    ------
    ValueError
        If the emulator has no option for one of them.
    """
    plain = Constants()
    options = []
    for own, default in ((constants.drive, plain.drive), (constants.sensor, plain.sensor), (constants.law, plain.law)):
        for field in dataclasses.fields(own):
            value = getattr(own, field.name)
            if value == getattr(default, field.name):
                continue
            if field.name not in _OPTIONS_OF_EMULATOR:
                known = ", ".join(_OPTIONS_OF_EMULATOR)
                raise ValueError(f'{field.name}: an emulated rig has no such option, but {known}; or take rig="fake".')
            option, scale = _OPTIONS_OF_EMULATOR[field.name]
            options += [option, f"{scale * value:.9g}"]
    return options


class RigSource:
    """The rig that an environment's argument names, and the records of its cuts.

    Parameters
    ----------
    rig : str or Path
        "fake", "emulator", or a TOML file.
    constants : Constants
        Of an emulated or fake rig's drive and sensor.
    specimen_class : str
        Of the specimens that an emulated rig draws.
    tissue : Path, optional
        Description that it draws them from; default pig liver.
    operator : Operator, optional
        Asked before anything moves.  Default: a person at the terminal, nobody for an emulated or fake rig.
    records : str or Path, optional
        Folder for the records of cuts.

    Attributes
    ----------
    settings : RigSettings
        Of the rig.
    draws : bool
        Whether specimens are drawn by program, not laid by hand.

    Raises
    ------
    FileNotFoundError, ValueError
        If the file is missing or says what cannot be.
    """

    def __init__(
        self,
        rig: str | Path,
        constants: Constants,
        *,
        specimen_class: str = "mixed",
        tissue: Path | None = None,
        operator: Operator | None = None,
        records: str | Path | None = None,
    ) -> None:
        self._rig, self._constants, self._operator = str(rig), constants, operator
        self.draws = self._rig in (FAKE, EMULATOR)
        self.settings: RigSettings = fake_settings(name=self._rig) if self.draws else read(rig)
        self._class, self._tissue = specimen_class, tissue
        self._emulator_options = emulator_options(constants) if self._rig == EMULATOR else []
        self._folder = None if records is None else Path(records)
        self._record: AppendingRecord | None = None
        self.records: list[Path] = []
        """Of finished cuts."""

    def session(self) -> RigSession:
        """Make the rig; it is connected to at its first cut."""
        if self._rig == FAKE:
            fake = FakeRig(_practice_bench, self.settings)
            operator = self._operator or AutomaticOperator(self.settings)
            return RigSession(fake.plant, operator, FakeSupply(fake, self._constants))
        if self._rig == EMULATOR:
            return self._emulated()
        operator = self._operator or TerminalOperator()
        return RigSession(rig_plant(self.settings), operator, HandSupply(self.settings, operator))

    def _emulated(self) -> RigSession:
        """A session with an emulated rig that is started now, and ended with it."""
        from cutenv.rig.emulator.process import start

        emulator = start(arguments=self._emulator_options)
        try:
            settings = emulator.settings
            supply = EmulatorSupply(emulator.control, self._class, self._tissue)
            operator = self._operator or AutomaticOperator(settings)
            return RigSession(rig_plant(settings), operator, supply, release=emulator.close)
        except BaseException:
            emulator.close()
            raise

    def begin_record(self, plant: RigPlant, *, seed: int, episode: int, **metadata: Any) -> None:
        """Begin the record of a cut, if records are kept; a disk that takes no more stops the blade."""
        if self._folder is None:
            return
        self._folder.mkdir(parents=True, exist_ok=True)
        date, settings = datetime.now(), self.settings
        name = f"{date:%Y%m%dT%H%M%S}_{settings.name}_{seed}-{episode}"
        origin = Provenance(
            rig=settings.name,
            sensor=f"Net F/T at {settings.sensor.address}" if not self.draws else f"of the {self._rig}",
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
                **metadata,
            },
        )
        self._record = record

        def keep(readings: Records) -> None:
            depth = depth_along(plant, readings["position"])
            columns = [readings[field].tolist() for field in ("time", "force", "position", "speed", "angle")]
            try:
                record.append(map(Reading._make, zip(*columns, depth.tolist(), strict=True)))
            except RecordingFailed as error:
                plant.supervisor.trip(Cause.EXCEPTION, f"the record cannot be kept: {error}")

        plant.keep = keep

    def end_record(self, plant: RigPlant, **metadata: Any) -> None:
        """Finish the record of a cut, if one is being kept."""
        plant.keep = _forget
        if self._record is not None:
            self._record.close({**metadata, "overruns": plant.timing.overruns})
            self.records.append(self._record.path)
            self._record = None


def _forget(readings: Records) -> None:
    """Keep no record."""


def _practice_bench(settings: RigSettings) -> CutBench:
    """What lies on a fake rig before the first specimen: mean tissue, 2 cm deep."""
    tissue = measured_liver()
    mean = Specimen.homogeneous(
        modulus=tissue.intercept_90, fracture_resistance=tissue.fracture_resistance, depth=0.02, tissue=tissue
    )
    return CutBench(mean, settings)
