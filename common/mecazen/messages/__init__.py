"""The messages: frozen structs with ROS's fields, and ROS's defaults for missing fields."""

from mecazen.messages.mecazen_msgs import *
from mecazen.messages.ros import *
