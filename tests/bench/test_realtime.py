"""Processes are measured in real time, those of a viewer too."""

from mecazen_bench import realtime


def test_a_stack_in_real_time_is_measured_by_process(figures):
    rows = figures(realtime.run(window_s=1.0))
    services = ["physics", "controller", "target", "follower"]
    assert sorted(rows) == sorted(
        ["router", *services, "fork server", "tracker", "up", "all", "mecazen up"]
    )
    for name in services:
        assert rows[name]["% of a core"].value > 0.0
        assert rows[name]["MB"].value > 1.0


def test_the_viewer_takes_some_processor_time_and_memory(figures):
    service, server, _ = figures(realtime.run_viewer(window_s=2.0)).values()
    # a server without a browser may take less than the resolution of the processor's clock
    assert service["% of a core"].value > 0.0
    assert min(service["MB"].value, server["MB"].value) > 1.0
