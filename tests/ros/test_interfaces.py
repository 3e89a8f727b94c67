"""Messages and services that only ROS sees, made from their definitions."""

from mecazen import messages as m
from mecazen_ros.interfaces import message, service


def test_a_message_has_the_fields_and_defaults_of_its_line():
    stamped = message("TwistStamped")
    assert stamped.ROS_TYPE == "geometry_msgs/msg/TwistStamped"
    assert stamped() == stamped(header=m.Header(), twist=m.Twist())
    assert stamped is message("TwistStamped")
    transforms = message("TFMessage")()
    assert (transforms.__struct_fields__, transforms.transforms) == (("transforms",), ())
    value = message("ParameterValue")()
    assert (value.type, value.bool_value, value.string_value) == (0, False, "")
    assert (value.byte_array_value, value.double_array_value) == (b"", ())


def test_a_service_has_a_request_and_a_response():
    trigger = service("std_srvs/srv/Trigger")
    assert trigger.request.__struct_fields__ == ()
    assert trigger.response.__struct_fields__ == ("success", "message")
    assert trigger.response.ROS_TYPE == "std_srvs/srv/Trigger_Response"
    step = service("simulation_interfaces/srv/StepSimulation")
    assert step.request(5).steps == 5
    assert step.response().result == message("Result")(0, "")
