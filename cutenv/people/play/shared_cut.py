"""Cut by an agent that a person can take over, while a button is held.

In :class:`SharedCut` it is taken over millisecond by millisecond; :class:`InterveningHand` takes over decision by
decision, in simulation and on a rig, for :class:`cutenv.envs.SharedControl`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.validation import one_of
from cutenv.people.play.devices import HandMotion, ScriptedDevice, within_angles
from cutenv.people.play.hand_model import speed_over
from cutenv.people.play.haptics import FeltForce, HapticDevice, Stylus
from cutenv.people.play.played_cut import UPDATES_HZ, PlayedCut
from cutenv.sim.cutting.drive import Rig
from cutenv.sim.trace import Trace
from cutenv.task.observation import COMPONENTS, OFFSETS, SCALES, SPEED_SCALE, to_action

LEADS = "next"
"""Button that hands the blade to the person while it is held: the first of a grip."""
LEASH = 0.010
"""Distance by which the hand may be ahead of the blade that follows it [m]."""
_SOON = 2.0  # decisions in which the blade is brought to where the hand is
_FOLDED = {component.name: k for k, component in enumerate(COMPONENTS)}
_TAKEN_BY = ("control_hz", "angle_mode", "fixed_angle_deg")


@dataclass(frozen=True, kw_only=True)
class SharingAgent:
    """Agent that shares a cut, by what a rig measures; ValueError for another."""

    name: str  # of the policy, for the record
    policy: Any  # of cutenv/GentleCut-v1: an observation to an action, with reset
    arguments: Mapping[str, Any] = field(default_factory=dict)  # of the environment that it needs

    def __post_init__(self) -> None:
        if (task := self.arguments.get("task", "gentle")) != "gentle":
            raise ValueError(f"policy {self.name!r} is for the task {task!r}; a cut is shared in gentle cutting alone.")
        if hasattr(self.policy, "set_state"):
            raise ValueError(
                f"policy {self.name!r} knows the hidden state of the cut. Take one that knows what a rig measures."
            )
        for name in self.arguments:
            one_of(f"argument of policy {self.name!r}", name, (*_TAKEN_BY, "task"))

    @property
    def control_hz(self) -> int:
        """Decisions a second."""
        return int(self.arguments.get("control_hz", 10))

    @property
    def turning(self) -> dict[str, Any]:
        """Arguments of the environment apart from the decisions a second."""
        return {name: value for name, value in self.arguments.items() if name not in ("control_hz", "task")}


class SharedCut(PlayedCut):
    """Cut on a rig's drive, by agent or person.

    The drive follows the agent's speed and angle, or the person's while they hold a button.

    Without the person it is the agent's cut in the environment, decision by decision. The blade does not leap when the
    person takes it: it moves and leans by as much as the hand does from there. Keywords are those of
    :class:`~cutenv.people.play.played_cut.PlayedCut`.
    """

    def __init__(self, *, agent: SharingAgent, **keywords: Any) -> None:
        super().__init__(**keywords, **agent.turning)
        self.agent = agent
        self._ticks = UPDATES_HZ // agent.control_hz
        self._grabbed: tuple[float, float] | None = None  # blade less stylus: place [m], angle [rad]
        self._led: list[list[int]] = []  # first and last + 1 of the milliseconds in which the person led
        self._persons: set[int] = set()  # decisions
        self._sum, self._least, self._most = 0.0, np.inf, -np.inf  # of the force since the last decision [N]
        agent.policy.reset(np.random.default_rng((self.seed, self.episode)))
        self._decided = np.asarray(agent.policy(self._first), np.float32)

    def _drive(self) -> dict[str, Any]:
        return {"drive": "rig"}

    @property
    def person_leads(self) -> bool:
        """True while the person holds the blade."""
        return self._grabbed is not None

    @property
    def hand(self) -> float:
        """Blade's position [m], rigidly that of the drive."""
        return float(self.plant.states["blade"][0])

    @property
    def hand_place(self) -> tuple[float, float]:
        """Stylus place that keeps the blade where it is [m], and 0."""
        return self.hand - (0.0 if self._grabbed is None else self._grabbed[0]), 0.0

    @property
    def decisions(self) -> tuple[int, int]:
        """Number of agent decisions, and of those the person overrode."""
        return -(-self._count // self._ticks), len(self._persons)

    def tick(self, stylus: Stylus) -> None:
        """Advance a millisecond, led by agent or person, until the end."""
        if self.end:
            return
        if self._count and self._count % self._ticks == 0:
            self._decided = np.asarray(self.agent.policy(self._observed()), np.float32)
        held = LEADS in stylus.buttons
        if held and self._grabbed is None:
            self._grabbed = self.hand - stylus.position, float(self.plant.states["angle"][0]) - stylus.angle
            self._led.append([self._count, self._count])
        elif not held:
            self._grabbed = None
        if held:
            self._persons.add(self._count // self._ticks)
            self._led[-1][1] = self._count + 1
        super().tick(stylus)
        felt = float(self._readings[self._count - 1]["force"])
        self._sum, self._least, self._most = self._sum + felt, min(self._least, felt), max(self._most, felt)

    def action(self, stylus: Stylus) -> NDArray[np.float32]:
        """Return the agent's action, or the one toward the person's hand."""
        if self._grabbed is None:
            return self._decided
        place, angle = self._grabbed
        drive = self._env.constants.drive
        assert isinstance(drive, Rig)
        speed = speed_over(place + stylus.position - self.hand, drive.motor_lag, drive.acceleration)
        return to_action(speed, within_angles(angle + stylus.angle))

    def felt(self, felt: FeltForce, stylus: Stylus) -> float:
        """Return the blade's force for a holding hand [N], else 0."""
        if self._grabbed is None:
            felt.forget()
            return 0.0
        return felt.update(self._grabbed[0] + stylus.position, float(self.readings["position"][-1]))

    def simple_hand(self) -> ScriptedDevice:
        """Return a scripted hand that leads from 2 s to 4 s."""

        def reach(time: float) -> float:
            return 0.006 * min(max(time - 2.0, 0.0), 2.0)

        return ScriptedDevice(lambda time: HandMotion(reach(time), 0.5 * np.pi, held=2.0 <= time < 4.0))

    @property
    def map_words(self) -> str:
        """Words that say whose decisions they were."""
        every, persons = self.decisions
        return f"You held the blade in {persons} of {every} decisions; {self.agent.name!r} made the others."

    @property
    def leader_words(self) -> str:
        """Words that say who leads now."""
        agents = f"the agent {self.agent.name} cuts: hold space or the button to take over"
        return "you lead" if self.person_leads else agents

    def missing(self, *, practice: bool, force_shown: bool = True) -> tuple[str, ...]:
        """Return what is still missing to finish, while the person leads."""
        return super().missing(practice=practice, force_shown=force_shown) if self.person_leads else ()

    def trace(self, **metadata: object) -> Trace:
        """Return a rig's trace, with who held the blade and when."""
        every, persons = self.decisions
        metadata.pop("hand", None)  # there is none between person and blade
        return super().trace(
            policy=self.agent.name,
            control_hz=self.agent.control_hz,
            decisions=every,
            decisions_of_the_person=persons,
            person_led_s=[[first / UPDATES_HZ, last / UPDATES_HZ] for first, last in self._led],
            **metadata,
        )

    def _observed(self) -> NDArray[np.float32]:
        """Return the agent's observation, forces since its last one."""
        observation = self._observation.copy()
        folded = {"force_mean": self._sum / self._ticks, "force_min": self._least, "force_max": self._most}
        for name, value in folded.items():
            k = _FOLDED[name]
            observation[k] = (value - OFFSETS[k]) / SCALES[k]
        self._sum, self._least, self._most = 0.0, np.inf, -np.inf
        return observation


class InterveningHand:
    """Person's action while the first button is held.

    Call it once a decision.

    When the button goes down, the hand is where the blade is, wherever the device stands: the person moves it from
    there. Speed and angle follow the hand. One that gets ahead of the blade by more than :data:`LEASH`, because the
    device jumps, reads what is no place, or is moved faster than any blade, is followed no more: the blade stands until
    the button is pressed anew. The device pushes nothing: a force that is new only with every decision would not be
    passive. The device is open, ``blade`` returns the present position of the blade [m], decisions are ``control_hz`` a
    second.
    """

    def __init__(self, device: HapticDevice, blade: Callable[[], float], *, control_hz: int) -> None:
        self._device, self._blade = device, blade
        self._gain = control_hz / _SOON
        self._lost = False  # it got away since the button went down
        self._grabbed: float | None = None  # place of the blade less that of the hand when the button went down [m]

    def __call__(self) -> NDArray[np.float32] | None:
        """Return the action toward the hand, None while released."""
        stylus, blade = self._device.read(), self._blade()
        if LEADS not in stylus.buttons:
            self._grabbed = None
            return None
        if self._grabbed is None:
            self._grabbed, self._lost = blade - stylus.position, False
        ahead = self._grabbed + stylus.position - blade
        self._lost |= not abs(ahead) <= LEASH
        speed = 0.0 if self._lost else self._gain * ahead
        return to_action(min(max(speed, -SPEED_SCALE), SPEED_SCALE), stylus.angle)
