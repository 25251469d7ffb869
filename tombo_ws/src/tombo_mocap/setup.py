"""Installs the package as setup.cfg says."""

from setuptools import setup

setup()
