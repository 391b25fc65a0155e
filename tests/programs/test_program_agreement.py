"""Programs in lanes beside the compiled core, and what they are from exact numbers; derivatives from all sides."""

import pytest

import ccpin
from benchmarks.program_agreement import main
from ccpin.programs.compiling import NoCompilerError, compiler
from tests.support import lanes_and_core as agreement

try:
    compiler()
except NoCompilerError as error:
    pytest.skip(str(error), allow_module_level=True)
if ccpin.backend().name != "native":
    pytest.skip("what is compared with is the compiled core", allow_module_level=True)

WANTED = 1e-12  # of condition numbers, between lanes and core
ROUNDING = 2e-15  # of condition numbers, between lanes and exact numbers: some roundings of 1.1e-16
SHORT = ("rpdr", "four_bar", "slider_crank")


def agree(model, count):
    """Every quantity as wanted, and no state refused that the core answers."""
    held = agreement.states(model, count)
    differences, refused = agreement.compared(model, held)
    assert refused == 0
    assert {"sigma", "rho", "mass", "gravity", "forward_dynamics"} <= {each.name for each in differences}
    for each in differences:
        assert each.over <= WANTED, each
    return held, differences


@pytest.mark.parametrize("name", SHORT)
def test_lanes_and_core_agree(name):
    """And where they differ most it is the core's σ that stopped: the lanes are a rounding from exact numbers."""
    pytest.importorskip("flint")
    held, differences = agree(ccpin.ReducedModel(ccpin.load(name)), 1000)
    for each in differences:
        lanes, core = each.exact
        assert lanes <= ROUNDING * held.kappa.max(), each
        assert core <= WANTED * held.kappa.max(), each


@pytest.mark.slow
@pytest.mark.parametrize("name", agreement.NAMED)
def test_lanes_and_core_agree_everywhere(name):
    """The project's models and the ankle."""
    agree(ccpin.ReducedModel(ccpin.load(name)), agreement.STATES)


@pytest.mark.slow
def test_lanes_and_core_agree_on_random_mechanisms():
    """Fifty of them, of all kinds of joints and closures."""
    count = 0
    for model in agreement.drawn(agreement.DRAWN):
        agree(model, 2000)
        count += 1
    assert count == agreement.DRAWN


def test_slopes_agree():
    """Recorded ones, the core's and complex steps."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    found = agreement.slopes(model, agreement.states(model, agreement.SLOPED), {})
    assert found.keys() == {"core", "complex steps"}
    assert max(found.values()) <= WANTED


@pytest.mark.slow
@pytest.mark.parametrize("name", agreement.NAMED)
def test_slopes_agree_from_all_sides(name):
    """And those of the libraries that are installed."""
    model = ccpin.ReducedModel(ccpin.load(name))
    for who, off in agreement.slopes(model, agreement.states(model, agreement.SLOPED)).items():
        assert off <= WANTED, who


def test_a_difference_is_seen(monkeypatch):
    """A core that is off by 1e-9 in one state, and a slope that is off by as much."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    held = agreement.states(model, 200)
    wrong = {name: table.copy() for name, table in held.core.items()}
    for name in ("coriolis", "forward_dynamics_by_q"):
        wrong[name][7] *= 1.0 + 1e-9
    held = held._replace(core=wrong)
    differences, _ = agreement.compared(model, held)
    assert [each.name for each in differences if each.over > WANTED] == ["coriolis"]
    assert agreement.slopes(model, held, {})["core"] > WANTED


def test_the_command_prints_them(capsys):
    """A line a quantity, and slopes where asked."""
    main(["four_bar", "--states", "50"])
    told = capsys.readouterr().out
    assert all(name in told for name in ("four_bar: 50 states", "forward_dynamics", "from exact"))
