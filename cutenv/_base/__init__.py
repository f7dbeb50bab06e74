"""Building blocks of every package.

Validation, documented constants, files written whole, packaged data.
"""
