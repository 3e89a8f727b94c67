"""Look at the person and keep 1 m from them: a process of your own, with Zenoh alone."""

import json
import math
import sys

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps(sys.argv[1:] or ["tcp/127.0.0.1:7447"]))
session = zenoh.open(config)
cmd_vel = session.declare_publisher("cmd_vel", encoding="application/json")
observations = session.declare_subscriber("target/observation", zenoh.handlers.RingChannel(1))
for sample in observations:
    persons = json.loads(sample.payload.to_bytes())["poses"]
    if persons:
        position = persons[0]["pose"]["position"]
        x, y = position["x"], position["y"]
        ahead = 1.5 * (math.hypot(x, y) - 1.0)
        turn = 1.5 * math.atan2(y, x)
        cmd_vel.put(json.dumps({"linear": {"x": ahead}, "angular": {"z": turn}}))
