"""Handle and hand around the cut line, simulated by pymunk for pictures.

The cut itself uses the hand of :mod:`cutenv.sim.cutting.drive`, which moves along the line alone. Here the same spring
and damper pull a rigid handle that can also turn: it slides in a groove along the line, a spring holds it at the
demanded angle, between 45 and 90 degrees, and the force of the tissue on the blade below the surface tips it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from cutenv.people.play.hand_model import PLAYED_HAND
from cutenv.sim.cutting.drive import Hand
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.tissue.specimen import LENGTH

MOMENT = 4e-4
"""Moment of inertia about the point on the line [kg m2]: a handle of 0.15 kg, half of it 7 cm away (assumed)."""
GRIP_STIFFNESS, GRIP_DAMPING = 2.0, 0.03
"""Stiffness and damping of the grip against tipping [N m/rad], [N m s/rad]: 5 N, 1 cm below the line, tip it by 1.4
degrees (assumed)."""
_REST_LENGTH = 0.10  # between the spring's anchors [m]: pymunk pulls along their line, which needs a length


class HandlePose(NamedTuple):
    """Pose of the handle: position [m], speed, angle [rad]; pi/2 is upright."""

    position: float
    speed: float
    angle: float


class Handle:
    """Rigid handle in a groove along the line, held by a hand.

    The hand gives mass, stiffness and damping of the coupling; the angle is that at the start [rad].
    """

    def __init__(self, hand: Hand = PLAYED_HAND, *, angle: float = math.pi / 2) -> None:
        import pymunk  # an extra

        self._space: Any = pymunk.Space()  # without gravity: a hand carries the handle
        # Pymunk's angles count anticlockwise from the line, as those of the blade, which leans forward.
        self._handle: Any = pymunk.Body(hand.mass, MOMENT)
        self._handle.angle = angle
        self._hand: Any = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        self._fingers: Any = pymunk.Body(body_type=pymunk.Body.KINEMATIC)
        ground = self._space.static_body
        groove = pymunk.GrooveJoint(ground, self._handle, (-LENGTH, 0.0), (2.0 * LENGTH, 0.0), (0.0, 0.0))
        coupling = pymunk.DampedSpring(
            self._hand, self._handle, (-_REST_LENGTH, 0.0), (0.0, 0.0), _REST_LENGTH,
            hand.coupling_stiffness, hand.coupling_damping,
        )  # fmt: skip
        grip = pymunk.DampedRotarySpring(self._handle, self._fingers, 0.0, GRIP_STIFFNESS, GRIP_DAMPING)
        stops = pymunk.RotaryLimitJoint(ground, self._handle, math.pi / 4, math.pi / 2)
        self._space.add(self._handle, groove, coupling, grip, stops)

    @property
    def pose(self) -> HandlePose:
        """Present pose."""
        return HandlePose(float(self._handle.position.x), float(self._handle.velocity.x), float(self._handle.angle))

    def step(self, *, hand: float, hand_speed: float, angle: float, force: float, depth: float) -> None:
        """Advance by a millisecond.

        The hand has position [m] and speed [m/s], and demands an angle [rad]. The force of the tissue on the blade,
        against forward motion [N], acts at half the depth of the cut [m].
        """
        # Pymunk moves first and computes forces then: set the hand to its position before this millisecond.
        self._hand.position = (hand - hand_speed * TICK, 0.0)
        self._hand.velocity = (hand_speed, 0.0)
        self._fingers.angle = angle
        self._handle.apply_force_at_world_point((-force, 0.0), (self._handle.position.x, -0.5 * depth))
        self._space.step(TICK)
