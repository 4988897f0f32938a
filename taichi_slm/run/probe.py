"""Tries one thing on this machine and prints what it found as a line of JSON.

``python -m taichi_slm.run.probe backends``, or ``pictures``. :mod:`taichi_slm.run.doctor` runs it in a
process of its own, which a bad driver may end.
"""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

LAUNCHES, BATCHES = 300, 7


def backends() -> dict[str, Any]:
    """Which backends Taichi finds, what a kernel launch costs [s], and where compiled kernels are kept."""
    from taichi_slm.backend import start, ti

    start("cpu")
    one, wide = ti.field(ti.f64, shape=()), ti.field(ti.f64, shape=4096)

    @ti.kernel
    def serial():
        one[None] = 1.0

    @ti.kernel
    def parallel():
        for i in wide:
            wide[i] = 1.0

    settings = ti.lang.impl.current_cfg()
    return {
        "backends": [
            name
            for name in ("cpu", "cuda", "vulkan", "metal")
            if ti.lang.misc.is_arch_supported(getattr(ti, name))
        ],
        "serial": _launch_cost(serial, ti.sync),
        "parallel": _launch_cost(parallel, ti.sync),
        "threads": settings.cpu_max_num_threads,
        "cache": settings.offline_cache_file_path,
    }


def _launch_cost(kernel: Callable[[], None], finish: Callable[[], None]) -> float:
    kernel()
    finish()
    costs = []
    for _ in range(BATCHES):
        began = time.perf_counter()
        for _ in range(LAUNCHES):
            kernel()
        finish()
        costs.append((time.perf_counter() - began) / LAUNCHES)
    return min(costs)


def pictures() -> dict[str, Any]:
    """Whether a red ball drawn off screen comes out, and by which kind of window."""
    import numpy as np
    import pyvista

    plotter = pyvista.Plotter(off_screen=True, window_size=[64, 64])
    plotter.add_mesh(pyvista.Sphere(), color="red")
    image = np.asarray(plotter.screenshot(None, return_img=True))
    return {"window": type(plotter.render_window).__name__, "drawn": bool(np.ptp(image[..., 1]) > 10)}


if __name__ == "__main__":
    found = {"backends": backends, "pictures": pictures}[sys.argv[1]]()
    print("\n" + json.dumps(found), flush=True)
