"""Write a driver of your own for an axis, and try it against what every driver promises."""

from cutenv.drivers.conformance import LIMIT_NAMES, conform_motion
from cutenv.rig.config.settings import Axis, RigSettings
from cutenv.rig.devices import DriveState, Event, FakeClock, Latch, MotionSample, Mounting, RigError, rig_driver


@rig_driver(needs=("lead",), emulated=lambda rig, role: True)  # it moves nothing
class Stage:
    """A stage in memory; put your device's calls where this one counts."""

    def __init__(self, mounting):
        self.name, self.axis, self.clock = mounting.role, mounting.settings, mounting.clock
        self.period, self.listener, self.state = mounting.rig.bus.sync, None, DriveState.DISABLED
        self.latch, self.position, self.speed, self.target = Latch(), 0.0, 0.0, 0.0

    def open(self, listener):  # connect, check who answers, write the set-up and read it back
        self.only(self.listener is None, "it is open already: close it first")
        self.listener, self.timer = listener, self.clock.every(self.period, self.report, "stage")

    def report(self, now):  # called with every sample that your device sends
        runs = self.state is DriveState.ENABLED
        most = self.period * (self.axis.acceleration if runs else self.axis.quick_stop)
        self.speed += min(max(self.target * runs - self.speed, -most), most)
        self.position += self.speed * self.period
        self.listener.motion(self.name, MotionSample(now, self.position, self.speed, 0.0, self.state))
        self.listener.alive(self.name, now)

    def only(self, right, why):
        if not right:
            raise RigError(f"{self.name}: {why}.")

    def enable(self):
        self.only(not self.latch.closed and self.state is not DriveState.QUICK_STOP, "stopped; clear it first")
        self.target, self.state = 0.0, DriveState.ENABLED

    def command(self, speed):  # send, and do not wait; a quick stop of another thread has to win
        self.only(not self.latch.closed and self.state is DriveState.ENABLED, "not enabled")
        self.only(abs(speed) <= self.axis.speed, f"speed = {speed} m/s is none within its limit")
        self.target = speed

    def quick_stop(self, *, for_good=False):
        self.latch.happens(Event.STOP)
        self.state = DriveState.QUICK_STOP

    def disable(self):
        self.target, self.state = 0.0, DriveState.DISABLED

    def close(self):
        self.listener = self.listener and self.timer.stop()

    clear, withhold_heartbeat = disable, lambda self, why: self.quick_stop()  # a device stops by a watch of its own
    limits, about = lambda self: {name: getattr(self.axis, name) for name in LIMIT_NAMES}, lambda self: {"in": "memory"}


if __name__ == "__main__":  # not where a rig's file names the class
    clock, rig = FakeClock(), RigSettings(blade=Axis(driver="own_driver:Stage"))
    findings = conform_motion(Stage(Mounting(role="blade", rig=rig, clock=clock)), rig, clock)
    print(f"{sum(each.kept for each in findings)} of {len(findings)} promises are kept")
    assert sum(each.kept for each in findings) == len(findings) > 30
