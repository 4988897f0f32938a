"""The launch of kernels: what `direct` saves must not change what a kernel does."""

import numpy as np
import pytest

from taichi_slm import backend
from taichi_slm.backend import direct, ti


def _kernels():
    total = ti.field(ti.f64, shape=())

    @ti.kernel
    def add(
        count: ti.i32, amount: ti.f64, twice: ti.template(), seen: ti.types.ndarray(dtype=ti.f64, ndim=1)
    ):
        for _ in range(count):
            total[None] += amount
            if ti.static(twice):
                total[None] += amount
            seen[0] = amount

    return total, add, direct(add)


@pytest.mark.parametrize("debug", [False, True])
def test_direct_launches_do_what_the_kernel_does(debug):
    """Every launch with its own numbers, array and variant: nothing of an earlier one is kept."""
    backend.start(threads=1, debug=debug)
    total, _, add = _kernels()
    expected, seen = 0.0, np.zeros((4, 1))
    for number, (count, amount, twice) in enumerate(
        [(3, 0.5, False), (2, 0.25, True), (1, 4.0, False), (5, 1, True)]
    ):
        add(count, amount, twice, seen[number])
        expected += count * amount * (2 if twice else 1)
        assert total[None] == expected  # sums of powers of two are exact
        assert seen[number, 0] == amount


def test_only_the_first_launch_of_a_variant_is_taichis_own(monkeypatch):
    """Or nothing is saved."""
    backend.start(threads=1)
    _, _, add = _kernels()
    own = ti.lang.kernel_impl.Kernel.launch_kernel
    launches = []
    monkeypatch.setattr(
        ti.lang.kernel_impl.Kernel, "launch_kernel", lambda *a: launches.append(a) or own(*a), raising=True
    )
    for twice in (False, True, False, True, False):
        add(1, 1.0, twice, np.zeros(1))
    assert len(launches) == 2


def test_a_direct_launch_survives_a_new_start():
    """What was compiled for a program that is gone is not launched."""
    backend.start(threads=1)
    backend.start(threads=1)
    total, _, add = _kernels()
    seen = np.zeros(1)
    add(1, 1.0, False, seen)
    add(1, 1.0, False, seen)
    assert total[None] == 2.0


@pytest.mark.parametrize(
    "arguments", [(1, 1.0, False), (1.5, 1.0, False, np.zeros(1)), ("1", 1.0, False, np.zeros(1))]
)
def test_a_direct_launch_refuses_what_the_kernel_refuses(arguments):
    """Too few arguments, a fraction for an integer, a text: an exception, not a wrong number."""
    backend.start(threads=1)
    _, _, add = _kernels()
    add(1, 1.0, False, np.zeros(1))  # the next launch is direct
    with pytest.raises((TypeError, ti.TaichiCompilationError, ti.TaichiRuntimeError)):
        add(*arguments)
