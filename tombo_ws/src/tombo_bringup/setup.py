"""Installs tombo_bringup as an ament_python package."""

from glob import glob

from setuptools import find_packages, setup

NAME = "tombo_bringup"

setup(
    name=NAME,
    version="0.1.0",
    description="Launch files, configuration and the tombo command",
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
        (f"share/{NAME}/foxglove", glob("foxglove/*.json")),
        (f"share/{NAME}/rviz", glob("rviz/*.rviz")),
    ],
    install_requires=["setuptools"],
    extras_require={"test": ["pytest"]},
    zip_safe=False,
    entry_points={"console_scripts": ["tombo = tombo_bringup.cli.main:run"]},
)
