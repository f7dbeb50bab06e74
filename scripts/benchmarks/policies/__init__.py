"""Tables of agents, scripts and planners on the same held-out specimens."""
