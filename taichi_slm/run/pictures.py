"""The processes that draw the pictures of a run."""

import os
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from types import TracebackType

from taichi_slm.config.schema import Config
from taichi_slm.run.run_folder import RunFolder

RENDER_SECONDS = 1800
GL_PACKAGES = "libgl1 libegl1"


class Draughtsmen:
    """Processes begun with a run, which draw its pictures when it is done: one for each of ``threads`` (None: cores).

    They are processes of their own, so that a missing GL never takes a run with it. Each loads for a second what
    draws, beside the compiling of the kernels, which keeps one core busy; then it waits on a pipe, and ends when the
    run does, however that happens. Use it as a context.
    """

    def __init__(self, folder: RunFolder, config: Config, threads: int | None = None):
        self._folder, self._processes, self._failure = folder, list[subprocess.Popen[str]](), ""
        asked_for = config.output.images_at_most if config.output.images else 0
        shares = min(threads or os.cpu_count() or 1, asked_for)
        command = [sys.executable, "-m", "taichi_slm.render", str(folder.path)]
        pipe = subprocess.PIPE
        try:
            for share in range(shares):
                said = [*command, str(share), str(shares), "wait"]
                self._processes.append(
                    subprocess.Popen(said, text=True, stdin=pipe, stdout=pipe, stderr=pipe)
                )
        except OSError as error:  # no memory, or no process more: a run without pictures is still a run
            self._failure = str(error)

    def __enter__(self) -> "Draughtsmen":
        return self

    def __exit__(self, *_: type[BaseException] | BaseException | TracebackType | None) -> None:
        for process in self._processes:
            with process:
                process.kill()

    def draw(self) -> str:
        """Have the pictures drawn from the folder; returns the line to print."""
        if not (self._processes or self._failure):
            return "pictures   none asked for"
        began = time.perf_counter()

        def told(process: subprocess.Popen[str]) -> tuple[int, str]:
            said, complained = process.communicate("draw\n", RENDER_SECONDS)
            return process.returncode, complained or said

        try:
            with ThreadPoolExecutor(max(1, len(self._processes))) as pool:
                everyone = list(pool.map(told, self._processes))
        except (OSError, subprocess.SubprocessError) as error:
            self._failure = str(error)
        if self._failure:
            return f"pictures   none: {self._failure}"
        code, said = max(everyone, key=lambda one: abs(one[0]))  # one that failed, if there is one
        if code == 0:
            count = len(list(self._folder.renders.glob("*.png")))
            return f"pictures   {count} in {self._folder.renders} ({time.perf_counter() - began:.0f} s)"
        lines = said.strip().splitlines()
        reason = lines[-1] if lines else f"code {code}"
        return (
            f"pictures   none: rendering failed ({reason}). On a machine without OpenGL install it "
            f"(Debian: apt install {GL_PACKAGES}), then: taichi-slm render {self._folder.path}"
        )
