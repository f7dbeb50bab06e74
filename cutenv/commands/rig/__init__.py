"""Sub-commands of ``cutenv rig``: one module with ``main(argv)`` for each."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence

from cutenv.commands.options import reports_errors
from cutenv.rig.errors import RigError

AFTER_CTRL_C = 130  # exit status after Ctrl-C, SIGTERM or a closed terminal, whatever the command was doing
_Main = Callable[[Sequence[str]], int]


def reports_rig_errors(name: str, *also: type[Exception], refused: int = 1) -> Callable[[_Main], _Main]:
    """Decorate ``main`` of a rig command to report errors on one line.

    Besides what :func:`cutenv.commands.options.reports_errors` does, what the rig or its operator refuses, and a stop,
    is a line and the status ``refused``; a stop by Ctrl-C has the status 130.
    """

    def decorated(main: _Main) -> _Main:
        @reports_errors(f"rig {name}", *also)
        @functools.wraps(main)
        def guarded(argv: Sequence[str]) -> int:
            try:
                return main(argv)
            except RigError as error:
                report = getattr(error, "report", None)  # of a stop
                print(f"cutenv rig {name}: {'stopped: ' * (report is not None)}{error}", file=sys.stderr)
                return AFTER_CTRL_C if report is not None and by_signal(report.cause) else refused
            except KeyboardInterrupt:
                print(f"\ncutenv rig {name}: interrupted; nothing moves", file=sys.stderr)
                return AFTER_CTRL_C

        return guarded

    return decorated


def by_signal(cause: object) -> bool:
    """Return whether a stop comes from a signal: Ctrl-C, SIGTERM, a closed terminal."""
    from cutenv.rig.safety.stop_causes import Cause

    return cause == Cause.INTERRUPTED
