"""The keys and tokens that ROS may use: they are the bridge's words for access rules."""

from mecazen import keys
from mecazen.graph import TABLE
from mecazen_ros import bridge

TWIST = "geometry_msgs::msg::dds_::Twist_"


def test_a_topic_that_a_node_gives_is_published_in_ros_under_its_name_and_as_frames():
    assert bridge.given(TABLE["odometry"], keys.ODOM) == [
        "**/odom/nav_msgs::msg::dds_::Odometry_/*",
        "**/tf/tf2_msgs::msg::dds_::TFMessage_/*",
    ]


def test_only_open_topics_are_taken_in_any_namespace_or_in_that_of_a_robot():
    stamped = TWIST.replace("Twist_", "TwistStamped_")
    assert bridge.taken(keys.CMD_VEL) == [f"**/cmd_vel/{TWIST}/*", f"**/cmd_vel/{stamped}/*"]
    of_two = bridge.taken(keys.CMD_VEL, "two", "lab")
    assert of_two[0] == f"*/lab/two/cmd_vel/{TWIST}/*"
    assert bridge.taken(keys.ODOM) == []


def test_a_query_has_the_services_that_make_it():
    trigger = "std_srvs::srv::dds_::Trigger_"
    standard = "simulation_interfaces::srv::dds_::StepSimulation_"
    assert bridge.asked([keys.SIM_STEP]) == [f"**/step_simulation/{standard}/*"]
    assert f"**/sim/reset/{trigger}/*" in bridge.asked([keys.SIM_RESET])
    assert bridge.asked([]) == []


def test_the_description_alone_is_there_for_late_subscribers():
    assert bridge.latched(keys.SIM_STATE) == []
    description, *_ = bridge.latched(keys.ROBOT_DESCRIPTION)
    assert description == "**/robot_description/std_msgs::msg::dds_::String_/*"


def test_tokens_of_a_service_are_among_those_of_all():
    assert bridge.tokens() == "@ros2_lv/**"
    assert bridge.tokens("physics") == f"@ros2_lv/{'*/' * 7}physics/**"


def test_the_package_of_messages_has_its_place(tmp_path):
    files = dict(bridge.files(tmp_path))
    assert tmp_path / "ros2" / "mecazen_msgs" / "package.xml" in files
