"""The metrics of Follow-Bench, against episodes that are computed by hand."""

import math

import numpy as np
import pytest
from mecazen_experiments.followbench.metrics import (
    compare,
    has_caused_contact,
    measure,
)
from mecazen_experiments.followbench.play import Record

TURNED = math.pi / 2
DISTANCES = np.array([1.5, 1.5, 1.0, 1.9, 2.0])
"""From axle to target. The personal zone is between 1.195 and 1.945 m."""
NEAREST = np.array([3.0, 1.19, 1.21, 3.0, 3.0])
"""From axle to the other person, whose private zone ends at 1.195 m."""


def drive(**changes):
    """Return four steps along x at 1.0, 1.2, 1.2 and 0.6 m/s; the last turns by 90°."""
    x = np.array([0.0, 0.1, 0.22, 0.34, 0.40])
    robot = np.stack((x, 0.0 * x, [0.0, 0.0, 0.0, 0.0, TURNED]), axis=1)
    record = Record(
        robot=robot,
        target=robot[:, :2] + np.stack((DISTANCES, 0.0 * x), axis=1),
        humans=(robot[:, :2] - np.stack((NEAREST, 0.0 * x), axis=1))[:, None],
        visible=np.array([True, True, False, False, True]),
        collided=False,
        max_steps=10,
        max_search_steps=2,
        step_s=0.1,
    )
    return record._replace(**changes)


def metrics(place="back", **changes):
    return measure(drive(**changes), place, 1.5)


def test_a_success_has_no_contact_and_is_not_out_of_sight_for_too_long():
    assert (metrics().sr, metrics().asr) == (100.0, 100.0)
    assert (metrics(collided=True).sr, metrics(collided=True).asr) == (0.0, 0.0)


@pytest.mark.parametrize(("most", "success"), [(2, 100.0), (1, 0.0)])
def test_more_unseen_steps_at_a_stretch_than_allowed_fail(most, success):
    assert metrics(max_search_steps=most).sr == success


def test_unseen_steps_add_up_at_a_stretch_only():
    visible = np.array([True, False, True, False, True])

    assert metrics(visible=visible, max_search_steps=1).sr == 100.0


def test_a_target_may_be_out_of_sight_at_the_end():
    visible = np.array([True, True, True, True, False])

    assert metrics(visible=visible).sr == 100.0


def test_time_in_sight_and_zones_is_a_share_of_the_longest_episode():
    result = metrics()

    assert result.tvr == 20.0  # 2 of 10 steps, the start is none
    assert result.tin_tperson == 20.0  # at 1.5 m and 1.9 m
    assert result.tin_private == 10.0  # at 1.19 m


def test_nobody_else_has_no_private_zone():
    assert metrics(humans=np.empty((5, 0, 2))).tin_private == 0.0


def test_path_and_speed_are_those_of_the_rows_after_each_step():
    result = metrics()

    assert result.pl_m == pytest.approx(0.12 + 0.12 + 0.06)  # the first row has none before it
    assert result.avg_vel_m_s == pytest.approx((1.0 + 1.2 + 1.2 + 0.6) / 4)


def test_acceleration_is_that_of_the_velocity_along_the_new_heading():
    # velocities (1, 0), (1.2, 0), (1.2, 0), (0, 0.6); the first row is repeated before them
    changes = [0.0, 0.2, 0.0, math.hypot(1.2, 0.6)]

    assert metrics().avg_acc_m_s2 == pytest.approx(sum(changes) / 0.1 / 4)


def test_jerk_repeats_the_first_two_rows():
    # 1, 1.2, 1, 1.2, 1.2 along x, then 0.6 along y: second differences
    changes = [0.4, 0.4, 0.2, math.hypot(-1.2, 0.6)]

    assert metrics().jerk_m_s3 == pytest.approx(sum(changes) / 0.01 / 4)


def test_driving_backwards_is_a_velocity_too():
    x = np.array([0.0, -0.1, -0.2, -0.3, -0.4])
    back = np.stack((x, 0.0 * x, 0.0 * x), axis=1)

    result = metrics(robot=back)

    assert result.avg_vel_m_s == pytest.approx(1.0)
    assert result.avg_acc_m_s2 == pytest.approx(0.0, abs=1e-12)  # rounding


def test_the_search_is_the_way_and_time_out_of_sight():
    assert metrics().search_path_m == pytest.approx(0.12 + 0.12)
    assert metrics().search_time_s == pytest.approx(0.2)


def test_our_view_and_distance_count_the_driven_steps():
    assert metrics().in_view == 50.0
    assert metrics().d_err_m == pytest.approx((0.0 + 0.5 + 0.4 + 0.5) / 4)


def test_behind_the_target_the_robot_should_face_it():
    assert metrics().heading_err_deg == pytest.approx(90.0 / 4)  # turned away in the last step


def test_beside_the_target_the_robot_should_look_along_its_motion():
    still = np.zeros((5, 2))
    up = np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 0.1], [0.0, 0.1], [0.0, 0.1]])

    # headings 0, 0, 90° where the target has moved upwards
    assert metrics("left_side", target=up).heading_err_deg == pytest.approx(180.0 / 3)
    assert metrics("left_side", target=still).heading_err_deg is None


def test_a_run_of_one_step_has_no_jerk():
    record = drive()
    first = {key: getattr(record, key)[:2] for key in ("robot", "target", "humans", "visible")}

    assert metrics(**first).jerk_m_s3 == 0.0
    assert metrics(**first).pl_m == 0.0


def contact(robot_x, person_x):
    """Return a contact ahead: the outline ends 0.6 m ahead, and the person's radius is 0.3 m."""
    robot = np.array([[x, 0.0, 0.0] for x in robot_x])
    far = np.full((len(robot), 2), 5.0)
    humans = np.array([[[x, 0.0]] for x in person_x])
    return drive(robot=robot, target=far, humans=humans, collided=True)


@pytest.mark.parametrize(
    ("robot_x", "person_x", "is_caused"),
    [
        ((0.0, 0.1, 0.2), (1.05, 1.05, 1.05), True),  # it drives into a standing person
        ((0.0, 0.0, 0.0), (1.05, 0.85, 0.85), False),  # a person walks into a standing robot
        ((0.0, 0.004, 0.008), (1.2, 0.89, 0.89), False),  # a person walks at one that creeps
        ((0.0, 0.05, 0.1), (1.2, 0.89, 0.89), True),  # both go at each other
        ((0.0, -0.1, -0.1), (1.05, 0.75, 0.75), False),  # a person follows a robot that recedes
    ],
)
def test_the_robot_causes_a_contact_when_it_drives_at_a_person(robot_x, person_x, is_caused):
    assert has_caused_contact(contact(robot_x, person_x)) == is_caused


def test_a_contact_with_a_box_is_caused_by_the_robot():
    assert has_caused_contact(contact((0.0, 0.1, 0.2), (9.0, 9.0, 9.0)))


def test_a_person_who_stands_in_the_robot_at_the_start_is_not_hit_by_it():
    assert not has_caused_contact(contact((0.0, 0.1), (0.5, 0.5)))


def test_no_contact_has_no_cause():
    assert not has_caused_contact(drive())
    assert metrics().caused_contact == 0.0


def test_planners_are_compared_over_the_episodes_that_both_drove():
    good, bad = metrics(), metrics(collided=True)

    difference = compare({"a": bad, "b": bad, "c": bad}, {"a": good, "b": good})

    assert (difference["sr"].mean, difference["sr"].n) == (100.0, 2)
    assert difference["tvr"].mean == 0.0
