"""Zenoh's access rules, derived from the graph: permissions to publish, answer and query."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

from mecazen import keys
from mecazen.bus.session import OPERATOR, ROUTER_ENTRIES
from mecazen.config import LIVELINESS
from mecazen.graph import GRAPH, SERVICES, services
from mecazen.row import Row
from mecazen.runtime.pace import EVERY, READY, RECORD
from mecazen_ros import protocol
from mecazen_tools.cli.teleop import TELEOP

HEADER = """\
// Mutual TLS, and who may publish what. For `bus.zenoh_config`, together with `bus.keys`, a folder
// that `mecazen keys create` has made: each process then shows the certificate of its service.
// Made from the graph by `make graph`.
//
// Every process that listens checks what comes to it by the certificate of the sender, so all of
// them load this file, and peers talk directly. A client's samples come through the router, which
// has checked them: so the router's own certificate may send anything.
//
// Keys are those on the wire, which begin with the namespace where there is one: hence `**/`.
// A deny rule counts before any rule that allows.
{
  connect: { endpoints: ["tls/127.0.0.1:7447"] },
  listen: { endpoints: { router: ["tls/127.0.0.1:7447"], peer: ["tls/127.0.0.1:0"] } },
  // Between hosts: a link that is cut is given up after 2 s, and then tried anew every second.
  // TCP alone would wait twice as long after each loss.
  transport: { link: { tx: { lease: 2000 } }, unicast: { open_timeout: 1000 } },
"""

LATCHED = "**/@adv/**"
"""Keys that announce latched samples to late subscribers; `**` does not match them."""
ANSWERS = ["declare_queryable", "reply"]
"""Messages of those who answer queries."""
ANYONE, ROUTER = "anyone", "router"
"""Subjects of rules: any certificate, and the router's certificate."""


def secure_json5() -> str:
    """Return the whole configuration file."""
    rules = list(_rules())
    names = (ROUTER, *SERVICES, OPERATOR)
    subjects = [{"id": ANYONE}, *({"id": name, "cert_common_names": [name]} for name in names)]
    policies = [
        {"subjects": [name], "rules": [rule["id"] for who, rule in rules if who == name]}
        for name in (ANYONE, *names)
    ]
    access = {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for _, rule in rules],
        "subjects": subjects,
        "policies": policies,
    }
    lines = [
        f"    {name}: {json.dumps(value)},"
        if not isinstance(value, list)
        else "\n".join([f"    {name}: [", *(f"      {json.dumps(v)}," for v in value), "    ],"])
        for name, value in access.items()
    ]
    return HEADER + "  access_control: {\n" + "\n".join(lines) + "\n  },\n}\n"


def access_table() -> str:
    """Return the permissions of each certificate as a Markdown table of plain keys."""
    reads, rules = _queries()
    lines = [
        "| certificate | may put | may answer | may query |",
        "| --- | --- | --- | --- |",
        *(
            _line(
                service,
                [t.key for row in rows for t in (*row.outputs, *_handed_on(row))],
                _plain([call for row in rows for call in row.calls]),
            )
            for service, rows in services(GRAPH).items()
        ),
        _line(OPERATOR, [topic.key for topic in keys.TOPICS if topic.open], [], _plain(rules)),
        _line("each service", ["diagnostics/<its name>"], [f"<its name>/{EVERY}"]),
        _line("anyone admitted", [], [], [*_plain(reads), f"<name>/{EVERY}"]),
        "| router | what it relays | what it relays | what it relays |",
    ]
    return "\n".join(lines)


def _line(who: str, *cells: Sequence[str]) -> str:
    filled = [", ".join(f"`{key}`" for key in dict.fromkeys(cell)) for cell in (*cells, [], [])]
    return f"| {' | '.join([who, *filled[:3]])} |"


def _queries() -> tuple[list[keys.Call[Any, Any]], list[keys.Call[Any, Any]]]:
    """Return the queries that only read, and the queries that change something."""
    calls = dict.fromkeys(call for row in GRAPH for call in row.calls)
    return [c for c in calls if not c.changes], [c for c in calls if c.changes]


def _rules() -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield each rule with its subject."""
    reads, rules = _queries()
    everything = ["**", protocol.tokens(), LATCHED, ROUTER_ENTRIES]
    hears = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    sent = ["put", "delete", "query", "reply", "declare_queryable", "liveliness_token", *hears]
    yield ANYONE, _rule("anyone subscribes to everything", hears, everything)
    yield ANYONE, _rule("anyone is sent everything", sent, everything, flow="egress")
    asked = [*_call_keys(reads), f"**/{EVERY}", LATCHED, ROUTER_ENTRIES]
    yield ANYONE, _rule("anyone asks what changes nothing", ["query"], asked)
    relays = ["put", "query", "reply", "declare_queryable", "liveliness_token"]
    yield ROUTER, _rule("the router relays what it has let in", relays, everything)
    for service, nodes in services(GRAPH).items():
        yield from _service_rules(service, nodes)
    puts = [
        key
        for topic in keys.TOPICS
        if topic.open
        for key in (f"**/{topic.key}", *protocol.received_keys(topic))
    ]
    yield OPERATOR, _rule("the operator drives robot and person", ["put"], puts)
    denied = _overlapping(puts)
    yield OPERATOR, _rule("the operator does not bypass the guard", ["put"], denied, deny=True)
    yield OPERATOR, _rule("the operator controls the run", ["query"], _call_keys(rules))
    yield OPERATOR, _rule(f"{RECORD} answers", ANSWERS, [f"**/{RECORD}/{EVERY}"])
    for command in (RECORD, TELEOP):
        yield OPERATOR, _rule(f"{command} is alive", ["liveliness_token"], _tokens(command))
    yield OPERATOR, _rule("the operator has ROS nodes", ["liveliness_token"], [protocol.tokens()])


def _service_rules(service: str, nodes: Sequence[Row]) -> Iterator[tuple[str, dict[str, Any]]]:
    puts = [
        *(key for row in nodes for topic in row.outputs for key in _published(row, topic)),
        *_published(Row(service), keys.diagnostics(service)),
        # samples from ROS that it passes on to all others
        *(f"**/{topic.key}" for row in nodes for topic in _handed_on(row)),
    ]
    calls = [call for row in nodes for call in row.calls]
    latched = [key for call in calls for key in protocol.latched_keys(call)]
    puts = list(dict.fromkeys([*puts, *latched]))
    yield service, _rule(f"{service} publishes", ["put"], puts)
    if denied := _overlapping(puts):
        yield service, _rule(f"{service} does not publish", ["put"], denied, deny=True)
    keys_of_calls = [*_call_keys(calls), f"**/{service}/{EVERY}"]
    yield service, _rule(f"{service} answers", ANSWERS, keys_of_calls)
    if latched:
        kept = ["put", "declare_queryable", "reply", "liveliness_token"]
        exprs = [*latched, *(f"{key}/@adv/**" for key in latched)]
        yield service, _rule(f"{service} publishes for those who come later", kept, exprs)
    tokens = [*_tokens(service), protocol.tokens(service)]
    yield service, _rule(f"{service} is alive", ["liveliness_token"], tokens)


def _published(row: Row, topic: keys.Topic[Any]) -> list[str]:
    """Return the keys of an output of a node: the plain one, and those of ROS."""
    return [f"**/{topic.key}", *protocol.published_keys(row, topic)]


def _handed_on(row: Row) -> list[keys.Topic[Any]]:
    """Return the open topics that a node may receive from ROS."""
    takes = not (row.observes or row.shared)
    return [i.topic for i in row.inputs if i.topic.open and takes]


def _overlapping(allowed: Sequence[str]) -> list[str]:
    """Return other known keys that a rule for keys matches: `**/odom` matches `target/odom`."""
    outputs = [(row, topic) for row in GRAPH for topic in row.outputs]
    known = [key for row, topic in outputs for key in _published(row, topic)]
    known += [
        key for topic in keys.TOPICS for key in (f"**/{topic.key}", *protocol.received_keys(topic))
    ]
    ends = tuple(key.removeprefix("**") for key in allowed)
    return [key for key in dict.fromkeys(known) if key not in allowed and key.endswith(ends)]


def _tokens(name: str) -> list[str]:
    return [f"**/{LIVELINESS}/{name}{end}" for end in ("", f"/{READY}", f"/{EVERY}")]


def _plain(calls: Sequence[keys.Call[Any, Any]]) -> list[str]:
    return [f"{call.key}{'/**' if call is keys.ROBOT_DESCRIPTION else ''}" for call in calls]


def _call_keys(calls: Sequence[keys.Call[Any, Any]]) -> list[str]:
    plain = [f"**/{key}" for key in _plain(calls)]
    return [*plain, *protocol.service_keys(calls)]


def _rule(
    name: str, messages: list[str], exprs: list[str], *, flow: str = "ingress", deny: bool = False
) -> dict[str, Any]:
    rule = {"id": name, "permission": "deny" if deny else "allow", "flows": [flow]}
    return {**rule, "messages": messages, "key_exprs": exprs}
