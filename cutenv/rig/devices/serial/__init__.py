"""Devices on a serial line: the board of ``assets/firmware``, with a load cell and a stepper."""
