"""Who may publish, answer and ask what: Zenoh's access rules, from the graph."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from typing import Any

from mecazen import keys
from mecazen.bus.session import OPERATOR
from mecazen.config import LIVELINESS
from mecazen.graph import GRAPH, Row, services

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

EVERYTHING = ["**"]
ANYONE, ROUTER, RECORD = "anyone", "router", "record"
"""Any certificate; the router's; the token of `mecazen record`, which the operator runs."""


def secure_json5() -> str:
    """Return the whole configuration file."""
    rules = list(_rules())
    names = (ROUTER, *services(), OPERATOR)
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


def _rules() -> Iterator[tuple[Any, dict[str, Any]]]:
    """Yield each rule with the subject that it is for."""
    reads = [call for row in GRAPH for call in row.calls if not call.changes]
    rules = [call for row in GRAPH for call in row.calls if call.changes]
    hears = ["declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    sent = ["put", "delete", "query", "reply", "declare_queryable", "liveliness_token", *hears]
    yield ANYONE, _rule("anyone subscribes to everything", hears, EVERYTHING)
    yield ANYONE, _rule("anyone is sent everything", sent, EVERYTHING, flow="egress")
    yield ANYONE, _rule("anyone asks what changes nothing", ["query"], _call_keys(reads))
    relays = ["put", "query", "reply", "declare_queryable", "liveliness_token"]
    yield ROUTER, _rule("the router relays what it has let in", relays, EVERYTHING)
    for service, rows in services().items():
        yield from _service_rules(service, rows)
    open_keys = [topic.key for topic in keys.TOPICS if topic.open]
    puts = [f"**/{key}" for key in open_keys]
    yield OPERATOR, _rule("the operator drives robot and person", ["put"], puts)
    others = _others(open_keys)
    yield OPERATOR, _rule("the operator does not bypass the guard", ["put"], others, deny=True)
    yield OPERATOR, _rule("the operator controls the run", ["query"], _call_keys(rules))
    yield OPERATOR, _alive(RECORD)


def _service_rules(service: str, rows: Sequence[Row]) -> Iterator[tuple[str, dict[str, Any]]]:
    given = [topic.key for row in rows for topic in row.outputs]
    puts = [f"**/{key}" for key in (*given, keys.diagnostics(service).key)]
    yield service, _rule(f"{service} publishes", ["put"], puts)
    if others := _others(given):
        yield service, _rule(f"{service} does not publish", ["put"], others, deny=True)
    calls = [call for row in rows for call in row.calls]
    if calls:
        answers = ["declare_queryable", "reply"]
        yield service, _rule(f"{service} answers", answers, _call_keys(calls))
    yield service, _alive(service)


def _others(given: Sequence[str]) -> list[str]:
    """Return what a rule for keys holds as well: `**/odom` holds `target/odom`."""
    return [
        f"**/{topic.key}"
        for topic in keys.TOPICS
        if topic.key not in given and any(topic.key.endswith(f"/{key}") for key in given)
    ]


def _alive(name: str) -> dict[str, Any]:
    return _rule(f"{name} is alive", ["liveliness_token"], [f"**/{LIVELINESS}/{name}/**"])


def _call_keys(calls: Sequence[keys.Call[Any, Any]]) -> list[str]:
    return [f"**/{call.key}{'/**' if call.files else ''}" for call in calls]


def _rule(
    name: str, messages: list[str], exprs: list[str], *, flow: str = "ingress", deny: bool = False
) -> dict[str, Any]:
    rule = {"id": name, "permission": "deny" if deny else "allow", "flows": [flow]}
    return {**rule, "messages": messages, "key_exprs": exprs}
