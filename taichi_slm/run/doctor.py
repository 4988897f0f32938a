"""What this machine can do for a run: versions, backends, launch cost, pictures, films, folders.

Kernels, pictures and films are tried, each in a process of its own, because a bad driver can end a process.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from taichi_slm.errors import UnfitMachineError

NEEDED = ("taichi", "numpy", "scipy", "pydantic", "ruamel.yaml", "pint", "typer", "rich", "vtk")
FOR = {  # packages that a run does without -> what is lost with them
    "pyvista": "pictures",
    "pillow": "pictures",
    "imageio": "films",
    "imageio-ffmpeg": "films",
    "meshio": "export",
    "h5py": "export to xdmf",
    "matplotlib": "plots",
}
EXTRAS = {
    "quadrants": "the other compiler of kernels",
    "pyarrow": "study tables as Parquet",
    "distributed": "studies on a cluster",
}
PATIENCE = 60  # [s] for one probe
ENOUGH = 1e9  # bytes of memory, and of disk
GL_PACKAGES = {"libGL": "libgl1", "libEGL": "libegl1", "libOSMesa": "libosmesa6", "libX": "libxrender1"}

Report = tuple[dict[str, Any] | None, str]


@dataclass(frozen=True)
class Finding:
    """One line of the report. ``needed``: without it there is no run at all."""

    subject: str
    value: str
    good: bool = True
    needed: bool = False


def examine() -> list[Finding]:
    """Everything worth knowing before a run; some seconds."""
    launch = _probe("launch")  # alone: it is timed
    others = ["cuda", "vulkan", "metal"] if sys.platform == "darwin" else ["cuda", "vulkan"]
    with ThreadPoolExecutor() as pool:  # each waits for a process of its own
        backends = [(name, pool.submit(_probe, "backend", name)) for name in ("cpu", *others)]
        pictures, films = pool.submit(_probe, "pictures"), pool.submit(_probe, "films")
    return [
        *_versions(),
        *_machine(),
        *_kernels(*launch),
        *(_backend(name, *answer.result()) for name, answer in backends),
        _pictures(*pictures.result()),
        _films(*films.result()),
    ]


def judge(findings: Iterable[Finding]) -> None:
    """Raises UnfitMachineError, which names them, if there are findings without which there is no run."""
    missing = [finding.subject for finding in findings if finding.needed and not finding.good]
    if missing:
        raise UnfitMachineError(f"no run will work here: {', '.join(missing)}")


def _probe(*subject: str) -> Report:
    """(what the probe found, what it said otherwise), from a process of its own."""
    command = (sys.executable, "-m", "taichi_slm.run.probe", *subject)
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return None, f"no answer within {PATIENCE} s"
    except OSError as error:
        return None, str(error)
    last = done.stdout.strip().rpartition("\n")[2]
    try:
        report = json.loads(last)
    except ValueError:
        report = None
    if not isinstance(report, dict):
        said = (done.stderr.strip() or done.stdout.strip()).splitlines()
        return None, said[-1] if said else f"the process ended with code {done.returncode}"
    return report, done.stderr


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _versions() -> list[Finding]:
    from taichi_slm import __version__

    findings = [
        Finding("python", f"{platform.python_version()} ({platform.machine()}, {platform.system()})"),
        Finding("taichi-slm", __version__),
    ]
    for name in NEEDED:
        version = _version(name)
        findings.append(Finding(name, version or "not installed", version is not None, needed=True))
    for name, purpose in FOR.items():
        version = _version(name)
        findings.append(Finding(name, version or f"not installed: no {purpose}", version is not None))
    for name, purpose in EXTRAS.items():
        findings.append(Finding(name, _version(name) or f"not installed ({purpose}; optional)"))
    return findings


def _machine() -> list[Finding]:
    from taichi_slm.run.estimate import available_memory

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    findings = [Finding("cpu", f"{usable} of {os.cpu_count()} threads usable")]
    memory = available_memory()
    if memory is not None:
        findings.append(Finding("memory", f"{memory / 1e9:,.1f} GB free", memory > ENOUGH))
    here = Path.cwd()
    free = shutil.disk_usage(here).free
    findings.append(Finding("disk", f"{free / 1e9:,.1f} GB free in {here}", free > ENOUGH))
    refusal = _refusal(here)
    value = f"{here / 'runs'}" if refusal is None else f"{here}: {refusal}; choose another folder with --out"
    findings.append(Finding("run folders", value, refusal is None))
    return findings


def _refusal(folder: Path) -> str | None:
    """Why no file can be made in ``folder``, found by making one; None if it can."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"x")
    except OSError as error:
        return error.strerror or str(error)
    return None


def _kernels(report: dict[str, Any] | None, said: str) -> list[Finding]:
    if report is None:
        return [Finding("kernels", f"no: {said}", False, needed=True)]
    from taichi_slm.compiler import compiler

    cache = Path(report["cache"])
    home = next((each for each in (cache, *cache.parents) if each.exists()), cache)
    refusal = _refusal(home)
    size = sum(file.stat().st_size for file in cache.rglob("*") if file.is_file())
    note = "" if refusal is None else f": {refusal}; every run will compile its kernels anew"
    serial, parallel = report["serial"] * 1e6, report["parallel"] * 1e6
    return [
        Finding("kernels", f"compiled by {compiler()}, on {report['threads']} CPU threads", needed=True),
        Finding("kernel launch", f"{serial:.1f} us serial, {parallel:.1f} us parallel"),
        Finding("kernel cache", f"{cache}, {size / 1e6:,.1f} MB{note}", refusal is None),
    ]


def _backend(name: str, report: dict[str, Any] | None, said: str) -> Finding:
    """Only the CPU is needed; a GPU that is not there is no fault, one that computes wrongly is."""
    needed, subject = name == "cpu", f"--arch {name}"
    if report is None:
        return Finding(subject, f"no: {said}", False, needed)
    if not report["there"]:
        return Finding(subject, "not on this machine", not needed, needed)
    faults = {precision: fault for precision, fault in report["works"].items() if fault}
    fine = [precision for precision in report["works"] if precision not in faults]
    parts = [f"works in {' and '.join(fine)}"] if fine else []
    parts += [f"not in {precision}: {fault}" for precision, fault in faults.items()]
    return Finding(subject, "; ".join(parts), bool(fine), needed)


def _pictures(report: dict[str, Any] | None, said: str) -> Finding:
    if report is not None and report["drawn"]:
        return Finding("pictures", f"drawn by {report['renderer'] or 'OpenGL'} ({report['window']})")
    reason = said if report is None else "the picture stays empty"
    missing = next((package for library, package in GL_PACKAGES.items() if library in reason), None)
    packages = missing or "libgl1 libegl1"
    advice = f"no: {reason}. Runs finish without pictures; on Debian: apt install {packages}"
    return Finding("pictures", advice, False)


def _films(report: dict[str, Any] | None, said: str) -> Finding:
    if report is not None and report["frames"] == 3:
        return Finding("films", f"ffmpeg {report['version']}")
    reason = said if report is None else f"{report['frames']} of 3 pictures came back from a film"
    return Finding("films", f"no: {reason}. `render --movie` will not work", False)
