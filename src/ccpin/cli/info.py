"""`ccpin info` and `ccpin modes`: what was loaded, and its assembly modes."""

from __future__ import annotations

import argparse
import json
from typing import Any

import numpy as np

import ccpin
from ccpin.cli.common import add_mechanism, add_vector, load, vector
from ccpin.modes import assembly_modes
from ccpin.report import in_words, summary


def add_info(commands: Any) -> None:
    """The command and its options."""
    parser = commands.add_parser("info", help="what was loaded: sizes, mobility, joints, conditioning")
    add_mechanism(parser)
    parser.set_defaults(run=_info)


def _info(options: argparse.Namespace) -> None:
    facts = summary(load(options))
    print(json.dumps(facts, indent=2) if options.json else in_words(facts))


def add_modes(commands: Any) -> None:
    """The command and its options."""
    parser = commands.add_parser("modes", help="the assembly modes over a given q")
    add_mechanism(parser)
    add_vector(parser, "q", "independent coordinates (default: the reference's)")
    parser.set_defaults(run=_modes)


def _modes(options: argparse.Namespace) -> None:
    mechanism = load(options)
    model = ccpin.ReducedModel(mechanism)
    q = vector(options, "q", mechanism)
    found = assembly_modes(model, model.alpha(mechanism.q_reference) if q is None else q)
    if options.json:
        modes = [mode._asdict() | {"q_free": mode.q_free.tolist()} for mode in found.modes]
        print(json.dumps({"modes": modes, "starts": found.starts, "singular": found.singular}, indent=2))
        return
    print(f"{len(found.modes)} assembly modes found from {found.starts} starts (sampled, not proved complete)")
    if found.singular:
        print(f"{found.singular} starts ended at singular configurations, which belong to no mode")
    for k, mode in enumerate(found.modes, start=1):
        reference = ", the reference's" if mode.is_reference else ""
        print(f"mode {k}{reference}: sign det ψ_q′ = {mode.sign:+d}, 1/κ = {mode.rcond:.3g}")
        print(f"  q′ = {np.array2string(mode.q_free, precision=6, separator=', ')}")
