"""A run's folder: what lies where, and where the run came from; never written over."""

import hashlib
import os
import platform
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

from taichi_slm.compiler import compiler
from taichi_slm.config.load import LoadedConfig, load_config
from taichi_slm.config.material import Material
from taichi_slm.config.schema import Config
from taichi_slm.errors import ConfigError, StorageError
from taichi_slm.output import lock
from taichi_slm.output.atomic import make_folder, read_json, storage_error, write_text

__all__ = ["RunFolder", "package_version", "processor", "provenance", "read_json", "source_hash"]

PACKAGES = ("taichi", "quadrants", "numpy", "scipy", "vtk", "pyvista", "meshio", "pydantic")


@dataclass(frozen=True)
class RunFolder:
    """The paths of one run."""

    path: Path

    @classmethod
    def create(cls, loaded: LoadedConfig, out: Path | None = None) -> "RunFolder":
        """Make ``out``, or runs/NAME-UTCSTAMP/ in the working directory, and put the config into it."""
        folder = cls(_fresh(loaded, out))
        for part in (folder.snapshots, folder.checkpoints, folder.renders, folder.analysis):
            make_folder(part)
        write_text(folder.config, loaded.text)
        write_text(folder.resolved, loaded.resolved_text)
        return folder

    @classmethod
    def open(cls, path: Path) -> "RunFolder":
        """The run at ``path``; a StorageError if there is none."""
        folder = cls(path)
        if not path.is_dir():
            raise StorageError(f"there is no folder {path}")
        if not folder.resolved.is_file() or not folder.provenance.is_file():
            raise StorageError(
                f"{path} is not a run folder: config.resolved.yaml or provenance.json is missing"
            )
        return folder

    def resolved_config(self, facts: Mapping[str, Any]) -> Config:
        """The config of the run; a ConfigError if it is not the one of ``facts``, its provenance."""
        begun_with = facts.get("config_sha256")
        try:
            data = self.resolved.read_bytes()
        except OSError as error:
            raise storage_error("read", self.resolved, error) from error
        if begun_with not in (None, hashlib.sha256(data).hexdigest()):
            raise ConfigError(
                f"{self.resolved} is not what the run was begun with (provenance.json has its SHA-256): put it back, "
                "or begin a new run from it"
            )
        return load_config(self.resolved).config

    @property
    def config(self) -> Path:
        """The config as given."""
        return self.path / "config.yaml"

    @property
    def resolved(self) -> Path:
        """The config with every default."""
        return self.path / "config.resolved.yaml"

    @property
    def provenance(self) -> Path:
        """What ran, where, from which source."""
        return self.path / "provenance.json"

    @property
    def history(self) -> Path:
        """One row of numbers per interval."""
        return self.path / "history.csv"

    @property
    def series(self) -> Path:
        """The snapshots as a time series."""
        return self.path / "snapshots.pvd"

    @property
    def snapshots(self) -> Path:
        """Folder of the VTU files."""
        return self.path / "snapshots"

    @property
    def checkpoints(self) -> Path:
        """Folder of the two slots."""
        return self.path / "checkpoints"

    @property
    def renders(self) -> Path:
        """Folder of the pictures."""
        return self.path / "renders"

    @property
    def analysis(self) -> Path:
        """Folder for analyses of the run."""
        return self.path / "analysis"

    @property
    def crash(self) -> Path:
        """Folder of the moment of a blow-up."""
        return self.path / "crash"

    @property
    def status(self) -> Path:
        """Where the run stands."""
        return self.path / "status.json"

    @property
    def summary(self) -> Path:
        """What the run came to."""
        return self.path / "summary.json"

    @property
    def stop(self) -> Path:
        """A file that, once it exists, asks the run to stop."""
        return self.path / "STOP"

    def snapshot(self, index: int) -> Path:
        """The file of snapshot ``index``, counted from 0."""
        return self.snapshots / f"{index:06d}.vtu"


def _fresh(loaded: LoadedConfig, out: Path | None) -> Path:
    if out is not None:
        taken = out.exists() and (not out.is_dir() or any(out.iterdir()))
        if not taken:
            make_folder(out)
            taken = not lock.claim(out)
        if taken:
            raise StorageError(
                f"{out} exists already and is never written over: name another --out, move it away, "
                f"or, if it is a run that stopped, continue it with: taichi-slm resume {out}"
            )
        return out
    name = loaded.path.stem
    stamp = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    make_folder(Path("runs"))
    for attempt in range(1, 1000):
        path = Path("runs") / (f"{name}-{stamp}" if attempt == 1 else f"{name}-{stamp}-{attempt}")
        try:
            path.mkdir()
        except FileExistsError:
            continue
        except OSError as error:
            raise storage_error("make the folder", path, error) from error
        return path
    raise StorageError(f"runs/ holds a thousand runs named {name}-{stamp}; name one with --out")


def provenance(
    config: Config,
    resolved_text: str,
    source: Path,
    materials: Sequence[Material],
    arch: str,
    precision: str,
    threads: int | None,
) -> dict[str, Any]:
    """What a person needs to make the same run again."""
    return {
        "version": package_version(),
        "git": source_hash(),
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "config": str(source),
        "config_sha256": hashlib.sha256(resolved_text.encode("utf-8")).hexdigest(),
        "seed": config.seed,
        "arch": arch,
        "precision": precision,
        "threads": threads,
        "compiler": compiler(),
        "argv": sys.argv,
        "packages": {name: version for name in PACKAGES if (version := _version(name))},
        "machine": {
            "python": platform.python_version(),
            "system": platform.platform(),
            "processor": processor(),
            "cores": os.cpu_count(),
            "host": platform.node(),
        },
        "materials": [{"name": m.name, "solidus_K": m.solidus, "liquidus_K": m.liquidus} for m in materials],
    }


def package_version() -> str:
    """The version of taichi_slm."""
    return _version("taichi-slm") or "unknown"


@lru_cache(maxsize=1)
def source_hash() -> str:
    """The commit of the source checkout, "-dirty" if files differ; without a checkout the version."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return package_version()
    try:
        commit = _git(root, "rev-parse", "HEAD")
        return commit + ("-dirty" if _git(root, "status", "--porcelain", "--untracked-files=no") else "")
    except (OSError, subprocess.SubprocessError):
        return package_version()


def _git(root: Path, *arguments: str) -> str:
    done = subprocess.run(
        ["git", *arguments], cwd=root, capture_output=True, text=True, check=True, timeout=10
    )
    return done.stdout.strip()


def _version(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def processor() -> str:
    """The name of this machine's processor."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:
        pass  # not Linux
    return platform.processor()
