"""Compile every kernel before the first cut, as for images.

Each task is compiled in a process of its own, as many at once as there are cores.  What is compiled is kept where the
first cut would keep it: beside the package, or in the user's cache, or below NUMBA_CACHE_DIR.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from importlib.util import find_spec

from cutenv._base.output import progress_bar
from cutenv.commands.options import command_parser, reports_errors
from cutenv.task.registry import TASKS, RegisteredTask

_RIG = "emulated rig"  # a part beside the tasks, where its extra is installed
_ACROSS: tuple[tuple[str, ...], ...] = ((), ("height",), ("side",))


@reports_errors("warm")
def main(argv: Sequence[str]) -> int:
    """Compile and print the place; return 1 if a part fails, or nothing can be kept."""
    arguments = _parser().parse_args(argv)
    from cutenv._engine.jit import kernel_folder, remove_kernels

    if arguments.remove:
        print(
            "\n".join(f"removed: what was compiled in {place}" for place in remove_kernels()) or "nothing is compiled"
        )
        return 0

    folder = kernel_folder("cutenv.sim.cutting.law")
    if folder is None:
        print(
            "cutenv warm: nothing that is compiled can be kept here: set NUMBA_CACHE_DIR to a folder that can be "
            "written to, now and for every later program.",
            file=sys.stderr,
        )
        return 1
    names = list(dict.fromkeys(arguments.task or parts()))
    begun = time.monotonic()
    with ThreadPoolExecutor(os.cpu_count()) as pool, progress_bar("compiling", "part", total=len(names)) as count:
        waiting = {pool.submit(_compiled_apart, name): name for name in names}
        errors = []
        try:
            for done in as_completed(waiting):
                count(1)
                if (error := done.result()) is not None:
                    errors.append(f"cutenv warm: {waiting[done]}: {error}")
        except BaseException:  # a terminal's Ctrl-C ends the parts under way, and the next ones would begin
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    print("\n".join(errors), file=sys.stderr, end="\n" * bool(errors))
    if not errors:
        print(f"{', '.join(names)}: ready after {time.monotonic() - begun:.0f} s; kept in {folder.parent}")
    return 1 if errors else 0


def parts() -> list[str]:
    """Return what can be compiled: tasks, and an installed emulator."""
    return [*TASKS, *([_RIG] if find_spec("canopen") is not None else [])]


def compile_part(name: str) -> None:
    """Compile the kernels of a task or the emulator.

    Of a task: by truth and by estimate, its scripts and planner.
    """
    if name == _RIG:
        _use_rigs()
        return
    import numpy as np

    task = TASKS[name]
    for keywords in ({}, {"reward_from": "estimate"}):
        for environment in (task.single(**keywords), task.vector(64, **keywords)):
            environment.reset(seed=0)
            environment.step(np.zeros(environment.action_space.shape, np.float32))
            environment.close()
    _use_policies(task)
    _use_plant(task)


def _use_policies(task: RegisteredTask) -> None:
    """Let a task's scripts and planner cut, with learner features."""
    import numpy as np

    from cutenv.agents.learning.evaluation import batched_rollout
    from cutenv.envs.vector import CutBatch
    from cutenv.records.scoring import score
    from cutenv.sim.plant.protocol import recorded_trace

    for policy in (*(make() for make in task.scripts.values()), task.planner(rounds=1)):
        for seeds in ([0], [0, 1]):  # for one cut, columns of an array are contiguous
            cut, *_ = batched_rollout(policy, seeds, {"task": task.name, "deadline_s": 1.0}, readings=True)
        score(recorded_trace(cut.readings, cut.depth), target_length=cut.truth["target_length_m"])
    batch, which = CutBatch(2, task.single()), np.arange(2)
    batch.give_seeds([0, 1], which, np.random.default_rng(0))
    batch.begin(which)
    batch.append_hidden(task.features(2)(batch.observations), which)


def _use_plant(task: RegisteredTask) -> None:
    """Drive and score a blade, also by hand."""
    import numpy as np

    from cutenv.records.scoring import score
    from cutenv.sim.tissue import measured_liver
    from cutenv.sim.tissue.floor import BladePath, expected_floor
    from cutenv.sim.tissue.grid import N_POINTS
    from cutenv.sim.tissue.specimen import draw_liver

    environment = task.single()
    environment.reset(seed=0)
    plant = environment.plant
    plant.advance(0.01, math.radians(60.0), 5)
    plant.lead([plant.states["blade"][0]], math.radians(60.0))
    plant.energy()
    draw_liver(np.random.default_rng(0))
    expected_floor(measured_liver(), np.full(N_POINTS, 0.01), BladePath(*np.zeros((3, 2))))
    if task.hand:
        cut = task.hand()
        way = np.zeros((2000, len(task.task.action_names)))
        way[:, 0], way[:, 1] = np.linspace(0.0, 0.04, len(way)), math.radians(60.0)
        score(cut.trace(cut.follow(way), **cut.facts), target_length=cut.target_length)


def _use_rigs() -> None:
    """Use the emulator in both directions, and fake rigs."""
    import numpy as np

    from cutenv.emulation.process import warm_up

    for across in _ACROSS:
        warm_up(across=across)
    for task in TASKS.values():
        if task.rig:
            environment = task.rig(rig="fake")
            environment.reset(seed=0)
            environment.step(np.zeros(environment.action_space.shape, np.float32))
            environment.cutting.charge_stop()
            environment.close()


def _compiled_apart(name: str) -> str | None:
    """Compile a part in its own process; return any error."""
    program = f"from cutenv.commands.warm import compile_part; compile_part({name!r})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    return None if done.returncode == 0 else (done.stderr.strip() or f"status {done.returncode}").splitlines()[-1]


def _parser() -> argparse.ArgumentParser:
    parser = command_parser("warm", __doc__, examples=("", "--task gentle --task excision", "--remove"))
    add = parser.option
    add("--task", "compile this alone; may be given again", choices=parts(), action="append")
    add("--remove", "delete what was compiled, as before 'pip uninstall'")
    return parser
