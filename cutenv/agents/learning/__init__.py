"""Training and evaluation of agents.

Needs the extra ``rl``: ``pip install 'cutenv[rl]'``.

A module is imported when it is used, since some load torch:

- :mod:`~cutenv.agents.learning.seeds`: seeds of the specimens for training, validation and test;
- :mod:`~cutenv.agents.learning.evaluation`, :mod:`~cutenv.agents.learning.statistics`: scores of policies on the same
  held-out specimens, with intervals (``cutenv evaluate``);
- :mod:`~cutenv.agents.learning.on_policy` (PPO, recurrent PPO), :mod:`~cutenv.agents.learning.off_policy` (SAC, TQC,
  CrossQ), :mod:`~cutenv.agents.learning.bc`, :mod:`~cutenv.agents.learning.iql`: the learners of ``cutenv train``, with
  options and defaults in :mod:`~cutenv.agents.learning.arguments`;
- :mod:`~cutenv.agents.learning.progress`, :mod:`~cutenv.agents.learning.cloning`,
  :mod:`~cutenv.agents.learning.asymmetric_actors`: their parts;
- :mod:`~cutenv.agents.learning.minari_datasets`: recorded and simulated cuts as Minari data sets (``cutenv datasets``);
- :mod:`~cutenv.agents.learning.rllib_env`: the environment for runners of Ray RLlib.
"""
