"""Commands of ``cutenv``: one module with ``main(argv)`` for each.

``cutenv rig run`` is ``cutenv.commands.rig.run``; :mod:`~cutenv.commands.cli` lists them all with their extras.

May import: people, agents, envs, emulation, drivers, rig, display, vision, task, records, sim.
"""
