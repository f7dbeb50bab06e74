"""Tasks: what an agent sees, what it is charged for, and when an episode ends.

Each task is declared in one module by the classes of :mod:`~cutenv.task.declare`: action axes, components of the
observation, terms of the reward, costs of the whole cut, ends and success. The terms of gentle cutting stand in
:mod:`~cutenv.task.reward`, those of the others in :mod:`~cutenv.task.depth` and :mod:`~cutenv.task.path`: a term is one
entry there.

:mod:`~cutenv.task.registry` lists the tasks with all that belongs to each. :mod:`~cutenv.task.stepper` compiles the
step of a declared task, for one cut, rows of cuts and the readings of a rig. Nothing here knows Gymnasium.

May import: records, sim.
"""
