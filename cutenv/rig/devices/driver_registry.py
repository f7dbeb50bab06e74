"""Registry of drivers.

It finds what ``driver = "..."`` in a rig's file names, in this package, in another, or by its class.

A driver is a class, or a function, that is called with a :class:`Mounting` and returns a
:class:`~cutenv.rig.devices.protocols.MotionDriver`, a :class:`~cutenv.rig.devices.protocols.ForceDriver` or a
:class:`cutenv.vision.film_source.CameraDriver`. :func:`rig_driver` declares what it takes from the file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple, TypeVar

from cutenv._base.imports import import_from_here
from cutenv._base.validation import one_of
from cutenv.rig.config.file_schema import FileKey, keys_of
from cutenv.rig.config.settings import Axis, CameraSettings, RigSettings, SensorSettings
from cutenv.rig.devices.loop import Clock

Made = TypeVar("Made", bound=Callable[..., Any])
Shared = TypeVar("Shared")


class DriverKind(StrEnum):
    """Kind of a driver.

    Packages register theirs as an entry point of the group.
    """

    MOTION = "motion"
    FORCE = "force"
    CAMERA = "camera"

    @property
    def group(self) -> str:
        """Group of entry points, such as ``cutenv.motion_drivers``."""
        return f"cutenv.{self}_drivers"


KIND_OF_ROLE = {
    "blade": DriverKind.MOTION,
    "angle": DriverKind.MOTION,
    "height": DriverKind.MOTION,
    "side": DriverKind.MOTION,
    "sensor": DriverKind.FORCE,
    "camera": DriverKind.CAMERA,
}
"""Kind of driver that each section of a rig's file takes."""

OPTIONS = "options"  # name of the table of a driver's own keys, as in ``[blade.options]``
SHIPPED_DRIVERS: Mapping[DriverKind, Mapping[str, str]] = {
    DriverKind.MOTION: {
        "canopen": "cutenv.rig.devices.standard_drivers:mounted_axis",
        "serial": "cutenv.rig.devices.serial.board_drivers:StepperAxis",
        "grbl": "cutenv.drivers.grbl_axis:GrblAxis",
    },
    DriverKind.FORCE: {
        "analogue": "cutenv.drivers.analogue_sensor:AnalogueSensor",
        "bota": "cutenv.drivers.bota_sensor:bota_sensor",
        "netft": "cutenv.rig.devices.standard_drivers:mounted_sensor",
        "robotiq": "cutenv.drivers.robotiq_sensor:robotiq_sensor",
        "serial": "cutenv.rig.devices.serial.board_drivers:LoadCell",
    },
    DriverKind.CAMERA: {"opencv": "cutenv.vision.film_source:mounted_camera"},
}
"""Drivers of this package by name, each as ``module:attribute``; loaded when they are asked for."""

SHIPPED_KEYS: Mapping[str, frozenset[str]] = {
    "canopen": frozenset(
        [f"bus.{key}" for key in ("interface", "channel", "bitrate", "host", "port", "node", "heartbeat")]
        + [
            f"{axis}.{key}"
            for axis in ("blade", "angle", "height", "side")
            for key in ("node", "gear", "pulses", "following_error", "current_limit", "rated_torque")
        ]
    ),
    "netft": frozenset(("sensor.address", "sensor.port", "sensor.page")),
    "opencv": frozenset(("camera.source",)),
}
"""Keys of the common sections that only this driver, or another that declares its need of them, reads."""

CONDITIONAL = frozenset().union(*SHIPPED_KEYS.values()) | {
    f"{axis}.lead" for axis in ("blade", "angle", "height", "side")
}
"""Keys that a person has to supply only for a driver that needs them."""


@dataclass(frozen=True, kw_only=True)
class Mounting:
    """Place of a driver on a rig.

    All that it is made from.

    Attributes
    ----------
    role : str
        Section of the rig's file: "blade", "angle", "height", "side", "sensor" or "camera".
    rig : RigSettings
        All settings of the rig, in SI.
    clock : Clock
        Clock that paces and dates everything.
    shared : dict
        Objects that several drivers of the rig share, by a key of theirs.
    """

    role: str
    rig: RigSettings
    clock: Clock
    shared: dict[Any, Any] = field(default_factory=dict)

    @property
    def settings(self) -> Any:
        """Settings of the section: an ``Axis``, ``SensorSettings`` or ``CameraSettings``."""
        return getattr(self.rig, self.role)

    @property
    def options(self) -> Any:
        """The driver's options, of its declared class, or None."""
        return self.settings.options

    def share(self, key: Any, make: Callable[[], Shared]) -> Shared:
        """Return the port, bus or board made under ``key``, or make it."""
        if key not in self.shared:
            self.shared[key] = make()
        made: Shared = self.shared[key]
        return made


@dataclass(frozen=True, kw_only=True)
class DriverTraits:
    """Declaration of a driver's keys in the rig's file.

    It also tells whether what the driver reaches is real.

    Attributes
    ----------
    options : type or None
        Frozen dataclass of its options, each field a :func:`cutenv.rig.config.settings.setting`; they stand in the
        file's table ``[blade.options]``, ``[sensor.options]`` and so on. None: it has none.
    needs : tuple of str
        Names of fields of the section that a person has to supply, such as "lead"; "bus.interface" of another section.
    check : callable
        Called with the settings of the rig and the role before anything is connected; raises ValueError, with names,
        values and cure, for what cannot be.
    emulated : callable
        Called likewise; returns True if what the driver reaches is an emulator on this computer, which needs nobody's
        consent to move.
    patience : float
        Of an axis: time for which it may go on after the computer has fallen silent [s]; nan: not stated.
    """

    options: type[Any] | None = None
    needs: tuple[str, ...] = ()
    check: Callable[[RigSettings, str], None] = lambda rig, role: None
    emulated: Callable[[RigSettings, str], bool] = lambda rig, role: False
    patience: float = math.nan


_NO_TRAITS = DriverTraits()
_TRAITS = "__rig_driver__"


def rig_driver(
    *,
    options: type[Any] | None = None,
    needs: tuple[str, ...] = (),
    check: Callable[[RigSettings, str], None] = _NO_TRAITS.check,
    emulated: Callable[[RigSettings, str], bool] = _NO_TRAITS.emulated,
    patience: float = math.nan,
) -> Callable[[Made], Made]:
    """Return a decorator for a driver's class or function; see :class:`DriverTraits`."""

    def decorated(made: Made) -> Made:
        setattr(
            made, _TRAITS, DriverTraits(options=options, needs=needs, check=check, emulated=emulated, patience=patience)
        )
        return made

    return decorated


class RegisteredDriver(NamedTuple):
    """One driver that a rig's file can name."""

    name: str  # name in the file
    kind: DriverKind
    origin: str  # "cutenv", or the package that brings it
    target: str  # ``module:attribute``

    def load(self) -> Callable[[Mounting], Any]:
        """Import the driver's class or function; raise ValueError if it is none."""
        try:
            made = EntryPoint(name=self.name, value=self.target, group=self.kind.group).load()
        except ModuleNotFoundError as error:
            if self.origin == "cutenv":
                raise  # the command line names the extra that brings it
            raise ValueError(f"driver {self.name!r} ({self.target}) cannot be imported: {error}. {_CURE}") from None
        except Exception as error:  # whatever somebody else's module raises on import
            raise ValueError(f"driver {self.name!r} ({self.target}) cannot be imported: {error!r}. {_CURE}") from error
        if not callable(made):
            raise ValueError(f"driver {self.name!r} ({self.target}) is {made!r}, no class or function. {_CURE}")
        driver: Callable[[Mounting], Any] = made
        return driver


_CURE = 'Is its package installed here, and is driver = "module:Class" spelled right?'


def registered_drivers(kind: DriverKind) -> dict[str, RegisteredDriver]:
    """Return a kind's drivers by name, this package's first.

    A package cannot take a name of this package's: its driver is then listed under ``package.name``.
    """
    found = {name: RegisteredDriver(name, kind, "cutenv", target) for name, target in SHIPPED_DRIVERS[kind].items()}
    for point in entry_points(group=kind.group):
        origin = point.dist.name if point.dist is not None else "?"
        name = point.name if point.name not in found else f"{origin}.{point.name}"
        found[name] = RegisteredDriver(name, kind, origin, point.value)
    return found


def driver_named(kind: DriverKind, name: str) -> RegisteredDriver:
    """Return a driver by its registered name or ``module:Class``."""
    module, colon, attribute = name.partition(":")
    if colon and module and attribute:
        import_from_here()
        return RegisteredDriver(name, kind, module.partition(".")[0], name)
    if name in SHIPPED_DRIVERS[kind]:  # nobody can take its name, and to ask every installed package takes 5 ms
        return RegisteredDriver(name, kind, "cutenv", SHIPPED_DRIVERS[kind][name])
    known = registered_drivers(kind)
    try:
        return known[one_of("driver", name, known)]
    except ValueError as error:
        raise ValueError(f'{error} A driver of your own is "module:Class".') from None


def traits_of(kind: DriverKind, name: str) -> DriverTraits:
    """Return the declaration of the driver of that name; loads it.

    Raise ValueError if there is no such driver, or it cannot be imported.
    """
    if (kind, name) == (DriverKind.CAMERA, "opencv"):
        return DriverTraits(needs=("source",))  # its own process alone loads OpenCV
    found: DriverTraits = getattr(driver_named(kind, name).load(), _TRAITS, _NO_TRAITS)
    return found


def option_keys(kind: DriverKind, name: str) -> tuple[FileKey, ...]:
    """Return keys of a driver's options; ValueError if unknown."""
    options = traits_of(kind, name).options
    return () if options is None else keys_of(options)


def mounted(mounting: Mounting) -> Any:
    """Make the driver that the mounting's section names.

    Raise ValueError if there is no such driver, it cannot be imported, or it refuses its settings.
    """
    kind = KIND_OF_ROLE[mounting.role]
    settings: Axis | SensorSettings | CameraSettings = mounting.settings
    return driver_named(kind, settings.driver).load()(mounting)


def driven_roles(rig: RigSettings) -> dict[str, str]:
    """Return the driver's name of each section that the rig has."""
    return {role: getattr(rig, role).driver for role in KIND_OF_ROLE if getattr(rig, role) is not None}


def axes_driven_by(rig: RigSettings, driver: str) -> dict[str, Axis]:
    """Return a rig's axes with this driver, by name."""
    return {name: axis for name, axis in rig.axes.items() if axis.driver == driver}
