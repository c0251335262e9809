"""Measures the Multi-Robot Warehouse, rware, with random actions, in processor time.

    python rware_driver.py NAME STEPS   ->  one line of JSON: {"agent_steps_per_second": [...]}

An agent step is an action of one agent, with an observation for it. `NAME`: of an environment, such
as rware-tiny-4ag-v2.
"""

import json
import sys
import time

import gymnasium
import numpy as np
import rware  # noqa: F401 - it registers the environments

REPEATS = 5


def main() -> None:
    """Measure, and print what was measured."""
    name = sys.argv[1]
    steps = int(sys.argv[2])
    env = gymnasium.make(name, disable_env_checker=True).unwrapped
    env.reset(seed=1)
    rates = []
    for _ in range(REPEATS):
        begun = time.process_time()
        for _ in range(steps):
            _, _, is_done, is_cut, _ = env.step(env.action_space.sample())
            # By the version of rware it is one truth value, or one for each agent.
            if is_cut or np.all(is_done):
                env.reset()
        rates.append(steps * env.n_agents / (time.process_time() - begun))
    print(json.dumps({"agent_steps_per_second": rates}))


if __name__ == "__main__":
    main()
