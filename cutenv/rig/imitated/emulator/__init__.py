"""Emulated rig.

Drive, screw, tissue and force sensor on the same wires, as a separate process.
"""
