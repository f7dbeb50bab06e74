"""TQC from parts of the package: SAC with quantile critics.

    python agents/tqc.py                              some four minutes; writes runs/<name>/policy/
    python agents/tqc.py --timesteps 30000 --name mine

``cutenv train --learner tqc`` makes the same policy, with --resume, --quick, an evaluation and a report; the
comments in sac.py apply here too.
"""

from __future__ import annotations

from pathlib import Path

import torch
from sb3_contrib import TQC

from cutenv.agents.learning.arguments import TQCArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricTQCPolicy
from cutenv.agents.learning.cloning import script_demonstrations
from cutenv.agents.learning.off_policy import imitate, network, off_policy_keywords, remember
from cutenv.agents.learning.progress import Progress
from cutenv.agents.learning.run_folder import export, record_run, run_program


def train(arguments: TQCArguments, run: Path) -> None:
    """Train an agent, and write its actor into ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "TQC")
    environments = arguments.training_environments()
    model = TQC(AsymmetricTQCPolicy, environments, **off_policy_keywords(arguments))
    if arguments.demonstrations:
        shown = script_demonstrations(environments, arguments)
        remember(model, shown)
        imitate(model.policy, shown, arguments)

    progress = Progress(run, arguments, curve=[])
    model.learn(arguments.timesteps, callback=progress)
    progress.validate()

    best = TQC.load(run / "policy.zip", device="cpu").policy.state_dict()
    weights = {name: values.numpy() for name, values in best.items()}
    export(arguments, run / "policy", network(weights, "relu"), facts)


if __name__ == "__main__":
    run_program(train, TQCArguments, "tqc", __doc__)
