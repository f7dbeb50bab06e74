"""Pages that are made of the package itself, blocks of pages, and hooks of MkDocs."""
