"""Settings of every project's tests."""

from hypothesis import HealthCheck, settings

# a shared core may be slow: examples are limited in number, not in time
settings.register_profile("mecazen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("mecazen")
