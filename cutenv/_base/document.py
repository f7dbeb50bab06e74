"""Documents of one file, filled from Jinja2 templates."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

_TEMPLATES = Path(__file__).parent / "templates"


def render(
    template: Path,
    values: Mapping[str, Any],
    *,
    folders: Sequence[Path] = (),
    filters: Mapping[str, Callable[..., Any]] | None = None,
) -> str:
    """Return a filled template, escaped; missing names are errors.

    It may extend ``document.html``: a document that loads nothing else.  Further ``folders`` of templates and the
    template's own are searched first.  ImportError, with the command that installs it, if Jinja2 is missing.
    """
    try:
        import jinja2  # an extra
    except ImportError as error:
        cure = "Pages need Jinja2. Install it with: pip install 'cutenv[view]'"
        raise ModuleNotFoundError(cure, name="jinja2") from error
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, *folders, _TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters or {})
    return environment.get_template(template.name).render(values)


def as_base64(data: bytes) -> str:
    """Return bytes as text for a page."""
    return base64.b64encode(data).decode("ascii")


def script_digest(code: str) -> str:
    """Return a script's SHA-256 as base64, for a content security policy."""
    return as_base64(hashlib.sha256(code.encode()).digest())
