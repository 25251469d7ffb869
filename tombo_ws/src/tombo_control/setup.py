"""Installs tombo_control as an ament_python package."""

from glob import glob

from setuptools import find_packages, setup

NAME = "tombo_control"

setup(
    name=NAME,
    version="0.1.0",
    description="Estimator, cascade, allocation and mission of the quadrotor",
    license="MIT",
    maintainer="Tombo developers",
    maintainer_email="tombo@example.org",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={NAME: ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/config", glob("config/*.yaml")),
        (f"share/{NAME}/launch", glob("launch/*.py")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={
        "console_scripts": [
            "controller_node = tombo_control.controller_node:main",
            "estimator_node = tombo_control.estimator_node:main",
            "mission_node = tombo_control.mission_node:main",
        ]
    },
)
