"""The real rig: a motor and a force sensor that a policy meets through the simulator's interface, and that stop."""
