"""Figures and pages of results."""

from cutenv.display.report.record_figure import RecordPicture, draw_cut, draw_pictures, draw_record
from cutenv.display.report.training_page import CutPicture, TrainingResult, training_headline, write_training_page

__all__ = [
    "CutPicture",
    "RecordPicture",
    "TrainingResult",
    "draw_cut",
    "draw_pictures",
    "draw_record",
    "training_headline",
    "write_training_page",
]
