"""Materials against known answers: the sulphur law, meeting densities, enthalpy and its inverse."""

import numpy as np
import pytest
from scipy.integrate import quad

from taichi_slm.config.material import Law, Material, MaterialOverride
from taichi_slm.errors import ConfigError
from taichi_slm.materials import plot
from taichi_slm.materials.laws import (
    evaluate,
    liquid_fraction,
    phase_value,
    slope,
    surface_tension,
    surface_tension_slope,
)
from taichi_slm.materials.library import alloy_names, load_alloy, resolve
from taichi_slm.materials.tables import KNOTS, SEGMENT_BASE, enthalpy_at, tabulate, temperature_at


def entry(**fields):
    return MaterialOverride.model_validate(fields)


FLUID = Material.model_validate(
    {
        "name": "fluid",
        "density": {"liquid": {"line": {"value": 1000, "slope": -1, "at": 1000}}},
        "heat_capacity": {"liquid": {"polynomial": [500, 0.1]}},
        "conductivity": {"liquid": {"table": [[300, 10], [700, 30]]}},
        "viscosity": {"liquid": {"constant": 0}},
        "maximum_temperature": 1500,
    }
)


# --------------------------------------------------------------------------- laws


def test_sulphur_law_hits_the_check_values():
    steel = load_alloy("steel_304")
    assert surface_tension(steel, [1809, 2300]) == pytest.approx([1.872, 1.722], abs=5e-4)
    assert surface_tension_slope(steel, [1809, 2300]) == pytest.approx([-1.08e-4, -3.97e-4], abs=5e-7)


def test_without_sulphur_the_law_is_a_line():
    law = Law.model_validate({"sulphur": {"sulphur_wt_percent": 0}})
    assert evaluate(law, 1909.0) == pytest.approx(1.943 - 4.3e-2)
    assert slope(law, 1909.0) == pytest.approx(-4.3e-4)


@pytest.mark.parametrize(
    "form",
    [
        {"constant": 3.0},
        {"polynomial": [1.0, 2e-3, -3e-7]},
        {"line": {"value": 2.0, "slope": -1e-3, "at": 900}},
        {"table": [[300, 1.0], [800, 2.0], [1500, 1.5]]},
        {"log10_arrhenius": [2385.2, -0.5958, 1e-3]},
        {"sulphur": {}},
    ],
    ids=lambda form: next(iter(form)),
)
def test_slope_is_the_derivative_of_the_law(form):
    law = Law.model_validate(form)
    T = np.array([[350.0, 700.0], [1400.0, 2500.0]])
    difference = (evaluate(law, T + 0.01) - evaluate(law, T - 0.01)) / 0.02
    assert slope(law, T) == pytest.approx(difference, rel=1e-6, abs=1e-12)
    assert slope(law, T).shape == T.shape


def test_surface_tension_stops_at_zero():
    titanium = load_alloy("Ti6Al4V")
    assert surface_tension(titanium, 4000.0) == 0.0
    assert surface_tension_slope(titanium, 4000.0) == 0.0


@pytest.mark.parametrize(("name", "at_solidus"), [("steel_304", 7442.5), ("steel_304_physical", 7332.5)])
def test_densities_meet_at_the_ends_of_the_mushy_zone(name, at_solidus):
    steel = load_alloy(name)
    assert phase_value(steel, "density", [1673, 1673 + 1e-9]) == pytest.approx([at_solidus] * 2)
    assert phase_value(steel, "density", [1773 - 1e-9, 1773]) == pytest.approx([6840] * 2)
    assert phase_value(steel, "density", 1723) == pytest.approx(0.5 * (at_solidus + 6840))


def test_mushy_slopes_are_those_of_eq_49():
    for name, printed in (("steel_304", -6.03), ("steel_304_physical", -4.925)):
        low, high = phase_value(load_alloy(name), "density", [1673, 1773])
        assert (high - low) / 100 == pytest.approx(printed, abs=6e-3)


def test_liquid_fraction_is_linear_in_the_band():
    assert liquid_fraction(load_alloy("steel_304"), [300, 1673, 1698, 1773, 3000]) == pytest.approx(
        [0, 0, 0.25, 1, 1]
    )
    assert liquid_fraction(FLUID, 300.0) == 1.0


def test_viscosity_of_the_mushy_zone():
    steel = load_alloy("steel_304")
    assert phase_value(steel, "viscosity", [300, 1673, 1723, 1773, 2500]) == pytest.approx(
        [0.1, 0.1, 0.055, 0.01, 0.01]
    )


# --------------------------------------------------------------------------- library


@pytest.mark.parametrize("name", alloy_names())
def test_every_number_of_an_alloy_has_a_source(name):
    alloy = load_alloy(name)
    for field in ("density", "heat_capacity", "conductivity", "viscosity"):
        laws = getattr(alloy, field)
        assert laws.liquid.source, field
        assert laws.solid is None or laws.solid.source, field
    assert alloy.surface_tension.source
    assert alloy.evaporation.source
    scalars = {"solidus", "liquidus", "latent_heat", "emissivity", "absorptivity", "mushy_viscosity_factor"}
    assert scalars <= set(alloy.sources)


def test_overrides_replace_whole_laws_and_scales_multiply():
    found = resolve(
        "top",
        {
            "top": entry(extends="middle", scale={"conductivity": 2}, latent_heat=1e5),
            "middle": entry(
                extends="steel_304",
                scale={"conductivity": 3},
                viscosity={"solid": {"constant": 1.0}, "liquid": {"constant": 0.01}},
            ),
        },
    )
    assert found.name == "top"
    assert found.latent_heat == 1e5
    assert phase_value(found, "conductivity", [300, 2000]) == pytest.approx([6 * 20.9, 6 * 209.3])
    # a solid law of the viscosity takes the place of an inherited factor
    assert phase_value(found, "viscosity", [1673, 1773]) == pytest.approx([1.0, 0.01])


def test_an_entry_may_bear_the_name_of_the_alloy_it_extends():
    found = resolve("steel_304", {"steel_304": entry(extends="steel_304", emissivity=0.9)})
    assert (found.emissivity, found.solidus) == (0.9, 1673)


@pytest.mark.parametrize(
    ("name", "entries", "sentence"),
    [
        ("steel_340", {}, "did you mean steel_304"),
        ("a", {"a": entry(extends="IN635")}, "did you mean IN625"),
        ("a", {"a": entry(extends="b"), "b": entry(extends="a")}, "a -> b -> a"),
        ("a", {"a": entry(extends="a")}, "a -> a"),
        ("a", {"a": entry(latent_heat=1)}, "no density"),
        ("a", {"a": entry(extends="steel_304", solidus=2000)}, "not below liquidus"),
    ],
)
def test_what_cannot_be_resolved_is_said(name, entries, sentence):
    with pytest.raises(ConfigError, match=sentence):
        resolve(name, entries)


# --------------------------------------------------------------------------- tables


@pytest.fixture(scope="module")
def tables():
    return tabulate([*(load_alloy(name) for name in alloy_names()), FLUID])


def test_knots(tables):
    steel = tables.names.index("steel_304")
    assert tables.temperature.shape == (len(tables.names), KNOTS)
    assert tables.temperature[steel, list(SEGMENT_BASE)] == pytest.approx([1, 1673, 1773, 10000])
    assert tables.temperature[-1, SEGMENT_BASE[2]] == 1.0  # no solid: the liquid segment begins at T_low
    for name in ("temperature", "enthalpy", "kirchhoff", "temperature_of_enthalpy"):
        assert (np.diff(getattr(tables, name)) > 0).all(), name


def test_temperature_and_enthalpy_are_inverse_to_round_off(tables):
    rng = np.random.default_rng(0)
    for m in range(len(tables.names)):
        T = rng.uniform(1.0, tables.segment_start[m, 3], 5000)
        H = enthalpy_at(tables, m, T)
        assert temperature_at(tables, m, H) == pytest.approx(T, rel=1e-14)
        assert enthalpy_at(tables, m, temperature_at(tables, m, H)) == pytest.approx(H, rel=1e-13, abs=1e-9)


def test_enthalpy_across_the_band_is_latent_plus_sensible(tables):
    steel = tables.names.index("steel_304")
    start = tables.enthalpy_start[steel]
    assert start[2] - start[1] == pytest.approx(2.6e5 + 0.5 * (711.2 + 937.4) * 100, rel=1e-14)
    assert tables.band_heat_capacity[steel] == pytest.approx(2600 + 0.5 * (711.2 + 937.4), rel=1e-14)
    middle = enthalpy_at(tables, steel, 1723.0)
    assert middle == pytest.approx(0.5 * (start[1] + start[2]), rel=1e-14)


def test_solid_enthalpy_carries_the_true_density(tables):
    steel = tables.names.index("steel_304")
    exact = quad(lambda T: 711.2 * (8020 - 0.42 * (T - 298)) / 7442.5, 293, 1673, epsabs=1e-6)[0]
    assert enthalpy_at(tables, steel, 1673.0) - enthalpy_at(tables, steel, 293.0) == pytest.approx(
        exact, rel=1e-6
    )
    assert tables.density[steel, 0] == pytest.approx(7442.5)
    free = tabulate([load_alloy("steel_304")], solid_density="true")
    assert free.enthalpy_start[0, 1] == pytest.approx(711.2 * 1672, rel=1e-13)
    assert (free.density == free.density_true).all()


@pytest.mark.parametrize("name", ["316L", "Ti6Al4V", "fluid"])
def test_integrals_against_quadrature(tables, name):
    m = tables.names.index(name)
    material = FLUID if name == "fluid" else load_alloy(name)
    limits = [p for p in (300, 700, 1267, 1269, material.solidus, material.liquidus) if p]
    low, high = 400.0, 1400.0
    knots, phi = tables.temperature[m], tables.kirchhoff[m]
    k = [int(np.searchsorted(knots, T)) for T in (low, high)]
    exact = quad(
        lambda T: float(phase_value(material, "conductivity", T)),
        knots[k[0]],
        knots[k[1]],
        points=[p for p in limits if low < p < high] or None,
        limit=200,
    )[0]
    assert phi[k[1]] - phi[k[0]] == pytest.approx(exact, rel=1e-9)


def test_inverse_table_holds_the_exact_temperature(tables):
    m = tables.names.index("316L")  # c(T) and rho(T) vary
    alloy = load_alloy("316L")
    held = float(phase_value(alloy, "density", alloy.solidus))

    def sensible(T):
        return float(phase_value(alloy, "heat_capacity", T) * phase_value(alloy, "density", T)) / held

    knot = 100
    H = tables.enthalpy_start[m, 1] * knot / SEGMENT_BASE[1]
    assert quad(sensible, 1.0, tables.temperature_of_enthalpy[m, knot])[0] == pytest.approx(H, rel=1e-10)


def test_a_law_that_vanishes_inside_the_table_is_refused():
    with pytest.raises(ConfigError, match="density is not positive at 2"):
        tabulate([FLUID.model_copy(update={"maximum_temperature": 2500.0})])


def test_a_temperature_outside_the_table_is_refused(tables):
    with pytest.raises(ConfigError, match="outside the tables"):
        enthalpy_at(tables, 0, [300.0, 20000.0])


# --------------------------------------------------------------------------- the picture


def curves(figure):
    """Label of an axis -> (temperatures, values) of all that is drawn there, in the order of temperature."""
    found = {}
    for axes in figure.axes:
        lines = [
            line for line in axes.lines if len(line.get_xdata()) > 2
        ]  # the others mark a temperature, or zero
        if lines:
            data = np.hstack([line.get_data() for line in lines])
            found[axes.get_ylabel()] = data[:, np.argsort(data[0], kind="stable")]
    return found


def test_the_picture_of_316l_has_the_values_of_its_sheet():
    """Values worked out by hand from alloys/316L.yaml; the curves have knots no further apart than 10 K."""
    found = curves(plot.draw(load_alloy("316L")))
    for label, T, value in (
        ("density [kg/m³]", 1000.0, 8084.2 - 420.86 - 38.94),
        ("density [kg/m³]", 1708.0, 7432.7 + 0.0393 * 1708 - 1.80e-4 * 1708**2),
        ("heat capacity [J/(kg K)]", 293.0, 459.3 + 0.1329 * 293),
        ("conductivity [W/(m K)]", 1675.0, 6.38 + 0.019 * 1675 - 2.45e-6 * 1675**2),
        ("viscosity [mPa s]", 1708.0, 10 ** (2385.2 / 1708 - 0.5958)),
        ("viscosity [mPa s]", 1675.0, 10 * 10 ** (2385.2 / 1708 - 0.5958)),
        ("surface tension [N/m]", 2708.0, 1.593 + 0.19),
        ("tension slope [mN/(m K)]", 2000.0, 0.19),
    ):
        # linear between knots: of the bent ones here, off by less than 1e-5 in the middle of 10 K
        assert np.interp(T, *found[label]) == pytest.approx(value, rel=1e-5), label
    T, pressure = found["vapour pressure [kPa]"]
    assert np.exp(np.interp(3090.0, T, np.log(pressure))) == pytest.approx(101.325, rel=1e-4)
    assert len(found) == 7
    assert all(np.diff(T).max() <= 10.0 for T, _ in found.values())
    assert found["viscosity [mPa s]"][0].min() == found["vapour pressure [kPa]"][0].min() == 1675.0


@pytest.mark.parametrize("name", alloy_names())
def test_the_picture_says_where_every_law_comes_from(name):
    alloy = load_alloy(name)
    figure = plot.draw(alloy)
    said = " ".join(axes.get_title(loc="left") for axes in figure.axes).replace("\n", " ")
    for law in (alloy.density, alloy.heat_capacity, alloy.conductivity, alloy.viscosity):
        assert law.liquid.source
        assert law.liquid.source in said
    assert alloy.surface_tension.source in said
    assert alloy.evaporation.source in said
    assert alloy.sources["mushy_viscosity_factor"] in said
    assert "no source given" not in said


def test_a_material_without_a_solid_has_a_picture():
    found = curves(plot.draw(FLUID.model_copy(update={"maximum_temperature": 900.0})))
    assert sorted(found) == [
        "conductivity [W/(m K)]", "density [kg/m³]", "heat capacity [J/(kg K)]", "viscosity [mPa s]",
    ]  # fmt: skip
    T, conductivity = found["conductivity [W/(m K)]"]
    assert (T[0], T[-1]) == (293.0, 900.0)
    assert conductivity[T == 700.0] == 30.0  # the row of the table itself


@pytest.mark.filterwarnings("error")  # matplotlib warns where the panels leave each other no room
def test_the_picture_is_a_file(tmp_path):
    from PIL import Image

    path = plot.plot_alloy("steel_304", tmp_path / "steel.png")
    with Image.open(path) as image:
        assert image.width > 1000
    assert plot.plot_alloy("316L", tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
    with pytest.raises(ConfigError, match="Did you mean '316L'"):
        plot.plot_alloy("316", tmp_path / "b.png")
    with pytest.raises(ConfigError, match=r"a picture is one of \.png, \.pdf, \.svg"):
        plot.plot_alloy("316L", tmp_path / "b.jpg")
    with pytest.raises(ConfigError, match="name it, as in"):
        plot.plot_alloy(None, tmp_path / "b.png")
