"""Imports at first use, of a package's names and of extras."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from typing import Any

EXTRAS_OF_MODULE = {
    "PIL": ("data",),
    "av": ("vision",),
    "can": ("rig",),
    "canopen": ("rig",),
    "cv2": ("vision",),
    "h5py": ("data", "formats"),
    "joserfc": ("lti",),
    "jinja2": ("view", "rl", "serve", "view3d", "vision"),
    "mcap": ("ros", "formats"),
    "matplotlib": ("view", "rl", "serve", "vision"),
    "meshcat": ("view3d",),
    "minari": ("data",),
    "nidaqmx": ("daq",),
    "nptdms": ("formats",),
    "numba": ("compile",),
    "protobuf": ("formats",),
    "pyarrow": ("data", "formats", "vision"),
    "pygame": ("view",),
    "pymunk": ("play",),
    "pylsl": ("streams",),
    "python_calamine": ("formats",),
    "pyxdf": ("formats",),
    "rich": ("rl",),
    "rosbags": ("ros",),
    "safetensors": ("view", "data", "play", "rig", "rl"),
    "sb3_contrib": ("rl",),
    "serial": ("rig",),
    "sqlalchemy": ("serve",),
    "starlette": ("serve",),
    "uvicorn": ("serve",),
    "stable_baselines3": ("rl",),
    "statsmodels": ("stats",),
    "tensorboard": ("rl",),
    "tomlkit": ("rig",),
    "torch": ("rl",),
    "tqdm": ("view", "data", "rl", "serve", "vision"),
    "umsgpack": ("view3d",),
    "websockets": ("play",),
}
"""Extras that bring a module; the first is named unless the command has one of the others."""


def import_when_used(package: str, modules: Mapping[str, str], packages: Iterable[str] = ()) -> Callable[[str], Any]:
    """Return a package's lazy ``__getattr__`` (PEP 562) for names and packages."""

    def attribute(name: str) -> Any:
        if name in packages:
            return importlib.import_module(f"{package}.{name}")
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(importlib.import_module(modules[name]), name)

    return attribute


def optional_import(name: str, package: str, format_name: str, extra: str = "data") -> Any:
    """Import a module of an extra; ModuleNotFoundError has the pip command."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != name.partition(".")[0]:
            raise
        raise ModuleNotFoundError(
            f"{format_name} is read and written with {package}, which is not installed: pip install 'cutenv[{extra}]'",
            name=package,
        ) from None


def missing_extra(error: ModuleNotFoundError, preferred: str = "") -> str | None:
    """Return the pip command for a missing module, by its ``preferred`` extra, or None."""
    package = (error.name or "").partition(".")[0]
    extras = EXTRAS_OF_MODULE.get(package)
    if extras is None:
        return None
    extra = preferred if preferred in extras else extras[0]
    return f"{package} is not installed: pip install 'cutenv[{extra}]'"


def require(*packages: str) -> None:
    """Raise ModuleNotFoundError for a package that is not installed, before any work that needs it."""
    for package in packages:
        if find_spec(package) is None:
            raise ModuleNotFoundError(f"No module named {package!r}", name=package)


def import_from_here() -> None:
    """Let modules of the present folder be imported, as ``python -m``."""
    if "" not in sys.path:
        sys.path.insert(0, "")


@contextmanager
def extra_named(preferred: str = "") -> Iterator[None]:
    """Raise ModuleNotFoundError anew with the module's pip command."""
    try:
        yield
    except ModuleNotFoundError as error:
        cure = missing_extra(error, preferred)
        if cure is None:
            raise
        raise ModuleNotFoundError(cure, name=error.name) from None
