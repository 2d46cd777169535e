# SPDX-License-Identifier: GPL-3.0-or-later
# ruff: noqa: E501 (a table)

"""One fault at each step of a transfer, with each taker of part killed there: how it ends, row by row.

Each row has been thought through. A row: step, what befalls its message, who is killed there and for how long; who
commands at the end, epoch, phase; how long after the aircraft entered the region GCSB commanded; how each transfer
ended; when nobody commanded. What to look for:

* A message lost or reordered costs one retransmission (0.2 s), doubled nothing. Late beyond the time-out of its step, it
  costs the attempt (4 s and a pause of 2 s), and what arrives then changes nothing. Only step 6 is not needed: the
  vehicle commits after 2 s.
* A partner that dies before its word (step 5) is through stays partner no longer; the commander keeps the aircraft until
  it is back. If it dies after that, it has authority, is lost 5 s later, and the former commander takes it by force;
  the end of its zone moves it once more.
* A commander that dies before its consent is lost 5 s later, and the partner takes it by force at once. After its consent
  the transfer goes on without it.
* The companion is back after 1 s with the same commander and the next epoch, and the transfer begins anew; after the
  commit it is not repeated.
"""

from __future__ import annotations

import pytest

from tests.model.fault_matrix import FAULTS, KILLS, NAMES, Fault, run

EXPECTED = """\
1 lost      | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
1 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 0.58 s; #1 committed (zone)
1 lost      | partner 8 s     | B e2 ON_MISSION; B after 8.16 s; #1 aborted (partner silent), #2 committed (zone)
1 lost      | commander 0.5 s | B e2 ON_MISSION; B after 0.88 s; #1 committed (zone)
1 lost      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
1 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
1 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
1 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 0.58 s; #1 committed (zone)
1 doubled   | partner 8 s     | B e2 ON_MISSION; B after 8.16 s; #1 aborted (partner silent), #2 committed (zone)
1 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 0.77 s; #1 committed (zone)
1 doubled   | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
1 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
1 late      | nobody          | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
1 late      | partner 0.5 s   | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
1 late      | partner 8 s     | B e2 ON_MISSION; B after 8.16 s; #1 aborted (partner silent), #2 committed (zone)
1 late      | commander 0.5 s | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
1 late      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (partner silent), #2 committed (commander_lost); nobody 5.0-5.1 s
1 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
1 reordered | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
1 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 0.58 s; #1 committed (zone)
1 reordered | partner 8 s     | B e2 ON_MISSION; B after 8.16 s; #1 aborted (partner silent), #2 committed (zone)
1 reordered | commander 0.5 s | B e2 ON_MISSION; B after 0.88 s; #1 committed (zone)
1 reordered | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
1 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
2 lost      | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
2 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 0.78 s; #1 committed (zone)
2 lost      | partner 8 s     | B e2 ON_MISSION; B after 8.36 s; #1 aborted (partner silent), #2 committed (zone)
2 lost      | commander 0.5 s | B e2 ON_MISSION; B after 0.88 s; #1 committed (zone)
2 lost      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
2 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
2 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
2 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 1.02 s; #1 committed (zone)
2 doubled   | partner 8 s     | B e2 ON_MISSION; B after 8.36 s; #1 aborted (partner silent), #2 committed (zone)
2 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 0.77 s; #1 committed (zone)
2 doubled   | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
2 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
2 late      | nobody          | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
2 late      | partner 0.5 s   | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
2 late      | partner 8 s     | B e2 ON_MISSION; B after 9.36 s; #1 aborted (partner silent), #2 committed (zone)
2 late      | commander 0.5 s | B e2 ON_MISSION; B after 6.06 s; #1 aborted (partner silent), #2 committed (zone)
2 late      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (partner silent), #2 committed (commander_lost); nobody 5.0-5.1 s
2 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
2 reordered | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
2 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 0.78 s; #1 committed (zone)
2 reordered | partner 8 s     | B e2 ON_MISSION; B after 8.36 s; #1 aborted (partner silent), #2 committed (zone)
2 reordered | commander 0.5 s | B e2 ON_MISSION; B after 0.88 s; #1 committed (zone)
2 reordered | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
2 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
3 lost      | nobody          | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
3 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 1.22 s; #1 committed (zone)
3 lost      | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
3 lost      | commander 0.5 s | B e2 ON_MISSION; B after 0.77 s; #1 committed (zone)
3 lost      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
3 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
3 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
3 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 1.02 s; #1 committed (zone)
3 doubled   | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
3 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
3 doubled   | commander 8 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
3 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
3 late      | nobody          | B e2 ON_MISSION; B after 6.16 s; #1 aborted (commander silent), #2 committed (zone)
3 late      | partner 0.5 s   | B e2 ON_MISSION; B after 6.16 s; #1 aborted (commander silent), #2 committed (zone)
3 late      | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (commander silent), #2 committed (zone)
3 late      | commander 0.5 s | B e2 ON_MISSION; B after 6.16 s; #1 aborted (commander silent), #2 committed (zone)
3 late      | commander 8 s   | B e2 ON_MISSION; B after 5.05 s; #1 aborted (commander silent), #2 committed (commander_lost); nobody 5.0-5.1 s
3 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
3 reordered | nobody          | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
3 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 1.22 s; #1 committed (zone)
3 reordered | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
3 reordered | commander 0.5 s | B e2 ON_MISSION; B after 0.77 s; #1 committed (zone)
3 reordered | commander 8 s   | B e2 ON_MISSION; B after 3.05 s; #1 committed (release_timeout)
3 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.0 s
4 lost      | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
4 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 1.02 s; #1 committed (zone)
4 lost      | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
4 lost      | commander 0.5 s | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
4 lost      | commander 8 s   | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
4 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
4 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
4 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 1.02 s; #1 committed (zone)
4 doubled   | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
4 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
4 doubled   | commander 8 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
4 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
4 late      | nobody          | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
4 late      | partner 0.5 s   | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
4 late      | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
4 late      | commander 0.5 s | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
4 late      | commander 8 s   | B e2 ON_MISSION; B after 5.07 s; #1 aborted (partner silent), #2 committed (commander_lost); nobody 5.0-5.1 s
4 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
4 reordered | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
4 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 1.02 s; #1 committed (zone)
4 reordered | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
4 reordered | commander 0.5 s | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
4 reordered | commander 8 s   | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
4 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
5 lost      | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
5 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 1.22 s; #1 committed (zone)
5 lost      | partner 8 s     | B e2 ON_MISSION; B after 8.38 s; #1 aborted (partner silent), #2 committed (zone)
5 lost      | commander 0.5 s | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
5 lost      | commander 8 s   | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
5 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
5 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
5 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
5 doubled   | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
5 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
5 doubled   | commander 8 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
5 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
5 late      | nobody          | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
5 late      | partner 0.5 s   | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
5 late      | partner 8 s     | B e2 ON_MISSION; B after 9.36 s; #1 aborted (partner silent), #2 committed (zone)
5 late      | commander 0.5 s | B e2 ON_MISSION; B after 6.16 s; #1 aborted (partner silent), #2 committed (zone)
5 late      | commander 8 s   | B e2 ON_MISSION; B after 5.07 s; #1 aborted (partner silent), #2 committed (commander_lost); nobody 5.0-5.1 s
5 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
5 reordered | nobody          | B e2 ON_MISSION; B after 0.26 s; #1 committed (zone)
5 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 1.06 s; #1 committed (zone)
5 reordered | partner 8 s     | B e4 ON_MISSION; B after 1.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 6.1-6.1 s
5 reordered | commander 0.5 s | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
5 reordered | commander 8 s   | B e2 ON_MISSION; B after 2.25 s; #1 committed (release_timeout)
5 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.0-1.1 s
6 lost      | nobody          | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
6 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
6 lost      | partner 8 s     | B e4 ON_MISSION; B after 0.27 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
6 lost      | commander 0.5 s | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 lost      | commander 8 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.1-1.1 s
6 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
6 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
6 doubled   | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
6 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
6 doubled   | commander 8 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
6 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.1-1.1 s
6 late      | nobody          | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 late      | partner 0.5 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 late      | partner 8 s     | B e4 ON_MISSION; B after 2.05 s; #1 committed (release_timeout), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
6 late      | commander 0.5 s | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 late      | commander 8 s   | B e2 ON_MISSION; B after 2.05 s; #1 committed (release_timeout)
6 late      | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.1-1.1 s
6 reordered | nobody          | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
6 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 0.27 s; #1 committed (zone)
6 reordered | partner 8 s     | B e4 ON_MISSION; B after 0.27 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
6 reordered | commander 0.5 s | B e2 ON_MISSION; B after 1.06 s; #1 committed (zone)
6 reordered | commander 8 s   | B e2 ON_MISSION; B after 1.06 s; #1 committed (zone)
6 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 1.26 s; #2 committed (zone); nobody 0.1-1.1 s
7 lost      | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 lost      | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 lost      | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
7 lost      | commander 0.5 s | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 lost      | commander 8 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 lost      | vehicle 1 s     | B e3 ON_MISSION; B after 0.06 s; #1 committed (zone); nobody 0.1-1.1 s
7 doubled   | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 doubled   | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 doubled   | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
7 doubled   | commander 0.5 s | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 doubled   | commander 8 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 doubled   | vehicle 1 s     | B e3 ON_MISSION; B after 0.06 s; #1 committed (zone); nobody 0.1-1.1 s
7 late      | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 late      | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 late      | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
7 late      | commander 0.5 s | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 late      | commander 8 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 late      | vehicle 1 s     | B e3 ON_MISSION; B after 0.06 s; #1 committed (zone); nobody 0.1-1.1 s
7 reordered | nobody          | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 reordered | partner 0.5 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 reordered | partner 8 s     | B e4 ON_MISSION; B after 0.06 s; #1 committed (zone), #2 committed (commander_lost), #3 committed (zone_ends); nobody 5.1-5.1 s
7 reordered | commander 0.5 s | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 reordered | commander 8 s   | B e2 ON_MISSION; B after 0.06 s; #1 committed (zone)
7 reordered | vehicle 1 s     | B e3 ON_MISSION; B after 0.06 s; #1 committed (zone); nobody 0.1-1.1 s
"""

TABLE = {tuple(part.strip() for part in row.split("|")[:2]): row for row in EXPECTED.splitlines()}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.value)
@pytest.mark.parametrize("step", NAMES)
def test_each_fault_ends_as_it_should(step: int, fault: Fault) -> None:
    for kill in KILLS:
        outcome = run(step, fault, kill)
        expected = TABLE[f"{step} {fault.value}", kill.name]
        assert f"{step} {fault.value:9} | {kill.name:15} | {outcome}" == expected


def test_every_combination_is_in_the_table() -> None:
    assert len(EXPECTED.splitlines()) == len(TABLE) == 7 * 4 * 6


def test_in_the_end_the_station_of_the_zone_commands_and_all_agree() -> None:
    """Read from the table, so that no row may be put there that gives this away."""
    for row in TABLE.values():
        end, *rest = row.split("| ")[2].split("; ")
        assert end in ("B e2 ON_MISSION", "B e3 ON_MISSION", "B e4 ON_MISSION"), row
        assert "RETURN" not in rest, row
        if rest[-1].startswith("nobody "):
            begin, until = rest[-1].removeprefix("nobody ").removesuffix(" s").split("-")
            assert float(until) - float(begin) <= 1.1, row
