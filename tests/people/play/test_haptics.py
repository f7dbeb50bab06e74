"""The virtual coupling: it gives back no more than it got, in any hand; and where its bound comes from."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played import COUPLING, TARGET, Pushing, run

from cutenv.people.play.devices import GamepadDevice, MouseDevice, simple_hand
from cutenv.people.play.haptics import FeltForce, HapticDevice, Stylus, VirtualCoupling
from cutenv.people.play.play_session import Servo, Session, SessionPlan


def energy_made(felt: FeltForce, positions: list[float], blades: list[float]) -> float:
    """The most that a hand ever got out of the device, its own damping counted [J]; never more than 0 if passive.

    Within a period the device goes straight: any other way, its damping takes more.
    """
    c = felt.coupling
    taken, worst, force = 0.0, 0.0, 0.0
    for k, (position, blade) in enumerate(zip(positions, blades, strict=True)):
        if k > 0:
            moved = position - positions[k - 1]
            taken += force * moved + c.device_damping / c.period * moved**2
            worst = min(worst, taken)
        force = felt.update(position, blade)
    return -worst


motions = st.lists(st.floats(-0.002, 0.002), min_size=2, max_size=200)


@given(motions, motions)
@settings(max_examples=200)
def test_whatever_hand_and_simulation_do_no_energy_is_made(steps: list[float], jumps: list[float]) -> None:
    n = min(len(steps), len(jumps))
    positions, blades = np.cumsum(steps[:n]).tolist(), (5.0 * np.cumsum(jumps[:n])).tolist()
    assert energy_made(COUPLING.felt(), positions, blades) < 1e-12


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.9), st.floats(0.05, 5.0))
def test_a_hand_that_always_gives_way_gains_nothing(seed: int, share: float, b: float) -> None:
    """The worst hand: it moves the way that costs the device most, -F T/(2 b), against a blade that jumps about."""
    coupling = VirtualCoupling(
        stiffness=1.99 * (1.0 - share) * b / 1e-3, damping=share * b, device_damping=b, force_limit=50.0
    )
    rng = np.random.default_rng(seed)
    felt, position, taken = coupling.felt(), 0.0, 0.0
    for _ in range(500):
        force = felt.update(position, float(rng.normal(0.0, 0.01)))
        moved = rng.choice([-force * coupling.period / (2.0 * b), rng.normal(0.0, 1e-4)])
        taken += force * moved + b / coupling.period * moved**2
        assert taken > -1e-12
        position += moved


class Unguarded(FeltForce):
    """Spring and damper without the account."""

    def update(self, position: float, blade: float) -> float:
        if not hasattr(self, "before"):
            self.before = position - blade
        lead, c = position - blade, self.coupling
        force = c.stiffness * lead + c.damping / c.period * (lead - self.before)
        self.before = lead
        return force


def too_stiff(times: float) -> VirtualCoupling:
    """A coupling beyond the bound, which its constructor would refuse."""
    coupling = VirtualCoupling(damping=0.0, force_limit=50.0)
    object.__setattr__(coupling, "stiffness", times * 2.0 * coupling.device_damping / coupling.period)
    return coupling


TO_AND_FRO = [0.001 * (k % 2) for k in range(200)]


def test_beyond_the_bound_the_account_still_holds() -> None:
    assert energy_made(too_stiff(5.0).felt(), TO_AND_FRO, [0.0] * 200) < 1e-12


@given(motions)
def test_within_the_bound_the_account_changes_nothing_at_a_blade_that_stands(steps: list[float]) -> None:
    coupling = VirtualCoupling(stiffness=700.0, damping=0.1, force_limit=100.0)
    positions = np.cumsum(steps)
    positions = np.clip(positions - positions[0], -0.05, 0.05)  # below the largest force
    felt, plain = coupling.felt(), Unguarded(coupling)
    for position in positions.tolist():
        assert felt.update(position, 0.0) == pytest.approx(plain.update(position, 0.0), abs=1e-6)


def test_the_force_is_no_more_than_its_limit() -> None:
    felt = COUPLING.felt()
    forces = [felt.update(1e-4 * k, 0.0) for k in range(1000)]
    assert max(forces) == COUPLING.force_limit


def test_work_that_went_into_the_tissue_is_not_saved_up() -> None:
    felt = COUPLING.felt()
    for k in range(5000):  # half a metre of pushing at the largest force
        felt.update(1e-4 * k, 1e-4 * k - 0.02)
    assert felt.energy <= 0.5 * COUPLING.force_limit**2 / COUPLING.stiffness + 1e-12


@pytest.mark.parametrize("mass", [0.02, 0.1, 1.0])
def test_nobodys_device_is_still_within_the_bound_and_swings_up_beyond(mass: float) -> None:
    def growth(times: float) -> float:
        coupling = VirtualCoupling(damping=0.0, device_mass=mass)
        object.__setattr__(coupling, "stiffness", times * 2.0 * coupling.device_damping / coupling.period)
        return coupling.growth

    assert growth(0.99) < 1.0
    # A light device has left its linear bound behind by a little: passivity is the narrower of the two.
    assert growth(1.3) > 1.0


def test_the_growth_is_that_of_the_motion_step_by_step() -> None:
    m, b, T = 0.1, 0.5, 1e-3
    coupling = VirtualCoupling(stiffness=300.0, damping=0.1, device_mass=m, device_damping=b)
    x, v, before, fine = 0.01, 0.0, 0.01, 200
    sizes = []
    for _ in range(4000):
        force = 300.0 * x + 0.1 * (x - before) / T
        before = x
        for _ in range(fine):
            v += (-force - b * v) * T / fine / m
            x += v * T / fine
        sizes.append(abs(x) + abs(v) * math.sqrt(m / 300.0))
    measured = (max(sizes[3000:4000]) / max(sizes[0:1000])) ** (1.0 / 3000.0)
    assert measured == pytest.approx(coupling.growth, abs=2e-4)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"stiffness": 900.0}, "take a stiffness of 800 N/m at most"),
        ({"period": 0.005}, "take a stiffness of 160 N/m at most"),
        ({"damping": 0.6}, "take a damping below 0.5"),
        ({"device_damping": 0.0}, "device_damping"),
        ({"stiffness": float("nan")}, "stiffness"),
    ],
)
def test_a_coupling_beyond_the_bound_is_refused_with_the_stiffness_that_would_do(
    changes: dict[str, float], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        VirtualCoupling(**changes)


def test_a_place_that_is_none_is_refused() -> None:
    felt = COUPLING.felt()
    for position in (math.nan, 80.0):
        with pytest.raises(ValueError, match="position"):
            felt.update(position, 0.0)


@pytest.mark.parametrize("device", [MouseDevice(), GamepadDevice(), simple_hand(0.07)])
def test_every_device_keeps_the_protocol(device: HapticDevice) -> None:
    assert isinstance(device, HapticDevice)
    device.open()
    assert isinstance(device.read(), Stylus)
    device.push(1.0)
    device.close()


def test_a_device_that_pushes_is_pushed_every_millisecond_and_let_go_at_the_end() -> None:
    device = Pushing()
    played = Session(device, SessionPlan(seed=6, target_length=TARGET, countdown=0.0))
    played.begin()
    run(played)
    assert len(device.forces) == len(played.cut.readings) + 1
    assert 1.0 < max(device.forces) <= COUPLING.force_limit
    assert device.forces[-1] == 0.0


def test_a_button_counts_once_when_it_goes_down() -> None:
    device = Pushing()
    played = Session(device, SessionPlan(seed=6, target_length=TARGET, countdown=0.5))
    played.advance(0.0)
    assert played.phase == "ready"
    device.held = frozenset({"next"})
    clock = run(played)
    assert played.number == 0
    played.advance(clock + 0.1)
    assert played.phase == "ended"  # still held down
    device.held = frozenset()
    played.advance(clock + 0.2)
    device.held = frozenset({"next"})
    played.advance(clock + 0.3)
    assert (played.phase, played.number) == ("countdown", 1)


def test_a_servo_advances_a_session_in_time_and_lets_go_when_it_stops() -> None:
    device = Pushing()
    played = Session(device, SessionPlan(seed=6, target_length=TARGET, countdown=0.0))
    played.begin()
    servo = Servo(played)
    start = time.perf_counter()
    while time.perf_counter() - start < 10.0:
        with servo.lock:
            if len(played.cut.readings) >= 200:
                break
        time.sleep(0.01)
    servo.stop()
    assert len(played.cut.readings) >= 200
    assert device.forces[-1] == 0.0
    readings = len(played.cut.readings)
    time.sleep(0.02)
    assert len(played.cut.readings) == readings


def test_what_goes_wrong_in_the_servo_is_told_and_nothing_pushes_on() -> None:
    class Broken(Pushing):
        def read(self) -> Stylus:
            raise OSError("the cable is out")

    device = Broken()
    played = Session(device, SessionPlan(countdown=0.0))
    played.begin()
    servo = Servo(played)
    deadline = time.perf_counter() + 10.0
    while servo.error is None and time.perf_counter() < deadline:
        time.sleep(0.005)
    with pytest.raises(OSError, match="the cable is out"):
        servo.stop()
    assert device.forces == [0.0]


def test_a_device_is_opened_before_it_is_read_and_closed_at_the_end() -> None:
    device = Pushing()
    with pytest.raises(OSError, match="not open"):
        device.read()
    played = Session(device)
    played.advance(0.0)
    played.advance(0.01)
    played.close()
    with pytest.raises(OSError, match="not open"):
        device.read()
