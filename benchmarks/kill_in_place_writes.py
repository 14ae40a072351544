"""Kill processes at random moments while they write a rig in place; the rig must read, and no entry be lost.

python benchmarks/kill_in_place_writes.py [KILLS]
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "files"))

from writers import kill_at_random, write

ROUND = 25  # kills on one history, so that reading it does not become the work


def main(kills: int) -> int:
    written = unreadable = lost = 0
    for start in range(0, kills, ROUND):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rig.json"
            write(path, 0.0)
            survey = kill_at_random(path, min(ROUND, kills - start), seed=start)
        written, unreadable, lost = written + survey.written, unreadable + survey.unreadable, lost + survey.lost
    print(f"{kills} kills, {written} entries reported as written: {unreadable} rigs unreadable, {lost} entries lost")
    return int(unreadable + lost > 0)


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000))
