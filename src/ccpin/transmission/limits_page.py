"""One offline page about a transmission: its numbers, its limits over the range, and sliders to try postures with."""

from __future__ import annotations

import json
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.pages.html_page import Section, render
from ccpin.pages.parts import figure, paragraphs, preformatted, table
from ccpin.transmission.motor_limits import LimitsCertificate
from ccpin.transmission.pictures import UNITS, plot_limits
from ccpin.transmission.posture import Posture
from ccpin.transmission.surveys import Survey

_DRAWING = """
<div id="tryout"><p id="sliders"></p>
<svg id="polygon" viewBox="-110 -110 220 220" width="420" height="420" role="img" aria-label="joint efforts">
<line x1="-105" x2="105" y1="0" y2="0" stroke="currentColor" opacity=".3"/>
<line y1="-105" y2="105" x1="0" x2="0" stroke="currentColor" opacity=".3"/>
<text id="across" x="108" y="-4" text-anchor="end" font-size="7" fill="currentColor"/>
<text id="up" x="4" y="-101" font-size="7" fill="currentColor"/>
<polygon id="box" fill="none" stroke="#009e73" stroke-dasharray="4 3"/>
<polygon id="efforts" fill="#0072b2" fill-opacity=".15" stroke="#0072b2" stroke-width="1.5"/></svg>
<pre id="numbers"></pre></div>
<script type="application/json" id="postures">DATA</script>
<script>
(() => {
  const told = JSON.parse(document.getElementById("postures").textContent);
  const inputs = told.joints.map((joint, k) => {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, {type: "range", min: told.lower[k], max: told.upper[k], step: "any", value: told.start[k]});
    input.addEventListener("input", show);
    label.append(joint + " ", input);
    document.getElementById("sliders").append(label, " ");
    return input;
  });
  function show() {
    const q = inputs.map(input => Number(input.value));
    const far = p => p.q.reduce((s, x, k) => s + ((x - q[k]) / (told.upper[k] - told.lower[k])) ** 2, 0);
    const at = told.postures.reduce((a, b) => far(b) < far(a) ? b : a);
    const place = ([x, y]) => `${100 * x / told.scale[0]},${-100 * y / told.scale[1]}`;
    document.getElementById("efforts").setAttribute("points", at.corners.map(place).join(" "));
    const [w, h] = at.box;
    document.getElementById("box").setAttribute("points", [[w, h], [w, -h], [-w, -h], [-w, h]].map(place).join(" "));
    document.getElementById("numbers").textContent = at.words;
  }
  ["across", "up"].forEach((id, k) => { document.getElementById(id).textContent = told.axes[k]; });
  show();
})();
</script>
"""


def transmission_page(
    found: Survey,
    words: Sequence[str],
    *,
    effort: ArrayLike | None,
    speed: ArrayLike | None,
    proved: Sequence[LimitsCertificate] = (),
) -> str:
    """The page as HTML.

    Args:
        found: Postures over the range.
        words: The table, as a terminal shows it.
        effort: Largest efforts of the motors behind their gears; default the mechanism's.
        speed: Largest speeds of their joints; default the file's.
        proved: What is proved over a region, of `certify_limits`.

    Raises:
        InvalidInputError: Limits that are none.
    """
    transmission = found.transmission
    name = transmission.joint_model.mechanism.title
    home = transmission.reference
    rates = [[motor, *(f"{x:.4g}" for x in row)] for motor, row in zip(transmission.motors, home.jacobian, strict=True)]
    sections = [
        Section("told", "What it does", preformatted("\n".join(words))),
        Section("rates", "Rates at the reference", table(["∂q_m/∂q_j", *transmission.joints], rates)),
    ]
    try:
        picture = plot_limits(transmission, effort=effort, speed=speed, proved=proved)
        drawn = figure(picture, "Efforts and speeds over the range")
        sections.append(Section("limits", "Limits over the range", drawn))
    except (InvalidInputError, UnsupportedMechanismError) as error:
        sections.append(Section("limits", "Limits over the range", paragraphs(f"Not drawn: {error}.")))
    stated = transmission.joint_model.mechanism.motors.limits
    if transmission.n == 2 and (effort is not None or np.isfinite(stated).all()):
        told = "The nearest of the postures that were visited: its efforts (blue), and the largest box inside (dashed)."
        body = paragraphs(told) + _DRAWING.replace("DATA", _postures(found, effort))
        sections.append(Section("try", "Try a posture", body))
    return render(
        f"{name}: from motors to joints",
        " → ".join(map(", ".join, (transmission.motors, transmission.joints))),
        sections,
    )


def _postures(found: Survey, effort: ArrayLike | None) -> str:
    """What the sliders show, as JSON that no text can end before its time."""
    polytopes = [posture.torque_polytope(effort=effort) for posture in found.postures]
    reached = np.array([posture.q_joint for posture in found.postures])
    corners = [polytope.vertices for polytope in polytopes]
    boxes = [polytope.largest_box() for polytope in polytopes]
    scale = np.abs(np.vstack(corners)).max(axis=0)
    of_each = zip(found.transmission.joints, scale, found.transmission.joint_side.units, strict=True)
    told = {
        "joints": list(found.transmission.joints),
        "axes": [f"{joint}: {most:.3g} {UNITS[unit][0]}" for joint, most, unit in of_each],
        "lower": reached.min(axis=0).tolist(),
        "upper": reached.max(axis=0).tolist(),
        "start": found.postures[0].q_joint.tolist(),
        "scale": scale.tolist(),
        "postures": [
            {
                "q": posture.q_joint.tolist(),
                "corners": corner.tolist(),
                "box": box.tolist(),
                "words": _words(posture, box),
            }
            for posture, corner, box in zip(found.postures, corners, boxes, strict=True)
        ],
    }
    return json.dumps(told).replace("<", "\\u003c")


def _words(posture: Posture, box: Array) -> str:
    lines = (
        ("joints at", posture.q_joint),
        ("motors at", posture.q_motor),
        ("rotors felt", np.diag(posture.rotor_inertia)),
        ("box inside ±", box),
    )
    return "\n".join(f"{what:13} {'  '.join(f'{x:.4g}' for x in values)}" for what, values in lines)
