"""Devices on a serial line.

The board of ``assets/firmware``, with a load cell and a stepper.
"""
