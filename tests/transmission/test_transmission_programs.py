"""A transmission's maps as programs and as C: the closed forms', from the last state, refused where they must be."""

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.programs import record
from tests.support.exported import exported
from tests.support.linkage_models import FORMS, transmission_of

each = pytest.mark.parametrize("name", ["knee", "neck", pytest.param("ankle", marks=pytest.mark.slow)])


def walk(name, count):
    """q_j along a closed curve through the middle of the range, at most some 0.01 rad a step."""
    low, high = FORMS[name].RANGE.T
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None] * np.arange(1, len(low) + 1)
    return 0.3 * (high - low) * np.sin(phase)


@each
def test_one_side_follows_the_other_from_the_last_state(name, tmp_path):
    """q_j(q_m), J⁻¹ and J along a curve that begins at the reference, in C, and the same from the joints' side."""
    found, form = transmission_of(name), FORMS[name]
    for given in ("motors", "joints"):
        program = found.program(given)
        run, n = exported(program, tmp_path, name=f"by_{given}"), found.n
        y = np.array(program.example[n:])
        for q in walk(name, 400):
            motors, jacobian = form.motors(q), form.jacobian(q)
            out, status = run(np.concatenate([motors if given == "motors" else q, y])[None])
            assert status[0] == 0
            y, across, rates, inverse = np.split(out[0], len(y) + np.cumsum([0, n, n * n]))
            expected = np.linalg.inv(jacobian) if given == "motors" else jacobian
            np.testing.assert_allclose(across, q if given == "motors" else motors, rtol=0, atol=1e-10)
            np.testing.assert_allclose(rates.reshape(n, n), expected, rtol=0, atol=1e-9)
            np.testing.assert_allclose(rates.reshape(n, n) @ inverse.reshape(n, n), np.eye(n), rtol=0, atol=1e-12)


def test_what_lies_across_has_to_be_named():
    """Joints of one freedom, as many as motions where an inverse is asked for; sides by their names."""
    found = transmission_of("knee")
    with pytest.raises(InvalidInputError, match="name them by across="):
        record(found.motor_model, "across")
    with pytest.raises(InvalidInputError, match="is of 1 joints"):
        record(found.motor_model, "across_inverse", across=("knee", "motor"))
    with pytest.raises(InvalidInputError, match="not one of knee"):
        record(found.motor_model, "across", across=("kne",))
    with pytest.raises(InvalidInputError, match="given"):
        found.program("rods")
