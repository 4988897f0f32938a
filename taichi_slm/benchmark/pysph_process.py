"""PySPH, if it is there: in this interpreter, or in the one that the environment variable TAICHI_SLM_PYSPH names.

It runs pysph_drop.py in a process of its own, and what comes back is looked at before it is believed.
"""

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, FiniteFloat, ValidationError

VARIABLE = "TAICHI_SLM_PYSPH"
SCRIPT = Path(__file__).with_name("pysph_drop.py")
STARTS_WITHIN = 60.0  # [s] of an interpreter that imports PySPH
ENDS_WITHIN = 1800.0  # [s] of one drop, compiling included


class PySPHError(Exception):
    """PySPH is not there, or did not answer; the message is a sentence."""


class Answer(BaseModel):
    """What pysph_drop.py writes."""

    seconds: Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
    steps: Annotated[int, Field(gt=0)]
    position: list[tuple[FiniteFloat, FiniteFloat]] = []  # of the elliptic drop at the end
    jump: list[FiniteFloat] = []  # of the square drop


@dataclass(frozen=True)
class PySPH:
    """An interpreter that can import it."""

    interpreter: str
    version: str

    def run(self, job: dict[str, Any]) -> Answer:
        """Run the drop of ``job`` (see pysph_drop.py). Raises PySPHError."""
        with tempfile.TemporaryDirectory() as scratch:
            job_file, result_file = Path(scratch) / "job.json", Path(scratch) / "result.json"
            job_file.write_text(json.dumps(job), encoding="utf-8")
            _said([self.interpreter, str(SCRIPT), str(job_file), str(result_file)], ENDS_WITHIN)
            if not result_file.is_file():
                raise PySPHError(f"{self.interpreter} ended without a result")
            try:
                answer = Answer.model_validate_json(result_file.read_bytes())
            except ValidationError as error:
                first = error.errors()[0]
                where = ".".join(str(part) for part in first["loc"]) or "result"
                raise PySPHError(
                    f"{self.interpreter} answered with a wrong {where}: {first['msg']}"
                ) from None
        expected = {"position": job["position"], "jump": ()} if job["drop"] == "elliptic" else {
            "position": (), "jump": job["sample_times"]}  # fmt: skip
        for name, like in expected.items():
            got = len(getattr(answer, name))
            if got != len(like):
                raise PySPHError(f"{self.interpreter} answered with {got} of {name}, not {len(like)}")
        return answer


def find() -> PySPH:
    """The PySPH of TAICHI_SLM_PYSPH, or of this interpreter. Raises PySPHError."""
    named = os.environ.get(VARIABLE, "")
    if not named and importlib.util.find_spec("pysph") is None:
        raise PySPHError(f"PySPH is not in this environment, and {VARIABLE} names no interpreter that has it")
    interpreter = named or sys.executable
    said = _said([interpreter, "-c", "import pysph; print(pysph.__version__)"], STARTS_WITHIN)
    if not re.fullmatch(r"\d+(\.\w+)+", said):
        raise PySPHError(f"{interpreter} was asked for the version of PySPH and said '{said}'")
    return PySPH(interpreter, said)


def _said(command: Sequence[str], within: float) -> str:
    """The last line that a process printed. Raises PySPHError if it could not start, failed or took too long."""
    name = command[0]
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    try:
        ended = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace",
                               timeout=within, check=False)  # fmt: skip
    except OSError as error:
        raise PySPHError(f"{name} cannot be started: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise PySPHError(f"{name} was stopped after {within:.0f} s") from None
    if ended.returncode:
        raise PySPHError(f"{name} ended with {ended.returncode}: {_last_line(ended.stderr)}")
    return _last_line(ended.stdout)


def _last_line(text: str) -> str:
    lines = text.split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")
