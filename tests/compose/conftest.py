"""Whole systems in containers, each test's under a name and at ports of its own."""

import pytest
from compose.containers import Stack, compose

BUILT = (
    *("router", "physics", "controller", "target", "follower"),
    *("viewer", "recorder", "sensors", "guard"),
)
"""Services of docker-compose.yml, one for each image; `crowd` runs in that of `target`."""


@pytest.fixture(scope="session")
def images():
    """All images, as this checkout makes them."""
    if compose() is None:
        pytest.skip("no Compose, or no engine of Docker answers")
    Stack().run("build", *BUILT)
    return tuple(f"mecazen-{name}" for name in BUILT)


@pytest.fixture(scope="module")
def following(images):
    """The stack of `docker compose up`, with a seed and a standoff of its own."""
    stack = Stack(MECAZEN_SET="seed=5 follower.standoff_m=1.2")
    try:
        stack.up()
        yield stack
    finally:
        stack.down()


@pytest.fixture
def stacks(images):
    """Make stacks of containers that are removed after the test."""
    made = []

    def make(profile, **variables):
        made.append(Stack(profile, **variables))
        return made[-1]

    yield make
    for stack in made:
        stack.down()
