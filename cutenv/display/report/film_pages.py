"""Pages of filmed cuts.

Depth of cut, and beads beside the model.

The depth is shown above the force, with frames and what was found in them, and as a table. Beads are compared with the
model, and the modulus is measured twice.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cutenv.display.report.page import (
    PHONE_WIDTH,
    estimate_text,
    new_figure,
    plain_axes,
    write_page,
    write_table,
    write_text,
)
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.trace import Trace
from cutenv.vision import BeadTracks
from cutenv.vision.field_comparison import (
    FieldComparison,
    FilmedMeasurement,
    ImageModuli,
    MeanModulus,
    ZoneModuli,
    compare_field,
    estimate_zone_moduli,
    even_borders,
    measure_filmed_cut,
    zones_as_measured,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from cutenv.vision.depth_record import FilmedDepth, RunsAndDrops
    from cutenv.vision.marked_blade import DepthFrame


_STRIP, _SURFACE, _BLADE, _ALONG, _OUT = "#e69f00", "#56b4e9", "#d55e00", "#8a3ffc", "#b00020"
_POINTS = 3000  # points of a line: more than a figure has pixels
_AROUND = 140  # of the blade that is shown to either side [px]


def frames_figure(filmed: FilmedDepth, pictures: Mapping[int, NDArray[np.uint8]], width: float) -> Figure:
    """Draw frames with strip, surface, exposed blade, or reason of omission.

    Pictures are grey values by number of the frame, shape (height, width), of a pair the left one.
    """
    shown = [frame for frame in filmed.frames if frame.number in pictures]
    columns = 2 if width < PHONE_WIDTH else max(len(shown), 1)
    rows = -(-len(shown) // columns)
    figure = new_figure(width, rows * (width / columns + 0.5))
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes in panels:
        axes.set_axis_off()
    for axes, frame in zip(panels, shown, strict=False):
        _draw_frame(axes, frame, pictures[frame.number])
    return figure


def _draw_frame(axes: Axes, frame: DepthFrame, picture: NDArray[np.uint8]) -> None:
    axes.imshow(picture, cmap="gray", vmin=0, vmax=255, interpolation="nearest")
    if frame.blade is None:
        axes.set_title(f"{frame.time:.2f} s, left out:\n{frame.reason}", fontsize=7, color=_OUT)
        return
    view = frame.blade.view
    axes.plot(*np.stack([view.strip, view.surface]).T, color=_BLADE, linewidth=1.0)
    axes.plot(*view.strip_ends.T, color=_STRIP, linewidth=3.0)
    axes.plot(*view.surface_line.T, color=_SURFACE, linewidth=1.6)
    middle = 0.5 * (view.strip + view.surface)
    axes.set_xlim(middle[0] - _AROUND, middle[0] + _AROUND)
    axes.set_ylim(middle[1] + _AROUND, middle[1] - _AROUND)
    axes.set_title(f"{frame.time:.2f} s: {1e3 * frame.blade.exposed:.2f} mm\nexposed", fontsize=7)


def depth_figure(trace: Trace, filmed: FilmedDepth, found: RunsAndDrops, width: float) -> Figure:
    """Draw depth and length along the blade, frames left out, runs and force."""
    figure = new_figure(width, 5.0)
    depth, force = figure.subplots(2, 1, sharex=True, height_ratios=(1.6, 1.0))
    band: dict[str, Any] = {"color": _SURFACE, "alpha": 0.35, "linewidth": 0.0}
    vertical, sd = 1e3 * filmed.vertical, 2e3 * filmed.vertical_sd
    depth.fill_between(filmed.time, vertical - sd, vertical + sd, label="two standard errors", **band)
    depth.plot(filmed.time, 1e3 * filmed.along, ".", markersize=2.0, color=_ALONG, label="along the blade")
    step = max(1, len(trace) // _POINTS)
    (recorded,) = trace.require("depth", by="the figure")
    depth.plot(trace.time[::step], 1e3 * recorded[::step], color="#0072b2", linewidth=1.0, label="vertical")
    out = [frame.time + filmed.alignment.lag for frame in filmed.frames if frame.blade is None]
    depth.plot(out, np.zeros(len(out)), "|", markersize=8.0, color=_OUT, label="frames left out")
    depth.set_ylabel("depth of cut [mm]")
    force.plot(trace.time[::step], trace.force[::step], color="0.4", linewidth=0.9)
    marks = (([run.time for run in found.runs], "v", "run seen"), (found.drops, "|", "force drops"))
    for (times, marker, label), height, colour in zip(marks, (1.16, 1.08), (_STRIP, "0.4"), strict=True):
        at = np.full(len(times), height * float(trace.force.max()))
        force.plot(times, at, marker, markersize=5.0, color=colour, label=label)
    force.set_ylabel("force [N]" if trace.force_unit == "N" else "force")
    force.set_xlabel("time [s]")
    for axes in (depth, force):
        plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 4, frameon=False, fontsize=9)
    return figure


FRAME_COLUMNS = (
    "frame", "film_s", "time_s", "exposed_mm", "exposed_sd_mm", "along_mm", "along_sd_mm", "vertical_mm",
    "vertical_sd_mm", "left_out",
)  # fmt: skip
"""Columns of the table of frames; a frame that is left out has its reason and no lengths."""


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedRecord:
    """Record with depth and runs from a film, and some frames by number."""

    name: str
    trace: Trace
    filmed: FilmedDepth
    found: RunsAndDrops
    pictures: Mapping[int, NDArray[np.uint8]]


def write_depth_page(path: Path, record: FilmedRecord) -> None:
    """Write the page of a filmed cut into an existing folder."""
    filmed = record.filmed
    share = len(filmed.time) / len(filmed.frames)
    write_page(
        path,
        "depth.html",
        *(frames_figure, depth_figure),
        kind="good" if share >= 0.9 else "open",
        degrees=math.degrees(filmed.alignment.angle),
        low=1e3 * max(float(filmed.vertical.min()), 0.0),
        high=1e3 * float(filmed.vertical.max()),
        share=100.0 * share,
        **vars(record),
    )


def write_frame_table(path: Path, filmed: FilmedDepth) -> None:
    """Write :data:`FRAME_COLUMNS` of every frame as CSV."""
    used = iter(zip(filmed.along, filmed.along_sd, filmed.vertical, filmed.vertical_sd, strict=True))
    rows: list[Sequence[object]] = [FRAME_COLUMNS]
    for frame in filmed.frames:
        clock = [f"{frame.time:.5f}", f"{frame.time + filmed.alignment.lag:.5f}"]
        lengths = [""] * 6
        if frame.blade is not None:
            values = (frame.blade.exposed, frame.blade.exposed_sd, *next(used))
            lengths = [f"{1e3 * value:.4f}" for value in values]
        rows.append([frame.number, *clock, *lengths, frame.reason])
    write_table(path, rows)


_FORCE, _IMAGE, _ZONES, _TRUTH = "#d55e00", "#0072b2", "#009e73", "0.35"
_TRACKED, _COMPUTED = "#0072b2", "#d55e00"

FIELD_SCHEMA = "cutenv.field/1"
"""Name and version of the JSON beside the page."""

TRUTH_KEY = "modulus_put_in_Pa"
"""Key in the metadata of tracks for the modulus that a virtual cut was given [Pa]."""

_AGREES = 0.1  # relative difference up to which both moduli count as one


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldResult:
    """One filmed cut, measured."""

    name: str
    measured: FilmedMeasurement
    image: ImageModuli
    compared: FieldComparison  # with the estimated zones, or else those of the ramps' own moduli
    zones: ZoneModuli | None  # if they were asked for
    truth: float | None  # modulus that was put in [Pa]

    @classmethod
    def of(
        cls,
        tracks: BeadTracks,
        trace: Trace,
        model: CutModel,
        *,
        thickness: float | None = None,
        zones: int | None = None,
        truth: float | None = None,
    ) -> FieldResult:
        """Measure a cut by its force and by its beads.

        The modulus that was put in [Pa] is by default that of the tracks' metadata. Raises ValueError if tracks and
        record are not of one cut, lack what is needed, or do not allow so many zones.
        """
        measured = measure_filmed_cut(tracks, trace, model, thickness=thickness)
        image = measured.by_image()
        estimated = None if zones is None else estimate_zone_moduli(measured, even_borders(measured, zones))
        if estimated is None:
            borders, moduli = zones_as_measured(measured.moduli)
        else:
            borders, moduli = estimated.borders, estimated.modulus
        known = tracks.metadata.get(TRUTH_KEY) if truth is None else truth
        return cls(
            name=str(trace.metadata.get("name") or "cut"),
            measured=measured,
            image=image,
            compared=compare_field(measured, borders, moduli),
            zones=estimated,
            truth=None if known is None else float(known),
        )

    @property
    def by_force(self) -> MeanModulus:
        """Mean modulus by force, over the ramps that beads measured too."""
        return MeanModulus.of(self.measured.by_force[self.image.ramp])

    @property
    def by_image(self) -> MeanModulus:
        """Mean modulus by force and motion of the beads."""
        return MeanModulus.of(self.image.modulus)

    @property
    def flags(self) -> tuple[str, ...]:
        """Remarks on what weakens the result, each once."""
        unknown = self.zones.unknown if self.zones is not None else ()
        return tuple(dict.fromkeys((*self.measured.moduli.flags, *self.compared.flags, *unknown)))

    @property
    def agrees(self) -> bool:
        """True if both moduli differ by at most 10 %."""
        return abs(math.log(self.by_image.mean / self.by_force.mean)) <= math.log1p(_AGREES)

    def headline(self) -> str:
        """Return a sentence on modulus and field."""
        put_in = "" if self.truth is None else f", put in {self.truth / 1e3:.1f} kPa"
        return (
            f"Modulus by force {kilopascals(self.by_force)} kPa, by image {kilopascals(self.by_image)} kPa{put_in}; "
            f"{len({*self.compared.rises.bead.tolist()})} beads differ from the model by "
            f"{1e3 * self.compared.rms():.2f} mm (RMS)."
        )

    def to_json(self) -> str:
        """Return the result as JSON, with units in names."""
        field = self.compared
        content: dict[str, Any] = {
            "schema": FIELD_SCHEMA,
            "name": self.name,
            "modulus_put_in_Pa": self.truth,
            "modulus_by_force_Pa": _interval(self.by_force),
            "modulus_by_image_Pa": _interval(self.by_image),
            "field": {
                "rms_m": field.rms(),
                "rms_near_m": _finite(field.rms(field.near)),
                "rms_far_m": _finite(field.rms(field.far)),
                "noise_m": field.noise,
                "slope": _finite(field.slope),
                "correlation": field.correlation,
            },
            "beads": [vars(row) for row in field.table()],
            "zones": None if self.zones is None else _zones(self.zones),
            "flags": list(self.flags),
        }
        return json.dumps(content, indent=1, allow_nan=False)


def write_field_page(path: Path, result: FieldResult) -> Path:
    """Write the result as self-contained page and as JSON, whose path is returned."""
    write_page(
        path,
        "field.html",
        *(kilopascals, estimate_text, bead_map, moduli_figure),
        result=result,
    )
    data = path.with_suffix(".json")
    write_text(data, result.to_json() + "\n")
    return data


def kilopascals(modulus: MeanModulus) -> str:
    """Return a mean modulus with its interval [kPa]."""
    if not math.isfinite(modulus.high):
        return f"{modulus.mean / 1e3:.1f}"
    return estimate_text(modulus.mean / 1e3, modulus.low / 1e3, modulus.high / 1e3, 1)


def _interval(modulus: MeanModulus) -> dict[str, Any]:
    return {"mean": modulus.mean, "low": modulus.low, "high": _finite(modulus.high), "ramps": modulus.ramps}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _zones(zones: ZoneModuli) -> dict[str, Any]:
    names = ("modulus", "low", "high", "prior")
    units = {f"{name}_Pa": getattr(zones, name).tolist() for name in names}
    return {"borders_m": zones.borders.tolist(), **units, "learned": zones.learned.tolist(), "unknown": zones.unknown}


def moduli_figure(result: FieldResult, width: float) -> Figure:
    """Draw moduli by force and by image; zones and value put in."""
    tips, image, zones, truth = result.measured.tips, result.image, result.zones, result.truth
    figure = new_figure(width, 3.6)
    axes = figure.subplots()
    axes.plot(100 * tips, result.measured.by_force / 1e3, "o", color=_FORCE, markersize=5, label="by force")
    axes.errorbar(
        100 * image.position, image.modulus / 1e3, 1.96 * image.standard_error / 1e3,
        fmt="s", color=_IMAGE, markersize=4, elinewidth=1.0, label="by image",
    )  # fmt: skip
    if zones is not None:
        edges = 100 * np.concatenate(([0.0], zones.borders, [float(tips.max()) + 0.01]))
        for i, (low, high) in enumerate(zip(zones.low, zones.high, strict=True)):
            axes.fill_between(edges[i : i + 2], low / 1e3, high / 1e3, color=_ZONES, alpha=0.25, linewidth=0)
        axes.stairs(zones.modulus / 1e3, edges, color=_ZONES, label="zones, by both", baseline=None)
    if truth is not None:
        axes.axhline(truth / 1e3, color=_TRUTH, linestyle="--", linewidth=1.0, label="put in")
    axes.set_xlabel("tip from the clamp [cm]")
    axes.set_ylabel("modulus [kPa]")
    axes.set_ylim(bottom=0.0)
    plain_axes(axes)
    figure.legend(loc="outside upper left", ncols=2 if width < PHONE_WIDTH else 4, frameon=False, fontsize=9)
    return figure


def bead_map(compared: FieldComparison, width: float) -> Figure:
    """Draw bead displacements of the largest ramp; all ramps computed against tracked.

    The map is seen from above. Arrows show displacements, enlarged: as tracked, and as computed.
    """
    rises = compared.rises
    size = np.linalg.norm(compared.measured, axis=1)
    ramp = int(rises.ramp[np.argmax(size)])
    own = rises.ramp == ramp
    narrow = width < PHONE_WIDTH
    figure = new_figure(width, 10.0 if narrow else 6.5)
    above, against = figure.subplots(2 if narrow else 1, 1 if narrow else 2, squeeze=False).ravel()
    place = 100 * rises.place[own]
    larger = max(1.0, np.floor(0.012 / size[own].max()))
    for field, colour, name, thickness in (
        (compared.measured, _TRACKED, "as tracked", 0.006),
        (compared.computed, _COMPUTED, "by the model", 0.003),
    ):
        arrows = 100 * larger * field[own]
        above.quiver(
            place[:, 0], place[:, 1], arrows[:, 0], arrows[:, 1],
            angles="xy", scale_units="xy", scale=1.0, color=colour, width=thickness, minlength=0.1, label=name,
        )  # fmt: skip
    tip = float(rises.ramps[ramp].tip.mean())
    above.plot([0.0, 0.0], [0.0, 100 * tip], color="0.2", linewidth=1.5, label="cut")
    above.set_aspect("equal")
    above.set_xlabel("across [cm]")
    above.set_ylabel("along, from the clamp [cm]")
    above.set_title(f"tip at {100 * tip:.1f} cm, arrows {larger:.0f} times", fontsize=10, loc="left")
    against.plot(
        1e3 * compared.computed.ravel(),
        1e3 * compared.measured.ravel(),
        ".",
        color="0.55",
        markersize=2,
        rasterized=True,
    )
    ends = 1e3 * np.array([compared.computed.min(), compared.computed.max()])
    against.plot(ends, ends, color="0.2", linewidth=1.0)
    against.set_xlabel("by the model [mm]")
    against.set_ylabel("as tracked [mm]")
    against.set_title("every component, all ramps", fontsize=10, loc="left")
    plain_axes(above)
    plain_axes(against)
    figure.legend(*above.get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False, fontsize=9)
    return figure
