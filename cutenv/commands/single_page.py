"""Write a one-file page that cuts in a browser, without a server."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from cutenv._base.language_files import ENGLISH, languages
from cutenv.agents.policy import ORACLE
from cutenv.commands.options import (
    add_task,
    add_tissue,
    check_line,
    command_parser,
    drawn_given,
    made_place,
    note_missing,
    reports_errors,
)
from cutenv.people.browser.page_alone import OFFERED, OFFERED_LINES, write_page_alone, write_scorm_package
from cutenv.sim.tissue.drawn_lines import KINDS
from cutenv.sim.tissue.specimen import CLASSES


@reports_errors("single-page")
def main(argv: Sequence[str]) -> int:
    """Write the page; return 0, or 2 on bad input."""
    arguments = _parser().parse_args(argv)
    if arguments.pass_mark is not None and arguments.scorm is None:
        raise ValueError("--pass-mark is for a learning platform's package: give --scorm PACKAGE too.")
    tasks = tuple(arguments.task or ("gentle",))
    if arguments.line:
        check_line(arguments.line[0], tasks)
    note_missing(arguments.language)
    drawn_given(arguments)  # refuses a file that is no tissue
    if arguments.page.suffix.lower() not in (".html", ".htm"):
        raise ValueError(f"PAGE {arguments.page} must end in .html: a browser shows another file as text.")
    made_place("PAGE", arguments.page)
    if arguments.scorm is not None:
        made_place("PACKAGE", arguments.scorm)
    options = {
        "tasks": tasks,
        "lines": arguments.line or OFFERED_LINES,
        "specimen_classes": arguments.specimen_class or OFFERED,
        "tissue": arguments.tissue,
        "count": arguments.count,
        "seed": arguments.seed,
        "language": arguments.language,
        "expert": arguments.expert,
    }
    if arguments.scorm is not None:
        size = write_scorm_package(arguments.scorm, pass_mark=arguments.pass_mark, **options)
        print(f"package: {arguments.scorm} ({size / 1e6:.1f} MB, SCORM 1.2); add it to a course of a learning platform")
    size = write_page_alone(arguments.page, **options)
    print(f"page: {arguments.page} ({size / 1e6:.1f} MB); open it in a browser, also from a stick or by mail")
    if arguments.open:
        import webbrowser

        webbrowser.open(arguments.page.resolve().as_uri())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "single-page",
        __doc__,
        examples=(
            "cut.html --open",
            "klasse.html --language de --specimen-class vascular --count 10 --seed 7",
            "cut.html --scorm cut.zip --pass-mark 60",
            "depth.html --task depth --open",
            "both.html --task gentle --task depth --scorm both.zip",
            "excision.html --task path --line fusiform --expert ppo-excision",
        ),
        note="The page saves records that 'cutenv score' and 'cutenv study' read.",
    )
    add = parser.option
    add("page PAGE", "page to write (.html)", Path)
    add_task(parser, "hand", "; may be repeated", several=True)
    add(
        "--line",
        "kind of line to cut along, may be repeated: the specimens of a class have them in turn; default "
        f"{', '.join(OFFERED_LINES)}",
        action="append",
        choices=KINDS,
    )
    add(
        "--specimen-class",
        f"class of specimens, may be repeated; default {', '.join(OFFERED)}",
        action="append",
        choices=CLASSES,
    )
    add_tissue(parser)
    add("--count N", "specimens of each class; default 4", 4)
    add("--seed N", "seed of specimens and targets; default 0", 0)
    add("--language", "language of the page; default en", ENGLISH, choices=languages())
    add(
        "--expert POLICY",
        "show the way of the planner, or of a shipped policy, in replays, too; seconds of work for a specimen",
        nargs="?",
        const=ORACLE,
    )
    add("--scorm PACKAGE", "write it as a SCORM 1.2 package for a learning platform, too", Path)
    add("--pass-mark SCORE", "score that passes there, 0 to 100", float)
    add("--open", "open the page in the browser")
    return parser
