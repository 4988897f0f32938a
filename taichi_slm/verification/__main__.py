"""One case in a process of its own: ``python -m taichi_slm.verification NAME FILE`` writes its outcome to FILE."""

import sys
import time
from pathlib import Path

from taichi_slm.output.atomic import write_json
from taichi_slm.verification.catalogue import chosen


def main() -> None:
    """Run the case, and say how long it took."""
    name, target = sys.argv[1:]
    (case,) = chosen([name])
    began = time.perf_counter()
    outcome = case.run()
    write_json(Path(target), {**outcome.to_json(), "seconds": time.perf_counter() - began})


if __name__ == "__main__":
    main()
