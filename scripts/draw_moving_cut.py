"""Draw a cut by the shipped agent as a moving picture: cut.gif in assets/pictures.

    python scripts/draw_moving_cut.py

It runs at twice the speed of the cut, and is repeated after a pause.
"""

from __future__ import annotations

from pathlib import Path

import gymnasium
import numpy as np
from PIL import Image  # comes with matplotlib

import cutenv  # noqa: F401  registers the environments
from cutenv.policy import named_policy

PICTURE = Path(__file__).parents[1] / "assets" / "pictures" / "cut.gif"
AGENT = "ppo-free"
SEED = 7
EVERY_S = 0.2
"""Time between two pictures [s], in which GIF can show twice the speed: its unit is 10 ms."""
PAUSE_MS = 3000
SIZE = (640, 480)
COLOURS = 40


def pictures() -> list[Image.Image]:
    """Return the pictures of a cut, from its start to its end."""
    agent = named_policy(AGENT)
    env = gymnasium.make(agent.card.environment, render_mode="rgb_array", **agent.environment_arguments)
    every = round(EVERY_S * env.metadata["render_fps"])  # decisions
    observation, info = env.reset(seed=SEED)
    agent.reset(np.random.default_rng(0))
    drawn, decisions, over = [env.render()], 0, False
    while not over:
        observation, _, terminated, truncated, info = env.step(agent(observation))
        decisions, over = decisions + 1, terminated or truncated
        if over or decisions % every == 0:
            drawn.append(env.render())
    print(f"{AGENT}, seed {SEED}: {info['end']}, success {info['is_success']}, {len(drawn)} pictures")
    return [Image.fromarray(np.asarray(each)).resize(SIZE, Image.Resampling.LANCZOS) for each in drawn]


def main() -> None:
    """Draw the pictures in few colours, those of three of them side by side, and save them."""
    drawn = pictures()
    chosen = np.concatenate([np.asarray(drawn[k]) for k in (0, len(drawn) // 2, -1)])
    palette = Image.fromarray(chosen).quantize(COLOURS, kmeans=3)
    frames = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in drawn]
    times = [round(500 * EVERY_S)] * (len(frames) - 1) + [PAUSE_MS]
    frames[0].save(PICTURE, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)
    print(f"picture: {PICTURE} ({PICTURE.stat().st_size / 1e3:.0f} kB)")


if __name__ == "__main__":
    main()
