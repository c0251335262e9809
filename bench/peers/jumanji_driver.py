"""Measures RobotWarehouse of Jumanji with random actions, many warehouses at once, in processor
time.

    python jumanji_driver.py WAREHOUSES STEPS   ->  one line of JSON: {"agent_steps_per_second": []}

An agent step is an action of one agent, with an observation for it. What JAX compiles is compiled
before.
"""

import json
import sys
import time

import jax
import jumanji
from jumanji.wrappers import VmapAutoResetWrapper

REPEATS = 5


def main() -> None:
    """Measure, and print what was measured."""
    warehouses = int(sys.argv[1])
    steps = int(sys.argv[2])
    env = jumanji.make("RobotWarehouse-v0")
    many = VmapAutoResetWrapper(env)
    shape = (warehouses, env.num_agents)

    def step(state, key):
        # An agent has five actions.
        actions = jax.random.randint(key, shape, 0, 5)
        state, timestep = many.step(state, actions)
        return state, timestep.reward.sum()

    @jax.jit
    def steps_of_all(state, key):
        return jax.lax.scan(step, state, jax.random.split(key, steps))

    state, _ = jax.jit(many.reset)(jax.random.split(jax.random.PRNGKey(1), warehouses))
    rates = []
    # The first one compiles.
    for number in range(1 + REPEATS):
        begun = time.process_time()
        state, rewards = steps_of_all(state, jax.random.PRNGKey(number))
        rewards.block_until_ready()
        rates.append(steps * shape[0] * shape[1] / (time.process_time() - begun))
    print(json.dumps({"agent_steps_per_second": rates[1:]}))


if __name__ == "__main__":
    main()
