"""Programs that derive constants of the package from the thesis's tables and from finite elements: assets/derived."""
