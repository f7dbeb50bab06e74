"""Training and evaluation of agents.

Needs the extra ``rl``: ``pip install 'cutenv[rl]'``.

A module is imported when it is used, since some load torch:

- :mod:`~cutenv.learning.seeds`: seeds of the specimens for training, validation and test;
- :mod:`~cutenv.learning.evaluation`, :mod:`~cutenv.learning.statistics`: scores of policies on the same held-out
  specimens, with intervals (``cutenv evaluate``);
- :mod:`~cutenv.learning.ppo`, :mod:`~cutenv.learning.recurrent_ppo`, :mod:`~cutenv.learning.off_policy` (SAC, TQC,
  CrossQ), :mod:`~cutenv.learning.bc`, :mod:`~cutenv.learning.iql`: the learners of ``cutenv train``, with their options
  in :mod:`~cutenv.learning.arguments`;
- :mod:`~cutenv.learning.on_policy`, :mod:`~cutenv.learning.progress`, :mod:`~cutenv.learning.cloning`,
  :mod:`~cutenv.learning.asymmetric_actors`: their parts;
- :mod:`~cutenv.learning.minari_datasets`: recorded and simulated cuts as Minari data sets (``cutenv datasets``);
- :mod:`~cutenv.learning.rllib_env`: the environment for runners of Ray RLlib.
"""
