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
    parser.add_argument("page", type=Path, metavar="PAGE", help="page to write (.html)")
    add_task(parser, "hand", "; may be repeated", several=True)
    parser.add_argument(
        "--line",
        action="append",
        choices=KINDS,
        help="kind of line to cut along, may be repeated: the specimens of a class have them in turn; default "
        f"{', '.join(OFFERED_LINES)}",
    )
    parser.add_argument(
        "--specimen-class",
        action="append",
        choices=CLASSES,
        help=f"class of specimens, may be repeated; default {', '.join(OFFERED)}",
    )
    add_tissue(parser)
    parser.add_argument("--count", type=int, default=4, metavar="N", help="specimens of each class; default 4")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="seed of specimens and targets; default 0")
    parser.add_argument("--language", choices=languages(), default=ENGLISH, help="language of the page; default en")
    parser.add_argument(
        "--expert",
        nargs="?",
        const=ORACLE,
        metavar="POLICY",
        help="show the way of the planner, or of a shipped policy, in replays, too; seconds of work for a specimen",
    )
    parser.add_argument(
        "--scorm", type=Path, metavar="PACKAGE", help="write it as a SCORM 1.2 package for a learning platform, too"
    )
    parser.add_argument("--pass-mark", type=float, metavar="SCORE", help="score that passes there, 0 to 100")
    parser.add_argument("--open", action="store_true", help="open the page in the browser")
    return parser
