"""The ROS side: zenoh-ros2-sdk, told what to do by lines.

A process of its own, in an environment that holds nothing of this project. Each line of its
input is a JSON list: a function's name and arguments; each line of its output is what that
returned, or {"error": ...}. Messages are dicts of fields, as ROS names them.
"""

import dataclasses
import json
import queue
import sys
import tempfile
from functools import cache
from pathlib import Path

import zenoh_ros2_sdk as sdk
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

STORE = get_typestore(Stores.ROS2_JAZZY)
GUARD_S = 60.0
"""Far beyond what anything takes to come."""
SIMULATION = {  # of simulation_interfaces, which the SDK does not have
    "msg/Result": "uint8 result\nstring error_message\n",
    "msg/SimulationState": "uint8 state\n",
    "srv/GetSimulationState": "---\nsimulation_interfaces/SimulationState state\n"
    "simulation_interfaces/Result result\n",
    "srv/SetSimulationState": "simulation_interfaces/SimulationState state\n---\n"
    "simulation_interfaces/Result result\n",
    "srv/ResetSimulation": "uint8 scope\n---\nsimulation_interfaces/Result result\n",
    "srv/StepSimulation": "uint64 steps\n---\nsimulation_interfaces/Result result\n",
}

samples = {}
subscribers = {}


def plain(value):
    """A message as a dict."""
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if f.name != "__msgtype__"]
        return {name: plain(getattr(value, name)) for name in names}
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(item) for item in value] if isinstance(value, list | tuple) else value


def filled(kind, fields):
    """The fields of a type for the SDK; those that are left out are zero."""
    zeros = {"string": "", "bool": False}
    return {
        name: sdk.get_message_class(detail)(**filled(detail, fields.get(name, {})))
        if node == Nodetype.NAME
        else fields.get(name, zeros.get(detail[0], 0) if node == Nodetype.BASE else [])
        for name, (node, detail) in STORE.fielddefs[kind][1]
    }


def type_hash(name):
    """The hash of a message's type."""
    text = (Path(folder) / f"{name}.msg").read_text()
    parts = sdk.utils.load_dependencies_recursive(name, text, sdk.get_registry())
    return sdk.utils.get_type_hash(name, text, parts)


def subscribe(topic, kind):
    """Keep what comes on a topic."""
    samples[topic] = queue.SimpleQueue()
    take = samples[topic].put
    subscribers[topic] = sdk.ROS2Subscriber(topic, kind, callback=take, router_port=port)


def take(topic, count):
    """Return the next messages of a topic, oldest first; wait for them, and unsubscribe."""
    messages = [plain(samples[topic].get(timeout=GUARD_S)) for _ in range(count)]
    subscribers.pop(topic).close()
    return messages


@cache
def publisher(topic, kind):
    return sdk.ROS2Publisher(topic, kind, router_port=port)


def publish(topic, kind, fields):
    """Publish a message."""
    publisher(topic, kind).publish(**filled(kind, fields))


def call(name, kind, fields):
    """Call a service; its response, or None."""
    client = sdk.ROS2ServiceClient(name, kind, router_port=port, timeout=10.0)
    response = client.call(**filled(f"{kind}_Request", fields))
    client.close()
    return plain(response)


def graph():
    """All topics and services with their types."""
    return {
        "topics": dict(sdk.get_topic_names_and_types(router_port=port)),
        "services": dict(sdk.get_service_names_and_types(router_port=port)),
    }


def write_definitions(packages):
    """Write what zenoh-ros2-sdk would otherwise fetch from the internet."""
    texts = {f"simulation_interfaces/{name}": text for name, text in SIMULATION.items()}
    for path in Path(packages).glob("*/msg/*.msg"):
        texts[f"{path.parts[-3]}/msg/{path.stem}"] = path.read_text()
    for name, text in texts.items():
        request, is_service, _ = text.partition("---\n")
        (fields,) = get_types_from_msg(request, name).values()
        STORE.fielddefs[f"{name}_Request" if is_service else name] = fields
    for name in STORE.fielddefs:
        if "/msg/" in name:
            definition = STORE.generate_msgdef(name, ros_version=2)[0]
            texts[name] = definition.split("=" * 80)[0]
    for name, text in texts.items():
        path = Path(folder) / f"{name}.{name.split('/')[1]}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


if __name__ == "__main__":
    port = int(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        write_definitions(sys.argv[2])
        sdk.ZenohSession.get_instance(router_port=port)
        sdk.get_registry(folder)
        for line in sys.stdin:
            name, *arguments = json.loads(line)
            try:
                answer = globals()[name](*arguments)
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
            print(json.dumps(answer), flush=True)
