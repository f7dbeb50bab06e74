"""Behaviour cloning from parts of the package: imitate a script.

    python agents/bc.py                             some three minutes; writes runs/<name>/policy/
    python agents/bc.py --epochs 20 --name mine

``cutenv train --learner bc`` makes the same policy, with --resume, --dataset, an evaluation and a report.
"""

from __future__ import annotations

from pathlib import Path

import torch
from tqdm import tqdm

from cutenv.agents.learning.arguments import BCArguments
from cutenv.agents.learning.bc import Clone
from cutenv.agents.learning.cloning import Cloning, script_demonstrations
from cutenv.agents.learning.progress import validate
from cutenv.agents.learning.run_folder import export, record_run, run_program


def train(arguments: BCArguments, run: Path) -> None:
    """Fit the script's actions; write the best epoch to ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "behaviour cloning")
    clone = Clone(arguments)
    shown = script_demonstrations(arguments.training_environments(), arguments)
    cloning = Cloning(
        clone,
        list(clone.module.parameters()),
        shown.by_decision(),
        epochs=arguments.epochs,
        batch_size=arguments.batch_size,
        learning_rate=arguments.learning_rate,
        seed=arguments.seed,
    )
    every = max(arguments.epochs // arguments.validations, 1)
    best = float("-inf")
    for epoch in tqdm(range(1, arguments.epochs + 1), desc="cloning", unit="epoch"):
        cloning.run_epoch()
        if epoch == arguments.epochs or epoch % every == 0:
            mean_return, success = validate(clone, arguments)
            tqdm.write(f"epoch {epoch}: return {mean_return:.3f}, success {success:.2f} on validation specimens")
            if mean_return > best:
                best = mean_return
                export(arguments, run / "policy", clone.network(), facts)


if __name__ == "__main__":
    run_program(train, BCArguments, "bc", __doc__)
