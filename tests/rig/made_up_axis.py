"""An empty axis of known constants: the simulator's drive, seen through encoder, torque meter and a late bus."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.interpolate import make_smoothing_spline

from cutenv.agents.sim_to_real.identification import Identification, Plan, Recorded, identification_from
from cutenv.rig.config.settings import Axis, RigSettings
from cutenv.rig.operation.recorder import Felt, Stretch
from cutenv.sim.cutting.drive import Rig, advance_command, delayed_command, lag_gain
from cutenv.sim.cutting.dtypes import STATE, TICK

advance, delayed = advance_command.py_func, delayed_command.py_func  # type: ignore[attr-defined]
SYNC = 5  # ticks
AXIS = Axis()
INCREMENT = AXIS.lead / (AXIS.gear * 4 * AXIS.pulses)
COUNT = 1e-3 * 2.0 * np.pi * AXIS.gear / AXIS.lead * AXIS.rated_torque  # [N] of a per mille


def plain(record: np.void) -> Any:
    """Return the numbers of a record as attributes; to read those of a record takes ten times as long."""
    return SimpleNamespace(**dict(zip(record.dtype.names or (), record.tolist(), strict=True)))


@dataclass(frozen=True, kw_only=True)
class MadeUpAxis:
    """Constants in, recordings out; friction on the motor's side, and of the carriage behind the play [N]."""

    drive: Rig = field(default_factory=Rig)
    motor_friction: float = 18.0
    carriage_friction: float = 4.0
    viscous: float = 300.0
    jitter: float = 0.4e-3  # mean of an exponential lateness of samples [s]
    reports_torque: bool = True
    seed: int = 0
    carried: float = 0.0  # mass behind the sensor [kg]; negative: a sensor with the wrong sign
    force_delay: float = 0.0  # [s]

    def stretch(self, commands: np.ndarray) -> Stretch:
        """What follows from one commanded speed a millisecond."""
        rng = np.random.default_rng([self.seed, len(commands)])
        (record,) = self.drive.records(2.0)
        drive, state = plain(record), plain(np.zeros(1, STATE)[0])
        state.hand = state.blade = 1.0
        share = lag_gain(record, TICK)
        rows = []
        for tick, command in enumerate(commands):
            before = float(state.hand)
            advance(state, drive, share, delayed(state, drive, float(command)), TICK)
            dx = state.hand - state.blade
            if dx < 0.0:
                dx = min(dx + drive.backlash, 0.0)
            state.blade += dx
            speed = (state.hand - before) / TICK
            force = np.sign(speed) * self.motor_friction + self.viscous * speed + np.sign(dx) * self.carriage_friction
            if (tick + 1) % SYNC == 0:
                late = rng.exponential(self.jitter)
                torque = round(force / COUNT) if self.reports_torque else 0
                rows.append(((tick + 1) * TICK + late, round(state.hand / INCREMENT) * INCREMENT, 1e-3 * torque))
        time, position, torque = np.array(rows).T
        time = np.maximum.accumulate(time)  # what is late holds up what follows
        changes = np.flatnonzero(np.diff(commands, prepend=np.nan))
        changes = np.append(changes, len(commands) - 1)
        return Stretch(
            command_time=TICK * changes, command=commands[changes], time=time, position=position, torque=torque
        )

    def step(self, speed: float, hold: float) -> Stretch:
        ticks = round(hold / TICK)
        return self.stretch(np.concatenate((np.zeros(400), np.full(ticks, speed), np.zeros(ticks + 20))))

    def turns(self, plan: Plan) -> Stretch:
        ticks = round(plan.turn_travel / plan.turn_speed / TICK)
        legs = [np.full(ticks, plan.turn_speed * -((-1) ** k)) for k in range(plan.turns + 1)]
        return self.stretch(np.concatenate((np.zeros(400), *legs, np.zeros(20))))

    def felt(self, sine: Stretch) -> Felt:
        """Readings at 1 kHz of the inertia that the sensor carries; the motion between samples is smooth."""
        rng = np.random.default_rng([self.seed, len(sine.time), 1])
        smooth = make_smoothing_spline(*_increasing(sine.time, sine.position), lam=1e-9)
        time = np.arange(float(sine.time[0]), float(sine.time[-1]), TICK)
        force = self.carried * smooth.derivative(2)(np.maximum(time - self.force_delay, sine.time[0]))
        return Felt(time, force + 0.02 * rng.standard_normal(len(time)))

    def sine(self, frequency: float, amplitude: float, duration: float) -> Stretch:
        time = 0.020 * np.arange(round(duration / 0.020))
        commands = np.repeat(amplitude * np.sin(2.0 * np.pi * frequency * time), 20)
        return self.stretch(np.concatenate((np.zeros(400), commands, np.zeros(400))))


def made_up_force(
    *, noise: float = 0.02, resolution: float = 0.05, drift: float = 0.0, duration: float = 20.0, seed: int = 0
) -> np.ndarray:
    """Readings at rest at 1 kHz, with an offset [N]."""
    rng = np.random.default_rng(seed)
    n = round(duration / TICK)
    walk = np.cumsum(drift * TICK**0.5 * rng.standard_normal(n))
    force = 0.0137 + walk + noise * rng.standard_normal(n)
    return force if resolution == 0.0 else resolution * np.floor(force / resolution + 0.5)


def _increasing(time: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    new = np.flatnonzero(np.diff(time, prepend=-1.0) > 1e-6)
    return time[new], position[new]


@functools.cache
def recorded(axis: MadeUpAxis) -> tuple[Plan, Recorded]:
    """The whole experiment on a made-up rig."""
    plan = Plan.within(RigSettings(), 0.03)
    steps = tuple(
        axis.step(sign * speed, hold)
        for speed, hold in zip(plan.speeds, plan.step_hold, strict=True)
        for sign in (1, -1)
    )
    sines = tuple(axis.sine(*sine, sine.duration) for sine in plan.sines)
    felt = tuple(map(axis.felt, sines)) if axis.carried else ()
    return plan, Recorded(steps, sines, axis.turns(plan), made_up_force(), 1000.0, felt=felt)


def identified(axis: MadeUpAxis) -> Identification:
    """Drive as it is identified from that experiment."""
    return identification_from(RigSettings(), *recorded(axis))
