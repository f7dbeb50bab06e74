"""Files and streams of other programs, as records.

A file becomes *named columns* (:mod:`~cutenv.records.foreign.named_columns`), whatever its format: text tables
(``text_tables``, with its parts ``text_lines``, ``table_layouts``, ``maker_headers`` and ``cell_values``), arrays
(``array_files``), Parquet (``arrow_file``), bags (``ros_bag``); ``files_by_suffix`` chooses. A *mapping* of these
columns (``column_map``) is given by a person or proposed (``proposal``); ``mapped_columns`` makes records of both.
:func:`cutenv.records.read_record` does all of it.
"""
