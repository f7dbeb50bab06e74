"""Measure the depth of cut from video of a marked blade, or calibrate.

The depth is put into the record. The calibration is that of the camera.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Container, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cutenv._base.output import watched
from cutenv.commands.options import add_option, command_parser, made_folder, made_place, reports_errors

if TYPE_CHECKING:  # slow to import, and --help does not need it
    from cutenv.sim.trace import Trace
    from cutenv.vision.cameras import GreyImage
    from cutenv.vision.depth_record import FilmedDepth, RunsAndDrops
    from cutenv.vision.film_source import VideoFrame

_MEASURING = ("calibration", "record")
_CALIBRATING = ("board", "spacing")
_OF_CALIBRATION = (*_CALIBRATING, "charuco")
_OF_MEASURING = (*_MEASURING, "tag")


@reports_errors("depth")
def main(argv: Sequence[str]) -> int:
    """Measure or calibrate; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    wanted, other = (_CALIBRATING, _OF_MEASURING) if arguments.calibrate else (_MEASURING, _OF_CALIBRATION)
    what = "with --calibrate" if arguments.calibrate else "to measure a video"
    for name in wanted:
        if getattr(arguments, name) is None:
            raise ValueError(f"--{name} is missing; {what} it is needed.")
    for name in other:
        if getattr(arguments, name) is not None:
            raise ValueError(f"--{name} has no use {what}; leave it out.")
    missing = [str(path) for path in arguments.files if not path.is_file()]
    if missing:
        raise FileNotFoundError(f"no such file: {', '.join(missing)}.")
    return _calibrate(arguments) if arguments.calibrate else _measure(arguments)


def _calibrate(arguments: argparse.Namespace) -> int:
    from cutenv.records.schema import parse_length
    from cutenv.vision.cameras import CalibrationBoard, calibrate_cameras, read_image

    if arguments.out is None or arguments.out.suffix != ".json":
        raise ValueError("--calibrate writes one file: give --out cam.json.")
    if not arguments.stereo and arguments.plane is None:
        raise ValueError("one camera needs --plane IMAGE, the board standing in the plane of the cut; a pair --stereo.")
    if arguments.circles and arguments.charuco is not None:
        raise ValueError("--circles and --charuco are two kinds of board: give one.")
    kind = "circles" if arguments.circles else "chessboard" if arguments.charuco is None else "charuco"
    tag = None if arguments.charuco is None else parse_length("--charuco", arguments.charuco)
    board = CalibrationBoard.parse(arguments.board, parse_length("--spacing", arguments.spacing), kind, tag)
    made_place("--out", arguments.out)
    plane = None if arguments.plane is None else (str(arguments.plane), read_image(arguments.plane))
    images = ((str(path), read_image(path)) for path in watched(arguments.files, "finding the board", "image"))
    cameras = calibrate_cameras(images, board, stereo=arguments.stereo, plane=plane)
    cameras.save(arguments.out)
    for name in cameras.about["left_out"]:
        print(f"left out: {name}: the board is not seen whole", file=sys.stderr)
    for camera, name in zip(cameras.cameras, ("left", "right") if arguments.stereo else ("camera",), strict=True):
        print(f"{name}: residual {camera.residual:.2f} px over {camera.boards} boards")
    for name, pose in (("pair", cameras.second), ("plane", cameras.plane)):
        if pose is not None:
            print(f"{name}: residual {pose.residual:.2f} px")
    print(f"calibration: {arguments.out}")
    return 0


def _measure(arguments: argparse.Namespace) -> int:
    from cutenv.display.report.film_pages import FilmedRecord, write_depth_page, write_frame_table
    from cutenv.records import save
    from cutenv.records.schema import parse_length
    from cutenv.vision.blade_mark import MarkedBlade
    from cutenv.vision.cameras import CalibratedCameras
    from cutenv.vision.depth_record import filmed_depth, runs_and_drops, seen_runs
    from cutenv.vision.film_source import video_facts, video_frames
    from cutenv.vision.marked_blade import BladeCameras

    if len(arguments.files) != 1:
        raise ValueError(f"{len(arguments.files)} videos are given; give one, with a pair's images side by side.")
    if arguments.rate is not None and not 0.1 <= arguments.rate <= 1e4:
        raise ValueError(f"--rate {arguments.rate:g} is no number of frames a second: 0.1 to 10000.")
    video = arguments.files[0]
    lengths = {name: parse_length(f"--{name}", getattr(arguments, name)) for name in ("total", "strip", "width")}
    blade = MarkedBlade(**lengths, tag=arguments.tag)
    cameras = CalibratedCameras.load(arguments.calibration)
    trace = _record(arguments.record)
    trace.require("position", by="cutenv depth")
    out = made_folder("--out", arguments.out or Path())
    target = out / f"{arguments.record.stem}_depth{arguments.record.suffix}"
    if target.suffix.lower() not in (".csv", ".parquet", ".h5", ".hdf5"):
        target = target.with_suffix(".csv")
    frames = video_frames(video, size=cameras.frame_size, rate=arguments.rate)
    total = video_facts(video).frames or None
    measured = list(watched(BladeCameras(cameras, blade).measure_all(frames), "measuring", "frame", total=total))
    filmed = filmed_depth(measured, trace, blade, travel=arguments.travel)
    with_depth = filmed.onto(trace)
    pictures: dict[int, GreyImage] = {}
    again = watched(video_frames(video, rate=arguments.rate), "watching the tissue", "frame", total=total)
    width = cameras.cameras[0].width
    kept = _keeping(again, _shown(filmed), pictures, width)
    found = runs_and_drops(seen_runs(kept, filmed, trace, width), trace)
    page, table = target.with_suffix(".html"), target.with_name(f"{target.stem}_frames.csv")
    about = FilmedRecord(name=arguments.record.stem, trace=with_depth, filmed=filmed, found=found, pictures=pictures)
    write_depth_page(page, about)
    write_frame_table(table, filmed)
    save(with_depth, target)
    print(filmed_summary(filmed))
    print(run_summary(found))
    print(f"record: {target}\nframes: {table}\npage: {page}")
    return 0


def filmed_summary(filmed: FilmedDepth) -> str:
    """Return what was measured, as text."""
    used, of = len(filmed.time), len(filmed.frames)
    low, high = 1e3 * filmed.vertical.min(), 1e3 * filmed.vertical.max()
    lag, lag_sd = filmed.alignment.lag, 1e3 * filmed.alignment.lag_sd
    lines = [
        f"depth {max(low, 0.0):.1f} to {high:.1f} mm, standard deviation {1e3 * filmed.sd:.2f} mm, from {used} of {of} "
        f"frames; the film's time 0 is {lag:.3f} s of the record, to {lag_sd:.1f} ms"
    ]
    return "\n".join(lines + [f"left out: {reason}: {count} frames" for reason, count in filmed.left_out.items()])


def run_summary(found: RunsAndDrops) -> str:
    """Return counts of crack runs and of force drops."""
    told = f"runs of the crack: {len(found.runs)} seen; sudden drops of the force: {len(found.drops)}"
    return told + (f"; at the same time: {len(found.pairs)}, F1 {found.f1:.2f}" if found.runs and found.drops else "")


def _record(path: Path) -> Trace:
    """Return the one cut of a record; raise ValueError if it holds several, or is bad."""
    from cutenv.records import read_record

    imported = read_record(path)
    if len(imported.traces) != 1:
        raise ValueError(f"{path} holds {len(imported.traces)} cuts; give a record of the one that was filmed.")
    return imported.traces[0]


def _keeping(
    frames: Iterable[VideoFrame], numbers: Container[int], kept: dict[int, GreyImage], width: int
) -> Iterator[VideoFrame]:
    """Yield all frames, keeping some images of the first camera."""
    for frame in frames:
        if frame.number in numbers:
            kept[frame.number] = frame.image[:, :width]
        yield frame


def _shown(filmed: FilmedDepth) -> set[int]:
    """Choose frames to draw: three used, the first omitted."""
    used = [frame.number for frame in filmed.frames if frame.blade is not None]
    left_out = [frame.number for frame in filmed.frames if frame.blade is None]
    return {used[len(used) // 8], used[len(used) // 4], used[len(used) // 2], *left_out[:1]}


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "depth",
        __doc__,
        examples=(
            "cut.mp4 --calibration cam.json --record cut.csv --out measured",
            "--calibrate boards/*.png --board 9x6 --spacing 5mm --plane standing.png --out cam.json",
            "--calibrate boards/*.png --board 9x6 --spacing 5mm --stereo --out cam.json",
        ),
        note="The images of a pair of cameras stand side by side in every frame, the left camera's on the left. The\n"
        "record gets the depth at right angles to the travel; the table of frames has the length along the blade too.",
    )
    add = parser.option
    add("files FILE", "video of the cut; or images of the board", Path, nargs="+")
    add("--calibration FILE.json", "calibration of the camera or the pair", Path)
    add("--record FILE", "record of the same cut, with position", Path)
    add("--out PATH", "folder of record, table and page, default here; or calibration file", Path)
    add("--rate HZ", "frames a second, if the file's times are wrong", float)
    add("--travel", "way the blade goes in the images when it cuts; default right", "right", choices=("right", "left"))
    blade = parser.add_argument_group("the blade")
    sizes = {
        "total": ("42.5mm", "centre of strip or tag to the blade's end"),
        "strip": ("4mm", "strip along the blade, or side of the tag"),
    }
    for name, (default, about) in (sizes | {"width": ("8mm", "blade, across")}).items():
        blade.add_argument(
            f"--{name}", default=default, metavar="LENGTH", help=f"length with unit: {about}; default {default}"
        )
    add_option(blade, "--tag N", "number of the ArUco tag (4X4_50) that the blade has in place of a strip", int)
    board = parser.add_argument_group("calibration from images of a board")
    add_option(board, "--calibrate", "calibrate from images of a board instead of measuring")
    add_option(board, "--board NxM", "columns and rows of its inner corners, or of its circles")
    add_option(board, "--spacing LENGTH", "distance between these, with its unit")
    add_option(board, "--circles", "take a board of circles, not a chessboard")
    add_option(board, "--charuco LENGTH", "take a ChArUco board, whose tags (4X4) have sides of this length")
    add_option(board, "--stereo", "calibrate a pair; its images stand side by side")
    add_option(board, "--plane IMAGE", "image of the board standing in the plane of the cut", Path)
    return parser
