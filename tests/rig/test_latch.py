"""Stop, late sample, clear, reset, enable, in any order: never in power without consent, and the operator can go on.

The whole rig of one axis runs, from the plant to the drive's own state machine, on a clock moved by hand.
"""

from __future__ import annotations

from typing import Any

import hypothesis
import pytest
from hand_moved_rig import UPRIGHT, WAY, HandMovedRig
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from cutenv.rig.devices.protocols import NEXT, DriveState, Event, Latch, Phase
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause, RigStopped

LATE = st.sampled_from([WAY, 0.010, 0.025, 0.045])
"""Ways of the drive's frames to the rig [s]: the host stalls, and samples tell what was true before a stop."""
STILL = 1e-5  # [m/s]


@pytest.fixture
def rig() -> HandMovedRig:
    return HandMovedRig().ready()


class AnyOrder(RuleBasedStateMachine):
    """What an operator, a policy, a drive and a bus may do to a rig, in any order.

    Power is consented to while ``power`` runs, and while the rig is released.
    """

    @initialize()
    def begin(self) -> None:
        self.rig = HandMovedRig().ready()
        self.supervisor = self.rig.supervisor
        self.switching_on = False
        self.unasked: list[str] = []
        enable = self.rig.node._enter

        def watched(state: DriveState) -> None:
            consented = self.switching_on or self.supervisor.phase is Phase.READY
            if state is DriveState.ENABLED and self.rig.node.state is not state and not consented:
                self.unasked.append(f"at {self.rig.clock.now():.3f} s")
            enable(state)

        self.rig.node._enter = watched  # type: ignore[method-assign]

    def tried(self, action: Any) -> bool:
        """Whether it was done; any other refusal than the rig's own words is a defect."""
        try:
            action()
        except RigError:
            return False
        return True

    @rule(way=LATE)
    def delay(self, way: float) -> None:
        self.rig.network.way = way

    @rule(seconds=st.sampled_from([0.001, 0.004, 0.012, 0.06]))
    def wait(self, seconds: float) -> None:
        self.rig.wait(seconds)

    @rule(frames=st.integers(1, 3))
    def lose(self, frames: int) -> None:
        self.rig.network.lost = frames

    @rule(locked=st.booleans())
    def stop(self, locked: bool) -> None:
        self.supervisor.trip(Cause.OPERATOR, "as told", locked=locked)

    @rule()
    def stop_by_itself(self) -> None:
        if self.rig.node.state is DriveState.ENABLED:
            self.rig.node._enter(DriveState.QUICK_STOP)

    @rule(fails=st.booleans())
    def fault(self, fails: bool) -> None:
        self.rig.node.failure = 0x2310 if fails else 0

    @rule(agreed=st.booleans())
    def reset(self, agreed: bool) -> None:
        latched = self.supervisor.latched
        if self.tried(lambda: self.supervisor.reset(agreed=agreed)) and latched is not None:
            assert agreed
            assert self.rig.node.state is not DriveState.ENABLED
            assert self.supervisor.phase is Phase.UNREADY

    @rule(way=LATE, after=st.sampled_from([0.0, 0.005, 0.02]))
    def reset_right_after_a_stop(self, way: float, after: float) -> None:
        self.rig.network.way = way
        self.stop(locked=True)
        self.rig.wait(after)
        self.reset(agreed=True)

    @rule()
    def enable(self) -> None:
        stopped = self.supervisor.phase is Phase.STOPPED
        self.switching_on = not stopped  # a stopped rig gets no power, whoever asks
        self.tried(self.rig.plant.power)
        self.switching_on = False

    @rule()
    def disable(self) -> None:
        self.tried(self.rig.plant.switch_off)

    @rule()
    def release(self) -> None:
        self.tried(self.supervisor.release)

    @rule(speed=st.sampled_from([0.015, -0.005, 0.0]))
    def drive(self, speed: float) -> None:
        moved = self.tried(lambda: self.supervisor.drive(speed, UPRIGHT, 0.02))
        assert not moved or self.supervisor.phase is not Phase.UNREADY

    @rule()
    def halt(self) -> None:
        self.rig.plant.halt()

    @invariant()
    def never_in_power_without_consent(self) -> None:
        if hasattr(self, "rig"):
            assert self.unasked == []
            assert self.supervisor.phase in (Phase.UNREADY, Phase.READY, Phase.STOPPED)  # no reset is left half done

    def teardown(self) -> None:
        """Everything is mended: an operator who agrees can go on, and cut."""
        if not hasattr(self, "rig"):
            return
        rig = self.rig
        rig.network.way, rig.network.lost, rig.node.failure = WAY, 0, 0
        rig.wait(0.5)
        if self.supervisor.phase is Phase.STOPPED:
            assert abs(rig.speed) < STILL
            assert rig.node.state is not DriveState.ENABLED
        rig.plant.halt()
        self.switching_on = True
        rig.go_on()
        begun = rig.position
        rig.cut(0.01 if begun < 0.1 else -0.01, 0.2)
        assert abs(rig.position - begun) > 0.0005
        rig.plant.close()
        assert rig.node.state not in (DriveState.ENABLED, DriveState.QUICK_STOP)


@pytest.mark.promise("S5")
def test_any_order_of_events_ends_where_the_operator_can_go_on_and_never_in_power_without_consent():
    run_state_machine_as_test(
        AnyOrder,
        settings=settings(
            max_examples=30, stateful_step_count=20, deadline=None, derandomize=True,
            phases=[hypothesis.Phase.generate],  # to shrink a failure takes minutes
            suppress_health_check=list(hypothesis.HealthCheck),
        ),
    )  # fmt: skip


@pytest.mark.parametrize("way", [0.0005, 0.010, 0.030, 0.045])
@pytest.mark.parametrize("after", [0.0, 0.001, 0.005, 0.012, 0.030])
def test_a_reset_right_after_a_stop_is_done_while_old_samples_still_come(rig, way, after):
    rig.cut(0.015, 0.1)
    rig.network.way = way
    rig.supervisor.trip(Cause.OPERATOR, "as told")
    rig.wait(after)
    rig.supervisor.reset(agreed=True)
    assert rig.supervisor.latched is None
    assert rig.node.state is DriveState.DISABLED
    rig.network.way = WAY
    rig.wait(0.1)
    rig.go_on()
    rig.cut(0.015, 0.1)


def test_a_stop_during_a_reset_is_a_stop_of_its_own(rig):
    rig.cut(0.015, 0.1)
    rig.supervisor.trip(Cause.OPERATOR, "the first")
    clear = rig.driver.clear

    def interrupted() -> None:
        rig.supervisor.trip(Cause.OPERATOR, "the second", locked=True)
        clear()

    rig.driver.clear = interrupted
    with pytest.raises(RigError, match="stopped again during the reset"):
        rig.supervisor.reset(agreed=True)
    assert "the second" in rig.supervisor.latched
    with pytest.raises(RigError):
        rig.plant.power()
    rig.driver.clear = clear
    rig.go_on()


def test_a_reset_of_a_drive_that_never_heard_the_stop_stops_it_first(rig):
    rig.cut(0.015, 0.3)
    rig.network.lost = 1
    rig.supervisor.trip(Cause.OPERATOR, "as told")
    assert rig.node.state is DriveState.ENABLED
    rig.supervisor.reset(agreed=True)
    assert rig.node.state is DriveState.DISABLED
    assert abs(rig.speed) < STILL


@pytest.mark.promise("S5")
def test_only_the_operators_word_leads_out_of_a_stop():
    assert {event for (phase, event), after in NEXT.items() if phase is Phase.STOPPED} == {Event.AGREE}
    assert {phase for (phase, _), after in NEXT.items() if after is Phase.READY} == {Phase.UNREADY}
    assert all(NEXT[phase, Event.STOP] is Phase.STOPPED for phase in Phase if phase is not Phase.STOPPED)
    latch = Latch()
    for event in (Event.RELEASE, Event.STOP, Event.RELEASE, Event.LOCK, Event.CLEARED):
        latch.happens(event)
    assert (latch.phase, latch.closed) == (Phase.STOPPED, True)


@pytest.mark.promise("S6")
def test_an_axis_without_heartbeat_has_none_until_the_operator_agrees_and_the_others_go_on():
    latch = Latch()
    latch.withhold("blade")
    assert latch.phase is Phase.STOPPED
    for event in (Event.STOP, Event.RELEASE, Event.LOCK, Event.CLEARED, Event.FAILED):
        latch.happens(event)
        assert (latch.allows_heartbeat("blade", 0.0), latch.allows_heartbeat("height", 0.0)) == (False, True)
    latch.happens(Event.AGREE)
    assert latch.allows_heartbeat("blade", 0.0)
    latch.withhold("blade")  # by a thread that comes late: a stop of its own, which the reset does not undo
    assert not latch.happens(Event.CLEARED)
    assert not latch.allows_heartbeat("blade", 0.0)
    latch.restore("blade")  # opened again
    assert (latch.allows_heartbeat("blade", 0.0), latch.phase) == (True, Phase.STOPPED)


def cut_through_growing_latency(rig: HandMovedRig) -> None:
    """Cut for a second, in which the way to the rig grows by 4 ms every 20 ms: no sample is ever stale."""
    for _ in range(50):
        rig.network.way += 0.004
        rig.cut(0.01, 0.02)


@pytest.mark.parametrize("lost", [6, 20, 60])
def test_after_an_interrupted_bus_one_reset_is_enough_and_latency_that_grows_still_stops(rig, lost: int) -> None:
    rig.network.lost = lost
    rig.wait(1.5)
    assert rig.supervisor.phase is Phase.STOPPED
    rig.go_on()
    begun = rig.position
    rig.cut(0.01, 0.2)
    assert rig.position - begun > 0.0005
    with pytest.raises(RigStopped, match="the bus is late"):
        cut_through_growing_latency(rig)
    rig.plant.close()
