"""Pictures and pages of what happened."""

from cutenv.report.cut_figure import draw_cut
from cutenv.report.training_page import CutPicture, TrainingResult, write_training_page

__all__ = ["CutPicture", "TrainingResult", "draw_cut", "write_training_page"]
