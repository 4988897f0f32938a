"""Tries one thing on this machine and prints what it found as a line of JSON.

``python -m taichi_slm.run.probe launch``, ``backend cuda``, ``pictures``, ``films``. :mod:`taichi_slm.run.doctor` runs
each in a process of its own, which a bad driver may end.
"""

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

LAUNCHES, BATCHES = 300, 7
ROWS = 10_000


def launch() -> dict[str, Any]:
    """What a kernel launch costs on the CPU [s], on how many threads, and where compiled kernels are kept."""
    from taichi_slm.backend import direct, start, ti

    start("cpu")
    one, wide = ti.field(ti.f64, shape=()), ti.field(ti.f64, shape=4096)

    @direct
    @ti.kernel
    def serial():
        one[None] = 1.0

    @direct
    @ti.kernel
    def parallel():
        for i in wide:
            wide[i] = 1.0

    settings = ti.lang.impl.current_cfg()
    return {
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


def backend(name: str) -> dict[str, Any]:
    """Whether the backend ``name`` is there, and with which precisions it sums a field rightly, in f64 as accounts are.

    ``works``: precision -> "" or why not.
    """
    from taichi_slm.backend import start, ti

    if not ti.lang.misc.is_arch_supported(getattr(ti, name)):
        return {"there": False, "works": {}}
    works = {}
    for precision in ("f64", "f32"):
        try:
            start(name, precision)
            works[precision] = _sums(ti, name, getattr(ti, precision))
        except Exception as error:  # whatever a driver raises is the answer
            works[precision] = (str(error).strip() or type(error).__name__).splitlines()[-1]
    return {"there": True, "works": works}


def _sums(ti: Any, name: str, real: Any) -> str:
    """Add up 0, 1, 2 ... in parallel, and compare with n (n - 1)/2; "" if they agree."""
    running = ti.lang.impl.current_cfg().arch
    if name != "cpu" and running != getattr(ti, name):  # it falls back to the CPU without a word
        return f"Taichi took {running} instead"
    values, total = ti.field(real, shape=ROWS), ti.field(ti.f64, shape=())

    @ti.kernel
    def fill():
        for i in values:
            values[i] = i

    @ti.kernel
    def add():
        for i in values:
            ti.atomic_add(total[None], ti.cast(values[i], ti.f64))

    fill()
    add()
    found, exact = float(total[None]), 0.5 * ROWS * (ROWS - 1)
    return "" if found == exact else f"a sum is {found:.17g}, not {exact:.17g}"


def pictures() -> dict[str, Any]:
    """Whether a red ball drawn off screen comes out, by which kind of window, and who draws."""
    import numpy as np
    import pyvista

    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[64, 64])
    plotter.add_mesh(pyvista.Sphere(), color="red")
    image = np.asarray(plotter.screenshot(None, return_img=True))
    told = plotter.render_window.ReportCapabilities().splitlines()
    renderer = next((line.partition(":")[2].strip() for line in told if "renderer string" in line), "")
    return {
        "window": type(plotter.render_window).__name__,
        "renderer": renderer,
        "drawn": bool(np.ptp(image[..., 1]) > 10),
    }


def films() -> dict[str, Any]:
    """Whether ffmpeg makes a film of three pictures that reads back as three, and which ffmpeg it is."""
    import imageio.v2 as imageio
    import imageio_ffmpeg
    import numpy as np

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "film.mp4")
        writer: Any
        with imageio.get_writer(path, fps=3, macro_block_size=2) as writer:
            for grey in (0, 128, 255):
                writer.append_data(np.full((32, 32, 3), grey, dtype=np.uint8))
        reader: Any = imageio.get_reader(path)
        frames = sum(1 for _ in reader)  # its len() is infinite
    return {"version": imageio_ffmpeg.get_ffmpeg_version(), "frames": frames}


SUBJECTS: dict[str, Callable[..., dict[str, Any]]] = {
    "launch": launch,
    "backend": backend,
    "pictures": pictures,
    "films": films,
}

if __name__ == "__main__":
    found = SUBJECTS[sys.argv[1]](*sys.argv[2:])
    print("\n" + json.dumps(found), flush=True)
