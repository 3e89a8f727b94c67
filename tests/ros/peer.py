"""The ROS side: zenoh-ros2-sdk, cyclonedds, rosbags and ros2-pyterfaces, told what to do by lines.

A process of its own, in an environment that holds nothing of this project. Each line of its
input is a JSON list: a function's name and arguments; each line of its output is what that
returned, or {"error": ...}. Messages are dicts of fields, as ROS names them; bytes are hex.
"""

import dataclasses
import json
import queue
import sys
import tempfile
from functools import cache
from pathlib import Path

import zenoh_ros2_sdk as sdk
from cyclonedds.idl import make_idl_struct, types
from ros2_pyterfaces import core
from ros2_pyterfaces.core.description import hash_rihs01
from ros2_pyterfaces.core.rcl_interfaces import srv as rcl_interfaces
from ros2_pyterfaces.core.std_srvs import srv as std_srvs
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

NAME = "__typename"
STORE = get_typestore(Stores.ROS2_JAZZY)
MSGTYPE = "__msgtype__"
"""Key of rosbags that is no field."""
GUARD_S = 20.0
"""Far beyond what anything takes to come."""
PLACEHOLDER = {"structure_needs_at_least_one_member": "uint8"}
"""The field in IDL of a message without fields."""

heard = {}
subscribers = {}


def service(name, request, answer):
    """A service that no library here knows, from its definition."""
    parts = ({NAME: f"{name}_Request", **request}, {NAME: f"{name}_Response", **answer})
    return core.make_srv_schema(*parts, typename=name)


RESULT = {NAME: "simulation_interfaces/msg/Result", "result": "uint8", "error_message": "string"}
STATE = {NAME: "simulation_interfaces/msg/SimulationState", "state": "uint8"}
SERVICES = {
    **{
        f"{package}/srv/{name}": schema
        for package, module in (("std_srvs", std_srvs), ("rcl_interfaces", rcl_interfaces))
        for name, schema in vars(module).items()
        if isinstance(schema, dict) and "event_message" in schema
    },
    **{
        (full := f"simulation_interfaces/srv/{name}"): service(full, request, answer)
        for name, request, answer in (
            ("GetSimulationState", {}, {"state": STATE, "result": RESULT}),
            ("SetSimulationState", {"state": STATE}, {"result": RESULT}),
            ("ResetSimulation", {"scope": "uint8"}, {"result": RESULT}),
            ("StepSimulation", {"steps": "uint64"}, {"result": RESULT}),
        )
    },
}


@cache
def schema(name):
    """The fields of a type: of a message by rosbags, of a service's parts by ros2-pyterfaces."""
    if "/srv/" in name:
        base, _, part = name.rpartition("_")
        return SERVICES[base][f"{part.lower()}_message"]
    return {NAME: name} | {field: entry(*node) for field, node in STORE.fielddefs[name][1]}


def entry(kind, detail):
    """A field of ros2-pyterfaces from one of rosbags."""
    if kind == Nodetype.BASE:
        return {"octet": "byte"}.get(detail[0], detail[0])
    if kind == Nodetype.NAME:
        return schema(detail)
    inner, length = detail
    return (core.Array if kind == Nodetype.ARRAY else core.Sequence)(entry(*inner), length or None)


@cache
def idl(name):
    """The type in cyclonedds."""
    return made(schema(name))


def made(fields):
    """A type of cyclonedds from a schema."""
    members = {field: kind for field, kind in fields.items() if field != NAME} or PLACEHOLDER
    name = fields[NAME]
    return make_idl_struct(
        name.replace("/", "_"), name, {field: of_dds(kind) for field, kind in members.items()}
    )


def of_dds(kind):
    """The type of a field in cyclonedds."""
    if isinstance(kind, dict):
        return made(kind)
    if isinstance(kind, core.Array):
        return types.array[of_dds(kind.subtype), kind.length]
    if isinstance(kind, core.Sequence):
        return types.sequence[of_dds(kind.subtype)]
    return {"string": str, "bool": bool}.get(kind) or getattr(types, kind)


def plain(value):
    """A message of any of the libraries as a dict."""
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
        return {n: plain(getattr(value, n)) for n in names if n not in {*PLACEHOLDER, MSGTYPE}}
    if isinstance(value, bytes | bytearray):
        return list(value)
    if hasattr(value, "tolist"):
        return value.tolist()
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def filled(kind, fields):
    """A message of cyclonedds, with ROS's zeros for what `fields` leaves out."""
    return made(kind)(
        **{
            name: value(of, fields.get(name))
            for name, of in ({k: v for k, v in kind.items() if k != NAME} or PLACEHOLDER).items()
        }
    )


def value(kind, given):
    if isinstance(kind, dict):
        return filled(kind, given or {})
    if isinstance(kind, core.Array):
        return given or [value(kind.subtype, None)] * kind.length
    if isinstance(kind, core.Sequence):
        return [value(kind.subtype, one) for one in given or ()]
    if given is None:
        return {"string": "", "bool": False}.get(kind, 0)
    return given


def read(name, payloads):
    """Return the messages that cyclonedds reads, once it writes the same payloads from them."""
    found = []
    for payload in payloads:
        message = idl(name).deserialize(bytes.fromhex(payload))
        again = message.serialize().hex()
        if again != payload:
            raise ValueError(f"{name}: {payload} is {again} in cyclonedds")
        found.append(plain(message))
    return found


def hashes(name):
    """The hashes of a type, by the name of who says it."""
    if "/srv/" in name:
        return {"ros2-pyterfaces": hash_rihs01(SERVICES[name])}
    return {
        "rosbags": STORE.hash_rihs01(name),
        "ros2-pyterfaces": hash_rihs01(schema(name)),
        "zenoh-ros2-sdk": sdk.utils.get_type_hash(name, *definitions(name)),
    }


def definitions(name):
    text = (Path(folder) / f"{name}.msg").read_text()
    return text, sdk.utils.load_dependencies_recursive(name, text, sdk.get_registry())


def subscribe(topic, kind, qos=None):
    """Keep what comes on a topic."""
    heard[topic] = queue.SimpleQueue()
    take = heard[topic].put
    subscribers[topic] = sdk.ROS2Subscriber(topic, kind, callback=take, router_port=port, qos=qos)


def take(topic, count=1):
    """Return the next messages of a topic, oldest first; wait for them, and hear no more."""
    found = [plain(heard[topic].get(timeout=GUARD_S)) for _ in range(count)]
    subscribers.pop(topic).close()
    return found


@cache
def publisher(topic, kind):
    return sdk.ROS2Publisher(topic, kind, router_port=port)


def publish(topic, kind, fields):
    """Publish a message; fields that are left out of a nested one are zero."""
    publisher(topic, kind)
    publisher(topic, kind).publish(**of_sdk(kind, fields))


def of_sdk(kind, fields):
    filled = {}
    for name, of in schema(kind).items():
        if isinstance(of, dict):
            filled[name] = sdk.get_message_class(of[NAME])(**of_sdk(of[NAME], fields.get(name, {})))
        elif name != NAME:
            filled[name] = value(of, fields.get(name))
    return filled


def call(name, kind, fields):
    """Call a service; its answer, or None."""
    request = sdk.ROS2ServiceClient(name, kind, router_port=port, timeout=10.0)
    answer = request.call(**of_sdk(f"{kind}_Request", fields))
    request.close()
    return plain(answer)


def graph():
    """All topics and services with their types."""
    return {
        "topics": dict(sdk.get_topic_names_and_types(router_port=port)),
        "services": dict(sdk.get_service_names_and_types(router_port=port)),
    }


def write_definitions(folder, packages):
    """Write what zenoh-ros2-sdk would otherwise fetch from the internet."""
    known = {part[NAME]: lines(part) for part in (RESULT, STATE)}
    for path in Path(packages).glob("*/msg/*.msg"):
        known[f"{path.parts[-3]}/msg/{path.stem}"] = path.read_text()
    for name, text in known.items():
        STORE.register(get_types_from_msg(text, name))
    texts = {
        f"{name}.msg": STORE.generate_msgdef(name, ros_version=2)[0].split("=" * 80)[0]
        for name in STORE.fielddefs
    }
    for name, of in SERVICES.items():
        if name.startswith("simulation_interfaces"):
            halves = lines(of["request_message"]), lines(of["response_message"])
            texts[f"{name}.srv"] = "---\n".join(halves)
    for name, text in texts.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def lines(fields):
    return "".join(
        f"{kind[NAME] if isinstance(kind, dict) else kind} {name}\n"
        for name, kind in fields.items()
        if name != NAME
    )


if __name__ == "__main__":
    port = int(sys.argv[1])
    with tempfile.TemporaryDirectory() as folder:
        write_definitions(Path(folder), sys.argv[2])
        sdk.ZenohSession.get_instance(router_port=port)
        sdk.get_registry(folder)
        for line in sys.stdin:
            name, *arguments = json.loads(line)
            try:
                answer = globals()[name](*arguments)
            except Exception as error:
                answer = {"error": f"{type(error).__name__}: {error}"}
            print(json.dumps(answer), flush=True)
