"""Checks of rigs, in real time on an emulator: faults, attacks, soak, jitter, haptic devices, twins."""
