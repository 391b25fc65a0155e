"""Certificates that were pickled: all they have can be read, nothing is proven until it is replayed, then all is."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from ccpin import control, domain
from ccpin.domain.atlas.cover_claims import proved_cover
from ccpin.proof.facts import NotProvedError, Unproved

Q, HALF = np.radians((-108.0, -72.0)), 0.1


@pytest.fixture(scope="module")
def made(rpdr, rpdr_model):
    """A proven one of each kind."""
    atlas = domain.certify(rpdr, Q, (Q - HALF, Q + HALF), max_depth=5)
    return {
        "atlas": atlas,
        "path": domain.certify_path(rpdr, [Q, Q + 0.2], tube=0.01),
        "gains": control.suggest_gains(rpdr_model, Q, atlas),
        "curves": domain.certify_singularities(rpdr, np.radians(((118.0, 52.0), (121.0, 55.0)))),
        "sheets": domain.certify_sheets(rpdr, (Q - HALF, Q + HALF), max_depth=4),
    }


def sent(one):
    return pickle.loads(pickle.dumps(one))


@pytest.mark.parametrize("name", ["atlas", "path", "gains", "curves", "sheets"])
def test_all_it_has_can_be_read(made, name):
    """Its properties, its text and its table; what is a stored word is told as one."""
    one, again = made[name], sent(made[name])
    names = [each for each in dir(one) if not each.startswith("_") and not callable(getattr(one, each))]
    assert len(names) > 5
    for each in names:
        getattr(again, each)
    assert repr(again)
    if hasattr(one, "_repr_html_"):
        assert again._repr_html_()


@pytest.mark.parametrize("name", ["atlas", "path", "gains", "curves"])
def test_it_is_undecided(made, name):
    assert made[name].verdict == "proven"
    assert sent(made[name]).verdict == "undecided"


@pytest.mark.parametrize("name", ["atlas", "path"])
def test_its_reason_says_so(made, name):
    assert "pickled" in sent(made[name]).reason
    assert "pickled" not in made[name].reason


def test_it_is_proven_once_it_is_replayed(made):
    atlas, path, gains = (made[name] for name in ("atlas", "path", "gains"))
    assert sent(atlas).replayed().verdict == sent(path).replay().verdict == "proven"
    again = sent(gains)
    assert again._replace(proved=again.proved.replay()).verdict == "proven"


def test_no_other_words_are_believed(made):
    """A smaller β, or gains below it, are not what was proved; nor is a path that is another."""
    gains, path = made["gains"], made["path"]
    assert gains._replace(beta=0.999 * gains.beta).verdict == "undecided"
    assert gains._replace(K_p=np.eye(2) * gains.beta).verdict == "undecided"
    assert gains._replace(K_p=np.eye(2) * gains.beta * 1.001).verdict == "proven"
    again = sent(path)
    claim = again.proved.claim
    with pytest.raises(NotProvedError):
        Unproved(type(claim)(**{**vars(claim), "tube": 100.0 * claim.tube}), again.proved.premises).replay()


def test_faces_that_are_not_glued_are_told(rpdr):
    """Of an atlas whose boxes nothing is said to glue: σ is one function on the seed's, as of one from a file."""
    atlas = domain.certify(rpdr, Q, (Q - 0.9, Q + 0.9), max_depth=4)
    cover = proved_cover(atlas.problem, atlas.region, atlas.tree, atlas.seed, atlas.solutions, ())
    torn = replace(atlas, proved=cover)
    again = sent(torn)
    assert len(again.unglued)
    np.testing.assert_array_equal(again.unglued, torn.unglued)
    np.testing.assert_array_equal(again.one_function, torn.one_function)
    assert again.witness is None
    assert again.replayed().verdict == atlas.verdict
    assert not len(again.replayed().unglued)
