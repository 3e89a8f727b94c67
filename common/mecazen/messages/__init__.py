"""The messages: frozen structs with ROS's fields, and ROS's defaults for missing fields.

Messages of ROS are in `ros`. Those of `mecazen_msgs`, which have no equal in ROS, are in `own`.
"""

from mecazen.messages.own import *
from mecazen.messages.ros import *
