"""Haptic devices.

Position in, force out, and a coupling that cannot return more energy than it received.

A driver implements the five parts of :class:`HapticDevice` and may be in your own code: pass it to ``Session(device)``
and ``PlayWindow(session)``. Haply's Inverse3 is in :mod:`cutenv.people.play.inverse3`. None of these devices was
available for testing: that one was tested against an emulated one. For others, the table shows the calls for each part:

============= =========================== =============================================
part          Force Dimension (DHD;       3D Systems (OpenHaptics HDAPI)
              ``forcedimension_core``)    through ctypes
============= =========================== =============================================
``open``      ``dhd.open()``,             ``hdInitDevice``,
              ``dhd.enableForce(True)``   ``hdEnable(HD_FORCE_OUTPUT)``,
                                          ``hdStartScheduler``
``read``      ``dhd.getPosition`` [m],    ``hdGetDoublev(HD_CURRENT_POSITION)`` [mm!],
              ``dhd.getButton``           ``HD_CURRENT_BUTTONS``
``push``      ``dhd.setForce([f, 0, 0])`` ``hdSetDoublev(HD_CURRENT_FORCE, ...)`` [N]
              [N]
``close``     ``dhd.setForce([0, 0, 0])`` ``hdStopScheduler``, ``hdDisableDevice``
              ``dhd.close()``
``coupling``  damping and mass of the     the same
              data sheet, or measured
============= =========================== =============================================

Take one axis of the device along the cut line, measure it from its position when the cut begins, and convert it to SI.
OpenHaptics calls back at 1 kHz in a thread of its own: there, keep the newest position and send the newest force, and
let ``read`` and ``push`` pass them on, as :class:`~cutenv.people.play.polled_handle.PolledHandle` does. A mouse or a
gamepad cannot push.
:class:`~cutenv.people.play.play_session.Servo` runs a session in a thread, a millisecond at a time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from cutenv._base.validation import check_parameters, in_range, parameter
from cutenv.sim.cutting.dtypes import TICK


class Stylus(NamedTuple):
    """Input of a person at one instant.

    Attributes
    ----------
    position : float
        Wanted position of the hand, from the clamp [m].
    angle : float
        Wanted angle of the blade [rad]; pi/2 is upright.
    buttons : frozenset of str
        Buttons held down, among "next" and "repeat".
    level : float
        Wanted level of the blade above that at the start [m], where its depth is its own.
    across : float
        Wanted place of the hand across the slab, to the left [m], where the blade is steered; `position` is then the
        place along the slab.
    """

    position: float
    angle: float
    buttons: frozenset[str] = frozenset()
    level: float = 0.0
    across: float = 0.0


@runtime_checkable
class HapticDevice(Protocol):
    """Device held in the hand; read and pushed once a millisecond."""

    @property
    def coupling(self) -> VirtualCoupling | None:
        """Coupling that keeps the force safe, None without force feedback."""
        ...

    def open(self) -> None:
        """Connect if necessary and start at the clamp, for every cut."""
        ...

    def read(self) -> Stylus:
        """Return the person's present input, without waiting."""
        ...

    def push(self, force: float) -> None:
        """Apply ``force`` [N] against forward motion until the next call, without waiting."""
        ...

    def close(self) -> None:
        """End the force and release the device; further calls do nothing."""
        ...


@dataclass(frozen=True, kw_only=True)
class VirtualCoupling:
    """Spring and damper between a device and the blade.

    Their stiffness is limited by the device's own damping.

    A force that is held for a period T generates energy: a spring K that is displaced by d during T returns K d^2/2
    more than it received. The device's friction b dissipates at least b d^2/T in that time. Hence

        K T/2 + B <= b        (Colgate and Schenkel 1997)

    and with it the device is passive in any hand, and stable, whatever its mass. For B = 0 that is K < 2 b/T.

    Parameters
    ----------
    stiffness : float
        K [N/m].
    damping : float
        B, damping of the virtual damper [N s/m].
    device_damping : float
        b, physical damping of the device alone, without the hand [N s/m].
    device_mass : float
        Moving mass [kg].
    period : float
        T: the longest time for which a force is held [s]. A millisecond needs a real-time thread; for Python assume 5
        ms, which allows a fifth of the stiffness.
    force_limit : float
        Greatest force that is applied [N].

    Raises
    ------
    ValueError
        If a value is out of range, or the bound is violated; the message gives the stiffness that would be allowed.

    Notes
    -----
    J. E. Colgate and G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces, J.
    Robotic Systems 14 (1997) 37-47. The defaults are typical of a light desktop device: assumed, not measured.
    """

    stiffness: float = parameter(
        300.0, unit="N/m", low=0.0, high=1e6, provenance="choice", source="softer than the hand's own 400 N/m"
    )
    damping: float = parameter(
        0.1, unit="N s/m", low=0.0, high=1e3, provenance="choice", source="a little, for the feel"
    )
    device_damping: float = parameter(
        0.5, unit="N s/m", low=1e-6, high=1e3, provenance="assumed",
        source="order of a desktop device's; measure yours", sensitivity=(0.1, 2.0),
    )  # fmt: skip
    device_mass: float = parameter(
        0.1, unit="kg", low=1e-3, high=10.0, provenance="assumed",
        source="order of a desktop device's apparent mass", sensitivity=(0.04, 0.3),
    )  # fmt: skip
    period: float = parameter(TICK, unit="s", low=1e-4, high=0.1, provenance="choice", source="a servo at 1 kHz")
    force_limit: float = parameter(
        3.3, unit="N", low=0.01, high=100.0, provenance="choice", source="of a Touch, at peak"
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        room = self.device_damping - self.damping
        if self.stiffness * self.period / 2.0 > room:
            cure = f"take a stiffness of {max(2.0 * room / self.period, 0.0):.4g} N/m at most"
            if room <= 0.0:
                cure = f"take a damping below {self.device_damping:g} N s/m, the device's own"
            raise ValueError(
                f"stiffness = {self.stiffness:g} N/m with damping = {self.damping:g} N s/m makes energy with a device "
                f"of {self.device_damping:g} N s/m whose force is held for {1e3 * self.period:g} ms: {cure}."
            )

    @property
    def growth(self) -> float:
        """Growth of a free device's motion per period [1]; below 1 stable.

        It is the largest eigenvalue of the device (mass and damping, its force held for a period) under spring and
        damper.
        """
        m, b, T = self.device_mass, self.device_damping, self.period
        left = math.exp(-b * T / m)
        slide = m / b * (1.0 - left)  # remaining travel for a speed of 1
        fall = (T - slide) / b  # travel for a force of 1
        gain = (1.0 - left) / b  # speed for a force of 1
        K, B = self.stiffness, self.damping / T
        # Position, speed, and the position before, because the damper takes differences of positions.
        step = np.array([[1.0 - fall * (K + B), slide, fall * B], [-gain * (K + B), left, gain * B], [1.0, 0.0, 0.0]])
        return float(np.abs(np.linalg.eigvals(step)).max())

    def felt(self) -> FeltForce:
        """Return a new filter of the force for one session, at rest."""
        return FeltForce(self)


class HandEnergy:
    """Account of the energy that a device received from a person.

    What it has not returned limits the next force.

    A force F that is held for a time T at most returns no more than the account E covers, in any hand:

        E + F d + (b/T) d^2 >= 0 for every d        if and only if        |F| <= 2 sqrt(b E/T).

    b is the device's damping.
    """

    def __init__(self, coupling: VirtualCoupling) -> None:
        self.energy = 0.0
        """Energy that can be returned [J]."""
        self._coupling = coupling
        # Energy of the spring at the largest force: by the bound, at least what that force needs.
        softest = max(coupling.stiffness, 1e-3 * coupling.device_damping / coupling.period)
        self._full = 0.5 * coupling.force_limit**2 / softest

    def held(self, force: float, moved: float, seconds: float) -> None:
        """Enter a force [N] held for a time, and the motion [m]."""
        self.energy += force * moved + self._coupling.device_damping / seconds * moved**2
        self.energy = min(self.energy, self._full)

    @property
    def allowed(self) -> float:
        """Greatest force that may be held for the coupling's period [N]."""
        c = self._coupling
        return min(2.0 * math.sqrt(c.device_damping * max(self.energy, 0.0) / c.period), c.force_limit)


class FeltForce:
    """Force of a virtual coupling between device and blade.

    It is limited by an energy account that keeps it passive.

    The bound holds for a blade at rest. One that the simulation moves could still put energy into the hand; therefore
    an :class:`HandEnergy` is kept, and the force is limited to what it covers, in all cases.

    For a spring within the bound, below its largest force, and a blade at rest, the limit never acts. The account holds
    no more than such a spring at that force: work that went into the tissue is not saved.
    """

    def __init__(self, coupling: VirtualCoupling) -> None:
        self.coupling = coupling
        self.force = 0.0
        """Force held now, against forward motion [N]."""
        self._account = HandEnergy(coupling)
        self._position: float | None = None
        self._lead = 0.0

    @property
    def energy(self) -> float:
        """Energy that can be returned [J]."""
        return max(self._account.energy, 0.0)  # below 0 by rounding only

    def forget(self) -> None:
        """Release the force and reset the energy account.

        What the device's friction took in a longer time is less than the account would reckon.
        """
        self.force = self._account.energy = 0.0
        self._position = None

    def update(self, position: float, blade: float) -> float:
        """Return the force to hold for the next period [N].

        Both positions are from the clamp [m], -1 to 1. Raises ValueError if a position is not finite, or out of a
        desktop's range.
        """
        for name, place in (("position", position), ("blade", blade)):
            if not -1.0 <= place <= 1.0:
                in_range(name, place, -1.0, 1.0, "m", "Give metres from the clamp; 80 mm is 0.08.")
        c = self.coupling
        lead = position - blade
        if self._position is None:
            self._position, self._lead = position, lead
        moved = position - self._position
        self._account.held(self.force, moved, c.period)
        wanted = c.stiffness * lead + c.damping / c.period * (lead - self._lead)
        allowed = self._account.allowed
        self.force = min(max(wanted, -allowed), allowed)
        self._position, self._lead = position, lead
        return self.force
