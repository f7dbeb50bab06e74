"""Devices of a rig: driver protocols, samples, clocks, CANopen drives and the Net F/T sensor."""
