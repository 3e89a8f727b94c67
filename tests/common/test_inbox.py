"""What waits for the service's thread: the newest good samples, or all up to a size."""

import queue

import pytest
from mecazen.bus.inbox import SAMPLE_BYTES, WAITING_SAMPLES, Backlog, Inbox, Refusals


@pytest.fixture
def ready():
    """The calls for the service's thread."""
    return queue.SimpleQueue()


def run(ready) -> int:
    """Make the calls that wait; return how many there were."""
    count = ready.qsize()
    for _ in range(count):
        ready.get()()
    return count


class Taken:
    """An inbox of words, of which those that begin with "x" are malformed."""

    def __init__(self, ready):
        self.tried: list[str] = []
        self.lost = 0
        self.inbox: Inbox[str] = Inbox(ready, self._take, self._is_good, self._count_lost)

    def receive(self, *samples):
        for sample in samples:
            self.inbox.receive(sample)

    def _is_good(self, sample):
        return not sample.startswith("x")

    def _take(self, sample):
        self.tried.append(sample)
        return self._is_good(sample)

    def _count_lost(self, count):
        self.lost += count


@pytest.mark.parametrize(
    ("samples", "tried", "lost"),
    [
        (["a"], ["a"], 0),
        (["a", "b", "c"], ["c"], 2),
        (["a", "b", "x1", "x2"], ["x2", "x1", "b"], 1),
        (["x1"], ["x1"], 0),
    ],
)
def test_the_newest_good_sample_is_taken_and_what_it_replaced_is_counted(
    ready, samples, tried, lost
):
    taken = Taken(ready)
    taken.receive(*samples)
    assert run(ready) == 1  # one call for all that wait
    assert (taken.tried, taken.lost) == (tried, lost)


def test_malformed_samples_never_displace_good_ones_and_good_ones_displace_the_oldest(ready):
    taken = Taken(ready)
    taken.receive("a", *["x"] * (WAITING_SAMPLES + 5))
    run(ready)
    assert taken.tried == [*["x"] * (WAITING_SAMPLES - 1), "a"]
    taken = Taken(ready)
    taken.receive(*["x"] * WAITING_SAMPLES, "b", "c")
    run(ready)
    assert (taken.tried, taken.lost) == (["c"], WAITING_SAMPLES - 1 + 2)


def test_what_comes_after_a_delivery_is_announced_again(ready):
    taken = Taken(ready)
    for sample in "ab":
        taken.receive(sample)
        assert run(ready) == 1
    assert (taken.tried, taken.lost) == (["a", "b"], 0)


def test_a_backlog_keeps_all_in_order_up_to_its_size_and_has_room_again_when_they_are_taken(ready):
    taken: list[str] = []
    refused: list[int] = []
    limit = 2 * (SAMPLE_BYTES + 3)
    backlog = Backlog(ready, taken.append, len, limit, lambda: refused.append(1))
    for sample in ("one", "two", "six"):
        backlog.receive(sample)
    assert len(refused) == 1
    run(ready)
    backlog.receive("ten")
    run(ready)
    assert taken == ["one", "two", "ten"]
    backlog.receive("x" * limit)
    assert len(refused) == 2


def test_refusals_are_reported_together_by_key_and_reason(ready):
    reports: list[tuple[str, str, int]] = []
    refusals = Refusals(ready, lambda *report: reports.append(report))
    for key, reason in (("a", "long"), ("a", "long"), ("a", "short"), ("b", "long")):
        refusals.add(key, reason)
    assert run(ready) == 1
    assert reports == [("a", "long", 2), ("a", "short", 1), ("b", "long", 1)]
    refusals.add("a", "long")
    assert run(ready) == 1
    assert reports[3:] == [("a", "long", 1)]
