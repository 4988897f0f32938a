"""The commands. No logic: each hands over to the package and prints what comes back."""

import sys
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from taichi_slm.errors import InterruptedRunError, SlmError


class Commands(TyperGroup):
    """The group of commands; Ctrl-C in any of them is this program's own error."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            raise InterruptedRunError("stopped by Ctrl-C") from None


app = typer.Typer(
    name="taichi-slm",
    cls=Commands,
    help="Laser melting of metal powder with smoothed particle hydrodynamics on Taichi.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


class Arch(str, Enum):
    """Where kernels run."""

    cpu = "cpu"
    cuda = "cuda"
    vulkan = "vulkan"
    metal = "metal"


class Precision(str, Enum):
    """Of the particle fields; accounts are always f64."""

    f64 = "f64"
    f32 = "f32"


Override = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one key, as in laser.power=200. Repeatable."),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        from taichi_slm import __version__

        print(__version__)
        raise typer.Exit


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Laser melting of metal powder with smoothed particle hydrodynamics on Taichi."""


@app.command()
def run(
    config: Annotated[Path, typer.Argument(help="The scene: a YAML file, or the name of one that ships.")],
    override: Override = None,
    out: Annotated[Path | None, typer.Option(help="Run folder; by default runs/NAME-TIME.")] = None,
    arch: Annotated[Arch, typer.Option(help="Where kernels run.")] = Arch.cpu,
    precision: Annotated[Precision, typer.Option(help="Of the particle fields.")] = Precision.f64,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; all by default.")] = None,
) -> None:
    """Simulate a scene into a new run folder."""
    from taichi_slm.config.load import load_config

    loaded = load_config(config, override or ())
    for warning in loaded.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    from taichi_slm.run.driver import execute

    execute(loaded, out=out, arch=arch.value, precision=precision.value, threads=threads)


@app.command()
def resume(
    run: Annotated[Path, typer.Argument(help="The folder of a run that stopped.")],
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; as before by default.")] = None,
) -> None:
    """Continue a run that stopped, from its last good checkpoint."""
    from taichi_slm.run.driver import resume as continue_run

    continue_run(run, threads=threads)


@app.command()
def validate(
    config: Annotated[
        list[Path], typer.Argument(help="One or more scenes: files, or names of those that ship.")
    ],
    override: Override = None,
) -> None:
    """Check scenes and say what they would take: particles, memory, steps, output. Under a second."""
    from taichi_slm.run.estimate import validate_all

    for line in validate_all(config, override or ()):
        print(line)


@app.command()
def scenes(
    name: Annotated[str | None, typer.Argument(help="Show this one, and what it would take.")] = None,
    write: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Copy it there instead, with the files it names.")
    ] = None,
) -> None:
    """List the scenes that ship, show one, or copy it out to start one's own."""
    from taichi_slm.config import shipped

    if name is None:
        print("\n".join(shipped.list_scenes()))
    elif write is not None:
        for file in shipped.copy_scene(name, write):
            print(file)
    else:
        from taichi_slm.run.estimate import validate_all

        path = shipped.scene_path(name)
        print(path.read_text(encoding="utf-8"))
        print("\n".join(validate_all([path])))


@app.command()
def render(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
    movie: Annotated[bool, typer.Option("--movie", help="A film of every snapshot (MP4) instead.")] = False,
    gif: Annotated[bool, typer.Option("--gif", help="The same as a GIF of at most 2 MB.")] = False,
    kind: Annotated[
        list[str] | None,
        typer.Option(
            help="Instead of output.images: temperature, state, velocity, surface_force, tracer, material; in "
            "3-D also cut, isosurface, streamlines."
        ),
    ] = None,
) -> None:
    """Draw the snapshots of a run as pictures, into its folder renders/."""
    from taichi_slm.render.movie import film_run
    from taichi_slm.render.views import render_run

    if movie or gif:
        pictures = (film_run(run, kind) if movie else []) + (film_run(run, kind, gif=True) if gif else [])
    else:
        pictures = render_run(run, kind)
    for picture in pictures:
        print(picture)


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
    form: Annotated[
        str, typer.Option("--format", metavar="NAME", help="xdmf, vtk, ply, gmsh, avsucd, csv or npz.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="By default export/particles.SUFFIX in the run folder."),
    ] = None,
    times: Annotated[
        str, typer.Option(metavar="WHICH", help="all, last, or a number of moments, evenly chosen.")
    ] = "all",
) -> None:
    """Write the snapshots of a run in another format; the numbers of particles stay what they are."""
    from taichi_slm.output.export import export_run

    for file in export_run(run, form, out, times):
        print(file)


@app.command()
def analyse(
    run: Annotated[Path, typer.Argument(help="A run folder.")],
) -> None:
    """Measure a run: melt pools, track, freezing, spatter, mixing, energy; into its folder analysis/."""
    from taichi_slm.analysis.analyse import analyse as measure

    for line in measure(run):
        print(line)


@app.command()
def compare(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN RUN ...", help="Two run folders or more.")],
    out: Annotated[Path, typer.Option(help="Folder of compare.csv and compare.png.")] = Path("comparison"),
) -> None:
    """Lay runs side by side: what was different, what came of it; a table, a CSV file, a plot."""
    from taichi_slm.analysis.compare import compare as lay_side_by_side

    lay_side_by_side(runs, out, _wide_console())


@app.command()
def schema(
    write: Annotated[Path | None, typer.Option(metavar="FILE", help="Write it there instead.")] = None,
) -> None:
    """Show the JSON schema of a config, for editors."""
    from taichi_slm.config.load import schema_json

    if write is None:
        print(schema_json(), end="")
    else:
        from taichi_slm.output.atomic import write_text

        write_text(write, schema_json())


@app.command()
def doctor() -> None:
    """Look at this machine: versions, backends, launch cost, pictures, folders; exit 1 if no run would work."""
    from taichi_slm.run.doctor import examine, judge

    findings = examine()
    from rich.markup import escape
    from rich.table import Table

    table = Table(show_header=False, box=None)
    for finding in findings:
        mark = "[green]ok[/]" if finding.good else "[red]!![/]" if finding.needed else "[yellow]--[/]"
        table.add_row(mark, finding.subject, escape(finding.value))
    _wide_console().print(table)
    judge(findings)


@app.command()
def materials(
    name: Annotated[str | None, typer.Argument(help="Show this one with its sources.")] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw its laws there instead: .png, .pdf or .svg.")
    ] = None,
) -> None:
    """List the alloys that ship, or show one as text or as curves."""
    if plot is not None:
        from taichi_slm.materials.plot import plot_alloy

        print(plot_alloy(name, plot))
        return
    from taichi_slm.materials.sheet import sheet

    for line in sheet(name):
        print(line)


class Tier(str, Enum):
    """How long the cases take: seconds; up to a few minutes; more."""

    quick = "quick"
    full = "full"
    long = "long"


@app.command()
def verify(
    case: Annotated[list[str] | None, typer.Argument(help="Cases by name; all by default.")] = None,
    tier: Annotated[Tier, typer.Option(help="Run all cases up to this tier.")] = Tier.long,
    out: Annotated[Path, typer.Option(help="Folder of verify.json and the plots.")] = Path("verify"),
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Cases at a time; as many as cores by default.")
    ] = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a Markdown page as well.")] = None,
    show: Annotated[bool, typer.Option("--list", help="Only list the cases.")] = False,
) -> None:
    """Compare with exact and measured answers: a table, verify.json and plots; exit 1 if a limit is broken."""
    import os

    from taichi_slm.verification.catalogue import chosen

    cases = chosen(case or (), tier.value)
    if show:
        for each in cases:
            print(f"{each.name:28s} {each.tier:6s} {each.title}")
        return

    from taichi_slm.verification.verify import verify as run_cases

    try:
        run_cases(cases, out, jobs or os.cpu_count() or 1, _wide_console())
    finally:
        if page is not None and (out / "verify.json").is_file():
            from taichi_slm.verification.page import write_page

            write_page(out / "verify.json", page)


def _wide_console() -> Any:
    """A console on which the table of a file is not folded to 80 columns."""
    from rich.console import Console

    console = Console()
    return console if console.is_terminal else Console(width=160)


@app.command()
def bench(
    subject: Annotated[
        list[str] | None,
        typer.Argument(help="accuracy, speed, skips, scaling, reach, peers; all by default."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of bench.json, the CSV files and the plots.")] = Path(
        "bench"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Small scenes, few rounds: a look, not a result.")
    ] = False,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a Markdown page as well.")] = None,
) -> None:
    """Measure this program on this machine: time against error, passes beside C++, skips, scaling, scenes, PySPH."""
    from taichi_slm.benchmark.bench import bench as measure

    report = measure(subject or (), out, quick, _wide_console())
    if page is not None:
        from taichi_slm.benchmark.report import write_page

        write_page(report, page)


@app.command()
def stress(
    subject: Annotated[
        list[str] | None,
        typer.Argument(help="drop, column, weld, track, drift, margins, endurance; all by default."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder of stress.json, the CSV files and the plots.")] = Path(
        "stress"
    ),
    quick: Annotated[
        bool, typer.Option("--quick", help="Few settings, wide brackets: a look, not a result.")
    ] = False,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Searches at a time; as many as cores by default.")
    ] = None,
    page: Annotated[Path | None, typer.Option(metavar="FILE", help="Write a Markdown page as well.")] = None,
) -> None:
    """Map how long a step may be before it is unstable, what it costs below, and the margin of every scene."""
    import os

    from taichi_slm.stress.stress import stress as measure

    report = measure(subject or (), out, quick, jobs or os.cpu_count() or 1, _wide_console())
    if page is not None:
        from taichi_slm.stress.page import write_page

        write_page(report, page)


@app.command()
def study(
    study: Annotated[Path, typer.Argument(help="The study, a YAML file.")],
    out: Annotated[Path | None, typer.Option(help="Folder of the study; by default studies/NAME.")] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Runs at a time; by default one per core.")] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="CPU threads of a run; by default they share the cores.")
    ] = None,
    arch: Annotated[Arch, typer.Option(help="Where kernels run.")] = Arch.cpu,
    precision: Annotated[Precision, typer.Option(help="Of the particle fields.")] = Precision.f64,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="A Dask scheduler, as tcp://host:8786.")
    ] = None,
    only: Annotated[int | None, typer.Option(metavar="N", help="Only run N, counted from 1.")] = None,
    retry: Annotated[bool, typer.Option("--retry", help="Do failed runs again.")] = False,
    check: Annotated[bool, typer.Option("--check", help="Only check the runs and list them.")] = False,
) -> None:
    """Do the runs of a study, or those that are missing, and collect them into one table."""
    from taichi_slm.study.plan import load_plan

    plan = load_plan(study, arch.value, precision.value)
    for warning in plan.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    if check:
        for run in plan.runs:
            print(f"{run.number:5d}  {run.name}")
        return
    from taichi_slm.study.conduct import conduct

    conduct(plan, out, jobs, threads, only, retry, scheduler)


def main() -> None:
    """Entry point: an error becomes a sentence on stderr and an exit code."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(InterruptedRunError.exit_code)
    except SlmError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_code)
    except Exception as error:
        from taichi_slm.run.crash_report import ending

        sentence, code = ending(error)
        print(sentence, file=sys.stderr)
        sys.exit(code)


if __name__ == "__main__":
    main()
