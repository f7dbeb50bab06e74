"""Extension of griffe: the docstrings that mkdocstrings shows, with links and tables that Markdown understands."""

from __future__ import annotations

from typing import Any

import griffe
from restructured import with_links, with_tables


class Docstrings(griffe.Extension):
    """Rewrite every docstring before it is parsed."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Rewrite the docstring of ``obj``, where it has one."""
        if obj.docstring is not None:
            obj.docstring.value = with_tables(with_links(obj.docstring.value))
