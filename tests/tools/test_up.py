"""What `mecazen up` does when it is asked to end."""

import signal

import pytest
from mecazen_tools.cli.up import Interrupts
from mecazen_tools.forking import STOPPING


@pytest.fixture(autouse=True)
def handlers():
    before = {number: signal.getsignal(number) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_that_asks_to_end_interrupts(number):
    interrupts = Interrupts()
    interrupts.check()
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(number)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_an_interrupt_that_a_destructor_drops_is_not_lost():
    class Dropping:
        def __del__(self):
            signal.raise_signal(signal.SIGINT)

    interrupts = Interrupts()
    Dropping()
    with pytest.raises(KeyboardInterrupt):
        interrupts.check()
