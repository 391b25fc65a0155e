"""What an MJCF file tells MuJoCo's solver comes out again, as MuJoCo compiles it; and what tight files tell it."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.description import read_description
from ccpin.description.formats import write_description
from ccpin.description.mjcf.tightening import tightened
from ccpin.errors import InvalidInputError
from tests.support.mjcf_files import BALL, PAIR, model, read

mujoco = pytest.importorskip("mujoco")

HEAD = (
    '<option timestep="0.003" integrator="implicitfast" solver="CG" iterations="37" tolerance="1e-9" impratio="2.5" '
    'cone="elliptic"/><option noslip_iterations="3"><flag warmstart="disable" eulerdamp="disable"/></option>'
    '<default><equality solref="0.011 0.9"/><joint solreffriction="0.02 1.1" frictionloss="0.1"/>'
    '<default class="hard"><equality solref="0.004 1" solimp="0.8 0.97 0.002 0.4 3"/></default></default>'
)
EQUALITY = (
    '<connect name="c" body1="a" body2="b" anchor="0.5 0.1 0"/><weld name="w" class="hard" body1="b"/>'
    '<joint name="j" class="hard" joint1="ja" joint2="jb" polycoef="0 2 0 0 0" solimp="0.7 0.8"/>'
)
LIMITED = PAIR.replace('name="jb"', 'name="jb" range="-30 40" solreflimit="0.03 1" solimplimit="0.5 0.6" margin="0.01"')


def compiled(text):
    """MuJoCo's model of a file."""
    return mujoco.MjModel.from_xml_string(text)


def test_the_file_is_as_it_was_to_mujoco(tmp_path):
    """Options, flags and softness of equalities, limits and friction: of the same names, the same numbers."""
    text = model(LIMITED, equality=EQUALITY, head=HEAD)
    before = compiled(text)
    description = read(text)
    notes = write_description(description, tmp_path / "again.xml")
    after = mujoco.MjModel.from_xml_path(str(tmp_path / "again.xml"))
    for name in (
        *("timestep", "integrator", "solver", "iterations", "tolerance", "impratio", "cone", "noslip_iterations"),
        *("disableflags", "enableflags"),
    ):
        assert getattr(before.opt, name) == getattr(after.opt, name), name
    for name in ("c", "w", "j"):
        for field in ("solref", "solimp"):
            np.testing.assert_array_equal(getattr(before.equality(name), field), getattr(after.equality(name), field))
    for name in ("ja", "jb"):
        one, other = before.joint(name), after.joint(name)
        for field in ("jnt_solref", "jnt_solimp", "jnt_margin"):
            np.testing.assert_array_equal(getattr(before, field)[one.id], getattr(after, field)[other.id])
        for field in ("dof_solref", "dof_solimp"):
            np.testing.assert_array_equal(
                getattr(before, field)[one.dofadr[0]], getattr(after, field)[other.dofadr[0]], err_msg=field
            )
    assert any("as the file read states (solref, solimp)" in note for note in notes)
    assert read_description(tmp_path / "again.xml").solver == description.solver
    told = "\n".join(write_description(description, tmp_path / "again.sdf"))
    assert "no place for what the file tells MuJoCo's solver: timestep, integrator" in told


def test_flags_that_the_reader_acts_on_are_not_written_again(tmp_path):
    """A spring that a file switches off is no spring, and a file without it must not switch others off."""
    text = model(
        PAIR, head='<option gravity="1 2 3"><flag gravity="disable" spring="disable" limit="disable"/></option>'
    )
    assert read(text).solver.flags == {"limit": "disable"}
    assert read(text).solver.options == {}


def test_tight_files_tell_what_holds_loops_closed(tmp_path):
    """Runge-Kutta, steps of a millisecond at most, two of them as time constant, solimp near 1."""
    description = read(model(LIMITED, equality=EQUALITY, head=HEAD))
    assert write_description(description, tmp_path / "tight.xml", loops="tight") == ()
    tight = mujoco.MjModel.from_xml_path(str(tmp_path / "tight.xml"))
    assert (tight.opt.timestep, tight.opt.integrator) == (0.001, mujoco.mjtIntegrator.mjINT_RK4)
    assert tight.neq == 3
    np.testing.assert_array_equal(tight.eq_solref, np.tile([0.002, 1.0], (3, 1)))
    np.testing.assert_array_equal(tight.eq_solimp[:, :2], 0.9999)
    fine = replace(description, solver=replace(description.solver, options={"timestep": "0.0005"}))
    assert tightened(fine).solver.options["timestep"] == "0.0005"
    assert tightened(fine).solver.equalities["c"]["solref"] == "0.001 1.0"
    odd = replace(description, solver=replace(description.solver, options={"timestep": "-1"}))
    assert tightened(odd).solver == tightened(description).solver == tightened(tightened(odd)).solver


@pytest.mark.parametrize(("words", "said"), [({"loops": "soft"}, "loops='soft'"), ({"meshes": None}, "meshes=None")])
def test_other_words_are_refused(words, said, tmp_path):
    """By name; and tight is a word about MuJoCo's files."""
    with pytest.raises(InvalidInputError, match=f"{said} is none of"):
        ccpin.load("rpdr").save(tmp_path / "robot.xml", **words)
    with pytest.raises(InvalidInputError, match="loops='tight' is about MuJoCo's soft loops: urdf states none"):
        ccpin.load("rpdr").save(tmp_path / "robot.urdf", loops="tight")
    assert not list(tmp_path.iterdir())


ROD = model(
    f'<body name="a"><joint name="j" axis="0 1 0"/>{BALL}<site name="s" pos="0.3 0 0.1"/></body>'
    f'<body name="b" pos="1 0 0"><joint name="k" axis="0 1 0" ref="20"/>{BALL}<site name="t" pos="0 0 0.5"/></body>',
    equality='<tendon name="rod" tendon1="wire" polycoef="0.125 1 0 0 0"/>',
    tail='<tendon><spatial name="wire"><site site="s"/><site site="t"/></spatial></tendon>',
)


def test_a_straight_tendon_of_stated_length_is_a_distance(tmp_path):
    """Its length is MuJoCo's at qpos0 and what the equality adds; written again, MuJoCo's residual is |d| − L."""
    engine = compiled(ROD)
    description = read(ROD)
    (rod,) = description.closures
    assert (rod.name, rod.kind, rod.link_a, rod.link_b) == ("rod", "distance", "a", "b")
    assert rod.length == pytest.approx(engine.tendon_length0[0] + 0.125, abs=1e-15)
    assert not any("tendon" in note for note in description.notes)
    write_description(description, tmp_path / "rod.xml")
    assert read_description(tmp_path / "rod.xml").closures[0].length == pytest.approx(rod.length, abs=1e-15)
    again = mujoco.MjModel.from_xml_path(str(tmp_path / "rod.xml"))
    data, rng = mujoco.MjData(again), np.random.default_rng(4)
    for _ in range(5):
        data.qpos[:] = rng.uniform(-1.0, 1.0, again.nq)
        mujoco.mj_forward(again, data)
        apart = np.linalg.norm(data.site("rod_a").xpos - data.site("rod_b").xpos)
        assert data.efc_pos[0] == pytest.approx(apart - rod.length, abs=1e-14)


@pytest.mark.parametrize(
    ("old", "new", "note"),
    [
        ('<site site="t"/></spatial>', '<site site="t"/><site site="s"/></spatial>', "spatial tendons"),
        ('polycoef="0.125 1', 'polycoef="-9 1', "a tendon has a length"),
        ('name="wire">', 'name="wire" stiffness="3">', "The tendons are left out"),
    ],
)
def test_other_tendons_are_noted(old, new, note):
    """Those round a corner, those that would have no length, those that pull besides."""
    assert any(note in said for said in read(ROD.replace(old, new)).notes)


def test_a_tendon_names_sites_that_exist():
    """By name."""
    with pytest.raises(ccpin.errors.DescriptionError, match="there is no site 'u'; there are: s, t"):
        read(ROD.replace('site="t"', 'site="u"'))
