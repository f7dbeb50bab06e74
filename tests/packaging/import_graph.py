"""Who imports whom among the modules of a checkout, read from their syntax trees."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from pathlib import Path

Graph = dict[str, set[str]]


def module_files(root: Path, folders: Mapping[str, str]) -> dict[str, Path]:
    """Return each module below ``folders`` (folder -> prefix of its modules' names) with its file."""
    found = {}
    for folder, prefix in folders.items():
        for path in sorted((root / folder).rglob("*.py")):
            parts = path.relative_to(root / folder).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            found[".".join([*filter(None, [prefix]), *parts])] = path
    return found


def import_graph(files: Mapping[str, Path]) -> Graph:
    """Return what each module imports of the others at its top level, for annotations alone included."""
    graph: Graph = {}
    for name, path in files.items():
        found = set(_imports(ast.parse(path.read_text(encoding="utf-8")), files))
        graph[name] = found - {name}
    return graph


def _imports(tree: ast.AST, files: Mapping[str, Path]) -> Iterator[str]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in files)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                target = inner if inner in files else node.module
                if target in files:
                    yield target
        else:
            yield from _imports(node, files)


def cycles(graph: Graph) -> list[list[str]]:
    """Return every set of modules that import each other in a circle (Tarjan's strongly connected components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in sorted(graph.get(name, ())):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            circle = [stack.pop()]
            while circle[-1] != name:
                circle.append(stack.pop())
            if len(circle) > 1:
                found.append(sorted(circle))

    for name in graph:
        if name not in index:
            visit(name)
    return found
