"""Every public call answers every wrong argument with an error of ccpin's: never an AttributeError from inside."""

import inspect
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin import (
    control,
    description,
    domain,
    dynamics,
    identification,
    mechanism,
    plotting,
    programs,
    simulation,
    transmission,
    validated,
    visualization,
)
from ccpin.control.control_law import NoTorque
from ccpin.control.online import capped_sigma
from ccpin.control.stability.set_point.sampled_region import sample_region
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.description.finding import find_file, installed_models
from ccpin.domain import scalar_coordinates_at
from ccpin.domain.atlas.square import newton_steps
from ccpin.errors import CcpinError
from ccpin.plotting.motion import plot_configuration_panels
from ccpin.simulation.plant.stick_slip import friction_force
from ccpin.simulation.results.forces import closure_forces_at
from tests.support.long_cases import later

ROOMS = ("control", "description", "domain", "dynamics", "mechanism", "plotting", "simulation", "transmission")
ROOMS += ("identification", "validated")
WRONG = (None, "rpbr", -1, np.nan, [], [[1.0, 2.0]], np.zeros((3, 3)), {"a": 1}, [object()], np.ones(2) * 1j, 10**400)
FLAGS = {"floating_base", "loop", "open_browser", "failures", "proved", "workers", "executor", "checkpoint"}
# What these hold is given by ccpin, or looked at where it is used.
HELD = {"Atlas", "Gains", "Region", "SetPointCertificate", "State", "Trajectory", "Scene", "Viewer", "Mechanism"}
ABSTRACT = {"ControlLaw", "HasForce", "Reference", "TrackingLaw", "drawing"}
LONG = {
    ("certify_law", "domain"),
    ("certify_set_point", "domain"),
    ("design", "evaluations"),
    ("enclose", "duration"),
    ("plot_sublevel", "starts"),
}


class Bench:
    """One of each thing that calls take."""

    def __init__(self, folder):
        self.folder = folder
        self.whole = ccpin.load("rpdr")
        self.model = ccpin.ReducedModel(self.whole)
        self.q = self.model.alpha(self.whole.q_reference)
        self.state = self.model.at(self.q)
        self.rest, self.q_free = np.zeros(2), self.state.q_free
        self.link = self.whole.description.links[-1].name
        self.law = control.PDSimpleGravity(self.model, self.q, 50.0, 5.0)
        self.hold = control.Hold(self.model, self.q)
        self.tracking = control.ComputedTorque(self.model, self.hold, 50.0, 5.0)
        self.run = ccpin.simulate(self.model, self.law, self.q, duration=0.02)
        self.effector = ccpin.EndEffector(self.model, self.link)
        self.tip = ccpin.EndEffector(self.model, "link3", (0.3048, 0.0, 0.0))
        self.box = (self.q - 0.02, self.q + 0.02)
        self.atlas = domain.certify(self.whole, self.q, region=self.box)
        self.sheets = domain.certify_sheets(self.whole, self.box, max_depth=2)
        self.cover = domain.certify_singularities(self.whole, self.box)
        self.certificate = certify_law(self.law, self.box)

    def methods(self, thing, skip=()):
        """The public methods of a thing, each with arguments that are right."""
        right = {"q": self.q, "v": self.rest, "a": self.rest, "u": self.rest, "force": self.rest, "wrenches": None}
        right |= {
            "state": self.state,
            "near": None,
            "q_free": self.q_free,
            "v_free": np.zeros(4),
            "threads": 1,
            "t": 0.0,
            "proved": False,
        }
        right |= {"failures": None, "Q": [self.q], "V": [self.rest], "U": [self.rest], "A": [self.rest], "V_r": None}
        right |= {
            "wrench": np.zeros(6),
            "efforts": None,
            "part": "linear",
            "loads": None,
            "v_r": None,
            "target": self.effector.pose(self.q),
        }
        found = {}
        for name, method in inspect.getmembers(thing, inspect.ismethod):
            if not name.startswith("_") and name not in skip:
                found[f"{type(thing).__name__}.{name}"] = (
                    method,
                    {p: right[p] for p in inspect.signature(method).parameters},
                )
        return found


def _ccpin(b):
    names, reference = list(b.whole.independent), {b.whole.independent[0]: 0.1}
    load = {"path": "rpdr", "closures": (), "couplings": (), "independent": names, "actuated": names, "joints": {}}
    load |= {"motors": {}, "format": None, "model": None, "include_root": None, "xacro": False, "xacro_arguments": None}
    load |= {"reference": reference, "geometry": None, "constraints": (), "geometry_tolerance": 1e-5}
    run = {"model": b.model, "controller": b.law, "q0": b.q, "v0": b.rest, "duration": 0.005, "near": None}
    run |= {"method": "RK45", "rtol": 1e-6, "atol": 1e-6, "sample_period": 0.005, "max_step": 1.0, "region": None}
    run |= {"settling": None, "friction": None, "wrenches": None, "sampling": None, "singular_rcond": 1e-7}
    closure = {"name": "a", "kind": "fixed", "link_a": "a", "link_b": "b", "placement_a": np.eye(4), "length": None}
    return {
        "load": (ccpin.load, load),
        "simulate": (ccpin.simulate, run),
        "ReducedModel": (ccpin.ReducedModel, {"mechanism": b.whole, "gravity": (0, 0, -9.81)}),
        "EndEffector": (ccpin.EndEffector, {"model": b.model, "link": b.link, "point": (0, 0, 0)}),
        "LoopClosure": (ccpin.LoopClosure, closure),
        "Mechanism.save": (b.whole.save, {"path": b.folder / "a.urdf", "format": "urdf"}),
        **b.methods(b.model),
        **b.methods(b.state, skip=("of",)),
        **b.methods(b.effector),
    }


def _control(b):
    pd = {"model": b.model, "q_d": b.q, "K_p": [50, 50], "K_v": [5, 5], "near": None}
    tracking = {"model": b.model, "reference": b.hold, "K_p": [50, 50], "K_v": [5, 5], "near": None}
    online = control.OnlineSigma(b.model, b.q_free)
    poses = [b.effector.pose(b.q), b.effector.pose(b.q + 0.01)]
    sampling = {"period": 0.001, "encoder_counts": 1000, "velocity_cutoff": 10.0, "saturation": 1.0, "delay": 1}
    newton = {"parametrization": b.whole.parametrization(), "q": b.q, "near": b.q_free, "max_newton_steps": 4}
    return {
        "NoTorque": (NoTorque, {"model": b.model}),
        "TorqueFunction": (control.TorqueFunction, {"function": lambda t, q, v: b.rest}),
        "PDSimpleGravity": (control.PDSimpleGravity, pd),
        "PDFullGravity": (control.PDFullGravity, pd),
        "ComputedTorque": (control.ComputedTorque, tracking),
        "PDPlus": (control.PDPlus, tracking),
        "PDOnlineGravity": (control.PDOnlineGravity, tracking),
        "CoulombCompensation": (
            control.CoulombCompensation,
            {"law": b.law, "coulomb": 0.1, "q_start": b.q, "width": 0.01},
        ),
        "WithSigmaError": (control.WithSigmaError, {"law": b.tracking, "offset": np.zeros(4)}),
        "OnlineSigma": (
            control.OnlineSigma,
            {"model": b.model, "q_free": b.q_free, "max_newton_steps": 4, "tolerance": 1e-9, "patience": 20},
        ),
        "OnlineLaw": (control.OnlineLaw, {"law": b.tracking, "online": online}),
        "Servos": (control.Servos, {"model": b.model, "inputs": b.rest}),
        "Sampling": (control.Sampling, sampling),
        "Hold": (control.Hold, {"model": b.model, "q": b.q}),
        "PointToPoint": (
            control.PointToPoint,
            {"model": b.model, "q_start": b.q, "q_goal": b.q + 0.1, "duration": 1.0},
        ),
        "Waypoints": (
            control.Waypoints,
            {"model": b.model, "times": [0, 1], "waypoints": [b.q, b.q + 0.1], "degree": 5},
        ),
        "through_points": (
            control.through_points,
            {"end_effector": b.effector, "times": [0, 1], "targets": poses, "degree": 5, "near": None},
        ),
        "capped_sigma": (capped_sigma, newton | {"tolerance": 1e-9}),
        "certify_law": (certify_law, {"law": b.law, "domain": b.box, "max_depth": None, "budget": None}),
        "certify_tracking": (
            control.certify_tracking,
            {"law": b.tracking, "sigma_error": 1e-4, "disturbance": 0.0, "initial_error": 0.0, "initial_speed": 0.0}
            | {"cells": 4},
        ),
        "largest_sigma_error": (
            control.largest_sigma_error,
            {"law": b.tracking, "disturbance": 0.0, "initial_error": 0.0, "initial_speed": 0.0, "cells": 4},
        ),
        "certify_set_point": (
            control.certify_set_point,
            pd | {"domain": b.box, "constants": None, "max_depth": None, "budget": None},
        ),
        "sample_region": (
            sample_region,
            {"model": b.model, "lower": b.box[0], "upper": b.box[1], "q_free_d": b.q_free, "points": 50},
        ),
        "local_gains": (
            control.local_gains,
            {"model": b.model, "q_d": b.q, "frequency": 10.0, "damping": 1.0, "near": None},
        ),
        "suggest_gains": (
            control.suggest_gains,
            {
                "model": b.model,
                "q_d": b.q,
                "domain": b.box,
                "constants": None,
                "margin": 1.5,
                "damping": 0.7,
                "near": None,
            },
        ),
        "PDSimpleGravity.torque": (b.law.torque, {"state": b.state, "v": b.rest, "t": 0.0}),
        "PDSimpleGravity.lyapunov": (b.law.lyapunov, {"q": b.q, "v": b.rest, "near": None}),
        "SetPointCertificate.contains": (b.certificate.contains, {"q": b.q, "v": b.rest}),
    }


def _description(b):
    parts = {"left_": description.Part(b.whole.description)}
    return {
        "read_description": (
            description.read_description,
            {
                "path": "rpdr",
                "format": None,
                "model": None,
                "include_root": None,
                "xacro": False,
                "xacro_arguments": None,
            },
        ),
        "scaled": (
            description.scaled,
            {"description": b.whole.description, "masses": 1.1, "lengths": {b.link: 1.0}, "friction": 1.0},
        ),
        "find_file": (find_file, {"path": "rpdr"}),
        "installed_models": (installed_models, {}),
        "combine": (
            description.combine,
            {"name": "a", "parts": parts, "links": (), "joints": (), "closures": (), "root": "world"},
        ),
    }


def _domain(b):
    path = [b.q, b.q + 0.02]
    x = b.tip.pose(b.q)[[0, 2], 3]
    asked = {"end_effector": b.tip, "near": None, "limits": True, "dexterity": 0.0, "length": None, "seconds": None}
    asked |= {"bounds": "auto"}
    largest = asked | {"centre": x, "proportions": 1.0, "tilt": 0.0, "within": 0.01, "tolerance": 0.5, "work": None}
    curves = {"starts": 2, "step": 0.05, "limit": 10}
    return {
        "certify": (
            domain.certify,
            {"mechanism": b.whole, "q0": b.q, "region": b.box, "near": None, "max_depth": 2, "bounds": "auto"}
            | {"resolution": 0.1, "fraction": 0.5, "seconds": None},
        ),
        "certify_sheets": (
            domain.certify_sheets,
            {"mechanism": b.whole, "region": b.box, "max_depth": 2, "budget": 1000, "bounds": "auto", "seconds": None},
        ),
        "certify_singularities": (
            domain.certify_singularities,
            {"mechanism": b.whole, "region": b.box, "resolution": 0.1, "budget": 1000, "seconds": None}
            | {"bounds": "auto"},
        ),
        "merge": (domain.merge, {"parts": [b.atlas]}),
        "merge of covers": (domain.merge, {"parts": [b.cover]}),
        "SingularCover.continued": (
            b.cover.continued,
            {"resolution": 0.1, "budget": 1000, "seconds": None, "bounds": "auto"},
        ),
        "split_region": (domain.split_region, {"region": b.box, "parts": 2}),
        "cusps": (domain.cusps, {"mechanism": b.whole, "region": b.box, "curves": ()}),
        "certify_workspace": (
            domain.certify_workspace,
            asked | {"region": (x - 0.01, x + 0.01), "max_depth": 2, "fraction": None},
        ),
        "largest_cube": (domain.largest_cube, largest),
        "largest_ball": (domain.largest_ball, largest),
        "design": (
            domain.design,
            {"build": dict, "ranges": {"a": (0.0, 1.0)}, "figure": len, "start": None, "evaluations": 3},
        ),
        "scaled_links": (domain.scaled_links, {"source": "rpdr", "links": {"arms": ("link1", "link2")}}),
        "certify_path": (
            domain.certify_path,
            {"mechanism": b.whole, "path": path, "tube": 1e-3, "near": None, "bounds": "auto"},
        ),
        "kantorovich_radius": (domain.kantorovich_radius, {"mechanism": b.whole, "q_free": b.q_free, "bounds": "auto"}),
        "newton_steps": (
            newton_steps,
            {"mechanism": b.whole, "q_free": b.q_free, "radius": 0.01, "accuracy": 1e-12, "bounds": "auto"},
        ),
        "theorem2": (domain.theorem2, {"mechanism": b.whole, "q_free": b.q_free}),
        "singularities": (domain.singularities, {"mechanism": b.whole, **curves}),
        "serial_singularities": (
            domain.serial_singularities,
            {"mechanism": b.whole, "link": b.link, "point": (0, 0, 0), **curves},
        ),
        "singularity_distance": (domain.singularity_distance, {"mechanism": b.whole, "path": path, "near": None}),
        "certified_radius": (domain.certified_radius, {"atlas": b.atlas, "q": [b.q]}),
        "scalar_coordinates_at": (scalar_coordinates_at, {"mechanism": b.whole, "q_free": b.q_free}),
    }


def _dynamics(b):
    linear = dynamics.linearize(b.model, b.q, b.rest)

    def push(**wrench):
        return b.state.forward_dynamics(b.rest, b.rest, {b.link: dynamics.Wrench(**wrench)})

    return {
        "assembly_modes": (dynamics.assembly_modes, {"model": b.model, "q": b.q, "patience": 5, "limit": 20}),
        "linearize": (
            dynamics.linearize,
            {"model": b.model, "q": b.q, "u": b.rest, "v": b.rest, "near": None, "wrenches": None},
        ),
        "Linearization.closed_loop": (linear.closed_loop, {"du_dq": np.eye(2), "du_dv": np.eye(2)}),
        "Wrench": (push, {"force": np.ones(3), "moment": (0, 0, 0), "point": (0, 0, 0)}),
    }


def _mechanism(b):
    model = b.whole.pin_model
    return {"describe_pinocchio": (mechanism.describe_pinocchio, {"model": model, "geometry": None, "constraints": ()})}


def _nothing(*_, **__):
    return 0.0


def _options(b):
    """How a run is made, of `Simulator` (and of `simulate`)."""
    options = {"model": b.model, "law": b.law, "method": "RK45", "rtol": 1e-6, "atol": 1e-6, "max_step": 1.0}
    options |= {"region": None, "friction": None, "wrenches": None, "sampling": None, "events": ()}
    return options | {"singular_rcond": 1e-7, "limits": None, "contacts": (), "motors": None}


def _simulation(b):
    forces = {"model": b.model, "trajectory": b.run, "wrenches": None}
    at = {"model": b.model, "q": b.q, "v": b.rest, "u": b.rest, "near": None, "wrenches": None}
    near = simulation.Settling(b.q, hold=0.002)
    supervised = {"model": b.model, "q0": b.q, "goals": [b.q], "wait": 0.003, "settling": near, "timeout": 0.01}
    supervised |= {"law_to": lambda goal, q_free: control.PDSimpleGravity(b.model, goal, 50, 5, q_free), "near": None}
    metrics = {"trajectory": b.run, "mechanism": b.whole, "goal": b.q, "band": 0.03}
    b.whole.save(b.folder / "twin.xml")
    twin = {"model": b.whole, "file": b.folder / "twin.xml", "u": b.rest, "duration": 0.01}
    return {
        "run_in_mujoco": (simulation.run_in_mujoco, twin),
        "closure_forces": (simulation.closure_forces, forces),
        "joint_forces": (simulation.joint_forces, forces),
        "closure_forces_at": (closure_forces_at, at),
        "friction_force": (friction_force, at | {"friction": (0.1, 0.1)}),
        "Trajectory.load": (ccpin.Trajectory.load, {"path": b.folder / "absent.npz"}),
        "lyapunov_along": (simulation.lyapunov_along, {"law": b.law, "trajectory": b.run}),
        "set_point_metrics": (simulation.set_point_metrics, metrics),
        "supervise": (simulation.supervise, supervised),
        "Trajectory.then": (b.run.then, {"other": b.run}),
        "Trajectory.states": (lambda model: list(b.run.states(model)), {"model": b.model}),
        "Trajectory.save": (b.run.save, {"path": b.folder / "t.npz"}),
        "Simulator": (ccpin.Simulator, _options(b)),
        "demands": (simulation.demands, forces),
        "exceeded": (simulation.exceeded, {"model": b.model, "trajectory": b.run}),
        "sweep": (ccpin.sweep, {"task": _nothing, "cases": [{}, {}], "seed": 1, "path": None, "progress": None}),
        "Disturbance": (simulation.Disturbance, {"pushes": ()}),
        "grid": (simulation.grid, {"values": {"a": [1, 2]}}),
        "sobol": (simulation.sobol, {"ranges": {"a": (0.0, 1.0)}, "count": 2, "seed": 0}),
        "latin_hypercube": (simulation.latin_hypercube, {"ranges": {"a": (0.0, 1.0)}, "count": 2, "seed": 0}),
    }


def _validated(b):
    run = {"model": b.model, "law": b.law, "q0": b.q, "v0": b.rest, "duration": 1e-3, "near": None}
    run |= {"precision": 64, "order": 4, "tolerance": 1e-6, "pieces": 2}
    spread = {"spread": 1e-6, "parts": 1, "cells": 1}
    return {
        "enclose": (validated.enclose, run | {"shortest_step": 1e-6, "longest_step": 1.0}),
        "enclose_set": (validated.enclose_set, run | spread | {"longest_slice": 1.0, "period": None}),
        "certify_move": (validated.certify_move, run | spread | {"arrival": 1.0, "spread": 0.0}),
        "certify_program": (validated.certify_program, _program(b)),
        "ProgramCertificate.load": (validated.ProgramCertificate.load, {"path": b.folder / "absent.npz"}),
    }


def _program(b):
    program = programs.record(b.model, "rho")
    q = np.array(program.example[: b.model.n])
    box = (q - 0.01, q + 0.01)
    return {"program": program, "region": box, "bounds": {}, "start": 1e-6, "formats": ("double",), "max_cells": 1}


def _identification(b):
    """A log of four seconds of the RPDR about its reference."""
    t = np.linspace(0.0, 4.0, 400)
    q = b.q + 0.1 * np.sin(np.outer(t, [3.0, 5.0]) + [0.0, 1.0])
    names = b.whole.independent
    columns = {f"{s}_{name}": q[:, k] for k, name in enumerate(names) for s in "qu"}
    log = identification.Log(t, columns)
    path = b.folder / "log.csv"
    log.save(path)
    smoothing = {"spacing": 0.05, "noise": {"q_joint1": 1e-3}}
    estimate = identification.identify(b.model, log, kinds=("inertia",), **smoothing)
    limits = {"lower": b.q - 0.1, "upper": b.q + 0.1, "speed": 1.0, "effort": None, "start": b.q}
    search = {"kinds": ("friction",), "waypoints": 2, "criterion": "trace", "starts": 1, "iterations": 0, "seed": 0}
    law = {"model": b.model, "reference": b.tracking.reference, "slope": 9.0, "K": [0.5, 0.5], "gain": 1.0}
    law |= {"period": 1e-3, "adapted": ("body",), "bounds": 0.2, "initial": np.ones(4), "near": None}
    adaptive = identification.AdaptiveTracking(**law)
    encoders = identification.Sensor.encoders(names, 1e-3)
    four = identification.Sensor.encoders(["joint1", "joint2", "joint3", "joint4"], 1e-3, offsets=())
    q_free, at = b.model.sigma_many(q[:20]), {"link": "link3", "point": (0.3, 0.0, 0.0)}
    return {
        "AdaptiveTracking": (identification.AdaptiveTracking, law),
        "AdaptiveTracking.constants": (adaptive.constants, {"estimate": np.ones(4)}),
        "AdaptiveTracking.program": (adaptive.program, {"given": "near", "steps": 1, "near": adaptive.near}),
        "certify_adaptive": (
            identification.certify_adaptive,
            {"law": adaptive, "initial_error": 0.0, "initial_sliding": 0.0, "cells": 4},
        ),
        "base_parameters": (
            identification.base_parameters,
            {"mechanism": b.whole, "forces": (), "base": False, "states": 1, "precision": 60, "box": None},
        ),
        "consistent": (identification.consistent, {"model": b.model, "estimate": estimate, "doubt": 10.0}),
        "excitation": (identification.excitation, {"model": b.model, "duration": 1.0} | limits | search),
        "explained": (
            identification.explained,
            {"model": b.model, "parameters": b.model.parameters, "log": log} | smoothing,
        ),
        "Sensor": (identification.Sensor, {"kind": encoders.kind}),
        "Sensor.encoders": (identification.Sensor.encoders, {"joints": names, "noise": 1e-3, "offsets": None}),
        "Sensor.tracker": (
            identification.Sensor.tracker,
            at | {"noise": 1e-3, "turn_noise": None, "target": False, "name": "tracker"},
        ),
        "Sensor.touch": (identification.Sensor.touch, at | {"noise": 1e-3, "name": "touch"}),
        "Sensor.plane": (
            identification.Sensor.plane,
            at | {"normal": (0.0, 0.0, 1.0), "distance": 0.0, "noise": 1e-3, "name": "plane"},
        ),
        "Sensor.bar": (identification.Sensor.bar, at | {"centre": np.zeros(3), "noise": 1e-3, "name": "bar"}),
        "calibrate": (
            identification.calibrate,
            {"model": b.model, "measurements": [(four, q_free[:, [0, 2, 1, 3]])], "parameters": ["joint3/x"]}
            | {"known": (), "priors": None, "coarsest": 0.1},
        ),
        "calibration_poses": (
            identification.calibration_poses,
            {"model": b.model, "count": 4, "measure": [four], "within": (b.q - 0.1, b.q + 0.1), "known": ()}
            | {"parameters": ["joint3/x"], "candidates": 9, "coarsest": 0.1, "seed": 0},
        ),
        "identify": (
            identification.identify,
            {"model": b.model, "logs": [log], "kinds": ("inertia",), "prior": {"mass": "5 %"}}
            | {"robust": True, "align": False, "stribeck": False, "motors": "10 %", "added": [{"mass:link3": 0.1}]}
            | smoothing,
        ),
        "Log": (identification.Log, {"t": t, "columns": columns, "source": "a log"}),
        "Log.read": (
            identification.Log.read,
            {"path": path, "columns": {"q_joint1": "q_joint1"}, "units": {"q": "deg"}, "time": "t"},
        ),
        "Log.save": (log.save, {"path": path}),
        "Log.between": (log.between, {"begin": 0.0, "end": 1.0}),
        "Log.delayed": (log.delayed, {"seconds": {"u": 0.01}}),
        "smoothed": (
            identification.smoothed,
            {"log": log, "model": b.model, "smoothness": 1.0} | smoothing,
        ),
        "with_constants": (
            identification.with_constants,
            {"model": b.model, "parameters": b.model.parameters},
        ),
    }


def _transmission(b):
    found = transmission.Transmission(b.whole, ["joint3", "joint4"])
    posture, q = found.reference, found.reference.q_joint
    swing = transmission.Swing(found, [0.1, 0.1], 1.0, q)
    along = {"transmission": found, "motion": swing, "near": None, "samples": 3}
    made = transmission.compare(**along)
    rocker = transmission.Transmission(ccpin.load("four_bar"))
    at = rocker.reference.q_joint
    pair = {"v_joint": b.rest, "a_joint": b.rest}
    joints = q + 0.02 * np.array([[k, k * k % 5] for k in range(8)])
    motors = [found.motor_from_joint(each) for each in joints]
    limits = {"effort": 1.0, "speed": 1.0}
    return {
        "Transmission": (
            transmission.Transmission,
            {"model": b.whole, "joints": ["joint3", "joint4"], "motors": ["joint1", "joint2"]},
        ),
        "Transmission.at": (found.at, {"q_joint": q, "near": None}),
        "Transmission.at_motor": (found.at_motor, {"q_motor": posture.q_motor, "near": posture}),
        "Transmission.motor_from_joint": (found.motor_from_joint, {"q_joint": q, "near": None}),
        "Transmission.joint_from_motor": (found.joint_from_motor, {"q_motor": posture.q_motor, "near": None}),
        "Posture.jacobian_rate": (posture.jacobian_rate, {"v_joint": b.rest}),
        "Posture.motor_velocity": (posture.motor_velocity, {"v_joint": b.rest}),
        "Posture.joint_velocity": (posture.joint_velocity, {"v_motor": b.rest}),
        "Posture.motor_acceleration": (posture.motor_acceleration, pair),
        "Posture.joint_effort": (posture.joint_effort, {"motor_effort": b.rest}),
        "Posture.motor_effort": (posture.motor_effort, {"joint_effort": b.rest}),
        "Posture.linkage_effort": (posture.linkage_effort, pair),
        "Posture.serial_effort": (posture.serial_effort, pair),
        "Posture.delivered_effort": (posture.delivered_effort, {"motor_effort": b.rest} | pair),
        "Posture.required_effort": (posture.required_effort, {"joint_effort": b.rest} | pair),
        "Posture.apparent_inertia": (posture.apparent_inertia, {"rotor_inertia": [1.0, 1.0]}),
        "Posture.joint_stiffness": (posture.joint_stiffness, {"stiffness": [1.0, 1.0], "motor_effort": None}),
        "Posture.motor_stiffness": (posture.motor_stiffness, {"stiffness": np.eye(2), "joint_effort": None}),
        "Posture.joint_damping": (posture.joint_damping, {"damping": [1.0, 1.0]}),
        "Posture.motor_damping": (posture.motor_damping, {"damping": [1.0, 1.0]}),
        "Posture.joint_play": (posture.joint_play, {"motor_play": [1.0, 1.0]}),
        "Posture.motor_play": (posture.motor_play, {"joint_play": [1.0, 1.0]}),
        "Posture.torque_polytope": (
            posture.torque_polytope,
            {"v_joint": None, "effort": 1.0, "motors": None, "friction": 0.0},
        ),
        "Posture.speed_polytope": (posture.speed_polytope, {"speed": 1.0}),
        "Polytope.largest_box": (posture.torque_polytope(effort=1.0).largest_box, {"shape": None}),
        "Swing": (
            transmission.Swing,
            {"transmission": found, "amplitude": [0.1, 0.1], "frequency": 1.0, "centre": None, "cycles": 1},
        ),
        "identify_geometry": (
            transmission.identify_geometry,
            {"transmission": found, "motor_positions": motors, "joint_positions": joints, "motor_noise": 1e-3}
            | {"joint_noise": 1e-3, "parameters": None, "known": (), "offsets": (), "priors": None},
        ),
        "compare": (transmission.compare, along | {"shortcut": "serial", "bandwidth": None}),
        "motor_loads": (transmission.motor_loads, along),
        "survey": (
            transmission.survey,
            {"transmission": found, "lower": q - 0.01, "upper": q + 0.01, "count": 2},
        ),
        "certify_limits": (
            transmission.certify_limits,
            {"transmission": found, "region": (q - 0.01, q + 0.01), "of": "effort", "size": None, "form": "box"}
            | {"shape": None, "effort": 1.0, "speed": None, "friction": None, "motors": None, "max_cells": 1},
        ),
        "serial_robot": (
            transmission.serial_robot,
            {"transmission": rocker, "region": (at - 0.01, at + 0.01), "at": at, "count": 3, "max_cells": 1} | limits,
        ),
        "Transmission.program": (found.program, {"given": "motors", "steps": 1}),
        "export_ros2": (
            transmission.export_ros2,
            {"transmission": found, "folder": b.folder, "maintainer": "Ada <ada@lab.org>", "license": "MIT"}
            | {"name": None, "region": None, "max_cells": 1},
        ),
        "plot_limits": (transmission.plot_limits, {"transmission": found, "title": None} | limits),
        "plot_shortcuts": (transmission.plot_shortcuts, {"comparisons": [made], "title": None}),
    }


def _visualization(b):
    still = {"mechanism": b.whole, "q_free": b.q_free, "path": b.folder / "a.html", "title": None}
    moving = still | {"t": [0, 0.1], "q_free": [b.q_free, b.q_free], "fps": 30, "trace": None, "speed": 1.0}
    moving |= {"forces": (), "size": None}
    live = {"mechanism": b.whole, "q_free": b.q_free, "t": None, "title": None, "fps": 30, "open_browser": False}
    inside = {name: value for name, value in live.items() if name != "open_browser"} | {"height": 300}

    def view(**given):
        visualization.view(**given).close()

    return {
        "animate": (visualization.animate, moving),
        "embed": (visualization.embed, inside),
        "snapshot": (visualization.snapshot, still),
        "view": (view, live),
    }


def _plotting(b):
    history = simulation.lyapunov_along(b.law, b.run)
    poses = {"mechanism": b.whole, "labels": ["here"], "title": None}
    area = {"mechanism": b.whole, "curves": (), "title": None}
    return {
        "plot_motion": (plotting.plot_motion, {"trajectory": b.run, "mechanism": b.whole, "goal": b.q, "title": None}),
        "plot_configurations": (plotting.plot_configurations, poses | {"configurations": [b.q_free]}),
        "plot_configuration_panels": (plot_configuration_panels, poses | {"panels": [("a", [b.q_free])]}),
        "plot_lyapunov": (plotting.plot_lyapunov, {"t": b.run.t, "history": history, "level": None, "title": None}),
        "plot_atlas": (plotting.plot_atlas, area | {"atlas": b.atlas}),
        "plot_sheets": (
            plotting.plot_sheets,
            {"mechanism": b.whole, "atlas": b.sheets, "cusps": (), "path": None, "title": None},
        ),
        "plot_radius_map": (plotting.plot_radius_map, area | {"atlas": b.atlas, "resolution": 8}),
        "plot_singularities": (plotting.plot_singularities, area | {"regions": ()}),
        "plot_sublevel": (
            plotting.plot_sublevel,
            {"certificate": b.certificate, "starts": (), "window": None, "title": None},
        ),
        "save": (plotting.save, {"figure": plotting.plot_motion(b.run, b.whole), "path": b.folder / "f.png"}),
    }


TABLES = {
    "": _ccpin,
    "control": _control,
    "description": _description,
    "domain": _domain,
    "dynamics": _dynamics,
    "identification": _identification,
    "mechanism": _mechanism,
    "plotting": _plotting,
    "simulation": _simulation,
    "transmission": _transmission,
    "validated": _validated,
    "visualization": _visualization,
}


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    """One of each thing that calls take."""
    return Bench(tmp_path_factory.mktemp("bench"))


@pytest.fixture(scope="module")
def tables(bench):
    """The calls of each room, with arguments that are right."""
    return {room: table(bench) for room, table in TABLES.items()}


def is_optional(call, argument):
    """Whether `None`, which is no wrong argument then, is what a call takes unless it is told otherwise."""
    known = inspect.signature(call).parameters
    return argument in known and known[argument].default is None


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("step", later(5, 1))
@pytest.mark.parametrize("room", TABLES)
def test_wrong_arguments(room, step, bench, tables, monkeypatch):
    """Each argument of each call in turn is replaced by what it is not: the answer is right, or a CcpinError.

    Every run tries each fifth value, with the next argument the ones beside them.
    """
    monkeypatch.chdir(bench.folder)  # "rpbr" is a path to some
    escaped = []
    for name, (call, right) in tables[room].items():
        for k, argument in enumerate(name for name in right if name not in FLAGS):
            values = () if (name, argument) in LONG else WRONG[is_optional(call, argument) :]
            for wrong in values[k % step :: step]:
                try:
                    call(**(right | {argument: wrong}))
                except CcpinError:
                    pass
                except Exception as error:
                    escaped.append(f"{name}({argument}={wrong!r:.40}): {error!r:.120}")
    assert not escaped, "\n".join(escaped)


@pytest.mark.parametrize("room", TABLES)
def test_every_public_call_is_in_the_table(room, tables):
    """Or is a record, an exception, or an abstract class."""
    face = import_module(f"ccpin.{room}" if room else "ccpin")
    listed = {name for table in tables.values() for name in table} | HELD | ABSTRACT | {"backend"}
    for name in face.__all__:
        thing = getattr(face, name)
        record = inspect.isclass(thing) and (hasattr(thing, "_fields") or hasattr(thing, "__dataclass_fields__"))
        raised = inspect.isclass(thing) and issubclass(thing, Exception)
        assert not callable(thing) or record or raised or name in listed or name == "CellStatus", name


def test_a_model_for_a_mechanism_and_the_reverse(bench, tmp_path):
    """Wherever one is wanted the other does."""
    q, box = bench.q, bench.box
    for subject in (bench.whole, bench.model):
        assert ccpin.ReducedModel(subject).mechanism is bench.whole
        assert control.certify_set_point(subject, q, 50.0, 5.0, box).level > 0
        assert domain.certify(subject, q, region=box, max_depth=0).radius > 0
        assert control.suggest_gains(subject, q, box).beta > 0
        visualization.snapshot(subject, None, tmp_path / "page.html")
        assert plotting.plot_configurations(subject, [bench.q_free], ["here"]) is not None
        assert len(list(bench.run.states(subject))) == len(bench.run.t)
    for wrong in ("rpdr", None, bench.law):
        with pytest.raises(ccpin.errors.InvalidInputError, match=r"a mechanism .* or a ReducedModel is needed, not"):
            domain.certify(wrong, q)


@pytest.mark.parametrize("name", ["motion.avi", "motion.png", "motion"])
def test_an_unknown_ending_is_no_film(name, bench, tmp_path):
    """The endings there are, are named; nothing is written."""
    with pytest.raises(ccpin.errors.InvalidInputError, match=r"as \.html, \.htm, \.mp4 or \.gif"):
        visualization.animate(bench.whole, [0, 1], [bench.q_free] * 2, Path(tmp_path) / name)
    assert not list(tmp_path.iterdir())
