"""Every way a run can end other than well: one class and one exit code each."""

from typing import ClassVar


class SlmError(Exception):
    """Base: the message is a sentence for the user; ``exit_code`` is what the command returns."""

    exit_code: ClassVar[int] = 1


class LimitBrokenError(SlmError):
    """A verification case missed its limit."""

    exit_code = 1


class UnfitMachineError(SlmError):
    """`doctor` found that no run can work on this machine."""

    exit_code = 1


class ConfigError(SlmError):
    """The config is wrong: the message lists every error with file, line and key."""

    exit_code = 2


class BlowUpError(SlmError):
    """The simulation left the physical: the message names pass, particle, place and rule."""

    exit_code = 3


class StorageError(SlmError):
    """Disk or memory: full, read-only, vanished, too small."""

    exit_code = 4


class StoppedError(SlmError):
    """Stopped early but resumable (SIGTERM, wall limit, STOP file)."""

    exit_code = 75


class InterruptedRunError(SlmError):
    """Ctrl-C, after the checkpoint."""

    exit_code = 130
