"""Meshes of cut slabs as input of CalculiX and Abaqus, and their tip's compliance by CalculiX."""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.sim.tissue.split_mesh import DoubledMesh

MODULUS, POISSON, THICKNESS = 1e4, 0.3, 0.01  # modulus [Pa], Poisson's ratio [1] and thickness [m] of the slab
_LOAD = 1e-2  # on the tip [N]
_DISPLACED = re.compile(r"^\s*(\d+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$")


def deck(mesh: DoubledMesh, title: str, *, strain: bool = False) -> str:
    """Return an input file, in plane stress or strain; the tip is pulled along x in one step, along y in the next.

    A pair of nodes on the faces of the cut moves alike across the cut, and is free to slide along it.
    """
    kinds = ("CPE8", "CPE6") if strain else ("CPS8", "CPS6")
    lines = ["*HEADING", title, "*NODE, NSET=ALL"]
    lines += [f"{k}, {x:.9g}, {y:.9g}, 0." for k, (x, y) in enumerate(mesh.nodes, 1)]
    number = 1
    for kind, name, elements in zip(kinds, ("QUADS", "TRIANGLES"), (mesh.quadrilaterals, mesh.triangles), strict=True):
        if not len(elements):
            continue
        lines.append(f"*ELEMENT, TYPE={kind}, ELSET={name}")
        lines += [f"{k}, " + ", ".join(str(n + 1) for n in nodes) for k, nodes in enumerate(elements, number)]
        number += len(elements)
    lines += ["*MATERIAL, NAME=TISSUE", "*ELASTIC", f"{MODULUS:g}, {POISSON:g}"]
    for name, elements in (("QUADS", mesh.quadrilaterals), ("TRIANGLES", mesh.triangles)):
        if len(elements):
            lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL=TISSUE", f"{THICKNESS:g}"]
    lines += ["*NSET, NSET=TIP", str(mesh.tip + 1), "*BOUNDARY"]
    lines += [f"{node + 1}, 1, 2" for node in mesh.clamped]
    for (left, right), (x, y) in zip(mesh.pairs, mesh.directions, strict=True):
        normal = {1: -y, 2: x}
        first, second = sorted(normal, key=lambda axis: -abs(normal[axis]))
        terms = [(right, first, normal[first]), (right, second, normal[second])]
        terms += [(left, first, -normal[first]), (left, second, -normal[second])]
        kept = [term for term in terms if abs(term[2]) > 1e-12]
        lines += ["*EQUATION", str(len(kept))]
        lines.append(", ".join(f"{node + 1}, {axis}, {factor:.12g}" for node, axis, factor in kept))
    for axis in (1, 2):
        lines += ["*STEP", "*STATIC", "*CLOAD, OP=NEW", f"{mesh.tip + 1}, {axis}, {_LOAD:g}"]
        lines += ["*NODE PRINT, NSET=TIP", "U", "*END STEP"]
    return "\n".join(lines) + "\n"


def compliance(mesh: DoubledMesh, program: str) -> Any:
    """Return the displacement of the tip per force in plane strain, times modulus and thickness, shape (2, 2)."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "cut.inp").write_text(deck(mesh, "cut", strain=True), encoding="ascii")
        done = subprocess.run([program, "cut"], cwd=folder, capture_output=True, text=True, check=False)
        printed = Path(folder) / "cut.dat"
        if done.returncode or not printed.is_file():
            raise RuntimeError(f"{program} failed:\n{done.stdout[-2000:]}{done.stderr[-500:]}")
        found = [_DISPLACED.match(line) for line in printed.read_text(encoding="ascii").splitlines()]
    moved = np.array([[float(match[2]), float(match[3])] for match in found if match])
    if moved.shape != (2, 2):
        raise RuntimeError(f"{program} printed {len(moved)} displacements of the tip, not 2")
    return moved.T / _LOAD * MODULUS * THICKNESS
