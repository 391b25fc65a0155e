"""Figures show the data they are given."""

import numpy as np
import pytest
from PIL import Image

import ccpin
from ccpin import plotting
from ccpin.errors import InvalidInputError
from ccpin.mechanism.wireframe import outline, plane_of_motion


@pytest.fixture(scope="module")
def swing(rpdr_model):
    return ccpin.simulate(rpdr_model, None, np.radians([-90.0, -95.0]), duration=0.05)


def test_motion_has_six_panels_with_the_samples(rpdr, swing):
    """Two columns of position, velocity and effort; angles in degrees."""
    figure = plotting.plot_motion(swing, rpdr, np.radians([-90.0, -95.0]))
    assert len(figure.axes) == 6
    assert np.allclose(figure.axes[0].lines[0].get_ydata(), np.degrees(swing.q[:, 0]))
    assert np.allclose(figure.axes[3].lines[0].get_ydata(), np.degrees(swing.v[:, 1]))
    assert np.allclose(figure.axes[5].lines[0].get_ydata(), swing.u[:, 1])
    assert "°" in figure.axes[0].get_ylabel()


def test_prismatic_coordinates_stay_in_metres():
    """A sliding joint's axis is labelled in metres and newtons."""
    mechanism = ccpin.load("stewart")
    model = ccpin.ReducedModel(mechanism)
    motion = ccpin.simulate(model, None, model.alpha(mechanism.q_reference), duration=0.002)
    figure = plotting.plot_motion(motion, mechanism)
    assert "[m]" in figure.axes[0].get_ylabel()
    assert "[N]" in figure.axes[-1].get_ylabel()
    places = [panel.get_subplotspec() for panel in figure.axes if panel.get_visible()]
    assert len(places) == 3 * 6
    assert {place.colspan.start for place in places} == {0, 1, 2}  # in two groups of three
    assert np.allclose(figure.axes[9].lines[0].get_ydata(), motion.q[:, 3])


def test_outline_is_the_kinematics(rpdr):
    """At the reference both links' tips are the loop point, 0.3048 m below the line of the elbows' triangle."""
    shape = outline(rpdr, rpdr.q_reference)
    tips = shape.segments[-2:, 1]
    assert np.allclose(tips[0], tips[1], atol=1e-12)
    assert np.allclose(shape.loops[0], [0.1524, 0.0, -0.2794 - 0.3048 * np.sqrt(3) / 2], atol=1e-12)
    assert np.allclose(np.abs(plane_of_motion(rpdr)), [[1, 0, 0], [0, 0, 1]])


@pytest.mark.parametrize("name", ["rpdr", "delta"])
def test_configurations_are_drawn_in_plane_and_in_space(name, tmp_path):
    """Planar mechanisms get two axes, spatial ones three; the file is a picture."""
    mechanism = ccpin.load(name)
    figure = plotting.plot_configurations(mechanism, [mechanism.q_reference] * 2, ["a", "b"])
    assert hasattr(figure.axes[0], "get_zlim") == (name == "delta")
    plotting.save(figure, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").read_bytes()[1:4] == b"PNG"
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]


@pytest.mark.slow
def test_pictures_have_300_dots_an_inch(rpdr, swing, tmp_path):
    """A saved PNG has 300 dots per inch of the figure's size, and says so."""
    for figure in (plotting.plot_motion(swing, rpdr), plotting.plot_configurations(rpdr, [rpdr.q_reference], ["a"])):
        plotting.save(figure, tmp_path / "figure.png")
        with Image.open(tmp_path / "figure.png") as picture:
            assert np.allclose(picture.size, 300.0 * figure.get_size_inches(), rtol=0, atol=1)
            assert np.allclose(picture.info["dpi"], 300.0, atol=0.02)  # PNG counts dots a metre


def test_a_figure_that_cannot_be_written_is_an_error(rpdr, tmp_path):
    """A folder that is a file raises ours."""
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InvalidInputError):
        plotting.save(plotting.plot_configurations(rpdr, [rpdr.q_reference], ["a"]), tmp_path / "file" / "x.png")
