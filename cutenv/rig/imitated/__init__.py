"""Imitated rigs, beside the one that moves hardware.

The emulator on real wires, the fake in memory, both by name.
"""
