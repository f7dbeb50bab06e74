"""Build the laws of the page: WebAssembly from the kernels that Python runs, assets/browser.

    python -m scripts.build_browser_law              # build those of all tasks

Another Python or Numba may give other instructions for the same arithmetic.

Numba translates the kernels to LLVM's intermediate code, without optimising and for no processor in particular;
llvmlite's own back end makes WebAssembly of it, and the linker comes from the wheel ``ziglang``.  Nothing is computed
anew: the arithmetic is that of IEEE 754 in the order of the source, so its results are Python's to the last bit
(tests/people/browser).  Calls of Python and of Numba's runtime, all in branches that are never taken, become traps.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from cutenv.task.registry import TASKS, tasks_with
from scripts import ROOT

BUILT = ROOT / "assets" / "browser"
_ENTRY = "follow"
_LAYOUT = "e-m:e-p:32:32-p10:8:8-p20:8:8-i64:64-i128:128-n32:64-S128-ni:1:10:20"  # of data, for wasm32
_TRIPLE = "wasm32-unknown-unknown"
_RUNTIME = ("NRT_", "Py", "numba_")  # begin the names of functions of Numba's runtime and of Python
_FEATURES = "+bulk-memory,+bulk-memory-opt,+mutable-globals,+nontrapping-fptoint,+sign-ext"  # of browsers since 2022


def main() -> int:
    """Build; return 1 if a result is to be compared and differs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare with the files that are kept")
    parser.add_argument("--task", choices=tasks_with("hand"), help="the only one to build")
    parser.add_argument("--out", type=Path, default=BUILT, metavar="FOLDER", help="folder to write to")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    differ = False
    for task in [arguments.task] if arguments.task else tasks_with("hand"):
        content = linked(compiled(intermediate_code(task)))
        name = f"{task}_law.wasm"
        if arguments.check:
            same = (BUILT / name).read_bytes() == content
            differ |= not same
            print(f"{name}: {len(content)} bytes, {'as kept' if same else 'NOT as kept: build it again'}")
        else:
            (arguments.out / name).write_bytes(content)
            print(f"{arguments.out / name}: {len(content)} bytes")
    return 1 if differ else 0


def intermediate_code(task: str) -> str:
    """Return LLVM's intermediate code of a task's entry and all that it calls."""
    # Numba reads these when it is imported.  Its cache would hold code for this processor.
    os.environ |= {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    with tempfile.TemporaryDirectory() as cache:
        os.environ["NUMBA_CACHE_DIR"] = cache
        import warnings

        import numba
        from numba.core import types
        from numba.np.numpy_support import from_dtype

        from cutenv.people.browser.stylus_steps import LeadingHand, follow_hand
        from cutenv.sim.cutting.dtypes import READING
        from cutenv.task.declare import OneCut

        library: Any = numba  # which has no types
        carray, pointer = library.carray, library.types.CPointer
        kind = TASKS[task].hand
        led = kind.led
        follow_led, numbers, components = follow_hand(led), len(led.task.action_names), len(led.task.all_components)
        channels = len(kind.channel_fields)
        kinds = led.task.motion.cut, kind.shared, led.task.episode, READING
        cut, share, episode, reading = (pointer(from_dtype(kind)) for kind in kinds)
        number, single, real, whole = pointer(types.float64), pointer(types.float32), types.float64, types.int32

        def entry(
            cuts: Any, shared: Any, episodes: Any, stylus: Any, count: Any, lag: Any, acceleration: Any, start: Any,
            action: Any, observation: Any, across: Any, readings: Any, noted: Any, outcome: Any,
        ) -> Any:  # fmt: skip
            return follow_led(
                OneCut(carray(cuts, (1,)), carray(shared, (1,)), carray(episodes, (1,))),
                carray(stylus, (count, numbers)), LeadingHand(lag, acceleration, start),
                (carray(action, (1, numbers)), carray(observation, (1, components)), carray(across, (1,))),
                (carray(readings, (count, 1)), carray(noted, (channels, count)), carray(outcome, (2,))),
            )  # fmt: skip

        arguments = (
            cut, share, episode, number, whole, real, real, real, number, single, number, reading, number, number,
        )  # fmt: skip
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", numba.NumbaWarning)  # of what cannot be cached
            made: Any = library.cfunc(whole(*arguments), nopython=True, error_model="numpy")(entry)
        code: str = made._library.get_llvm_str()
        return code.replace(made.native_name, _ENTRY)


def compiled(code: str) -> bytes:
    """Return an object file for WebAssembly."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    module = _parsed(llvm, code)
    for each in (*module.functions, *module.global_variables):
        if not each.is_declaration:
            each.linkage = "external" if each.name == _ENTRY else "internal"
    target: Any = llvm.Target.from_triple(_TRIPLE)
    machine = target.create_target_machine(cpu="generic", features=_FEATURES, opt=2)
    tuning: Any = llvm.create_pipeline_tuning_options(speed_level=2)
    tuning.loop_vectorization = tuning.slp_vectorization = False
    builder: Any = llvm.create_pass_builder(machine, tuning)
    builder.getModulePassManager().run(module, builder)
    return machine.emit_object(module)


def _parsed(llvm: Any, code: str) -> Any:
    """Return the module of an entry, for WebAssembly."""
    code = re.sub(r'^target datalayout = ".*"', f'target datalayout = "{_LAYOUT}"', code, flags=re.M)
    code = re.sub(r'^target triple = ".*"', f'target triple = "{_TRIPLE}"', code, flags=re.M)
    code = re.sub(r"^declare (\w+) @(?!llvm\.)([\w.]+)\((.*?)\).*$", _defined, code, flags=re.M)
    intrinsics = "void @llvm.trap()", "double @llvm.sqrt.f64(double)", "double @llvm.floor.f64(double)"
    missing = [f"declare {each}" for each in intrinsics if f"declare {each}" not in code]
    return llvm.parse_assembly("\n".join([code, *missing, ""]))


def _defined(declared: re.Match[str]) -> str:
    """Return a function in the place of a declared one that the browser does not have."""
    kind, name, parameters = declared.groups()
    if name in ("sqrt", "floor"):  # instructions of WebAssembly, and exact
        return (
            f"define internal double @{name}(double %x) {{\n"
            f"  %y = call double @llvm.{name}.f64(double %x)\n  ret double %y\n}}"
        )
    if not name.startswith(_RUNTIME):
        raise RuntimeError(f"the kernels call {name}, which is not part of the engine: it would differ by machine.")
    return f"define internal {kind} @{name}({parameters}) noinline {{\n  call void @llvm.trap()\n  unreachable\n}}"


def linked(content: bytes) -> bytes:
    """Return a module that exports the entry, its memory and where free memory begins; it imports nothing."""
    with tempfile.TemporaryDirectory() as folder:
        part, whole = Path(folder) / "law.o", Path(folder) / "law.wasm"
        part.write_bytes(content)
        exports = [f"--export={name}" for name in (_ENTRY, "__heap_base")]
        linker = [sys.executable, "-m", "ziglang", "wasm-ld", "--no-entry", "--strip-all", *exports]
        subprocess.run([*linker, "-o", str(whole), str(part)], check=True)
        return whole.read_bytes()


if __name__ == "__main__":
    sys.exit(main())
