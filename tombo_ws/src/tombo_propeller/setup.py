"""Installs tombo_propeller as an ament_python package."""

from glob import glob

from setuptools import find_packages, setup

NAME = "tombo_propeller"

setup(
    name=NAME,
    version="0.1.0",
    description="Propeller workbench: the paper recomputed, design, flap angle from a film",
    license="MIT",
    maintainer="Tombo developers",
    maintainer_email="tombo@example.org",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed", "reproduce/*.yaml", "reproduce/assets/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml")),
        (f"share/{NAME}/launch", glob("launch/*.py")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
)
