"""Building blocks of every wing.

Validation, documented constants, files written whole, packaged data.
"""
