"""Installs tombo_px4 as an ament_python package."""

from glob import glob

from setuptools import find_packages, setup

NAME = "tombo_px4"

setup(
    name=NAME,
    version="0.1.0",
    description="MAVLink link and bridge to PX4, a simulated PX4, lockstep HIL",
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
            "px4_bridge_node = tombo_px4.px4_bridge_node:main",
            "px4_sim_node = tombo_px4.px4_sim_node:main",
            "hil_sim_node = tombo_px4.hil_sim_node:main",
        ]
    },
)
