"""Tasks of sweeps, in a module so that other processes find them."""

import os
import time

import numpy as np


def parabola(case):
    """A number and a list, and an error where x < 0."""
    if case["x"] < 0:
        raise ValueError(f"x = {case['x']} is negative")
    return {"y": case["x"] ** 2, "both": [case["x"], 2 * case["x"]]}


def drawn(case):
    """A random number of the case's own seed."""
    return {"noise": np.random.default_rng(case["seed"]).normal()}


def deadly(case):
    """Kills its process where told to."""
    if case["dies"]:
        os._exit(3)
    return {"y": case["x"]}


def slow(case):
    """Leaves word in a folder that it ran."""
    with open(os.path.join(case["folder"], f"ran_{case['x']}"), "a", encoding="utf-8") as file:
        file.write("x")
    time.sleep(0.05)
    return {"y": case["x"]}
