"""Pictures and pages of what happened."""

from cutenv.report.cut_figure import draw_cut

__all__ = ["draw_cut"]
