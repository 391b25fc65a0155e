"""Stribeck's friction found from simulated logs: `python -m benchmarks.stribeck [MODEL …] [--runs N] [--into FILE]`.

Robots, motions and noise are those of `benchmarks.identification`, but that Coulomb's levels of joints of one velocity
are 5 to 15 % of the efforts' root mean square, breakaway levels 1.3 to 2 times these, and Stribeck speeds a twentieth
to a fifth of the joints' largest. `identify` gets the file's model, which knows of no friction, and the log, once with
`stribeck=True` and once without.

Told: of how many joints an effect was told, how many of all 95 % intervals (±1.96 deviations) hold c, s and v_s, how
many profile intervals hold v_s, and the efforts missed on a motion that was not in the log, over their root mean
square, with the effect and with Coulomb's friction alone. `--none`: robots without it, of which none should be told.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import ccpin
from benchmarks.identification import MODELS, along, another, logged, motions, robots
from ccpin.identification import identify

LEVEL, HIGHER, SPEED = (0.05, 0.15), (0.3, 1.0), (0.05, 0.2)
"""Coulomb's levels, of efforts; breakaway above them, of them; and Stribeck speeds, of the joint's largest."""


def main(arguments: list[str] | None = None) -> None:
    """Print a model's lines each."""
    parser = argparse.ArgumentParser("python -m benchmarks.stribeck", description=__doc__)
    parser.add_argument("models", nargs="*", default=["rpdr"], help="installed models' names, or files")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--none", action="store_true", help="robots without the effect")
    parser.add_argument("--into", type=Path, help="a file of JSON lines")
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(name, asked.runs, asked.none, asked.into)


def told(name: str, runs: int, none: bool, into: Path | None = None) -> None:
    """Log and identify one mechanism again and again."""
    model = ccpin.ReducedModel(ccpin.load(name))
    joints = tuple(joint.name for joint in model.mechanism.tree.joints if joint.kind.nv == 1)
    (shown,), further = motions(model, *MODELS.get(name, (0.15, 2.0, 1)))
    moved, (_, unseen, states) = along(model, shown), along(model, further)
    columns, later = rubbing(model, joints, moved.Y, moved.states), rubbing(model, joints, unseen, states)

    def found_of(draw: np.random.Generator) -> dict[str, Any]:
        truth = another(model, draw)
        coulomb = np.sqrt(np.mean((moved.Y @ truth) ** 2)) * draw.uniform(*LEVEL, len(joints))
        truth[places(model, joints)] = coulomb
        more = coulomb * draw.uniform(*HIGHER, len(joints)) * (not none)
        speeds = np.abs(columns.rates).max(axis=0) * draw.uniform(*SPEED, len(joints))
        log = logged(model, moved, moved.Y @ truth + columns.falling(speeds, more), draw)
        found, plain = identify(model, log, stribeck=True), identify(model, log)
        efforts = unseen @ truth + later.falling(speeds, more)
        own = [each for each in found.stribeck if not each.reason]
        at = [joints.index(each.joint) for each in own]
        plainly = np.isin(found.parameters.names, model.parameters.names)
        levels, deviations = (np.array([getattr(e, n) for e in own]).reshape(-1, 3) for n in ("values", "deviations"))
        ends = np.array([each.interval for each in own]).reshape(-1, 2)
        seen = unseen @ found.parameters.values[plainly]
        fall, slow = np.zeros(len(joints)), np.ones(len(joints))
        fall[at], slow[at] = levels[:, 1] - levels[:, 0], levels[:, 2]
        seen += later.falling(slow, fall)
        true = np.stack([coulomb, coulomb + more, speeds], axis=1)[at]
        within = (ends[:, 0] <= true[:, 2]) & (true[:, 2] <= ends[:, 1])
        size = np.sqrt((efforts**2).mean())
        both = seen, unseen @ plain.parameters.values
        return {
            "joints": len(joints),
            "told": [each.joint for each in own],
            "away": np.round((levels - true) / deviations, 4).tolist(),
            "within": within.tolist(),
            "missed": [float(np.sqrt(((each - efforts) ** 2).mean()) / size) for each in both],
        }

    lines = robots(found_of, runs, into, model=name, none=none)
    print(f"{Path(name).stem}: {summary(lines)}", flush=True)


def places(model: ccpin.ReducedModel, joints: tuple[str, ...]) -> list[int]:
    """Where their Coulomb levels stand among all constants."""
    return [model.parameters.names.index(f"friction:{name}") for name in joints]


class Rubbing(NamedTuple):
    """Along a motion ρ_jᵀ sign q̇′_j, of shape (T, n, k), and q̇′_j of k joints, of shape (T, k)."""

    friction: np.ndarray
    rates: np.ndarray

    def falling(self, speeds: np.ndarray, more: np.ndarray) -> np.ndarray:
        """Efforts of dry friction beyond Coulomb's: Σ_j ρ_jᵀ (s − c) exp(−(q̇′_j/v_s)²) sign q̇′_j, of shape (T, n)."""
        return np.asarray(np.einsum("tnk,tk->tn", self.friction, more * np.exp(-((self.rates / speeds) ** 2))))


def rubbing(
    model: ccpin.ReducedModel, joints: tuple[str, ...], Y: np.ndarray, states: tuple[np.ndarray, ...]
) -> Rubbing:
    """That of a motion."""
    own = [model.mechanism.tree.joint(name).v.start for name in joints]
    rates = np.einsum("sij,sj->si", model.terms_many(*states[:2]).rho, states[1])
    return Rubbing(Y[..., places(model, joints)], rates[:, own])


def summary(lines: list[dict[str, Any]]) -> str:
    """What all robots of a model say together."""
    count, due = sum(len(line["told"]) for line in lines), sum(line["joints"] for line in lines)
    error = 100.0 * np.sqrt(np.mean(np.square([line["missed"] for line in lines]), axis=0))
    said = f"{len(lines)} robots, an effect told of {count} of {due} joints; missed, unseen: {error[0]:.3g} % with it, "
    said += f"{error[1]:.3g} % without; {np.mean([line['s'] for line in lines]):.2f} s of one core a robot"
    if not count:
        return said
    away = np.concatenate([np.reshape(line["away"], (-1, 3)) for line in lines])
    hold, spread = 100.0 * (np.abs(away) < 1.96).mean(axis=0), np.sqrt((away**2).mean(axis=0))
    within = 100.0 * np.mean([each for line in lines for each in line["within"]])
    words = ", ".join(f"{n} {h:.1f} % (RMS {r:.2f})" for n, h, r in zip(("c", "s", "v_s"), hold, spread, strict=True))
    return f"{said}\n  intervals that hold: {words}; profile intervals of v_s {within:.1f} %"


if __name__ == "__main__":
    main()
