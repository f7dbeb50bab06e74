"""``python -m cutenv`` is the same as the command ``cutenv``."""

from __future__ import annotations

from cutenv.commands.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
