"""Window in which a person cuts, by keys, pointers and gamepad."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cutenv.display.viewer.canvas import import_pygame
from cutenv.display.viewer.window import Window, is_seen, open_display
from cutenv.people.play.devices import GamepadDevice, MouseDevice
from cutenv.people.play.haptics import HapticDevice
from cutenv.people.play.picture import LAYOUT, PlayPicture
from cutenv.people.play.play_session import SHARED_TASK, Servo, Session

FPS = 60.0
CARD_SECONDS = 8.0
"""Time [s] for which an end card stays that no key ends, where somebody can see it."""
_FULL_STICK, _FULL_TRIGGER = 32768.0, 32767.0  # SDL's ranges for the axes of a game controller
_NOTCH_HEIGHT = 12.0  # [px] that a finger moves up or down to turn the blade by a notch of the wheel


class PlayWindow:
    """Window of a session.

    If the session's device is a :class:`MouseDevice`, mouse and gamepad replace it when they begin a cut. A scripted
    hand cuts in place of a person by its own clock, a sixtieth of a second for each picture, however long that takes;
    where no display shows them, none is drawn, and it cuts as fast as it can. The window closes by itself when all cuts
    are done and the last card could be read, if it ``ends`` or is scripted.
    """

    def __init__(
        self,
        session: Session,
        *,
        scripted: bool = False,
        ends: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.session = session
        self.scripted = scripted
        self._ends = scripted or ends
        self._clock = clock
        self._pygame: Any = import_pygame()
        self._picture = PlayPicture()
        open_display()
        self._card_pictures = int(CARD_SECONDS * FPS) if is_seen() else 0
        self._draws = is_seen() or not scripted
        self._window = Window(LAYOUT.width, LAYOUT.height, FPS if self._draws else 0.0)
        self._pygame.display.set_caption("cutenv play")
        self.mouse, self.gamepad = MouseDevice(), GamepadDevice()
        self._own_device = isinstance(session.device, MouseDevice)
        self._stick = self._sideways = self._trigger = self._second = 0.0
        self._arrows: set[int] = set()
        self._free = False
        self._pointers: dict[object, tuple[float, float]] = {}  # finger or mouse, and where in the picture it is [px]
        self._pads: list[Any] = []
        self._pictures = self._pictures_of_card = 0
        if not scripted:
            self._open_gamepads()

    def run(self) -> None:
        """Run until closed or done; a cut in progress is recorded."""
        servo = Servo(self.session, self._clock) if self.session.device.coupling is not None else None
        try:
            while self._window.open and (servo is None or servo.error is None):
                if servo is None:
                    self.show_next()
                else:
                    with servo.lock:
                        self.take_events()
                        sight = self.session.sight()
                    self._window.present(self._picture.draw(sight))
                if self._ends and self.session.done and self._card_was_shown():
                    self._window.close()
        finally:
            try:
                if servo is not None:
                    servo.stop()
            finally:
                self.session.close()
                self._window.close()

    def _card_was_shown(self) -> bool:
        return self.session.phase == "ended" and self._pictures_of_card >= self._card_pictures

    def show_next(self) -> None:
        """Show one picture: take events, advance the time, draw."""
        self.take_events()
        if self.scripted:
            self._lead_by_script()
        self.session.advance(self._pictures / FPS if self.scripted else self._clock())
        self._pictures += 1
        if self._draws:
            self._window.present(self._picture.draw(self.session.sight()))

    def save(self, file: Path) -> None:
        """Write the last picture as PNG."""
        self._pygame.image.save(self._picture.draw(self.session.sight()).surface, str(file))

    # Events

    def take_events(self) -> None:
        """Handle keys, mouse, touch and gamepad events of one frame."""
        self._pictures_of_card = self._pictures_of_card + 1 if self.session.phase == "ended" else 0
        for event in self._window.take_events():
            self._take(event)
        if self._window.open:
            busy = self.session.phase in ("countdown", "cutting") and self._own_device and not self.scripted
            # A captured mouse moves on beyond the edge of the screen, and its pointer does not hide the cut. What tells
            # positions alone, as a pen or a remote desktop does, would not move at all: that pointer is left free.
            self._pygame.event.set_grab(busy and not self._free)
            self._pygame.mouse.set_visible(not busy or self._free)

    def _take(self, event: Any) -> None:
        pygame = self._pygame
        of_key = event.type in (pygame.KEYDOWN, pygame.KEYUP)
        if of_key and self.session.cut.third == "across" and event.key in self._ways():
            self._take_arrow(event)
        elif self.session.task == SHARED_TASK and self._takes_over(event):
            pass
        elif event.type == pygame.KEYDOWN:
            self._take_key(event.key)
        elif event.type == pygame.MOUSEMOTION:
            self._take_mouse(event)
        elif event.type in (pygame.FINGERDOWN, pygame.FINGERMOTION, pygame.FINGERUP):
            self._take_finger(event)
        elif event.type == pygame.MOUSEWHEEL and self.session.phase == "cutting":
            self._turn_wheel(event.y)
        elif event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            self._go_on(self.mouse)
        elif event.type == pygame.CONTROLLERAXISMOTION:
            self._take_axis(event.axis, event.value)
        elif event.type == pygame.CONTROLLERBUTTONDOWN and event.button == pygame.CONTROLLER_BUTTON_A:
            self._go_on(self.gamepad)
        elif event.type == pygame.CONTROLLERDEVICEADDED:
            self._open_gamepads()

    def _takes_over(self, event: Any) -> bool:
        """Take the blade from an agent or return it; True if handled."""
        pygame = self._pygame
        ways = {pygame.K_RIGHT: 1.0, pygame.K_LEFT: -1.0}
        if event.type in (pygame.KEYDOWN, pygame.KEYUP) and event.key in (pygame.K_SPACE, *ways):
            held, key = event.type == pygame.KEYDOWN, event.key
        elif event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP) and event.button == 1:
            held, key = event.type == pygame.MOUSEBUTTONDOWN, -1
        elif event.type in (pygame.CONTROLLERBUTTONDOWN, pygame.CONTROLLERBUTTONUP):
            held, key = event.type == pygame.CONTROLLERBUTTONDOWN, -2
            if event.button != pygame.CONTROLLER_BUTTON_A:
                return False
        else:
            return False
        if held and self.session.phase != "cutting":
            return False
        (self._arrows.add if held else self._arrows.discard)(key)
        self.mouse.hold_keys(sum(ways.get(each, 0.0) for each in self._arrows), 0.0)
        self.mouse.held = self.gamepad.held = bool(self._arrows)
        return True

    def _take_key(self, key: int) -> None:
        pygame, session = self._pygame, self.session
        if key in (pygame.K_SPACE, pygame.K_RETURN, pygame.K_KP_ENTER):
            self._go_on(self.mouse)
        elif key == pygame.K_r:
            session.repeat()
        elif key == pygame.K_c:
            session.choose_class()
        elif key == pygame.K_p:
            session.show_hidden()
        elif key == pygame.K_m:
            self._free = not self._free
            self._pointers.clear()
        elif key in (pygame.K_UP, pygame.K_DOWN) and session.phase == "cutting":
            self._turn_wheel(1 if key == pygame.K_UP else -1)
        elif key == pygame.K_ESCAPE:
            self._window.close()

    def _ways(self) -> dict[int, tuple[float, float]]:
        """Return arrow key directions along a line: along, left across."""
        pygame = self._pygame
        return {pygame.K_RIGHT: (1, 0), pygame.K_LEFT: (-1, 0), pygame.K_UP: (0, 1), pygame.K_DOWN: (0, -1)}

    def _take_arrow(self, event: Any) -> None:
        """Move the hand as long as arrow keys are held down."""
        if event.type == self._pygame.KEYDOWN:
            self._arrows.add(event.key)
        else:
            self._arrows.discard(event.key)
        held = [self._ways()[key] for key in self._arrows]
        self.mouse.hold_keys(sum(way[0] for way in held), sum(way[1] for way in held))

    def _turn_wheel(self, notches: float) -> None:
        """Lean or raise the blade; change depth where wanted, without shift."""
        if self.session.cut.third == "level" and not self._pygame.key.get_mods() & self._pygame.KMOD_SHIFT:
            self.mouse.lower(notches)
        else:
            self.mouse.turn(notches)

    def _go_on(self, device: HapticDevice) -> None:
        """Begin the next cut, led by the requesting device."""
        if self.session.phase == "ended" and self.session.done:
            self._window.close()
            return
        if self._own_device and self.session.phase in ("ready", "ended"):
            self.session.device = device
        self.session.go_on()

    def _take_mouse(self, event: Any) -> None:
        if getattr(event, "touch", False):
            return  # of a finger, whose own event comes as well
        if not self._free:
            self._lead(*event.rel)
        else:
            self._lead(*self._moved("mouse", *event.pos))

    def _take_finger(self, event: Any) -> None:
        """Lead the hand by the first finger, the wheel by others."""
        finger = event.finger_id
        if event.type == self._pygame.FINGERUP:
            self._pointers.pop(finger, None)
            return
        width, height = self._window.size
        across, down = self._moved(finger, event.x * width, event.y * height)
        if finger == next(key for key in self._pointers if key != "mouse"):
            self._lead(across, down)
        elif self.session.phase == "cutting":
            self._turn_wheel(-down / _NOTCH_HEIGHT)

    def _moved(self, pointer: object, x: float, y: float) -> tuple[float, float]:
        """Return a pointer's motion in the picture [px], zero if new."""
        here = self._window.in_picture(x, y)
        before = self._pointers.get(pointer, here)
        self._pointers[pointer] = here
        return here[0] - before[0], here[1] - before[1]

    def _lead(self, across: float, down: float) -> None:
        """Move the hand by picture pixels, vertically only when steered."""
        if self.session.phase == "cutting":
            aside = -down / LAYOUT.scale if self.session.cut.third == "across" else 0.0
            self.mouse.move(across / LAYOUT.scale, aside)

    def _take_axis(self, axis: int, value: int) -> None:
        if axis == self._pygame.CONTROLLER_AXIS_LEFTX:
            self._stick = value / _FULL_STICK
        elif axis == self._pygame.CONTROLLER_AXIS_LEFTY and self.session.cut.third == "across":
            self._sideways = value / _FULL_STICK
        elif axis == self._pygame.CONTROLLER_AXIS_TRIGGERRIGHT:
            self._trigger = max(value, 0) / _FULL_TRIGGER
        elif axis == self._pygame.CONTROLLER_AXIS_RIGHTY:
            self._second = value / _FULL_STICK
        self.gamepad.hold(self._stick, self._trigger, self._second, self._sideways)

    def _open_gamepads(self) -> None:
        from pygame._sdl2 import controller  # its axes mean the same on every pad, unlike a joystick's

        controller.init()
        self._pads = [controller.Controller(i) for i in range(controller.get_count()) if controller.is_controller(i)]

    def _lead_by_script(self) -> None:
        if self.session.phase == "ready" or (self._card_was_shown() and not self.session.done):
            if self.session.phase == "ended":
                self.session.go_on()
            self.session.device = self.session.cut.simple_hand()
            self.session.begin()
