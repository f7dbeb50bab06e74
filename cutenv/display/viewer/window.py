"""Window that shows pictures at a steady rate, and a cut in it."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv.display.viewer import palette, views
from cutenv.display.viewer.canvas import Canvas, import_pygame
from cutenv.display.viewer.drawn_slab import Slab, drawn_slab_of
from cutenv.display.viewer.scene import ForceTrace, Layout, Moment
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.task.episode import Episode

_SHARE = 0.92  # of a screen that a window may fill: the rest is for bars and frames
_CURE = "Run it on a desktop, or over ssh -X; SDL_VIDEODRIVER=dummy draws without a window."


_UNSEEN = ("dummy", "offscreen")  # video drivers of SDL that show nothing


def open_display() -> None:
    """Open the display; a second time does nothing.

    Raises OSError if there is no display: SDL would draw invisibly and wait for keys for ever, which the variable
    SDL_VIDEODRIVER allows.
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


def is_seen() -> bool:
    """Return whether the display's windows are visible to anybody."""
    seen: bool = import_pygame().display.get_driver() not in _UNSEEN
    return seen


class Window:
    """Single window of pygame's display, opened at construction.

    It can be resized, and F11 fills the screen.

    A picture is scaled to the window and keeps its proportions. On a screen that has room for a multiple of it, the
    window opens at that multiple; on one that is too small, as large as the screen. Sizes in px; showing a picture
    waits until it is due, with 0 pictures per second never. It is ``open`` until closed, by :meth:`close` or by the
    person.
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
        width, height = self._picture
        across, down = self._pygame.display.get_desktop_sizes()[0]
        factor = min(across / width, down / height)
        if factor > 1.0:
            factor = max(int(_SHARE * factor), 1)
        return round(factor * width), round(factor * height)

    def _fit(self) -> tuple[float, int, int]:
        """Return the pictures' scale, and their corner in the window [px]."""
        (across, down), (width, height) = self.size, self._picture
        factor = min(across / width, down / height)
        return factor, round(0.5 * (across - factor * width)), round(0.5 * (down - factor * height))

    def show(self, canvas: Canvas) -> None:
        """Show a canvas, dropping earlier keys; do nothing if closed."""
        # Take all events, because a full queue would hide the one that closes the window.
        self.take_events()
        self.present(canvas)

    def take_events(self) -> list[Any]:
        """Return new pygame events; a close request closes the window, F11 changes it."""
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
        """Return the picture's place of a window's place [px]."""
        factor, left, top = self._fit()
        return (x - left) / factor, (y - top) / factor

    def present(self, canvas: Canvas) -> None:
        """Show a canvas until the next is due; skip if closed."""
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


_SHOWN = ("truth", "force")
_SIDE_HEIGHT = 116  # [px] of the view from the side


class CutViewer:
    """Viewer that draws a cut as array or in a window.

    From above, the tissue is displaced according to the finite-element model, at one scale with the ruler; the open cut
    is only an illustration. From the side the tissue is at rest, so that the tip and the blade that displaces it are
    apart by the lag. A cut along a drawn line is seen in its places from above, with the tissue at rest. The force is
    below, over the position of the blade. The tip is hidden from agents, and marked so.

    Parameters
    ----------
    window : bool
        True to open a window. Closing it ends the drawing in it and not the cut. Without one no display is used.
    fps : float
        Pictures per second of the window; drawing waits until the next one is due.

    Raises
    ------
    ImportError
        If pygame is not installed.
    """

    def __init__(self, *, window: bool = False, fps: float = 50.0) -> None:
        self.layout = Layout()
        self._canvas = Canvas(self.layout.width, self.layout.height, palette.PAPER)
        self._window = Window(self.layout.width, self.layout.height, fps) if window else None
        self._cutting: Episode | None = None
        self._slab: Slab
        self._trace: ForceTrace
        self._standing: Canvas

    def draw(self, plant: SimulatedPlant, cutting: Episode, readings: StructArray | None = None) -> NDArray[np.uint8]:
        """Draw the present moment.

        Parameters
        ----------
        plant, cutting : SimulatedPlant, Episode
            The cut.
        readings : StructArray, optional
            Every reading since the last picture, shape (n,), whose force is drawn; default those of the last step.

        Returns
        -------
        ndarray of shape (720, 960, 3)
            Red, green, blue, 0 to 255.
        """
        moment = Moment.of(plant, cutting)
        fresh = cutting is not self._cutting
        if fresh:
            self._cutting = cutting
            self._trace = ForceTrace()
            self.layout = Layout() if moment.shown_depth is None else Layout().with_depth()
            self._slab = drawn_slab_of(plant.specimen.cut_model())
        scale = self._trace.low, self._trace.high
        felt = self._trace.add(cutting.readings if readings is None else readings)
        if fresh or (self._trace.low, self._trace.high) != scale:
            self._standing = self._draw_standing(moment)
            views.draw_force(self._standing, self.layout, self._trace, self._trace.whole())
        elif felt:
            views.draw_force(self._standing, self.layout, self._trace, self._trace.latest())

        canvas, layout = self._canvas, self.layout
        canvas.paste(self._standing)
        sheet = views.Sheet(canvas, layout, moment.quantities(), (*_SHOWN, *moment.conditions))
        above = None
        if moment.shown_path is None:
            views.draw_from_above(sheet, self._slab)
        else:
            views.draw_plan(sheet, moment.shown_path, self._slab)
            above = views.PLAN_TITLE
        box = layout.blade_end - _SIDE_HEIGHT, layout.column - 20
        views.draw_from_the_side(sheet, box)
        views.draw_titles(sheet, self._slab.model.width, box[0] - 11, above=above)
        views.draw_present(canvas, layout, moment, self._trace)
        views.draw_header(canvas, layout, moment)
        views.draw_numbers(canvas, layout, moment)
        views.draw_reward(canvas, layout, moment)
        if self._window is not None:
            self._window.show(canvas)
        return canvas.picture()

    def _draw_standing(self, moment: Moment) -> Canvas:
        layout, model = self.layout, self._slab.model
        canvas = Canvas(layout.width, layout.height, palette.PAPER)
        views.draw_clamp(canvas, layout, model.width)
        shown = (*moment.conditions, "layer") if moment.conditions else ()
        views.draw_parts(views.Sheet(canvas, layout, moment.quantities(), shown), "side", standing=True)
        views.draw_ruler(canvas, layout, model.length)
        views.draw_axes(canvas, layout, moment, self._trace)
        views.draw_legend(canvas, layout)
        return canvas

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
