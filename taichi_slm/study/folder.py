"""A study's folder: what lies where."""

from dataclasses import dataclass
from pathlib import Path

from taichi_slm.errors import StorageError
from taichi_slm.output.atomic import make_folder, storage_error, write_text
from taichi_slm.run.run_folder import RunFolder


@dataclass(frozen=True)
class StudyFolder:
    """The paths of one study."""

    path: Path

    @classmethod
    def prepare(cls, path: Path) -> "StudyFolder":
        """Make the folder, or take up the study that is there; nothing else is ever written into."""
        folder = cls(path)
        try:
            taken = path.exists() and (not path.is_dir() or any(path.iterdir()))
        except OSError as error:
            raise storage_error("look into", path, error) from error
        if taken and not folder.plan.is_file():
            raise StorageError(f"{path} exists already and is not a study: name another --out")
        for part in (folder.scenes, folder.runs, folder.logs):
            make_folder(part)
        return folder

    @property
    def given(self) -> Path:
        """The study file as given."""
        return self.path / "study.yaml"

    @property
    def plan(self) -> Path:
        """The runs, with what they change."""
        return self.path / "plan.json"

    @property
    def scenes(self) -> Path:
        """Folder of the scenes, one for each run, every key spelled out."""
        return self.path / "scenes"

    @property
    def runs(self) -> Path:
        """Folder of the run folders."""
        return self.path / "runs"

    @property
    def logs(self) -> Path:
        """Folder of what the runs print."""
        return self.path / "logs"

    @property
    def set_aside(self) -> Path:
        """Folder of runs that were begun, left nothing to resume from, and were started anew."""
        return self.path / "set_aside"

    @property
    def table(self) -> Path:
        """One row per run."""
        return self.path / "table.csv"

    @property
    def overview(self) -> Path:
        """The plot of the results."""
        return self.path / "overview.png"

    @property
    def contact_sheet(self) -> Path:
        """The last picture of every run."""
        return self.path / "contact_sheet.png"

    @property
    def stop(self) -> Path:
        """A file that, once it exists, asks all runs to stop."""
        return self.path / "STOP"

    def scene(self, name: str) -> Path:
        """The scene of the run ``name``."""
        return self.scenes / f"{name}.yaml"

    def log(self, name: str) -> Path:
        """What the run ``name`` prints; held by its process as long as it lives."""
        return self.logs / f"{name}.log"

    def run(self, name: str) -> RunFolder:
        """The run folder of the run ``name``."""
        return RunFolder(self.runs / name)


def write_if_new(path: Path, text: str) -> None:
    """Write ``text``, unless it is there already: tasks of one job array begin at the same moment."""
    try:
        if path.read_text(encoding="utf-8") == text:
            return
    except (OSError, UnicodeDecodeError):
        pass  # it is not there, or not what it should be
    write_text(path, text)
