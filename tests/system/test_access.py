"""Permissions to publish, answer and query, by role."""

import json

import pytest
from harness import ROOT
from mecazen.bus.session import session_config
from mecazen.config import BusConfig

from docs.access import access_table


@pytest.fixture(scope="module")
def control():
    """The access rules as Zenoh reads them."""
    secure = ROOT / "configs" / "zenoh" / "secure.json5"
    config = session_config(BusConfig(zenoh_config=secure), "client")
    return json.loads(config.get_json("access_control"))


def test_zenoh_reads_the_access_rules_and_they_deny_what_they_do_not_allow(control):
    assert (control["enabled"], control["default_permission"]) == (True, "deny")
    named = {rule["id"] for rule in control["rules"]}
    assert {rule for policy in control["policies"] for rule in policy["rules"]} == named


def test_a_service_may_publish_its_own_keys_and_none_that_these_hold(control):
    rules = {rule["id"]: rule for rule in control["rules"]}
    given, others = (rules[f"controller {what}"] for what in ("publishes", "does not publish"))
    assert (given["permission"], others["permission"]) == ("allow", "deny")
    assert {"**/odom", "**/diagnostics/controller"} <= set(given["key_exprs"])
    assert "**/target/odom" in others["key_exprs"]  # which `**/odom` holds
    assert not set(given["key_exprs"]) & set(others["key_exprs"])


def test_the_table_tells_it_by_plain_keys():
    cells = {line.split(" | ")[0].strip("| `"): line for line in access_table().splitlines()}
    assert "`cmd_vel`" in cells["operator"]
    assert "`guard/cmd_vel`" not in cells["operator"]
    assert "`diagnostics/<its name>`" in cells["each service"]
