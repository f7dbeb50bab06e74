"""Hook of hatchling: a wheel that brings compiled kernels is for one platform; every other one needs the compiler."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

PLATFORM = "CUTENV_WHEEL_PLATFORM"
"""Environment variable with the platform's tag; the kernels are those that scripts/build_kernels.py left."""


class KernelsHook(BuildHookInterface):
    """Tags the wheel, and adds the compiler to the requirements of one without kernels."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Change what hatchling is about to build."""
        platform = os.environ.get(PLATFORM)
        if version == "editable" or platform is None:
            build_data["dependencies"] += self.metadata.core_raw_metadata["optional-dependencies"]["compile"]
            return
        if not (libraries := sorted(Path(self.root, "cutenv", "_engine").glob("_kernels.*"))):
            raise FileNotFoundError(f"{PLATFORM} = {platform}, but there are no kernels: scripts/build_kernels.py.")
        build_data["pure_python"] = False
        build_data["tag"] = f"cp311-abi3-{platform}"
        build_data["artifacts"] += [f"cutenv/_engine/{library.name}" for library in libraries]
