"""The social-force follower."""

from __future__ import annotations

import math

import pytest
from experiments.followbench.planners.views import drive, nothing, view
from mecazen.geometry import Pose2D
from mecazen_experiments.followbench.planners.social import Social, unicycle
from mecazen_experiments.followbench.view import Seen


def test_the_first_step_is_the_driving_force() -> None:
    # nothing but the target: 0.1 s of 1.3/s times 3 m/s, straight ahead
    assert Social().command(view(target=Seen(54.0, 50.0, 0.0, 0.0))) == pytest.approx((0.39, 0.0))


def test_a_person_repels_exponentially() -> None:
    person, target = Seen(50.0, 51.0, 0.0, 0.0), Seen(52.0, 50.0, 0.0, 0.0)
    alone = view(Pose2D(50.0, 50.0, -math.pi / 2), target, [person])
    alone = alone._replace(ranges=nothing())  # a scan would see the person a second time
    v, w = Social().command(alone)
    # the goal is 0.5 m ahead, which counts as reached, so only the person acts
    assert v == pytest.approx(0.1 * 7.0 * math.exp((0.3 - 1.0) / 0.5))
    assert w == 0.0


def test_a_cluster_of_the_scan_repels_too() -> None:
    box = (50.7, 51.2, 0.0, 0.6, 0.6)
    free = Social().command(view(target=Seen(53.0, 50.0, 0.0, 0.0)))
    repelled = Social().command(view(target=Seen(53.0, 50.0, 0.0, 0.0), boxes=[box]))
    assert repelled[0] < free[0]
    assert repelled[1] < 0.0


@pytest.mark.parametrize(
    ("velocity", "command"),
    [
        ((1.0, 0.0), (1.0, 0.0)),
        ((1.0, 0.05), (1.0, 0.0)),
        ((0.0, 1.0), (0.0, 2.0)),
        ((0.0, -1.0), (0.0, -2.0)),
        ((-1.0, -0.1), (0.0, -2.0)),
        ((0.01, 0.01), (0.0, 0.0)),
    ],
)
def test_the_robot_turns_into_the_velocity(
    velocity: tuple[float, float], command: tuple[float, float]
) -> None:
    # the speed is that of the projection, less than a percent off for a small angle
    assert unicycle(0.0, *velocity) == pytest.approx(command, abs=1e-2)


def test_it_follows_a_walker() -> None:
    walker = Seen(53.0, 50.0, 1.2, 0.0)
    states = drive(Social(), view(target=walker), 100)
    # it pulses about its place, as a driving force of 3 m/s and none within 0.7 m make it
    assert abs(53.0 + 12.0 - states[-1].pose.x - 1.5) < 1.0


def test_the_same_views_give_the_same_commands() -> None:
    walker = Seen(53.0, 50.0, 1.2, 0.3)
    crossing = [Seen(56.0, 54.0, 0.0, -1.0), Seen(58.0, 48.0, -1.0, 0.5)]
    first = view(target=walker, people=crossing)
    planner = Social()
    assert drive(planner, first, 50) == drive(planner, first, 50) == drive(Social(), first, 50)
