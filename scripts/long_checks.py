"""Run the checks that are too long for every change: soak, faults, attacks, fuzzing, learning, the whole benchmark.

    python3 scripts/start.py test --long                    all of them, some hours; sets up first
    python -m scripts.long_checks --list                    what there is, and what is done
    python -m scripts.long_checks --only "rig: soak" "tests: slow"

A check that has passed on this state of the source is not repeated: interrupt it at any time, and start it again. What
is done is kept in runs/long-checks/, with the output of every check. The last line has the date and the commit.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from scripts import ROOT, checks

FOLDER = Path("runs") / "long-checks"
CHECKS = {check.name: check.arguments for check in checks.CHECKS if check.long}
"""Arguments of Python for each check; it passes if the program ends with 0."""
ENVIRONMENT = {"tests: new examples of every property": {"CUTENV_EXPLORE": "1"}}


def state_of_source() -> str:
    """Return the commit, with a digest of what is not committed."""
    git = ["git", "-C", str(ROOT)]
    commit = subprocess.run([*git, "rev-parse", "--short=12", "HEAD"], capture_output=True, text=True, check=True)
    changes = subprocess.run([*git, "diff", "HEAD"], capture_output=True, check=True).stdout
    return commit.stdout.strip() + (f" changed {hashlib.sha256(changes).hexdigest()[:8]}" if changes else "")


def end(running: subprocess.Popen[bytes]) -> None:
    """Interrupt a program with all that it started; end it if that does not."""
    for name in ("SIGINT", "SIGTERM", "SIGKILL"):
        try:
            os.killpg(running.pid, getattr(signal, name)) if os.name == "posix" else running.kill()
            running.wait(timeout=15.0)
            return
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue


def passes(name: str, command: list[str], output: Path) -> bool:
    """Run a check with its output in a file; an interrupt stops it with all that it started."""
    environment = os.environ | ENVIRONMENT.get(name, {})
    with output.open("w", encoding="utf-8") as file:
        running = subprocess.Popen(
            [sys.executable, *command], cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=file,
            stderr=subprocess.STDOUT, start_new_session=True,
        )  # fmt: skip
        try:
            return running.wait() == 0
        except KeyboardInterrupt:
            end(running)
            raise


def main(argv: list[str], chosen: dict[str, list[str]] = CHECKS, folder: Path = ROOT / FOLDER) -> int:
    """Run what is not done yet; return 0 if all that was asked for has passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", metavar="CHECK", choices=chosen, default=list(chosen))
    parser.add_argument("--list", action="store_true", help="print what there is, and what is done, and stop")
    options = parser.parse_args(argv)
    folder.mkdir(parents=True, exist_ok=True)
    done_file, state = folder / "done.json", state_of_source()
    kept = json.loads(done_file.read_text(encoding="utf-8")) if done_file.is_file() else {}
    done: dict[str, str] = kept.get("done", {}) if kept.get("source") == state else {}
    if options.list:
        for name, command in chosen.items():
            print(f"{name:<40} {done.get(name, 'to do'):<20} python {' '.join(command)}")
        return 0
    failed = []
    for number, name in enumerate(options.only, 1):
        output = folder / f"{name.replace(' ', '-').replace(':', '')}.txt"
        if name in done:
            print(f"[{number}/{len(options.only)}] {name}: passed {done[name]}", flush=True)
            continue
        print(f"[{number}/{len(options.only)}] {name} ...", end=" ", flush=True)
        begun = time.monotonic()
        try:
            passed = passes(name, chosen[name], output)
        except KeyboardInterrupt:
            print(f"stopped; the same command goes on ({len(done)} done)")
            return 130
        took = f"in {(time.monotonic() - begun) / 60:.1f} minutes"
        if passed:
            done[name] = f"{datetime.datetime.now():%Y-%m-%d %H:%M}"
            done_file.write_text(json.dumps({"source": state, "done": done}, indent=1), encoding="utf-8")
            print(f"passed {took}", flush=True)
        else:
            failed.append(name)
            lines = output.read_text(encoding="utf-8", errors="replace").splitlines()[-15:]
            print("\n".join([f"FAILED {took}; the end of {output}:", *(f"    {line}" for line in lines)]), flush=True)
    counted = f"{len(failed)} failed, " if failed else ""
    print(f"long checks: {counted}{len(options.only) - len(failed)} passed; {datetime.date.today()}, commit {state}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
