"""Imposed temperature histories of a body: T(t) and its rate."""

from bisect import bisect_right
from math import cos, pi, sin

from taichi_slm.config.schema import RampProgram, SineProgram


def program_temperature(program: SineProgram | RampProgram, t: float) -> float:
    """T [K] at time t [s] (paper eqs. 46 and 48)."""
    if isinstance(program, SineProgram):
        return program.mean * (1.0 + program.amplitude * sin(2.0 * pi * program.frequency * t))
    k = bisect_right([time for time, _ in program.points], t)
    if k in (0, len(program.points)):
        return program.points[min(k, len(program.points) - 1)][1]
    (t0, T0), (t1, T1) = program.points[k - 1], program.points[k]
    return T0 + (T1 - T0) * (t - t0) / (t1 - t0)


def program_rate(program: SineProgram | RampProgram, t: float) -> float:
    """dT/dt [K/s] at time t [s], from the right at a corner."""
    if isinstance(program, SineProgram):
        omega = 2.0 * pi * program.frequency
        return program.mean * program.amplitude * omega * cos(omega * t)
    k = bisect_right([time for time, _ in program.points], t)
    if k in (0, len(program.points)):
        return 0.0
    (t0, T0), (t1, T1) = program.points[k - 1], program.points[k]
    return (T1 - T0) / (t1 - t0)
