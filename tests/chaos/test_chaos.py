"""A hundred kills in one run: whoever dies, the robot stays sane and follows again."""

from statistics import median

from faults import PARTS, RESUME_S, WALK, Strike, Up, strikes

KILLS = 100
SEED = 7


def test_after_each_of_a_hundred_kills_the_robot_follows_again():
    done = []
    with Up("circle", *WALK) as up:
        up.wait_until_it_follows()
        for struck in strikes(up, KILLS, SEED):
            done.append(struck)
            print(f"{len(done):3} {struck}", flush=True)
    report(done)
    assert max(struck.resumed_s for struck in done) <= RESUME_S


def report(done: list[Strike]) -> None:
    """Print what it took, by who was killed."""
    print(f"\n{len(done)} kills, seed {SEED}; back: wall time from the kill until ready again;")
    print("follows: simulated time from then on")
    print(f"{'killed':22}{'kills':>6}{'back p50':>10}{'max':>7}{'follows p50':>13}{'max':>7}")
    groups = {name: [s for s in done if s.names == (name,)] for name in PARTS}
    groups |= {"two at once": [s for s in done if len(s.names) == 2], "all": done}
    for name, group in groups.items():
        back = [struck.back_s for struck in group]
        resumed = [struck.resumed_s for struck in group]
        print(
            f"{name:22}{len(group):6}{median(back):9.2f}s{max(back):6.2f}s"
            f"{median(resumed):12.2f}s{max(resumed):6.2f}s"
        )
    print(f"fastest {max(s.fastest_m_s for s in done):.2f} m/s, ", end="")
    print(f"hardest change {max(s.hardest_m_s2 for s in done):.2f} m/s² over 0.2 s")
