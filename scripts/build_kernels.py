"""Build the kernels of a wheel: one library of machine code, which Python calls without Numba.

    python -m scripts.build_kernels --out FOLDER  for each system, in a folder of its name
    python -m scripts.build_kernels --out FOLDER --target x86_64-linux --part gentle
                                                  for one, a part

Each part (a task, the emulated rig) is used once, as a user would, to see which kernels it calls with which types.
These are translated by Numba to LLVM's intermediate code, and by llvmlite's own back end to machine code, on x86-64 for
every processor, for those with AVX2 and for those with AVX-512.  Fast-math is off and nothing is contracted, so that
results are Numba's to the last bit.  ``ziglang`` compiles scripts/kernels/binding.c and links.
"""

from __future__ import annotations

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import import_module
from operator import attrgetter
from pathlib import Path
from typing import Any

from scripts import ROOT

PACKAGE = ROOT / "cutenv"
BINDING = Path(__file__).with_name("kernels") / "binding.c"


@dataclass(frozen=True)
class Target:
    """A system that kernels are built for."""

    triple: str  # LLVM's name of it
    zig: str  # ziglang's name of it
    file: str  # name of the library, as Python looks for it
    tag: str  # platform of a wheel's name
    levels: tuple[str, ...]
    """Processors, the least first, each with LLVM's features of it behind a comma; the binding takes the best."""
    options: tuple[str, ...] = ()  # options of the linker


# Rows of cuts are long: AVX-512 pays in its full width.
_X86_64 = "x86-64", "x86-64-v3", "x86-64-v4,-prefer-256-bit"
TARGETS = {
    "x86_64-linux": Target(
        "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", "_kernels.abi3.so", "manylinux_2_17_x86_64",
        _X86_64, ("-Wl,-z,undefs",),
    ),
    "aarch64-linux": Target(
        "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", "_kernels.abi3.so", "manylinux_2_17_aarch64",
        ("generic",), ("-Wl,-z,undefs",),
    ),
    "arm64-macos": Target(
        "arm64-apple-macosx11.0.0", "aarch64-macos.11.0", "_kernels.abi3.so", "macosx_11_0_arm64", ("apple-m1",),
        ("-Wl,-undefined,dynamic_lookup",),
    ),
    "x86_64-windows": Target(
        "x86_64-pc-windows-gnu", "x86_64-windows-gnu", "_kernels.pyd", "win_amd64", _X86_64,
    ),
}  # fmt: skip


@dataclass(frozen=True)
class Use:
    """A call of a kernel: where it is found, and the types that it was called with."""

    module: str
    name: str
    made_in: str | None
    releases: bool
    types: tuple[Any, ...]


def main() -> int:
    """Build; return 1 if a part fails."""
    arguments = _parser().parse_args()
    if arguments.stage is not None:
        _STAGES[arguments.stage](*arguments.rest)
        return 0
    begun = time.monotonic()
    build(arguments.out, arguments.target or list(TARGETS), arguments.part)
    for file in sorted(arguments.out.rglob("_kernels.*")):
        print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")
    print(f"built in {time.monotonic() - begun:.0f} s")
    return 0


def build(out: Path, targets: Sequence[str], parts: Sequence[str] = ()) -> None:
    """Build libraries with the kernels of some parts, by default of all, each in a folder of its target's name."""
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(os.cpu_count()) as pool:
        names = [",".join(parts)] if parts else groups()
        built = list(pool.map(lambda name: _build_part(name, targets, Path(folder)), names))
        for target in targets:
            link([entry for entries in built for entry in entries], target, Path(folder), out / target)


def groups() -> list[str]:
    """Return the parts that share their kernels, together: tasks of one declaration."""
    from cutenv.commands.warm import parts
    from cutenv.task.registry import TASKS

    together: dict[Any, list[str]] = {}
    for name in parts():
        together.setdefault(TASKS[name].task if name in TASKS else name, []).append(name)
    return [",".join(names) for names in together.values()]


def _build_part(name: str, targets: Sequence[str], folder: Path) -> list[dict[str, Any]]:
    """Build the objects of a part in processes of their own; return its entries."""
    stem = folder / "".join(character for character in name if character.isalnum())
    for stage, numba in (("see", {}), ("translate", _TRANSLATION), ("emit", {})):
        wanted = ",".join(targets) if stage == "emit" else name
        command = [sys.executable, __file__, "--stage", stage, wanted, str(stem)]
        subprocess.run(command, env=os.environ | {"CUTENV_COMPILE": "1"} | numba, check=True)
    with stem.with_suffix(".entries").open("rb") as file:
        entries: list[dict[str, Any]] = pickle.load(file)
    return entries


# Numba reads these when it is imported.
_TRANSLATION = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


def see(part: str, stem: str) -> None:
    """Use a part, and write a file of the kernels that were called, each with the types of its arguments."""
    from cutenv._engine import jit

    uses: dict[Use, None] = {}
    compiled = jit._compiled

    def watched(function: Any, cache: bool = True, **options: Any) -> Any:
        dispatcher = compiled(function, cache, **options)
        if not options.get("no_cpython_wrapper"):
            compile_for = dispatcher._compile_for_args
            place = function.__module__, function.__qualname__, getattr(function, "made_in", None)

            def seen(*arguments: Any) -> Any:
                types = tuple(dispatcher.typeof_pyval(each) for each in arguments)
                uses[Use(*place, bool(options.get("nogil")), types)] = None
                return compile_for(*arguments)

            dispatcher._compile_for_args = seen
        return dispatcher

    jit._compiled = watched
    from cutenv.commands.warm import compile_part

    for each in part.split(","):
        module, _, name = each.partition(":")
        if name:
            sys.path.insert(0, "")
            getattr(import_module(module), name)()
        else:
            compile_part(each)
    with Path(stem).with_suffix(".uses").open("wb") as file:
        pickle.dump(list(uses), file)


def translate(part: str, stem: str) -> None:
    """Translate the kernels that a part calls to LLVM's intermediate code; write it to a file, and one of entries."""
    from cutenv._engine import jit

    jit.kernel_folder = lambda *_, **__: None
    jit._print_once = lambda *_: None
    with Path(stem).with_suffix(".uses").open("rb") as file:
        uses: list[Use] = pickle.load(file)
    import llvmlite.binding as llvm

    entries, whole = [], None
    forms = set()
    for number, use in enumerate(uses):
        dispatcher = dispatcher_of(use)
        dispatcher.compile(use.types)
        compiled = dispatcher.overloads[use.types]
        entry = form_of(use, compiled) | {"symbol": f"{Path(stem).name}_{number}"}
        if (key := (entry["name"], tuple(entry["arguments"]))) in forms:
            continue
        forms.add(key)
        entries.append(entry)
        for code in (compiled.library.get_llvm_str(), entry_code(compiled, entry["symbol"])):
            part_of_it = llvm.parse_assembly(code)
            if whole is None:
                whole = part_of_it
            else:
                whole.link_in(part_of_it)
    symbols = {entry["symbol"] for entry in entries}
    for each in (*whole.functions, *whole.global_variables):
        if not each.is_declaration:
            each.linkage = "external" if each.name in symbols else "internal"
    Path(stem).with_suffix(".bc").write_bytes(whole.as_bitcode())
    with Path(stem).with_suffix(".entries").open("wb") as file:
        pickle.dump(entries, file)


def emit(targets: str, stem: str) -> None:
    """Make one object for each level of each target."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    with Path(stem).with_suffix(".entries").open("rb") as file:
        symbols = [entry["symbol"] for entry in pickle.load(file)]
    code = Path(stem).with_suffix(".bc").read_bytes()
    for name in targets.split(","):
        target = TARGETS[name]
        machines = [machine_of(llvm, target.triple, level) for level in target.levels]
        module = llvm.parse_bitcode(code)
        module.triple, module.data_layout = target.triple, str(machines[0].target_data)
        inline(llvm, module, machines[0])
        inlined = module.as_bitcode()
        for level, machine in enumerate(machines):
            renamed = {symbol: f"{symbol}_{level}" for symbol in symbols}
            content = machine_code(llvm, llvm.parse_bitcode(inlined), machine, renamed)
            Path(f"{stem}-{name}-{level}.o").write_bytes(content)


def dispatcher_of(use: Use) -> Any:
    """Return what Numba compiles of a kernel."""
    if use.made_in is None:
        return attrgetter(use.name)(import_module(use.module))
    owner, _, name = use.name.rpartition(".")
    return getattr(import_module(use.made_in), name)(attrgetter(owner)(import_module(use.module)))


def form_of(use: Use, compiled: Any) -> dict[str, Any]:
    """Return name and form of a kernel, as scripts/kernels/binding.c reads it, its dtypes still in words."""
    signature = compiled.signature
    arguments = [part for kind in signature.args for part in _form(kind)]
    result = list(_form(signature.return_type))
    if any(part[0] in ("r", "w", "v", "dtype") for part in result):
        raise SystemExit(f"build_kernels: {use.name} of {use.module} returns memory: let it fill an argument instead.")
    name = f"{use.module}:{use.name}"
    named = getattr(signature.return_type, "instance_class", None)  # of a named tuple
    place = "" if named is None else f"{named.__module__}:{named.__qualname__}"
    modules = [use.module] if use.made_in is None else [use.module, use.made_in]
    entry = {"name": name, "releases": use.releases, "arguments": arguments, "result": result, "class": place}
    return entry | {"modules": modules}


def _form(kind: Any) -> Iterator[str | tuple[str, str]]:
    """Yield the letters of a type; of an array's dtype its description, to be numbered."""
    from numba.core import types
    from numba.np.numpy_support import as_dtype

    from cutenv._engine.native import memory_of

    letters = {types.float64: "d", types.float32: "f", types.int64: "l", types.uint64: "u", types.boolean: "b"}
    if kind in letters:
        yield letters[kind]
    elif isinstance(kind, types.BaseTuple):
        yield "("
        for each in kind:
            yield from _form(each)
        yield ")"
    elif isinstance(kind, types.Array):
        yield f"{'w' if kind.mutable else 'r'}{'C' if kind.layout == 'C' else 'A'}{kind.ndim}"
        yield "dtype", memory_of(as_dtype(kind.dtype))
    elif isinstance(kind, types.Record):
        yield "v"
        yield "dtype", memory_of(as_dtype(kind))
    elif kind == types.none:
        yield "n"
    else:
        raise SystemExit(f"build_kernels: a kernel takes or returns {kind}: add it to scripts/kernels/binding.c.")


def entry_code(compiled: Any, symbol: str) -> str:
    """Return the intermediate code of an entry: it takes its arguments as 64-bit words, and calls the kernel."""
    from llvmlite import ir
    from numba.core import types

    context, described = compiled.target_context, compiled.fndesc
    module = ir.Module(symbol)
    word = ir.IntType(64)
    function = ir.Function(module, ir.FunctionType(ir.IntType(32), [word.as_pointer()] * 2), symbol)
    builder = ir.IRBuilder(function.append_basic_block())
    taken, given = 0, 0

    def next_word() -> Any:
        nonlocal taken
        taken += 1
        return builder.load(builder.gep(function.args[0], [word(taken - 1)]))

    def value_of(kind: Any) -> Any:
        if isinstance(kind, types.BaseTuple):
            return context.make_tuple(builder, kind, [value_of(each) for each in kind])
        if isinstance(kind, types.Array):
            array = context.make_array(kind)(context, builder)
            data = next_word()
            shape, strides = ([next_word() for _ in range(kind.ndim)] for _ in range(2))
            size = word(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
            count = word(1)
            for length in shape:
                count = builder.mul(count, length)
            array.data = builder.inttoptr(data, array.data.type)
            array.shape, array.strides = (_array_of(builder, word, each) for each in (shape, strides))
            array.itemsize, array.nitems = size, count
            array.meminfo = ir.Constant(array.meminfo.type, None)
            array.parent = ir.Constant(array.parent.type, None)
            return array._getvalue()
        number = next_word()
        if isinstance(kind, types.Record):
            return builder.inttoptr(number, context.get_value_type(kind))
        if kind == types.float64:
            return builder.bitcast(number, ir.DoubleType())
        if kind == types.float32:
            return builder.bitcast(builder.trunc(number, ir.IntType(32)), ir.FloatType())
        return builder.trunc(number, ir.IntType(1)) if kind == types.boolean else number

    def give(kind: Any, value: Any) -> None:
        nonlocal given
        if isinstance(kind, types.BaseTuple):
            for k, each in enumerate(kind):
                give(each, builder.extract_value(value, k))
        elif kind != types.none:
            if kind == types.float64:
                value = builder.bitcast(value, word)
            elif kind == types.float32:
                value = builder.zext(builder.bitcast(value, ir.IntType(32)), word)
            elif kind == types.boolean:
                value = builder.zext(value, word)
            builder.store(value, builder.gep(function.args[1], [word(given)]))
            given += 1

    callee = context.declare_function(module, described)
    values = [value_of(kind) for kind in described.argtypes]
    status, result = context.call_conv.call_function(builder, callee, described.restype, described.argtypes, values)
    with builder.if_then(status.is_ok):
        give(described.restype, result)
    failed = builder.select(status.is_ok, ir.Constant(ir.IntType(32), 0), ir.Constant(ir.IntType(32), 1))
    builder.ret(failed)
    return str(module)


def _array_of(builder: Any, word: Any, values: list[Any]) -> Any:
    from llvmlite import ir

    whole = ir.Constant(ir.ArrayType(word, len(values)), ir.Undefined)
    for k, value in enumerate(values):
        whole = builder.insert_value(whole, value, k)
    return whole


_RUNTIME = {  # of binding.c; and of any C library, exact in each
    "NRT_Allocate", "NRT_Free", "NRT_MemInfo_alloc_aligned", "NRT_MemInfo_call_dtor", "numba_attempt_nocopy_reshape",
    "floor", "memcpy", "memmove", "memset", "rint", "sqrt",
}  # fmt: skip


def machine_of(llvm: Any, triple: str, level: str) -> Any:
    """Return llvmlite's back end for one level of a target."""
    cpu, _, features = level.partition(",")
    target: Any = llvm.Target.from_triple(triple)
    return target.create_target_machine(cpu=cpu, features=features, opt=3, reloc="pic", codemodel="default")


def inline(llvm: Any, module: Any, machine: Any) -> None:
    """Inline and simplify, until counts of references meet and cancel: the first of Numba's two passes."""
    _optimise(llvm, module, machine, vectorise=False)


def machine_code(llvm: Any, module: Any, machine: Any, symbols: dict[str, str]) -> bytes:
    """Return an object file of a module that was inlined, its entries renamed: the second of Numba's two passes."""
    _optimise(llvm, module, machine, vectorise=True)
    called = {each.name for each in module.functions if each.is_declaration and not each.name.startswith("llvm.")}
    if unknown := sorted(called - _RUNTIME):
        raise SystemExit(f"build_kernels: kernels call {', '.join(unknown)}: would it be the same on every machine?")
    for symbol, name in symbols.items():
        module.get_function(symbol).name = name
    return machine.emit_object(module)


def _optimise(llvm: Any, module: Any, machine: Any, vectorise: bool) -> None:
    tuning: Any = llvm.create_pipeline_tuning_options(speed_level=3)
    tuning.loop_vectorization = tuning.slp_vectorization = vectorise
    builder: Any = llvm.create_pass_builder(machine, tuning)
    passes = builder.getModulePassManager()
    if not vectorise:
        passes.add_loop_rotate_pass()
        passes.add_instruction_combine_pass()
        passes.add_jump_threading_pass()
    passes.add_refprune_pass()
    passes.run(module, builder)


def link(entries: list[dict[str, Any]], name: str, folder: Path, out: Path) -> None:
    """Write the table of entries, compile the binding, and link it with the objects of the parts."""
    target = TARGETS[name]
    out.mkdir(parents=True, exist_ok=True)
    once: dict[tuple[str, tuple[Any, ...]], dict[str, Any]] = {}
    for entry in entries:
        once.setdefault((entry["name"], tuple(entry["arguments"])), entry)
    (folder / "table.h").write_text(table(list(once.values()), len(target.levels)), encoding="utf-8")
    objects = sorted(str(path) for path in folder.glob(f"*-{name}-*.o"))
    compiler = [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        target.zig,
        "-O2",
        "-shared",
        "-s",
        "-lm",
        f"-I{folder}",
    ]
    imports = [str(_python_of_windows(folder))] if "windows" in target.zig else []
    subprocess.run(
        [*compiler, *target.options, "-o", str(out / target.file), str(BINDING), *objects, *imports], check=True
    )


def _python_of_windows(folder: Path) -> Path:
    """Return a library that says which functions Windows finds in python3.dll."""
    import re

    names = sorted(set(re.findall(r"\b_?Py_?[A-Z]\w+(?= ?\(|,|;)", BINDING.read_text(encoding="utf-8"))))
    data = ("PyFloat_Type", "PyBool_Type", "PyTuple_Type", "PyLong_Type", "_Py_NoneStruct")
    data += ("PyExc_RuntimeError", "PyExc_SystemError")
    names = [name for name in names if not name.startswith("PyInit")]
    lines = [f"{name} DATA" if name in data else name for name in names]
    definition, library = folder / "python3.def", folder / "python3.lib"
    definition.write_text("\n".join(["LIBRARY python3.dll", "EXPORTS", *lines, ""]), encoding="utf-8")
    tool = [sys.executable, "-m", "ziglang", "dlltool", "-m", "i386:x86-64", "-D", "python3.dll"]
    subprocess.run([*tool, "-d", str(definition), "-l", str(library)], check=True)
    return library


def table(entries: list[dict[str, Any]], levels: int) -> str:
    """Return the header file with the table of entries, dtypes, sources and levels."""
    from cutenv._engine.native import digest_of

    dtypes: dict[str, int] = {}
    symbols = [entry["symbol"] for entry in entries]
    lines = [f"extern int {symbol}_{k}(const int64_t *, int64_t *);" for symbol in symbols for k in range(levels)]
    rows = []
    for entry in entries:
        arguments, result = (_letters(entry[each], dtypes) for each in ("arguments", "result"))
        texts = ", ".join(f'"{text}"' for text in (entry["name"], arguments, result, entry["class"]))
        rows.append(f"    {{{texts}, {int(entry['releases'])}}},")
    lines += ["static const Entry entries[] = {", *rows, "};"]
    lines += [f"static const Kernel kernels[{levels}][{len(entries)}] = {{"]
    lines += [f"    {{{', '.join(f'{symbol}_{k}' for symbol in symbols)}}}," for k in range(levels)]
    sources = sources_of(entries)
    lines += ["};", _texts("dtypes", list(dtypes)), _texts("sources", sources)]
    sizes = {"ENTRIES": len(entries), "DTYPES": len(dtypes), "SOURCES": len(sources), "LEVELS": levels}
    first = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n".join([*first, f'#define DIGEST "{digest_of(sources)}"', *lines, ""])


def _letters(form: list[Any], dtypes: dict[str, int]) -> str:
    return "".join(part if isinstance(part, str) else f"{dtypes.setdefault(part[1], len(dtypes)):03x}" for part in form)


def _texts(name: str, values: list[str]) -> str:
    quoted = ", ".join(f'"{value}"' for value in values)
    return f"static const char *const {name}[] = {{{quoted}}};"


def sources_of(entries: list[dict[str, Any]]) -> list[str]:
    """Return the files whose content is compiled into the kernels, relative to the package."""
    from cutenv._engine import jit

    files = set().union(*(jit.sources(module) for entry in entries for module in entry["modules"]))
    return sorted(path.relative_to(PACKAGE).as_posix() for path in files)


_STAGES = {"see": see, "translate": translate, "emit": emit}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--target", choices=list(TARGETS), action="append", help="system; may be given again")
    parser.add_argument("--out", type=Path, default=Path("build") / "kernels", metavar="FOLDER")
    parser.add_argument("--part", action="append", metavar="NAME", help="task, or MODULE:FUNCTION that calls kernels")
    parser.add_argument("--stage", choices=list(_STAGES), help=argparse.SUPPRESS)
    parser.add_argument("rest", nargs="*", help=argparse.SUPPRESS)
    return parser


if __name__ == "__main__":
    sys.exit(main())
