"""Safety of a rig: the supervisor, its monitors, causes of a stop and quick stops."""
