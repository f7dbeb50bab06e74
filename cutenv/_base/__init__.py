"""Building blocks of every wing: validation, documented constants, files written whole, packaged data."""
