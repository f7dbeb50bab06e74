"""Drivers that are plugged in, and the conformance of anybody's.

The rig loads them by name alone.

They are found as those of other packages are, by ``module:attribute``, in the registry's table. Entry points would need
an installed distribution; the table works from a source tree, too, and all have one version.
"""
