"""Words about a course, in each language of the class's pages."""

from __future__ import annotations

from collections.abc import Mapping

COURSE_WORDS: Mapping[str, Mapping[str, str]] = {
    "en": {
        "done": "Course {course!r}: all {count} tasks are done.",
        "over": "Course {course!r}: all tasks are over; {reached} of {count} reached.",
        "attempt": "Attempt {nth} of {of}.",
        "moment": "%Y-%m-%d, %H:%M",
        "opens": "It opens on {moment}.",
        "closes": "It closes on {moment}.",
        "ahead": "Task {number} of {count}, {name}: {demand}{so_far}. Force: {force}.",
        "so far": ", {done} of {times} so far",
        "along a wanted depth": "Along the dashed depth.",
        "along a drawn line": "Along the dashed line.",
        "one cut": "1 cut",
        "cuts": "{times} cuts",
        "in a row": "{limits}, {cuts} in a row",
        "and": " and ",
        "at least": "{name} {limit} or more",
        "at most": "{name} {limit} or less",
        "unknown": "{limit}: not known",
        "here": "{limit}: here {value}",
        "counts": "This cut counts.",
        "counts not": "Not counted: the cut was given up.",
        "reached": "Mark reached.",
        "missed": "Mark missed.",
        "missed by": "Mark missed: {misses}.",
        "given up": "given up",
        "always": "shown",
        "above-limit": "shown where it costs",
        "afterwards": "shown after the cut",
        "never": "not shown",
        "overall_score": "score",
    },
    "de": {
        "done": "Kurs „{course}“: Alle {count} Aufgaben sind geschafft.",
        "over": "Kurs „{course}“: Alle Aufgaben sind vorbei; {reached} von {count} geschafft.",
        "attempt": "Versuch {nth} von {of}.",
        "moment": "%d.%m.%Y, %H:%M",
        "opens": "Sie öffnet am {moment}.",
        "closes": "Sie schließt am {moment}.",
        "ahead": "Aufgabe {number} von {count}, {name}: {demand}{so_far}. Kraft: {force}.",
        "so far": ", bisher {done} von {times}",
        "along a wanted depth": "In der gestrichelten Tiefe.",
        "along a drawn line": "Entlang der gestrichelten Linie.",
        "one cut": "1 Schnitt",
        "cuts": "{times} Schnitte",
        "in a row": "{limits}, {cuts} hintereinander",
        "and": " und ",
        "at least": "{name} mindestens {limit}",
        "at most": "{name} höchstens {limit}",
        "unknown": "{limit}: nicht bekannt",
        "here": "{limit}: hier {value}",
        "counts": "Dieser Schnitt zählt.",
        "counts not": "Zählt nicht: Der Schnitt wurde aufgegeben.",
        "reached": "Vorgabe erreicht.",
        "missed": "Vorgabe verfehlt.",
        "missed by": "Vorgabe verfehlt: {misses}.",
        "given up": "aufgegeben",
        "always": "gezeigt",
        "above-limit": "gezeigt, wo sie kostet",
        "afterwards": "nach dem Schnitt gezeigt",
        "never": "nicht gezeigt",
        "overall_score": "Punkte",
        "peak_force_per_depth": "größte Kraft je Tiefe",
        "mean_force_per_depth": "mittlere Kraft je Tiefe",
        "rms_force_per_depth": "quadratisches Mittel der Kraft je Tiefe",
        "peak_force": "größte Kraft",
        "force_time_integral": "Zeitintegral der Kraft",
        "force_variation": "Schwankung der Kraft",
        "force_drops": "plötzliche Abfälle der Kraft",
        "mean_force_drop": "mittlerer Abfall der Kraft",
        "force_rate": "Anstieg der Kraft",
        "force_jerk": "Ruck der Kraft",
        "duration": "Dauer",
        "idle_time": "Zeit ohne Bewegung",
        "reversals": "Richtungswechsel",
        "haste": "Anhalteweg der Klinge",
        "tip_error": "Abstand der Spitze vom Ziel",
        "overshoot": "Schnitt über das Ziel hinaus",
        "wedge": "Keil",
        "uncontrolled_share": "Anteil der plötzlichen Sprünge",
        "largest_jump": "längster plötzlicher Sprung",
        "mean_lag": "mittlerer Rückstand der Spitze",
        "work_over_fracture": "Arbeit je Brucharbeit",
        "mean_depth_error": "mittlerer Fehler der Tiefe",
        "rms_depth_error": "quadratisches Mittel des Fehlers der Tiefe",
        "largest_depth_error": "größter Fehler der Tiefe",
        "too_deep_area": "zu tief geschnittene Fläche",
        "uncut_area": "ungeschnittene Fläche",
        "layer_area": "geöffnete Fläche der Schicht darunter",
        "layer_depth": "Tiefe in der Schicht darunter",
        "peak_vertical_force": "größte senkrechte Kraft",
        "mean_line_distance": "mittlerer Abstand zur Linie",
        "largest_line_distance": "größter Abstand zur Linie",
        "line_area": "Fläche zwischen Schnitt und Linie",
        "peak_lateral_force": "größte Kraft zur Seite",
    },
}
"""Sentences, rules of feedback and names of metrics; a metric without a word is called as in the table of metrics."""


def course_words(language: str, key: str, **values: object) -> str:
    """Return a sentence or a name of :data:`COURSE_WORDS`, filled with values."""
    return COURSE_WORDS[language].get(key, key.replace("_", " ")).format(**values)


_SHIPPED_NAMES: Mapping[str, Mapping[str, str]] = {
    "de": {
        "first cuts": "erste Schnitte",
        "even tissue": "gleichmäßiges Gewebe",
        "liver": "Leber",
        "liver, force above the limit": "Leber, Kraft über der Grenze",
        "liver, force afterwards": "Leber, Kraft hinterher",
        "vessels": "Gefäße",
        "force shown or not": "Kraft gezeigt oder nicht",
        "warm-up": "Aufwärmen",
        "first half": "erste Hälfte",
        "second half": "zweite Hälfte",
        "wanted depth": "gewünschte Tiefe",
        "gently": "schonend",
        "to a depth": "auf eine Tiefe",
        "to a depth in liver": "auf eine Tiefe in Leber",
        "to a depth, force afterwards": "auf eine Tiefe, Kraft hinterher",
        "drawn lines": "gezeichnete Linien",
        "along an arc": "entlang eines Bogens",
        "along an S in liver": "entlang eines S in Leber",
        "an excision, force afterwards": "eine Exzision, Kraft hinterher",
    }
}


def course_name(language: str, name: str) -> str:
    """Return the name of a course or a task in a language if it comes with cutenv; a teacher's own stays as it is."""
    return _SHIPPED_NAMES.get(language, {}).get(name, name)
