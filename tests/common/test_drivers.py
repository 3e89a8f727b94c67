"""What drives the services of a process: time, a worker, or an observer."""

import pytest
from carts import Carts
from mecazen.bus import LocalBus
from mecazen.graph import TABLE
from mecazen.node import Node
from mecazen.runtime.clock import Clock
from mecazen.runtime.drivers import drive
from mecazen.runtime.observer import Observer
from mecazen.runtime.worker import Worker


class Page(Observer):
    def reset(self, seed):
        self.seed = seed


class Still(Node):
    ROW = TABLE["target"]

    def reset(self, seed): ...

    def step(self, tick, inputs):
        return {}


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    kinds = {"physics": Carts, "viewer": Page}
    monkeypatch.setattr("mecazen.programs.find", lambda name, _: kinds.get(name, Still))


@pytest.mark.parametrize(
    ("services", "kind"),
    [(["target"], Worker), (["physics"], Clock), (["target", "physics"], Clock)],
)
def test_with_the_world_there_is_time_and_without_it_a_worker_that_waits(scenario, services, kind):
    driver = drive([(service, "") for service in services], LocalBus(), scenario)
    assert type(driver) is kind
    assert {hosted.name for hosted in driver.host.hosted} == set(services)


def test_an_observer_drives_itself_and_has_begun_a_run(scenario):
    page = drive([("viewer", "")], LocalBus(), scenario)
    assert isinstance(page, Page)
    assert page.seed == 5
