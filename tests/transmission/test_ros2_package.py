"""The plugin of ros2_control: no warning, commands by the hundred thousand as Python has them, refusals."""

import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from functools import cache

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.transmission import Transmission, export_ros2
from tests.support.driven_plugins import WARNINGS, built, in_python, walk
from tests.support.exported import compiler
from tests.support.linkage_models import FORMS, transmission_of

ADA = "Ada Lovelace <ada@lab.org>"


def plugin(name, folder, **options):
    """The plugin of a transmission, compiled, with its driver."""
    made = transmission_of(name)
    export_ros2(made, folder, maintainer=ADA, name=name, **options)
    return built(made, folder, name)


def commands(name, count, size):
    """Rows for `drive`, and what the closed form makes of them."""
    form, rng, n = FORMS[name], np.random.default_rng(5), transmission_of(name).n
    q, wanted = walk(name, count, size), walk(name, count, 0.8 * size)
    v, tau, v_wanted, tau_wanted = rng.normal(size=(4, count, n))
    rows, expected = [], []
    for k in range(count):
        J, J_wanted = form.jacobian(q[k]), form.jacobian(wanted[k])
        rows.append([*form.motors(q[k]), *v[k], *tau[k], *wanted[k], *v_wanted[k], *tau_wanted[k]])
        joints = [*q[k], *np.linalg.solve(J, v[k]), *(J.T @ tau[k])]
        motors = [*form.motors(wanted[k]), *(J_wanted @ v_wanted[k]), *np.linalg.solve(J.T, tau_wanted[k])]
        expected.append([*joints, *motors])
    return np.array(rows), np.array(expected)


@cache
def scale(n, reduction):
    """What a gear makes of motors' positions, velocities and efforts."""
    return np.repeat([reduction, reduction, 1.0 / reduction], n)


@pytest.fixture(scope="module")
def knee(tmp_path_factory):
    """The knee's plugin, proved from -0.3 to 0.3 rad."""
    pytest.importorskip("flint")
    return plugin("knee", tmp_path_factory.mktemp("knee"), region=([-0.3], [0.3]), max_cells=16)


def require_both_ways(run, name, size):
    """Positions, velocities and efforts, by gears and offsets, in the robot's order; the description is held to it."""
    n = transmission_of(name).n
    rows, expected = commands(name, 500, size)
    for reduction, offset in ((1.0, 0.0), (-9.0, 0.25)):
        given, wanted = rows.copy(), expected.copy()
        given[:, : 3 * n] *= scale(n, reduction)
        given[:, 3 * n : 4 * n] += offset
        wanted[:, 3 * n :] *= scale(n, reduction)
        wanted[:, :n] += offset
        out, status, _ = run(given, reduction, offset)
        assert (status == 0).all()
        np.testing.assert_allclose(out, wanted, rtol=1e-9, atol=1e-10)


def test_commands_both_ways_are_the_closed_form_s(knee):
    """Of the knee, where its region is proved; a description that lacks its motor is not loaded."""
    assert knee.loads(1)
    assert not knee.loads(0)
    require_both_ways(knee, "knee", 0.4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knee", "neck", "ankle"])
def test_commands_both_ways_with_nothing_proved(name, tmp_path):
    """Of all three."""
    require_both_ways(plugin(name, tmp_path), name, 0.6)


def test_what_cannot_be_computed_is_refused(knee):
    """No numbers and what is outside: a status, and the last values; efforts go on alone; a good sample is taken."""
    rows, expected = commands("knee", 40, 0.4)
    bad, form = rows.copy(), FORMS["knee"]
    bad[10, 0], bad[12, 1], bad[14, 2], bad[16, 3], bad[18, 4] = np.nan, np.inf, np.nan, np.nan, np.nan
    bad[20, 0], bad[22, 0], bad[24, 3] = 1e9, form.motors(np.array([0.35]))[0], 0.3001
    out, status, _ = knee(bad)
    refused = {10: 4, 12: 4, 14: 4, 20: 3, 22: 3}
    assert {int(k): int(status[k, 0]) for k in np.flatnonzero(status[:, 0])} == refused
    assert {int(k): int(status[k, 1]) for k in np.flatnonzero(status[:, 1])} == {18: 4, 24: 3}
    for k in refused:  # what was there: the joints' commands of the tick before
        np.testing.assert_array_equal(out[k, :3], bad[k - 1, 3:])
    for k in (18, 24):
        np.testing.assert_array_equal(out[k, 3:], bad[k, :3])
    assert out[16, 3] == bad[16, 0]  # no position is commanded, and none is written
    J = form.jacobian(np.array([expected[16, 0]]))[0, 0]
    np.testing.assert_allclose(out[16, 4:], [J * bad[16, 4], bad[16, 5] / J], rtol=1e-9)
    good = np.setdiff1d(np.arange(40), [16, 18, 24, *refused])
    np.testing.assert_allclose(out[good], expected[good], rtol=1e-9, atol=1e-10)


def require_as_python(run, name, count, size):
    """Within 1e-12 of their size, or of 1."""
    rows, expected = in_python(transmission_of(name), walk(name, count, size))
    out, status, _ = run(rows)
    assert (status == 0).all()
    assert (np.abs(out - expected) <= 1e-12 * np.maximum(1.0, np.abs(expected))).all()


def test_commands_are_answered_as_python_answers_them(knee):
    """Where its region is proved."""
    require_as_python(knee, "knee", 1_000, 0.4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knee", "ankle"])
def test_a_hundred_thousand_commands(name, tmp_path):
    """With nothing proved, over more of the range."""
    require_as_python(plugin(name, tmp_path), name, 100_000, 0.6)


@pytest.mark.slow
def test_cmake_builds_and_tests_it(tmp_path):
    """The package as it is written, by CMake and CTest, against the declarations."""
    if shutil.which("cmake") is None:
        pytest.skip("there is no cmake here")
    compiler("g++")
    export_ros2(transmission_of("neck"), tmp_path / "package", maintainer=ADA, name="neck_linkage")
    build = tmp_path / "build"
    strict = f"-DCMAKE_CXX_FLAGS={' '.join(WARNINGS)}"
    subprocess.run(["cmake", "-S", str(tmp_path / "package"), "-B", str(build), strict], check=True)
    subprocess.run(["cmake", "--build", str(build)], check=True)
    subprocess.run(["ctest", "--test-dir", str(build), "--output-on-failure"], check=True)


def test_the_package_names_what_is_loaded(tmp_path):
    """The plugin's class is the one that is registered; roles are the linkage's; names are a package's."""
    found = transmission_of("neck")
    paths = export_ros2(found, tmp_path, maintainer=ADA, license="MIT & Co", name="my_neck")
    assert all(path.is_file() and "@" not in path.read_text().replace("ada@lab.org", "") for path in paths)
    package = ElementTree.parse(tmp_path / "package.xml").getroot()
    keeper = package.find("maintainer")
    assert (keeper.text, keeper.get("email"), package.findtext("license")) == (
        "Ada Lovelace",
        "ada@lab.org",
        "MIT & Co",
    )
    stated = ElementTree.parse(tmp_path / "my_neck.xml").getroot()[0]
    assert (
        f"PLUGINLIB_EXPORT_CLASS({stated.get('type')}, {stated.get('base_class_type')})"
        in (tmp_path / "src" / "loader.cpp").read_text()
    )
    element = ElementTree.parse(tmp_path / "robot.xml").getroot()
    assert element.findtext("plugin") == stated.get("name")
    assert [each.get("role") for each in element.iter("joint")] == list(found.joints)
    assert [each.get("role") for each in element.iter("actuator")] == list(found.motors)
    for name in ("Neck", "my__neck", "neck_", "1neck", "n", "my neck"):
        with pytest.raises(InvalidInputError, match="name must be a package's"):
            export_ros2(found, tmp_path, maintainer=ADA, name=name)
    for nobody in ("", "Ada", "ada@lab.org", "Ada <ada>"):
        with pytest.raises(InvalidInputError, match="maintainer must be a name and an address"):
            export_ros2(found, tmp_path, maintainer=nobody)
    with pytest.raises(InvalidInputError, match="license must be"):
        export_ros2(found, tmp_path, maintainer=ADA, license=" ")
    with pytest.raises(InvalidInputError, match="must be below"):
        export_ros2(found, tmp_path, maintainer=ADA, region=([0.1, 0.1], [0.1, 0.2]))
    direct = Transmission(found.motor_model, joints=found.motors, motors=found.motors)
    with pytest.raises(InvalidInputError, match="motors are the joints"):
        export_ros2(direct, tmp_path, maintainer=ADA)
