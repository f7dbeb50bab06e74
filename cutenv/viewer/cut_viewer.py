"""Viewer of a cut: slab from above, blade from the side, force along the cut, numbers and reward."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv.plant.simulator import SimulatedPlant
from cutenv.task.episode import Episode
from cutenv.viewer import chart, palette, plan_view, readout, views
from cutenv.viewer.canvas import Canvas
from cutenv.viewer.drawn_slab import Slab, drawn_slab_of
from cutenv.viewer.scene import ForceTrace, Layout, Moment
from cutenv.viewer.window import Window

_SHOWN = ("truth", "force")
_SIDE_HEIGHT = 116  # [px] of the view from the side


class CutViewer:
    """Viewer that draws a simulated cut as an array and, on request, in a window.

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
        readings : Records, optional
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
            chart.draw_force(self._standing, self.layout, self._trace, self._trace.whole())
        elif felt:
            chart.draw_force(self._standing, self.layout, self._trace, self._trace.latest())

        canvas, layout = self._canvas, self.layout
        canvas.paste(self._standing)
        sheet = views.Sheet(canvas, layout, moment.quantities(), (*_SHOWN, *moment.conditions))
        above = None
        if moment.shown_path is None:
            views.draw_from_above(sheet, self._slab)
        else:
            plan_view.draw_plan(sheet, moment.shown_path, self._slab)
            above = plan_view.TITLE
        box = layout.blade_end - _SIDE_HEIGHT, layout.column - 20
        views.draw_from_the_side(sheet, box)
        views.draw_titles(sheet, self._slab.model.width, box[0] - 11, above=above)
        chart.draw_present(canvas, layout, moment, self._trace)
        readout.draw_header(canvas, layout, moment)
        readout.draw_numbers(canvas, layout, moment)
        readout.draw_reward(canvas, layout, moment)
        if self._window is not None:
            self._window.show(canvas)
        return canvas.picture()

    def _draw_standing(self, moment: Moment) -> Canvas:
        """Draw what does not change during a cut; the force is added to it later."""
        layout, model = self.layout, self._slab.model
        canvas = Canvas(layout.width, layout.height, palette.PAPER)
        views.draw_clamp(canvas, layout, model.width)
        shown = (*moment.conditions, "layer") if moment.conditions else ()
        views.draw_parts(views.Sheet(canvas, layout, moment.quantities(), shown), "side", standing=True)
        views.draw_ruler(canvas, layout, model.length)
        chart.draw_axes(canvas, layout, moment, self._trace)
        readout.draw_legend(canvas, layout)
        return canvas

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
