"""An emulated rig: drive, screw, tissue and force sensor on the same wires, as a process of its own."""
