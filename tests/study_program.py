"""`taichi-slm` with a closed form for a solver, as a program of its own; a module that Dask workers load first.

Above 1000 W a run blows up; at 666 W it is killed once; STUDY_SLEEP [s] is how long each stretch of a run takes.
"""

import os
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import fake_run

from taichi_slm.errors import BlowUpError
from taichi_slm.run import driver
from taichi_slm.study import execute

execute.PROGRAM = (sys.executable, __file__)


class Comet(fake_run.FakeSimulation):
    """Ten kelvin per watt; else as its parent."""

    def advance(self, *until):
        time.sleep(float(os.environ.get("STUDY_SLEEP", "0")))
        super().advance(*until)
        power = self.config.laser.power
        once = Path(os.environ.get("STUDY_ONCE", "killed"))
        if power == 666 and self.time > 5e-5 and not once.exists():
            once.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if power > 1000 and self.time > 5e-5:
            raise BlowUpError(f"heat: particle 3 at {10 * power:.0f} K")

    def diagnostics(self):
        return super().diagnostics() | {"max_temperature_K": 10 * self.config.laser.power}


if __name__ == "__main__":
    from taichi_slm.cli import main

    driver._build = lambda config, *_: Comet(config)  # of this process alone: tests import this module, too
    main()
