"""The messages: frozen structs, field for field ROS's, with ROS's defaults for what is missing.

ROS's own are in `ros`, those of `mecazen_msgs`, which have no equal in ROS, in `own`.
"""

from mecazen.messages.own import *
from mecazen.messages.ros import *
