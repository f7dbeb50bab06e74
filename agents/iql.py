"""Implicit Q-learning from parts of the package: offline, from scripted cuts.

    python agents/iql.py                            some four minutes; writes runs/<name>/policy/
    python agents/iql.py --epochs 10 --name mine

``cutenv train --learner iql`` makes the same policy, with --resume, an evaluation and a report, and also learns from a
Minari data set (--dataset).  The losses are in ``cutenv/agents/learning/iql.py``.
"""

from __future__ import annotations

from pathlib import Path

import torch
from tqdm import tqdm

from cutenv.agents.learning.arguments import IQLArguments
from cutenv.agents.learning.iql import Agent, ImplicitQLearning, transition_data
from cutenv.agents.learning.progress import validate
from cutenv.agents.learning.run_folder import export, record_run, run_program


def train(arguments: IQLArguments, run: Path) -> None:
    """Fit the scripts' cuts; write the best epoch to ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "IQL")
    data, facts["taught_by"] = transition_data(arguments)
    agent = Agent(arguments, data.observations.shape[1])
    learning = ImplicitQLearning(agent, data, arguments)
    every = max(arguments.epochs // arguments.validations, 1)
    best = float("-inf")
    for epoch in tqdm(range(1, arguments.epochs + 1), desc="fitting", unit="epoch"):
        learning.run_epoch()
        if epoch == arguments.epochs or epoch % every == 0:
            mean_return, success = validate(agent, arguments)
            tqdm.write(f"epoch {epoch}: return {mean_return:.3f}, success {success:.2f} on validation specimens")
            if mean_return > best:
                best = mean_return
                export(arguments, run / "policy", agent.network(), facts)


if __name__ == "__main__":
    run_program(train, IQLArguments, "iql", __doc__)
