"""Extension of griffe: the docstrings that mkdocstrings shows, with links and tables that Markdown understands."""

from __future__ import annotations

import inspect
import pydoc
from typing import Any

import griffe

from scripts.documentation.restructured import with_links, with_tables


class Docstrings(griffe.Extension):
    """Rewrite every docstring before it is parsed."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite the docstring of ``obj``, where it has one."""
        if obj.docstring is not None:
            described = obj.is_class and obj.path.startswith("cutenv.envs.")  # is filled in when it is imported
            text = inspect.getdoc(pydoc.locate(obj.path)) if described else obj.docstring.value
            obj.docstring.value = with_tables(with_links(text or ""))
