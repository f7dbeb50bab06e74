"""Cut on a rig with a policy from simulation, recorded and scored.

A software stop is not a safety function: wire the stop button to the drive's safe torque off before anything moves.
"""

from __future__ import annotations

import argparse
import json
import math
import shlex
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv._base.validation import nearest_choices
from cutenv.commands import options
from cutenv.commands.rig import AFTER_CTRL_C, by_signal, reports_rig_errors
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.canopen.objects import ENABLE_OPERATION, AxisUnits, command_frame
from cutenv.rig.devices.driver_registry import axes_driven_by
from cutenv.rig.devices.loop import SystemClock
from cutenv.task.registry import TASKS, RegisteredTask, task_made_as

if TYPE_CHECKING:
    from cutenv.agents.policy import Policy
    from cutenv.envs.rig_cut import RigCutEnv


_STEPS = 1000  # milli-rpm, which the axis asks its drive for


class Transcript:
    """Listing of commands: time, axis, speed, CAN frame.

    Repetitions are only counted. ``start``: time shown as zero [s]; ``write``: called with each line.
    """

    def __init__(self, settings: RigSettings, start: float, write: Callable[[str], None]) -> None:
        self._axes = settings.axes
        canopen = axes_driven_by(settings, "canopen")  # other drivers have no frame to show
        self._units = {name: AxisUnits(axis=axis, steps=_STEPS) for name, axis in canopen.items()}
        self._start, self._write = start, write
        self._last: dict[str, tuple[float, int]] = {}

    def heard(self, time: float, axis: str, speed: float) -> None:
        """Take an axis's command at ``time`` [s]; m/s or rad/s."""
        last, count = self._last.get(axis, (math.nan, 0))
        if speed == last:
            self._last[axis] = last, count + 1
            return
        self._last[axis] = speed, 1
        frame = ""
        if axis in self._units:
            number, data = command_frame(self._axes[axis].node, ENABLE_OPERATION, self._units[axis].velocity(speed))
            frame = f"  {number:03X}#{data.hex(' ').upper()}"
        shown = f"{1e3 * speed:+8.3f} mm/s" if axis != "angle" else f"{math.degrees(speed):+8.2f} deg/s"
        again = f"   (the one before {count} times)" if count > 1 else ""
        self._write(f"{time - self._start:8.3f} s  {axis:<6}{shown}{frame}{again}")

    def note(self, text: str) -> None:
        """Write a line of text."""
        self._write(f"-- {text}")


_STOPPED = 3
_LATE = ("force stale", "force late", "motion stale", "clock overrun", "heartbeat lost")


@reports_rig_errors("run", refused=2)
def main(argv: Sequence[str]) -> int:
    """Cut; return 0, 3 (stopped), 2 (error), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    return _dry_run(arguments) if arguments.dry_run is not None else _run(arguments)


def chosen_policy(name: str, task: str = "gentle") -> tuple[Policy, dict[str, Any]]:
    """Return a policy by name, and its environment's arguments.

    ``MODULE:CLASS`` is a :class:`~cutenv.agents.policy.Policy` of your own, in the present folder or an installed
    module; ``task`` is of :data:`cutenv.task.registry.TASKS`. Raise ValueError, FileNotFoundError if there is no such
    policy, or it is for another task.
    """
    from cutenv.agents.policy import gentle_policy, named_policy
    from cutenv.agents.policy.interface import PrivilegedPolicy
    from cutenv.agents.policy.shipped import SHIPPED, policy_of_class

    chosen = TASKS[task]
    own_policies, scripts = chosen.policies or chosen.scripts, ", ".join(chosen.scripts)
    if name in own_policies:
        policy = own_policies[name]()
        if isinstance(policy, PrivilegedPolicy):
            raise ValueError(f"policy {name!r} is shown the hidden state, which no rig knows. Take another.")
        return policy, {}
    for other in TASKS.values():
        if name in (other.policies or other.scripts):
            raise ValueError(f"policy {name!r} is a script of {other.id}, and the task is {task}. Give {scripts}.")
    if ":" in name:  # what it imports, such as PyTorch, can take seconds
        print(f"loading {name} ...", file=sys.stderr, flush=True)
    own = policy_of_class(name)
    if own is not None:
        return own, dict(getattr(own, "environment_arguments", {}))
    try:
        learned = gentle_policy(name) if task == "gentle" else named_policy(name)
    except ValueError as error:
        near = nearest_choices(name, [*SHIPPED, *own_policies], most=3)
        raise ValueError(f"policy {name!r} is not known.{near}" if near else str(error)) from None
    if task_made_as(learned.card.environment) is not chosen:
        raise ValueError(
            f"policy {name!r} was trained in {learned.card.environment}, and the task {task} is {chosen.id}. Give one "
            f"of that, or a script: {scripts}."
        )
    return learned, {key: value for key, value in learned.environment_arguments.items() if key != "task"}


def paced(keywords: dict[str, Any], settings: RigSettings) -> tuple[dict[str, Any], str]:
    """Return environment arguments at the rig's decision rate, and a note.

    A policy that was trained at a rate keeps it; a script takes 50 decisions a second, or what a slower rig allows.
    """
    from cutenv.rig.operation.suitability import decisions

    most, usual = decisions(settings), 50
    own = keywords.get("control_hz")
    if own is not None and own > most:
        return keywords, f"this policy decides {own} times a second; on this rig {most} see what the last one did"
    if own is None and most < usual:
        return {**keywords, "control_hz": most}, f"{most} decisions a second, as this rig allows"
    return keywords, ""


def _environment(arguments: argparse.Namespace, keywords: dict[str, Any], **more: Any) -> RigCutEnv:
    from cutenv.drivers.rig_names import settings_of
    from cutenv.sim.tissue.drawn_lines import KINDS

    keywords, note = paced(keywords, settings_of(arguments.rig))
    if note:
        print(f"cutenv rig run: {note}", file=sys.stderr)
    if arguments.line is not None:
        options.check_line(arguments.line, [arguments.task])
        keywords = {**keywords, "line": arguments.line if arguments.line in KINDS else options.line_given(arguments)}
    lower = {
        "force": arguments.force_limit_N,
        "speed": None if arguments.speed_limit_cm_s is None else 1e-2 * arguments.speed_limit_cm_s,
        "high": None if arguments.travel_limit_mm is None else 1e-3 * arguments.travel_limit_mm,
    }
    env: RigCutEnv = TASKS[arguments.task].rig(
        rig=arguments.rig,
        specimen_class=arguments.specimen_class,
        target_length=options.target_length(arguments),
        tissue=arguments.tissue,
        lower_limits={name: value for name, value in lower.items() if value is not None},
        **keywords,
        **more,
    )
    return env


def _dry_run(arguments: argparse.Namespace) -> int:
    """Cut on a fake; print the frames that would command drives."""
    import numpy as np

    policy, keywords = chosen_policy(arguments.policy, arguments.task)
    env = _environment(arguments, keywords).rehearsal()
    fake = env.the_fake()
    transcript = Transcript(env.settings, fake.clock.now(), print)
    fake.heard = transcript.heard
    transcript.note("self-test, the blade in air: a millimetre to and fro, and the way to the clamp")
    observation, _ = env.reset(seed=arguments.seed)
    policy.reset(np.random.default_rng(arguments.seed))
    transcript.note(f"the cut, on a drawn specimen, to {1e3 * env.cutting.target_length:.1f} mm")
    began, ended = fake.clock.now(), False
    while not ended and fake.clock.now() - began < arguments.dry_run:
        observation, _, ended, _, _ = env.step(policy(observation))
    env.close()
    transcript.note("end of the dry run; nothing was connected, nothing was sent")
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from cutenv.records.foreign.lsl import LslOutlet
    from cutenv.rig.operation.recorder import published
    from cutenv.rig.safety.stop_causes import ENDS_SESSION

    if arguments.lsl and arguments.rig == "fake":
        raise ValueError("--lsl streams in real time, which a fake rig has none of. Give --rig emulator, or a file.")
    options.made_folder("--out", arguments.out)
    if arguments.json is not None:
        options.made_place("--json", arguments.json)
    policy, keywords = chosen_policy(arguments.policy, arguments.task)
    env = _environment(arguments, keywords, records=arguments.out)
    outlet = None
    if arguments.lsl:
        outlet = LslOutlet("cutenv rig", scope=arguments.lsl, about={"rig": env.settings.name})
        env.listen(outlet)
    if env.settings.angle_mode == "fixed" and not keywords:
        by_hand = math.degrees(env.settings.fixed_angle)
        print(f"the blade is set by hand, at {by_hand:.0f} degrees: angles that the policy asks for are ignored")
    print("rehearsing on a fake rig ...", file=sys.stderr, flush=True)
    told = rehearse(env, policy, seed=arguments.seed)
    if note := _slowness(told, env):
        print(f"cutenv rig run: {note}", file=sys.stderr)
    stopped, interrupted = 0, False
    with nullcontext() if arguments.watch is None else published(env.session.plant, arguments.watch):
        try:
            for number in range(arguments.cuts):
                print(f"cut {number + 1} of {arguments.cuts} ...", file=sys.stderr, flush=True)
                told = cut_and_report(env, policy, seed=arguments.seed, episode=number)
                stopped += told["end"] == "stopped"
                print(_line(number, told, env, TASKS[arguments.task]), flush=True)
                if arguments.json is not None:
                    with arguments.json.open("a") as file:
                        file.write(json.dumps(told) + "\n")
                if told["stop"] is not None and told["stop"]["cause"] in ENDS_SESSION:
                    interrupted = by_signal(told["stop"]["cause"])
                    break
        finally:
            env.close()
            if outlet is not None:
                outlet.close()
    return AFTER_CTRL_C if interrupted else _STOPPED if stopped else 0


def rehearse(env: RigCutEnv, policy: Policy, *, seed: int) -> dict[str, Any]:
    """Cut once on a fake with the rig's settings.

    A policy so compiles, or fails, before the rig moves. Return the result, as of :func:`cut_and_report`.
    """
    fake = env.rehearsal()
    try:
        return cut_and_report(fake, policy, seed=seed, episode=0)
    finally:
        fake.close()


def cut_and_report(env: RigCutEnv, policy: Policy, *, seed: int, episode: int) -> dict[str, Any]:
    """Cut once; return the result as a dictionary for JSON."""
    import numpy as np

    observation, _ = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    total, ended = 0.0, False
    decisions: list[float] = []  # [s]
    info: dict[str, Any] = {}
    while not ended:
        begun = time.perf_counter()
        action = policy(observation)
        decisions.append(time.perf_counter() - begun)
        observation, reward, ended, _, info = env.step(action)
        total += reward
    timing, cutting = env.session.plant.timing, env.cutting
    group = env.task.shown_as
    found = {f"{name}_estimated": value for name, value in info.get(group, {}).items()}
    return {
        "seed": seed,
        "episode": episode,
        "end": info["end"],
        "success_estimated": info["is_success"],
        "return_estimated": total,
        "tip_error_estimated_mm": 1e3 * abs(cutting.tip - cutting.target_length),
        **({group: found} if found else {}),
        "time_s": cutting.time,
        "overruns": timing.overruns,
        "longest_period_s": max(timing.periods, default=math.nan),
        "decision_s": statistics.median(decisions),
        "stop": info.get("stop"),
        "record": str(env.records[-1]) if env.records else None,
    }


def _slowness(told: dict[str, Any], env: RigCutEnv) -> str:
    """Return a warning if a policy decides too slowly."""
    decision, period = told["decision_s"], 1e-3 * env.ticks
    if decision < period:
        return ""
    return f"the policy takes {1e3 * decision:.0f} ms a decision, and has {1e3 * period:g} ms: on a rig it is late"


def _line(number: int, told: dict[str, Any], env: RigCutEnv, task: RegisteredTask) -> str:
    line = (
        f"cut {number + 1}: {told['end']} after {told['time_s']:.1f} s, "
        f"{'a success' if told['success_estimated'] else 'no success'} as estimated: return "
        f"{told['return_estimated']:.3f}, tip error {told['tip_error_estimated_mm']:.1f} mm; "
        f"{told['overruns']} commands more than 2 ms late"
    )
    if not isinstance(env.session.plant.clock, SystemClock):  # it stands still while a policy decides
        line = line.rpartition("; ")[0] + f"; {1e3 * told['decision_s']:.1f} ms a decision"
    errors = told.get(env.task.shown_as, {})
    for name, words, unit, decimals in task.errors:
        if f"{name}_estimated" in errors:
            line += f"; estimated {words} {errors[f'{name}_estimated']:.{decimals}f} {unit}"
    if told["stop"] is not None:
        stop = told["stop"]
        line += f"\n  STOPPED, {stop['cause']}: {stop['detail']}"
        if stop["time_to_standstill_s"] is not None:
            time, way = 1e3 * stop["time_to_standstill_s"], 1e3 * (stop["distance_to_standstill_m"] or 0.0)
            line += f"; at rest {time:.0f} ms and {way:.2f} mm later"
        if stop["cause"] in _LATE:
            line += f"\n  {env.lateness or 'the computer was late'}: close other programs; 'cutenv rig check' explains "
            line += "real-time priority"
    if told["record"] is not None:
        line += f"\n  in full: cutenv score {shlex.quote(told['record'])}"
    return line


def _parser() -> argparse.ArgumentParser:
    parser = options.command_parser(
        "rig run",
        __doc__,
        examples=(
            "--policy ppo-free --rig emulator --cuts 2",
            '--task depth --policy "follow the depth" --rig emulator',
            '--task path --policy "steer by force" --rig emulator --line arc',
            '--policy "probe and creep" --rig my_rig.toml --dry-run',
            '--policy "probe and creep" --rig my_rig.toml --target-length 80mm --out cuts',
        ),
        note="Limits given here may only be lower than those of the rig's file. A rig that moves needs the file's\n"
        "armed_by, a valid calibration, and the operator's typed word.",
    )
    add = parser.option
    add(
        "--policy POLICY",
        "name of a script or of a shipped policy, folder of a trained policy, or MODULE:CLASS of your own",
        required=True,
    )
    add("--rig RIG", options.RIG, required=True)
    options.add_task(parser, "rig")
    options.add_line(
        parser, "of a task along one: a kind that is drawn, arc, s, excision, random; or", "any that is drawn"
    )
    add("--cuts N", "number of cuts, one after the other; default 1", 1)
    add("--seed N", "seed of target lengths and of drawn specimens; default 0", 0)
    options.add_target_length(parser, "drawn from 60mm to 100mm")
    options.add_specimen_class(parser, "mixed")
    add("--tissue FILE", "tissue that the rig expects to cut; default measured pig liver", Path)
    add("--out FOLDER", "folder of the records; default cuts", Path("cuts"))
    add("--json FILE", "file that gets a line of JSON for every cut, at its end", Path)
    add("--force-limit-N N", "limit of each axis of the force [N]", float)
    add("--speed-limit-cm-s CM_S", "limit of the blade's speed [cm/s]", float)
    add("--travel-limit-mm MM", "limit of the blade's travel from the clamp [mm]", float)
    options.add_lsl(parser)
    options.add_watch(parser, "publish force, position and stops on this machine, for 'cutenv serve FOLDER --watch'")
    add(
        "--dry-run SECONDS",
        "connect to nothing; print every frame that would command a drive in the first seconds (default 2)",
        float,
        nargs="?",
        const=2.0,
    )
    return parser
