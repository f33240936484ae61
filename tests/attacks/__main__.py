"""Command line of the attacks: ``python -m attacks NAME --seed N --count N``, with ``tests`` as the working folder."""

from __future__ import annotations

import argparse
import importlib
import sys
import time

# The module of each attack; the function has the attack's name.
ATTACKS = {
    "messages": "messages",
    "lines": "lines",
    "many_pages": "lines",
    "slow_readers": "lines",
    "long_run": "long_runs",
    "kills_of_workers": "bricks",
    "damaged_chunks": "bricks",
    "hostile_arrays": "bricks",
    "given_up": "bricks",
    "full_disks_of_workers": "bricks",
    "lost_schedulers": "bricks",
    "kills_of_films": "films",
    "full_disks_of_films": "films",
    "two_films_in_one_folder": "films",
    "odd_names": "films",
    "rubbish_frames": "films",
    "foreign_arguments": "arguments",
    "ends_of_viewers": "endings",
    "swapped_fields": "endings",
    "foreign_headers": "headers",
    "notebook_messages": "headers",
}


def main() -> int:
    """Run one attack; the exit code is 1 where it found anything."""
    parser = argparse.ArgumentParser(prog="python -m attacks", description=__doc__)
    parser.add_argument("name", choices=sorted(ATTACKS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=1000)
    given = parser.parse_args()
    began = time.monotonic()
    tally = getattr(importlib.import_module(f"attacks.{ATTACKS[given.name]}"), given.name)(given.seed, given.count)
    print(f"{given.name}, seed {given.seed}, {given.count} in {time.monotonic() - began:.0f} s\n{tally}")
    return 1 if tally.failures else 0


if __name__ == "__main__":
    sys.exit(main())
