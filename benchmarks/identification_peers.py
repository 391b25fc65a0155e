"""The same simulated logs given to FIGAROH and to MuJoCo's sysid: `python -m benchmarks.identification_peers [PEER …]`.

FIGAROH (`pip install figaroh`) fits the efforts of all joints of a tree and knows of no loops, so it is given one arm
of the RPDR by itself, both its joints driven; and then, to see what comes of it, the RPDR's two arms as if they were
not joined: positions of all four joints, and no effort at the two that nothing drives. MuJoCo's sysid (`pip install
'mujoco[sysid]'`) fits what a simulation shows, loops and all: it is given the RPDR as ccpin writes it, with tight
loops, pieces of the log of a twentieth of a second, and the states that ccpin's smoothing finds at their beginnings.

Logs are those of `benchmarks.identification`: constants a fifth off what is stated, friction in every joint, efforts
with noise. Told: the efforts that each one's constants miss on another motion, over their root mean square. A peer that
is not installed is skipped, and said so.
"""

from __future__ import annotations

import argparse
import logging
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from dataclasses import replace
from importlib import import_module
from io import StringIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

import ccpin
from benchmarks import identification as own
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link
from ccpin.identification import Log, identify, smoothed

Motion = tuple[np.ndarray, np.ndarray, np.ndarray]
CUTOFF = 10.0  # Hz, of FIGAROH's filter of positions
EDGE = 0.2  # s, at either end of a log, where that filter takes positions before and after to be 0
PIECE, EVERY, ITERATIONS = 25, 50, 3  # samples of a piece for MuJoCo, samples between two; steps of its search


def main(arguments: list[str] | None = None) -> None:
    """Print each peer's lines."""
    parser = argparse.ArgumentParser("python -m benchmarks.identification_peers", description=__doc__)
    parser.add_argument("peers", nargs="*", default=list(PEERS), help=f"of {', '.join(PEERS)}")
    for name in parser.parse_args(arguments).peers:
        needed, compare = PEERS[name]
        try:
            import_module(needed)
        except ImportError as error:
            print(f"{name}: skipped, it is not installed ({error})", flush=True)
            continue
        compare()


def figaroh() -> None:
    """One arm alone, which both take; and the RPDR as two arms, which is another robot."""
    arm = one_arm()
    shown, unseen = (swings(arm, seed) for seed in (1, 2))
    truth, log = robot(arm, shown)
    Y = arm.regressor_many(*unseen)[:, :2]
    made = {
        "ccpin": Y @ identify(arm, log).parameters.values,
        "FIGAROH": by_figaroh(arm, ("joint1", "joint3"), log, unseen),
        "stated": Y @ arm.parameters.values,
    }
    told("one arm of the RPDR, both joints driven", Y @ truth, made)
    both = ccpin.ReducedModel(ccpin.load("rpdr"))
    shown, unseen = (swings(both, seed) for seed in (1, 2))
    truth, log = robot(both, shown)
    passive = {
        f"q_{name}": column for name, column in zip(("joint3", "joint4"), passive_positions(both, shown), strict=True)
    }
    still = {f"u_{name}": np.zeros(len(log.t)) for name in ("joint3", "joint4")}
    cut = Log(log.t, {**log.columns, **passive, **still})
    Y = both.regressor_many(*unseen)
    made = {
        "ccpin": Y @ identify(both, log).parameters.values,
        "FIGAROH, arms not joined": by_figaroh(both, both.mechanism.tree.names, cut, unseen)[:, [0, 2]],
        "stated": Y @ both.parameters.values,
    }
    told("the RPDR", Y @ truth, made)


def by_figaroh(model: ccpin.ReducedModel, tree: Sequence[str], log: Log, unseen: Motion) -> np.ndarray:
    """Efforts of a tree's joints along a motion, by constants that FIGAROH finds for it, of shape (N, joints)."""
    base: Any = import_module("figaroh.identification.base_identification")
    regressors: Any = import_module("figaroh.tools.regressor")
    loaded: Any = import_module("figaroh.tools.robot")
    logging.disable(logging.ERROR)
    settings = {
        "robot_name": model.mechanism.name,
        "has_friction": True,
        "has_actuator_inertia": True,
        "has_joint_offset": False,
        "is_joint_torques": True,
        "is_external_wrench": False,
        "qr_relative_tolerance": 1e-4,
        "active_joints": list(tree),
        "act_idxq": list(range(len(tree))),
        "act_idxv": list(range(len(tree))),
        "filter_config": {
            "differentiation_method": "gradient",
            "filter_params": {"nbutter": 4, "f_butter": CUTOFF, "med_fil": 5, "f_sample": own.RATE},
        },
    }

    class Identification(base.BaseIdentification):  # type: ignore[misc, name-defined]
        def load_param(self, config_file: str, setting_type: str = "identification") -> None:
            self.identif_config = settings

        def load_trajectory_data(self, data_source: str | None = None) -> dict[str, Any]:
            columns = (np.column_stack([log.columns[f"{what}_{name}"] for name in tree]) for what in "qu")
            q, u = columns
            return {"timestamps": log.t, "positions": q, "velocities": None, "accelerations": None, "torques": u}

        def process_torque_data(self, **_: Any) -> np.ndarray:
            return self.raw_data["torques"]

    with tempfile.TemporaryDirectory() as folder, redirect_stdout(StringIO()):
        path = Path(folder) / "tree.urdf"
        model.mechanism.save(path)
        document = ElementTree.parse(path)
        for joint in [each for each in document.getroot().findall("joint") if each.get("name") not in tree]:
            carried = document.find(f"link[@name='{joint.find('child').get('link')}']")
            document.getroot().remove(joint)
            document.getroot().remove(carried)
        document.write(path)
        robot = loaded.Robot(str(path), package_dirs=folder)
        assert tuple(robot.model.names[1:]) == tuple(tree)
        found = Identification(robot, "")
        found.initialize()
        found._sample_mask = (log.t > EDGE) & (log.t < log.t[-1] - EDGE)
        found.solve(decimate=False, plotting=False, wls=True)
        there, v = model.terms_many(unseen[0], unseen[1]), unseen[1]
        places = [model.mechanism.tree.joint(name).v.start for name in tree]
        a = np.einsum("sij,sj->si", there.rho, unseen[2]) + np.einsum("sij,sj->si", there.rho_dot, v)
        moved = (there.q_free, np.einsum("sij,sj->si", there.rho, v), a)
        W = regressors.build_regressor_basic(robot, *(rows[:, places] for rows in moved), settings)
    kept = regressors.build_regressor_reduced(W, found._idx_eliminated)[:, found._base_indices]
    return np.asarray((kept @ found.phi_base).reshape(len(tree), -1).T)


def mujoco_sysid() -> None:
    """The RPDR with its loop."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    shown, unseen = (swings(model, seed) for seed in (1, 2))
    truth, log = robot(model, shown)
    Y = model.regressor_many(*unseen)
    found, seconds = timed(lambda: identify(model, log))
    theirs, longer = timed(lambda: by_mujoco(model, log))
    made = {
        f"ccpin ({seconds:.1f} s of a core)": Y @ found.parameters.values,
        f"mujoco.sysid ({longer:.0f} s)": Y @ theirs,
        "stated": Y @ model.parameters.values,
    }
    told("the RPDR", Y @ truth, made)


def by_mujoco(model: ccpin.ReducedModel, log: Log) -> np.ndarray:
    """Constants that sysid finds for the model as written with tight loops: of bodies, dampers, friction, rotors."""
    import mujoco
    from mujoco import sysid

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "robot.xml"
        model.mechanism.save(path, loops="tight")
        spec = mujoco.MjSpec.from_file(str(path))
    for name in model.mechanism.actuated:
        spec.add_sensor(
            name=f"q_{name}", type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=name
        )
    compiled, parameters = spec.compile(), sysid.ParameterDict()
    for body in [joint.child for joint in model.mechanism.description.joints]:
        pseudo = sysid.body_inertia_param(spec, compiled, body, sysid.InertiaType.Pseudo, modifier=inertia_of(body))
        parameters.add(pseudo)
    for joint in model.mechanism.tree.names:
        for word, most in (("damping", 0.1), ("frictionloss", 0.1)):
            parameters.add(sysid.Parameter(f"{word} {joint}", 1e-3, 0.0, most, modifier=setter(joint, word)))
    motion = smoothed(log, model)
    pieces = [slice(k, k + PIECE) for k in range(0, len(log.t) - PIECE, EVERY)]
    states, controls, sensors = [], [], []
    for piece in pieces:
        begin = piece.start
        here = model.at(motion.q[begin])
        states.append(sysid.create_initial_state(compiled, here.q_free, here.v_free(motion.v[begin])))
        times = log.t[piece] - log.t[begin]
        u, q = (np.column_stack([log.columns[f"{s}_{name}"][piece] for name in model.mechanism.actuated]) for s in "uq")
        controls.append(sysid.TimeSeries.from_control_names(times, u, compiled))
        sensors.append(sysid.TimeSeries.from_names(times, q, compiled))
    names = [str(k) for k in range(len(pieces))]
    runs = sysid.ModelSequences("rpdr", spec, names, states, controls, sensors)
    residual = sysid.build_residual_fn(models_sequences=[runs], n_threads=1)
    with redirect_stdout(StringIO()):
        best, _ = sysid.optimize(parameters, residual, verbose=False, max_iters=ITERATIONS)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "found.xml"
        path.write_text(sysid.apply_param_modifiers_spec(best, spec.copy()).to_xml())
        again = ccpin.ReducedModel(ccpin.load(path))
    assert again.parameters.names == model.parameters.names
    return np.asarray(again.parameters.values)


def setter(joint: str, word: str) -> Callable[[Any, Any], None]:
    """Writes a number of a joint into a specification."""

    def write(spec: Any, parameter: Any) -> None:
        value, held = float(parameter.value[0]), getattr(spec.joint(joint), word)
        setattr(spec.joint(joint), word, np.array([[value], [0.0], [0.0]]) if np.ndim(held) else value)  # a polynomial

    return write


def inertia_of(body: str) -> Callable[[Any, Any], None]:
    """Writes sysid's pseudo-inertia into a specification as principal axes (MuJoCo 4.0.0 compiles no other)."""
    import mujoco

    modifiers: Any = import_module("mujoco.sysid._src.model_modifier")

    def write(spec: Any, parameter: Any) -> None:
        pi, there, quaternion = modifiers.pi_from_theta(parameter.value), spec.body(body), np.empty(4)
        com = pi[1:4] / pi[0]
        about = pi[4:].reshape(3, 3) - pi[0] * (com @ com * np.eye(3) - np.outer(com, com))
        sizes, axes = np.linalg.eigh(about)
        axes[:, 0] *= np.sign(np.linalg.det(axes))
        mujoco.mju_mat2Quat(quaternion, axes.ravel())
        there.mass, there.ipos, there.inertia, there.iquat = pi[0], com, sizes, quaternion
        there.fullinertia = np.full((6, 1), np.nan)

    return write


def one_arm() -> ccpin.ReducedModel:
    """Links 1 and 3 of the RPDR, driven at both joints, and a pair of geared wheels beside: ccpin takes no tree."""
    rpdr = ccpin.load("rpdr").description
    kept, driven, inertia = ("base", "link1", "link3"), ("joint1", "joint3", "wheel1"), 1e-5 * np.eye(3)
    wheels = [Link(name, Inertia(0.01, np.zeros(3), inertia)) for name in ("hub1", "hub2")]
    hinges = [Joint(f"wheel{k}", "revolute", "base", f"hub{k}", np.eye(4), np.array([0.0, 0.0, 1.0])) for k in (1, 2)]
    arm = replace(
        rpdr,
        name="arm",
        links=(*(link for link in rpdr.links if link.name in kept), *wheels),
        joints=(*(joint for joint in rpdr.joints if joint.child in kept), *hinges),
        closures=(),
        couplings=(Coupling("gear", (CouplingTerm("wheel1", (0.0, 1.0)), CouplingTerm("wheel2", (0.0, -2.0)))),),
        independent=driven,
        actuated=driven,
        motors=(),
        reference={name: rpdr.reference[name] for name in driven[:2]},
    )
    return ccpin.ReducedModel(ccpin.load(arm))


def swings(model: ccpin.ReducedModel, seed: int) -> Motion:
    """q, q̇, q̈ of sums of sines at the log's rate."""
    draw, t = np.random.default_rng(seed), np.arange(0.0, own.DURATION, 1.0 / own.RATE)
    w = 2.0 * np.pi * draw.uniform(0.3, 1.6, (3, model.n))
    size, phase = 0.12 * draw.uniform(0.5, 1.0, w.shape), draw.uniform(0.0, 2.0 * np.pi, w.shape)
    angle = t[:, None, None] * w + phase
    q = model.alpha(model.mechanism.q_reference) + (size * np.sin(angle)).sum(axis=1)
    return q, (size * w * np.cos(angle)).sum(axis=1), -(size * w**2 * np.sin(angle)).sum(axis=1)


def passive_positions(model: ccpin.ReducedModel, motion: Motion) -> np.ndarray:
    """Of joints that are no coordinates, with encoders' noise, one a row."""
    rows = model.sigma_many(motion[0])
    tree, draw = model.mechanism.tree, np.random.default_rng(9)
    passive = [name for name in tree.names if name not in model.mechanism.independent]
    return np.array(
        [rows[:, tree.joint(name).q.start] + own.ENCODER[False] * draw.normal(size=len(rows)) for name in passive]
    )


def robot(model: ccpin.ReducedModel, motion: Motion) -> tuple[np.ndarray, Log]:
    """A robot's constants and its log."""
    draw, t = np.random.default_rng(0), np.arange(0.0, own.DURATION, 1.0 / own.RATE)
    truth = own.another(model, draw)
    moved = own.Moved(t, model.regressor_many(*motion), motion)
    return truth, own.logged(model, moved, moved.Y @ truth, draw)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """What some work answers, and the seconds of a core that it took."""
    begin = time.process_time()
    return work(), time.process_time() - begin


def told(what: str, efforts: np.ndarray, made: dict[str, np.ndarray]) -> None:
    """Print what each misses."""
    size = np.sqrt((efforts**2).mean())
    each = (f"{who} {100.0 * np.sqrt(((u - efforts) ** 2).mean()) / size:.3g} %" for who, u in made.items())
    print(f"{what}: missed, unseen: {', '.join(each)}", flush=True)


PEERS = {"figaroh": ("figaroh", figaroh), "mujoco": ("mujoco.sysid.report.defaults", mujoco_sysid)}

if __name__ == "__main__":
    main()
