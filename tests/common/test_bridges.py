"""A bridge to another system is what is installed, and what the settings ask for."""

import pytest
from mecazen import bridges
from mecazen.config import BusConfig
from mecazen.errors import BusError


def test_no_bridge_is_loaded_unless_the_settings_ask_for_it(monkeypatch):
    monkeypatch.setattr(bridges, "import_module", pytest.fail)
    assert bridges.bridge_of(BusConfig()) is None


def test_a_bridge_that_is_not_installed_is_an_error_that_says_what_to_install(monkeypatch):
    monkeypatch.setattr(bridges, "is_installed", lambda extra: False)
    bridges.installed.cache_clear()
    with pytest.raises(BusError, match=r"needs pip install 'mecazen\[ros2\]'"):
        bridges.bridge_of(BusConfig(ros2=True))
