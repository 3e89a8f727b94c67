"""Settings of every project's tests."""

import signal

from hypothesis import HealthCheck, settings

# a shared core may be slow: examples are limited in number, not in time
settings.register_profile("mecazen", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("mecazen")

# What a shell starts in the background ignores Ctrl-C, and hands that on: processes that the
# tests start and interrupt would never end.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
