"""The launch of kernels: what `direct` saves must not change what a kernel does."""

import os
from pathlib import Path

import numpy as np
import pytest

from taichi_slm import backend
from taichi_slm.backend import direct, handed_out, ti
from taichi_slm.benchmark.drops import started
from taichi_slm.benchmark.measure import in_its_own_process
from taichi_slm.benchmark.scenes import track
from taichi_slm.run.simulation import Simulation


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


@pytest.mark.parametrize("alone", [False, True])
def test_rows_that_are_handed_out_are_visited_once_each(alone):
    """However many there are, by two threads; and kernels that are compiled later are as they were."""
    backend.start(threads=2)
    visits = ti.field(ti.i32, shape=5000)

    @handed_out
    @ti.kernel
    def visit(count: ti.i32, serial: ti.template()):
        ti.loop_config(serialize=serial)
        for row in range(count):
            visits[row] += 1

    options = ti.lang.impl.current_cfg()
    before = options.make_cpu_multithreading_loop, options.random_seed
    expected = np.zeros(5000, int)
    for count in (0, 1, 7, 600, 5000, 600):
        visit(count, alone)
        expected[:count] += 1
        assert (visits.to_numpy() == expected).all()
    assert (options.make_cpu_multithreading_loop, options.random_seed) == before


TASKS = Path("/proc/self/task")


@pytest.mark.skipif(not (TASKS / str(os.getpid()) / "schedstat").is_file(), reason="no times of threads")
def test_a_handed_out_loop_does_not_wait_for_one_thread():
    """All the work is in the first half of the rows: two threads share it, where Taichi gives it to one."""

    def on_processor():
        return {each.name: int((each / "schedstat").read_text().split()[0]) for each in TASKS.iterdir()}

    def share_of_the_second(decorated):
        backend.start(threads=2)
        field = ti.field(ti.f64, shape=2048)

        @decorated
        @ti.kernel
        def uneven(turns: ti.i32):
            for row in range(2048):
                total = 0.0
                for turn in range(turns if row < 1024 else 1):
                    total += ti.sqrt(field[row] + turn)
                field[row] = 1e-9 * total

        uneven(1)
        before = on_processor()
        uneven(100_000)  # in one launch: the next one's first half may be the other thread's
        spent = sorted(time - before.get(name, 0) for name, time in on_processor().items())
        return spent[-2] / spent[-1]

    # of the time of the busiest: nothing for the other half, and next to all where it is shared; under load one of
    # them may take what there is until the other is let in
    assert share_of_the_second(direct) < 0.1
    assert max(share_of_the_second(handed_out) for _ in range(3)) > 0.3


def test_a_kernel_that_does_not_compile_says_where():
    """`_short_places` leaves out the drawing of the line, not file, number and text."""
    backend.start(threads=1)

    @ti.kernel
    def broken():
        nobody_knows_this()  # noqa: F821

    with pytest.raises(ti.TaichiCompilationError, match=r'test_backend.py", line \d+, in broken') as raised:
        broken()
    assert "nobody_knows_this()" in str(raised.value)


@pytest.mark.parametrize(
    "built", [lambda: started("elliptic", 10, "rings", 1.0), lambda: Simulation(track(3), threads=1)]
)
def test_a_compiled_simulation_compiles_nothing_more(built, monkeypatch):
    """Steps are timed after `compile`; what was left to the first one took half of a small drop's time.

    And of a heat step of several stages, one was left to it: 0.2 s, twenty times the steps of a small case.
    """
    sim = built()
    sim.compile()
    kernel = ti.lang.kernel_impl.Kernel
    materialize, compiled = kernel.materialize, []

    def watch(self, key, **rest):
        if key not in self.compiled_kernels:
            compiled.append(self.func.__name__)
        return materialize(self, key, **rest)

    monkeypatch.setattr(kernel, "materialize", watch)
    for _ in range(20):
        sim.step()
    assert sim.activity.builds > 2
    assert compiled == []


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


def _track(monkeypatch, on_demand_from):
    monkeypatch.setattr(backend, "ON_DEMAND_FROM", on_demand_from)
    return Simulation(track(grains=3, duration=1e-3))


def test_fields_on_demand_hold_what_ordinary_ones_do(monkeypatch):
    """A track with all its physics; the compiler orders the sums of the two in another way, no more."""
    found = {}
    for kind, least in (("ordinary", 10**9), ("on demand", 1)):
        sim = _track(monkeypatch, least)
        for _ in range(30):
            sim.step()
        assert sim.rows.mobile > 20
        found[kind] = sim.arrays(("position", "temperature", "surface_force"))
    for name, scale in (("position", 4e-6), ("temperature", 1000.0), ("surface_force", 1e10)):
        # 120 flow steps of round-off, which a melt doubles every few hundred
        np.testing.assert_allclose(
            found["ordinary"][name], found["on demand"][name], rtol=0, atol=1e-6 * scale
        )


def test_a_run_with_fields_on_demand_resumes_with_the_same_bits(monkeypatch):
    """What had no memory when the checkpoint was written reads as zero on both sides."""
    sim = _track(monkeypatch, 1)
    for _ in range(30):
        sim.step()
    saved = sim.checkpoint()
    for _ in range(10):
        sim.step()
    expected = sim.checkpoint()
    again = _track(monkeypatch, 1)
    again.step()
    again.restore(saved)
    for _ in range(10):
        again.step()
    found = again.checkpoint()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


@pytest.mark.slow
def test_cold_metal_in_3d_takes_less_than_500_bytes_a_particle(tmp_path):
    """Of fields, lists and cells, in f64: the difference of two plates under one weld.

    Both compile: where one finds its kernels in the cache, the difference holds the compiler's memory.
    """
    few, many = (in_its_own_process("benchmark.scaling:cold_memory",
                                    {"TI_OFFLINE_CACHE_FILE_PATH": str(tmp_path / str(width))},
                                    width=width, precision="f64")
                 for width in (800e-6, 1000e-6))  # fmt: skip
    taken = [(many[what] - few[what]) / (many["particles"] - few["particles"]) for what in ("peak", "scene")]
    assert many["active particles"] == few["active particles"]
    assert taken[0] - taken[1] < 500
