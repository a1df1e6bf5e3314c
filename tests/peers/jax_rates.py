"""Measures how fast simulators on JAX are on this processor, and prints JSON.

    python tests/peers/jax_rates.py frax|mjx FOLDER [--batch N]

`frax` measures forward dynamics of its own Panda. `mjx` measures steps of the first robot of a dataset, with the
integrator that is implicit in damping. Both use single precision, are compiled and batched by `vmap` as their
documentation advises, and use all cores. Without `--batch` the fastest batch is searched. Compiling does not count.
"""

import argparse
import contextlib
import importlib.metadata
import json
import sys
import time

import jax
import jax.numpy as jnp

BATCHES = {"frax": [64, 256, 1024], "mjx": [16, 64, 256]}
SECONDS = 1.0


def rate(function, batch):
    """Evaluations per second of a function that was compiled for `batch` at once."""
    jax.block_until_ready(function())
    start = time.perf_counter()
    calls = 0
    while time.perf_counter() - start < SECONDS:
        jax.block_until_ready(function())
        calls += 1
    return calls * batch / (time.perf_counter() - start)


def frax_rates(batches):
    from frax.robots.franka_panda import load_panda

    robot = load_panda()
    dynamics = jax.jit(jax.vmap(lambda q, v, u: robot.forward_dynamics(q, v, u, None)))
    rates = {}
    for batch in batches:
        q, v, u = jax.random.normal(jax.random.key(1), (3, batch, robot.nv), jnp.float32)
        rates[batch] = rate(lambda: dynamics(q, v, u), batch)
    return rates


def mjx_rates(folder, batches):
    import mujoco
    from mujoco import mjx

    import datasets
    import mujoco_arm

    robot, recorded = datasets.read(folder, 1)[0]
    compiled = mujoco_arm.model(robot, "implicitfast", 0.002)
    model = mjx.put_model(compiled)
    still = mjx.put_data(compiled, mujoco.MjData(compiled))
    still = still.replace(
        qpos=jnp.asarray(robot.q0, jnp.float32), qfrc_applied=jnp.asarray(recorded.u[0], jnp.float32)
    )
    # This is ten times as fast as with the model as an argument.
    step = jax.jit(jax.vmap(lambda data: mjx.step(model, data)))
    rates = {}
    for batch in batches:
        data = jax.tree.map(lambda value, batch=batch: jnp.stack([value] * batch), still)
        rates[batch] = rate(lambda data=data: step(data), batch)
    return rates


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("what", choices=["frax", "mjx"])
    parser.add_argument("folder", metavar="FOLDER")
    parser.add_argument("--batch", type=int)
    arguments = parser.parse_args()
    batches = [arguments.batch] if arguments.batch else BATCHES[arguments.what]
    # mjx prints the parts of it that cannot be imported.
    with contextlib.redirect_stdout(sys.stderr):
        if arguments.what == "frax":
            rates, package = frax_rates(batches), "frax"
        else:
            rates, package = mjx_rates(arguments.folder, batches), "mujoco-mjx"
    batch = max(rates, key=rates.get)
    print(
        json.dumps(
            {
                "version": importlib.metadata.version(package),
                "jax": jax.__version__,
                "batch": batch,
                "evaluations_per_s": rates[batch],
            }
        )
    )


if __name__ == "__main__":
    main()
