"""The scene and the map of the README's moving picture, without the film."""

import numpy as np
import pytest

import ccpin
from tests.support.loading import script


def test_the_scene_is_the_robot_with_its_boxes():
    """The same loops, three slides a box more, and the gripper at both ends of its way at rest."""
    hero = script("hero")
    robot = ccpin.load("delta")
    scene = hero.with_boxes(robot)
    assert scene.n == robot.n + 3 * len(hero.BOXES)
    assert len(scene.closures) == len(robot.closures)
    tip = ccpin.EndEffector(robot, "platform", hero.TIP)
    way = hero.path_of(tip, 1)
    for t, place in ((0.0, hero.PICK), (hero.WAIT + hero.GO, hero.PLACE), (hero.CYCLE, hero.PICK)):
        there = way.at(t)
        np.testing.assert_allclose(tip.pose(there.q)[:3, 3], place, atol=1e-6)
    middle = tip.pose(way.at(hero.WAIT + hero.GO / 2).q)[:3, 3]
    np.testing.assert_allclose(middle, (hero.PICK + hero.PLACE) / 2 + [0, 0, hero.LIFT], atol=1e-3)


@pytest.mark.slow
def test_the_five_bar_goes_round():
    """Pictures of the film's height, each another."""
    hero = script("hero")
    first, second, third = hero.five_bar(3)
    assert first.size == hero.SIZE
    assert len({picture.tobytes() for picture in (first, second, third)}) == 3
