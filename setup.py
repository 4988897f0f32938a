"""What pyproject.toml cannot say: the folder configs/ is installed as a part of the package."""

from setuptools import find_packages, setup

setup(
    packages=[*find_packages(include=["taichi_slm*"]), "taichi_slm.configs"],
    package_dir={"taichi_slm.configs": "configs"},
    package_data={
        "taichi_slm": ["materials/alloys/*.yaml", "verification/data/*.csv", "benchmark/*.cpp", "py.typed"],
        "taichi_slm.configs": ["*.yaml", "schema.json"],
    },
)
