"""Window that shows pictures at a steady rate."""

from __future__ import annotations

import os
from typing import Any

from cutenv.viewer import palette
from cutenv.viewer.canvas import Canvas, import_pygame

_SHARE = 0.92  # of a screen that a window may fill: the rest is for bars and frames
_CURE = "Run it on a desktop, or over ssh -X; SDL_VIDEODRIVER=dummy draws without a window."


_UNSEEN = ("dummy", "offscreen")  # video drivers of SDL that show nothing


def open_display() -> None:
    """Open the display; a second time does nothing.

    Raises
    ------
    OSError
        If there is no display. SDL would draw invisibly and wait for keys for ever; the variable SDL_VIDEODRIVER
        allows that.
    """
    pygame: Any = import_pygame()
    try:
        pygame.display.init()
    except pygame.error as error:
        raise OSError(f"no window can be opened: {error}. {_CURE}") from None
    driver = pygame.display.get_driver()
    if driver in _UNSEEN and driver != os.environ.get("SDL_VIDEODRIVER"):
        pygame.display.quit()
        raise OSError(f"no window can be opened: there is no display. {_CURE}")


class Window:
    """Single window of pygame's display, opened at construction; it can be resized, and F11 fills the screen.

    A picture is scaled to the window and keeps its proportions. On a screen that has room for a multiple of it, the
    window opens at that multiple; on one that is too small, as large as the screen.

    Parameters
    ----------
    width, height : int
        Size of the pictures [px].
    fps : float
        Pictures per second; showing one waits until it is due; 0: no waiting.

    Attributes
    ----------
    open : bool
        False after the window was closed, by `close` or by the person.
    full_screen : bool
        True while the window fills the screen.
    """

    def __init__(self, width: int, height: int, fps: float) -> None:
        self._pygame: Any = import_pygame()
        open_display()
        self._picture = width, height
        self._pygame.display.set_mode(self._size(), self._pygame.RESIZABLE)
        self._pygame.display.set_caption("cutenv")
        self._clock = self._pygame.time.Clock()
        self._fps = fps
        self.open, self.full_screen = True, False

    def _size(self) -> tuple[int, int]:
        """Return the size at which the window opens [px]."""
        width, height = self._picture
        across, down = self._pygame.display.get_desktop_sizes()[0]
        factor = min(across / width, down / height)
        if factor > 1.0:
            factor = max(int(_SHARE * factor), 1)
        return round(factor * width), round(factor * height)

    def _fit(self) -> tuple[float, int, int]:
        """Return the factor by which pictures are scaled, and where in the window their corner is [px]."""
        (across, down), (width, height) = self.size, self._picture
        factor = min(across / width, down / height)
        return factor, round(0.5 * (across - factor * width)), round(0.5 * (down - factor * height))

    def show(self, canvas: Canvas) -> None:
        """Show a canvas, ignoring keys pressed since the last one; do nothing if the window is closed."""
        # Take all events, because a full queue would hide the one that closes the window.
        self.take_events()
        self.present(canvas)

    def take_events(self) -> list[Any]:
        """Return pygame's events since the last call; one that asks to close the window closes it, F11 changes it."""
        events: list[Any] = self._pygame.event.get() if self.open else []
        if any(event.type == self._pygame.QUIT for event in events):
            self.close()
        elif any(event.type == self._pygame.KEYDOWN and event.key == self._pygame.K_F11 for event in events):
            self.change_full_screen()
        return events

    def change_full_screen(self) -> None:
        """Fill the screen, or be a window again."""
        self.full_screen = not self.full_screen
        size, flags = (0, 0), self._pygame.FULLSCREEN
        if not self.full_screen:
            size, flags = self._size(), self._pygame.RESIZABLE
        self._pygame.display.set_mode(size, flags)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the window [px]."""
        size: tuple[int, int] = self._pygame.display.get_window_size()
        return size

    def in_picture(self, x: float, y: float) -> tuple[float, float]:
        """Return the place in the picture that a place in the window shows, both in pixels."""
        factor, left, top = self._fit()
        return (x - left) / factor, (y - top) / factor

    def present(self, canvas: Canvas) -> None:
        """Show a canvas and wait until the next is due; do nothing if the window is closed."""
        if not self.open:
            return
        screen = self._pygame.display.get_surface()
        factor, left, top = self._fit()
        screen.fill(palette.PAPER)
        if factor == 1.0:
            screen.blit(canvas.surface, (left, top))
        else:
            size = tuple(round(factor * side) for side in canvas.surface.get_size())
            screen.blit(self._pygame.transform.smoothscale(canvas.surface, size), (left, top))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window; further calls do nothing."""
        if self.open:
            self.open = False
            self._pygame.display.quit()
