"""What this machine can do for a run: versions, backends, launch cost, pictures, folders.

Taichi and the renderer are tried in processes of their own, because a bad driver can end a process.
"""

import json
import os
import platform
import shutil
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from taichi_slm.compiler import compiler

PACKAGES = (
    "taichi-slm",
    "taichi",
    "numpy",
    "scipy",
    "pydantic",
    "ruamel.yaml",
    "pint",
    "vtk",
    "pyvista",
    "meshio",
)
PATIENCE = 180  # [s] for one probe
GL_PACKAGES = {"libGL": "libgl1", "libEGL": "libegl1", "libOSMesa": "libosmesa6", "libX": "libxrender1"}


@dataclass(frozen=True)
class Finding:
    """One line of the report."""

    subject: str
    value: str
    good: bool = True


def examine() -> list[Finding]:
    """Everything worth knowing before a run."""
    return [*_versions(), *_machine(), *_taichi(*_probe("backends")), *_pictures(*_probe("pictures"))]


def _probe(subject: str) -> tuple[dict[str, Any] | None, str]:
    """(what the probe found, what it said otherwise), from a process of its own."""
    command = (sys.executable, "-m", "taichi_slm.run.probe", subject)
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


def _versions() -> list[Finding]:
    findings = [Finding("python", f"{platform.python_version()} ({platform.machine()}, {platform.system()})")]
    for name in PACKAGES:
        try:
            findings.append(Finding(name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            findings.append(Finding(name, "not installed", False))
    return findings


def _machine() -> list[Finding]:
    from taichi_slm.run.estimate import available_memory

    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    findings = [Finding("cpu", f"{usable} of {os.cpu_count()} threads usable")]
    memory = available_memory()
    if memory is not None:
        findings.append(Finding("memory", f"{memory / 1e9:,.1f} GB free", memory > 1e9))
    here = Path.cwd()
    free = shutil.disk_usage(here).free
    findings.append(Finding("disk", f"{free / 1e9:,.1f} GB free in {here}", free > 1e9))
    writable = os.access(here, os.W_OK)
    findings.append(
        Finding("run folders", f"{here / 'runs'}" if writable else f"{here} is read-only", writable)
    )
    return findings


def _taichi(report: dict[str, Any] | None, said: str) -> list[Finding]:
    if report is None:
        return [Finding("taichi starts", f"no: {said}", False)]
    names = {"x64": "cpu", "arm64": "cpu"}
    backends = ", ".join(names.get(name, name) for name in report["backends"])
    cache = Path(report["cache"])
    home = next((each for each in (cache, *cache.parents) if each.exists()), cache)
    writable = os.access(home, os.W_OK)
    note = "" if writable else " is read-only: every run will compile its kernels anew"
    return [
        Finding("backends", backends, bool(backends)),
        Finding("kernels compiled by", compiler()),
        Finding("taichi threads", str(report["threads"])),
        Finding(
            "kernel launch",
            f"{report['serial'] * 1e6:.1f} us serial, {report['parallel'] * 1e6:.1f} us parallel",
        ),
        Finding("kernel cache", f"{cache}{note}", writable),
    ]


def _pictures(report: dict[str, Any] | None, said: str) -> list[Finding]:
    if report is not None and report["drawn"]:
        return [Finding("pictures", f"yes ({report['window']})")]
    reason = said if report is None else "the picture stays empty"
    missing = next((package for library, package in GL_PACKAGES.items() if library in reason), None)
    packages = missing or "libgl1 libegl1"
    advice = f"no: {reason}. Runs finish without pictures; on Debian: apt install {packages}"
    return [Finding("pictures", advice, False)]
