"""Forms of joints and couplings, number by number."""


def test_x():
    pass
