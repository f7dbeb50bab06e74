"""Window that shows pictures at a steady rate."""

from __future__ import annotations

import os
from typing import Any

from cutenv.viewer.canvas import Canvas, import_pygame

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
    """Single window of pygame's display, opened at construction.

    Parameters
    ----------
    width, height : int
        Size [px].
    fps : float
        Pictures per second; showing one waits until it is due; 0: no waiting.

    Attributes
    ----------
    open : bool
        False after the window was closed, by `close` or by the person.
    """

    def __init__(self, width: int, height: int, fps: float) -> None:
        self._pygame: Any = import_pygame()
        open_display()
        self._screen = self._pygame.display.set_mode((width, height))
        self._pygame.display.set_caption("cutenv")
        self._clock = self._pygame.time.Clock()
        self._fps = fps
        self.open = True

    def show(self, canvas: Canvas) -> None:
        """Show a canvas, ignoring keys pressed since the last one; do nothing if the window is closed."""
        # Take all events, because a full queue would hide the one that closes the window.
        self.take_events()
        self.present(canvas)

    def take_events(self) -> list[Any]:
        """Return pygame's events since the last call; one that asks to close the window closes it."""
        events: list[Any] = self._pygame.event.get() if self.open else []
        if any(event.type == self._pygame.QUIT for event in events):
            self.close()
        return events

    def present(self, canvas: Canvas) -> None:
        """Show a canvas and wait until the next is due; do nothing if the window is closed."""
        if not self.open:
            return
        self._screen.blit(canvas.surface, (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Close the window; further calls do nothing."""
        if self.open:
            self.open = False
            self._pygame.display.quit()
